"""Kernels of models with effects: stages of simulation, whitening, nonlinear elements.

Signals have shape (n_samples, n_runs), so that the loops over runs hide the latency of recursions.
Coefficients with one row hold throughout, with n_samples rows they vary in time.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .kernel import OPTIONS, inner, kernel

N_NEWTON = 20  # at most
MOST_JUMPS = 100  # of friction in one sample


@kernel("f8[:,::1], f8[:,::1]", 1)
def delayed(x, delay):
    """Signals ``delay`` samples ago; ``delay`` (1 or n_samples, 1 or n_runs) may be negative.

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


@kernel("f8[::1], f8[::1], f8", 1)
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
        away = mean * mean - square
        root, growth = np.sqrt(abs(away)), np.exp(mean * dt)
        if root * dt < 1e-7:
            sine, cosine = growth * dt, growth
        elif away < 0.0:
            sine, cosine = growth * np.sin(root * dt) / root, growth * np.cos(root * dt)
        elif root * dt > 300.0:  # a large overdamped one between slow samples: 0 times inf
            cosine = np.exp((mean + root) * dt) / 2
            sine = cosine / root
        else:
            sine, cosine = growth * np.sinh(root * dt) / root, growth * np.cosh(root * dt)
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


@njit(**OPTIONS, fastmath={"contract"})
def _recurred(x, t, det):
    """Solve y(k) = x(k) + t y(k-1) - det y(k-2) from rest, in place; some runs at a time.

    Values stay in registers, and the latencies of several chains overlap.
    """
    n, runs = x.shape
    first = 0
    while first < runs:
        left = runs - first
        if left >= 4:
            a, b, c, d = x[:, first], x[:, first + 1], x[:, first + 2], x[:, first + 3]
            a1 = b1 = c1 = d1 = a2 = b2 = c2 = d2 = 0.0
            for k in range(n):
                a1, a2 = (a[k] - det * a2) + t * a1, a1
                b1, b2 = (b[k] - det * b2) + t * b1, b1
                c1, c2 = (c[k] - det * c2) + t * c1, c1
                d1, d2 = (d[k] - det * d2) + t * d1, d1
                a[k], b[k], c[k], d[k] = a1, b1, c1, d1
            first += 4
        elif left == 3:
            a, b, c = x[:, first], x[:, first + 1], x[:, first + 2]
            a1 = b1 = c1 = a2 = b2 = c2 = 0.0
            for k in range(n):
                a1, a2 = (a[k] - det * a2) + t * a1, a1
                b1, b2 = (b[k] - det * b2) + t * b1, b1
                c1, c2 = (c[k] - det * c2) + t * c1, c1
                a[k], b[k], c[k] = a1, b1, c1
            first += 3
        else:
            a = x[:, first]
            a1 = a2 = 0.0
            for k in range(n):
                a1, a2 = (a[k] - det * a2) + t * a1, a1
                a[k] = a1
            first += 1


@njit(**OPTIONS, fastmath={"contract"})
def _linear(position, rate, q):
    """``second_order`` for constant matrices and no stiffness, as a difference equation.

    With the companion eliminated: z(k+1) = (a + d) z(k) - (a d - b c) z(k-1) + input, where the
    input is a sum over three samples of position and rate.
    """
    n, runs = position.shape
    out = np.empty((n, runs))
    p, r, y = position.reshape(n * runs), rate.reshape(n * runs), out.reshape(n * runs)
    a, b, c, d = q[0], q[1], q[2], q[3]
    y[:runs] = 0.0
    if n > 1:
        for j in range(runs):
            y[runs + j] = q[4] * p[j] + q[5] * r[j] + q[8] * p[runs + j] + q[9] * r[runs + j]
    p_now, r_now = q[8], q[9]
    p_before, r_before = q[4] - d * q[8] + b * q[10], q[5] - d * q[9] + b * q[11]
    p_first, r_first = b * q[6] - d * q[4], b * q[7] - d * q[5]
    m = max(n - 2, 0) * runs
    # Slices, because their indices cannot be negative: only such loops are vectorised.
    p0, p1, p2 = p[:m], p[runs : runs + m], p[2 * runs :]
    r0, r1, r2 = r[:m], r[runs : runs + m], r[2 * runs :]
    to = y[2 * runs :]
    for i in range(m):
        to[i] = (p_now * p2[i] + p_before * p1[i] + p_first * p0[i]) + (
            r_now * r2[i] + r_before * r1[i] + r_first * r0[i]
        )
    _recurred(out[1:], a + d, a * d - b * c)
    return out


