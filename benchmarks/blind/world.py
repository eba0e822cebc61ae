"""Who controls what: operator, controlled element, forcing functions and channels of a case."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from effects import Context, Operator, RunInputs, Wiring
from loop import ACC, DT, F_D, F_T, K_C, MOTION_OF_X, NOISE, OMEGA_B, PLATFORM, E, U, X
from signals import (
    FINE_TIME,
    KEPT,
    N_FINE,
    START,
    TIME,
    Multisine,
    coloured,
    disturbance,
    remnant,
    target,
    wandering,
)

# Tables II and III of the thesis, and a rate control: K_c, omega_b, K_e, T_L.
ELEMENTS = {
    "C1": np.array([90.0, 6.0, 0.09, 0.4]),
    "C2": np.array([30.0, 0.2, 0.07, 1.2]),
    "rate": np.array([50.0, 20.0, 0.7, 0.12]),
}
CHANNELS = {"dist": 1 / 3, "motion_acc": 0.35, "speed": 0.35, "e_y": 0.35}
NEEDED = {
    "rectified": "dist",
    "disturbance": "dist",
    "motion_feedback": "motion_acc",
    "scheduled_gain": "speed",
    "cross_axis": "e_y",
    "airspeed_gain": "speed",
    "workload_delay": "speed",
    "squared_channel": "speed",
    "cross_two_lags": "e_y",
}
OMEGA = np.geomspace(0.1, 60, 400)


class HopelessError(ArithmeticError):
    """A draw that cannot be used: unstable, or its remnant out of reach."""


@dataclass(frozen=True)
class World:
    """Everything about a case but its effects.

    Parameters
    ----------
    kind : str
        Of the controlled element.
    operator : Operator
        The linear operator.
    K_c, omega_b : ndarray of shape (n_fine,)
        The controlled element over time.
    targets : tuple of Multisine
        Of training and of held-out runs.
    f_d : ndarray of shape (n_fine,)
        The disturbance, the same in all runs, with its constant part ``pull``.
    pull : float
        See above.
    channels : frozenset of str
        Those given besides e, x and f_t.
    motion : str
        Whose acceleration is felt and measured: "x", "x and platform" or "platform".
    sizes : dict
        Of channels: rms of e_y, platform and sensor noise; unit and offset of speed.
    lag, order, noise : float, int, str
        Of the remnant: time constant (s), order, kind.
    """

    kind: str
    operator: Operator
    K_c: np.ndarray
    omega_b: np.ndarray
    targets: tuple[Multisine, Multisine]
    f_d: np.ndarray
    pull: float
    channels: frozenset[str]
    motion: str
    sizes: dict[str, float]
    lag: float
    order: int
    noise: str

    @property
    def element(self) -> tuple[float, float]:
        """K_c and omega_b at the beginning."""
        return float(self.K_c[0]), float(self.omega_b[0])

    def inputs(self, rng: np.random.Generator, held_out: bool) -> RunInputs:
        """Draw what is given from outside in one run."""
        none, size, given = np.zeros(N_FINE), self.sizes, self.channels
        e_y = size["e_y"] * coloured(rng, 0.18, 3) if "e_y" in given else none
        speed = none
        if "speed" in given:
            speed = size["speed_offset"] + size["speed"] * wandering(rng)
        moves = "motion_acc" in given and self.motion != "x"
        platform = size["platform"] * coloured(rng, 0.2, 2) if moves else none
        noise = remnant(rng, self.lag, self.order, self.noise)
        chance = int(rng.integers(2**62))
        f_t = self.targets[int(held_out)]
        return RunInputs(f_t, self.f_d, e_y, speed, platform, noise, chance)

    def wire(self, run: RunInputs, context: Context, nominal: bool = False) -> Wiring:
        """The loop of a run without effects and without remnant."""
        w = Wiring(run, self.operator, context, nominal)
        w.table[:, F_T], w.table[:, F_D], w.table[:, PLATFORM] = (
            _sampled(run),
            run.f_d,
            run.platform,
        )
        w.table[:, K_C], w.table[:, OMEGA_B] = self.K_c, self.omega_b
        w.paths[MOTION_OF_X] = float(self.motion != "platform")
        return w


_TARGETS: dict[bytes, np.ndarray] = {}


def _sampled(run: RunInputs) -> np.ndarray:
    """f_t at 500 Hz; runs of a case share it."""
    key = run.f_t.phase.tobytes() + run.f_t.amplitude.tobytes()
    if key not in _TARGETS:
        if len(_TARGETS) > 8:
            _TARGETS.clear()
        _TARGETS[key] = run.f_t.at(FINE_TIME)
    return _TARGETS[key]


def closed(w: Wiring, noise_gain: float) -> np.ndarray:
    """Simulate the closed loop: rows e, x, acceleration, u at 500 Hz."""
    w.table[:, NOISE] = noise_gain * w.given.noise
    out = np.empty((4, N_FINE))
    if not w.run(out, 0, closed=True):
        raise HopelessError("The loop runs away.")
    f_t, e = w.table[START:, F_T], out[E, START:]
    room = 4.0 if any(row[0] in (6, 7) for row in w.maps) else 2.0
    if np.std(e) > room * np.std(f_t) or np.abs(out[X]).max() > 15 * np.abs(f_t).max():
        raise HopelessError("The loop does not track.")
    return out


def opened(w: Wiring, driven: np.ndarray, noise: np.ndarray | float = 0.0) -> np.ndarray:
    """The operator's output, without remnant if none is given, driven by the signals of a run.

    It starts at rest with the recording, as any model must: what was before is not known, and taken
    as the first value recorded.
    """
    w.table[:, NOISE] = noise
    out = driven[:, START:].copy()
    w.run(out, START, closed=False)
    return out[U, :: KEPT.step]


def far_from_unstable(element: tuple[float, float], o: Operator) -> float:
    """Least distance of the open loop from -1; negative where the loop is unstable."""
    s = 1j * OMEGA
    muscle = o.omega_nm**2 / (s**2 + 2 * o.zeta_nm * o.omega_nm * s + o.omega_nm**2)
    loop = element[0] / (s * (s + element[1])) * (o.K_e + o.K_edot * s) * muscle
    loop = loop * np.exp(-o.tau * s)
    phase = np.unwrap(np.angle(loop))
    phase -= 2 * np.pi * np.round((phase[0] + 0.7 * np.pi) / (2 * np.pi))
    late = phase < -np.pi
    stable = not late.any() or np.abs(loop[np.argmax(late)]) < 1
    return float(np.abs(1 + loop).min()) * (1 if stable else -1)


def draw_operator(
    rng: np.random.Generator, kinds: tuple[str, ...]
) -> tuple[str, tuple[float, float], Operator]:
    """A controlled element and somebody who controls it well enough."""
    kind = str(rng.choice(kinds))
    if kind == "between":
        share = rng.uniform(0.2, 0.8)
        center = ELEMENTS["C1"] ** share * ELEMENTS["C2"] ** (1 - share)
    else:
        center = ELEMENTS[kind]
    K_c, omega_b, K_e, T_L = center * rng.uniform(0.78, 1.22, 4)
    tau, w, zeta = rng.uniform(0.18, 0.36), *(np.array([11.25, 0.35]) * rng.uniform(0.78, 1.22, 2))
    element = (float(K_c), float(omega_b))
    for _ in range(20):
        operator = Operator(float(K_e), float(K_e * T_L), tau, float(w), float(zeta))
        if far_from_unstable(element, operator) > 0.4:
            return kind, element, operator
        K_e *= 0.93
    raise HopelessError("No gain keeps this loop stable.")


def draw_world(
    rng: np.random.Generator, names: tuple[str, ...], off: bool, variant: str
) -> tuple[World, Context]:
    """Draw a case's world, and what sizes of its effects are drawn from."""
    kinds = ("C1", "rate") if "rectified" in names else ("C1", "C2", "between", "rate")
    kind, element, operator = draw_operator(rng, kinds)
    channels = {name for name, chance in CHANNELS.items() if rng.random() < chance}
    channels |= {NEEDED[name] for name in names if name in NEEDED}
    motion = str(rng.choice(["x", "x and platform", "platform"], p=[0.4, 0.35, 0.25]))
    if "motion_feedback" in names:
        moving = ["x and platform", "platform" if off else "x"]
        motion = str(rng.choice(moving))
    scale = rng.uniform(0.7, 1.3)
    trained = target(rng, scale)
    tested = target(rng, scale) if rng.random() < 0.5 else trained
    if rng.random() < 0.35:
        tested = replace(tested, amplitude=tested.amplitude * rng.uniform(0.7, 1.4))
    world = World(
        kind=kind,
        operator=operator,
        K_c=np.full(N_FINE, element[0]),
        omega_b=np.full(N_FINE, element[1]),
        targets=(trained, tested),
        f_d=np.zeros(N_FINE),
        pull=0.0,
        channels=frozenset(channels),
        motion=motion,
        sizes={"e_y": 0.0, "platform": 0.0, "speed": 1.0, "speed_offset": 0.0},
        lag=0.06 * rng.uniform(0.75, 1.25),
        order=1 if variant == "heavy" else int(rng.integers(1, 4)),
        noise=variant if variant in ("heavy", "growing") else "gaussian",
    )
    quiet = reference(world, 0.0, off)
    unit = float(np.exp(rng.uniform(np.log(0.05), np.log(30.0))))
    sizes = {
        "e_y": quiet.rms["e"] * rng.uniform(0.6, 1.4),
        "platform": quiet.rms["acc"] * rng.uniform(0.5, 1.5),
        "speed": unit,
        "speed_offset": unit * rng.uniform(0.0, 10.0),
        "sensor": float(rng.choice([0.0, rng.uniform(0.01, 0.08)])),
    }
    pull = 0.0
    if "dist" in channels:
        low, high = (0.35, 0.8) if "disturbance" in names else (0.15, 0.6)
        f_d = quiet.rms["u"] * rng.uniform(low, high) * disturbance(rng).at(FINE_TIME)
        if "rectified" in names or rng.random() < 0.3:
            pull = float(rng.choice([-1, 1])) * rng.uniform(0.3, 1.0) * quiet.rms["u"]
        world = replace(world, f_d=f_d + pull, pull=pull)
    world = replace(world, sizes=sizes)
    return world, reference(world, pull, off)


