"""Cases of the suites by seed: what is hidden, whether it matters, and the tables that the search
is given.

Open it for the suites. A case depends on (suite, element, seed) alone. Seeds from 1,000,000 on are
for verdicts: they are never looked at while anything is tuned.
"""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
import pandas as pd

from . import elements, signals
from .draw import draw_pursuit, draw_world, spread
from .forms import Form, all_forms
from .forms_further import FURTHER
from .forms_strange import HELD_BACK, STRANGE
from .linear import gap
from .loop import CLIP
from .world import DT, World

SUITES = ("null", "hidden", "leaks", "given_delay", "further", "strange", "held_back")
DRAWN = "drawn"
LEAST_GAP = {"medium": 1.0, "strong": 3.0}  # points of VAF that the best linear person misses
STRANGE_GAP = {"medium": (2.0, 6.0), "strong": (6.0, 20.0)}  # of what no catalogue holds
LEAST_COHERENT = 45.0  # percent of u that the person's own answer must explain
OFFSETS = (-20, -10, -5, 5, 10, 20)  # samples, of a delay given in suite given_delay


@dataclass
class Case:
    """A world with what is hidden in it, simulated; X, y for the search, X_new, y_new for the
    fresh runs.
    """

    suite: str
    seed: int
    element: str
    world: World
    hidden: Form | None
    strength: str
    gap: float
    closed: list[np.ndarray]
    answers: list[np.ndarray]
    also: tuple[str, ...] = ()  # further names that are right

    @property
    def old(self) -> range:
        return range(len(self.world.runs) - self.world.n_fresh)

    @property
    def new(self) -> range:
        return range(len(self.world.runs) - self.world.n_fresh, len(self.world.runs))

    def tables(self) -> tuple[pd.DataFrame, pd.Series, pd.DataFrame, pd.Series]:
        """X, y, X_new, y_new."""
        return (*self.world.table(self.closed, self.old), *self.world.table(self.closed, self.new))

    def truth(self, which: range) -> np.ndarray:
        """The person's noise-free answer at the recorded rate, as the sensor shows it, runs one
        after another.
        """
        return self._joined(which, self.answers)

    @property
    def coherent(self) -> float:
        """Percent of the power of the fresh u that the person's noise-free answer to the same e
        explains.
        """
        u = self._joined(self.new, [c[:, 2] for c in self.closed])
        return 100.0 * (1 - np.sum((u - self.truth(self.new)) ** 2) / np.sum((u - u.mean()) ** 2))

    def _joined(self, which: range, signals_u: list[np.ndarray]) -> np.ndarray:
        whole = np.concatenate([self.world.cut(self.world.runs[i], signals_u[i]) for i in which])
        return np.abs(whole) if self.world.sensor_abs else whole


def generator(suite: str, element: str, seed: int) -> np.random.Generator:
    """The generator of a case; given_delay has the cases of hidden."""
    return np.random.default_rng(
        [
            crc32(("hidden" if suite == "given_delay" else suite).encode()),
            crc32(element.encode()),
            seed,
        ]
    )


def build(suite: str, element: str, seed: int) -> Case:
    """The case; ``element`` is one of ``elements.NAMES`` or ``drawn``."""
    rng = generator(suite, element, seed)
    if suite == "null":
        return null(element, seed, rng)
    if suite == "leaks":
        return leaks(element, seed, rng)
    if suite in ("strange", "held_back"):
        return beyond(suite, element, seed, rng)
    return hidden(suite, element, seed, rng)


def null(element: str, seed: int, rng: np.random.Generator) -> Case:
    """Nothing hidden; the display is drawn, some have channels that mean nothing."""
    name = elements.NAMES[seed % 4] if element == DRAWN else element
    for _ in range(40):
        display = str(rng.choice(["compensatory", "pursuit", "preview"]))
        world = draw_world(name, rng, display, dist_recorded=bool(rng.random() < 0.35))
        idle(world, rng, 0.3)
        case = finished("null", element, seed, world, None, "")
        if _holds(case):
            return case
    raise RuntimeError(f"null on {name}, seed {seed}: no person who answers")


def idle(world: World, rng: np.random.Generator, share: float) -> None:
    """Record, in a share of the cases, a channel that the person does not use."""
    if rng.random() >= share:
        return
    kind = rng.choice(["e_other", "airspeed", "motion_rate"])
    if kind == "motion_rate" and world.element.order == 2:
        world.motion = "motion_rate"
        return
    forcing = signals.Forcing(rng, fast=True)
    for i, r in enumerate(world.runs):
        n = len(r.f)
        if kind == "airspeed":
            r.channels["airspeed"] = signals.slow_channel(n, DT, rng, 1.3 * i)
        else:
            r.channels["e_other"] = world.scale["e"] * forcing.run(n, DT, rng)


