"""Which runs are repeats of each other, and the whole periods of what drives them."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy import fft
from scipy.stats import f as f_distribution

from ..runs import RunLayout
from ..runs.roles import is_external
from ..text import Note, counted
from .leaks import (
    band_edge,
    estimated_inverse,
    lagged,
    low_passed,
    triangle,
    with_target_and_x,
)

LINE = 3e-4  # power of an excited line at least, as a fraction of that of the strongest
BESIDE = 0.05  # of the lines, at most, are neighbours
BETWEEN = 1e-3  # of the power of a periodic target, at most, is off its lines
PERIODIC = 1e-3  # power of f(t + P) - f(t), as a fraction of twice that of f
MOVED = 0.3  # the same at least once before a period can end: near 0 shifts everything is alike
SEEN = 0.25  # of a period, at least, that is there a second time
KEPT = 2 / 3  # of the rows of repeats, at least, that whole periods leave
POWER = 0.9  # of the output, in the band in which disturbances are compared
APART = 0.12  # rms difference of two disturbances (over root 2), of the rms output
ALIKE = 0.7  # correlation of disturbances that are the same
WINDOWS = (1, 4)  # stretches of a run with an element of their own: it may change
BAND = 0.95  # of the output, in the band in which it may answer a disturbance
SAMPLED = 4  # samples a period of the edge of that band
PAST = 10  # samples
CHANCE = 1e-3  # with which a disturbance that is not answered may seem to be
THINNED = 8  # samples a period of the edge of the band


class Decided(StrEnum):
    """How it is known which runs repeat each other."""

    BY_TARGET = "the targets alone were compared"
    BY_CALLER = "the caller says it"
    RECORDED = "runs of one target differ in a recorded disturbance"
    UNRECORDED = "runs of one target differ in a disturbance that u and x show"
    ALIKE = "u and x show no such disturbance"
    UNCHECKED = "a disturbance that was not recorded cannot be ruled out"

    @property
    def apart(self) -> bool:
        """Whether runs of one target were told apart by a disturbance."""
        return self in (Decided.RECORDED, Decided.UNRECORDED)


BY_TARGET = Note(Decided.BY_TARGET, "")


@dataclass(frozen=True)
class Group:
    """Runs (``rows``, one row a run) of one target; ``lines`` are its excited bins, if any."""

    runs: np.ndarray
    rows: np.ndarray
    lines: np.ndarray | None

    @property
    def n_runs(self) -> int:
        return self.rows.shape[0]

    @property
    def n_samples(self) -> int:
        return self.rows.shape[1]

    def omega(self, dt: float) -> np.ndarray:
        """Frequencies of the bins, in rad/s."""
        return 2 * np.pi * fft.rfftfreq(self.n_samples, dt)


def grouped(
    layout: RunLayout,
    stretches: Mapping[int, tuple[int, int]],
    measured: np.ndarray,
    channels: Mapping[str, np.ndarray],
    repeats: Any,
) -> tuple[list[Group], Note, list[Note]]:
    """Groups of repeats (of one target and disturbance), how that was decided, and notes."""
    labels = repeat_labels(layout, repeats)
    outside = {name: values for name, values in channels.items() if is_external(name)}
    idle = [
        name
        for name in outside
        if name != "f_t" and not _is_answered(name, outside, measured, stretches, layout)
    ]
    outside = {name: values for name, values in outside.items() if name not in idle}
    members, apart = runs_in_common(layout, stretches, outside, labels)
    groups = []
    notes = [
        Note("idle disturbance", f"{name} is recorded, and the output does not follow it")
        for name in idle
    ]
    decided = BY_TARGET
    if labels is not None:
        decided = Note(Decided.BY_CALLER, "repeats= says which runs repeat")
    elif apart:
        names = ", ".join(sorted(apart))
        text = f"runs that share the target differ in the recorded disturbance {names}"
        decided = Note(Decided.RECORDED, text)
    for runs, rows in members:
        split = [np.arange(len(runs))]
        if labels is None and len(runs) > 1:
            split, how = _by_disturbance(measured, channels, rows, layout)
            if decided is BY_TARGET:
                decided = how
        for part in split:
            group = Group(np.array(runs)[part], rows[part], None)
            group, note = _in_whole_periods(group, outside, layout)
            groups.append(group)
            notes += note
    return groups, decided, list(dict.fromkeys(notes))


def repeat_labels(layout: RunLayout, repeats: Any) -> list[Any] | None:
    """What ``repeats`` says of each run; None leaves it to the target."""
    n_runs = len(layout.labels)
    if repeats is None:
        return None
    if isinstance(repeats, (bool, np.bool_)):
        return [0] * n_runs if repeats else list(range(n_runs))
    if isinstance(repeats, Mapping):
        unknown = [label for label in repeats if label not in layout.labels]
        if unknown:
            raise ValueError(f"repeats names run {unknown[0]!r}; the runs are {layout.labels}.")
        return [repeats.get(label, ("alone", label)) for label in layout.labels]
    if isinstance(repeats, str) or not isinstance(repeats, Iterable):
        raise TypeError(
            "repeats must be None, True, False, a dict {run: label} or a sequence of one label per "
            "run; "
            f"got {repeats!r}."
        )
    labels = list(repeats)
    if not all(isinstance(label, Hashable) for label in labels):
        raise TypeError(
            f"repeats must have a label for each run, a number or a name; got {repeats!r}."
        )
    if len(labels) != n_runs:
        raise ValueError(
            f"repeats has {len(labels)} entries for {n_runs} runs: give one label per run (runs "
            "with the same label repeat each other), a dict {run: label}, True (all are repeats) "
            "or False (none are)."
        )
    return labels


def _is_answered(
    name: str,
    outside: Mapping[str, np.ndarray],
    measured: np.ndarray,
    stretches: Mapping[int, tuple[int, int]],
    layout: RunLayout,
) -> bool:
    """Whether the output answers a disturbance that differs between runs of one target.

    By an F test of the past of the disturbance beside that of the output (Granger, 1969): in runs
    of one target in what differs from their mean, in others beside the past of the target.
    """
    others = {key: values for key, values in outside.items() if key != name}
    members, _ = runs_in_common(layout, stretches, others, None)
    edge = band_edge([measured[start:stop] for start, stop in stretches.values()], layout.dt, BAND)
    if not edge:
        return True
    step = max(int(1 / (SAMPLED * edge * layout.dt)), 1)
    target = outside.get("f_t", np.zeros_like(measured))
    tables, free, differs = [], 0.0, False
    for _, rows in members:
        low = {
            key: np.array([low_passed(values[part], layout.dt, edge)[::step] for part in rows])
            for key, values in (("u", measured), ("f", target), ("d", outside[name]))
        }
        centred = {
            key: values - values.mean(axis=int(len(rows) == 1)) for key, values in low.items()
        }
        differs |= bool(np.ptp(centred["d"]) > SAME_TARGET * np.ptp(low["d"]) > 0)
        for u, f, d in zip(*centred.values(), strict=True):
            past = [lagged(v, np.arange(1, PAST + 1)) for v in (u, f, d)]
            tables.append(np.column_stack([*past, u])[PAST:])
            free += len(tables[-1]) * (1 - 1 / len(rows) if len(rows) > 1 else 1)
    # R of the tables: its last column holds what the columns before it leave of the output.
    rows_left, _ = triangle(tables)
    rest, more = float(rows_left[-1, -1] ** 2), float(np.sum(rows_left[-1 - PAST : -1, -1] ** 2))
    free -= 3 * PAST
    if not differs or free <= 0 or not rest > 0:
        return True
    return bool(f_distribution.sf(more / PAST / (rest / free), PAST, free) < CHANCE)


def _by_disturbance(
    measured: np.ndarray, channels: Mapping[str, np.ndarray], rows: np.ndarray, layout: RunLayout
) -> tuple[list[np.ndarray], Note]:
    """Split runs of one target by a disturbance that was not recorded, and say how.

    With an estimated element x = G (u + d), d follows: with one element or one a window, whichever
    leaves the runs more alike.
    """
    together = [np.arange(len(rows))]
    signals = with_target_and_x(channels)
    if signals is None:
        return together, Note(
            Decided.UNCHECKED, "that no unrecorded disturbance acts cannot be checked without x"
        )
    target, x = signals
    dt = layout.dt
    edge = band_edge([measured[part] for part in rows], dt, POWER)
    step = max(int(1 / (THINNED * edge * dt)), 1) if edge else 1
    taps = max(round(0.15 / (edge * dt * step)), 1) if edge else 1
    low = [
        {
            name: low_passed(values[part], dt, edge)[::step]
            for name, values in (("u", measured), ("x", x), ("target", target))
        }
        for part in rows
        if edge
    ]
    found = [_disturbances(low, dt * step, taps, n) for n in WINDOWS] if low else []
    estimates = [estimate for estimate in found if estimate is not None]
    if not estimates:
        return together, Note(
            Decided.UNCHECKED,
            "that no unrecorded disturbance acts could not be checked: the controlled element "
            "cannot be estimated from u and x",
        )
    size = float(np.mean([np.std(part["u"]) for part in low]))

    def same(i: int, j: int) -> bool:
        return any(
            np.std(d[i] - d[j]) < np.sqrt(2) * APART * size or np.corrcoef(d[i], d[j])[0, 1] > ALIKE
            for d in estimates
        )

    split: list[list[int]] = []
    for run in range(len(rows)):
        for part in split:
            if same(part[0], run):
                part.append(run)
                break
        else:
            split.append([run])
    if len(split) == 1:
        text = "u and x show no unrecorded disturbance that differs between them"
        return together, Note(Decided.ALIKE, text)
    text = "u and x show an unrecorded disturbance that differs between runs of one target"
    return [np.array(part) for part in split], Note(Decided.UNRECORDED, text)


def _disturbances(
    low: list[dict[str, np.ndarray]], dt: float, taps: int, n_windows: int
) -> np.ndarray | None:
    """Estimated disturbance (runs in rows), with an element for each window."""
    n = low[0]["u"].size
    found = []
    for rows in np.array_split(np.arange(n), n_windows):
        parts = [{name: values[rows] for name, values in piece.items()} for piece in low]
        received = estimated_inverse(parts, dt, taps)
        if isinstance(received, str):
            return None
        found.append([v - part["u"] for v, part in zip(received, parts, strict=True)])
    edge = taps  # samples that the derivatives at either end are not known in
    return np.array([np.concatenate(d)[edge:-edge] for d in zip(*found, strict=True)])


def _in_whole_periods(
    group: Group, outside: Mapping[str, np.ndarray], layout: RunLayout
) -> tuple[Group, list[Note]]:
    """A group with the lines of what drives it, on whole periods where its start is left out."""
    lines = _lines(outside, group.rows[0])
    if lines is not None or "f_t" not in outside:
        return replace(group, lines=lines), []
    period = _period(outside, group.rows[0])
    if period is None:
        first = layout.starts[group.runs[0]]
        period = _period(outside, np.arange(first, group.rows[0][-1] + 1))
    n = group.n_samples
    if period is None or period > n:
        return group, []
    kept = n // period * period
    if group.n_runs > 1 and kept < KEPT * n:
        return group, []
    rows = group.rows[:, n - kept :]
    lines = _lines(outside, rows[0], whole=True)
    if lines is None:
        return group, []
    if kept == n:
        return replace(group, lines=lines), []
    text = (
        f"the target has a period of {period * layout.dt:.4g} s: spectra, tests and ceiling use "
        f"the last {counted(kept // period, 'whole period')}, and so begin "
        f"{(n - kept) * layout.dt:.3g} s later than the VAF"
    )
    return Group(group.runs, rows, lines), [Note("whole periods", text)]


def _lines(
    outside: Mapping[str, np.ndarray], rows: np.ndarray, whole: bool = False
) -> np.ndarray | None:
    """Excited bins of all that comes from outside; None if one of it is not periodic."""
    if "f_t" not in outside:
        return None
    found = []
    for values in outside.values():
        part = values[rows]
        if np.ptp(part) > 0:
            lines = excited_lines(part, whole)
            if lines is None:
                return None
            found.append(lines)
    return np.unique(np.concatenate(found)) if found else None


def _period(outside: Mapping[str, np.ndarray], rows: np.ndarray) -> int | None:
    """Least whole number of samples after which all that comes from outside is as before."""
    n = rows.size
    longest = int(n / (1 + SEEN))
    if longest < 2:
        return None
    unlike = np.zeros(longest + 1)
    for values in outside.values():
        f = values[rows] - np.mean(values[rows])
        if not np.ptp(f) > 0:
            continue
        squares = np.concatenate([[0.0], np.cumsum(f**2)])
        shifts = np.arange(longest + 1)
        power = squares[n - shifts] + squares[n] - squares[shifts]
        size = fft.next_fast_len(2 * n, real=True)
        together = fft.irfft(np.abs(fft.rfft(f, size)) ** 2, size)[: longest + 1]
        unlike = np.maximum(unlike, (power - 2 * together) / np.maximum(power, 1e-300))
    left = np.flatnonzero(unlike > MOVED)
    if not left.size:
        return None
    again = np.flatnonzero(unlike[left[0] :] < PERIODIC)
    if not again.size:
        return None
    first = left[0] + int(again[0])
    until = first
    while until < longest and unlike[until + 1] < PERIODIC:
        until += 1
    return first + int(np.argmin(unlike[first : until + 1]))


def excited_lines(target: np.ndarray, whole: bool = False) -> np.ndarray | None:
    """Bins that hold the power of a target periodic in its window (or ``whole``); None if not."""
    power = np.abs(fft.rfft(target - target.mean())) ** 2
    if not power.any():
        return None
    lines = np.flatnonzero(power > LINE * power.max())
    # A window of no whole period leaks from each line into its neighbours.
    alone = whole or np.sum(np.diff(lines) == 1) <= BESIDE * lines.size
    off = power.sum() - power[lines].sum()
    return lines if alone and off <= BETWEEN * power.sum() else None


SAME_TARGET = 0.05  # rms difference of targets of repeats, as a fraction of their rms
OVERLAP = 0.8  # of the longer run, at least, that repeats have in common
EVERY = 32  # samples between those by which runs are told apart first
FIRST = 8  # of these, in a first look; each further one takes twice as many


def runs_in_common(
    layout: RunLayout,
    stretches: Mapping[int, tuple[int, int]],
    outside: Mapping[str, np.ndarray],
    labels: Sequence[Any] | None,
) -> tuple[list[tuple[list[int], np.ndarray]], set[str]]:
    """Runs of one label, or of one target and disturbance, and the rows that they have in common.

    Also the disturbances in which runs of one target differ.
    """
    number = layout.sample_numbers()
    first = {run: int(number[start]) for run, (start, _) in stretches.items()}
    groups = _Groups(stretches, first, {} if labels is not None else outside)
    of_label: dict[Any, list[int]] = {}
    for run in stretches:
        if labels is None:
            found = groups.like(run)
        else:
            near = of_label.setdefault(labels[run], [])
            found = next((int(at) for at in groups.overlapping(run, np.array(near, int))), None)
            if found is None:
                near.append(len(groups.runs))
        groups.add(run, found)
    members = []
    for runs, low, high in zip(groups.runs, groups.low, groups.high, strict=False):
        starts = np.array([stretches[run][0] - first[run] for run in runs])
        members.append((runs, starts[:, None] + np.arange(low, high)))
    return members, groups.apart


class _Groups:
    """Groups of runs so far: sample numbers that they have in common, and signals of the first.

    Most pairs are told apart by a few samples.
    """

    def __init__(
        self,
        stretches: Mapping[int, tuple[int, int]],
        first: Mapping[int, int],
        outside: Mapping[str, np.ndarray],
    ):
        self.stretches, self.first, self.outside = stretches, first, outside
        self.runs: list[list[int]] = []
        self.apart: set[str] = set()
        most = len(stretches)
        self.low, self.high = np.zeros((2, most), dtype=np.int64)
        ends = [first[run] + stop - start for run, (start, stop) in stretches.items()]
        grid = np.arange(-(-min(first.values()) // EVERY) * EVERY, max(ends), EVERY)
        self.grid = np.random.default_rng(0).permutation(grid)
        self.few = {name: np.empty((most, grid.size)) for name in outside}
        self.power = {name: np.empty(most) for name in outside}

    def add(self, run: int, to: int | None) -> None:
        """Add a run to a group, or begin one with it."""
        low, high = self._range(run)
        if to is not None:
            self.runs[to].append(run)
            self.low[to], self.high[to] = max(self.low[to], low), min(self.high[to], high)
            return
        to = len(self.runs)
        self.runs.append([run])
        self.low[to], self.high[to] = low, high
        for name in self.outside:
            self.few[name][to], self.power[name][to] = self._sketch(name, run)

    def like(self, run: int) -> int | None:
        """The first group whose target and disturbances are those of a run."""
        if "f_t" not in self.outside:
            return None
        near = self.overlapping(run, np.arange(len(self.runs)))
        near = near[self.power["f_t"][near] > 0]
        others = self.outside.keys() - {"f_t"}
        for name in ["f_t", *others]:
            # A pair of one target is to be said to differ in a disturbance once.
            if name == "f_t" or others <= self.apart:
                near = self._not_surely_different(name, run, near)
        for group in near:
            differ = self._different(run, group)
            if not differ:
                return int(group)
            if "f_t" not in differ:
                self.apart.update(differ)
        return None

    def overlapping(self, run: int, groups: np.ndarray) -> np.ndarray:
        """Groups that have most of their samples in common with a run."""
        low, high = self._range(run)
        shared = np.minimum(self.high[groups], high) - np.maximum(self.low[groups], low)
        longer = np.maximum(self.high[groups] - self.low[groups], high - low)
        return groups[shared >= OVERLAP * longer]

    def _range(self, run: int) -> tuple[int, int]:
        start, stop = self.stretches[run]
        return self.first[run], self.first[run] + stop - start

    def _sketch(self, name: str, run: int) -> tuple[np.ndarray, float]:
        """Some samples of a run, NaN where it has none, and the sum of squares of all."""
        start, stop = self.stretches[run]
        values = self.outside[name][start:stop]
        at = self.grid - self.first[run]
        known = (at >= 0) & (at < values.size)
        return np.where(known, values[np.where(known, at, 0)], np.nan), float(values @ values)

    def _not_surely_different(self, name: str, run: int, groups: np.ndarray) -> np.ndarray:
        few, power = self._sketch(name, run)
        most = SAME_TARGET**2 * np.maximum(self.power[name][groups], power)
        apart = np.zeros(groups.size)
        begin, end = 0, FIRST
        while begin < self.grid.size and groups.size:
            part = slice(begin, end)
            known = (self.grid[part] >= self.low[groups, None]) & (
                self.grid[part] < self.high[groups, None]
            )
            difference = self.few[name][groups, part] - few[part]
            apart = apart + np.nansum(np.where(known, difference, 0.0) ** 2, axis=1)
            left = apart <= most
            groups, most, apart = groups[left], most[left], apart[left]
            begin, end = end, 2 * end
        return groups

    def _different(self, run: int, group: int) -> list[str]:
        """Signals from outside the loop in which a run differs from the first of a group."""
        low, high = self._range(run)
        low, high = max(int(self.low[group]), low), min(int(self.high[group]), high)
        a, b = (
            slice(low + shift, high + shift)
            for shift in (self.stretches[k][0] - self.first[k] for k in (self.runs[group][0], run))
        )
        if not np.any(self.outside["f_t"][a]):
            return ["f_t"]
        found = []
        for name, values in self.outside.items():
            power = max(float(np.mean(values[a] ** 2)), float(np.mean(values[b] ** 2)))
            if np.mean((values[a] - values[b]) ** 2) > SAME_TARGET**2 * power:
                found.append(name)
        return found
