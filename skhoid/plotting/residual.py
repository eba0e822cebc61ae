"""Where a model fails: the residual over time, frequency, amplitude, both, and lag.

The base of :class:`ComparisonDisplay`, in whose overview some of these panels stand too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from scipy.stats import norm

from ..diagnosis.findings import SMALL
from ._axes import (
    draw_band,
    letters_across,
    plain_logarithmic,
    say_instead,
    with_unit,
)
from ._display import Display, figure_size
from ._roles import (
    GREY,
    ROLES,
    background,
    dimmed,
    foreground,
    scaled,
    sized,
)

ALL_RUNS = "all"  # the name in by_time of all validation runs together
CLOSED_LOOP = "closed loop: not a test"
CHANNELS = {"f_t": "target $f_t$", "dist": "disturbance $f_d$", "e": "error e", "x": "output x"}
# Time
CHANGE = " change"  # ends the names of the tests that place a change in time
CHANGE_STYLES = ("--", "-.", (0, (4, 1, 1, 1, 1, 1)))
CHANCE = {"chance_low", "chance_high"}  # limits of the ratio of all runs, where they are known
MOST_LINES = 50  # single runs that have a line each
MOST_RUNS = 0.9  # of more of them, in the band in place of lines
REPEATS = {"explainable", "p_explainable"}  # of all runs, where several share the target
# Frequency: single lines and harmonics are marks; bins pooled over a band make a curve.
MARKS = {"excited": "o", "odd": "^", "even": "v"}
HARMONICS = {"odd": "odd harmonics", "even": "even harmonics"}
CONFIDENCE = 0.95
SHOWN = 1e-5  # of the highest density of the output, down to which spectra are drawn
EDGE = 1.3
# Amplitude
COLUMNS = 3
LEAST_ROW = 1.95  # inches of a row of panels, of a font of 10 points
LETTERS = 28  # across a panel with its label, at least
# Map
LEAST = 6.0  # dB; chance alone does not use the whole scale
MOST = 20.0
HELD = 99.0  # percentile that the scale holds


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualPanels(Display):
    """Pictures of the residual of a comparison; each returns its main artists."""

    comparison: Any
    kind: str = "overview"

    def _forget(self) -> None:
        """Nothing is drawn yet."""
        self.lines_: dict[Any, Any] = {}

    def _draw_time(self, ax: Any) -> Any:
        shows = "VAF points lost and relative power"
        top, bottom = self._take_axes(ax, shows, (2, 1), sharex=True, figsize=(6.4, 5.2))
        windows, chance_rate = self.comparison.by_time, self.comparison.false_alarm
        together = windows[is_of_all_runs(windows)]
        bars = draw_lost_points(top, together, chance_rate)
        if not bars:
            say_instead(bottom, "Relative power is not available.")
            return []
        self._draw_runs_over_time(bottom, windows[~is_of_all_runs(windows)], together)
        bottom.axhline(1.0, color=foreground(), lw=scaled(0.8), ls=":")
        if set(together) >= CHANCE:
            time, low = _stairs(together, "chance_low")
            _, high = _stairs(together, "chance_high")
            draw_band(bottom, time, low, high, GREY, chance(chance_rate), alpha=0.35)
        look: dict[str, Any] = {"color": ROLES["residual"].colour, "lw": scaled(1.8), "zorder": 3}
        (self.lines_[ALL_RUNS],) = bottom.plot(*_stairs(together), label="all runs", **look)
        bottom.set_ylabel("residual power /\nthat of the run")
        bottom.set_ylim(bottom=0.0)
        bottom.grid(alpha=0.3)
        for panel in (top, bottom):
            mark_changes(panel, changes_in_time(self.comparison.tests))
        bottom.set_xlabel("time in the run, s")
        bottom.set_xlim(together["start"].min(), together["stop"].max())
        return [self.lines_[ALL_RUNS], bars]

    def _draw_runs_over_time(
        self, panel: Axes, alone: pd.DataFrame, together: pd.DataFrame
    ) -> None:
        """Lines of single runs, and dots where one exceeds chance."""
        runs = list(dict.fromkeys(alone["run"]))
        if len(runs) < 2:  # the only one is what all runs are together
            return
        raised = alone[worse_than_chance(alone)]
        drawn = alone
        if len(runs) > MOST_LINES:  # together they would hide all else
            worst = alone.groupby("run")["ratio"].max().nlargest(MOST_LINES).index
            drawn = alone[alone["run"].isin(worst)]
        look: dict[str, Any] = {"color": GREY, "lw": scaled(0.6), "alpha": 0.8}
        for run, rows in drawn.groupby("run", sort=False):
            (self.lines_[run],) = panel.plot(*_stairs(rows), label="single runs", **look)
        if len(raised):
            # Red is misfit, where that is known; a single run's power may be remnant.
            colour = foreground() if knows_repeats(together) else ROLES["misfit"].colour
            middle = (raised["start"] + raised["stop"]) / 2
            label = f"single run {beyond(self.comparison.false_alarm)}"
            self._mark(panel, middle, raised["ratio"], label, color=colour, ms=sized(3))

    def _mark(self, panel: Axes, x: Any, y: Any, label: str | None = None, **look: Any) -> None:
        """Marks of what exceeds chance."""
        default: dict[str, Any] = {"color": ROLES["misfit"].colour, "marker": "o", "ls": "none"}
        label = label or beyond(self.comparison.false_alarm)
        panel.plot(x, y, label=label, **(default | look))

    def _draw_frequency(self, ax: Any) -> Any:
        table = self.comparison.by_frequency
        shows = "spectra and magnitude"
        ratios: dict[str, Any] = {"height_ratios": [1.2, 1], "sharex": True}
        top, bottom = self._take_axes(ax, shows, (2, 1), figsize=(6.4, 6.0), **ratios)
        self._draw_spectra(top)
        if (table["kind"] == "excited").any():
            top.set_title("dots: excited lines, curves: between them", fontsize="small")
        measured = table[table["measured_gain"].notna()]
        lowest = top if measured.empty else bottom
        if measured.empty:
            say_instead(bottom, "Measured response: not available, it needs the target f_t.")
        else:
            self._draw_gain(bottom, measured)
        for panel in self.axes_ if self._own else []:
            panel.tick_params(labelbottom=panel is lowest)
        lowest.set_xlabel("frequency, rad/s")
        return [line for name, line in self.lines_.items() if name.startswith("residual")]

    def _draw_spectra(self, panel: Axes) -> None:
        """Spectra of output, residual and noise; rings around what exceeds chance."""
        every = self.comparison.by_frequency
        table = every[every["omega"] > 0]
        if table.empty or not (table["psd_residual"] > 0).any():
            say_instead(panel, "Where in frequency: not available, no run is long enough.")
            return
        panel.set_xscale("log")
        panel.set_yscale("log")
        curve = table[~table["kind"].isin(list(MARKS)).to_numpy()]
        noise, excited = table[table["psd_noise"] > 0], table[table["kind"] == "excited"]
        if len(noise):
            role = ROLES["remnant"]
            look: dict[str, Any] = {"color": role.colour, "lw": scaled(3.0), "alpha": 0.6}
            (self.lines_["noise"],) = panel.plot(
                noise["omega"], noise["psd_noise"], label=role.word, **look
            )
        for name, role in (("output", ROLES["measured"]), ("residual", ROLES["residual"])):
            look = {"color": role.colour, "lw": scaled(1.3)}
            values = curve[f"psd_{name}"].where(curve[f"psd_{name}"] > 0)
            (self.lines_[name],) = panel.plot(curve["omega"], values, **look)
            (self.lines_[f"{name} lines"],) = panel.plot(
                excited["omega"],
                excited[f"psd_{name}"],
                color=role.colour,
                ls="none",
                marker="o",
                ms=sized(5),
            )
            panel.plot([], [], marker="o" if len(excited) else None, label=role.word, **look)
        for kind, label in HARMONICS.items():
            rows = table[table["kind"] == kind]
            if len(rows):
                look = {"color": ROLES["residual"].colour, "marker": MARKS[kind], "ms": sized(4)}
                (self.lines_[f"residual {kind}"],) = panel.plot(
                    rows["omega"], rows["psd_residual"], ls="none", label=label, **look
                )
        raised = table[exceeding(table)]
        if len(raised):
            look = {"mfc": "none", "mec": ROLES["misfit"].colour, "mew": scaled(1.6), "zorder": 4}
            self._mark(panel, raised["omega"], raised["psd_residual"], ms=sized(9), **look)
        # Without the high frequencies that hold next to nothing of the output.
        highest = float(table["psd_output"].max())
        held = table[(table["psd_output"] >= SHOWN * highest) | (table["kind"] == "excited")]
        if highest > 0 and len(held) > 1:
            panel.set_xlim(held["omega"].min() / EDGE, held["omega"].max() * EDGE)
            panel.set_ylim(bottom=SHOWN * highest / 2)
        plain_logarithmic(panel.xaxis)
        unit = self.comparison.unit
        panel.set_ylabel(f"PSD, {unit}² s/rad" if unit else "PSD")
        panel.grid(alpha=0.3)

    def _draw_gain(self, panel: Axes, measured: pd.DataFrame) -> None:
        omega, gain = measured["omega"], measured["measured_gain"]
        # As wide on the logarithmic axis above as below.
        factor = np.exp(norm.ppf(0.5 + CONFIDENCE / 2) * measured["sd_gain"] / gain)
        panel.set_xscale("log")
        panel.set_yscale("log")
        look: dict[str, Any] = {"color": ROLES["measured"].colour}
        panel.vlines(omega, gain / factor, gain * factor, lw=scaled(1.2), alpha=0.6, **look)
        label = f"measured, {100 * CONFIDENCE:g} % interval"
        look |= {"marker": "o", "ms": sized(5), "ls": "none", "label": label}
        (self.lines_["measured gain"],) = panel.plot(omega, gain, **look)
        role = ROLES["simulated"]
        (self.lines_["model gain"],) = panel.plot(
            omega, measured["model_gain"], label=role.word, **role.style(1.4)
        )
        both = np.concatenate([gain, measured["model_gain"]])
        both = both[np.isfinite(both) & (both > 0)]
        # The responses stay in view, however wide their intervals.
        panel.set_ylim(both.min() / 2.5, both.max() * 2.5)
        for axis in (panel.xaxis, panel.yaxis):
            plain_logarithmic(axis)
        panel.set_ylabel("response, magnitude")
        panel.grid(alpha=0.3)

    def _draw_amplitude(self, ax: Any) -> Any:
        bins = self.comparison.by_operating_point
        tables = dict(list(bins.groupby("channel", sort=False)))
        n = max(len(tables), 1)
        columns = min(n, COLUMNS)
        width, _ = figure_size((max(4.2, 0.8 + 2.6 * columns), 1.0), 1)
        columns = min(columns, max(letters_across(width) // LETTERS, 1))
        rows = math.ceil(n / columns)
        self._take_axes(
            ax,
            "one for each channel",
            (rows, columns),
            used=range(n),
            sharey=True,
            figsize=(max(4.2, 0.8 + 2.6 * columns), 0.9 + 2.3 * rows),
            least_height=0.6 + LEAST_ROW * rows,  # labels of two lines, and one beside each row
        )
        if not tables:
            say_instead(self.ax_, "Mean residual over levels: not available.")
            return []
        units, tests = bins.attrs.get("units", {}), self.comparison.tests
        held = tests[tests["test"].eq("level") & exceeding(tests)]
        for i, (panel, (name, table)) in enumerate(zip(self.axes_, tables.items(), strict=True)):
            self._draw_bins(panel, name, table, units.get(name))
            # Where the signal sticks or clips, if it does.
            levels = held.loc[held["signal"].eq(name), "where"].dropna().tolist()
            look = {"color": ROLES["misfit"].colour, "ls": "--", "lw": scaled(1.0)}
            for level in levels:
                panel.axvline(level, label="level held, measured", **look)
            if not self._own or i % columns == 0:
                panel.set_ylabel(with_unit("mean residual", self.comparison.unit))
        return self.lines_

    def _draw_bins(self, panel: Axes, name: str, bins: pd.DataFrame, unit: str | None) -> None:
        """Mean residual in the bins of one channel, and the band of chance around zero."""
        bins = bins.sort_values("center")
        at, mean, half = (bins[name].to_numpy(dtype=float) for name in ("center", "mean", "band"))
        label = chance(self.comparison.false_alarm)
        draw_band(panel, at, -half, half, GREY, label, alpha=0.35)
        panel.axhline(0.0, color=GREY, lw=scaled(0.8))
        valid = bool(bins["valid"].all())
        look: dict[str, Any] = {"marker": "o", "ms": sized(3.5), "lw": scaled(1.2)}
        look["color"] = ROLES["residual"].colour if valid else dimmed(0.55)
        label = "residual" if valid else CLOSED_LOOP
        (self.lines_[name],) = panel.plot(at, mean, label=label, **look)
        raised = exceeding(bins)
        if valid and raised.any():
            self._mark(panel, at[raised], mean[raised], ms=sized(5.5), zorder=3)
        panel.set_xlabel(self._bins_label(bins, unit))
        panel.xaxis.set_major_locator(MaxNLocator(4))
        if not valid:
            panel.set_title(CLOSED_LOOP, fontsize="small", color=dimmed())
        panel.grid(alpha=0.3)

    def _bins_label(self, bins: pd.DataFrame, unit: str | None) -> str:
        channel, lag = bins["channel"].iloc[0], float(bins["lag"].iloc[0])
        name, output = CHANNELS.get(channel, channel), self.comparison.output
        if channel in (output, f"{output} rate"):
            # Not the measured one, which holds the residual itself.
            name = f"simulated {channel}"
        late = f" {lag:.2f} s earlier" if lag > 0 else ""
        return with_unit(f"{name}{late}", unit)

    def _draw_map(self, ax: Any) -> Any:
        table = self.comparison.time_frequency
        self._take_axes(ax, "the map", figsize=(6.4, 4.2))
        panel = self.ax_
        omega = table.columns.to_numpy(dtype=float)
        time = table.index.to_numpy(dtype=float)
        ratio = table.to_numpy(dtype=float)[:, omega > 0]
        limit = np.broadcast_to(table.attrs.get("limit", np.inf), omega.shape)
        cells = np.argwhere(ratio > limit[omega > 0])
        omega = omega[omega > 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.ma.masked_invalid(10 * np.log10(ratio))
        if min(ratio.shape) < 2 or level.count() == 0:
            say_instead(panel, "Time and frequency: not available, no run is long enough.")
            return []
        highest = float(np.percentile(np.abs(level.compressed()), HELD))
        end = float(np.clip(np.ceil(highest), LEAST, MOST))
        edges = _edges(time), np.exp(_edges(np.log(omega)))
        mesh = panel.pcolormesh(
            *edges, level.T, cmap="RdBu_r", vmin=-end, vmax=end, rasterized=True
        )
        if len(cells):
            # On cells of any colour, in any style.
            look: dict[str, Any] = {"mec": foreground(), "mew": scaled(0.8)}
            look["color"] = background()
            self._mark(panel, time[cells[:, 0]], omega[cells[:, 1]], ms=sized(3.0), **look)
        panel.set_yscale("log")
        plain_logarithmic(panel.yaxis)
        panel.set_xlabel("time in the run, s")
        panel.set_ylabel("frequency, rad/s")
        self.figure_.colorbar(mesh, ax=panel, label="residual / remnant, dB", extend="both")
        return mesh

    def _draw_correlation(self, ax: Any) -> Any:
        tests_first = self.comparison.correlations.sort_values(
            "valid", ascending=False, kind="stable"
        )
        tables = dict(list(tests_first.groupby("signal", sort=False)))
        n = max(len(tables), 1)
        self._take_axes(ax, "one for each signal", (n, 1), figsize=(6.4, 1.3 + 1.6 * n))
        if not tables:
            say_instead(self.ax_, "Correlation with other signals: not available.")
            return []
        for panel, (name, table) in zip(self.axes_, tables.items(), strict=True):
            self._draw_lags(panel, name, table.sort_values("lag"))
        self.axes_[-1].set_xlabel("lag, s (positive: the residual follows)")
        return self.lines_

    def _draw_lags(self, panel: Axes, name: str, table: pd.DataFrame) -> None:
        lag, value, half = (
            table[column].to_numpy(dtype=float) for column in ("lag", "correlation", "band")
        )
        valid = bool(table["valid"].all())
        panel.axhline(0.0, color=foreground(), lw=scaled(0.6))
        panel.axvline(0.0, color=foreground(), lw=scaled(0.6))
        label = chance(self.comparison.false_alarm)
        draw_band(panel, lag, -half, half, GREY, label, alpha=0.3)
        colour = ROLES["residual"].colour if valid else GREY
        label = "correlation with the residual" if valid else CLOSED_LOOP
        (self.lines_[name],) = panel.plot(lag, value, color=colour, lw=scaled(1.4), label=label)
        outside = np.abs(value) > half
        if valid and outside.any():
            self._mark(panel, lag[outside], value[outside], ms=sized(3))
        title = CHANNELS.get(name, name) + ("" if valid else f" ({CLOSED_LOOP})")
        colour = foreground() if valid else dimmed()
        panel.set_title(title, loc="left", fontsize="medium", color=colour)
        panel.set_xlim(lag[0], lag[-1])
        panel.set_ylabel("correlation")
        panel.grid(alpha=0.3)


def draw_lost_points(
    panel: Axes, windows: pd.DataFrame, false_alarm: float, *, even: bool = True
) -> list[Any]:
    """VAF points that each window costs, and the misfit among them; nothing if not known.

    ``even`` draws what they would be if the loss were spread evenly over time.
    """
    share = windows["share"].to_numpy(dtype=float)
    if not np.isfinite(share).any():
        say_instead(panel, "Where in time: not available, no window holds scored rows.")
        return []
    start, stop = windows["start"].to_numpy(), windows["stop"].to_numpy()
    look: dict[str, Any] = {"width": stop - start, "align": "edge", "edgecolor": background()}
    look["linewidth"] = 0.6
    raised, repeats = failing(windows, false_alarm), knows_repeats(windows)
    rest, label = ROLES["residual"], "residual"
    if raised.any() and repeats:
        rest, label = ROLES["remnant"], "remnant: does not repeat"
    bars = panel.bar(start, share, color=rest.colour, label=label, **look)
    if raised.any():
        height, label = share, f"misfit: {beyond(false_alarm)}"
        if repeats:  # a part of the bar, though estimates of it may exceed the bar
            height = np.clip(windows["explainable"].to_numpy(dtype=float), 0, share)
            label = "misfit: repeats over runs"
        height = np.where(raised, height, 0.0)
        panel.bar(start, height, color=ROLES["misfit"].colour, label=label, **look)
    if even:
        level = np.nansum(share) * (stop - start) / np.sum((stop - start)[np.isfinite(share)])
        dots: dict[str, Any] = {"color": foreground(), "lw": scaled(0.8), "ls": ":"}
        stairs = _stairs(windows.assign(even=level), "even")
        panel.plot(*stairs, label="if lost evenly over time", **dots)
    panel.set_ylabel("VAF points lost")
    panel.grid(alpha=0.3, axis="y")
    panel.set_axisbelow(True)
    return [bars]


def knows_repeats(windows: pd.DataFrame) -> bool:
    """Whether it is known how much of the windows repeats over runs."""
    return set(windows) >= REPEATS and bool(windows["p_explainable"].notna().any())


def failing(windows: pd.DataFrame, false_alarm: float) -> np.ndarray:
    """Windows in which the model fails: what repeats there, if that is known, is beyond chance."""
    if knows_repeats(windows):
        return (windows["p_explainable"] < false_alarm).to_numpy(dtype=bool)
    return worse_than_chance(windows)


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


def mark_changes(panel: Axes, changes: dict[str, float]) -> list[Any]:
    """A line at each change, of a style of its own."""
    return [
        panel.axvline(at, color=foreground(), ls=style, lw=scaled(1.1), label=f"{name}, {at:.1f} s")
        for style, (name, at) in zip(CHANGE_STYLES, changes.items(), strict=False)
    ]


def _stairs(windows: pd.DataFrame, name: str = "ratio") -> tuple[np.ndarray, np.ndarray]:
    """A column as a line that is level inside each window."""
    time = windows[["start", "stop"]].to_numpy(dtype=float).ravel()
    return time, np.repeat(windows[name].to_numpy(dtype=float), 2)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of cells halfway between their centres."""
    half = np.diff(centres) / 2
    return np.concatenate([[centres[0] - half[0]], centres[:-1] + half, [centres[-1] + half[-1]]])


def is_of_all_runs(table: pd.DataFrame) -> np.ndarray:
    return (table["run"] == ALL_RUNS).to_numpy(dtype=bool)


def exceeding(table: pd.DataFrame) -> np.ndarray:
    """Rows that exceed chance; what is not known does not."""
    return table["exceeds"].eq(True).to_numpy(dtype=bool)


def beyond(false_alarm: float) -> str:
    return f"beyond chance ({100 * (1 - false_alarm):g} %)"


def chance(false_alarm: float) -> str:
    return f"chance ({100 * (1 - false_alarm):g} %)"


def percent(value: float) -> str:
    return f"{value:.1f} %"
