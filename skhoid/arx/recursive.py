"""RecursiveARX: recursive least squares with forgetting, whose parameters follow the data."""

from __future__ import annotations

import warnings
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd

from .. import _kernels
from .._sklearn import Interval, StrOptions, fit_context
from ..exceptions import RunTimeWarning, ShortRunError
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from ..regression import DataToFit
from ..text import ModelSummary, estimates_table
from .base import BaseARX, arx_parameter_table, check_row_count
from .forgetting import Forgetting, read_forgetting
from .model_summary import (
    CLOSED_LOOP,
    JUDGE,
    WHITE,
    delay_text,
    largest_pole,
    memory_text,
    orders_text,
    path_table,
)
from .orders import Orders, regressors
from .rls import (
    Instants,
    RecursionData,
    RecursionState,
    RunRecursion,
    find_start,
    grid_numbers,
    kernel_regressors,
    likelihoods,
    needs_data,
    relatively_weighted,
    run_recursion,
    weigh,
)
from .streaming import Recursion, Streaming

MOST_ROWS_BACK, MOST_PARAMETERS = 1_000_000, 1_000  # for which a stream keeps rows and squares
OF_RUNS = (  # attributes that describe recorded runs
    "coef_path_",
    "noise_path_",
    "time_path_",
    "covariance_path_",
    "coef_paths_",
    "one_step_errors_",
    "log_likelihood_",
    "n_rows_missing_",
    "run_labels_",
)
NO_TIMES = np.empty(0)
MEMORY: dict = {  # constraints of what says how long is remembered
    "forgetting": "no_validation",
    "memory_horizon": "no_validation",
    "memory_time": "no_validation",
}