@njit(**OPTIONS, forceinline=True)
def _force(y, cubic, square):
    return (cubic * y * y + square * abs(y)) * y


@kernel("f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8", 2)
def second_order(position, rate, matrices, cubic, square, bound):
    """Response from rest of a second-order system to a position and a rate command.

    s(k+1) = phi s(k) + before w(k) + after w(k+1), with s = (output, its companion) and
    w = (position - cubic output^3 - square output abs(output), rate); see ``held_linearly`` for the
    matrices. The force of the spring at k + 1 is that of the output at k + 1, so that no stiffness
    makes the steps unstable.
    """
    q = matrices[0]
    stiff = cubic != 0.0 or square != 0.0
    if matrices.shape[0] == 1 and not stiff:
        return _linear(position, rate, q)
    n, runs = position.shape
    out = np.empty((n, runs))
    z = np.zeros(runs)
    v = np.zeros(runs)
    last = np.zeros(runs)
    out[0] = 0.0
    varies = matrices.shape[0] > 1
    if not stiff:  # nothing to run away
        bound = np.inf
    for k in range(n - 1):
        if varies:
            q = matrices[k]
        a, b, c, d = q[0], q[1], q[2], q[3]
        b0, b1, b2, b3 = q[4], q[5], q[6], q[7]
        c0, c1, c2, c3 = q[8], q[9], q[10], q[11]
        for j in range(runs):
            p0 = position[k, j] - _force(z[j], cubic, square)
            p1, r0, r1 = position[k + 1, j], rate[k, j], rate[k + 1, j]
            new = a * z[j] + b * v[j] + b0 * p0 + b1 * r0 + c0 * p1 + c1 * r1
            if stiff:  # new + c0 force(new) equals the output without the spring's new force
                whole, new = new, 2 * z[j] - last[j]
                last[j] = z[j]
                for _ in range(N_NEWTON):
                    away = new + c0 * _force(new, cubic, square) - whole
                    step = away / (1 + c0 * (3 * cubic * new * new + 2 * square * abs(new)))
                    new -= step
                    if abs(step) <= 1e-12 * (abs(whole) + abs(new)):
                        break
                p1 -= _force(new, cubic, square)
            if abs(z[j]) == bound:  # diverged: it stays at the bound
                new = z[j]
            elif not abs(new) < bound:
                new = bound if new > 0.0 else -bound
            else:
                v[j] = c * z[j] + d * v[j] + b2 * p0 + b3 * r0 + c2 * p1 + c3 * r1
            z[j] = new
            out[k + 1, j] = new
    return out


@kernel("f8[:,::1], f8[::1], f8[::1], f8, f8, f8, f8", 1)
def arx_response(x, a, b, cubic, square, constant, bound):
    """Output from rest of A(q) y = B(q) (x - cubic y^3 - square y abs(y)) + constant.

    b is from lag 0 on.
    """
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
            if cubic != 0.0 or square != 0.0:
                value = min(max(value, -bound), bound)
                if b[0] != 0.0:
                    value = past + b[0] * (now - _force(value, cubic, square))
                    value = min(max(value, -bound), bound)
                now -= _force(value, cubic, square)
            w[k, j] = now
            out[k, j] = min(max(value, -bound), bound)
    return out


