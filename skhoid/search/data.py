"""What a search is fitted to: data without lost control, runs to look at, and folds."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..arx.folds import make_folds
from ..effects.parameter import CoreKind
from ..effects.record import Record
from ..exceptions import ShortRunError, SlowClockWarning
from ..model import OperatorRegressor
from ..model.estimator import vaf_of_output
from ..model.extend import refit_on_all_runs
from ..model.fitting import some_runs
from ..model.model import Model
from ..model.prepared import Prepared, check_rows
from ..preprocessing.gate import as_output
from ..recordings.loss_of_control import (
    KEEP,
    KEEP_ROWS,
    LOST_ROWS,
    ControlCheck,
    control_check,
    control_in,
)
from ..runs.roles import OTHER, columns_by_role, input_columns, role_of
from ..text import counted
from .answering import prepare_answering
from .judges import HeldOutRows

GUARD = 5.0  # s beside held-out blocks of a single run
MOST_FOLDS = 20  # of a search in some of very many runs

Held = tuple[np.ndarray, np.ndarray]  # columns, and rows of these (n_samples, n_columns)


@dataclass(frozen=True)
class SearchData:
    """The data of a search before any effect is tried.

    ``some`` are the columns of the record in which effects are looked for (None: all), ``record``
    their data; ``held`` is then what each fold holds out of all columns.
    """

    prepared: Prepared
    control: ControlCheck
    some: np.ndarray | None
    record: Record
    folds: list[HeldOutRows]
    held: list[Held]

    @property
    def searched(self) -> Prepared:
        """The data in which effects are looked for."""
        return replace(self.prepared, record=self.record)

    def score_folds(self, prediction: np.ndarray) -> list[float]:
        """VAF in percent of an output of all columns, on what each fold holds out."""
        record, scores = self.prepared.record, []
        for columns, rows in self.held or [held_columns(fold.test) for fold in self.folds]:
            test = np.zeros_like(record.known)
            test[:, columns] = rows
            scores.append(vaf_of_output(replace(record, known=test), prediction))
        return scores

    @property
    def searched_runs(self) -> list[Any]:
        """Labels of the runs in which effects are looked for."""
        run_of = self.prepared.run_of_columns
        runs = np.unique(run_of if self.some is None else run_of[self.some])
        return [self.prepared.grid.layout.labels[run] for run in runs]


def prepare_data(
    model: Any, X: Any, y: Any, *, domain: str | None, lost_control: str
) -> tuple[Prepared, ControlCheck]:
    """The data of a model without stretches in which control was lost, and where these are."""
    prepared = prepare_answering(model, X, y, domain)
    roles = getattr(model, "roles", None)
    control = ControlCheck()
    person = prepared.core.kind != CoreKind.CONTROLLER and domain != "machine"
    if lost_control != KEEP and person:
        names = [prepared.names[i] for i in prepared.channels]
        first = names[list(prepared.roles).index(prepared.record.inputs[0])]
        own = roles_with_error(model, first, roles)
        channels = {
            role: prepared.table[:, prepared.channels[i]]
            for role, i in columns_by_role(names, own).items()
        }
        layout = prepared.grid.layout
        judged = None if layout.trimmed is None else ~layout.trimmed
        control = control_check(layout, channels, judged)
    lost = control.rows(prepared.grid.layout.n_rows)
    return without_rows(set_domain(prepared, domain, roles), lost, model.settling), control


def split_data(
    prepared: Prepared,
    control: ControlCheck,
    *,
    cv: Any,
    routed: dict[str, Any],
    max_rows: int | None,
) -> SearchData:
    """The data with the runs to look at, and the rows that each fold holds out of them."""
    some = None if max_rows is None else some_runs(prepared.record, max_rows)
    record = prepared.record if some is None else prepared.record.part(some, 1)
    folds, held = split_rows(prepared, cv, routed, some)
    return SearchData(prepared, control, some, record, folds, held)


def split_rows(
    prepared: Prepared, cv: Any, routed: dict[str, Any], some: np.ndarray | None
) -> tuple[list[HeldOutRows], list[Held]]:
    """Rows to hold out and to fit on, in ``some`` columns; and what is held out in all."""
    record, columns, known = prepared.record, prepared.columns, prepared.record.known
    groups = routed["groups"]
    run_of = prepared.run_of_columns
    if some is not None:
        known, run_of = known[:, some], run_of[some]
    runs = np.unique(run_of[known.any(axis=0)])
    if cv is None and groups is None and runs.size > 1:
        parts = runs if some is None else np.array_split(runs, min(MOST_FOLDS, runs.size))
        tests = [known & np.isin(run_of, part) for part in parts]
        folds = [HeldOutRows(t, known & ~t) for t in tests]
        return folds, [] if some is None else [held_columns(t, some) for t in tests]
    if cv is None and groups is None:
        return split_in_blocks(known, round(GUARD / record.dt)), []
    folds, held = [], []
    for fold in make_folds(prepared.grid.layout, cv, routed, prepared.known):
        rows = prepared.grid.thin_inputs(fold.test.mask())
        whole = columns.beside(rows, fill=False) & record.known
        test = whole if some is None else whole[:, some]
        if test.any():
            folds.append(HeldOutRows(test, known & ~test))
            if some is not None:
                held.append(held_columns(whole))
    return folds, held


def split_in_blocks(known: np.ndarray, guard: int) -> list[HeldOutRows]:
    """Three contiguous blocks of one run, with guards that are neither fitted nor held out."""
    folds = []
    rows = np.flatnonzero(known.any(axis=1))
    for block in np.array_split(rows, 3):
        test, train = np.zeros_like(known), known.copy()
        test[block] = known[block]
        train[max(block[0] - guard, 0) : block[-1] + guard + 1] = False
        folds.append(HeldOutRows(test, train))
    return folds


def held_columns(test: np.ndarray, columns: np.ndarray | None = None) -> Held:
    """What a mask of rows holds out, without columns of which it holds none."""
    some = np.flatnonzero(test.any(axis=0))
    return (some if columns is None else columns[some]), test[:, some]


def refit_on_rows(record: Record, fitted: Model) -> Model:
    """The model fitted to all rows of a record, where a search fitted it to others."""
    return fitted if fitted.simulator.record.y is record.y else refit_on_all_runs(fitted, record)


def set_domain(prepared: Prepared, domain: str | None, roles: Any) -> Prepared:
    """The data with their domain: the given one, or the one that core and roles imply."""
    record = prepared.record
    if domain is None:
        own = role_of(record.inputs[0], roles)
        loop = {"x", "f_t"} & {*prepared.roles.values()}
        answers = own in ("x", "f_t") or (own == "e" and bool(loop))
        person = record.core.is_operator or answers
        domain = "human" if person and record.core != CoreKind.CONTROLLER else "machine"
    return replace(prepared, record=replace(record, domain=domain))


def roles_with_error(model: Any, first: Any, roles: Any) -> Any:
    """Roles of columns, of which the first input of an operator is the error, whatever its name."""
    if isinstance(model, OperatorRegressor) and role_of(first, roles) == OTHER:
        return {**(roles or {}), first: "e"}
    return roles


def control_of(
    estimator: Any, X: Any, lost_control: str, domain: str | None = None
) -> ControlCheck:
    """Where control was lost in data; nowhere if rows are kept or it is said to be a machine's."""
    if lost_control == KEEP or domain == "machine":
        return ControlCheck()
    roles, run = (getattr(estimator, name, None) for name in ("roles", "run"))
    names = list(getattr(X, "columns", range(np.shape(X)[1])))
    if isinstance(estimator, OperatorRegressor):
        inputs = input_columns(names, len(names), estimator.inputs, run, roles)
        roles = roles_with_error(estimator, names[inputs[0]], roles)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SlowClockWarning)  # the fit says so
        return control_in(X, roles=roles, dt=getattr(estimator, "dt", None), run=run)


