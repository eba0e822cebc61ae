"""Runs in which a channel was never recorded: no measurement, whatever the others hold."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from .layout import RunLayout


def empty_runs(layout: RunLayout, values: np.ndarray, columns: list[int]) -> dict[int, int]:
    """The first of the columns that is NaN in all rows of a run outside the run-in, by run."""
    last = layout.run_starts[1:] - 1
    missing = np.isnan(values[last][:, columns])
    if layout.trimmed is not None:
        missing |= layout.trimmed[last, None]
    found = {}
    for run in np.flatnonzero(missing.any(axis=1)):
        rows = slice(*layout.run_starts[run : run + 2])
        outside = ... if layout.trimmed is None else ~layout.trimmed[rows]
        for column in np.asarray(columns)[missing[run]]:
            part = values[rows, column][outside]
            if part.size and np.isnan(part).all():
                found[int(run)] = int(column)
                break
    return found


def rows_of_runs(layout: RunLayout, runs: Collection[int]) -> np.ndarray:
    """Mask of the rows of some runs, by their numbers."""
    chosen = np.zeros(len(layout.labels), dtype=bool)
    chosen[list(runs)] = True
    return np.repeat(chosen, np.diff(layout.run_starts))