def changing_element(rng: np.random.Generator, world: World) -> World:
    """The controlled element changes in the run, and the operator does not."""
    for _ in range(50):
        change = np.exp(rng.uniform(np.log(0.5), np.log(2.0), 2))
        one, other = world.element, tuple(world.element * change)
        if far_from_unstable((other[0], other[1]), world.operator) > 0.33:
            rate, middle = rng.choice([0.5, 100.0]), rng.uniform(20.0, 62.0)
            progress = 1 / (1 + np.exp(-np.clip(rate * (FINE_TIME - middle), -500, 500)))
            K_c, omega_b = (a + (b - a) * progress for a, b in zip(one, other, strict=True))
            return replace(world, K_c=K_c, omega_b=omega_b)
    raise HopelessError("No change keeps this loop stable.")


def reference(world: World, pull: float, off: bool) -> Context:
    """Simulate without effects and remnant, and measure."""
    f_t, zero = world.targets[0], np.zeros(N_FINE)
    run = RunInputs(f_t, world.f_d, zero, zero, zero, zero, 0)
    empty = Context(world.operator, world.element, {}, 0.0, pull, world.motion, off)
    w = world.wire(run, empty)
    w.paths[MOTION_OF_X] = 1.0  # its size is of interest even where only the platform is felt
    out = closed(w, 0.0)[:, START:]
    e, x, u, o = out[E], out[X], out[U], world.operator
    signals = {
        "e": e,
        "x": x,
        "u": u,
        "acc": out[ACC],
        "du": np.gradient(u, DT),
        "x_rate": np.gradient(x, DT),
        "c": o.K_e * e + o.K_edot * np.gradient(e, DT),
        "f_t": w.table[START:, F_T],
        "f_t_rate": np.gradient(w.table[START:, F_T], DT),
    }
    rms = {name: float(np.sqrt(np.mean(z**2))) for name, z in signals.items()}
    rms["e_max"] = float(np.abs(e).max())
    rms["platform"], rms["speed"] = world.sizes["platform"] or 1.0, world.sizes["speed"]
    mean = world.sizes["speed_offset"]
    return Context(o, world.element, rms, mean, pull, world.motion, off)