def without_output(y: Any, control: ControlCheck) -> Any:
    """The output, missing where control was lost; as it is where nothing was lost."""
    if not control.stretches:
        return y
    lost = control.rows(len(y))
    if isinstance(y, (pd.Series, pd.DataFrame)):
        kept = y.mask(lost)
        kept.attrs = {**y.attrs, LOST_ROWS: int(lost.sum())}
        return kept
    return np.where(lost, np.nan, as_output(y))


def without_rows(prepared: Prepared, rows: np.ndarray, settling: float) -> Prepared:
    """The data with some rows of X not known; refused where too few are left."""
    if not rows.any():
        return prepared
    grid, record = prepared.grid, prepared.record
    lost = prepared.columns.beside(rows if grid.rows is None else rows[grid.rows], fill=False)
    record = replace(record, known=record.known & ~lost, remembered={})
    try:
        check_rows(record, len(prepared.core.parameters), grid, settling)
    except ShortRunError as error:
        raise ShortRunError(
            f"{error} {counted(int(rows.sum()), 'row')} of X are left out because control was lost "
            "in them.",
            hint=f"{KEEP_ROWS}.",
            options=["lost_control"],
        ) from error
    measured, known = prepared.measured & ~lost, prepared.known & ~rows
    return replace(prepared, record=record, measured=measured, known=known)
