"""Compiled free runs with forces of the output and its rate inside: of ARX systems, and limbs."""

from __future__ import annotations

import numpy as np
from numba import njit

from .kernel import OPTIONS, inner, kernel

# Kinds of terms, their first number. SHARP is friction with a line in place of the tanh.
# TABLE is a force given by its values at equal distances, SPRING one that stiffens.
FRICTION, ROOT, STOPS, SHARP, TABLE, SPRING = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
N_BRACKETED = 60  # steps of Newton's rule or bisection, at most
N_DOUBLED = 8  # of the bracket
N_LINES = 8  # steps of Newton's rule along a table, before a bracket


@njit(**OPTIONS, forceinline=True)
def _resistance(terms, tables, value, rate):
    """Sum of the forces at an output and its rate, and its slopes by both.

    A table is linear between its values, and beyond them as in its first and last interval.
    """
    force = by_value = by_rate = 0.0
    for i in range(terms.shape[0]):
        kind, of_rate, size, width, extra, fall = (
            terms[i, 0],
            terms[i, 1],
            terms[i, 2],
            terms[i, 3],
            terms[i, 4],
            terms[i, 5],
        )
        if kind in (FRICTION, SHARP):
            v = rate if of_rate != 0.0 else value
            if kind == SHARP:
                t = min(max(v / width, -1.0), 1.0)
                rise = 1.0 / width if abs(t) < 1.0 else 0.0
            else:
                t = np.tanh(v / width)
                rise = (1.0 - t * t) / width
            above = extra * np.exp(-((v / fall) ** 2)) if extra != 0.0 else 0.0
            force += size * t * (1.0 + above)
            slope = size * (rise * (1.0 + above) - t * above * 2.0 * v / (fall * fall))
            if of_rate != 0.0:
                by_rate += slope
            else:
                by_value += slope
        elif kind == ROOT:
            head = value - extra
            if head > 0.0:  # a line below ``width``, where a root would be too steep
                root = np.sqrt(head) if head > width else head / np.sqrt(width)
                force += size * root
                by_value += size * (0.5 / root if head > width else 1.0 / np.sqrt(width))
        elif kind == TABLE:
            row = int(extra)
            at = ((rate if of_rate != 0.0 else value) - size) / width
            i = int(min(max(at, 0.0), tables.shape[1] - 2.0))
            rise = tables[row, i + 1] - tables[row, i]
            force += tables[row, i] + (at - i) * rise
            if of_rate != 0.0:
                by_rate += rise / width
            else:
                by_value += rise / width
        elif kind == SPRING:
            force += (size * value * value + width * abs(value)) * value
            by_value += 3 * size * value * value + 2 * width * abs(value)
    return force, by_value, by_rate


@kernel("f8[:,::1], f8[:,::1], f8[::1], f8[::1]", 1)
def resistances(terms, tables, value, rate):
    """Sum of the forces at each of several outputs and their rates."""
    out = np.empty(value.size)
    for k in range(value.size):
        out[k] = _resistance(terms, tables, value[k], rate[k])[0]
    return out


@inner
def _balanced(whole, gain, terms, tables, last, before, dt):
    """The output y with y + gain force(y, (y - last) / dt) = whole, after last and before."""
    if tables.shape[0] > 0:  # made of lines: Newton's rule ends at once where they are
        y = 2.0 * last - before
        for _ in range(N_LINES):
            force, by_value, by_rate = _resistance(terms, tables, y, (y - last) / dt)
            slope = 1.0 + gain * (by_value + by_rate / dt)
            if not slope > 0.0:
                break
            step = (y + gain * force - whole) / slope
            y -= step
            if abs(step) <= 1e-9 * (abs(whole) + abs(y)):
                return y
    force, _, _ = _resistance(terms, tables, whole, (whole - last) / dt)
    if force == 0.0:
        return whole
    other = whole - gain * force
    for _ in range(N_DOUBLED):  # a force that falls with the rate may hold the root farther away
        at_other, _, _ = _resistance(terms, tables, other, (other - last) / dt)
        if (other + gain * at_other - whole) * force <= 0.0:
            break
        other = whole - 2.0 * (whole - other)
    low, high = min(whole, other), max(whole, other)
    y = last if low < last < high else 0.5 * (low + high)
    for _ in range(N_BRACKETED):
        force, by_value, by_rate = _resistance(terms, tables, y, (y - last) / dt)
        away = y + gain * force - whole
        if away == 0.0:
            break
        if away > 0.0:
            high = y
        else:
            low = y
        step = away / (1.0 + gain * (by_value + by_rate / dt))
        new = y - step
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - y) <= 1e-13 * (abs(whole) + abs(y)) + 1e-300:
            y = new
            break
        y = new
    return y


