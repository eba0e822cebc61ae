"""Speed against noise of the methods of a tournament."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd

from ._display import Display
from ._roles import scaled, series_colour
from ._study import cell_text, check_table, ordered
from ._tournament import method_handles, method_style

if TYPE_CHECKING:
    from ..lab.studies import TournamentResult

NAME = "TournamentSettlingDisplay"
COLUMNS = ("method", "causal", "remnant_intensity", "noise", "settling")
NEVER = 1.5  # times the longest settling time, where methods are that do not settle
LINEAR = 2.0  # s, up to which the settling time is shown linearly; beyond, by its logarithm
TICKS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
LARGER = 0.45  # of the size of a mark, by which those of more remnant are larger


@dataclass(kw_only=True, eq=False, repr=False)
class TournamentSettlingDisplay(Display):
    """How soon an estimate has settled after a change, against how noisy it is before.

    A line for each method joins remnant intensities, of which the largest mark is the highest.
    Marks of causal methods are filled. A method that does not settle in the median run is at the
    upper edge. Both axes are logarithmic, that of time from 2 s on.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    points : DataFrame
        A row for each method and intensity: ``method``, ``causal``, ``remnant_intensity``,
        ``noise`` (RMSE before the change in %) and ``settling`` (s; infinite if it does not).

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    lines_ : dict of Line2D
        A line for each method.
    points_ : dict of Line2D
        The marks, by method and intensity.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting.tournament_settling import TournamentSettlingDisplay
    >>> points = pd.DataFrame(
    ...     {
    ...         "method": ["rls", "rls", "rls_smooth", "rls_smooth"],
    ...         "causal": [True, True, False, False],
    ...         "remnant_intensity": [0.05, 0.25] * 2,
    ...         "noise": [8.0, 22.0, 6.0, 15.0],
    ...         "settling": [4.2, 6.1, 2.0, 3.5],
    ...     }
    ... )
    >>> display = TournamentSettlingDisplay(points=points).plot()
    >>> display.lines_["rls"].get_ydata().tolist()
    [4.2, 6.1]
    """

    points: pd.DataFrame

    @classmethod
    def from_result(cls, result: TournamentResult, *, ax: Any = None, **styles: Any) -> Self:
        """Draw the methods of a tournament: medians over runs with a change.

        Parameters
        ----------
        result : TournamentResult
            The tournament.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : TournamentSettlingDisplay

        Raises
        ------
        ValueError
            If nothing changes in any of the runs.
        """
        rows = result.table
        rows = rows[(rows["parameter"] == "K_edot") & (rows["kind"] == "changing")]
        if rows.empty:
            raise ValueError("Nothing changes in the runs of this tournament.")
        if "remnant_intensity" not in rows:
            rows = rows.assign(remnant_intensity=np.nan)
        grouped = rows.groupby(["method", "remnant_intensity"], sort=False, dropna=False)
        points = grouped[["rmse_before", "settling"]].median().reset_index()
        points = points.rename(columns={"rmse_before": "noise"})
        points["causal"] = result.methods["causal"].reindex(points["method"]).to_numpy()
        return cls(points=points).plot(ax, **styles)

    def plot(self, ax: Any = None, *, line_kw: dict[str, Any] | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the lines.

        Returns
        -------
        self : TournamentSettlingDisplay
        """
        check_table(self.points, COLUMNS, NAME)
        (self.ax_,) = self._take_axes(ax, "one panel", figsize=(6.4, 5.2))
        methods = list(dict.fromkeys(self.points["method"]))
        intensities = ordered(self.points["remnant_intensity"])
        known = self.points["settling"].replace(np.inf, np.nan)
        never = NEVER * float(known.max()) if known.max() > 0 else 1.0
        self.lines_: dict[str, Any] = {}
        self.points_: dict[tuple[str, Any], Any] = {}
        for place, method in enumerate(methods):
            part = self.points[self.points["method"] == method].sort_values("remnant_intensity")
            height = part["settling"].replace(np.inf, never).to_numpy(float)
            noise = part["noise"].to_numpy(float)
            (self.lines_[method],) = self.ax_.plot(
                noise, height, color=series_colour(place), lw=scaled(0.9), zorder=2
            )
            look = method_style(methods, method, bool(part["causal"].iloc[0]))
            for x, y, P_n in zip(noise, height, part["remnant_intensity"], strict=True):
                size = 1.0 + LARGER * (_place(intensities, P_n) - (len(intensities) - 1) / 2)
                (mark,) = self.ax_.plot(x, y, zorder=3, **(look | {"ms": look["ms"] * size}))
                self.points_[method, P_n] = mark
        self.ax_.set_xscale("log")
        self.ax_.set_yscale("symlog", linthresh=LINEAR, linscale=0.6)
        ends = self.ax_.get_xlim()
        across = [t for t in TICKS if ends[0] <= t <= ends[1]]
        self.ax_.set_xticks(across, [f"{t:g}" for t in across])
        self.ax_.minorticks_off()
        up = {
            t: f"{t:g}" for t in (0.0, *TICKS[1:]) if t <= (known.max() if known.max() > 0 else 0)
        }
        if np.isinf(self.points["settling"]).any():
            up[never] = "never"
            self.ax_.set_ylim(top=1.2 * never)  # whole marks
        self.ax_.set_yticks([*up], [*up.values()])
        self.ax_.grid(alpha=0.3)
        self.ax_.set_ylim(bottom=min(0.0, float(np.nanmin([known.min(), 0.0]))))
        self.ax_.set_xlabel(r"RMSE of $K_{\dot e}$ before the change, %")
        self.ax_.set_ylabel("settling time, s")
        if len(intensities) > 1:
            said = [cell_text("remnant_intensity", P_n) for P_n in intensities]
            self.ax_.set_title(f"marks from small to large: {', '.join(said)}", fontsize="medium")
        self._restyle({"line": line_kw}, line=self.lines_)
        kinds = self.points.drop_duplicates("method").set_index("method")["causal"]
        self._legend(method_handles(methods, [kinds[method] for method in methods]), methods)
        return self


def _place(intensities: list[Any], P_n: Any) -> int:
    if pd.isna(P_n):
        return len(intensities) - 1
    return intensities.index(P_n)
