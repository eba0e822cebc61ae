"""Hidden effects at the operator's input and output: maps, actuators and offsets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from effects import Context, Draw, Effect, Wire, Wiring, between, choose, sign
from loop import (
    ABS_DELAY,
    ABS_GAIN,
    ABS_ROUND,
    ASINH,
    ASYMMETRY,
    CLIP,
    CUBIC,
    DEAD_ZONE,
    DT,
    FLOOR,
    HALF_WAVE,
    INTEGRAL,
    JUMP,
    LAGGED_RATE_LIMIT,
    LEAK,
    PLAY,
    POWER,
    POWER_ADDED,
    QUADRATIC,
    RATE_LIMIT,
    ROUND,
    ROUNDED_PLAY,
    SINH,
    SMOOTH_ASYMMETRY,
    SMOOTH_DEAD_ZONE,
    SOFT_HALF_WAVE,
    STICK_JUMP,
    STICK_SLIP,
    TANH,
    U_EXTRA,
    UNEVEN,
)
from signals import PERIOD


def draw_dead_zone(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    width = between(rng, 0.3, 1.2) * min(boost, 2.5) * c.rms["e"]
    return Effect("dead_zone", {"width": width}, choose(rng, c, "jump", "smooth"))


def wire_dead_zone(w: Wiring, effect: Effect) -> None:
    kind = {"jump": JUMP, "smooth": SMOOTH_DEAD_ZONE}.get(effect.form, DEAD_ZONE)
    w.maps.append([kind, effect.parameters["width"], 0.0])


def draw_asym_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    asymmetry = sign(rng) * min(between(rng, 0.15, 0.65) * boost, 0.85)
    form = choose(rng, c, "above a threshold", "smooth switch")
    extra = {"level": rng.uniform(0.3, 0.7) * c.rms["e"]}
    return Effect("asym_gain", {"asymmetry": asymmetry}, form, extra)


def wire_asym_gain(w: Wiring, effect: Effect) -> None:
    kind = SMOOTH_ASYMMETRY if effect.form == "smooth switch" else ASYMMETRY
    level = 0.0 if effect.canonical else effect.extra["level"]
    w.maps.append([kind, effect.parameters["asymmetry"], level])


def draw_rectified(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    side = -float(np.sign(c.pull))  # it must pull against the disturbance's constant part
    form = choose(rng, c, "leak", "soft")
    extra = {"leak": rng.uniform(0.05, 0.15), "level": rng.uniform(0.2, 0.5) * c.rms["e"]}
    return Effect("rectified", {"sign": side}, form, extra)


def wire_rectified(w: Wiring, effect: Effect) -> None:
    side = effect.parameters["sign"]
    if effect.form == "soft":
        w.maps.append([SOFT_HALF_WAVE, side, effect.extra["level"]])
    else:
        w.maps.append([HALF_WAVE, side, 0.0 if effect.canonical else effect.extra["leak"]])


def draw_cubic_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    hardening = bool(rng.random() < 0.6)
    form = choose(rng, c, "square", "power", "sinh")
    if hardening:
        cubic = min(between(rng, 0.06, 0.4) * boost, 1.0) / c.rms["e"] ** 2
    else:  # the slope 1 + 3 c e^2 must stay positive
        cubic = -min(rng.uniform(0.4, 0.8) * boost, 0.95) / (3 * (1.25 * c.rms["e_max"]) ** 2)
    size = min(rng.uniform(0.5, 1) * boost, 2.0)
    extra = {"hardening": hardening, "size": size, "e": c.rms["e"], "e_max": c.rms["e_max"]}
    return Effect("cubic_gain", {"cubic": cubic}, form, extra)


def wire_cubic_gain(w: Wiring, effect: Effect) -> None:
    e, size, hardening = (effect.extra[name] for name in ("e", "size", "hardening"))
    if effect.form == "square":
        w.maps.append(
            _power_added(0.6 * size / e if hardening else -0.4 / effect.extra["e_max"], 2.0)
        )
    elif effect.form == "power":
        w.maps.append([POWER, e, 1 + 0.7 * size if hardening else 1 / (1 + 0.8 * size)])
    elif effect.form == "sinh":
        w.maps.append([SINH if hardening else ASINH, e / (0.9 * size), 0.0])
    else:
        w.maps.append(_power_added(effect.parameters["cubic"], 3.0))


def _power_added(factor: float, power: float) -> list[float]:
    """Where it softens, up to the error at which the slope is zero."""
    largest = np.inf if factor > 0 else (-1 / (power * factor)) ** (1 / (power - 1))
    return [POWER_ADDED, factor, power, largest]


def draw_absolute_value(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    gain = sign(rng) * min(between(rng, 0.2, 0.9) * boost, 1.5) * c.operator.K_e
    form = choose(rng, c, "rounded", "delay of its own")
    extra = {"level": rng.uniform(0.2, 0.6) * c.rms["e"], "delay": rng.uniform(0.1, 0.5)}
    return Effect("absolute_value", {"gain": gain}, form, extra)


def wire_absolute_value(w: Wiring, effect: Effect) -> None:
    own = effect.form == "delay of its own"
    w.paths[ABS_GAIN] = effect.parameters["gain"]
    w.paths[ABS_DELAY] = effect.extra["delay"] if own else -1.0
    w.paths[ABS_ROUND] = effect.extra["level"] if effect.form == "rounded" else 0.0


def _behind(rng: np.random.Generator) -> dict[str, float]:
    """Whether an operation on the output acts on the remnant too."""
    return {"behind": float(rng.random() < 0.5)}


def draw_saturation(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    limit = between(rng, 0.6, 1.5) / min(boost, 2.5) * c.rms["u"]
    form = choose(rng, c, "tanh", "unequal limits")
    return Effect(
        "saturation", {"limit": limit}, form, {**_behind(rng), "other": rng.uniform(1.3, 2)}
    )


def wire_saturation(w: Wiring, effect: Effect) -> None:
    limit, behind = effect.parameters["limit"], effect.extra["behind"]
    if effect.form == "tanh":
        w.outputs.append([TANH, behind, limit])
    else:
        w.outputs.append(
            [CLIP, behind, -limit, limit * (1 if effect.canonical else effect.extra["other"])]
        )


def draw_rate_limit(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    limit = between(rng, 0.5, 1.3) / min(boost, 2.0) * c.rms["du"]
    form = choose(rng, c, "lag within")
    return Effect(
        "rate_limit", {"limit": limit}, form, {**_behind(rng), "lag": rng.uniform(0.03, 0.1)}
    )


def wire_rate_limit(w: Wiring, effect: Effect) -> None:
    kind = RATE_LIMIT if effect.canonical else LAGGED_RATE_LIMIT
    w.outputs.append(
        [kind, effect.extra["behind"], effect.parameters["limit"], effect.extra["lag"]]
    )


def draw_backlash(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    gap = between(rng, 0.25, 1.2) * min(boost, 1.8) * c.rms["u"]
    return Effect("backlash", {"gap": gap}, choose(rng, c, "rounded"))


def wire_backlash(w: Wiring, effect: Effect) -> None:
    w.outputs.append([PLAY if effect.canonical else ROUNDED_PLAY, 0.0, effect.parameters["gap"]])


def draw_stiction(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    breakaway = between(rng, 0.35, 1.3) * min(boost, 1.8) * c.rms["u"]
    parameters = {"breakaway": breakaway, "kinetic": rng.uniform(0.25, 0.8) * breakaway}
    return Effect("stiction", parameters, choose(rng, c, "slip"), {"lag": rng.uniform(0.04, 0.1)})


def wire_stiction(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    kind = STICK_JUMP if effect.canonical else STICK_SLIP
    w.outputs.append([kind, 0.0, p["breakaway"], p["kinetic"], effect.extra["lag"]])


def draw_quantised(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    step = between(rng, 0.5, 1.8) * min(boost, 2.0) * c.rms["u"]
    form = choose(rng, c, "floor", "uneven")
    return Effect(
        "quantised", {"step": step}, form, {**_behind(rng), "power": rng.uniform(1.15, 1.4)}
    )


def wire_quantised(w: Wiring, effect: Effect) -> None:
    kind = {"floor": FLOOR, "uneven": UNEVEN}.get(effect.form, ROUND)
    row = [kind, effect.extra["behind"], effect.parameters["step"], effect.extra["power"]]
    w.outputs.append(row)


def draw_hardening_stiffness(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    size = between(rng, 0.2, 2.0) * boost
    form = choose(rng, c, "square")
    extra = {"square": 1.5 * size / c.rms["u"]}
    return Effect("hardening_stiffness", {"stiffness": size / c.rms["u"] ** 2}, form, extra)


def wire_hardening_stiffness(w: Wiring, effect: Effect) -> None:
    if effect.canonical:
        w.muscle[CUBIC] = effect.parameters["stiffness"]
    else:
        w.muscle[QUADRATIC] = effect.extra["square"]


def draw_bias(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    level = sign(rng) * between(rng, 0.12, 0.6) * boost * c.rms["u"]
    return Effect("bias", {"level": level}, choose(rng, c, "by run"))


def wire_bias(w: Wiring, effect: Effect) -> None:
    level = effect.parameters["level"]
    if not effect.canonical and not w.nominal:
        level *= 1 + w.rng.uniform(-0.15, 0.15)
    w.table[:, U_EXTRA] += level


def draw_drift(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    rate = sign(rng) * between(rng, 0.22, 1.1) * boost * c.rms["u"] / (PERIOD / 2)
    form = choose(rng, c, "settling")
    return Effect("drift", {"rate": rate}, form, {"time": rng.uniform(12.0, 40.0)})


def wire_drift(w: Wiring, effect: Effect) -> None:
    rate = effect.parameters["rate"]
    if effect.canonical:
        w.table[:, U_EXTRA] += rate * (w.t - PERIOD / 2)
    else:
        settling = np.exp(-np.maximum(w.t, 0) / effect.extra["time"])
        w.table[:, U_EXTRA] += rate * PERIOD * (0.5 - settling)


def draw_integral(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    gain = between(rng, 0.08, 0.5) * boost * c.operator.K_e
    return Effect("integral", {"gain": gain}, choose(rng, c, "leaky"), {"leak": rng.uniform(5, 20)})


def wire_integral(w: Wiring, effect: Effect) -> None:
    w.paths[INTEGRAL] = effect.parameters["gain"]
    w.paths[LEAK] = 0.0 if effect.canonical else 1 / effect.extra["leak"]


def draw_tremor(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    share = between(rng, 0.005, 0.05)
    parameters = {"frequency": rng.uniform(7.5, 13.0), "amplitude": np.sqrt(2 * share) * c.rms["u"]}
    return Effect("tremor", parameters, choose(rng, c, "wandering"), {"share": share})


def wire_tremor(w: Wiring, effect: Effect) -> None:
    if w.nominal:
        return
    p, rng = effect.parameters, w.rng
    frequency = np.full(len(w.t), p["frequency"])
    if not effect.canonical:
        steps = rng.standard_normal(len(w.t) // 500 + 2)
        slow = np.interp(w.t, np.arange(len(steps)) + w.t[0], np.cumsum(steps))
        frequency += 0.25 * slow / max(float(np.std(slow)), 1e-9)
    phase = 2 * np.pi * (np.cumsum(frequency) * DT + rng.random())
    w.table[:, U_EXTRA] += p["amplitude"] * np.sin(phase)


def _named(place: Callable[..., None] | Draw) -> str:
    return place.__name__.split("_", 1)[1]


DRAW: dict[str, Draw] = {
    _named(draw): draw
    for draw in (
        draw_dead_zone,
        draw_asym_gain,
        draw_rectified,
        draw_cubic_gain,
        draw_absolute_value,
        draw_saturation,
        draw_rate_limit,
        draw_backlash,
        draw_stiction,
        draw_quantised,
        draw_hardening_stiffness,
        draw_bias,
        draw_drift,
        draw_integral,
        draw_tremor,
    )
}
WIRE: dict[str, Wire] = {
    _named(wire): wire
    for wire in (
        wire_dead_zone,
        wire_asym_gain,
        wire_rectified,
        wire_cubic_gain,
        wire_absolute_value,
        wire_saturation,
        wire_rate_limit,
        wire_backlash,
        wire_stiction,
        wire_quantised,
        wire_hardening_stiffness,
        wire_bias,
        wire_drift,
        wire_integral,
        wire_tremor,
    )
}
