"""Hidden forms without a memory, and those of limb and stick: thresholds, limits, play, friction,
asymmetry.

Open it for what acts where: at the eye (on e), late (on the delayed error before equalisation), on
the equalised command, on the command to the limb, in the limb, or in the stick (on u). Widths are
shares of the standard deviation that the linear person has there.
"""

import numpy as np

from . import loop
from .forms import form
from .world import World

PLACES = {"eye": "e", "late": "e", "equal": "c", "command": "c", "stick": "u"}


def put(world: World, place: str, code: int, a: float, b: float = 0.0) -> None:
    """Put a static function at a place; it makes one place alone nonlinear."""
    world.put(**{place: code, f"{place}_a": a, f"{place}_b": b})


def _threshold(place: str, code: int, least: float, most: float):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        put(world, place, code, world.scale[PLACES[place]] * (least + (most - least) * size))

    return hide


for _place in ("eye", "late", "command", "stick"):
    form("dead_zone", "flat", _place)(_threshold(_place, loop.DEAD_ZONE, 0.1, 1.0))
form("dead_zone", "indifference", "eye", plain=True)(_threshold("eye", loop.INDIFFERENCE, 0.2, 1.3))
form("dead_zone", "indifference", "late")(_threshold("late", loop.INDIFFERENCE, 0.2, 1.3))
for _place in ("command", "stick"):
    form("saturation", "hard", _place)(_threshold(_place, loop.CLIP, 1.7, 0.7))
form("saturation", "screen", "eye")(_threshold("eye", loop.CLIP, 1.5, 0.6))
form("saturation", "one_side", "stick")(_threshold("stick", loop.CLIP_TOP, 1.3, 0.2))
for _place in ("equal", "command", "stick"):
    form("saturation", "soft", _place)(_threshold(_place, loop.TANH, 1.8, 0.6))
form("quantised", "detents", "stick")(_threshold("stick", loop.STEPS, 0.4, 1.6))
form("quantised", "command", "command")(_threshold("command", loop.STEPS, 0.5, 1.8))
form("quantised", "display", "eye", plain=True)(_threshold("eye", loop.STEPS, 0.5, 1.6))


def _asymmetric(place: str):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        put(world, place, loop.ASYMMETRIC, rng.choice([-1, 1]) * (0.1 + 0.5 * size))

    return hide


for _place in ("eye", "late", "equal", "stick"):
    form("asym_gain", "signs", _place)(_asymmetric(_place))


@form("rectified", "half_wave", "late")
def half_wave(world: World, size: float, rng: np.random.Generator) -> None:
    """Only one sign of the error is answered in full, the other with a small share."""
    put(world, "late", loop.HALF_WAVE, rng.choice([-1.0, 1.0]), max(0.0, 0.5 - 0.5 * size))


@form("rectified", "share", "equal")
def half_wave_command(world: World, size: float, rng: np.random.Generator) -> None:
    """One muscle group does most of the work: the command of the other sign is weakened."""
    put(world, "equal", loop.HALF_WAVE, rng.choice([-1.0, 1.0]), max(0.05, 0.6 - 0.5 * size))


@form("rectified", "reflex", "path")
def reflex(world: World, size: float, rng: np.random.Generator) -> None:
    """The stretch reflex of Mirbagheri and Kearney: a delayed path that answers the rate of one
    sign alone.
    """
    gain = (0.3 + 1.2 * size) * world.scale["c"] / world.scale["de"]
    delay = world.person.delay * rng.uniform(0.4, 1.0)
    world.put(reflex=gain, reflex_sign=rng.choice([-1.0, 1.0]), reflex_delay=delay)


@form("absolute_value", "path", "late")
def size_of_error(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of the answer follows the size of the error, whatever its sign."""
    put(world, "late", loop.PLUS_ABS, rng.choice([-1, 1]) * (0.15 + 0.45 * size))


@form("absolute_value", "sensor", "sensor")
def sensor(world: World, size: float, rng: np.random.Generator) -> None:
    """The recorder shows the size of u without its sign; the loop is untouched."""
    world.sensor_abs = True


def _cubic(place: str):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        sd = world.scale[PLACES[place]]
        put(world, place, loop.CUBIC, (0.05 + 0.4 * size) / sd**2)

    return hide


def _power(place: str, low: float, high: float):
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        put(world, place, loop.POWER, low + (high - low) * size, world.scale[PLACES[place]])

    return hide


for _place in ("late", "equal"):
    form("cubic_gain", "grows", _place)(_cubic(_place))
    form("cubic_gain", "power", _place)(_power(_place, 1.2, 2.0))
    form("cubic_gain", "falls", _place)(_power(_place, 0.85, 0.5))


@form("hardening_stiffness", "spring", "limb")
def spring(world: World, size: float, rng: np.random.Generator) -> None:
    """The spring of limb and stick stiffens with its deflection: w^2 (q + k q^3)."""
    world.put(hardening=(0.1 + 0.9 * size) / world.scale["q"] ** 2)


@form("rate_limit", "muscle", "command")
def rate_before(world: World, size: float, rng: np.random.Generator) -> None:
    """The command to the limb changes no faster than a limit."""
    world.put(rate_command=world.scale["dc"] * (1.2 - 0.9 * size) * 0.6)


@form("rate_limit", "stick", "stick")
def rate_behind(world: World, size: float, rng: np.random.Generator) -> None:
    """The stick moves no faster than a limit."""
    world.put(rate_stick=world.scale["du"] * (1.2 - 0.8 * size))


@form("backlash", "play", "stick")
def play(world: World, size: float, rng: np.random.Generator) -> None:
    """Play between hand and stick: the stick is pushed by either flank."""
    world.put(play=world.scale["u"] * (0.1 + 0.8 * size))


@form("stiction", "jump", "stick")
def stick_and_jump(world: World, size: float, rng: np.random.Generator) -> None:
    """The stick rests within a band and jumps (the two-parameter form of Choudhury)."""
    band = world.scale["u"] * (0.25 + 0.8 * size)
    world.put(stick_band=band, jump=band * rng.uniform(0.3, 1.0))


@form("stiction", "karnopp", "limb")
def karnopp(world: World, size: float, rng: np.random.Generator) -> None:
    """Coulomb friction and a larger breakaway force in the limb (Karnopp; Armstrong-Helouvry)."""
    friction = world.person.omega**2 * world.scale["q"] * (0.15 + 0.55 * size)
    world.put(friction=friction, breakaway=friction * rng.uniform(1.1, 1.6))
