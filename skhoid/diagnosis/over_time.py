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
    edges = _edges(signals)
    names, sums = ["all"], [np.zeros((3, edges.size - 1))]
    for k, (start, stop) in enumerate(pairwise(signals.layout.run_starts)):
        rows = start + np.flatnonzero(signals.scored[start:stop])
        if not rows.size:
            continue
        window = _windows(edges, signals.layout.time[rows], signals.dt)
        weights = None, signals.y[rows] ** 2, signals.residual[rows] ** 2
        names.append(signals.run_label(k))
        sums.append(np.array([np.bincount(window, w, edges.size - 1) for w in weights]))
        sums[0] += sums[-1]
    table = _table_of_windows(edges, names, np.array(sums), signals.dt, ceiling, false_alarm)
    together = table[: np.count_nonzero(sums[0][0])]
    more = pd.DataFrame(_repeating(signals, ceiling, edges, together), index=together.index)
    gain = gain_over_time(signals, ceiling, edges)
    if gain is not None and len(together) == len(gain):
        more = more.join(gain)
    table = table.join(more)
    table["exceeds"] = table["p"] < false_alarm
    return table


def _table_of_windows(
    edges: np.ndarray,
    names: list[str],
    sums: np.ndarray,
    dt: float,
    ceiling: Ceiling,
    false_alarm: float,
) -> pd.DataFrame:
    """Rows for the windows of all runs, which are first, and of each, that hold samples.

    ``sums`` are those of samples, of squared output and of squared residual, by run and window.
    """
    count, power, lost = sums.transpose(1, 0, 2)
    totals = sums.sum(axis=2)
    run, window = np.nonzero(count)
    n_windows = np.count_nonzero(count, axis=1)[run]
    n_samples, all_power, all_lost = totals[run].T
    count, power, lost = (values[run, window] for values in (count, power, lost))
    rest = n_samples - count
    # Runs of more power count for more: there are fewer values than of runs all alike.
    of_runs = totals[1:, 2]
    shares = of_runs[of_runs > 0] / max(of_runs.sum(), 1e-300)
    alike = np.ones(len(names))
    alike[0] = 1 / (shares.size * np.sum(shares**2)) if shares.size else 1.0
    # A window of T seconds holds that many independent values of the noise's square.
    per_sample = alike[run] * dt / ceiling.noise.correlation_time
    free, free_rest = np.maximum(per_sample * count, 1.0), np.maximum(per_sample * rest, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        F = (lost / count) / ((all_lost - lost) / rest)
        tail = np.minimum(
            f_distribution.sf(F, free, free_rest), f_distribution.cdf(F, free, free_rest)
        )
        vaf = 100 * (1 - lost / power)
        share = np.where(all_power > 0, 100 * lost / all_power, np.nan)
        ratio = np.where(all_lost > 0, lost / count / (all_lost / n_samples), 1.0)
    p = of_several(2 * np.where(np.isfinite(F), tail, 0.5), n_windows)
    views = np.where(run == 0, 1, len(names) - 1)
    each = of_one(false_alarm / views, n_windows) / 2
    limits = np.array(
        [f_distribution.ppf(each, free, free_rest), f_distribution.isf(each, free, free_rest)]
    )
    part = count / n_samples
    limits = limits / (part * limits + 1 - part)
    return pd.DataFrame(
        {
            "run": np.array(names, dtype=object)[run],
            "start": edges[window],
            "stop": edges[window + 1],
            "rmse": np.sqrt(lost / count),
            "vaf": vaf,
            "share": share,
            "ratio": ratio,
            "chance_low": limits[0],
            "chance_high": limits[1],
            "p": np.minimum(p * views, 1.0),
        }
    )


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
        at = _windows(edges, time, signals.dt)
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


def _edges(signals: Signals) -> np.ndarray:
    time = signals.layout.time[signals.scored]
    start, stop = float(time.min()), float(time.max()) + signals.dt
    n = int(np.clip((stop - start) / SHORTEST, 1, N_WINDOWS))
    return np.linspace(start, stop, n + 1)


def _windows(edges: np.ndarray, time: np.ndarray, dt: float) -> np.ndarray:
    """Number of the window that each instant is in."""
    return np.clip(np.searchsorted(edges, time + dt / 4, side="right") - 1, 0, edges.size - 2)


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
