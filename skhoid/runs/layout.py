"""Runs, time and marks: the one module that knows the data convention.

A recording is a table with one row per sample. Which run a row belongs to, and when it was
taken, travels in the row index of ``X`` (levels ``run`` and ``time``, in seconds; optional outer
levels such as ``subject`` and ``condition``) or, for arrays and plain frames, in a run column
(``run=``) and a sampling time (``dt=``). Everything else in skhoid asks :func:`read_layout`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError, RunIndexError

RUN, TIME = "run", "time"
RUN_IN_LEVEL = "run-in"
_RUN_COLUMN_LEVEL = "runs from column "  # and the name of a column that is no input
_DECIMATION_LEVEL = re.compile(r"^decimation 1/(\d+) (\S+) (\S+)$")

JITTER_TOLERANCE = 0.10  # of a sampling time; beyond it, lags in samples mean nothing
GAP = 1.5  # steps longer than this many sampling times start a new segment
WHOLE = 1e-6  # a duration within this many samples of a whole number is that number

SET_OUTPUT_HINT = (
    "A scikit-learn transformer that returns NumPy arrays drops the row index; call "
    '.set_output(transform="pandas") on the pipeline to keep it, and put Decimator, DelayShift and '
    "RunInTrimmer as steps of the pipeline itself, not in one branch of a ColumnTransformer."
)


@dataclass(frozen=True)
class DecimationMark:
    """What :class:`skhoid.Decimator` says about the rows it marks: factor, filter and its ends."""

    factor: int
    method: str
    padding: str

    @property
    def level(self) -> str:
        return f"decimation 1/{self.factor} {self.method} {self.padding}"


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
    """A run label in words; those of outer levels are joined, ``S1/C3/2``."""
    return "/".join(map(str, label)) if isinstance(label, tuple) else str(label)


def whole_samples(duration: float, dt: float) -> float:
    """Duration in samples, snapped to a whole number when within 1e-6 of one."""
    samples = duration / dt
    nearest = round(samples)
    return float(nearest) if abs(samples - nearest) <= WHOLE * max(1.0, abs(nearest)) else samples


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
        Sampling time when the index cannot tell it (runs of one row).

    Raises
    ------
    RunIndexError
        Runs not contiguous, time not increasing, index levels missing, time not in seconds.
    IrregularSamplingError
        Steps that deviate by more than 10 % from the sampling time and are not gaps.
    """
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is the sampling time in seconds and must be positive; got {dt!r}.")
    index = getattr(X, "index", None)
    if not isinstance(index, pd.Index):
        index = None
    if isinstance(index, pd.MultiIndex):
        return _layout_from_multiindex(index, dt, fallback_dt)
    if isinstance(index, (pd.DatetimeIndex, pd.TimedeltaIndex)):
        _refuse_datetime(index)
    n_rows = index.size if index is not None else np.asarray(X).shape[0]
    if index is not None and index.name != TIME and index.dtype.kind == "f":
        raise RunIndexError(
            "The row index of X holds numbers that are not whole and has no name. If they are "
            "seconds, say so (X.index.name = 'time'); if they mean nothing, call "
            "X.reset_index(drop=True)."
        )
    run_starts, labels = _runs_of_column(X, run, n_rows)
    if index is not None and index.name == TIME:
        time = time_in_seconds(index)
        return _layout_from_time(time, labels, run_starts, dt, fallback_dt, indexed=True)
    step = dt if dt is not None else (fallback_dt if fallback_dt is not None else 1.0)
    starts = run_starts
    number = np.arange(n_rows) - np.repeat(run_starts[:-1], np.diff(run_starts))
    if index is not None and not isinstance(index, pd.RangeIndex) and index.dtype.kind in "iu":
        starts, number = _cut_at_jumps(index.to_numpy(), run_starts, number)
    return RunLayout(labels, run_starts, starts, number * step, step)


def _position(names: list[Any], column: Any) -> int | None:
    """Position of a column given by its name, or by its position where all names are words."""
    if column in names:
        return names.index(column)
    whole = isinstance(column, (int, np.integer)) and not isinstance(column, bool)
    words = all(isinstance(name, str) for name in names) or names == list(range(len(names)))
    if whole and words and -len(names) <= column < len(names):
        return int(column) % len(names)
    return None


def run_column(names: list[Any], run: Any) -> int:
    """Position of the run column."""
    position = _position(names, run)
    if position is None:
        raise RunIndexError(
            f"run={run!r} names the column with the run labels (or, for an array, its position), "
            f"but X has the columns {names}."
        )
    return position


