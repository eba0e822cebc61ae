"""Cross-validation splits whose unit is the run."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from sklearn.model_selection import GroupKFold, LeaveOneGroupOut, check_cv
from sklearn.utils.metadata_routing import MetadataRouter, MethodMapping, process_routing

from ..._sklearn import raise_for_params, routing_enabled
from ...exceptions import MissingDataWarning, RunCutWarning, RunIndexError
from ...runs import RunLayout, check_alignment


@dataclass(frozen=True)
class Fold:
    """Rows to fit on, rows to score, and the rows to simulate: the whole runs that are scored."""

    train: np.ndarray
    test: np.ndarray
    simulated: np.ndarray


class SplitsRuns:
    """A search whose ``fit`` takes groups, and what its splitter requests, as GridSearchCV does."""

    cv: Any

    __metadata_request__fit = {"groups": True}

    def get_metadata_routing(self) -> MetadataRouter:
        """Say which metadata ``fit`` takes, and which it passes on to the splitter.

        Returns
        -------
        routing : MetadataRouter
        """
        router = MetadataRouter(owner=self).add_self_request(self)
        if self.cv is None or isinstance(self.cv, Integral) or hasattr(self.cv, "split"):
            mapping = MethodMapping().add(caller="fit", callee="split")
            router.add(splitter=_splitter(self.cv), method_mapping=mapping)
        return router

    def _routed(
        self, X: Any, layout: RunLayout, groups: Any, params: dict[str, Any]
    ) -> dict[str, Any]:
        """What the splitter gets besides rows; groups are checked, and numbered by row."""
        given = params if groups is None else {"groups": groups, **params}
        if routing_enabled():
            given = dict(process_routing(self, "fit", **given).get("splitter", {}).get("split", {}))
        else:
            raise_for_params(params, self, "fit")
        numbers = _checked_groups(X, layout, given.get("groups", groups))
        return {**given, "groups": numbers if "groups" in given else None}


def _splitter(cv: Any, several: bool = True) -> Any:
    if cv is None:
        return LeaveOneGroupOut()
    return GroupKFold(int(cv)) if isinstance(cv, Integral) and several else check_cv(cv)


def folds_of(
    layout: RunLayout,
    cv: Any,
    routed: dict[str, Any],
    measured: np.ndarray,
    scored: np.ndarray | None = None,
) -> list[Fold]:
    """Split rows by runs; a single run into halves, as the thesis does.

    A free run needs no measured output, so the model is simulated from the start of each run and
    scored in the rows of the fold: a fold that begins inside a run has no transient of its own.
    Groups of rows that are ``routed`` take the place of runs. Runs without a ``measured`` row are
    in no fold, unless a splitter of the user's own puts them there; folds without a ``scored``
    row (None: a measured one) are left out.
    """
    rows = np.arange(layout.n_rows)
    run = layout.run_of(rows)
    groups = routed["groups"]
    known = np.bincount(run, measured) > 0
    if not known.any():
        raise ValueError("No row is left to score: no run has measurements of input and output.")
    several = known.sum() > 1 or groups is not None
    if cv is None or isinstance(cv, Integral):
        rows = rows[known[run]]
    if cv is None and not several:
        half = (rows.size + 1) // 2
        splits = [(rows[:half], rows[half:])]
    else:
        kept = (run if groups is None else groups)[rows]
        with warnings.catch_warnings():
            # Splitters that do not use groups say so; the runs are offered to all alike.
            warnings.filterwarnings("ignore", message="The groups parameter is ignored")
            found = _splitter(cv, several).split(
                rows[:, None], np.zeros(rows.size), **{**routed, "groups": kept}
            )
            splits = [(rows[train], rows[test]) for train, test in found]
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
    folds = [_fold(train, test, run) for train, test in splits]
    return _with_scores(folds, layout, measured, measured if scored is None else scored)


def _with_scores(
    folds: list[Fold], layout: RunLayout, measured: np.ndarray, scored: np.ndarray
) -> list[Fold]:
    """Folds that can be scored; that runs without any measurement are not, the fit has said."""
    left = [fold for fold in folds if scored[fold.test].any()]
    if not left:
        raise ValueError(
            "No row is left to score in any fold: the run-in, the window and missing values leave "
            f"out all of them (X has n_samples = {layout.n_rows})."
        )
    unscored = [fold for fold in folds if measured[fold.test].any() and not scored[fold.test].any()]
    if unscored:
        row = int(np.flatnonzero(unscored[0].test & measured)[0])
        warnings.warn(
            f"{len(unscored)} of {len(folds)} folds are not scored, first that of "
            f"{layout.where(row)}: the run-in, the window and missing values leave out all their "
            "rows.",
            MissingDataWarning,
            stacklevel=6,
        )
    return left


def _checked_groups(X: Any, layout: RunLayout, groups: Any) -> np.ndarray | None:
    """Groups as numbers of rows; each is made of whole runs."""
    if groups is None:
        return None
    check_alignment(X, groups, ("X", "groups"))
    given = np.asarray(groups)
    if given.shape != (layout.n_rows,):
        raise ValueError(
            f"groups has the shape {given.shape} and X has {layout.n_rows} rows: give one group "
            'for each row, such as run_labels(X, level="subject").'
        )
    numbers, found = pd.factorize(given, sort=True)
    labels = found.tolist()
    if (numbers < 0).any():
        raise ValueError(f"groups has no label in {layout.where(int(np.argmin(numbers)))}.")
    starts = layout.run_starts[:-1]
    first = np.repeat(numbers[starts], np.diff(layout.run_starts))
    if (numbers != first).any():
        row = int(np.argmax(numbers != first))
        run = layout.labels[int(layout.run_of(np.asarray(row)))]
        raise RunIndexError(
            f"Run {run!r} lies in two groups: {labels[first[row]]!r}, and "
            f"{labels[numbers[row]]!r} from {layout.where(row)} on. Rows of one run are nearly "
            "equal, so that a group is made of whole runs: give each run one label, such as "
            'run_labels(X, level="subject").'
        )
    return numbers


def _fold(train: np.ndarray, test: np.ndarray, run: np.ndarray) -> Fold:
    masks = np.zeros((2, run.size), dtype=bool)
    masks[0, train] = True
    masks[1, test] = True
    return Fold(masks[0], masks[1], _touched(test, run)[run])


def _touched(rows: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Whether each run has any of the rows."""
    return np.bincount(run[rows], minlength=int(run[-1]) + 1) > 0
