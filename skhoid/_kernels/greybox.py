"""Steps of a simulated operator or system, sample by sample, for several runs at once.

Signals have shape (n_samples, n_runs), so that the loops over runs hide the latency of recursions.
Coefficients with one row hold throughout, with n_samples rows they vary in time.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def delayed(x, delay):
    """Signals ``delay`` samples ago, of shape (1 or n_samples, 1 or n_runs), may be negative.

    Interpolates by cubic Lagrange polynomials; before the first sample and after the last their
    values hold.
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
            if at <= 0.0:
                out[k, j] = x[0, j]
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


@njit(cache=True, nogil=True, error_model="numpy")
def held_linearly(omega, zeta, dt):
    """Exact discretisation of the neuromuscular system for inputs linear between samples.

    s' = M s + omega^2 [[0, 1], [1, 0]] w with M = [[-2 zeta omega, 1], [-omega^2, 0]], s = (output,
    companion) and w = (position, rate command). Rows of the result hold the 2 x 2 matrices phi on
    s(k), ``before`` on w(k) and ``after`` on w(k + 1).
    """
    n = omega.size
    out = np.empty((n, 12))
    for i in range(n):
        w, z = omega[i], zeta[i]
        mean, square = -z * w, w * w
        root = np.sqrt(complex(mean * mean - square))
        if abs(root) * dt < 1e-7:
            sine = dt
        else:
            sine = (np.sinh(root * dt) / root).real
        growth = np.exp(mean * dt)
        cosine = growth * np.cosh(root * dt).real
        sine *= growth
        # phi = cosine I + sine (M - mean I)
        p0, p1 = cosine + sine * mean, sine
        p2, p3 = -sine * square, cosine - sine * mean
        # M^-1 = [[0, -1 / square], [1, 2 mean / square]]
        f0, f1, f2, f3 = p0 - 1.0, p1, p2, p3 - 1.0
        h0, h1 = -f2 / square, -f3 / square
        h2, h3 = f0 + 2 * mean / square * f2, f1 + 2 * mean / square * f3
        g0, g1, g2, g3 = h0 - dt, h1, h2, h3 - dt
        r0, r1 = -g2 / square / dt, -g3 / square / dt
        r2, r3 = (g0 + 2 * mean / square * g2) / dt, (g1 + 2 * mean / square * g3) / dt
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = p0, p1, p2, p3
        out[i, 4], out[i, 5] = square * (h1 - r1), square * (h0 - r0)
        out[i, 6], out[i, 7] = square * (h3 - r3), square * (h2 - r2)
        out[i, 8], out[i, 9] = square * r1, square * r0
        out[i, 10], out[i, 11] = square * r3, square * r2
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def second_order(position, rate, matrices, stiffness, bound):
    """Response from rest of a second-order system to a position and a rate command.

    s(k+1) = phi s(k) + before w(k) + after w(k+1), with s = (output, its companion) and
    w = (position - stiffness output^3, rate); see ``held_linearly`` for the matrices.
    """
    n, runs = position.shape
    out = np.empty((n, runs))
    drive = np.empty(runs)
    z = np.zeros(runs)
    v = np.zeros(runs)
    last = np.zeros(runs)
    out[0] = 0.0
    varies = matrices.shape[0] > 1
    q = matrices[0]
    for k in range(n - 1):
        if varies:
            q = matrices[k]
        a, b, c, d = q[0], q[1], q[2], q[3]
        b0, b1, b2, b3 = q[4], q[5], q[6], q[7]
        c0, c1, c2, c3 = q[8], q[9], q[10], q[11]
        if stiffness == 0.0:
            for j in range(runs):
                p0, p1, r0, r1 = position[k, j], position[k + 1, j], rate[k, j], rate[k + 1, j]
                drive[j] = b0 * p0 + b1 * r0 + c0 * p1 + c1 * r1
                out[k + 1, j] = drive[j] + (a * z[j] + b * v[j])
                v[j] = (b2 * p0 + b3 * r0 + c2 * p1 + c3 * r1) + (c * z[j] + d * v[j])
                z[j] = out[k + 1, j]
            continue
        for j in range(runs):
            ahead = 2 * z[j] - last[j]
            last[j] = z[j]
            p0 = position[k, j] - stiffness * z[j] * z[j] * z[j]
            p1 = position[k + 1, j] - stiffness * ahead * ahead * ahead
            r0, r1 = rate[k, j], rate[k + 1, j]
            new = a * z[j] + b * v[j] + b0 * p0 + b1 * r0 + c0 * p1 + c1 * r1
            v[j] = c * z[j] + d * v[j] + b2 * p0 + b3 * r0 + c2 * p1 + c3 * r1
            z[j] = min(max(new, -bound), bound)
            out[k + 1, j] = z[j]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def arx_response(x, a, b, stiffness, constant, bound):
    """Output from rest of A(q) y = B(q) (x - stiffness y^3) + constant, b from lag 0 on."""
    n, runs = x.shape
    na, nb = a.size, b.size
    out = np.empty((n, runs))
    w = np.empty((n, runs))
    for k in range(n):
        for j in range(runs):
            past = constant
            for i in range(min(na, k)):
                past -= a[i] * out[k - 1 - i, j]
            for i in range(1, min(nb, k + 1)):
                past += b[i] * w[k - i, j]
            now = x[k, j]
            value = past + b[0] * now
            if stiffness != 0.0:
                value = min(max(value, -bound), bound)
                if b[0] != 0.0:
                    value = past + b[0] * (now - stiffness * value * value * value)
                    value = min(max(value, -bound), bound)
                now -= stiffness * value * value * value
            w[k, j] = now
            out[k, j] = min(max(value, -bound), bound)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def held(x, watched, period, threshold, phase):
    """Sample and hold, of shape like x; times in samples.

    A new sample is taken when ``period`` has passed since the last one and ``watched`` is more
    than ``threshold`` away from its value then. A clock (threshold 0) ticks between samples too:
    x is interpolated, and the step in which it changes weighed by time.
    """
    n, runs = x.shape
    out = np.empty((n, runs))
    for j in range(runs):
        due = phase  # when the next sample may be taken
        value = 0.0
        seen = 0.0
        for k in range(n):
            out[k, j] = value
            if threshold > 0.0:
                if k >= due and abs(watched[k, j] - seen) > threshold:
                    value = x[k, j]
                    seen = watched[k, j]
                    out[k, j] = value
                    due = k + period
                continue
            # Between samples the output is a ramp: half of the step lies before the tick.
            while due - 0.5 < k:
                i = min(int(max(due, 0.0)), n - 1)
                f = max(due, 0.0) - i
                new = (1 - f) * x[i, j] + f * x[min(i + 1, n - 1), j]
                share = min(k - due + 0.5, 1.0)
                out[k, j] = (1 - share) * value + share * new
                value = new
                due += period
    return out


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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
