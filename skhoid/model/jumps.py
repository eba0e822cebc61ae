"""Fits of effects whose response jumps with their parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution

from ..effects.composition import Effects
from .fitting import Criterion, RemnantModel, minimise, sse_at
from .model import Model, start_beside
from .scan import Scan
from .simulator import Simulator
from .tied import Tied

N_AGAIN = 2  # scans around what was found
SOFT = (0.1, 0.05, 0.025, 0.012)  # corners, ever sharper

# How far off estimates in a wrong minimum are, relative.
OFF = 0.05
OFF_LEAD = 0.2  # gains but the first: a lead and a lag trade places
OFF_USUAL = 0.3  # of what is usual for the others
WIDEST = 12.0  # times as far off, at most
RUNS_EVOLVED = 2
POPULATION, GENERATIONS = 80, 60
DRAWN = 30  # points of an effect's cube for each member of the first generation
CHAINS, STEPS = 16, 60
SHARES = (0.2, 0.6, 0.95)  # of the difference of two chains; the second is usual for few parameters
DIVERGED = 1e3  # times the squares of the start


def searched(model: Model, name: str, criterion: Criterion, sizes: tuple[float, ...]) -> Model:
    """Pattern search over the parameters of an effect whose response is not smooth in them.

    The other parameters follow each step.
    """
    simulator = model.simulator
    softer = _followed(model, name, criterion)
    if softer is not None:
        return softer
    tied = Tied(simulator, model.theta)
    mine = [i for i, n in enumerate(simulator.names) if n.startswith(f"{name}__")]
    fixed = np.zeros(model.theta.size, dtype=bool)
    fixed[mine] = True
    best = replace(model.fit, theta=tied.to(model.theta))
    for _ in range(N_AGAIN):
        before = best.sse
        for start in _starts_beside(simulator, name, criterion, tied.back(best.theta), model):
            trial = minimise(tied, criterion, tied.to(start), max_iter=6, fixed=fixed)
            best = trial if trial.sse < best.sse else best
        if not best.sse < 0.999 * before:
            break
    for size in sizes:
        for i in mine:
            width = size * max(abs(best.theta[i]), 0.1 * simulator.scale[i])
            for sign in (1.0, -1.0):
                for _ in range(4):
                    theta = best.theta.copy()
                    theta[i] += sign * width
                    trial = minimise(tied, criterion, theta, max_iter=1, fixed=fixed)
                    if not trial.sse < best.sse:
                        break
                    best = trial
        best = minimise(tied, criterion, best.theta, max_iter=4, fixed=fixed)
    return Model(simulator, tied.back_fit(best), model.other_cores)


def _followed(model: Model, name: str, criterion: Criterion) -> Model | None:
    """The fit of an effect whose corners are softened at first and then sharpened."""
    simulator = model.simulator
    theta = model.theta
    for amount in SOFT:
        soft = simulator.with_soft_corners(amount, only=name)
        if soft is simulator:
            return None
        theta = minimise(soft, criterion, theta, max_iter=8, tol=1e-4).theta
    sharp = minimise(simulator, criterion, theta, max_iter=4)
    return Model(simulator, min(sharp, model.fit, key=lambda fit: fit.sse), model.other_cores)


def _starts_beside(
    simulator: Simulator, name: str, criterion: Criterion, theta: np.ndarray, model: Model
) -> list[np.ndarray]:
    """Starts that an effect proposes near given parameters, on the record of a criterion."""
    variant = dict(simulator.effects.steps)[name]
    found = dict(zip(simulator.names, theta.tolist(), strict=True))
    fewer = Effects([item for item in simulator.effects if item[0] != name])
    plain = Simulator(simulator.core, fewer, simulator.record)
    rest = {n: found[n] for n in plain.names}
    fit = replace(model.fit, theta=np.array(list(rest.values())))
    scan = Scan(Model(plain, fit), name, variant, criterion, bent=False)
    own = {n.split("__")[-1]: v for n, v in found.items() if n not in rest} | variant.fixed
    values = variant.scanned_beside(scan, own)
    return [start_beside(scan.parent, simulator, name, v) for v in values]


def evolved(model: Model, name: str, criterion: Criterion) -> tuple[Model, np.ndarray]:
    """The model at the best minimum by differential evolution, if that is better than its own.

    All parameters together: events of an effect that jumps depend on the core too. On some runs;
    the core then follows on all. Under whitened residuals the minima are deep and narrow, and the
    fit of least simulation error may have ended in any of them. Returned too are the distances from
    the best of the last generation, of shape (POPULATION, n_parameters).
    """
    simulator, record = model.simulator, criterion.record
    runs = np.sort(np.argsort(-record.known.sum(axis=0), kind="stable")[:RUNS_EVOLVED])
    some = record if runs.size == record.n_runs else record.part(runs, 1)
    few = simulator.on(some)
    noise = RemnantModel(criterion.noise.ar, criterion.noise.scale[runs])
    on_few = Criterion(some, noise, rate=criterion.rate)
    effect = dict(simulator.effects.steps)[name]
    keys = [p.name for p in effect.free]
    mine = np.array([simulator.names.index(f"{name}__{key}") for key in keys])
    rest = np.setdiff1d(np.arange(model.theta.size), mine)
    values = {key: float(model.theta[i]) for key, i in zip(keys, mine, strict=True)}
    off = _how_far_off(model)
    low = np.maximum(simulator.low, model.theta - WIDEST * off)[rest]
    high = np.minimum(simulator.high, model.theta + WIDEST * off)[rest]
    start = sse_at(few, on_few, model.theta)

    def at(point: np.ndarray) -> np.ndarray:
        theta = model.theta.copy()
        theta[rest] = point[: rest.size]
        found = effect.within_cube(values, point[rest.size :], record)
        theta[mine] = [found[key] for key in keys]
        return np.clip(theta, simulator.low, simulator.high)

    def left(point: np.ndarray) -> float:
        return min(sse_at(few, on_few, at(point)), DIVERGED * start)

    rng = np.random.default_rng(0)
    first = np.empty((POPULATION, model.theta.size))
    for member in first:
        member[: rest.size] = model.theta[rest] + off[rest] * rng.standard_normal(rest.size)
        member[: rest.size] = np.clip(member[: rest.size], low, high)
        cube = rng.uniform(size=(DRAWN, mine.size))
        drawn = [np.r_[member[: rest.size], own] for own in cube]
        member[:] = min(drawn, key=left)
    bounds = [*zip(low, high, strict=True), *[(0.0, 1.0)] * mine.size]
    best = differential_evolution(
        left, bounds, init=first, maxiter=GENERATIONS, tol=1e-5, polish=False, rng=rng,
        mutation=(0.3, 0.9), recombination=0.8,
    )  # fmt: skip
    fixed = np.zeros(model.theta.size, dtype=bool)
    fixed[mine] = True
    fit = minimise(simulator, criterion, at(best.x), max_iter=6, fixed=fixed)
    found = Model(simulator, fit, model.other_cores) if fit.sse < model.sse else model
    return found, np.array([at(point) for point in best.population]) - at(best.x)


def _how_far_off(model: Model) -> np.ndarray:
    """What to add to or subtract from parameters of a first generation, typically."""
    simulator, core = model.simulator, model.simulator.core
    relative = dict.fromkeys(simulator.names, OFF) | dict.fromkeys(core.gains[1:], OFF_LEAD)
    relative |= {n: OFF_USUAL * one.spread for n, one in core.usual.items() if one.relative}
    sizes = [simulator.size(i, value) for i, value in enumerate(model.theta)]
    return np.array([relative[n] for n in simulator.names]) * sizes


def wandered(model: Model, criterion: Criterion, apart: np.ndarray) -> tuple[Model, np.ndarray]:
    """The likeliest parameters that Markov chains pass, and the covariance of chains about them.

    A likelihood with many narrow minima side by side has no slopes that would tell how far the
    estimates may be off. Each chain steps along the difference of two others, so that they find the
    directions and distances by themselves; they begin ``apart`` from the model by so much.

    References
    ----------
    Ter Braak, A Markov chain Monte Carlo version of the genetic algorithm differential evolution
    (2006).
    """
    simulator = model.simulator
    rng = np.random.default_rng(0)
    chains = np.clip(model.theta + apart[:CHAINS], simulator.low, simulator.high)
    chains[0] = model.theta
    squares = np.array([sse_at(simulator, criterion, theta) for theta in chains])
    best = int(squares.argmin())
    likeliest, least = chains[best].copy(), float(squares[best])
    passed = []
    for k in range(STEPS):
        for i in range(CHAINS):
            one, other = rng.choice(CHAINS, size=2, replace=False)
            theta = chains[i] + rng.choice(SHARES) * (chains[one] - chains[other])
            if not ((theta >= simulator.low) & (theta <= simulator.high)).all():
                continue
            sse = sse_at(simulator, criterion, theta)
            odds = criterion.n / 2 * (squares[i] - sse) / least
            if np.log(rng.uniform()) < odds:
                chains[i], squares[i] = theta, sse
            if sse < least:
                likeliest, least = theta.copy(), sse
        if k >= STEPS // 2:
            passed.append(chains.copy())
    away = np.concatenate(passed) - likeliest
    return model.at(likeliest), away.T @ away / len(away)
