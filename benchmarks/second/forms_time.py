"""Hidden forms that change with time: gains and delays that vary, lapses, intermittent control,
offsets, tremor.

Open it for the courses. A course is a function of the time in the record and is the same in every
run, unless it says otherwise.
"""

import numpy as np

from . import signals
from .forms import form
from .world import DT, World


def _span(world: World) -> float:
    return world.runs[0].keep * DT


def _sigmoid(world: World, rng: np.random.Generator, quick: tuple[float, float]):
    middle, g = _span(world) * rng.uniform(0.35, 0.65), rng.uniform(*quick)
    return lambda t: 1.0 / (1.0 + np.exp(-np.clip(g * (t - middle), -50, 50)))


@form("tv_gain", "error", "error path")
def sigmoid_gain(world: World, size: float, rng: np.random.Generator) -> None:
    """Zaal's sigmoid: the gain of the error falls, or rises back to what it was."""
    course, down, depth = (
        _sigmoid(world, rng, (0.5, 8.0)),
        rng.random() < 0.5,
        0.2 + 0.4 * min(size, 1.2),
    )
    for r in world.runs:
        s = course(r.time)
        r.g_error = 1 - depth * (s if down else 1 - s)


@form("tv_gain", "step", "whole person")
def step_gain(world: World, size: float, rng: np.random.Generator) -> None:
    """The whole person changes at once, another time in each run by up to 2 s."""
    down, depth, middle = (
        rng.random() < 0.5,
        0.2 + 0.4 * min(size, 1.2),
        _span(world) * rng.uniform(0.35, 0.65),
    )
    for r in world.runs:
        s = (r.time > middle).astype(float)
        r.g_all = 1 - depth * (s if down else 1 - s)


@form("gain_drift", "line", "error path")
def line_gain(world: World, size: float, rng: np.random.Generator) -> None:
    """The gain falls or rises on a line through the run."""
    depth, down = 0.3 + 0.45 * min(size, 1.2), rng.random() < 0.6
    for r in world.runs:
        s = np.clip(r.time / _span(world), 0, 1)
        r.g_error = 1 - depth * (s if down else 1 - s)


@form("gain_drift", "tiring", "whole person")
def tiring(world: World, size: float, rng: np.random.Generator) -> None:
    """The whole person tires: an exponential with a time constant of half a run."""
    depth = 0.35 + 0.45 * min(size, 1.2)
    for r in world.runs:
        r.g_all = 1 - depth * (1 - np.exp(-np.clip(r.time, 0, None) / (0.5 * _span(world))))


@form("tv_delay", "sigmoid", "delay")
def sigmoid_delay(world: World, size: float, rng: np.random.Generator) -> None:
    """The delay grows or shrinks along a sigmoid; its mean over the run is the person's."""
    course, sign = _sigmoid(world, rng, (0.3, 4.0)), rng.choice([-1, 1])
    spread = min(0.08 + 0.16 * size, 1.6 * world.person.delay)
    for r in world.runs:
        r.tau = world.person.delay + sign * spread * (course(r.time) - 0.5)


@form("tv_delay", "line", "delay")
def line_delay(world: World, size: float, rng: np.random.Generator) -> None:
    """The delay grows on a line through the run."""
    spread = min(0.1 + 0.18 * size, 1.6 * world.person.delay)
    for r in world.runs:
        r.tau = world.person.delay + spread * (np.clip(r.time / _span(world), 0, 1) - 0.5)


@form("tv_delay", "wave", "delay")
def wave_delay(world: World, size: float, rng: np.random.Generator) -> None:
    """The delay swings slowly, as alertness does."""
    spread, period = min(0.05 + 0.1 * size, 0.8 * world.person.delay), rng.uniform(15, 40)
    for r in world.runs:
        r.tau = world.person.delay + spread * np.sin(2 * np.pi * r.time / period)


@form("scheduled_gain", "line", "channel")
def scheduled(world: World, size: float, rng: np.random.Generator) -> None:
    """The gain of the error follows a recorded channel on a line."""
    depth = 0.2 + 0.35 * min(size, 1.2)
    for i, r in enumerate(world.runs):
        r.channels["airspeed"] = signals.slow_channel(len(r.f), DT, rng, 1.3 * i)
        r.g_error = 1 - depth * (1 + r.channels["airspeed"]) / 1.25


