"""The closed loop, step by step at 600 Hz: element, eye, delay, equalisation, command, limb, stick.

Open it for what a person of this trial does in one step. What depends on outside signals alone
(target, disturbance, remnant, other channels, courses of gain and delay) comes in as an array; what
depends on the loop is done here. With ``answer`` the loop is cut: recorded x and target go in, and
the person's reply without remnant comes out.
"""

import numba
import numpy as np

from .strange import lateness, sense, urge

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
    *("strange", "s_a", "s_b", "s_c", "s_d"),  # a code of ``strange.py`` and four numbers
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
def held(p, memory, e, v, dt, first):
    """Error and rate that an intermittent person acts on; memory: the last sample, its age (s)."""
    memory[2] += dt
    age = memory[2]
    if p.hold == 1:
        expected = memory[0] + memory[1] * min(age, 0.5)
    elif p.hold == 2:
        expected = memory[0] * np.exp(-p.decay * age)
    else:
        expected = memory[0]
    due = age >= p.period and (p.intermittent == 1 or abs(e - expected) > p.threshold)
    if due or first:
        memory[0], memory[1], memory[2] = e, v, 0.0
        return e, v
    if p.hold == 2:
        return expected, memory[1] * np.exp(-p.decay * age)
    return expected, memory[1]


@numba.njit(cache=True, nogil=True)
def equalised(p, error, k, steps, e, v, shape, memory, dt):
    """Command of the error path; memory: the integral of the error, two states of the filter."""
    c = p.gain * (static(int(p.late), p.late_a, p.late_b, e) + p.lead * v)
    if p.second_lead != 0.0:
        bent = at(error, k, steps) - 2 * at(error, k, steps + 1) + at(error, k, steps + 2)
        c += p.gain * p.second_lead * (v + p.lead * bent / (dt * dt))
    if p.integral != 0.0:
        memory[0] += e * dt
        c += p.integral * memory[0]
    c = static(int(p.equal), p.equal_a, p.equal_b, c)
    if p.has_filter > 0:
        fresh = c - shape[4] * memory[1] - shape[5] * memory[2]
        c = shape[0] * fresh + shape[1] * memory[1] + shape[2] * memory[2]
        memory[2], memory[1] = memory[1], fresh
    return c


@numba.njit(cache=True, nogil=True)
def beside(p, xs, vs, ms, plain, k, dt):
    """Command of the paths beside the error: output, motion, reflex."""
    c = 0.0
    if p.x_gain != 0.0 or p.v_gain != 0.0:
        c -= p.x_gain * at(xs, k, p.x_delay / dt) + p.v_gain * at(vs, k, p.x_delay / dt)
    if p.motion > 0:
        c -= p.motion_gain * at(ms, k, p.motion_delay / dt)
    if p.reflex != 0.0:
        steps = p.reflex_delay / dt
        stretch = p.reflex_sign * (at(plain, k, steps) - at(plain, k, steps + 1)) / dt
        c += p.reflex * p.reflex_sign * max(stretch, 0.0)
    return c


@numba.njit(cache=True, nogil=True)
def move_limb(p, limb, c, dt):
    """Position, rate and whether it is stuck, moved in place by half steps under the command c."""
    for _ in range(2):
        force = p.omega**2 * (c - limb[0] - p.hardening * limb[0] ** 3)
        force -= 2 * p.zeta * p.omega * limb[1]
        if p.friction > 0:  # Karnopp: stuck until the force exceeds what breaks away
            if limb[2] > 0 and abs(force) <= p.breakaway:
                limb[1] = 0.0
            else:
                limb[2] = 0.0
                way = np.sign(limb[1]) if limb[1] != 0.0 else np.sign(force)
                fresh = limb[1] + 0.5 * dt * (force - p.friction * way)
                if limb[1] != 0.0 and fresh * limb[1] <= 0:
                    fresh, limb[2] = 0.0, 1.0
                limb[1] = fresh
        else:
            limb[1] += 0.5 * dt * force
        limb[0] += 0.5 * dt * limb[1]


@numba.njit(cache=True, nogil=True)
def move_stick(p, stick, want, dt):
    """u when the hand wants the stick there; stick: u, where its play and its stiction hold it."""
    if p.play > 0:  # backlash: the stick is pushed by either flank
        stick[1] = min(max(stick[1], want - p.play), want + p.play)
        want = stick[1]
    if p.stick_band > 0:  # stiction: rests within the band, then jumps
        if abs(want - stick[2]) > p.stick_band:
            stick[2] = want - np.sign(want - stick[2]) * (p.stick_band - p.jump)
        want = stick[2]
    want = static(int(p.stick), p.stick_a, p.stick_b, want)
    if p.rate_stick > 0:
        most = p.rate_stick * dt
        want = stick[0] + min(max(want - stick[0], -most), most)
    stick[0] = want
    return want


@numba.njit(cache=True, nogil=True)
def simulate(people, start, plant, column, shape, outside, x_given, answer):
    """Columns of the result (n, 6): x, e, u, limb, x', command.

    Rows of ``outside`` (9, n): target, what the error is taken of, disturbance, what is added
    before and behind the limb, delay (s), gain of the error path, of the whole person, attention
    (1; 0 holds the command; -1 lets go).
    """
    p = people[0]
    dt = 1.0 / 600.0
    f, seen, d, before, after = outside[0], outside[1], outside[2], outside[3], outside[4]
    tau, g_error, g_all, awake = outside[5], outside[6], outside[7], outside[8]
    n = len(f)
    out = np.zeros((n, 6))
    error, plain = np.zeros(n), np.zeros(n)
    xs, vs, ms = np.zeros(n), np.zeros(n), np.zeros(n)
    sampled, summed, limb, stick = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    memory = np.zeros(3)
    x, v = start[0], start[1]
    last_v, commanded, kept = v, 0.0, 0.0
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
        steps = lateness(p, memory, error, k, tau[k] / dt, dt)
        e_now = at(error, k, steps)
        v_now = (e_now - at(error, k, steps + 1.0)) / dt
        if p.strange > 0:
            e_now, v_now = sense(p, memory, xs, k, steps, e_now, v_now, dt)
        if p.intermittent > 0:
            e_now, v_now = held(p, sampled, e_now, v_now, dt, k == 0)
        c = g_error[k] * equalised(p, error, k, steps, e_now, v_now, shape, summed, dt)
        c = g_all[k] * (c + beside(p, xs, vs, ms, plain, k, dt))
        if awake[k] > 0:
            kept = c
        else:
            c = kept if awake[k] == 0 else 0.0
        c = static(int(p.command), p.command_a, p.command_b, c + before[k])
        if p.rate_command > 0:
            most = p.rate_command * dt
            commanded += min(max(c - commanded, -most), most)
            c = commanded
        if p.strange > 0:
            c = urge(p, memory, c, limb, dt)
        move_limb(p, limb, c, dt)
        u = move_stick(p, stick, limb[0] + after[k], dt)
        out[k, 0], out[k, 1], out[k, 2] = x, f[k] - x, u
        out[k, 3], out[k, 4], out[k, 5] = limb[0], v, c
        if not answer:
            drive = u + d[k]
            x_next = plant[0, 0] * x + plant[0, 1] * v + column[0] * drive
            v = plant[1, 0] * x + plant[1, 1] * v + column[1] * drive
            x = min(max(x_next, -1e6), 1e6)
    return out
