"""Hidden effects that no catalogue has, of the suite ``beyond``.

From physiology and control: responses that fall back or grow by another law, muscles that differ by
side, attention and fatigue, delays that go with workload, friction that remembers, slow relaxation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from effects import Context, Draw, Effect, Wire, Wiring, between, sign
from loop import (
    AT_COMMAND,
    AT_INPUT,
    AT_RATE,
    AT_SPRING,
    BRISTLE,
    C_EXTRA,
    FRICTION,
    K_E,
    K_EDOT,
    PLAYS,
    TAU,
    U_EXTRA,
)
from signals import low_passed

REACH = 12.0  # in rms; beyond it a curve goes on straight
CROSSOVER = 3.0  # rad/s
PAIRS, STEP = 6, 3.0  # of poles and zeros of the fractional lag, and from one to the next


def _balanced(of: Callable[[np.ndarray], np.ndarray], rms: float) -> Callable[..., np.ndarray]:
    """The curve, scaled so that normal errors are answered with gain one on average."""
    x = rms * np.linspace(-4, 4, 801)
    weight = np.exp(-0.5 * (x / rms) ** 2)
    gain = np.sum(weight * x * of(x)) / np.sum(weight * x * x)
    return lambda x: of(x) / gain


def draw_falling_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The answer grows with the error, is largest at one size, and falls back."""
    size = rng.uniform(1.3, 2.2) / min(boost, 1.6) * c.rms["e"]
    return Effect("falling_gain", {"size": size, "floor": rng.uniform(0.1, 0.3), "e": c.rms["e"]})


