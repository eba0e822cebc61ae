"""The best method of a tournament in each condition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from matplotlib.patches import Patch, Rectangle

from ._display import Display
from ._layout import figure_size, page_width
from ._roles import GREY, background, faded, readable_on, scaled, series_colour
from ._study import check_table

if TYPE_CHECKING:
    from ..lab.studies import TournamentResult

NAME = "TournamentWinnersDisplay"
COLUMNS = ("panel", "row", "column", "method", "loss")
CLOSE = 0.05  # of the loss, within which the next method is as good
INSIDE = 0.75  # of the width of a figure, that panels take
LEAST_WIDTH = 0.18  # inches of a cell with a number in it
ROWS = ((0.19, "small"), (0.14, "x-small"), (0.0, "xx-small"))  # inches of a row, and its letters
LEAST_COLUMN = 0.14  # inches of a cell in panels side by side, for its column's name
HATCHES = ("", "//", "..")  # of methods that share a colour
TITLES = {True: "causal methods", False: "offline methods"}


@dataclass(kw_only=True, eq=False, repr=False)
class TournamentWinnersDisplay(Display):
    """Map of conditions, coloured by the method that does best there, with its loss.

    A cell is pale where the next method is within 5 % of the best. Conditions are rows; columns are
    the remnant's intensity and the order of its filter. Causal and offline methods have a panel
    each.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    winners : DataFrame
        A row for each cell: ``panel``, ``row``, ``column``, ``method``, ``loss`` and, if known,
        ``next_loss``, that of the second method.
    loss : str, default="RMSE over time, %"
        What the numbers are.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_panels,)
        The panels.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    patches_ : list of dict
        The coloured cells of each panel, by row and column.
    texts_ : list of dict
        Their numbers; empty where cells are too narrow for them.
    methods_ : list of str
        Methods that win somewhere, in the order of the legend: the one that wins most first.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting.tournament_winners import TournamentWinnersDisplay
    >>> winners = pd.DataFrame(
    ...     {
    ...         "panel": "causal methods",
    ...         "row": ["C1", "C1", "C4", "C4"],
    ...         "column": ["0.05", "0.15"] * 2,
    ...         "method": ["rls", "rls", "ukf", "rls"],
    ...         "loss": [4.0, 9.0, 11.0, 17.0],
    ...     }
    ... )
    >>> display = TournamentWinnersDisplay(winners=winners).plot()
    >>> display.methods_
    ['rls', 'ukf']
    """

    winners: pd.DataFrame
    loss: str = "RMSE over time, %"

    @classmethod
    def from_result(
        cls,
        result: TournamentResult,
        *,
        question: str = "follow",
        parameter: str = "K_edot",
        causal: bool | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the winners of a tournament.

        Parameters
        ----------
        result : TournamentResult
            The tournament.
        question : {"follow", "final", "detect", "predict", "delay"}, default="follow"
            What methods are judged by; see :meth:`TournamentResult.ranking`.
        parameter : str, default="K_edot"
            For "follow" and "final".
        causal : bool or None, default=None
            Only causal methods, or only offline ones; None means a panel for each.
        ax : Axes, sequence of Axes or None, default=None
            One Axes per panel. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : TournamentWinnersDisplay
        """
        there = set(result.methods.loc[~result.methods["oracle"].astype(bool), "causal"])
        kinds = [kind for kind in ((True, False) if causal is None else (causal,)) if kind in there]
        parts = []
        for kind in kinds or [bool(causal)]:
            found = result.winners(question, causal=kind, parameter=parameter)
            parts.append(found.reset_index().assign(panel=TITLES[kind]))
        winners = pd.concat(parts, ignore_index=True)
        winners["row"], winners["column"] = _row_names(winners), _column_names(winners)
        loss = result.describe_loss(question, parameter=parameter)
        return cls(winners=winners, loss=loss).plot(ax, **styles)

    def plot(self, ax: Any = None, *, cell_kw: dict[str, Any] | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes or None, default=None
            One Axes per panel. None makes a figure.
        cell_kw : dict or None, default=None
            Keywords of matplotlib for the coloured cells.

        Returns
        -------
        self : TournamentWinnersDisplay
        """
        check_table(self.winners, COLUMNS, NAME)
        names = list(dict.fromkeys(self.winners["panel"]))
        rows = list(dict.fromkeys(self.winners["row"]))
        columns = list(dict.fromkeys(self.winners["column"]))
        counts = self.winners["method"].value_counts(sort=False)
        self.methods_ = counts.sort_values(ascending=False, kind="stable").index.tolist()
        width = page_width(1.6 + len(names) * max(2.6, 0.42 * len(columns)), len(names))
        inside = INSIDE * figure_size((width, 1.0), 1)[0]
        side_by_side = inside / len(names) / len(columns) >= LEAST_COLUMN
        shape = (1, len(names)) if side_by_side else (len(names), 1)
        size = (width, 1.4 + shape[0] * (0.3 + 0.26 * len(rows)))
        self.axes_ = self._take_axes(ax, "one per panel", shape, figsize=size)
        self.ax_ = self.axes_[0]
        self.patches_: list[dict[Any, Any]] = []
        self.texts_: list[dict[Any, Any]] = []
        room = INSIDE * self.figure_.get_figwidth() / shape[1] / len(columns)
        height = INSIDE * self.figure_.get_figheight() / shape[0] / len(rows)
        letters = next(size for least, size in ROWS if height >= least)
        for number, (name, panel) in enumerate(zip(names, self.axes_, strict=True)):
            part = self.winners[self.winners["panel"] == name]
            self._draw(panel, part, rows, columns, numbers=room >= LEAST_WIDTH)
            panel.set_title(name, fontsize="medium")
            panel.set_xticks(range(len(columns)), columns, rotation=90, fontsize="small")
            panel.set_yticks(range(len(rows)), rows, fontsize=letters)
            first = number % shape[1] == 0 or not self._own
            panel.tick_params(length=0, labelleft=first)
            panel.set_xlim(-0.5, len(columns) - 0.5)
            panel.set_ylim(len(rows) - 0.5, -0.5)
            panel.set_xlabel("$P_n$, order of the remnant" if "/" in columns[0] else "$P_n$")
        self._restyle({"cell": cell_kw}, cell=self.patches_)
        handles = [Patch(**self._look(method)) for method in self.methods_]
        if self._own:
            self.figure_.suptitle(f"Best method, with {self.loss}", fontsize="medium")
        self._legend(handles, self.methods_)
        return self

    def _look(self, method: str) -> dict[str, Any]:
        place = self.methods_.index(method)
        return {
            "facecolor": series_colour(place),
            "edgecolor": background(),
            "hatch": HATCHES[place // 7 % len(HATCHES)],
            "lw": scaled(0.6),
        }

    def _draw(
        self, panel: Any, part: pd.DataFrame, rows: list[str], columns: list[str], *, numbers: bool
    ) -> None:
        patches: dict[Any, Any] = {}
        texts: dict[Any, Any] = {}
        panel.set_facecolor(faded(GREY, 0.15))
        for cell in part.to_dict("records"):
            key = cell["row"], cell["column"]
            x, y = columns.index(key[1]), rows.index(key[0])
            look = self._look(cell["method"])
            if cell.get("next_loss", np.inf) <= (1 + CLOSE) * cell["loss"]:
                look["facecolor"] = faded(look["facecolor"], 0.5)
            patches[key] = panel.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **look))
            if numbers:
                texts[key] = panel.text(
                    x,
                    y,
                    f"{cell['loss']:.{0 if cell['loss'] >= 9.95 else 1}f}",
                    ha="center",
                    va="center",
                    fontsize="x-small",
                    color=readable_on(look["facecolor"]),
                    bbox={"facecolor": look["facecolor"], "edgecolor": "none", "pad": 0.0},
                )
        self.patches_.append(patches)
        self.texts_.append(texts)


def _row_names(winners: pd.DataFrame) -> list[str]:
    """Names of conditions, without what columns say."""
    parts = [str(cell).split(", ") for cell in winners["cell"]]
    return [", ".join(p for p in part if not p.startswith(("P_n ", "order "))) for part in parts]


def _column_names(winners: pd.DataFrame) -> list[str]:
    intensity = winners.get("remnant_intensity", pd.Series(np.nan, index=winners.index))
    order = winners.get("remnant_order", pd.Series("", index=winners.index))
    several = len(set(order.astype(str))) > 1
    names = [
        ("own" if pd.isna(P) else f"{P:g}") + (f" / {m}" if several else "")
        for P, m in zip(intensity, order, strict=True)
    ]
    return names
