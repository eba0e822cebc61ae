"""People: how well each is modelled, who has which effect, and the means of a group.

Parameters of people over time are in ``parameters``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from sklearn.utils.validation import check_is_fitted

from ..effects.registry import title_of
from ..text import p_text
from ._axes import (
    corner_note,
    cut,
    draw_arrow,
    letters,
    parameter_symbol,
    say_instead,
    short_names,
    with_unit,
)
from ._display import PAGE, Display, check_option, page_width
from ._roles import (
    BLUE,
    GREY,
    ROLES,
    VERMILION,
    background,
    dimmed,
    foreground,
    scaled,
    series_colour,
    sized,
)

ALL = "all"  # the condition of what is of all conditions, or of the only one
LONGEST = 14  # letters of a person's name
# How well each person is modelled
MOST_COLUMNS = 5
ROW = 1.45  # inches for each row of panels
LOWEST = -20.0  # % VAF, of panels
SPREAD = 0.3  # of the place of a condition, over which its runs are spread
# Who has which effect
CELL = 0.22  # inches for each row of cells
# Means of a group
STEP = 0.085  # of the range of what is drawn, from bracket to bracket
MOST_BRACKETS = 8
SIGNIFICANT = 0.05


@dataclass(kw_only=True, eq=False, repr=False)
class PeopleDisplay(Display):
    """The VAF of each person's runs in each condition, against the noise ceiling.

    A panel for each person. Dots are runs, each with its own fit where there is one, else with the
    fit of all runs of the person in the condition, which is the line. The dotted line is the noise
    ceiling, a lower bound (an arrow) of what a model could reach. What looks wrong is ringed in
    red, and so is the name of a person of whom anything does; a cross at the lower edge is a fit
    that failed. A triangle there is a run below the panel.

    Make it with :meth:`from_result`, or with the method ``plot`` of the result.

    Parameters
    ----------
    result : PeopleResult
        Of :func:`skhoid.identify_people`; its ``runs``, ``groups`` and ``outlying`` are drawn.
    people : sequence of labels or None, default=None
        Whom to draw; None draws all.

    Attributes
    ----------
    %(panels)
    people_, conditions_ : list
        The person of each panel, and the conditions from the left.

    See Also
    --------
    skhoid.identify_people : Makes what is drawn.
    GroupEffectsDisplay : Who has which effect.

    Examples
    --------
    >>> from skhoid import ARXRegressor, identify_people, simulate_experiment
    >>> from skhoid.plotting import PeopleDisplay
    >>> X, y = simulate_experiment(2, "C1", runs=2, duration=20.48, random_state=0)
    >>> result = identify_people(ARXRegressor(nk=29), X, y, ceiling=False)
    >>> display = PeopleDisplay.from_result(result)
    >>> display.people_, display.conditions_
    (['S1', 'S2'], ['C1'])
    """

    result: Any
    people: Sequence[Any] | None = None

    @classmethod
    def from_result(
        cls, result: Any, *, people: Sequence[Any] | None = None, ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw what :func:`skhoid.identify_people` found.

        Parameters
        ----------
        result : PeopleResult
            Of the identification.
        people : sequence of labels or None, default=None
            Whom to draw; None draws all.
        """
        return cls(result=result, people=people).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        groups, runs = self.result.groups, self.result.runs
        known = list(dict.fromkeys(groups["subject"]))
        self.people_ = known if self.people is None else list(self.people)
        for who in self.people_:
            check_option("a name in people", who, known)
        self.conditions_ = list(dict.fromkeys(groups["condition"]))
        n = max(len(self.people_), 1)
        columns = min(n, MOST_COLUMNS)
        rows = -(-n // columns)
        names = short_names(self.conditions_, 12)
        upright = sum(len(name) + 2 for name in names) > 18
        height = 1.0 + 0.07 * max(map(len, names), default=0) * upright + ROW * rows
        self._take_axes(
            ax,
            "one for each person",
            (rows, columns),
            used=range(n),
            figsize=(min(PAGE, 1.2 + 2.2 * columns), height),
            least_height=height,
            sharex=True,
            sharey=True,
        )
        if not self.people_:
            say_instead(self.ax_, "Nobody.")
            return self
        values = pd.concat([runs["vaf"], runs["vaf_group"], groups["vaf"]]).astype(float)
        lowest = values[np.isfinite(values)].min()
        low = max(float(np.nan_to_num(lowest)), LOWEST)
        low -= 0.12 * (100.0 - low)
        dots = []
        titles = short_names(self.people_, 11)
        for number, (panel, who, title) in enumerate(
            zip(self.axes_, self.people_, titles, strict=True)
        ):
            dots.append(self._draw(panel, who, low))
            odd = (self.result.outlying["subject"] == who).any()
            colour = ROLES["misfit"].colour if odd else foreground()
            title += " (!)" if odd else ""
            panel.set_title(title, fontsize="medium", color=colour, pad=3)
            panel.set_xticks(range(len(names)), [""] * len(names) if names == [ALL] else names)
            panel.tick_params(axis="x", length=0, labelsize="small", rotation=90 * upright)
            panel.tick_params(axis="x", labelbottom=number + columns >= n)
            panel.set_xlim(-0.6, len(names) - 0.4)
            panel.yaxis.set_major_locator(MaxNLocator(4))
            panel.grid(alpha=0.3, axis="y")
            panel.spines[["top", "right"]].set_visible(False)
            panel.set_ylim(low, 102.0)
            if not self._own or number % columns == 0:
                panel.set_ylabel("VAF, %")
        self._restyle(kwargs, dots)
        self._legend_of_panels()
        return self

    def _draw(self, panel: Any, who: Any, low: float) -> Any:
        """Levels and runs of a person; return the dots."""
        groups, runs = self.result.groups, self.result.runs
        groups = groups[groups["subject"] == who].drop_duplicates("condition")
        for row in groups.to_dict("records"):
            place = self.conditions_.index(row["condition"])
            ends = place - 0.4, place + 0.4
            if np.isfinite(row["vaf"]):
                look: dict[str, Any] = {"color": BLUE, "label": "all runs in one fit"}
                panel.plot(ends, [max(row["vaf"], low)] * 2, **look)
            if np.isfinite(row["ceiling"]):
                role = ROLES["ceiling"]
                panel.plot(ends, [row["ceiling"]] * 2, label=role.word, **role.style(1.8))
                draw_arrow(panel, (sum(ends) / 2, row["ceiling"]), (0.0, 10.0), role.colour)
            if row["failure"] != "":
                at = low + 0.06 * (100.0 - low)
                look = {"marker": "x", "ms": sized(6), "mew": scaled(1.6), "ls": "none"}
                panel.plot(place, at, color=ROLES["misfit"].colour, label="no fit", **look)
        runs = runs[runs["subject"] == who]
        vaf = runs["vaf"].fillna(runs["vaf_group"]).astype(float)
        runs = runs.assign(vaf=vaf)[np.isfinite(vaf)]
        of_condition = runs.groupby("condition", sort=False)
        number, of = of_condition.cumcount(), of_condition["run"].transform("size")
        places = runs["condition"].map(self.conditions_.index)
        at = places + np.where(of > 1, SPREAD * (2 * number / (of - 1).clip(lower=1) - 1), 0.0)
        below = runs["vaf"] < low
        shown = runs["vaf"].where(~below, low + 0.03 * (100.0 - low))
        look = {"ls": "none", "color": ROLES["measured"].colour}
        dots = panel.plot(at[~below], shown[~below], marker="o", ms=sized(3.5), label="run", **look)
        if below.any():
            look |= {"marker": "v", "ms": sized(5), "label": "run below the panel"}
            panel.plot(at[below], shown[below], **look)
        key = ["subject", "condition", "run"]
        odd = pd.MultiIndex.from_frame(runs[key]).isin(
            pd.MultiIndex.from_frame(self.result.outlying[key])
        )
        if odd.any():
            look = {"mec": ROLES["misfit"].colour, "mew": scaled(1.6), "mfc": "none", "ls": "none"}
            panel.plot(at[odd], shown[odd], marker="o", ms=sized(8), label="looks wrong", **look)
        return dots


class Row(NamedTuple):
    """A row of both panels; that of an effect over all its conditions has no cells."""

    effect: str
    condition: Any
    label: str
    whole: bool


@dataclass(kw_only=True, eq=False, repr=False)
class GroupEffectsDisplay(Display):
    """Who has which effect, and its prevalence.

    Left, a row for each effect, and below it one for each condition; a column for each person.
    Cells are the darker the more probable the effect is in that person; a dot is where the person's
    own search named it; a crossed cell is where the data cannot tell. Right, the prevalence of each
    effect, the share of people who have it, with its credible interval. The dashed line is the
    prevalence that an effect of the group exceeds; such effects are red, and their names bold.

    Make it with :meth:`from_search`, or with the method ``plot`` of the search.

    Parameters
    ----------
    prevalence, members : DataFrame
        ``prevalence_`` and ``members_`` of the search.
    people : sequence of labels
        The people, in order.
    least_prevalence : float, default=0.25
        Where the line is.

    Attributes
    ----------
    %(panels)
    rows_ : list of (effect, condition)
        The rows, from the top; the condition is ``"all"`` in those over all conditions.

    See Also
    --------
    skhoid.GroupEffectSearch : Makes what is drawn.
    PeopleDisplay : How well each person is modelled.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting import GroupEffectsDisplay
    >>> members = pd.DataFrame(
    ...     {
    ...         "subject": ["S1", "S2", "S3"],
    ...         "condition": "all",
    ...         "effect": "saturation",
    ...         "probability": [0.99, 0.97, 0.02],
    ...         "named": [True, False, False],
    ...     }
    ... )
    >>> prevalence = pd.DataFrame(
    ...     {
    ...         "effect": ["saturation"],
    ...         "condition": ["all"],
    ...         "share": [0.6],
    ...         "low": [0.2],
    ...         "high": [0.93],
    ...         "group": [False],
    ...     }
    ... )
    >>> display = GroupEffectsDisplay(
    ...     prevalence=prevalence, members=members, people=["S1", "S2", "S3"]
    ... ).plot()
    >>> display.rows_
    [('saturation', 'all')]
    """

    prevalence: pd.DataFrame
    members: pd.DataFrame
    people: Any
    least_prevalence: float = 0.25

    @classmethod
    def from_search(cls, search: Any, *, ax: Any = None, **kwargs: Any) -> Self:
        """Draw what a search in a group found.

        Parameters
        ----------
        search : fitted GroupEffectSearch
            The search.
        """
        check_is_fitted(search, "prevalence_")
        return cls(
            prevalence=search.prevalence_,
            members=search.members_,
            people=list(dict.fromkeys(search.people_["subject"])),
            least_prevalence=float(search.least_prevalence),
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        rows = list(_rows(self.prevalence))
        self.rows_ = [(row.effect, row.condition) for row in rows]
        names = short_names(self.people, LONGEST)
        longest = max(map(len, names), default=1)
        upright = len(names) * longest > 30
        height = 1.75 + (0.075 * longest if upright else 0.2) + CELL * len(rows)
        self._take_axes(
            ax,
            "people by effects, and prevalence",
            (1, 2),
            figsize=(7.2, max(2.6, height)),
            least_height=height,
            width_ratios=[max(len(names), 4) / 12 + 0.4, 0.9],
        )
        matrix, forest = self.axes_
        if not rows:
            say_instead(matrix, "No effect in anybody.")
            say_instead(forest, "")
            return self
        self._draw_cells(matrix, rows)
        intervals = self._draw_prevalence(forest, rows)
        self._name_rows(rows)
        matrix.set_xticks(range(len(names)), names, rotation=90 if upright else 0, fontsize="small")
        starts = [n for n, row in enumerate(rows) if n and row.effect != rows[n - 1].effect]
        for panel in self.axes_:
            panel.set_ylim(len(rows) - 0.5, -0.5)
            for start in starts:
                panel.axhline(start - 0.5, color=dimmed(0.5), lw=scaled(0.8))
        self._restyle(kwargs, intervals)
        self._legend_of_panels()
        return self

    def _draw_cells(self, panel: Any, rows: list[Row]) -> None:
        index = pd.MultiIndex.from_tuples(self.rows_, names=["effect", "condition"])
        table = self.members.pivot_table(
            index=["effect", "condition"], columns="subject", values=["probability", "named"]
        ).reindex(index)
        values, named = (
            table[name].reindex(columns=self.people).to_numpy(dtype=float)
            for name in ("probability", "named")
        )
        edges = [np.arange(n + 1) - 0.5 for n in (len(self.people), len(rows))]
        panel.pcolormesh(
            *edges,
            np.ma.masked_invalid(values),
            cmap=LinearSegmentedColormap.from_list("people", [background(), BLUE]),
            vmin=0.0,
            vmax=1.0,
            edgecolors=dimmed(0.25),
            linewidth=scaled(0.6),
        )
        square: dict[str, Any] = {"marker": "s", "ls": "none", "ms": 8, "mec": dimmed(0.25)}
        panel.plot([], [], mfc=BLUE, **square, label="probable")
        panel.plot([], [], mfc=background(), **square, label="improbable")
        whole = np.array([row.whole for row in rows])
        for number in np.flatnonzero(whole):  # has no cells
            panel.axhspan(number - 0.47, number + 0.47, color=background(), zorder=1.5)
        unknown = np.isnan(values) & ~whole[:, None]
        marks: tuple[tuple[np.ndarray, dict[str, Any]], ...] = (
            (unknown, {"color": dimmed(0.45), "marker": "x", "ms": 4, "label": "cannot be told"}),
            (
                named > 0,
                {
                    "color": foreground(),
                    "marker": "o",
                    "ms": 4.5,
                    "mec": background(),
                    "mew": scaled(0.8),
                    "label": "named in this person alone",
                },
            ),
        )
        for where, look in marks:
            row_numbers, columns = np.nonzero(where)
            if row_numbers.size:
                panel.plot(columns, row_numbers, ls="none", **look)

    def _draw_prevalence(self, panel: Any, rows: list[Row]) -> list[Any]:
        intervals = []
        table = self.prevalence.set_index(["effect", "condition"])
        for number, row in enumerate(rows):
            found = table.loc[[(row.effect, row.condition)]].iloc[0]
            colour = VERMILION if found["group"] else GREY
            look: dict[str, Any] = {"color": colour, "solid_capstyle": "butt"}
            ends = [100 * found["low"], 100 * found["high"]]
            intervals += panel.plot(
                ends, [number] * 2, lw=scaled(2.2 if row.whole else 1.5), **look
            )
            look = {"color": colour, "mec": foreground(), "mew": scaled(0.5), "ls": "none"}
            label = "an effect of the group" if found["group"] else "no effect of the group"
            marker = "D" if row.whole else "o"
            panel.plot(100 * found["share"], number, marker=marker, ms=5, label=label, **look)
        least = 100 * self.least_prevalence
        look = {"color": dimmed(), "ls": "--", "lw": scaled(1.0)}
        panel.axvline(least, label=f"least of the group, {least:g} %", **look)
        panel.set_title("Prevalence", fontsize="medium")
        panel.set_xlim(-2, 102)
        panel.set_xlabel("% of people")
        panel.set_yticks(range(len(rows)), [""] * len(rows))
        panel.tick_params(axis="y", length=0)
        panel.grid(alpha=0.3, axis="x")
        panel.spines[["top", "right"]].set_visible(False)
        return intervals

    def _name_rows(self, rows: list[Row]) -> None:
        matrix = self.axes_[0]
        group = set(self.prevalence.loc[self.prevalence["group"], "effect"])
        room = max(int(0.3 * letters(self.figure_)), 12)
        matrix.set_yticks(range(len(rows)), [cut(row.label, room) for row in rows])
        for label, row in zip(matrix.get_yticklabels(), rows, strict=True):
            if row.whole or row.condition == ALL:
                label.set_fontweight("bold" if row.effect in group else "normal")
            else:
                label.set(color=dimmed(0.8), fontsize="small")
        matrix.tick_params(length=0)
        matrix.set_title("Who has it", fontsize="medium")


def _rows(prevalence: pd.DataFrame) -> Iterator[Row]:
    """An effect over all conditions, and then each condition; one row where there is one."""
    for effect, table in prevalence.groupby("effect", sort=False):
        name, title = str(effect), title_of(str(effect))
        conditions = [c for c in table["condition"] if c != ALL]
        if len(conditions) == 1 and len(table) == 1:
            yield Row(name, conditions[0], title, False)
            continue
        yield Row(name, ALL, title, bool(conditions))
        for condition in conditions:
            yield Row(name, condition, f"  {condition}", False)


@dataclass(kw_only=True, eq=False, repr=False)
class GroupMeansDisplay(Display):
    """A parameter of people in conditions, and the mean of the group with its interval.

    ``kind="conditions"`` joins the means of each person's runs by a thin line, beside the mean over
    people. Brackets join conditions whose contrast is significant, with its adjusted p-value.

    ``kind="forest"`` has a panel for each condition and a row for each person: squares are means of
    the person's runs, larger where they are more precise. The diamond below is the mean over people
    of the mixed model, as wide as its interval.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    result : MixedModelResult
        Of :func:`skhoid.lab.experiment.mixed_model`.
    kind : {"conditions", "forest"}, default="conditions"
        What to draw.

    Attributes
    ----------
    %(panels)
    conditions_ : list
        Conditions from the left.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> from skhoid.plotting import GroupMeansDisplay
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
    >>> display = GroupMeansDisplay.from_result(mixed_model(table, "tau_e"))
    >>> display.conditions_
    ['C1', 'C2']
    """

    result: Any
    kind: str = "conditions"

    @classmethod
    def from_result(
        cls, result: Any, kind: str = "conditions", *, ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw the result of a mixed model.

        Parameters
        ----------
        result : MixedModelResult
            Of :func:`skhoid.lab.experiment.mixed_model`.
        kind : {"conditions", "forest"}, default="conditions"
            What to draw.
        """
        return cls(result=result, kind=kind).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(ax)
        **kwargs : dict
            Keywords of matplotlib for the means and intervals of conditions, or for the squares of
            a forest.

        %(self)
        """
        check_option("kind", self.kind, ("conditions", "forest"))
        self.conditions_ = list(self.result.effects["condition"])
        draw = self._plot_conditions if self.kind == "conditions" else self._plot_forest
        draw(ax, kwargs, with_unit(parameter_symbol(self.result.parameter), self.result.unit))
        return self

    def _plot_conditions(self, ax: Any, kwargs: dict[str, Any], label: str) -> None:
        result, n = self.result, len(self.conditions_)
        significant = result.contrasts[result.contrasts["p_adjusted"] < SIGNIFICANT]
        told = significant.nsmallest(MOST_BRACKETS, "p_adjusted")
        size = page_width(2.4 + 0.9 * n, 1), 3.4 + 0.14 * len(told)
        self._take_axes(ax, "people over conditions", figsize=size)
        panel, places = self.ax_, np.arange(n)
        wide = result.own_means.pivot_table(
            index="subject", columns="condition", values="estimate", sort=False
        ).reindex(columns=self.conditions_)
        thin: dict[str, Any] = {"lw": scaled(0.7), "marker": "o", "ms": sized(2.0), "zorder": 1.8}
        for values in wide.to_numpy(dtype=float):
            panel.plot(places, values, color=GREY, label="people, mean of runs", **thin)
        means = result.effects
        look: dict[str, Any] = {"color": BLUE, "lw": scaled(1.6), "ms": sized(5.0), "zorder": 2.4}
        around = np.abs(means[["low", "high"]].sub(means["mean"], axis=0)).to_numpy(dtype=float).T
        drawn = panel.errorbar(
            places,
            means["mean"],
            around,
            marker="D",
            elinewidth=scaled(2.4),
            label="mean over people, with interval",
            **look,
        )
        every = np.r_[wide.to_numpy(dtype=float).ravel(), means["low"], means["high"]]
        low, high = float(np.nanmin(every)), float(np.nanmax(every))
        step = STEP * ((high - low) or abs(high) or 1.0)
        spans = [
            (*sorted(map(self.conditions_.index, (row.condition, row.against))), row.p_adjusted)
            for row in told.itertuples()
        ]
        # Brackets above what is drawn, the short ones lowest.
        for a, b, p in sorted(spans, key=lambda span: (span[1] - span[0], span[0])):
            high += step
            ys = [high - step / 4, high, high, high - step / 4]
            panel.plot([a, a, b, b], ys, color=foreground(), lw=scaled(0.8), zorder=2.0)
            place: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": "x-small"}
            panel.text(0.5 * (a + b), high, p_text(p), **place)
        note = ""
        if len(result.contrasts) and significant.empty:
            note = f"no contrast with p < {SIGNIFICANT} (Holm)"
        elif len(significant) > len(told):
            note = f"{len(significant) - len(told)} more contrasts are significant"
        panel.set_ylim(low - 0.8 * step, high + (1.4 if note or spans else 0.8) * step)
        panel.set_xticks(places, list(map(str, self.conditions_)))
        panel.set_xlim(-0.4, n - 0.6)
        panel.set_ylabel(label)
        panel.grid(axis="y", alpha=0.3)
        if note:
            corner_note(panel, note, ("top", "right"))
        self._restyle(kwargs, list(drawn.lines))
        self._legend_of_panels()

    def _plot_forest(self, ax: Any, kwargs: dict[str, Any], label: str) -> None:
        people = self.result.own_means
        subjects = list(dict.fromkeys(people["subject"]))
        n, columns = len(subjects), len(self.conditions_)
        self._take_axes(
            ax,
            f"one for each of {columns} conditions",
            (1, columns),
            figsize=(page_width(max(4.8, 1.2 + 2.4 * columns), columns), 1.3 + 0.26 * (n + 1)),
            sharex=True,
            sharey=True,
        )
        width = people["high"] - people["low"]
        # A square of the most precise estimate is a good two times as large as the least.
        people = people.assign(size=3.0 + 3.6 * (width.min() / width.where(width > 0)).fillna(1.0))
        squares = []
        for column, (panel, condition) in enumerate(zip(self.axes_, self.conditions_, strict=True)):
            look: dict[str, Any] = {"color": series_colour(column), "zorder": 2.2}
            for row in people[people["condition"] == condition].itertuples():
                y = subjects.index(row.subject)
                panel.plot([row.low, row.high], [y, y], lw=scaled(1.3), **look)
                squares += panel.plot(row.estimate, y, marker="s", ms=sized(row.size), **look)
            self._draw_diamond(panel, condition, n)
            group = "geometric mean" if self.result.transform == "log" else "mean"
            panel.set_yticks(range(n + 1), [*map(str, subjects), group])
            panel.set_ylim(n + 0.6, -0.6)
            panel.grid(axis="x", alpha=0.3)
            panel.set_xlabel(label)
            if columns > 1 or condition != ALL:
                panel.set_title(str(condition))
        self._restyle(kwargs, squares)

    def _draw_diamond(self, panel: Any, condition: Any, n: int) -> None:
        means = self.result.effects
        row = means[means["condition"] == condition].iloc[0]
        low, mean, high = (float(row[name]) for name in ("low", "mean", "high"))
        corners = [(low, n), (mean, n - 0.32), (high, n), (mean, n + 0.32)]
        look: dict[str, Any] = {"facecolor": foreground(), "edgecolor": "none", "zorder": 2.2}
        panel.add_patch(Polygon(corners, closed=True, **look))
        dashes: dict[str, Any] = {"ls": "--", "lw": scaled(0.8), "zorder": 1.5}
        panel.plot([mean] * 2, [-0.6, n], color=foreground(), **dashes)
