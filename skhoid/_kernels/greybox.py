"""Steps of a simulated operator or system, sample by sample, for several runs at once.

Signals have shape (n_samples, n_runs), so that the loops over runs hide the latency of recursions.
Coefficients with one row hold throughout, with n_samples rows they vary in time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**OPTIONS)
def delayed(x, delay):
    """Signals ``delay`` samples ago, of shape (1 or n_samples, 1 or n_runs), may be negative.

    Interpolates by cubic Lagrange polynomials; zero before the first sample, and the last
    value after the last.
    """
    n, runs = x.shape
    out = np.empty((n, runs))
    constant = delay.size == 1
    whole = int(np.floor(-delay[0, 0]))
    f = -delay[0, 0] - whole
    w0 = -f * (f - 1) * (f - 2) / 6
    w1 = (f + 1) * (f - 1) * (f - 2) / 2
    w2 = -(f + 1) * f * (f - 2) / 2
    w3 = (f + 1) * f * (f - 1) / 6
    for k in range(n):
        i = k + whole
        if constant and i >= 1 and i + 2 < n:
            for j in range(runs):
                out[k, j] = w0 * x[i - 1, j] + w1 * x[i, j] + w2 * x[i + 1, j] + w3 * x[i + 2, j]
            continue
        for j in range(runs):
            at = k - delay[min(k, delay.shape[0] - 1), min(j, delay.shape[1] - 1)]
            if at < 0.0:
                out[k, j] = 0.0
                continue
            i = int(np.floor(at))
            if i >= n - 1:
                out[k, j] = x[n - 1, j]
                continue
            g = at - i
            if i < 1 or i + 2 >= n:
                out[k, j] = (1 - g) * x[i, j] + g * x[i + 1, j]
            else:
                out[k, j] = (
                    -g * (g - 1) * (g - 2) / 6 * x[i - 1, j]
                    + (g + 1) * (g - 1) * (g - 2) / 2 * x[i, j]
                    - (g + 1) * g * (g - 2) / 2 * x[i + 1, j]
                    + (g + 1) * g * (g - 1) / 6 * x[i + 2, j]
                )
    return out


@njit(**OPTIONS)
def second_order(position, rate, phi, before, after, stiffness, bound):
    """Response from rest of a second-order system to a position and a rate command.

    s(k+1) = phi s(k) + before w(k) + after w(k+1), with s = (output, its companion) and
    w = (position - stiffness output^3, rate); 2 x 2 matrices are rows of four.
    """
    n, runs = position.shape
    out = np.empty((n, runs))
    z = np.zeros(runs)
    v = np.zeros(runs)
    last = np.zeros(runs)
    for j in range(runs):
        out[0, j] = 0.0
    varies = phi.shape[0] > 1
    for k in range(n - 1):
        i = k if varies else 0
        a, b, c, d = phi[i, 0], phi[i, 1], phi[i, 2], phi[i, 3]
        b0, b1, b2, b3 = before[i, 0], before[i, 1], before[i, 2], before[i, 3]
        c0, c1, c2, c3 = after[i, 0], after[i, 1], after[i, 2], after[i, 3]
        for j in range(runs):
            p0, p1 = position[k, j], position[k + 1, j]
            if stiffness != 0.0:
                ahead = 2 * z[j] - last[j]
                p0 -= stiffness * z[j] * z[j] * z[j]
                p1 -= stiffness * ahead * ahead * ahead
                last[j] = z[j]
            r0, r1 = rate[k, j], rate[k + 1, j]
            new = a * z[j] + b * v[j] + b0 * p0 + b1 * r0 + c0 * p1 + c1 * r1
            v[j] = c * z[j] + d * v[j] + b2 * p0 + b3 * r0 + c2 * p1 + c3 * r1
            z[j] = min(max(new, -bound), bound)
            out[k + 1, j] = z[j]
    return out


@njit(**OPTIONS)
def arx_response(x, a, b, stiffness, bound):
    """Output from rest of A(q) y = B(q) (x - stiffness y^3), b from lag 0 on."""
    n, runs = x.shape
    na, nb = a.size, b.size
    out = np.empty((n, runs))
    w = np.empty((n, runs))
    for k in range(n):
        for j in range(runs):
            past = 0.0
            for i in range(min(na, k)):
                past -= a[i] * out[k - 1 - i, j]
            for i in range(1, min(nb, k + 1)):
                past += b[i] * w[k - i, j]
            now = x[k, j]
            value = past + b[0] * now
            if stiffness != 0.0:
                if b[0] != 0.0:
                    value = min(max(value, -bound), bound)
                    value = past + b[0] * (now - stiffness * value * value * value)
                    value = min(max(value, -bound), bound)
                now -= stiffness * value * value * value
            w[k, j] = now
            out[k, j] = min(max(value, -bound), bound)
    return out


@njit(**OPTIONS)
def filtered(x, b, a):
    """Response from rest of (b0 + b1 q^-1 + b2 q^-2) / (1 + a0 q^-1 + a1 q^-2)."""
    n, runs = x.shape
    out = np.empty((n, runs))
    s1 = np.zeros(runs)
    s2 = np.zeros(runs)
    for k in range(n):
        for j in range(runs):
            now = b[0] * x[k, j] + s1[j]
            s1[j] = b[1] * x[k, j] - a[0] * now + s2[j]
            s2[j] = b[2] * x[k, j] - a[1] * now
            out[k, j] = now
    return out


@njit(**OPTIONS)
def whitened(signals, ar, weight):
    """Prediction errors of signals (n_signals, n_samples, n_runs) under an AR(6) model, weighted.

    The first six samples are zero. Returns a table (n_signals, n_samples * n_runs).
    """
    count, n, r = signals.shape
    length = n * r
    flat = signals.reshape(count, length)
    by_row = weight.reshape(length)
    out = np.zeros((count, length))
    a1, a2, a3, a4, a5, a6 = ar[0], ar[1], ar[2], ar[3], ar[4], ar[5]
    for i in range(count):
        x = flat[i]
        to = out[i]
        for k in range(6 * r, length):  # the sample before lies one row of runs before
            to[k] = by_row[k] * (
                x[k]
                + a1 * x[k - r]
                + a2 * x[k - 2 * r]
                + a3 * x[k - 3 * r]
                + a4 * x[k - 4 * r]
                + a5 * x[k - 5 * r]
                + a6 * x[k - 6 * r]
            )
    return out


@njit(**OPTIONS)
def held(x, period, threshold, phase):
    """Sample and hold, of shape like x; times in samples.

    A new sample is taken when ``period`` has passed since the last one and x differs from the
    held value by more than ``threshold``; within a step the change is weighed by time.
    """
    n, runs = x.shape
    out = np.empty((n, runs))
    for j in range(runs):
        due = phase  # when the next sample may be taken
        value = 0.0
        for k in range(n):
            out[k, j] = value
            while due <= k:
                if due > k - 1 and threshold <= 0.0 and k > 0:
                    f = k - due
                    new = (1 - f) * x[k, j] + f * x[k - 1, j]
                    share = f
                else:
                    new = x[k, j]
                    share = 1.0
                if abs(new - value) > threshold:
                    out[k, j] = share * new + (1 - share) * out[k, j]
                    value = new
                    due = max(due, k - 1.0) + period
                else:
                    due = k + 1.0
    return out


@njit(**OPTIONS)
def rate_limited(x, step):
    """Follow x with at most ``step`` a sample."""
    n, runs = x.shape
    out = np.empty((n, runs))
    for j in range(runs):
        out[0, j] = x[0, j]
    for k in range(1, n):
        for j in range(runs):
            change = x[k, j] - out[k - 1, j]
            out[k, j] = out[k - 1, j] + min(max(change, -step), step)
    return out


@njit(**OPTIONS)
def stuck(x, breakaway, kinetic):
    """Stick until x is ``breakaway`` away, then go on ``kinetic`` behind x until it turns."""
    n, runs = x.shape
    out = np.empty((n, runs))
    for j in range(runs):
        value = x[0, j]
        moving = 0
        for k in range(n):
            away = x[k, j] - value
            if moving != 0:
                target = x[k, j] - moving * kinetic
                if (target - value) * moving > 0.0:
                    value = target
                else:
                    moving = 0
            if moving == 0 and abs(away) > breakaway:
                moving = 1 if away > 0.0 else -1
                value = x[k, j] - moving * kinetic
            out[k, j] = value
    return out
