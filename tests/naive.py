"""Slow, readable twins of the compiled loops and of the array code: one row at a time.

They share no code with the package. Runs are given as stretches ``(begin, end)`` of rows.
"""

import numpy as np


def regressor_rows(y, X, stretches, na, nb, nk, intercept=False):
    """Eq. 10 for every row whose lags are known: inside its own stretch, and none of them NaN.

    Returns the regression vectors, the outputs, the rows, and how many rows NaN cost.
    """
    phi, output, rows, n_missing = [], [], [], 0
    for begin, end in stretches:
        for t in range(begin, end):
            wanted = [(y, t - i, -1.0) for i in range(1, na + 1)]
            for j in range(X.shape[1]):
                wanted += [(X[:, j], t - nk[j] - k, 1.0) for k in range(nb[j])]
            if any(row < begin for _, row, _ in wanted):
                continue
            values = [sign * float(signal[row]) for signal, row, sign in wanted]
            if intercept:
                values.append(1.0)
            if np.isnan([*values, y[t]]).any():
                n_missing += 1
                continue
            phi.append(values)
            output.append(float(y[t]))
            rows.append(t)
    n_params = na + sum(nb) + intercept
    return np.array(phi).reshape(-1, n_params), np.array(output), np.array(rows, int), n_missing


def one_step(t, history, X, a, b, nk, intercept, first_input):
    """Eq. 6 in row t; ``history[i]`` is the output i + 1 rows before it."""
    value = intercept
    for j, coefficients in enumerate(b):
        for k, coefficient in enumerate(coefficients):
            row = t - nk[j] - k
            if row >= first_input:
                value += coefficient * X[row, j]
    for i, coefficient in enumerate(a):
        value -= coefficient * history[i]
    return value


def free_run(X, stretches, a, b, nk, intercept=0.0, past=None, y0=None, bound=1e100):
    """Simulate from the inputs alone; ``past[s]`` is the first row whose inputs are known."""
    out = np.zeros(len(X))
    for s, (begin, end) in enumerate(stretches):
        history = [0.0] * len(a) if y0 is None else [float(v) for v in y0[s][: len(a)]]
        first_input = begin if past is None else past[s]
        for t in range(begin, end):
            value = one_step(t, history, X, a, b, nk, intercept, first_input)
            out[t] = max(-bound, min(bound, value))
            history = [out[t], *history][: len(a)]
    return out


def predict_ahead(y, X, stretches, a, b, nk, intercept=0.0, horizon=1, bound=1e100):
    """Simulate each row afresh from what was measured up to ``horizon`` rows before it."""
    out = np.zeros(len(y))
    for begin, end in stretches:
        measured = {}
        for t in range(begin, end):
            last_known = t - horizon
            history = {row: measured[row] for row in range(begin, min(last_known, t - 1) + 1)}
            for row in range(max(begin, last_known + 1), t + 1):
                lags = [history.get(row - 1 - i, 0.0) for i in range(len(a))]
                value = one_step(row, lags, X, a, b, nk, intercept, begin)
                history[row] = max(-bound, min(bound, value))
            out[t] = history[t]
            if np.isnan(y[t]):
                lags = [measured.get(t - 1 - i, 0.0) for i in range(len(a))]
                value = one_step(t, lags, X, a, b, nk, intercept, begin)
                measured[t] = max(-bound, min(bound, value))
            else:
                measured[t] = float(y[t])
    return out


def one_step_losses(y, X, stretches, na, nb, candidates, intercept=False):
    """Mean squared one-step error (Eq. 24) of each ``nk``, on the rows that all of them know."""
    n_inputs = X.shape[1]
    common = None
    tables = []
    for nk in candidates:
        nks = [nk] * n_inputs if np.ndim(nk) == 0 else list(nk)
        tables.append(regressor_rows(y, X, stretches, na, [nb] * n_inputs, nks, intercept)[:3])
        rows = set(tables[-1][2].tolist())
        common = rows if common is None else common & rows
    losses = []
    for phi, output, rows in tables:
        kept = [i for i, row in enumerate(rows.tolist()) if row in common]
        theta = np.linalg.lstsq(phi[kept], output[kept], rcond=None)[0]
        losses.append(np.mean((output[kept] - phi[kept] @ theta) ** 2))
    return np.array(losses)


def vaf(measured, simulated):
    """Eq. 25 in percent, unclipped; rows that were not measured are left out."""
    lost = power = 0.0
    for u, u_hat in zip(measured, simulated, strict=True):
        if not np.isnan(u):
            lost += (u - u_hat) ** 2
            power += u**2
    return 100 * (1 - lost / power)


def brick_wall(signal, factor):
    """Keep what lies below the Nyquist frequency of every ``factor``-th row, by an explicit DFT."""
    n = len(signal)
    t = np.arange(n)
    out = np.zeros(n)
    for k in range(-(n // 2), n - n // 2):
        if abs(k) / n < 0.5 / factor:  # cycles a row
            wave = np.exp(2j * np.pi * k * t / n)
            out += (np.vdot(wave, signal) / n * wave).real
    return out


def block_mean(signal, factor):
    """In every row, the mean of it and the ``factor - 1`` rows after it, where there are any."""
    return np.array([np.mean(signal[t : t + factor]) for t in range(len(signal))])


def delay(signal, n_samples, stretches):
    """Each row holds what was there ``n_samples`` before it in its stretch; NaN without a past."""
    out = np.full(len(signal), np.nan)
    for begin, end in stretches:
        for t in range(begin, end):
            if t - n_samples >= begin:
                out[t] = signal[t - n_samples]
    return out


def newey_west(scores, rows, n_lags):
    """Sum over all pairs of rows no more than ``n_lags`` apart, with Bartlett weights."""
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for s, t in zip(scores, rows, strict=True):
        for other, at in zip(scores, rows, strict=True):
            if abs(t - at) <= n_lags:
                total += (1 - abs(t - at) / (n_lags + 1)) * np.outer(s, other)
    return total
