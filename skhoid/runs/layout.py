"""Where runs, segments and marks lie in the rows of a table.

A recording is a table with one row per sample. Which run a row belongs to, and when it was taken,
travels in the row index of ``X`` (levels ``run`` and ``time``, in seconds; optional outer levels
such as ``subject`` and ``condition``) or, for arrays and plain frames, in a run column (``run=``)
and a sampling time (``dt=``). The rest of skhoid asks :func:`read_layout`.
"""

from __future__ import annotations

import warnings
from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError, RunIndexError, SlowClockWarning
from .clock import (
    GAP,
    JITTER_TOLERANCE,
    RUN,
    TIME,
    check_increasing,
    refuse_datetime,
    snap,
    time_in_seconds,
    typical_step,
)
from .containers import refuse_container
from .flat import refuse_flat
from .marks import DecimationMark, is_mark, read_marks
from .roles import of_person, run_column

SLOW = 2.0  # s a row, at which nobody steers
LONGEST_DT = 1e100  # s, with which times are still computed


@dataclass(frozen=True)
class RunLayout:
    """Where runs, segments and marks lie in the rows of a table.

    ``run_starts`` and ``starts`` are row offsets that end with the number of rows: runs, and the
    segments into which gaps cut them. ``time`` is in seconds, ``dt`` the sampling time,
    ``jitter`` the largest deviation of a step from ``dt``, as a fraction of it.
    """

    labels: list[Any]
    run_starts: np.ndarray
    starts: np.ndarray
    time: np.ndarray
    dt: float
    jitter: float = 0.0
    indexed: bool = False
    trimmed: np.ndarray | None = None
    mark: DecimationMark | None = None
    kept: np.ndarray | None = None
    run_column: str | None = None

    @property
    def n_rows(self) -> int:
        return int(self.run_starts[-1])

    @property
    def stretches(self) -> np.ndarray:
        """Segment offsets, also cut where the run-in ends."""
        if self.trimmed is None:
            return self.starts
        flips = np.flatnonzero(self.trimmed[1:] != self.trimmed[:-1]) + 1
        return np.union1d(self.starts, flips)

    def run_of(self, rows: np.ndarray) -> np.ndarray:
        """Run number, counted from 0, of each row position."""
        return np.searchsorted(self.run_starts, rows, side="right") - 1

    def of_run(self, run: int) -> RunLayout:
        """Layout of the rows of one run."""
        a, b = self.run_starts[run : run + 2].tolist()
        low, high = np.searchsorted(self.starts, (a, b))
        return replace(
            self,
            labels=self.labels[run : run + 1],
            run_starts=np.array([0, b - a]),
            starts=self.starts[low : high + 1] - a,
            time=self.time[a:b],
            trimmed=None if self.trimmed is None else self.trimmed[a:b],
            kept=None if self.kept is None else self.kept[a:b],
        )

    def where(self, row: int) -> str:
        """Name a row in an error message: its run, its time and its position."""
        run = self.labels[int(self.run_of(np.asarray(row)))]
        return f"run {run!r}, t = {self.time[row]:.6g} s (row {row})"

    def sample_numbers(self) -> np.ndarray:
        """Sample number of each row, counted from time zero and without a break in a segment."""
        first = self.starts[:-1]
        # A quarter sample of slack either way, so that times on half samples do not flip.
        base = np.floor(self.time[first] / self.dt + 0.25).astype(np.int64)
        lengths = np.diff(self.starts)
        return np.arange(self.n_rows) - np.repeat(first - base, lengths)


def run_name(label: Any) -> str:
    """A run label as text; those of outer levels are joined, ``S1/C3/2``."""
    return "/".join(map(str, label)) if isinstance(label, tuple) else str(label)