def _runs_of_column(X: Any, run: Any, n_rows: int) -> tuple[np.ndarray, list[Any]]:
    if run is None:
        return np.array([0, n_rows]), [0]
    if isinstance(X, pd.DataFrame):
        values = X.iloc[:, run_column(list(X.columns), run)].to_numpy()
    else:
        array = np.asarray(X)
        values = array[:, run_column(list(range(array.shape[1])), run)]
    codes, labels = pd.factorize(values)
    if np.any(codes < 0):
        row = int(np.flatnonzero(codes < 0)[0])
        raise RunIndexError(f"The run label in column {run!r} is missing in row {row}.")
    return contiguous_runs(codes, list(labels)), list(labels)


def within_runs(run_starts: np.ndarray) -> np.ndarray:
    """Steps between rows of one run, of all steps from a row to the next."""
    within = np.ones(max(int(run_starts[-1]) - 1, 0), dtype=bool)
    within[run_starts[1:-1] - 1] = False
    return within


def contiguous_runs(codes: np.ndarray, labels: list[Any]) -> np.ndarray:
    """Offsets of the runs, whose codes are numbered in order of appearance."""
    change = np.flatnonzero(codes[1:] != codes[:-1]) + 1
    if change.size + 1 > len(labels):
        back = change[np.flatnonzero(codes[change] < codes[change - 1])[0]]
        label = labels[codes[back]]
        raise RunIndexError(
            f"The rows of run {label!r} are not contiguous: they go on at row {back}, after rows "
            f"of run {labels[codes[back - 1]]!r}. Sort the table by run and time "
            "(X = X.sort_index(), y likewise), or give runs that share a label their own. "
            "Cross-validation must not shuffle rows: use LeaveOneGroupOut or GroupKFold with "
            "groups=run_labels(X)."
        )
    return np.concatenate(([0], change, [codes.size])) if codes.size else np.array([0, 0])


def _layout_from_multiindex(
    index: pd.MultiIndex, dt: float | None, fallback_dt: float | None
) -> RunLayout:
    names = list(index.names)
    if RUN not in names or TIME not in names:
        raise RunIndexError(
            f"The row index of X has the levels {names}; skhoid needs the levels 'run' and 'time' "
            "(in seconds), and optional outer ones such as 'subject'. Rename them with "
            "X.index = X.index.set_names([...]) or build the index with "
            "X.set_index(['run', 'time'])."
        )
    trimmed = kept = mark = run_column = None
    keys = []
    for position, name in enumerate(names):
        if name == RUN_IN_LEVEL:
            trimmed = index.get_level_values(position).to_numpy(dtype=bool)
        elif match := _DECIMATION_LEVEL.match(str(name)):
            kept = index.get_level_values(position).to_numpy(dtype=bool)
            mark = DecimationMark(int(match[1]), match[2], match[3])
        elif str(name).startswith(_RUN_COLUMN_LEVEL):
            run_column = str(name).removeprefix(_RUN_COLUMN_LEVEL)
        elif name != TIME:
            keys.append(position)
    codes = np.zeros(len(index), dtype=np.int64)
    for position in keys:
        level_codes = np.asarray(index.codes[position])
        if level_codes.size and level_codes.min() < 0:
            row = int(np.flatnonzero(level_codes < 0)[0])
            raise RunIndexError(
                f"Row {row} has no label in the index level {names[position]!r} (NaN)."
            )
        codes = codes * max(len(index.levels[position]), 1) + level_codes
    changes = np.flatnonzero(codes[1:] != codes[:-1]) + 1
    firsts = np.concatenate(([0], changes)) if codes.size else np.array([], dtype=np.int64)
    run_starts = np.append(firsts, codes.size)
    if len(keys) > 1 and firsts.size == codes.size > 1:
        raise RunIndexError(
            f"The index levels {[names[k] for k in keys]} together give every row a run of its "
            "own. Levels besides 'run' and 'time' name subjects or conditions; drop others with "
            "X.index = X.index.droplevel(...)."
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
        trimmed=trimmed,
        mark=mark,
        kept=kept,
        run_column=run_column,
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
            "The estimator thins marked rows itself; pass it all of them."
        )


