"""Models on a record: fitting a core, and adding an effect to a fitted model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from .cores import Core, OperatorCore
from .fitting import Criterion, Fit, Noise, minimise
from .simulator import Simulator

N_TRIED = 2  # iterations from every start
N_KEPT = 2  # starts that are followed to the end


@dataclass
class Model:
    """A simulator with parameters at a minimum."""

    simulator: Simulator
    fit: Fit

    @property
    def effects(self) -> Effects:
        return self.simulator.effects

    @property
    def theta(self) -> np.ndarray:
        return self.fit.theta

    @property
    def sse(self) -> float:
        return self.fit.sse

    @property
    def output(self) -> np.ndarray:
        return self.simulator.run(self.theta)

    @property
    def n_parameters(self) -> int:
        """Parameters estimated, counting what effects found beside them."""
        hidden = sum(getattr(effect, "n_hidden", 0) for _, effect in self.effects)
        return self.theta.size + hidden

    def values(self) -> dict[str, float]:
        return dict(zip(self.simulator.names, self.theta.tolist(), strict=True))

    def covariance(self) -> np.ndarray:
        """Covariance of the parameters; NaN for those at a bound."""
        inside = (self.theta > self.simulator.low) & (self.theta < self.simulator.high)
        return self.fit.covariance(inside)

    def refined(self, criterion: Criterion, max_iter: int = 12, tol: float = 1e-5) -> Model:
        """The same model at the minimum of another criterion nearby."""
        fit = minimise(self.simulator, criterion, self.theta, max_iter=max_iter, tol=tol)
        return Model(self.simulator, fit)


def fit_core(core: Core, record: Record, criterion: Criterion, starts: np.ndarray) -> Model:
    """The core without effects, from the best of some starts."""
    return best_of(Simulator(core, Effects([]), record), criterion, starts)


def operator_starts(core: OperatorCore, record: Record, criterion: Criterion) -> np.ndarray:
    """Starts of an operator: gains by least squares on a grid of delay and neuromuscular system."""
    simulator = Simulator(core, Effects([]), record)
    delays = np.arange(0.06, 0.62, 0.08) if core.fixed_delay is None else np.zeros(1)
    found = []
    for delay in delays:
        for omega in (5.0, 9.0, 15.0):
            for zeta in (0.25, 0.7):
                theta = np.array([1.0, 0.0, omega, zeta, delay][: len(core.parameters)])
                by_gain = []
                for gains in ((1.0, 0.0), (0.0, 1.0)):
                    theta[:2] = gains
                    by_gain.append(simulator.run(theta)[:: criterion.thin])
                table = criterion.whitened(np.stack([*by_gain, criterion.y * criterion.known]))
                a, b, y = table
                rate_only = max(float(b @ y) / max(float(b @ b), 1e-300), 0.0)
                solved = np.linalg.lstsq(np.stack([a, b], 1), y, rcond=None)[0]
                if solved[1] < 0:
                    solved = np.array([float(a @ y) / max(float(a @ a), 1e-300), 0.0])
                residual = y - solved[0] * a - solved[1] * b
                theta[:2] = solved
                found.append((float(residual @ residual), rate_only, theta.copy()))
    found.sort(key=lambda item: item[0])
    return np.array([theta for _, _, theta in found[:4]])


def best_of(simulator: Simulator, criterion: Criterion, starts: Iterable[np.ndarray]) -> Model:
    """Minimise from several starts: a little from all, to the end from the best."""
    starts = list(starts)
    if len(starts) > N_KEPT:
        tried = [
            minimise(simulator, criterion, np.asarray(s, dtype=float), max_iter=N_TRIED)
            for s in starts
        ]
        tried.sort(key=lambda fit: fit.sse)
        starts = [fit.theta for fit in tried[:N_KEPT]]
    fits = [minimise(simulator, criterion, np.asarray(s, dtype=float)) for s in starts]
    return Model(simulator, min(fits, key=lambda fit: fit.sse))


def extended(parent: Model, name: str, effect: Effect, criterion: Criterion) -> Model | None:
    """A fitted model with one more effect, from the best of its variants and starts.

    None where the effect has nothing to try on this record.
    """
    record = replace(parent.simulator.record, prediction=parent.output)
    best: Model | None = None
    for variant in effect.variants(record):
        together = Effects([*parent.effects.steps, (name, variant)])
        simulator = Simulator(parent.simulator.core, together, parent.simulator.record)
        starts = [
            start_beside(parent, simulator, name, values) for values in variant.starts(record)
        ]
        model = best_of(simulator, criterion, starts)
        if not variant.smooth:
            model = searched(model, name, criterion)
        if best is None or model.sse < best.sse:
            best = model
    return best


def start_beside(
    parent: Model, simulator: Simulator, name: str, values: dict[str, float]
) -> np.ndarray:
    """Parameters of the parent and start values of a further effect as one vector."""
    known = parent.values()
    known.update({f"{name}__{key}": value for key, value in values.items()})
    return np.clip([known[n] for n in simulator.names], simulator.low, simulator.high)


def searched(model: Model, name: str, criterion: Criterion) -> Model:
    """Pattern search over the parameters of an effect whose response is not smooth in them."""
    simulator = model.simulator
    mine = [i for i, n in enumerate(simulator.names) if n.startswith(f"{name}__")]
    fixed = np.zeros(model.theta.size, dtype=bool)
    fixed[mine] = True
    best = model.fit
    for size in (0.15, 0.05, 0.015):
        for i in mine:
            width = size * max(abs(best.theta[i]), 0.05 * simulator.scale[i])
            for sign in (1.0, -1.0):
                for _ in range(4):
                    theta = best.theta.copy()
                    theta[i] = np.clip(theta[i] + sign * width, simulator.low[i], simulator.high[i])
                    sse = criterion.sse(simulator.run(theta))
                    if not sse < best.sse:
                        break
                    best = replace(best, theta=theta, sse=sse)
        best = minimise(simulator, criterion, best.theta, max_iter=3, fixed=fixed)
    return Model(simulator, best)


def noise_of_best(models: Iterable[Model], criterion: Criterion) -> Noise:
    """AR model of the residual of the model with the smallest free-run error."""
    best = min(models, key=lambda m: m.sse)
    return criterion.noise_of(best.output)
