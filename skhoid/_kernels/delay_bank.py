"""Probabilities of the delays of a bank of recursive models, and their most probable path.

Lanes stand in blocks: arrays have the shapes of :func:`~skhoid._kernels.rls.recursion`, with one
axis more before, over blocks. The signals of each lane are those that its own delay gives.
"""

from __future__ import annotations

import numpy as np

from .kernel import kernel

SETTLED = 30  # errors, before the variance of the errors counts as known
EXACT = 1e-12  # of the power of the output: errors below it are rounding
LARGEST = 1e100  # of predictions, whose square still sums without overflow
COUNT, VARIANCE, POWER = 0, 1, 2  # moments


@kernel(
    "f8[:,::1], f8[::1], i8[:,::1], f8[:,:,:,:,::1], f8[:,:,:,::1], i8[:,::1], i8, i8, "
    "i8[::1], i8[::1], i8",
    1,
)
def fill(X, y, shifts, Z, target, since, first, begin, columns, lags, na):
    """Write rows of a stream into the signals of a bank, from row ``begin`` on.

    Inputs are written ahead, to where the ``shifts`` of the lanes, of shape (n_blocks, lanes),
    delay them. ``since`` counts the rows known without a break up to each row; those up to number
    ``first`` give no update, nor does a row whose inputs are NaN in any lane: its target is NaN.
    """
    n_blocks, lanes = shifts.shape
    for i in range(y.size):
        t = begin + i
        since[t, 0] = since[t - 1, 0] + 1
        for b in range(n_blocks):
            for j in range(lanes):
                Z[b, 0, t, 0, j] = -y[i]
                for c in range(X.shape[1]):
                    Z[b, c + 1, t + shifts[b, j], 0, j] = X[i, c]
        usable = since[t, 0] > first
        if usable:
            for b in range(n_blocks):
                for k in range(na, lags.size):
                    for j in range(lanes):
                        value = Z[b, columns[k], t - lags[k], 0, j]
                        usable = usable and value == value
        for b in range(n_blocks):
            for j in range(lanes):
                target[b, t, 0, j] = y[i] if usable else np.nan


@kernel(
    "f8[:,:,:,:,::1], f8[:,:,:,::1], f8[:,:,:,::1], i8[:,::1], i8[::1], i8[::1], i8, i8, i8, "
    "i8, i8, i8, f8, f8, f8, f8[::1], f8[::1], f8[:,::1], f8[:,::1]",
    2,
)
def follow(
    Z, target, theta, since, columns, lags, na, first, begin, end, horizon, n_delays, leave,
    power, memory, weights, moments, probabilities, fits,
):  # fmt: skip
    """Follow the probabilities of the delays over the instants from ``begin`` to ``end``.

    The errors are those ``horizon`` instants ahead, along theta of the instant before them; early
    in a stretch, of which ``since`` counts the rows, they are fewer. With their sum of squares
    over the runs,

        w_j ~ exp(-power sum(eps_j^2) / (2 variance)) sum_i pi_ij w_i,

    where pi leaves a delay for each of its neighbours with probability ``leave / 2``. The variance
    is the mean of w_j eps_j^2, of ``memory`` instants. ``weights`` and ``moments`` are the state;
    outputs are ``probabilities``, and the exponents ``fits`` unless of size 0.
    """
    n_blocks, lanes = Z.shape[0], Z.shape[4]
    n_runs, N = Z.shape[3], theta.shape[2]
    free = np.zeros((horizon, n_blocks, lanes))
    lost, squares = np.zeros(n_delays), np.zeros(n_delays)
    ahead = np.zeros(n_delays)
    value = np.zeros(lanes)
    for t in range(begin, end):
        for j in range(n_delays):
            left = weights[j - 1] if j > 0 else weights[j]
            right = weights[j + 1] if j < n_delays - 1 else weights[j]
            ahead[j] = (1.0 - leave) * weights[j] + 0.5 * leave * (left + right)
        for j in range(n_delays):
            weights[j], lost[j] = ahead[j], 0.0
        n_known, size = 0, 0.0
        for r in range(n_runs):
            y = target[0, t, r, 0]
            steps = min(horizon, since[t, r] - first)
            origin = t - steps
            if y != y or steps < 1 or origin < 0:
                continue
            known = True
            for b in range(n_blocks):
                for i in range(steps):
                    now = origin + 1 + i
                    for j in range(lanes):
                        value[j] = 0.0
                    for k in range(N):
                        row = now - lags[k]
                        if k < na and row > origin:
                            for j in range(lanes):
                                value[j] -= theta[b, origin, k, j] * free[row - origin - 1, b, j]
                        else:
                            for j in range(lanes):
                                value[j] += theta[b, origin, k, j] * Z[b, columns[k], row, r, j]
                    for j in range(lanes):
                        free[i, b, j] = min(max(value[j], -LARGEST), LARGEST)
            for j in range(n_delays):
                error = y - free[steps - 1, j // lanes, j % lanes]
                squares[j] = error * error
                known = known and (error == error)
            if known:
                n_known += 1
                size += y * y
                for j in range(n_delays):
                    lost[j] += squares[j]
        if n_known > 0:
            mean = 0.0
            for j in range(n_delays):
                mean += weights[j] * lost[j]
            moments[COUNT] = moments[COUNT] * (1.0 - 1.0 / memory) + 1.0
            gain = 1.0 / moments[COUNT]
            moments[VARIANCE] += (mean / n_known - moments[VARIANCE]) * gain
            moments[POWER] += (size / n_known - moments[POWER]) * gain
            variance = max(moments[VARIANCE], EXACT * moments[POWER])
            if moments[COUNT] > SETTLED and variance > 0.0:
                least = lost.min()
                total = 0.0
                for j in range(n_delays):
                    exponent = -0.5 * power * (lost[j] - least) / variance
                    if fits.size > 0:
                        fits[t, j] = exponent
                    weights[j] *= np.exp(exponent)
                    total += weights[j]
                for j in range(n_delays):
                    weights[j] = weights[j] / total if total > 0.0 else ahead[j]
        for j in range(n_delays):
            probabilities[t, j] = weights[j]


@kernel("f8[:,::1], f8", 1)
def most_probable(fits, leave):
    """Path of the highest posterior probability (Viterbi 1967), of shape (n_instants,).

    ``fits`` are log-likelihoods up to a number per instant; delays are left as in ``follow``. Of
    equal paths it is one that stays.
    """
    n_instants, n_delays = fits.shape
    before, now = np.zeros(n_delays), np.zeros(n_delays)
    came = np.zeros((n_instants, n_delays), dtype=np.int8)
    move = np.log(0.5 * leave)
    for t in range(n_instants):
        for j in range(n_delays):
            at_end = (j == 0) + (j == n_delays - 1)
            best, step = before[j] + np.log(1.0 - leave + 0.5 * leave * at_end), 0
            if j > 0 and before[j - 1] + move > best:
                best, step = before[j - 1] + move, -1
            if j < n_delays - 1 and before[j + 1] + move > best:
                best, step = before[j + 1] + move, 1
            now[j] = best + fits[t, j]
            came[t, j] = step
        best = now.max()
        for j in range(n_delays):
            before[j] = now[j] - best
    path = np.zeros(n_instants, dtype=np.int64)
    j = int(np.argmax(before))
    for t in range(n_instants - 1, -1, -1):
        path[t] = j
        j += came[t, j]
    return path