def _refuse_datetime(time: pd.Index) -> None:
    raise RunIndexError(
        f"The time index holds {time.dtype}; skhoid counts time in seconds from the start of the "
        "run. Convert it with (t - t[0]).total_seconds()."
    )


def time_in_seconds(time: pd.Index) -> np.ndarray:
    """Values of a time index, checked to be finite numbers."""
    if time.dtype.kind in "mM":
        _refuse_datetime(time)
    if time.dtype.kind not in "iuf":
        raise RunIndexError(f"The time index must be numbers in seconds; it holds {time.dtype}.")
    seconds = time.to_numpy(dtype=float)
    if not np.all(np.isfinite(seconds)):
        row = int(np.flatnonzero(~np.isfinite(seconds))[0])
        raise RunIndexError(f"The time index is {seconds[row]} in row {row}; it must be finite.")
    return seconds


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
    typical = _typical_step(step, run_starts, labels)
    known = dt or fallback_dt
    few = within.sum() < 3
    if known is not None and (few or (np.abs(step[within] - known) <= 0.01 * known).any()):
        typical = known  # of few rows around a gap the median tells nothing
    if typical is None:
        typical = dt or fallback_dt
        if typical is None:
            raise IrregularSamplingError(
                "The sampling time cannot be read from the index: every run has one row. Give it "
                "as dt= (in seconds)."
            )
    regular = step[within & (step <= GAP * typical)]
    found = snap(float(regular.mean()) if regular.size else typical)
    if dt is None and found >= 2.0:
        raise RunIndexError(
            f"The time index advances by {found:g} a row: this looks like milliseconds or sample "
            "numbers, and skhoid counts seconds. Divide it by 1000 (read_runs does by units={'t': "
            "'ms'}), or multiply it by the sampling time (or read with dt= in place of time=); if "
            f"the sampling time really is {found:g} s, say so with dt={found:g}."
        )
    for given, whose in ((dt, "and dt="), (fallback_dt, "and the model was fitted at ")):
        if given is not None and abs(found - given) > 0.01 * given:
            raise IrregularSamplingError(
                f"Time advances by {found:g} s a row, {whose}{given:g} s. Use data of "
                f"one sampling time: skhoid.resample_runs(X, dt={given:g}) makes that grid."
            )
    found = dt or fallback_dt or found
    deviation = np.abs(regular - found) / found
    jitter = float(deviation.max()) if deviation.size else 0.0
    layout = RunLayout(
        labels,
        run_starts,
        _cut(run_starts, within & (step > GAP * typical)),
        time,
        found,
        jitter,
        **marks,
    )
    if jitter > JITTER_TOLERANCE:
        gapless = within & (step <= GAP * typical)
        row = int(np.argmax(np.where(gapless, np.abs(step - found), -1.0))) + 1
        raise IrregularSamplingError(
            f"Irregular sampling: {layout.where(row)} comes {step[row - 1]:.6g} s after the row "
            f"before it, and the sampling time is {snap(typical):.6g} s (largest deviation "
            f"{100 * jitter:.1f} %, rms {100 * np.sqrt(np.mean(deviation**2)):.2f} %; "
            f"{100 * JITTER_TOLERANCE:.0f} % is tolerated). Bring the runs onto a regular grid "
            f"with X, y = skhoid.resample_runs(X, y, dt={snap(typical):.6g})."
        )
    return layout


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
    row = int(bad[0]) + 1
    label = labels[int(np.searchsorted(run_starts, row, side="right")) - 1]
    where = f"run {label!r}, row {row}: {time[row - 1]:.6g} s is followed by {time[row]:.6g} s"
    if bad.size > 0.1 * step.size and bad.size > 1:
        raise RunIndexError(
            f"The rows are shuffled: time goes backwards in {bad.size} places, first in {where}. "
            "Sort the table (X = X.sort_index(), y likewise). For cross-validation split by runs, "
            "not by rows: LeaveOneGroupOut or GroupKFold with groups=run_labels(X)."
        )
    what = "repeats" if time[row] == time[row - 1] else "decreases"
    raise RunIndexError(
        f"Time {what} in {where}. If a new run begins there, give it a label of its own in the "
        "'run' level; otherwise sort the rows by time and drop repeated ones."
    )


def _typical_step(step: np.ndarray, run_starts: np.ndarray, labels: list[Any]) -> float | None:
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
                f"The runs differ in sampling time: {first:.6g} s in run {label!r}, {median:.6g} s "
                f"in run {other!r}. Bring them onto one grid: "
                f"X, y = skhoid.resample_runs(X, y, dt={max(first, median):.6g}). If rows are "
                "missing because a split shuffled them, split by runs instead: LeaveOneGroupOut "
                "with groups=run_labels(X)."
            )
    return first