def read_layout(
    X: Any, *, dt: float | None = None, run: Any = None, fallback_dt: float | None = None
) -> RunLayout:
    """Read runs, segments, sampling time and marks of ``X`` and check them.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_columns)
    dt : float or None
        Sampling time in seconds. With a time index it must agree with the index; without one,
        None means 1.
    run : column name or position, or None
        Column that holds the run label, for tables without a run index.
    fallback_dt : float or None
        Sampling time when the index does not show it (runs of one row).

    Raises
    ------
    RunIndexError
        Runs not contiguous, time not increasing, index levels missing, time not in seconds; run
        or time in columns that nothing names.
    IrregularSamplingError
        Steps that deviate by more than 10 % from the sampling time and are not gaps.
    """
    if dt is not None:
        if not 0 < dt < LONGEST_DT:
            raise ValueError(
                f"dt must be the sampling time in seconds, a positive number; got {dt!r}."
            )
        dt = float(dt)
    index = getattr(X, "index", None)
    if not isinstance(index, pd.Index):
        index = None
    if isinstance(index, pd.MultiIndex):
        layout = _layout_from_multiindex(index, dt, fallback_dt)
        _doubt_slow_clock(X, layout, dt or fallback_dt)
        return layout
    if isinstance(index, (pd.DatetimeIndex, pd.TimedeltaIndex)):
        refuse_datetime(index)
    if index is None:
        refuse_container(X)
    n_rows = index.size if index is not None else np.asarray(X).shape[0]
    refuse_flat(X, dt=dt, run=run)
    if index is not None and index.name != TIME and index.dtype.kind == "f":
        raise RunIndexError(
            "The row index of X holds numbers that are not whole but has no name. If they are "
            "seconds, say so (X.index.name = 'time'); if they mean nothing, call "
            "X.reset_index(drop=True)."
        )
    run_starts, labels = _runs_of_column(X, run, n_rows)
    if index is not None and index.name == TIME:
        time = time_in_seconds(index)
        layout = _layout_from_time(time, labels, run_starts, dt, fallback_dt, indexed=True)
        _doubt_slow_clock(X, layout, dt or fallback_dt)
        return layout
    step = dt if dt is not None else (fallback_dt if fallback_dt is not None else 1.0)
    starts = run_starts
    number = np.arange(n_rows) - np.repeat(run_starts[:-1], np.diff(run_starts))
    if index is not None and not isinstance(index, pd.RangeIndex) and index.dtype.kind in "iu":
        starts, number = _cut_at_jumps(index.to_numpy(), run_starts, number)
    return RunLayout(labels, run_starts, starts, number * step, step)


def _doubt_slow_clock(X: Any, layout: RunLayout, said: float | None) -> None:
    """Warn of a clock on which nobody steers, where the channels are those of a person.

    Machines may tick every 9 s; a person's clock of 2 s and more counts milliseconds or rows.
    """
    if said is None and layout.dt >= SLOW and of_person(map(str, getattr(X, "columns", ()))):
        warnings.warn(
            SlowClockWarning(
                f"The time index advances by {layout.dt:g} a row, which is counted as "
                f"{layout.dt:g} s. The channels are those of a person, who does not steer that "
                "slowly.",
                hint="If these are milliseconds, divide them by 1000 (read_runs does so with "
                "units={'t': 'ms'}); if they are row numbers, multiply them by the sampling time. "
                f"If they are seconds, say so with dt={layout.dt:g}.",
                options=["unit", "dt"],
            ),
            stacklevel=2,
        )


def _runs_of_column(X: Any, run: Any, n_rows: int) -> tuple[np.ndarray, list[Any]]:
    if run is None:
        return np.array([0, n_rows]), [0]
    if isinstance(X, pd.DataFrame):
        values = X.iloc[:, run_column(list(X.columns), run)].to_numpy()
    else:
        array = np.asarray(X)
        values = array[:, run_column(list(range(array.shape[1])), run)]
    codes, labels = numbered(values, f"column {run!r}")
    return contiguous_runs(codes, labels), labels


def numbered(values: Any, where: str) -> tuple[np.ndarray, list[Any]]:
    """Numbers of labels in order of appearance, and the labels, checked."""
    try:
        codes, labels = pd.factorize(values)
    except TypeError as error:
        row = next(i for i, label in enumerate(values) if not isinstance(label, Hashable))
        raise RunIndexError(
            f"The run label in {where} is {values[row]!r} in row {row}: labels must be numbers or "
            "text."
        ) from error
    if np.any(codes < 0):
        row = int(np.flatnonzero(codes < 0)[0])
        raise RunIndexError(f"The run label in {where} is missing in row {row}.")
    return codes, pd.Index(labels).tolist()


def within_runs(run_starts: np.ndarray) -> np.ndarray:
    """Steps between rows of one run, of all steps from a row to the next."""
    within = np.ones(max(int(run_starts[-1]) - 1, 0), dtype=bool)
    within[run_starts[1:-1] - 1] = False
    return within


