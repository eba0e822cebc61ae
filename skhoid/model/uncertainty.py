"""How far off estimates may be: covariance, and intervals of the profile likelihood."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from .cores import NO_PRIOR, Prior
from .fitting import (
    NOISE_FLOOR,
    STEP,
    Criterion,
    Fit,
    find_felt,
    make_normal_equations,
    minimise,
    scaled_inverse,
    sse_at,
    take_some_runs,
)
from .likelihood import collect_prior, joint_rate, minimise_joint_loss
from .model import Model
from .simulator import Simulator

UNKNOWN_DELAY = 12**-0.5  # of a sample, the rms of anything up to a half
SOFT_CORNERS = 0.2  # in steps, of slopes where the response jumps
SEARCHED = 0.02  # relative accuracy of parameters where the response is not smooth
MEMORY = 2.0  # s, over which scores may correlate


def estimate_covariance(
    simulator: Simulator, criterion: Criterion, fit: Fit, prior: Prior | None = None
) -> np.ndarray:
    """Covariance of an operator's parameters; NaN for those at a bound or without effect.

    Derivatives are differences over about a standard deviation; of an output in steps the corners
    are softened, since each row that jumps would tell more than any noise allows. The noise model
    is estimated from the same rows. Where whitened residuals are not white, a long-run covariance
    of the scores enlarges the variances. How far the estimates would move at twice the sampling
    time, or by what is between samples, counts too, and so do the last step of a search where the
    response is not smooth, and what other choices in the fit would have changed.
    """
    theta = fit.theta
    free = (theta > simulator.low) & (theta < simulator.high)
    covariance = np.full((theta.size, theta.size), np.nan)
    diagonal = np.diag(fit.normal)
    if not free.any():
        return covariance
    sigma = np.sqrt(sse_at(simulator, criterion, theta) / max(criterion.n - free.sum(), 1))
    sloped = simulator.with_soft_corners(SOFT_CORNERS)
    if not simulator.smooth:
        diagonal = np.diag(_sum_widely(sloped, criterion, theta, sigma, diagonal).gram)
    sums = _sum_widely(sloped, criterion, theta, sigma, diagonal)
    free &= find_felt(simulator, theta, np.diag(sums.gram)[: theta.size])
    known, _ = (prior or NO_PRIOR).weighing(sigma**2).normal_equations(theta)
    normal = sums.gram.copy()
    normal[: theta.size, : theta.size] += known
    n_noise = len(normal) - theta.size
    noise = theta.size + np.arange(n_noise)
    white = sums.gram[noise, noise].sum() / max(n_noise, 1)
    normal[noise, noise] += NOISE_FLOOR * white
    kept = np.r_[np.flatnonzero(free), noise]
    both = np.ix_(kept, kept)
    inverse = scaled_inverse(normal[both])[: free.sum()]
    block = sigma**2 * inverse[:, : free.sum()]
    robust = inverse @ sums.scores[both] @ inverse.T
    more = np.diag(robust) / np.maximum(np.diag(block), 1e-300)
    more = np.sqrt(np.clip(more, 1.0, None))
    block *= np.outer(more, more)
    for along in sums.along:
        moved = inverse @ along[kept]
        block += np.outer(moved, moved)
    if fit.beside is not None:
        block += fit.beside[np.ix_(free, free)]
    covariance[np.ix_(free, free)] = block
    for name, effect in simulator.effects:
        if not effect.smooth:
            own = [i for i, n in enumerate(simulator.names) if n.startswith(f"{name}__")]
            covariance[own, own] += (SEARCHED * theta[own]) ** 2
    return covariance


class _WideSums(NamedTuple):
    """Sums over rows of slopes over about a standard deviation, for all parameters.

    Products of pairs, the long-run covariance of scores, and products with what a coarser
    simulation and later channels would change. Those of the noise model come last.
    """

    gram: np.ndarray
    scores: np.ndarray
    along: np.ndarray


def _sum_widely(
    simulator: Simulator,
    criterion: Criterion,
    theta: np.ndarray,
    sigma: float,
    diagonal: np.ndarray,
) -> _WideSums:
    lags = round(MEMORY / (criterion.thin * simulator.record.dt))
    size = theta.size + criterion.noise.ar.size
    gram, scores = np.zeros((2, size, size))
    along = np.zeros((2, size))
    for runs, part in simulator.parts():
        output = part.run(theta)
        rows = differentiate_widely(part, criterion, theta, output, runs, sigma, diagonal)
        slopes, residual = rows[:-1], rows[-1]
        slopes = np.concatenate([slopes, differentiate_by_noise(criterion, output, runs)])
        gram += slopes @ slopes.T
        by_row = (slopes * residual).reshape(size, *criterion.y[:, runs].shape)
        scores += sum_long_run(by_row, lags)
        if not simulator.core.kind.has_limb:  # of samples, whatever is between them
            continue
        changes = [
            simulate_coarser(part, criterion, theta, output, runs),
            simulate_later(part, criterion, output, runs),
        ]
        along += criterion.whitened(np.stack(changes), runs) @ slopes.T
    return _WideSums(gram, scores, along)


def differentiate_by_noise(criterion: Criterion, output: np.ndarray, runs: slice) -> np.ndarray:
    """Derivatives of the whitened residual by the noise model, less their sign, as rows.

    Those of the output by its parameters have that sign too.
    """
    residual = criterion.residual(output, runs)
    earlier = np.zeros((criterion.noise.ar.size, *residual.shape))
    for i in range(len(earlier)):
        earlier[i, i + 1 :] = -residual[: -i - 1]
    return (earlier * criterion.weight[:, runs]).reshape(len(earlier), residual.size)


def differentiate_widely(
    part: Simulator,
    criterion: Criterion,
    theta: np.ndarray,
    output: np.ndarray,
    runs: slice,
    sigma: float,
    diagonal: np.ndarray,
) -> np.ndarray:
    """Whitened differences over the standard deviation that each parameter has on its own."""
    rows = np.empty((theta.size + 1, *criterion.y[:, runs].shape))
    for i, value in enumerate(theta):
        size = part.size(i, value)
        width = sigma / np.sqrt(max(diagonal[i], 1e-300))
        width = min(max(width, STEP * size), size)
        above = min(value + width, part.high[i])
        below = max(value - width, part.low[i])
        rows[i] = part.run_with_change(i, above)[:: criterion.thin]
        rows[i] -= part.run_with_change(i, below)[:: criterion.thin]
        rows[i] /= above - below
    rows[-1] = criterion.residual(output, runs)
    return criterion.whitened(rows, runs)


def sum_long_run(scores: np.ndarray, n_lags: int) -> np.ndarray:
    """Covariance of sums of scores (count, n, runs) that correlate in time (Newey and West)."""
    n_lags = min(n_lags, scores.shape[1] - 1)
    total = np.tensordot(scores, scores, axes=([1, 2], [1, 2]))
    for lag in range(1, n_lags + 1):
        cross = np.tensordot(scores[:, lag:], scores[:, :-lag], axes=([1, 2], [1, 2]))
        total += (1 - lag / (n_lags + 1)) * (cross + cross.T)
    return total


def simulate_coarser(
    part: Simulator, criterion: Criterion, theta: np.ndarray, output: np.ndarray, runs: slice
) -> np.ndarray:
    """Change of the output of some runs at twice the sampling time, on the criterion's rows."""
    half = part.record.part(np.arange(part.record.n_runs), 2)
    change = Simulator(part.core, part.effects, half).run(theta) - output[::2]
    if not np.isfinite(change).all():
        return np.zeros_like(criterion.y[:, runs])
    at = np.minimum(np.arange(0, len(output), criterion.thin) / 2, len(change) - 1)
    before = at.astype(int)
    after = np.minimum(before + 1, len(change) - 1)
    share = (at - before)[:, None]
    change = (1 - share) * change[before] + share * change[after]
    return np.where(criterion.known[:, runs], change, 0.0)


