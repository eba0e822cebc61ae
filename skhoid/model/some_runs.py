"""A few of many runs, on which minima are sought before all runs decide where they are.

From many starting points, fits of all runs would mostly repeat what a few runs already show. The
final estimate is that of all runs: from the minimum of the few, the last iterations use all.
"""

from __future__ import annotations

import numpy as np

from ..effects.record import Record
from .fitting import Criterion, minimise
from .jumps import searched
from .model import Model
from .simulator import Simulator

MOST_ROWS = 200_000  # known samples, up to which all runs are taken
SIZES = (0.04, 0.013, 0.004)  # steps of a pattern search, relative


def some_runs(record: Record, most: int) -> np.ndarray | None:
    """Columns spread evenly over a record, which together have at most so many known samples.

    At least two; None where all have no more.
    """
    known = record.known.sum(axis=0)
    if known.sum() <= most:
        return None
    columns = np.flatnonzero(known)
    count = min(max(2, int(most / known[columns].mean())), columns.size)
    if count == columns.size:
        return None
    return columns[np.round(np.linspace(0, columns.size - 1, count)).astype(int)]


def record_of_some(record: Record) -> Record | None:
    """The record of some runs with ``MOST_ROWS``; None where these are all runs."""
    columns = some_runs(record, MOST_ROWS)
    return None if columns is None else record.part(columns, 1)


def on_all_runs(model: Model, record: Record) -> Model:
    """A model of some runs of a record, at the minimum of the simulation error of all of them."""
    simulator = Simulator(model.simulator.core, model.effects, record)
    criterion = Criterion(record)
    found = Model(simulator, minimise(simulator, criterion, model.theta), model.other_cores)
    for name, effect in simulator.effects:
        if not effect.smooth:
            found = searched(found, name, criterion, SIZES)
    return found
