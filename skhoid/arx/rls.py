"""Recursive least squares on the instants of aligned runs: its start, its path, its likelihood."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from .. import _kernels
from ..exceptions import PoorExcitationWarning
from ..preprocessing.grid import ModelGrid
from ..runs import whole_samples
from .forgetting import Forgetting, kernel_arrays
from .least_squares import Triangle, weighted
from .orders import Orders, regressors

NOTHING = np.empty((0, 0, 0))
OWN, LONG = (1, 4), 500_000  # lanes and parameters with their own kernel, updates that are worth it


@dataclass(frozen=True)
class Instants:
    """The sampling instants of several runs, aligned by time in the run.

    ``number`` counts samples from time zero for each instant, and is not broken where any run
    goes on; ``of_row`` and ``run`` say where the rows of the grid belong.
    """

    number: np.ndarray
    of_row: np.ndarray
    run: np.ndarray
    dt: float
    n_runs: int

    @classmethod
    def of(cls, grid: ModelGrid) -> Instants:
        number = grid_numbers(grid)
        n_runs = len(grid.layout.labels)
        rows = np.arange(number.size) if grid.rows is None else grid.rows
        run = grid.layout.run_of(rows) if n_runs > 1 else np.zeros(number.size, dtype=np.int64)
        if n_runs == 1:
            return cls(number, np.arange(number.size), run, grid.dt, 1)
        unique, of_row = np.unique(number, return_inverse=True)
        return cls(unique, of_row, run, grid.dt, n_runs)

    @cached_property
    def time(self) -> np.ndarray:
        """Time in the run in seconds."""
        return self.number * self.dt

    def __len__(self) -> int:
        return self.number.size


@dataclass(frozen=True)
class RecursionData:
    """Recorded runs as the recursion takes them.

    ``signals`` are -y, the inputs and ones where there is an intercept, of shape (n_signals,
    n_instants, n_runs, 1), and ``target`` is the output where it gives an update; both are NaN
    where a run has no row. ``weights`` are those of the rows, if any are given.
    """

    grid: ModelGrid
    inputs: np.ndarray
    output: np.ndarray
    orders: Orders
    instants: Instants
    signals: np.ndarray
    target: np.ndarray
    weights: np.ndarray | None = None

    @property
    def n_rows_without_lags(self) -> int:
        """Rows in the run-in or so early in a stretch that their lags are not known."""
        grid = self.grid
        lengths = grid.end - grid.begin
        return int(
            np.where(grid.measured, np.minimum(lengths, self.orders.first_row), lengths).sum()
        )

    @classmethod
    def of(
        cls,
        grid: ModelGrid,
        inputs: np.ndarray,
        output: np.ndarray,
        orders: Orders,
        weights: np.ndarray | None = None,
    ) -> RecursionData:
        instants = Instants.of(grid)
        shape = (len(instants), instants.n_runs, 1)
        signals = np.full((1 + inputs.shape[1] + orders.intercept, *shape), np.nan)
        target = np.full(shape, np.nan)
        alone = instants.n_runs == 1
        at: Any = (slice(None), 0, 0) if alone else (instants.of_row, instants.run, 0)
        signals[(0, *at)] = -output
        for position, column in enumerate(inputs.T):
            signals[(1 + position, *at)] = column
        if orders.intercept:
            signals[-1] = 1.0
        target[at] = _usable(grid, output, orders)
        return cls(grid, inputs, output, orders, instants, signals, target, weights)

    @cached_property
    def sizes(self) -> np.ndarray | None:
        """Square roots of the weights, as ``target`` has its rows."""
        if self.weights is None:
            return None
        sizes = np.full_like(self.target, np.nan)
        sizes[self.instants.of_row, self.instants.run, 0] = np.sqrt(self.weights)
        return sizes

    def of_runs(self, runs: Any) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """What a recursion over some runs takes: signals, target, signal and lag of regressors."""
        signals = np.ascontiguousarray(self.signals[:, :, runs])
        target = np.ascontiguousarray(self.target[:, runs])
        lags = kernel_regressors(self.orders)
        if self.sizes is None:
            return signals, target, lags
        return weigh(signals, target, lags, self.sizes[:, runs])

    def first_window(self, seconds: float, runs: Any = None) -> np.ndarray:
        """Regressors and output of the first seconds of all runs, or of some, by their weights."""
        grid, instants = self.grid, self.instants
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        of_run = instants.run[begin]
        number = instants.number[instants.of_row]
        known = np.repeat(grid.measured, grid.end - grid.begin)
        known &= ~np.isnan(self.output) & ~np.isnan(self.inputs).any(axis=1)
        starts = np.full(instants.n_runs, number[-1])
        np.minimum.at(starts, instants.run[known], number[known])
        n_window = min(window_rows(seconds, instants.dt), len(number))
        left = np.clip(starts[of_run] + n_window - number[begin], 0, end - begin)
        chosen = np.ones(begin.size, dtype=bool) if runs is None else np.isin(of_run, runs)
        table, rows, _ = regressors(
            self.output, self.inputs, begin[chosen], (begin + left)[chosen], self.orders
        )
        return relatively_weighted(table, rows, self.weights)

    def inside(self) -> np.ndarray:
        """Whether each run goes on at each instant, of shape (n_runs, n_instants)."""
        instants = self.instants
        first = np.full(instants.n_runs, len(instants))
        last = np.full(instants.n_runs, -1)
        np.minimum.at(first, instants.run, instants.of_row)
        np.maximum.at(last, instants.run, instants.of_row)
        at = np.arange(len(instants))
        return (at >= first[:, None]) & (at <= last[:, None])


def relatively_weighted(
    table: np.ndarray, rows: np.ndarray, weights: np.ndarray | None
) -> np.ndarray:
    """A table of regressors and output by the weights of its rows over their mean."""
    if weights is None or not rows.size:
        return table
    return weighted(table, rows, weights / weights[rows].mean())


def weigh(
    signals: np.ndarray, target: np.ndarray, lags: tuple[np.ndarray, np.ndarray], sizes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Rows by the square roots of their weights: each regressor is a signal of its own then."""
    made = np.full((lags[0].size, *target.shape), np.nan)
    for row, column, lag in zip(made, *lags, strict=True):
        row[lag:] = signals[column, : len(row) - lag] * sizes[lag:]
    own = np.arange(len(made))
    return made, target * sizes, (own, np.zeros_like(own))


