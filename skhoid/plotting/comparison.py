"""A model against measured runs: how good it is, where it fails, what is left to explain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..diagnosis.comparison import Comparison, compare
from ..runs import read_layout, run_name
from ..text import ceiling_text
from ._axes import (
    draw_arrow,
    legend_entries,
    legend_inside,
    letters,
    letters_above,
    letters_across,
    say_instead,
    with_unit,
    wrapped,
)
from ._display import FittingLayout, add_lines, check_option, figure_size, letter_size
from ._roles import GREY, ROLES, choose_readable, dimmed, foreground, scaled, sized
from .residual import (
    ResidualPanels,
    beyond,
    chance,
    changes_in_time,
    draw_lost_points,
    exceeding,
    failing,
    is_of_all_runs,
    knows_repeats,
    mark_changes,
    percent,
)

KINDS = (
    "overview",
    "ceiling",
    "runs",
    "time",
    "frequency",
    "amplitude",
    "map",
    "correlation",
)
# Overview
AROUND = 1.5  # windows shown to either side of the worst
SIZE = (8.4, 7.6)  # inches
SIDE_BY_SIDE = 90  # letters across the figure, with which three panels are beside each other
HEIGHTS = {"bar": 0.85, "traces": 1.4, "time": 1.9, "frequency": 1.9, "amplitude": 1.9}
ABOVE_TRACES = 0.18  # of their height, for the name of the worst window
BETWEEN = 0.75  # inches that titles and labels take for each row of panels
# Ceiling
SMALL = 1.2  # letters of the small size to one of the medium size
FROM_THE_TOP = 1.15  # top of the panel; the bar ends at 0.4, the text about the ceiling is above
# Runs
PARTS = {
    "validation": "simulated",
    "not known": "simulated",
    "fitted": "remnant",
    "partly fitted": "remnant",
    "estimation": "remnant",
}
MOST_NAMED = 16  # runs that get a tick label each
MOST_SAID = 4
LOWEST = -20.0  # percent; runs below it are named at the edge


@dataclass(kw_only=True, eq=False, repr=False)
class ComparisonDisplay(ResidualPanels):
    """How good a model is, where it fails, and how much is left to explain.

    Misfit, in vermilion, is what exceeds chance; what chance gives is grey. ``kind`` is one of

    overview
        The output as explained, misfit and remnant, with the noise ceiling; measured and simulated
        output around the worst window of the worst run; the VAF points lost over time, the spectra,
        and the mean residual over the channel with the clearest nonlinearity.
    ceiling
        The measured output as a bar: what the model explains (its VAF), what a better model could
        explain beyond it, up to the noise ceiling (an arrow: it is a lower bound), and the remnant.
    runs
        VAF by run, in validation and estimation. Runs whose residual power exceeds chance are
        ringed; one far below zero is named at the lower edge.
    time
        The VAF points that each window costs, all runs together (they add up to 100 - VAF): what
        repeats over runs is misfit where it is beyond chance. Below, the power of the residual
        relative to that of the run; thin lines are single runs, of more than 50 the worst.
    frequency
        Spectra of output, residual and noise (what does not repeat); residual above the noise is
        structure that a better model could explain. Marks are lines of a periodic target. Below,
        the magnitude of the response from error to output, with 95 % intervals.
    amplitude
        The mean residual over the level of each channel, with what chance gives. A slope is a wrong
        gain, a bend at zero a dead zone or an asymmetry, a bend at the ends a limit. Dashed lines
        are levels at which the measured output is held.
    map
        Power of the residual over time and frequency, relative to the mean remnant of the
        frequency; dots mark cells beyond chance.
    correlation
        Correlation of the residual with signals, over the lag; at positive lags the residual
        follows. Signals inside the loop are grey: even the exact model's residual correlates with
        them.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    comparison : Comparison
        Result of :func:`skhoid.compare`, or whatever has the attributes that are drawn.
    kind : str, default="overview"
        One of the kinds above.

    Attributes
    ----------
    %(panels)
    lines_ : dict of Line2D
        Lines by name: ``"measured"`` and ``"simulated"``; ``"validation"`` and ``"estimation"``;
        the power of ``"all"`` runs and of each; spectra (``"output"``, ``"residual"``, ``"noise"``)
        and responses (``"measured gain"``, ``"model gain"``); one for each channel or signal.
    run_ : str
        The run shown in the overview.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ComparisonDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=5, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> comparison = compare(ARXRegressor(nk=29).fit(X, y), X, y)
    >>> display = ComparisonDisplay.from_comparison(comparison)
    >>> len(display.axes_)
    5
    >>> display = ComparisonDisplay.from_comparison(comparison, "correlation")
    >>> list(display.lines_)
    ['f_t', 'e']
    """

    @classmethod
    def from_comparison(
        cls,
        comparison: Comparison,
        kind: str = "overview",
        *,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw a comparison.

        Parameters
        ----------
        comparison : Comparison
            Result of :func:`skhoid.compare`.
        kind : str, default="overview"
            What to draw: overview, ceiling, runs, time, frequency, amplitude, map or correlation.
        """
        if not isinstance(comparison, Comparison):
            raise TypeError(
                f"{cls.__name__}.from_comparison draws a result of skhoid.compare; got "
                f"{type(comparison).__name__}. from_estimator(model, X, y) compares first."
            )
        return cls(comparison=comparison, kind=kind).plot(ax, **kwargs)

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        X: Any,
        y: Any,
        kind: str = "overview",
        *,
        estimation: tuple[Any, Any] | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Compare a fitted model with measured runs, and draw that.

        Parameters
        ----------
        model : fitted estimator
            With ``predict``.
        X : DataFrame of shape (n_rows, n_channels)
            Channels of the validation runs.
        y : Series of shape (n_rows,)
            The operator's measured output.
        kind : str, default="overview"
            What to draw: overview, ceiling, runs, time, frequency, amplitude, map or correlation.
        estimation : (X, y) or None, default=None
            Data that the model was fitted on; with other options, call :func:`skhoid.compare`.
        """
        comparison = compare(model, X, y, estimation=estimation)
        return cls.from_comparison(comparison, kind, ax=ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        check_option("kind", self.kind, KINDS)
        self._forget()
        main = getattr(self, f"_draw_{self.kind}")(ax)
        self._restyle(kwargs, main)
        if self.kind == "overview":
            self._explain_overview()
        else:
            self._legend_of_panels()
        return self

    # The overview

    def _draw_overview(self, ax: Any) -> Any:
        own = ax is None
        panels = _own_panels() if own else ax
        self._take_axes(panels, "traces, time, frequency, amplitude and the bar", (5, 1))
        self._own = own
        traces, time, frequency, amplitude, bar = self.axes_
        self._draw_bar(bar)
        self._draw_traces(traces)
        main = dict(self.lines_)
        self._draw_where_in_time(time)
        frequency.set_title("where in frequency", fontsize="medium")
        self._draw_spectra(frequency)
        if frequency.get_lines():
            frequency.set_xlabel("frequency, rad/s")
        self._draw_strongest(amplitude)
        return main

    def _explain_overview(self) -> None:
        """Titles, and what the colours mean."""
        traces, found = self.ax_, self.comparison
        title = f"{found.model_name}: {_ceiling_text(found)}"
        finding = "".join(f.title for f in found.findings[:1])
        if not self._own:
            traces.set_title(f"{title}\n{finding}", fontsize="small")
            for panel in self.axes_[:4]:
                entries = legend_entries([panel])
                legend_inside(panel, list(entries.values()), list(entries))
            return
        self.figure_.suptitle(title, fontsize="medium")
        traces.set_title(finding, fontsize="medium")
        entries = {
            ROLES[name].word: Line2D([], [], **ROLES[name].style(1.6))
            for name in ("measured", "simulated", "residual")
        }
        entries[f"misfit: {beyond(found.false_alarm)}"] = Patch(color=ROLES["misfit"].colour)
        entries["remnant"] = Patch(color=ROLES["remnant"].colour)
        entries[chance(found.false_alarm)] = Patch(color=GREY, alpha=0.35, lw=0)
        entries |= {str(line.get_label()): line for line in self._changes}
        self._legend(list(entries.values()), list(entries))

    def _draw_traces(self, panel: Axes) -> None:
        """Measured and simulated output around the worst window of the worst run."""
        found = self.comparison
        layout = read_layout(found.traces)
        validation = found.by_run[found.by_run["data"] != "estimation"]
        names = [run_name(label) for label in layout.labels]
        self.run_ = names[0]
        if validation["vaf"].notna().any():
            self.run_ = str(validation["run"].iloc[int(np.nanargmin(validation["vaf"]))])
        windows = found.by_time[found.by_time["run"] == self.run_]
        if windows.empty:  # the only run is all runs
            windows = found.by_time
        number = names.index(self.run_)
        rows = slice(layout.run_starts[number], layout.run_starts[number + 1])
        time, table = layout.time[rows], found.traces.iloc[rows]
        begin, end = time[0], time[-1]
        some = bool(windows["rmse"].notna().any())
        if some:
            worst = windows.loc[windows["rmse"].idxmax()]
            window = float(worst["start"]), float(worst["stop"])
            around = AROUND * (window[1] - window[0])
            begin, end = max(begin, window[0] - around), min(end, window[1] + around)
            self._shade(panel, window)
        shown = (time >= begin) & (time <= end)
        for name, column in (("measured", "measured"), ("simulated", "predicted")):
            look = ROLES[name].style(1.2)
            (self.lines_[name],) = panel.plot(
                time[shown], table[column].to_numpy()[shown], label=ROLES[name].word, **look
            )
        panel.set_xlim(begin, end)
        panel.set_xlabel(f"time in run {self.run_}, s")
        panel.set_ylabel(with_unit(found.output, found.unit))
        panel.grid(alpha=0.3)
        if some:  # room for the name of the window
            low, high = panel.get_ylim()
            panel.set_ylim(low, high + ABOVE_TRACES * (high - low))

    def _shade(self, panel: Axes, worst: tuple[float, float]) -> None:
        """The worst window, in the colour of misfit if the model fails there."""
        by_time = self.comparison.by_time
        windows, alone = by_time[is_of_all_runs(by_time)], by_time[by_time["run"] == self.run_]
        # What repeats does so over runs: it is not known of one alone. The only run is all runs.
        if not knows_repeats(windows) and len(alone):
            windows = alone
        raised = windows[failing(windows, self.comparison.false_alarm)]
        colour = ROLES["misfit"].colour if (raised["start"] == worst[0]).any() else GREY
        panel.axvspan(*worst, color=colour, alpha=0.2, lw=0)
        place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "top"}
        text, at = f"worst {worst[1] - worst[0]:.2g} s", (sum(worst) / 2, 1.0)
        panel.annotate(text, at, (0, -2), textcoords="offset points", fontsize="medium", **place)

    def _draw_where_in_time(self, panel: Axes) -> None:
        panel.set_title("where in time", fontsize="medium")
        found = self.comparison
        self._changes: list[Any] = []
        together = found.by_time[is_of_all_runs(found.by_time)]
        if draw_lost_points(panel, together, found.false_alarm, even=False):
            self._changes = mark_changes(panel, changes_in_time(found.tests))
            panel.set_xlim(together["start"].min(), together["stop"].max())
            panel.set_xlabel("time in the run, s")

    def _draw_strongest(self, panel: Axes) -> None:
        """The mean residual over the channel with the clearest nonlinearity."""
        title, table = "where in amplitude", self.comparison.by_operating_point
        channel = _strongest(table, self.comparison.tests)
        if channel is None:
            say_instead(panel, "Where in amplitude: not available.", 28)
        else:
            bins = table[table["channel"] == channel]
            self._draw_bins(panel, channel, bins, table.attrs.get("units", {}).get(channel))
            panel.set_ylabel(with_unit("mean residual", self.comparison.unit))
            title += "" if bins["valid"].all() else " (not a test)"
        panel.set_title(title, fontsize="medium", color=foreground())

    # The noise ceiling

    def _draw_ceiling(self, ax: Any) -> Any:
        self._take_axes(ax, "the bar", figsize=(6.4, 2.2))
        note = self.comparison.ceiling_note
        if not np.isnan(self.comparison.noise_ceiling):
            note = f"noise ceiling {note}"
        note = wrapped(note[:1].upper() + note[1:], letters(self.figure_))
        if self._own:
            add_lines(self.figure_, note.count("\n") + 2, mpl.rcParams["font.size"])
        self._draw_bar(self.ax_, note if self.comparison.ceiling_note else "")
        self.ax_.set_title(_ceiling_text(self.comparison), fontsize="medium")
        return self._parts

    def _draw_bar(self, panel: Axes, note: str = "") -> None:
        """The bar, its parts named in it, or below the panel where they are too small for that."""
        panel.set_xlim(0.0, 100.0)
        panel.set_ylim(-0.5, FROM_THE_TOP)
        panel.set_yticks([])
        panel.xaxis.set_major_formatter("{x:g} %")
        panel.spines[["left", "right", "top"]].set_visible(False)
        self._parts: list[Any] = []
        small = []
        room = letters_above(panel) / 100.0
        for name, colour, low, high, size in _spans(self.comparison):
            self._parts += panel.barh(0, high - low, left=low, height=0.8, color=colour)
            if max(len(name), len(size)) + 1 > room * (high - low):
                small += [f"{name} {size}"] if size else []
                continue
            look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
            box = {"facecolor": colour, "edgecolor": "none", "pad": 0.0}
            middle, text = (low + high) / 2, f"{name}\n{size}"
            panel.text(middle, 0, text, color=choose_readable(colour), bbox=box, **look)
        self._draw_ceiling_line(panel)
        below = [", ".join(small)] if small else []
        panel.set_xlabel("\n".join([*below, note] if note else below), fontsize="small")

    def _draw_ceiling_line(self, panel: Axes) -> None:
        """The ceiling as a line across the bar, named above it, with an arrow to what is more."""
        ceiling, role = self.comparison.noise_ceiling, ROLES["ceiling"]
        if np.isnan(ceiling):
            _write_above(panel, 100.0, "noise ceiling not known")
            return
        at = float(np.clip(ceiling, 0.0, 100.0))
        panel.plot([at, at], [-0.5, 0.62], **role.style(2.4), solid_capstyle="butt", zorder=3)
        draw_arrow(panel, (at, 0.52), (16.0, 0.0), role.colour)
        _write_above(panel, at, f"{role.word} {ceiling_text(ceiling)}")

    # The runs

    def _draw_runs(self, ax: Any) -> Any:
        self._take_axes(ax, "the VAF of the runs", figsize=(6.4, 4.2))
        by_run = self.comparison.by_run
        table = by_run.reset_index(drop=True)
        if not np.isfinite(table["vaf"].to_numpy(dtype=float)).any():
            say_instead(self.ax_, "VAF by run: not available.")
            return []
        n_compared = int((table["data"] != "estimation").sum())  # which come first
        # A gap between these and estimation.
        at = np.arange(len(table)) + np.where(np.arange(len(table)) < n_compared, 0.0, 0.6)
        self._draw_levels(n_compared)
        self._draw_vaf(table, at)
        names = table["run"].tolist()
        every = -(-len(names) // MOST_NAMED)
        upright = len(names) > 6 and max(map(len, names)) > 4
        self.ax_.set_xticks(at[::every], names[::every], rotation=90 if upright else 0)
        self.ax_.set_xlim(at[0] - 0.7, at[-1] + 0.7)
        self.ax_.set_xlabel("run")
        self.ax_.set_ylabel("VAF, %")
        self.ax_.set_title(_runs_text(table), fontsize="medium")
        self.ax_.grid(alpha=0.3, axis="y")
        return self.lines_

    def _draw_levels(self, n_compared: int) -> None:
        """The ceiling and the VAF of all compared runs, over these runs only."""
        span, role = np.array([-0.5, n_compared - 0.5]), ROLES["ceiling"]
        ceiling, vaf = self.comparison.noise_ceiling, self.comparison.vaf
        if not np.isnan(ceiling):
            label = f"{role.word} {ceiling_text(ceiling)}"
            self.ax_.plot(span, [ceiling] * 2, **role.style(1.6), label=label)
            draw_arrow(self.ax_, (float(span.mean()), ceiling), (0.0, 14.0), role.colour)
        look: dict[str, Any] = {"color": ROLES["simulated"].colour, "lw": scaled(1.2), "ls": "--"}
        label = f"compared runs together {percent(vaf)}"
        self.ax_.plot(span, [vaf] * 2, label=label, **look)

    def _draw_vaf(self, table: pd.DataFrame, at: np.ndarray) -> None:
        vaf = table["vaf"].to_numpy(dtype=float)
        below, raised = vaf < LOWEST, exceeding(table)
        size = 6.0 if len(table) <= 100 else 2.5
        for name, role in PARTS.items():
            rows = (table["data"] == name).to_numpy()
            if rows.any():
                look: dict[str, Any] = {"marker": "o", "ms": size, "ls": "none"}
                (self.lines_[name],) = self.ax_.plot(
                    at[rows], vaf[rows], color=ROLES[role].colour, label=name, **look
                )
        if raised.any():
            look = {"mfc": "none", "mec": ROLES["misfit"].colour, "mew": scaled(1.8)}
            self._mark(self.ax_, at[raised], vaf[raised], ms=sized(2) * size, **look)
        if not below.any():
            self.ax_.margins(y=0.15)
            return
        self.ax_.set_ylim(LOWEST, 100.0)
        lowest = np.flatnonzero(below)[np.argsort(vaf[below], kind="stable")][:MOST_NAMED]
        for x, value, red in zip(at[lowest], vaf[lowest], raised[lowest], strict=True):
            colour = ROLES["misfit"].colour if red else foreground()
            self.ax_.annotate(
                f"{value:.0f} %",
                (x, LOWEST),
                xytext=(0, 18),
                textcoords="offset points",
                ha="center",
                fontsize="small",
                color=colour,
                arrowprops={"arrowstyle": "->", "color": colour},
            )


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


def _own_panels() -> list[Axes]:
    """Traces, time, frequency, amplitude and the bar in a new figure."""
    width, height = figure_size(SIZE, 3)
    rows: Any = [["bar"] * 3, ["traces"] * 3, ["time", "frequency", "amplitude"]]
    if letters_across(width) < SIDE_BY_SIDE:
        rows = [[name] for name in HEIGHTS]
    heights = [HEIGHTS[row[0]] for row in rows]
    least = letter_size() * (sum(heights) * 0.85 + BETWEEN * len(rows))
    figure = plt.figure(figsize=(width, max(height, least)), layout=FittingLayout())
    panels: Any = figure.subplot_mosaic(rows, height_ratios=heights)
    return [panels[name] for name in ("traces", "time", "frequency", "amplitude", "bar")]


def _ceiling_text(comparison: Any) -> str:
    """VAF and ceiling, for a title; of a comparison or whatever has its attributes."""
    found = f"VAF {percent(comparison.vaf)}"
    if np.isnan(comparison.noise_ceiling):
        return f"{found}, noise ceiling not known"
    gap = comparison.explainable_gap
    left = f"{gap:.1f} points left to explain" if gap > 0 else "nothing left to explain"
    return f"{found}, noise ceiling {ceiling_text(comparison.noise_ceiling)}: {left}"


def _spans(comparison: Any) -> list[tuple[str, str, float, float, str]]:
    """Name, colour, begin and end in percent, and size in words, of each part of the bar."""
    ceiling, known = comparison.noise_ceiling, not np.isnan(comparison.noise_ceiling)
    # Where not all runs share their target, the ceiling and the gap are of those that do.
    left = max(comparison.explainable_gap, 0.0) if known else 0.0
    explained = ceiling - left if left > 0 else comparison.vaf
    end = float(np.clip(explained, 0.0, 100.0))
    size = percent(explained) + (": worse than no model" if explained < 0 else "")
    spans = [("explained", ROLES["simulated"].colour, 0.0, end, size)]
    if not known:
        rest = percent(100.0 - explained)
        return [*spans, ("not explained", dimmed(0.15), end, 100.0, rest)]
    top = float(np.clip(ceiling, end, 100.0))
    gap = f"{left:.1f} points" if left >= 0.05 else ""
    remnant = percent(max(100.0 - ceiling, 0.0))
    return [
        *spans,
        ("misfit", ROLES["misfit"].colour, end, top, gap),
        ("remnant", ROLES["remnant"].colour, top, 100.0, remnant)
        if comparison.ceiling.route.separates
        else ("not explained", dimmed(0.15), top, 100.0, remnant),
    ]


def _write_above(panel: Axes, at: float, text: str) -> None:
    """Text above the bar, on that side of ``at`` where there is more room."""
    left = at > 50.0
    # From the edge of the panel where the text is longer than the room to that side.
    room = SMALL * letters_above(panel) * (at if left else 100.0 - at) / 100.0
    if len(text) > room:
        at = 100.0 if left else 0.0
    panel.text(at, 0.68, text, ha="right" if left else "left", va="bottom", fontsize="small")


def _runs_text(table: pd.DataFrame) -> str:
    """Which runs exceed chance, for a title."""
    if table["p"].isna().all():
        return "Too few runs to test one against the others"
    raised = table.loc[exceeding(table), "run"].tolist()
    if not raised:
        return "No run differs from the others by more than chance"
    more = f" and {len(raised) - MOST_SAID} more" if len(raised) > MOST_SAID else ""
    runs = "run" if len(raised) == 1 else "runs"
    return f"Beyond chance: {runs} {', '.join(raised[:MOST_SAID])}{more}"
