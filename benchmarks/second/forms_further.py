"""Hidden forms in which names were missed in a simulator of other authors; suite ``further``.

Open it for friction inside the limb, a command in steps, clocks and tremors that begin anywhere in
each run, gains that drift on a curve, and pairs in which one effect hides the other. They have a
register of their own, so that the cases of ``hidden`` stay what they were. All are development
cases: they were written after it was known that their like are missed.
"""

from collections.abc import Callable

import numpy as np

from .forms import Form, Hide
from .forms_paths import quick, slow, trim
from .forms_static import put, rate_before, rate_behind
from .forms_time import _span, off_aim, off_centre
from .loop import RATE, STEPS
from .world import DT, World

FURTHER: list[Form] = []


def further(effect: str, name: str, place: str, **limits: object) -> Callable[[Hide], Hide]:
    """Register a form of this suite."""

    def keep(hide: Hide) -> Hide:
        FURTHER.append(Form(effect, name, place, hide, **limits))  # type: ignore[arg-type]
        return hide

    return keep


@further("friction", "coulomb", "limb")
def coulomb(world: World, size: float, rng: np.random.Generator) -> None:
    """Coulomb friction in the limb, no larger at rest than in motion."""
    friction = world.person.omega**2 * world.scale["q"] * (0.1 + 0.4 * size)
    world.put(friction=friction, breakaway=friction)


@further("quantised", "command", "command")
def command_in_steps(world: World, size: float, rng: np.random.Generator) -> None:
    """The command takes a few values only; the limb smooths them."""
    put(world, "command", STEPS, world.scale["c"] * (0.6 + 1.0 * size))


def _clocked(hold: int) -> Hide:
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        period = 0.15 + 0.25 * min(size, 1.0)
        world.put(intermittent=1, period=period, hold=hold, decay=world.person.crossover)
        for r in world.runs:  # the clock ran before the record began
            r.skip += int(rng.uniform(0, period) * RATE)

    return hide


further("intermittent", "own_clock", "sampler")(_clocked(0))


@further("tremor", "own_phase", "stick")
def trembling(world: World, size: float, rng: np.random.Generator) -> None:
    """A steady tremor of 8 to 12 Hz that begins anywhere in each run."""
    hertz, most = rng.uniform(8.0, 12.0), world.scale["u"] * (0.15 + 0.4 * size)
    for r in world.runs:
        phase, t = rng.uniform(0, 2 * np.pi), np.arange(len(r.f)) * DT
        r.after = r.after + most * np.sin(2 * np.pi * hertz * t + phase)


def _drifting(course: Callable[[np.ndarray], np.ndarray]) -> Hide:
    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        depth, up = 0.4 + 0.4 * min(size, 1.0), rng.random() < 0.4
        for r in world.runs:
            s = course(np.clip(r.time / _span(world), 0, 1))
            r.g_all = 1 - depth * ((1 - s) if up else s)

    return hide


further("gain_drift", "settling", "whole person")(
    _drifting(lambda s: (1 - np.exp(-4 * s)) / (1 - np.exp(-4.0)))
)
further("gain_drift", "late", "whole person")(_drifting(lambda s: s**2.5))
further("gain_drift", "root", "whole person")(_drifting(np.sqrt))

further("extra_lead", "lead", "command")(quick)


def pair(effects: str, name: str, place: str, *parts: Hide, **limits: object) -> None:
    """Register two effects at once."""

    def hide(world: World, size: float, rng: np.random.Generator) -> None:
        for part in parts:
            part(world, size, rng)

    further(effects, name, place, parts=parts, **limits)(hide)


for _offset, _where in ((off_centre, "stick"), (off_aim, "eye")):
    pair("extra_lag+bias", "lag", _where, slow, _offset, not_on=("K/s^2",))
    pair("integral+bias", "trim", _where, trim, _offset)
pair("extra_lead+rate_limit", "lead", "command", quick, rate_before)
pair("extra_lead+rate_limit", "lead", "stick", quick, rate_behind)
