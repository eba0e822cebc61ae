"""Runs as a user names them: labels for cross-validation, selection, sampling time."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_consistent_length

from .._sklearn import COUNT, DT, checked
from ..exceptions import PooledRunsWarning, RunIndexError
from .layout import check_alignment, check_levels, read_layout, run_name
from .roles import RUN, TIME
from .tables import is_mark


@checked(level=[str, None])
def run_labels(X: Any, *, level: str | None = None, run: Any = None) -> np.ndarray:
    """Return the run label of each row, to use as ``groups`` in cross-validation.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_columns) or array
        Data with ``run`` and ``time`` in the row index, or with a run column.
    level : str or None, default=None
        Index level to read, such as ``"subject"``, to leave out whole subjects. None means the run
        itself; with outer levels the labels are joined, ``"S1/C3/2"``, because run 2 of one subject
        is not run 2 of another.
    run : column name or position, or None, default=None
        Run column of a table without a run index.

    Returns
    -------
    labels : ndarray of shape (n_rows,)

    Examples
    --------
    >>> from skhoid import load_human_tracking, run_labels
    >>> X, y = load_human_tracking([0, 1])
    >>> sorted(set(run_labels(X).tolist()))
    ['difficulty 50', 'difficulty 80']
    """
    if level is not None:
        index = getattr(X, "index", None)
        if index is None or level not in index.names:
            found = list(index.names) if isinstance(index, pd.Index) else None
            raise RunIndexError(f"X has no index level {level!r}; its levels are {found}.")
        check_levels(index)
        return index.get_level_values(level).to_numpy()
    layout = read_layout(X, run=run)
    labels = layout.labels
    if labels and isinstance(labels[0], tuple):
        labels = [run_name(label) for label in labels]
        if len(set(labels)) < len(labels):
            labels = [repr(label) for label in layout.labels]
    return np.repeat(np.asarray(labels), np.diff(layout.run_starts))


@checked(dt=DT)
def sampling_time(X: Any, *, dt: float | None = None, run: Any = None) -> float:
    """Return the sampling time of recorded runs in seconds, after checking it.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_columns) or array
        Data with ``run`` and ``time`` in the row index.
    dt : float or None, default=None
        Sampling time in seconds, for data without a time index.
    run : column name or position, or None, default=None
        Run column of a table without a run index.

    Returns
    -------
    dt : float
        Sampling time in seconds.

    Raises
    ------
    IrregularSamplingError
        If a step deviates by more than 10 % from the others and is not a gap.

    Examples
    --------
    >>> from skhoid import load_bicycle_rider, sampling_time
    >>> X, y = load_bicycle_rider()
    >>> sampling_time(X)
    0.005
    """
    return read_layout(X, dt=dt, run=run).dt


def warn_of_pooled(X: Any) -> None:
    """Warn that runs of several subjects, or conditions, are taken for one operator's."""
    index = getattr(X, "index", None)
    if not isinstance(index, pd.MultiIndex):
        return
    for name in index.names:
        if name in (RUN, TIME) or is_mark(str(name)):
            continue
        values = index.get_level_values(name).unique()
        if len(values) < 2:
            continue
        warnings.warn(
            PooledRunsWarning(
                f"Runs of {len(values)} {name}s are fitted as those of one: "
                f"{', '.join(map(str, values[:3]))}{', ...' if len(values) > 3 else ''}.",
                hint=f'Fit each separately: for name, part in X.groupby(level="{name}"), with '
                "y.loc[part.index]; or use analyse_experiment. If you want one model for all, give "
                f"each run its own label and drop the level {name!r} from the index.",
                options=[(str(name), str(values[0]))],
            ),
            stacklevel=4,
        )


@checked(first=COUNT, last=COUNT)
def select_runs(
    X: pd.DataFrame,
    y: Any = None,
    *,
    runs: Any = None,
    first: int | None = None,
    last: int | None = None,
) -> Any:
    """Return the rows of some runs, by label or by their position in the session.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_columns)
        Data with levels ``run`` and ``time``, and possibly outer levels, in the row index.
    y : Series, DataFrame, array or None, default=None
        Output with the same rows.
    runs : label, list of labels or None, default=None
        Labels of the level ``run`` to keep.
    first, last : int or None, default=None
        Keep this many runs, the first or the last, within each combination of outer levels
        (subject, condition). The thesis keeps the last five of seven.

    Returns
    -------
    X_selected : DataFrame
    y_selected : same type as y
        Only if ``y`` is given.

    Examples
    --------
    >>> from skhoid import load_human_tracking, run_labels, select_runs
    >>> X, y = load_human_tracking("all")
    >>> X_last, y_last = select_runs(X, y, last=2)
    >>> len(set(run_labels(X_last)))
    2
    """
    if sum(choice is not None for choice in (runs, first, last)) != 1:
        raise ValueError("Give exactly one of runs=, first= and last=.")
    layout = read_layout(X)
    if not isinstance(getattr(X, "index", None), pd.MultiIndex):
        raise RunIndexError("select_runs needs the index levels 'run' and 'time'.")
    firsts = X.index[layout.run_starts[:-1]].to_frame(index=False)
    inner = firsts["run"].tolist()
    others = firsts.drop(columns=["run", "time"])
    outer = list(map(tuple, others.to_numpy(dtype=object)))  # itertuples drops rows without columns
    keep = np.zeros(len(inner), dtype=bool)
    if runs is not None:
        wanted = [runs] if np.ndim(runs) == 0 else list(runs)
        unknown = [w for w in wanted if w not in inner]
        if unknown:
            raise ValueError(f"There is no run {unknown[0]!r}; the runs are {sorted(set(inner))}.")
        keep[:] = [label in wanted for label in inner]
    else:
        for group in set(outer):
            members = [i for i, o in enumerate(outer) if o == group]
            keep[members[:first] if first is not None else members[-last:]] = True  # type: ignore
    rows = np.repeat(keep, np.diff(layout.run_starts))
    check_alignment(X, y)
    if y is None:
        return X[rows]
    output = y if hasattr(y, "shape") else np.asarray(y)
    check_consistent_length(X, output)
    return X[rows], output[rows]
