"""RecursiveFIR: an impulse response that follows the data, by regularised least squares."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral, Real
from typing import Any

import numpy as np

from .. import _kernels
from .._sklearn import DT, Interval, StrOptions, fit_context
from ..arx.base import check_lengths, check_row_count
from ..arx.forgetting import forgetting_factor
from ..arx.model_summary import orders_text
from ..arx.orders import Orders, whole_number
from ..arx.recursive import FollowedPath, check_streamable
from ..arx.rls import RecursionData, kernel_regressors
from ..arx.streaming import Recursion, Streaming
from ..exceptions import PoorExcitationWarning, ShortRunError
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from ..text import ModelSummary, estimates_table, number

CHUNK = 256  # rows that a stream takes at a time
FADED = 0.01  # of the variance of the first tap, by the last one, under penalty="tc"


@dataclass
class FIRFilter(Recursion):
    """The recursion of a model, with its state and the rows that its lags reach back to."""

    orders: Orders
    factor: float
    ridge: float
    every: int
    pseudoinverse: bool
    penalty: np.ndarray
    prior: np.ndarray

    def __post_init__(self) -> None:
        self.columns, self.lags = kernel_regressors(self.orders)
        self.owner = np.where(self.columns <= len(self.orders.nb), self.columns - 1, -1)
        offsets = list(_kernels.fir.layout(self.owner.size).items())
        self._where = {name: slice(begin, end) for (name, begin), (_, end) in pairwise(offsets)}
        self.state = np.zeros(offsets[-1][1])
        self.depth, self.since = self.orders.first_row, 0
        self._signals = np.full(
            (1 + len(self.orders.nb) + self.orders.intercept, self.depth + CHUNK, 1), np.nan
        )
        if self.orders.intercept:
            self._signals[-1] = 1.0
        self._target = np.full((self.depth + CHUNK, 1), np.nan)
        n = self.owner.size
        self._no_path, self._no_spread = np.empty((0, n)), np.empty((0, n, n))
        self._no_errors = np.empty((0, 0))

    @classmethod
    def of(cls, model: RecursiveFIR, factor: float) -> FIRFilter:
        orders = model.orders_
        pseudoinverse = model.form == "pseudoinverse"
        if pseudoinverse and model.penalty != "identity":
            raise ValueError(
                f"form='pseudoinverse' has no penalty, but penalty={model.penalty!r}; it goes with "
                "form='regularized'."
            )
        prior = np.eye(orders.n_params)
        penalty = np.eye(orders.n_params)
        if model.penalty == "tc":
            at = 0
            for taps in orders.nb:
                block = slice(at, at + taps)
                prior[block, block], penalty[block, block] = tc_kernel(taps)
                at += taps
        every = whole_number("every", model.every, 1)
        return cls(orders, factor, float(model.ridge), every, pseudoinverse, penalty, prior)

    def part(self, name: str) -> np.ndarray:
        """A quantity of the kernel's layout: a matrix, flat, a vector, or one number."""
        return self.state[self._where[name]]

    def matrix(self, name: str) -> np.ndarray:
        """A symmetric matrix of the kernel, which keeps what is above the diagonal."""
        n = self.owner.size
        above = np.triu(self.part(name).reshape(n, n))
        return above + np.triu(above, 1).T

    def advance(
        self,
        signals: np.ndarray,
        target: np.ndarray,
        errors: np.ndarray,
        with_covariance: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take all instants; the path of theta, and its covariance over σ²."""
        n, end = self.owner.size, len(target)
        solutions = end // self.every
        path = np.empty((solutions, n))
        spread = np.empty((solutions * with_covariance, n, n))
        if not self.pseudoinverse:
            self._run(signals, target, 0, end, self.every, path, spread, errors)
            return path, spread
        for row in range(solutions):
            self._accumulate(signals, target, row * self.every, (row + 1) * self.every, errors)
            path[row] = self.part("theta")
            if with_covariance:
                spread[row] = self.spread()
        self._accumulate(signals, target, solutions * self.every, end, errors)
        return path, spread

    def _accumulate(
        self, signals: np.ndarray, target: np.ndarray, begin: int, end: int, errors: np.ndarray
    ) -> None:
        """Take instants, and solve where it is due if the kernel cannot."""
        every = 0 if self.pseudoinverse else self.every
        while begin < end:
            so_far = int(self.part("instants")[0])
            due = self.every - so_far % self.every if self.pseudoinverse else end - begin
            stop = min(begin + due, end)
            self._run(signals, target, begin, stop, every, self._no_path, self._no_spread, errors)
            if self.pseudoinverse and stop - begin == due:
                self._invert()
            begin = stop

    def _run(self, signals: Any, target: Any, begin: int, end: int, every: int, *out: Any) -> None:
        _kernels.fir.advance(
            signals, target, self.columns, self.lags, self.owner, self.penalty, self.prior, begin,
            end, self.factor, self.ridge, every, self.state, *out,
        )  # fmt: skip

    def _invert(self) -> None:
        """Solve for theta by the pseudoinverse of R, each input in units of its mean power."""
        if self.part("fresh")[0] == 0.0:
            return
        R, n = self.matrix("R"), self.owner.size
        scale = np.ones(n)
        for j in range(len(self.orders.nb)):
            own = self.owner == j
            power = R.diagonal()[own].sum() / self.part("weight")[0]
            scale[own] = np.sqrt(power) if power > 0 else 1.0
        values, vectors = np.linalg.eigh(R / np.outer(scale, scale))
        kept = values > max(self.ridge, n * np.finfo(float).eps * values[-1])
        if not kept.any():
            return
        vectors = vectors[:, kept] / scale[:, None]
        inverse = (vectors / values[kept]) @ vectors.T
        self.part("A")[:] = inverse.ravel()
        self.part("meat")[:] = self.part("S")
        self.part("theta")[:] = inverse @ self.part("s")
        self.part("fresh")[:], self.part("solved")[:] = 0.0, 1.0

    def spread(self) -> np.ndarray:
        """Covariance of theta over σ²; NaN before the first solution."""
        n = self.owner.size
        out = np.full((n, n), np.nan)
        if self.part("solved")[0]:
            A, S = (self.part(name).reshape(n, n) for name in ("A", "meat"))
            _kernels.fir.sandwich(A, self.pseudoinverse, S, out)
        return out

    def covariance(self) -> np.ndarray:
        return self.noise_variance * self.spread()

    @property
    def noise_variance(self) -> float:
        judged = self.part("judged")[0]
        return float(self.part("total")[0] / judged) if judged else np.nan

    def delta(self) -> np.ndarray:
        """The last δ of each input."""
        if self.part("weight")[0] == 0.0:
            return np.zeros(len(self.orders.nb))
        of_tap = np.zeros(self.owner.size)
        _kernels.fir.penalties(
            self.matrix("R"), self.part("weight")[0], self.owner, self.prior, self.ridge, of_tap
        )
        return np.array([of_tap[self.owner == j][0] for j in range(len(self.orders.nb))])

    def warn_undetermined(self, inputs: list[str]) -> None:
        if self.part("solved")[0]:
            return
        cause = (
            f"no direction of the input {', '.join(map(repr, inputs))} weighs more than ridge="
            f"{self.ridge:g} rows, so all {self.owner.size} taps are zero. Use a smaller ridge"
            if self.pseudoinverse
            else f"the input {', '.join(map(repr, inputs))} never determined all of the "
            f"{self.owner.size} taps, so they are zero throughout. Use ridge > 0, fewer taps"
        )
        warnings.warn(
            f"There is no estimate: {cause}, or a richer input.",
            PoorExcitationWarning,
            stacklevel=4,
        )

    def remember(self, signals: np.ndarray) -> None:
        """Take over the lags at the end of a run, of shape (n_signals, n_rows)."""
        self.since = signals.shape[1]
        kept = min(self.since, self.depth)
        if kept:
            self._signals[:, self.depth - kept : self.depth, 0] = signals[:, -kept:]

    def rest(self) -> None:
        """Forget the rows before."""
        self.since = 0

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        """Take rows that follow those before."""
        depth, inputs = self.depth, slice(1, 1 + X.shape[1])
        for first in range(0, y.size, CHUNK):
            m = min(CHUNK, y.size - first)
            self._signals[inputs, depth : depth + m, 0] = X[first : first + m].T
            self._target[depth : depth + m, 0] = y[first : first + m]
            if self.since < depth:
                self._target[depth : 2 * depth - self.since, 0] = np.nan
            self.since += m
            self._accumulate(self._signals, self._target, depth, depth + m, self._no_errors)
            self._signals[inputs, :depth] = self._signals[inputs, m : m + depth]


def tc_kernel(n_taps: int) -> tuple[np.ndarray, np.ndarray]:
    """The kernel min(ρ^i, ρ^k) of a smooth response that fades, and its inverse."""
    variance = FADED ** (np.arange(n_taps) / max(n_taps - 1, 1))
    kernel = np.minimum.outer(variance, variance)
    steps = np.append(-np.diff(variance), variance[-1])  # variances of independent increments
    diagonal = 1 / steps
    inverse = np.diag(diagonal + np.append(0.0, diagonal[:-1]))
    if n_taps > 1:
        beside = np.arange(n_taps - 1)
        inverse[beside, beside + 1] = inverse[beside + 1, beside] = -diagonal[:-1]
    return kernel, inverse


MOST_TAPS = 1000
OF_RUNS = (  # attributes that describe recorded runs
    "coef_path_",
    "time_path_",
    "covariance_path_",
    "one_step_errors_",
    "n_rows_missing_",
    "run_labels_",
)


class RecursiveFIR(Streaming, FollowedPath):
    """Finite impulse response that follows the data, by regularised recursive least squares.

    u(t) = Σ h_i e(t - nk - i) + ε(t), i = 0 ... n_taps - 1, with θ(t) = (R + δD)⁻¹ s and, at each
    instant, R = λR + φφ', s = λs + φu (Olivari and others 2016).

    Parameters
    ----------
    n_taps : int, or one per input, default=30
        Length of the impulse response in samples of the fitted grid.
    nk : int, or one per input, default=0
        Input delay in samples, as for :class:`ARXRegressor`. The impulse response may begin with
        the delay itself; with an ``nk`` it needs fewer taps.
    length : float or None, default=None
        Length of the impulse response in seconds, in place of ``n_taps``: the same at every
        decimation factor.
    {inputs}
    fit_intercept : bool, default=False
        Add a constant, which is not regularised.
    ridge : float, default=0.001
        How strong the regularisation is: the ratio of the variances of noise and response that is
        expected before anything was measured. δ follows from it and from the data (see Notes), so
        that it keeps its meaning when units, memory or the number of taps change. 0 is plain least
        squares, which needs an input that excites all taps.
    form : {"regularized", "pseudoinverse"}, default="regularized"
        Add δD to R; or invert R only in the directions whose eigenvalues exceed δ (with
        ``ridge=0``, rounding errors).
    penalty : {"identity", "tc"}, default="identity"
        D. ``"tc"`` expects a smooth response that fades: D is the inverse of the kernel
        min(ρ^i, ρ^k) of Chen, Ohlsson and Ljung (2012), of which the last tap has 1 % of the
        variance of the first. For ``form="regularized"``.
    forgetting : float or None, default=None
        λ in (0, 1]. If this and the next two are None, nothing is forgotten (λ = 1).
    memory_horizon : float or None, default=None
        N0 in samples of the fitted grid, λ = 1 - 1 / N0; may be infinite.
    memory_time : float or None, default=None
        T0 = N0 dt in seconds.
    every : int, default=1
        θ is solved for at every so many-th instant and held in between: the path has only these
        instants. Solving for 100 taps takes some 50 µs, and ``operator_parameters(model,
        method="fit")`` some 5 ms for each.
    parameters : {"path", "last"}, default="path"
        What predictions use: θ of the latest instant of the path at the same time in the run, or
        the last θ throughout.
    store_covariance : bool, default=False
        Keep ``covariance_path_``.
    {roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_solutions, n_params)
        θ of each ``every``-th instant, taps h_0 ... of each input and the constant. Absent after
        ``partial_fit``.
    time_path_ : ndarray of shape (n_solutions,)
        Time in the run in seconds.
    coef_ : ndarray of shape (n_params,)
        The last θ.
    b_ : ndarray of shape (n_taps,), or list of them for several inputs
        Its impulse responses; h_i answers the input ``(nk + i) dt_`` seconds later.
    a_, intercept_ : ndarray of shape (0,), float
        No output coefficients; the constant.
    covariance_ : ndarray of shape (n_params, n_params)
        Mean squared error of ``coef_``, σ² A⁻¹ (S + δD) A⁻¹ with A = R + δD and S = Σ λ^2k φφ'
        (see Notes); with ``form="pseudoinverse"`` σ² R⁺SR⁺.
    standard_errors_ : ndarray of shape (n_params,)
        Square roots of its diagonal.
    covariance_path_ : ndarray of shape (n_solutions, n_params, n_params)
        Covariance of ``coef_path_``; with ``store_covariance``. NaN before the first solution.
    parameters_ : DataFrame
        The last parameters: value, sd, low and high (95 % interval), unit, meaning.
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        Error of each row of the fitted grid by the θ known before; NaN where there was none.
    noise_variance_ : float
        σ², the mean of ε² / (1 + φ'Cφ) with the covariance σ²C before each row, in the squared unit
        of ``y``.
    delta_ : ndarray of shape (n_inputs,)
        The last δ of each input.
    forgetting_, memory_horizon_ : float
        λ, and 1 / (1 - λ) in samples.
    n_updates_ : int
        Rows with an output and known lags.
    n_held_ : int
        Instants at which nothing was learned or forgotten, as the input was at rest.
    parameter_names_ : list of str
        b0, b1 ... as in :class:`ARXRegressor`.
    run_labels_ : list
        Labels of the runs.
    {dt_, inputs_}
    jitter_ : float
        Largest deviation of a step of the clock, as a fraction of the sampling time.
    n_rows_missing_ : int
        Rows without an update because y or an input in their lags is NaN.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARX : Fewer parameters, but an output error model: biased by remnant.

    Notes
    -----
    δ = ridge trace(D⁻¹R) / w, with w the sum of the weights λ^k of the rows in R. If the taps are
    drawn from N(0, cD⁻¹), the mean variance of their response is c trace(D⁻¹R) / w, and δ = σ² / c
    is the best there is: ``ridge`` is the ratio of the two variances. For an operator that is P_n,
    but an error of low frequencies hardly shows taps that are drawn so; in simulated runs (C1 and
    C4, P_n = 0.1 and 0.15) the bias of operator parameters was least from 0.0001 to 0.01. δ weighs
    as much as that share of one row, so that it matters while few rows are remembered, and in
    directions that the input hardly excites. The papers give δ itself, which ``delta_`` shows. Each
    input has its own.

    θ is zero before the first row that moves the input. Where y or a lag is NaN, nothing is updated
    and nothing is forgotten, nor where the input is at rest: with less than 1e-12 of its mean
    power. Where R + δD cannot be inverted (``ridge=0`` and fewer rows than taps, or an input that
    does not excite them), θ is held. Several runs are pooled, aligned by time in the run, with one
    forgetting step per instant.

    An operator's response at 100 Hz lasts about 1 s, 100 taps, whose cost grows with their cube:
    :class:`Decimator` before the model is the remedy, or ``every``.

    Standard deviations assume a white error, which coloured remnant violates, and do not include
    the lag behind changing parameters. A⁻¹SA⁻¹ is of the noise, and δA⁻¹DA⁻¹ of the bias towards
    zero, if taps are as large as ``ridge`` says; without it, taps that the data say nothing about
    would seem certain. The pseudoinverse leaves the bias out.

    Of the papers only abstracts could be read; the equations are those of the issue that asked for
    this model. The definition of δ by ``ridge`` and the TC penalty are not theirs.

    References
    ----------
    Olivari, Nieuwenhuizen, Bülthoff and Pollini, "Identifying time-varying neuromuscular system
    with a recursive least-squares algorithm: a Monte-Carlo simulation study", IEEE SMC (2014);
    "Identifying time-varying neuromuscular response: a recursive least-squares algorithm with
    pseudoinverse", IEEE SMC (2015), doi 10.1109/SMC.2015.535; "Identifying time-varying pilot
    responses: a regularized recursive least-squares algorithm", IFAC-PapersOnLine 49 (2016). Chen,
    Ohlsson and Ljung, Automatica 48 (2012) 1525-1535.

    Examples
    --------
    >>> from skhoid import Decimator, RecursiveFIR, make_tracking_runs
    >>> from sklearn.pipeline import make_pipeline
    >>> X, y = make_tracking_runs("C4", n_runs=2, remnant_intensity=0.1, random_state=0)
    >>> model = make_pipeline(Decimator(4), RecursiveFIR(length=1.2, memory_time=10.24))
    >>> model.fit(X, y)[-1].coef_path_.shape
    (2048, 30)
    >>> bool(model.score(X, y) > 80)
    True
    """

    _parameter_constraints: dict = {
        "n_taps": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "nk": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "length": [Interval(Real, 0, None, closed="neither"), None],
        "inputs": "no_validation",
        "fit_intercept": ["boolean"],
        "ridge": [Interval(Real, 0, 1e12, closed="both")],
        "form": [StrOptions({"regularized", "pseudoinverse"})],
        "penalty": [StrOptions({"identity", "tc"})],
        "forgetting": [Interval(Real, 0, 1, closed="right"), None],
        "memory_horizon": [Interval(Real, 1, None, closed="neither"), None],
        "memory_time": [Interval(Real, 0, None, closed="neither"), None],
        "every": [Interval(Integral, 1, 10**9, closed="both")],
        "parameters": [StrOptions({"path", "last"})],
        "store_covariance": ["boolean"],
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    init_window = 0.0  # seconds of a stream before there is an estimate: it begins from zero

    def __init__(
        self,
        n_taps: Any = 30,
        nk: Any = 0,
        *,
        length: float | None = None,
        inputs: Any = None,
        fit_intercept: bool = False,
        ridge: float = 0.001,
        form: str = "regularized",
        penalty: str = "identity",
        forgetting: float | None = None,
        memory_horizon: float | None = None,
        memory_time: float | None = None,
        every: int = 1,
        parameters: str = "path",
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.n_taps = n_taps
        self.nk = nk
        self.length = length
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.ridge = ridge
        self.form = form
        self.penalty = penalty
        self.forgetting = forgetting
        self.memory_horizon = memory_horizon
        self.memory_time = memory_time
        self.every = every
        self.parameters = parameters
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> RecursiveFIR:
        """Run the recursion over recorded runs.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : RecursiveFIR

        Raises
        ------
        ValueError
            If options do not fit each other or the data.
        ShortRunError
            If a run has fewer rows than the taps need, or all have fewer than ``every``.
        RunIndexError, IrregularSamplingError
            If rows, runs or time violate the data convention.

        Warns
        -----
        PoorExcitationWarning
            If the input never determined all taps.
        MissingDataWarning
            With the number of rows that are NaN.
        """
        grid, inputs, output, *_ = self._read_data(X, y)
        self._set_orders(grid)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        data = RecursionData.of(grid, inputs, output, self.orders_)
        self._check_shared_times(data.instants, data.grid)
        check_row_count(int((~np.isnan(data.target)).sum()), 1, grid)
        if len(data.instants) < self.every:
            raise ShortRunError(
                f"every={self.every} is more than the {len(data.instants)} instants of the fitted "
                f"grid (n_samples = {grid.layout.n_rows}), so θ would never be solved for. Use a "
                "smaller one."
            )
        self._end_stream(*OF_RUNS)
        found = FIRFilter.of(self, self._factor())
        signals = _kernels.gate(data.signals[..., 0])
        errors = np.full(data.target.shape[:2], np.nan)
        path, spread = found.advance(
            signals, _kernels.gate(data.target[..., 0]), errors, self.store_covariance
        )
        self.coef_path_ = path
        if self.store_covariance:
            self.covariance_path_ = spread * found.noise_variance
        self.initial_coef_ = np.zeros(self.orders_.n_params)
        self._numbers = data.instants.number[self.every - 1 :: self.every]
        self.time_path_ = self._numbers * self.dt_
        self.one_step_errors_ = errors[data.instants.of_row, data.instants.run]
        self.n_rows_missing_ = int(np.isnan(self.one_step_errors_).sum() - data.n_rows_without_lags)
        self.run_labels_ = list(grid.layout.labels)
        self._set_state(found)
        if grid.rows is None:
            if data.instants.n_runs == 1:
                length = int(grid.end[-1] - grid.begin[-1]) if grid.measured[-1] else 0
                found.remember(signals[:, max(signals.shape[1] - length, 0) :, 0])
            self._leave_for_streams(found, grid.layout)
        self._report_missing(grid, inputs, output, self.n_updates_, self.inputs_)
        found.warn_undetermined(self.inputs_)
        return self

    def _set_orders(self, grid: ModelGrid) -> None:
        self._read_orders()
        check_lengths(grid, self.orders_)

    def _read_orders(self) -> None:
        if self.length is None:
            taps = self.n_taps
        elif self.length < self.dt_:
            raise ValueError(
                f"length={self.length:g} s is less than the sampling time of the fitted grid, "
                f"{self.dt_:g} s; it is the length of the impulse response."
            )
        else:
            taps = round(self.length / self.dt_)
        self.orders_ = Orders.of(0, taps, self.nk, len(self._columns), bool(self.fit_intercept))
        if self.orders_.n_params > MOST_TAPS:
            raise ValueError(
                f"{self.orders_.n_params} taps are too many to solve for at each instant; the "
                f"limit is {MOST_TAPS}. Put a Decimator before the model, use fewer taps, or give "
                "the delay as nk."
            )
        check_streamable(self.orders_)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)

    def _factor(self) -> float:
        """λ, from whichever of the three was given."""
        names = ("forgetting", "memory_horizon", "memory_time")
        given = {n: getattr(self, n) for n in names if getattr(self, n) is not None}
        if len(given) > 1:
            raise ValueError(
                "Give at most one of forgetting (λ), memory_horizon (N0, samples) and memory_time "
                f"(T0, s); got {', '.join(f'{n}={v!r}' for n, v in given.items())}."
            )
        if self.forgetting is not None or not given:
            return 1.0 if self.forgetting is None else float(self.forgetting)
        return float(
            forgetting_factor(self.memory_horizon, memory_time=self.memory_time, dt=self.dt_)
        )

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> FIRFilter:
        self._read_orders()
        return FIRFilter.of(self, self._factor())

    def _rows_to_begin(self) -> int:
        return 0

    def _refresh(self, row_filter: FIRFilter) -> None:
        for name in OF_RUNS:
            self.__dict__.pop(name, None)
        self._set_state(row_filter)

    def _set_state(self, found: FIRFilter) -> None:
        self._state = found
        self.coef_ = found.part("theta").copy()

    @property
    def covariance_(self) -> np.ndarray:
        self._check_fitted()
        return self._state.covariance()

    @property
    def noise_variance_(self) -> float:
        self._check_fitted()
        return self._state.noise_variance

    @property
    def delta_(self) -> np.ndarray:
        self._check_fitted()
        return self._state.delta()

    @property
    def forgetting_(self) -> float:
        self._check_fitted()
        return self._state.factor

    @property
    def memory_horizon_(self) -> float:
        return float("inf") if self.forgetting_ == 1.0 else 1.0 / (1.0 - self.forgetting_)

    @property
    def n_updates_(self) -> int:
        self._check_fitted()
        return int(self._state.part("updates")[0])

    @property
    def n_held_(self) -> int:
        self._check_fitted()
        return int(self._state.part("held")[0])

    def summary_table(self) -> ModelSummary:
        told = as_fitted(self)
        inverse = "pseudoinverse" if told.form == "pseudoinverse" else f"penalty {told.penalty}"
        memory = (
            "nothing is forgotten, λ = 1"
            if self.forgetting_ == 1.0
            else f"N0 = {self.memory_horizon_:.4g} samples, "
            f"{number(self.memory_horizon_ * self.dt_)} s (λ = {self.forgetting_:.6g})"
        )
        facts = {
            "Model": orders_text(self.orders_),
            **self._signal_facts(),
            "Method": f"recursive least squares, ridge = {told.ridge:g}, {inverse}",
            "Memory": memory,
            "Rows": f"{self.n_updates_} updates",
            **self._grid_facts(),
            "Residual sd": self._residual_sd(),
        }
        notes = [
            "Standard errors assume a white error, and do not include the lag behind changing "
            "parameters.",
            "Residual sd is one step ahead. Judge a model by its free run, preferably on runs that "
            "were not fitted: summary(X, y).",
        ]
        return ModelSummary(
            self._title(),
            facts,
            estimates_table(self.parameters_, "Parameters at the end"),
            notes,
        )