def hidden(suite: str, element: str, seed: int, rng: np.random.Generator) -> Case:
    """One effect, by turns; drawn anew until it matters and the loop holds."""
    forms = FURTHER if suite == "further" else all_forms()
    if element != DRAWN:
        given = elements.draw(element, np.random.default_rng(0))
        forms = [f for f in forms if f.fits(given)]
    names = sorted({f.effect for f in forms})
    effect = names[seed % len(names)]
    strength = str(rng.choice(["medium", "strong"]))
    for attempt in range(60):
        chosen = _choose([f for f in forms if f.effect == effect], rng)
        name = str(rng.choice(elements.NAMES)) if element == DRAWN else element
        display = str(rng.choice(chosen.displays))
        linear = draw_world(
            name, rng, display, dist_recorded=chosen.dist or bool(rng.random() < 0.3)
        )
        if not chosen.fits(linear.element) or (chosen.plain and linear.person.lead > 0):
            continue
        world = linear.clean()
        idle(world, rng, 0.15)
        size = rng.uniform(0.3, 0.6) if strength == "medium" else rng.uniform(0.7, 1.0)
        chosen.hide(world, float(size * 1.03 ** max(0, attempt - 6)), rng)
        case = finished(suite, element, seed, world, chosen, strength)
        least = LEAST_GAP[strength]
        if not (_holds(case) and matters(case, least)):
            continue
        for part in chosen.parts:
            alone = linear.clean()
            part(alone, float(size), rng)
            if not matters(finished(suite, element, seed, alone, chosen, strength), least):
                break
        else:
            return case
    raise RuntimeError(f"{effect} on {element}, seed {seed}: no case in which it matters")


def beyond(suite: str, element: str, seed: int, rng: np.random.Generator) -> Case:
    """What no catalogue holds, by turns; its size follows the gap that is asked for."""
    forms = STRANGE if suite == "strange" else HELD_BACK
    if element != DRAWN:
        given = elements.draw(element, np.random.default_rng(0))
        forms = [f for f in forms if f.fits(given)]
    chosen = forms[seed % len(forms)]
    strength = str(rng.choice(list(STRANGE_GAP)))
    least, most = STRANGE_GAP[strength]
    size = float(rng.uniform(0.3, 0.6) if strength == "medium" else rng.uniform(0.7, 1.0))
    for _ in range(60):
        name = str(rng.choice(elements.NAMES)) if element == DRAWN else element
        display = str(rng.choice(chosen.displays))
        world = draw_world(name, rng, display, dist_recorded=bool(rng.random() < 0.3))
        if not chosen.fits(world.element):
            continue
        idle(world, rng, 0.15)
        chosen.hide(world, size, rng)
        case = finished(suite, element, seed, world, chosen, strength)
        if not _holds(case):
            continue
        if matters(case, least) and case.gap <= most:
            return case
        size *= 1.15 if case.gap < least else 1 / 1.15
    raise RuntimeError(f"{chosen.effect} on {element}, seed {seed}: no case in which it matters")


def _choose(forms: list[Form], rng: np.random.Generator) -> Form:
    return forms[int(rng.integers(len(forms)))]


def leaks(element: str, seed: int, rng: np.random.Generator) -> Case:
    """Twins of the pursuit experiment: even seeds answer the target too, odd ones e alone."""
    name = elements.NAMES[rng.integers(2)] if element == DRAWN else element
    if name not in elements.NAMES[:2]:
        raise ValueError(f"suite leaks knows the elements {elements.NAMES[:2]}, got {name!r}")
    chosen = None
    for _ in range(40):
        linear = draw_pursuit(name, rng)
        world = linear.clean()
        world.ahead = int(rng.integers(2)) * world.step
        if seed % 2 == 0:
            chosen = _choose(
                [f for f in all_forms() if f.effect in ("preview", "feedforward")], rng
            )
            chosen.hide(world, float(rng.uniform(0.3, 0.9)), rng)
        also = more_than_a_path(world, rng) if seed % 4 == 0 else ()
        size = min(spread(world, world.simulate(), 2), 3.0 * linear.scale["u"])
        limit = size * rng.uniform(2.8, 4.0)  # the stops of the slider, seldom reached
        world.put(stick=CLIP, stick_a=limit)
        case = finished("leaks", element, seed, world, chosen, "pursuit")
        case.also = also
        if _holds(case) and (chosen is None or matters(case, 3.0)):
            return case
    raise RuntimeError(f"leaks on {element}, seed {seed}: no case in which the target matters")


def more_than_a_path(world: World, rng: np.random.Generator) -> tuple[str, ...]:
    """Make the person one of higher order: what is left of u then tempts to the plant's inverse."""
    form = _choose([f for f in all_forms() if f.effect == "higher_order"], rng)
    form.hide(world, float(rng.uniform(0.3, 0.8)), rng)
    return form.accepted


def finished(
    suite: str, element: str, seed: int, world: World, chosen: Form | None, strength: str
) -> Case:
    """Simulate, and let the person answer the same e without remnant."""
    closed = world.simulate()
    return Case(suite, seed, element, world, chosen, strength, 0.0, closed, world.answer(closed))


def matters(case: Case, least: float) -> bool:
    """The best linear person misses ``least`` points of the answer; says how many in ``gap``."""
    world, person = case.world, case.world.person
    e, u = [], []
    for run, closed, answer in list(zip(world.runs, case.closed, case.answers, strict=True))[:3]:
        recorded = slice(0, run.skip + run.keep, world.step)
        e.append((run.f - closed[:, 0])[recorded])
        u.append(np.abs(answer[recorded]) if world.sensor_abs else answer[recorded])
    start = (person.delay, person.omega, person.zeta)
    case.gap = gap(e, u, 1 / world.rate, start, least)
    return case.gap >= least


def _holds(case: Case) -> bool:
    """Control is not lost: the error stays near that of the linear loop and u is answered, not
    noise alone.
    """
    if any(not np.isfinite(c).all() or np.abs(c).max() > 1e5 for c in case.closed):
        return False
    world = case.world
    if (
        spread(world, case.closed, 1) > 3.0 * world.scale["e"]
        or spread(world, case.closed, 2) > 3.0 * world.scale["u"]
    ):
        return False
    return case.coherent >= LEAST_COHERENT
