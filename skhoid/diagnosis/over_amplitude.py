"""The residual over amplitude: dead zones, asymmetry, levels at which the output sticks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from scipy.ndimage import median_filter
from scipy.signal import correlate
from scipy.stats import f as f_distribution
from scipy.stats import poisson

from .ceiling import Ceiling
from .signals import Signals
from .tests_table import FALSE_ALARM, N_DRAWS, Test, draw_normals

N_BINS = 12
LONGEST_LAG = 1.5  # s, by which the response follows a channel at most
LEAST_COUNT = 0.005  # of the samples, in a bin


def by_operating_point(signals: Signals, ceiling: Ceiling) -> tuple[pd.DataFrame, list[Test]]:
    """Mean residual against the value of signals one response time earlier, and its tests.

    Remnant goes round the loop and would sort itself into bins: with repeats the straight line that
    it makes is taken out, else it is described, not tested, except over the target.
    """
    quantities = _quantities(signals)
    tables, tests = [], []
    for name, (values, source) in quantities.items():
        lag, sign = _response_lag(signals, source)
        found = _bins(signals, ceiling, name, values, lag, sign)
        if found is not None:
            tables.append(found[0])
            tests += found[1]
    if not tables:
        columns = ["channel", "lag", "low", "high", "center", "count", "mean", "sd", "band", "sign"]
        return pd.DataFrame(columns=[*columns, "exceeds", "valid"]), tests
    table = pd.concat(tables, ignore_index=True)
    table.attrs["units"] = _units(signals, quantities)
    return table, tests


def _units(signals: Signals, names: Iterable[str]) -> dict[str, str]:
    """Units by the name of a channel or of its rate."""
    found = {}
    for name in names:
        unit = signals.units.get(name.removesuffix(" rate"))
        if unit:
            found[name] = f"{unit}/s" if name.endswith(" rate") else unit
    return found


def _quantities(signals: Signals) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Values at every row, and the signal whose response lag is theirs."""
    found: dict[str, np.ndarray] = {}
    for name in ("e", "x", "f_t"):
        if name in signals.channels:
            found[name] = signals.channels[name]
    found[signals.output] = signals.predicted
    quantities = {}
    for name, values in found.items():
        quantities[name] = (values, values)
        if name in ("e", signals.output):
            quantities[f"{name} rate"] = (_rate(signals, values), values)
    return quantities


def _rate(signals: Signals, values: np.ndarray) -> np.ndarray:
    rate = np.zeros_like(values)
    for start, stop in zip(signals.layout.starts[:-1], signals.layout.starts[1:], strict=True):
        if stop - start > 1:
            rate[start:stop] = np.gradient(values[start:stop], signals.dt)
    return rate