@form("scheduled_gain", "curve", "channel")
def scheduled_curve(world: World, size: float, rng: np.random.Generator) -> None:
    """The gain of the whole person falls with a recorded channel as 1/(1 + a c), like that of
    stiff controls.
    """
    a = 0.5 + 2.0 * size
    for i, r in enumerate(world.runs):
        r.channels["airspeed"] = 1 + signals.slow_channel(len(r.f), DT, rng, 1.3 * i)
        r.g_all = 1 / (1 + a * r.channels["airspeed"] / 2)


def _episodes(r, length: tuple[float, float], apart: tuple[float, float], rng: np.random.Generator):
    inside, t, when = np.zeros(len(r.f), bool), r.time, rng.uniform(2, 8)
    while when < t[-1]:
        for_so_long = rng.uniform(*length)
        inside |= (t >= when) & (t < when + for_so_long)
        when += for_so_long + rng.uniform(*apart)
    return inside


@form("lapses", "hold", "whole person")
def looking_away(world: World, size: float, rng: np.random.Generator) -> None:
    """The person looks away and holds the command, at other times in each run."""
    for r in world.runs:
        r.awake[_episodes(r, (0.6 + size, 1.2 + 1.6 * size), (5, 11), rng)] = 0.0


@form("lapses", "let_go", "whole person")
def letting_go(world: World, size: float, rng: np.random.Generator) -> None:
    """The person lets go: no command for a while, at other times in each run."""
    for r in world.runs:
        r.awake[_episodes(r, (0.5 + 0.7 * size, 0.8 + 1.4 * size), (5, 11), rng)] = -1.0


def _intermittent(kind: int, hold: int):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        period = 0.2 + 0.3 * size if kind == 1 else rng.uniform(0.12, 0.25)
        threshold = world.scale["e"] * (0.3 + 0.7 * size)
        world.put(
            intermittent=kind,
            period=period,
            threshold=threshold,
            hold=hold,
            decay=world.person.crossover,
        )

    return hide


for _kind, _clock in ((1, "clock"), (2, "event")):
    for _hold, _name in ((0, "hold"), (1, "predictor"), (2, "matched_hold")):
        form("intermittent", f"{_clock}_{_name}", "sampler")(_intermittent(_kind, _hold))


@form("bias", "stick", "stick")
def off_centre(world: World, size: float, rng: np.random.Generator) -> None:
    """The stick rests off its centre."""
    offset = rng.choice([-1, 1]) * world.scale["u"] * (0.15 + 0.6 * size)
    for r in world.runs:
        r.after = r.after + offset


@form("bias", "aim", "eye")
def off_aim(world: World, size: float, rng: np.random.Generator) -> None:
    """The person aims beside the target."""
    offset = rng.choice([-1, 1]) * world.scale["e"] * (0.3 + 0.8 * size)
    for r in world.runs:
        r.seen = r.seen + offset


@form("drift", "line", "stick")
def creeping(world: World, size: float, rng: np.random.Generator) -> None:
    """The centre of the stick creeps on a line, from nothing."""
    last = rng.choice([-1, 1]) * world.scale["u"] * (0.4 + 1.3 * size)
    for r in world.runs:
        r.after = r.after + last * np.clip(r.time / _span(world), 0, 1.1)


@form("drift", "line", "command")
def creeping_command(world: World, size: float, rng: np.random.Generator) -> None:
    """The command creeps on a line about zero."""
    last = rng.choice([-1, 1]) * world.scale["c"] * (0.5 + 1.5 * size)
    for r in world.runs:
        r.before = r.before + last * (np.clip(r.time / _span(world), -0.1, 1.1) - 0.5)


def _tremor(behind: bool, hertz: tuple[float, float], wander: float):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        f = rng.uniform(*hertz)
        for r in world.runs:
            shake = (
                world.scale["u"] * (0.1 + 0.5 * size) * signals.tremor(len(r.f), DT, f, wander, rng)
            )
            if behind:
                r.after = r.after + shake
            else:
                r.before = r.before + shake * (2 * np.pi * f / world.person.omega) ** 2

    return hide


form("tremor", "physiological", "stick")(_tremor(True, (6.0, 11.0), 0.3))
form("tremor", "slow", "stick")(_tremor(True, (3.5, 6.0), 0.6))
form("tremor", "muscle", "command")(_tremor(False, (4.0, 7.0), 0.4))
