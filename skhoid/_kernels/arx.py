"""Simulation and prediction of ARX models, sample by sample.

Common arguments: ``begin``, ``end`` and ``past`` give, for each stretch of rows, where the output
starts from its initial values, where it ends, and the first row whose inputs are known. Row t has
the parameters ``theta[at[t]]``: ``na`` output coefficients, ``nb[j]`` of each input, and a constant
if they have one more.
"""

from __future__ import annotations

import numpy as np

from .kernel import kernel


@kernel(
    "f8[:,::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[::1], i8, i8[::1], i8[::1], "
    "f8[:,::1], f8, b1",
    1,
)
def free_run(X, begin, end, past, theta, at, na, nb, nk, y0, bound, held):
    """Simulate Eq. 6 without noise from the inputs alone.

    ``y0[s, i]`` is the output ``i + 1`` samples before stretch ``s``. Inputs before the first known
    row are zero, or ``held``: as in that row. The output is held within ``+-bound``, so that an
    unstable model stays finite.
    """
    out = np.zeros(X.shape[0])
    constant = na + nb.sum()
    for s in range(begin.size):
        first = begin[s]
        for t in range(first, end[s]):
            now = at[t]
            value = theta[now, constant] if constant < theta.shape[1] else 0.0
            entry = na
            for j in range(nb.size):
                for k in range(nb[j]):
                    row = t - nk[j] - k
                    if row >= past[s] or held:
                        value += theta[now, entry] * X[max(row, past[s]), j]
                    entry += 1
            for i in range(na):
                row = t - 1 - i
                if row >= first:
                    value -= theta[now, i] * out[row]
                else:
                    value -= theta[now, i] * y0[s, first - 1 - row]
            out[t] = min(max(value, -bound), bound)
    return out


@kernel("f8[:,::1], i8, f8[:,::1], f8[:,:,::1], i8[:,::1], f8[::1], f8, f8[:,::1]", 1)
def free_runs(X, first, a, b, lags, constant, bound, out):
    """Simulate one stretch from rest by many models side by side, as ``free_run`` does.

    Row t of ``out``, with a model in each column, follows from ``X[j, first + t - lag]``: the
    inputs in rows, behind as many zeros as the models look back. Coefficients are ``a[i, model]``
    and ``b[j, k, model]``, zero where a model has fewer than others.
    """
    n_models = out.shape[1]
    for t in range(out.shape[0]):
        row = out[t]
        for m in range(n_models):
            row[m] = constant[m]
        for j in range(b.shape[0]):
            for k in range(b.shape[1]):
                at = first + t - k
                for m in range(n_models):
                    row[m] += b[j, k, m] * X[j, at - lags[j, m]]
        for i in range(min(a.shape[0], t)):
            before = out[t - 1 - i]
            for m in range(n_models):
                row[m] -= a[i, m] * before[m]
        for m in range(n_models):
            row[m] = min(max(row[m], -bound), bound)


@kernel(
    "f8[::1], f8[:,::1], i8, i8[::1], i8[::1], i8[::1], f8[:,::1], i8[::1], i8, i8[::1], "
    "i8[::1], i8, f8, f8[::1]",
    1,
)
def predict_ahead(known, X, low, begin, end, past, theta, at, na, nb, nk, horizon, bound, out):
    """Predict each row from outputs measured ``horizon`` samples before it, and from all inputs.

    Outputs and inputs before ``past`` are zero. A missing output is replaced by its one-step
    prediction in ``known``. ``X`` and ``at`` are those from row ``low`` on.
    """
    free = np.zeros(horizon)
    constant = na + nb.sum()
    for s in range(begin.size):
        first = past[s]
        for t in range(begin[s], end[s]):
            now = at[t - low]
            start = max(first, t - horizon + 1)
            # A missing output needs its own one-step prediction, before the longer one.
            twice = start < t and np.isnan(known[t])
            one_step = 0.0
            for pass_ in range(2 if twice else 1):
                origin = t if twice and pass_ == 0 else start
                for r in range(origin, t + 1):
                    value = theta[now, constant] if constant < theta.shape[1] else 0.0
                    entry = na
                    for j in range(nb.size):
                        for k in range(nb[j]):
                            row = r - nk[j] - k
                            if row >= first:
                                value += theta[now, entry] * X[row - low, j]
                            entry += 1
                    for i in range(na):
                        row = r - 1 - i
                        if row >= origin:
                            value -= theta[now, i] * free[row - origin]
                        elif row >= first:
                            value -= theta[now, i] * known[row]
                    free[r - origin] = min(max(value, -bound), bound)
                if pass_ == 0:
                    one_step = free[0]
            out[t] = free[t - start]
            if np.isnan(known[t]):
                known[t] = one_step
