"""Tables of estimated parameters with standard errors and units, and their text."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from ..effects.composition import Effects
from ..effects.dimension import Dimension, S, checked
from ..text import Estimate
from .model import Model
from .simulator import Simulator

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