class FollowedPath(BaseARX):
    """Predictions along ``coef_path_``, or with the last parameters where there is no path.

    ``_numbers`` are the sample numbers of its instants, and ``initial_coef_`` what held before.
    """

    coef_path_: np.ndarray
    time_path_: np.ndarray
    initial_coef_: np.ndarray
    _numbers: np.ndarray

    def __sklearn_is_fitted__(self) -> bool:
        return "coef_" in vars(self)

    @property
    def covariance_(self) -> np.ndarray:
        raise NotImplementedError

    @property
    def standard_errors_(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance_))

    @property
    def parameters_(self) -> pd.DataFrame:
        self._check_fitted()
        return arx_parameter_table(
            self.parameter_names_, self.coef_, self.standard_errors_, self._coefficient_units()
        )

    def _parameters(self, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
        if not self._follows_path:
            return super()._parameters(grid)
        numbers = grid_numbers(grid)
        self._check_times(grid, numbers)
        at = np.searchsorted(self._numbers, numbers, side="right") - 1
        return self.coef_path_, np.maximum(at, 0)

    def _parameters_before(self, grid: ModelGrid, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        if not self._follows_path:
            return super()._parameters_before(grid, horizon)
        self._check_times(grid, grid_numbers(grid))
        path = np.concatenate([self.initial_coef_[None], self.coef_path_])
        return path, self._places_before(grid, horizon)

    def _places_before(self, grid: ModelGrid, horizon: int) -> np.ndarray:
        """Place of what each row knew so many rows before: 0 for the start, then the path's."""
        return np.searchsorted(self._numbers, grid_numbers(grid) - horizon, side="right")

    def _check_times(self, grid: ModelGrid, numbers: np.ndarray) -> None:
        warn_of_times_outside(
            grid, numbers, self._numbers, self.time_path_, ", or use parameters='last'"
        )

    def _check_shared_times(self, instants: Instants, grid: ModelGrid) -> None:
        """Warn of runs that cannot be aligned with the others."""
        if instants.n_runs == 1:
            return
        shared = np.bincount(instants.of_row)[instants.of_row] > 1
        alone = np.bincount(instants.run, shared, instants.n_runs) == 0
        if alone.any():
            label = grid.layout.labels[int(np.argmax(alone))]
            warnings.warn(
                f"Run {label!r} shares no instant with the other runs. Runs are aligned by their "
                "time, which must count from the start of each run.",
                RunTimeWarning,
                stacklevel=5,
            )

    @property
    def _follows_path(self) -> bool:
        wanted = getattr(as_fitted(self), "parameters", "path")
        return wanted == "path" and "coef_path_" in vars(self)

    def _keep_runs(self, data: RecursionData, errors: np.ndarray) -> None:
        """Set what describes the runs; ``errors`` are one step ahead, by instant and run."""
        instants = data.instants
        self.run_labels_ = list(data.grid.layout.labels)
        self._numbers, self.time_path_ = instants.number, instants.time
        self.one_step_errors_ = errors[instants.of_row, instants.run]
        self.n_rows_missing_ = int(np.isnan(self.one_step_errors_).sum() - data.n_rows_without_lags)


class OneRecursion(Streaming, FollowedPath):
    """A model that one recursion follows, over runs or a stream.

    The recursion has ``theta``, ``covariance``, ``noise_variance``, ``n_updates`` and ``n_held``.
    """

    def _set_current(self, recursion: Any) -> None:
        self._current = recursion
        self.coef_ = recursion.theta.copy()

    def _refresh(self, recursion: Any) -> None:
        for name in OF_RUNS:
            self.__dict__.pop(name, None)
        self._set_current(recursion)

    @property
    def covariance_(self) -> np.ndarray:
        self._check_fitted()
        return self._current.covariance

    @property
    def noise_variance_(self) -> float:
        self._check_fitted()
        return self._current.noise_variance

    @property
    def n_updates_(self) -> int:
        self._check_fitted()
        return self._current.n_updates

    @property
    def n_held_(self) -> int:
        self._check_fitted()
        return self._current.n_held


def warn_of_times_outside(
    grid: ModelGrid, numbers: np.ndarray, known: np.ndarray, time: np.ndarray, or_else: str = ""
) -> None:
    """Warn of stretches of a grid with no instant of a path, whose sample numbers are ``known``."""
    outside = (numbers[grid.begin] > known[-1]) | (numbers[grid.end - 1] < known[0])
    if outside.any():
        row = grid.full_row(int(grid.begin[np.argmax(outside)]))
        warnings.warn(
            f"Rows from {grid.layout.where(row)} on lie outside the fitted times, {time[0]:g} to "
            f"{time[-1]:g} s, so they get the parameters of the nearest end. Count time from the "
            f"start of each run{or_else}.",
            RunTimeWarning,
            stacklevel=6,
        )


def check_streamable(orders: Orders) -> None:
    """Refuse more lags than a stream can keep."""
    if orders.first_row > MOST_ROWS_BACK or orders.n_params > MOST_PARAMETERS:
        raise ValueError(
            f"{orders.n_params} parameters with lags that reach {orders.first_row} samples "
            f"back are too many to stream; the limits are {MOST_PARAMETERS} parameters and "
            f"{MOST_ROWS_BACK} samples. Use fewer lags na and nb, or a smaller delay nk (in "
            "samples)."
        )


class Stream(Recursion):
    """Recursive least squares that take rows one after the other, with the rows they go on from."""

    def __init__(
        self,
        state: RecursionState,
        orders: Orders,
        n_inputs: int,
        P0: np.ndarray,
        dt: float,
        forgetting: Forgetting,
        reset_times: np.ndarray = NO_TIMES,
    ) -> None:
        self.state, self.P0, self.dt = state, P0, dt
        self.depth = orders.first_row
        rows = self.depth + _kernels.rls.CHUNK
        self._signals = np.full((1 + n_inputs + orders.intercept, rows, 1, 1), np.nan)
        if orders.intercept:
            self._signals[-1] = 1.0
        self._inputs = np.arange(n_inputs)
        self._target = np.full((rows, 1, 1), np.nan)
        self._regressors = kernel_regressors(orders)
        self._since = np.zeros(1, dtype=np.int64)  # rows without a break
        self._last_time = -np.inf
        self.forgetting, self._reset_times = forgetting, reset_times
        self._arrays = forgetting.arrays()
        self.plain = not forgetting.over_time and reset_times.size == 0

    def go_on_after(self, data: RecursionData) -> None:
        """Take over the lags at the end of a single run."""
        grid = data.grid
        length = int(grid.end[-1] - grid.begin[-1]) if grid.measured[-1] else 0
        kept = min(length, self.depth)
        if kept:
            self._signals[:, self.depth - kept : self.depth] = data.signals[:, -kept:]
        self._since[0] = length
        self._last_time = float(data.instants.time[-1])

    def rest(self) -> None:
        self._since[0] = 0
        self._last_time = -np.inf

    def step(self, X: np.ndarray, y: np.ndarray) -> bool:
        return _kernels.rls.take(
            X, y, self._inputs, self._signals, self._target, *self._regressors, self.depth,
            *self._arrays, self.forgetting.diagonal, self.forgetting.nominal, self.state.buffer,
            self._since,
        )  # fmt: skip

    def step_weighted(self, X: np.ndarray, y: np.ndarray, weights: np.ndarray) -> None:
        """The same as ``step`` of rows with weights, whose regressors are made here."""
        n, depth, signals = y.size, self.depth, self._signals
        known = np.concatenate([signals[:, :depth], np.ones((len(signals), n, 1, 1))], axis=1)
        known[0, depth:, 0, 0], known[1 : 1 + X.shape[1], depth:, 0, 0] = -y, X.T
        told = np.r_[np.full(depth, np.nan), y, np.sqrt(weights)][:, None, None]
        target, sizes = told[: depth + n], np.r_[told[:depth], told[depth + n :]]
        target[depth : depth + max(depth - int(self._since[0]), 0)] = np.nan
        made, scaled, lags = weigh(known, target, self._regressors, sizes)
        empty = np.empty((0, 0, 0))
        _kernels.rls.recursion(1)(
            made, scaled, *lags, depth, depth + n, *self._arrays, depth, self.forgetting.diagonal,
            self.forgetting.nominal, self.state.buffer, *[empty] * 5, np.empty((0, 0)),
        )  # fmt: skip
        signals[:, :depth] = known[:, n:]
        self._since[0] += n

    def take(
        self,
        X: np.ndarray,
        y: np.ndarray,
        time: np.ndarray | None = None,
        weights: np.ndarray | None = None,
    ) -> None:
        """Take rows, with all that may change at their instants."""
        if time is None:
            time = (self._since[0] + np.arange(y.size)) * self.dt
        slack = 1e-6 * self.dt
        resets = np.searchsorted(time, self._reset_times - slack)
        due = (self._reset_times - slack > self._last_time) & (resets < time.size)
        edges = np.unique([0, *resets[due].tolist(), time.size]).tolist()
        for begin, end in pairwise(edges):
            if begin in resets[due]:
                self.state.reset(self.P0)
            self.forgetting = self.forgetting.at(time[begin:end], self.state.n_params)
            self._arrays = self.forgetting.arrays()
            if weights is None:
                self.step(X[begin:end], y[begin:end])
            else:
                self.step_weighted(X[begin:end], y[begin:end], weights[begin:end])
        self._last_time = float(time[-1])


class RecursiveLeastSquares(Streaming, FollowedPath):
    """A model that recursive least squares follow, over runs aligned by time, or a stream.

    A subclass gives ``_read_forgetting(time)``: how to forget at the instants ``time``.
    """

    fit_intercept: bool
    init: Any
    init_window: float
    p0: Any
    store_covariance: bool
    _states: list[RecursionState]

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "forgetting_form": [StrOptions({"joint", "diagonal"})],
        "init": [StrOptions({"ols", "zeros"}), "array-like"],
        "init_window": [Interval(Real, 0, None, closed="neither")],
        "p0": [Interval(Real, 0, None, closed="neither"), "array-like", None],
        "parameters": [StrOptions({"path", "last"})],
        "store_covariance": ["boolean"],
    }

    def _read_forgetting(self, time: np.ndarray) -> Forgetting:
        raise NotImplementedError

    def _read_reset_times(self) -> np.ndarray:
        """Times in the run, in seconds, at which P is set back."""
        return NO_TIMES

    def _read_recursion(self, X: Any, y: Any) -> RecursionData:
        return self._recursion_of(self._read_data(X, y))

    def _recursion_of(self, data: DataToFit) -> RecursionData:
        self._set_orders(data.grid)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        weights = data.weights
        return RecursionData.of(data.grid, data.inputs, data.output, self.orders_, weights)

    def _fit_recursion(
        self,
        data: RecursionData,
        forgetting: Forgetting,
        *,
        each: bool = False,
        smooth: bool = False,
    ) -> None:
        """Run the recursion, or one for ``each`` run, over data that were read."""
        self._check_shared_times(data.instants, data.grid)
        check_row_count(int((~np.isnan(data.target)).sum()), 1, data.grid)
        self._end_stream(*OF_RUNS)
        n_runs = data.instants.n_runs
        parts = [slice(r, r + 1) for r in range(n_runs)] if each else [slice(None)]
        starts = [self._start(data, np.arange(n_runs)[runs]) for runs in parts]
        times = self._read_reset_times()
        at = np.searchsorted(data.instants.time, times - 1e-6 * data.instants.dt)
        resets = np.unique(at[at < len(data.instants)])
        if forgetting.automatic:
            found = likelihoods(data, starts, parts, forgetting, resets)
            self.log_likelihood_ = found
            forgetting = forgetting.with_horizon(max(found, key=lambda N0: (found[N0], N0)))
        if smooth and (forgetting.factors.shape[1] > 1 or forgetting.diagonal):
            raise ValueError(
                "smooth=True needs one λ for all parameters, and forgetting_form='joint'; with "
                "one λ per parameter, ΛPΛ is not a random walk."
            )
        options = {"smooth": smooth, "with_covariance": self.store_covariance}
        recursions = [
            run_recursion(data, start, runs, forgetting, resets, **options)
            for start, runs in zip(starts, parts, strict=True)
        ]
        errors = np.concatenate([r.errors for r in recursions], axis=1)
        self._keep_runs(data, errors)
        self._states = [r.state for r in recursions]
        self.initial_coef_ = np.mean([theta0 for theta0, _ in starts], axis=0)
        self.initial_covariance_ = np.mean([P0 for _, P0 in starts], axis=0)
        used = [r.used for r in recursions]
        self._set_forgetting(forgetting, np.mean(used, axis=0) if forgetting.nominal else None)
        self._set_paths(data, recursions, each)
        if not each and data.grid.rows is None:
            stream = self._stream_from(self._states[0], starts[0][1], forgetting)
            if data.instants.n_runs == 1:
                stream.go_on_after(data)
            self._leave_for_streams(stream, data.grid.layout)
        told = data.output if data.weights is None else np.where(data.weights > 0, data.output, 0)
        self._report_missing(data.grid, data.inputs, told, self.n_updates_, self.inputs_)

    def _start(self, data: RecursionData, runs: Any) -> tuple[np.ndarray, np.ndarray]:
        table = None
        if needs_data(self.init, self.p0):
            table = data.first_window(self.init_window, runs)
        return self._start_from(table, data.grid.layout.n_rows)

    def _start_from(
        self, table: np.ndarray | None, n_samples: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """theta0 and P0, from the regressors of the first window where they come from data."""
        if table is not None and len(table) < len(self.parameter_names_):
            clocked = self._reading.indexed or self.dt is not None
            clock = "" if clocked else " X has no time index, so each row counts as 1 s."
            raise ShortRunError(
                f"The first {self.init_window:g} s hold {len(table)} usable rows for "
                f"{len(self.parameter_names_)} parameters (n_samples = {n_samples}).{clock}",
                hint=f"Give {'' if clocked else 'dt=, or '}a longer init_window.",
                options=[] if clocked else ["dt"],
            )
        return find_start(self.init, self.p0, self.parameter_names_, table)

    def _set_forgetting(self, forgetting: Forgetting, variable: Any) -> None:
        self._forgetting = forgetting
        self.forgetting_ = variable if forgetting.nominal else forgetting.value
        with np.errstate(divide="ignore"):
            horizon = 1.0 / (1.0 - np.asarray(self.forgetting_))
        self.memory_horizon_ = float(horizon) if horizon.ndim == 0 else horizon

    def _set_paths(self, data: RecursionData, recursions: list[RunRecursion], each: bool) -> None:
        self._last_share = np.ones(1)
        self.coef_path_ = recursions[0].theta
        if self.store_covariance:
            self.covariance_path_ = recursions[0].covariance
        if each:
            inside = data.inside()
            share = inside / inside.sum(axis=0)
            self._last_share = share[:, -1]
            paths = np.stack([r.theta for r in recursions])
            self.coef_path_ = np.einsum("rt,rtp->tp", share, paths)
            self.coef_paths_ = np.where(inside[:, :, None], paths, np.nan)
            if self.store_covariance:
                covariances = np.stack([r.covariance for r in recursions])
                self.covariance_path_ = np.einsum("rt,rtpq->tpq", share**2, covariances)
        last = [r.state.theta for r in recursions]
        self.coef_ = np.einsum("r,rp->p", self._last_share, last)

    # Streams

    def _rows_to_begin(self) -> int:
        return super()._rows_to_begin() if needs_data(self.init, self.p0) else 0

    def _first_row(self, X: np.ndarray, y: np.ndarray) -> int | None:
        known = ~np.isnan(y) & ~np.isnan(X).any(axis=1)
        return int(np.argmax(known)) if known.any() else None

    def _first_table(
        self,
        X: np.ndarray,
        y: np.ndarray,
        fresh: np.ndarray,
        orders: Orders,
        weights: np.ndarray | None = None,
    ) -> np.ndarray | None:
        """Regressors of the first rows of a stream, where the start comes from data."""
        first = self._first_row(X, y)
        if first is None or not needs_data(self.init, self.p0):
            return None
        end = first + self._rows_to_begin()
        begin = np.flatnonzero(fresh[:end])
        edges = begin, np.append(begin[1:], end)
        table, rows, _ = regressors(y[:end], X[:end], *edges, orders)
        return relatively_weighted(table, rows, weights)

    def _stream_from(self, state: RecursionState, P0: np.ndarray, forgetting: Forgetting) -> Stream:
        n_inputs, times = len(self._columns), self._read_reset_times()
        return Stream(state, self.orders_, n_inputs, P0, self.dt_, forgetting, times)

    def _refresh(self, recursion: Stream) -> None:
        self.coef_ = recursion.state.theta
        for name in OF_RUNS:
            self.__dict__.pop(name, None)
        self._states, self._last_share = [recursion.state], np.ones(1)
        self._set_forgetting(recursion.forgetting, recursion.state.factor)

    def _refresh_estimates(self, recursion: Stream) -> None:
        self.coef_ = recursion.state.theta
        if "coef_path_" in vars(self) or recursion.forgetting.nominal:
            self._refresh(recursion)

    @property
    def covariance_(self) -> np.ndarray:
        self._check_fitted()
        shares = self._last_share**2
        each = [state.covariance(self._forgetting) for state in self._states]
        return np.einsum("r,rpq->pq", shares, each)

    @property
    def noise_variance_(self) -> float:
        updates = self.n_updates_
        total = sum(float(state.count("total").sum()) for state in self._states)
        return total / updates if updates else np.nan

    @property
    def n_updates_(self) -> int:
        self._check_fitted()
        return int(sum(state.count("updates").sum() for state in self._states))

    @property
    def n_held_(self) -> int:
        self._check_fitted()
        if (self._forgetting.factors == 1.0).all() and not self._forgetting.over_time:
            return 0
        return int(sum(state.count("held").sum() for state in self._states))

    def summary_table(self) -> ModelSummary:
        has_path = "coef_path_" in vars(self)
        smoothed = has_path and getattr(as_fitted(self), "smooth", False)
        facts = {"Model": orders_text(self.orders_), **self._signal_facts()}
        facts["Method"] = "recursive least squares" + (", path smoothed" if smoothed else "")
        facts["Memory"] = memory_text(self._forgetting, self.forgetting_, self.dt_)
        facts["Rows"] = f"{self.n_updates_} updates"
        if has_path:
            how = "averaged" if "coef_paths_" in vars(self) else "pooled"
            runs = len(self.run_labels_)
            facts["Runs"] = f"{runs}" + (f", {how}" if runs > 1 else "")
            if self.n_rows_missing_:
                facts["Missing"] = f"{self.n_rows_missing_} rows"
        facts |= self._grid_facts()
        facts["Delay, nk"] = delay_text(self.orders_.nk, self.dt_)
        facts["Residual sd"] = self._residual_sd()
        facts["Protection"] = f"forgetting held back at {self.n_held_} instants"
        facts["Largest |pole|"] = f"{largest_pole(self.a_)} at the end"
        notes = [
            WHITE.format(", and do not include the lag behind changing parameters"),
            CLOSED_LOOP.format(""),
            JUDGE.format(" is"),
        ]
        if not has_path:
            notes.append("partial_fit keeps no path: predictions use the last parameters.")
        elif smoothed:
            notes.append("The last parameters are not smoothed; the path is.")
        return ModelSummary(
            self._title(),
            facts,
            estimates_table(self.parameters_, "Parameters at the end"),
            notes,
            [path_table(self.parameter_names_, self.coef_path_, self.time_path_)]
            if has_path
            else [],
        )


class RecursiveARX(RecursiveLeastSquares):
    """ARX model whose parameters follow the data, by recursive least squares with forgetting.

    At each instant, with φ(t) = [-u(t-1) ... e(t-nk) ...] (Eqs. 10-20 of the thesis):

    P̄ = ΛP(t-1)Λ, K = P̄φ / (1 + φ'P̄φ), ε = u - φ'θ(t-1), θ(t) = θ(t-1) + Kε, P(t) = (I - Kφ')P̄

    with Λ = diag(λ_i)^(-1/2); for one λ this is the θ(t) that minimises the sum of squares of all
    errors so far, those k samples ago weighted by λ^k.

    Parameters
    ----------
    {orders, inputs, fit_intercept}
    forgetting : float or one per parameter, callable, "auto", "variable" or None, default=None
        λ in (0, 1], one number or one per parameter (Λ); over time as a function that gives it for
        an array of times in seconds, of shape (n_instants,) or (n_instants, n_params).
        ``"auto"`` takes the memory horizon of 2, 4, ... 8192 samples and infinity with the largest
        likelihood of the one-step predictions. ``"variable"`` forgets more when errors are large
        (Fortescue and others 1981), on average with the memory horizon or time given, by default
        256 samples. If this and the next two are None, nothing is forgotten (λ = 1).
    memory_horizon : float or one per parameter, default=None
        N0 in samples of the fitted grid, λ = 1 - 1 / N0; may be infinite.
    memory_time : float or one per parameter, default=None
        T0 = N0 dt in seconds: the same at every decimation factor.
    forgetting_form : {"joint", "diagonal"}, default="joint"
        What one λ per parameter means: ΛPΛ (Eqs. 17-20), or dividing the diagonal of P alone.
    init : {"ols", "zeros"} or array of shape (n_params,), default="ols"
        θ0: by ordinary least squares on the first ``init_window`` seconds of each run, zeros, or
        given.
    init_window : float, default=30.72
        Seconds of data (or as many as there are) for ``init="ols"`` and ``p0=None``, from the first
        row that is not NaN.
    p0 : float, array of shape (n_params,) or (n_params, n_params), or None, default=None
        P0: a number is multiplied by the identity (the thesis: 1), several are its diagonal. None
        scales with the data: diag(1 / (w mean φ_i²)) over the init window, worth w = 1 sample
        where θ0 is that of OLS, and 0.0001 otherwise.
    reset_times : float or array-like, default=None
        Times in the run, in seconds, at which P is reset to P0; θ is kept.
    combine : {"pooled", "average_estimates"}, default="pooled"
        How to combine several runs, aligned by time in the run: one recursion that minimises the
        errors of all, with one forgetting step per instant; or one recursion per run, whose
        estimates are averaged (Figs. 16-17).
    parameters : {"path", "last"}, default="path"
        What predictions use: θ at the same time in the run (outside the fitted times, that of the
        nearest end), or the last θ throughout.
    smooth : bool, default=False
        Smooth the path by also using later data, with the random walk of the parameters that the
        forgetting implies: their covariance grows from P to P / λ. It needs one λ for all
        parameters, and is not for streaming.
    {store_covariance, roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        θ(t) after the update at each instant. Absent after ``partial_fit``.
    {time_path_}
    coef_ : ndarray of shape (n_params,)
        The last θ, ordered as in :class:`ARXRegressor`; not smoothed.
    a_, b_, intercept_ : ndarray, ndarray or list of them, float
        The parts of ``coef_``.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``: σ² P (1 + λ^n) / (1 + λ) after n instants, with the latest λ.
    {standard_errors_, last_parameters_, covariance_path_}
    coef_paths_ : ndarray of shape (n_runs, n_instants, n_params)
        θ(t) of each run, NaN outside it; with ``combine="average_estimates"``.
    {run_labels_}
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        ε of each row of the fitted grid (of X, unless decimated), by θ before its update; NaN
        where there was none. Pooled runs are taken in turn at each instant.
    noise_variance_ : float
        σ², the mean of ε² / (1 + φ'P̄φ), in the squared unit of ``y``.
    forgetting_, memory_horizon_ : float or ndarray
        λ used: a number, one per parameter, or over instants; and 1 / (1 - λ) in samples.
    log_likelihood_ : dict
        Log-likelihood of one-step predictions by memory horizon; with ``forgetting="auto"``.
    initial_coef_, initial_covariance_ : ndarray
        θ0 and P0; with ``combine="average_estimates"`` their means.
    n_updates_, n_held_ : int
        Updates of θ; and instants at which some information was not forgotten, because no new
        information replaced it.
    {parameter_names_, dt_, inputs_, jitter_, n_rows_missing_}
    {n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARXCV : Chooses the memory horizon on validation runs.
    RecursiveBoxJenkins : A noise model of its own: coloured remnant does not bias it.
    RecursiveIV : Instruments: nor this one.
    skhoid.plotting.ParametersDisplay : Plots the path.
    reference_fits : Batch models of the constant parts to compare with.

    Notes
    -----
    ``score`` is the VAF of the free run in percent: 100 is perfect, where other regressors have R²,
    at most 1 (``VAFScorer(fraction=True)``).

    The first update is at k_c = max(na + 1, nb + nk) of each run, even if θ0 comes from OLS on the
    same data, as in the thesis. Where y or a lag is NaN, nothing is updated and nothing is
    forgotten. :meth:`predict_ahead` uses the θ of ``horizon`` instants before.

    P is stored as factors, P = UDU' (Bierman 1977), and stays symmetric and positive definite.
    Information that is not replaced is not forgotten: neither while all regressors are less than
    3e-6 of what they were, nor, for factor i, while D_i max(φ_i²) exceeds 1e11, the bound on P of
    Salgado, Goodwin and Middleton (1988). Neither happens in data that excite the model.

    Standard deviations assume a white equation error, which coloured remnant violates, and do not
    include the lag behind changing parameters.

    References
    ----------
    Van Grootheest, thesis, Sections III-B and IV-D. Bierman, Factorization Methods for Discrete
    Sequential Estimation (1977). Salgado, Goodwin and Middleton, Int. J. Control 47 (1988) 477-491.
    Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981) 831-835. Rauch, Tung and Striebel, AIAA
    J. 3 (1965) 1445-1450.

    Examples
    --------
    >>> from skhoid import RecursiveARX, make_tracking_runs
    >>> X, y = make_tracking_runs("C4", n_runs=2, remnant_intensity=0.1, random_state=0)
    >>> model = RecursiveARX(na=2, nb=2, nk=29, memory_time=2.56).fit(X, y)
    >>> model.coef_path_.shape
    (8192, 4)
    >>> model.forgetting_
    0.99609375
    """

    _parameter_constraints: dict = {
        **RecursiveLeastSquares._parameter_constraints,
        **MEMORY,
        "reset_times": [Real, "array-like", None],
        "combine": [StrOptions({"pooled", "average_estimates"})],
        "smooth": ["boolean"],
    }

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        fit_intercept: bool = False,
        forgetting: Any = None,
        memory_horizon: Any = None,
        memory_time: Any = None,
        forgetting_form: str = "joint",
        init: Any = "ols",
        init_window: float = 30.72,
        p0: Any = None,
        reset_times: Any = None,
        combine: str = "pooled",
        parameters: str = "path",
        smooth: bool = False,
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.forgetting = forgetting
        self.memory_horizon = memory_horizon
        self.memory_time = memory_time
        self.forgetting_form = forgetting_form
        self.init = init
        self.init_window = init_window
        self.p0 = p0
        self.reset_times = reset_times
        self.combine = combine
        self.parameters = parameters
        self.smooth = smooth
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> RecursiveARX:
        """Run the recursion over recorded runs.

        With ``init="ols"`` the first window of data is used twice, for θ0 and in the recursion, as
        in the thesis.

        Parameters
        ----------
        {X, y, sample_weight}

        Returns
        -------
        self : RecursiveARX

        Raises
        ------
        ValueError
            If forgetting, init or p0 do not fit the model.
        {run_errors}

        Warns
        -----
        PoorExcitationWarning
            If OLS on the first window has no unique solution.
        MissingDataWarning
            With the number of rows that are NaN.
        """
        data = self._recursion_of(self._read_data(X, y, sample_weight=sample_weight))
        each = self.combine == "average_estimates"
        forgetting = self._read_forgetting(data.instants.time)
        self._fit_recursion(data, forgetting, each=each, smooth=self.smooth)
        return self

    def partial_fit(
        self, X: Any, y: Any, sample_weight: Any = None, *, new_run: bool = False
    ) -> RecursiveARX:
        """Update the estimates with rows that follow those seen before, one or many.

        The estimates do not depend on how the stream is cut: from the same start they equal those
        of ``fit``, bit for bit. Rows are collected until ``init_window`` is full if the method
        begins from data; until then there is no estimate. After ``fit`` on a single run the stream
        continues from its end. Options changed since the stream began take effect when a new one
        begins.

        A new run, or a gap, clears the lags; estimates are kept. Runs are taken one after the
        other, while ``fit`` aligns them. No path is kept.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels. Runs and gaps are read from the index, or from the run column. A float64 array
            is fastest; give a delay as ``nk``, since pipelines have no ``partial_fit``.
        {y}
        sample_weight : array-like of shape (n_rows,), float or None, default=None
            Weight of each row, as in ``fit``; 0 means that y was not measured.
        new_run : bool, default=False
            Whether a new run begins with the first row.

        Returns
        -------
        self : RecursiveARX
        """
        if sample_weight is None:
            return super().partial_fit(X, y, new_run=new_run)
        return self._partial_fit(X, y, new_run, sample_weight)

    def _begun(
        self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray, weights: np.ndarray | None = None
    ) -> Recursion:
        self.orders_ = orders = Orders.of(
            self.na, self.nb, self.nk, len(self._columns), bool(self.fit_intercept)
        )
        check_streamable(orders)
        self.parameter_names_ = orders.parameter_names(self.inputs_)
        theta0, P0 = self._start_from(self._first_table(X, y, fresh, orders, weights), y.size)
        self.initial_coef_, self.initial_covariance_ = theta0, P0
        forgetting = self._read_forgetting(np.zeros(1))
        state = RecursionState(theta0, P0)
        state.set_factor(forgetting)
        return self._stream_from(state, P0, forgetting)

    def _read_forgetting(self, time: np.ndarray) -> Forgetting:
        return read_forgetting(
            self.forgetting,
            self.memory_horizon,
            self.memory_time,
            form=self.forgetting_form,
            n_params=self.orders_.n_params,
            time=time,
            dt=self.dt_,
        )

    def _read_reset_times(self) -> np.ndarray:
        given = [] if self.reset_times is None else self.reset_times
        refusal = f"reset_times must be times in the run, in seconds; got {given!r}."
        try:
            times = np.atleast_1d(np.asarray(given, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise ValueError(refusal) from error
        if times.ndim != 1 or not np.isfinite(times).all():
            raise ValueError(refusal)
        return np.unique(times)

    def _check_streaming(self) -> None:
        if self.combine == "average_estimates" or "coef_paths_" in vars(self):
            raise ValueError(
                "partial_fit cannot continue with combine='average_estimates', one recursion per "
                "run."
            )
        if self.__sklearn_is_fitted__():
            return
        automatic = isinstance(self.forgetting, str) and self.forgetting == "auto"
        for option, chosen in (("smooth=True", self.smooth), ("forgetting='auto'", automatic)):
            if chosen:
                raise ValueError(
                    f"partial_fit cannot start with {option}, which needs whole runs. Call fit on "
                    "recorded runs first."
                )