@kernel("f8[:,:,::1], f8[::1], f8[:,::1]", 1, fastmath={"contract"})
def whitened(signals, ar, weight):
    """Prediction errors of signals (n_signals, n_samples, n_runs) under an AR(6) model, weighted.

    The first six samples are zero. Returns a table (n_signals, n_samples * n_runs).
    """
    count, n, r = signals.shape
    m = max(n - 6, 0) * r
    flat = signals.reshape(count, n * r)
    by_row = weight.reshape(n * r)[6 * r :]
    out = np.zeros((count, n * r))
    a1, a2, a3, a4, a5, a6 = ar[0], ar[1], ar[2], ar[3], ar[4], ar[5]
    for i in range(count):
        x, to = flat[i], out[i, 6 * r :]  # the sample before lies one row of runs before
        x1, x2, x3 = x[5 * r : 5 * r + m], x[4 * r : 4 * r + m], x[3 * r : 3 * r + m]
        x4, x5, x6 = x[2 * r : 2 * r + m], x[r : r + m], x[:m]
        x = x[6 * r :]
        for k in range(m):
            to[k] = by_row[k] * (
                (x[k] + a1 * x1[k] + a2 * x2[k])
                + (a3 * x3[k] + a4 * x4[k])
                + (a5 * x5[k] + a6 * x6[k])
            )
    return out


