"""Many ARX candidates on the same rows: one triangle per run, small problems, and their VAF."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from .. import _kernels
from .._sklearn import safe_indexing
from ..exceptions import RankDeficiencyError, ShortRunError
from ..metrics import VAF_FLOOR, VAFScorer, scored_rows, scored_signals, vaf_of_rows, vaf_of_sums
from ..pipelines import final_step, raw_layout, reach_model, trimmed_rows
from ..preprocessing.base import RowPreservingTransformer
from ..preprocessing.gate import AS_GIVEN, as_output
from ..preprocessing.grid import HeldInputs, ModelGrid
from .base import BOUND, BaseARX, check_lengths, check_row_count
from .batch import ARXRegressor
from .folds import Fold, RunRows, make_folds
from .least_squares import Triangle, solutions
from .orders import Orders, regressor_blocks, whole_number


@dataclass(frozen=True)
class FittedCandidates:
    """Coefficients of candidates, by part of the data that they were fitted on.

    ``a`` has the shape (parts, lags, candidates), ``b`` (parts, inputs, lags, candidates) and
    ``constant`` (parts, candidates), all with zeros where a candidate has fewer than others;
    ``nk`` has the shape (inputs, candidates). ``known`` is False where regressors are dependent.
    """

    a: np.ndarray
    b: np.ndarray
    constant: np.ndarray
    nk: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, orders: list[Orders], found: list[np.ndarray]) -> FittedCandidates:
        """Line up the coefficients of each candidate, of shape (parts, n_params)."""
        parts, n, n_inputs = len(found[0]), len(orders), len(orders[0].nb)
        a = np.zeros((parts, max(o.na for o in orders), n))
        b = np.zeros((parts, n_inputs, max(max(o.nb) for o in orders), n))
        constant = np.zeros((parts, n))
        for i, (o, theta) in enumerate(zip(orders, found, strict=True)):
            a[:, : o.na, i] = theta[:, : o.na]
            at = o.na
            for j, nb in enumerate(o.nb):
                b[:, j, :nb, i] = theta[:, at : at + nb]
                at += nb
            if o.intercept:
                constant[:, i] = theta[:, at]
        known = ~np.isnan(np.column_stack([theta[:, 0] for theta in found]))
        return cls(a, b, constant, np.array([o.nk for o in orders]).T, known)

    @property
    def n_candidates(self) -> int:
        return self.known.shape[1]

    def simulate(self, part: int, some: slice, grid: ModelGrid, inputs: np.ndarray) -> np.ndarray:
        """Free runs from rest on a grid, one in each column."""
        a, b, constant, nk = (
            np.ascontiguousarray(values[..., some])
            for values in (self.a[part], self.b[part], self.constant[part], self.nk)
        )
        reach = int(nk.max()) + b.shape[1]
        free = np.empty((grid.n_rows, constant.size))
        for begin, end, past in zip(grid.begin, grid.end, grid.past, strict=True):
            behind_zeros = np.zeros((len(nk), reach + end - past))
            behind_zeros[:, reach:] = inputs[past:end].T
            first = reach + begin - past
            _kernels.arx.free_runs(behind_zeros, first, a, b, nk, constant, BOUND, free[begin:end])
        return free


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
        data, self._hold = self._model.read_candidates(X, y)
        self.grid, self._raw_inputs, self.output = data.grid, data.inputs, data.output
        self.known = data.known
        self.dt = self.grid.dt
        self.n_runs = len(self.grid.layout.labels)

    @cached_property
    def inputs(self) -> HeldInputs:
        """Inputs to simulate from."""
        return self._hold()

    def set_candidates(self, candidates: list[dict[str, Any]], *, check: bool) -> None:
        """Take candidates ``{"na": ..., "nb": ..., "nk": ...}``; ``check`` that runs suffice."""
        self.candidates = candidates
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
        if check:
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
        """Factorise the rows whose lags all lie in each of several parts of the data, and all."""
        belongs = np.array([rows.whole for rows in training])
        _, unit_of = np.unique(belongs, axis=1, return_inverse=True)
        unit_of = unit_of.ravel()  # NumPy 2.0 keeps a second axis
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

    def one_step_losses(self, triangle: Triangle) -> np.ndarray:
        """Mean squared one-step errors (Eq. 24); NaN where regressors are linearly dependent."""
        losses = []
        for orders in self.orders:
            small = triangle.subset(self.columns(orders))
            dependent = len(small.null_space()) > 0
            losses.append(np.nan if dependent else small.rss / triangle.n_rows)
        return np.array(losses)

    def impulse_losses(self) -> np.ndarray:
        """How unlikely each delay is, by impulse responses of any form that begin there.

        -2 ln of the marginal likelihood, per row, of y = sum g_k x(t - k) + 1/D n, with a D of
        ``NOISE_LAGS`` coefficients and a prior of smooth, decaying (D g)_k (kernel "TC", whose size
        and decay are the likeliest; Chen, Ohlsson and Ljung 2012).
        """
        some = self.orders[0]
        nk = np.array([orders.nk for orders in self.orders])
        low, high = nk.min(axis=0), nk.max(axis=0)
        begin, end = self.grid.begin[self.grid.measured], self.grid.end[self.grid.measured]
        rows = int(np.maximum(end - begin - high.max(), 0).sum())
        lags = max(min(RESPONSE_LAGS, rows // (4 * low.size) - NOISE_LAGS), 1)
        orders = Orders.of(NOISE_LAGS, (high - low + lags).tolist(), low.tolist(), low.size)
        check_lengths(self.grid, orders)
        blocks = regressor_blocks(self.output, self._raw_inputs, begin, end, orders)
        ones = (np.column_stack([np.ones(len(t)), t])[:, not some.intercept :] for t, *_ in blocks)
        known = NOISE_LAGS + some.intercept
        whole = Triangle.of_blocks(
            map(np.asfortranarray, ones), orders.n_params + 1 + some.intercept
        )
        check_row_count(whole.n_rows, orders.n_params + 2, self.grid)
        R = whole.R[known:, known:]
        size = np.repeat(
            [np.sqrt(np.mean(R[:, a:b] ** 2)) for a, b in pairwise([0, *np.cumsum(orders.nb)])],
            orders.nb,
        )
        R = np.column_stack([R[:, :-1] / np.where(size > 0, size, 1.0), R[:, -1]])
        first = np.cumsum([0, *orders.nb[:-1]])
        losses = []
        for delays in nk:
            columns = np.concatenate([np.arange(lags) + f for f in first + delays - low])
            losses.append(
                min(
                    _unlikelihood(R, columns, decay, lags, whole.n_rows - known) for decay in DECAYS
                )
            )
        return np.array(losses)

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
                "or smaller na, nb and nk.",
                options=["na", "nb", "nk"],
            )
        return reduce(Triangle.merged, pieces)


NOISE_LAGS = 10  # of D
RESPONSE_LAGS = 50  # of the impulse response, after its delay
DECAYS = 1 - np.geomspace(0.01, 0.6, 8)  # of the variance of a coefficient, by sample
SIZES = np.geomspace(1e-4, 1e6, 31)  # of the first one's variance, to that of the noise


def _unlikelihood(
    R: np.ndarray, columns: np.ndarray, decay: float, lags: int, n_rows: int
) -> float:
    """-2 ln of the marginal likelihood per row, of the likeliest size of the response."""
    variance = decay ** np.arange(1, lags + 1)
    kernel = np.minimum.outer(variance, variance)
    root = np.kron(np.eye(columns.size // lags), np.linalg.cholesky(kernel))
    U, sizes, _ = np.linalg.svd(R[:, columns] @ root, full_matrices=False)
    output = R[:, -1]
    along = (U.T @ output) ** 2
    beside = max(float(output @ output) - float(along.sum()), 0.0)
    more = 1 + np.outer(SIZES, sizes**2)
    squares = np.maximum(beside + (along / more).sum(axis=1), np.finfo(float).tiny)
    return float(np.min(np.log(squares / n_rows) + np.log(more).sum(axis=1) / n_rows))


N_BLOCKS = 8  # of the rows of a single fold, for a standard error


class Validation:
    """Scores candidates on the folds, in the rows that the scorer and the run-in leave.

    ``known`` are the rows with an output, of runs whose inputs were recorded.
    """

    folds: list[Fold]

    def __init__(
        self, estimator: Any, X: Any, y: Any, known: np.ndarray, scorer: VAFScorer
    ) -> None:
        scorer.check_for_search()
        self.layout = raw_layout(estimator, X, dt=scorer.dt, run=scorer.run)
        self.y = as_output(y, dtypes=AS_GIVEN)
        self.known = known
        self.scorer = scorer
        self.keep = known & scored_rows(self.layout, scorer.run_in, scorer.window)
        self.keep &= ~trimmed_rows(estimator, X)

    def split(self, cv: Any, routed: dict[str, Any]) -> list[Fold]:
        """Make the folds."""
        return make_folds(self.layout, cv, routed, self.known, self.keep)

    def score_together(
        self, table: CandidateTable, models: FittedCandidates, number: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """VAF and its standard error of all candidates, fitted on the training rows of a fold."""
        test = self.folds[number].test
        runs = np.flatnonzero(test.runs).tolist()
        rows = [self._scored(run, test.of_run(run)) for run in runs]
        ends = np.cumsum([some.size for some in rows])
        n_blocks = self._n_blocks
        sizes = [block.size for block in np.array_split(np.empty(ends[-1]), n_blocks)]
        edges = np.cumsum(sizes)[:-1]
        power = np.zeros((len(runs), n_blocks))
        lost = np.zeros((len(runs), n_blocks, models.n_candidates))
        for i, (run, some) in enumerate(zip(runs, rows, strict=True)):
            cuts = np.clip(edges - (ends[i] - some.size), 0, some.size)
            measured = self.y[self.layout.run_starts[run] + some].astype(np.float64)
            centered = self.scorer.centered and some.size
            signal = measured - measured.mean() if centered else measured
            power[i] = [np.sum(block**2) for block in np.split(signal, cuts)]
            at = 0
            for free in table.simulate(models, number, run):
                error = measured[:, None] - free[some]
                columns = slice(at, at + free.shape[1])
                for block, part in enumerate(np.split(error, cuts)):
                    lost[i, block, columns] = np.einsum("tm,tm->m", part, part)
                at = columns.stop
        scored = np.array([some.size > 0 for some in rows])
        vaf = vaf_of_sums(lost.sum(axis=1), power.sum(axis=1), scored, self.scorer.average)
        errors = _standard_errors(lost.sum(axis=0), power.sum(axis=0))
        known = models.known[number]
        return np.where(known, vaf, np.nan), np.where(known, errors, np.nan)

    @property
    def _n_blocks(self) -> int:
        """Several folds have a spread of their own."""
        return N_BLOCKS if len(self.folds) == 1 else 1

    def _scored(self, run: int, mask: np.ndarray) -> np.ndarray:
        """Rows of a run, counted from its first, that are scored."""
        rows = slice(*self.layout.run_starts[run : run + 2].tolist())
        return np.flatnonzero(self.keep[rows] & mask)

    def score_refitted(self, estimator: Any, X: Any, y: Any, fold: Fold) -> tuple[float, float]:
        """The same of a single candidate, by a clone that is fitted on a fold."""
        test, layout = fold.test, self.layout
        train = np.flatnonzero(fold.train.mask())
        simulated = np.flatnonzero(np.repeat(test.runs, np.diff(test.run_starts)))
        try:
            model = clone(estimator).fit(safe_indexing(X, train), safe_indexing(y, train))
        except RankDeficiencyError:
            return np.nan, np.nan
        prediction = np.zeros(layout.n_rows)
        prediction[simulated] = model.predict(safe_indexing(X, simulated))
        keep, scorer = self.keep & test.mask(), self.scorer
        measured = self.y.astype(np.float64, copy=False)
        vaf = vaf_of_rows(measured, prediction, keep, layout, scorer.average, scorer.centered)
        signal, error, _ = scored_signals(measured, prediction, keep, layout, scorer.centered)
        lost, power = (
            np.array([np.sum(block**2) for block in np.array_split(values, self._n_blocks)])
            for values in (error, signal)
        )
        return vaf, float(_standard_errors(lost[:, None], power)[0])


def _standard_errors(lost: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Standard errors of VAFs from the spread over blocks of rows, of squares by block.

    A ratio estimator; NaN for bad models, and of a single block.
    """
    n_blocks, total = len(power), power.sum()
    if n_blocks == 1:
        return np.full(lost.shape[1], np.nan)
    lost = np.where(lost.sum(axis=0) > -VAF_FLOOR * total, np.nan, lost)
    deviation = lost - lost.sum(axis=0) / total * power[:, None]
    return 100 * np.sqrt(np.sum(deviation**2, axis=0) * n_blocks / (n_blocks - 1)) / total


