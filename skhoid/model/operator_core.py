"""Fitting an operator core without effects: its starts, and the smallest simulation error."""

from __future__ import annotations

import numpy as np

from ..effects.composition import Effects
from ..effects.record import Record
from .cores import OperatorCore
from .fitting import Criterion, minimise
from .model import Model, fit_core
from .simulator import Simulator


def fit_plain_operator(core: OperatorCore, record: Record, criterion: Criterion) -> Model:
    """An operator without effects; see ``Model.other_cores`` where it ends at a bound."""
    starts = operator_starts(core, record, criterion)
    model = fit_core(core, record, criterion, starts)
    simulator = model.simulator
    dynamic = np.array([name in core.ordinary for name in simulator.names])
    at_bound = (model.theta <= simulator.low) | (model.theta >= simulator.high)
    if (at_bound & dynamic).any():
        # A spurious lag and lead may compensate for what is missing: try without both, too.
        plain = {name: usual.centre for name, usual in core.usual.items()}
        plain |= dict.fromkeys(core.gains[1:], 0.0)
        without = np.array([plain.get(name, value) for name, value in model.values().items()])
        given = np.array([name in plain for name in simulator.names])
        fits = [
            minimise(simulator, criterion, start, fixed=fixed)
            for start, fixed in ((starts[0], dynamic), (without, given))
        ]
        model.other_cores = tuple(
            dict(zip(simulator.names, fit.theta.tolist(), strict=True)) for fit in fits
        )
    return model


def operator_starts(core: OperatorCore, record: Record, criterion: Criterion) -> np.ndarray:
    """Starts of an operator: gains by least squares on a grid of delay and neuromuscular system."""
    simulator = Simulator(core, Effects([]), record)
    delays = np.zeros(1)
    if core.fixed_delay is None:
        delays = np.maximum(np.arange(0.06, 0.62, 0.08), core.least)
    found = []
    for delay in delays:
        for omega in (5.0, 9.0, 15.0):
            for zeta in (0.25, 0.7):
                theta = np.array([1.0, 0.0, omega, zeta, delay][: len(core.parameters)])
                by_gain = []
                for gains in ((1.0, 0.0), (0.0, 1.0)):
                    theta[:2] = gains
                    by_gain.append(simulator.run(theta)[:: criterion.thin])
                a, b, y = criterion.whitened(np.stack([*by_gain, criterion.y]))
                solved = np.linalg.lstsq(np.stack([a, b], 1), y, rcond=None)[0]
                if solved[1] < 0:
                    solved = np.array([float(a @ y) / max(float(a @ a), 1e-300), 0.0])
                residual = y - solved[0] * a - solved[1] * b
                theta[:2] = solved
                found.append((float(residual @ residual), theta.copy()))
    found.sort(key=lambda item: item[0])
    return np.array([theta for _, theta in found[:4]])