def contiguous_runs(codes: np.ndarray, labels: list[Any]) -> np.ndarray:
    """Offsets of the runs, whose codes are numbered in order of appearance."""
    if not codes.size:
        return np.array([0, 0])
    change = np.flatnonzero(codes[1:] != codes[:-1]) + 1
    if change.size + 1 > len(labels):
        back = change[np.flatnonzero(codes[change] < codes[change - 1])[0]]
        label = labels[codes[back]]
        raise RunIndexError(
            f"The rows of run {label!r} are not contiguous: they continue at row {back}, after "
            f"rows of run {labels[codes[back - 1]]!r}. Sort the table by run and time (X = "
            "X.sort_index(), y likewise), or give each run its own label. Cross-validation must "
            "not shuffle rows: use LeaveOneGroupOut or GroupKFold with groups=run_labels(X)."
        )
    return np.concatenate(([0], change, [codes.size]))


def check_levels(index: pd.Index) -> None:
    """Refuse levels that share a name: what is asked for by name would be either."""
    names = list(index.names)
    twice = next((name for name in names if names.count(name) > 1), RUN)
    if names.count(twice) > 1:
        raise RunIndexError(
            f"{names.count(twice)} levels of the row index of X are called {twice!r}: give each a "
            "different name, X.index = X.index.set_names([...])."
        )


def _layout_from_multiindex(
    index: pd.MultiIndex, dt: float | None, fallback_dt: float | None
) -> RunLayout:
    names = list(index.names)
    if RUN not in names or TIME not in names:
        raise RunIndexError(
            f"The row index of X has the levels {names}; skhoid needs the levels 'run' and 'time' "
            "(in seconds), with optional outer ones such as 'subject'. Rename them with "
            "X.index = X.index.set_names([...]) or build the index with "
            "X.set_index(['run', 'time'])."
        )
    check_levels(index)
    marks = read_marks(index)
    keys = [i for i, name in enumerate(names) if name != TIME and not is_mark(str(name))]
    codes: Any = 0
    for position in keys:
        level_codes = np.asarray(index.codes[position])
        if level_codes.size and level_codes.min() < 0:
            row = int(np.flatnonzero(level_codes < 0)[0])
            raise RunIndexError(
                f"Row {row} has no label in the index level {names[position]!r} (NaN)."
            )
        if len(keys) > 1:
            level_codes = level_codes.astype(np.int64)
        codes = codes * max(len(index.levels[position]), 1) + level_codes
    changes = np.flatnonzero(codes[1:] != codes[:-1]) + 1
    firsts = np.concatenate(([0], changes)) if codes.size else np.array([], dtype=np.int64)
    run_starts = np.append(firsts, codes.size)
    if len(keys) > 1 and firsts.size == codes.size > 1:
        raise RunIndexError(
            f"The index levels {[names[k] for k in keys]} together make every row a run of its "
            "own. Levels besides 'run' and 'time' should name subjects or conditions; drop others "
            "with X.index = X.index.droplevel(...)."
        )
    levels = [index.levels[p].take(np.asarray(index.codes[p])[firsts]) for p in keys]
    labels = list(zip(*levels, strict=True)) if len(keys) > 1 else list(levels[0])
    block_codes, unique = pd.factorize(codes[firsts])
    if len(unique) < len(firsts):
        contiguous_runs(np.repeat(block_codes, np.diff(run_starts)), list(dict.fromkeys(labels)))
    time = time_in_seconds(index.get_level_values(TIME))
    layout = _layout_from_time(
        time,
        labels,
        run_starts,
        dt,
        fallback_dt,
        indexed=True,
        **marks,
    )
    _check_mark(layout)
    return layout


def _check_mark(layout: RunLayout) -> None:
    """Refuse a decimation mark whose rows were dropped after the Decimator."""
    if layout.mark is None or layout.kept is None:
        return
    expected = layout.sample_numbers() % layout.mark.factor == 0
    if not np.array_equal(expected, layout.kept):
        row = int(np.flatnonzero(expected != layout.kept)[0])
        raise RunIndexError(
            f"Rows were dropped after the Decimator: its mark does not fit {layout.where(row)}. "
            "The estimator thins marked rows itself; pass it all rows."
        )


