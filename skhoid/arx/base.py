"""What ARX estimators share: the gate for data, simulation, prediction and score."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d

from .. import _kernels
from ..exceptions import (
    MissingDataWarning,
    RunIndexError,
    SamplingJitterWarning,
    ShortRunError,
)
from ..metrics import scored_rows, vaf_of_rows
from ..preprocessing.base import check_numbers, read_table
from ..preprocessing.grid import ModelGrid
from ..runs import DecimationMark, check_alignment, input_columns
from .orders import Orders, regressors
from .transfer import transfer_function

BOUND = 1e100  # of simulated outputs; its square still sums without overflow
NOTED_JITTER = 0.01  # of a sampling time


class BaseARX(RegressorMixin, BaseEstimator):
    """An ARX model with parameters ``coef_`` on the grid that marks of X leave."""

    na: Any
    nb: Any
    nk: Any
    inputs: Any
    fit_intercept: bool
    roles: dict | None
    dt: float | None
    run: Any
    n_rows_missing_: int

    def _read_X(self, X: Any, *, reset: bool) -> tuple[ModelGrid, np.ndarray]:
        """Read the layout and all columns of X, checked."""
        layout, values = read_table(self, X, reset=reset)
        if reset:
            self._mark = layout.mark
        elif layout.mark != self._mark:
            raise RunIndexError(
                f"{type(self).__name__} was fitted on X {_marked(self._mark)} and now gets X "
                f"{_marked(layout.mark)}. Pass X through the same Decimator, best by putting both "
                "in one Pipeline."
            )
        return ModelGrid.of(layout), values

    def _read_y(self, X: Any, y: Any) -> np.ndarray:
        """Read y, in which NaN means no measurement."""
        if y is None:
            raise ValueError(
                f"{type(self).__name__} requires y to be passed, but the target y is None."
            )
        check_alignment(X, y)
        output = column_or_1d(y, warn=True)
        if output.dtype.kind not in "iufb":
            check_numbers(pd.DataFrame({getattr(y, "name", None) or "y": output}), "y")
        output = np.asarray(output, dtype=np.float64)
        check_consistent_length(X, output)
        if np.isinf(output).any():
            row = int(np.flatnonzero(np.isinf(output))[0])
            raise ValueError(
                "Input y contains infinity or a value too large for dtype('float64'), first in "
                f"row {row}. Mark missing measurements by NaN."
            )
        return output

    def _channel_names(self, positions: list[int]) -> list[str]:
        return [f"x{p}" if self._names is None else str(self._names[p]) for p in positions]

    def _read_data(self, X: Any, y: Any) -> tuple[ModelGrid, np.ndarray, np.ndarray, np.ndarray]:
        """Read data to fit; return the grid, and inputs, output and all columns of X on it."""
        grid, values = self._read_X(X, reset=True)
        output = self._read_y(X, y)
        self._output_name = str(getattr(y, "name", None) or "y")
        self._columns = input_columns(
            self._names, values.shape[1], self.inputs, self._run, self.roles
        )
        self.inputs_ = self._channel_names(self._columns)
        self.dt_ = grid.dt
        self.jitter_ = grid.layout.jitter
        if self.jitter_ > NOTED_JITTER:
            warnings.warn(
                f"The sampling instants jitter by up to {100 * self.jitter_:.1f} % of "
                f"{grid.layout.dt:.6g} s. The model takes them as regular; "
                "skhoid.resample_runs(X, y) brings them onto a regular grid.",
                SamplingJitterWarning,
                stacklevel=4,
            )
        thinned = grid.thin_inputs(values)
        whole = self._columns == list(range(values.shape[1]))
        inputs = thinned if whole else thinned[:, self._columns]
        return grid, inputs, grid.thin_output(output), thinned

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
        """Warn of rows left out, unless they only lack a past before the run (DelayShift)."""
        if self.n_rows_missing_ == 0:
            return
        missing = np.isnan(output) | np.isnan(inputs).any(axis=1)
        for begin, end in segments(grid):
            known = np.flatnonzero(~np.isnan(inputs[begin:end]).any(axis=1))
            if known.size:
                missing[begin : begin + known[0]] = False
        n_missing = int(missing.sum())
        if n_missing:
            channels = [self._output_name, *names]
            columns = np.column_stack([output, inputs])[missing]
            named = [
                c for c, gap in zip(channels, np.isnan(columns).any(axis=0), strict=True) if gap
            ]
            warnings.warn(
                f"{n_missing} rows of {', '.join(map(repr, named))} are NaN, first "
                f"{grid.layout.where(grid.full_row(int(np.flatnonzero(missing)[0])))}; "
                f"{self.n_rows_missing_} rows whose lags need them are left out, "
                f"{n_used} are used.",
                MissingDataWarning,
                stacklevel=5,
            )

    def _check_fitted(self) -> None:
        check_is_fitted(self)

    def to_transfer_function(self, backend: str = "scipy") -> Any:
        """Return the discrete-time transfer function from the inputs to the output.

        G(z) = z^-nk (b_0 + b_1 z^-1 + ...) / (1 + a_1 z^-1 + ...), with the sampling time ``dt_``.
        The intercept is not part of it, nor is a :class:`DelayShift` that stands before the model.

        Parameters
        ----------
        backend : {"scipy", "control"}, default="scipy"
            Library of the result; python-control is an extra: ``pip install "skhoid[control]"``.

        Returns
        -------
        G : scipy.signal.dlti, dict of them by input, or control.TransferFunction
            With several inputs SciPy, which has no systems of several inputs with delays, gets
            a dict ``{input: dlti}``; python-control gets one system.
        """
        self._check_fitted()
        if backend not in ("scipy", "control"):
            raise ValueError(f"backend must be 'scipy' or 'control'; got {backend!r}.")
        return transfer_function(
            self.orders_, self.coef_, self.dt_, self.inputs_, self._output_name, backend
        )

    def _held_inputs(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        return self._hold(grid, grid.thin_inputs(values)[:, self._columns])

    def _hold(self, grid: ModelGrid, inputs: np.ndarray) -> np.ndarray:
        """Inputs whose NaN hold the last value, and are zero before the first."""
        missing = np.isnan(inputs)
        if not missing.any():
            return inputs
        inputs = inputs.copy()
        held = np.zeros(len(inputs), dtype=bool)
        for a, b in segments(grid):
            part, gaps = inputs[a:b], missing[a:b]
            last = np.maximum.accumulate(np.where(gaps, -1, np.arange(b - a)[:, None]), axis=0)
            part[:] = np.where(last >= 0, np.take_along_axis(part, np.maximum(last, 0), 0), 0.0)
            # Rows before the first value only lack a past (DelayShift), unless none ever comes.
            held[a:b] = (gaps & ((last >= 0) | gaps.all(axis=0))).any(axis=1)
        if held.any():
            first = grid.full_row(int(np.flatnonzero(held)[0]))
            warnings.warn(
                f"{int(held.sum())} rows of the inputs {self.inputs_} are NaN, first "
                f"{grid.layout.where(first)}; the simulation holds the last value there, or zero "
                "where there is none.",
                MissingDataWarning,
                stacklevel=4,
            )
        return inputs

    def _simulate(
        self, grid: ModelGrid, inputs: np.ndarray, y0: np.ndarray | None = None
    ) -> np.ndarray:
        """Free run on the grid."""
        stretches = (grid.begin, grid.end, grid.past)
        return free_run(inputs, stretches, self.orders_, *self._parameters(grid), y0)

    def _parameters(self, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
        """Sets of parameters, and which of them each row of the grid has."""
        return self.coef_[None], np.zeros(grid.n_rows, dtype=np.int64)

    def _parameters_before(self, grid: ModelGrid, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        """The same, as they were known ``horizon`` rows before."""
        return self._parameters(grid)

    def predict(self, X: Any) -> np.ndarray:
        """Simulate the output from the inputs alone (free run).

        The output is zero before each run, and before the first row after a gap or a marked
        run-in; inputs are zero before the recording begins. A NaN input holds the last value, and
        a warning says how many. Unstable models stay finite (within 1e100).

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
            Simulated output, in the unit of ``y``.

        See Also
        --------
        predict_ahead : Predictions that use the measured output.
        simulate : Free run from an estimated initial state.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        return grid.to_full_rate(self._simulate(grid, self._held_inputs(grid, values)))

    def simulate(self, X: Any, y: Any = None, *, initial_state: str = "zero") -> np.ndarray:
        """Simulate the output, from a zero or an estimated initial state.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,), default=None
            Measured output, needed to estimate the initial state.
        initial_state : {"zero", "estimate"}, default="zero"
            ``"estimate"`` chooses the ``na`` outputs before each run (and gap, and end of the
            run-in) by least squares on ``y``, as MATLAB's ``compare`` does.

        Returns
        -------
        y_sim : ndarray of shape (n_rows,)
        """
        if initial_state not in ("zero", "estimate"):
            raise ValueError(f"initial_state must be 'zero' or 'estimate'; got {initial_state!r}.")
        if initial_state == "zero":
            return self.predict(X)
        self._check_fitted()
        if y is None:
            raise ValueError("initial_state='estimate' needs the measured output y.")
        grid, values = self._read_X(X, reset=False)
        output = grid.thin_output(self._read_y(X, y))
        inputs = self._held_inputs(grid, values)
        free = self._simulate(grid, inputs)
        na = self.orders_.na
        if na == 0:
            return grid.to_full_rate(free)
        responses = np.empty((free.size, na))
        rest = np.zeros_like(inputs)
        for lag in range(na):
            y0 = np.zeros((grid.begin.size, na))
            y0[:, lag] = 1.0
            responses[:, lag] = self._simulate(grid, rest, y0) - self._simulate(grid, rest)
        for begin, end in zip(grid.begin, grid.end, strict=True):
            known = np.flatnonzero(~np.isnan(output[begin:end])) + begin
            fitted = np.linalg.lstsq(responses[known], output[known] - free[known], rcond=None)[0]
            free[begin:end] += responses[begin:end] @ fitted
        return grid.to_full_rate(free)

    def predict_ahead(self, X: Any, y: Any, horizon: int = 1) -> np.ndarray:
        """Predict each row from the output measured ``horizon`` samples before it.

        One-step predictions are good even for wrong models: validate with :meth:`predict`.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output.
        horizon : int, default=1
            Steps ahead, in samples of the fitted grid (``dt_``).

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
            Outputs and inputs before a run or a gap are taken as zero; a missing output is
            replaced by its own one-step prediction.
        """
        self._check_fitted()
        if isinstance(horizon, bool) or not isinstance(horizon, (int, np.integer)) or horizon < 1:
            raise ValueError(f"horizon is a number of samples, at least 1; got {horizon!r}.")
        grid, values = self._read_X(X, reset=False)
        output = grid.thin_output(self._read_y(X, y))
        return grid.to_full_rate(
            self._ahead(grid, self._held_inputs(grid, values), output, int(horizon))
        )

    def _ahead(
        self, grid: ModelGrid, inputs: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        begin, end = np.array(segments(grid)).T
        return _kernels.arx.predict_ahead(
            _kernels.gate(output),
            _kernels.gate(inputs),
            _kernels.gate(begin, np.int64),
            _kernels.gate(end, np.int64),
            *_as_kernels_take(self.orders_, *self._parameters_before(grid, horizon)),
            horizon,
            BOUND,
        )

    def _one_step_errors(self, X: Any, y: Any) -> np.ndarray:
        """One-step errors on the grid; NaN where lags are not known or nothing was measured."""
        grid, values = self._read_X(X, reset=False)
        output = grid.thin_output(self._read_y(X, y))
        raw = grid.thin_inputs(values)[:, self._columns]
        table, rows, _ = regressors(
            output, raw, grid.begin[grid.measured], grid.end[grid.measured], self.orders_
        )
        errors = np.full(output.size, np.nan)
        errors[rows] = table[:, -1] - self._fitted(table[:, :-1], rows, grid)
        return errors

    def _fitted(self, regressors: np.ndarray, rows: np.ndarray, grid: ModelGrid) -> np.ndarray:
        """Output that the regressors of grid rows give."""
        return regressors @ self.coef_

    def score(self, X: Any, y: Any) -> float:
        """Score the free run by its VAF in percent, pooled over runs.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output.

        Returns
        -------
        vaf : float
            Unclipped, at least -1000; rows of a marked run-in are left out.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        prediction = grid.to_full_rate(self._simulate(grid, self._held_inputs(grid, values)))
        keep = scored_rows(grid.layout, None, None)
        return vaf_of_rows(self._read_y(X, y), prediction, keep, grid.layout, "pooled", False)

    def _score_at_model_rate(
        self, X: Any, y: Any, keep: np.ndarray, average: str, centered: bool
    ) -> float:
        """VAF on the filtered and thinned signals; see ``VAFScorer(rate="model")``."""
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        output = self._read_y(X, y)
        free = self._simulate(grid, self._held_inputs(grid, values))
        full = np.zeros(output.size)
        rows = np.arange(output.size) if grid.rows is None else grid.rows
        thinned = np.full(output.size, np.nan)
        full[rows], thinned[rows] = free, grid.thin_output(output)
        return vaf_of_rows(thinned, full, keep, grid.layout, average, centered)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


def free_run(
    inputs: np.ndarray,
    stretches: tuple[np.ndarray, np.ndarray, np.ndarray],
    orders: Orders,
    theta: np.ndarray,
    at: np.ndarray,
    y0: np.ndarray | None = None,
) -> np.ndarray:
    """Simulate stretches (begin, end, past), each from ``na`` initial outputs, zero by default.

    Row t has the parameters ``theta[at[t]]``.
    """
    if y0 is None:
        y0 = np.zeros((stretches[0].size, max(orders.na, 1)))
    return _kernels.arx.free_run(
        _kernels.gate(inputs),
        *(_kernels.gate(edge, np.int64) for edge in stretches),
        *_as_kernels_take(orders, theta, at),
        _kernels.gate(y0),
        BOUND,
    )


def _as_kernels_take(orders: Orders, theta: np.ndarray, at: np.ndarray) -> tuple[Any, ...]:
    theta, at = _kernels.gate(theta), _kernels.gate(at, np.int64)
    return theta, at, orders.na, np.array(orders.nb), np.array(orders.nk)


def _marked(mark: DecimationMark | None) -> str:
    return "not decimated" if mark is None else f"decimated by {mark.factor} ({mark.method})"


def segments(grid: ModelGrid) -> list[tuple[int, int]]:
    """Begin and end of runs, cut at gaps but not at the end of a run-in."""
    begin = np.unique(grid.past)
    return list(pairwise([*begin.tolist(), int(grid.end[-1])]))


def longest_stretches(grid: ModelGrid) -> np.ndarray:
    """Rows of the longest measured stretch of each run."""
    lengths = np.where(grid.measured, grid.end - grid.begin, 0)
    longest = np.zeros(len(grid.layout.labels), dtype=np.int64)
    first = grid.begin if grid.rows is None else grid.rows[grid.begin]
    np.maximum.at(longest, grid.layout.run_of(first), lengths)
    return longest


def check_lengths(grid: ModelGrid, orders: Orders) -> None:
    """Refuse runs in which no row has known lags."""
    longest = longest_stretches(grid)
    needed = orders.first_row + 1
    short = np.flatnonzero(longest < needed)
    if short.size == 0:
        return
    many = f" (and {short.size - 1} more)" if short.size > 1 else ""
    raise ShortRunError(
        f"Run {grid.layout.labels[short[0]]!r}{many} has at most {longest[short[0]]} successive "
        f"rows at {grid.dt:g} s, and lags that reach {needed - 1} samples back need {needed} "
        f"(X has n_samples = {grid.layout.n_rows}). Leave the run out "
        "(skhoid.select_runs), or use smaller na, nb and nk, or a smaller decimation factor."
    )


def check_row_count(n_rows: int, n_params: int, output: np.ndarray, grid: ModelGrid) -> None:
    """Refuse to fit more parameters than rows are left."""
    if n_rows >= n_params:
        return
    if np.isnan(output).all():
        raise ValueError("Input y contains NaN in all rows: nothing was measured.")
    raise ShortRunError(
        f"{n_rows} rows are left for {n_params} parameters (n_samples = {grid.layout.n_rows} rows "
        "of X, of which lags, missing values and the run-in take the rest). Use more data or "
        "fewer lags."
    )