class Evaluated(NamedTuple):
    """What was found about candidates.

    ``losses`` are mean squared one-step errors, on ``n_rows`` rows; ``scores`` VAFs on each fold,
    of shape (n_candidates, n_folds), and ``within`` their standard errors; ``data`` X and y.
    """

    table: CandidateTable
    data: tuple[Any, Any]
    losses: np.ndarray
    n_params: np.ndarray
    n_rows: int
    scores: np.ndarray
    within: np.ndarray

    @property
    def candidates(self) -> list[dict[str, Any]]:
        return self.table.candidates


def evaluated(
    variant: Any,
    X: Any,
    y: Any,
    table: CandidateTable,
    validation: Validation | None,
    n_jobs: int | None,
) -> Evaluated:
    """One-step losses of all candidates and, with a validation, their VAF on each fold."""
    in_threads = Parallel(n_jobs=n_jobs, prefer="threads")
    folds = [] if validation is None else validation.folds
    same_runs = validation is None or np.array_equal(
        table.grid.layout.run_starts, validation.layout.run_starts
    )
    if has_fast_path(variant) and same_runs:
        scores = np.empty((2, 0, len(table.orders)))
        if validation is None:
            whole = table.whole()
        else:
            parts, whole = table.triangles([fold.train for fold in folds])
            models = table.fitted(parts)
            score = delayed(validation.score_together)
            scores = np.swapaxes(
                in_threads(score(table, models, i) for i in range(len(parts))), 0, 1
            )
        losses = table.one_step_losses(whole)
        fails = np.isnan(scores[0]).all(axis=1)
        if fails.any() and not np.isnan(losses).all():
            rows = np.flatnonzero(folds[int(np.argmax(fails))].train.mask())
            _say_why(with_orders(variant, **table.candidates[0]), X, y, rows)
        n_params = np.array([orders.n_params for orders in table.orders])
        return Evaluated(table, (X, y), losses, n_params, whole.n_rows, scores[0].T, scores[1].T)

    def one_by_one(candidate: dict[str, Any]) -> tuple[np.ndarray, float, np.ndarray]:
        model = with_orders(variant, **candidate)
        scored = np.empty((0, 2))
        if validation is not None:
            scored = np.array([validation.score_refitted(model, X, y, fold) for fold in folds])
        try:
            last, passed_on = reach_model(model.fit(X, y), X)
        except RankDeficiencyError:
            return scored, np.nan, np.empty(0)
        return scored, last.orders_.n_params, last.one_step_errors(passed_on, y)

    found = in_threads(delayed(one_by_one)(c) for c in table.candidates)
    fitted = [~np.isnan(errors) for *_, errors in found if errors.size]
    known = np.logical_and.reduce(fitted) if fitted else np.empty(0, dtype=bool)
    losses = np.array([np.mean(e[known] ** 2) if e.size else np.nan for *_, e in found])
    scores, n_params = np.array([f[0] for f in found]), np.array([float(f[1]) for f in found])
    n_rows = int(np.sum(known))
    return Evaluated(table, (X, y), losses, n_params, n_rows, scores[..., 0], scores[..., 1])


def _say_why(model: Any, X: Any, y: Any, rows: np.ndarray) -> None:
    """Raise what no candidate can be fitted for to the rows that a fold leaves."""
    try:
        model.fit(safe_indexing(X, rows), safe_indexing(y, rows))
    except RankDeficiencyError as error:
        raise RankDeficiencyError(
            f"On rows {rows[0] + 1} to {rows[-1] + 1} of {len(X)}, on which one fold fits: "
            f"{error.message} Leave out rows in which nothing happens, or choose other folds.",
            hint=error.hint,
            options=error.options,
        ) from error