@kernel("f8[:,::1], f8[:,::1], f8, f8, f8", 1)
def held(x, watched, period, threshold, phase):
    """Sample and hold, of shape like x; times in samples.

    A new sample is taken when ``period`` has passed since the last one and ``watched`` is more
    than ``threshold`` away from its value then. Clocks (threshold 0) and events do not wait for
    samples: x is interpolated, and the step in which it changes weighed by time.
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
                # Events after the sample before, until this one.
                i = max(k - 1, 0)
                last = i + 0.0
                rise = watched[k, j] - watched[i, j]
                while k >= due:
                    at = max(due, last)
                    away = watched[i, j] + (at - i) * rise - seen
                    if not abs(away) >= threshold:  # not yet
                        if not abs(watched[k, j] - seen) > threshold:
                            break
                        level = threshold if watched[k, j] > seen else -threshold
                        at = min(at + (level - away) / rise, k)
                    new = x[i, j] + (at - i) * (x[k, j] - x[i, j])
                    # Between samples the output is a ramp: half of the step lies before the event.
                    out[k, j] += min(k - at + 0.5, 1.0) * (new - value)
                    out[i, j] += max(k - at - 0.5, 0.0) * (new - value)
                    value = new
                    seen = watched[i, j] + (at - i) * rise
                    due, last = at + period, at
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


@inner
def _answered_by_events(x, w, y, counts, q, damping, period, threshold, due, value, seen):
    """Sums of squares and products of what a held command makes of a window: of the answer, its
    rate and y, on the rows that count.
    """
    z, v, before, last = value, damping * value, value, value
    yy = yr = rr = ty = tr = tt = 0.0
    for k in range(len(x)):
        i = max(k - 1, 0)
        now, since, turn = value, i + 0.0, w[k] - w[i]
        while k >= due:
            at = max(due, since)
            away = w[i] + (at - i) * turn - seen
            if not abs(away) >= threshold:
                if not abs(w[k] - seen) > threshold:
                    break
                level = threshold if w[k] > seen else -threshold
                at = min(at + (level - away) / turn, k)
            new = x[i] + (at - i) * (x[k] - x[i])
            now += min(k - at + 0.5, 1.0) * (new - value)
            last += max(k - at - 0.5, 0.0) * (new - value)
            value = new
            seen = w[i] + (at - i) * turn
            due, since = at + period, at
        if k >= 2:  # the row before is complete
            z, v = (
                q[0] * z + q[1] * v + q[4] * before + q[8] * last,
                q[2] * z + q[3] * v + q[6] * before + q[10] * last,
            )
        if k > 0 and counts[k - 1]:
            rate, target = v - damping * z, y[k - 1]
            yy += z * z
            yr += z * rate
            rr += rate * rate
            ty += target * z
            tr += target * rate
            tt += target * target
        before, last = last, now
    return yy, yr, rr, ty, tr, tt


@kernel("f8[:,::1], f8[:,::1], f8[:,::1], b1[:,::1], f8[:,::1], f8[:,::1], f8, b1, i8, i8, i8", 1)
def events_scanned(
    position, slope, y, known, points, matrices, damping, of_error, thin, window, phases
):
    """Squares that commands held by events leave of y, at many points, as ``held`` and
    ``second_order`` would; what the answers should come earlier, in seconds; and a gain on them.

    The rows of ``points`` are period in samples, threshold, ratio of the gains and factor of the
    command ``factor (position + ratio slope)``; events are of that, or of ``position``.
    ``damping`` is 2 zeta omega. Of each answer the best sum with its rate counts, on every
    ``thin``-th row. Runs are cut into windows of that many samples. Where there are ``phases``,
    each begins with a command as large as y that may change at the best of that many shares of the
    period, and its first quarter does not count.
    """
    n, runs = position.shape
    out = np.empty((len(points), 3))
    q = matrices[0]
    whole, counts = np.zeros((runs, n)), np.zeros((runs, n), dtype=np.bool_)
    for j in range(runs):
        for begin in range(0, n, window):
            first = begin + (min(window, n - begin) // 4 if phases > 0 else 0)
            for row in range(-(-begin // thin), len(y)):
                k = row * thin
                if k >= min(begin + window, n):
                    break
                whole[j, k], counts[j, k] = y[row, j], known[row, j] and k >= first
    at, slopes, x = position.T.copy(), slope.T.copy(), np.empty((runs, n))
    for p in range(len(points)):
        period, threshold, ratio, factor = points[p, 0], points[p, 1], points[p, 2], points[p, 3]
        yy = yr = rr = ty = tr = tt = 0.0
        for j in range(runs):
            for k in range(n):
                x[j, k] = factor * (at[j, k] + ratio * slopes[j, k])
            watched = at[j] if of_error else x[j]
            for begin in range(0, n, window):
                end = min(begin + window, n)
                most, best = -1.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                for phase in range(max(phases, 1)):
                    due, value, seen = 0.0, 0.0, 0.0
                    if phases > 0:
                        due = phase * period / phases
                        value = y[begin // thin, j]
                        seen = at[j, begin] if of_error else value
                    own = _answered_by_events(
                        x[j, begin:end],
                        watched[begin:end],
                        whole[j, begin:end],
                        counts[j, begin:end],
                        q,
                        damping,
                        period,
                        threshold,
                        due,
                        value,
                        seen,
                    )
                    explained = max(own[3], 0.0) ** 2 / own[0] if own[0] > 0.0 else 0.0
                    if explained > most:
                        most, best = explained, own
                yy, yr, rr = yy + best[0], yr + best[1], rr + best[2]
                ty, tr, tt = ty + best[3], tr + best[4], tt + best[5]
        det = yy * rr - yr * yr
        gain, along = 0.0, 0.0
        if det > 1e-9 * yy * rr:
            gain, along = (ty * rr - tr * yr) / det, (tr * yy - ty * yr) / det
        out[p, 0] = tt - gain * ty - along * tr if gain > 0.0 else tt
        out[p, 1] = along / gain if gain > 0.0 else 0.0
        out[p, 2] = gain
    return out


FAR, A_UNIT = 9, 64  # standard deviations, beyond which a tail is nothing; pieces of each


def _tail_pieces():
    """Mean of max(z - x, 0) over standard normal z, x from 0 on, by pieces to 1e-15.

    Coefficients, lowest powers first, of the polynomials that have the value and two derivatives at
    both ends of each piece.
    """
    x = np.arange(FAR * A_UNIT + 1) / A_UNIT
    density = np.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)
    above = np.array([0.5 * math.erfc(one / math.sqrt(2)) for one in x])
    f, d, s = density - x * above, -above / A_UNIT, density / A_UNIT**2
    c = f[1:] - f[:-1] - d[:-1] - s[:-1] / 2, d[1:] - d[:-1] - s[:-1], s[1:] - s[:-1]
    high = [(10, -4, 0.5), (-15, 7, -1), (6, -3, 0.5)]
    powers = [f[:-1], d[:-1], s[:-1] / 2, *(a * c[0] + b * c[1] + e * c[2] for a, b, e in high)]
    return np.ascontiguousarray(np.array(powers).T)


TAIL = _tail_pieces()


@inner
def _tail(x):
    if not x < FAR:
        return 0.0
    i = int(x * A_UNIT)
    t = x * A_UNIT - i
    c = TAIL[i]
    return ((((c[5] * t + c[4]) * t + c[3]) * t + c[2]) * t + c[1]) * t + c[0]


@kernel("f8[::1], f8, f8", 1)
def cut_within(x, limit, remnant):
    """Mean of a signal that limits cut, over normal remnant that is cut with it."""
    out = np.empty(x.size)
    for k in range(x.size):
        below, above = abs(x[k] + limit) / remnant, abs(x[k] - limit) / remnant
        out[k] = min(max(x[k], -limit), limit) + remnant * (_tail(below) - _tail(above))
    return out


@kernel("f8[::1], f8, f8, f8[::1]", 1)
def stepped(x, step, offset, sines):
    """Steps that sines of once, twice and three times their angle make, in proportion to x.

    The sine and cosine of half the angle are Taylor series, to 1e-14: loops with these are vectors.
    """
    out = np.empty(x.size)
    for k in range(x.size):
        place = x[k] / step - offset
        half = np.pi * (place - np.rint(place))
        square = half * half
        sine, cosine = 1.0, 1.0
        for i in range(9, 0, -1):
            sine = 1.0 - square * (1.0 / (2 * i * (2 * i + 1))) * sine
            cosine = 1.0 - square * (1.0 / (2 * i * (2 * i - 1))) * cosine
        once, along = 2.0 * half * sine * cosine, 2.0 * cosine * cosine - 1.0
        more = sines[0] - sines[1] * along + sines[2] / 3.0 * (4.0 * along * along - 1.0)
        out[k] = step * (place - once * more)
    return out


@kernel("f8[:,::1], f8", 1)
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


@kernel("f8[::1], f8[::1], f8[:,::1]", 1)
def along(at, knots, pieces):
    """Values at points of a polynomial by pieces, of shape (4, n_knots + 1): before the first knot,
    between knots, after the last; highest powers first, of the distance from the knot to the left.
    """
    out = np.empty(at.size)
    most = knots.size
    i = 0
    for k in range(at.size):
        x = at[k]
        while i > 0 and x < knots[i - 1]:
            i -= 1
        while i < most and x >= knots[i]:
            i += 1
        d = x - knots[max(i - 1, 0)]
        out[k] = ((pieces[0, i] * d + pieces[1, i]) * d + pieces[2, i]) * d + pieces[3, i]
    return out


@kernel("f8[:,::1], f8, f8, b1", 1)
def stuck(x, breakaway, kinetic, slides):
    """Stick until x is ``breakaway`` away, then jump to ``kinetic`` behind it.

    If it ``slides``, it then follows x until that turns; else it sticks there again, and its jumps
    fall between samples.
    """
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
            if not slides:  # it broke away between the samples, and perhaps again
                jump = breakaway - kinetic
                now, before = value, x[max(k - 1, 0), j]
                for _ in range(MOST_JUMPS):
                    if not abs(away) > breakaway or jump <= 0.0:
                        break
                    sign = 1.0 if away > 0.0 else -1.0
                    moved = x[k, j] - before
                    late = (abs(away) - breakaway) / abs(moved) if moved != 0.0 else 0.0
                    # A step is a ramp of one sample, half of which lies before it.
                    late = min(late, 1.0)
                    now += min(late + 0.5, 1.0) * sign * jump
                    if k > 0:
                        out[k - 1, j] += max(late - 0.5, 0.0) * sign * jump
                    value += sign * jump
                    away = x[k, j] - value
                if abs(away) > breakaway and jump > 0.0:  # too far to take the jumps one by one
                    value = now = x[k, j] - kinetic if away > 0.0 else x[k, j] + kinetic
                out[k, j] = now
                continue
            elif moving == 0 and abs(away) > breakaway:
                moving = 1 if away > 0.0 else -1
                value = x[k, j] - moving * kinetic
            out[k, j] = value
    return out


@kernel("f8[:,::1], f8[::1], f8[::1]", 1)
def stops_summed(x, gaps, weights):
    """Sum of how far x is ahead of each of several plays, whose half-widths are ``gaps``, weighted.

    Each follows x as ``stuck(x, gap, gap, True)`` does.
    """
    n, runs = x.shape
    out = np.zeros((n, runs))
    ahead = np.zeros((runs, gaps.size))
    for k in range(1, n):
        for j in range(runs):
            change = x[k, j] - x[k - 1, j]
            total = 0.0
            for i in range(gaps.size):
                ahead[j, i] = min(max(ahead[j, i] + change, -gaps[i]), gaps[i])
                total += weights[i] * ahead[j, i]
            out[k, j] = total
    return out