def window_rows(seconds: float, dt: float) -> int:
    """Rows of the first window."""
    return max(round(whole_samples(seconds, dt)), 1)


def grid_numbers(grid: ModelGrid) -> np.ndarray:
    """Sample number of each row of a grid, counted from time zero."""
    numbers = grid.layout.sample_numbers()
    if grid.rows is None or grid.layout.mark is None:
        return numbers
    return numbers[grid.rows] // grid.layout.mark.factor


def kernel_regressors(orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """Signal and lag of each regressor; signals are -y, the inputs, and ones."""
    signals, lags = [0] * orders.na, list(range(1, orders.na + 1))
    for position, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        signals += [1 + position] * nb
        lags += range(nk, nk + nb)
    if orders.intercept:
        signals.append(1 + len(orders.nb))
        lags.append(0)
    return np.array(signals), np.array(lags)


def _usable(grid: ModelGrid, output: np.ndarray, orders: Orders) -> np.ndarray:
    """Output where all lags lie inside the stretch, elsewhere NaN."""
    target = np.full(output.size, np.nan)
    for begin, end, measured in zip(grid.begin, grid.end, grid.measured, strict=True):
        first = begin + orders.first_row
        if measured and first < end:
            target[first:end] = output[first:end]
    return target


def factored(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U by columns, above the diagonal, and D of a positive definite P = U D U'."""
    root = np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]
    scale = np.diag(root)
    return (root / scale)[_above(len(P))], scale**2


def multiplied_out(factors: np.ndarray, n_params: int) -> np.ndarray:
    """P = U D U' of factors, U by columns and D, on the last axis."""
    above = _above(n_params)
    n_above = above[0].size
    U = np.broadcast_to(np.eye(n_params), (*factors.shape[:-1], n_params, n_params)).copy()
    U[..., above[0], above[1]] = factors[..., :n_above]
    P = (U * factors[..., None, n_above:]) @ U.swapaxes(-1, -2)
    return (P + P.swapaxes(-1, -2)) / 2


def _above(n_params: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the entries above the diagonal, by columns."""
    columns, rows = np.tril_indices(n_params, -1)
    return rows, columns


class RecursionState:
    """State of recursions, one in each lane: theta, the factors of P, sums and counts."""

    def __init__(self, theta0: np.ndarray, P0: np.ndarray, lanes: int = 1) -> None:
        """Begin with one theta0 and P0, or with one for each lane on the first axis."""
        self.n_params, self.lanes = theta0.shape[-1], lanes
        offsets = list(_kernels.rls.layout(self.n_params).items())
        self._where = {name: slice(begin, end) for (name, begin), (_, end) in pairwise(offsets)}
        self.buffer = np.zeros(offsets[-1][1] * lanes)
        self.rows("theta")[:] = theta0.T if theta0.ndim > 1 else theta0[:, None]
        self.reset(P0)
        self.rows("cap")[:] = _kernels.rls.HELD * self.rows("D")  # until it is excited

    def rows(self, name: str) -> np.ndarray:
        """A quantity of the kernel's layout, of shape (its length, lanes)."""
        return self.buffer.reshape(-1, self.lanes)[self._where[name]]

    def reset(self, P0: np.ndarray) -> None:
        """Set P back to one matrix, or to one for each lane, and begin to forget anew."""
        parts = [factored(P) for P in (P0 if P0.ndim > 2 else [P0])]
        self.rows("U")[:] = np.array([U for U, _ in parts]).T
        self.rows("D")[:] = np.array([D for _, D in parts]).T
        self.rows("instants")[:] = 0.0

    def lane(self, lane: int) -> RecursionState:
        """One of the recursions alone."""
        alone = copy(self)
        alone.lanes, alone.buffer = 1, self.buffer.reshape(-1, self.lanes)[:, lane].copy()
        return alone

    def set_factor(self, forgetting: Forgetting) -> None:
        """Set the forgetting factor of the next instant, where it is variable."""
        if forgetting.nominal:
            self.rows("inflation")[:] = 1.0 / forgetting.factors[0, 0]

    @property
    def factors(self) -> np.ndarray:
        """U by columns and D, of shape (n_factors, lanes)."""
        return self.buffer.reshape(-1, self.lanes)[: self._where["D"].stop]

    @property
    def theta(self) -> np.ndarray:
        """Parameters in the first lane."""
        where = self._where["theta"]
        return self.buffer[where.start * self.lanes : where.stop * self.lanes : self.lanes].copy()

    @property
    def P(self) -> np.ndarray:
        return multiplied_out(self.factors[:, 0], self.n_params)

    @property
    def factor(self) -> float:
        """Variable forgetting factor of the next instant in the first lane."""
        return float(1.0 / self.rows("inflation")[0, 0])

    def count(self, name: str) -> np.ndarray:
        """One of the sums and counts of the kernel, by lane."""
        return self.rows(name)[0]

    def covariance(self, forgetting: Forgetting) -> np.ndarray:
        """Covariance of theta in the first lane."""
        factors = forgetting.factors[-1]
        if forgetting.nominal:
            factors = np.array([self.factor])
        weight = spread_weights(factors, self.count("instants")[0])
        return self.noise_variance * self.P * np.outer(weight, weight)

    @property
    def noise_variance(self) -> float:
        """Mean of the squared one-step errors over 1 + phi' P phi; NaN before any update."""
        updates = self.count("updates").sum()
        return float(self.count("total").sum() / updates) if updates else np.nan


@dataclass
class Paths:
    """What recursions record at each instant; see ``advance`` of the kernel."""

    theta: np.ndarray
    errors: np.ndarray
    factors: np.ndarray
    priors: np.ndarray
    alphas: np.ndarray
    used: np.ndarray

    @classmethod
    def empty(
        cls, n_instants: int, n_runs: int, state: RecursionState, keep: Iterable[str]
    ) -> Paths:
        n_params, lanes = state.n_params, state.lanes
        shapes: dict[str, tuple[int, ...]] = {
            "theta": (n_instants, n_params, lanes),
            "errors": (n_instants, n_runs, lanes),
            "factors": (n_instants, n_params * (n_params + 1) // 2, lanes),
            "priors": (n_instants, n_params * (n_params + 1) // 2, lanes),
            "alphas": (n_instants, n_runs, lanes),
            "used": (n_instants, lanes),
        }
        return cls(
            **{
                name: _kernels.aligned(shape if name in keep else (0,) * len(shape))
                for name, shape in shapes.items()
            }
        )


def recurse(
    state: RecursionState,
    signals: np.ndarray,
    target: np.ndarray,
    orders: Orders,
    forgetting: Forgetting,
    *,
    inflation: tuple[np.ndarray, np.ndarray] | None = None,
    resets: np.ndarray | None = None,
    P0: np.ndarray | None = None,
    keep: Iterable[str] = ("theta", "errors"),
    lags: tuple[np.ndarray, np.ndarray] | None = None,
) -> Paths:
    """Run recursions over all instants, from ``state``, which they change.

    ``inflation`` are the kernel's arrays where lanes forget differently; at the instants ``resets``
    P is set back to ``P0``. ``lags`` are signal and lag of each regressor, where they are not as
    the orders say.
    """
    n_instants = signals.shape[1]
    paths = Paths.empty(n_instants, signals.shape[2], state, keep)
    columns, back = kernel_regressors(orders) if lags is None else lags
    inflate, tilt = forgetting.arrays(state.lanes) if inflation is None else inflation
    shared = signals.shape[3] < state.lanes
    is_long = n_instants * signals.shape[2] >= LONG and (state.lanes, state.n_params) == OWN
    advance = _kernels.rls.recursion(state.lanes, shared, state.n_params if is_long else 0)
    first = min(orders.first_row, n_instants)
    before = {
        "theta": state.rows("theta"),
        "errors": np.nan,
        "factors": state.factors,
        "priors": state.factors,
        "alphas": np.nan,
        "used": 1.0 / state.count("inflation") if forgetting.nominal else 1.0,
    }
    for name in keep:
        getattr(paths, name)[:first] = before[name]
    resets = np.empty(0, dtype=np.int64) if resets is None else resets
    for begin, end in pairwise([first, *resets[resets > first].tolist(), n_instants]):
        if begin > first and P0 is not None:
            state.reset(P0)
        advance(
            signals, target, columns, back, begin, end, inflate, tilt, 0, forgetting.diagonal,
            forgetting.nominal, state.buffer, paths.theta, paths.factors, paths.priors,
            paths.errors, paths.alphas, paths.used,
        )  # fmt: skip
    return paths


@dataclass
class RunRecursion:
    """One recursion over recorded runs: where it ends, and its path, smoothed if wanted."""

    state: RecursionState
    theta: np.ndarray
    errors: np.ndarray
    covariance: np.ndarray
    used: np.ndarray


def run_recursion(
    data: RecursionData,
    start: tuple[np.ndarray, np.ndarray],
    runs: slice,
    forgetting: Forgetting,
    resets: np.ndarray,
    *,
    smooth: bool,
    with_covariance: bool,
) -> RunRecursion:
    """Run one recursion over some of the runs, which P is reset in at some instants."""
    state = RecursionState(*start)
    state.set_factor(forgetting)
    keep = ["theta", "errors"]
    if forgetting.nominal:
        keep.append("used")
    if smooth or with_covariance:
        keep.append("factors")
    if smooth:
        keep.append("priors")
    signals, target, lags = data.of_runs(runs)
    paths = recurse(
        state,
        signals,
        target,
        data.orders,
        forgetting,
        resets=resets,
        P0=start[1],
        keep=keep,
        lags=lags,
    )
    theta, errors = paths.theta[:, :, 0], paths.errors[:, :, 0]
    if data.sizes is not None:
        errors = errors / data.sizes[:, runs, 0]
    used = paths.used[:, 0] if forgetting.nominal else NOTHING
    covariance = NOTHING
    if smooth:
        theta, covariance = _smoothed(paths, resets, with_covariance)
    elif with_covariance:
        factors = used[:, None] if forgetting.nominal else forgetting.factors
        so_far = _instants_so_far(errors, resets)
        covariance = covariance_along(paths.factors[:, :, 0], state.n_params, factors, so_far)
    covariance *= state.noise_variance
    return RunRecursion(state, theta, errors, covariance, used)


def covariance_along(
    P_factors: np.ndarray, n_params: int, forgetting: np.ndarray, n_instants: np.ndarray
) -> np.ndarray:
    """Covariance of theta over σ² at each instant, from the factors of P."""
    covariance = multiplied_out(P_factors, n_params)
    weight = spread_weights(forgetting, n_instants[:, None])
    covariance *= weight[:, :, None] * weight[:, None, :]
    return covariance


def spread_weights(factors: np.ndarray, n_instants: Any) -> np.ndarray:
    """Square roots of (1 + λ^n) / (1 + λ), which turn P into the covariance of theta over σ².

    It is the sum of the squared weights over the sum of the weights after n instants: 1 for
    λ = 1, and 1 / (1 + λ) in steady state (Ljung and Söderström 1983).
    """
    return np.sqrt((1.0 + factors**n_instants) / (1.0 + factors))


def _instants_so_far(errors: np.ndarray, resets: np.ndarray) -> np.ndarray:
    """Instants with an update since the beginning or the last reset."""
    count = np.cumsum(~np.isnan(errors).all(axis=1))
    before = np.concatenate(([0], count))[resets]
    since = np.searchsorted(resets, np.arange(count.size), side="right")
    return count - np.concatenate(([0], before))[since]


def _smoothed(
    paths: Paths, resets: np.ndarray, with_covariance: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Fixed-interval smoothing of one recursion (Rauch, Tung and Striebel 1965)."""
    theta = paths.theta[:, :, 0].copy()
    P = NOTHING
    if with_covariance:
        P = multiplied_out(paths.factors[:, :, 0], theta.shape[1])
    cut = np.zeros(len(theta), dtype=np.bool_)
    cut[resets] = True
    factors, priors = (np.ascontiguousarray(f[:, :, 0]) for f in (paths.factors, paths.priors))
    _kernels.rls.smooth(theta, P, factors, priors, cut)
    return theta, P


def likelihoods(
    data: RecursionData,
    starts: list[tuple[np.ndarray, np.ndarray]],
    parts: list[slice],
    forgetting: Forgetting,
    resets: np.ndarray,
) -> dict[float, float]:
    """Log-likelihood of the one-step predictions by memory horizon, summed over recursions.

    Each recursion has normal errors of variance σ² (1 + φ'P̄φ) and its own σ² (West and Harrison
    1997, Section 10.8).
    """
    horizons = [2.0**i for i in range(1, 14) if 2**i <= max(len(data.instants), 2)] + [np.inf]
    lanes = _kernels.rls.MANY
    factors = np.ones((1, 1, lanes))
    factors[0, 0, : len(horizons)] = 1.0 - 1.0 / np.array(horizons)
    total = np.zeros(lanes)
    for runs, start in zip(parts, starts, strict=True):
        signals, target, lags = data.of_runs(runs)
        paths = recurse(
            RecursionState(*start, lanes),
            signals,
            target,
            data.orders,
            forgetting,
            lags=lags,
            inflation=kernel_arrays(factors),
            resets=resets,
            P0=start[1],
            keep=("errors", "alphas"),
        )
        known = ~np.isnan(paths.errors[:, :, 0])
        errors, alphas = paths.errors[known], paths.alphas[known]
        with np.errstate(divide="ignore"):
            total -= 0.5 * known.sum() * np.log(2 * np.pi * np.mean(errors**2 / alphas, axis=0))
        total -= 0.5 * (known.sum() + np.log(alphas).sum(axis=0))
    return dict(zip(horizons, total.tolist(), strict=False))


LARGEST_P0, SMALLEST_P0 = 1e100, 1e-100  # with data of any size, products stay finite
WORTH = {"ols": 1.0, "given": 1e-4}  # of P0 by default, in samples of mean power


def needs_data(init: Any, p0: Any) -> bool:
    """Whether theta0 or P0 come from the first window of data."""
    return p0 is None or (isinstance(init, str) and init == "ols")


def find_start(
    init: Any, p0: Any, names: list[str], table: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """theta0 and P0, from the regressors and output (last column) of the first window."""
    n_params = len(names)
    by_ols = isinstance(init, str) and init == "ols"
    if isinstance(init, str):
        theta0 = np.zeros(n_params)
    else:
        refusal = (
            f"init must be 'ols', 'zeros' or theta0: {n_params} finite numbers for "
            f"{', '.join(names)}; got {init!r}."
        )
        try:
            theta0 = np.array(init, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(refusal) from error
        if theta0.shape != (n_params,) or not np.isfinite(theta0).all():
            raise ValueError(refusal)
    power = np.ones(n_params)
    if table is not None:
        power = np.mean(table[:, :-1] ** 2, axis=0)
        power[power == 0] = power.max() or 1.0
    if by_ols:
        assert table is not None
        theta0 = _least_squares(table, np.sqrt(power), names)
    if p0 is None:
        return theta0, np.diag(1.0 / (WORTH["ols" if by_ols else "given"] * power))
    return theta0, _given_P0(p0, n_params)


def _least_squares(table: np.ndarray, scale: np.ndarray, names: list[str]) -> np.ndarray:
    """OLS, of the smallest (scaled) parameters where the data do not determine them."""
    triangle = Triangle.of(np.array(table, order="F"))
    if len(table) >= len(names) and len(triangle.null_space()) == 0:
        return triangle.solve()
    warnings.warn(
        f"The first {len(table)} usable rows do not determine all of {', '.join(names)}; the "
        "recursion starts from the minimum-norm parameters that fit them. Give a longer "
        "init_window.",
        PoorExcitationWarning,
        stacklevel=5,
    )
    return np.linalg.lstsq(table[:, :-1] / scale, table[:, -1], rcond=None)[0] / scale


def _given_P0(p0: Any, n_params: int) -> np.ndarray:
    refusal = (
        f"p0 must be a number, {n_params} numbers or a symmetric positive definite matrix of shape "
        f"({n_params}, {n_params}), with variances from {SMALLEST_P0:g} to {LARGEST_P0:g}; got "
        f"{p0!r}."
    )
    try:
        given = np.asarray(p0, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(refusal) from error
    P0 = given * np.eye(n_params) if given.ndim == 0 else given
    P0 = np.diag(given) if given.ndim == 1 else P0
    sizes = np.diag(P0) if P0.shape == (n_params, n_params) else np.zeros(1)
    # Within these bounds the eigenvalues of the scaled matrix are finite.
    good = sizes.min() > SMALLEST_P0 and sizes.max() < LARGEST_P0 and np.array_equal(P0, P0.T)
    scale = np.sqrt(sizes)
    if not good or np.linalg.eigvalsh(P0 / np.outer(scale, scale))[0] <= 0:
        raise ValueError(refusal)
    return P0
