"""Levels at which a signal stays: stops, clipping, quantised steps."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import poisson

from .signals import Signals
from .tests_table import Test

N_LEVELS = 400  # over the range of the signal
LEAST = 0.01  # of the samples
TIMES_NEIGHBOURS = 4.0
NEIGHBOURS = 21


def level_tests(signals: Signals) -> list[Test]:
    """The levels at which the output stays longest, at either end and between."""
    rows = np.concatenate([group.rows.ravel() for group in signals.groups])
    values = signals.y[rows]
    run = signals.layout.run_of(rows)
    found = held_level(values, run, signals.dt)
    if found is None:
        return []
    level, share, p, end = found
    return [
        Test(
            "level",
            signals.output,
            share,
            p,
            where=level,
            size=share,
            description=f"largest share of samples at one level of {signals.output}"
            + (f", at the {end} end of its range" if end else ""),
        )
    ]


def held_level(
    values: np.ndarray, run: np.ndarray, dt: float
) -> tuple[float, float, float, str] | None:
    """Level with the most samples beyond what its neighbours hold, share, p and which end."""
    low, high = float(values.min()), float(values.max())
    distinct = np.unique(values)
    if not high > low or distinct.size < 3:
        return None
    width = (high - low) / N_LEVELS
    if distinct.size < values.size / 10:  # recorded in whole steps
        width = max(width, 1.01 * float(np.median(np.diff(distinct))))
    n = max(int(np.ceil((high - low) / width)), 3)
    # Half a bin beyond either end: the extremes are in the middle of theirs.
    edges = low - width / 2 + width * np.arange(n + 2)
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, n)
    count = np.bincount(bins, minlength=n + 1).astype(float)
    expected = median_filter(count, min(NEIGHBOURS, n), mode="mirror")
    # Stays, not samples, are independent: a stay is a sequence of rows in one bin.
    changes = np.flatnonzero((np.diff(bins) != 0) | (np.diff(run) != 0))
    stays = np.bincount(bins[np.append(changes, bins.size - 1)], minlength=n + 1)
    longest = count / np.maximum(stays, 1)
    k = int(np.argmax(count - TIMES_NEIGHBOURS * np.maximum(expected, 1.0)))
    share = float(count[k] / values.size)
    if share < LEAST or count[k] < TIMES_NEIGHBOURS * max(expected[k], 1.0) or stays[k] < 5:
        return float(edges[k] + width / 2), share, 1.0, ""
    typical = float(np.median(longest[stays > 0]))
    # As many stays as were seen, each as long as elsewhere, would hold so many samples.
    p = float(poisson.sf(count[k] / typical - 1, max(expected[k] / typical, 1.0)) * (n + 1))
    end = "lower" if k <= 1 else "upper" if k >= n - 1 else ""
    inside = values[bins == k]
    return float(np.median(inside)), share, min(p, 1.0), end
