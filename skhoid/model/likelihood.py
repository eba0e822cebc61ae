"""Maximum likelihood with a noise model that is estimated together with the model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ..effects.parameter import CoreKind
from ..effects.record import Record
from .cores import Prior
from .fitting import (
    AR_ORDER,
    NOISE_FLOOR,
    Criterion,
    RemnantModel,
    find_residual,
    fit_remnant,
    make_normal_equations,
    minimise,
    scaled_inverse,
    sse_at,
    take_some_runs,
)
from .jumps import SOFT, evolve, wander
from .loop import LoopSimulator, find_loop
from .model import Model
from .simulator import Simulator

# Rounds of noise model and refinement, at most.
N_LIKELIHOOD = {
    CoreKind.OPERATOR: 12,
    CoreKind.ARX: 2,
}
N_FREELY = {CoreKind.OPERATOR: 2, CoreKind.ARX: 0}  # rounds of which the free run may get worse
# Largest ratio of the squares of the simulation error to those of the round before (ARX: of all).
WORSE = {CoreKind.OPERATOR: 1.01, CoreKind.ARX: 1.05}
SETTLED = 1e-3  # of n log(SSE), by which a round must move the estimates to go on

JOINT_RATE = 12.5  # Hz: faster, errors of the simulation count more than the remnant
OTHER_RATES = (JOINT_RATE / 2, 2 * JOINT_RATE)  # at which a good estimate is about the same
LOOP_RATE = 6.25  # Hz, at which errors of sensors do not count in the closed loop
TOLERATED = 1.25  # times the squares of the simulation error, at most, of an unbiased estimate
STEADY = 0.02  # of n log(SSE), by which a round must be better to go on
DELAYS = (0.15, 0.25, 0.35)  # s, to start from
NEAR_BY = (0.3, 0.7, 0.85, 1.2, 1.4, 3.0)  # times the numbers of an effect with kinks
ROUNDS_AMONG_KINKS = 4
ROUNDS_AMONG_JUMPS = 3
ALIKE = 1.0  # of n log(SSE), by which minima side by side may differ
SAME = 0.1  # of n log(SSE), from a minimum, where a fit will end there too
NEEDED = 8.0  # of n log(SSE), that a gain on the error rate or another minimum must save
# Square of a gain over its variance, beyond which nobody needs to try without it: n log(SSE) rises
# by a tenth of that ratio at least, which is far more than NEEDED.
CLEARLY_NEEDED = 500.0
SHORT_LEAD = 0.05  # s, from which to seek how large a gain may be that was left out
SOUGHT, CLOSE, FARTHER = 4, 0.2, 3.0  # tries; relative accuracy; times as far, at most

Likeliest = tuple[float, np.ndarray] | None  # loss and parameters; None where no fit has led


def joint_rate(record: Record) -> float:
    """Rate (Hz) of the rows of a fit along with the noise model: all rows of a controller."""
    return JOINT_RATE if np.isfinite(record.criterion_rate) else np.inf


def likelihood_fit(model: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """Refine under an AR model of the residual that is estimated along with the parameters.

    In a closed loop the remnant goes round the loop into the error, and a response that is too slow
    fits it: the estimate of least simulation error is biased, and a noise model of its residual
    keeps the bias. So for an operator both are estimated together: see :func:`fit_jointly`.
    """
    kind = model.simulator.record.core
    model, noise = settled(model, criterion)
    if kind == CoreKind.ARX:
        return model, noise
    if not model.simulator.smooth:
        return choose_among_jumps(model, noise, criterion)
    theta, beside = fit_jointly(model)
    if theta is None:
        model.fit.beside = beside
        return model, noise
    found = Model(model.simulator, replace(model.fit, theta=theta), model.other_cores)
    residual = find_residual(found.simulator, criterion, theta)
    criterion.set_noise(fit_remnant(residual, criterion.known, criterion.sizes))
    found = found.under(criterion)
    found.fit.beside, found.fit.jointly = beside, True
    return found, criterion.noise


def make_criterion(model: Model, noise: RemnantModel) -> Criterion:
    """The criterion that a model's parameters minimise, for a noise model at the usual rate.

    A fit along with the noise model is on other rows, which decide how exact it is.
    """
    record = model.simulator.record
    if not model.fit.jointly:
        return Criterion(record, noise)
    found = make_joint_criterion(model.simulator, model.theta)
    return found or Criterion(record, noise, rate=joint_rate(record))


def settled(model: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """Refine under an AR model of the residual, and again under that of the new residual.

    Until neither moves. A wrong model would leave more and more to the noise model, so the free run
    may become only slightly worse (for an operator, after two rounds). An ARX model gets two
    rounds.
    """
    core = model.simulator.record.core
    core = CoreKind.OPERATOR if core.is_operator else core
    power = 0.0
    for i in range(N_LIKELIHOOD[core]):
        before, noise = model, criterion.noise
        residual = find_residual(model.simulator, criterion, model.theta)
        if i == 0 or core != CoreKind.ARX:
            power = float((residual**2).sum())
        criterion.set_noise(fit_remnant(residual, criterion.known, criterion.sizes))
        model = model.refined(criterion)
        moved = model.theta - before.theta
        after = float((find_residual(model.simulator, criterion, model.theta) ** 2).sum())
        worse = i >= N_FREELY[core] and after > WORSE[core] * power
        if worse or not after <= max(power, criterion.power):
            if not noise.ar.size:
                return before.under(criterion), criterion.noise
            criterion.set_noise(noise)
            return before, noise
        if criterion.n * (moved @ model.fit.normal @ moved) < SETTLED * model.sse:
            break
    return model, criterion.noise


def choose_among_jumps(
    model: Model, noise: RemnantModel, criterion: Criterion
) -> tuple[Model, RemnantModel]:
    """The likeliest minimum where effects jump, sought again under each new noise model.

    Its fit has the covariance of others that are about as likely.
    """
    jumping = [
        name
        for name, effect in model.effects
        if not effect.smooth and effect.free and effect.softened(SOFT[0]) is None
    ]
    if not jumping:
        return model, noise
    for _ in range(ROUNDS_AMONG_JUMPS):
        found = here = model.under(criterion)
        for name in jumping:
            found, apart = evolve(found, name, criterion)
        if not criterion.n * np.log(here.sse / found.sse) > NEEDED:
            break
        model, noise = settled(found, criterion)
    if take_some_runs(model.simulator.record) is not None:
        return model, noise  # chains on all runs would take long, and these hardly leave minima
    found, covariance = wander(model, criterion, apart)
    found = found.under(criterion)
    found.fit.beside = covariance
    return found, noise


def collect_prior(simulator: Simulator) -> Prior:
    """What is known of the parameters of a core and its effects before any data."""
    return Prior.of(simulator.names, simulator.core.usual) + simulator.prior


def fit_jointly(model: Model) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Parameters that are most probable jointly with a noise model; None where the fit fails.

    What is usual for people decides where the likelihood is flat, as between a delay and the lag of
    a limb; a gain on the error rate that is not needed is left out. The covariance due to choices
    is returned too: rows at half and at twice the rate; the closed loop
    (:func:`estimate_loop_bias`); how large a gain may be that was left out
    (:func:`seek_high_gain`). Where the simulation error forbids what is most probable, all of that
    difference counts.
    """
    simulator = model.simulator
    core = simulator.core
    few = take_some_runs(simulator.record)
    some = simulator if few is None else simulator.on_record(few)

    def best_from(starts: list[np.ndarray], held: np.ndarray | None = None) -> Likeliest:
        found = None if some is simulator else likeliest(some, starts, held=held)
        return likeliest(simulator, starts if found is None else [found[1]], held=held)

    starts = [model.theta, *usual_starts(simulator, model.theta)]
    best = best_from(starts)
    if best is None:
        return None, None
    extra = [simulator.names.index(name) for name in core.gains[1:]]
    held = np.zeros(model.theta.size, dtype=bool)
    beside = np.zeros((held.size, held.size))
    free = best
    if extra and best[1][extra].any() and not is_clearly_needed(simulator, best[1], extra):
        held[extra] = True
        plain = [np.where(held, 0.0, start) for start in [best[1], *starts]]
        without = best_from(plain, held)
        if without is not None and without[0] < best[0] + NEEDED:
            best = without
        else:
            held[:] = False
    for i in extra:
        if best[1][i] == 0.0:
            beside += _outer(seek_high_gain(simulator, free, i) - best[1])
    best, apart_minima = choose_among_kinks(simulator, best, held)
    beside += apart_minima
    theta = best[1]
    simulation = Criterion(simulator.record)
    least = sse_at(simulator, simulation, model.theta)
    if sse_at(simulator, simulation, theta) > TOLERATED * least:
        return None, _outer(theta - model.theta)
    rates = OTHER_RATES if joint_rate(simulator.record) == JOINT_RATE else ()
    others = [likeliest(simulator, [theta], rate, held) for rate in rates]
    apart = [_outer(one[1] - theta) / len(OTHER_RATES) for one in others if one is not None]
    open_loop = (None, theta) if some is simulator else likeliest(some, [theta], held=held)
    if open_loop is not None:
        apart.append(estimate_loop_bias(some, open_loop[1], held))
    return theta, beside + sum(apart)


