"""resample_runs: regular time grids for recordings with an irregular clock."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from sklearn.utils.validation import check_consistent_length

from .._machine import check_memory
from .._sklearn import DT, checked
from ..exceptions import IrregularSamplingError, RunIndexError
from ..runs import (
    TIME,
    WHOLE,
    check_alignment,
    check_increasing,
    check_levels,
    contiguous_runs,
    refuse_flat,
    snap,
    time_in_seconds,
    within_runs,
)
from .gate import as_output, check_numbers

LONGEST_BRIDGE = 3.0  # median steps; late samples of a jittery clock are no gap


@checked(dt=DT)
def resample_runs(X: pd.DataFrame, y: Any = None, *, dt: float | None = None) -> Any:
    """Bring recorded runs onto a regular time grid by cubic interpolation.

    skhoid never does this on its own: lags in samples need a regular clock, and an irregular one
    raises an error that names this function.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_columns)
        Data with ``run`` and ``time`` (s) in the row index; time must increase within runs.
    y : Series, DataFrame, array of shape (n_rows,) or None, default=None
        Output with the same rows.
    dt : float or None, default=None
        Sampling time of the new grid in seconds; None takes the median step. Do not choose it
        longer than the old one: nothing is filtered, so coarser grids alias (thin with
        :class:`skhoid.Decimator` instead).

    Returns
    -------
    X_regular : DataFrame
        Rows at the first instant of each segment plus multiples of ``dt``. A step longer than three
        median steps remains a gap; rows with NaN neighbours are NaN.
    y_regular : Series or DataFrame
        Only if ``y`` is given.

    Examples
    --------
    >>> from skhoid import load_human_tracking, resample_runs, sampling_time
    >>> X, y = load_human_tracking(0, resample=False)
    >>> X, y = resample_runs(X, y, dt=1 / 60)
    >>> round(1 / sampling_time(X))
    60
    """
    check_alignment(X, y)
    index = X.index if isinstance(X, pd.DataFrame) else pd.RangeIndex(0)
    if TIME not in index.names:
        refuse_flat(X, dt=None, run=None)
        raise RunIndexError("resample_runs needs the index levels 'run' and 'time'.")
    check_levels(index)
    time = time_in_seconds(index.get_level_values(TIME))
    others = [name for name in index.names if name != TIME]
    check_numbers(X, "X")
    values = X.to_numpy(dtype=float)
    if y is not None:
        output = as_output(y)
        check_consistent_length(X, output)
        values = np.column_stack([values, output])
    if others:
        codes, labels = pd.factorize(index.droplevel(TIME))
        if (codes < 0).any():
            row = int(np.flatnonzero(codes < 0)[0])
            raise RunIndexError(f"Row {row} has no label in the index level {others[0]!r} (NaN).")
        run_starts = contiguous_runs(codes, list(labels))
    else:
        labels, run_starts = [0], np.array([0, len(index)])
    step, within = np.diff(time), within_runs(run_starts)
    check_increasing(time, step, within, run_starts, list(labels))
    typical = np.full(len(labels), np.nan)
    for run, (a, b) in enumerate(pairwise(run_starts)):
        if b - a > 1:
            typical[run] = np.median(step[a : b - 1])
    if np.isnan(typical).all():
        raise IrregularSamplingError("resample_runs needs runs of at least two rows.")
    grid_step = float(dt) if dt is not None else snap(float(np.nanmedian(typical)))
    longest = LONGEST_BRIDGE * np.repeat(typical, np.diff(run_starts))[1:]
    starts = np.union1d(run_starts, np.flatnonzero(within & (step > longest)) + 1)
    n_rows = float((time[starts[1:] - 1] - time[starts[:-1]]).sum()) / grid_step
    check_memory(2 * n_rows * values.shape[1], f"A grid of dt = {grid_step:g} s")
    pieces: list[np.ndarray] = []
    times: list[np.ndarray] = []
    origin: list[np.ndarray] = []
    for a, b in pairwise(starts):
        span = time[b - 1] - time[a]
        grid = time[a] + grid_step * np.arange(int(np.floor(span / grid_step + WHOLE)) + 1)
        pieces.append(_interpolate(time[a:b], values[a:b], grid))
        times.append(grid)
        origin.append(np.full(grid.size, a))
    rows = np.concatenate(origin)
    levels = [index.get_level_values(name).take(rows) for name in others]
    arrays = dict(zip(others, levels, strict=True)) | {TIME: np.concatenate(times)}
    new_index = (
        pd.MultiIndex.from_arrays([arrays[n] for n in index.names], names=index.names)
        if others
        else pd.Index(arrays[TIME], name=TIME)
    )
    result = np.vstack(pieces)
    n_channels = X.shape[1]
    X_new = pd.DataFrame(result[:, :n_channels], index=new_index, columns=X.columns)
    X_new.attrs = dict(X.attrs)
    if y is None:
        return X_new
    rest = result[:, n_channels:]
    y_new: Any
    if isinstance(y, pd.DataFrame):
        y_new = pd.DataFrame(rest, index=new_index, columns=y.columns)
    else:
        y_new = pd.Series(rest[:, 0], index=new_index, name=getattr(y, "name", None))
    y_new.attrs = dict(getattr(y, "attrs", {}))
    return X_new, y_new


def _interpolate(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    result = np.full((grid.size, values.shape[1]), np.nan)
    right = np.clip(np.searchsorted(time, grid, side="left"), 0, time.size - 1)
    slack = WHOLE * (grid[-1] - grid[0]) / max(grid.size - 1, 1)
    left = np.where(np.abs(time[right] - grid) <= slack, right, np.maximum(right - 1, 0))
    for column in range(values.shape[1]):
        known = np.isfinite(values[:, column])
        if not known.any():
            continue
        degree = 3 if known.sum() > 3 else 1
        if known.sum() == 1:
            result[:, column] = values[known, column]
        else:
            spline = make_interp_spline(time[known], values[known, column], k=degree)
            result[:, column] = spline(grid)
        result[~(known[left] & known[right]), column] = np.nan
    return result
