"""Many ARX candidates on the same rows: one triangle per run, then a small problem each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property, reduce
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from ...exceptions import ShortRunError
from ...pipelines import final_step
from ...preprocessing.base import RowPreservingTransformer
from ...preprocessing.grid import ModelGrid
from ...preprocessing.held_inputs import HeldInputs
from ..base import BaseARX, check_lengths, check_row_count, longest_stretches
from ..batch import ARXRegressor
from ..least_squares import Triangle, solutions
from ..orders import Orders, regressor_blocks, whole_number
from .fitted_candidates import FittedCandidates
from .folds import RunRows

SAMPLES = 1 << 20  # simulated at a time


def has_fast_path(estimator: Any) -> bool:
    """Whether candidates can share one factorisation: OLS behind skhoid's own transformers."""
    model = final_step(estimator)[1]
    steps = estimator.steps[:-1] if isinstance(estimator, Pipeline) else []
    return (
        type(model) is ARXRegressor
        and model.method == "ols"
        and all(
            isinstance(s, RowPreservingTransformer) or s in (None, "passthrough") for _, s in steps
        )
    )


def with_orders(estimator: Any, **orders: Any) -> Any:
    """Clone with other ``na``, ``nb``, ``nk`` in the last step."""
    prefix, _ = final_step(estimator)
    return clone(estimator).set_params(**{prefix + name: v for name, v in orders.items()})


def as_candidate(name: str, value: Any) -> Any:
    """Check a candidate: a whole number, or a tuple of one per input."""
    least = {"na": 0, "nb": 1, "nk": 0}[name]
    if np.ndim(value):
        return tuple(whole_number(name, v, least) for v in value)
    return whole_number(name, value, least)


