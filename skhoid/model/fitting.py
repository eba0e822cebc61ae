"""Maximum likelihood in simulation: bounded Levenberg-Marquardt on whitened residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz

from .. import _kernels
from ..effects.core_kind import CoreKind
from ..effects.record import Record
from .prior import NO_PRIOR, Prior
from .simulator import Simulator

AR_ORDER = 6  # what the kernel is written for
WHITE_FLOOR = 3e-3  # least share of the residual's variance that is white
NOISE_FLOOR = 1e-5  # the same where the noise model is estimated along with the parameters
UNKNOWN_DELAY = 12**-0.5  # of a sample, the rms of anything up to a half
EXPLORED_RUNS = 3
EXPLORED_STEP = 0.04  # s
STEP = 1e-4  # of finite differences, relative
COARSE_STEP = 5e-3  # where the response is not smooth
WORTHWHILE = 1e-4  # share of the squares that a common scale must save
SOFT_CORNERS = 0.2  # in steps, of slopes where the response jumps
SEARCHED = 0.02  # relative accuracy of parameters where the response is not smooth
FAR = 3.0  # times what a step promises, that it may save
MEMORY = 2.0  # s, over which scores may correlate
NO_CHANGE = 1e-14  # of the squares that the most influential parameter changes
ALL = slice(None)


@dataclass(frozen=True)
class RemnantModel:
    """AR model of the remnant on the criterion's rows, and the scale of each run."""

    ar: np.ndarray
    scale: np.ndarray

    @classmethod
    def white(cls, n_runs: int) -> RemnantModel:
        return cls(np.zeros(0), np.ones(n_runs))


class Sums(NamedTuple):
    """Sum of squares at some parameters, J'J and J'r there."""

    sse: float
    normal: np.ndarray
    gradient: np.ndarray


class Criterion:
    """Squares of whitened residuals on every ``thin``-th row, and their derivatives.

    Of the known rows, those in ``rows`` of shape (n_samples, n_runs) count; None means all.
    """

    def __init__(
        self,
        record: Record,
        noise: RemnantModel | None = None,
        *,
        rate: float | None = None,
        rows: np.ndarray | None = None,
    ):
        assert record.y is not None
        rate = record.criterion_rate if rate is None else rate
        self.record, self.rate = record, rate
        self.thin = max(1, round(1.0 / (rate * record.dt)))
        known = record.known if rows is None else record.known & rows
        self.y = record.y[:: self.thin].copy(order="K")
        self.known = known[:: self.thin].copy(order="K")
        self.power = float((self.y[self.known] ** 2).sum())
        about_mean = self.y[self.known] - self.y[self.known].sum() / max(self.known.sum(), 1)
        self.power_about_mean = float((about_mean**2).sum())
        self.set_noise(noise or RemnantModel.white(record.n_runs))

    def coarse(self) -> Criterion:
        """A cheaper criterion to explore with: some of the runs, at a lower rate."""
        n = self.record.known.sum(axis=0)
        runs = np.sort(np.argsort(-n, kind="stable")[:EXPLORED_RUNS])
        rate = self.record.criterion_rate
        # Without a finite rate no rows are skipped: an ARX model depends on the sampling time.
        thin = max(1, int(EXPLORED_STEP / self.record.dt + 1e-6)) if np.isfinite(rate) else 1
        return Criterion(self.record.part(runs, thin), rate=rate / 2)

    def on(self, rows: np.ndarray) -> Criterion:
        """The same criterion on some of the rows, a mask of shape (n_samples, n_runs)."""
        return Criterion(self.record, self.noise, rate=self.rate, rows=rows)

    def set_noise(self, noise: RemnantModel) -> None:
        self.noise = noise
        order = noise.ar.size
        weight = self.known.copy(order="K")
        for lag in range(1, order + 1):
            weight[lag:] &= self.known[:-lag]
        weight[:order] = False
        self.n = int(weight.sum())
        self.weight = weight / noise.scale

    def residual(self, output: np.ndarray, runs: slice = ALL) -> np.ndarray:
        """Residuals on the criterion's rows, zero where nothing is known.

        ``output`` is that of ``runs``.
        """
        return np.where(self.known[:, runs], self.y[:, runs] - output[:: self.thin], 0.0)

    def whitened(self, signals: np.ndarray, runs: slice = ALL) -> np.ndarray:
        """Signals (count, n, runs) on the criterion's rows as whitened rows of a table."""
        weight = self.weight[:, runs]
        if self.noise.ar.size == 0:
            return (signals * weight).reshape(len(signals), -1)
        return _kernels.greybox.whitened(
            _kernels.gate(signals), _kernels.gate(self.noise.ar), _kernels.gate(weight)
        )

    def sse(self, output: np.ndarray, runs: slice = ALL) -> float:
        """Sum of squares; infinite where the output is not finite."""
        if not np.isfinite(output[-1]).all():
            return np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            r = self.whitened(self.residual(output, runs)[None], runs)[0]
            value = float(r @ r)
        return value if np.isfinite(value) else np.inf

    def remnant_model(self, output: np.ndarray) -> RemnantModel:
        """AR model of the residual of an output, one for all runs, by Yule and Walker."""
        return remnant_model(self.residual(output), self.known)


