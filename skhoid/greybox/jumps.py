"""Fits of effects whose response jumps with their parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..effects.composition import Effects
from .fitting import Criterion, minimise
from .model import Model, start_beside
from .scan import Scan
from .simulator import Simulator
from .tied import Tied

N_AGAIN = 2  # scans around what was found
SOFT = (0.1, 0.05, 0.025, 0.012)  # corners, ever sharper


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
        softened = dict(simulator.effects.steps)[name].softened(amount)
        if softened is None:
            return None
        steps = [(n, softened if n == name else e) for n, e in simulator.effects]
        soft = Simulator(simulator.core, Effects(steps), simulator.record)
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
