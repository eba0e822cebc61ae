"""Overview of a comparison: a model against measured runs, in several panels on one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..runs import read_layout, run_name
from ._axes import (
    LETTER,
    legend_above,
    legend_entries,
    legend_inside,
    letters,
    letters_above,
    letters_across,
    with_unit,
    wrapped,
)
from ._comparison import (
    ComparisonBaseDisplay,
    beyond,
    chance,
    exceeding,
    is_of_all_runs,
    residual_label,
    say_instead,
)
from ._layout import FittingLayout, figure_size
from ._roles import GREY, ROLES, foreground
from .noise_ceiling import ceiling_text, draw_ceiling_bar
from .operating_point import draw_bins
from .residual_frequency import draw_spectra
from .residual_time import changes_in_time, draw_lost_points, failing, knows_repeats, mark_changes

AROUND = 1.5  # windows shown to either side of the worst
SIZE = (8.4, 7.6)  # inches
# Panels side by side, by the letters across the figure.
LAYOUTS: dict[int, list[list[str]]] = {
    90: [["bar"] * 3, ["traces"] * 3, ["time", "frequency", "amplitude"]],
    62: [["bar"] * 2, ["traces"] * 2, ["time", "frequency"], ["amplitude", "key"]],
    0: [["bar"], ["traces"], ["time"], ["frequency"], ["amplitude"]],
}
HEIGHTS = {"bar": 0.85, "traces": 1.4, "time": 1.9, "amplitude": 1.9, "frequency": 1.9}
ABOVE_TRACES = 0.18  # of their height, for the name of the worst window
ABOVE_BARS = 0.6  # of the panel at most, for the names of changes
BETWEEN = 0.75  # inches that titles and labels take for each row of panels
SPEAKS = {"gain change": "gain changes", "mean change": "mean changes"}


@dataclass(kw_only=True, eq=False, repr=False)
class ComparisonDisplay(ComparisonBaseDisplay):
    """How good a model is, where it fails, and how much is left to explain.

    From above: the output as explained, misfit and remnant, with the noise ceiling; the measured
    and the simulated output around the worst window of the worst run; where the misfit is: the VAF
    points lost over time, the spectra of output, residual and remnant, and the mean residual over
    the channel with the clearest nonlinearity. Misfit is what exceeds chance; in time, if runs
    share the target, what repeats over them. One key of colours serves all panels.

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
        Rate of false alarms of what is called misfit.
    vaf : float
        Free-run VAF in percent.
    noise_ceiling : float
        The highest VAF that a model can reach, in percent; NaN if it is not known.
    noise_ceiling_interval : (float, float)
        Its 95 % interval.
    explainable_gap : float
        VAF points up to the ceiling.
    traces, by_run, by_time, by_frequency, by_operating_point, tests : DataFrame
        The tables of these names in a :class:`Comparison <skhoid.Comparison>`.
    findings : list of Finding
        The title of the first stands above the traces.

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
        The traces, ``"measured"`` and ``"simulated"``.
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

    def plot(
        self,
        ax: Any = None,
        *,
        measured_kw: dict[str, Any] | None = None,
        simulated_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of five Axes or None, default=None
            Where to draw traces, time, frequency, amplitude and the bar. None makes a figure.
        measured_kw : dict or None, default=None
            Keywords of matplotlib for the measured output.
        simulated_kw : dict or None, default=None
            Keywords of matplotlib for the simulated output.

        Returns
        -------
        self : ComparisonDisplay
        """
        own = ax is None
        key: Axes | None = None
        if own:
            ax, key = _own_panels()
        shows = "traces, time, frequency, amplitude and the bar"
        self.axes_ = self._take_axes(ax, shows, (5, 1))
        self._own = own
        traces, time, frequency, amplitude, bar = self.axes_
        self.parts_ = draw_ceiling_bar(bar, self).parts
        self._draw_traces(traces)
        self._restyle(
            {"measured": measured_kw, "simulated": simulated_kw},
            measured=self.lines_["measured"],
            simulated=self.lines_["simulated"],
        )
        self._draw_time(time)
        self._draw_frequency(frequency)
        self._draw_amplitude(amplitude)
        title = f"{self.model_name}: {ceiling_text(self)}"
        finding = "\n".join(
            wrapped(f"{finding.title}", letters_above(traces)) for finding in self.findings[:1]
        )
        if own:
            across = letters(self.figure_)
            size = "large" if 1.2 * len(title) < across else "medium"
            self.figure_.suptitle(title, fontsize=size)
            traces.set_title(finding, fontsize="medium")
            self._draw_key(key)
            return self
        traces.set_title(f"{wrapped(title, letters_above(traces))}\n{finding}", fontsize="small")
        legend_above(traces)
        for panel in self.axes_[1:4]:
            entries = legend_entries([panel])
            legend_inside(panel, list(entries.values()), list(entries))
        return self

    def _draw_key(self, place: Axes | None) -> None:
        """What the colours mean, in all panels; in a place of its own, or below the figure."""
        entries: dict[str, Any] = {
            ROLES[name].word: Line2D([], [], **ROLES[name].style(1.6))
            for name in ("measured", "simulated", "residual")
        }
        entries[f"misfit: {beyond(self.false_alarm)}"] = Patch(color=ROLES["misfit"].colour)
        entries["remnant"] = Patch(color=ROLES["remnant"].colour)
        entries[chance(self.false_alarm)] = Patch(color=GREY, alpha=0.35, lw=0)
        if place is None:
            self._legend(list(entries.values()), list(entries))
        else:
            place.set_axis_off()
            place.legend(
                entries.values(), entries.keys(), loc="center", frameon=False, fontsize="medium"
            )

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
        for name, column in (("measured", "measured"), ("simulated", "predicted")):
            (self.lines_[name],) = panel.plot(
                time[shown],
                table[column].to_numpy()[shown],
                **ROLES[name].style(1.2),
                label=ROLES[name].word,
            )
        panel.set_xlim(begin, end)
        panel.set_xlabel(f"time in run {self.run_}, s")
        panel.set_ylabel(with_unit(self.output, self.unit))
        panel.grid(alpha=0.3)
        if self.window_ is not None:  # room for its name
            low, high = panel.get_ylim()
            panel.set_ylim(low, high + ABOVE_TRACES * (high - low))

    def _shade(self, panel: Axes, windows: pd.DataFrame, worst: tuple[float, float]) -> None:
        """The worst window, in the colour of misfit if the model fails there."""
        together = self.by_time[is_of_all_runs(self.by_time)]
        rule = windows
        if knows_repeats(together):  # over runs, so it is not known of one alone
            rule = together[together["start"].isin(windows["start"])]
        raised = rule[failing(rule, self.false_alarm)]
        fails = worst in set(zip(raised["start"], raised["stop"], strict=True))
        colour = ROLES["misfit"].colour if fails else GREY
        panel.axvspan(*worst, color=colour, alpha=0.2, lw=0)
        panel.annotate(
            f"worst {worst[1] - worst[0]:.2g} s",
            (sum(worst) / 2, 1.0),
            (0, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize="medium",
        )

    def _draw_time(self, panel: Axes) -> None:
        panel.set_title("where in time", fontsize="medium")
        together = self.by_time[is_of_all_runs(self.by_time)]
        if draw_lost_points(panel, together, self.false_alarm, even=False)[0] is None:
            return
        self._mark_changes(panel)
        panel.set_xlim(together["start"].min(), together["stop"].max())
        panel.set_xlabel("time in the run, s")

    def _mark_changes(self, panel: Axes) -> None:
        """Changes in time, named where they are."""
        changes = changes_in_time(self.tests)
        mark_changes(panel, changes)
        if not (self._own and changes):
            return
        names = {name: SPEAKS.get(name, name) for name in changes}
        box, points = panel.get_window_extent(), 72.0 / panel.figure.dpi
        size = FontProperties(size="x-small").get_size_in_points()
        taken = min(
            size * LETTER * (max(map(len, names.values())) + 4) / (points * box.height), ABOVE_BARS
        )
        low, high = panel.get_ylim()
        panel.set_ylim(low, low + (high - low) / (1.0 - taken))
        start, stop = panel.dataLim.intervalx
        near = 1.5 * size * (stop - start) / (points * box.width)
        for line, (name, at) in zip(panel.get_lines(), changes.items(), strict=False):
            line.set_label("_")  # named beside it
            # Before its line, if the next line is where the name would be.
            later = [(t, n) for n, t in changes.items() if (t, n) > (at, name)]
            before = any(t < at + near for t, _ in later)
            panel.annotate(
                names[name],
                (at, 1.0),
                (-2 if before else 2, -2),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                rotation=90,
                ha="right" if before else "left",
                va="top",
                fontsize="x-small",
            )

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
            unit = table.attrs.get("units", {}).get(channel)
            draw_bins(panel, bins, self.false_alarm, self.output, unit)
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


def _own_panels() -> tuple[list[Axes], Axes | None]:
    """Traces, time, frequency, amplitude and the bar in a new figure, and a place for the key.

    Narrow figures have fewer panels side by side.
    """
    width, height = figure_size(SIZE, 3)
    across = letters_across(width)
    rows: Any = next(rows for least, rows in LAYOUTS.items() if across >= least)
    heights = [HEIGHTS[row[0]] for row in rows]
    letter = mpl.rcParams["font.size"] / 10.0
    least = letter * (sum(heights) * 0.85 + BETWEEN * len(rows))
    figure = plt.figure(figsize=(width, max(height, least)), layout=FittingLayout())
    panels = figure.subplot_mosaic(rows, height_ratios=heights)
    key = panels.pop("key", None)
    names = ("traces", "time", "frequency", "amplitude", "bar")
    return [panels[name] for name in names], key
