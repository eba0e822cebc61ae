"""Rows that a search leaves out of fits and scores, because control was lost in them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import ShortRunError, SlowClockWarning
from ..model import OperatorRegressor
from ..model.prepared import Prepared, check_rows
from ..preprocessing.gate import as_output, as_table
from ..recordings.loss_of_control import KEEP, KEEP_ROWS, ControlCheck, control_in
from ..runs.roles import OTHER, input_columns, role_of
from ..text import counted


def control_of(
    estimator: Any, X: Any, lost_control: str, domain: str | None = None
) -> ControlCheck:
    """Where control was lost in what a model is to be fitted on.

    Nowhere if rows are to be kept, or if the user says that it is a machine, which loses none.
    """
    if lost_control == KEEP or domain == "machine":
        return ControlCheck()
    X = as_table(X)
    X = X if hasattr(X, "columns") else np.asarray(X)
    roles, run = (getattr(estimator, name, None) for name in ("roles", "run"))
    if isinstance(estimator, OperatorRegressor):
        names = list(X.columns) if hasattr(X, "columns") else None
        inputs = input_columns(names, X.shape[1], estimator.inputs, run, roles)
        first = inputs[0] if names is None else names[inputs[0]]
        if role_of(first, roles) == OTHER:  # what an operator answers is the error
            roles = {**(roles or {}), first: "e"}
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
        kept.attrs = dict(y.attrs)
        return kept
    return np.where(lost, np.nan, as_output(y))


def without_rows(prepared: Prepared, rows: np.ndarray, settling: float) -> Prepared:
    """The data with some rows of X not known; refused where too few are left."""
    if not rows.any():
        return prepared
    grid, record = prepared.grid, prepared.record
    lost = prepared.columns.beside(rows if grid.rows is None else rows[grid.rows], fill=False)
    record = replace(record, known=record.known & ~lost, _derived={})
    try:
        check_rows(record, len(prepared.core.parameters), grid, settling)
    except ShortRunError as error:
        raise ShortRunError(
            f"{error} {counted(int(rows.sum()), 'row')} of X are left out because control was lost "
            "in them.",
            hint=f"{KEEP_ROWS}.",
            options=["lost_control"],
        ) from error
    return replace(prepared, record=record, measured=prepared.measured & ~lost)
