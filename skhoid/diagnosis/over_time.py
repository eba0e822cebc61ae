"""The residual over time in the run: windows, and map over frequency."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from .ceiling import Ceiling
from .changes import gain_over_time
from .run_signals import Signals
from .tests_table import of_one, of_several

N_WINDOWS = 16
SHORTEST = 1.0  # s, of a window
N_BANDS = 14  # of the map


def by_time(signals: Signals, ceiling: Ceiling, false_alarm: float) -> pd.DataFrame:
    """Residual of all runs, and of each, in windows of time in the run.

    ``exceeds`` says that a window has more, or less, than chance.
    """
    rows = np.flatnonzero(signals.scored)
    time, run = signals.layout.time[rows], signals.layout.run_of(rows)
    edges = _edges(time, signals.dt)
    window = np.searchsorted(edges, time + signals.dt / 4, side="right") - 1
    n = edges.size - 1
    parts = [("all", np.ones(rows.size, dtype=bool))]
    numbers = np.unique(run)
    if numbers.size >= 1:
        parts += [(signals.run_label(k), run == k) for k in numbers]
    y, r = signals.y[rows], signals.residual[rows]
    # A window of T seconds holds that many independent values of the noise's square.
    per_second = 1 / ceiling.noise.correlation_time
    tables = []
    for label, own in parts:
        at = window[own]
        count = np.bincount(at, minlength=n)
        power, lost = np.bincount(at, y[own] ** 2, n), np.bincount(at, r[own] ** 2, n)
        used = np.flatnonzero(count)
        count, power, lost = count[used], power[used], lost[used]
        rest = count.sum() - count
        # Runs of more power count for more: there are fewer values than of runs all alike.
        of_runs = np.bincount(run[own], r[own] ** 2, len(signals.layout.labels))
        shares = of_runs[of_runs > 0] / max(of_runs.sum(), 1e-300)
        alike = 1 / (shares.size * np.sum(shares**2)) if shares.size else 1.0
        free = np.maximum(alike * per_second * signals.dt * count, 1.0)
        free_rest = np.maximum(alike * per_second * signals.dt * rest, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            F = (lost / count) / ((lost.sum() - lost) / rest)
            tail = np.minimum(
                f_distribution.sf(F, free, free_rest), f_distribution.cdf(F, free, free_rest)
            )
            vaf = 100 * (1 - lost / power)
        p = of_several(2 * np.where(np.isfinite(F), tail, 0.5))
        views = 1 if label == "all" else numbers.size
        each = of_one(false_alarm / views, used.size) / 2
        limits = np.array(
            [f_distribution.ppf(each, free, free_rest), f_distribution.isf(each, free, free_rest)]
        )
        part = count / count.sum()
        limits = limits / (part * limits + 1 - part)
        tables.append(
            pd.DataFrame(
                {
                    "run": label,
                    "start": edges[used],
                    "stop": edges[used + 1],
                    "rmse": np.sqrt(lost / count),
                    "vaf": vaf,
                    "share": 100 * lost / power.sum() if power.sum() else np.nan,
                    "ratio": lost / count / (lost.sum() / count.sum()) if lost.any() else 1.0,
                    "chance_low": limits[0],
                    "chance_high": limits[1],
                    "p": np.minimum(p * views, 1.0),
                }
            )
        )
    tables[0] = tables[0].assign(**_repeating(signals, ceiling, edges, tables[0]))
    gain = gain_over_time(signals, ceiling, edges)
    if gain is not None and len(tables[0]) == len(gain):
        tables[0] = tables[0].join(gain)
    table = pd.concat(tables, ignore_index=True)
    table["exceeds"] = table["p"] < false_alarm
    return table


def _repeating(
    signals: Signals, ceiling: Ceiling, edges: np.ndarray, table: pd.DataFrame
) -> dict[str, np.ndarray]:
    """VAF points of each window that repeat over runs, and the p-value that they are noise."""
    n = edges.size - 1
    repeated, noise, runs = np.zeros(n), np.zeros(n), []
    free = np.zeros((2, n))
    for group in signals.groups:
        if group.n_runs < 2:
            continue
        r = signals.residual[group.rows]
        mean = r.mean(axis=0)
        time = signals.layout.time[group.rows[0]]
        at = np.clip(np.searchsorted(edges, time + signals.dt / 4, side="right") - 1, 0, n - 1)
        repeated += np.bincount(at, group.n_runs * mean**2, n)
        noise += np.bincount(at, np.sum((r - mean) ** 2, axis=0) / (group.n_runs - 1), n)
        count = np.bincount(at, minlength=n) * signals.dt / ceiling.noise.correlation_time
        free += np.stack([count, count * (group.n_runs - 1)])
        runs.append(group.n_runs)
    power = float(np.sum(signals.y[signals.scored] ** 2))
    if not runs or not power:
        return {}
    used = np.isin(edges[:-1], table["start"])
    with np.errstate(divide="ignore", invalid="ignore"):
        p = f_distribution.sf(repeated / noise, *np.maximum(free, 1.0))
    return {
        "explainable": (100 * (repeated - noise) / power)[used],
        "p_explainable": of_several(np.nan_to_num(p, nan=1.0))[used],
    }


def _edges(time: np.ndarray, dt: float) -> np.ndarray:
    start, stop = float(time.min()), float(time.max()) + dt
    n = int(np.clip((stop - start) / SHORTEST, 1, N_WINDOWS))
    return np.linspace(start, stop, n + 1)


def time_frequency(signals: Signals, ceiling: Ceiling, false_alarm: float) -> pd.DataFrame:
    """Residual power over time and frequency, relative to the noise expected there.

    ``attrs["limit"]`` is what one cell of the map exceeds by chance at the false-alarm rate.
    """
    n = min(group.n_samples for group in signals.groups)
    length = max(n // N_WINDOWS, 16)
    hop = length // 2
    transform = ShortTimeFFT(hann(length, sym=False), hop, 1 / signals.dt, scale_to="psd")
    total: np.ndarray | float = 0.0
    n_runs = 0
    for group in signals.groups:
        for rows in group.rows:
            total = total + transform.spectrogram(signals.residual[rows[:n]])
            n_runs += 1
    inside = (transform.t(n) >= length / 2 * signals.dt) & (
        transform.t(n) <= (n - length / 2) * signals.dt
    )
    omega = 2 * np.pi * transform.f
    expected = ceiling.noise.at(omega) * signals.dt
    ratio = np.asarray(total)[1:, inside] / n_runs / np.maximum(expected[1:, None], 1e-300)
    top = int(np.flatnonzero(ceiling.noise.known(omega))[-1])
    edges = np.unique(np.round(np.geomspace(1, max(top, 1) + 1, N_BANDS + 1)).astype(int))
    bands = [ratio[a - 1 : b - 1].mean(axis=0) for a, b in pairwise(edges)]
    centre = [np.sqrt(omega[a] * omega[b - 1]) for a, b in pairwise(edges)]
    start = float(signals.layout.time[signals.groups[0].rows[0, 0]])
    table = pd.DataFrame(
        np.transpose(bands),
        index=pd.Index(start + transform.t(n)[inside], name="time"),
        columns=pd.Index(centre, name="omega"),
    )
    # A Hann window makes two of three neighbouring bins independent.
    free = np.maximum(2 * n_runs * np.diff(edges) * 2 / 3, 2.0)
    beyond = of_one(false_alarm, table.size)
    table.attrs["limit"] = (chi2.isf(beyond, free) / free).tolist()
    return table
