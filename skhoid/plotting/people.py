"""People: how well each is modelled, who has which effect, and the means of a group.

Open it to change a picture of several people in several conditions; parameters of people over time
are in ``ensembles``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from sklearn.utils.validation import check_is_fitted

from ..effects.registry import title_of
from ..text import p_text
from ._axes import (
    corner_note,
    cut,
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

KEY = ["subject", "condition"]
ALL = "all"  # the condition of what is of all conditions, or of the only one
# How well each person is modelled
MOST_COLUMNS = 5
ROW = 1.45  # inches for each row of panels
LOWEST = -20.0  # % VAF, of panels
FAR = 4.0  # ranges of the middle half, beyond which a run makes no room for itself
SPREAD = 0.3  # of the place of a condition, over which its runs are spread
NAME = 11  # letters of a name above a panel
LEVEL = 18  # letters of the names of all conditions, that can lie below a panel
TICK = 12  # letters of a condition
# Who has which effect
CELL = 0.22  # inches for each row of cells
LONGEST = 14  # letters of a person's name
LONG = 3  # letters, from which names stand upright where there are many
LEVEL_PEOPLE = 8  # whose names can lie
# Means of a group
STEP = 0.085  # of the range of what is drawn, from bracket to bracket
END = 0.02  # of it, the ends of a bracket
MOST_BRACKETS = 8
SIGNIFICANT = 0.05
DIAMOND = 0.32  # rows, half its height
LARGEST = 2.2  # times the smallest marker


@dataclass(kw_only=True, eq=False, repr=False)
class PeopleDisplay(Display):
    """The VAF of each person's runs in each condition, against the noise ceiling.

    A panel for each person. Dots are runs, each with its own fit where there is one, else with the
    fit of all runs of the person in the condition, which is the line. The dotted line is the noise
    ceiling: what any model could reach. What looks wrong is ringed in red, and so is the name of a
    person of whom anything does; a cross at the lower edge is a fit that failed. A triangle there
    is a run below the panel.

    Make it with :meth:`from_result`, or with the method ``plot`` of the result.

    Parameters
    ----------
    runs : DataFrame
        Columns ``subject``, ``condition``, ``run``, ``vaf``, ``vaf_group``.
    groups : DataFrame
        Columns ``subject``, ``condition``, ``vaf``, ``ceiling``, ``failure``.
    outlying : DataFrame
        Columns ``subject``, ``condition``, ``run``.

    Attributes
    ----------
    %(panels)
    people_, conditions_ : list
        The person of each panel, and the conditions from the left.
    dots_ : dict of Line2D
        VAF of the runs, by person: the main artists.
    levels_, ceilings_ : dict of LineCollection
        VAF of the fits of all runs, and noise ceilings, by person.
    outlying_, failed_ : dict of Line2D
        Rings around runs that look wrong, and crosses where a fit failed, by person; only those of
        whom there are any.

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

    runs: pd.DataFrame
    groups: pd.DataFrame
    outlying: pd.DataFrame

    @classmethod
    def from_result(cls, result: Any, *, people: Any = None, ax: Any = None, **kwargs: Any) -> Self:
        """Draw what :func:`skhoid.identify_people` found.

        Parameters
        ----------
        result : PeopleResult
            Of the identification.
        people : sequence of labels or None, default=None
            Whom to draw; None draws all.
        %(keywords)

        %(display)
        """
        known = list(dict.fromkeys(result.groups["subject"]))
        chosen = known if people is None else list(people)
        for who in chosen:
            check_option("a name in people", who, known)
        tables = {
            name: getattr(result, name).loc[lambda t: t["subject"].isin(chosen)]
            for name in ("runs", "groups", "outlying")
        }
        return cls(**tables).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        self.people_ = list(dict.fromkeys(self.groups["subject"]))
        self.conditions_ = list(dict.fromkeys(self.groups["condition"]))
        n = max(len(self.people_), 1)
        columns = min(n, MOST_COLUMNS)
        rows = -(-n // columns)
        names = short_names(self.conditions_, TICK)
        self._upright = sum(len(name) + 2 for name in names) > LEVEL
        height = 1.0 + 0.07 * max(map(len, names), default=0) * self._upright + ROW * rows
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
        self.dots_: dict[Any, Any] = {}
        self.levels_: dict[Any, Any] = {}
        self.ceilings_: dict[Any, Any] = {}
        self.outlying_: dict[Any, Any] = {}
        self.failed_: dict[Any, Any] = {}
        if not self.people_:
            say_instead(self.ax_, "Nobody.")
            return self
        low, high = self._limits()
        for number, (panel, who) in enumerate(zip(self.axes_, self.people_, strict=True)):
            self._draw(panel, who, low)
            self._name(panel, who, bottom=number + columns >= n)
            panel.set_ylim(low, high)
            place = panel.get_subplotspec()
            if place is None or place.is_first_col():
                panel.set_ylabel("VAF, %")
        self._restyle(kwargs, self.dots_)
        self._legend_of_panels()
        return self

    def _limits(self) -> tuple[float, float]:
        """Limits of all panels: they hold all but runs far below zero."""
        parts = [self.runs["vaf"], self.runs["vaf_group"], self.groups["vaf"]]
        values = np.concatenate([part.to_numpy(dtype=float) for part in parts])
        values = values[np.isfinite(values)]
        if not values.size:
            return 0.0, 102.0
        quarter, half, three = np.quantile(values, [0.25, 0.5, 0.75])
        typical = quarter - FAR * max(three - quarter, 2.0)
        low = max(float(values.min()), min(typical, half - 10.0), LOWEST)
        low -= 0.12 * (100.0 - low)
        return low, 102.0

    def _draw(self, panel: Any, who: Any, low: float) -> None:
        groups = self.groups[self.groups["subject"] == who].drop_duplicates(KEY)
        places = {name: place for place, name in enumerate(self.conditions_)}
        levels, ceilings = [], []
        for row in groups.to_dict("records"):
            place = places[row["condition"]]
            ends = place - 0.4, place + 0.4
            if np.isfinite(row["vaf"]):
                levels.append(tuple((end, max(row["vaf"], low)) for end in ends))
            if np.isfinite(row["ceiling"]):
                ceilings.append(tuple((end, row["ceiling"]) for end in ends))
        self.levels_[who] = _lines(panel, levels, "all runs in one fit", color=BLUE)
        style = ROLES["ceiling"].style(1.8)
        self.ceilings_[who] = _lines(panel, ceilings, ROLES["ceiling"].word, **style)
        at, vaf, wrong = self._dots_of(who, places)
        below = vaf < low
        shown = np.where(below, low + 0.03 * (100.0 - low), vaf)
        look: dict[str, Any] = {"ls": "none", "color": ROLES["measured"].colour}
        (self.dots_[who],) = panel.plot(
            at[~below], shown[~below], marker="o", ms=sized(3.5), label="run", **look
        )
        if below.any():
            look |= {"marker": "v", "ms": sized(5), "label": "run below the panel"}
            panel.plot(at[below], shown[below], **look)
        self._ring(panel, who, at[wrong], shown[wrong])
        failed = [places[c] for c in groups.loc[groups["failure"] != "", "condition"]]
        if failed:
            (self.failed_[who],) = panel.plot(
                failed,
                np.full(len(failed), low + 0.06 * (100.0 - low)),
                marker="x",
                ms=sized(6),
                mew=scaled(1.6),
                ls="none",
                color=ROLES["misfit"].colour,
                label="no fit",
            )

    def _dots_of(self, who: Any, places: dict[Any, int]) -> tuple[np.ndarray, ...]:
        """Places and VAF of the runs, and which of them look wrong."""
        runs = self.runs[self.runs["subject"] == who]
        odd = set(zip(*(self.outlying[n] for n in (*KEY, "run")), strict=True))
        at, vaf, wrong = [], [], []
        for condition, table in runs.groupby("condition", sort=False):
            steps = np.linspace(-SPREAD, SPREAD, len(table)) if len(table) > 1 else [0.0]
            own = table["vaf"].fillna(table["vaf_group"])
            for step, run, value in zip(steps, table["run"], own, strict=True):
                if np.isfinite(value):
                    at.append(places[condition] + step)
                    vaf.append(value)
                    wrong.append((who, condition, run) in odd)
        return np.array(at, float), np.array(vaf, float), np.array(wrong, bool)

    def _ring(self, panel: Any, who: Any, at: np.ndarray, vaf: np.ndarray) -> None:
        """Rings around runs; a person as a whole is a red name."""
        if at.size:
            look: dict[str, Any] = {
                "mec": ROLES["misfit"].colour,
                "mew": scaled(1.6),
                "mfc": "none",
            }
            (self.outlying_[who],) = panel.plot(
                at, vaf, ls="none", marker="o", ms=sized(8), label="looks wrong", **look
            )

    def _name(self, panel: Any, who: Any, bottom: bool) -> None:
        name = short_names(self.people_, NAME)[self.people_.index(who)]
        odd = (self.outlying["subject"] == who).any()
        colour = ROLES["misfit"].colour if odd else foreground()
        panel.set_title(f"{name} (!)" if odd else name, fontsize="medium", color=colour, pad=3)
        names = short_names(self.conditions_, TICK)
        panel.set_xticks(range(len(names)), [""] * len(names) if names == [ALL] else names)
        turn = {"rotation": 90} if self._upright else {}
        panel.tick_params(axis="x", length=0, labelsize="small", labelbottom=bottom, **turn)
        panel.set_xlim(-0.6, len(names) - 0.4)
        panel.yaxis.set_major_locator(MaxNLocator(4))
        panel.grid(alpha=0.3, axis="y")
        panel.spines[["top", "right"]].set_visible(False)


def _lines(panel: Any, segments: list[Any], label: str, **style: Any) -> Any:
    return panel.add_collection(
        LineCollection(segments, label=label if segments else None, **style)
    )


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
    cells_ : QuadMesh or None
        The cells, with the probabilities as their array (NaN where there is none).
    named_ : Line2D or None
        Dots where a person's own search named the effect.
    intervals_, shares_ : dict of Line2D
        Intervals of prevalence, the main artists, and prevalences, by (effect, condition).
    line_ : Line2D or None
        The least prevalence.

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
        %(keywords)

        %(display)
        """
        if not hasattr(search, "least_prevalence"):
            raise TypeError(
                f"{cls.__name__}.from_search draws a fitted GroupEffectSearch; got "
                f"{type(search).__name__}."
            )
        check_is_fitted(search, "prevalence_")
        return cls(
            prevalence=search.prevalence_,
            members=search.members_,
            people=list(dict.fromkeys(search.people_["subject"])),
            least_prevalence=float(search.least_prevalence),
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        rows = list(_rows(self.prevalence))
        self.rows_ = [(row.effect, row.condition) for row in rows]
        names = short_names(self.people, LONGEST)
        longest = max(map(len, names), default=1)
        upright = (len(names) > LEVEL_PEOPLE and longest > LONG) or longest > 2 * LONG
        height = 1.75 + (0.075 * longest if upright else 0.2) + CELL * len(rows)
        self._take_axes(
            ax,
            "people by effects, and prevalence",
            (1, 2),
            figsize=(7.2, max(2.6, height)),
            least_height=height,
            width_ratios=[max(len(names), 4) / 12 + 0.4, 0.9],
        )
        self.cells_: Any = None
        self.named_: Any = None
        self.line_: Any = None
        self.intervals_: dict[tuple[str, Any], Any] = {}
        self.shares_: dict[tuple[str, Any], Any] = {}
        if not rows:
            for panel, text in zip(self.axes_, ("No effect in anybody.", ""), strict=True):
                say_instead(panel, text)
            return self
        self._draw_cells(rows)
        self._draw_prevalence(rows)
        self._name(rows, names, upright)
        self._restyle(kwargs, self.intervals_)
        self._legend_of_panels()
        return self

    def _draw_cells(self, rows: list[Row]) -> None:
        panel = self.axes_[0]
        places = {who: column for column, who in enumerate(self.people)}
        at = {(row.effect, row.condition): number for number, row in enumerate(rows)}
        values = np.full((len(rows), len(self.people)), np.nan)
        named = []
        for member in self.members.itertuples(index=False):
            place = at.get((member.effect, member.condition)), places.get(member.subject)
            if place[0] is None or place[1] is None:
                continue
            values[place] = member.probability
            if member.named:
                named.append(place)
        edges = [np.arange(n + 1) - 0.5 for n in (len(self.people), len(rows))]
        self.cells_ = panel.pcolormesh(
            *edges,
            np.ma.masked_invalid(values),
            cmap=LinearSegmentedColormap.from_list("people", [background(), BLUE]),
            vmin=0.0,
            vmax=1.0,
            edgecolors=dimmed(0.25),
            linewidth=scaled(0.6),
        )
        square = {"marker": "s", "ls": "none", "ms": 8, "mec": dimmed(0.25)}
        panel.plot([], [], mfc=BLUE, **square, label="probable")
        panel.plot([], [], mfc=background(), **square, label="improbable")
        for number, row in enumerate(rows):
            if row.whole:  # has no cells
                panel.axhspan(number - 0.47, number + 0.47, color=background(), zorder=1.5)
        unknown = [
            (column, number)
            for number, row in enumerate(rows)
            if not row.whole
            for column in range(len(self.people))
            if not np.isfinite(values[number, column])
        ]
        if unknown:
            style = {"color": dimmed(0.45), "marker": "x", "ls": "none", "ms": 4}
            panel.plot(*zip(*unknown, strict=True), **style, label="cannot be told")
        if named:
            (self.named_,) = panel.plot(
                [column for _, column in named],
                [number for number, _ in named],
                marker="o",
                ms=4.5,
                ls="none",
                color=foreground(),
                markeredgecolor=background(),
                markeredgewidth=scaled(0.8),
                label="named in this person alone",
            )

    def _draw_prevalence(self, rows: list[Row]) -> None:
        panel = self.axes_[1]
        table = self.prevalence.set_index(["effect", "condition"])
        for number, row in enumerate(rows):
            key = row.effect, row.condition
            if key not in table.index:
                continue
            found = table.loc[[key]].iloc[0]
            colour = VERMILION if found["group"] else GREY
            (self.intervals_[key],) = panel.plot(
                [100 * found["low"], 100 * found["high"]],
                [number, number],
                color=colour,
                lw=scaled(2.2 if row.whole else 1.5),
                solid_capstyle="butt",
            )
            (self.shares_[key],) = panel.plot(
                [100 * found["share"]],
                [number],
                label="an effect of the group" if found["group"] else "no effect of the group",
                lw=0,
                color=colour,
                marker="D" if row.whole else "o",
                ms=5,
                markeredgecolor=foreground(),
                markeredgewidth=scaled(0.5),
            )
        self.line_ = panel.axvline(
            100 * self.least_prevalence,
            color=dimmed(),
            ls="--",
            lw=scaled(1.0),
            label=f"least of the group, {100 * self.least_prevalence:g} %",
        )

    def _name(self, rows: list[Row], names: list[str], upright: bool) -> None:
        matrix, forest = self.axes_
        group = set(self.prevalence.loc[self.prevalence["group"], "effect"])
        room = max(int(0.3 * letters(self.figure_)), 12)
        matrix.set_yticks(range(len(rows)), [cut(row.label, room) for row in rows])
        for label, row in zip(matrix.get_yticklabels(), rows, strict=True):
            if row.whole or row.condition == ALL:
                label.set_fontweight("bold" if row.effect in group else "normal")
            else:
                label.set(color=dimmed(0.8), fontsize="small")
        matrix.set_xticks(range(len(names)), names, rotation=90 if upright else 0, fontsize="small")
        matrix.tick_params(length=0)
        matrix.set_title("Who has it", fontsize="medium")
        forest.set_title("Prevalence", fontsize="medium")
        forest.set_xlim(-2, 102)
        forest.set_xlabel("% of people")
        forest.set_yticks(range(len(rows)), [""] * len(rows))
        forest.tick_params(axis="y", length=0)
        forest.grid(alpha=0.3, axis="x")
        forest.spines[["top", "right"]].set_visible(False)
        starts = [n for n, row in enumerate(rows) if n and row.effect != rows[n - 1].effect]
        for panel in self.axes_:
            panel.set_ylim(len(rows) - 0.5, -0.5)
            for start in starts:
                panel.axhline(start - 0.5, color=dimmed(0.5), lw=scaled(0.8))


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

    ``kind="conditions"`` joins the means of each person's runs by a thin line, with a gap where a
    condition is missing, beside the mean over people. Brackets join conditions whose contrast is
    significant, with its adjusted p-value; where there is none, a note says so.

    ``kind="forest"`` has a panel for each condition and a row for each person. Squares are means of
    the person's runs, weighted by their precision, and larger where they are more precise; they are
    not drawn towards the group. The diamond below is the mean over people of the mixed model, as
    wide as its interval, and the dashed line goes up from it.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    people : DataFrame
        ``subject``, ``condition``, ``estimate`` and, for a forest, ``low`` and ``high``.
    means : DataFrame
        ``condition``, ``mean``, ``low``, ``high`` over people.
    kind : {"conditions", "forest"}, default="conditions"
        What to draw.
    significant : DataFrame or None, default=None
        ``condition``, ``against``, ``p_adjusted`` of the contrasts to be told.
    label : str, default=""
        Label of the axis.
    note : str, default=""
        What is said in a corner of the conditions.
    group : str, default="mean"
        What the row of the diamond is called.

    Attributes
    ----------
    %(panels)
    conditions_, subjects_ : list
        Conditions from the left, and people from above.
    points_ : dict of Line2D
        The line of each person, or squares by (subject, condition).
    means_ : dict of Artist
        The line of the means by ``"all"``, or diamonds by condition.
    intervals_ : dict of Line2D
        Intervals of the means by condition, or those of people by (subject, condition).
    brackets_, texts_ : dict of Line2D, and of Text
        By (condition, against).

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
    >>> display.conditions_, list(display.brackets_)
    (['C1', 'C2'], [('C2', 'C1')])
    """

    people: pd.DataFrame
    means: pd.DataFrame
    kind: str = "conditions"
    significant: pd.DataFrame | None = None
    label: str = ""
    note: str = ""
    group: str = "mean"

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
        %(keywords)

        %(display)
        """
        significant = result.contrasts[result.contrasts["p_adjusted"] < SIGNIFICANT]
        note = ""
        if len(result.contrasts) and significant.empty:
            note = f"no contrast with p < {SIGNIFICANT} (Holm)"
        elif len(significant) > MOST_BRACKETS:
            note = f"{len(significant) - MOST_BRACKETS} more contrasts are significant"
            significant = significant.sort_values("p_adjusted").iloc[:MOST_BRACKETS]
        return cls(
            people=result.own_means,
            means=result.effects,
            kind=kind,
            significant=significant[["condition", "against", "p_adjusted"]],
            label=with_unit(parameter_symbol(result.parameter), result.unit),
            note=note,
            group="geometric mean" if result.transform == "log" else "mean",
        ).plot(ax, **kwargs)

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
        self.conditions_ = list(self.means["condition"])
        self.subjects_ = list(dict.fromkeys(self.people["subject"]))
        self.points_: dict[Any, Any] = {}
        self.means_: dict[Any, Any] = {}
        self.intervals_: dict[Any, Any] = {}
        self.brackets_: dict[tuple[Any, Any], Any] = {}
        self.texts_: dict[tuple[Any, Any], Any] = {}
        if self.kind == "conditions":
            self._plot_conditions(ax, kwargs)
        else:
            self._plot_forest(ax, kwargs)
        return self

    def _plot_conditions(self, ax: Any, kwargs: dict[str, Any]) -> None:
        n, told = len(self.conditions_), self.significant
        spans = [] if told is None else [self._span(row) for row in told.to_dict("records")]
        size = page_width(2.4 + 0.9 * n, 1), 3.4 + 0.14 * len(spans)
        self._take_axes(ax, "people over conditions", figsize=size)
        panel, places = self.ax_, np.arange(n)
        wide = self.people.pivot_table(
            index="subject", columns="condition", values="estimate", sort=False
        ).reindex(columns=self.conditions_)
        thin: dict[str, Any] = {"lw": scaled(0.7), "marker": "o", "ms": sized(2.0), "zorder": 1.8}
        for subject, row in wide.iterrows():
            (self.points_[subject],) = panel.plot(
                places,
                row.to_numpy(dtype=float),
                color=GREY,
                label="people, mean of runs",
                **thin,
            )
        for place, row in zip(places, self.means.to_dict("records"), strict=True):
            (self.intervals_[row["condition"]],) = panel.plot(
                [place] * 2, [row["low"], row["high"]], color=BLUE, lw=scaled(2.4), zorder=2.3
            )
        (self.means_[ALL],) = panel.plot(
            places,
            self.means["mean"].to_numpy(dtype=float),
            color=BLUE,
            lw=scaled(1.6),
            marker="D",
            ms=sized(5.0),
            zorder=2.4,
            label="mean over people, with interval",
        )
        self._draw_brackets(spans, wide.to_numpy(dtype=float))
        panel.set_xticks(places, list(map(str, self.conditions_)))
        panel.set_xlim(-0.4, n - 0.6)
        panel.set_ylabel(self.label)
        panel.grid(axis="y", alpha=0.3)
        if self.note:
            corner_note(panel, self.note, ("top", "right"))
        self._restyle(kwargs, self.means_, self.intervals_)
        self._legend_of_panels()

    def _span(self, row: dict[Any, Any]) -> tuple[int, int, dict[Any, Any]]:
        """From where to where a bracket goes."""
        a, b = sorted(map(self.conditions_.index, (row["condition"], row["against"])))
        return a, b, row

    def _draw_brackets(self, spans: list[tuple[int, int, dict[Any, Any]]], drawn: Any) -> None:
        """Brackets above what is drawn, the short ones lowest."""
        ends = self.means[["low", "high"]].to_numpy(dtype=float)
        low = min(np.nanmin(drawn), ends.min())
        high = max(np.nanmax(drawn), ends.max())
        size = (high - low) or abs(high) or 1.0
        for level, (a, b, row) in enumerate(sorted(spans, key=lambda s: (s[1] - s[0], s[0]))):
            key = row["condition"], row["against"]
            y = high + size * STEP * (level + 0.8)
            ys = [y - END * size, y, y, y - END * size]
            (self.brackets_[key],) = self.ax_.plot(
                [a, a, b, b], ys, color=foreground(), lw=scaled(0.8), zorder=2.0
            )
            place: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": "x-small"}
            text = p_text(row["p_adjusted"])
            self.texts_[key] = self.ax_.text(0.5 * (a + b), y, text, **place)
        top = high + size * (STEP * (len(spans) + 0.9) if spans else 0.12 if self.note else 0.06)
        self.ax_.set_ylim(low - 0.06 * size, top)

    def _plot_forest(self, ax: Any, kwargs: dict[str, Any]) -> None:
        n, columns = len(self.subjects_), len(self.conditions_)
        self._take_axes(
            ax,
            f"one for each of {columns} conditions",
            (1, columns),
            figsize=(page_width(max(4.8, 1.2 + 2.4 * columns), columns), 1.3 + 0.26 * (n + 1)),
            sharex=True,
            sharey=True,
        )
        narrowest = float((self.people["high"] - self.people["low"]).min())
        for column, condition in enumerate(self.conditions_):
            panel, colour = self.axes_[column], series_colour(column)
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
            self._draw_diamond(panel, condition, n)
            panel.set_yticks(range(n + 1), [*map(str, self.subjects_), self.group])
            panel.set_ylim(n + 0.6, -0.6)
            panel.grid(axis="x", alpha=0.3)
            panel.set_xlabel(self.label)
            if columns > 1 or condition != ALL:
                panel.set_title(str(condition))
        self._restyle(kwargs, self.points_)

    def _draw_diamond(self, panel: Any, condition: Any, n: int) -> None:
        low, mean, high = (
            self.means.loc[self.means["condition"] == condition, ["low", "mean", "high"]]
            .iloc[0]
            .astype(float)
        )
        corners = [(low, n), (mean, n - DIAMOND), (high, n), (mean, n + DIAMOND)]
        look: dict[str, Any] = {"facecolor": foreground(), "edgecolor": "none", "zorder": 2.2}
        self.means_[condition] = panel.add_patch(Polygon(corners, closed=True, **look))
        dashes: dict[str, Any] = {"ls": "--", "lw": scaled(0.8), "zorder": 1.5}
        panel.plot([mean] * 2, [-0.6, n], color=foreground(), **dashes)
