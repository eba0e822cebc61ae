"""Follower: ``partial_fit`` of methods whose filter takes rows one after the other.

Open it to make a method stream: it needs a :class:`RowFilter`, and a way to begin one.
"""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import replace
from typing import Any, Protocol, Self

import numpy as np
from sklearn.exceptions import NotFittedError

from .. import _kernels
from .._sklearn import fit_context
from ..arx.rls import window_rows
from ..arx.streaming import Clock, Piece
from ..regression import RunRegressor, columns_of


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
