"""Naive twins of the delay bank, and recordings with a white equation error whose delay jumps."""

from itertools import pairwise, product

import numpy as np
from scipy.signal import lfilter

A = (-1.8, 0.84)
B = (0.05, -0.04)


def jumping_run(seed=0, noise=0.03):
    """e, u and the delay in samples of each row, which changes in the middle."""
    n_rows, delays, rng = 4000, (20, 35), np.random.default_rng(seed)
    e = lfilter([1], [1, -0.9], rng.standard_normal(n_rows))
    nk = np.where(np.arange(n_rows) < n_rows // 2, *delays)
    drive = np.zeros(n_rows)
    rows = np.arange(max(delays) + 1, n_rows)
    drive[rows] = B[0] * e[rows - nk[rows]] + B[1] * e[rows - nk[rows] - 1]
    white = noise * np.std(drive) * rng.standard_normal(n_rows)
    return e[:, None], lfilter([1.0], [1.0, *A], drive + white), nk


def transitions(n, leave):
    """Matrix pi whose entry (i, j) is the probability of going from i to j."""
    pi = np.zeros((n, n))
    for i, step in product(range(n), (-1, 1)):
        pi[i, min(max(i + step, 0), n - 1)] += leave / 2  # beyond the ends one stays
    return pi + (1 - leave) * np.eye(n)


def error_ahead(path, e, u, nk, t, steps):
    """Error at row t of a simulation with the theta of ``steps`` rows before, na = nb = 2."""
    a1, a2, b0, b1 = path[t - steps]
    y = dict(enumerate(u[: t - steps + 1]))
    for row in range(t - steps + 1, t + 1):
        y[row] = -a1 * y[row - 1] - a2 * y[row - 2] + b0 * e[row - nk] + b1 * e[row - nk - 1]
    return u[t] - y[t]


def probabilities(paths, runs, delays, *, steps, leave, power, memory, settled):
    """Probabilities of the delays over time, from the paths of theta of each delay.

    ``runs`` are (e, u) of the same length; NaN in u alone means that there is no error there.
    """
    first = max(delays) + 1
    n_rows = len(runs[0][1])
    w = np.full(len(delays), 1 / len(delays))
    out = np.empty((n_rows, len(delays)))
    pi = transitions(len(delays), leave)
    count, variance = 0.0, 0.0
    for t in range(n_rows):
        w = w @ pi
        lost, known = np.zeros(len(delays)), 0
        for e, u in runs:
            back = min(steps, t + 1 - first)
            if back < 1:
                continue
            errors = [
                error_ahead(p, e, u, nk, t, back) for p, nk in zip(paths, delays, strict=True)
            ]
            if np.isfinite(errors).all():
                lost += np.square(errors)
                known += 1
        if known:
            count = count * (1 - 1 / memory) + 1
            variance += (w @ lost / known - variance) / count
            if count > settled:
                w = w * np.exp(-power * (lost - lost.min()) / (2 * variance))
                w = w / w.sum()
        out[t] = w
    return out


def best_path(fits, leave):
    """The most probable path by trying all of them."""
    n_instants, n = fits.shape
    with np.errstate(divide="ignore"):
        log_pi = np.log(transitions(n, leave))
    best, found = -np.inf, None
    for path in product(range(n), repeat=n_instants):
        # The first step leads from any delay, all alike, to the first of the path.
        value = log_pi[:, path[0]].max() + sum(fits[t, j] for t, j in enumerate(path))
        value += sum(log_pi[i, j] for i, j in pairwise(path))
        if value > best:
            best, found = value, path
    return best, np.array(found)


def value_of(path, fits, leave):
    with np.errstate(divide="ignore"):
        log_pi = np.log(transitions(fits.shape[1], leave))
    value = log_pi[:, path[0]].max() + fits[np.arange(len(path)), path].sum()
    return value + sum(log_pi[i, j] for i, j in pairwise(path))
