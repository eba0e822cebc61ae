"""LPVARX: ARX coefficients that are linear in known functions of a scheduling signal."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import issparse
from sklearn.base import clone
from sklearn.preprocessing import PolynomialFeatures

from .._sklearn import HasMethods, StrOptions, fit_context
from ..arx.base import BaseARX, arx_parameter_table, check_row_count
from ..arx.least_squares import Triangle
from ..arx.model_summary import CLOSED_LOOP, JUDGE, WHITE, orders_text
from ..arx.orders import regressor_blocks
from ..arx.rls import Instants, grid_numbers
from ..exceptions import RankDeficiencyError
from ..preprocessing.grid import ModelGrid
from ..regression import DataToFit, find_columns
from ..runs import input_columns
from ..text import ModelSummary, estimates_table

TIME = "time"  # the scheduling that is no channel


@dataclass(frozen=True)
class Schedule:
    """A basis as a user gives it, fitted if it is a transformer."""

    basis: Any
    descriptions: list[str]

    @classmethod
    def fitted(cls, basis: Any, signal: np.ndarray, channels: list[str]) -> Schedule:
        """Check a basis on a signal of shape (n, n_channels) without NaN, and fit transformers."""
        if len(signal) == 0:
            raise ValueError(
                f"scheduling {', '.join(map(repr, channels))} contains NaN in all rows: nothing "
                "was measured."
            )
        if isinstance(basis, str):
            basis = PolynomialFeatures(1)
        if hasattr(basis, "transform"):
            basis = clone(basis).fit(signal)
            return cls(basis, [str(n) for n in basis.get_feature_names_out(channels)])
        n_functions = cls(basis, []).evaluated(signal).shape[1]
        names = [f"{_name(basis)}[{j}]" for j in range(n_functions)]
        if np.ndim(basis(_argument(signal))) == 1:
            names = ["1", _name(basis)]
        return cls(basis, names)

    def described(self) -> list[str]:
        return [f"{j}: {text}" for j, text in enumerate(self.descriptions)]

    def functions(self, signal: np.ndarray) -> np.ndarray:
        """Functions of a signal (n, n_channels), of shape (n, n_functions); NaN where it is."""
        known = ~np.isnan(signal).any(axis=1)
        values = np.full((len(signal), len(self.descriptions)), np.nan)
        if known.any():
            values[known] = self.evaluated(signal[known])
        return values

    def evaluated(self, signal: np.ndarray) -> np.ndarray:
        """Functions of a signal, with 1 before them where one function gives one number a row."""
        if hasattr(self.basis, "transform"):
            found = self.basis.transform(signal)
            return np.asarray(found.toarray() if issparse(found) else found, dtype=np.float64)
        name, n, argument = _name(self.basis), len(signal), _argument(signal)
        try:
            values = np.asarray(self.basis(argument), dtype=np.float64)
        except (TypeError, ValueError, ArithmeticError, LookupError) as error:
            raise ValueError(
                f"The basis {name} failed for the array s of {argument.shape} values ({error}). It "
                "is called with all rows at once: choose between values with np.where, not if."
            ) from error
        if values.ndim not in (1, 2) or len(values) != n or not values.size:
            raise ValueError(
                f"The basis {name} returned the shape {values.shape} for the scheduling s of shape "
                f"{argument.shape}. It must return ({n},) or ({n}, n_functions)."
            )
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values.reshape(n, -1)).all(axis=1))[0])
            raise ValueError(
                f"The basis {name} is not finite for s = {argument[row]}. It must be finite "
                "wherever s is."
            )
        return np.column_stack([np.ones(n), values]) if values.ndim == 1 else values


def _argument(signal: np.ndarray) -> np.ndarray:
    """The scheduling as functions get it: without the axis of a single channel."""
    return signal[:, 0].copy() if signal.shape[1] == 1 else signal.copy()


def _name(function: Any) -> str:
    return str(getattr(function, "__name__", repr(function)))


PATH = ("coef_path_", "time_path_", "covariance_path_")


class LPVARX(BaseARX):
    """ARX model whose coefficients are linear in known functions of a scheduling signal.

    A(q, t) y(t) = B(q, t) x(t - nk) + c(t) + ε(t) with θ(t) = Σ_j μ_j(s(t)) θ_j: s(t) is a channel,
    or the time in the run, and the functions μ_j are given.

    Parameters
    ----------
    {orders}
    scheduling : "time", column name or position, or list of them, default="time"
        What the coefficients depend on: the time in the run in seconds, or columns of X, which are
        not linear inputs then.
    basis : "linear", callable or transformer, default="linear"
        The functions μ_j. ``"linear"``: 1 and s. A callable gets s, of shape (n,), or (n,
        n_channels) for several, and returns (n,), such as a :class:`Sigmoid` with the values 0 and
        1, for the functions 1 and that one, or (n, n_functions). A transformer of scikit-learn,
        such as ``PolynomialFeatures`` or ``SplineTransformer``, is fitted on s of shape (n,
        n_channels).
    varying : {"all", "inputs"}, default="all"
        Which coefficients vary: all, or those of the inputs alone, while those of the output (the
        poles) and the constant do not.
    inputs : list of column names or positions, or None, default=None
        Linear inputs. None means the column named ``e`` if there is one, else all columns but those
        of ``scheduling``.
    {fit_intercept, roles, dt, run}

    Attributes
    ----------
    scheduled_coef_ : ndarray of shape (n_functions, n_params)
        θ_j, each ordered as in :class:`ARXRegressor`. A coefficient that does not vary is in the
        last row, whose function is 1, with ``varying="inputs"``.
    estimates_ : ndarray of shape (n_estimates,)
        What was estimated, in the order of the rows of ``parameters_``.
    estimates_covariance_ : ndarray of shape (n_estimates, n_estimates)
        Its covariance.
    coef_path_, covariance_path_ : ndarray of shape (n_instants, n_params), and (..., n_params)
        θ(t) and its covariance at all instants of the fitted runs; with ``scheduling="time"``
        alone, since otherwise each run has its own path (:meth:`coef_at`).
    time_path_ : ndarray of shape (n_instants,)
        Time in the run in seconds; with ``scheduling="time"``.
    coef_ : ndarray of shape (n_params,)
        θ for the mean of the functions over all rows with a scheduling: of the average model.
    a_, b_, intercept_ : ndarray, ndarray or list of them, float
        The parts of ``coef_``.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``.
    {standard_errors_}
    parameters_ : DataFrame
        Estimates: value, sd, low and high (95 % interval), unit, meaning. ``b0[1]`` belongs to the
        second function, ``b0`` does not vary.
    noise_variance_ : float
        Variance of the equation error, in the squared unit of ``y``.
    parameter_names_ : list of str
        Names of the entries of θ(t).
    n_rows_used_, n_rows_missing_ : int
        Rows in the regression, and left out because y, an input in their lags or the scheduling is
        NaN.
    scheduling_ : list of str
        Names of the scheduling channels, or ``["time"]``.
    {dt_, inputs_, jitter_, n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARX : Follows coefficients whose course is not known.
    ARXRegressor : Constant coefficients.

    Notes
    -----
    Ordinary least squares on the products μ_j φ_i (Bamieh and Giarré 2002), for all runs together.
    All regressors of row t get the functions of row t. Predictions use the scheduling of the X that
    they are given. Where a scheduling channel is NaN, rows are left out of the fit, and predictions
    hold the last value. It is filtered and thinned by a Decimator as all columns are.

    ``operator_parameters(model)`` converts the path for ``scheduling="time"``; for a channel, the
    average model. For some of its values: ``arx_to_operator(theta, model.dt_, covariance)`` with
    ``theta, covariance = model.coef_at(s, return_covariance=True)``.

    References
    ----------
    Bamieh and Giarré, Int. J. Robust Nonlinear Control 12 (2002) 841-853. Tóth, Modeling and
    Identification of Linear Parameter-Varying Systems (2010).

    Examples
    --------
    >>> from skhoid import LPVARX, Sigmoid, make_tracking_runs, operator_parameters
    >>> X, y = make_tracking_runs("C3", n_runs=2, random_state=0)
    >>> model = LPVARX(nk=29, basis=Sigmoid(0, 1, rate=0.5, time=40.96), varying="inputs")
    >>> operator_parameters(model.fit(X, y))[["K_e", "K_edot"]].iloc[[0, -1]].round(2)
            K_e  K_edot
    time
    0.00   0.09    0.04
    81.91  0.07    0.08
    """

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "scheduling": "no_validation",
        "basis": [
            StrOptions({"linear"}),
            callable,
            HasMethods(["fit", "transform"]),
        ],
        "varying": [StrOptions({"all", "inputs"})],
    }

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        scheduling: Any = TIME,
        basis: Any = "linear",
        varying: str = "all",
        inputs: Any = None,
        fit_intercept: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.scheduling = scheduling
        self.basis = basis
        self.varying = varying
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> LPVARX:
        """Estimate the coefficients of all functions.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : LPVARX

        Raises
        ------
        RankDeficiencyError
            If the coefficients cannot all be estimated; the message names the cause.
        {run_errors}
        ValueError
            If ``scheduling`` is not a channel or also an input, or ``basis`` does not return what
            it should.

        Warns
        -----
        MissingDataWarning
            With the number of rows that are NaN.
        """
        data = self._read_data(X, y)
        self.scheduling_ = self._channel_names(self._channels) if self._channels else [TIME]
        grid = data.grid
        self._set_orders(grid)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        signal = self._signal(grid, data.columns)
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        measured = np.repeat(grid.measured, grid.end - grid.begin)
        known = measured & ~np.isnan(signal).any(axis=1)
        self._schedule = Schedule.fitted(self.basis, signal[known], self.scheduling_)
        functions = self._schedule.functions(signal)
        self._spread_out(functions.shape[1])
        triangle = Triangle.of_blocks(
            (table for table, _ in self._blocks(data, functions)), self._entry.size + 1
        )
        n_rows = triangle.n_rows
        possible = int(np.maximum(end - begin - self.orders_.first_row, 0).sum())
        self.n_rows_used_, self.n_rows_missing_ = n_rows, possible - n_rows
        check_row_count(n_rows, self._entry.size, grid)
        names = [*self.inputs_, *(self.scheduling_ if self._channels else [])]
        told = np.column_stack([data.inputs, signal]) if self._channels else data.inputs
        self._report_missing(grid, told, data.output, n_rows, names)
        self._check_coefficients(triangle, data)
        self.estimates_ = triangle.solve()
        self.noise_variance_ = triangle.rss / max(n_rows - self._entry.size, 1)
        self.estimates_covariance_ = self.noise_variance_ * triangle.inverse_information()
        self._show(functions[known].mean(axis=0), grid)
        return self

    def _blocks(
        self, data: DataToFit, functions: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Products of regressors and functions, with the output in the last column, and rows."""
        for table, rows in self._regressors(data):
            factors = self._extended(functions[rows])
            known = ~np.isnan(factors).any(axis=1)
            products = np.empty((int(known.sum()), self._entry.size + 1), order="F")
            for column, (i, j) in enumerate(zip(self._entry, self._function, strict=True)):
                np.multiply(table[known, i], factors[known, j], out=products[:, column])
            products[:, -1] = table[known, -1]
            yield products, rows[known]

    def _regressors(self, data: DataToFit) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        grid = data.grid
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        for table, rows, _ in regressor_blocks(data.output, data.inputs, begin, end, self.orders_):
            yield table, rows

    def _linear_columns(self, n_columns: int) -> list[int]:
        """Those of the inputs that do not schedule."""
        read = self._reading
        names: list[Any] = list(read.names or range(n_columns))
        self._channels: list[int] = []
        if not (isinstance(self.scheduling, str) and self.scheduling == TIME):
            self._channels = input_columns(
                read.names, n_columns, self.scheduling, read.run, self.roles, "scheduling"
            )
        columns = input_columns(read.names, n_columns, self.inputs, read.run, self.roles)
        if self.inputs is None:
            columns = [i for i in columns if i not in self._channels]
        both = [names[i] for i in columns if i in self._channels]
        if both:
            raise ValueError(
                f"{both[0]!r} is in scheduling and in inputs; a channel that schedules the "
                "coefficients cannot be a linear input as well. Leave it out of one."
            )
        if not columns:
            raise ValueError(
                f"X has no column left for the inputs: the columns are {names}, and scheduling="
                f"{self.scheduling!r}. Add the error, or leave a channel out of scheduling."
            )
        return columns

    def _signal(self, grid: ModelGrid, columns: np.ndarray) -> np.ndarray:
        """Scheduling signal on the grid, of shape (n_rows, n_channels)."""
        if not self._channels:
            return (grid_numbers(grid) * grid.dt)[:, None]
        return find_columns(columns, self._channels).astype(np.float64)

    def _spread_out(self, n_functions: int) -> None:
        """Note to which entry of θ and to which function each estimate belongs."""
        orders = self.orders_
        self._with_constant = self.varying == "inputs"
        varies = np.ones(orders.n_params, dtype=bool)
        if self._with_constant:
            varies[: orders.na] = False
            varies[orders.n_params - orders.intercept :] = False
        pairs = [
            (i, j)
            for i in range(orders.n_params)
            for j in (range(n_functions) if varies[i] else [n_functions])
        ]
        self._entry, self._function = np.array(pairs, dtype=np.int64).T

    def _extended(self, functions: np.ndarray) -> np.ndarray:
        """Functions of rows, and 1 where some coefficients do not vary."""
        if not self._with_constant:
            return functions
        return np.column_stack([functions, np.ones(len(functions))])

    def _check_coefficients(self, triangle: Triangle, data: DataToFit) -> None:
        null_space = triangle.null_space()
        if len(null_space) == 0:
            return
        tables = (table for table, _ in self._regressors(data))
        alone = Triangle.of_blocks(tables, self.orders_.n_params + 1)
        self._check_rank(alone, data.inputs, data.output)
        weight = np.abs(null_space).max(axis=0)
        involved = [n for n, w in zip(self._estimate_names(), weight, strict=True) if w > 1e-3]
        raise RankDeficiencyError(
            f"The {self._entry.size} coefficients cannot all be estimated: the products of "
            f"regressors and functions have rank {self._entry.size - len(null_space)}, and "
            f"{', '.join(involved)} cannot be told apart. The functions are "
            f"{', '.join(self._schedule.described())}. Either the scheduling hardly changes, or a "
            "function repeats another (1 is added to a single function, and to a list of them). "
            "Use fewer functions, or data in which the scheduling changes."
        )

    def _estimate_names(self) -> list[str]:
        fixed = self._function.max() if self._with_constant else -1
        return [
            self.parameter_names_[i] + ("" if j == fixed else f"[{j}]")
            for i, j in zip(self._entry, self._function, strict=True)
        ]

    def _show(self, weights: np.ndarray, grid: ModelGrid) -> None:
        """Set the attributes of an estimate; ``weights`` are the mean functions."""
        n_functions = int(weights.size + self._with_constant)
        self.scheduled_coef_ = np.zeros((n_functions, self.orders_.n_params))
        self.scheduled_coef_[self._function, self._entry] = self.estimates_
        coef, covariance = self._at(weights[None])
        self.coef_, self.covariance_ = coef[0], covariance[0]
        self.standard_errors_ = np.sqrt(np.diag(self.covariance_))
        sd = np.sqrt(np.diag(self.estimates_covariance_))
        units, described = self._coefficient_units(), self._schedule.descriptions
        fixed = len(described) if self._with_constant else -1
        meaning = ["constant" if j == fixed else f"times {described[j]}" for j in self._function]
        self.parameters_ = arx_parameter_table(
            self._estimate_names(), self.estimates_, sd, [units[i] for i in self._entry], meaning
        )
        for name in PATH:
            self.__dict__.pop(name, None)
        if not self._channels:
            self.time_path_ = Instants.of(grid).time
            functions = self._schedule.functions(self.time_path_[:, None])
            self.coef_path_, self.covariance_path_ = self._at(functions)

    def _at(self, functions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """θ and its covariance where the functions have these values."""
        factors = self._extended(functions)
        theta = factors @ self.scheduled_coef_
        covariance = np.zeros((len(theta), theta.shape[1], theta.shape[1]))
        of_entry = [np.flatnonzero(self._entry == i) for i in range(theta.shape[1])]
        for i, one in enumerate(of_entry):
            for k, other in enumerate(of_entry[: i + 1]):
                block = self.estimates_covariance_[np.ix_(one, other)]
                left, right = factors[:, self._function[one]], factors[:, self._function[other]]
                covariance[:, i, k] = covariance[:, k, i] = np.einsum(
                    "tj,jl,tl->t", left, block, right, optimize=True
                )
        return theta, covariance

    def coef_at(self, scheduling: Any, *, return_covariance: bool = False) -> Any:
        """Coefficients θ for values of the scheduling signal.

        Parameters
        ----------
        scheduling : array-like of shape (n,), or (n, n_channels) for several channels
            Times in seconds, or values of the channels, in the unit and order of the fit.
        return_covariance : bool, default=False
            Return their covariance as well.

        Returns
        -------
        theta : ndarray of shape (n, n_params)
            Ordered as ``parameter_names_``; NaN where ``scheduling`` is.
        covariance : ndarray of shape (n, n_params, n_params)
            Only with ``return_covariance``.

        Raises
        ------
        ValueError
            If the shape is not that of the scheduling signal.

        Examples
        --------
        >>> from skhoid import LPVARX, Sigmoid, make_tracking_runs
        >>> X, y = make_tracking_runs("C4", n_runs=1, random_state=0)
        >>> model = LPVARX(nk=29, basis=Sigmoid(0, 1, rate=100.0, time=40.96)).fit(X, y)
        >>> model.coef_at([10.0, 70.0]).shape
        (2, 4)
        """
        self._check_fitted()
        signal = np.asarray(scheduling, dtype=np.float64)
        n_channels = len(self.scheduling_)
        if signal.ndim < 2 and n_channels == 1:
            signal = signal.reshape(-1, 1)
        if signal.ndim != 2 or signal.shape[1] != n_channels:
            wanted = "(n,)" if n_channels == 1 else f"(n, {n_channels})"
            raise ValueError(
                f"scheduling must have the shape {wanted}, values of {self.scheduling_}; got the "
                f"shape {np.shape(scheduling)}."
            )
        theta, covariance = self._at(self._schedule.functions(signal))
        return (theta, covariance) if return_covariance else theta

    # Predictions take θ from the scheduling of the rows they are made for.

    def _following(self, grid: ModelGrid, values: np.ndarray) -> LPVARX:
        """The model with θ of each row of the grid."""
        thin = grid.thin_inputs(values)
        if self._channels:
            held = self._hold(grid, thin, self._channels, self.scheduling_)
            signal = held[slice(0, len(thin))]
        else:
            signal = self._signal(grid, thin)
        following = copy(self)
        factors = self._extended(self._schedule.functions(signal))
        following._theta_of_rows = factors @ self.scheduled_coef_
        return following

    _theta_of_rows: np.ndarray | None = None

    def _parameters(self, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
        if self._theta_of_rows is None:
            raise AssertionError("predictions go through _following")
        return self._theta_of_rows, np.arange(len(self._theta_of_rows))

    def summary_table(self) -> ModelSummary:
        facts = {
            "Model": orders_text(self.orders_),
            **self._signal_facts(),
            "Method": f"least squares, {len(self._schedule.descriptions)} functions of "
            f"{', '.join(self.scheduling_)}",
            "Rows": f"{self.n_rows_used_}"
            + (f" ({self.n_rows_missing_} missing)" if self.n_rows_missing_ else ""),
            "Runs": f"{self._n_runs}",
            **self._grid_facts(),
            "Residual sd": self._residual_sd(),
        }
        notes = [
            f"[j] belongs to function j: {', '.join(self._schedule.described())}.",
            WHITE.format(""),
            CLOSED_LOOP.format(""),
            JUDGE.format(" is"),
        ]
        return ModelSummary(
            self._title(),
            facts,
            estimates_table(self.parameters_),
            notes,
        )