def remnant_model(residual: np.ndarray, known: np.ndarray) -> RemnantModel:
    """AR model of residuals (n, runs), and the rms of whitened residuals of each run."""
    order = AR_ORDER
    lags = np.zeros(order + 1)
    for lag in range(order + 1):
        n = residual.shape[0] - lag
        pairs = max(int((known[lag:] & known[:n]).sum()), 1)
        lags[lag] = (residual[lag:] * residual[:n]).sum() / pairs
    if lags[0] <= 0.0:
        return RemnantModel(np.zeros(order), np.ones(residual.shape[1]))
    lags[0] *= 1 + WHITE_FLOOR
    ar = -solve_toeplitz(lags[:order], lags[1:])
    errors = _kernels.greybox.whitened(
        _kernels.gate(residual[None]), _kernels.gate(ar), _kernels.gate(known.astype(float))
    )[0]
    counts = np.maximum(known.sum(axis=0), 1)
    power = (errors.reshape(residual.shape) ** 2).sum(axis=0) / counts
    # Runs with stronger remnant count less, within a factor of three: no single run decides.
    scale = np.sqrt(np.clip(power, power.mean() / 9, None))
    if power.mean() <= 0:
        return RemnantModel(ar, np.ones(residual.shape[1]))
    return RemnantModel(ar, scale / np.sqrt(power.mean()))


@dataclass
class Fit:
    """Parameters at a minimum, and the normal equations there.

    ``beside`` is the part of the covariance due to choices that could have been made differently,
    ``jointly`` whether the noise model was estimated along with the parameters, ``hopeless``
    whether the fit ended as it would not have saved what was asked.
    """

    theta: np.ndarray
    sse: float
    n: int
    normal: np.ndarray
    gradient: np.ndarray
    beside: np.ndarray | None = None
    jointly: bool = False
    hopeless: bool = False

    def covariance(self, free: np.ndarray) -> np.ndarray:
        """Covariance of the parameters; those not ``free`` (at a bound) have none."""
        covariance = np.full_like(self.normal, np.nan)
        if free.any():
            sigma2 = self.sse / max(self.n - free.sum(), 1)
            inverse = scaled_inverse(self.normal[np.ix_(free, free)])
            covariance[np.ix_(free, free)] = sigma2 * inverse
        return covariance

    def permuted(self, at: list[int]) -> Fit:
        """The same fit of a model whose parameters are those ``at`` these positions, in order."""
        normal = self.normal[np.ix_(at, at)]
        return replace(self, theta=self.theta[at], normal=normal, gradient=self.gradient[at])


def sse_at(simulator: Simulator, criterion: Criterion, theta: np.ndarray) -> float:
    """Sum of squares at these parameters; for a large record the output is not kept."""
    return sum(criterion.sse(part.run(theta), runs) for runs, part in simulator.parts())


def residual_at(simulator: Simulator, criterion: Criterion, theta: np.ndarray) -> np.ndarray:
    """Residuals on the criterion's rows at parameters."""
    found = np.empty_like(criterion.y)
    for runs, part in simulator.parts():
        found[:, runs] = criterion.residual(part.run(theta), runs)
    return found