def estimate_loop_bias(simulator: Simulator, theta: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Covariance due to how far the likeliest parameters in the closed loop are, beyond chance.

    If both models are right, the difference of an estimate from a better one has the difference of
    their variances (Hausman, Specification tests in econometrics, 1978).
    """
    in_loop = fit_in_loop(simulator, theta, held)
    criterion = make_joint_criterion(simulator, theta)
    if in_loop is None or criterion is None:
        return np.zeros((theta.size, theta.size))
    change = in_loop[0] - theta
    chance = np.abs(in_loop[1] - estimate_variances(simulator, criterion, theta, held))
    return _outer(np.sign(change) * np.sqrt(np.maximum(change**2 - chance, 0.0)))


def make_joint_criterion(simulator: Simulator, theta: np.ndarray) -> Criterion | None:
    """The criterion with the noise model of some parameters; None where there is none."""
    criterion = Criterion(simulator.record, rate=joint_rate(simulator.record))
    residual = find_residual(simulator, criterion, theta)
    noise = fit_autoregression(residual, criterion.known, criterion.sizes)
    if noise is None:
        return None
    criterion.set_noise(noise)
    return criterion


def is_clearly_needed(simulator: Simulator, theta: np.ndarray, positions: list[int]) -> bool:
    """Whether a gain at some position is so many standard errors large that it must be kept."""
    criterion = make_joint_criterion(simulator, theta)
    if criterion is None:
        return False
    variance = estimate_variances(simulator, criterion, theta, np.zeros(theta.size, dtype=bool))[
        positions
    ]
    return bool((theta[positions] ** 2 > CLEARLY_NEEDED * variance)[variance > 0.0].any())


def estimate_variances(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """Variances of parameters at their likeliest values; zero for those held or at a bound."""
    normal, _ = make_normal_equations(simulator, criterion, theta)
    variance = sse_at(simulator, criterion, theta) / criterion.n
    known, _ = collect_prior(simulator).weighing(variance).normal_equations(theta)
    free = ~held & (theta > simulator.low) & (theta < simulator.high)
    found = np.zeros(theta.size)
    found[free] = variance * np.diag(scaled_inverse((normal + known)[np.ix_(free, free)]))
    return found


def seek_high_gain(
    simulator: Simulator, best: tuple[float, np.ndarray], position: int
) -> np.ndarray:
    """Parameters that are likeliest with a gain one standard error above its likeliest value.

    What was left out is not known to be zero. Near zero a small gain on the error rate is nothing
    but a shorter delay, so that no tangent there says how large it may be.
    """
    least, theta = best
    held = np.zeros(theta.size, dtype=bool)
    held[position] = True
    step = max(SHORT_LEAD * abs(theta[simulator.names.index(simulator.core.gains[0])]), 1e-9)
    for _ in range(SOUGHT):
        start = theta.copy()
        start[position] = best[1][position] + step
        end = likeliest(simulator, [start], held=held)
        if end is None:
            break
        theta, away = end[1], np.sqrt(max(end[0] - least, 0.0))
        if abs(away - 1.0) < CLOSE:
            break
        step /= np.clip(away, 1 / FARTHER, FARTHER)
    return theta


def choose_among_kinks(
    simulator: Simulator, best: tuple[float, np.ndarray], held: np.ndarray
) -> tuple[tuple[float, np.ndarray], np.ndarray]:
    """The likeliest minimum near the one found, and the covariance of those about as likely.

    Only for effects with kinks, whose likelihood has many minima side by side: which one a fit ends
    in may depend on the rounding of the data.
    """
    own = [
        i
        for i, full in enumerate(simulator.names)
        for name, effect in simulator.effects
        if effect.kinks and full.startswith(f"{name}__")
    ]
    found = [best]
    for _ in range(ROUNDS_AMONG_KINKS if own else 0):
        last = best
        for factor in NEAR_BY:
            start = last[1].copy()
            start[own] *= factor
            end = likeliest(simulator, [start], held=held)
            found += [] if end is None else [end]
        best = min(found, key=lambda one: one[0])
        if last[0] - best[0] < ALIKE:
            break
    odds = np.exp([(best[0] - loss) / 2 for loss, _ in found])
    apart = [share * _outer(theta - best[1]) for share, (_, theta) in zip(odds, found, strict=True)]
    return best, np.sum(apart, axis=0) / odds.sum()


def fit_in_loop(
    simulator: Simulator, theta: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Likeliest parameters of a linear model in its closed loop if it is known, and variances."""
    loop = find_loop(simulator.record)
    linear = all(effect.place in ("path", "sum", "delay") for _, effect in simulator.effects)
    if loop is None or not linear:
        return None
    closed: Any = LoopSimulator(simulator.core, simulator.effects, simulator.record, loop)
    found = minimise(closed, Criterion(simulator.record), theta, max_iter=10, fixed=held).theta
    criterion = Criterion(simulator.record, rate=LOOP_RATE)
    for _ in range(2):
        output = closed.run(found)
        if not np.isfinite(output).all():
            return None
        criterion.set_noise(criterion.remnant_model(output))
        prior = collect_prior(simulator).weighing(criterion.sse(output) / criterion.n)
        found = minimise(closed, criterion, found, max_iter=10, fixed=held, prior=prior).theta
    if not np.isfinite(closed.run(found)).all():
        return None
    return found, estimate_variances(closed, criterion, found, held)


def _outer(change: np.ndarray) -> np.ndarray:
    return np.outer(change, change)


def usual_starts(simulator: Simulator, theta: np.ndarray) -> list[np.ndarray]:
    """The same parameters, with the core's usual values and delays from short to long."""
    core, found = simulator.core, []
    at = {name: simulator.names.index(name) for name in core.usual if name in simulator.names}
    free_delay = [at[name] for name in core.delays if name in at]
    for delay in DELAYS if free_delay else DELAYS[:1]:
        start = theta.copy()
        for name, usual in core.usual.items():
            if name in at:
                start[at[name]] = usual.centre
        start[free_delay] = delay
        found.append(start)
    return found


def likeliest(
    simulator: Simulator,
    starts: Iterable[np.ndarray],
    rate: float | None = None,
    held: np.ndarray | None = None,
    known: Likeliest = None,
) -> Likeliest:
    """Least n log(SSE / n) of model and noise model, with the cost of the prior; its parameters.

    On rows at a ``rate`` (Hz). ``known`` is what other starts have led to. None where no start
    succeeds.
    """
    held = np.zeros(simulator.low.size, dtype=bool) if held is None else held
    criterion = Criterion(simulator.record, rate=rate or joint_rate(simulator.record))
    for start in starts:
        found = minimise_joint_loss(simulator, start, criterion, held, known)
        if found is not None and (known is None or found[0] < known[0]):
            known = found
    return known


def minimise_joint_loss(
    simulator: Simulator,
    theta: np.ndarray,
    criterion: Criterion,
    held: np.ndarray,
    known: Likeliest = None,
) -> Likeliest:
    """From one start: n log(SSE / n), the cost of the prior, and the parameters.

    None where no fit leads on, or it leads to what is known.
    """
    prior = collect_prior(simulator)
    last = np.inf
    theta = np.clip(theta, simulator.low, simulator.high)
    for _ in range(N_LIKELIHOOD[CoreKind.OPERATOR]):
        residual = find_residual(simulator, criterion, theta)
        noise = fit_autoregression(residual, criterion.known, criterion.sizes)
        if noise is None:
            return None
        criterion.set_noise(noise)
        sse = sse_at(simulator, criterion, theta)
        if not np.isfinite(sse) or sse <= 0 or criterion.n <= theta.size:
            return None
        loss = criterion.n * np.log(sse / criterion.n) + prior.distance(theta)
        if last - loss < STEADY:
            break
        last, best = loss, theta
        fit = minimise(
            simulator,
            criterion,
            theta,
            max_iter=6,
            fixed=held,
            prior=prior.weighing(sse / criterion.n),
        )
        theta = fit.theta
        if known is not None:
            apart = theta - known[1]
            if criterion.n * (apart @ fit.normal @ apart) < SAME * fit.sse:
                return None
    return last, best


def fit_autoregression(
    residual: np.ndarray, known: np.ndarray, sizes: np.ndarray | None = None
) -> RemnantModel | None:
    """AR model of residuals (n, runs) by least squares, one for all runs.

    ``sizes`` are the square roots of what squares count.
    """
    order = AR_ORDER
    gram = np.zeros((order + 1, order + 1))
    if residual.shape[0] <= order:
        return None
    for j, (column, rows) in enumerate(zip(residual.T, known.T, strict=True)):
        whole = np.lib.stride_tricks.sliding_window_view(rows, order + 1).all(axis=1)
        windows = np.lib.stride_tricks.sliding_window_view(column, order + 1)[whole]
        if sizes is not None:
            windows = windows * sizes[order:, j][whole][:, None]
        gram += windows.T @ windows
    gram = gram[::-1, ::-1]
    past = gram[1:, 1:]
    white = NOISE_FLOOR * np.trace(past) / order
    if not white > 0:
        return None
    ar = -np.linalg.solve(past + white * np.eye(order), gram[1:, 0])
    return RemnantModel(ar, np.ones(residual.shape[1]))
