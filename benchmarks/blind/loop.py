"""The trial's own loop: an operator with hidden effects and a controlled element, step by step.

It shares no code with the package and no scheme with its simulators: both filters are integrated by
the trapezoidal rule at 500 Hz, delays are fractional, and everything nonlinear acts in its place.
"""

from __future__ import annotations

import numpy as np
from numba import njit

RATE = 500  # Hz
DT = 1 / RATE

# Columns of the table over time.
F_T, F_D, NOISE, K_C, OMEGA_B, PLATFORM = 0, 1, 2, 3, 4, 5
K_E, K_EDOT, TAU, WEIGHT, FROZEN, TICK, C_EXTRA, U_EXTRA = 6, 7, 8, 9, 10, 11, 12, 13
N_COLUMNS = 14

# Maps of the error, and operations on the output: a row is the kind and its numbers.
DEAD_ZONE, JUMP, SMOOTH_DEAD_ZONE, ASYMMETRY, SMOOTH_ASYMMETRY, HALF_WAVE = 1, 2, 3, 4, 5, 6
SOFT_HALF_WAVE, POWER_ADDED, POWER, SINH, ASINH = 7, 8, 9, 10, 11
CLIP, TANH, RATE_LIMIT, LAGGED_RATE_LIMIT, PLAY, ROUNDED_PLAY = 1, 2, 3, 4, 5, 6
STICK_JUMP, STICK_SLIP, ROUND, FLOOR, UNEVEN, PLAYS = 7, 8, 9, 10, 11, 12
N_PLAYS = 4
# Where a curve given by a table acts; a row is the place, the first abscissa, the step, the values.
AT_INPUT, AT_COMMAND, AT_SPRING, AT_RATE = 1, 2, 3, 4

# Numbers of the other paths.
OUT_GAIN, OUT_RATE, OUT_DELAY, MOTION_GAIN, MOTION_DELAY, MOTION_LEAD, MOTION_LAG = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
)
INTEGRAL, LEAK, ABS_GAIN, ABS_DELAY, ABS_ROUND, MOTION_OF_X = 7, 8, 9, 10, 11, 12
N_PATHS = 13

# Sample and hold: kind, hold time (s), threshold. Neuromuscular filter and what stands before it.
CLOCK, EVENT_OF_COMMAND, EVENT_OF_ERROR = 1, 2, 3
OMEGA_NM, ZETA_NM, CUBIC, QUADRATIC, LEAD, B0, B1, B2, A1, A2 = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
BRISTLE, FRICTION = 10, 11
N_MUSCLE = 12

# Rows of what comes out.
E, X, ACC, U = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def _at(signal: np.ndarray, position: float) -> float:
    """A signal between its samples; before it begins its first value holds."""
    if position <= 0:
        return signal[0]
    i = int(position)
    return signal[i] + (position - i) * (signal[i + 1] - signal[i])


@njit(cache=True, nogil=True)
def _curve(x: float, row: np.ndarray) -> float:
    """The value of a tabled curve; beyond its ends it goes on straight."""
    position = (x - row[1]) / row[2]
    i = min(max(int(position), 0), len(row) - 5)
    return row[3 + i] + (position - i) * (row[4 + i] - row[3 + i])


@njit(cache=True, nogil=True)
def _seen(e: float, maps: np.ndarray, curves: np.ndarray | None) -> float:
    """The error behind the static maps of the operator's input."""
    if curves is not None:
        for i in range(len(curves)):
            if curves[i, 0] == AT_INPUT:
                e = _curve(e, curves[i])
    for row in maps:
        kind, a, b = int(row[0]), row[1], row[2]
        if kind == DEAD_ZONE:
            e = np.sign(e) * max(abs(e) - a, 0.0)
        elif kind == JUMP:
            e = e if abs(e) > a else 0.0
        elif kind == SMOOTH_DEAD_ZONE:
            e = e - a * np.tanh(e / a)
        elif kind == ASYMMETRY:
            e = e + a * max(abs(e) - b, 0.0)
        elif kind == SMOOTH_ASYMMETRY:
            e = e + a * e * np.tanh(e / b)
        elif kind == HALF_WAVE:
            e = e if a * e > 0 else b * e
        elif kind == SOFT_HALF_WAVE:
            e = 0.5 * (e + a * (np.sqrt(e * e + b * b) - b))
        elif kind == POWER_ADDED:
            size = min(abs(e), row[3])  # where it softens, the slope stays positive
            e = np.sign(e) * (abs(e) + a * size**b)
        elif kind == POWER:
            e = np.sign(e) * a * abs(e / a) ** b
        elif kind == SINH:
            e = a * np.sinh(e / a)
        elif kind == ASINH:
            e = a * np.arcsinh(e / a)
    return e


