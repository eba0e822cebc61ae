"""Cross-validation splits whose unit is the run."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from sklearn.model_selection import GroupKFold, LeaveOneGroupOut, LeavePGroupsOut, check_cv

from ...exceptions import RunCutWarning
from ...runs import RunLayout

# Splitters that go by groups alone get a row for each run: with all rows, leaving each run out
# would take the rows times the runs.
COUNT_NO_ROWS = (LeaveOneGroupOut, LeavePGroupsOut)


@dataclass(frozen=True)
class RunRows:
    """Rows of runs: the runs taken as a whole, and the rows (masks) of those that are cut."""

    run_starts: np.ndarray
    whole: np.ndarray
    cut: dict[int, np.ndarray]

    @classmethod
    def of(cls, rows: np.ndarray, run_starts: np.ndarray) -> RunRows:
        mask = np.zeros(run_starts[-1], dtype=bool)
        mask[rows] = True
        counts = np.add.reduceat(mask, run_starts[:-1], dtype=np.int64)
        whole = counts == np.diff(run_starts)
        some = np.flatnonzero((counts > 0) & ~whole)
        cut = {int(run): mask[run_starts[run] : run_starts[run + 1]].copy() for run in some}
        return cls(run_starts, whole, cut)

    @property
    def runs(self) -> np.ndarray:
        """Whether each run has any of the rows."""
        runs = self.whole.copy()
        runs[list(self.cut)] = True
        return runs

    def of_run(self, run: int) -> np.ndarray:
        """Mask of the rows of a run."""
        n_rows = int(self.run_starts[run + 1] - self.run_starts[run])
        return self.cut.get(run, np.full(n_rows, self.whole[run]))

    def mask(self) -> np.ndarray:
        """Mask of all rows."""
        mask = np.repeat(self.whole, np.diff(self.run_starts))
        for run, rows in self.cut.items():
            mask[self.run_starts[run] : self.run_starts[run + 1]] = rows
        return mask


class Fold(NamedTuple):
    """Rows to fit on and rows to score; the runs of the latter are simulated as a whole."""

    train: RunRows
    test: RunRows


def folds_of(X: Any, y: Any, layout: RunLayout, cv: Any, groups: Any = None) -> list[Fold]:
    """Split rows by runs; a single run into halves, as the thesis does.

    A free run needs no measured output, so the model is simulated from the start of each run and
    scored in the rows of the fold: a fold that begins inside a run has no transient of its own.
    ``groups`` of rows take the place of runs.
    """
    starts = layout.run_starts
    several = len(layout.labels) > 1 or groups is not None
    if cv is None and not several:
        rows = np.arange(layout.n_rows)
        half = (layout.n_rows + 1) // 2
        return [Fold(RunRows.of(rows[:half], starts), RunRows.of(rows[half:], starts))]
    if cv is None:
        splitter: Any = LeaveOneGroupOut()
    elif isinstance(cv, Integral) and several:
        splitter = GroupKFold(int(cv))
    else:
        splitter = check_cv(cv)
    kept = layout.run_of(np.arange(layout.n_rows))
    if groups is not None:
        kept = _checked_groups(groups, layout.n_rows)
    of_run = kept[starts[:-1]]
    if isinstance(splitter, COUNT_NO_ROWS) and np.array_equal(
        np.repeat(of_run, np.diff(starts)), kept
    ):
        return [
            Fold(*(_whole(runs, starts) for runs in split))
            for split in splitter.split(of_run[:, None], groups=of_run)
        ]
    with warnings.catch_warnings():
        # Splitters that do not use groups say so; the runs are offered to all alike.
        warnings.filterwarnings("ignore", message="The groups parameter is ignored")
        folds = [
            Fold(*(RunRows.of(rows, starts) for rows in split))
            for split in splitter.split(kept[:, None], np.zeros(layout.n_rows), groups=kept)
        ]
    cut = [
        layout.labels[run]
        for fold in folds
        for run in np.flatnonzero(fold.train.runs & fold.test.runs)[:1]
    ]
    if cut:
        warnings.warn(
            f"The splits of cv={cv!r} cut run {cut[0]!r}: rows next to each other, which are "
            "nearly equal, stand on both sides. Runs are the unit of cross-validation: use "
            "LeaveOneGroupOut, GroupKFold, or cv=None.",
            RunCutWarning,
            stacklevel=6,
        )
    return folds


def _whole(runs: np.ndarray, run_starts: np.ndarray) -> RunRows:
    whole = np.zeros(run_starts.size - 1, dtype=bool)
    whole[runs] = True
    return RunRows(run_starts, whole, {})


def _checked_groups(groups: Any, n_rows: int) -> np.ndarray:
    """Groups as numbers of rows."""
    given = np.asarray(groups)
    if given.shape != (n_rows,):
        raise ValueError(
            f"groups has the shape {given.shape} and X has {n_rows} rows: give one group for each "
            'row, such as run_labels(X, level="subject").'
        )
    return np.unique(given, return_inverse=True)[1]
