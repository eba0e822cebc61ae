"""A fitted model on a record: a simulator, its parameters, and minimising from several starts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from .cores import Core
from .fitting import (
    Criterion,
    Fit,
    find_felt,
    find_power_and_product,
    make_normal_equations,
    minimise,
    scaled_inverse,
    sse_at,
)
from .simulator import Simulator

N_TRIED = 2  # iterations from every start
MANY = 4  # starts, of which each gets one iteration only
N_SCREENED = 10  # starts that are simulated more than once
N_SCREENED_COARSELY = 4  # the same, where the response is not smooth
N_STARTS_KEPT = 2  # starts that are followed to the end
ROUNDS = (4, 8, 40)  # iterations from all starts, from the better half, and so on
AT_BOUND = 1e-3  # of its size, by which a parameter is off a bound at most


@dataclass
class Model:
    """A simulator with parameters at a minimum.

    ``other_cores`` are usual parameters of the core: further starting points where a missing effect
    has pushed the minimum to a bound.
    """

    simulator: Simulator
    fit: Fit
    other_cores: tuple[dict[str, float], ...] = ()

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
    def n_parameters(self) -> float:
        """Number of estimated parameters, including numbers that effects found in the data.

        Those that are known beforehand count by as much as the data decide them.
        """
        count = self.theta.size + sum(effect.n_hidden for _, effect in self.effects)
        if self.simulator.estimates_start:
            count += self.simulator.record.n_runs * sum(effect.lasts for _, effect in self.effects)
        known = self.simulator.prior.weighing(self.sse / max(self.fit.n, 1))
        if not known.usual:
            return count
        curvature, _ = known.normal_equations(self.theta)
        decided = np.diag(scaled_inverse(self.fit.normal) @ curvature)
        return float(count - np.clip(decided, 0.0, 1.0).sum())

    @property
    def key(self) -> tuple:
        """Choices of the effects and parameters, by which it is known again on the same record."""
        chosen = [(name, type(e), repr(e.get_params())) for name, e in self.effects.steps]
        return *chosen, self.theta.tobytes()

    def values(self) -> dict[str, float]:
        return dict(zip(self.simulator.names, self.theta.tolist(), strict=True))

    def covariance(self) -> np.ndarray:
        """Covariance of the parameters; NaN for those at a bound or without effect."""
        inside = (self.theta > self.simulator.low) & (self.theta < self.simulator.high)
        inside &= find_felt(self.simulator, self.theta, np.diag(self.fit.normal))
        return self.fit.covariance(inside)

    def at_bound(self) -> list[str]:
        """Names of parameters at a bound, within a share of their own size."""
        simulator, found = self.simulator, []
        for i, name in enumerate(simulator.names):
            near = [
                abs(self.theta[i] - bound) <= AT_BOUND * simulator.size(i, bound)
                for bound in (simulator.low[i], simulator.high[i])
                if np.isfinite(bound)
            ]
            if any(near):
                found.append(name)
        return found

    def undetermined(self) -> list[str]:
        """Names of parameters that the data say nothing about.

        The output does not depend on them, or their standard error exceeds their range.
        """
        simulator = self.simulator
        sd = np.sqrt(np.diag(self.covariance()))
        lost = ~find_felt(simulator, self.theta, np.diag(self.fit.normal))
        lost |= sd > simulator.high - simulator.low
        return [name for name, is_lost in zip(simulator.names, lost, strict=True) if is_lost]

    def at(self, theta: np.ndarray) -> Model:
        """The same model with other parameters."""
        return Model(self.simulator, replace(self.fit, theta=theta), self.other_cores)

    def under(self, criterion: Criterion) -> Model:
        """The same parameters, with squares and normal equations of another criterion."""
        normal, gradient = make_normal_equations(self.simulator, criterion, self.theta)
        sse = sse_at(self.simulator, criterion, self.theta)
        known = self.simulator.prior.weighing(sse / max(criterion.n, 1))
        curvature, slope = known.normal_equations(self.theta)
        fit = Fit(self.theta, sse, criterion.n, normal + curvature, gradient + slope)
        return Model(self.simulator, fit, self.other_cores)

    def refined(self, criterion: Criterion, max_iter: int = 12, tol: float = 1e-5) -> Model:
        """The same model at the nearby minimum of another criterion."""
        fit = minimise(self.simulator, criterion, self.theta, max_iter=max_iter, tol=tol)
        return Model(self.simulator, fit, self.other_cores)


def fit_core(core: Core, record: Record, criterion: Criterion, starts: np.ndarray) -> Model:
    """The core without effects, from the best of some starts."""
    return find_best(Simulator(core, Effects([]), record), criterion, starts)


def find_best(
    simulator: Simulator,
    criterion: Criterion,
    starts: Iterable[np.ndarray],
    *,
    explore: bool = False,
    below: float = np.inf,
) -> Model:
    """Minimise from several starts: a few iterations from each, then on from the best.

    Starts that would not lead ``below`` a sum of squares are followed no further.
    """
    most, tol = (8, 2e-4) if explore else (20, 1e-5)
    points = [np.asarray(start, dtype=float) for start in starts]
    n_screened = N_SCREENED if simulator.smooth else N_SCREENED_COARSELY
    if len(points) > n_screened:
        points.sort(key=lambda s: find_scaled_sse(simulator, criterion, s))
        points = points[:n_screened]
    fits: list[Fit] = []
    if len(points) > N_STARTS_KEPT:
        first = 1 if len(points) > MANY else N_TRIED
        tried = [
            minimise(simulator, criterion, point, max_iter=first, tol=1e-3, below=below)
            for point in points
        ]
        tried.sort(key=lambda fit: fit.sse)
        fits = [fit for fit in tried[:N_STARTS_KEPT] if fit.hopeless]
        points = [fit.theta for fit in tried[:N_STARTS_KEPT] if not fit.hopeless]
    fits += [
        minimise(simulator, criterion, point, max_iter=most, tol=tol, below=below)
        for point in points
    ]
    return Model(simulator, min(fits, key=lambda fit: fit.sse))


def fit_by_halving(
    simulator: Simulator, criterion: Criterion, starts: Iterable[np.ndarray]
) -> Model:
    """Minimise from many starts: some iterations from all, more from the better half, and so on.

    The result is never worse than any start.
    """
    points = [np.asarray(start, dtype=float) for start in starts]
    fits: list[Fit] = []
    for most in ROUNDS:
        fits = [minimise(simulator, criterion, point, max_iter=most) for point in points]
        fits.sort(key=lambda fit: fit.sse)
        points = [fit.theta for fit in fits[: -(-len(fits) // 2)]]
    return Model(simulator, fits[0])


def find_scaled_sse(simulator: Simulator, criterion: Criterion, theta: np.ndarray) -> float:
    """Sum of squares left by the best multiple of the output at some parameters."""
    power, product, of_y = find_power_and_product(simulator, criterion, theta)
    if not np.isfinite(power) or power <= 0.0:
        return np.inf
    return of_y - max(product, 0.0) ** 2 / power


def make_start(
    parent: Model,
    simulator: Simulator,
    name: str,
    values: dict[str, float],
    core: dict[str, float] | None = None,
) -> np.ndarray:
    """Parameters of the parent and start values of one more effect as one vector.

    A start value called ``+`` and the name of a parameter of the parent is added to it, if there
    is one; see ``effects.error_scan``. ``core`` replaces parameters of the parent.
    """
    known = {**parent.values(), **(core or {})}
    for key, value in values.items():
        if not key.startswith("+"):
            known[f"{name}__{key}"] = value
        elif key[1:] in known:
            known[key[1:]] += value
    return np.clip([known[n] for n in simulator.names], simulator.low, simulator.high)


def without(model: Model, name: str, core: dict[str, float] | None = None) -> Model:
    """A model without one of its effects, at the nearby minimum of the simulation error.

    Without the effect it may diverge; then ``core`` replaces its parameters at the start.
    """
    kept = Effects([(n, e) for n, e in model.effects if n != name])
    simulator = Simulator(model.simulator.core, kept, model.simulator.record)
    criterion = Criterion(model.simulator.record)
    values = model.values()
    theta = np.array([values[n] for n in simulator.names])
    if core is not None:
        other = np.array([(values | core)[n] for n in simulator.names])
        theta = min(theta, other, key=lambda start: sse_at(simulator, criterion, start))
    return Model(simulator, replace(model.fit, theta=theta), model.other_cores).refined(criterion)


def begin_alike(parent: Model, name: str, effect: Effect, values: Mapping[str, float]) -> Model:
    """The parent, whose runs begin anywhere, as they do with an effect that lasts.

    It has that effect, which does nothing else: so levels of runs are no evidence of the effect.
    The parent itself where nothing lasts.
    """
    if not effect.lasts:
        return parent
    own = {p.name: values[p.name] for p in effect.free}
    idle = effect.with_values({**own, **effect.neutral})
    record = parent.simulator.record
    effects = Effects([*parent.effects.steps, (name, idle)])
    simulator = Simulator(parent.simulator.core, effects, record)
    if not simulator.estimates_start:
        return parent
    return Model(simulator, parent.fit, parent.other_cores).refined(Criterion(record))


def in_order(model: Model, names: Sequence[str]) -> Model:
    """The same model, its effects in the order of their names."""
    if model.effects.names == list(names):
        return model
    by_name = dict(model.effects.steps)
    simulator = Simulator(
        model.simulator.core, Effects([(n, by_name[n]) for n in names]), model.simulator.record
    )
    at = [model.simulator.names.index(n) for n in simulator.names]
    return Model(simulator, model.fit.permuted(at), model.other_cores)
