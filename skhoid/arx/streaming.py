"""``partial_fit``: rows that arrive one by one, and the one protocol by which recursions take them.

Open it to make a method stream: it needs a :class:`Recursion`, and a way to begin one.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from sklearn.exceptions import NotFittedError

from .. import _kernels
from .._sklearn import fit_context
from ..exceptions import IrregularSamplingError, RunIndexError
from ..preprocessing.gate import as_weights
from ..preprocessing.grid import BLOCK
from ..regression import RunRegressor, find_columns
from ..runs import GAP, JITTER_TOLERANCE, RunLayout
from .rls import window_rows


@dataclass(frozen=True)
class Piece:
    """Rows that follow each other without a break; ``fresh`` if they follow nothing.

    ``X`` has the inputs alone, maybe in single precision; ``weights`` are those of the rows, if
    any are given.
    """

    X: np.ndarray
    y: np.ndarray
    time: np.ndarray
    fresh: bool
    weights: np.ndarray | None = None


@dataclass
class Clock:
    """Where the last row was: its run and, where rows have an index, its time in seconds."""

    run: Any = None
    time: float | None = None

    def pieces(
        self,
        layout: RunLayout,
        X: np.ndarray,
        y: np.ndarray,
        new_run: bool,
        weights: np.ndarray | None = None,
    ) -> Iterator[Piece]:
        """Cut rows at runs, gaps and run-ins, and note where the last one is."""
        stretches = layout.stretches
        for begin, end in zip(stretches[:-1].tolist(), stretches[1:].tolist(), strict=True):
            run = layout.labels[int(layout.run_of(np.asarray(begin)))]
            fresh = begin > 0 or new_run or not self._goes_on(run, layout, begin)
            self.run, self.time = run, float(layout.time[end - 1]) if layout.indexed else None
            if layout.trimmed is None or not layout.trimmed[begin]:
                own = None if weights is None else weights[begin:end]
                yield Piece(X[begin:end], y[begin:end], layout.time[begin:end], fresh, own)

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


def first_telling_row(X: np.ndarray, y: np.ndarray) -> int | None:
    """The first row without NaN, after a rest before the task, which tells nothing; None if none.

    Where all rests, it is the first without NaN.
    """
    whole = ~np.isnan(y) & ~np.isnan(X).any(axis=1)
    moving = whole & ((y != 0) | (X != 0).any(axis=1))
    return int(np.argmax(moving if moving.any() else whole)) if whole.any() else None


class Recursion:
    """Estimates that rows update, one or many at a time, with all the state that takes."""

    plain = True  # rows need no times

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        """Take rows that follow those before: inputs of shape (n, n_inputs), and outputs (n,).

        Either may be NaN. ``time`` is that in the run, where rows have one. A method that takes
        weights has them as one more argument.
        """
        raise NotImplementedError

    def step(self, X: np.ndarray, y: np.ndarray) -> bool:
        """Take rows that nobody has checked; False, and nothing done, if they need a look."""
        if not np.isfinite(X).all() or np.isinf(y).any():
            return False
        self.take(X, y)
        return True

    def rest(self) -> None:
        """Forget the signals before, at the beginning of a run or after a gap; keep estimates."""
        raise NotImplementedError


class Streaming(RunRegressor):
    """A model that follows a stream of rows.

    A subclass gives ``_begun(X, y, fresh)``, a recursion that begins with the first rows, which it
    does not take yet (``fresh`` says which of them follow nothing), ``_rows_to_begin()``, how many
    it needs, and ``_refresh(recursion)``, which sets the fitted attributes. ``fit`` may leave a
    recursion for streams to go on with: ``_leave_for_streams(recursion, layout)``.
    """

    init_window: float

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Say of fitted attributes that a stream has too few rows yet, as predictions do."""
            if name.endswith("_") and "_pending" in vars(self):
                self._check_fitted()
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> Recursion | None:
        raise NotImplementedError

    def _first_row(self, X: np.ndarray, y: np.ndarray) -> int | None:
        """The row from which those to begin with count."""
        return first_telling_row(X, y)

    def _signal_columns(self, n_columns: int) -> list[int]:
        """Columns of X that the recursion takes."""
        return self._columns

    def _rows_to_begin(self) -> int:
        return window_rows(self.init_window, self.dt_)

    def _refresh(self, recursion: Any) -> None:
        raise NotImplementedError

    def _refresh_estimates(self, recursion: Any) -> None:
        """Set what changes with each row, in a stream that has been told of before."""
        self._refresh(recursion)

    def _check_streaming(self) -> None:
        """Refuse options that need whole runs."""

    def partial_fit(self, X: Any, y: Any, *, new_run: bool = False) -> Self:
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
        recursion = vars(self).get("_recursion")
        if not (
            recursion is not None
            and recursion.plain
            and self._reading.run is None
            and not self._reading.indexed
            and self._reading.names is None
            and not new_run
            and type(X) is np.ndarray
            and type(y) is np.ndarray
            and X.dtype == np.float64
            and y.dtype == np.float64
            and X.ndim == 2
            and X.shape[1] == self.n_features_in_
            and X.shape[0] == y.size > 0
            and y.ndim == 1
            and recursion.step(_kernels.gate(X[:, self._streamed]), _kernels.gate(y))
        ):
            return self._partial_fit(X, y, new_run)
        self._refresh_estimates(recursion)
        return self

    @fit_context(prefer_skip_nested_validation=True)
    def _partial_fit(self, X: Any, y: Any, new_run: bool, sample_weight: Any = None) -> Self:
        """Take what :meth:`partial_fit` does not take by its fast path."""
        recursion, pending = vars(self).get("_recursion"), vars(self).get("_pending")
        self._check_streaming()
        fitted = self.__sklearn_is_fitted__()
        if not fitted and pending is None:
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
        columns = self._stream_columns(values.shape[1])
        inputs, output = find_columns(values, columns), _kernels.gate(output)
        weights = as_weights(sample_weight, X, output.size)
        if weights is not None:
            output = np.where(weights > 0.0, output, np.nan)
        pieces = list(clock.pieces(grid.layout, inputs, output, new_run, weights))
        recursion = deepcopy(recursion)
        if recursion is None:
            pieces = [*(pending or []), *pieces]
            recursion = self._started(pieces)
            if recursion is None:  # the caller may write other rows into the same table
                kept = [replace(p, X=p.X.copy(), y=p.y.copy()) for p in pieces]
                self._pending, self._clock = kept, clock
                return self
        for piece in pieces:
            if piece.fresh:
                recursion.rest()
            for begin in range(0, piece.y.size, BLOCK):
                rows = slice(begin, begin + BLOCK)
                time = piece.time[rows] if self._reading.indexed else None
                own = () if piece.weights is None else (piece.weights[rows],)
                X_rows, y_rows = _kernels.gate(piece.X[rows]), _kernels.gate(piece.y[rows])
                recursion.take(X_rows, y_rows, time, *own)
        self._recursion, self._clock = recursion, clock
        self.__dict__.pop("_pending", None)
        self._refresh(recursion)
        return self

    def _stream_columns(self, n_columns: int) -> list[int]:
        """Columns that the recursion takes, noted as the fast path indexes by them."""
        columns = self._signal_columns(n_columns)
        everything = columns == list(range(n_columns))
        self._streamed = slice(None) if everything else np.array(columns)
        return columns

    def _started(self, pieces: list[Piece]) -> Any:
        """A recursion from the rows so far, if they suffice."""
        X = np.concatenate([piece.X for piece in pieces], dtype=np.float64)
        y = np.concatenate([piece.y for piece in pieces])
        first, needed = self._first_row(X, y), self._rows_to_begin()
        if needed and (first is None or y.size - first < needed):
            return None
        fresh = np.zeros(y.size, dtype=bool)
        begins = np.cumsum([0, *(piece.y.size for piece in pieces[:-1])])
        fresh[begins] = [piece.fresh for piece in pieces]
        begun: Any = self._begun
        if all(piece.weights is None for piece in pieces):
            return begun(X, y, fresh)
        weights = [np.ones(p.y.size) if p.weights is None else p.weights for p in pieces]
        return begun(X, y, fresh, np.concatenate(weights))

    def _leave_for_streams(self, recursion: Recursion, layout: RunLayout) -> None:
        """Let streams go on after runs that were fitted: after a single one, without a break."""
        self._recursion, self._clock = recursion, Clock()
        self._stream_columns(self.n_features_in_)
        if len(layout.labels) == 1:
            self._clock.run = layout.labels[-1]
            self._clock.time = float(layout.time[-1]) if layout.indexed else None

    def _end_stream(self, *attributes: str) -> None:
        """Forget the stream before, and attributes of runs."""
        for name in (*attributes, "_recursion", "_pending", "_clock"):
            self.__dict__.pop(name, None)

    def _check_fitted(self) -> None:
        if "_pending" in vars(self):
            rows = sum(piece.y.size for piece in self._pending)
            raise NotFittedError(
                f"There is no estimate yet: partial_fit has collected {rows} rows of the "
                f"{self._rows_to_begin()} that the method begins with (init_window = "
                f"{self.init_window:g} s)."
            )
        super()._check_fitted()
