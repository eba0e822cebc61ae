"""Levels at which a signal stays: stops, clipping, quantised steps."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import poisson

from .run_signals import Signals
from .tests_table import Test

N_LEVELS = 400  # over the range of the signal
LEAST = 0.01  # of the samples
TIMES_NEIGHBOURS = 4.0
NEIGHBOURS = 21
LEAST_STAYS = 5
MOST_LISTED = 4  # levels


def level_tests(signals: Signals) -> list[Test]:
    """The levels at which the output stays longest, at either end and between."""
    rows = np.concatenate([group.rows.ravel() for group in signals.groups])
    levels, shares, p = held_levels(signals.y[rows], signals.layout.run_of(rows))
    if not levels.size:
        return [Test("level", signals.output, 0.0, 1.0, description="at no level")]
    at = " and ".join(f"{level:.4g}" for level in np.sort(levels[:MOST_LISTED]))
    more = f" (and {levels.size - MOST_LISTED} more levels)" if levels.size > MOST_LISTED else ""
    share = float(shares[:MOST_LISTED].sum())
    return [
        Test(
            "level",
            signals.output,
            share,
            p,
            where=float(levels[0]),
            size=share,
            description=f"at {signals.output} = {at}{more}",
        )
    ]


def held_levels(values: np.ndarray, run: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Levels that hold far more samples than their neighbours, their shares, and p of the first."""
    low, high = float(values.min()), float(values.max())
    distinct = np.unique(values)
    none = np.array([]), np.array([]), 1.0
    if not high > low or distinct.size < 3:
        return none
    width = (high - low) / N_LEVELS
    if distinct.size < values.size / 10:  # recorded in whole steps
        width = max(width, 1.01 * float(np.median(np.diff(distinct))))
    n = max(int(np.ceil((high - low) / width)), 3)
    # Half a bin beyond either end: the extremes are in the middle of theirs.
    edges = low - width / 2 + width * np.arange(n + 2)
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, n)
    count = np.bincount(bins, minlength=n + 1).astype(float)
    expected = np.maximum(median_filter(count, min(NEIGHBOURS, n), mode="mirror"), 1.0)
    # Stays, not samples, are independent: a stay is a sequence of rows in one bin.
    changes = np.flatnonzero((np.diff(bins) != 0) | (np.diff(run) != 0))
    stays = np.bincount(bins[np.append(changes, bins.size - 1)], minlength=n + 1)
    held = (
        (count >= LEAST * values.size)
        & (count >= TIMES_NEIGHBOURS * expected)
        & (stays >= LEAST_STAYS)
    )
    if not held.any():
        return none
    order = np.flatnonzero(held)[np.argsort(-count[held])]
    typical = float(np.median(count[stays > 0] / stays[stays > 0]))
    k = order[0]
    # Samples counted in stays of the typical length.
    p = poisson.sf(count[k] / typical - 1, max(expected[k] / typical, 1.0)) * (n + 1)
    levels = np.array([np.median(values[bins == k]) for k in order])
    return levels, count[order] / values.size, float(min(p, 1.0))
