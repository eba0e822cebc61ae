"""An ARX core at the smallest error of simulation, and its forecasts."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.signal import lfilter

from ..effects.composition import Effects
from ..effects.record import Record
from .cores import ARXCore
from .fitting import Criterion
from .model import Model, fit_core, scaled_sse
from .simulator import Simulator

Filter = Callable[[np.ndarray], np.ndarray]
N_ROUNDS = 5  # of Steiglitz and McBride
LARGEST_POLE = 0.999  # radius of a start


def fitted_arx(core: ARXCore, record: Record, criterion: Criterion) -> Model:
    """The core without effects at the smallest error of simulation."""
    starts = arx_starts(core, record)
    simulator = Simulator(core, Effects([]), record)
    best = min(starts, key=lambda theta: scaled_sse(simulator, criterion, theta))
    core = ARXCore(core.na, core.nb, core.nk, core.intercept, sizes(core, record, best))
    return fit_core(core, record, criterion, np.array(starts))


def arx_starts(core: ARXCore, record: Record) -> list[np.ndarray]:
    """Coefficients by ordinary least squares, and by Steiglitz and McBride's iteration.

    Least squares minimise the one-step error, which noise on the output biases; on signals
    filtered by the last 1 / A they come close to the error of simulation. Poles outside the unit
    circle are reflected, and the input coefficients are those of the smallest simulation error.
    """
    found = []
    a = np.zeros(core.na)
    for _ in range(N_ROUNDS if core.na else 1):
        a = _stable(_denominator(core, record, a))
        found.append(np.r_[a, _numerator(core, record, a)])
    return found


def sizes(core: ARXCore, record: Record, theta: np.ndarray) -> dict[str, float]:
    """Changes of the coefficients that change the output by its own size, linearised."""
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


def _denominator(core: ARXCore, record: Record, a: np.ndarray) -> np.ndarray:
    """a_1 ... by least squares on signals filtered by 1 / A for the last a."""
    assert record.y is not None

    def filtered(signal: np.ndarray) -> np.ndarray:
        return lfilter([1.0], np.r_[1.0, a], signal, axis=0)

    y = filtered(record.y)
    columns = [-_late(y, i + 1) for i in range(core.na)]
    columns += _inputs(core, record, filtered)
    usable = record.known.copy()
    for lag in range(1, core.na + 1):
        usable[lag:] &= record.known[:-lag]
    usable[: max(core.na, core.nb + core.nk - 1)] = False
    table = np.stack([c[usable] for c in columns], axis=1)
    return np.linalg.lstsq(table, y[usable], rcond=None)[0][: core.na]


def _numerator(core: ARXCore, record: Record, a: np.ndarray) -> np.ndarray:
    """b_0 ... and the intercept that simulate best with a given denominator."""
    assert record.y is not None
    columns = _inputs(core, record, lambda s: lfilter([1.0], np.r_[1.0, a], s, axis=0))
    table = np.stack([c[record.known] for c in columns], axis=1)
    return np.linalg.lstsq(table, record.y[record.known], rcond=None)[0]


def _inputs(
    core: ARXCore, record: Record, filtered: Callable[[np.ndarray], np.ndarray]
) -> list[np.ndarray]:
    x = filtered(record.input)
    columns = [_late(x, core.nk + i) for i in range(core.nb)]
    if core.intercept:
        columns.append(filtered(np.ones_like(x)))
    return columns


def _late(signal: np.ndarray, lag: int) -> np.ndarray:
    late = np.zeros_like(signal)
    late[lag:] = signal[: len(signal) - lag]
    return late


def _stable(a: np.ndarray) -> np.ndarray:
    roots = np.roots(np.r_[1.0, a])
    radius = np.abs(roots)
    outside = radius > LARGEST_POLE
    if not outside.any():
        return a
    inside = np.minimum(1.0 / radius[outside], LARGEST_POLE)
    roots[outside] *= inside / radius[outside]
    return np.poly(roots)[1:].real


def forecast(
    simulated: np.ndarray,
    output: np.ndarray,
    segments: Iterable[tuple[int, int]],
    ar: np.ndarray,
    horizon: int,
) -> np.ndarray:
    """Simulated output, and the residual as an AR model foresees it some rows ahead.

    A residual that was not measured, or lies before its segment, is taken as zero.
    """
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
