"""The closed loop, step by step at 600 Hz: element, eye, delay, equalisation, command, limb, stick.

Open it for what a person of this trial does in one step. What depends on outside signals alone
(target, disturbance, remnant, other channels, courses of gain and delay) comes in as an array; what
depends on the loop is done here. With ``answer`` the loop is cut: recorded x and target go in, and
the person's reply without remnant comes out.
"""

import numba
import numpy as np

RATE = 600.0
PARAMETERS = (
    # equalisation: c = gain (e + lead e' + ...) of the delayed error; (1 + second_lead s) beside it
    *("gain", "lead", "second_lead", "integral", "has_filter"),
    # static functions, a code and two numbers each: at the eye, on the delayed error, on the
    # equalised command, on the command to the limb, in the stick
    *("eye", "eye_a", "eye_b", "late", "late_a", "late_b", "equal", "equal_a", "equal_b"),
    *("command", "command_a", "command_b", "stick", "stick_a", "stick_b"),
    # paths beside the error: gains on x and x', on the motion channel, on the rate of one sign
    *("x_gain", "v_gain", "x_delay", "motion", "motion_gain", "motion_delay"),
    *("reflex", "reflex_sign", "reflex_delay"),
    # intermittent: 1 clock, 2 event; hold: 0 zero order, 1 extrapolates, 2 decays as the loop does
    *("intermittent", "period", "threshold", "hold", "decay"),
    *("omega", "zeta", "hardening", "friction", "breakaway"),
    *("rate_command", "rate_stick", "play", "stick_band", "jump"),
)
PERSON = np.dtype([(name, "f8") for name in PARAMETERS])

# codes of static functions
(
    NONE,
    DEAD_ZONE,
    INDIFFERENCE,
    ASYMMETRIC,
    HALF_WAVE,
    CUBIC,
    POWER,
    CLIP,
    TANH,
    STEPS,
    PLUS_ABS,
    CLIP_TOP,
) = range(12)


@numba.njit(cache=True, nogil=True)
def static(code, a, b, v):
    """The static functions; a is a width or a strength in the units of v, b a second number."""
    if code == NONE:
        return v
    if code == DEAD_ZONE:  # dead zone
        return v - a if v > a else (v + a if v < -a else 0.0)
    if code == INDIFFERENCE:  # indifference threshold: nothing below it, the whole above
        return v if abs(v) > a else 0.0
    if code == ASYMMETRIC:  # another gain for each sign
        return v * (1 + a) if v > 0 else v * (1 - a)
    if code == HALF_WAVE:  # one sign only, the other with the share b
        return v if v * a > 0 else b * v
    if code == CUBIC:
        return v * (1 + a * v * v)
    if code == POWER:  # power law of exponent a about the scale b
        return np.sign(v) * b * (abs(v) / b) ** a
    if code == CLIP:
        return min(max(v, -a), a)
    if code == TANH:
        return a * np.tanh(v / a)
    if code == STEPS:
        return a * np.round(v / a)
    if code == PLUS_ABS:
        return v + a * abs(v)
    return min(v, a)  # a stop on one side


@numba.njit(cache=True, nogil=True)
def at(past, k, steps):
    """The value ``steps`` (a fraction is allowed) before k; before the first sample the first."""
    where = k - steps
    if where <= 0:
        return past[0]
    low = int(where)
    part = where - low
    if low >= k:
        return past[k]
    return past[low] * (1 - part) + past[low + 1] * part


