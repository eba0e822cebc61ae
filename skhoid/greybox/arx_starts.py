"""Starting values of ARX coefficients, by least squares and Steiglitz-McBride."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.signal import lfilter

from ..effects.record import Record

Filter = Callable[[np.ndarray], np.ndarray]
LARGEST_POLE = 0.999  # radius of a start


class HasOrders(Protocol):
    """Orders of an ARX model of one input."""

    na: int
    nb: int
    nk: int
    intercept: bool


def arx_starts(core: HasOrders, record: Record, x: np.ndarray, n_rounds: int) -> list[np.ndarray]:
    """Coefficients by ordinary least squares, and by Steiglitz and McBride's iteration.

    Least squares minimise the one-step error, which noise on the output biases; on signals
    filtered by the last 1 / A they come close to the error of simulation. Poles outside the unit
    circle are reflected, and the input coefficients are those of the smallest simulation error.
    """
    found = []
    a = np.zeros(core.na)
    for _ in range(n_rounds if core.na else 1):
        a = _stable(_denominator(core, record, x, a))
        found.append(np.r_[a, _numerator(core, record, x, a)])
    return found


def _denominator(core: HasOrders, record: Record, x: np.ndarray, a: np.ndarray) -> np.ndarray:
    """a_1 ... by least squares on signals filtered by 1 / A for the last a."""
    assert record.y is not None

    def filtered(signal: np.ndarray) -> np.ndarray:
        return lfilter([1.0], np.r_[1.0, a], signal, axis=0)

    y = filtered(record.y)
    columns = [-_late(y, i + 1) for i in range(core.na)]
    columns += _inputs(core, x, filtered)
    usable = record.known.copy()
    for lag in range(1, core.na + 1):
        usable[lag:] &= record.known[:-lag]
    usable[: max(core.na, core.nb + core.nk - 1)] = False
    table = np.stack([c[usable] for c in columns], axis=1)
    return np.linalg.lstsq(table, y[usable], rcond=None)[0][: core.na]


def _numerator(core: HasOrders, record: Record, x: np.ndarray, a: np.ndarray) -> np.ndarray:
    """b_0 ... and the intercept that simulate best with a given denominator."""
    assert record.y is not None
    columns = _inputs(core, x, lambda s: lfilter([1.0], np.r_[1.0, a], s, axis=0))
    table = np.stack([c[record.known] for c in columns], axis=1)
    return np.linalg.lstsq(table, record.y[record.known], rcond=None)[0]


def _inputs(core: HasOrders, signal: np.ndarray, filtered: Filter) -> list[np.ndarray]:
    x = filtered(signal)
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