def _response_lag(signals: Signals, values: np.ndarray) -> tuple[int, float]:
    """Samples by which the prediction follows a signal most closely, and with which sign."""
    if values is signals.predicted:
        return 0, 1.0
    total: np.ndarray | float = 0.0
    longest = max(int(LONGEST_LAG / signals.dt), 1)
    longest = min(longest, min(group.n_samples for group in signals.groups) // 8)
    for group in signals.groups:
        for rows in group.rows:
            z, m = values[rows], signals.predicted[rows]
            product = correlate(m - m.mean(), z - z.mean(), method="fft")
            total = total + product[rows.size - 1 : rows.size + longest]
    lag = int(np.argmax(np.abs(total)))
    if lag == longest:  # no peak within reach
        lag = 0
    return lag, float(np.sign(np.asarray(total)[lag]) or 1.0)


def _bins(
    signals: Signals,
    ceiling: Ceiling,
    name: str,
    values: np.ndarray,
    lag: int,
    sign: float,
) -> tuple[pd.DataFrame, list[Test]] | None:
    valid = name in signals.external or all(group.n_runs > 1 for group in signals.groups)
    every = np.concatenate([z[known] for z, known in _coordinates(signals, values, lag)])
    low, high = np.quantile(every, [0.005, 0.995])
    if not high > low:
        return None
    edges = np.linspace(low, high, N_BINS + 1)
    edges[0], edges[-1] = every.min(), every.max()
    count = np.histogram(every, edges)[0]
    kept = np.flatnonzero(count >= max(LEAST_COUNT * every.size, 2))
    del every
    if kept.size < 5:
        return None
    sums, covariance, moments = np.zeros(N_BINS), np.zeros((N_BINS, N_BINS)), np.zeros(N_BINS)
    for group in signals.groups:
        late, z = group.rows[:, lag:], values[group.rows[:, : group.n_samples - lag]]
        r, known = signals.residual[late], signals.scored[late]
        if name not in signals.external and group.n_runs > 1:
            r = r - _linear_in_remnant(r, z, known)
        for k, rows in enumerate(late):
            number = np.clip(np.searchsorted(edges, z[k], side="right") - 1, 0, N_BINS - 1)
            inside = ((number == np.arange(N_BINS)[:, None]) & known[k]).astype(float)
            sums += inside @ r[k]
            moments += inside @ z[k]
            covariance += ceiling.noise.covariance(inside.T, signals.layout.time[rows])
    n = count[kept]
    mean, center = sums[kept] / n, moments[kept] / n
    covariance = covariance[np.ix_(kept, kept)] / np.outer(n, n)
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    largest = _largest_of_bins(covariance, sd, ceiling.noise.free)
    band = float(np.quantile(largest, 1 - FALSE_ALARM)) * sd
    table = pd.DataFrame(
        {
            "channel": name,
            "lag": lag * signals.dt,
            "low": edges[kept],
            "high": edges[kept + 1],
            "center": center,
            "count": n,
            "mean": mean,
            "sd": sd,
            "band": band,
            "sign": sign,
            "exceeds": valid & (np.abs(mean) > band),
            "valid": valid,
        }
    )
    power = float(np.mean(signals.y[signals.scored] ** 2))
    found = name, center, mean, covariance, n, ceiling.noise.free, power, valid
    return table, [_shape(kind, *found) for kind in ("nonlinearity", "asymmetry")]


def _coordinates(
    signals: Signals, values: np.ndarray, lag: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Values before a lag and whether rows are scored, run by run."""
    for group in signals.groups:
        for rows in group.rows:
            yield values[rows[: rows.size - lag]], signals.scored[rows[lag:]]


def _linear_in_remnant(r: np.ndarray, z: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The straight line that residual and signal share because remnant went round the loop."""
    n_runs = len(r)
    own = np.where(known, z - (z.sum(axis=0) - z) / (n_runs - 1), 0.0)
    deviation = np.where(known, r - r.mean(axis=0), 0.0)
    power = np.sum(own**2) * (n_runs - 1) / n_runs
    slope = np.sum(deviation * own) / power if power > 0 else 0.0
    return slope * own


def _largest_of_bins(covariance: np.ndarray, sd: np.ndarray, free: float) -> np.ndarray:
    """Draws of the largest mean, in its standard deviations, that noise alone would give."""
    rng = np.random.default_rng(0)
    draws = draw_normals(covariance / np.outer(sd, sd), rng)
    return np.abs(draws).max(axis=1) / np.sqrt(rng.chisquare(free, N_DRAWS) / free)


def _shape(
    kind: str,
    name: str,
    z: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    count: np.ndarray,
    free: float,
    mean_square: float,
    valid: bool,
) -> Test:
    """Tests whether the mean residual over a channel is a straight line, and an odd function."""
    scale = float(np.sqrt(np.average(z**2, weights=count))) or 1.0
    z = z / scale
    inverse = np.linalg.pinv(covariance, rcond=1e-6, hermitian=True)
    line = np.column_stack([np.ones(z.size), z])
    if kind == "asymmetry":
        line = np.column_stack([line, z * np.abs(z)])
        extra = np.abs(z)[:, None]
    else:
        extra = np.eye(z.size)
    # What the straight line explains is taken out of data and patterns alike.
    project = np.eye(z.size) - line @ np.linalg.pinv(line.T @ inverse @ line) @ line.T @ inverse
    M = extra.T @ inverse @ project @ extra
    g = extra.T @ inverse @ project @ mean
    statistic = float(g @ np.linalg.pinv(M, rcond=1e-6, hermitian=True) @ g)
    scale_of_M = max(float(np.abs(M).max()), 1e-300)
    rank = max(int(np.linalg.matrix_rank(M, tol=1e-6 * scale_of_M, hermitian=True)), 1)
    rest = project @ mean
    worst = int(np.argmax(np.abs(rest) / np.sqrt(np.diag(covariance))))
    size = float(np.sqrt(np.average(rest**2, weights=count)))
    # Noise alone gives that mean square too, on average that of its own in these bins.
    by_chance = float(np.average(np.diag(project @ covariance), weights=count))
    cost = 100 * max(size**2 - by_chance, 0.0) / mean_square
    what = f"mean residual over {name} against a straight line"
    if kind == "asymmetry":
        what = f"mean residual over {name}: gain of one sign against the other"
        # Of a channel that has one sign only, the two patterns differ by rounding.
        told = M[0, 0] > 1e-9 * (extra.T @ inverse @ extra)[0, 0]
        size = float(g[0] / M[0, 0]) if told else 0.0
    return Test(
        kind,
        name,
        statistic,
        float(f_distribution.sf(statistic / rank, rank, free)),
        where=float(z[worst] * scale),
        size=size,
        cost=cost,
        valid=valid,
        description=what,
    )


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
