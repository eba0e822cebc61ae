"""Parameters of models as tables: estimates with standard errors and units, and values by hand."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..effects.composition import Effects
from ..effects.parameter import CoreKind, Dimension, S, checked
from ..parameters import NORMAL_95, Kind, ModelParameter, ParameterTable
from ..text import Estimate
from .model import Model
from .simulator import Simulator, list_own

if TYPE_CHECKING:
    from .estimator import Simulation

NO_INTERVALS: Mapping[str, tuple[float, float]] = MappingProxyType({})
# What a fit found at its own estimates, which other values do not have.
OF_ESTIMATE = ("loglik_", "bic_", "vaf_", "simulation_parameters_")


def parameter_table(
    simulator: Simulator,
    theta: np.ndarray,
    covariance: np.ndarray,
    units: dict[str, str | None],
    fixed: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]] = NO_INTERVALS,
) -> ParameterTable:
    """Values, standard errors and intervals of all parameters, including derived and fixed ones.

    Parameters that the data do not determine have no standard error; their interval is the whole
    range. ``intervals`` replace those of standard errors.
    """
    rows: list[ModelParameter] = []
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inside = (theta > simulator.low) & (theta < simulator.high)
    lost = inside & ~(sd <= simulator.high - simulator.low)
    ratios = {ratio.over: ratio for ratio in simulator.core.ratios}
    curves = tuple(f"{name}__" for name, effect in simulator.effects if effect.free_form)

    def derived(
        name: str, value: float, s: float, dimension: Dimension, meaning: str
    ) -> ModelParameter:
        unit = dimension.label(units)
        return set_estimate(
            ModelParameter(name, unit=unit, meaning=meaning, kind=Kind.DERIVED), value, s
        )

    for i, p in enumerate(simulator.parameters):
        kind = Kind.COEFFICIENT if p.name.startswith(curves) else Kind.ESTIMATED
        p = replace(p, unit=p.label(units), kind=kind)
        if lost[i]:
            rows.append(replace(p, value=float(theta[i]), low=p.min, high=p.max))
        else:
            rows.append(set_estimate(p, float(theta[i]), float(sd[i]), intervals.get(p.name)))
        ratio = ratios.get(p.name)
        if ratio is not None:
            k = simulator.names.index(ratio.under)
            under, over = float(theta[k]), float(theta[i])
            if under != 0.0:
                slope = np.array([-over / under**2, 1 / under])
                block = covariance[np.ix_([k, i], [k, i])]
                s = float(np.sqrt(np.maximum(slope @ block @ slope, 0.0)))
                row = derived(ratio.name, over / under, s, ratio.dimension, ratio.meaning)
                if lost[k] or lost[i]:
                    row = replace(row, sd=np.nan, low=-np.inf, high=np.inf)
                rows.append(row)
    for name, value in fixed.items():
        one = ModelParameter(name, unit=S.label(units), meaning="given")
        rows.append(one.given(value))
    for name, effect in simulator.effects:
        given = [spec for spec in effect.parameters if spec.name in effect.fixed]
        behind = simulator.effects.before(name, simulator.record.core == CoreKind.ARX)
        for one in list_own(name, effect, given, simulator.record, behind):
            one = replace(one, unit=one.label(units), meaning=f"{one.meaning} (given)")
            rows.append(one.given(effect.fixed[one.name.split("__", 1)[1]]))
        for key, number in derive_numbers(simulator, theta, covariance, name).items():
            rows.append(derived(f"{name}__{key}", *number))
    return ParameterTable(rows)


def set_estimate(
    parameter: ModelParameter,
    value: float,
    sd: float,
    interval: tuple[float, float] | None = None,
) -> ModelParameter:
    """A parameter at an estimate with its standard error, and the interval that follows from it."""
    low, high = interval or (value - NORMAL_95 * sd, value + NORMAL_95 * sd)
    return replace(parameter, value=value, sd=sd, low=low, high=high)


def derive_numbers(
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


def move_parameters(model: Any, values: Mapping[str, float], fixed_core: bool) -> Any:
    """A copy of a fitted model with parameters at other values.

    With ``fixed_core`` only parameters of effects may be moved.
    """
    simulation: Simulation = model.simulation_
    names = list(simulation.covariance.index)
    kept = {f"{name}__{key}" for name, one in simulation.effects for key in one.fixed}
    known = [n for n in [*names, *kept] if "__" in n or not fixed_core]
    by_hand = model.parameter_table_.checked(values, known)
    theta, predicting = simulation.theta.copy(), simulation.predicting
    predicting = None if predicting is None else predicting.copy()
    for name, value in by_hand.items():
        if name not in kept:
            theta[names.index(name)] = value
            if predicting is not None:
                predicting[names.index(name)] = value
    fixed = {name: value for name, value in by_hand.items() if name in kept}
    effects = Effects(
        [(name, one.with_choices(**select_own(name, fixed))) for name, one in simulation.effects]
    )
    found = dict(zip(names, theta.tolist(), strict=True))
    taken = copy.copy(model)
    for attribute in OF_ESTIMATE:
        vars(taken).pop(attribute, None)
    taken.effects_ = Effects(
        [
            (name, one.with_values({p.name: found[f"{name}__{p.name}"] for p in one.free}))
            for name, one in effects
        ]
    )
    taken.simulation_ = replace(simulation, theta=theta, effects=effects, predicting=predicting)
    new = {**found, **fixed, **derive_following(taken.simulation_, {**found, **fixed})}
    taken.parameter_table_ = model.parameter_table_.moved(new, by_hand)
    taken.parameters_ = taken.parameter_table_.estimates()
    return taken


def select_own(name: str, values: Mapping[str, float]) -> dict[str, float]:
    """Those of an effect, by their plain names."""
    start = f"{name}__"
    return {full.removeprefix(start): v for full, v in values.items() if full.startswith(start)}


def derive_following(simulation: Simulation, values: Mapping[str, float]) -> dict[str, float]:
    """What follows from values of parameters: ratios, and numbers derived by effects."""
    new = {}
    for ratio in simulation.spec.core.ratios:
        if values[ratio.under] != 0.0:
            new[ratio.name] = values[ratio.over] / values[ratio.under]
    for name, effect in simulation.effects:
        own = {**effect.fixed, **select_own(name, values)}
        for key, (value, _, _) in effect.derived({**values, **own}).items():
            new[f"{name}__{key}"] = value
    return new


WHY = (
    "In a closed loop the remnant returns in the error, and the fit of least simulation error "
    "follows it: trust the likelihood. Without a loop, the model lacks something that the two "
    "weigh differently."
)


def find_differing(likelihood: pd.DataFrame, least_error: pd.DataFrame) -> list[str]:
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


PREDICTING = (
    "Predictions and VAF are those of least simulation error, which is better by more than a point "
    "of VAF on the fitted rows; parameters, effects and compare keep to the likelihood."
)


def difference_notes(
    likelihood: pd.DataFrame, least_error: pd.DataFrame, predicting: bool = False
) -> list[str]:
    """Both estimates of each parameter that differs, and why, in a sentence; none if none does.

    ``predicting`` is whether the model predicts by those of least error.
    """
    names = find_differing(likelihood, least_error)
    said = [PREDICTING] if predicting else []
    if not names:
        return said
    pairs = [
        f"{name} = {Estimate.of(likelihood.loc[name])} by likelihood, "
        f"{Estimate.of(least_error.loc[name])} by least simulation error"
        for name in names
    ]
    differ = f"Two estimates differ by more than their uncertainty: {'; '.join(pairs)}. {WHY}"
    return [differ, *said]
