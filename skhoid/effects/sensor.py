"""A machine's sensor that shows only the magnitude of the output."""

from __future__ import annotations

import numpy as np

from .base import Effect
from .core_kind import CoreKind
from .error_scan import ErrorScan
from .record import Record

N_ROUNDS = 8  # of signs and least squares
N_KEPT = 3  # starts
LOW_MINIMA = (0.15, 0.3, 0.5, 0.8)  # standard deviations, below which a minimum may be a crossing


class SensorMagnitude(Effect):
    """The sensor shows the magnitude of the output without its sign: y' = abs(y).

    Pulse counters and rectifying tachometers do this. A search starts from the signs that make the
    output smooth, then repeats with the signs of the fitted model until they no longer change.

    References
    ----------
    Wigren and Schoukens, Coupled electric drives data set and reference models (2017).

    Examples
    --------
    >>> from skhoid.effects import SensorMagnitude
    >>> SensorMagnitude().place
    'output'
    """

    name = "sensor_magnitude"
    title = "sensor without sign"
    place = "output"
    physics = "The sensor shows how fast or how far, but not in which direction."
    formula = "y' = |y|"
    tex = r"y' = |y|"
    source = "Wigren and Schoukens (2017)"
    domains = ("machine",)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core != CoreKind.ARX:
            return "for an ARX model: its signs are found with linear fits"
        if record.y is not None and (record.y[record.known] < -0.1 * record.sd("u")).any():
            return "the output takes both signs"
        return None

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """The core fitted to the output with signs that make it smooth, and with its own signs."""
        return cores_by_signs(error_of, record)

    def apply(self, signal: np.ndarray, record: Record) -> np.ndarray:
        return np.abs(signal)


def cores_by_signs(error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
    """Changes of a core that is linear in its parameters, fitted to an output without its signs.

    From signs that make it smooth, then with the signs of the free run until they stay.
    """
    if record.y is None:
        return []
    known = record.known

    def error(free_run: np.ndarray) -> float:
        return float(np.sum((np.abs(free_run) - record.y)[known] ** 2))

    found = []
    lows = [share * record.sd("u") for share in LOW_MINIMA]
    guesses = [smooth_signs(record.y), *(signs_by_minima(record.y, low) for low in lows)]
    for signs in guesses:
        signed = signs * record.y
        for _ in range(N_ROUNDS):
            rounds = error_of.refitted(signed)
            if not rounds:
                return []
            values, free_run = min(rounds, key=lambda one: error(one[1]))
            found.append((error(free_run), values))
            again = np.where(free_run < 0.0, -record.y, record.y)
            if np.array_equal(again, signed):
                break
            signed = again
    found.sort(key=lambda one: one[0])
    return [values for _, values in found[:N_KEPT]]


def smooth_signs(y: np.ndarray) -> np.ndarray:
    """Signs of samples (n_samples, n_runs) at which the second differences are least.

    The first is positive. By Viterbi's algorithm, over the signs of two neighbours.
    """
    n, runs = y.shape
    signs = np.ones((n, runs))
    if n < 3:
        return signs
    pairs = [(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)]  # of the sample before and this one
    cost = np.array([[0.0 if a > 0 else np.inf for a, _ in pairs]] * runs).T
    came = np.zeros((n, 4, runs), dtype=int)
    for k in range(2, n):
        new = np.empty_like(cost)
        for i, (b, c) in enumerate(pairs):
            before = [j for j, pair in enumerate(pairs) if pair[1] == b]
            bends = np.stack(
                [
                    cost[j] + (c * y[k] - 2 * b * y[k - 1] + pairs[j][0] * y[k - 2]) ** 2
                    for j in before
                ]
            )
            least = np.argmin(bends, axis=0)
            came[k, i] = np.array(before)[least]
            new[i] = bends.min(axis=0)
        cost = new
    at = np.argmin(cost, axis=0)
    columns = np.arange(runs)
    for k in range(n - 1, 1, -1):
        signs[k] = np.array([pair[1] for pair in pairs])[at]
        signs[k - 1] = np.array([pair[0] for pair in pairs])[at]
        at = came[k, at, columns]
    return signs


def signs_by_minima(y: np.ndarray, low: float) -> np.ndarray:
    """Signs of samples (n_samples, n_runs) that change at each minimum below a value."""
    before, after = y[:-2] >= y[1:-1], y[1:-1] < y[2:]
    flips = np.ones_like(y)
    flips[1:-1] = np.where(before & after & (y[1:-1] < low), -1.0, 1.0)
    return np.cumprod(flips, axis=0)