@kernel(
    "f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, "
    "f8[:,::1], f8, f8",
    1,
)
def arx_inside(x, a, b, against, spring, bends, terms, tables, constant, begun, dt, bound):
    """Output of A(q) y = B(q) (x - spring(y)) - G(q) force(y, rate of y) + constant.

    ``begun`` of shape (n_first, n_runs) adds to the first samples what led there; without any it
    begins at rest. a and b are of shape (1 or n_samples, n_lags), b and ``against``, the
    coefficients of G, from lag 0 on; spring(y) = spring[0] y^3 + spring[1] y abs(y), and the forces
    of ``bends``, which has rows like those of ``terms``. The rows of
    ``terms`` are forces or stops: (FRICTION or SHARP, of the rate, size, width, excess at rest,
    rate of its fall), (ROOT, 0, size, width of the line at zero, level, 0), (STOPS, 0, low, high,
    0, 0), (TABLE, of the rate, first place, distance of places, row of ``tables``, 0). The force of
    now is that of the output of now, so that friction holds what rests; where G begins with a
    negative number it is that of the output before.
    """
    n, runs = x.shape
    na, nb, ng = a.shape[1], b.shape[1], against.size
    out = np.empty((n, runs))
    w = np.empty((n, runs))
    forces = np.zeros((n, runs))
    low, high = -bound, bound
    forced = False
    for i in range(terms.shape[0]):
        if terms[i, 0] == STOPS:
            low, high = max(low, terms[i, 2]), min(high, terms[i, 3])
        else:
            forced = True
    cubic, square = spring[0], spring[1]
    bent = bends.shape[0] > 0
    stiff = cubic != 0.0 or square != 0.0
    varies_a, varies_b = a.shape[0] > 1, b.shape[0] > 1
    for k in range(n):
        ka, kb = k if varies_a else 0, k if varies_b else 0
        for j in range(runs):
            past = constant
            if k < begun.shape[0]:
                past += begun[k, j]
            for i in range(min(na, k)):
                past -= a[ka, i] * out[k - 1 - i, j]
            for i in range(1, min(nb, k + 1)):
                past += b[kb, i] * w[k - i, j]
            last = out[k - 1, j] if k > 0 else 0.0
            now = x[k, j]
            value = past + b[kb, 0] * now
            if stiff and b[kb, 0] != 0.0:
                value = min(max(value, -bound), bound)
                value -= b[kb, 0] * (cubic * value**3 + square * value * abs(value))
            if bent and b[kb, 0] != 0.0:
                value = min(max(value, -bound), bound)
                value -= b[kb, 0] * _resistance(bends, tables, value, 0.0)[0]
            if forced:
                for i in range(1, min(ng, k + 1)):
                    value -= against[i] * forces[k - i, j]
                value = min(max(value, -bound), bound)
                before = out[k - 2, j] if k > 1 else 0.0
                if against[0] > 0.0:
                    value = _balanced(value, against[0], terms, tables, last, before, dt)
                elif against[0] < 0.0:
                    value -= against[0] * _resistance(terms, tables, last, (last - before) / dt)[0]
            value = min(max(value, low), high)
            if forced:
                forces[k, j] = _resistance(terms, tables, value, (value - last) / dt)[0]
            if stiff:
                now -= cubic * value**3 + square * value * abs(value)
            if bent:
                now -= _resistance(bends, tables, value, 0.0)[0]
            w[k, j] = now
            out[k, j] = value
    return out


@kernel("f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8", 1)
def limb_inside(position, rate, matrices, terms, tables, dt, bound):
    """``second_order`` with forces of the output and its rate against the position command.

    ``terms`` are as in ``arx_inside``, but without stops, or (SPRING, 0, cubic, square, 0, 0). The
    rate is that since the sample before. The force at k + 1 is that of the output at k + 1. Between
    samples forces change in lines, but with one of the rate they are all held as at k + 1, because
    friction may be so steep that the steps were unstable otherwise.
    """
    n, runs = position.shape
    out = np.zeros((n, runs))
    z = np.zeros(runs)
    v = np.zeros(runs)
    held = np.full(runs, _resistance(terms, tables, 0.0, 0.0)[0])
    varies = matrices.shape[0] > 1
    held_late = False
    for i in range(terms.shape[0]):
        held_late = held_late or terms[i, 1] != 0.0
    q = matrices[0]
    for k in range(n - 1):
        if varies:
            q = matrices[k]
        a, b, c, d = q[0], q[1], q[2], q[3]
        b0, b1, b2, b3 = q[4], q[5], q[6], q[7]
        c0, c1, c2, c3 = q[8], q[9], q[10], q[11]
        for j in range(runs):
            p0, p1 = position[k, j], position[k + 1, j]
            if not held_late:
                p0 -= held[j]
            r0, r1 = rate[k, j], rate[k + 1, j]
            new = a * z[j] + b * v[j] + b0 * p0 + b1 * r0 + c0 * p1 + c1 * r1
            if abs(z[j]) == bound:  # diverged: it stays at the bound
                out[k + 1, j] = z[j]
                continue
            new = min(max(new, -bound), bound)
            by = b0 + c0 if held_late else c0
            before = out[k - 1, j] if k > 0 else 0.0
            new = _balanced(new, by, terms, tables, z[j], before, dt)
            held[j] = _resistance(terms, tables, new, (new - z[j]) / dt)[0]
            p1 -= held[j]
            if held_late:
                p0 -= held[j]
            if abs(new) < bound:
                v[j] = c * z[j] + d * v[j] + b2 * p0 + b3 * r0 + c2 * p1 + c3 * r1
            else:
                new = bound if new > 0.0 else -bound
            z[j] = new
            out[k + 1, j] = new
    return out
