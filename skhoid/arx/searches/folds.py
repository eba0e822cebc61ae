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


def folds_of(X: Any, y: Any, layout: RunLayout, cv: Any) -> list[Fold]:
    """Split rows by runs; a single run into halves, as the thesis does.

    A free run needs no measured output, so the model is simulated from the start of each run and
    scored in the rows of the fold: a fold that begins inside a run has no transient of its own.
    """
    rows = np.arange(layout.n_rows)
    run = layout.run_of(rows)
    n_runs = len(layout.labels)
    if cv is None and n_runs == 1:
        half = (layout.n_rows + 1) // 2
        splits = [(rows[:half], rows[half:])]
    else:
        if cv is None:
            splitter: Any = LeaveOneGroupOut()
        elif isinstance(cv, Integral) and n_runs > 1:
            splitter = GroupKFold(int(cv))
        else:
            splitter = check_cv(cv)
        with warnings.catch_warnings():
            # Splitters that do not use groups say so; the runs are offered to all alike.
            warnings.filterwarnings("ignore", message="The groups parameter is ignored")
            splits = list(splitter.split(rows[:, None], np.zeros(layout.n_rows), groups=run))
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


def _fold(train: np.ndarray, test: np.ndarray, run: np.ndarray) -> Fold:
    masks = np.zeros((2, run.size), dtype=bool)
    masks[0, train] = True
    masks[1, test] = True
    return Fold(masks[0], masks[1], _touched(test, run)[run])


def _touched(rows: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Whether each run has any of the rows."""
    return np.bincount(run[rows], minlength=int(run[-1]) + 1) > 0
