"""Slow, readable twins of the kernels that simulate operators with effects: one run, one sample.

They share no code with the package. A signal is a list or one-dimensional array of one run.
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq


def delayed(x, delay):
    """x some samples ago, x[0] before that; ``delay`` has a value for each sample."""
    n = len(x)
    out = []
    for k in range(n):
        at = k - delay[k]
        before = int(np.floor(at))
        if at < 0:
            out.append(x[0])
        elif before >= n - 1:
            out.append(x[n - 1])
        elif before < 1 or before + 2 >= n:
            out.append(x[before] + (at - before) * (x[before + 1] - x[before]))
        else:
            nodes = range(before - 1, before + 3)
            out.append(lagrange(at, nodes, [x[i] for i in nodes]))
    return out


def lagrange(at, nodes, values):
    """The polynomial through the nodes, at a place."""
    total = 0.0
    for i, value in zip(nodes, values, strict=True):
        weight = 1.0
        for j in nodes:
            if j != i:
                weight *= (at - j) / (i - j)
        total += weight * value
    return total


def transition(omega, zeta, dt):
    """phi, before and after for inputs that are linear between samples (Van Loan's integrals).

    s' = M s + B w, s(k+1) = phi s(k) + before w(k) + after w(k+1), from one matrix exponential of
    the state with the input and its slope: [M B 0; 0 0 I; 0 0 0].
    """
    M = np.array([[-2 * zeta * omega, 1.0], [-(omega**2), 0.0]])
    B = omega**2 * np.array([[0.0, 1.0], [1.0, 0.0]])
    together = np.zeros((6, 6))
    together[:2, :2], together[:2, 2:4], together[2:4, 4:] = M, B, np.eye(2)
    grown = expm(together * dt)
    phi, held, sloped = grown[:2, :2], grown[:2, 2:4], grown[:2, 4:]
    return phi, held - sloped / dt, sloped / dt


def spring(y, cubic, square):
    return cubic * y**3 + square * y * abs(y)


def second_order(position, rate, matrices, cubic, square, bound):
    """s(k+1) = phi s(k) + before w(k) + after w(k+1), w = (position - spring(y), rate).

    ``matrices`` has phi, before and after for each sample. The spring at the next sample has the
    force of the output there.
    """
    s, out = np.zeros(2), [0.0]
    for k in range(len(position) - 1):
        phi, before, after = matrices[k]
        now = np.array([position[k] - spring(s[0], cubic, square), rate[k]])
        rest = phi @ s + before @ now + after @ np.array([position[k + 1], rate[k + 1]])

        def away(y, rest=rest[0], by=after[0, 0]):
            return y + by * spring(y, cubic, square) - rest

        if abs(s[0]) == bound:
            out.append(out[-1])
            continue
        y = brentq(away, *sorted((0.0, rest[0])), xtol=1e-14, maxiter=1000) if rest[0] else 0.0
        s = rest - after[:, 0] * spring(y, cubic, square)
        if (cubic or square) and not abs(s[0]) < bound:
            s[0] = np.copysign(bound, s[0])
        out.append(s[0])
    return out


def arx_response(x, a, b, cubic, square, constant, bound):
    """A(q) y = B(q) (x - spring(y)) + constant; with b_0, y of now is predicted first."""
    y, held = [], []

    def limited(value):
        return min(max(value, -bound), bound)

    for k in range(len(x)):
        past = constant - sum(a[i] * y[k - 1 - i] for i in range(len(a)) if k - 1 - i >= 0)
        past += sum(b[i] * (x[k - i] - held[k - i]) for i in range(1, len(b)) if k - i >= 0)
        value = past + b[0] * x[k]
        if (cubic or square) and b[0] != 0:
            value = past + b[0] * (x[k] - spring(limited(value), cubic, square))
        y.append(limited(value))
        held.append(spring(y[-1], cubic, square))
    return y


def whitened(signal, ar, weight):
    """weight(k) (x(k) + a_1 x(k-1) + ... + a_6 x(k-6)), zero for the first six samples."""
    out = [0.0] * 6
    for k in range(6, len(signal)):
        total = signal[k] + sum(a * signal[k - 1 - i] for i, a in enumerate(ar))
        out.append(weight[k] * total)
    return out


def held_by_clock(x, period, phase):
    """Sample and hold at phase, phase + period, ... (in samples, x linear between them).

    What follows takes it as linear between samples. So each step of the hold is there a ramp that
    lasts a sample, half of it before the tick.
    """
    n = len(x)
    out, before, tick = np.zeros(n), 0.0, phase
    while tick < n:
        value = np.interp(tick, np.arange(n), x)
        out += (value - before) * np.clip(np.arange(n) - tick + 0.5, 0.0, 1.0)
        before, tick = value, tick + period
    return out


def held_by_event(x, watched, period, threshold, phase):
    """Hold x when ``watched``, linear between samples, has moved that far, ``period`` apart.

    Steps are ramps as those of a clock.
    """
    n = len(x)
    k, out = np.arange(n), np.zeros(n)
    before, seen, now, due = 0.0, 0.0, 0.0, phase
    while now <= n - 1:
        # The first instant from ``due`` on at which it is that far away: in one of the samples.
        at = max(now, due)
        while at <= n - 1 and not abs(np.interp(at, k, watched) - seen) >= threshold:
            after = min(np.floor(at) + 1, n)
            if after > n - 1:
                at = np.inf
                break
            one, other = np.interp(at, k, watched) - seen, watched[int(after)] - seen
            if abs(other) > threshold:
                level = threshold if other > 0 else -threshold
                at += (after - at) * (level - one) / (other - one)
                break
            at = after
        if not at <= n - 1:
            break
        value = np.interp(at, k, x)
        out += (value - before) * np.clip(k - at + 0.5, 0.0, 1.0)
        before, seen, due, now = value, np.interp(at, k, watched), at + period, at
    return out


def rate_limited(x, step):
    """Follow x by at most a step a sample."""
    out = [x[0]]
    for value in x[1:]:
        low, high = out[-1] - step, out[-1] + step
        out.append(low if value < low else high if value > high else value)
    return out


def stuck(x, breakaway, kinetic):
    """At rest until x is further than ``breakaway``; then ``kinetic`` behind x, till x turns."""
    out, direction, place = [], 0, x[0]
    for value in x:
        if direction and direction * (value - direction * kinetic - place) <= 0:
            direction = 0
        if not direction and abs(value - place) > breakaway:
            direction = 1 if value > place else -1
        if direction:
            place = value - direction * kinetic
        out.append(place)
    return out


def resistance(terms, y, rate, tables=()):
    """Sum of forces (kind, of the rate, size, width, extra, fall) at an output and its rate."""
    total = 0.0
    for kind, of_rate, size, width, extra, fall in terms:
        v = rate if of_rate else y
        if kind == 0.0:
            total += size * np.tanh(v / width) * (1 + extra * np.exp(-((v / fall) ** 2)))
        elif kind == 3.0:
            total += size * np.clip(v / width, -1, 1) * (1 + extra * np.exp(-((v / fall) ** 2)))
        elif kind == 1.0 and y > extra:
            head = y - extra
            total += size * (np.sqrt(head) if head > width else head / np.sqrt(width))
        elif kind == 4.0:
            values = np.asarray(tables[int(extra)])
            places = size + width * np.arange(values.size)
            ends = [0, 1] if v < places[1] else [-2, -1]
            line = np.polyval(np.polyfit(places[ends], values[ends], 1), v)
            total += np.interp(v, places, values) if places[0] <= v <= places[-1] else line
        elif kind == 5.0:
            total += spring(y, size, width)
    return total


def arx_inside(
    x, a, b, against, spring_sizes, terms, constant, dt, bound, begun=(), bends=(), tables=()
):
    """A(q) y = B(q) (x - spring(y)) - G(q) force(y, rate) + constant, within stops.

    ``a`` and ``b`` have a row for all samples, or one each. The force of now is that of the output
    of now, found by Brent's method, if G begins with a positive number. ``begun`` adds to the
    first samples.
    """
    y, held, forces = [], [], []
    low = max([-bound, *(t[2] for t in terms if t[0] == 2.0)])
    high = min([bound, *(t[3] for t in terms if t[0] == 2.0)])
    for k in range(len(x)):
        a_now, b_now = a[k if len(a) > 1 else 0], b[k if len(b) > 1 else 0]
        value = constant + (begun[k] if k < len(begun) else 0.0)
        value -= sum(c * y[k - 1 - i] for i, c in enumerate(a_now) if k - 1 - i >= 0)
        value += sum(b_now[i] * (x[k - i] - held[k - i]) for i in range(1, len(b_now)) if k >= i)
        value += b_now[0] * x[k]
        if b_now[0] != 0:
            value -= b_now[0] * spring(value, *spring_sizes)
        if b_now[0] != 0 and bends:
            value -= b_now[0] * resistance(bends, value, 0.0, tables)
        value -= sum(against[i] * forces[k - i] for i in range(1, len(against)) if k >= i)
        last = y[k - 1] if k > 0 else 0.0

        def away(new, value=value, last=last):
            return new + against[0] * resistance(terms, new, (new - last) / dt, tables) - value

        if against[0] > 0 and away(value) != 0.0:
            reach = 2 * against[0] * sum(abs(t[2]) * (1 + abs(t[4])) for t in terms) + abs(value)
            reach += sum(np.abs(row).max() for row in tables)
            value = brentq(away, value - reach - 1, value + reach + 1, xtol=1e-15, maxiter=1000)
        elif against[0] < 0:
            before = y[k - 2] if k > 1 else 0.0
            value -= against[0] * resistance(terms, last, (last - before) / dt, tables)
        y.append(min(max(value, low), high))
        held.append(spring(y[-1], *spring_sizes) + resistance(bends, y[-1], 0.0, tables))
        forces.append(resistance(terms, y[-1], (y[-1] - last) / dt, tables))
    return y


def limb_inside(position, rate, matrices, terms, tables, dt):
    """``second_order`` with forces of the output and of its rate since the sample before.

    With one of the rate, all are as after a step throughout the step.
    """
    s, out, last = np.zeros(2), [0.0], 0.0
    late = any(t[1] for t in terms)
    for k in range(len(position) - 1):
        phi, before, after = matrices[k]
        force = resistance(terms, s[0], (s[0] - last) / dt, tables)
        now = np.array([position[k] - (0.0 if late else force), rate[k]])
        to = after[:, 0] + (before[:, 0] if late else 0.0)
        rest = phi @ s + before @ now + after @ np.array([position[k + 1], rate[k + 1]])
        last = s[0]

        def away(y, rest=rest[0], by=to[0], last=last):
            return y + by * resistance(terms, y, (y - last) / dt, tables) - rest

        reach = 1.0
        while away(rest[0] - reach) * away(rest[0] + reach) > 0:
            reach *= 2
        y = brentq(away, rest[0] - reach, rest[0] + reach, xtol=1e-15, maxiter=1000)
        s = rest - to * resistance(terms, y, (y - last) / dt, tables)
        s[0] = y
        out.append(y)
    return out


def rubbing(position, rate, matrices, omega, zeta, friction, stiffness, bound):
    """As ``second_order`` with an explicit spring, and a force that is held over each step.

    The force brings the rate y' = companion - 2 zeta omega y + omega^2 r at the end of the step to
    zero, or as near as ``friction`` allows.
    """
    s, out = np.zeros(2), [0.0]
    for k in range(len(position) - 1):
        phi, before, after = matrices[k]
        force = spring(s[0], *stiffness)
        now = np.array([position[k] - force, rate[k]])
        then = np.array([position[k + 1] - force, rate[k + 1]])
        free = phi @ s + before @ now + after @ then
        of_force = (before + after) @ np.array([1.0, 0.0])
        to_rate = np.array([-2 * zeta[k] * omega[k], 1.0])
        speed = to_rate @ free + omega[k] ** 2 * rate[k + 1]
        held = np.clip(speed / (to_rate @ of_force), -friction, friction)
        s = free - held * of_force
        s[0] = np.clip(s[0], -bound, bound)
        out.append(s[0])
    return out
