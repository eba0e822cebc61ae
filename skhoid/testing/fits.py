"""Checks of an effect in a model: it simulates, and a fit recovers its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.parameter import CoreKind
from ..effects.paths import Bias
from ..effects.record import Record
from ..model.cores import ARXCore, OperatorCore
from ..model.operator_regressor import OperatorRegressor
from ..model.simulated_arx import SimulatedARX
from ..model.simulator import Simulator
from ..text import Estimate
from .application import shown
from .descriptions import expect, name_of
from .records import DELAY, OPERATOR

ARX = {"a1": -1.6, "a2": 0.68, "b0": 0.05, "b1": 0.03}
NOISE = 0.02  # of the output's standard deviation
SURE = 5.0  # standard errors by which an estimate may be off
CLOSE = 0.03  # share of its value by which it may be off, however small its standard error


def _core(core: CoreKind) -> tuple[Any, list[float]]:
    if core == CoreKind.ARX:
        return ARXCore(2, 2, 10), list(ARX.values())
    return OperatorCore(DELAY), list(OPERATOR.values())


def _simulated(steps: Effects, values: Mapping[str, float], record: Record, core: CoreKind) -> Any:
    """Output of a core with effects, at values of the parameters of one of them."""
    model, own = _core(core)
    simulator = Simulator(model, steps, record)
    theta = [*own, *(values[n] for n in simulator.names[len(own) :])]
    return simulator.run(np.array(theta))


def check_simulation(effect: Effect, record: Record, core: CoreKind) -> None:
    who = name_of(effect)
    alone, beside = Effects.of(effect), Bias(level=0.1) + effect + Bias(level=0.2)
    expect(
        beside.names == ["bias", effect.name, "bias-2"] or effect.name == "bias",
        f"{who} + Bias() must give a composition; got {beside.names}.",
    )
    twice = effect + clone(effect)
    expect(
        twice.names == [effect.name, f"{effect.name}-2"],
        f"{who} twice must be called {effect.name} and {effect.name}-2; got {twice.names}.",
    )
    start = {k: v for k, v in effect.starts(record)[0].items() if not k.startswith("+")}
    values = {f"{n}__{k}": v for n in beside.names + twice.names for k, v in start.items()}
    for together in (alone, beside, twice):
        out = _simulated(together, values, record, core)
        expect(
            np.isfinite(out).all(),
            f"A simulation with {' + '.join(together.names)} is not finite at {shown(start)}: "
            "check the sign and the size of starts.",
        )


def check_recovery(effect: Effect, record: Record, core: CoreKind, truth: dict) -> None:
    """Simulate, estimate, compare."""
    who = name_of(effect)
    names = {p.name for p in effect.free}
    expect(
        truth.keys() == names,
        f"recovers must give a value for each estimated parameter: {sorted(names)}; got "
        f"{sorted(truth)}.",
    )
    quiet = _simulated(
        Effects.of(effect), {f"{effect.name}__{k}": v for k, v in truth.items()}, record, core
    )
    noise = np.random.default_rng(1).standard_normal(quiet.shape)
    output = quiet + NOISE * quiet.std() * noise
    X, y = _as_dataset(record, output)
    element = record.controlled_element
    if core == CoreKind.ARX:
        model: Any = SimulatedARX(2, 2, 10, effects=effect, controlled_element=element)
    else:
        free = effect.refusal(record, CoreKind.OPERATOR_FREE_DELAY) is None
        delay = None if free else DELAY
        model = OperatorRegressor(delay, effects=effect, controlled_element=element)
    fitted = model.fit(X, y)
    for key, value in truth.items():
        row = fitted.parameters_.loc[f"{effect.name}__{key}"]
        off = abs(row["value"] - value)
        expect(
            off <= max(SURE * np.nan_to_num(row["sd"]), CLOSE * abs(value), 1e-3),
            f"{who}: {key} was simulated as {value:.4g} and estimated as {Estimate.of(row)}. "
            "Give more starts, closer to usual values; set smooth = False if the output does not "
            "change smoothly with the parameters. Or the parameters cannot be told apart.",
        )


def _as_dataset(record: Record, output: np.ndarray) -> tuple[pd.DataFrame, pd.Series]:
    """X and y with the known samples of each run."""
    frames = []
    for j in range(record.n_runs):
        known = record.known[:, j]
        frame = pd.DataFrame({name: v[known, j] for name, v in record.channels.items()})
        frame["u"] = output[known, j]
        time = np.round(record.t[known, 0], 9)
        frame.index = pd.MultiIndex.from_arrays(
            [np.full(time.size, j), time], names=["run", "time"]
        )
        frames.append(frame)
    table = pd.concat(frames)
    return table.drop(columns="u"), table["u"]
