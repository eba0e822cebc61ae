"""Cross-validation splits whose unit is the run."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
from sklearn.model_selection import GroupKFold, LeaveOneGroupOut, check_cv

from ...exceptions import RunCutWarning
from ...runs import RunLayout


@dataclass(frozen=True)
class Fold:
    """Rows to fit on, rows to score, and the rows to simulate: the whole runs that are scored."""

    train: np.ndarray
    test: np.ndarray
    simulated: np.ndarray


def folds_of(X: Any, y: Any, layout: RunLayout, cv: Any, groups: Any = None) -> list[Fold]:
    """Split rows by runs; a single run into halves, as the thesis does.

    A free run needs no measured output, so the model is simulated from the start of each run and
    scored in the rows of the fold: a fold that begins inside a run has no transient of its own.
    ``groups`` of rows take the place of runs.
    """
    rows = np.arange(layout.n_rows)
    run = layout.run_of(rows)
    kept = run if groups is None else _checked_groups(groups, layout.n_rows)
    several = len(layout.labels) > 1 or groups is not None
    if cv is None and not several:
        half = (layout.n_rows + 1) // 2
        splits = [(rows[:half], rows[half:])]
    else:
        if cv is None:
            splitter: Any = LeaveOneGroupOut()
        elif isinstance(cv, Integral) and several:
            splitter = GroupKFold(int(cv))
        else:
            splitter = check_cv(cv)
        with warnings.catch_warnings():
            # Splitters that do not use groups say so; the runs are offered to all alike.
            warnings.filterwarnings("ignore", message="The groups parameter is ignored")
            splits = list(splitter.split(rows[:, None], np.zeros(layout.n_rows), groups=kept))
        cut = [
            layout.labels[i]
            for train, test in splits
            for i in np.flatnonzero(_touched(train, run) & _touched(test, run))[:1]
        ]
        if cut:
            warnings.warn(
                f"The splits of cv={cv!r} cut run {cut[0]!r}: rows next to each other, which are "
                "nearly equal, stand on both sides. Runs are the unit of cross-validation: use "
                "LeaveOneGroupOut, GroupKFold, or cv=None.",
                RunCutWarning,
                stacklevel=6,
            )
    return [_fold(train, test, run) for train, test in splits]


def _checked_groups(groups: Any, n_rows: int) -> np.ndarray:
    """Groups as numbers of rows."""
    given = np.asarray(groups)
    if given.shape != (n_rows,):
        raise ValueError(
            f"groups has the shape {given.shape} and X has {n_rows} rows: give one group for each "
            'row, such as run_labels(X, level="subject").'
        )
    return np.unique(given, return_inverse=True)[1]


def _fold(train: np.ndarray, test: np.ndarray, run: np.ndarray) -> Fold:
    masks = np.zeros((2, run.size), dtype=bool)
    masks[0, train] = True
    masks[1, test] = True
    return Fold(masks[0], masks[1], _touched(test, run)[run])


def _touched(rows: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Whether each run has any of the rows."""
    return np.bincount(run[rows], minlength=int(run[-1]) + 1) > 0
