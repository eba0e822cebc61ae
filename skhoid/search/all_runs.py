"""Figures of all runs, where a search looked for effects in some of very many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects.record import Record
from ..model.estimator import vaf_of_output
from ..model.extend import on_all_runs
from ..model.model import Model
from ..model.simulator import Simulator
from .judging import SearchStep
from .path import Search

Held = tuple[np.ndarray, np.ndarray]  # columns, and rows of these (n_samples, n_columns)


def held_columns(test: np.ndarray, columns: np.ndarray | None = None) -> Held:
    """What a mask of rows holds out, without columns of which it holds none."""
    some = np.flatnonzero(test.any(axis=0))
    return (some if columns is None else columns[some]), test[:, some]


def on_rows_of(record: Record, fitted: Model) -> Model:
    """The model fitted to all rows of a record, where a search fitted it to others.

    It looks at some of the runs, or takes noise out of the output.
    """
    return fitted if fitted.simulator.record.y is record.y else on_all_runs(fitted, record)


@dataclass(frozen=True)
class AllRuns:
    """A record of all runs, and what each fold of the search holds out of it.

    No fit of the search has seen rows that no fold holds out.
    """

    record: Record
    held: Sequence[Held]

    def judged(self, search: Search, step: SearchStep, model: Model) -> SearchStep:
        """A step with its model fitted to all runs, and all of them held out of the search's."""
        base, without = search.fitted_without_folds(model)
        prediction = self.prediction(base, without)
        parent = on_all_runs(step.parent, self.record)
        vaf = vaf_of_output(self.record, prediction)
        return replace(step, parent=parent, vaf=vaf, prediction=prediction)

    def prediction(self, model: Model, without: Sequence[np.ndarray]) -> np.ndarray:
        """Free runs of a model, and in rows of each fold with the parameters of ``without``."""
        core, effects = model.simulator.core, model.effects
        found = Simulator(core, effects, self.record).run(model.theta)
        for theta, (columns, rows) in zip(without, self.held, strict=True):
            held_out = Simulator(core, effects, self.record.part(columns, 1)).run(theta)
            found[:, columns] = np.where(rows, held_out, found[:, columns])
        return np.where(np.isfinite(found), found, 0.0)