@njit(cache=True, nogil=True)
def _play(v: float, u: float, gap: float) -> float:
    return min(max(u, v - gap), v + gap)


@njit(cache=True, nogil=True)
def _put_out(v: float, row: np.ndarray, state: np.ndarray) -> float:
    """The output behind one operation; ``state`` keeps its last positions."""
    kind, a, b = int(row[0]), row[2], row[3]
    u = state[0]
    if kind == CLIP:
        u = min(max(v, a), b)
    elif kind == TANH:
        u = a * np.tanh(v / a)
    elif kind == RATE_LIMIT:
        u = min(max(v, u - a * DT), u + a * DT)
    elif kind == LAGGED_RATE_LIMIT:
        u += DT * min(max((v - u) / b, -a), a)
    elif kind == PLAY:
        u = _play(v, u, a)
    elif kind == ROUNDED_PLAY:
        for i in range(3):
            state[1 + i] = _play(v, state[1 + i], a * (0.5 + 0.5 * i))
        u = (state[1] + state[2] + state[3]) / 3
    elif kind == STICK_JUMP:
        if abs(v - u) > a:  # to v - b as it was when it broke away, within this sample
            u += np.sign(v - u) * (a - b)
    elif kind == STICK_SLIP:
        if state[1] == 0 and abs(v - u) > a:
            state[1] = np.sign(v - u)
        if state[1] != 0:
            move = state[1] * (v - u) - b
            if move < 0:
                state[1] = 0.0
            else:
                u += state[1] * move * DT / row[4]
    elif kind == ROUND:
        u = a * np.round(v / a)
    elif kind == FLOOR:
        u = a * np.floor(v / a)
    elif kind == UNEVEN:
        u = np.sign(v) * a * np.round(abs(v / a) ** b) ** (1 / b)
    elif kind == PLAYS:  # a straight part, and plays of unequal gaps and weights
        u = a * v
        for i in range(N_PLAYS):
            state[1 + i] = _play(v, state[1 + i], row[3 + 2 * i])
            u += row[4 + 2 * i] * state[1 + i]
    state[0] = u
    return u