def simulate_later(
    part: Simulator, criterion: Criterion, output: np.ndarray, runs: slice
) -> np.ndarray:
    """Change of the output of some runs if all channels came later, on the criterion's rows.

    By the rms of what is not recorded: between two samples a channel may go straight to the next or
    hold its value, or anything between, which is late by up to half a sample. The output is too.
    """
    late = part.record.delayed(output, part.record.dt * UNKNOWN_DELAY)
    return np.where(criterion.known[:, runs], (late - output)[:: criterion.thin], 0.0)


CHI2_95 = float(chi2.ppf(0.95, 1))
NEAR = 0.1  # relative accuracy of an interval's ends
MOST_TRIED = 6  # values for an end
FARTHEST = 3.0  # times as far, at most, that the next value is
FLAT = 0.3  # of the root of the deviance allowed, below which nothing is known of its slope
FITTED = 6  # iterations at a value, where the noise model is given


class Conditional(NamedTuple):
    """At a value of one parameter: the deviance that the others leave at best, and all of them."""

    deviance: float
    theta: np.ndarray


def find_profile_intervals(
    model: Model, criterion: Criterion, covariance: np.ndarray
) -> dict[str, tuple[float, float]]:
    """95 % intervals of the parameters of effects by their full names, by profile likelihood.

    The square of an end's distance is that of the profile, plus 3.84 (chi-squared at 95 %) times
    what the variance in ``covariance`` exceeds that of the likelihood by: of a normal likelihood
    this is the interval of the standard error. Parameters at their bounds are free here, and their
    own intervals end there. Only for smooth responses, and not for so many rows that some are
    fitted first (Venzon and Moolgavkar 1988, A method for computing profile-likelihood-based
    confidence intervals).
    """
    simulator = model.simulator
    curves = tuple(f"{name}__" for name, effect in simulator.effects if effect.free_form)
    mine = [i for i, n in enumerate(simulator.names) if "__" in n and not n.startswith(curves)]
    if not mine or not simulator.smooth or take_some_runs(simulator.record) is not None:
        return {}
    return _Profile(model, criterion, covariance).intervals(mine)


