"""Averages over runs, and channels about their means."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_consistent_length

from .._sklearn import checked
from ..exceptions import RunIndexError
from ..runs import RUN, TIME, check_alignment, read_layout
from .gate import as_output

MEAN = "mean"  # label of the averaged run
SAME = 1e-6  # of its largest value, within which a target is the same


@checked(y=["array-like"])
def ensemble_average(X: pd.DataFrame, y: Any) -> tuple[pd.DataFrame, pd.Series]:
    """Average runs that share the forcing function, instant by instant.

    The operator's response to the target remains, and remnant, which differs from run to run, falls
    with the square root of the number of runs: the averaged run can be identified with a shorter
    memory horizon. Differences between runs in the response are averaged too.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_columns)
        Channels, with ``run`` and ``time`` in the row index. With outer levels such as
        ``subject`` the runs of each combination of them are averaged.
    y : Series or array of shape (n_rows,)
        Output. Missing values in X or y are left out of the mean.

    Returns
    -------
    X_mean : DataFrame
        One run labelled ``"mean"`` for each combination of outer levels, over the instants that all
        its runs share.
    y_mean : Series
        The averaged output.

    Raises
    ------
    RunIndexError
        If X has no run and time index, or the runs have no instant in common.
    ValueError
        If the column ``f_t`` differs between the runs.

    See Also
    --------
    RecursiveARX : ``combine="average_estimates"`` averages estimates instead of signals.

    Examples
    --------
    >>> from skhoid import ensemble_average, make_tracking_runs
    >>> X, y = make_tracking_runs("C3", n_runs=5, remnant_intensity=0.2, random_state=0)
    >>> X_mean, y_mean = ensemble_average(X, y)
    >>> X_mean.shape
    (8192, 1)
    """
    layout = read_layout(X)
    index = getattr(X, "index", None)
    if not isinstance(index, pd.MultiIndex) or not {RUN, TIME} <= set(index.names):
        raise RunIndexError("ensemble_average needs the index levels 'run' and 'time' in X.")
    check_consistent_length(X, y)
    check_alignment(X, y)
    if layout.mark is not None or layout.trimmed is not None:
        raise RunIndexError(
            "ensemble_average needs recorded rows, not rows marked by a Decimator or a "
            "RunInTrimmer; average first and put these into the pipeline."
        )
    table = X.assign(**{"": as_output(y)})  # no channel has an empty name
    outer = [name for name in index.names if name not in (RUN, TIME)]
    starts = layout.run_starts
    number = layout.sample_numbers()
    frames = []
    keys = index.droplevel([RUN, TIME]) if outer else np.zeros(len(X), dtype=int)
    for key in pd.unique(keys[starts[:-1]]):
        runs = [r for r, first in enumerate(starts[:-1]) if keys[first] == key]
        rows = [slice(starts[r], starts[r + 1]) for r in runs]
        common = number[rows[0]]
        for of_run in rows[1:]:
            common = np.intersect1d(common, number[of_run])
        if common.size == 0:
            raise RunIndexError(
                f"The runs {[layout.labels[r] for r in runs]} have no instant in common; count "
                "their times from the start of the forcing function."
            )
        values = np.stack(
            [table.iloc[r].to_numpy(dtype=float)[np.isin(number[r], common)] for r in rows]
        )
        _check_target(X, values, [layout.labels[r] for r in runs])
        known = ~np.isnan(values)
        total = np.where(known, values, 0.0).sum(axis=0)
        count = known.sum(axis=0)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        labels = dict(zip(outer, key if isinstance(key, tuple) else (key,), strict=False))
        labels |= {RUN: MEAN, TIME: common * layout.dt}
        names = list(index.names)
        levels = [labels[n] if n == TIME else [labels[n]] * common.size for n in names]
        averaged_index = pd.MultiIndex.from_arrays(levels, names=names)
        frames.append(pd.DataFrame(mean, index=averaged_index, columns=table.columns))
    averaged = pd.concat(frames)
    averaged.attrs = dict(X.attrs)
    return averaged.drop(columns=""), averaged[""].rename(getattr(y, "name", None))


def _check_target(X: pd.DataFrame, values: np.ndarray, labels: list[Any]) -> None:
    if "f_t" not in X.columns:
        return
    target = values[:, :, list(X.columns).index("f_t")]
    apart = np.abs(target - target[0]).max(axis=1)
    if np.nanmax(apart) > SAME * np.nanmax(np.abs(target[0])):
        other = labels[int(np.nanargmax(apart))]
        raise ValueError(
            f"The runs {labels[0]!r} and {other!r} have different targets f_t; only runs that "
            "share the forcing function can be averaged."
        )
