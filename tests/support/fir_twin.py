"""Regularised recursive least squares, as plainly as it can be written."""

import numpy as np


def regressors(X, begin, end, lags):
    """Rows [x_j(t - lag) ...] of a stretch, and their row numbers; lags by input."""
    first = max(max(of_input) for of_input in lags)
    rows = np.arange(begin + first, end)
    columns = [X[rows - lag, j] for j, of_input in enumerate(lags) for lag in of_input]
    return np.stack(columns, axis=1), rows


def information(phi, u, weights):
    """R, s and the sum of the weights of rows that are given at once."""
    return (phi.T * weights) @ phi, (phi.T * weights) @ u, weights.sum()


def deltas(R, total, owner, prior, ridge):
    """δ of each parameter, ridge trace(prior R) / w of its input."""
    out = np.zeros(len(owner))
    for j in set(owner) - {-1}:
        own = np.flatnonzero(owner == j)
        block = np.ix_(own, own)
        out[own] = ridge * np.trace(prior[block] @ R[block]) / total
    return out
