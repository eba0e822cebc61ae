"""Where in time the model fails: the residual's power in windows of the runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..diagnosis.findings import SMALL
from ._comparison import (
    ComparisonBaseDisplay,
    beyond,
    chance,
    exceeding,
    is_of_all_runs,
    say_instead,
)
from ._roles import GREY, ROLES, background, foreground, scaled, sized, veil

CHANGE = " change"  # ends the names of the tests that place a change in time
CHANGE_STYLES = ("--", "-.", (0, (4, 1, 1, 1, 1, 1)))
CHANCE = {"chance_low", "chance_high"}  # limits of the ratio of all runs, where they are known
EVEN = "if lost evenly over time"
MOST_LINES = 50  # single runs that have a line each
MOST_RUNS = 0.9  # of more of them, in the band in place of lines
REPEATS = {"explainable", "p_explainable"}  # of all runs, where several share the target


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualTimeDisplay(ComparisonBaseDisplay):
    """The residual over the time in the run, in windows.

    Above, the VAF points that each window costs, all runs together: the bars add up to 100 - VAF.
    What repeats over runs is misfit, drawn where it is beyond chance; the rest is remnant, which
    may grow without a fault of the model. Where no runs share the target, windows with more than
    chance have the colour of misfit. Below, the power of the residual relative to that of the whole
    run; thin lines are single runs, of more than 50 those that exceed chance most, beside a band
    that holds 90 % of all. Changes in time that cost something are dashed.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    by_time : DataFrame
        ``Comparison.by_time``.
    tests : DataFrame
        ``Comparison.tests``: the changes in time among them are marked where they exceed chance,
        and do not cost next to nothing.
    false_alarm : float, default=0.01
        Rate of false alarms of what is marked.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (2,)
        VAF points lost, and relative power.
    figure_ : Figure
        The figure that holds them.
    bars_ : BarContainer or None
        The VAF points.
    misfit_ : BarContainer or None
        The part of them that is red; None where no part is.
    runs_ : dict of Line2D
        Relative power by run, where there are several; of more than 50 those that exceed chance.
    line_ : Line2D or None
        Relative power of all runs together.
    band_ : FillBetweenPolyCollection or None
        What chance gives it; None if ``by_time`` has no columns ``chance_low``, ``chance_high``.
    changes_ : dict {str: float}
        Instants marked, in s, by the name of the test.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ResidualTimeDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = ResidualTimeDisplay.from_comparison(compare(model, X, y))
    >>> list(display.runs_)
    ['0', '1', '2']
    """

    by_time: pd.DataFrame
    tests: pd.DataFrame
    false_alarm: float = 0.01

    def plot(
        self,
        ax: Any = None,
        *,
        residual_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        misfit_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two Axes or None, default=None
            Where to draw VAF points and relative power. None makes a figure.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the residual of all runs.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the band of chance.
        misfit_kw : dict or None, default=None
            Keywords of matplotlib for the bars of what exceeds chance.

        Returns
        -------
        self : ResidualTimeDisplay
        """
        styles = {"residual": residual_kw, "band": band_kw, "misfit": misfit_kw}
        self.axes_ = self._take_axes(
            ax, "VAF points lost and relative power", (2, 1), sharex=True, figsize=(6.4, 5.2)
        )
        self.runs_: dict[Any, Any] = {}
        self.line_: Any = None
        self.band_: Any = None
        top, bottom = self.axes_
        together = self.by_time[is_of_all_runs(self.by_time)]
        self.bars_, self.misfit_ = draw_lost_points(top, together, self.false_alarm)
        self.changes_ = changes_in_time(self.tests)
        if self.bars_ is None:
            say_instead(bottom, "Relative power is not available.")
            return self
        self._draw_power(bottom, together)
        for panel in self.axes_:
            mark_changes(panel, self.changes_)
        bottom.set_xlabel("time in the run, s")
        bottom.set_xlim(together["start"].min(), together["stop"].max())
        self._restyle(
            styles, residual=[self.line_, self.bars_], band=self.band_, misfit=self.misfit_
        )
        self._legend_of_panels()
        return self

    def _draw_power(self, panel: Axes, together: pd.DataFrame) -> None:
        alone = self.by_time[~is_of_all_runs(self.by_time)]
        runs = list(dict.fromkeys(alone["run"]))
        if len(runs) > 1:  # the only one is what all runs are together
            raised = alone[worse_than_chance(alone)]
            drawn = alone
            if len(runs) > MOST_LINES:  # together they would hide all else
                self._draw_most_runs(panel, alone)
                worst = raised.sort_values("ratio", ascending=False)["run"].unique()[:MOST_LINES]
                drawn = alone[alone["run"].isin(worst)]
            for run, rows in drawn.groupby("run", sort=False):
                (self.runs_[run],) = panel.plot(
                    *_stairs(rows), color=GREY, lw=scaled(0.6), alpha=0.8, label="single runs"
                )
            if len(raised):
                # Red is misfit, where that is known; a single run's power may be remnant.
                panel.plot(
                    (raised["start"] + raised["stop"]) / 2,
                    raised["ratio"],
                    color=foreground() if knows_repeats(together) else ROLES["misfit"].colour,
                    marker="o",
                    ms=sized(3),
                    ls="none",
                    label=f"single run {beyond(self.false_alarm)}",
                )
        panel.axhline(1.0, color=foreground(), lw=scaled(0.8), ls=":")
        if set(together) >= CHANCE:
            time, low = _stairs(together, "chance_low")
            _, high = _stairs(together, "chance_high")
            self.band_ = panel.fill_between(
                time, low, high, color=GREY, alpha=0.35, lw=0, label=chance(self.false_alarm)
            )
        (self.line_,) = panel.plot(
            *_stairs(together),
            color=ROLES["residual"].colour,
            lw=scaled(1.8),
            label="all runs",
            zorder=3,
        )
        panel.set_ylabel("residual power /\nthat of the run")
        panel.set_ylim(bottom=0.0)
        panel.grid(alpha=0.3)

    def _draw_most_runs(self, panel: Axes, alone: pd.DataFrame) -> None:
        """The range in which most of the single runs are, in place of a line for each."""
        outside = (1 - MOST_RUNS) / 2
        levels = alone.groupby(["start", "stop"])["ratio"].quantile([outside, 1 - outside])
        windows = levels.unstack().set_axis(["low", "high"], axis=1).reset_index()
        time, low = _stairs(windows, "low")
        _, high = _stairs(windows, "high")
        label = f"{100 * MOST_RUNS:g} % of single runs"
        panel.fill_between(
            time, low, high, color=ROLES["residual"].colour, alpha=veil(0.25), lw=0, label=label
        )


