"""A parameter of each person, with its interval, and the mean of the group below."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.patches import Polygon

from ._display import Display
from ._layout import page_width
from ._people import axis_label
from ._roles import foreground, scaled, series_colour, sized

DIAMOND = 0.32  # rows, half its height
LARGEST = 2.2  # times the smallest marker


@dataclass(kw_only=True, eq=False, repr=False)
class ParameterForestDisplay(Display):
    """Forest of people: the estimate of each with its interval, a panel for each condition.

    Squares are means of a person's runs, weighted by their precision, and larger where they are
    more precise; they are not drawn towards the group. The diamond below is the mean over people
    of the mixed model, as wide as its interval, and the dashed line goes up from it.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    people : DataFrame
        ``subject``, ``condition``, ``estimate``, ``low``, ``high``.
    means : DataFrame
        ``condition``, ``mean``, ``low``, ``high`` over people.
    label : str, default=""
        Label of the horizontal axis.
    group : str, default="mean"
        What the row of the diamond is called.

    Attributes
    ----------
    ax_ : ndarray of Axes, shape (n_conditions,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    conditions_, subjects_ : list
        The condition of each panel, and the person of each row, from above.
    points_ : dict of Line2D
        Squares by (subject, condition).
    intervals_ : dict of Line2D
        Intervals by (subject, condition).
    diamonds_ : dict of Polygon
        Means over people by condition.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> from skhoid.plotting.parameter_forest import ParameterForestDisplay
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
    >>> display = ParameterForestDisplay.from_result(mixed_model(table, "tau_e"))
    >>> display.subjects_, display.conditions_
    (['a', 'b', 'c', 'd'], ['C1', 'C2'])
    """

    people: pd.DataFrame
    means: pd.DataFrame
    label: str = ""
    group: str = "mean"

    @classmethod
    def from_result(
        cls,
        result: Any,
        *,
        ax: Any = None,
        point_kw: dict[str, Any] | None = None,
        interval_kw: dict[str, Any] | None = None,
        diamond_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw the result of a mixed model.

        Parameters
        ----------
        result : MixedModelResult
            Of :func:`skhoid.lab.experiment.mixed_model`.
        ax : sequence of Axes or None, default=None
            One for each condition. None makes a figure.
        point_kw : dict or None, default=None
            Keywords of matplotlib for the squares.
        interval_kw : dict or None, default=None
            Keywords of matplotlib for the intervals.
        diamond_kw : dict or None, default=None
            Keywords of matplotlib for the diamonds.

        Returns
        -------
        display : ParameterForestDisplay
        """
        found = result
        display = cls(
            people=found.own_means,
            means=found.effects,
            label=axis_label(found.parameter, found.unit),
            group="geometric mean" if found.transform == "log" else "mean",
        )
        return display.plot(ax, point_kw=point_kw, interval_kw=interval_kw, diamond_kw=diamond_kw)

    def plot(
        self,
        ax: Any = None,
        *,
        point_kw: dict[str, Any] | None = None,
        interval_kw: dict[str, Any] | None = None,
        diamond_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            One for each condition. None makes a figure.
        point_kw : dict or None, default=None
            Keywords of matplotlib for the squares.
        interval_kw : dict or None, default=None
            Keywords of matplotlib for the intervals.
        diamond_kw : dict or None, default=None
            Keywords of matplotlib for the diamonds.

        Returns
        -------
        self : ParameterForestDisplay
        """
        self.conditions_ = list(self.means["condition"])
        self.subjects_ = list(dict.fromkeys(self.people["subject"]))
        n, columns = len(self.subjects_), len(self.conditions_)
        self.ax_ = self._take_axes(
            ax,
            f"one for each of {columns} conditions",
            (1, columns),
            figsize=(page_width(max(4.8, 1.2 + 2.4 * columns), columns), 1.3 + 0.26 * (n + 1)),
            sharex=True,
            sharey=True,
        )
        self.points_: dict[tuple[Any, Any], Any] = {}
        self.intervals_: dict[tuple[Any, Any], Any] = {}
        self.diamonds_: dict[Any, Any] = {}
        widths = (self.people["high"] - self.people["low"]).to_numpy(dtype=float)
        for column, condition in enumerate(self.conditions_):
            self._draw(self.ax_[column], condition, series_colour(column), float(np.min(widths)))
        styles = {"point": point_kw, "interval": interval_kw, "diamond": diamond_kw}
        self._restyle(styles, point=self.points_, interval=self.intervals_, diamond=self.diamonds_)
        return self

    def _draw(self, panel: Any, condition: Any, colour: str, narrowest: float) -> None:
        n = len(self.subjects_)
        here = self.people[self.people["condition"] == condition]
        for row in here.to_dict("records"):
            key, y = (row["subject"], condition), self.subjects_.index(row["subject"])
            (self.intervals_[key],) = panel.plot(
                [row["low"], row["high"]], [y, y], color=colour, lw=scaled(1.3), zorder=2.0
            )
            width = row["high"] - row["low"]
            size = 3.0 * (1.0 + (LARGEST - 1.0) * (narrowest / width if width > 0.0 else 1.0))
            (self.points_[key],) = panel.plot(
                row["estimate"], y, marker="s", ms=sized(size), color=colour, zorder=2.2
            )
        mean = self.means[self.means["condition"] == condition].iloc[0]
        corners = [
            (mean["low"], n),
            (mean["mean"], n - DIAMOND),
            (mean["high"], n),
            (mean["mean"], n + DIAMOND),
        ]
        self.diamonds_[condition] = panel.add_patch(
            Polygon(corners, closed=True, facecolor=foreground(), edgecolor="none", zorder=2.2)
        )
        panel.plot(
            [mean["mean"]] * 2, [-0.6, n], color=foreground(), ls="--", lw=scaled(0.8), zorder=1.5
        )
        panel.set_yticks(range(n + 1), [*map(str, self.subjects_), self.group])
        panel.set_ylim(n + 0.6, -0.6)
        panel.grid(axis="x", alpha=0.3)
        panel.set_xlabel(self.label)
        if len(self.conditions_) > 1 or condition != "all":
            panel.set_title(str(condition))
