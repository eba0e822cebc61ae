"""What recursions beside autoregressive noise share: first window, signals, predictions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral, Real
from typing import Any, Self

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.signal import lfilter

from .._sklearn import Interval, fit_context
from ..arx.base import BaseARX, free_run_output
from ..arx.forgetting import read_forgetting
from ..arx.model_summary import orders_text
from ..arx.orders import Orders, regressors
from ..arx.recursive import OF_RUNS, OneRecursion, check_streamable
from ..arx.rls import Instants, spread_weights, window_rows
from ..arx.streaming import Recursion, first_telling_row
from ..exceptions import ShortRunError
from ..preprocessing.grid import ModelGrid
from ..regression import find_columns, segments
from ..text import ModelSummary, estimates_table

SETTLE = 2.0  # s after a beginning in which simulations forget that they began at rest
LARGEST_POLE = 0.9995
REFLECTED = 0.97  # radius to which a pole outside goes
STEIGLITZ_MCBRIDE = 6  # iterations of the second start
MOST_STEPS = 60
NO_NUMBER = 1e6  # times the noise: the error where F is unstable


@dataclass(frozen=True)
class Start:
    """What a recursion begins with: estimates, and information about both."""

    theta: np.ndarray
    d: np.ndarray
    information: np.ndarray
    noise_triangle: np.ndarray
    noise_variance: float
    n_rows: int


class Window:
    """Stretches of signals and output without gaps, and the model's errors in them."""

    def __init__(
        self,
        parts: list[tuple[np.ndarray, np.ndarray]],
        orders: Orders,
        noise_order: int,
        dt: float,
    ) -> None:
        self.orders, self.nd = orders, noise_order
        self.skip = orders.first_row + noise_order + round(SETTLE / dt)
        n, long = len(orders.nb), self.skip + noise_order
        self.parts = [(X[:, :n], y) for X, y in parts if y.size > long]
        self.external = [X[:, n:] for X, y in parts if y.size > long]
        power = [float(np.mean(y**2)) for _, y in self.parts]
        self.scale = float(np.sqrt(np.mean(power))) if power else 1.0

    @property
    def n_rows(self) -> int:
        return sum(y.size - self.skip for _, y in self.parts)

    def simulated(self, theta: np.ndarray, X: np.ndarray) -> np.ndarray:
        f, b, _ = self.orders.split(theta)
        total = np.zeros(len(X))
        for row, nb, nk, column in zip(b, self.orders.nb, self.orders.nk, X.T, strict=True):
            total += lfilter(np.r_[np.zeros(nk), row[:nb]], np.r_[1.0, f], column)
        return total

    def errors(self, parameters: np.ndarray) -> np.ndarray:
        n = self.orders.n_params
        theta, D = parameters[:n], np.r_[1.0, parameters[n:]]
        if not stable(theta[: self.orders.na]):
            return np.full(self.n_rows, NO_NUMBER * self.scale)
        return np.concatenate(
            [lfilter(D, 1.0, y - self.simulated(theta, X))[self.skip :] for X, y in self.parts]
        )

    def slopes(self, parameters: np.ndarray) -> np.ndarray:
        """Derivatives of the errors: minus the regressors filtered by D / F, and lags of v."""
        n = self.orders.n_params
        theta, D = parameters[:n], np.r_[1.0, parameters[n:]]
        F = np.r_[1.0, theta[: self.orders.na]]
        rows = []
        for X, y in self.parts:
            w = self.simulated(theta, X)
            columns = [-lagged(lfilter(D, F, w), k + 1) for k in range(self.orders.na)]
            for nb, nk, column in zip(self.orders.nb, self.orders.nk, X.T, strict=True):
                filtered = lfilter(D, F, column)
                columns += [lagged(filtered, nk + k) for k in range(nb)]
            noise = [lagged(y - w, k + 1) for k in range(self.nd)]
            rows.append(np.stack([*(-c for c in columns), *noise], axis=1)[self.skip :])
        return np.concatenate(rows)

    def noise(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of D by least squares on v, and the triangle of its lags."""
        if self.nd == 0:
            return np.empty(0), np.empty((0, 0))
        table = []
        for X, y in self.parts:
            v = y - self.simulated(theta, X)
            lags = [-lagged(v, k + 1) for k in range(self.nd)]
            table.append(np.stack([*lags, v], axis=1)[self.skip :])
        stacked = np.concatenate(table)
        triangle = np.asarray(np.linalg.qr(stacked[:, :-1], mode="r"))
        return np.linalg.lstsq(stacked[:, :-1], stacked[:, -1], rcond=None)[0], triangle

    def estimate(self) -> Start:
        """The estimate with the smallest error from two starts."""
        n, best = self.orders.n_params, None
        for theta in self._starts():
            d, _ = self.noise(theta)
            begin = np.r_[theta, d]
            size = np.sqrt((self.slopes(begin) ** 2).mean(axis=0))
            scale = self.scale or 1.0
            unit = scale / np.where(size > 0, size, scale)  # so that tolerances have none
            found = least_squares(
                lambda q, unit=unit, scale=scale: self.errors(q * unit) / scale,
                begin / unit,
                jac=lambda q, unit=unit, scale=scale: self.slopes(q * unit) * (unit / scale),
                max_nfev=MOST_STEPS,
            )
            if best is None or found.cost < best[0]:
                best = found.cost, found.x * unit
        assert best is not None
        return self.at(best[1][:n])

    def at(self, theta: np.ndarray) -> Start:
        """What the window tells about these parameters, and the noise beside them."""
        d, triangle = self.noise(theta)
        parameters = np.r_[theta, d]
        psi = self.slopes(parameters)[:, : theta.size]
        errors = self.errors(parameters)
        return Start(theta, d, psi.T @ psi, triangle, float(np.mean(errors**2)), errors.size)

    def _starts(self) -> list[np.ndarray]:
        """Least squares, and the iteration of Steiglitz and McBride (1965), whitened."""
        first = self._least_squares(None, np.ones(1))
        theta = first
        for _ in range(STEIGLITZ_MCBRIDE):
            d, _ = self.noise(theta)
            theta = self._least_squares(theta, np.r_[1.0, d])
        return [first, theta]

    def _least_squares(self, theta: np.ndarray | None, D: np.ndarray) -> np.ndarray:
        """ARX parameters of signals filtered by D / F, with poles inside the unit circle."""
        F = np.ones(1) if theta is None else np.r_[1.0, theta[: self.orders.na]]
        y = np.concatenate([lfilter(D, F, y) for _, y in self.parts])
        X = np.concatenate([lfilter(D, F, X, axis=0) for X, _ in self.parts])
        edges = np.cumsum([0, *(y.size for _, y in self.parts)])
        begin, end = np.array(list(pairwise(edges))).T
        table = regressors(y, X, begin + self.skip - self.orders.first_row, end, self.orders)[0]
        size = np.sqrt((table[:, :-1] ** 2).sum(axis=0))
        size = np.where(size > 0, size, 1.0)
        found = np.linalg.lstsq(table[:, :-1] / size, table[:, -1], rcond=None)[0] / size
        return stabilised(found, self.orders.na)


def unit_factors(triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U by columns, above the diagonal, and D of (R'R)^-1 = U D U', for a triangle R."""
    n = len(triangle)
    if n == 0:
        return np.empty(0), np.empty(0)
    scale = np.abs(np.diag(triangle))
    least = 1e-12 * (scale.max() or 1.0)
    root = solve_triangular(triangle + np.diag(np.where(scale < least, least, 0.0)), np.eye(n))
    diagonal = np.diag(root)
    columns, rows = np.tril_indices(n, -1)
    return (root / diagonal)[rows, columns], diagonal**2


def whole_stretches(
    X: np.ndarray, y: np.ndarray, n_rows: int, fresh: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stretches without NaN in the first rows from one that is whole; ``fresh`` rows begin anew."""
    first = first_telling_row(X, y)
    if first is None:
        return []
    part = slice(first, first + n_rows)
    rows = np.flatnonzero(~np.isnan(y[part]) & ~np.isnan(X[part]).any(axis=1)) + first
    cuts = np.flatnonzero((np.diff(rows) > 1) | fresh[rows[1:]]) + 1
    return [(X[part], y[part]) for part in np.split(rows, cuts)]


def lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """The same so many rows later, zero before."""
    if lag == 0:
        return values
    return np.concatenate([np.zeros(min(lag, values.size)), values[:-lag]])


def stable(f: np.ndarray) -> bool:
    """Whether all roots of 1 + f_1 q^-1 + ... lie inside the unit circle."""
    return bool(np.abs(np.roots(np.r_[1.0, f])).max(initial=0.0) < LARGEST_POLE)


def stabilised(theta: np.ndarray, na: int) -> np.ndarray:
    """Parameters whose poles outside the unit circle are moved into it."""
    if stable(theta[:na]):
        return theta
    poles = np.roots(np.r_[1.0, theta[:na]])
    radius = np.abs(poles)
    poles = np.where(radius < LARGEST_POLE, poles, REFLECTED * poles / np.maximum(radius, 1e-300))
    return np.r_[np.real(np.poly(poles))[1:], theta[na:]]


FILTER_TIME = 10.24  # s: the longest time in which the filters follow F
START_WORTH = 1.0  # of the memory, that the start is worth
AT_ONCE = 4096  # rows whose forecasts are computed together
LITTLE_WORTH = 0.05  # of the window, that the start is worth if the memory is longer


@dataclass(frozen=True)
class Signals:
    """Inputs (n_signals, n_instants, n_runs), output, and where runs begin or go on after gaps."""

    inputs: np.ndarray
    target: np.ndarray
    fresh: np.ndarray
    instants: Instants

    @classmethod
    def of(cls, grid: ModelGrid, inputs: np.ndarray, output: np.ndarray) -> Signals:
        instants = Instants.of(grid)
        shape = (len(instants), instants.n_runs)
        values = np.full((inputs.shape[1], *shape), np.nan)
        target = np.full(shape, np.nan)
        fresh = np.zeros(shape, dtype=bool)
        at = (instants.of_row, instants.run)
        for position, column in enumerate(inputs.T):
            values[(position, *at)] = column
        measured = np.repeat(grid.measured, grid.end - grid.begin)
        target[at] = np.where(measured, output, np.nan)
        begin = np.union1d([first for first, _ in segments(grid)], grid.begin).astype(np.int64)
        fresh[instants.of_row[begin], instants.run[begin]] = True
        return cls(values, target, fresh, instants)


class WhitenedFilter(Recursion):
    """The state of a recursion, and what it does with rows; ``advance`` is its kernel."""

    advance: Any
    forgetting: np.ndarray
    shared: np.ndarray
    memory: np.ndarray
    before: tuple[Any, ...]  # arguments of the kernel between orders and forgetting

    def __init__(self, start: Start, orders: Orders, lam: np.ndarray, dt: float) -> None:
        """``lam`` are the factors of the parameters. Nothing of the noise is forgotten."""
        nd = start.d.size
        self.orders, self.lam, self.n = orders, lam, orders.n_params
        with np.errstate(divide="ignore"):
            memory = 1.0 / (1.0 - lam.min())
        # The recursion takes the window's rows once more, which only a finite memory forgets.
        self.worth = START_WORTH * memory / start.n_rows if memory < start.n_rows else LITTLE_WORTH
        follow = min(1.0 / min(memory, FILTER_TIME / dt), 1.0)
        self.shares = np.array([1.0, follow, min(dt / FILTER_TIME, 0.1)])
        self.kernel_orders = np.array([orders.na, nd, *orders.nb, *orders.nk])
        depth = max(nb + nk for nb, nk in zip(orders.nb, orders.nk, strict=True))
        self.waits = np.array([depth + nd + round(SETTLE / dt), depth + nd], dtype=float)
        self.theta, self.slow = start.theta.copy(), start.theta[: orders.na].copy()
        self.noise = np.concatenate([start.d, *unit_factors(start.noise_triangle)])
        self.counts = np.array([0.0, 0.0, 0.0, max(start.noise_variance, 1e-300), 0.0])
        self.prior_variance = start.noise_variance
        self.largest = np.sqrt(np.diag(start.information) / start.n_rows)
        self._none = (np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0, 0)), np.empty((0, 0)))

    def run(self, inputs: np.ndarray, target: np.ndarray, paths: Iterable[np.ndarray]) -> None:
        """Go on over instants, with all runs side by side."""
        self.advance(
            inputs, target, self.kernel_orders, *self.before, self.forgetting, self.waits,
            self.theta, self.slow, self.noise, self.shared, self.memory, self.counts, *paths,
        )  # fmt: skip

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        self.run(np.ascontiguousarray(X.T)[:, :, None], y[:, None], self._none)

    def rest(self) -> None:
        self.memory[:] = 0.0

    @property
    def information(self) -> np.ndarray:
        raise NotImplementedError

    @property
    def noise_variance(self) -> float:
        return self.counts[1] / self.counts[0] if self.counts[0] else self.prior_variance

    @property
    def n_updates(self) -> int:
        return int(self.counts[0])

    @property
    def n_held(self) -> int:
        return int(self.counts[2])

    @property
    def covariance(self) -> np.ndarray:
        return self.covariance_by(self.information, self.counts[4])

    def covariance_by(self, information: np.ndarray, n_updates: Any) -> np.ndarray:
        """Covariance of theta by the information about it, one or a path of them."""
        weight = spread_weights(self.lam, np.asarray(n_updates, float)[..., None])
        scale = np.sqrt(np.einsum("...ii->...i", information))
        scale = np.where(scale > 0, scale, 1.0)
        scaled = information / (scale[..., :, None] * scale[..., None, :])
        inverse = np.linalg.pinv(scaled, hermitian=True)
        share = weight / scale
        return self.noise_variance * inverse * share[..., :, None] * share[..., None, :]


class WhitenedRecursion(OneRecursion):
    """A recursion for B/F beside noise 1/D, over runs aligned by time, or a stream."""

    noise_order: int
    memory_time: Any
    store_covariance: bool
    method_name: str
    fit_intercept = False

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "noise_order": [Interval(Integral, 0, 50, closed="both")],
        "memory_time": "no_validation",
        "init_window": [Interval(Real, 0, None, closed="neither")],
        "store_covariance": ["boolean"],
    }

    def _filter(self, window: Window, lam: np.ndarray, n_runs: int) -> WhitenedFilter:
        """The recursion that begins with what the window tells."""
        raise NotImplementedError

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> Self:
        """Run the recursion over recorded runs, all at once, aligned by time in the run.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : estimator

        Raises
        ------
        ValueError
            If there is no instrument for a model that needs one, or the memory does not fit.
        RankDeficiencyError
            If the instruments do not excite the model.
        {run_errors}

        Warns
        -----
        MissingDataWarning
            With the number of rows that are NaN.
        """
        grid, _, output, columns, *_ = self._read_data(X, y)
        self._set_orders(grid)
        taken = find_columns(columns, self._signal_columns(columns.shape[1]))
        taken = np.asarray(taken, dtype=np.float64)
        signals = Signals.of(grid, taken, output)
        self._check_shared_times(signals.instants, grid)
        self._end_stream(*OF_RUNS)
        row_filter = self._started_filter(self._first_window(signals), signals.instants.n_runs)
        self.initial_coef_ = row_filter.theta.copy()
        self._initial_noise = row_filter.noise[: int(self.noise_order)].copy()
        n, n_runs = len(signals.instants), signals.instants.n_runs
        p, nd = row_filter.theta.size, int(self.noise_order)
        path, noise, errors = np.empty((n, p)), np.empty((n, nd)), np.empty((n, n_runs))
        information = np.empty((n, p, p) if self.store_covariance else (0, 0, 0))
        edges = np.unique([0, *np.flatnonzero(signals.fresh.any(axis=1)).tolist(), n])
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            row_filter.memory[signals.fresh[begin]] = 0.0
            row_filter.run(
                np.ascontiguousarray(signals.inputs[:, begin:end]),
                np.ascontiguousarray(signals.target[begin:end]),
                (path[begin:end], noise[begin:end], information[begin:end], errors[begin:end]),
            )
        instants = signals.instants
        self.coef_path_, self.noise_path_, self.time_path_ = path, noise, instants.time
        self._numbers = instants.number
        self.one_step_errors_ = errors[instants.of_row, instants.run]
        self.run_labels_ = list(grid.layout.labels)
        self._set_current(row_filter)
        if self.store_covariance:
            updates = np.cumsum(~np.isnan(errors).all(axis=1))
            self.covariance_path_ = row_filter.covariance_by(information, updates)
        missing = np.isnan(output) | np.isnan(taken).any(axis=1)
        self.n_rows_missing_ = int(missing.sum())
        names = self._channel_names(self._signal_columns(columns.shape[1]))
        self._report_missing(grid, taken, output, self.n_updates_, names)
        if n_runs == 1 and grid.rows is None:
            self._leave_for_streams(row_filter, grid.layout)
        return self

    def _first_window(self, signals: Signals) -> list[tuple[np.ndarray, np.ndarray]]:
        """Stretches without NaN in the first seconds of each run."""
        parts = []
        n_window = window_rows(self.init_window, self.dt_)
        for run in range(signals.instants.n_runs):
            X, y = signals.inputs[:, :, run].T, signals.target[:, run]
            parts += whole_stretches(X, y, n_window, signals.fresh[:, run])
        return parts

    def _started_filter(
        self, parts: list[tuple[np.ndarray, np.ndarray]], n_runs: int
    ) -> WhitenedFilter:
        check_streamable(self.orders_)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        n, nd = self.orders_.n_params, int(self.noise_order)
        window = Window(parts, self.orders_, nd, self.dt_)
        if window.n_rows < 2 * (n + nd):
            raise ShortRunError(
                f"The first {self.init_window:g} s hold {window.n_rows} usable rows in stretches "
                f"longer than {window.skip} rows, for {n} parameters and a noise model of order "
                f"{nd}. Use longer runs, a longer init_window, or a smaller noise_order."
            )
        return self._filter(window, self._factors(), n_runs)

    def _factors(self) -> np.ndarray:
        """λ of each parameter."""
        n = self.orders_.n_params
        found = read_forgetting(
            None, None, self.memory_time, form="joint", n_params=n, time=np.zeros(1), dt=self.dt_
        )
        self.forgetting_ = found.value
        with np.errstate(divide="ignore"):
            horizon = 1.0 / (1.0 - np.asarray(self.forgetting_))
        self.memory_horizon_ = float(horizon) if horizon.ndim == 0 else horizon
        return np.broadcast_to(found.factors[0], n).copy()

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> WhitenedFilter:
        self.orders_ = Orders.of(self.na, self.nb, self.nk, len(self._columns))
        n_window = window_rows(self.init_window, self.dt_)
        row_filter = self._started_filter(whole_stretches(X, y, n_window, fresh), 1)
        self.initial_coef_ = row_filter.theta.copy()
        return row_filter

    @property
    def noise_ar_(self) -> np.ndarray:
        self._check_fitted()
        return self._current.noise[: int(self._current.kernel_orders[1])].copy()

    def _ahead(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        """The simulation, plus what the noise model foresees of its error."""
        horizon = min(horizon, grid.n_rows)
        stretches = (grid.begin, grid.end, grid.past)
        parameters = self._parameters_before(grid, horizon)
        inputs = self._held_inputs(grid, values)
        simulated = free_run_output(inputs, stretches, self.orders_, *parameters)
        noise = self._noise_before(grid, horizon)
        ahead = simulated.copy()
        for begin, end in segments(grid):
            v = output[begin:end] - simulated[begin:end]
            ahead[begin:end] += foreseen(v, noise[begin:end], horizon)
        return ahead

    def _noise_before(self, grid: ModelGrid, horizon: int) -> np.ndarray:
        """D of each row as known so many rows before, of shape (n_rows, noise_order)."""
        if not self._follows_path:
            return np.broadcast_to(self.noise_ar_, (grid.n_rows, self.noise_ar_.size))
        path = np.concatenate([self._initial_noise[None], self.noise_path_])
        return path[self._places_before(grid, horizon)]

    def _errors_on(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        errors = output - self._ahead(grid, values, output, 1)
        for begin, _ in segments(grid):
            errors[begin : begin + self.orders_.first_row] = np.nan
        return errors

    def summary_table(self) -> ModelSummary:
        current, seconds = self._current, np.asarray(self.memory_horizon_) * self.dt_
        facts = {
            "Model": orders_text(self.orders_).replace("ARX", "Box-Jenkins"),
            **self._signal_facts(),
            "Method": self.method_name,
            "Memory": f"T0 = {', '.join(f'{t:.4g}' for t in np.atleast_1d(seconds))} s",
            "Rows": f"{self.n_updates_} updates",
            **self._grid_facts(),
            "Noise model": f"AR({int(current.kernel_orders[1])})",
        }
        notes = [
            "Standard errors do not include the lag behind changing parameters.",
            "Coefficients a are those of F, which the noise does not share.",
        ]
        return ModelSummary(
            self._title(),
            facts,
            estimates_table(self.parameters_, "Parameters at the end"),
            notes,
        )


def foreseen(v: np.ndarray, d: np.ndarray, horizon: int) -> np.ndarray:
    """Forecast of autoregressive noise, so many rows ahead of each row, by the D of each forecast.

    ``d`` has the shape (n_rows, noise_order). Noise that is not known is its own forecast.
    """
    nd = d.shape[1]
    if nd == 0:
        return np.zeros(v.size)
    known = np.r_[np.zeros(horizon + nd - 1), v]
    for t in np.flatnonzero(np.isnan(known)).tolist():
        row = t - (horizon + nd - 1)
        known[t] = -float(d[row] @ known[t - nd : t][::-1]) if row > 0 else 0.0
    before = np.lib.stride_tricks.sliding_window_view(known, nd)[: v.size, ::-1]
    ahead = np.empty(v.size)
    for begin in range(0, v.size, AT_ONCE):
        rows = slice(begin, begin + AT_ONCE)
        companion = np.zeros((d[rows].shape[0], nd, nd))
        companion[:, 0] = -d[rows]
        companion[:, np.arange(1, nd), np.arange(nd - 1)] = 1.0
        weights = np.linalg.matrix_power(companion, horizon)[:, 0]
        ahead[rows] = np.einsum("tk,tk->t", weights, before[rows])
    return ahead
