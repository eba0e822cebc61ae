"""Many ARX candidates on the same rows: one factorisation, then a small problem each."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from ... import _kernels
from ..._sklearn import safe_indexing
from ...exceptions import RankDeficiencyError, ShortRunError
from ...metrics import VAF_FLOOR, VAFScorer, scored_rows, scored_signals, vaf_of_rows
from ...pipelines import final_step, raw_layout, trimmed_rows
from ...preprocessing.base import RowPreservingTransformer
from ...preprocessing.gate import as_output
from ..base import BaseARX, check_lengths, check_row_count, free_run_output, longest_stretches
from ..batch import ARXRegressor
from ..least_squares import Triangle
from ..orders import Orders, regressors, whole_number
from .folds import Fold


def has_fast_path(estimator: Any) -> bool:
    """Whether candidates can share one factorisation: OLS behind skhoid's own transformers."""
    model = final_step(estimator)[1]
    steps = estimator.steps[:-1] if isinstance(estimator, Pipeline) else []
    return (
        type(model) is ARXRegressor
        and model.method == "ols"
        and model.effects is None
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

    All candidates are compared on the same rows: those on which the largest lags are known.
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
        self.grid, self._raw_inputs, self.output, *_ = self._model._read_data(X, y)
        self.dt = self.grid.dt

    @cached_property
    def inputs(self) -> np.ndarray:
        """Inputs to simulate from."""
        return _kernels.gate(self._model._hold(self.grid, self._raw_inputs))

    @property
    def shortest_run(self) -> int:
        """Rows of the longest stretch of the run in which it is shortest."""
        return int(longest_stretches(self.grid).min())

    def set_candidates(self, candidates: list[dict[str, Any]]) -> None:
        """Stack the regressors of candidates ``{"na": ..., "nb": ..., "nk": ...}``."""
        model, inputs = self._model, self._raw_inputs
        n_inputs = inputs.shape[1]
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
        begin, end = self.grid.begin[self.grid.measured], self.grid.end[self.grid.measured]
        self.table, self.rows, self.n_missing = regressors(
            self.output, inputs, begin, end, self.largest
        )
        most = max(o.n_params for o in self.orders)
        check_row_count(self.rows.size, most + 1, self.output, self.grid)  # a loss needs one more

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
        """Factorise all rows; the table is overwritten, so this comes last."""
        return Triangle.of(self.table)

    def triangle(self, train: np.ndarray) -> Triangle:
        """Factorise the rows whose lags all lie in ``train`` (a mask of full-rate rows)."""
        on_grid = train if self.grid.rows is None else train[self.grid.rows]
        outside = np.concatenate(([0], np.cumsum(~on_grid)))
        inside = outside[self.rows + 1] == outside[self.rows - self.largest.first_row]
        if inside.sum() < self.table.shape[1]:
            raise ShortRunError(
                f"A fold leaves {int(inside.sum())} rows to fit up to {self.table.shape[1] - 1} "
                "lags on. Use fewer folds, or smaller na, nb and nk."
            )
        return Triangle.of(np.asfortranarray(self.table[inside]))

    def one_step_loss(self, triangle: Triangle, orders: Orders) -> float:
        """Mean squared one-step error (Eq. 24); NaN where regressors are linearly dependent."""
        small = triangle.subset(self.columns(orders))
        return np.nan if len(small.null_space()) else small.rss / triangle.n_rows

    def simulate(self, orders: Orders, theta: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Free run at full rate, of the stretches with any of ``rows`` (a mask)."""
        grid = self.grid
        touched = rows if grid.rows is None else rows[grid.rows]
        some = np.add.reduceat(touched, grid.begin) > 0
        stretches = (grid.begin[some], grid.end[some], grid.past[some])
        constant = np.zeros(len(self.inputs), dtype=np.int64)
        free = free_run_output(self.inputs, stretches, orders, theta[None], constant)
        return grid.to_full_rate(free, rows)


class Validation:
    """Scores candidates on the folds, in the rows that the scorer and the run-in leave."""

    def __init__(
        self, estimator: Any, X: Any, y: Any, folds: list[Fold], scorer: VAFScorer
    ) -> None:
        if scorer.rate == "model":
            raise ValueError(
                "A search scores at the full rate; figures of VAFScorer(rate='model') cannot "
                "choose between models."
            )
        self.layout = raw_layout(estimator, X, dt=scorer.dt, run=scorer.run)
        self.y = as_output(y)
        self.folds = folds
        self.scorer = scorer
        self.keep = scored_rows(self.layout, scorer.run_in, scorer.window)
        self.keep &= ~trimmed_rows(estimator, X)

    def vaf(self, prediction: np.ndarray, fold: Fold) -> float:
        return vaf_of_rows(
            self.y,
            prediction,
            self.keep & fold.test,
            self.layout,
            self.scorer.average,
            self.scorer.centered,
        )

    def score_candidate(
        self, table: CandidateTable, triangle: Triangle, index: int, fold: Fold
    ) -> tuple[float, np.ndarray]:
        """VAF and free run of a candidate fitted on a fold; NaN if it cannot be fitted."""
        orders = table.orders[index]
        small = triangle.subset(table.columns(orders))
        if len(small.null_space()):
            return np.nan, np.empty(0)
        prediction = table.simulate(orders, small.solve(), fold.test)
        return self.vaf(prediction, fold), prediction

    def error_of_single_fold(self, scored: list[tuple[float, np.ndarray]]) -> float:
        """Standard error of the VAF of a single fold, from the spread over blocks of its rows.

        A ratio estimator; NaN for bad models, and with several folds, whose own spread is used.
        """
        if len(scored) > 1 or scored[0][1].size == 0:
            return np.nan
        fold, prediction, n_blocks = self.folds[0], scored[0][1], 8
        signal, error, _ = scored_signals(
            self.y, prediction, self.keep & fold.test, self.layout, self.scorer.centered
        )
        power = [np.sum(block**2) for block in np.array_split(signal, n_blocks)]
        lost = [np.sum(block**2) for block in np.array_split(error, n_blocks)]
        if sum(lost) > -VAF_FLOOR * sum(power):
            return np.nan
        deviation = np.asarray(lost) - sum(lost) / sum(power) * np.asarray(power)
        return float(100 * np.sqrt(np.sum(deviation**2) * n_blocks / (n_blocks - 1)) / sum(power))

    def score_refitted(
        self, estimator: Any, X: Any, y: Any, fold: Fold
    ) -> tuple[float, np.ndarray]:
        """VAF and free run of a clone fitted on a fold; NaN if it cannot be fitted."""
        train, simulated = np.flatnonzero(fold.train), np.flatnonzero(fold.simulated)
        try:
            model = clone(estimator).fit(safe_indexing(X, train), safe_indexing(y, train))
        except RankDeficiencyError:
            return np.nan, np.empty(0)
        prediction = np.zeros(self.layout.n_rows)
        prediction[simulated] = model.predict(safe_indexing(X, simulated))
        return self.vaf(prediction, fold), prediction