def minimise(
    simulator: Simulator,
    criterion: Criterion,
    theta: np.ndarray,
    *,
    max_iter: int = 20,
    tol: float = 1e-5,
    fixed: np.ndarray | None = None,
    prior: Prior | None = None,
    at_start: Sums | None = None,
    below: float = np.inf,
) -> Fit:
    """Levenberg-Marquardt with bounds by projection and finite differences.

    Stops when a step lowers the sum of squares by less than ``tol`` of itself. Where the response
    is not smooth, its scale is solved for at the start, whatever is ``fixed``. The cost of a
    ``prior``, by default that of the effects, adds to the sum of squares that is minimised, not to
    that of the fit. ``at_start`` is for a start whose sums are known, where the response is smooth.
    A smooth fit ends where even several times what a step promises would not lead ``below`` a sum
    of squares.
    """
    low, high = simulator.low, simulator.high
    theta = np.clip(theta, low, high)
    held = np.zeros(theta.size, dtype=bool) if fixed is None else fixed
    sse = sse_at(simulator, criterion, theta) if at_start is None else at_start.sse
    damping = 1e-3
    normal, gradient = np.eye(theta.size), np.zeros(theta.size)
    if not np.isfinite(sse):
        return Fit(theta, np.inf, criterion.n, normal, gradient)
    if prior is None:
        prior = simulator.prior.weighing(sse / max(criterion.n, 1))
    if not simulator.smooth:
        theta, sse = rescaled(simulator, criterion, theta, sse)
    better, hopeless = True, False
    for i in range(max_iter):
        if i or at_start is None:
            normal, gradient = normal_equations(simulator, criterion, theta)
        else:
            _, normal, gradient = at_start
        curvature, slope = prior.normal_equations(theta)
        normal, gradient = normal + curvature, gradient + slope
        at_low = (theta <= low) & (gradient < 0)
        at_high = (theta >= high) & (gradient > 0)
        free = ~(held | at_low | at_high)
        if not free.any():
            break
        better = False
        for _retry in range(6):
            step = np.zeros_like(theta)
            block = normal[np.ix_(free, free)]
            # Scaled, so that units do not decide what is small.
            d = np.sqrt(np.where(np.diag(block) > 0, np.diag(block), 1.0))
            scaled = block / np.outer(d, d) + damping * np.eye(d.size)
            try:
                step[free] = np.linalg.solve(scaled, gradient[free] / d) / d
            except np.linalg.LinAlgError:
                damping *= 10
                continue
            if simulator.smooth and sse - FAR * (gradient @ step) > below:
                hopeless = True
                break
            trial = np.clip(theta + step, low, high)
            new = sse_at(simulator, criterion, trial)
            gain = sse - new + prior.cost(theta) - prior.cost(trial)
            if gain > 0:
                better = True
                break
            if not simulator.exact and step @ (2 * gradient - normal @ step) < tol * sse:
                break  # promised by derivatives whose errors are larger; shorter steps promise less
            damping *= 8
        if not better:
            break
        theta, sse = trial, new
        damping = max(damping / 6, 1e-9)
        if gain < tol * sse:
            break
    return Fit(theta, sse, criterion.n, normal, gradient, hopeless=hopeless)


def rescaled(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray, sse: float
) -> tuple[np.ndarray, float]:
    """Parameters and squares, with the output's scale solved for where that is better.

    All parameters in units of the output scale together: scaling only gains, or only levels of the
    output, would change when events happen.
    """
    power, product = power_and_product(simulator, criterion, theta)[:2]
    if product <= 0.0 or (power - product) ** 2 <= WORTHWHILE * sse * power:
        return theta, sse
    powers = np.array([p.dimension.u for p in simulator.parameters])
    trial = np.clip(theta * (product / power) ** powers, simulator.low, simulator.high)
    new = sse_at(simulator, criterion, trial)
    return (trial, new) if new < sse else (theta, sse)


