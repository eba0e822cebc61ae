"""Who has which effect, and how many people: a search in a group."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from sklearn.utils.validation import check_is_fitted

from ..effects.registry import title_of
from ._axes import letters
from ._comparison import say_instead
from ._display import Display
from ._roles import BLUE, GREY, VERMILION, background, dimmed, foreground, scaled
from ._short_names import cut, short_names

ALL = "all"
ROW = 0.22  # inches for each row
LONGEST = 14  # letters of a person's name in a picture
LONG = 3  # letters, from which names stand upright where there are many
LEVEL_PEOPLE = 8  # whose names can lie


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
    prevalence : DataFrame
        ``prevalence_`` of the search.
    members : DataFrame
        ``members_`` of the search.
    people : sequence of labels
        The people, in order.
    least_prevalence : float, default=0.25
        Where the line is.

    Attributes
    ----------
    ax_ : ndarray of Axes, shape (2,)
        The matrix and the prevalences.
    figure_ : Figure
        The figure that holds them.
    rows_ : list of (effect, condition)
        The rows, from the top; the condition is ``"all"`` in those over all conditions.
    cells_ : QuadMesh or None
        The cells, with the probabilities as their array (NaN where there is none).
    named_ : Line2D or None
        Dots where a person's own search named the effect.
    intervals_ : dict of Line2D
        Intervals of prevalence by (effect, condition).
    shares_ : dict of Line2D
        Prevalences by (effect, condition).
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
    def from_search(cls, search: Any, *, ax: Any = None, **styles: Any) -> Self:
        """Draw what a search in a group found.

        Parameters
        ----------
        search : fitted GroupEffectSearch
            The search.
        ax : sequence of two Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : GroupEffectsDisplay

        Raises
        ------
        TypeError
            If it is no GroupEffectSearch.
        NotFittedError
            If it is not fitted.
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
        ).plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        dot_kw: dict[str, Any] | None = None,
        interval_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two Axes or None, default=None
            Where to draw. None makes a figure.
        dot_kw : dict or None, default=None
            Keywords of matplotlib for the dots.
        interval_kw : dict or None, default=None
            Keywords of matplotlib for the intervals.

        Returns
        -------
        self : GroupEffectsDisplay
        """
        rows = list(_rows(self.prevalence))
        self.rows_ = [(row.effect, row.condition) for row in rows]
        wanted = self._wanted()
        self.ax_ = self._take_axes(ax, "people by effects, and prevalence", (1, 2), **wanted)
        if self._own:
            height = max(self.figure_.get_figheight(), wanted["figsize"][1])
            self.figure_.set_figheight(height)
        self.cells_: Any = None
        self.named_: Any = None
        self.line_: Any = None
        self.intervals_: dict[tuple[str, Any], Any] = {}
        self.shares_: dict[tuple[str, Any], Any] = {}
        if not rows:
            for panel, text in zip(self.ax_, ("No effect in anybody.", ""), strict=True):
                say_instead(panel, text)
            return self
        self._draw_cells(rows)
        self._draw_prevalence(rows)
        self._name(rows, self._upright())
        self._restyle(
            {"dot": dot_kw, "interval": interval_kw}, dot=self.named_, interval=self.intervals_
        )
        self._legend_of_panels()
        return self

    def _wanted(self) -> dict[str, Any]:
        """Size of a figure, and how wide its panels are."""
        letter = mpl.rcParams["font.size"] / 10.0
        names = max(map(len, short_names(self.people, LONGEST)), default=1)
        below = letter * (0.075 * names if self._upright() else 0.2)
        height = 1.75 * letter + below + ROW * letter * len(list(_rows(self.prevalence)))
        ratios = [max(len(self.people), 4) / 12 + 0.4, 0.9]
        return {"figsize": (7.2, max(2.6, height)), "width_ratios": ratios}

    def _upright(self) -> bool:
        longest = max(map(len, short_names(self.people, LONGEST)), default=0)
        return (len(self.people) > LEVEL_PEOPLE and longest > LONG) or longest > 2 * LONG

    def _draw_cells(self, rows: list[Row]) -> None:
        panel = self.ax_[0]
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
        panel = self.ax_[1]
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

    def _name(self, rows: list[Row], upright: bool) -> None:
        matrix, forest = self.ax_
        group = set(self.prevalence.loc[self.prevalence["group"], "effect"])
        room = max(int(0.3 * letters(self.figure_)), 12)
        matrix.set_yticks(range(len(rows)), [cut(row.label, room) for row in rows])
        for label, row in zip(matrix.get_yticklabels(), rows, strict=True):
            if row.whole or row.condition == ALL:
                label.set_fontweight("bold" if row.effect in group else "normal")
            else:
                label.set(color=dimmed(0.8), fontsize="small")
        names = short_names(self.people, LONGEST)
        matrix.set_xticks(range(len(names)), names, rotation=90 if upright else 0, fontsize="small")
        matrix.tick_params(length=0)
        matrix.set_title("Who has it", fontsize="medium")
        forest.set_title("Prevalence", fontsize="medium")
        forest.set_xlim(-2, 102)
        forest.set_xlabel("% of people")
        forest.set_yticks(range(len(rows)), [""] * len(rows))
        forest.tick_params(axis="y", length=0)
        forest.grid(alpha=0.3, axis="x")
        for panel in self.ax_:
            panel.set_ylim(len(rows) - 0.5, -0.5)
        starts = [n for n, row in enumerate(rows) if n and row.effect != rows[n - 1].effect]
        for panel in self.ax_:
            for start in starts:
                panel.axhline(start - 0.5, color=dimmed(0.5), lw=scaled(0.8))
        for side in ("top", "right"):
            forest.spines[side].set_visible(False)


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
