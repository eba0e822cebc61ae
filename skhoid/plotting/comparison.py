"""Overview of a comparison: a model against measured runs, in several panels on one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ..runs import read_layout, run_name
from ._axes import legend_above, legend_entries, legend_inside, with_unit, wrapped
from ._comparison import (
    ComparisonBaseDisplay,
    exceeding,
    is_of_all_runs,
    residual_label,
    say_instead,
)
from ._roles import GREY, ROLES, foreground, scaled
from .noise_ceiling import ceiling_text, draw_ceiling_bar
from .operating_point import draw_bins
from .residual_frequency import draw_spectra
from .residual_time import (
    changes_in_time,
    draw_lost_points,
    failing,
    failing_label,
    knows_repeats,
    mark_changes,
)

AROUND = 1.5  # windows shown to either side of the worst
ENTRIES = 5  # in a row of the legend
LETTERS = 90  # in a line of the title


@dataclass(kw_only=True, eq=False, repr=False)
class ComparisonDisplay(ComparisonBaseDisplay):
    """How good a model is, where it fails, and how much is left to explain.

    From above: the measured and the predicted output around the worst window of the worst run;
    the VAF points lost over time, the spectra of output, residual and noise, and the mean residual
    over the channel with the clearest nonlinearity; the output as explained, explainable and
    remnant. What exceeds chance is vermilion; in time, if runs share the target, what repeats
    over them.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    model_name : str
        Name of the model.
    output : str
        Name of the output.
    unit : str or None
        Its unit.
    false_alarm : float
        Rate of false alarms of what is vermilion.
    vaf : float
        Free-run VAF in percent.
    noise_ceiling : float
        The highest VAF that a model can reach, in percent; NaN if it is not known.
    noise_ceiling_interval : (float, float)
        Its 90 % interval.
    explainable_gap : float
        VAF points up to the ceiling.
    traces, by_run, by_time, by_frequency, by_operating_point, tests : DataFrame
        The tables of these names in a :class:`Comparison <skhoid.Comparison>`.
    findings : list of Finding
        The title of the first stands above the page.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (5,)
        Traces, time, frequency, amplitude and the bar.
    figure_ : Figure
        The figure that holds them.
    run_ : str
        Name of the run shown.
    window_ : (float, float) or None
        Its worst window, in s.
    lines_ : dict of Line2D
        The traces, ``"measured"`` and ``"predicted"``.
    parts_ : dict of Rectangle
        The parts of the bar.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ComparisonDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=5, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = ComparisonDisplay.from_estimator(model, X, y)
    >>> len(display.axes_)
    5
    """

    model_name: str
    output: str
    unit: str | None
    false_alarm: float
    vaf: float
    noise_ceiling: float
    noise_ceiling_interval: tuple[float, float]
    explainable_gap: float
    traces: pd.DataFrame
    by_run: pd.DataFrame
    by_time: pd.DataFrame
    by_frequency: pd.DataFrame
    by_operating_point: pd.DataFrame
    tests: pd.DataFrame
    findings: Sequence[Any]

    def plot(self, ax: Any = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of five Axes or None, default=None
            Where to draw traces, time, frequency, amplitude and the bar. None makes a figure.

        Returns
        -------
        self : ComparisonDisplay
        """
        own = ax is None
        if own:
            figure = plt.figure(figsize=(10.0, 7.8), layout="constrained")
            panels = figure.subplot_mosaic(
                [
                    ["traces"] * 3,
                    ["time", "frequency", "amplitude"],
                    ["legend"] * 3,
                    ["bar"] * 3,
                ],
                height_ratios=[1.0, 1.25, 0.1, 0.22],
            )
            legend = panels.pop("legend")
            ax = list(panels.values())
        shows = "traces, time, frequency, amplitude and the bar"
        self.axes_ = self._take_axes(ax, shows, (5, 1))
        traces, time, frequency, amplitude, bar = self.axes_
        self._draw_traces(traces)
        self._draw_time(time)
        self._draw_frequency(frequency)
        self._draw_amplitude(amplitude)
        self.parts_, _ = draw_ceiling_bar(bar, self, columns=4)
        where = self.axes_[1:4]
        if own:
            self.figure_.suptitle(self._title_text())
            _explain_in(legend, where)
        else:
            traces.set_title(self._title_text(), fontsize="small")
            for panel in where:
                entries = legend_entries([panel])
                legend_inside(panel, list(entries.values()), list(entries))
        return self

    def _title_text(self) -> str:
        lines = [f"{self.model_name}: {ceiling_text(self)}"]
        if len(lines[0]) > LETTERS:
            lines = [self.model_name, ceiling_text(self)]
        lines += [finding.title for finding in self.findings[:1]]
        return "\n".join(wrapped(line, LETTERS) for line in lines)

    def _draw_traces(self, panel: Axes) -> None:
        self.lines_: dict[str, Any] = {}
        self.window_: tuple[float, float] | None = None
        layout = read_layout(self.traces)
        validation = self.by_run[self.by_run["data"] == "validation"]
        names = [run_name(label) for label in layout.labels]
        self.run_ = names[0]
        if validation["vaf"].notna().any():
            self.run_ = str(validation["run"].iloc[int(np.nanargmin(validation["vaf"]))])
        windows = self.by_time[self.by_time["run"] == self.run_]
        if windows.empty:  # the only run is all runs
            windows = self.by_time
        number = names.index(self.run_)
        rows = slice(layout.run_starts[number], layout.run_starts[number + 1])
        time, table = layout.time[rows], self.traces.iloc[rows]
        begin, end = time[0], time[-1]
        if windows["rmse"].notna().any():
            worst = windows.loc[windows["rmse"].idxmax()]
            self.window_ = (float(worst["start"]), float(worst["stop"]))
            around = AROUND * (self.window_[1] - self.window_[0])
            begin, end = max(begin, self.window_[0] - around), min(end, self.window_[1] + around)
            inside = ((windows["start"] < end) & (windows["stop"] > begin)).to_numpy()
            self._shade(panel, windows[inside], self.window_)
        shown = (time >= begin) & (time <= end)
        for name, colour in (
            ("measured", ROLES["measured"].colour),
            ("predicted", ROLES["simulated"].colour),
        ):
            (self.lines_[name],) = panel.plot(
                time[shown], table[name].to_numpy()[shown], color=colour, lw=scaled(1.1), label=name
            )
        panel.set_xlim(begin, end)
        panel.set_xlabel(f"time in run {self.run_}, s")
        panel.set_ylabel(with_unit(self.output, self.unit))
        panel.grid(alpha=0.3)
        legend_above(panel)

    def _shade(self, panel: Axes, windows: pd.DataFrame, worst: tuple[float, float]) -> None:
        """The worst window, vermilion if the model fails there, and others in which it does."""
        together = self.by_time[is_of_all_runs(self.by_time)]
        rule = windows
        if knows_repeats(together):  # over runs, so it is not known of one alone
            rule = together[together["start"].isin(windows["start"])]
        raised = rule[failing(rule, self.false_alarm)]
        colour = GREY
        for window in zip(raised["start"], raised["stop"], strict=True):
            if window == worst:
                colour = ROLES["misfit"].colour
            else:
                label = failing_label(rule, self.false_alarm)
                panel.axvspan(*window, color=ROLES["misfit"].colour, alpha=0.12, lw=0, label=label)
        label = "worst window of the worst run"
        panel.axvspan(*worst, color=colour, alpha=0.3, lw=0, label=label)

    def _draw_time(self, panel: Axes) -> None:
        panel.set_title("where in time", fontsize="medium")
        together = self.by_time[is_of_all_runs(self.by_time)]
        if draw_lost_points(panel, together, self.false_alarm)[0] is None:
            return
        mark_changes(panel, changes_in_time(self.tests))
        panel.set_xlim(together["start"].min(), together["stop"].max())
        panel.set_xlabel("time in the run, s")

    def _draw_frequency(self, panel: Axes) -> None:
        panel.set_title("where in frequency", fontsize="medium")
        if draw_spectra(panel, self.by_frequency, self.unit, self.false_alarm)[0]:
            panel.set_xlabel("frequency, rad/s")

    def _draw_amplitude(self, panel: Axes) -> None:
        title = "where in amplitude"
        channel = _strongest(self.by_operating_point, self.tests)
        if channel is None:
            say_instead(panel, "Where in amplitude: not available.", 28)
        else:
            table = self.by_operating_point
            bins = table[table["channel"] == channel]
            draw_bins(panel, bins, self.false_alarm, self.output)
            panel.set_ylabel(residual_label(self.unit))
            title += "" if bins["valid"].all() else " (not a test)"
        panel.set_title(title, fontsize="medium", color=foreground())


def _strongest(bins: pd.DataFrame, tests: pd.DataFrame) -> str | None:
    """The channel with the clearest nonlinearity, else furthest outside its band."""
    shaped = tests[tests["test"].isin(["nonlinearity", "asymmetry"]) & exceeding(tests)]
    shaped = shaped[shaped["signal"].isin(bins["channel"]) & shaped["statistic"].notna()]
    if not shaped.empty:
        return str(shaped.loc[shaped["statistic"].idxmax(), "signal"])
    tested = bins[bins["valid"].eq(True)]
    bins = bins if tested.empty else tested
    in_bands = (bins["mean"].abs() / bins["band"]).groupby(bins["channel"], sort=False).max()
    in_bands = in_bands.dropna()
    return None if in_bands.empty else str(in_bands.idxmax())


def _explain_in(place: Axes, panels: Any) -> None:
    """One legend for the panels, in the place of another."""
    place.set_axis_off()
    entries = legend_entries(panels)
    place.legend(
        entries.values(),
        entries.keys(),
        loc="center",
        ncols=min(len(entries), ENTRIES),
        frameon=False,
        fontsize="small",
        borderaxespad=0,
    )