@njit(cache=True, nogil=True)
def run_loop(
    table: np.ndarray,
    maps: np.ndarray,
    outputs: np.ndarray,
    paths: np.ndarray,
    hold: np.ndarray,
    muscle: np.ndarray,
    curves: np.ndarray | None,
    sections: np.ndarray,
    start: int,
    out: np.ndarray,
    closed: bool,
) -> bool:
    """One run: fill the rows e, x, acceleration and u of ``out``; if not closed, only the last.

    False where the loop runs away. The table's row k is the instant k DT; the recording begins
    with the row ``start``. Without ``curves``, a variant is compiled that has neither them nor
    sections nor friction, as most effects need none.
    """
    n = len(table)
    e, x, acc = out[E], out[X], out[ACC]
    w, zeta = muscle[OMEGA_NM], muscle[ZETA_NM]
    h = DT / 2
    below = 1 + 2 * zeta * w * h + (w * h) ** 2
    above = 1 - 2 * zeta * w * h - (w * h) ** 2
    state = np.zeros((len(outputs), 1 + N_PLAYS))
    past = np.zeros((len(sections), 4))
    v = vd = xd = drive = trim = held = held_e = sensed = moved = rubbing = 0.0
    in_1 = in_2 = out_1 = out_2 = 0.0
    since = 1e9
    if closed:
        e[0], x[0], acc[0] = table[0, F_T], 0.0, 0.0
    out[U, 0] = 0.0
    for k in range(1, n):
        now = table[k]
        back = k - now[TAU] * RATE
        later = _seen(_at(e, back + 0.5), maps, curves)
        earlier = _seen(_at(e, back - 0.5), maps, curves)
        c = now[K_E] * 0.5 * (later + earlier) + now[K_EDOT] * (later - earlier) * RATE
        c += now[C_EXTRA]
        if paths[INTEGRAL] != 0 and k > start:
            trim += DT * (_at(e, back) - trim * paths[LEAK])
            c += paths[INTEGRAL] * trim
        if paths[ABS_GAIN] != 0:
            level = _at(e, back if paths[ABS_DELAY] < 0 else k - paths[ABS_DELAY] * RATE)
            c += paths[ABS_GAIN] * np.sqrt(level**2 + paths[ABS_ROUND] ** 2)
        if paths[OUT_GAIN] != 0 or paths[OUT_RATE] != 0:
            place = k - paths[OUT_DELAY] * RATE
            c -= paths[OUT_GAIN] * _at(x, place)
            c -= paths[OUT_RATE] * (_at(x, place + 0.5) - _at(x, place - 0.5)) * RATE
        if paths[MOTION_GAIN] != 0:
            last, moved = moved, _at(acc, k - paths[MOTION_DELAY] * RATE)
            T_1, T_2 = paths[MOTION_LEAD], paths[MOTION_LAG]
            if T_2 > 0:
                sensed = ((T_2 - h) * sensed + (T_1 + h) * moved - (T_1 - h) * last) / (T_2 + h)
            else:
                sensed = moved
            c -= paths[MOTION_GAIN] * sensed
        c *= now[WEIGHT]
        if hold[0] > 0:
            since += DT
            if hold[0] == CLOCK:
                fresh = now[TICK] > 0
            elif hold[0] == EVENT_OF_COMMAND:
                fresh = abs(c - held) > hold[2] and since >= hold[1]
            else:
                seen = 0.5 * (later + earlier)
                fresh = abs(seen - held_e) > hold[2] and since >= hold[1]
            if fresh:
                held, held_e, since = c, 0.5 * (later + earlier), 0.0
            c = held
        if curves is not None:
            for i in range(len(curves)):
                if curves[i, 0] == AT_COMMAND:
                    c = _curve(c, curves[i])
        filtered = muscle[B0] * c + muscle[B1] * in_1 + muscle[B2] * in_2
        filtered -= muscle[A1] * out_1 + muscle[A2] * out_2
        in_2, in_1, out_2, out_1 = in_1, c, out_1, filtered
        if curves is not None:
            for i in range(len(sections)):
                b, was, put = sections[i], past[i], filtered
                filtered = b[0] * put + b[1] * was[0] + b[2] * was[1]
                filtered -= b[3] * was[2] + b[4] * was[3]
                was[1], was[0], was[3], was[2] = was[0], put, was[2], filtered
        ahead = v + DT * vd
        before, drive = drive, filtered
        drive -= muscle[CUBIC] * ahead**3 + muscle[QUADRATIC] * ahead * abs(ahead)
        if curves is not None:
            for i in range(len(curves)):
                if curves[i, 0] == AT_SPRING:
                    drive -= _curve(ahead, curves[i])
                elif curves[i, 0] == AT_RATE:
                    drive -= _curve(vd, curves[i])
            if muscle[FRICTION] > 0:  # Dahl's: a force that grows with the way since a turn
                rubbing += muscle[BRISTLE] * DT * (vd - abs(vd) * rubbing / muscle[FRICTION])
                drive -= rubbing
        if now[FROZEN] > 0:
            vd = 0.0
        else:
            faster = (vd * above + h * w * w * (before + drive - 2 * v)) / below
            v += h * (vd + faster)
            vd = faster
        u = v + muscle[LEAD] * vd + now[U_EXTRA]
        for i in range(len(outputs)):
            if outputs[i, 1] == 0:
                u = _put_out(u, outputs[i], state[i])
        u += now[NOISE]
        for i in range(len(outputs)):
            if outputs[i, 1] == 1:
                u = _put_out(u, outputs[i], state[i])
        out[U, k] = u
        if closed:
            last_row = table[k - 1]
            push = last_row[K_C] * (out[U, k - 1] + last_row[F_D]) + now[K_C] * (u + now[F_D])
            slow = now[OMEGA_B] * h
            speed = (xd * (1 - slow) + h * push) / (1 + slow)
            x[k] = x[k - 1] + h * (xd + speed)
            xd = speed
            e[k] = now[F_T] - x[k]
            own = now[K_C] * (u + now[F_D]) - now[OMEGA_B] * xd
            acc[k] = paths[MOTION_OF_X] * own + now[PLATFORM]
            if not abs(x[k]) < 1e6:
                return False
    return True
