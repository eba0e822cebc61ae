"""Where runs, segments and marks lie in the rows of a table.

A recording is a table with one row per sample. Which run a row belongs to, and when it was taken,
travels in the row index of ``X`` (levels ``run`` and ``time``, in seconds; optional outer levels
such as ``subject`` and ``condition``) or, for arrays and plain frames, in a run column (``run=``)
and a sampling time (``dt=``). The rest of skhoid asks :func:`read_layout`.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError, RunIndexError, SlowClockWarning
from .roles import RUN, TIME, of_person, run_column
from .tables import (
    JITTER_TOLERANCE,
    DecimationMark,
    is_mark,
    read_marks,
    refuse_container,
    refuse_flat,
)

BY_RUNS = (
    "A model of runs remembers what came before a row: split by whole runs, LeaveOneGroupOut or "
    "GroupKFold with groups=run_labels(X), or a single run in long pieces, TimeSeriesSplit or "
    "KFold without shuffle."
)
SORT = "If they are only in another order, sort them: X = X.sort_index(), y likewise."
SPARSE = 0.5  # of the steps; where fewer are one sample, rows are missing rather than gaps there
GAP = 1.5  # steps longer than this many sampling times start a new segment
WHOLE = 1e-6  # a duration within this many samples of a whole number is that number
SLOW = 2.0  # s a row, at which nobody steers


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


def refuse_drawn(found: str, hint: str = "", options: Sequence[str] = ()) -> NoReturn:
    """Refuse rows that a split, a bootstrap or a sort tore out of their runs."""
    raise RunIndexError(
        f"The rows are shuffled, or drawn one by one: {found}.",
        f"{BY_RUNS} {hint}".strip(),
        options,
    )


def check_not_drawn(step: np.ndarray, within: np.ndarray, known: float | None) -> None:
    """Refuse rows of which most are missing, in no order: their steps are many multiples of one."""
    if not within.any():
        return
    ratio = step[within] / (known or step[within].min())
    whole = np.rint(ratio)
    one = float(np.mean(whole == 1))
    irregular = np.unique(whole).size > 2 and one < SPARSE
    if irregular and (np.abs(ratio - whole) < JITTER_TOLERANCE).all():
        refuse_drawn(
            f"{1 - one:.0%} of the steps between them are longer than a sample, up to "
            f"{whole.max():.0f} samples",
            "If they were recorded so, put them on a grid: skhoid.resample_runs(X, y, dt=...).",
            ["resample"],
        )


def check_pieces(layout: RunLayout, lengths: np.ndarray, needed: int, dt: float) -> None:
    """Refuse runs that are torn, most of their rows into pieces of fewer rows than needed."""
    short = lengths < needed
    if len(lengths) > len(layout.labels) and 2 * lengths[short].sum() > lengths.sum():
        refuse_drawn(
            f"gaps leave {len(lengths)} pieces, of which {short.sum()} are shorter than the "
            f"{needed} rows ({needed * dt:.3g} s) that the model needs to forget how each begins",
            "If the recording has such gaps, bridge them: skhoid.resample_runs(X, y, dt=...).",
            ["resample"],
        )


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
        if not 0 < dt < np.inf:
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
        if 4 * change.size > codes.size:
            refuse_drawn(f"runs take turns in {change.size} places, first at row {change[0]}", SORT)
        back = change[np.flatnonzero(codes[change] < codes[change - 1])[0]]
        label = labels[codes[back]]
        raise RunIndexError(
            f"The rows of run {label!r} are not contiguous: they continue at row {back}, after "
            f"rows of run {labels[codes[back - 1]]!r}. Sort the table by run and time (X = "
            "X.sort_index(), y likewise), or give each run its own label."
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
    check_not_drawn(step, within, dt or fallback_dt)
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
    if backwards.size > 0.1 * step.size and backwards.size > 1:
        refuse_drawn(
            f"the row index goes backwards in {backwards.size} places, first from "
            f"{sample[backwards[0]]} to {sample[backwards[0] + 1]} at row {backwards[0] + 1}",
            "If the index means nothing, call X.reset_index(drop=True).",
        )
    if backwards.size:
        row = int(backwards[0]) + 1
        raise RunIndexError(
            f"The rows hold several runs, or are in another order: the row index goes from "
            f"{sample[row - 1]} to {sample[row]} at row {row}. Rows must be in time order.",
            hint="Label runs with an index of levels 'run' and 'time', or with a run column and "
            "run=; if the index means nothing, call X.reset_index(drop=True).",
            options=["run"],
        )
    if within.any() and np.median(step[within]) == 1:
        first = np.repeat(sample[run_starts[:-1]], np.diff(run_starts))
        return _cut(run_starts, within & (step > 1)), sample - first
    check_not_drawn(step, within, None)
    return run_starts, number


def whole_samples(duration: float, dt: float) -> float:
    """Duration in samples, snapped to a whole number when within 1e-6 of one."""
    samples = duration / dt
    nearest = round(samples)
    return float(nearest) if abs(samples - nearest) <= WHOLE * max(1.0, abs(nearest)) else samples


def snap(dt: float) -> float:
    """Sampling time without rounding noise: one over a whole rate, or nine digits."""
    rate = round(1.0 / dt) if dt < 1.0 else 0
    if rate and abs(1.0 / dt - rate) < 1e-6 * rate:
        return 1.0 / rate
    return float(f"{dt:.9g}")


def time_in_seconds(time: pd.Index) -> np.ndarray:
    """Values of a time index, checked to be finite numbers."""
    if time.dtype.kind in "mM":
        refuse_datetime(time)
    if time.dtype.kind not in "iuf":
        raise RunIndexError(f"The time index must be numbers in seconds; it holds {time.dtype}.")
    seconds = time.to_numpy(dtype=float)
    if not np.all(np.isfinite(seconds)):
        row = int(np.flatnonzero(~np.isfinite(seconds))[0])
        raise RunIndexError(f"The time index is {seconds[row]} in row {row}; it must be finite.")
    return seconds


def refuse_datetime(time: pd.Index) -> None:
    raise RunIndexError(
        f"The time index holds {time.dtype}; skhoid counts time in seconds from the start of the "
        "run. Convert it with (t - t[0]).total_seconds()."
    )


def check_increasing(
    time: np.ndarray,
    step: np.ndarray,
    within: np.ndarray,
    run_starts: np.ndarray,
    labels: list[Any],
) -> None:
    """Refuse time that repeats or goes backwards within a run."""
    bad = np.flatnonzero(within & (step <= 0))
    if bad.size == 0:
        return
    many = bad.size > 0.1 * step.size and bad.size > 1
    repeated = bad[step[bad] == 0]
    repeats = many and 2 * repeated.size > bad.size
    if many:
        bad = repeated if repeats else bad[step[bad] < 0]
    row = int(bad[0]) + 1
    label = labels[int(np.searchsorted(run_starts, row, side="right")) - 1]
    where = f"run {label!r}, row {row}: {time[row - 1]:.6g} s is followed by {time[row]:.6g} s"
    if repeats:
        raise RunIndexError(
            f"Time repeats in {bad.size} places, first in {where}. The usual causes are two runs "
            "or two channels in one table, or times written with too few digits: give each run "
            "its own label in the 'run' level, each channel a column, and the time all its digits."
        )
    if many:
        refuse_drawn(
            f"time goes backwards in {bad.size} places, first in {where}",
            SORT,
        )
    what = "repeats" if time[row] == time[row - 1] else "decreases"
    raise RunIndexError(
        f"Time {what} in {where}. If a new run begins there, give it its own label in the 'run' "
        "level; otherwise sort the rows by time and drop repeated ones."
    )


def typical_step(step: np.ndarray, run_starts: np.ndarray, labels: list[Any]) -> float | None:
    medians = [
        (float(np.median(step[a : b - 1])), label)
        for a, b, label in zip(run_starts[:-1], run_starts[1:], labels, strict=True)
        if b - a > 1
    ]
    if not medians:
        return None
    first, label = medians[0]
    for median, other in medians[1:]:
        if abs(median - first) > JITTER_TOLERANCE * first and min(median, first) > 0:
            raise IrregularSamplingError(
                f"The runs differ in sampling time: {first:.6g} s in run {label!r}, {median:.6g} "
                f"s in run {other!r}.",
                hint="Put them on one grid: X, y = skhoid.resample_runs(X, y, "
                f"dt={max(first, median):.6g}).",
                options=["resample", "dt"],
            )
    return first


def run_index(labels: list[Any], lengths: np.ndarray, time: np.ndarray) -> pd.MultiIndex:
    """The row index of runs that follow one another, with the levels ``run`` and ``time`` (s)."""
    runs = pd.Index(labels, tupleize_cols=False).take(np.repeat(np.arange(len(labels)), lengths))
    return pd.MultiIndex.from_arrays([runs, time], names=[RUN, TIME])


def run_time_index(layout: RunLayout) -> pd.MultiIndex:
    """The row index that says what ``layout`` says."""
    return run_index(layout.labels, np.diff(layout.run_starts), layout.time)


def empty_runs(layout: RunLayout, values: np.ndarray, columns: list[int]) -> dict[int, int]:
    """The first of the columns that is NaN in all rows of a run outside the run-in, by run."""
    last = layout.run_starts[1:] - 1
    missing = np.isnan(values[last][:, columns])
    if layout.trimmed is not None:
        missing |= layout.trimmed[last, None]
    found = {}
    for run in np.flatnonzero(missing.any(axis=1)):
        rows = slice(*layout.run_starts[run : run + 2])
        outside = ... if layout.trimmed is None else ~layout.trimmed[rows]
        for column in np.asarray(columns)[missing[run]]:
            part = values[rows, column][outside]
            if part.size and np.isnan(part).all():
                found[int(run)] = int(column)
                break
    return found


def rows_of_runs(layout: RunLayout, runs: Collection[int]) -> np.ndarray:
    """Mask of the rows of some runs, by their numbers."""
    chosen = np.zeros(len(layout.labels), dtype=bool)
    chosen[list(runs)] = True
    return np.repeat(chosen, np.diff(layout.run_starts))


SET_OUTPUT_HINT = (
    "A scikit-learn transformer that returns NumPy arrays drops the row index; call "
    '.set_output(transform="pandas") on the pipeline to keep it, and use Decimator, DelayShift and '
    "RunInTrimmer as steps of the pipeline itself, not in one branch of a ColumnTransformer."
)


def check_alignment(X: Any, y: Any, names: tuple[str, str] = ("X", "y")) -> None:
    """Refuse ``y`` whose row index disagrees with that of ``X``."""
    x_name, y_name = names
    y_index = getattr(y, "index", None)
    if not isinstance(y_index, pd.Index):
        return
    x_index = getattr(X, "index", None)
    if not isinstance(x_index, pd.Index):
        x_index = None
    y_has_runs = TIME in y_index.names
    if x_index is None or TIME not in x_index.names:
        if y_has_runs:
            raise RunIndexError(
                f"{y_name} has a run and time index but {x_name} has none, so the runs of {x_name} "
                "are lost. " + SET_OUTPUT_HINT
            )
        if x_index is None:
            return
    elif y_index.nlevels == 1 and y_index.dtype.kind in "iu" and y_index.is_monotonic_increasing:
        return  # row numbers, as slices of a plain Series keep them
    if x_index is y_index:
        return
    plain, y_index = _without_marks(x_index), _without_marks(y_index)
    if len(plain) != len(y_index) or plain.equals(y_index):
        return  # unequal lengths are reported by scikit-learn
    if plain.nlevels != y_index.nlevels:
        detail = (
            f"the levels are {list(plain.names)} in {x_name} and {list(y_index.names)} in {y_name}"
        )
    else:
        row = int(np.flatnonzero([a != b for a, b in zip(plain, y_index, strict=True)])[0])
        labels = [_plain_label(index[row]) for index in (plain, y_index)]
        detail = (
            f"the first difference is in row {row}: {labels[0]} in {x_name}, "
            f"{labels[1]} in {y_name}"
        )
    raise RunIndexError(
        f"The row indexes of {x_name} and {y_name} disagree; {detail}. Give both the same rows in "
        f"the same order ({y_name} = {y_name}.loc[{x_name}.index]), or pass {y_name} as an array "
        "if its index means nothing."
    )


def _without_marks(index: pd.Index) -> pd.Index:
    marks = [name for name in index.names if is_mark(str(name))]
    return index.droplevel(marks) if marks else index


def _plain_label(label: Any) -> Any:
    parts = label if isinstance(label, tuple) else (label,)
    return tuple(part.item() if isinstance(part, np.generic) else part for part in parts)
