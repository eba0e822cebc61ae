"""How well each person is modelled: VAF of runs against the noise ceiling, person by person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.ticker import MaxNLocator

from ._comparison import say_instead
from ._display import Display
from ._layout import PAGE
from ._roles import BLUE, ROLES, foreground, scaled, sized
from ._short_names import short_names

if TYPE_CHECKING:
    from ..lab.experiment.people import PeopleResult

KEY = ["subject", "condition"]
ALL = "all"
MOST_COLUMNS = 5
ROW = 1.45  # inches for each row of panels
LOWEST = -20.0  # % VAF, of panels
FAR = 4.0  # ranges of the middle half, beyond which a run makes no room for itself
SPREAD = 0.3  # of the place of a condition, over which its runs are spread
LETTERS = 15  # of a name above a panel
LEVEL = 18  # letters of the names of all conditions, that can lie below a panel
TICK = 12  # letters of a condition


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
    ax_ : ndarray of Axes, shape (n_people,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    people_ : list
        The person of each panel.
    conditions_ : list
        The conditions, from the left.
    dots_ : dict of Line2D
        VAF of the runs, by person.
    levels_ : dict of LineCollection
        VAF of the fits of all runs, by person.
    ceilings_ : dict of LineCollection
        Noise ceilings, by person.
    outlying_ : dict of Line2D
        Rings around runs that look wrong, by person; only those of whom there are any.
    failed_ : dict of Line2D
        Crosses where a fit failed, by person; only those of whom there are any.

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
    def from_result(
        cls, result: PeopleResult, *, people: Any = None, ax: Any = None, **styles: Any
    ) -> Self:
        """Draw what :func:`skhoid.identify_people` found.

        Parameters
        ----------
        result : PeopleResult
            Of the identification.
        people : sequence of labels or None, default=None
            Whom to draw; None draws all.
        ax : sequence of Axes or None, default=None
            Where to draw, one for each person. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : PeopleDisplay

        Raises
        ------
        ValueError
            If there is no such person.
        """
        known = list(dict.fromkeys(result.groups["subject"]))
        chosen = known if people is None else list(people)
        for who in chosen:
            if who not in known:
                raise ValueError(
                    f"people has {who!r}; the result has {', '.join(map(str, known))}."
                )
        tables = {
            name: getattr(result, name).loc[lambda t: t["subject"].isin(chosen)]
            for name in ("runs", "groups", "outlying")
        }
        return cls(**tables).plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        dot_kw: dict[str, Any] | None = None,
        ceiling_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            Where to draw, one for each person. None makes a figure.
        dot_kw : dict or None, default=None
            Keywords of matplotlib for the dots of the runs.
        ceiling_kw : dict or None, default=None
            Keywords of matplotlib for the noise ceilings.

        Returns
        -------
        self : PeopleDisplay
        """
        self.people_ = list(dict.fromkeys(self.groups["subject"]))
        self.conditions_ = list(dict.fromkeys(self.groups["condition"]))
        n, wanted = len(self.people_), self._wanted()
        rows, columns = wanted.pop("shape")
        self.ax_ = self._take_axes(
            ax, "one for each person", (rows, columns), used=range(max(n, 1)), **wanted
        )
        if self._own:
            height = max(self.figure_.get_figheight(), wanted["figsize"][1])
            self.figure_.set_figheight(height)
        self.dots_: dict[Any, Any] = {}
        self.levels_: dict[Any, Any] = {}
        self.ceilings_: dict[Any, Any] = {}
        self.outlying_: dict[Any, Any] = {}
        self.failed_: dict[Any, Any] = {}
        if not n:
            say_instead(self.ax_[0], "Nobody.")
            return self
        low, high = self._limits()
        for number, who in enumerate(self.people_):
            self._draw(self.ax_[number], who, low)
            self._name(self.ax_[number], who, bottom=number + columns >= n)
            self.ax_[number].set_ylim(low, high)
            place = self.ax_[number].get_subplotspec()
            if place is None or place.is_first_col():
                self.ax_[number].set_ylabel("VAF, %")
        self._restyle(
            {"dot": dot_kw, "ceiling": ceiling_kw}, dot=self.dots_, ceiling=self.ceilings_
        )
        self._legend_of_panels()
        return self

    def _wanted(self) -> dict[str, Any]:
        """Shape and size of a figure, and which axes its panels share."""
        people, conditions = (
            list(dict.fromkeys(self.groups[name])) for name in ("subject", "condition")
        )
        columns = max(min(len(people), MOST_COLUMNS), 1)
        rows = max(-(-len(people) // columns), 1)
        letter = mpl.rcParams["font.size"] / 10.0
        return {
            "shape": (rows, columns),
            "figsize": (
                min(PAGE, 1.2 + 2.2 * columns),
                letter * (1.0 + _below(conditions) + ROW * rows),
            ),
            "sharex": True,
            "sharey": True,
        }

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
        self._draw_wrong(panel, who, at[wrong], shown[wrong])
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

    def _draw_wrong(self, panel: Any, who: Any, at: np.ndarray, vaf: np.ndarray) -> None:
        """Rings around runs; a person as a whole is a red name."""
        if not at.size:
            return
        (self.outlying_[who],) = panel.plot(
            at,
            vaf,
            ls="none",
            marker="o",
            ms=sized(8),
            mfc="none",
            mec=ROLES["misfit"].colour,
            mew=scaled(1.6),
            label="looks wrong",
        )

    def _name(self, panel: Any, who: Any, bottom: bool) -> None:
        name = short_names(self.people_, LETTERS - 4)[self.people_.index(who)]
        odd = (self.outlying["subject"] == who).any()
        colour = ROLES["misfit"].colour if odd else foreground()
        panel.set_title(f"{name} (!)" if odd else name, fontsize="medium", color=colour, pad=3)
        names = short_names(self.conditions_, TICK)
        panel.set_xticks(range(len(names)), [""] * len(names) if names == [ALL] else names)
        if _upright(self.conditions_):
            panel.tick_params(axis="x", rotation=90)
        panel.tick_params(axis="x", length=0, labelsize="small", labelbottom=bottom)
        panel.set_xlim(-0.6, len(names) - 0.4)
        panel.yaxis.set_major_locator(MaxNLocator(4))
        panel.grid(alpha=0.3, axis="y")
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)


def _lines(panel: Any, segments: list[Any], label: str, **style: Any) -> Any:
    return panel.add_collection(
        LineCollection(segments, label=label if segments else None, **style)
    )


def _upright(conditions: list[Any]) -> bool:
    """Whether names below a panel need to stand."""
    return sum(len(name) + 2 for name in short_names(conditions, TICK)) > LEVEL


def _below(conditions: list[Any]) -> float:
    """Inches that names of conditions take, where they stand upright."""
    longest = max(map(len, short_names(conditions, TICK)), default=0)
    return 0.07 * longest * _upright(conditions)
