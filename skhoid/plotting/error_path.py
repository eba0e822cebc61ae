"""Error path of a search: how the error falls as effects are added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..effects.registry import titles_of
from ..search import Verdict
from ._axes import letters_above, with_unit, wrapped
from ._comparison import percent, say_instead
from ._display import Display
from ._effects import UNKNOWN, attributes_of, step_labels, unit_of
from ._roles import ROLES, foreground, scaled

TAKEN = ("error_path_", "best_effects_", "verdict_", "predictions_")
LOWEST = -20.0  # percent; lower steps are cut and written
WIDTH = 1.25  # inches for each step
SMALL_GAP = 0.05  # points, below which nothing is left
LEAST_SPAN = 10.0  # points of VAF, so that a small gap looks small
BESIDE_EACH_OTHER = 0.25  # of a step, by which two values on it are off its middle
ABOVE, BELOW = 0.22, 0.18  # of the span of VAF, for the ceiling's text and for values
ROOM = 0.09  # of the span of VAF, that a line of text takes
OF_SMALL = 1.2  # letters of the small size to one of the medium size
IN_LOOP = "in the closed loop"


@dataclass(kw_only=True, eq=False, repr=False)
class ErrorPathDisplay(Display):
    """Held-out VAF as a staircase: one step for each effect that is added.

    Each step is named by all effects that its model has, and carries its VAF on runs that were held
    out of the fit. The dotted line is the noise ceiling: what any model driven by these channels
    can reach. The bar on the last step, in the colour of misfit, is what is left to explain. The
    thin dotted staircase is the VAF of the same runs in the closed loop, in which the model's own
    output moves x and e: what follows the remnant round the loop does not rise there. A second
    panel has the RMSE, where it is asked for.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    error_path : DataFrame
        ``error_path_`` of the search: one row a step, with the columns effect, vaf, rmse,
        ceiling and explainable_gap, and vaf_loop where the closed loop is known.
    best_effects : list of str
        ``best_effects_`` of the search.
    verdict : Verdict or str
        ``verdict_`` of the search.
    unit : str or None, default=None
        Unit of the output.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (1,) or (2,)
        VAF, and RMSE.
    figure_ : Figure
        The figure that holds them.
    stairs_ : dict of StepPatch
        The staircases, ``"vaf"``, ``"vaf_loop"`` where it is known, and ``"rmse"`` where it is
        drawn.
    ceilings_ : dict of StepPatch
        The ceiling in each panel; empty where it is not known.
    ceiling_text_ : Text or None
        What is written at it.
    gap_ : Line2D or None
        The bar, where something is left.
    labels_ : dict of list of Text
        Values on the steps, by the names of the staircases.

    See Also
    --------
    EffectStepsDisplay : The simulations before and after.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting import ErrorPathDisplay
    >>> path = pd.DataFrame(
    ...     {
    ...         "effect": ["baseline", "dead_zone"],
    ...         "vaf": [76.1, 86.8],
    ...         "rmse": [0.31, 0.23],
    ...         "ceiling": [87.0, 87.0],
    ...         "explainable_gap": [10.9, 0.2],
    ...     }
    ... )
    >>> display = ErrorPathDisplay(
    ...     error_path=path, best_effects=["dead_zone"], verdict="effects found", unit="deg"
    ... ).plot()
    >>> display.stairs_["vaf"].get_data().values.tolist()
    [76.1, 86.8]
    """

    error_path: pd.DataFrame
    best_effects: list[str]
    verdict: Verdict | str
    unit: str | None = None

    @classmethod
    def from_estimator(
        cls,
        search: Any,
        *,
        rmse: bool = False,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the path of a search.

        Parameters
        ----------
        search : fitted EffectSearchCV
            The search.
        rmse : bool, default=False
            Draw the RMSE too, see :meth:`plot`.
        ax : Axes, sequence of two Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ErrorPathDisplay
        """
        taken = attributes_of(search, TAKEN, cls.__name__)
        return cls(unit=unit_of(taken.pop("predictions")), **taken).plot(ax, rmse=rmse, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        rmse: bool = False,
        line_kw: dict[str, Any] | None = None,
        ceiling_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of two Axes or None, default=None
            Where to draw the VAF, and the RMSE. None makes a figure.
        rmse : bool, default=False
            Draw the RMSE too, in a figure made here; of given Axes, the second has it.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the staircases.
        ceiling_kw : dict or None, default=None
            Keywords of matplotlib for the ceiling.

        Returns
        -------
        self : ErrorPathDisplay
        """
        # Structure that no effect explains is no step: nothing was added.
        path = self.error_path[self.error_path["effect"] != UNKNOWN]
        self.axes_ = self._take_axes(
            ax,
            "VAF and, if wanted, RMSE",
            (1 + rmse, 1),
            allowed=(1, 2),
            sharex=True,
            figsize=(max(6.4, 0.9 + WIDTH * len(path)), 5.6 if rmse else 3.8),
        )
        self.stairs_: dict[str, Any] = {}
        self.ceilings_: dict[str, Any] = {}
        self.ceiling_text_: Any = None
        self.labels_: dict[str, list[Any]] = {}
        self.gap_: Any = None
        top = self.axes_[0]
        title = wrapped(self._title_text(path), letters_above(top))
        top.set_title(title, fontsize="medium")
        if not np.isfinite(path["vaf"].to_numpy(dtype=float)).any():
            for panel, what in zip(self.axes_, ("VAF", "RMSE"), strict=False):
                say_instead(panel, f"Held-out {what}: not available.")
            return self
        self._draw_vaf(top, path)
        if len(self.axes_) == 2:
            self._draw_rmse(self.axes_[1], path)
        self._restyle(
            {"line": line_kw, "ceiling": ceiling_kw}, line=self.stairs_, ceiling=self.ceilings_
        )
        each = max(int(OF_SMALL * letters_above(top) / len(path)) - 2, 6)
        labels = [wrapped(label, each) for label in step_labels(path["effect"])]
        for panel in self.axes_:
            panel.set_xlim(-0.5, len(path) - 0.5)
            panel.set_xticks(range(len(path)), labels, fontsize="small")
            panel.tick_params(axis="x", length=0, labelbottom=panel is self.axes_[-1])
        return self

    def _draw_vaf(self, panel: Axes, path: pd.DataFrame) -> None:
        vaf, ceiling = (path[name].to_numpy(dtype=float) for name in ("vaf", "ceiling"))
        in_loop = path.get("vaf_loop", pd.Series(np.nan, path.index)).to_numpy(dtype=float)
        known = np.r_[vaf, in_loop, ceiling]
        high = np.nanmax(known)
        low = min(max(np.nanmin(known), LOWEST), high - LEAST_SPAN)
        span = high - low
        self._draw_stairs(panel, "vaf", vaf, ceiling, [percent(v) for v in vaf])
        if np.isfinite(in_loop).any():
            self._draw_in_loop(panel, in_loop)
            self._part(vaf, in_loop, ceiling, ROOM * span)
        low -= 0.0 if np.nanmin(known) < LOWEST else BELOW * span
        panel.set_ylim(low, high + ABOVE * span)
        panel.set_ylabel("held-out VAF, %")
        self._say_what_is_left(panel, path)
        more = self.ceiling_text_.get_text().count("\n")
        panel.set_ylim(low, high + (1 + 0.6 * more) * ABOVE * span)

    def _draw_rmse(self, panel: Axes, path: pd.DataFrame) -> None:
        vaf, ceiling, rmse = (path[n].to_numpy(dtype=float) for n in ("vaf", "ceiling", "rmse"))
        # The power of the output, which VAF is relative to, is that of the RMSE at a VAF of 0.
        floor = rmse * np.sqrt(np.clip(100.0 - ceiling, 0.0, None) / (100.0 - vaf))
        self._draw_stairs(panel, "rmse", rmse, floor, [f"{v:#.3g}" for v in rmse])
        panel.set_ylim(0.0, 1.14 * panel.get_ylim()[1])
        panel.set_ylabel(with_unit("held-out RMSE", self.unit))

    def _title_text(self, path: pd.DataFrame) -> str:
        found = [name for name in self.best_effects if name != UNKNOWN]
        added = list(path["effect"][1:])
        verdict = str(self.verdict)
        verdict = verdict[:1].upper() + verdict[1:]
        vaf = path["vaf"].to_numpy(dtype=float)
        rise = f"held-out VAF from {vaf[0]:.1f}\xa0to\xa0{vaf[-1]:.1f}\xa0%"
        if not found:
            # Effects may be added without being named: none explains enough.
            return f"{verdict}; stand-ins: {titles_of(added)}" if added else verdict
        names = titles_of(found)
        text = f"{names[:1].upper()}{names[1:]}: {rise}" if np.isfinite(vaf).all() else names
        return f"{text}; {self.verdict}" if len(found) < len(self.best_effects) else text

    def _draw_stairs(
        self, panel: Axes, name: str, values: np.ndarray, ceiling: np.ndarray, labels: list[str]
    ) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        colour = ROLES["simulated" if name == "vaf" else "residual"].colour
        self.stairs_[name] = panel.stairs(
            values, edges, baseline=None, color=colour, lw=scaled(2.6), zorder=3
        )
        if np.isfinite(ceiling).any():
            role = ROLES["ceiling"]
            self.ceilings_[name] = panel.stairs(
                ceiling, edges, baseline=None, color=role.colour, lw=scaled(2.2), ls=role.line
            )
        self._label(panel, name, values, labels)

    def _draw_in_loop(self, panel: Axes, values: np.ndarray) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        self.stairs_["vaf_loop"] = panel.stairs(
            values, edges, baseline=None, color=foreground(), lw=scaled(1.0), ls=":"
        )
        labels = [percent(v) if np.isfinite(v) else "" for v in values]
        first = int(np.flatnonzero(np.isfinite(values))[0])
        labels[first] = f"{IN_LOOP}\n{labels[first]}"
        self._label(panel, "vaf_loop", values, labels)

    def _part(self, vaf: np.ndarray, in_loop: np.ndarray, ceiling: np.ndarray, room: float) -> None:
        """Move values of free run and closed loop apart, and away from the ceiling."""
        texts = zip(self.labels_["vaf"], self.labels_["vaf_loop"], strict=True)
        for (of_free, of_loop), free, loop, top in zip(texts, vaf, in_loop, ceiling, strict=True):
            high, of_high = max((free, of_free), (loop, of_loop), key=lambda pair: pair[0])
            if not np.isfinite(loop) or abs(free - loop) > 2 * room:
                continue
            if high >= LOWEST and not high + 2 * room > top:
                of_high.set_position((0, 4))
                of_high.set_va("bottom")
                continue
            for label, side in ((of_free, -1.0), (of_loop, 1.0)):
                label.xy = (label.xy[0] + side * BESIDE_EACH_OTHER, label.xy[1])

    def _label(
        self,
        panel: Axes,
        name: str,
        values: np.ndarray,
        labels: list[str],
    ) -> None:
        """Write the value on each step."""
        self.labels_[name] = []
        for i, (value, label) in enumerate(zip(values, labels, strict=True)):
            cut = name != "rmse" and value < LOWEST
            above = cut or name == "rmse"
            self.labels_[name].append(
                panel.annotate(
                    f"↓ {label}" if cut else label,
                    (i, LOWEST if cut else np.nan_to_num(value)),
                    xytext=(0, 4 if above else -4),
                    textcoords="offset points",
                    ha="center",
                    va="bottom" if above else "top",
                    fontsize="small" if name == "vaf_loop" else "medium",
                    visible=bool(label),
                )
            )

    def _say_what_is_left(self, panel: Axes, path: pd.DataFrame) -> None:
        """The ceiling named where it is drawn, and what is left up to it, as a bar and in words."""
        last = path.iloc[-1]
        vaf, ceiling, gap = (float(last[n]) for n in ("vaf", "ceiling", "explainable_gap"))
        left = UNKNOWN in self.best_effects
        if np.isnan(ceiling):
            text, at = "noise ceiling not known", panel.get_ylim()[1]
        else:
            # Remnant that passes a nonlinearity lowers the ceiling seen by a model without it.
            passed = (path["vaf"] > path["ceiling"] + SMALL_GAP).any()
            text, at = f"noise ceiling {percent(ceiling)}", max(vaf, ceiling)
            text += " (a lower bound)" if passed else ""
            some = gap >= SMALL_GAP
            text += f": {gap:.1f} points left to explain" if some else ": nothing left to explain"
            if some:
                (self.gap_,) = panel.plot(
                    [len(path) - 0.6] * 2,
                    [max(vaf, LOWEST), ceiling],
                    color=ROLES["misfit"].colour,
                    lw=scaled(5.0),
                    solid_capstyle="butt",
                )
        if left and not np.isnan(ceiling) and gap >= SMALL_GAP:
            text += ", not in the catalogue"
        self.ceiling_text_ = panel.annotate(
            wrapped(text, int(OF_SMALL * 0.9 * letters_above(panel))),
            (0.0, at),
            (4, -3 if np.isnan(ceiling) else 3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="top" if np.isnan(ceiling) else "bottom",
            fontsize="small",
        )
