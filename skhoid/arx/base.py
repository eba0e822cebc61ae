"""Base class of ARX estimators: simulation, how it begins, prediction, score, transfer function."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import linalg, signal

from .. import _kernels
from .._sklearn import DT, CoefficientsOfLags, Interval
from ..exceptions import MissingDataWarning, ShortRunError
from ..metrics import vaf_of_rows
from ..parameters import NORMAL_95
from ..preprocessing.grid import BLOCK, HeldInputs, ModelGrid
from ..regression import DataToFit, RunRegressor, check_segments, segments
from ..runs import BY_RUNS
from ..text import quantity
from .least_squares import Triangle, rank_error
from .orders import Orders, regressors

FARTHEST = 2**62  # rows; more cannot be counted
ON_THE_AXIS = 1e-9  # imaginary part of a pole there, by rounding
BOUND = 1e100  # of simulated outputs; its square still sums without overflow


class BaseARX(RunRegressor):
    """An ARX model with parameters ``coef_`` on the grid that the marks of X leave."""

    na: Any
    nb: Any
    nk: Any
    inputs: Any
    fit_intercept: bool
    roles: dict | None
    dt: float | None
    run: Any
    n_rows_missing_: int
    noise_variance_: Any
    parameter_names_: list[str]

    coef_: Any = CoefficientsOfLags()

    _parameter_constraints: dict = {
        "na": [Interval(Integral, 0, None, closed="left")],
        "nb": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "nk": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "inputs": "no_validation",
        "fit_intercept": ["boolean"],
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    def _set_orders(self, grid: ModelGrid) -> None:
        self.orders_ = Orders.of(
            self.na, self.nb, self.nk, len(self._columns), bool(self.fit_intercept)
        )
        check_lengths(grid, self.orders_)

    def _report_missing(
        self,
        grid: ModelGrid,
        inputs: np.ndarray,
        output: np.ndarray,
        n_used: int,
        names: list[str],
    ) -> None:
        """Warn of rows left out in runs that are not, but of those before a DelayShift's past."""
        if self.n_rows_missing_ == 0:
            return
        unknown = np.isnan(output)
        run = grid.layout.run_of(np.arange(output.size) if grid.rows is None else grid.rows)
        some = np.bincount(run, ~unknown) > 0  # of the others, which are left out, a warning told
        missing = (unknown | np.isnan(inputs).any(axis=1)) & some[run]
        for begin, end in segments(grid):
            known = np.flatnonzero(~np.isnan(inputs[begin:end]).any(axis=1))
            if known.size:
                missing[begin : begin + known[0]] = False
        n_missing = int(missing.sum())
        if n_missing:
            channels = [self.output_name, *names]
            columns = np.column_stack([output, inputs])[missing]
            named = [
                c for c, gap in zip(channels, np.isnan(columns).any(axis=0), strict=True) if gap
            ]
            warnings.warn(
                f"{n_missing} rows of {', '.join(map(repr, named))} are NaN, the first at "
                f"{grid.layout.where(grid.full_row(int(np.flatnonzero(missing)[0])))}; "
                f"{self.n_rows_missing_} rows whose lags need them are left out, {n_used} are "
                "used.",
                MissingDataWarning,
                stacklevel=5,
            )

    @property
    def a_(self) -> np.ndarray:
        self._check_fitted()
        return self.orders_.split(self.coef_)[0]

    @property
    def b_(self) -> Any:
        self._check_fitted()
        return self.orders_.input_rows(self.coef_)

    @property
    def intercept_(self) -> float:
        self._check_fitted()
        return self.orders_.split(self.coef_)[2]

    def _check_rank(self, triangle: Triangle, inputs: np.ndarray, output: np.ndarray) -> None:
        """Refuse regressors that are dependent, and name the cause."""
        null_space = triangle.null_space()
        if len(null_space):
            finite = ~np.isnan(inputs).any(axis=1) & ~np.isnan(output)
            raise rank_error(
                null_space,
                self.parameter_names_,
                self.inputs_,
                inputs[finite].astype(np.float64),
                output[finite].astype(np.float64),
                self.output_name,
                self.orders_,
            )

    def _title(self) -> str:
        """First line of a summary."""
        return f"{type(self).__name__}: {self.output_name} from {', '.join(self.inputs_)}"

    def _residual_sd(self) -> str:
        sd = float(np.sqrt(self.noise_variance_))
        return quantity(sd, self._units.get(self.output_name))

    def _coefficient_units(self) -> list[str]:
        """Units of the entries of theta."""
        output = self._units.get(self.output_name) or f"[{self.output_name}]"
        units = ["-"] * self.orders_.na
        for channel, nb in zip(self.inputs_, self.orders_.nb, strict=True):
            units += [f"{output}/{self._units.get(channel) or f'[{channel}]'}"] * nb
        return units + [output] * self.orders_.intercept

    def to_transfer_function(self, backend: str = "scipy", *, continuous: bool = False) -> Any:
        """Return the transfer function from the inputs to the output, in discrete time or not.

        G(z) = z^-nk (b_0 + b_1 z^-1 + ...) / (1 + a_1 z^-1 + ...), with the sampling time ``dt_``.
        It includes neither the intercept nor a :class:`DelayShift` before the model.

        Parameters
        ----------
        backend : {"scipy", "control"}, default="scipy"
            Library of the result; python-control is an extra: ``pip install "skhoid[control]"``.
        continuous : bool, default=False
            Invert the zero-order hold (the inputs are constant between samples): the system in
            continuous time of which G(z) holds the samples, and its delay apart, in s, (nk - 1)
            ``dt_``. Needs poles off the negative real axis, and ``nb`` of at most ``na`` (for nk =
            0, where the input acts at once, one more).

        Returns
        -------
        G : scipy.signal.dlti, dict of them by input, or control.TransferFunction
            With several inputs, a dict ``{input: dlti}`` for SciPy, which has no multi-input
            systems with delays, and one system for python-control. If ``continuous``, a tuple of a
            system (``scipy.signal.lti`` or ``control.TransferFunction``) and its delay, or a dict
            of them by input.
        """
        self._check_fitted()
        if backend not in ("scipy", "control"):
            raise ValueError(f"backend must be 'scipy' or 'control'; got {backend!r}.")
        if continuous:
            found = continuous_systems(self.orders_, self.coef_, self.dt_, backend)
            return found[0] if len(found) == 1 else dict(zip(self.inputs_, found, strict=True))
        return transfer_function(
            self.orders_, self.coef_, self.dt_, self.inputs_, self.output_name, backend
        )

    @property
    def one_coefficient_per_column(self) -> bool:
        """Whether ``coef_`` has one entry for each column of X."""
        plain = self.orders_.na == 0 and not self.orders_.intercept and set(self.orders_.nb) == {1}
        return plain and self._columns == list(range(self.n_features_in_))

    def read_candidates(self, X: Any, y: Any) -> tuple[DataToFit, Callable[[], HeldInputs]]:
        """Read data for a search, which fits many sets of orders to them.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        data : DataToFit
            What a fit would read.
        hold : callable
            Gives the inputs to simulate from, in which NaN hold the last value.
        """
        data = self._read_data(X, y, in_parts=True)
        return data, partial(self._hold, data.grid, data.inputs)

    def _held_inputs(self, grid: ModelGrid, values: np.ndarray) -> HeldInputs:
        return self._hold(grid, grid.thin_inputs(values), self._columns)

    def _following(self, grid: ModelGrid, values: np.ndarray) -> Any:
        """The model with the parameters, and maybe the orders, of each row of the grid."""
        return self

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        model = self._following(grid, values)
        return model._simulate(grid, self._held_inputs(grid, values))

    def _simulate(
        self,
        grid: ModelGrid,
        inputs: HeldInputs,
        y0: np.ndarray | None = None,
        held: bool = False,
        most: int | None = None,
    ) -> np.ndarray:
        """Free run on the grid, or of the first ``most`` rows of its stretches."""
        end = grid.end if most is None else np.minimum(grid.end, grid.begin + most)
        stretches = (grid.begin, end, grid.past)
        return free_run_output(inputs, stretches, self.orders_, *self._parameters(grid), y0, held)

    def _from_fitted_states(
        self, grid: ModelGrid, inputs: HeldInputs, output: np.ndarray, held: bool
    ) -> np.ndarray:
        """Free run on the grid whose outputs before each stretch fit its first seconds best."""
        free = self._simulate(grid, inputs, held=held)
        na = self.orders_.na
        if na == 0:
            return free
        theta, at = self._parameters(grid)
        if self.orders_.intercept:  # beside a large one the response to 1 would be rounded away
            theta = np.column_stack([theta[:, :-1], np.zeros(len(theta))])
        first = np.zeros(1, dtype=np.int64)
        for begin, end in zip(grid.begin, grid.end, strict=True):
            rest = np.broadcast_to(0.0, (end - begin, inputs.shape[1]))
            stretch = (first, first + end - begin, first)
            responses = np.column_stack(
                [
                    free_run_output(rest, stretch, self.orders_, theta, at[begin:end], one[None])
                    for one in np.eye(na)
                ]
            )
            known = first_measured(~np.isnan(output[begin:end]), grid.dt)
            wrong = output[begin:end][known] - free[begin:end][known]
            fitted = np.linalg.lstsq(responses[known], wrong, rcond=None)[0]
            free[begin:end] += responses @ fitted
        return free

    def _parameters(self, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
        """Sets of parameters, and which of them each row of the grid has."""
        return self.coef_[None], np.broadcast_to(np.int64(0), grid.n_rows)

    def _parameters_before(self, grid: ModelGrid, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        """The same, as they were known ``horizon`` rows before."""
        return self._parameters(grid)

    def _rows_to_forget(self, dt: float) -> int:
        """Rows after which a free run no longer shows how it began; of an integrator, so many."""
        most = max(round(START / dt), START_ROWS)
        radius = float(np.abs(np.roots(np.r_[1.0, self.a_])).max(initial=0.0))
        rows = np.log(FORGOTTEN) / np.log(radius) if 0 < radius < 1 else most * (radius > 0)
        return self.orders_.first_row + min(int(rows), most)

    def growth_over(self, X: Any) -> float:
        """Natural logarithm of how much the slowest mode grows over the longest run.

        ``UNSTABLE`` or more is no integrator's: free runs say nothing of the recording. Where
        parameters follow changes, their poles from row to row count.

        Parameters
        ----------
        {X}

        Returns
        -------
        growth : float
            Negative for a stable model.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        model = self._following(grid, values)
        theta, at = model._parameters(grid)
        na = model.orders_.na
        companion = np.zeros((len(theta), na, na)) + np.eye(na, k=-1)
        companion[:, :1] -= theta[:, None, :na]
        radius = np.abs(np.linalg.eigvals(companion)).max(axis=1, initial=np.finfo(float).tiny)
        steps = np.concatenate([[0.0], np.cumsum(np.log(radius)[at])])
        grown = [steps[end] - steps[begin] for begin, end in segments(grid)]
        return float(max(grown, default=0.0))

    def simulate(self, X: Any, y: Any = None) -> np.ndarray:
        """Simulate the output from rest or, with a measured output, from estimated initial states.

        Parameters
        ----------
        {X}
        y : Series or array of shape (n_rows,), default=None
            Measured output. With it the ``na`` outputs before each run (and gap, and end of the
            run-in) are those that fit its first seconds best, as in ``score``.

        Returns
        -------
        y_sim : ndarray of shape (n_rows,)
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        output = None if y is None else grid.thin_output(self._read_y(X, y))
        return grid.to_full_rate(self._simulated(grid, values, output))

    def _simulated(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        """Free run on the grid from rest, or from initial states that fit an output."""
        inputs, model = self._held_inputs(grid, values), self._following(grid, values)
        if output is None:
            return model._simulate(grid, inputs)
        return model._from_fitted_states(grid, inputs, output, held=False)

    def predict_ahead(self, X: Any, y: Any, horizon: int = 1) -> np.ndarray:
        """Predict each row from the output measured ``horizon`` samples before it.

        One-step predictions look good even for wrong models: validate with :meth:`predict`.

        Parameters
        ----------
        {X, y}
        horizon : int, default=1
            Steps ahead, in samples of the fitted grid (``dt_``).

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
            Outputs and inputs before a run or a gap are taken as zero; a missing output is
            replaced by its own one-step prediction. A horizon longer than a run makes it a free
            run from rest.
        """
        self._check_fitted()
        if isinstance(horizon, bool) or not isinstance(horizon, (int, np.integer)) or horizon < 1:
            raise ValueError(f"horizon must be a number of samples, at least 1; got {horizon!r}.")
        grid, values = self._read_X(X, reset=False)
        output = grid.thin_output(self._read_y(X, y))
        return grid.to_full_rate(self._ahead(grid, values, output, int(horizon)))

    def _ahead(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        """Predictions on the grid, from all columns of X at full rate."""
        begin, end = np.array(segments(grid)).T
        model = self._following(grid, values)
        theta, at = model._parameters_before(grid, min(horizon, FARTHEST))
        inputs, orders = self._held_inputs(grid, values), model.orders_
        longest = int((end - begin).max())
        if horizon >= longest and len(theta) == 1:  # no output is known so long before
            return free_run_output(inputs, (begin, end, begin), orders, theta, at)
        horizon = min(horizon, longest)
        known, ahead = np.array(output, dtype=np.float64), np.zeros(output.size)
        for part in _parts(begin, end, begin, orders.first_row + horizon):
            _kernels.arx.predict_ahead(
                known,
                _kernels.gate(inputs[part.low : part.high]),
                part.low,
                *(_kernels.gate(e, np.int64) for e in (part.begin, part.end)),
                _kernels.gate(begin[part.stretches], np.int64),
                *_as_kernels_take(orders, theta, at[part.low : part.high]),
                horizon,
                BOUND,
                ahead,
            )
        return ahead

    def one_step_errors(self, X: Any, y: Any) -> np.ndarray:
        """Errors of predictions one step ahead, on the grid that the model is fitted on.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        errors : ndarray of shape (n_grid_rows,)
            NaN where lags are not known or nothing was measured.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        return self._errors_on(grid, values, grid.thin_output(self._read_y(X, y)))

    def _errors_on(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        """The same for data that were read."""
        model = self._following(grid, values)
        raw = grid.thin_inputs(values)[:, self._columns]
        table, rows, _ = regressors(
            output, raw, grid.begin[grid.measured], grid.end[grid.measured], model.orders_
        )
        errors = np.full(output.size, np.nan)
        path, at = model._parameters_before(grid, 1)
        fitted = np.einsum("tp,tp->t", table[:, :-1], path[at[rows]])
        errors[rows] = table[:, -1] - fitted
        return errors

    def score_at_model_rate(
        self, X: Any, y: Any, keep: np.ndarray, average: str, centered: bool
    ) -> float:
        """Score the free run by its VAF on the filtered and thinned signals.

        :class:`VAFScorer` with ``rate="model"`` asks for it.

        Parameters
        ----------
        {X, y}
        keep : ndarray of bool of shape (n_rows,)
            Rows that count.
        average : str
            How runs are averaged, as in :class:`VAFScorer`.
        centered : bool
            Whether means are removed, as in :class:`VAFScorer`.

        Returns
        -------
        vaf : float
            In percent, unclipped, at least -1000.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        output = self._read_y(X, y)
        free = self._run_from(grid, values, grid.thin_output(output))
        full = np.zeros(output.size)
        rows = np.arange(output.size) if grid.rows is None else grid.rows
        thinned = np.full(output.size, np.nan)
        full[rows], thinned[rows] = free, grid.thin_output(output)
        return vaf_of_rows(thinned, full, keep, grid.layout, average, centered)


def free_run_output(
    inputs: HeldInputs | np.ndarray,
    stretches: tuple[np.ndarray, np.ndarray, np.ndarray],
    orders: Orders,
    theta: np.ndarray,
    at: np.ndarray,
    y0: np.ndarray | None = None,
    held: bool = False,
) -> np.ndarray:
    """Simulate stretches (begin, end, past), each from ``na`` initial outputs, zero by default.

    Row t has the parameters ``theta[at[t]]``. Inputs before a stretch are zero, or ``held`` as in
    its first row.
    """
    na = orders.na
    if y0 is None:
        y0 = np.zeros((stretches[0].size, max(na, 1)))
    out = np.zeros(inputs.shape[0])
    for part in _parts(*stretches, orders.first_row):
        initial = y0[part.stretches].astype(np.float64)
        begun = part.begin[0] - stretches[0][part.stretches][0]
        if begun:  # the first one goes on from the part before
            before = out[part.begin[0] - min(begun, na) : part.begin[0]][::-1]
            initial[0] = np.r_[before, initial[0]][: initial.shape[1]]
        out[part.rows] = _kernels.arx.free_run(
            _kernels.gate(inputs[part.low : part.high]),
            *(_kernels.gate(e - part.low, np.int64) for e in (part.begin, part.end, part.past)),
            *_as_kernels_take(orders, theta, at[part.low : part.high]),
            _kernels.gate(initial),
            BOUND,
            held,
        )[part.rows.start - part.low :]
    return out


class _Part(NamedTuple):
    """Stretches, or pieces of them, in some rows; inputs and parameters from ``low`` on count."""

    rows: slice
    low: int
    stretches: slice
    begin: np.ndarray
    end: np.ndarray
    past: np.ndarray

    @property
    def high(self) -> int:
        return int(self.rows.stop)


def _parts(begin: np.ndarray, end: np.ndarray, past: np.ndarray, reach: int) -> Iterator[_Part]:
    """Cut stretches into blocks of rows, which look back so many rows."""
    for first in range(0, int(end.max(initial=0)), BLOCK):
        stop = min(first + BLOCK, int(end[-1]))
        some = slice(
            int(np.searchsorted(end, first, side="right")), int(np.searchsorted(begin, stop))
        )
        if some.start == some.stop:
            continue
        begins, ends = np.maximum(begin[some], first), np.minimum(end[some], stop)
        pasts = np.maximum(past[some], begins - reach)
        low = min(first, int(pasts[0]))
        yield _Part(slice(first, stop), low, some, begins, ends, pasts)


def _as_kernels_take(orders: Orders, theta: np.ndarray, at: np.ndarray) -> tuple[Any, ...]:
    theta, at = _kernels.gate(theta), _kernels.gate(at, np.int64)
    return theta, at, orders.na, np.array(orders.nb), np.array(orders.nk)


def longest_stretches(grid: ModelGrid) -> np.ndarray:
    """Rows of the longest measured stretch of each run."""
    lengths = np.where(grid.measured, grid.end - grid.begin, 0)
    longest = np.zeros(len(grid.layout.labels), dtype=np.int64)
    first = grid.begin if grid.rows is None else grid.rows[grid.begin]
    np.maximum.at(longest, grid.layout.run_of(first), lengths)
    return longest


def check_lengths(grid: ModelGrid, orders: Orders) -> None:
    """Refuse runs in which no row has known lags."""
    check_segments(grid, orders.first_row + 1)
    longest = longest_stretches(grid)
    needed = orders.first_row + 1
    short = np.flatnonzero(longest < needed)
    if short.size == 0:
        return
    many = f" (and {short.size - 1} more)" if short.size > 1 else ""
    raise ShortRunError(
        f"Run {grid.layout.labels[short[0]]!r}{many} has at most {longest[short[0]]} successive "
        f"rows at {grid.dt:g} s, but lags that reach {needed - 1} samples back need {needed} (X "
        f"has n_samples = {grid.layout.n_rows}). Use smaller na, nb and nk, or a smaller "
        "decimation factor, or leave the run out.",
        hint=f"skhoid.select_runs leaves runs out. If a split cut it short: {BY_RUNS}",
        options=["files"],
    )


def check_row_count(n_rows: int, n_params: int, grid: ModelGrid) -> None:
    """Refuse to fit more parameters than rows are left."""
    if n_rows >= n_params:
        return
    raise ShortRunError(
        f"{n_rows} rows are left for {n_params} parameters (n_samples = {grid.layout.n_rows} rows "
        "in X; lags, missing values and the run-in use up the rest). Use more data or fewer lags."
    )


def arx_parameter_table(
    names: list[str],
    theta: np.ndarray,
    sd: np.ndarray,
    units: list[str],
    meaning: list[str] | None = None,
) -> pd.DataFrame:
    """Values, standard errors, 95 % intervals and units of coefficients."""
    if meaning is None:
        of = {"a": "of the output", "b": "of the input", "i": "constant"}
        of |= {"c": "of the noise", "d": "of the noise, in the denominator"}
        meaning = [of[name[0]] for name in names]
    columns = {
        "value": theta,
        "sd": sd,
        "low": theta - NORMAL_95 * sd,
        "high": theta + NORMAL_95 * sd,
        "unit": units,
        "meaning": meaning,
    }
    return pd.DataFrame(columns, index=pd.Index(names, name="parameter"))


REST, HELD, ESTIMATE = "rest", "held", "estimate"
START, START_ROWS = 10.0, 200  # at most so many s (rows on a slow clock) tell how a run begins
FORGOTTEN = 0.01  # of what a run began with
START_SHARE = 4  # of the measured rows, one in so many at most: the others are predicted
# Less growth is an integrator's, as far as n rows can tell: the 99 % quantile of n (rho - 1) of an
# estimated unit root (Fuller 1976).
UNSTABLE = 2.03
SHARE_OF_ERROR, SHARE_OF_POWER = 0.1, 0.01  # by which a start must lower the squares to be taken


def first_measured(known: np.ndarray, dt: float) -> np.ndarray:
    """The first measured rows of each run, in its column, from which its start is estimated.

    All rows would flatter a model whose free run goes astray: a mode that grows, or an offset of an
    integral, would be removed with hindsight.
    """
    count = np.cumsum(known, axis=0)
    most = np.minimum(count[-1] // START_SHARE, max(round(START / dt), START_ROWS))
    return np.asarray(known & (count <= most))


def pays(rest: float, other: float, y: np.ndarray) -> bool:
    """Whether another start reduces the squares enough to show that runs do not begin at rest.

    ``y`` is all that was measured; its power about the mean says how much that is.
    """
    if not y.size:
        return False
    moves = y - y.mean()
    power = float(np.square(moves, out=moves).sum())
    return bool(rest - other > max(SHARE_OF_ERROR * rest, SHARE_OF_POWER * power))


def held_level(a: np.ndarray, drive: np.ndarray, levels: tuple[float, float]) -> np.ndarray:
    """Output at rest under a constant drive, within limits; 0, or next to it, where there is none.

    A slow or integrating model amplifies its errors, so a level that the output never had is not
    believed.
    """
    rest = np.clip(np.zeros_like(drive), *levels)
    if levels[0] == levels[1]:
        return rest
    stable = (np.abs(np.roots(a)) < 1.0 - 1e-6).all()  # and none of the poles integrates
    return np.clip(drive / a.sum(), *levels) if stable else rest


def measured_rows(grid: ModelGrid, most: int | None = None) -> np.ndarray:
    """Rows outside run-ins, or the first ``most`` of each stretch."""
    rows = np.zeros(grid.n_rows, dtype=bool)
    for begin, end in zip(grid.begin[grid.measured], grid.end[grid.measured], strict=True):
        rows[begin : end if most is None else min(end, begin + most)] = True
    return rows


def transfer_function(
    orders: Orders, theta: np.ndarray, dt: float, inputs: list[str], output: str, backend: str
) -> Any:
    """Discrete-time transfer functions in positive powers of z."""
    a, b, _ = orders.split(theta)
    polynomials = []
    for row, nb, nk in zip(b, orders.nb, orders.nk, strict=True):
        degree = max(orders.na, nk + nb - 1)
        denominator = np.zeros(degree + 1)
        denominator[: orders.na + 1] = [1.0, *a]
        numerator = np.zeros(degree + 1)
        numerator[nk : nk + nb] = row[:nb]
        # Leading zeros are not coefficients; SciPy warns about them.
        numerator = np.trim_zeros(numerator, "f")
        polynomials.append((numerator if numerator.size else np.zeros(1), denominator))
    if backend == "control":
        control = _import_control()
        numerators, denominators = zip(*polynomials, strict=True)
        return control.TransferFunction(
            [[n.tolist() for n in numerators]],
            [[d.tolist() for d in denominators]],
            dt,
            inputs=list(inputs),
            outputs=[output],
        )
    systems = [signal.dlti(n, d, dt=dt) for n, d in polynomials]
    return systems[0] if len(systems) == 1 else dict(zip(inputs, systems, strict=True))


def _import_control() -> Any:
    try:
        import control
    except ImportError as error:
        raise ImportError(
            'backend="control" needs python-control: pip install "skhoid[control]".'
        ) from error
    return control


def continuous_systems(
    orders: Orders, theta: np.ndarray, dt: float, backend: str
) -> list[tuple[Any, float]]:
    """Systems whose samples under zero-order hold are the model, each with its delay in s.

    With states x, [x, u] a sample later is expm([[A, B], [0, 0]] dt) [x, u].
    """
    a, b, _ = orders.split(theta)
    poles = np.roots(np.r_[1.0, a])
    bad = poles[(poles.real <= 0.0) & (np.abs(poles.imag) <= ON_THE_AXIS)]
    if bad.size:
        raise ValueError(
            f"The pole at z = {bad[0].real:.4g} has no counterpart in continuous time under "
            "zero-order hold: only poles off the negative real axis have one. Use a smaller na, or "
            "decimate less."
        )
    found = []
    for row, nb, nk in zip(b, orders.nb, orders.nk, strict=True):
        at_once = nk == 0
        if nb > orders.na + at_once:
            raise ValueError(
                f"nb = {nb} input coefficients with na = {orders.na} poles have no counterpart in "
                f"continuous time: use nb of at most {orders.na + at_once}, or a larger na."
            )
        numerator = np.zeros(orders.na + 1)
        numerator[1 - at_once : 1 - at_once + nb] = row[:nb]
        through = numerator[0]
        output = numerator[1:] - through * a
        n = orders.na
        step = np.zeros((n + 1, n + 1))
        step[:n, :n] = np.eye(n, k=-1)
        step[:1, :n] = -a
        step[0, n] = step[n, n] = 1.0
        if n == 0:
            step[0, 0] = 1.0
        rates = np.real(linalg.logm(step)) / dt
        num, den = signal.ss2tf(rates[:n, :n], rates[:n, n:], output[None], [[through]])
        size = np.abs(num[0]) * dt ** -np.arange(n, -1.0, -1.0)  # at the sampling frequency
        num = np.trim_zeros(np.where(size > ON_THE_AXIS * size.max(), num[0], 0.0), "f")
        num = num if num.size else np.zeros(1)
        system = (
            _import_control().TransferFunction(num.tolist(), den.tolist())
            if backend == "control"
            else signal.lti(num, den)
        )
        found.append((system, max(nk - 1, 0) * dt))
    return found
