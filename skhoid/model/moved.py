"""A fitted model with some of its parameters moved by hand: ``with_parameters``."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..effects.composition import Effects
from ..exceptions import did_you_mean

if TYPE_CHECKING:
    from .base import Simulation

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
