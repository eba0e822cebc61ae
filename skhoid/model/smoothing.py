"""How smooth free forms are: the prior variance of their curves by marginal likelihood."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ..effects.composition import Effects
from ..effects.free_form import FreeForm
from .fitting import Criterion, make_normal_equations, minimise, scaled_inverse, sse_at
from .model import Model
from .simulator import Simulator

ROUNDS = 8  # of fit and choice, at most
SETTLED = 0.05  # change of the logarithm of the spread, below which it ends
NOTHING = 0.5  # effective degrees of freedom, below which a curve is not there
WORSE = 1.02  # times the squares, at most, by which a smoother curve may simulate worse
SMALLEST = 1e-3  # of the scale of the parameters: a straight line
ROUGHER = 10.0  # times the spread, of a curve that smoothing takes little from
FACTOR = 10.0  # by which a round may change the spread, at most
N_FINE = 20  # knots, at least, of a curve that is shown
CROWDED = 0.7  # effective degrees of freedom per coefficient of a curve that asks for more knots


class Posterior(NamedTuple):
    """Of parameters at a fit: covariance, and effective degrees of freedom of each."""

    covariance: np.ndarray
    dof: np.ndarray


def find_posterior(model: Model, criterion: Criterion) -> Posterior:
    """Covariance under data and prior, and how much of each parameter the data decide."""
    normal, _ = make_normal_equations(model.simulator, criterion, model.theta)
    sigma2 = sse_at(model.simulator, criterion, model.theta) / max(criterion.n, 1)
    curvature, _ = model.simulator.prior.weighing(sigma2).normal_equations(model.theta)
    inverse = scaled_inverse(normal + curvature)
    return Posterior(sigma2 * inverse, np.diag(inverse @ normal).copy())


def change_if_rougher(model: Model, name: str, criterion: Criterion) -> np.ndarray:
    """Change of parameters at a fit, linearised, if the spread of a curve were much greater."""
    simulator, theta = model.simulator, model.theta
    normal, _ = make_normal_equations(simulator, criterion, theta)
    sigma2 = sse_at(simulator, criterion, theta) / max(criterion.n, 1)
    curvature, slope = simulator.prior.weighing(sigma2).normal_equations(theta)
    own = np.array([one.startswith(f"{name}__") for one in simulator.names])
    weaker = np.where(own, 1 / ROUGHER**2, 1.0)
    free = np.flatnonzero((theta > simulator.low) & (theta < simulator.high))
    # At the fit the data's gradient balances the prior's slope, of which a part is taken away.
    released = (weaker - 1.0) * slope
    change = np.zeros(theta.size)
    inverse = scaled_inverse((normal + curvature * weaker)[np.ix_(free, free)])
    change[free] = inverse @ released[free]
    return change


def change_if_finer(
    model: Model, name: str, criterion: Criterion, finer: FreeForm, at: np.ndarray
) -> np.ndarray:
    """Change of a curve at points if it might be much rougher, and on the knots of another form."""
    assert finer.spread is not None
    rough = finer.with_choices(spread=ROUGHER * finer.spread)
    simulator, start = move_knots(model, name, rough)
    theta = minimise(simulator, criterion, start, max_iter=2).theta
    own = np.array([one.startswith(f"{name}__") for one in simulator.names])
    return np.asarray(rough.design(at) @ (theta - start)[own])


def smooth(model: Model, names: Collection[str]) -> Model:
    """A model with free forms that are as smooth as is most likely, at the minimum of that.

    The variance of a curve's coefficients is the sum of their squares, in units of the prior's,
    over their effective degrees of freedom (Wood and Fasiolo 2017, A generalized Fellner-Schall
    method for smoothing parameter optimization). Residuals are whitened: remnant is not taken for
    roughness.
    """
    criterion = Criterion(model.simulator.record)
    plain = Criterion(model.simulator.record)
    most = WORSE * sse_at(model.simulator, plain, model.theta)
    for number in range(ROUNDS):
        criterion.set_noise(criterion.remnant_model(model.output))
        found = model.refined(criterion, max_iter=4)
        if sse_at(found.simulator, plain, found.theta) > most:
            # What whitening favours may be no simulation, as long as the curve is too smooth.
            found = model if number == 0 else model.refined(plain, max_iter=4)
        spreads = choose_spreads(found, names, criterion)
        if not spreads:
            return found
        model = set_spreads(found, spreads)
        moved = [abs(np.log(new / old)) for new, old in spreads.values()]
        if max(moved) < SETTLED:
            return found if number else model
    return model.refined(criterion, max_iter=4)


def refine_detail(model: Model, name: str, least: int = N_FINE) -> Model:
    """A model at the least error of simulation, with more knots of a free form that has a curve.

    As many at least, by further ones half-way between. Between few knots a curve cannot bend: what
    it misses there is no error that its posterior knows. With many its smoothness is chosen by the
    likelihood alone.
    """
    effect = dict(model.effects.steps)[name]
    if not isinstance(effect, FreeForm) or not effect.free or effect.spread is None:
        return model
    finer, before = effect, None
    while len(finer.knots or ()) < least and finer.knots != before:
        before, finer = finer.knots, finer.with_more_knots()
    return model if finer.knots == effect.knots else fit_finer(model, name, finer)


def crowded(model: Model, name: str) -> bool:
    """Whether the data use most coefficients of a curve."""
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    dof = find_posterior(model, criterion).dof
    own = [one.startswith(f"{name}__") for one in model.simulator.names]
    return bool(dof[own].sum() > CROWDED * sum(own))


def fit_finer(model: Model, name: str, finer: FreeForm) -> Model:
    """The model with the same curve on other knots, and fitted."""
    plain = Criterion(model.simulator.record)
    simulator, start = move_knots(model, name, finer)
    fit = minimise(simulator, plain, start, max_iter=8)
    return smooth(Model(simulator, fit, model.other_cores), [name]).refined(plain)


def move_knots(model: Model, name: str, form: FreeForm) -> tuple[Simulator, np.ndarray]:
    """A simulator with a form that has other knots, and the parameters of the same curve."""
    effect, values = dict(model.effects.steps)[name], model.values()
    assert isinstance(effect, FreeForm)
    own = np.array([values[f"{name}__{p.name}"] for p in effect.free])
    found = form.coefficients(effect.curve(effect.curve.basis @ own, np.asarray(form.knots)))
    values |= {f"{name}__{key}": value for key, value in found.items()}
    steps = [(one, form if one == name else other) for one, other in model.effects]
    simulator = Simulator(model.simulator.core, Effects(steps), model.simulator.record)
    return simulator, np.array([values[one] for one in simulator.names])


def choose_spreads(
    model: Model, names: Collection[str], criterion: Criterion
) -> dict[str, tuple[float, float]]:
    """New and old spread of free forms by their names; none where there is no curve."""
    simulator, values = model.simulator, model.values()
    dof = find_posterior(model, criterion).dof
    found = {}
    for name, effect in model.effects:
        if name not in names or not isinstance(effect, FreeForm) or not effect.free:
            continue
        scales = {
            p.name: simulator.scale[simulator.names.index(f"{name}__{p.name}")] for p in effect.free
        }
        prior = effect.spreads(scales)
        if not prior:
            continue
        old = max(prior.values())
        at = [simulator.names.index(f"{name}__{key}") for key in prior]
        squares = sum((values[f"{name}__{key}"] / sd) ** 2 for key, sd in prior.items())
        factor = np.sqrt(squares / max(float(dof[at].sum()), 1e-300))
        if dof[at].sum() < NOTHING and not factor > 1.0:
            continue
        new = old * float(np.clip(factor, 1 / FACTOR, FACTOR))
        found[name] = (max(new, SMALLEST * max(scales.values())), old)
    return found


def set_spreads(model: Model, spreads: dict[str, tuple[float, float]]) -> Model:
    """The same parameters, with other spreads of free forms."""
    steps = [
        (name, effect.with_choices(spread=float(spreads[name][0])) if name in spreads else effect)
        for name, effect in model.effects
    ]
    simulator = Simulator(model.simulator.core, Effects(steps), model.simulator.record)
    return Model(simulator, model.fit, model.other_cores)
