"""Hidden effects on other paths, and linear ones on the path of the error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from effects import Context, Draw, Effect, Wire, Wiring, between, choose, sign
from loop import (
    C_EXTRA,
    LEAD,
    MOTION_DELAY,
    MOTION_GAIN,
    MOTION_LAG,
    MOTION_LEAD,
    OUT_DELAY,
    OUT_GAIN,
    OUT_RATE,
    U_EXTRA,
)


def _shifted(w: Wiring, signal: np.ndarray, delay: float) -> np.ndarray:
    return np.interp(w.t - delay, w.t, signal)


def _target_path(w: Wiring, effect: Effect, delay: float) -> None:
    """Of f_t, so much later: through the inverse of the controlled element, its rate, or itself.

    Where the form differs from the catalogue's, the inverse is made proper by two lags.
    """
    (K_c, omega_b), T = w.context.element, 0.0 if effect.canonical else effect.extra["lag"]
    gain, scale = effect.parameters["gain"], effect.extra["scale"]

    def response(s: np.ndarray) -> np.ndarray:
        if effect.form == "rate":
            path = scale["rate"] * s
        elif effect.form == "gain":
            path = scale["gain"] * np.ones_like(s)
        else:
            path = s * (s + omega_b) / K_c / (T * s + 1) ** 2
        if effect.form == "spread":  # not one instant ahead but 0.4 s around it
            path = path * np.sinc(s.imag * 0.4 / (2 * np.pi))
        return gain * path * np.exp(-delay * s)

    w.table[:, C_EXTRA] += w.given.f_t.through(response).at(w.t)


def _target_extra(rng: np.random.Generator, c: Context) -> dict[str, object]:
    """Lag of the inverse, and scales that make f_t or its rate as strong as the usual command."""
    strength = rng.uniform(0.6, 1.2) * c.rms["u"]
    scale = {"rate": strength / c.rms["f_t_rate"], "gain": strength / c.rms["f_t"]}
    return {"lag": rng.uniform(0.02, 0.05), "scale": scale}


def draw_feedforward(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    parameters = {"gain": min(between(rng, 0.2, 0.9) * boost, 1.0), "delay": rng.uniform(0.0, 0.3)}
    form = choose(rng, c, "rate", "gain")
    return Effect("feedforward", parameters, form, _target_extra(rng, c))


def wire_feedforward(w: Wiring, effect: Effect) -> None:
    _target_path(w, effect, effect.parameters["delay"])


def draw_preview(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    parameters = {"gain": min(between(rng, 0.2, 0.9) * boost, 1.0), "time": rng.uniform(0.2, 0.8)}
    form = choose(rng, c, "rate", "spread")
    return Effect("preview", parameters, form, _target_extra(rng, c))


def wire_preview(w: Wiring, effect: Effect) -> None:
    _target_path(w, effect, -effect.parameters["time"])


def draw_output_feedback(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    gain = min(between(rng, 0.15, 0.7) * boost, 1.0) * c.rms["u"] / c.rms["x"]
    rate_gain = min(between(rng, 0.15, 0.7) * boost, 1.0) * c.rms["u"] / c.rms["x_rate"]
    parameters = {"gain": gain, "rate_gain": rate_gain, "delay": rng.uniform(0.1, 0.3)}
    return Effect("output_feedback", parameters, choose(rng, c, "gain", "rate"))


def wire_output_feedback(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    w.paths[OUT_GAIN] = 0.0 if effect.form == "rate" else p["gain"]
    w.paths[OUT_RATE] = 0.0 if effect.form == "gain" else p["rate_gain"]
    w.paths[OUT_DELAY] = p["delay"] if effect.canonical else w.operator.tau


def draw_motion_feedback(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    form = choose(rng, c, "semicircular canals")
    if c.motion == "platform":  # moves by itself
        form = "feedthrough"
        size = between(rng, 0.12, 0.6) * boost * c.rms["u"] / c.rms["platform"]
    else:
        size = min(between(rng, 0.15, 0.6) * boost, 0.8) * c.rms["u"] / c.rms["acc"]
    extra = {"lead": 0.11, "lag": 5.9, "scale": 5.9 * 0.8}
    return Effect("motion_feedback", {"gain": size, "delay": rng.uniform(0.1, 0.25)}, form, extra)


def wire_motion_feedback(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    if effect.form == "feedthrough":
        w.table[:, U_EXTRA] += p["gain"] * w.given.platform
        return
    w.paths[MOTION_GAIN], w.paths[MOTION_DELAY] = p["gain"], p["delay"]
    if not effect.canonical:
        w.paths[MOTION_GAIN] *= effect.extra["scale"]
        w.paths[MOTION_LEAD], w.paths[MOTION_LAG] = effect.extra["lead"], effect.extra["lag"]


def draw_disturbance(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    parameters = {"gain": min(between(rng, 0.25, 0.9) * boost, 1.1), "delay": rng.uniform(0.1, 0.3)}
    form = choose(rng, c, "gain and rate")
    return Effect("disturbance", parameters, form, {"lead": rng.uniform(0.1, 0.3)})


def wire_disturbance(w: Wiring, effect: Effect) -> None:
    p, felt = effect.parameters, w.given.f_d
    if not effect.canonical:
        felt = felt + effect.extra["lead"] * np.gradient(felt, w.t)
    w.table[:, C_EXTRA] -= p["gain"] * _shifted(w, felt, p["delay"])


def draw_cross_axis(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    gain = sign(rng) * min(between(rng, 0.12, 0.8) * boost, 1.2)
    return Effect("cross_axis", {"gain": gain}, choose(rng, c, "gain only"))


def wire_cross_axis(w: Wiring, effect: Effect) -> None:
    o, e_y = w.operator, w.given.e_y
    if effect.canonical:
        path = o.K_e * e_y + o.K_edot * np.gradient(e_y, w.t)
    else:  # as strong as both together at 2 rad/s
        path = np.hypot(o.K_e, 2 * o.K_edot) * e_y
    w.table[:, C_EXTRA] += effect.parameters["gain"] * _shifted(w, path, o.tau)


def draw_extra_lag(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    return Effect("extra_lag", {"T_I": between(rng, 0.05, 0.4)}, choose(rng, c, "two lags"))


def wire_extra_lag(w: Wiring, effect: Effect) -> None:
    T = effect.parameters["T_I"]
    if effect.canonical:
        w.filter([1, 0, 0], [1, T, 0])
    else:
        w.filter([1, 0, 0], [1, T, T * T / 4])


def draw_extra_lead(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    T = min(between(rng, 0.06, 0.2) * boost, 0.4)
    return Effect("extra_lead", {"T": T}, choose(rng, c, "lead and lag"))


def wire_extra_lead(w: Wiring, effect: Effect) -> None:
    T = effect.parameters["T"]
    if effect.canonical:
        w.muscle[LEAD] = T
    else:
        w.filter([1, T, 0], [1, T / 6, 0])


def draw_nm_mode(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    parameters = {"omega": between(rng, 14.0, 40.0), "zeta": between(rng, 0.15, 0.8)}
    return Effect("nm_mode", parameters, choose(rng, c, "with zeros"))


def wire_nm_mode(w: Wiring, effect: Effect) -> None:
    w_2, zeta = effect.parameters["omega"], effect.parameters["zeta"]
    numerator = [w_2**2, 0, 0] if effect.canonical else [w_2**2, 0.5 * w_2, 0.2]
    w.filter(numerator, [w_2**2, 2 * zeta * w_2, 1])


def draw_higher_order(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    ratio = max(between(rng, 0.1, 0.4) / boost, 0.05)
    damping = [0.8, 0.8 * ratio] if rng.random() < 0.5 else [0.8 * ratio, 0.8]
    parameters = {
        "omega": between(rng, 1.2, 5.0),
        "zeta_zeros": damping[0],
        "zeta_poles": damping[1],
    }
    form = choose(rng, c, "apart")
    return Effect("higher_order", parameters, form, {"apart": between(rng, 1.3, 1.8)})


def wire_higher_order(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    zeros = poles = p["omega"]
    if not effect.canonical:
        zeros = zeros * effect.extra["apart"]
    numerator = [1, 2 * p["zeta_zeros"] / zeros, zeros**-2]
    w.filter(numerator, [1, 2 * p["zeta_poles"] / poles, poles**-2])


def _named(place: Callable[..., None] | Draw) -> str:
    return place.__name__.split("_", 1)[1]


DRAW: dict[str, Draw] = {
    _named(draw): draw
    for draw in (
        draw_feedforward,
        draw_preview,
        draw_output_feedback,
        draw_motion_feedback,
        draw_disturbance,
        draw_cross_axis,
        draw_extra_lag,
        draw_extra_lead,
        draw_nm_mode,
        draw_higher_order,
    )
}
WIRE: dict[str, Wire] = {
    _named(wire): wire
    for wire in (
        wire_feedforward,
        wire_preview,
        wire_output_feedback,
        wire_motion_feedback,
        wire_disturbance,
        wire_cross_axis,
        wire_extra_lag,
        wire_extra_lead,
        wire_nm_mode,
        wire_higher_order,
    )
}