def wire_falling_gain(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def answer(x: np.ndarray) -> np.ndarray:
        return x * (p["floor"] + (1 - p["floor"]) * np.exp(-((x / p["size"]) ** 2)))

    w.curve(AT_INPUT, _balanced(answer, p["e"]), REACH * p["e"])


def draw_dual_slope(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """Another slope beyond a knee, which lies elsewhere on each side."""
    more = rng.random() < 0.5
    slopes = between(rng, 1.6, 3.0) * boost if more else rng.uniform(0.1, 0.5) / boost
    knees = np.array([rng.uniform(0.2, 0.5), rng.uniform(0.8, 1.5)]) * c.rms["e"]
    left, right = rng.permutation(knees)
    return Effect("dual_slope", {"slope": slopes, "left": left, "right": right, "e": c.rms["e"]})


def wire_dual_slope(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def answer(x: np.ndarray) -> np.ndarray:
        beyond = np.maximum(x - p["right"], 0) - np.maximum(-x - p["left"], 0)
        return x + (p["slope"] - 1) * beyond

    w.curve(AT_INPUT, _balanced(answer, p["e"]), REACH * p["e"])


def draw_fechner(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The logarithm of the error above a threshold."""
    floor, scale = rng.uniform(0.15, 0.45) * min(boost, 2.0), rng.uniform(0.2, 0.6) / boost
    parameters = {"floor": floor * c.rms["e"], "scale": scale * c.rms["e"], "e": c.rms["e"]}
    return Effect("fechner", parameters)


def wire_fechner(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def answer(x: np.ndarray) -> np.ndarray:
        return np.sign(x) * np.log1p(np.maximum(np.abs(x) - p["floor"], 0) / p["scale"])

    w.curve(AT_INPUT, _balanced(answer, p["e"]), REACH * p["e"])


def draw_plateau(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """A range of errors on one side that are all answered alike."""
    begin = rng.uniform(0.1, 0.4) * c.rms["e"]
    width = rng.uniform(0.6, 1.3) * min(boost, 2.0) * c.rms["e"]
    return Effect("plateau", {"side": sign(rng), "begin": begin, "width": width, "e": c.rms["e"]})


def wire_plateau(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def answer(x: np.ndarray) -> np.ndarray:
        return x - p["side"] * np.clip(p["side"] * x - p["begin"], 0, p["width"])

    w.curve(AT_INPUT, _balanced(answer, p["e"]), REACH * p["e"])


def draw_one_sided_detent(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """To one side a detent has to be overcome; before, the command does little."""
    width = rng.uniform(0.5, 1.1) * min(boost, 2.0) * c.rms["c"]
    parameters = {"side": sign(rng), "width": width, "slope": rng.uniform(0.1, 0.35)}
    return Effect("one_sided_detent", parameters, extra={"c": c.rms["c"]})


def wire_one_sided_detent(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def answer(x: np.ndarray) -> np.ndarray:
        lost = (1 - p["slope"]) * np.clip(p["side"] * x, 0, p["width"])
        return x - p["side"] * lost

    w.curve(AT_COMMAND, answer, REACH * effect.extra["c"])


def draw_one_sided_spring(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The limb's spring stiffens on one side only."""
    u = c.rms["u"]
    parameters = {
        "side": sign(rng),
        "begin": rng.uniform(0.0, 0.4) * u,
        "stiffness": between(rng, 0.6, 2.0) * boost / u,
    }
    return Effect("one_sided_spring", parameters, extra={"u": u})


def wire_one_sided_spring(w: Wiring, effect: Effect) -> None:
    p = effect.parameters

    def force(v: np.ndarray) -> np.ndarray:
        return p["side"] * p["stiffness"] * np.maximum(p["side"] * v - p["begin"], 0) ** 2

    w.curve(AT_SPRING, force, REACH * effect.extra["u"])


def draw_quadratic_damping(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The limb's damping grows with its speed."""
    size = between(rng, 0.8, 4.0) * boost * c.rms["u"] / c.rms["du"] ** 2
    return Effect("quadratic_damping", {"damping": size}, extra={"du": c.rms["du"]})


def wire_quadratic_damping(w: Wiring, effect: Effect) -> None:
    size = effect.parameters["damping"]
    w.curve(AT_RATE, lambda v: size * v * np.abs(v), REACH * effect.extra["du"])


def draw_one_sided_damping(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """Movement one way is damped, the other way not."""
    size = between(rng, 0.4, 1.5) * boost * c.rms["u"] / c.rms["du"]
    parameters = {"side": sign(rng), "damping": size}
    return Effect("one_sided_damping", parameters, extra={"du": c.rms["du"]})


def wire_one_sided_damping(w: Wiring, effect: Effect) -> None:
    side, size = effect.parameters["side"], effect.parameters["damping"]
    reach = REACH * effect.extra["du"]
    w.curve(AT_RATE, lambda v: size * side * np.maximum(side * v, 0), reach)


def draw_attention(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The gain comes and goes over the run."""
    depth = min(rng.uniform(0.25, 0.55) * boost, 0.75)
    cycle = {"period": between(rng, 12.0, 32.0), "phase": rng.uniform(0, 2 * np.pi)}
    return Effect("attention", {"depth": depth, **cycle})


def wire_attention(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    w.gain(1 + p["depth"] * np.sin(2 * np.pi * w.t / p["period"] + p["phase"]))


def draw_fatigue(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The gain sinks exponentially, and comes back from some moment on."""
    parameters = {
        "lost": min(rng.uniform(0.4, 0.7) * boost, 0.85),
        "sinking": rng.uniform(8.0, 25.0),
        "rest": rng.uniform(42.0, 60.0),
        "recovery": rng.uniform(3.0, 10.0),
    }
    return Effect("fatigue", parameters)


def wire_fatigue(w: Wiring, effect: Effect) -> None:
    p, t = effect.parameters, np.maximum(w.t, 0)
    tired = 1 - np.exp(-np.minimum(t, p["rest"]) / p["sinking"])
    w.gain(1 - p["lost"] * tired * np.exp(-np.maximum(t - p["rest"], 0) / p["recovery"]))


def _size_of_speed(w: Wiring) -> np.ndarray:
    return (w.given.speed - w.context.speed_mean) / w.context.rms["speed"]


def draw_airspeed_gain(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The gain goes by steps of a channel, up and down again."""
    change = np.exp(sign(rng) * min(rng.uniform(0.35, 0.7) * boost, 1.0))
    edges = {"low": rng.uniform(-0.8, -0.3), "high": rng.uniform(0.3, 0.8)}
    return Effect("airspeed_gain", {"middle": change, "last": rng.uniform(0.8, 1.25), **edges})


def wire_airspeed_gain(w: Wiring, effect: Effect) -> None:
    p, z = effect.parameters, _size_of_speed(w)
    w.gain(np.where(z < p["low"], 1.0, np.where(z < p["high"], p["middle"], p["last"])))


def draw_workload_delay(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The delay grows with the size of a channel, whatever its sign."""
    return Effect("workload_delay", {"change": rng.uniform(0.09, 0.2) * min(boost, 2.0)})


def wire_workload_delay(w: Wiring, effect: Effect) -> None:
    size = np.minimum(np.abs(_size_of_speed(w)), 2.0)
    w.table[:, TAU] += effect.parameters["change"] * size


def draw_swinging_delay(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The delay swings slowly."""
    change = min(rng.uniform(0.08, 0.2) * boost, c.operator.tau - 0.05)
    cycle = {"period": between(rng, 18.0, 45.0), "phase": rng.uniform(0, 2 * np.pi)}
    return Effect("swinging_delay", {"change": change, **cycle})


def wire_swinging_delay(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    w.table[:, TAU] += p["change"] * np.sin(2 * np.pi * w.t / p["period"] + p["phase"])


def draw_wandering_offset(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The output goes off its place and comes back, twice."""
    heights = [sign(rng) * rng.uniform(0.4, 0.9) * boost * c.rms["u"] for _ in range(2)]
    times = [rng.uniform(12.0, 32.0), rng.uniform(48.0, 70.0)]
    widths = list(rng.uniform(3.0, 8.0, 2))
    return Effect("wandering_offset", {"heights": heights, "times": times, "widths": widths})


def wire_wandering_offset(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    for height, time, width in zip(p["heights"], p["times"], p["widths"], strict=True):
        w.table[:, U_EXTRA] += height * np.exp(-0.5 * ((w.t - time) / width) ** 2)


def draw_many_plays(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """Plays of unequal gaps beside a straight part (Prandtl and Ishlinskii)."""
    gaps = np.array([0.1, 0.4, 0.8, 1.3]) * rng.uniform(0.75, 1.25, 4)
    shares = rng.dirichlet([2.0, 2.0, 2.0, 2.0, 2.0])
    parameters = {
        "gaps": list(gaps * min(boost, 2.0) * c.rms["u"]),
        "straight": 0.3 * shares[0] / (1 - 0.7 * shares[0]),
        "weights": list(shares[1:] / (1 - 0.7 * shares[0])),
    }
    return Effect("many_plays", parameters)


def wire_many_plays(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    pairs = [x for pair in zip(p["gaps"], p["weights"], strict=True) for x in pair]
    w.outputs.append([PLAYS, 0.0, p["straight"], *pairs])


def draw_bristles(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """Friction in the limb that bends before it slides (Dahl)."""
    force = between(rng, 0.4, 1.2) * min(boost, 2.0) * c.rms["u"]
    way = rng.uniform(0.1, 0.4) * c.rms["u"]
    return Effect("bristles", {"force": force, "way": way})


def wire_bristles(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    w.muscle[FRICTION], w.muscle[BRISTLE] = p["force"], p["force"] / p["way"]


def _command_of(w: Wiring, signal: np.ndarray, rms: float) -> None:
    """Add a signal of this size to the command, as late as the error is answered."""
    late = np.interp(w.t - w.operator.tau, w.t, signal)
    w.table[:, C_EXTRA] += rms * late


def draw_cross_two_lags(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """An answer to the other axis, through two lags."""
    size = sign(rng) * min(rng.uniform(0.25, 0.6) * boost, 0.9) * c.rms["u"]
    lags = {"slow": rng.uniform(0.5, 1.2), "fast": rng.uniform(0.15, 0.4)}
    return Effect("cross_two_lags", {"size": size, **lags})


def wire_cross_two_lags(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    slow = low_passed(low_passed(w.given.e_y, p["slow"], 1), p["fast"], 1)
    _command_of(w, slow / max(float(np.std(slow)), 1e-9), p["size"])


def draw_squared_channel(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """An answer to the square of a channel."""
    size = sign(rng) * min(rng.uniform(0.15, 0.4) * boost, 0.7) * c.rms["u"]
    return Effect("squared_channel", {"size": size, "middle": rng.uniform(0.3, 0.8)})


def wire_squared_channel(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    square = (np.clip(_size_of_speed(w), -2.5, 2.5) + p["middle"]) ** 2
    _command_of(w, square - 1 - p["middle"] ** 2, p["size"] / np.sqrt(2 + 4 * p["middle"] ** 2))


def draw_fractional_lag(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """The limb relaxes by a power of time: a lag of fractional order (Oustaloup)."""
    order = min(rng.uniform(0.3, 0.6) * boost, 0.8)
    return Effect("fractional_lag", {"order": order, "omega": between(rng, 0.15, 0.6)})


def wire_fractional_lag(w: Wiring, effect: Effect) -> None:
    """Who has such a limb leads more: at crossover the whole is as it would be without."""
    p, o, s = effect.parameters, w.operator, 1j * CROSSOVER
    lag = 1.0 + 0j
    for k in range(PAIRS):
        pole = p["omega"] * STEP ** (k + 0.5 - 0.5 * p["order"])
        zero = pole * STEP ** p["order"]
        w.section([1, 1 / zero, 0], [1, 1 / pole, 0])
        lag *= (1 + s / zero) / (1 + s / pole)
    wanted = (o.K_e + o.K_edot * s) / lag
    w.table[:, K_E], w.table[:, K_EDOT] = wanted.real, wanted.imag / CROSSOVER


def draw_two_notches(rng: np.random.Generator, c: Context, boost: float) -> Effect:
    """Two anti-resonances of the limb."""
    parameters = {
        "omega": [between(rng, 0.7, 1.6), between(rng, 2.5, 6.0)],
        "depth": [max(between(rng, 0.15, 0.5) / boost, 0.05) for _ in range(2)],
    }
    return Effect("two_notches", parameters)


def wire_two_notches(w: Wiring, effect: Effect) -> None:
    p = effect.parameters
    for omega, depth in zip(p["omega"], p["depth"], strict=True):
        zeros, poles = 2 * 0.7 * depth / omega, 2 * 0.7 / omega
        w.section([1, zeros, omega**-2], [1, poles, omega**-2])


_DRAWS = (
    draw_falling_gain,
    draw_dual_slope,
    draw_fechner,
    draw_plateau,
    draw_one_sided_detent,
    draw_one_sided_spring,
    draw_quadratic_damping,
    draw_one_sided_damping,
    draw_attention,
    draw_fatigue,
    draw_airspeed_gain,
    draw_workload_delay,
    draw_swinging_delay,
    draw_wandering_offset,
    draw_many_plays,
    draw_bristles,
    draw_cross_two_lags,
    draw_squared_channel,
    draw_fractional_lag,
    draw_two_notches,
)
DRAW: dict[str, Draw] = {draw.__name__.removeprefix("draw_"): draw for draw in _DRAWS}
WIRE: dict[str, Wire] = {name: globals()[f"wire_{name}"] for name in DRAW}