class _Profile:
    """Deviances from a fitted model at values of single parameters."""

    def __init__(self, model: Model, criterion: Criterion, covariance: np.ndarray):
        simulator = self.simulator = model.simulator
        self.theta, self.criterion = model.theta, criterion
        self.prior = collect_prior(simulator)
        self.variance = sse_at(simulator, criterion, self.theta) / max(criterion.n, 1)
        known, _ = self.prior.weighing(self.variance).normal_equations(self.theta)
        normal = make_normal_equations(simulator, criterion, self.theta)[0] + known
        self.alone = self.variance * scaled_inverse(normal)  # also of what is at a bound
        self.free = (self.theta > simulator.low) & (self.theta < simulator.high)
        block = np.ix_(self.free, self.free)
        likely = np.diag(self.variance * scaled_inverse(normal[block]))
        beside = model.fit.beside
        self.more = np.zeros(self.theta.size) if beside is None else np.diag(beside).copy()
        self.more[self.free] = np.maximum(np.diag(covariance)[self.free] - likely, 0.0)
        self.off_bounds: list[np.ndarray] = []  # further starts
        self.joint = None
        if model.fit.jointly:
            self.joint = Criterion(simulator.record, rate=joint_rate(simulator.record))
        self.here = self._loss(self.theta, np.ones(self.theta.size, dtype=bool))

    def intervals(self, positions: list[int]) -> dict[str, tuple[float, float]]:
        simulator, found = self.simulator, {}
        for i in sorted(positions, key=lambda i: bool(self.free[i])):  # those at a bound first
            value, bounds = self.theta[i], (simulator.low[i], simulator.high[i])
            variance = float(np.nan_to_num(self.alone[i, i]))
            known = 0.0 < variance + self.more[i] <= (bounds[1] - bounds[0]) ** 2
            if self.free[i] and not known:
                continue  # not determined, and said so
            distance = float(np.sqrt(CHI2_95 * variance)) if known else bounds[1] - bounds[0]
            ends = []
            for sign, bound in zip((-1.0, 1.0), bounds, strict=True):
                likely = self._distance(i, sign, distance, bound)
                away = float(np.sqrt(likely**2 + CHI2_95 * self.more[i]))
                ends.append(value + sign * min(away, abs(bound - value)))
            found[simulator.names[i]] = (ends[0], ends[1])
            if not self.free[i]:  # where it moves the output, as it may not do at the bound
                inside = (ends[0] + ends[1]) / 2
                self.off_bounds.append(self.at(i, inside, self.theta).theta)
        return found

    def _loss(self, theta: np.ndarray, held: np.ndarray) -> Conditional:
        """What is minimised, from parameters of which some are held."""
        if self.joint is not None:
            best = minimise_joint_loss(self.simulator, theta, self.joint, held)
            return Conditional(np.inf, theta) if best is None else Conditional(*best)
        prior = self.prior.weighing(self.variance)
        fit = minimise(
            self.simulator, self.criterion, theta, max_iter=FITTED, fixed=held, prior=prior
        )
        return Conditional(fit.sse / self.variance + self.prior.distance(fit.theta), fit.theta)

    def at(self, position: int, value: float, beside: np.ndarray) -> Conditional:
        """The best of the other parameters, sought from those of a neighbouring value on."""
        held = np.zeros(self.theta.size, dtype=bool)
        held[position] = True
        along = self.alone[:, position]
        by = (value - beside[position]) / along[position] if along[position] > 0.0 else 0.0
        tried = []
        for start in (beside + by * along, *self.off_bounds):
            start = np.clip(start, self.simulator.low, self.simulator.high)
            start[position] = value
            tried.append(self._loss(start, held))
        found = min(tried, key=lambda one: one.deviance)
        return found._replace(deviance=found.deviance - self.here.deviance)

    def _distance(self, position: int, sign: float, distance: float, bound: float) -> float:
        """How far the deviance is below what an interval allows; to the bound at most.

        The root of the deviance grows nearly in proportion to the distance.
        """
        here, last = float(self.theta[position]), self.theta
        most = abs(bound - here)
        inner, outer = (0.0, 0.0), (np.inf, np.inf)  # distance, and root of the share allowed
        for _ in range(MOST_TRIED if most > 0.0 else 0):
            distance = min(distance, most)
            found = self.at(position, here + sign * distance, last)
            root = float(np.sqrt(max(found.deviance, 0.0) / CHI2_95))
            if abs(root - 1.0) < NEAR:
                return min(distance / root, most)
            if root > 1.0:
                outer = distance, root
            elif distance == most:
                return most
            else:
                inner, last = (distance, root), found.theta
            distance = self._next(inner, outer)
        return min(outer[0], FARTHEST * inner[0], most)

    @staticmethod
    def _next(inner: tuple[float, float], outer: tuple[float, float]) -> float:
        """The next distance to try, between one that is too short and one that is too long."""
        if not np.isfinite(outer[0]):
            return inner[0] * min(1 / max(inner[1], 1e-9), FARTHEST)
        if inner[1] < FLAT or not np.isfinite(outer[1]):
            return (inner[0] + outer[0]) / 2
        share = (1 - inner[1]) / (outer[1] - inner[1])
        return inner[0] + float(np.clip(share, 0.1, 0.9)) * (outer[0] - inner[0])
