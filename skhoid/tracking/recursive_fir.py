"""RecursiveFIR: an impulse response that follows the data, by regularised least squares."""

from __future__ import annotations

import warnings
from itertools import pairwise
from numbers import Integral, Real
from typing import Any

import numpy as np
from scipy.linalg import cho_solve

from .. import _kernels
from .._sklearn import Interval, fit_context
from ..arx.base import BaseARX, check_lengths, check_row_count
from ..arx.forgetting import factor_of_time
from ..arx.model_summary import JUDGE, WHITE, orders_text
from ..arx.orders import Orders
from ..arx.recursive import OF_RUNS, OneRecursion, check_streamable
from ..arx.rls import RecursionData, kernel_regressors
from ..arx.streaming import Recursion
from ..exceptions import PoorExcitationWarning, ShortRunError
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from ..text import ModelSummary, estimates_table, number

CHUNK = 256  # rows that a stream takes at a time
MOST_TAPS = 1000


class FIRFilter(Recursion):
    """The recursion of a model, with its state and the rows that its lags reach back to."""

    def __init__(self, orders: Orders, factor: float, ridge: float, every: int) -> None:
        self.orders, self.factor, self.ridge, self.every = orders, factor, ridge, every
        self.columns, self.lags = kernel_regressors(orders)
        n_inputs, n = len(orders.nb), orders.n_params
        self.owner = np.where(self.columns <= n_inputs, self.columns - 1, -1)
        offsets = list(_kernels.fir.layout(n).items())
        self._where = {name: slice(begin, end) for (name, begin), (_, end) in pairwise(offsets)}
        self.state = np.zeros(offsets[-1][1])
        self.depth, self.since = orders.first_row, 0
        self._signals = np.full((1 + n_inputs + orders.intercept, self.depth + CHUNK, 1), np.nan)
        if orders.intercept:
            self._signals[-1] = 1.0
        self._target = np.full((self.depth + CHUNK, 1), np.nan)
        self._no_paths = np.empty((0, n)), np.empty((0, n, n)), np.empty((0, 0))

    def part(self, name: str) -> np.ndarray:
        """A quantity of the kernel's layout: a matrix, flat, a vector, or one number."""
        return self.state[self._where[name]]

    def run(self, signals: np.ndarray, target: np.ndarray, begin: int, end: int, *out: Any) -> None:
        """Take instants; ``out`` are the path of theta, its covariance over σ², and errors."""
        _kernels.fir.advance(
            signals, target, self.columns, self.lags, self.owner, begin, end, self.factor,
            self.ridge, self.every, self.state, *out,
        )  # fmt: skip

    @property
    def theta(self) -> np.ndarray:
        return self.part("theta")

    @property
    def n_updates(self) -> int:
        return int(self.part("updates")[0])

    @property
    def n_held(self) -> int:
        return int(self.part("held")[0])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of theta; NaN before the first solution."""
        n = self.owner.size
        if not self.part("solved")[0]:
            return np.full((n, n), np.nan)
        A, S = (self.part(name).reshape(n, n) for name in ("A", "meat"))
        S = np.triu(S) + np.triu(S, 1).T
        half = cho_solve((A, False), S)
        return self.noise_variance * cho_solve((A, False), half.T)

    @property
    def noise_variance(self) -> float:
        judged = self.part("judged")[0]
        return float(self.part("total")[0] / judged) if judged else np.nan

    def delta(self) -> np.ndarray:
        """The last δ of each input."""
        n, weight = self.owner.size, self.part("weight")[0]
        if weight == 0.0:
            return np.zeros(len(self.orders.nb))
        power = self.part("R").reshape(n, n).diagonal() * self.ridge / weight
        return np.array([power[self.owner == j].sum() for j in range(len(self.orders.nb))])

    def remember(self, signals: np.ndarray) -> None:
        """Take over the lags at the end of a run, of shape (n_signals, n_rows)."""
        self.since = signals.shape[1]
        kept = min(self.since, self.depth)
        if kept:
            self._signals[:, self.depth - kept : self.depth, 0] = signals[:, -kept:]

    def rest(self) -> None:
        self.since = 0

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        depth, inputs = self.depth, slice(1, 1 + X.shape[1])
        for first in range(0, y.size, CHUNK):
            m = min(CHUNK, y.size - first)
            self._signals[inputs, depth : depth + m, 0] = X[first : first + m].T
            self._target[depth : depth + m, 0] = y[first : first + m]
            if self.since < depth:
                self._target[depth : 2 * depth - self.since, 0] = np.nan
            self.since += m
            self.run(self._signals, self._target, depth, depth + m, *self._no_paths)
            self._signals[inputs, :depth] = self._signals[inputs, m : m + depth]


class RecursiveFIR(OneRecursion):
    """Finite impulse response that follows the data, by regularised recursive least squares.

    u(t) = Σ h_i e(t - nk - i) + ε(t), i = 0 ... n_taps - 1, with θ(t) = (R + δI)⁻¹ s and, at each
    instant, R = λR + φφ', s = λs + φu (Olivari and others 2016).

    Parameters
    ----------
    n_taps : int, or one per input, default=30
        Length of the impulse response in samples of the fitted grid.
    nk : int, or one per input, default=0
        Input delay in samples, as for :class:`ARXRegressor`. The impulse response may begin with
        the delay itself; with an ``nk`` it needs fewer taps.
    {inputs}
    fit_intercept : bool, default=False
        Add a constant, which is not regularised.
    ridge : float, default=0.001
        How strong the regularisation is: the ratio of the variances of noise and response that is
        expected before anything was measured (see Notes). 0 is plain least squares, which needs an
        input that excites all taps.
    {memory_time}
    every : int, default=1
        θ is solved for at every so many-th instant and held in between: the path has only these
        instants. Solving for 100 taps takes some 50 µs, and ``operator_parameters(model,
        method="fit")`` some 5 ms for each.
    {store_covariance, roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        θ of each ``every``-th instant, taps h_0 ... of each input and the constant. Absent after
        ``partial_fit``.
    {time_path_}
    coef_ : ndarray of shape (n_params,)
        The last θ.
    b_ : ndarray of shape (n_taps,), or list of them for several inputs
        Its impulse responses; h_i answers the input ``(nk + i) dt_`` seconds later.
    a_, intercept_ : ndarray of shape (0,), float
        No output coefficients; the constant.
    covariance_ : ndarray of shape (n_params, n_params)
        Mean squared error of ``coef_``, σ² A⁻¹ (S + δI) A⁻¹ with A = R + δI and S = Σ λ^2k φφ'.
    {standard_errors_, covariance_path_, last_parameters_}
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
    {parameter_names_, run_labels_, dt_, inputs_, jitter_, n_rows_missing_}
    {n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARX : Fewer parameters, but an output error model: biased by remnant.

    Notes
    -----
    δ = ridge trace(R) / w, with w the sum of the weights λ^k of the rows in R. If the taps are
    drawn from N(0, cI), the mean variance of their response is c trace(R) / w, and δ = σ² / c is
    the best there is. For an operator that is P_n, but in simulated runs (C1 and C4, P_n = 0.1 and
    0.15) the bias of operator parameters was least from 0.0001 to 0.01. The papers give δ itself.

    θ is zero before the first row that moves the input. Where y or a lag is NaN, nothing is updated
    and nothing is forgotten, nor where the input is at rest: with less than 1e-12 of its mean
    power. Where R + δI cannot be inverted, θ is held. Several runs are pooled, aligned by time in
    the run, with one forgetting step per instant.

    An operator's response at 100 Hz lasts about 1 s, 100 taps, whose cost grows with their cube:
    :class:`Decimator` before the model is the remedy, or ``every``.

    Standard deviations assume a white error, which coloured remnant violates, and do not include
    the lag behind changing parameters. A⁻¹SA⁻¹ is of the noise, and δA⁻² of the bias towards zero,
    if taps are as large as ``ridge`` says.

    References
    ----------
    Olivari, Nieuwenhuizen, Bülthoff and Pollini, "Identifying time-varying pilot responses: a
    regularized recursive least-squares algorithm", IFAC-PapersOnLine 49 (2016). The definition of δ
    by ``ridge`` is not theirs.

    Examples
    --------
    >>> from skhoid import Decimator, RecursiveFIR, make_tracking_runs
    >>> from sklearn.pipeline import make_pipeline
    >>> X, y = make_tracking_runs("C4", n_runs=2, remnant_intensity=0.1, random_state=0)
    >>> model = make_pipeline(Decimator(4), RecursiveFIR(n_taps=30, memory_time=10.24))
    >>> model.fit(X, y)[-1].coef_path_.shape
    (2048, 30)
    >>> bool(model.score(X, y) > 80)
    True
    """

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "n_taps": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "ridge": [Interval(Real, 0, 1e12, closed="both")],
        "memory_time": [Interval(Real, 0, None, closed="neither"), None],
        "every": [Interval(Integral, 1, 10**9, closed="both")],
        "store_covariance": ["boolean"],
    }

    init_window = 0.0  # seconds of a stream before there is an estimate: it begins from zero

    def __init__(
        self,
        n_taps: Any = 30,
        nk: Any = 0,
        *,
        inputs: Any = None,
        fit_intercept: bool = False,
        ridge: float = 0.001,
        memory_time: float | None = None,
        every: int = 1,
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.n_taps = n_taps
        self.nk = nk
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.ridge = ridge
        self.memory_time = memory_time
        self.every = every
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
        {run_errors}

        Warns
        -----
        PoorExcitationWarning
            If the input never determined all taps.
        MissingDataWarning
            With the number of rows that are NaN.
        """
        grid, inputs, output, *_ = self._read_data(X, y)
        self._set_orders(grid)
        data = RecursionData.of(grid, inputs, output, self.orders_)
        self._check_shared_times(data.instants, data.grid)
        check_row_count(int((~np.isnan(data.target)).sum()), 1, grid)
        n_solutions, n = len(data.instants) // self.every, self.orders_.n_params
        if n_solutions == 0:
            raise ShortRunError(
                f"every={self.every} is more than the {len(data.instants)} instants of the fitted "
                f"grid (n_samples = {grid.layout.n_rows}), so θ would never be solved for. Use a "
                "smaller one."
            )
        self._end_stream(*OF_RUNS)
        found = self._new_filter()
        signals = _kernels.gate(data.signals[..., 0])
        errors = np.full(data.target.shape[:2], np.nan)
        self.coef_path_ = np.empty((n_solutions, n))
        spread = np.empty((n_solutions * self.store_covariance, n, n))
        target = _kernels.gate(data.target[..., 0])
        found.run(signals, target, 0, len(target), self.coef_path_, spread, errors)
        if self.store_covariance:
            self.covariance_path_ = spread * found.noise_variance
        self.initial_coef_ = np.zeros(n)
        self._keep_runs(data, errors)
        self._numbers = self._numbers[self.every - 1 :: self.every]
        self.time_path_ = self._numbers * self.dt_
        self._set_current(found)
        if grid.rows is None:
            if data.instants.n_runs == 1:
                length = int(grid.end[-1] - grid.begin[-1]) if grid.measured[-1] else 0
                found.remember(signals[:, max(signals.shape[1] - length, 0) :, 0])
            self._leave_for_streams(found, grid.layout)
        self._report_missing(grid, inputs, output, self.n_updates_, self.inputs_)
        if not found.part("solved")[0]:
            warnings.warn(
                f"There is no estimate: the input {', '.join(map(repr, self.inputs_))} never "
                f"determined all of the {n} taps, so they are zero throughout. Use ridge > 0, "
                "fewer taps, or a richer input.",
                PoorExcitationWarning,
                stacklevel=3,
            )
        return self

    def _set_orders(self, grid: ModelGrid) -> None:
        self._read_orders()
        check_lengths(grid, self.orders_)

    def _read_orders(self) -> None:
        self.orders_ = Orders.of(
            0, self.n_taps, self.nk, len(self._columns), bool(self.fit_intercept)
        )
        if self.orders_.n_params > MOST_TAPS:
            raise ValueError(
                f"{self.orders_.n_params} taps are too many to solve for at each instant; the "
                f"limit is {MOST_TAPS}. Put a Decimator before the model, use fewer taps, or give "
                "the delay as nk."
            )
        check_streamable(self.orders_)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)

    def _new_filter(self) -> FIRFilter:
        factor = factor_of_time(self.memory_time, self.dt_)
        return FIRFilter(self.orders_, factor, float(self.ridge), int(self.every))

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> FIRFilter:
        self._read_orders()
        return self._new_filter()

    def _rows_to_begin(self) -> int:
        return 0

    @property
    def delta_(self) -> np.ndarray:
        self._check_fitted()
        return self._current.delta()

    @property
    def forgetting_(self) -> float:
        self._check_fitted()
        return self._current.factor

    @property
    def memory_horizon_(self) -> float:
        return float("inf") if self.forgetting_ == 1.0 else 1.0 / (1.0 - self.forgetting_)

    def summary_table(self) -> ModelSummary:
        memory = "nothing is forgotten"
        if self.forgetting_ < 1.0:
            memory = f"T0 = {number(self.memory_horizon_ * self.dt_)} s"
        facts = {
            "Model": orders_text(self.orders_),
            **self._signal_facts(),
            "Method": f"recursive least squares, ridge = {as_fitted(self).ridge:g}",
            "Memory": memory,
            "Rows": f"{self.n_updates_} updates",
            **self._grid_facts(),
            "Residual sd": self._residual_sd(),
        }
        notes = [
            WHITE.format(", and do not include the lag behind changing parameters"),
            JUDGE.format(" is"),
        ]
        table = estimates_table(self.parameters_, "Parameters at the end")
        return ModelSummary(self._title(), facts, table, notes)
