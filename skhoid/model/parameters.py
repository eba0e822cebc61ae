"""Parameters of models as tables: estimates with standard errors and units, and values by hand."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..effects.composition import Effects
from ..effects.parameter import Dimension, S, checked
from ..exceptions import did_you_mean
from ..text import Estimate
from .model import Model
from .simulator import Simulator

if TYPE_CHECKING:
    from .estimator import Simulation

NORMAL_95 = 1.96
NO_INTERVALS: Mapping[str, tuple[float, float]] = MappingProxyType({})


def parameter_table(
    simulator: Simulator,
    theta: np.ndarray,
    covariance: np.ndarray,
    units: dict[str, str | None],
    fixed: dict[str, float],
    intervals: Mapping[str, tuple[float, float]] = NO_INTERVALS,
) -> pd.DataFrame:
    """Values, standard errors and intervals of all parameters, including derived and fixed ones.

    Parameters that the data do not determine have no standard error; their interval is the whole
    range. ``intervals`` replace those of standard errors.
    """
    rows = []
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inside = (theta > simulator.low) & (theta < simulator.high)
    lost = inside & ~(sd <= simulator.high - simulator.low)
    ratios = {ratio.over: ratio for ratio in simulator.core.ratios}

    def add(name: str, value: float, s: float, dimension: Dimension, meaning: str) -> None:
        low, high = value - NORMAL_95 * s, value + NORMAL_95 * s
        rows.append((name, value, s, low, high, dimension.label(units), meaning))

    def add_lost(
        name: str,
        value: float,
        dimension: Dimension,
        meaning: str,
        span: tuple[float, float] = (-np.inf, np.inf),
    ) -> None:
        rows.append((name, value, np.nan, *span, dimension.label(units), meaning))

    curves = tuple(f"{name}__" for name, effect in simulator.effects if effect.free_form)
    for i, p in enumerate(simulator.parameters):
        if p.name.startswith(curves):
            continue  # coefficients of a curve, which ``effects_`` has
        if lost[i]:
            add_lost(p.name, float(theta[i]), p.dimension, p.spec.meaning, (p.low, p.high))
        else:
            add(p.name, float(theta[i]), float(sd[i]), p.dimension, p.spec.meaning)
            if p.name in intervals:
                rows[-1] = (*rows[-1][:3], *intervals[p.name], *rows[-1][5:])
        ratio = ratios.get(p.name)
        if ratio is not None:
            k = simulator.names.index(ratio.under)
            under, over = float(theta[k]), float(theta[i])
            if under != 0.0:
                slope = np.array([-over / under**2, 1 / under])
                block = covariance[np.ix_([k, i], [k, i])]
                s = float(np.sqrt(np.maximum(slope @ block @ slope, 0.0)))
                if lost[k] or lost[i]:
                    add_lost(ratio.name, over / under, ratio.dimension, ratio.meaning)
                else:
                    add(ratio.name, over / under, s, ratio.dimension, ratio.meaning)
    for name, value in fixed.items():
        add(name, value, 0.0, S, "given")
    for name, effect in simulator.effects:
        spec = {p.name: p for p in effect.parameters}
        for key, value in effect.fixed.items():
            dimension = spec[key].dimension_on(simulator.record, effect.place)
            add(f"{name}__{key}", value, 0.0, dimension, f"{spec[key].meaning} (given)")
        for key, number in derived_with_errors(simulator, theta, covariance, name).items():
            add(f"{name}__{key}", *number)
    table = pd.DataFrame(
        rows, columns=["parameter", "value", "sd", "low", "high", "unit", "meaning"]
    )
    return table.set_index("parameter")


def derived_with_errors(
    simulator: Simulator, theta: np.ndarray, covariance: np.ndarray, name: str
) -> dict[str, tuple[float, float, Dimension, str]]:
    """Numbers derived from those of an effect, with standard errors by linearisation."""
    effect = dict(simulator.effects.steps)[name]

    def at(point: np.ndarray) -> dict[str, tuple[float, Dimension, str]]:
        values = dict(zip(simulator.names, point.tolist(), strict=True))
        own = {k.split("__", 1)[1]: v for k, v in values.items() if k.startswith(f"{name}__")}
        return effect.derived({**values, **effect.fixed, **own})

    here = at(theta)
    at_bound = (theta <= simulator.low) | (theta >= simulator.high)
    known = np.flatnonzero(~at_bound)
    slopes: dict[str, np.ndarray] = {key: np.zeros(theta.size) for key in here}
    for i in known:
        h = 1e-6 * max(abs(theta[i]), 1e-6)
        moved = theta.copy()
        moved[i] += h
        for key, (value, _, _) in at(moved).items():
            slopes[key][i] = (value - here[key][0]) / h
    found = {}
    for key, (value, given, meaning) in here.items():
        dimension = checked(given, f"{type(effect).__name__}.derived, {key}: the dimension")
        felt = known[slopes[key][known] != 0.0]
        slope = slopes[key][felt]
        variance = float(slope @ covariance[np.ix_(felt, felt)] @ slope)
        found[key] = (value, float(np.sqrt(np.maximum(variance, 0.0))), dimension, meaning)
    return found


def arx_parameter_table(
    names: list[str], theta: np.ndarray, sd: np.ndarray, units: list[str]
) -> pd.DataFrame:
    """The same table for an ARX model fitted by least squares."""
    meaning = {"a": "of the output", "b": "of the input", "i": "constant"}
    columns = {
        "value": theta,
        "sd": sd,
        "low": theta - NORMAL_95 * sd,
        "high": theta + NORMAL_95 * sd,
        "unit": units,
        "meaning": [meaning[name[0]] for name in names],
    }
    return pd.DataFrame(columns, index=pd.Index(names, name="parameter"))


def covariance_frame(simulator: Simulator, covariance: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(covariance, index=simulator.names, columns=simulator.names)


def effects_with_values(model: Model) -> Effects:
    """The effects with their estimated values set."""
    values = model.values()
    done = []
    for name, effect in model.effects:
        found = {p.name: values[f"{name}__{p.name}"] for p in effect.free}
        done.append((name, effect.with_values(found)))
    return Effects(done)


def parameter_text(table: pd.DataFrame, prefix: str) -> str:
    """Estimated parameters of an effect as ``width = 0.3123 ± 0.0041 deg``."""
    names = [str(full) for full in table.index]
    return ", ".join(
        f"{name.removeprefix(f'{prefix}__')} = {Estimate.of(row)}"
        for name, (_, row) in zip(names, table.iterrows(), strict=True)
        if name.startswith(f"{prefix}__") and row["sd"] != 0.0
    )


# What a fit found at its own estimates, which other values do not have.
OF_ESTIMATE = ("loglik_", "bic_", "vaf_", "simulation_parameters_")


def moved(model: Any, values: Mapping[str, float], fixed_core: bool) -> tuple[Any, Simulation]:
    """A copy of a model with parameters at other values, and its simulation.

    With ``fixed_core`` only parameters of effects may be moved.
    """
    simulation: Simulation = model._simulation
    names = list(simulation.covariance.index)
    kept = {f"{name}__{key}" for name, one in simulation.effects for key in one.fixed}
    known = [n for n in [*names, *kept] if "__" in n or not fixed_core]
    theta = simulation.theta.copy()
    given: dict[str, float] = {}
    for name, value in values.items():
        checked_value(name, value, known, simulation.bounds)
        if name in kept:
            given[name] = float(value)
        else:
            theta[names.index(name)] = float(value)
    effects = Effects(
        [(name, one.with_choices(**own_of(name, given))) for name, one in simulation.effects]
    )
    found = dict(zip(names, theta.tolist(), strict=True))
    at = replace(simulation, theta=theta, effects=effects)
    taken = copy.copy(model)
    for attribute in OF_ESTIMATE:
        vars(taken).pop(attribute, None)
    taken.effects_ = Effects(
        [
            (name, one.with_values({p.name: found[f"{name}__{p.name}"] for p in one.free}))
            for name, one in effects
        ]
    )
    taken.parameters_ = table_of(model.parameters_, {**found, **given}, values, at)
    return taken, at


def own_of(name: str, values: Mapping[str, float]) -> dict[str, float]:
    """Those of an effect, by their plain names."""
    start = f"{name}__"
    return {full.removeprefix(start): v for full, v in values.items() if full.startswith(start)}


def checked_value(
    name: str, value: Any, known: list[str], bounds: Mapping[str, tuple[float, float]]
) -> None:
    """Refuse what is no parameter, and what is not possible for it."""
    if name not in known:
        raise ValueError(
            f"{name!r} is no parameter that can be moved. These can: {', '.join(known)}."
            f"{did_you_mean(name, known)}"
        )
    low, high = bounds[name]
    if not isinstance(value, Real) or not np.isfinite(float(value)):
        raise ValueError(f"{name} must be a finite number; got {value!r}.")
    if not low <= float(value) <= high:
        raise ValueError(
            f"{name} = {float(value):.6g} is outside its range of {low:.6g} to {high:.6g}: beyond "
            "it the model is not physical, or the effect is too small to matter."
        )


def table_of(
    table: pd.DataFrame, found: Mapping[str, float], moved_names: Any, simulation: Simulation
) -> pd.DataFrame:
    """The table of parameters with what was moved, which has no error, and what follows from it."""
    new = {name: found[name] for name in table.index if name in found}
    for ratio in simulation.spec.core.ratios:
        if ratio.name in table.index and found[ratio.under] != 0.0:
            new[ratio.name] = found[ratio.over] / found[ratio.under]
    for name, effect in simulation.effects:
        own = {**effect.fixed, **own_of(name, found)}
        for key, (value, _, _) in effect.derived({**found, **own}).items():
            new[f"{name}__{key}"] = value
    value = table["value"].to_numpy(copy=True)
    errors = {name: table[name].to_numpy(copy=True) for name in ("sd", "low", "high")}
    for row, name in enumerate(table.index):
        if name in new and (name in moved_names or new[name] != value[row]):
            value[row] = new[name]
            for column in errors.values():
                column[row] = np.nan
    return table.assign(value=value, **errors)


WHY = (
    "In a closed loop the remnant returns in the error, and the fit of least simulation error "
    "follows it: trust the likelihood. Without a loop, the model lacks something that the two "
    "weigh differently."
)


def that_differ(likelihood: pd.DataFrame, least_error: pd.DataFrame) -> list[str]:
    """Parameters of the core whose two estimates differ by more than their uncertainty allows.

    The 95 % interval of the difference is that of two independent estimates, which is too wide for
    estimates from the same data. A value at its bound counts as exact.
    """
    found = []
    for name in likelihood.index.intersection(least_error.index):
        one, other = likelihood.loc[name], least_error.loc[name]
        width = NORMAL_95 * np.hypot(_sd(one), _sd(other))
        if "__" not in name and width > 0.0 and abs(one["value"] - other["value"]) > width:
            found.append(name)
    return found


def _sd(row: pd.Series) -> float:
    at_bound = np.isnan(row["sd"]) and np.isnan(row["low"])
    return 0.0 if at_bound else float(row["sd"])


def difference_notes(likelihood: pd.DataFrame, least_error: pd.DataFrame) -> list[str]:
    """Both estimates of each parameter that differs, and why, in a sentence; none if none does."""
    names = that_differ(likelihood, least_error)
    if not names:
        return []
    pairs = [
        f"{name} = {Estimate.of(likelihood.loc[name])} by likelihood, "
        f"{Estimate.of(least_error.loc[name])} by least simulation error"
        for name in names
    ]
    return [f"Two estimates differ by more than their uncertainty: {'; '.join(pairs)}. {WHY}"]
