"""The residual over time in the run: windows, change points, drift, map over frequency."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann
from scipy.stats import chi2, norm
from scipy.stats import f as f_distribution

from .breaks import Break, largest_break
from .ceiling import Ceiling, coherent_part
from .signals import Group, Signals
from .tests_table import Test, of_one, of_several

N_WINDOWS = 16
N_BLOCKS = 160
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
        free = np.maximum(per_second * signals.dt * count, 1.0)
        free_rest = np.maximum(per_second * signals.dt * rest, 1.0)
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
    lost, spread = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
    known = False
    for group in signals.groups:
        if group.n_runs < 2:
            continue
        known = True
        r = signals.residual[group.rows]
        mean = r.mean(axis=0)
        noise = np.sum((r - mean) ** 2, axis=0) / (group.n_runs - 1)
        time = signals.layout.time[group.rows[0]]
        at = np.clip(np.searchsorted(edges, time + signals.dt / 4, side="right") - 1, 0, None)
        at = np.minimum(at, edges.size - 2)
        lost += np.bincount(at, group.n_runs * mean**2 - noise, edges.size - 1)
        # The product of two runs' noise, as for the ceiling, over the samples of the window.
        variance = np.bincount(at, noise, edges.size - 1) ** 2
        count = np.maximum(np.bincount(at, minlength=edges.size - 1), 1) * signals.dt
        pairs = 2 * group.n_runs / (group.n_runs - 1)
        spread += pairs * variance * ceiling.noise.correlation_time / count
    power = float(np.sum(signals.y[signals.scored] ** 2))
    if not known or not power:
        return {}
    used = np.isin(edges[:-1], table["start"])
    with np.errstate(divide="ignore", invalid="ignore"):
        p = norm.sf(lost / np.sqrt(spread))
    return {
        "explainable": (100 * lost / power)[used],
        "p_explainable": of_several(np.nan_to_num(p, nan=1.0))[used],
    }


def _edges(time: np.ndarray, dt: float) -> np.ndarray:
    start, stop = float(time.min()), float(time.max()) + dt
    n = int(np.clip((stop - start) / SHORTEST, 1, N_WINDOWS))
    return np.linspace(start, stop, n + 1)


def tests_over_time(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Changes of the response, of the noise's power and of the mean; single outliers."""
    start, stop = _span(signals)
    edges = np.linspace(start, stop, N_BLOCKS + 1)
    gains, powers, means, largest = [], [], [], (0.0, np.nan)
    n_rows, of_run = 0, ""
    for group, remnant in zip(signals.groups, ceiling.remnant, strict=True):
        repeated = ceiling.route == "repeats" and group.n_runs > 1
        # Deviations from a mean of R runs have R - 1 degrees of freedom in R records.
        per_record = group.n_runs / (group.n_runs - 1) if repeated else 1.0
        for k, rows in enumerate(group.rows):
            time, r = signals.layout.time[rows], signals.residual[rows]
            block = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, N_BLOCKS - 1)
            values = signals.tapered(rows, r, np.ones(r.size))
            white = ceiling.noise.whitened(values, time)
            means.append(_sums_of_products(white[:, 1:], white[:, 0], block))
            known = signals.scored[rows]
            powers.append(_power_sums(remnant[k], known, block, ceiling, per_record))
            inner = white[values[:, 1] == 1.0, 0]
            n_rows += inner.size
            score = np.abs(inner) / max(np.std(inner), 1e-300)
            if score.size and score.max() > largest[0]:
                largest = float(score.max()), float(time[values[:, 1] == 1.0][score.argmax()])
                of_run = signals.run_label(int(group.runs[k]))
        response = coherent_part(signals, group, signals.predicted[group.rows])
        if response is not None:
            gains += _gain_sums(signals, ceiling, group, response, edges)
    rows = np.concatenate([group.rows.ravel() for group in signals.groups])
    response_share = np.sum(signals.predicted[rows] ** 2) / np.sum(signals.y[rows] ** 2)

    def of_gain(change: Break) -> float:
        before = (change.block + 1) / N_BLOCKS
        step = float(change.after[0] - change.before[0])
        return float(100 * step**2 * before * (1 - before) * response_share)

    def relative(change: Break) -> float:
        return change.ratio - 1

    def absolute(change: Break) -> float:
        return float(change.after[0] - change.before[0])

    def unknown(change: Break) -> float:
        return np.nan

    inf, free = np.inf, ceiling.noise.free
    found = [
        _break_test(name, parts, edges, known, what, size, cost)
        for name, parts, known, what, size, cost in (
            ("gain change", gains, inf, "one change of the response", relative, of_gain),
            ("remnant power change", powers, inf, "one change of its power", relative, unknown),
            ("mean change", means, free, "one change of the mean residual", absolute, unknown),
        )
        if parts
    ]
    p = float(of_several(np.full(n_rows, 2 * norm.sf(largest[0])))[0])
    return [
        *found,
        Test(
            "outlier",
            of_run,
            largest[0],
            p,
            where=largest[1],
            size=largest[0],
            description="largest whitened residual, in standard deviations",
        ),
    ]


