"""The time of rows: seconds that increase, the sampling time, durations in samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError, RunIndexError

RUN, TIME = "run", "time"  # levels of the row index
JITTER_TOLERANCE = 0.10  # of a sampling time; beyond it, lags in samples mean nothing
GAP = 1.5  # steps longer than this many sampling times start a new segment
WHOLE = 1e-6  # a duration within this many samples of a whole number is that number


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
        raise RunIndexError(
            f"The rows are shuffled: time goes backwards in {bad.size} places, first in {where}. "
            "Sort the table (X = X.sort_index(), y likewise). For cross-validation split by runs, "
            "not by rows: LeaveOneGroupOut or GroupKFold with groups=run_labels(X)."
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
                f"dt={max(first, median):.6g}). If rows are missing because a split shuffled "
                "them, split by runs instead: LeaveOneGroupOut with groups=run_labels(X).",
                options=["resample", "dt"],
            )
    return first
