"""Hidden effects of timing and of change in time."""

from __future__ import annotations

import numpy as np
from effects import Context, Draw, Effect, Wire, Wiring, between, choose, sign
from loop import (
    CLOCK,
    DT,
    EVENT_OF_COMMAND,
    EVENT_OF_ERROR,
    FROZEN,
    K_E,
    K_EDOT,
    TAU,
    TICK,
    WEIGHT,
)
from signals import FINE_TIME, PERIOD

T_MIDDLE = PERIOD / 2


def transition(form: str, rate: float, middle: float, width: float) -> np.ndarray:
    """From 0 to 1: a sigmoid, or a step, ramp or half cosine of ``width`` seconds."""
    t = FINE_TIME
    if form == "step":
        return (t >= middle).astype(float)
    if form in ("ramp", "half cosine"):
        linear = np.clip((t - middle) / width + 0.5, 0, 1)
        return linear if form == "ramp" else 0.5 * (1 - np.cos(np.pi * linear))
    return 1 / (1 + np.exp(-np.clip(rate * (t - middle), -500, 500)))


def _change(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Rate and time of a sigmoid, in a fifth of cases practically a step; width of a ramp."""
    rate = 100.0 if rng.random() < 0.2 else between(rng, 0.25, 6.0)
    return {"G": rate, "t_M": rng.uniform(20.0, 62.0)}, {"width": rng.uniform(4.0, 20.0)}


def draw_wrong_delay(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    error = sign(rng) * min(rng.uniform(0.06, 0.15) * boost, 0.15)
    if c.operator.tau + error < 0.05:
        error = -error
    return Effect("wrong_delay", {"extra": -error})


def wire_wrong_delay(w: Wiring, effect: Effect) -> None:
    """Nothing is different in the loop: it is the user who is wrong."""


def draw_tv_delay(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    change = sign(rng) * rng.uniform(0.06, 0.18) * min(boost, 2.0)
    if c.operator.tau + change < 0.1:
        change = -change
    times, extra = _change(rng)
    form = choose(rng, c, "step", "ramp")
    return Effect("tv_delay", {"change": change, **times}, form, extra)


def wire_tv_delay(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    progress = transition(effect.form, p["G"], p["t_M"], effect.extra["width"])
    w.table[:, TAU] += p["change"] * progress


def draw_intermittent(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    kind = str(rng.choice(["clock", "event"]))
    boost = min(boost, 2.0)
    if kind == "clock":
        form = choose(rng, c, "jittered clock")
        return Effect("intermittent", {"hold_time": rng.uniform(0.15, 0.45) * boost}, form)
    form = choose(rng, c, "event of the error")
    size = c.rms["e"] if c.off else c.rms["c"]
    parameters = {
        "threshold": between(rng, 0.25, 1.0) * boost * size,
        "hold_time": rng.uniform(0.06, 0.3),
    }
    return Effect("intermittent", parameters, form)


def wire_intermittent(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    if "threshold" in p:
        kind = EVENT_OF_COMMAND if effect.canonical else EVENT_OF_ERROR
        w.hold[:] = kind, p["hold_time"], p["threshold"]
        return
    instants = np.arange(np.ceil(FINE_TIME[0] / p["hold_time"]), 1e4) * p["hold_time"]
    instants = instants[instants < PERIOD]
    if not effect.canonical and not w.nominal:
        instants = instants + w.rng.uniform(-0.12, 0.12, len(instants)) * p["hold_time"]
    rows = np.ceil((instants - FINE_TIME[0]) / DT - 1e-6).astype(int)
    w.table[np.clip(rows, 0, len(w.t) - 1), TICK] = 1.0
    w.hold[0] = CLOCK


def draw_tv_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    low, high = np.log(1.15), np.log(2.5)
    one, other = (sign(rng) * min(rng.uniform(low, high) * boost, 1.2) for _ in range(2))
    times, extra = _change(rng)
    parameters = {"K_e_factor": float(np.exp(one)), "K_edot_factor": float(np.exp(other)), **times}
    form = choose(rng, c, "step", "ramp", "half cosine")
    return Effect("tv_gain", parameters, form, extra)


def wire_tv_gain(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    progress = transition(effect.form, p["G"], p["t_M"], effect.extra["width"])
    w.table[:, K_E] *= 1 + (p["K_e_factor"] - 1) * progress
    w.table[:, K_EDOT] *= 1 + (p["K_edot_factor"] - 1) * progress


def draw_gain_drift(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    rate = sign(rng) * min(between(rng, 0.004, 0.018) * boost, 0.02)
    return Effect("gain_drift", {"rate": rate}, choose(rng, c, "exponential", "square root"))


def wire_gain_drift(w: Wiring, effect: Effect) -> None:
    rate, t = effect.parameters["rate"], np.maximum(w.t, 0)
    if effect.form == "exponential":
        w.gain(np.exp(rate * (t - T_MIDDLE)))
    elif effect.form == "square root":
        w.gain(1 + rate * PERIOD * (np.sqrt(t / PERIOD) - 2 / 3))
    else:
        w.gain(1 + rate * (t - T_MIDDLE))


def draw_lapses(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    number = int(rng.integers(2, 6))
    lengths = rng.uniform(1.5, min(3.5 * boost, 5.0), number)
    free = PERIOD - 8 - lengths.sum() - 4 * number  # at least 4 s between them
    begins = 6 + np.sort(rng.uniform(0, free, number))
    begins += np.concatenate([[0], np.cumsum(lengths + 4)[:-1]])
    intervals = [(float(b), float(b + d)) for b, d in zip(begins, lengths, strict=True)]
    form = choose(rng, c, "a little response", "frozen output")
    return Effect("lapses", {"intervals": intervals}, form)


def wire_lapses(w: Wiring, effect: Effect) -> None:
    inside = np.zeros(len(w.t), dtype=bool)
    for begin, end in effect.parameters["intervals"]:
        inside |= (w.t >= begin) & (w.t < end)
    if effect.form == "frozen output":
        w.table[inside, FROZEN] = 1.0
    else:
        w.table[inside, WEIGHT] *= 0.0 if effect.canonical else 0.15


def draw_scheduled_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    slope = sign(rng) * min(rng.uniform(0.12, 0.4) * boost, 0.5) / c.rms["speed"]
    form = choose(rng, c, "exponential", "saturating")
    return Effect("scheduled_gain", {"slope": slope}, form)


def wire_scheduled_gain(w: Wiring, effect: Effect) -> None:
    change = effect.parameters["slope"] * (w.given.speed - w.context.speed_mean)
    if effect.form == "exponential":
        w.gain(np.exp(change))
    elif effect.form == "saturating":
        w.gain(1 + 0.4 * np.tanh(1.5 * change / 0.4))
    else:
        w.gain(np.maximum(1 + change, 0.05))


DRAW: dict[str, Draw] = {
    "wrong_delay": draw_wrong_delay,
    "tv_delay": draw_tv_delay,
    "intermittent": draw_intermittent,
    "tv_gain": draw_tv_gain,
    "gain_drift": draw_gain_drift,
    "lapses": draw_lapses,
    "scheduled_gain": draw_scheduled_gain,
}
WIRE: dict[str, Wire] = {
    "wrong_delay": wire_wrong_delay,
    "tv_delay": wire_tv_delay,
    "intermittent": wire_intermittent,
    "tv_gain": wire_tv_gain,
    "gain_drift": wire_gain_drift,
    "lapses": wire_lapses,
    "scheduled_gain": wire_scheduled_gain,
}
