"""What people and sticks do that no catalogue of simple effects holds; suites ``strange``,
``held_back``.

Open it for gains, delays and thresholds that hang on the error's own recent course, on the target's
speed or on x; corrections with a refractory period; muscles and limbs with a state of their own.
``unknown`` is the right answer. What is ``held`` back is of suite ``held_back``: no fit and nobody
who tunes uses it.
"""

import numpy as np

from . import signals, strange
from .forms import ANY, Form, Hide
from .forms_paths import PURSUIT
from .world import DT, World

STRANGE: list[Form] = []
HELD_BACK: list[Form] = []
TYPICAL = 0.8  # mean size of a normal signal in standard deviations


def own(
    effect: str,
    place: str,
    *,
    held: bool = False,
    displays: tuple[str, ...] = ANY,
    orders: tuple[int, ...] = (1, 2),
):
    """Register a form."""

    def keep(hide: Hide) -> Hide:
        form = Form(effect, "own", place, hide, displays=displays, orders=orders, beyond=True)
        (HELD_BACK if held else STRANGE).append(form)
        return hide

    return keep


def put(world: World, code: int, *numbers: float) -> None:
    """Set the code and its numbers."""
    world.put(strange=code, **dict(zip(("s_a", "s_b", "s_c", "s_d"), numbers, strict=False)))


@own("recent_size_gain", "eye")
def recent_size(world: World, size: float, rng: np.random.Generator) -> None:
    """The gain falls with the running size of the error, or rises with it (arousal)."""
    sign = rng.choice([-1.0, -1.0, 1.0])
    time = rng.uniform(0.7, 2.5)
    put(world, strange.RECENT, sign * 1.2 * size, TYPICAL * world.scale["e"], time)


@own("fading_gain", "eye", held=True)
def fading(world: World, size: float, rng: np.random.Generator) -> None:
    """The longer an error stands on one side the less it is answered (habituation)."""
    left = 1.0 - 0.95 * min(size, 1.0)
    put(world, strange.FADING, left, 0.0, rng.uniform(0.3, 0.9))


@own("position_gain", "eye")
def position(world: World, size: float, rng: np.random.Generator) -> None:
    """The gain is largest at one place of x, and falls to both sides of it."""
    put(world, strange.POSITION, 1.5 * size, world.scale["x"], rng.uniform(-0.6, 0.6))


@own("target_speed_gain", "error path", displays=PURSUIT)
def target_speed(world: World, size: float, rng: np.random.Generator) -> None:
    """The error is answered less while the target moves fast, or less while it hardly moves."""
    power = rng.choice([-1.0, 1.0]) * size
    for r in world.runs:
        speed = np.abs(signals.lag(signals.rate(r.f, DT), 0.15, DT))
        speed = signals.lag(speed, 0.2, DT) / np.mean(speed)
        r.g_error = np.clip((speed + 0.05) ** power, 0.2, 1.5)


@own("delay_of_size", "delay")
def delay_of_size(world: World, size: float, rng: np.random.Generator) -> None:
    """Small errors are answered later than large ones, as weak stimuli are (Pieron)."""
    lag = rng.uniform(0.05, 0.2)
    put(world, strange.DELAY_OF_SIZE, -0.7 * size, TYPICAL * world.scale["e"], lag)


@own("delay_of_rate", "delay", held=True)
def delay_of_rate(world: World, size: float, rng: np.random.Generator) -> None:
    """What moves fast is answered later: it takes longer to judge."""
    lag = rng.uniform(0.05, 0.3)
    put(world, strange.DELAY_OF_RATE, 0.6 * size, TYPICAL * world.scale["de"], lag)


@own("rate_threshold", "rate", orders=(2,))
def rate_threshold(world: World, size: float, rng: np.random.Generator) -> None:
    """Slow motion of the error is not seen; its place is."""
    put(world, strange.RATE_THRESHOLD, (0.3 + 1.2 * size) * world.scale["de"])


@own("rate_in_steps", "rate", orders=(2,), held=True)
def rate_in_steps(world: World, size: float, rng: np.random.Generator) -> None:
    """The rate is judged in a few classes: still, slow, fast."""
    put(world, strange.RATE_STEPS, (0.8 + 1.7 * size) * world.scale["de"])


@own("moving_threshold", "eye", held=True)
def moving_threshold(world: World, size: float, rng: np.random.Generator) -> None:
    """A threshold that is a share of the recent size of the error (Weber)."""
    put(world, strange.MOVING_THRESHOLD, 0.3 + 0.8 * size, 0.0, rng.uniform(0.4, 2.0))