def power_and_product(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> tuple[float, float, float]:
    """Whitened squares of the output at some parameters, its product with y, and squares of y."""
    gram = np.zeros((2, 2))
    for runs, part in simulator.parts():
        output = part.run(theta)[:: criterion.thin] * criterion.known[:, runs]
        table = criterion.whitened(np.stack([output, criterion.y[:, runs]]), runs)
        gram += [[a @ b for a in table] for b in table]
    return float(gram[0, 0]), float(gram[0, 1]), float(gram[1, 1])


def normal_equations(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J'J and J'r for whitened residuals r and derivatives J of the output."""
    gram = np.zeros((theta.size + 1, theta.size + 1))
    for runs, part in simulator.parts():
        rows = _derivatives(part, criterion, theta, runs, range(theta.size))
        table = criterion.whitened(rows, runs)
        gram += table @ table.T
    return gram[:-1, :-1], gram[:-1, -1]


def sums_of(criterion: Criterion, rows: np.ndarray) -> Sums:
    """Sums of a criterion, from :func:`derivatives` of one on the same or on more rows."""
    table = criterion.whitened(rows)
    gram = table @ table.T
    return Sums(float(gram[-1, -1]), gram[:-1, :-1], gram[:-1, -1])


def whitened_derivatives(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> np.ndarray:
    """Whitened derivatives by each parameter, and the whitened residual as the last row."""
    return criterion.whitened(derivatives(simulator, criterion, theta))


def derivatives(
    simulator: Simulator,
    criterion: Criterion,
    theta: np.ndarray,
    at: Sequence[int] | None = None,
) -> np.ndarray:
    """Derivatives of the output by each parameter on the criterion's rows, then the residual.

    Only by parameters ``at`` some positions, if these are given.
    """
    at = range(theta.size) if at is None else at
    rows = np.empty((len(at) + 1, *criterion.y.shape))
    for runs, part in simulator.parts():
        rows[:, :, runs] = _derivatives(part, criterion, theta, runs, at)
    return rows


def _derivatives(
    part: Simulator, criterion: Criterion, theta: np.ndarray, runs: slice, at: Sequence[int]
) -> np.ndarray:
    """The same of a part's runs."""
    output = part.run(theta)
    relative = STEP if part.smooth else COARSE_STEP
    thin = criterion.thin
    here = output[::thin]
    rows = np.empty((len(at) + 1, *here.shape))
    for row, i in zip(rows, at, strict=False):
        value = theta[i]
        h = relative * part.size(i, value)
        if value + h > part.high[i]:
            h = -h
        np.subtract(part.run_with_change(i, value + h)[::thin], here, out=row)
        row *= 1 / h
    rows[-1] = criterion.residual(output, runs)
    return rows


def felt(simulator: Simulator, theta: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """Which parameters change the output at all, from the squares of their derivatives."""
    size = np.array([simulator.size(i, value) for i, value in enumerate(theta)])
    moved = diagonal * size**2
    return moved > NO_CHANGE * moved.max(initial=0.0)


def covariance_of(
    simulator: Simulator, criterion: Criterion, fit: Fit, prior: Prior | None = None
) -> np.ndarray:
    """Covariance of an operator's parameters; NaN for those at a bound or without effect.

    It has these parts. Derivatives are differences over about a standard deviation, which are more
    meaningful than the tangent of a stepped or jagged response; of an output in steps the corners
    are softened, since each row that jumps would tell more than any noise allows. The noise model
    is estimated from the same rows: in a closed loop the remnant is in the error too, and what one
    of both takes the other lacks. Where whitened residuals are not white, a long-run covariance of
    the scores enlarges the variances. How far the estimates would move at twice the sampling time
    counts as a further standard deviation, and so does what is between samples
    (:func:`change_if_later`): the accuracy of the simulation limits them whatever the noise. So do
    the last step of a search where the response is not smooth, and what other choices in the fit
    would have changed.
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
        diagonal = np.diag(_wide_sums(sloped, criterion, theta, sigma, diagonal).gram)
    sums = _wide_sums(sloped, criterion, theta, sigma, diagonal)
    free &= felt(simulator, theta, np.diag(sums.gram)[: theta.size])
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


def _wide_sums(
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
        rows = wide_derivatives(part, criterion, theta, output, runs, sigma, diagonal)
        slopes, residual = rows[:-1], rows[-1]
        slopes = np.concatenate([slopes, by_noise(criterion, output, runs)])
        gram += slopes @ slopes.T
        by_row = (slopes * residual).reshape(size, *criterion.y[:, runs].shape)
        scores += long_run(by_row, lags)
        if simulator.core.kind == CoreKind.ARX:  # of samples, whatever is between them
            continue
        changes = [
            change_if_coarser(part, criterion, theta, output, runs),
            change_if_later(part, criterion, output, runs),
        ]
        along += criterion.whitened(np.stack(changes), runs) @ slopes.T
    return _WideSums(gram, scores, along)


def by_noise(criterion: Criterion, output: np.ndarray, runs: slice) -> np.ndarray:
    """Derivatives of the whitened residual by the noise model, less their sign, as rows.

    Those of the output by its parameters have that sign too.
    """
    residual = criterion.residual(output, runs)
    earlier = np.zeros((criterion.noise.ar.size, *residual.shape))
    for i in range(len(earlier)):
        earlier[i, i + 1 :] = -residual[: -i - 1]
    return (earlier * criterion.weight[:, runs]).reshape(len(earlier), residual.size)


def wide_derivatives(
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


def long_run(scores: np.ndarray, n_lags: int) -> np.ndarray:
    """Covariance of sums of scores (count, n, runs) that correlate in time (Newey and West)."""
    n_lags = min(n_lags, scores.shape[1] - 1)
    total = np.tensordot(scores, scores, axes=([1, 2], [1, 2]))
    for lag in range(1, n_lags + 1):
        cross = np.tensordot(scores[:, lag:], scores[:, :-lag], axes=([1, 2], [1, 2]))
        total += (1 - lag / (n_lags + 1)) * (cross + cross.T)
    return total


def change_if_coarser(
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


def change_if_later(
    part: Simulator, criterion: Criterion, output: np.ndarray, runs: slice
) -> np.ndarray:
    """Change of the output of some runs if all channels came later, on the criterion's rows.

    By the rms of what is not recorded: between two samples a channel may go straight to the next or
    hold its value, or anything between, which is late by up to half a sample. The output is too.
    """
    late = part.record.delayed(output, part.record.dt * UNKNOWN_DELAY)
    return np.where(criterion.known[:, runs], (late - output)[:: criterion.thin], 0.0)


def scaled_inverse(matrix: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of a Gram matrix, scaled so that units do not decide what is small."""
    d = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(d, d), rcond=1e-12) / np.outer(d, d)
