"""Cross-validation splits whose unit is the run."""

from __future__ import annotations

import reprlib
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.model_selection import GroupKFold, LeaveOneGroupOut, LeavePGroupsOut, check_cv
from sklearn.utils.metadata_routing import MetadataRouter, MethodMapping, process_routing

from .._sklearn import SharedDocs, raise_for_params, routing_enabled
from ..exceptions import (
    MissingDataWarning,
    NothingExplainedWarning,
    RunCutWarning,
    RunIndexError,
)
from ..preprocessing.gate import unmasked
from ..runs import RunLayout, check_alignment

# Splitters that use only groups get one row per run: with all rows, leaving out each run would cost
# rows times runs.
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

    def meets(self, rows: np.ndarray, of_runs: np.ndarray) -> bool:
        """Whether any row is in a mask, of which ``of_runs`` says the runs that have one there."""
        return bool((self.whole & of_runs).any()) or any(
            (rows[self.run_starts[run] : self.run_starts[run + 1]] & cut).any()
            for run, cut in self.cut.items()
        )

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


class SplitsRuns(SharedDocs):
    """A search whose ``fit`` takes groups and what its splitter requests, like GridSearchCV."""

    cv: Any

    __metadata_request__fit = {"groups": True}

    def get_metadata_routing(self) -> MetadataRouter:
        """Return which metadata ``fit`` takes and which it passes on to the splitter.

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
        if "sample_weight" in params:
            raise TypeError(
                f"{type(self).__name__} takes no sample_weight: it compares candidates on rows "
                "that count alike. Make y NaN in rows that shall not count, and fit the model "
                "found anew with weights."
            )
        given = params if groups is None else {"groups": groups, **params}
        if routing_enabled():
            given = dict(process_routing(self, "fit", **given).get("splitter", {}).get("split", {}))
        else:
            raise_for_params(params, self, "fit")
        numbers = _checked_groups(X, layout, given.get("groups", groups))
        return {**given, "groups": numbers if "groups" in given else None}

    def _doubt_best(self, vaf: float) -> None:
        """Warn of a choice among candidates of which the best explains nothing."""
        if vaf <= 0.0:
            warnings.warn(
                NothingExplainedWarning(
                    f"{type(self).__name__}: the best candidate has a VAF of {vaf:.1f} % on "
                    "held-out rows, where an output of zero has 0: it explains nothing, and what "
                    "was chosen means nothing.",
                    hint="Check that the inputs are what the output answers to, their signs and "
                    "units, and that means are removed; try longer delays, other orders and "
                    "fit_intercept=True.",
                ),
                stacklevel=4,
            )


def _splitter(cv: Any, several: bool = True) -> Any:
    if cv is None:
        return LeaveOneGroupOut()
    if isinstance(cv, Integral) and several:
        return GroupKFold(int(cv))
    if isinstance(cv, Iterable) and not isinstance(cv, str):
        cv = list(cv)
        for split in cv:
            if isinstance(split, str) or not np.iterable(split) or len(tuple(split)) != 2:
                raise ValueError(
                    f"cv holds {reprlib.repr(split)}, which is not a pair (training rows, test "
                    "rows); give pairs, a number of folds, or a splitter such as "
                    "LeaveOneGroupOut()."
                )
    return check_cv(cv)


def _check_rows(part: Any, n_rows: int) -> np.ndarray:
    """Rows of one side of a split, checked."""
    rows = np.asarray(part)
    if not rows.size:
        return np.zeros(0, dtype=np.int64)
    mask = rows.dtype.kind == "b" and rows.shape == (n_rows,)
    numbers = rows.dtype.kind in "iu" and rows.ndim == 1
    if not (mask or (numbers and -n_rows <= rows.min() and rows.max() < n_rows)):
        raise ValueError(
            f"A split of cv holds {reprlib.repr(part)}: rows must be whole numbers from 0 to "
            f"{n_rows - 1}, or a mask."
        )
    return rows


def make_folds(
    layout: RunLayout,
    cv: Any,
    routed: dict[str, Any],
    measured: np.ndarray,
    scored: np.ndarray | None = None,
) -> list[Fold]:
    """Split rows by runs, and a single run into halves, as the thesis does.

    A free run needs no measured output, so the model is simulated from the start of each run and
    scored in the rows of the fold: a fold that begins inside a run has no transient of its own.
    Groups of rows that are ``routed`` take the place of runs. Runs without a ``measured`` row are
    in no fold, unless a splitter of the user's own puts them there; folds without a ``scored``
    row (None: a measured one) are left out.
    """
    starts = layout.run_starts
    groups = routed["groups"]
    known = np.logical_or.reduceat(measured, starts[:-1])
    if not known.any():
        raise ValueError("No row is left to score: no run has both input and output measured.")
    several = known.sum() > 1 or groups is not None
    used = known | (not (cv is None or isinstance(cv, Integral)))
    of_run = np.arange(used.size) if groups is None else groups[starts[:-1]]
    splitter = _splitter(cv, several)
    if cv is None and not several:
        rows = np.flatnonzero(np.repeat(used, np.diff(starts)))
        half = (rows.size + 1) // 2
        folds = [Fold(RunRows.of(rows[:half], starts), RunRows.of(rows[half:], starts))]
    elif isinstance(splitter, COUNT_NO_ROWS):
        runs = np.flatnonzero(used)
        found = splitter.split(runs[:, None], **{**routed, "groups": of_run[runs]})
        folds = [Fold(*(_whole(runs[part], starts) for part in split)) for split in found]
    else:
        rows = np.flatnonzero(np.repeat(used, np.diff(starts)))
        kept = np.repeat(of_run, np.diff(starts))[rows]
        with warnings.catch_warnings():
            # Splitters that do not use groups say so; the runs are offered to all alike.
            warnings.filterwarnings("ignore", message="The groups parameter is ignored")
            found = splitter.split(rows[:, None], np.zeros(rows.size), **{**routed, "groups": kept})
            parts = [[rows[_check_rows(part, rows.size)] for part in split] for split in found]
        folds = [Fold(*(RunRows.of(part, starts) for part in split)) for split in parts]
        cut = [
            layout.labels[run]
            for fold in folds
            for run in np.flatnonzero(fold.train.runs & fold.test.runs)[:1]
        ]
        if cut:
            warnings.warn(
                f"The splits of cv={cv!r} cut run {cut[0]!r}: neighbouring rows, which are nearly "
                "equal, end up on both sides. Cross-validate by whole runs: use LeaveOneGroupOut, "
                "GroupKFold, or cv=None.",
                RunCutWarning,
                stacklevel=6,
            )
    return _with_scores(folds, measured, measured if scored is None else scored, layout)


def _whole(runs: np.ndarray, run_starts: np.ndarray) -> RunRows:
    whole = np.zeros(run_starts.size - 1, dtype=bool)
    whole[runs] = True
    return RunRows(run_starts, whole, {})


def _with_scores(
    folds: list[Fold], measured: np.ndarray, scored: np.ndarray, layout: RunLayout
) -> list[Fold]:
    """Folds that can be scored; that runs without any measurement are not, the fit has said."""
    starts = layout.run_starts
    of_runs = [(rows, np.logical_or.reduceat(rows, starts[:-1])) for rows in (measured, scored)]
    tests = [[fold.test.meets(*rows) for rows in of_runs] for fold in folds]
    left = [fold for fold, (_, can) in zip(folds, tests, strict=True) if can]
    if not left:
        raise ValueError(
            "No row is left to score in any fold: the run-in, the window and missing values "
            f"exclude all of them (X has n_samples = {layout.n_rows})."
        )
    unscored = [f for f, (some, can) in zip(folds, tests, strict=True) if some and not can]
    if unscored:
        row = int(np.flatnonzero(unscored[0].test.mask() & measured)[0])
        warnings.warn(
            f"{len(unscored)} of {len(folds)} folds are not scored, the first at "
            f"{layout.where(row)}: the run-in, the window and missing values exclude all their "
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
    given = np.asarray(unmasked(groups))
    if given.shape != (layout.n_rows,):
        raise ValueError(
            f"groups has the shape {given.shape} and X has {layout.n_rows} rows: give one group "
            'for each row, such as run_labels(X, level="subject").'
        )
    try:
        numbers, found = pd.factorize(given, sort=True)
    except TypeError as error:
        raise ValueError("groups holds labels that are neither numbers nor text.") from error
    labels = found.tolist()
    if (numbers < 0).any():
        raise ValueError(f"groups has no label at {layout.where(int(np.argmin(numbers)))}.")
    starts = layout.run_starts[:-1]
    first = np.repeat(numbers[starts], np.diff(layout.run_starts))
    if (numbers != first).any():
        row = int(np.argmax(numbers != first))
        run = layout.labels[int(layout.run_of(np.asarray(row)))]
        raise RunIndexError(
            f"Run {run!r} is in two groups: {labels[first[row]]!r}, and "
            f"{labels[numbers[row]]!r} from {layout.where(row)} on. Neighbouring rows are nearly "
            "equal, so a group must consist of whole runs: give each run one label, such as "
            'run_labels(X, level="subject").'
        )
    return numbers
