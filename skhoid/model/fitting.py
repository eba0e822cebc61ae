"""Maximum likelihood in simulation: bounded Levenberg-Marquardt on whitened residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz

from .. import _kernels
from ..effects.record import Record
from .cores import Prior
from .effort import is_spent
from .simulator import Simulator

# From many starting points, fits of all runs would mostly repeat what a few runs already show:
# minima are sought on some, and then all runs decide where they are.
MOST_ROWS = 200_000  # known samples, up to which all runs are taken


def some_runs(record: Record, most: int) -> np.ndarray | None:
    """Columns spread evenly over a record, which together have at most so many known samples.

    At least two; None where all have no more.
    """
    known = record.known.sum(axis=0)
    if known.sum() <= most:
        return None
    columns = np.flatnonzero(known)
    count = min(max(2, int(most / known[columns].mean())), columns.size)
    if count == columns.size:
        return None
    return columns[np.round(np.linspace(0, columns.size - 1, count)).astype(int)]


def take_some_runs(record: Record) -> Record | None:
    """The record of some runs with ``MOST_ROWS``; None where these are all runs."""
    columns = some_runs(record, MOST_ROWS)
    return None if columns is None else record.part(columns, 1)


AR_ORDER = 6  # what the kernel is written for
WHITE_FLOOR = 3e-3  # least share of the residual's variance that is white
NOISE_FLOOR = 1e-5  # the same where the noise model is estimated along with the parameters
EXPLORED_RUNS = 3
EXPLORED_STEP = 0.04  # s
STEP = 1e-4  # of finite differences, relative
COARSE_STEP = 5e-3  # where the response is not smooth
WORTHWHILE = 1e-4  # share of the squares that a common scale must save
FAR = 3.0  # times what a step promises, that it may save
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
        weights = record.weights
        self.sizes = None if weights is None else np.sqrt(weights[:: self.thin])
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

    def on_rows(self, rows: np.ndarray) -> Criterion:
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
        if self.sizes is not None:
            self.weight = self.weight * self.sizes

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
        return fit_remnant(self.residual(output), self.known, self.sizes)


def fit_remnant(
    residual: np.ndarray, known: np.ndarray, sizes: np.ndarray | None = None
) -> RemnantModel:
    """AR model of residuals (n, runs), and the rms of whitened residuals of each run.

    ``sizes`` are the square roots of what squares count.
    """
    order = AR_ORDER
    lags = np.zeros(order + 1)
    counted = known if sizes is None else known * sizes
    sized = residual if sizes is None else residual * sizes
    for lag in range(min(order + 1, len(residual))):
        n = len(residual) - lag
        pairs = max(float((counted[lag:] * counted[:n]).sum()), 1.0)
        lags[lag] = (sized[lag:] * sized[:n]).sum() / pairs
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


def find_residual(simulator: Simulator, criterion: Criterion, theta: np.ndarray) -> np.ndarray:
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
        theta, sse = rescale(simulator, criterion, theta, sse)
    better, hopeless = True, False
    for i in range(max_iter):
        if i and is_spent():
            break
        if i or at_start is None:
            normal, gradient = make_normal_equations(simulator, criterion, theta)
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


def rescale(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray, sse: float
) -> tuple[np.ndarray, float]:
    """Parameters and squares, with the output's scale solved for where that is better.

    All parameters in units of the output scale together: scaling only gains, or only levels of the
    output, would change when events happen.
    """
    power, product = find_power_and_product(simulator, criterion, theta)[:2]
    if product <= 0.0 or (power - product) ** 2 <= WORTHWHILE * sse * power:
        return theta, sse
    powers = np.array([p.dimension.u for p in simulator.parameters])
    trial = np.clip(theta * (product / power) ** powers, simulator.low, simulator.high)
    new = sse_at(simulator, criterion, trial)
    return (trial, new) if new < sse else (theta, sse)


def find_power_and_product(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> tuple[float, float, float]:
    """Whitened squares of the output at some parameters, its product with y, and squares of y."""
    gram = np.zeros((2, 2))
    for runs, part in simulator.parts():
        output = part.run(theta)[:: criterion.thin] * criterion.known[:, runs]
        table = criterion.whitened(np.stack([output, criterion.y[:, runs]]), runs)
        gram += [[a @ b for a in table] for b in table]
    return float(gram[0, 0]), float(gram[0, 1]), float(gram[1, 1])


def make_normal_equations(
    simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J'J and J'r for whitened residuals r and derivatives J of the output."""
    gram = np.zeros((theta.size + 1, theta.size + 1))
    for runs, part in simulator.parts():
        rows = _differentiate_part(part, criterion, theta, runs, range(theta.size))
        table = criterion.whitened(rows, runs)
        gram += table @ table.T
    return gram[:-1, :-1], gram[:-1, -1]


def sum_up(criterion: Criterion, rows: np.ndarray) -> Sums:
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
        rows[:, :, runs] = _differentiate_part(part, criterion, theta, runs, at)
    return rows


def _differentiate_part(
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


def find_felt(simulator: Simulator, theta: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """Which parameters change the output at all, from the squares of their derivatives."""
    size = np.array([simulator.size(i, value) for i, value in enumerate(theta)])
    moved = diagonal * size**2
    return moved > NO_CHANGE * moved.max(initial=0.0)


def scaled_inverse(matrix: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of a Gram matrix, scaled so that units do not decide what is small."""
    d = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(d, d), rcond=1e-12) / np.outer(d, d)