class CandidateTable:
    """Regressors of the largest candidate, of which every other one takes some columns.

    All candidates are compared on the same rows: those on which the largest lags are known. The
    rows are read run by run, and only triangles are kept of them.
    """

    def __init__(self, estimator: Any, X: Any, y: Any) -> None:
        if isinstance(estimator, Pipeline) and len(estimator.steps) > 1:
            X = clone(estimator[:-1]).fit_transform(X, y)
        self._model = clone(final_step(estimator)[1])
        if not isinstance(self._model, BaseARX):
            raise TypeError(
                "The search needs an ARX model, or a pipeline that ends in one; got "
                f"{type(self._model).__name__}."
            )
        data = self._model._read_data(X, y, in_parts=True)
        self.grid, self._raw_inputs, self.output = data.grid, data.inputs, data.output
        self.known = data.known
        self.dt = self.grid.dt
        self.n_runs = len(self.grid.layout.labels)

    @cached_property
    def inputs(self) -> HeldInputs:
        """Inputs to simulate from."""
        return self._model._hold(self.grid, self._raw_inputs)

    @property
    def shortest_run(self) -> int:
        """Rows of the longest stretch of the run in which it is shortest."""
        return int(longest_stretches(self.grid).min())

    def set_candidates(self, candidates: list[dict[str, Any]]) -> None:
        """Take candidates ``{"na": ..., "nb": ..., "nk": ...}``."""
        model, n_inputs = self._model, self._raw_inputs.shape[1]
        self.orders = [
            Orders.of(
                c.get("na", model.na), c.get("nb", model.nb), c["nk"], n_inputs, model.fit_intercept
            )
            for c in candidates
        ]
        low = [min(o.nk[j] for o in self.orders) for j in range(n_inputs)]
        high = [max(o.nk[j] + o.nb[j] for o in self.orders) for j in range(n_inputs)]
        lengths = [h - lo for lo, h in zip(low, high, strict=True)]
        self.largest = Orders.of(
            max(o.na for o in self.orders), lengths, low, n_inputs, model.fit_intercept
        )
        check_lengths(self.grid, self.largest)

    def columns(self, orders: Orders) -> list[int]:
        """Columns of the table that are the regressors of ``orders``."""
        chosen = list(range(orders.na))
        at = self.largest.na
        for low, length, nb, nk in zip(
            self.largest.nk, self.largest.nb, orders.nb, orders.nk, strict=True
        ):
            chosen += range(at + nk - low, at + nk - low + nb)
            at += length
        return chosen + ([at] if orders.intercept else [])

    def whole(self) -> Triangle:
        """Factorise all rows."""
        return self._checked(self._factorised(range(self.n_runs)))

    def between(self, start: float, stop: float) -> Triangle:
        """Factorise the rows of all runs with ``start <= time < stop``."""
        return self._of_tables(
            table
            for run in range(self.n_runs)
            for table, _ in self._blocks(run, *np.searchsorted(self._times(run), (start, stop)))
        )

    def time_span(self) -> tuple[float, float]:
        """First and last time of the rows."""
        known = [
            self._times(run)[rows[[0, -1]]]
            for run in range(self.n_runs)
            for _, rows in self._blocks(run)
            if rows.size
        ]
        if not known:
            check_row_count(0, 1, self.grid)
        return float(np.min(known)), float(np.max(known))

    def triangles(self, training: list[RunRows]) -> tuple[list[Triangle], Triangle]:
        """Factorise the rows whose lags all lie in each of several parts of the data, and all.

        Each row is factorised once, together with the runs that are in the same parts; the
        triangle of a part is merged of these. Only runs that a part cuts are read again.
        """
        belongs = np.array([rows.whole for rows in training])
        _, unit_of = np.unique(belongs, axis=1, return_inverse=True)
        members = [np.flatnonzero(unit_of == unit) for unit in dict.fromkeys(unit_of.tolist())]
        units = [self._factorised(runs) for runs in members]
        # Merged up to each unit, and from it on, so that to leave one out takes one merge more.
        upto = list(accumulate(units, Triangle.merged))
        since = list(accumulate(reversed(units), Triangle.merged))[::-1]
        parts = []
        for rows in training:
            chosen = rows.whole[[runs[0] for runs in members]]
            out = np.flatnonzero(~chosen)
            head, tail = (out[0], out[-1] + 1) if out.size else (len(units), len(units))
            pieces = [
                *upto[max(head - 1, 0) : head],
                *(units[i] for i in range(head, tail) if chosen[i]),
                *since[tail : tail + 1],
                *(self._of_cut_run(run, mask) for run, mask in rows.cut.items()),
            ]
            parts.append(self._enough(pieces))
        return parts, self._checked(upto[-1])

    def one_step_loss(self, triangle: Triangle, orders: Orders) -> float:
        """Mean squared one-step error (Eq. 24); NaN where regressors are linearly dependent."""
        small = triangle.subset(self.columns(orders))
        return np.nan if len(small.null_space()) else small.rss / triangle.n_rows

    def fitted(self, triangles: list[Triangle]) -> FittedCandidates:
        """All candidates, fitted on the rows of each triangle."""
        found = [solutions(triangles, self.columns(orders)) for orders in self.orders]
        return FittedCandidates.of(self.orders, found)

    def simulate(self, models: FittedCandidates, part: int, run: int) -> Iterator[np.ndarray]:
        """Free runs of a run at full rate: some candidates at a time, one in each column."""
        grid, at = self._of_run[run]
        some = max(1, SAMPLES // grid.layout.n_rows)
        for first in range(0, models.n_candidates, some):
            free = models.simulate(part, slice(first, first + some), grid, self.inputs[at])
            if grid.rows is not None:
                free = np.column_stack([grid.to_full_rate(column) for column in free.T])
            yield free

    @cached_property
    def _of_run(self) -> list[tuple[ModelGrid, slice]]:
        """The grid of each run, and where its rows are in that of all."""
        layout, rows = self.grid.layout, self.grid.rows
        starts = layout.run_starts if rows is None else np.searchsorted(rows, layout.run_starts)
        return [
            (ModelGrid.of(layout.of_run(run)), slice(a, b))
            for run, (a, b) in enumerate(pairwise(starts.tolist()))
        ]

    def _times(self, run: int) -> np.ndarray:
        grid, _ = self._of_run[run]
        return grid.thin_inputs(grid.layout.time)

    def _blocks(
        self, run: int, low: int = 0, high: int | None = None
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Regressors with output of a run, or of its rows from ``low`` to ``high``, and rows."""
        grid, at = self._of_run[run]
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        begin = np.maximum(begin, low - self.largest.first_row)
        end = end if high is None else np.minimum(end, high)
        for table, rows, _ in regressor_blocks(
            self.output[at], self._raw_inputs[at], begin, end, self.largest
        ):
            yield table, rows

    def _factorised(self, runs: Iterable[int]) -> Triangle:
        return self._of_tables(table for run in runs for table, _ in self._blocks(run))

    def _of_cut_run(self, run: int, mask: np.ndarray) -> Triangle:
        """Factorise the rows of a run whose lags all lie in a mask of its rows."""
        grid, _ = self._of_run[run]
        outside = np.concatenate(([0], np.cumsum(~grid.thin_inputs(mask))))
        first = self.largest.first_row
        return self._of_tables(
            np.asfortranarray(table[outside[rows + 1] == outside[rows - first]])
            for table, rows in self._blocks(run)
        )

    def _of_tables(self, tables: Iterable[np.ndarray]) -> Triangle:
        return Triangle.of_blocks(tables, self.largest.n_params + 1)

    def _checked(self, whole: Triangle) -> Triangle:
        most = max(o.n_params for o in self.orders)
        check_row_count(whole.n_rows, most + 1, self.grid)  # a loss needs one more
        return whole

    def _enough(self, pieces: list[Triangle]) -> Triangle:
        n_rows, n_params = sum(piece.n_rows for piece in pieces), self.largest.n_params
        if n_rows <= n_params:
            raise ShortRunError(
                f"A fold leaves only {n_rows} rows to fit up to {n_params} lags. Use fewer folds, "
                "or smaller na, nb and nk."
            )
        return reduce(Triangle.merged, pieces)
