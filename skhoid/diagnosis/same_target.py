"""Which runs have one target and the same recorded disturbances, without comparing all pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..runs import RunLayout

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

    Each run joins the first others that are like it. Also the disturbances in which runs of one
    target differ. ``stretches`` are first and last row + 1 of runs by number, without a gap inside.
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

    A sum of squared differences over some samples is none too large for all of them: most pairs
    are told apart by a few.
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
