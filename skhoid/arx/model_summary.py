"""Summaries of fitted ARX models, batch and recursive."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..preprocessing.base import as_fitted
from ..text import (
    ModelSummary,
    TextTable,
    estimates_table,
    grid_facts,
    number,
    quantity,
    signal_facts,
)
from .base import BaseARX
from .orders import Orders

if TYPE_CHECKING:
    from .batch import ARXRegressor
    from .recursive import RecursiveARX

JUDGE = (
    "Residual sd{} one step ahead. Judge a model by its free run, preferably on runs that were not "
    "fitted: summary(X, y)."
)
CLOSED_LOOP = (
    "In a closed loop, coloured remnant biases least squares; standard errors do not show this "
    "bias{}."
)
WHITE = "Standard errors assume a white equation error{}."


def batch_summary(model: ARXRegressor, *, hac: bool) -> ModelSummary:
    """Summary of an ARX model whose equation error was minimised."""
    n, p = model.n_rows_used_, len(model.coef_)
    facts = {"Model": orders_text(model.orders_), **signal_facts(model)}
    instrumental = bool(model.instruments_)
    if instrumental:
        facts["Method"] = "instrumental variables"
        facts["Instruments"] = ", ".join(model.instruments_)
    else:
        facts["Method"] = "ordinary least squares"
    facts["Rows"] = f"{n}" + (
        f" ({model.n_rows_missing_} missing)" if model.n_rows_missing_ else ""
    )
    facts["Runs"] = f"{model._n_runs}"
    facts |= grid_facts(model) | _delay(model)
    facts["Residual sd"] = _residual_sd(model)
    sse = model.noise_variance_ * max(n - p, 1)
    criteria = not instrumental and sse > 0
    if criteria:
        fit = n * np.log(sse / n)
        facts["AIC"], facts["BIC"] = f"{fit + 2 * p:.1f}", f"{fit + p * np.log(n):.1f}"
    facts["Largest |pole|"] = _largest_pole(model)
    if not (instrumental or hac) and p > 0 and sse > 0:
        facts["Condition"] = f"{_condition(model.covariance_):.3g} (scaled regressors)"
    notes = [
        "Standard errors allow for a coloured equation error (Newey and West)."
        if hac
        else WHITE.format(
            " after filtering by the remnant model"
            if instrumental
            else '; covariance="hac" allows for a coloured one'
        )
    ]
    if not instrumental:
        notes.append(CLOSED_LOOP.format('. method="iv" removes it'))
    notes.append(JUDGE.format(", AIC and BIC are" if criteria else " is"))
    if criteria:
        notes.append("AIC and BIC omit constants; compare them only on the same rows.")
    return ModelSummary(
        f"{type(model).__name__}: {_response(model)}",
        facts,
        estimates_table(model.parameters_),
        notes,
    )


def recursive_summary(model: RecursiveARX) -> ModelSummary:
    """Summary of a recursive model: its last parameters, and their path."""
    has_path = "coef_path_" in vars(model)
    smoothed = has_path and getattr(as_fitted(model), "smooth", False)
    facts = {"Model": orders_text(model.orders_), **signal_facts(model)}
    facts["Method"] = "recursive least squares" + (", path smoothed" if smoothed else "")
    facts["Memory"] = _memory(model)
    facts["Rows"] = f"{model.n_updates_} updates"
    if has_path:
        how = "averaged" if "coef_paths_" in vars(model) else "pooled"
        runs = len(model.run_labels_)
        facts["Runs"] = f"{runs}" + (f", {how}" if runs > 1 else "")
        if model.n_rows_missing_:
            facts["Missing"] = f"{model.n_rows_missing_} rows"
    facts |= grid_facts(model) | _delay(model)
    facts["Residual sd"] = _residual_sd(model)
    facts["Protection"] = f"forgetting held back at {model.n_held_} instants"
    facts["Largest |pole|"] = f"{_largest_pole(model)} at the end"
    notes = [
        WHITE.format(", and do not include the lag behind changing parameters"),
        CLOSED_LOOP.format(""),
        JUDGE.format(" is"),
    ]
    if not has_path:
        notes.append("partial_fit keeps no path: predictions use the last parameters.")
    elif smoothed:
        notes.append("The last parameters are not smoothed; the path is.")
    return ModelSummary(
        f"{type(model).__name__}: {_response(model)}",
        facts,
        estimates_table(model.parameters_, "Parameters at the end"),
        notes,
        [_path(model)] if has_path else [],
    )


def _response(model: BaseARX) -> str:
    return f"{model._output_name} from {', '.join(model.inputs_)}"


def orders_text(orders: Orders) -> str:
    nb, nk = (one_or_all(values) for values in (orders.nb, orders.nk))
    constant = ", intercept" if orders.intercept else ""
    return f"ARX, na = {orders.na}, nb = {nb}, nk = {nk}{constant}"


def _delay(model: BaseARX) -> dict[str, str]:
    nk = model.orders_.nk
    seconds = one_or_all([number(k * model.dt_) for k in nk])
    samples = "sample" if set(nk) == {1} else "samples"
    return {"Delay, nk": f"{one_or_all(nk)} {samples}, {seconds} s"}


def one_or_all(values: Iterable[Any]) -> str:
    listed = [str(value) for value in values]
    return listed[0] if len(set(listed)) == 1 else f"({', '.join(listed)})"


def _residual_sd(model: ARXRegressor | RecursiveARX) -> str:
    sd = float(np.sqrt(model.noise_variance_))
    return quantity(sd, model._units.get(model._output_name))


def _largest_pole(model: BaseARX) -> str:
    a = model.orders_.split(model.coef_)[0]
    largest = float(np.abs(np.roots([1.0, *a])).max(initial=0.0))
    return f"{largest:.4f}" + (" (unstable)" if largest >= 1.0 else "")


def _condition(covariance: np.ndarray) -> float:
    """Condition number of the regressors, each scaled to one."""
    sd = np.sqrt(np.diag(covariance))
    information = np.linalg.pinv(covariance / np.outer(sd, sd), hermitian=True)
    scale = np.sqrt(np.diag(information))
    return float(np.sqrt(np.linalg.cond(information / np.outer(scale, scale))))


def _memory(model: RecursiveARX) -> str:
    forgetting = model._forgetting
    factors = np.atleast_1d(model.forgetting_ if forgetting.nominal else forgetting.factors)
    if forgetting.nominal:
        return f"variable, λ = {factors.min():.6g} to {factors.max():.6g}"
    if forgetting.over_time:
        return f"given over time, λ = {factors.min():.6g} to {factors.max():.6g}"
    with np.errstate(divide="ignore"):
        horizons = 1.0 / (1.0 - factors[0])
    if horizons.size > 1:
        return f"N0 = ({', '.join(f'{h:.4g}' for h in horizons)}) samples"
    if np.isinf(horizons[0]):
        return "nothing is forgotten, λ = 1"
    seconds = number(float(horizons[0]) * model.dt_)
    return f"N0 = {horizons[0]:.4g} samples, {seconds} s (λ = {factors[0, 0]:.6g})"


def _path(model: RecursiveARX) -> TextTable:
    """Range of each parameter over time."""
    path, time = model.coef_path_, model.time_path_
    rows = []
    for name, values in zip(model.parameter_names_, path.T, strict=True):
        low, high = int(np.argmin(values)), int(np.argmax(values))
        rows.append(
            [name, number(float(values[0]))]
            + [text for i in (low, high) for text in (number(float(values[i])), f"{time[i]:.6g}")]
            + [number(float(values[-1]))]
        )
    return TextTable(
        f"Path over {time[0]:.6g} to {time[-1]:.6g} s",
        ["", "first", "min", "at (s)", "max", "at (s)", "last"],
        rows,
    )
