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