@numba.njit(cache=True, nogil=True)
def simulate(
    people,
    start,
    plant,
    column,
    shape,
    f,
    seen,
    d,
    before,
    after,
    tau,
    g_error,
    g_all,
    awake,
    x_given,
    answer,
):
    """Columns of the result (n, 6): x, e, u, q (limb), x', command; f is the target, ``seen`` what
    the error is taken of.
    """
    p = people[0]
    dt = 1.0 / 600.0
    n = len(f)
    out = np.zeros((n, 6))
    error = np.zeros(n)
    plain = np.zeros(n)
    xs = np.zeros(n)
    vs = np.zeros(n)
    ms = np.zeros(n)
    x, v = start[0], start[1]
    q, qd, u, played, jumped, commanded, held_command = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    summed, e_held, v_held, since = 0.0, 0.0, 0.0, 1e9
    w1, w2, last_v = 0.0, 0.0, v
    stuck = False
    for k in range(n):
        if answer:
            x = x_given[k]
            v = (x_given[min(k + 1, n - 1)] - x_given[max(k - 1, 0)]) / (2 * dt)
        xs[k] = x
        vs[k] = v
        ms[k] = v if p.motion < 2 else (v - last_v) / dt
        last_v = v
        plain[k] = seen[k] - x
        error[k] = static(int(p.eye), p.eye_a, p.eye_b, plain[k])
        steps = tau[k] / dt
        e_now = at(error, k, steps)
        v_now = (e_now - at(error, k, steps + 1.0)) / dt
        if p.intermittent > 0:
            since += dt
            if p.intermittent == 1:
                sample = since >= p.period
            else:
                if p.hold == 2:
                    expected = e_held * np.exp(-p.decay * since)
                elif p.hold == 1:
                    expected = e_held + v_held * min(since, 0.5)
                else:
                    expected = e_held
                sample = since >= p.period and abs(e_now - expected) > p.threshold
            if sample or k == 0:
                e_held, v_held, since = e_now, v_now, 0.0
            if p.hold == 1:
                e_now, v_now = e_held + v_held * min(since, 0.5), v_held
            elif p.hold == 2:
                e_now = e_held * np.exp(-p.decay * since)
                v_now = v_held * np.exp(-p.decay * since)
            else:
                e_now, v_now = e_held, v_held
        e_late = static(int(p.late), p.late_a, p.late_b, e_now)
        c = p.gain * (e_late + p.lead * v_now)
        if p.second_lead != 0.0:
            a_now = (
                at(error, k, steps) - 2 * at(error, k, steps + 1) + at(error, k, steps + 2)
            ) / (dt * dt)
            c += p.gain * p.second_lead * (v_now + p.lead * a_now)
        if p.integral != 0.0:
            summed += e_now * dt
            c += p.integral * summed
        c = static(int(p.equal), p.equal_a, p.equal_b, c)
        if p.has_filter > 0:
            w0 = c - shape[4] * w1 - shape[5] * w2
            c = shape[0] * w0 + shape[1] * w1 + shape[2] * w2
            w2, w1 = w1, w0
        c *= g_error[k]
        if p.x_gain != 0.0 or p.v_gain != 0.0:
            c -= p.x_gain * at(xs, k, p.x_delay / dt) + p.v_gain * at(vs, k, p.x_delay / dt)
        if p.motion > 0:
            c -= p.motion_gain * at(ms, k, p.motion_delay / dt)
        if p.reflex != 0.0:
            r = (
                p.reflex_sign
                * (at(plain, k, p.reflex_delay / dt) - at(plain, k, p.reflex_delay / dt + 1))
                / dt
            )
            if r > 0:
                c += p.reflex * p.reflex_sign * r
        c *= g_all[k]
        if awake[k] > 0:
            held_command = c
        else:
            c = held_command if awake[k] == 0 else 0.0
        c += before[k]
        c = static(int(p.command), p.command_a, p.command_b, c)
        if p.rate_command > 0:
            most = p.rate_command * dt
            commanded += min(max(c - commanded, -most), most)
            c = commanded
        for _ in range(2):  # the limb, half a step at a time
            force = p.omega**2 * (c - q - p.hardening * q**3) - 2 * p.zeta * p.omega * qd
            if p.friction > 0:  # Karnopp: stuck until the force exceeds what breaks away
                if stuck and abs(force) <= p.breakaway:
                    qd = 0.0
                else:
                    stuck = False
                    way = np.sign(qd) if qd != 0.0 else np.sign(force)
                    fresh = qd + 0.5 * dt * (force - p.friction * way)
                    if qd != 0.0 and fresh * qd <= 0:
                        fresh, stuck = 0.0, True
                    qd = fresh
            else:
                qd += 0.5 * dt * force
            q += 0.5 * dt * qd
        want = q + after[k]
        if p.play > 0:  # backlash: the stick is pushed by either flank
            played = min(max(played, want - p.play), want + p.play)
            want = played
        if p.stick_band > 0:  # stiction of the stick: rests within the band, then jumps
            if abs(want - jumped) > p.stick_band:
                jumped = want - np.sign(want - jumped) * (p.stick_band - p.jump)
            want = jumped
        want = static(int(p.stick), p.stick_a, p.stick_b, want)
        if p.rate_stick > 0:
            most = p.rate_stick * dt
            u += min(max(want - u, -most), most)
        else:
            u = want
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = x, f[k] - x, u, q, v, c
        if not answer:
            drive = u + d[k]
            x_next = plant[0, 0] * x + plant[0, 1] * v + column[0] * drive
            v = plant[1, 0] * x + plant[1, 1] * v + column[1] * drive
            x = min(max(x_next, -1e6), 1e6)
    return out
