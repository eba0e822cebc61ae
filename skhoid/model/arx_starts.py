"""Starting values of ARX coefficients, by least squares and Steiglitz-McBride."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter
from scipy.stats.qmc import Halton

from ..arx.base import ESTIMATE, REST, pays
from ..effects.record import Record
from .initial import fit_states, make_free_responses

if TYPE_CHECKING:
    from .cores import ARXCore

Filter = Callable[[np.ndarray], np.ndarray]
LARGEST_POLE = 0.999  # radius of a start
FASTEST = 2.5  # rad per sample, of poles that are tried
DAMPING = 0.05, 2.0  # ratios, the same
N_SPREAD = 24  # systems with different poles that are tried beside least squares
N_TOLD = 3  # rounds that tell how runs begin


def find_arx_starts(
    core: ARXCore, record: Record, x: np.ndarray, n_rounds: int
) -> list[np.ndarray]:
    """Coefficients by ordinary least squares, and by Steiglitz and McBride's iteration.

    Least squares minimise the one-step error, which noise on the output biases; on signals
    filtered by the last 1 / A they come close to the error of simulation. Poles outside the unit
    circle are reflected, and the input coefficients are those of the smallest simulation error.
    """
    found = []
    a = np.zeros(core.na)
    for _ in range(n_rounds if core.na else 1):
        a = _stabilise(_filter_by_denominator(core, record, x, a))
        found.append(np.r_[a, _solve(*_make_regression(core, record, x, a))])
    return found


def list_spread_starts(core: ARXCore, record: Record, x: np.ndarray) -> list[np.ndarray]:
    """Coefficients of systems of spread poles with their best numerators, best first."""
    tried = []
    for a in draw_spread_poles(core, record):
        table, y = _make_regression(core, record, x, a)
        b = _solve(table, y)
        error = y - table @ b
        tried.append((float(error @ error), np.r_[a, b]))
    tried.sort(key=lambda one: one[0])
    return [theta for _, theta in tried]


def list_blind_starts(core: ARXCore, record: Record, x: np.ndarray) -> list[np.ndarray]:
    """Coefficients of systems of spread poles with outputs of the size of the measured one.

    For cases that least squares cannot start from because a map hides the output.
    """
    assert record.y is not None
    size = float(np.sqrt(np.mean(record.y[record.known] ** 2)))
    found = []
    for a in draw_spread_poles(core, record):
        answer = lfilter([1.0], np.r_[1.0, a], _delay(x, core.nk), axis=0)[record.known]
        gain = size / max(float(np.sqrt(np.mean(answer**2))), 1e-300)
        found.append(np.r_[a, gain, np.zeros(core.nb - 1 + core.intercept)])
    return found


def draw_spread_poles(core: ARXCore, record: Record) -> list[np.ndarray]:
    """a_1 ... of systems whose poles are spread over what a record can show.

    Frequencies lie between one period a run and nearly half the sampling rate, on a logarithmic
    scale, and damping ratios between 0.05 and 2. The sequence is fixed.
    """
    if not core.na:
        return []
    slowest = np.log(2 * np.pi / len(record.known))
    pairs = -(-core.na // 2)
    points = Halton(2 * pairs, scramble=False, seed=0).random(N_SPREAD + 1)[1:]
    found = []
    for point in points:
        omega = np.exp(slowest + point[:pairs] * (np.log(FASTEST) - slowest))
        zeta = DAMPING[0] * (DAMPING[1] / DAMPING[0]) ** point[pairs:]
        root = np.sqrt((zeta**2 - 1).astype(complex))
        poles = np.exp(np.c_[omega * (-zeta + root), omega * (-zeta - root)].ravel())
        if core.na % 2:
            poles = np.r_[poles[:-2], np.exp(-omega[-1])]
        found.append(_stabilise(np.poly(poles)[1:].real))
    return found


def begins_at_rest(core: ARXCore, record: Record) -> bool:
    """Whether runs begin at rest, as far as a linear model without effects can tell."""
    assert record.y is not None
    least = []
    for initial in (REST, ESTIMATE):
        begun = replace(record, initial=initial)
        a = np.zeros(core.na)
        left = []
        for _ in range(N_TOLD if core.na else 1):
            a = _stabilise(_filter_by_denominator(core, begun, begun.input, a))
            table, y = _make_regression(core, begun, begun.input, a)
            error = y - table @ _solve(table, y)
            left.append(float(error @ error))
        least.append(min(left))
    return not pays(least[0], least[1], record.y[record.known])


def _solve(table: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares with scaled columns, so that the rank does not depend on units."""
    scale = np.sqrt(np.mean(table**2, axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.lstsq(table / scale, y, rcond=None)[0] / scale


def _filter_by_denominator(
    core: ARXCore, record: Record, x: np.ndarray, a: np.ndarray
) -> np.ndarray:
    """a_1 ... by least squares on signals filtered by 1 / A for the last a."""
    assert record.y is not None

    def filtered(signal: np.ndarray) -> np.ndarray:
        return lfilter([1.0], np.r_[1.0, a], signal, axis=0)

    y = filtered(record.y)
    columns = [-_delay(y, i + 1) for i in range(core.na)]
    columns += _stack_inputs(core, record, x, filtered)
    if not core.intercept:  # else an offset of the output is told as a slow pole
        columns.append(filtered(np.ones_like(y)))
    usable = record.known.copy()
    for lag in range(1, core.na + 1):
        usable[lag:] &= record.known[:-lag]
    usable[: max(core.na, core.nb + core.nk - 1)] = False
    y, *columns = _remove_start(record, a, [y, *columns], usable)
    table = np.stack([c[usable] for c in columns], axis=1)
    return _solve(table, y[usable])[: core.na]


def _make_regression(
    core: ARXCore, record: Record, x: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Signals that b_0 ... and the intercept weigh, and the output, on known rows."""
    assert record.y is not None
    columns = _stack_inputs(core, record, x, lambda s: lfilter([1.0], np.r_[1.0, a], s, axis=0))
    y, *columns = _remove_start(record, a, [record.y, *columns], record.known)
    return np.stack([c[record.known] for c in columns], axis=1), y[record.known]


def _remove_start(
    record: Record, a: np.ndarray, columns: list[np.ndarray], rows: np.ndarray
) -> list[np.ndarray]:
    """Columns less the free responses of 1 / A in them, where runs do not begin at rest."""
    if record.initial == REST or not a.size:
        return columns
    free = make_free_responses(np.r_[1.0, a], len(rows))
    return [c - free @ fit_states(free, c, rows) for c in columns]


def _stack_inputs(
    core: ARXCore, record: Record, signal: np.ndarray, filtered: Filter
) -> list[np.ndarray]:
    lags = [core.nk + i for i in range(core.nb)]
    if record.initial == REST:
        x = filtered(signal)
        columns = [_delay(x, lag) for lag in lags]
    else:
        columns = [filtered(_delay(signal, lag, signal[:1])) for lag in lags]
    if core.intercept:
        columns.append(filtered(np.ones_like(signal)))
    return columns


def _delay(signal: np.ndarray, lag: int, before: np.ndarray | float = 0.0) -> np.ndarray:
    late = np.empty_like(signal)
    late[:lag] = before
    late[lag:] = signal[: len(signal) - lag]
    return late


def _stabilise(a: np.ndarray) -> np.ndarray:
    roots = np.roots(np.r_[1.0, a])
    radius = np.abs(roots)
    outside = radius > LARGEST_POLE
    if not outside.any():
        return a
    inside = np.minimum(1.0 / radius[outside], LARGEST_POLE)
    roots[outside] *= inside / radius[outside]
    return np.poly(roots)[1:].real
