"""The parameters of any fitted estimator: estimates, standard errors and units."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from numbers import Real
from typing import Any, NamedTuple, TypeGuard

import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline

from ....interpret.arx_channel import is_arx
from ....interpret.conversion import FROM_POLES, UNITS, operator_parameters
from ....pipelines import taken_apart


class Row(NamedTuple):
    """An estimate; NaN where it, or its standard error, is not known."""

    parameter: str
    estimate: float
    se: float = np.nan
    unit: str = ""


def parameters_of(model: Any, vaf: float) -> list[Row]:
    """What searches chose, parameters of the model, and of the operator that it stands for.

    Of a recursive model they are those at the end. A model without parameters has its VAF.
    """
    rows = {row.parameter: row for row in _chosen(model)}
    searched = "delay" in rows or any(name.endswith(("nk", "delay")) for name in rows)
    table = getattr(taken_apart(model)[1], "parameters_", None)
    if isinstance(table, pd.DataFrame):
        for name, value, sd, unit in zip(
            table.index, table["value"], table["sd"], table["unit"], strict=True
        ):
            rows[str(name)] = Row(str(name), float(value), float(sd), "" if unit == "-" else unit)
    if is_arx(model):
        for row in _operator(model, searched):
            rows.setdefault(row.parameter, row)
    return list(rows.values()) or [Row("vaf", vaf, unit="%")]


def _chosen(estimator: Any) -> Iterator[Row]:
    """Numbers that searches chose, from the outermost in."""
    while True:
        for name, value in (getattr(estimator, "best_params_", None) or {}).items():
            if _is_number(value):
                yield Row(str(name), float(value))
        for name, unit in (("delay", "s"), ("memory_horizon", "samples")):
            value = getattr(estimator, f"best_{name}_", None)
            if _is_number(value):
                yield Row(name, float(value), unit=unit)
        if hasattr(estimator, "best_estimator_"):
            estimator = estimator.best_estimator_
        elif isinstance(estimator, Pipeline):
            estimator = estimator.steps[-1][1]
        else:
            return


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, (Real, np.number)) and not isinstance(value, (bool, np.bool_))


def _operator(model: Any, searched: bool) -> Iterator[Row]:
    """Parameters of the operator; none where orders, inputs or steps do not allow them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of real poles: their rows are NaN
        try:
            found = operator_parameters(model).iloc[-1]
        except (TypeError, ValueError):
            return
    # A delay that was given is no estimate.
    for name in (*FROM_POLES, *["tau_e"] * searched):
        yield Row(name, float(found[name]), float(found[f"sd_{name}"]), UNITS[name])


class Effect(NamedTuple):
    """A parameter of an effect that a search found; without a name where it found none."""

    effect: str
    row: Row
    verdict: str


def effects_of(model: Any) -> list[Effect]:
    """What a search for effects found; nothing of other estimators."""
    while not hasattr(model, "best_effects_"):
        if hasattr(model, "best_estimator_"):
            model = model.best_estimator_
        elif isinstance(model, Pipeline):
            model = model.steps[-1][1]
        else:
            return []
    parameters = parameters_of(model.best_estimator_, np.nan)
    found = []
    for effect in model.best_effects_:
        start = f"{effect}__"
        rows = [
            row._replace(parameter=row.parameter.removeprefix(start))
            for row in parameters
            if row.parameter.startswith(start)
        ]
        found += [Effect(effect, row, str(model.verdict_)) for row in rows or [Row("", np.nan)]]
    return found or [Effect("", Row("", np.nan), str(model.verdict_))]
