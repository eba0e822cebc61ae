"""RecursiveARX: recursive least squares with forgetting, whose parameters follow the data."""

from __future__ import annotations

import warnings
from copy import copy, deepcopy
from dataclasses import replace
from numbers import Integral, Real
from operator import attrgetter, is_
from typing import Any, Self

import numpy as np
import pandas as pd
from sklearn.exceptions import NotFittedError

from .. import _kernels
from .._sklearn import DT, Interval, StrOptions, fit_context
from ..exceptions import RunTimeWarning, ShortRunError
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from ..regression import columns_of
from ..text import ModelSummary
from .base import BaseARX, arx_parameter_table, check_row_count
from .forgetting import Forgetting, read_forgetting
from .model_summary import recursive_summary
from .orders import Orders
from .rls import (
    Instants,
    Recursion,
    RecursionData,
    RecursionPlan,
    RecursionState,
    grid_numbers,
    likelihoods,
    needs_data,
    start_of,
    window_rows,
)
from .streaming import Clock, Piece, Stream, first_rows


class FollowedPath(BaseARX):
    """Predictions along ``coef_path_``, or with the last parameters where there is no path.

    ``_numbers`` are the sample numbers of its instants, and ``initial_coef_`` what held before.
    """

    parameters: str
    coef_path_: np.ndarray
    time_path_: np.ndarray
    initial_coef_: np.ndarray
    parameter_names_: list[str]
    _numbers: np.ndarray

    @property
    def a_(self) -> np.ndarray:
        return self.orders_.split(self.coef_)[0]

    @property
    def b_(self) -> Any:
        return self.orders_.input_rows(self.coef_)

    @property
    def intercept_(self) -> float:
        return self.orders_.split(self.coef_)[2]

    @property
    def covariance_(self) -> np.ndarray:
        raise NotImplementedError

    @property
    def standard_errors_(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance_))

    @property
    def parameters_(self) -> pd.DataFrame:
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
        return as_fitted(self).parameters == "path" and "coef_path_" in vars(self)

    def _fitted(self, regressors: np.ndarray, rows: np.ndarray, grid: ModelGrid) -> np.ndarray:
        """Output that the regressors give with the parameters of the instant before."""
        if not self._follows_path:
            return regressors @ self.coef_
        path, at = self._parameters_before(grid, 1)
        return np.einsum("tp,tp->t", regressors, path[at[rows]])


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


MOST_ROWS_BACK, MOST_PARAMETERS = 1_000_000, 1_000  # for which a stream keeps rows and squares

