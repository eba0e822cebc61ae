"""Fitting an ARX core by its simulation error, and forecasts with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from ..effects.composition import Effects
from ..effects.record import Record
from .arx_starts import find_arx_starts, list_spread_starts
from .cores import ARXCore
from .fitting import Criterion
from .model import Model, find_scaled_sse, fit_by_halving
from .simulator import Simulator

N_ROUNDS = 5  # of Steiglitz and McBride
N_LEAST_SQUARES = 3  # of these, best first, that are followed
N_SPREAD = 4  # of the spread starts, the same


def fit_arx(core: ARXCore, record: Record, criterion: Criterion) -> Model:
    """The core without effects at its smallest simulation error, never worse than its starts."""
    simulator = Simulator(core, Effects([]), record)
    starts = find_arx_starts(core, record, record.input, N_ROUNDS)
    starts.sort(key=lambda theta: criterion.sse(simulator.run(theta)))
    starts = starts[:N_LEAST_SQUARES]
    starts += list_spread_starts(core, record, record.input, core.n_starts)[:N_SPREAD]
    best = min(starts, key=lambda theta: find_scaled_sse(simulator, criterion, theta))
    simulator = Simulator(core.sized(sizes(core, record, best)), Effects([]), record)
    return fit_by_halving(simulator, criterion, starts)


def sizes(core: ARXCore, record: Record, theta: np.ndarray) -> dict[str, float]:
    """Changes of the coefficients that would change the output by its own size (linearised)."""
    assert record.y is not None
    denominator = np.r_[1.0, theta[: core.na]]
    b = np.r_[np.zeros(core.nk), theta[core.na : core.na + core.nb]]
    answers = {
        "a": lfilter(b, np.polymul(denominator, denominator), record.input, axis=0),
        "b": lfilter([1.0], denominator, record.input, axis=0),
        "intercept": lfilter([1.0], denominator, np.ones_like(record.input), axis=0),
    }
    known = record.known
    size = float(np.sqrt(np.mean(record.y[known] ** 2)))
    rms = {k: max(float(np.sqrt(np.mean(v[known] ** 2))), 1e-300) for k, v in answers.items()}
    names = [p.name for p in core.parameters]
    return {n: size / rms[n if n == "intercept" else n[0]] for n in names}


def forecast(
    simulated: np.ndarray,
    output: np.ndarray,
    segments: Sequence[tuple[int, int]],
    ar: np.ndarray,
    horizon: int,
) -> np.ndarray:
    """Simulated output, and the residual as an AR model foresees it some rows ahead.

    A residual that was not measured, or lies before its segment, is taken as zero.
    """
    if all(end - begin <= horizon for begin, end in segments):
        return simulated.copy()
    companion = np.eye(ar.size, k=-1)
    companion[:1] = -ar
    weights = np.linalg.matrix_power(companion, horizon)[:1].ravel()
    residual = np.nan_to_num(output - simulated)
    ahead = simulated.copy()
    for begin, end in segments:
        for i, weight in enumerate(weights):
            lag = horizon + i
            if begin + lag < end:
                ahead[begin + lag : end] += weight * residual[begin : end - lag]
    return ahead