def gain_over_time(signals: Signals, ceiling: Ceiling, edges: np.ndarray) -> pd.DataFrame | None:
    """Gain of the measured response relative to the predicted one, in windows."""
    sums: list[tuple[np.ndarray, np.ndarray]] = []
    for group in signals.groups:
        response = coherent_part(signals, group, signals.predicted[group.rows])
        if response is not None:
            sums += _gain_sums(signals, ceiling, group, response, edges)
    if not sums:
        return None
    g = sum(part[0][:, 0] for part in sums)
    V = sum(part[1][:, 0, 0] for part in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        return pd.DataFrame({"gain": 1 + g / V, "sd_gain": 1 / np.sqrt(V)})


def _gain_sums(
    signals: Signals, ceiling: Ceiling, group: Group, response: np.ndarray, edges: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    sums = []
    for k, rows in enumerate(group.rows):
        time, r = signals.layout.time[rows], signals.residual[rows]
        block = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, edges.size - 2)
        rate = np.gradient(response[k], signals.dt)
        z = response[k] - response[k].mean()
        white = ceiling.noise.whitened(signals.tapered(rows, r - r.mean(), z, rate), time)
        sums.append(_sums_of_products(white[:, 1:], white[:, 0], block, edges.size - 1))
    return sums


def _sums_of_products(
    Z: np.ndarray, r: np.ndarray, block: np.ndarray, n_blocks: int = N_BLOCKS
) -> tuple[np.ndarray, np.ndarray]:
    """Sums of z r and of z z' in blocks of time."""
    p = Z.shape[1]
    scores = np.column_stack([np.bincount(block, Z[:, i] * r, n_blocks) for i in range(p)])
    information = np.empty((n_blocks, p, p))
    for i in range(p):
        for j in range(i + 1):
            sums = np.bincount(block, Z[:, i] * Z[:, j], n_blocks)
            information[:, i, j] = information[:, j, i] = sums
    return scores, information


def _power_sums(
    remnant: np.ndarray,
    known: np.ndarray,
    block: np.ndarray,
    ceiling: Ceiling,
    per_record: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Relative power in blocks less its mean, and its variance in stationary Gaussian noise."""
    count = np.bincount(block, known, N_BLOCKS)
    average = float(np.mean(remnant[known] ** 2)) or 1.0
    # Information per sample, so that the coefficient is the relative power.
    each = per_record * 2 * ceiling.noise.correlation_time / ceiling.noise.dt
    scores = (np.bincount(block, remnant**2, N_BLOCKS) / average - count) / each
    return scores[:, None], (count / each)[:, None, None]


def _break_test(
    name: str,
    parts: list[tuple[np.ndarray, np.ndarray]],
    edges: np.ndarray,
    free: float,
    what: str,
    size: Callable[[Break], float],
    cost: Callable[[Break], float],
) -> Test:
    scores = np.sum([part[0] for part in parts], axis=0)
    information = np.sum([part[1] for part in parts], axis=0)
    change = largest_break(scores, information, free)
    return Test(
        name,
        "residual",
        change.statistic,
        change.p,
        where=float(edges[change.block + 1]),
        size=size(change),
        cost=cost(change),
        description=what,
    )


def _span(signals: Signals) -> tuple[float, float]:
    time = np.concatenate([signals.layout.time[group.rows].ravel() for group in signals.groups])
    return float(time.min()), float(time.max()) + signals.dt


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
    edges = np.unique(np.round(np.geomspace(1, top + 1, N_BANDS + 1)).astype(int))
    bands = [ratio[a - 1 : b - 1].mean(axis=0) for a, b in pairwise(edges)]
    centre = [np.sqrt(omega[a] * omega[b]) for a, b in pairwise(edges)]
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