def snap(dt: float) -> float:
    """Sampling time without rounding noise: one over a whole rate, or nine digits."""
    rate = round(1.0 / dt) if dt < 1.0 else 0
    if rate and abs(1.0 / dt - rate) < 1e-6 * rate:
        return 1.0 / rate
    return float(f"{dt:.9g}")


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
            f"{sample[row - 1]} to {sample[row]} at row {row}. Rows must be in time order; name "
            "runs with an index of levels 'run' and 'time', or with a run column and run=; "
            "if the index means nothing, call X.reset_index(drop=True)."
        )
    if step.size and np.median(step[within]) == 1:
        first = np.repeat(sample[run_starts[:-1]], np.diff(run_starts))
        return _cut(run_starts, within & (step > 1)), sample - first
    return run_starts, number


def check_alignment(X: Any, y: Any, names: tuple[str, str] = ("X", "y")) -> None:
    """Refuse ``y`` whose row index says something else than that of ``X``."""
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
    marks = [name for name in x_index.names if _is_mark(str(name))]
    plain = x_index.droplevel(marks) if marks else x_index
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


def _is_mark(level: str) -> bool:
    return (
        level == RUN_IN_LEVEL
        or level.startswith(_RUN_COLUMN_LEVEL)
        or _DECIMATION_LEVEL.match(level) is not None
    )


def _plain_label(label: Any) -> Any:
    parts = label if isinstance(label, tuple) else (label,)
    return tuple(part.item() if isinstance(part, np.generic) else part for part in parts)


def input_columns(
    columns: list[Any] | None,
    n_columns: int,
    inputs: Any,
    run: Any,
    roles: Any = None,
    what: str = "inputs",
) -> list[int]:
    """Positions of the linear inputs: ``inputs``, else the column of role ``e``, else all."""
    names: list[Any] = list(range(n_columns)) if columns is None else list(columns)
    unknown = [column for column in (roles or {}) if column not in names]
    if unknown:
        raise RunIndexError(
            f"roles names {unknown[0]!r}, which is not a column of X; the columns are {names}."
        )
    run_position = None if run is None else run_column(names, run)
    if inputs is not None:
        wanted = [inputs] if isinstance(inputs, (str, int, np.integer)) else list(inputs)
        if not wanted:
            raise ValueError(f"{what} is empty; name at least one column, or None for the default.")
        positions = []
        for column in wanted:
            position = _position(names, column)
            if position is None:
                raise ValueError(
                    f"{what} names {column!r}, which is not a column of X; the columns are {names}."
                )
            positions.append(position)
        if len(set(positions)) < len(positions):
            raise ValueError(f"{what} names a column twice: {wanted}.")
        return positions
    by_role = [i for i, name in enumerate(names) if (roles or {}).get(name, name) == "e"]
    if by_role:
        return by_role
    return [i for i in range(n_columns) if i != run_position]


def mark_run_in(frame: pd.DataFrame, trimmed: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the run-in rows marked in an extra index level."""
    return _with_level(frame, RUN_IN_LEVEL, trimmed)


def mark_decimated(frame: pd.DataFrame, mark: DecimationMark, kept: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the kept rows marked in an extra index level."""
    return _with_level(frame, mark.level, kept)


def mark_run_column(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return ``frame`` with the name of its run column in an extra index level."""
    return _with_level(frame, _RUN_COLUMN_LEVEL + column, np.zeros(len(frame)))


def _with_level(frame: pd.DataFrame, name: str, values: np.ndarray) -> pd.DataFrame:
    index = frame.index
    if not isinstance(index, pd.MultiIndex):
        raise TypeError("marks are carried by a run and time index")
    frame.index = pd.MultiIndex(
        levels=[*index.levels, [False, True]],
        codes=[*index.codes, values.astype(np.int8)],
        names=[*index.names, name],
        verify_integrity=False,
    )
    return frame


def run_time_index(layout: RunLayout) -> pd.MultiIndex:
    """The row index that says what ``layout`` says."""
    rows = np.arange(layout.n_rows)
    labels = pd.Index(layout.labels).take(layout.run_of(rows))
    return pd.MultiIndex.from_arrays([labels, layout.time], names=[RUN, TIME])
