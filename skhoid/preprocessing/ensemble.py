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
    number = layout.sample_numbers()
    outer = [index.get_level_values(name) for name in index.names if name not in (RUN, TIME)]
    people = outer or [np.zeros(len(X), dtype=int)]
    instants = table.groupby([*people, number], sort=False)
    n_runs = pd.Series(layout.run_of(np.arange(len(X)))).groupby(people).transform("nunique")
    common = instants[""].transform("size").to_numpy() == n_runs.to_numpy()
    if not pd.Series(common).groupby(people).any().all():
        raise RunIndexError(
            f"The runs {list(layout.labels)} have no instant in common; count their times from the "
            "start of the forcing function."
        )
    if "f_t" in X.columns:
        apart = (X["f_t"] - instants["f_t"].transform("mean")).abs()[common].max()
        if apart > SAME * X["f_t"].abs().max():
            raise ValueError(
                "The runs have different targets f_t; only runs that share the forcing function "
                "can be averaged."
            )
    first = common & (instants.cumcount().to_numpy() == 0)
    averaged = instants.transform("mean")[first]
    levels = {name: index.get_level_values(name)[first] for name in index.names}
    levels |= {RUN: np.full(first.sum(), MEAN), TIME: number[first] * layout.dt}
    averaged.index = pd.MultiIndex.from_arrays(list(levels.values()), names=index.names)
    averaged.attrs = dict(X.attrs)
    return averaged.drop(columns=""), averaged[""].rename(getattr(y, "name", None))
