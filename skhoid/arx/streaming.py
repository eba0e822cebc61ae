"""partial_fit: rows that arrive one by one, and the recursions that take them."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol, Self

import numpy as np
from sklearn.exceptions import NotFittedError

from .. import _kernels
from .._sklearn import fit_context
from ..exceptions import IrregularSamplingError, RunIndexError
from ..preprocessing.grid import BLOCK
from ..regression import RunRegressor, columns_of
from ..runs import GAP, JITTER_TOLERANCE, RunLayout
from .forgetting import Forgetting
from .orders import Orders, regressors
from .rls import RecursionData, RecursionState, kernel_regressors, window_rows


@dataclass(frozen=True)
class Piece:
    """Rows that follow each other without a break; ``fresh`` if they follow nothing.

    ``X`` has the inputs alone, maybe in single precision.
    """

    X: np.ndarray
    y: np.ndarray
    time: np.ndarray
    fresh: bool


@dataclass
class Clock:
    """Where the last row was: its run and, where rows have an index, its time in seconds."""

    run: Any = None
    time: float | None = None

    def pieces(
        self, layout: RunLayout, X: np.ndarray, y: np.ndarray, new_run: bool
    ) -> Iterator[Piece]:
        """Cut rows at runs, gaps and run-ins, and note where the last one is."""
        stretches = layout.stretches
        for begin, end in zip(stretches[:-1].tolist(), stretches[1:].tolist(), strict=True):
            run = layout.labels[int(layout.run_of(np.asarray(begin)))]
            fresh = begin > 0 or new_run or not self._goes_on(run, layout, begin)
            self.run, self.time = run, float(layout.time[end - 1]) if layout.indexed else None
            if layout.trimmed is None or not layout.trimmed[begin]:
                yield Piece(X[begin:end], y[begin:end], layout.time[begin:end], fresh)

    def _goes_on(self, run: Any, layout: RunLayout, row: int) -> bool:
        if self.run is None or run != self.run:
            return False
        if self.time is None or not layout.indexed:
            return True
        step = float(layout.time[row]) - self.time
        if step <= 0:
            raise RunIndexError(
                f"The stream goes back in time: {layout.where(row)} follows t = {self.time:.6g} s "
                "of the same run. Give the rows in order of time; if a new run begins, give it "
                "its own label or pass new_run=True."
            )
        if step <= GAP * layout.dt and abs(step - layout.dt) > JITTER_TOLERANCE * layout.dt:
            raise IrregularSamplingError(
                f"The stream leaves its sampling grid: {layout.where(row)} comes {step:.6g} s "
                f"after the previous row, but the sampling time is {layout.dt:.6g} s. Resample "
                "the rows, or pass new_run=True."
            )
        return step <= GAP * layout.dt


class Stream:
    """A recursion and the rows it needs to go on."""

    def __init__(
        self,
        state: RecursionState,
        orders: Orders,
        columns: list[int],
        P0: np.ndarray,
        dt: float,
    ) -> None:
        self.state, self.P0, self.dt = state, P0, dt
        self.depth = orders.first_row
        rows = self.depth + _kernels.rls.CHUNK
        self._signals = np.full((1 + len(columns) + orders.intercept, rows, 1, 1), np.nan)
        if orders.intercept:
            self._signals[-1] = 1.0
        self._columns, self._inputs = np.array(columns), np.arange(len(columns))
        self._target = np.full((rows, 1, 1), np.nan)
        self._regressors = kernel_regressors(orders)
        self.since = np.zeros(1, dtype=np.int64)  # rows without a break
        self.last_time = -np.inf

    asked: tuple[Any, ...]  # parameters of the model when it was last called

    def go_on_with(self, forgetting: Forgetting, reset_times: np.ndarray) -> None:
        """Forget and reset in this way from the next row on."""
        self.forgetting, self.reset_times = forgetting, reset_times
        self._arrays = forgetting.arrays()
        self.plain = not forgetting.over_time and reset_times.size == 0

    def go_on_after(self, data: RecursionData) -> None:
        """Take over the lags at the end of a single run."""
        grid = data.grid
        length = int(grid.end[-1] - grid.begin[-1]) if grid.measured[-1] else 0
        kept = min(length, self.depth)
        if kept:
            self._signals[:, self.depth - kept : self.depth] = data.signals[:, -kept:]
        self.since[0] = length
        self.last_time = float(data.instants.time[-1])

    def take(self, X: np.ndarray, y: np.ndarray, columns: np.ndarray | None = None) -> bool:
        """Take rows that go on; False, and nothing done, if any is infinite.

        ``columns`` are those of the inputs, if X has not all that the model was given.
        """
        return _kernels.rls.stream(self.state.n_params, self._arrays[0].shape[1] > 1)(
            X,
            y,
            self._columns if columns is None else columns,
            self._signals,
            self._target,
            *self._regressors,
            self.depth,
            *self._arrays,
            self.forgetting.diagonal,
            self.forgetting.nominal,
            self.state.buffer,
            self.since,
        )

    def feed(self, piece: Piece, indexed: bool) -> None:
        """Take a piece, with all that may change at its instants."""
        if piece.fresh:
            self.since[0] = 0
            self.last_time = -np.inf
        time = piece.time if indexed else (self.since[0] + np.arange(piece.y.size)) * self.dt
        slack = 1e-6 * self.dt
        resets = np.searchsorted(time, self.reset_times - slack)
        due = (self.reset_times - slack > self.last_time) & (resets < time.size)
        edges = np.unique([*range(0, time.size, BLOCK), *resets[due].tolist(), time.size]).tolist()
        for begin, end in pairwise(edges):
            if begin in resets[due]:
                self.state.reset(self.P0)
            self.forgetting = self.forgetting.at(time[begin:end], self.state.n_params)
            self._arrays = self.forgetting.arrays()
            self.take(_kernels.gate(piece.X[begin:end]), piece.y[begin:end], self._inputs)
        self.last_time = float(time[-1])


def first_rows(pieces: list[Piece], n_rows: int, orders: Orders) -> np.ndarray | None:
    """Regressors and output of the first rows of a stream from one that is not NaN, if enough."""
    X = np.concatenate([piece.X for piece in pieces], dtype=np.float64)
    y = np.concatenate([piece.y for piece in pieces])
    known = np.flatnonzero(~np.isnan(y) & ~np.isnan(X).any(axis=1))
    if known.size == 0 or known[0] + n_rows > y.size:
        return None
    end = int(known[0]) + n_rows
    ends = np.cumsum([piece.y.size for piece in pieces])
    starts = ends - [piece.y.size for piece in pieces]
    begin = starts[np.array([piece.fresh for piece in pieces]) & (starts < end)]
    return regressors(y[:end], X[:end], begin, np.append(begin[1:], end), orders)[0]


def first_telling_row(X: np.ndarray, y: np.ndarray) -> int | None:
    """The first row without NaN, after a rest before the task, which tells nothing; None if none.

    Where all rests, it is the first without NaN.
    """
    whole = ~np.isnan(y) & ~np.isnan(X).any(axis=1)
    moving = whole & ((y != 0) | (X != 0).any(axis=1))
    return int(np.argmax(moving if moving.any() else whole)) if whole.any() else None


class RowFilter(Protocol):
    """A filter with a state of its own, which goes on from row to row."""

    def take(self, X: np.ndarray, y: np.ndarray) -> None:
        """Take rows that follow those before: inputs of shape (n, n_inputs), and outputs (n,)."""

    def rest(self) -> None:
        """Forget the signals before, at the beginning of a run or after a gap; keep estimates."""


class Follower(RunRegressor):
    """A model that follows a stream of rows.

    A subclass gives ``_begun(X, y, fresh)``, a filter that begins with the first rows, which it
    does not take yet (``fresh`` says which of them follow nothing), ``_rows_to_begin()``, how many
    it needs, and ``_refresh(row_filter)``, which sets the fitted attributes. ``fit`` may leave a
    filter for streams to go on with: ``_go_on_with(row_filter, layout)``.
    """

    init_window: float

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> RowFilter | None:
        raise NotImplementedError

    def _signal_columns(self, n_columns: int) -> list[int]:
        """Columns of X that the filter takes."""
        return self._columns

    def _rows_to_begin(self) -> int:
        return window_rows(self.init_window, self.dt_)

    def _refresh(self, row_filter: Any) -> None:
        raise NotImplementedError

    def _check_streaming(self) -> None:
        """Refuse options that need whole runs."""

    def partial_fit(self, X: Any, y: Any, *, new_run: bool = False) -> Self:
        """Update the estimates with rows that follow those seen before, one or many.

        The estimates do not depend on how the stream is cut. Rows are collected until
        ``init_window`` is full if the method begins from data; until then there is no estimate.
        After ``fit`` on a single run the stream continues from its end. Options changed since the
        stream began take effect when a new one begins.

        A new run, or a gap, clears the lags; estimates are kept. No path is kept.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels. Runs and gaps are read from the index, or from the run column. A float64 array
            is fastest.
        y : Series or array of shape (n_rows,)
            Output. NaN means no measurement.
        new_run : bool, default=False
            Whether a new run begins with the first row.

        Returns
        -------
        self : estimator

        Raises
        ------
        ValueError
            If X is decimated, or an option needs whole runs.
        RunIndexError
            If time goes backwards within a run.
        """
        row_filter = vars(self).get("_row_filter")
        if (
            row_filter is not None
            and "_streamed" in vars(self)
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
            and np.isfinite(X).all()
            and not np.isinf(y).any()
        ):
            row_filter.take(_kernels.gate(X[:, self._streamed]), _kernels.gate(y))
            self._refresh(row_filter)
            return self
        return self._partial_fit(X, y, new_run)

    @fit_context(prefer_skip_nested_validation=True)
    def _partial_fit(self, X: Any, y: Any, new_run: bool) -> Self:
        """Take what :meth:`partial_fit` does not take by its fast path."""
        self._check_streaming()
        row_filter, pending = vars(self).get("_row_filter"), vars(self).get("_pending")
        if row_filter is None and pending is None:
            grid, _, output, values, *_ = self._read_data(X, y, "nothing")
        else:
            grid, values = self._read_X(X, reset=False)
            output = self._read_y(X, y)
        if grid.layout.mark is not None:
            raise ValueError(
                "partial_fit cannot take decimated rows: the Decimator's filter needs the samples "
                "after them. Stream at the rate of the model."
            )
        # Nothing is kept of rows that are refused.
        clock = copy(vars(self).get("_clock", Clock()))
        self._streamed = self._signal_columns(values.shape[1])
        inputs = columns_of(values, self._streamed)
        output = _kernels.gate(output)
        pieces = list(clock.pieces(grid.layout, inputs, output, new_run))
        if row_filter is None:
            collected = list(pending or [])
            row_filter = self._started(collected + pieces)
            if row_filter is None:  # the caller may write other rows into the same table
                collected += [replace(p, X=p.X.copy(), y=p.y.copy()) for p in pieces]
                self._pending, self._clock = collected, clock
                return self
            pieces = collected + pieces
        else:
            row_filter = deepcopy(row_filter)
        for piece in pieces:
            if piece.fresh:
                row_filter.rest()
            row_filter.take(_kernels.gate(piece.X), _kernels.gate(piece.y))
        self._row_filter, self._clock = row_filter, clock
        self.__dict__.pop("_pending", None)
        self._refresh(row_filter)
        return self

    def _started(self, pieces: list[Piece]) -> RowFilter | None:
        """A filter from the rows so far, if they suffice."""
        X = np.concatenate([piece.X for piece in pieces], dtype=np.float64)
        y = np.concatenate([piece.y for piece in pieces])
        first, needed = first_telling_row(X, y), self._rows_to_begin()
        if needed and (first is None or y.size - first < needed):
            return None
        fresh = np.zeros(y.size, dtype=bool)
        begins = np.cumsum([0, *(piece.y.size for piece in pieces[:-1])])
        fresh[begins] = [piece.fresh for piece in pieces]
        return self._begun(X, y, fresh)

    def _go_on_with(self, row_filter: RowFilter, layout: Any) -> None:
        """Let streams go on after a single run that was fitted."""
        self._row_filter = row_filter
        self.__dict__.pop("_streamed", None)  # of a stream before
        time = float(layout.time[-1]) if layout.indexed else None
        self._clock = Clock(layout.labels[-1], time)

    def _check_fitted(self) -> None:
        if "_pending" in vars(self):
            rows = sum(piece.y.size for piece in self._pending)
            raise NotFittedError(
                f"There is no estimate yet: partial_fit has collected {rows} rows of the "
                f"{self._rows_to_begin()} that the method begins with (init_window = "
                f"{self.init_window:g} s)."
            )
        super()._check_fitted()
