"""Tournaments of methods that follow an operator: who wins where, and by what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from ._axes import parameter_symbol, plain_logarithmic
from ._display import Display, check_option, figure_size, page_width
from ._roles import GREY, background, choose_readable, faded, scaled, series_colour, sized
from ._study import cell_text, check_table, ordered

COLUMNS = {
    "winners": ("panel", "row", "column", "method", "loss"),
    "bias": ("method", "parameter", "causal", "bias", "sd"),
    "settling": ("method", "causal", "remnant_intensity", "noise", "settling"),
}
MARKS = "os^Dv<>PXhp*d8H"
# Winners
CLOSE = 0.05  # of the loss, within which the next method is as good
INSIDE = 0.75  # of the size of a figure, that panels take
LEAST_CELL = 0.18  # inches of a cell with a number in it; with three quarters, rows have names
HATCHES = ("", "//", "..")  # of methods that share a colour
TITLES = {True: "causal methods", False: "offline methods"}
# Bias
SHOWN = ("K_e", "K_edot", "omega_nm", "zeta_nm")
BESIDE = 2  # panels in a row
MARGIN = 1.12
# Settling
NEVER = 1.5  # times the longest settling time, where methods are that do not settle
LINEAR = 2.0  # s, up to which the settling time is shown linearly; beyond, by its logarithm
TICKS = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
LARGER = 0.45  # of the size of a mark, by which those of more remnant are larger


@dataclass(kw_only=True, eq=False, repr=False)
class TournamentDisplay(Display):
    """The methods of a tournament: who does best where, and how they err.

    ``kind="winners"`` is a map of conditions (rows) and remnants (columns), coloured by the method
    that follows K_edot best there, with its loss; pale where the next is within 5 %. Causal and
    offline methods have a panel each. ``kind="bias"`` is the bias against the standard deviation of
    each method; arcs are lines of equal RMSE. ``kind="settling"`` is how soon an estimate has
    settled after a change, against how noisy it is before, a line for each method from little
    remnant (small marks) to much. Marks of causal methods are filled.

    Make it with :meth:`from_result`, or with the method ``plot`` of the result.

    Parameters
    ----------
    table : DataFrame
        Winners: a row for each cell, with ``panel``, ``row``, ``column``, ``method``, ``loss`` and,
        if known, ``next_loss``, that of the second method. Bias: a row for each method and
        parameter, with ``method``, ``parameter``, ``causal``, and size of the ``bias`` and ``sd``
        in % of the truth. Settling: a row for each method and intensity, with ``method``,
        ``causal``, ``remnant_intensity``, ``noise`` (RMSE before the change in %) and ``settling``
        (s; infinite if it does not).
    kind : {"winners", "bias", "settling"}, default="winners"
        What to draw.

    Attributes
    ----------
    %(panels)
    methods_ : list of str
        Methods in the order of the legend; of winners, the one that wins most first.
    points_ : list of Line2D
        Marks of bias and settling: the main artists.
    patches_ : list of Rectangle
        The coloured cells, the main artists of winners.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting import TournamentDisplay
    >>> winners = pd.DataFrame(
    ...     {
    ...         "panel": "causal methods",
    ...         "row": ["C1", "C1", "C4", "C4"],
    ...         "column": ["0.05", "0.15"] * 2,
    ...         "method": ["rls", "rls", "ukf", "rls"],
    ...         "loss": [4.0, 9.0, 11.0, 17.0],
    ...     }
    ... )
    >>> display = TournamentDisplay(table=winners).plot()
    >>> display.methods_
    ['rls', 'ukf']
    """

    table: pd.DataFrame
    kind: str = "winners"

    @classmethod
    def from_result(
        cls, result: Any, kind: str = "winners", *, ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw the result of a tournament.

        Parameters
        ----------
        result : TournamentResult
            The tournament.
        kind : {"winners", "bias", "settling"}, default="winners"
            The best method by cell; bias against standard deviation, medians over cells; noise
            before and settling time after the change, medians over runs with one.
        """
        check_option("kind", kind, COLUMNS)
        if kind == "winners":
            table = _winners(result)
        elif kind == "bias":
            table = result.by_method()[["bias", "sd"]].reset_index()
            table = table[table["parameter"].isin(SHOWN)]
            table = table.sort_values(
                "parameter", key=lambda column: column.map(SHOWN.index), kind="stable"
            )
        else:
            table = result.settling()
        known = result.methods["causal"].reindex(table["method"]).to_numpy()
        return cls(table=table.assign(causal=known), kind=kind).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        check_option("kind", self.kind, COLUMNS)
        check_table(self.table, COLUMNS[self.kind], type(self).__name__)
        self.methods_ = list(dict.fromkeys(self.table["method"]))
        self.points_: list[Any] = []
        self.patches_: list[Any] = []
        draw = {"winners": self._winners, "bias": self._bias, "settling": self._settling}
        draw[self.kind](ax)
        self._restyle(kwargs, self.patches_, self.points_)
        handles: list[Any] = [Patch(**self._look(method)) for method in self.methods_]
        if self.kind != "winners":
            kinds = self.table.drop_duplicates("method")["causal"]
            marks = [self._mark(m, bool(c)) for m, c in zip(self.methods_, kinds, strict=True)]
            handles = [Line2D([], [], **mark) for mark in marks]
        self._legend(handles, self.methods_)
        return self

    def _winners(self, ax: Any) -> None:
        names, rows, columns = (
            list(dict.fromkeys(self.table[name])) for name in ("panel", "row", "column")
        )
        counts = self.table["method"].value_counts(sort=False)
        self.methods_ = counts.sort_values(ascending=False, kind="stable").index.tolist()
        width = page_width(1.6 + len(names) * max(2.6, 0.42 * len(columns)), len(names))
        inside = INSIDE * figure_size((width, 1.0), 1)[0] / len(columns)
        side_by_side = inside / len(names) >= 0.75 * LEAST_CELL
        shape = (1, len(names)) if side_by_side else (len(names), 1)
        size = (width, 1.4 + shape[0] * (0.3 + 0.26 * len(rows)))
        self._take_axes(ax, "one per panel", shape, figsize=size)
        room = INSIDE * self.figure_.get_figwidth() / shape[1] / len(columns)
        height = INSIDE * self.figure_.get_figheight() / shape[0] / len(rows)
        for number, (name, panel) in enumerate(zip(names, self.axes_, strict=True)):
            part = self.table[self.table["panel"] == name]
            self._draw_cells(panel, part, rows, columns, numbers=room >= LEAST_CELL)
            panel.set_title(name, fontsize="medium")
            panel.set_xticks(range(len(columns)), columns, rotation=90, fontsize="small")
            letters = "small" if height >= LEAST_CELL else "xx-small"
            panel.set_yticks(range(len(rows)), rows, fontsize=letters)
            first = number % shape[1] == 0 or not self._own
            panel.tick_params(length=0, labelleft=first)
            panel.set_xlim(-0.5, len(columns) - 0.5)
            panel.set_ylim(len(rows) - 0.5, -0.5)
            panel.set_xlabel("$P_n$, order of the remnant" if "/" in columns[0] else "$P_n$")
        if self._own:
            self.figure_.suptitle("Best method, with RMSE over time, %", fontsize="medium")

    def _look(self, method: str) -> dict[str, Any]:
        place = self.methods_.index(method)
        return {
            "facecolor": series_colour(place),
            "edgecolor": background(),
            "hatch": HATCHES[place // 7 % len(HATCHES)],
            "lw": scaled(0.6),
        }

    def _draw_cells(
        self, panel: Any, part: pd.DataFrame, rows: list[str], columns: list[str], *, numbers: bool
    ) -> None:
        panel.set_facecolor(faded(GREY, 0.15))
        for cell in part.to_dict("records"):
            x, y = columns.index(cell["column"]), rows.index(cell["row"])
            look = self._look(cell["method"])
            if cell.get("next_loss", np.inf) <= (1 + CLOSE) * cell["loss"]:
                look["facecolor"] = faded(look["facecolor"], 0.5)
            self.patches_.append(panel.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **look)))
            if numbers:
                panel.text(
                    x,
                    y,
                    f"{cell['loss']:.{0 if cell['loss'] >= 9.95 else 1}f}",
                    ha="center",
                    va="center",
                    fontsize="x-small",
                    color=choose_readable(look["facecolor"]),
                    bbox={"facecolor": look["facecolor"], "edgecolor": "none", "pad": 0.0},
                )

    def _mark(self, method: str, causal: bool) -> dict[str, Any]:
        """Keywords of a method's mark: filled if it is causal."""
        place = self.methods_.index(method)
        colour = series_colour(place)
        return {
            "marker": MARKS[place % len(MARKS)],
            "ms": sized(6),
            "color": colour,
            "markerfacecolor": colour if causal else background(),
            "markeredgewidth": scaled(1.2),
            "ls": "none",
            "zorder": 3,
        }

    def _bias(self, ax: Any) -> None:
        parameters = list(dict.fromkeys(self.table["parameter"]))
        columns = min(len(parameters), BESIDE)
        rows = -(-len(parameters) // columns)
        self._take_axes(
            ax,
            "one per parameter",
            (rows, columns),
            used=range(len(parameters)),
            figsize=(page_width(1.0 + 3.3 * columns, columns), 1.0 + 2.7 * rows),
        )
        for number, (parameter, panel) in enumerate(zip(parameters, self.axes_, strict=True)):
            part = self.table[self.table["parameter"] == parameter]
            values = part[["bias", "sd"]].to_numpy(float)
            reach = values[np.isfinite(values).all(axis=1)]
            right, top = (MARGIN * reach.max(axis=0) if reach.size else np.ones(2)).clip(min=1.0)
            x, y = np.meshgrid(np.linspace(0, right, 121), np.linspace(0, top, 121))
            levels = MaxNLocator(6).tick_values(0, float(np.hypot(right, top)))[1:]
            look: dict[str, Any] = {"colors": GREY, "linewidths": scaled(0.7), "zorder": 1}
            panel.contour(x, y, np.hypot(x, y), levels=levels, **look)
            for row in part.to_dict("records"):
                mark = self._mark(row["method"], bool(row["causal"]))
                self.points_ += panel.plot(row["bias"], row["sd"], clip_on=False, **mark)
            panel.set_xlim(0, right)
            panel.set_ylim(0, top)
            panel.set_title(parameter_symbol(parameter), fontsize="medium")
            if not self._own or number + columns >= len(parameters):
                panel.set_xlabel("size of the bias, %")
            if not self._own or number % columns == 0:
                panel.set_ylabel("standard deviation, %")

    def _settling(self, ax: Any) -> None:
        self._take_axes(ax, "one panel", figsize=(6.4, 5.2))
        panel = self.ax_
        intensities = ordered(self.table["remnant_intensity"])
        known = self.table["settling"].replace(np.inf, np.nan)
        longest = float(known.max()) if known.max() > 0 else 0.0
        never = NEVER * longest or 1.0
        for place, method in enumerate(self.methods_):
            part = self.table[self.table["method"] == method].sort_values("remnant_intensity")
            height = part["settling"].replace(np.inf, never).to_numpy(float)
            noise = part["noise"].to_numpy(float)
            panel.plot(noise, height, color=series_colour(place), lw=scaled(0.9), zorder=2)
            mark = self._mark(method, bool(part["causal"].iloc[0]))
            for x, y, P_n in zip(noise, height, part["remnant_intensity"], strict=True):
                rank = len(intensities) - 1 if pd.isna(P_n) else intensities.index(P_n)
                size = 1.0 + LARGER * (rank - (len(intensities) - 1) / 2)
                self.points_ += panel.plot(x, y, **(mark | {"ms": mark["ms"] * size}))
        panel.set_xscale("log")
        panel.set_yscale("symlog", linthresh=LINEAR, linscale=0.6)
        plain_logarithmic(panel.xaxis, minor_ticks=False)
        ticks = {t: f"{t:g}" for t in TICKS if t <= longest}
        if np.isinf(self.table["settling"]).any():
            ticks[never] = "never"
            panel.set_ylim(top=1.2 * never)  # whole marks
        panel.set_yticks([*ticks], [*ticks.values()])
        panel.grid(alpha=0.3)
        panel.set_ylim(bottom=min(0.0, float(np.nanmin([known.min(), 0.0]))))
        panel.set_xlabel(r"RMSE of $K_{\dot e}$ before the change, %")
        panel.set_ylabel("settling time, s")
        if len(intensities) > 1:
            said = [cell_text("remnant_intensity", P_n) for P_n in intensities]
            panel.set_title(f"marks from small to large: {', '.join(said)}", fontsize="medium")


def _winners(result: Any) -> pd.DataFrame:
    """Who wins each cell, with the names of panels, rows and columns."""
    there = set(result.methods.loc[~result.methods["oracle"].astype(bool), "causal"])
    parts = [
        result.winners("follow", causal=causal).reset_index().assign(panel=title)
        for causal, title in TITLES.items()
        if causal in there
    ]
    winners = pd.concat(parts, ignore_index=True)
    # Rows are conditions, without what columns say.
    cells = [str(cell).split(", ") for cell in winners["cell"]]
    winners["row"] = [
        ", ".join(p for p in part if not p.startswith(("P_n ", "order "))) for part in cells
    ]
    intensity = winners.get("remnant_intensity", pd.Series(np.nan, index=winners.index))
    order = winners.get("remnant_order", pd.Series("", index=winners.index)).astype(str)
    several = len(set(order)) > 1
    winners["column"] = [
        ("own" if pd.isna(P) else f"{P:g}") + (f" / {m}" if several else "")
        for P, m in zip(intensity, order, strict=True)
    ]
    return winners