def _layout_from_time(
    time: np.ndarray,
    labels: list[Any],
    run_starts: np.ndarray,
    dt: float | None,
    fallback_dt: float | None,
    **marks: Any,
) -> RunLayout:
    step = np.diff(time)
    within = within_runs(run_starts)
    check_increasing(time, step, within, run_starts, labels)
    typical = typical_step(step, run_starts, labels)
    known = dt or fallback_dt
    few = within.sum() < 3
    if known is not None and (
        few or (within & (step >= 0.99 * known) & (step <= 1.01 * known)).any()
    ):
        typical = known  # of few rows around a gap the median says nothing
    if typical is None:
        typical = dt or fallback_dt
        if typical is None:
            raise IrregularSamplingError(
                "The sampling time cannot be read from the index: no run has more than one row.",
                hint="Give it as dt= (in seconds).",
                options=["dt"],
            )
    starts = _cut(run_starts, within & (step > GAP * typical))
    regular = step[within & (step <= GAP * typical)]
    del step  # as long as the data, like what follows
    found = snap(float(regular.mean()) if regular.size else typical)
    for given, whose in ((dt, "and dt="), (fallback_dt, "and the model was fitted at ")):
        if given is not None and abs(found - given) > 0.01 * given:
            raise IrregularSamplingError(
                f"Time advances by {found:g} s per row, {whose}{given:g} s. Use data with one "
                "sampling time.",
                hint=f"skhoid.resample_runs(X, dt={given:g}) makes that grid.",
                options=["resample", "dt"],
            )
    found = dt or fallback_dt or found
    jitter = 0.0
    if regular.size:
        jitter = float(max(regular.max() - found, found - regular.min()) / found)
    layout = RunLayout(labels, run_starts, starts, time, found, jitter, **marks)
    if jitter > JITTER_TOLERANCE:
        raise _irregular(layout, typical)
    return layout


def _irregular(layout: RunLayout, typical: float) -> IrregularSamplingError:
    """Say where the step is that deviates most from the sampling time."""
    step, dt = np.diff(layout.time), layout.dt
    deviation = np.where(within_runs(layout.starts), np.abs(step - dt) / dt, np.nan)
    row = int(np.nanargmax(deviation)) + 1
    return IrregularSamplingError(
        f"Irregular sampling: {layout.where(row)} comes {step[row - 1]:.6g} s after the previous "
        f"row, but the sampling time is {snap(typical):.6g} s (largest deviation "
        f"{100 * layout.jitter:.1f} %, rms {100 * np.sqrt(np.nanmean(deviation**2)):.2f} %; "
        f"{100 * JITTER_TOLERANCE:.0f} % is allowed).",
        hint="Put the runs on a regular grid with X, y = skhoid.resample_runs(X, y, "
        f"dt={snap(typical):.6g}).",
        options=["resample", "dt"],
    )


def _cut(run_starts: np.ndarray, is_cut: np.ndarray) -> np.ndarray:
    cuts = np.flatnonzero(is_cut) + 1
    return np.union1d(run_starts, cuts) if cuts.size else run_starts


def _cut_at_jumps(
    sample: np.ndarray, run_starts: np.ndarray, number: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Read an integer row index as sample numbers: a jump is a gap, as KFold leaves it."""
    step = np.diff(sample.astype(np.int64))
    within = within_runs(run_starts)
    backwards = np.flatnonzero(within & (step <= 0))
    if backwards.size:
        row = int(backwards[0]) + 1
        raise RunIndexError(
            f"The rows are shuffled or hold several runs: the row index goes from "
            f"{sample[row - 1]} to {sample[row]} at row {row}. Rows must be in time order.",
            hint="Label runs with an index of levels 'run' and 'time', or with a run column and "
            "run=; if the index means nothing, call X.reset_index(drop=True).",
            options=["run"],
        )
    if within.any() and np.median(step[within]) == 1:
        first = np.repeat(sample[run_starts[:-1]], np.diff(run_starts))
        return _cut(run_starts, within & (step > 1)), sample - first
    return run_starts, number


def run_time_index(layout: RunLayout) -> pd.MultiIndex:
    """The row index that says what ``layout`` says."""
    rows = np.arange(layout.n_rows)
    labels = pd.Index(layout.labels).take(layout.run_of(rows))
    return pd.MultiIndex.from_arrays([labels, layout.time], names=[RUN, TIME])
