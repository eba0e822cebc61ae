"""The VAF of candidates on the runs that were held out."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import clone

from ..._sklearn import safe_indexing
from ...exceptions import RankDeficiencyError
from ...metrics import VAF_FLOOR, VAFScorer, scored_rows, scored_signals, vaf_of_rows, vaf_of_sums
from ...pipelines import raw_layout, trimmed_rows
from ...preprocessing.gate import AS_GIVEN, as_output
from .candidates import CandidateTable
from .fitted_candidates import FittedCandidates
from .folds import Fold, folds_of

N_BLOCKS = 8  # of the rows of a single fold, for a standard error


class Validation:
    """Scores candidates on the folds, in the rows that the scorer and the run-in leave.

    ``known`` are the rows with an output, of runs whose inputs were recorded.
    """

    folds: list[Fold]

    def __init__(
        self, estimator: Any, X: Any, y: Any, known: np.ndarray, scorer: VAFScorer
    ) -> None:
        if scorer.rate == "model":
            raise ValueError(
                "A search scores at the full rate; VAFScorer(rate='model') cannot choose between "
                "models."
            )
        self.layout = raw_layout(estimator, X, dt=scorer.dt, run=scorer.run)
        self.y = as_output(y, dtypes=AS_GIVEN)
        self.known = known
        self.scorer = scorer
        self.keep = known & scored_rows(self.layout, scorer.run_in, scorer.window)
        self.keep &= ~trimmed_rows(estimator, X)

    def split(self, cv: Any, routed: dict[str, Any]) -> None:
        """Make the folds."""
        self.folds = folds_of(self.layout, cv, routed, self.known, self.keep)

    def goes_by_runs_of(self, table: CandidateTable) -> bool:
        """Whether the folds take the same rows for runs as the model."""
        return np.array_equal(table.grid.layout.run_starts, self.layout.run_starts)

    def score_together(
        self, table: CandidateTable, models: FittedCandidates, number: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """VAF and its standard error of all candidates, fitted on the training rows of a fold.

        NaN of candidates that could not be fitted.
        """
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
            signal = self._levelled(measured)
            power[i] = [np.sum(block**2) for block in np.split(signal, cuts)]
            at = 0
            for free in table.simulate(models, number, run):
                error = self._levelled(measured[:, None] - free[some])
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

    def _levelled(self, values: np.ndarray) -> np.ndarray:
        return values - values.mean(axis=0) if self.scorer.centered and len(values) else values

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
