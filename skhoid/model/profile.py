"""Profile likelihood intervals of effects' parameters, where standard errors do not hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from .fitting import Criterion, minimise, normal_equations, scaled_inverse, sse_at
from .likelihood import JOINT_RATE, joint_loss, prior_of
from .model import Model
from .some_runs import record_of_some

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


def profile_intervals(
    model: Model, criterion: Criterion, covariance: np.ndarray
) -> dict[str, tuple[float, float]]:
    """95 % intervals of the parameters of effects by their full names.

    An interval holds the values at which the others, the noise model too, explain the data nearly
    as well as at the estimate: the deviance from it is below the 95 % point of chi squared. What
    the ``covariance`` has beyond that of the likelihood (colour that the noise model leaves, a
    coarser simulation, other choices in the fit) adds to the squares of the distances. So where the
    likelihood is as a normal distribution has it, this is the interval of the standard error.
    Parameters at their bounds are free here, and their own intervals end there.

    Only for responses that are smooth in their parameters, and not for so many rows that some are
    fitted first: then standard errors hold.

    References
    ----------
    Venzon and Moolgavkar, A method for computing profile-likelihood-based confidence intervals
    (1988).
    """
    simulator = model.simulator
    curves = tuple(f"{name}__" for name, effect in simulator.effects if effect.free_form)
    mine = [i for i, n in enumerate(simulator.names) if "__" in n and not n.startswith(curves)]
    if not mine or not simulator.smooth or record_of_some(simulator.record) is not None:
        return {}
    return _Profile(model, criterion, covariance).intervals(mine)


class _Profile:
    """Deviances from a fitted model at values of single parameters."""

    def __init__(self, model: Model, criterion: Criterion, covariance: np.ndarray):
        simulator = self.simulator = model.simulator
        self.theta, self.criterion = model.theta, criterion
        self.prior = prior_of(simulator)
        self.variance = sse_at(simulator, criterion, self.theta) / max(criterion.n, 1)
        known, _ = self.prior.weighing(self.variance).normal_equations(self.theta)
        normal = normal_equations(simulator, criterion, self.theta)[0] + known
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
            self.joint = Criterion(simulator.record, rate=JOINT_RATE)
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
            best = joint_loss(self.simulator, theta, self.joint, held)
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
