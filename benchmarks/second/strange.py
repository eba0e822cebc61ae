"""One step of what a person does by no catalogue; ``loop.py`` calls it where it acts.

Open it for the equations of ``forms_strange.py``. Numbers a to d of a form are ``s_a`` to ``s_d``;
``m`` is its memory, three zeros at first.
"""

import numba
import numpy as np

(
    RECENT,
    FADING,
    POSITION,
    DELAY_OF_SIZE,
    DELAY_OF_RATE,
    RATE_THRESHOLD,
    RATE_STEPS,
    MOVING_THRESHOLD,
    GROWING,
    PRODUCT,
    PULSES,
    SMALL_INTEGRAL,
    MODES,
    PEAKS,
    HYSTERESIS,
    HILL,
    DIRECTION,
    OFFSET,
    ACTIVATION,
    COCONTRACTION,
) = range(1, 21)


@numba.njit(cache=True, nogil=True)
def bounded(v, low, high):
    """v within limits."""
    return min(max(v, low), high)


@numba.njit(cache=True, nogil=True)
def without(v, width):
    """v less its first ``width``."""
    return np.sign(v) * max(abs(v) - width, 0.0)


@numba.njit(cache=True, nogil=True)
def lateness(p, m, error, k, steps, dt):
    """The delay in steps, of a person whose delay hangs on the error."""
    code = int(p.strange)
    if code != DELAY_OF_SIZE and code != DELAY_OF_RATE and code != MODES:
        return steps
    i = max(k - int(steps), 0)
    if code == MODES:  # mode 1 above b, until below .6 b; c: by how much mode 1 is sooner (s)
        if abs(error[i]) > p.s_b:
            m[0] = 1.0
        elif abs(error[i]) < 0.6 * p.s_b:
            m[0] = 0.0
        return max(steps + (0.5 - m[0]) * p.s_c / dt, 1.0)
    # a: change (s) from none of the signal to much of it, b: its unit, c: lag (s)
    signal = error[i] if code == DELAY_OF_SIZE else (error[i] - error[max(i - 1, 0)]) / dt
    m[0] += (abs(signal) / p.s_b - m[0]) * dt / p.s_c
    return max(steps + p.s_a * (m[0] / (1.0 + m[0]) - 0.45) / dt, 1.0)


@numba.njit(cache=True, nogil=True)
def sense(p, m, xs, k, steps, e, v, dt):
    """Delayed error and rate as such a person takes them."""
    code = int(p.strange)
    if code == RECENT:  # a: exponent, b: unit, c: time (s) over which the size is felt
        m[0] = abs(e) if k == 0 else m[0] + (abs(e) - m[0]) * dt / p.s_c
        gain = bounded((m[0] / p.s_b + 1e-9) ** p.s_a, 0.2, 1.7)
        return gain * e, gain * v
    if code == FADING:  # a: share that is left, c: time (s) since the error changed its sign
        m[1] = m[1] + dt if e * m[0] > 0 else 0.0
        m[0] = e
        gain = (p.s_a + (1.0 - p.s_a) * np.exp(-m[1] / p.s_c)) / (0.4 + 0.6 * p.s_a)
        return gain * e, gain * v
    if code == POSITION:  # a: fall, b: unit of x, c: where it is largest, in units
        away = xs[max(k - int(steps), 0)] / p.s_b - p.s_c
        gain = bounded((1.0 + p.s_a) / (1.0 + p.s_a * away * away), 0.15, 1.6)
        return gain * e, gain * v
    if code == RATE_THRESHOLD:
        return e, without(v, p.s_a)
    if code == RATE_STEPS:
        return e, p.s_a * np.round(v / p.s_a)
    if code == MOVING_THRESHOLD:  # a: share of the recent size, c: time (s)
        m[0] = abs(e) if k == 0 else m[0] + (abs(e) - m[0]) * dt / p.s_c
        seen = abs(without(e, p.s_a * m[0])) / (abs(e) + 1e-9)
        return seen * e, seen * v
    if code == GROWING:  # a: how much more lead while the error grows, and less while it shrinks
        return e, v * (1.0 + p.s_a if e * v > 0 else 1.0 - p.s_a)
    if code == PRODUCT:  # a: share, b: unit of e, c: of v
        return e + p.s_a * p.s_b * bounded(e * v / (p.s_b * p.s_c), -2.5, 2.5), v
    if code == PULSES:  # a: share, b: threshold, c: refractory time (s), d: length of a pulse (s)
        m[0] += dt
        if abs(e) > p.s_b and m[0] > p.s_c:
            m[0], m[1] = 0.0, e
        pulse = m[1] * np.sin(np.pi * m[0] / p.s_d) ** 2 if m[0] < p.s_d else 0.0
        return (1.0 - 0.6 * p.s_a) * e + 1.5 * p.s_a * pulse, v
    if code == SMALL_INTEGRAL:  # a: gain (1/s), b: below which it adds up, c: forgets (s) above
        m[0] = m[0] + e * dt if abs(e) < p.s_b else m[0] * (1.0 - dt / p.s_c)
        return e + p.s_a * m[0], v
    if code == MODES:  # a: how much more in mode 1, and less in the other
        gain = 1.0 + p.s_a if m[0] > 0 else 1.0 - p.s_a
        return gain * e, gain * v
    if code == PEAKS:  # a: share, b: least way between peaks
        m[1] += (v - m[1]) * dt / 0.04
        if m[1] * m[2] < 0 and abs(e - m[0]) > p.s_b:
            m[0] = e
        m[2] = m[1]
        return e + p.s_a * (m[0] - e), v
    if code == HYSTERESIS:  # a: share, b: half width, c: leaks (s)
        inside = abs(m[0] - e) < p.s_b
        m[0] = bounded(m[0] * (1.0 - dt / p.s_c), e - p.s_b, e + p.s_b)
        return e + p.s_a * (m[0] - e), v * (1.0 - p.s_a) if inside else v
    if code == COCONTRACTION:  # c: time (s) over which the size is felt
        m[0] = abs(e) if k == 0 else m[0] + (abs(e) - m[0]) * dt / p.s_c
    return e, v


@numba.njit(cache=True, nogil=True)
def urge(p, m, c, limb, dt):
    """The command to the limb; limb: its position and rate."""
    code = int(p.strange)
    if code == HILL:  # b: rate at which a muscle that shortens has no force
        along = limb[1] * np.sign(c) / p.s_b
        if along > 0:
            return c * (1.0 - min(along, 0.95)) / (1.0 + 3.0 * along)
        return c * (1.0 + 0.4 * min(-3.0 * along, 1.0))
    if code == DIRECTION:  # a: share, b: unit; d: 1 outward against back, 0 right against left
        way = limb[0] * limb[1] if p.s_d > 0 else limb[1]
        return c * (1.0 + p.s_a * np.tanh(way / p.s_b))
    if code == OFFSET:  # a: gain (1/s), b: above which it is remembered, c: forgets (s)
        m[0] += dt * (p.s_a * without(c, p.s_b) - m[0] / p.s_c)
        return c + m[0]
    if code == ACTIVATION:  # b: rise (s), c: release (s) of each of two muscles
        for i in range(2):
            pull = max(c if i == 0 else -c, 0.0)
            m[i] += (pull - m[i]) * dt / (p.s_b if pull > m[i] else p.s_c)
        return m[0] - m[1]
    if code == COCONTRACTION:  # a: stiffness gained, b: unit of the recent error
        more = bounded(p.s_a * (m[0] / p.s_b - 1.0), -0.8, 3.0)
        return c + more * (c - limb[0])
    return c
