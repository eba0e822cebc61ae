"""Draw the world of a case: element, person, forcing, disturbance, remnant; calibrated with the
linear person.

Open it for the ranges. The disturbance is scaled against what the target makes of u, the remnant so
that the wanted share of u is coherent with target and disturbance; both by superposition in the
linear loop.
"""

import numpy as np

from . import signals
from .elements import Element, draw
from .loop import RATE
from .person import draw_person
from .world import DT, TAIL, Run, World

N_FRESH = 2


def draw_world(name: str, rng: np.random.Generator, display: str, *, dist_recorded: bool) -> World:
    """A linear world on the element family ``name``."""
    element = draw(name, rng)
    person = draw_person(element, rng)
    n_runs, length = int(rng.integers(3, 7)), float(rng.integers(30, 61))
    cut_run_in = rng.random() < 0.6
    skip = int((rng.uniform(5, 10) if cut_run_in else rng.uniform(0.3, 1.5)) * RATE)
    size = float(rng.uniform(0.5, 5.0))
    target = signals.Forcing(rng, fast=element.order == 1)
    upset = signals.Forcing(rng, fast=False)
    remnant = Remnant(rng)
    runs = []
    for _ in range(n_runs + N_FRESH):
        keep = int(length * RATE)
        n = skip + keep + int(TAIL * RATE)
        start = np.zeros(2) if cut_run_in else np.array([rng.standard_normal() * size, 0.0])
        before, after = remnant.run(n, rng)
        runs.append(
            Run(
                size * target.run(n, DT, rng),
                upset.run(n, DT, rng),
                before,
                after,
                skip,
                keep,
                start,
            )
        )
    rate = int(rng.choice([60, 100, 50], p=[0.6, 0.25, 0.15]))
    world = World(
        element, person, runs, N_FRESH, rate, display, dist_recorded, bits=int(rng.integers(10, 13))
    )
    return calibrated(world, float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.55, 0.95)))


def draw_pursuit(name: str, rng: np.random.Generator) -> World:
    """A twin of the pursuit experiment: 60 Hz, 45 s of which 5 s ramp, primes of 0.05 Hz, hidden
    disturbance.
    """
    element = Element(name, 1, 1.0) if name == "1/s" else Element(name, 2, 1.0, 1.0)
    person = draw_person(element, rng, (0.15, 0.26))
    highest = 1.55 if element.order == 1 else 0.85
    kinds = [("all", "all"), ("even", "odd"), ("odd", "even")][int(rng.integers(3))]
    target, upset = (signals.PrimeSines(highest, kind) for kind in kinds)
    remnant = Remnant(rng)
    keep, runs = int(45 * RATE), []
    for _ in range(int(rng.integers(3, 7)) + N_FRESH):
        n = keep + int(TAIL * RATE)
        before, after = remnant.run(n, rng)
        runs.append(
            Run(target.run(n, DT, rng), upset.run(n, DT, rng), before, after, 0, keep, np.zeros(2))
        )
    world = World(element, person, runs, N_FRESH, 60, "preview", dist_recorded=False)
    return calibrated(world, float(rng.uniform(0.5, 1.2)), float(rng.uniform(0.55, 0.95)))


class Remnant:
    """Coloured noise of order 1 or 2 with a corner of 1 to 10 rad/s, before the limb, behind it,
    or both.
    """

    def __init__(self, rng: np.random.Generator):
        self.place = str(rng.choice(["before", "behind", "both"]))
        self.order = int(rng.integers(1, 3))
        self.corner = float(np.exp(rng.uniform(0.0, np.log(10.0))))
        self.tails = bool(rng.random() < 0.1)

    def run(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Noise before and behind the limb, of unit size."""
        parts = [signals.noise(n, DT, self.corner, self.order, rng, self.tails) for _ in range(2)]
        return parts[0] * (self.place != "behind"), parts[1] * (self.place != "before")


def calibrated(world: World, upset: float, share: float) -> World:
    """Scale disturbance and remnant: their parts of u in the linear loop relative to that of the
    target.
    """
    world = world.clean()
    of_target = spread(world, world.simulate(0, 1, 0), 2)
    by = upset * of_target / spread(world, world.simulate(0, 0, 1), 2)
    for r in world.runs:
        r.d = r.d * by
    coherent = spread(world, world.simulate(0, 1, 1), 2)
    by = coherent * np.sqrt((1 - share) / share) / spread(world, world.simulate(1, 0, 0), 2)
    for r in world.runs:
        r.noise_before, r.noise_after = r.noise_before * by, r.noise_after * by
    world = world.clean()
    closed = world.simulate()
    columns = {"x": 0, "e": 1, "u": 2, "q": 3, "v": 4, "c": 5}
    world.scale = {name: spread(world, closed, k) for name, k in columns.items()}
    world.scale["du"] = spread(world, [np.gradient(c, DT, axis=0) for c in closed], 2)
    world.scale["dc"] = spread(world, [np.gradient(c, DT, axis=0) for c in closed], 5)
    world.scale["dq"] = spread(world, [np.gradient(c, DT, axis=0) for c in closed], 3)
    world.scale["de"] = spread(world, [np.gradient(c, DT, axis=0) for c in closed], 1)
    world.scale["ff"] = float(np.std(np.concatenate([r.f for r in world.runs])))
    world.scale["share"] = share
    return world


def spread(world: World, closed: list[np.ndarray], column: int) -> float:
    """Standard deviation of a column over what is recorded of all runs."""
    return float(
        np.std(
            np.concatenate(
                [world.cut(r, c[:, column]) for r, c in zip(world.runs, closed, strict=True)]
            )
        )
    )