def draw_lost_points(
    panel: Axes, windows: pd.DataFrame, false_alarm: float, *, even: bool = True
) -> tuple[Any, Any]:
    """VAF points that each window costs, and the misfit among them; None where there is none.

    ``even`` draws what they would be if the loss were spread evenly over time.
    """
    share = windows["share"].to_numpy(dtype=float)
    if not np.isfinite(share).any():
        say_instead(panel, "Where in time: not available, no window holds scored rows.")
        return None, None
    start, stop = windows["start"].to_numpy(), windows["stop"].to_numpy()
    look: dict[str, Any] = {
        "width": stop - start,
        "align": "edge",
        "edgecolor": background(),
        "linewidth": 0.6,
    }
    raised = failing(windows, false_alarm)
    misfit = None
    rest, label = ROLES["residual"], "residual"
    if raised.any() and knows_repeats(windows):
        rest, label = ROLES["remnant"], "remnant: does not repeat"
    bars = panel.bar(start, share, color=rest.colour, label=label, **look)
    if raised.any():
        height = share
        if knows_repeats(windows):  # a part of the bar, though estimates of it may exceed the bar
            height = np.clip(windows["explainable"].to_numpy(dtype=float), 0, share)
        misfit = panel.bar(
            start,
            np.where(raised, height, 0.0),
            color=ROLES["misfit"].colour,
            label=failing_label(windows, false_alarm),
            **look,
        )
    if even:
        level = np.nansum(share) * (stop - start) / np.sum((stop - start)[np.isfinite(share)])
        panel.plot(
            *_stairs(windows.assign(even=level), "even"),
            color=foreground(),
            lw=scaled(0.8),
            ls=":",
            label=EVEN,
        )
    panel.set_ylabel("VAF points lost")
    panel.grid(alpha=0.3, axis="y")
    panel.set_axisbelow(True)
    return bars, misfit


def knows_repeats(windows: pd.DataFrame) -> bool:
    """Whether it is known how much of the windows repeats over runs."""
    return set(windows) >= REPEATS and bool(windows["p_explainable"].notna().any())


def failing(windows: pd.DataFrame, false_alarm: float) -> np.ndarray:
    """Windows in which the model fails: what repeats there, if that is known, is beyond chance."""
    if knows_repeats(windows):
        return (windows["p_explainable"] < false_alarm).to_numpy(dtype=bool)
    return worse_than_chance(windows)


def failing_label(windows: pd.DataFrame, false_alarm: float) -> str:
    return (
        "misfit: repeats over runs" if knows_repeats(windows) else f"misfit: {beyond(false_alarm)}"
    )


def worse_than_chance(windows: pd.DataFrame) -> np.ndarray:
    """Windows that exceed chance, without those that do because they hold less than others."""
    return exceeding(windows) & (windows["ratio"] > 1).to_numpy()


def changes_in_time(tests: pd.DataFrame) -> dict[str, float]:
    """What changes by more than chance, and does not cost next to nothing, and when."""
    found = tests[exceeding(tests) & tests["test"].astype(str).str.endswith(CHANGE)]
    if "cost" in found:  # what costs next to nothing is no finding either
        found = found[~(found["cost"] < SMALL)]
    found = found.dropna(subset=["where"])
    return dict(zip(found["test"], found["where"].astype(float), strict=True))


def mark_changes(panel: Axes, changes: dict[str, float]) -> None:
    for style, (name, at) in zip(CHANGE_STYLES, changes.items(), strict=False):
        panel.axvline(at, color=foreground(), ls=style, lw=scaled(1.1), label=f"{name}, {at:.1f} s")


def _stairs(windows: pd.DataFrame, name: str = "ratio") -> tuple[np.ndarray, np.ndarray]:
    """A column as a line that is level inside each window."""
    time = windows[["start", "stop"]].to_numpy(dtype=float).ravel()
    return time, np.repeat(windows[name].to_numpy(dtype=float), 2)
