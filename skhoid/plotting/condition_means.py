"""Each person over the conditions, and the mean of the group with its interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..text import p_text
from ._axes import corner_note
from ._display import Display
from ._layout import page_width
from ._people import axis_label
from ._roles import BLUE, GREY, foreground, scaled, sized

STEP = 0.085  # of the range of what is drawn, from bracket to bracket
TICK = 0.02  # of it, the ends of a bracket
MOST = 8  # brackets


@dataclass(kw_only=True, eq=False, repr=False)
class ConditionMeansDisplay(Display):
    """People as thin lines over the conditions, and the mean over people with its interval.

    A line joins the means of a person's runs, and has a gap where a condition is missing. Brackets
    join conditions whose contrast is significant, with its adjusted p-value; where there is none,
    a note says so.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    people : DataFrame
        ``subject``, ``condition``, ``estimate``.
    means : DataFrame
        ``condition``, ``mean``, ``low``, ``high``.
    significant : DataFrame
        ``condition``, ``against``, ``p_adjusted`` of the contrasts to be told.
    label : str, default=""
        Label of the vertical axis.
    note : str, default=""
        What is said in a corner.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    conditions_ : list
        From left to right.
    lines_ : dict of Line2D
        People, by subject.
    mean_ : Line2D
        Means over people.
    intervals_ : dict of Line2D
        Their intervals, by condition.
    brackets_ : dict of Line2D
        By (condition, against).
    texts_ : dict of Text
        The p-value of each bracket.
    note_ : Text or None
        What is said in a corner.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> from skhoid.plotting.condition_means import ConditionMeansDisplay
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> display = ConditionMeansDisplay.from_result(mixed_model(table, "tau_e"))
    >>> display.conditions_, list(display.brackets_)
    (['C1', 'C2'], [('C2', 'C1')])
    """

    people: pd.DataFrame
    means: pd.DataFrame
    significant: pd.DataFrame
    label: str = ""
    note: str = ""

    @classmethod
    def from_result(
        cls,
        result: Any,
        *,
        ax: Any = None,
        people_kw: dict[str, Any] | None = None,
        mean_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw the result of a mixed model.

        Parameters
        ----------
        result : MixedModelResult
            Of :func:`skhoid.lab.experiment.mixed_model`.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        people_kw : dict or None, default=None
            Keywords of matplotlib for the people.
        mean_kw : dict or None, default=None
            Keywords of matplotlib for the mean and its intervals.

        Returns
        -------
        display : ConditionMeansDisplay
        """
        found = result
        level = 1.0 - found.confidence
        significant = found.contrasts[found.contrasts["p_adjusted"] < level]
        note = ""
        if len(found.contrasts) and significant.empty:
            note = f"no contrast with p < {level:.2g} ({found.adjust})"
        elif len(significant) > MOST:
            note = f"{len(significant) - MOST} more contrasts are significant"
            significant = significant.sort_values("p_adjusted").iloc[:MOST]
        display = cls(
            people=found.own_means,
            means=found.effects,
            significant=significant[["condition", "against", "p_adjusted"]],
            label=axis_label(found.parameter, found.unit),
            note=note,
        )
        return display.plot(ax, people_kw=people_kw, mean_kw=mean_kw)

    def plot(
        self,
        ax: Any = None,
        *,
        people_kw: dict[str, Any] | None = None,
        mean_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        people_kw : dict or None, default=None
            Keywords of matplotlib for the people.
        mean_kw : dict or None, default=None
            Keywords of matplotlib for the mean and its intervals.

        Returns
        -------
        self : ConditionMeansDisplay
        """
        self.conditions_ = list(self.means["condition"])
        n = len(self.conditions_)
        width = page_width(2.4 + 0.9 * n, 1)
        height = 3.4 + 0.14 * len(self.significant)
        self.ax_ = self._take_axes(ax, "people over conditions", figsize=(width, height))[0]
        places = np.arange(n)
        self.lines_: dict[Any, Any] = {}
        wide = self.people.pivot_table(
            index="subject", columns="condition", values="estimate", sort=False
        ).reindex(columns=self.conditions_)
        for subject, row in wide.iterrows():
            (self.lines_[subject],) = self.ax_.plot(
                places,
                row.to_numpy(dtype=float),
                color=GREY,
                lw=scaled(0.7),
                marker="o",
                ms=sized(2.0),
                zorder=1.8,
                label="people, mean of runs",
            )
        self.intervals_: dict[Any, Any] = {}
        for place, row in zip(places, self.means.to_dict("records"), strict=True):
            (self.intervals_[row["condition"]],) = self.ax_.plot(
                [place] * 2, [row["low"], row["high"]], color=BLUE, lw=scaled(2.4), zorder=2.3
            )
        (self.mean_,) = self.ax_.plot(
            places,
            self.means["mean"].to_numpy(dtype=float),
            color=BLUE,
            lw=scaled(1.6),
            marker="D",
            ms=sized(5.0),
            zorder=2.4,
            label="mean over people, with interval",
        )
        self._draw_brackets(wide.to_numpy(dtype=float))
        self.ax_.set_xticks(places, list(map(str, self.conditions_)))
        self.ax_.set_xlim(-0.4, n - 0.6)
        self.ax_.set_ylabel(self.label)
        self.ax_.grid(axis="y", alpha=0.3)
        self.note_ = corner_note(self.ax_, self.note, ("top", "right")) if self.note else None
        styles = {"people": people_kw, "mean": mean_kw}
        self._restyle(styles, people=self.lines_, mean=[self.mean_, self.intervals_])
        self._legend_of_panels()
        return self

    def _draw_brackets(self, drawn: np.ndarray) -> None:
        """Brackets above what is drawn, the short ones lowest."""
        ends = self.means[["low", "high"]].to_numpy(dtype=float)
        low = min(np.nanmin(drawn), ends.min())
        high = max(np.nanmax(drawn), ends.max())
        size = (high - low) or abs(high) or 1.0
        spans = [
            (*sorted(map(self.conditions_.index, (row["condition"], row["against"]))), row)
            for row in self.significant.to_dict("records")
        ]
        self.brackets_: dict[tuple[Any, Any], Any] = {}
        self.texts_: dict[tuple[Any, Any], Any] = {}
        for level, (a, b, row) in enumerate(sorted(spans, key=lambda s: (s[1] - s[0], s[0]))):
            key = row["condition"], row["against"]
            y = high + size * STEP * (level + 0.8)
            (self.brackets_[key],) = self.ax_.plot(
                [a, a, b, b],
                [y - TICK * size, y, y, y - TICK * size],
                color=foreground(),
                lw=scaled(0.8),
                zorder=2.0,
            )
            self.texts_[key] = self.ax_.text(
                0.5 * (a + b), y, p_text(row["p_adjusted"]), ha="center", va="bottom",
                fontsize="x-small",
            )  # fmt: skip
        top = high + size * (STEP * (len(spans) + 0.9) if spans else 0.12 if self.note else 0.06)
        self.ax_.set_ylim(low - 0.06 * size, top)