OF_RUNS = (  # attributes that describe recorded runs
    "coef_path_",
    "time_path_",
    "covariance_path_",
    "coef_paths_",
    "one_step_errors_",
    "log_likelihood_",
    "n_rows_missing_",
    "run_labels_",
)
READ_ANEW = attrgetter(  # parameters that partial_fit looks at in each call
    "na",
    "nb",
    "nk",
    "fit_intercept",
    "forgetting",
    "memory_horizon",
    "memory_time",
    "forgetting_form",
    "reset_times",
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


class PartialFit(BaseARX):
    """``partial_fit`` of a recursive model."""

    fit_intercept: bool
    forgetting: Any
    init: Any
    init_window: float
    p0: Any
    smooth: bool
    combine: str
    _read_forgetting: Any
    _reset_times: Any
    _set_forgetting: Any

    def partial_fit(self, X: Any, y: Any, *, new_run: bool = False) -> Self:
        """Update the estimates with rows that follow those seen before, one or many.

        The estimates do not depend on how the stream is cut: with the same θ0 and P0 they equal
        those of ``fit``, bit for bit. With ``init="ols"`` or ``p0=None`` rows are collected until
        ``init_window`` is full; until then there is no estimate. Give ``init`` and ``p0`` to have
        one from the first row with known lags. After ``fit`` the stream continues from its end.

        Parameters set since the last call take effect as follows: forgetting and reset times from
        this call on; changed orders raise an error; all others when a new stream begins.

        A new run, or a gap, clears the lags; θ and P are kept. Runs are taken one after the other,
        so several runs give a different result from ``fit``, which aligns them. No path is kept:
        ``coef_`` and what derives from it are current, and predictions use it.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels. Runs and gaps are read from the index, or from the run column. A float64 array
            is fastest (about 4 µs per call); give the delay as ``nk``, since pipelines have no
            ``partial_fit``.
        y : Series or array of shape (n_rows,)
            Output. NaN means no measurement.
        new_run : bool, default=False
            Whether a new run begins with the first row.

        Returns
        -------
        self : RecursiveARX

        Raises
        ------
        ValueError
            If X is decimated, if orders were changed, or the options need whole runs:
            ``combine="average_estimates"``, an array over time, ``forgetting="auto"`` that was set
            since, and before ``fit`` also ``smooth`` and ``forgetting="auto"``.
        RunIndexError
            If time goes backwards within a run.
        """
        stream = vars(self).get("_stream")
        if not (
            stream is not None
            and stream.plain
            and all(map(is_, stream.asked, READ_ANEW(self)))
            and self._run is None
            and not self._indexed
            and self._names is None
            and not new_run
            and type(X) is np.ndarray
            and type(y) is np.ndarray
            and X.dtype == np.float64
            and y.dtype == np.float64
            and X.ndim == 2
            and X.shape[1] == self.n_features_in_
            and X.shape[0] == y.size > 0
            and y.ndim == 1
            and stream.take(
                X if X.flags.carray else _kernels.gate(X), y if y.flags.carray else _kernels.gate(y)
            )
        ):
            return self._partial_fit(X, y, new_run)
        self.coef_ = stream.state.theta
        if "coef_path_" in vars(self) or stream.forgetting.nominal:
            self._refresh(stream)
        return self

    @fit_context(prefer_skip_nested_validation=True)
    def _partial_fit(self, X: Any, y: Any, new_run: bool) -> Self:
        """Take what :meth:`partial_fit` does not take by its fast path."""
        stream, pending = vars(self).get("_stream"), vars(self).get("_pending")
        self._check_streaming("coef_" in vars(self))
        if "coef_" not in vars(self) and pending is None:
            grid, _, output, values, *_ = self._read_data(X, y, "nothing")
        else:
            grid, values = self._read_X(X, reset=False)
            output = self._read_y(X, y)
        if grid.layout.mark is not None:
            raise ValueError(
                "partial_fit cannot take decimated rows: the Decimator's filter needs the samples "
                "after them. Stream at the rate of the model."
            )
        self._read_orders(begun=stream is not None or pending is not None)
        # Nothing is kept of rows that are refused.
        clock = copy(vars(self).get("_clock", Clock()))
        inputs, output = columns_of(values, self._columns), _kernels.gate(output)
        pieces = list(clock.pieces(grid.layout, inputs, output, new_run))
        if stream is None:
            collected = list(pending or [])
            stream = self._started_stream([*collected, *pieces])
            if stream is None:  # the caller may write other rows into the same table
                collected += [replace(p, X=p.X.copy(), y=p.y.copy()) for p in pieces]
                self._pending, self._clock = collected, clock
                return self
            pieces = [*collected, *pieces]
        else:
            stream = deepcopy(stream)
            before, stream.asked = stream.asked, READ_ANEW(self)
            if not all(map(np.array_equal, before, stream.asked)):
                stream.go_on_with(self._stream_forgetting(), self._reset_times())
                stream.state.set_factor(stream.forgetting)
        for piece in pieces:
            stream.feed(piece, self._indexed)
        self._stream, self._clock = stream, clock
        self._forget("_pending")
        self._refresh(stream)
        return self

    def _read_orders(self, *, begun: bool) -> None:
        orders = Orders.of(self.na, self.nb, self.nk, len(self._columns), bool(self.fit_intercept))
        if begun and orders != self.orders_:
            raise ValueError(
                f"The stream began with {self.orders_} and now has {orders}. Orders cannot change "
                "within a stream: call fit, or begin a new stream with sklearn.base.clone."
            )
        check_streamable(orders)
        self.orders_ = orders
        self.parameter_names_ = orders.parameter_names(self.inputs_)
        if callable(self.forgetting) or isinstance(self.forgetting, str):
            return
        if np.shape(self.forgetting) not in ((), (orders.n_params,)):
            raise ValueError(
                f"partial_fit cannot take forgetting as an array of shape "
                f"{np.shape(self.forgetting)} over instants, since their number is not known in "
                "advance. Give it as a function of the time in the run, in seconds."
            )

    def __sklearn_is_fitted__(self) -> bool:
        return "coef_" in vars(self)

    def _check_fitted(self) -> None:
        if "_pending" in vars(self):
            rows = sum(piece.y.size for piece in self._pending)
            raise NotFittedError(
                f"There is no estimate yet: partial_fit has collected {rows} rows of the "
                f"{window_rows(self.init_window, self.dt_)} of init_window={self.init_window:g} s. "
                "Give init= and p0= to have one from the start."
            )
        super()._check_fitted()

    def _check_streaming(self, fitted: bool) -> None:
        if self.combine == "average_estimates" or "coef_paths_" in vars(self):
            raise ValueError(
                "partial_fit cannot continue with combine='average_estimates', one recursion per "
                "run."
            )
        automatic = isinstance(self.forgetting, str) and self.forgetting == "auto"
        for option, chosen in (("smooth=True", self.smooth), ("forgetting='auto'", automatic)):
            if chosen and not fitted:
                raise ValueError(
                    f"partial_fit cannot start with {option}, which needs whole runs. Call fit on "
                    "recorded runs first."
                )

    def _started_stream(self, pieces: list[Piece]) -> Stream | None:
        """A stream from the rows so far, if they suffice."""
        table, n_rows = None, window_rows(self.init_window, self.dt_)
        if needs_data(self.init, self.p0):
            if sum(piece.y.size for piece in pieces) < n_rows:
                return None
            table = first_rows(pieces, n_rows, self.orders_)
            if table is None:
                return None
        theta0, P0 = self._start_from(table, sum(piece.y.size for piece in pieces))
        forgetting = self._stream_forgetting()
        state = RecursionState(theta0, P0)
        state.set_factor(forgetting)
        self.initial_coef_, self.initial_covariance_ = theta0, P0
        return self._new_stream(state, forgetting, P0)

    def _start_from(
        self, table: np.ndarray | None, n_samples: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """theta0 and P0, from the regressors of the first window where they come from data."""
        if table is not None and len(table) < len(self.parameter_names_):
            clocked = self._indexed or self.dt is not None
            clock = "" if clocked else " X has no time index, so each row counts as 1 s."
            raise ShortRunError(
                f"The first {self.init_window:g} s hold {len(table)} usable rows for "
                f"{len(self.parameter_names_)} parameters (n_samples = {n_samples}).{clock}",
                hint=f"Give {'' if clocked else 'dt=, or '}a longer init_window, or init= and p0=.",
                options=[] if clocked else ["dt"],
            )
        return start_of(self.init, self.p0, self.parameter_names_, table)

    def _stream_forgetting(self) -> Forgetting:
        forgetting = self._read_forgetting(np.zeros(1))
        if forgetting.automatic:
            raise ValueError(
                "forgetting='auto' needs whole runs, which partial_fit does not have: give the "
                "forgetting factor, or call fit."
            )
        return forgetting

    def _new_stream(self, state: RecursionState, forgetting: Forgetting, P0: np.ndarray) -> Stream:
        stream = Stream(state, self.orders_, self._columns, P0, self.dt_)
        stream.asked = READ_ANEW(self)
        stream.go_on_with(forgetting, self._reset_times())
        return stream

    def _refresh(self, stream: Stream) -> None:
        """Set the fitted attributes from the stream."""
        self.coef_ = stream.state.theta
        self._forget(*OF_RUNS)
        self._states, self._last_share = [stream.state], np.ones(1)
        self._set_forgetting(stream.forgetting, stream.state.factor)

    def _forget(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)


class RecursiveARX(FollowedPath, PartialFit):
    """ARX model whose parameters follow the data, by recursive least squares with forgetting.

    At each instant, with φ(t) = [-u(t-1) ... e(t-nk) ...] (Eqs. 10-20 of the thesis):

    P̄ = ΛP(t-1)Λ, K = P̄φ / (1 + φ'P̄φ), ε = u - φ'θ(t-1), θ(t) = θ(t-1) + Kε, P(t) = (I - Kφ')P̄

    with Λ = diag(λ_i)^(-1/2); for one λ this is the θ(t) that minimises the sum of squares of all
    errors so far, those k samples ago weighted by λ^k.

    Parameters
    ----------
    na, nb, nk : int, or one per input for nb and nk, default=2, 2, 0
        Orders and input delay, as for :class:`ARXRegressor`.
    inputs : list of column names or positions, or None, default=None
        Linear inputs. None means the column named ``e`` if there is one, else all columns.
    fit_intercept : bool, default=False
        Add a constant to the regressors.
    forgetting : float, array, callable, "auto", "variable" or None, default=None
        λ in (0, 1], one number or one per parameter (Λ); over time as an array of shape
        (n_instants,) or (n_instants, n_params) or as a function that gives it for times in seconds.
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
        errors of all runs, with one forgetting step per instant; or one recursion per run, whose
        estimates are averaged (Figs. 16-17).
    parameters : {"path", "last"}, default="path"
        What predictions use: θ at the same time in the run (outside the fitted times, that of the
        nearest end), or the last θ throughout.
    smooth : bool, default=False
        Smooth the path by also using later data (fixed-interval smoothing), with the random walk of
        the parameters that the forgetting implies: their covariance grows from P to P / λ. It needs
        one λ for all parameters, and is not for streaming.
    store_covariance : bool, default=False
        Keep ``covariance_path_``.
    roles : dict or None, default=None
        Roles of columns, ``{column: role}``, where their names do not give them.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        θ(t) after the update at each instant. Absent after ``partial_fit``.
    time_path_ : ndarray of shape (n_instants,)
        Time in the run in seconds.
    coef_ : ndarray of shape (n_params,)
        The last θ, ordered as in :class:`ARXRegressor`; not smoothed.
    a_, b_, intercept_ : ndarray, ndarray or list of them, float
        The parts of ``coef_``.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``: σ² P (1 + λ^n) / (1 + λ) after n instants.
    standard_errors_ : ndarray of shape (n_params,)
        Square roots of its diagonal.
    parameters_ : DataFrame
        The last parameters: value, sd, low and high (95 % interval), unit, meaning.
    covariance_path_ : ndarray of shape (n_instants, n_params, n_params)
        Covariance of ``coef_path_``; with ``store_covariance``.
    coef_paths_ : ndarray of shape (n_runs, n_instants, n_params)
        θ(t) of each run, NaN outside it; with ``combine="average_estimates"``.
    run_labels_ : list
        Labels of the runs.
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        ε of each row of the fitted grid (of X, unless decimated), by θ before its update; NaN
        where there was none. Pooled runs are taken in turn at each instant.
    noise_variance_ : float
        σ², the mean of ε² / (1 + φ'P̄φ), in the squared unit of ``y``.
    forgetting_ : float or ndarray
        λ used: a number, one per parameter, or over instants.
    memory_horizon_ : float or ndarray
        1 / (1 - λ) in samples.
    log_likelihood_ : dict
        Log-likelihood of one-step predictions by memory horizon; with ``forgetting="auto"``.
    initial_coef_, initial_covariance_ : ndarray
        θ0 and P0; with ``combine="average_estimates"`` their means.
    n_updates_ : int
        Updates of θ.
    n_held_ : int
        Instants at which some information was not forgotten, because no new information replaced
        it.
    parameter_names_ : list of str
        Names of the parameters.
    dt_ : float
        Sampling time of the fitted grid in seconds.
    inputs_ : list of str
        Names of the linear inputs.
    jitter_ : float
        Largest deviation of a step of the clock, as a fraction of the sampling time.
    n_rows_missing_ : int
        Rows without an update because y or an input in their lags is NaN.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    See Also
    --------
    RecursiveARXCV : Chooses the memory horizon on validation runs.
    RecursiveBoxJenkins : A noise model of its own: coloured remnant does not bias it.
    RecursiveIV : Instruments: nor this one.
    skhoid.plotting.ParametersDisplay : Plots the path.
    reference_fits : Batch models of the constant parts to compare with.

    Notes
    -----
    The first update is at k_c = max(na + 1, nb + nk) of each run, even if θ0 comes from OLS on the
    same data, as in the thesis. Where y or a lag is NaN, nothing is updated and nothing is
    forgotten.

    P is stored as factors, P = UDU' (Bierman 1977), and stays symmetric and positive definite.
    Information that is not replaced is not forgotten: neither while all regressors are less than
    3e-6 of what they were, nor, for factor i, while D_i max(φ_i²) exceeds 1e11, the bound on P of
    Salgado, Goodwin and Middleton (1988) in the factors. Neither happens in data that excite the
    model; ``n_held_`` counts such instants.

    ``a_``, ``b_`` and ``to_transfer_function`` are those of the last θ. :meth:`predict_ahead` uses
    the θ of ``horizon`` instants before, which has not seen what it predicts.

    Standard deviations assume a white equation error, which coloured remnant violates, and do not
    include the lag behind changing parameters. For a λ that varies in time they use its latest
    value.

    References
    ----------
    Van Grootheest, thesis, Sections III-B and IV-D. Ljung and Söderström, Theory and Practice of
    Recursive Identification (1983). Bierman, Factorization Methods for Discrete Sequential
    Estimation (1977). Salgado, Goodwin and Middleton, Int. J. Control 47 (1988) 477-491.
    Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981) 831-835. Rauch, Tung and Striebel,
    AIAA J. 3 (1965) 1445-1450. West and Harrison, Bayesian Forecasting and Dynamic Models (1997).

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
        "na": [Interval(Integral, 0, None, closed="left")],
        "nb": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "nk": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "inputs": "no_validation",
        "fit_intercept": ["boolean"],
        "forgetting": "no_validation",
        "memory_horizon": "no_validation",
        "memory_time": "no_validation",
        "forgetting_form": [StrOptions({"joint", "diagonal"})],
        "init": [StrOptions({"ols", "zeros"}), "array-like"],
        "init_window": [Interval(Real, 0, None, closed="neither")],
        "p0": [Interval(Real, 0, None, closed="neither"), "array-like", None],
        "reset_times": [Real, "array-like", None],
        "combine": [StrOptions({"pooled", "average_estimates"})],
        "parameters": [StrOptions({"path", "last"})],
        "smooth": ["boolean"],
        "store_covariance": ["boolean"],
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
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
    def fit(self, X: Any, y: Any) -> RecursiveARX:
        """Run the recursion over recorded runs.

        With ``init="ols"`` the first window of data is used twice, for θ0 and in the recursion, as
        in the thesis.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample; runs and time are read from its index.
        y : Series or array of shape (n_rows,)
            Output. NaN means no measurement.

        Returns
        -------
        self : RecursiveARX

        Raises
        ------
        ValueError
            If forgetting, init or p0 do not fit the model.
        ShortRunError
            If a run has fewer rows than the lags need.
        RunIndexError, IrregularSamplingError
            If rows, runs or time violate the data convention.

        Warns
        -----
        PoorExcitationWarning
            If OLS on the first window has no unique solution.
        MissingDataWarning
            With the number of rows that are NaN.
        """
        data = self._read_recursion(X, y)
        self._fit_recursion(data, self._read_forgetting(data.instants.time))
        return self

    def _read_recursion(self, X: Any, y: Any) -> RecursionData:
        grid, inputs, output, *_ = self._read_data(X, y)
        self._set_orders(grid)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        return RecursionData.of(grid, inputs, output, self.orders_)

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

    def _fit_recursion(self, data: RecursionData, forgetting: Forgetting) -> None:
        """Run the recursion, or one for each run, over data that were read."""
        self._check_shared_times(data.instants, data.grid)
        check_row_count(int((~np.isnan(data.target)).sum()), 1, data.grid)
        self._forget(*OF_RUNS, "_stream", "_pending", "_clock")
        each = self.combine == "average_estimates"
        parts = range(data.instants.n_runs) if each else [None]
        starts = [self._start(data, run) for run in parts]
        resets = self._resets(data.instants)
        if forgetting.automatic:
            found = likelihoods(data, starts, forgetting, resets, each)
            self.log_likelihood_ = found
            forgetting = forgetting.with_horizon(max(found, key=lambda N0: (found[N0], N0)))
        if self.smooth and (forgetting.factors.shape[1] > 1 or forgetting.diagonal):
            raise ValueError(
                "smooth=True needs one λ for all parameters, and forgetting_form='joint'; with "
                "one λ per parameter, ΛPΛ is not a random walk."
            )
        plan = RecursionPlan(self.orders_, forgetting, resets, self.smooth, self.store_covariance)
        recursions = plan.each(data, starts) if each else [plan.pooled(data, starts[0])]
        errors = np.concatenate([r.errors for r in recursions], axis=1)
        self.one_step_errors_ = errors[data.instants.of_row, data.instants.run]
        self.n_rows_missing_ = int(np.isnan(self.one_step_errors_).sum() - data.n_rows_without_lags)
        self._states = [r.state for r in recursions]
        self.run_labels_ = list(data.grid.layout.labels)
        self.time_path_ = data.instants.time
        self._numbers = data.instants.number
        self.initial_coef_ = np.mean([theta0 for theta0, _ in starts], axis=0)
        self.initial_covariance_ = np.mean([P0 for _, P0 in starts], axis=0)
        used = [r.used for r in recursions]
        self._set_forgetting(forgetting, np.mean(used, axis=0) if forgetting.nominal else None)
        self._set_paths(data, recursions, each)
        if not each and data.grid.rows is None:
            self._stream = self._new_stream(self._states[0], forgetting, starts[0][1])
            self._clock = Clock()
            if data.instants.n_runs == 1:
                self._stream.go_on_after(data)
                layout = data.grid.layout
                time = float(layout.time[-1]) if layout.indexed else None
                self._clock = Clock(layout.labels[-1], time)
        self._report_missing(data.grid, data.inputs, data.output, self.n_updates_, self.inputs_)

    def _start(self, data: RecursionData, runs: Any) -> tuple[np.ndarray, np.ndarray]:
        table = None
        if needs_data(self.init, self.p0):
            table = data.first_window(self.init_window, runs)
        return self._start_from(table, data.grid.layout.n_rows)

    def _resets(self, instants: Instants) -> np.ndarray:
        """Instants at which P is set back."""
        times = self._reset_times()
        at = np.searchsorted(instants.time, times - 1e-6 * instants.dt)
        return np.unique(at[at < len(instants)])

    def _reset_times(self) -> np.ndarray:
        given = [] if self.reset_times is None else self.reset_times
        refusal = f"reset_times must be times in the run, in seconds; got {given!r}."
        try:
            times = np.atleast_1d(np.asarray(given, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise ValueError(refusal) from error
        if times.ndim != 1 or not np.isfinite(times).all():
            raise ValueError(refusal)
        return np.unique(times)

    def _set_forgetting(self, forgetting: Forgetting, variable: Any) -> None:
        self._forgetting = forgetting
        self.forgetting_ = variable if forgetting.nominal else forgetting.value
        with np.errstate(divide="ignore"):
            horizon = 1.0 / (1.0 - np.asarray(self.forgetting_))
        self.memory_horizon_ = float(horizon) if horizon.ndim == 0 else horizon

    def _set_paths(self, data: RecursionData, recursions: list[Recursion], each: bool) -> None:
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

    def _summary(self) -> ModelSummary:
        return recursive_summary(self)
