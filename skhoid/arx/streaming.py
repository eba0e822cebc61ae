"""The recursion behind ``partial_fit``: its lags, clock and state from row to row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .. import _kernels
from ..exceptions import IrregularSamplingError, RunIndexError
from ..preprocessing.held_inputs import BLOCK
from ..runs import GAP, JITTER_TOLERANCE, RunLayout
from .forgetting import Forgetting
from .orders import Orders, regressors
from .rls import RecursionData, RecursionState, kernel_regressors


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