def record(
    rng: np.random.Generator,
    world: World,
    loops: list[tuple[RunInputs, np.ndarray]],
    first_run: int,
    decoys: list[dict[str, Any]],
) -> tuple[pd.DataFrame, pd.Series]:
    """Runs as the user gets them: X with e, x, f_t and channels, and y."""
    tables = []
    for number, (run, out) in enumerate(loops, first_run):
        kept = {"e": out[E, KEPT], "x": out[X, KEPT], "f_t": _sampled(run)[KEPT]}
        if "dist" in world.channels:
            kept["dist"] = run.f_d[KEPT]
        if "motion_acc" in world.channels:
            acc = out[ACC, KEPT]
            noise = world.sizes["sensor"] * np.std(acc) * rng.standard_normal(len(acc))
            kept["motion_acc"] = acc + noise
        if "speed" in world.channels:
            kept["speed"] = run.speed[KEPT]
        if "e_y" in world.channels:
            kept["e_y"] = run.e_y[KEPT]
        for decoy in decoys:
            kept[decoy["name"]] = _decoy(rng, decoy, kept)
        kept["u"] = out[U, KEPT]
        levels = [np.full(len(TIME), number), TIME]
        index = pd.MultiIndex.from_arrays(levels, names=["run", "time"])
        tables.append(pd.DataFrame(kept, index=index))
    table = pd.concat(tables)
    return table.drop(columns="u"), table["u"]


def draw_decoys(rng: np.random.Generator, world: World, chance: float) -> list[dict[str, Any]]:
    """Channels that nobody responds to: noise, copies of others, a platform that is not there."""
    if rng.random() >= chance:
        return []
    others = ["e", "x", "f_t", *sorted(world.channels)]
    drawn: list[dict[str, Any]] = [
        {"name": "aux", "lag": rng.uniform(0.02, 1.0), "size": rng.uniform(0.1, 10.0)},
        {"name": "aux_copy", "of": str(rng.choice(others)), "delay": int(rng.integers(5, 80))},
        {"name": "motion_decoy", "lag": rng.uniform(0.05, 0.5), "size": rng.uniform(0.5, 5.0)},
    ]
    chosen = rng.choice(3, int(rng.integers(1, 3)), replace=False)
    return [drawn[i] for i in sorted(chosen)]


def _decoy(
    rng: np.random.Generator, decoy: dict[str, Any], kept: dict[str, np.ndarray]
) -> np.ndarray:
    if "of" in decoy:
        of = kept[decoy["of"]]
        late = np.concatenate([np.full(decoy["delay"], of[0]), of[: -decoy["delay"]]])
        return late + 0.3 * np.std(of) * rng.standard_normal(len(of))
    return decoy["size"] * coloured(rng, decoy["lag"], 2, len(TIME), 0.01)