@own("growing_lead", "rate", orders=(2,))
def growing_lead(world: World, size: float, rng: np.random.Generator) -> None:
    """The rate counts more while the error grows than while it shrinks, or the other way round."""
    put(world, strange.GROWING, rng.choice([-0.6, 1.0, 1.0]) * 0.9 * min(size, 1.1))


@own("error_times_rate", "eye", held=True)
def product(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of the answer follows the product of error and rate, with its sign."""
    share = rng.choice([-1.0, 1.0]) * 0.9 * size
    put(world, strange.PRODUCT, share, world.scale["e"], world.scale["de"])


@own("refractory_pulses", "eye")
def pulses(world: World, size: float, rng: np.random.Generator) -> None:
    """Beside the smooth answer pulses at large errors, which then cannot come for a while."""
    refractory = rng.uniform(0.4, 0.9)
    length = refractory * rng.uniform(0.5, 0.9)
    threshold = rng.uniform(0.3, 0.9) * world.scale["e"]
    put(world, strange.PULSES, min(1.2 * size, 1.4), threshold, refractory, length)


@own("integral_of_small", "path")
def small_integral(world: World, size: float, rng: np.random.Generator) -> None:
    """Small errors add up; large ones are answered at once, and what was added is forgotten."""
    gain = 1.2 * size * world.person.crossover
    put(world, strange.SMALL_INTEGRAL, gain, rng.uniform(0.5, 1.1) * world.scale["e"], 0.3)


@own("two_modes", "whole person")
def two_modes(world: World, size: float, rng: np.random.Generator) -> None:
    """Above one error strong and soon, below a smaller one weak and late (Costello's surges)."""
    sooner = min(0.25 * size, 1.5 * world.person.delay)
    put(world, strange.MODES, 0.45 * size, rng.uniform(0.6, 1.2) * world.scale["e"], sooner)


@own("last_peak", "path", held=True)
def last_peak(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of the answer stays at the last peak of the error until the next."""
    put(world, strange.PEAKS, min(0.6 * size, 0.8), rng.uniform(0.2, 0.5) * world.scale["e"])


@own("leaky_hysteresis", "eye", held=True)
def hysteresis(world: World, size: float, rng: np.random.Generator) -> None:
    """The error is followed with play, and forgotten inside it."""
    width = (0.3 + 0.8 * size) * world.scale["e"]
    put(world, strange.HYSTERESIS, rng.uniform(0.6, 1.0), width, rng.uniform(0.3, 1.5))


@own("reversals", "target", displays=PURSUIT, held=True)
def reversals(world: World, size: float, rng: np.random.Generator) -> None:
    """Only turning points of the target are foreseen (Poulton)."""
    ahead, near = rng.uniform(0.3, 0.7) * (0.5 + size), rng.uniform(0.4, 0.8)
    for r in world.runs:
        speed = signals.lag(signals.rate(r.f, DT), 0.1, DT)
        turning = np.exp(-((speed / (near * np.std(speed))) ** 2))
        r.seen = r.f + turning * (signals.delayed(r.f, -ahead, DT) - r.f)


@own("muscle_speed", "limb", held=True)
def muscle_speed(world: World, size: float, rng: np.random.Generator) -> None:
    """A muscle that shortens fast has little force, one that is stretched more (Hill)."""
    put(world, strange.HILL, 0.0, (3.0 / size) * world.scale["dq"])


@own("direction_gain", "limb")
def direction(world: World, size: float, rng: np.random.Generator) -> None:
    """The hand pushes stronger one way than the other, or outward than back."""
    outward = float(rng.random() < 0.5)
    unit = world.scale["dq"] * (world.scale["q"] if outward else 1.0)
    put(world, strange.DIRECTION, rng.choice([-0.8, 0.8]) * min(size, 1.1), 0.5 * unit, 0, outward)


@own("remembered_offset", "command", held=True)
def remembered_offset(world: World, size: float, rng: np.random.Generator) -> None:
    """After strong commands something of them stays for seconds (Kohnstamm)."""
    limit, forgets = rng.uniform(0.6, 1.2) * world.scale["c"], rng.uniform(0.8, 2.5)
    put(world, strange.OFFSET, 3.0 * size / forgets, limit, forgets)


@own("slow_release", "limb")
def slow_release(world: World, size: float, rng: np.random.Generator) -> None:
    """Two muscles that pull soon and let go slowly (Zajac)."""
    rise = rng.uniform(0.01, 0.05)
    put(world, strange.ACTIVATION, 0.0, rise, rise + 0.6 * size)


@own("cocontraction", "limb", held=True)
def cocontraction(world: World, size: float, rng: np.random.Generator) -> None:
    """Both muscles stiffen the limb after large errors (Hogan)."""
    time = rng.uniform(0.5, 1.5)
    put(world, strange.COCONTRACTION, 2.0 * size, TYPICAL * world.scale["e"], time)
