"""The residual over time in the run: windows, map over frequency, and single changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann
from scipy.stats import chi2, norm
from scipy.stats import f as f_distribution

from .ceiling import Ceiling, Route
from .repeats import Group
from .signals import Signals, coherent_part
from .tests_table import FALSE_ALARM, N_DRAWS, Test, correct_for_several, of_one

TRIM = 0.05  # of the information, at either end, where no change is looked for


@dataclass(frozen=True)
class Break:
    """The most likely change: the block after which it is, its statistic, p, and coefficients."""

    block: int
    statistic: float
    p: float
    before: np.ndarray
    after: np.ndarray

    @property
    def ratio(self) -> float:
        """One plus the first coefficient, after the change over before."""
        return float((1 + self.after[0]) / max(1 + self.before[0], 1e-3))


def largest_break(
    scores: np.ndarray, information: np.ndarray, free: float = np.inf
) -> Break | None:
    """Look for one change of coefficients c in r = Z c + n over all instants.

    By the largest Lagrange multiplier (Andrews 1993, Econometrica 61: 821), with the p-value of the
    fixed regressor bootstrap (Hansen 2000, Journal of Econometrics 97: 93). ``scores`` are sums of
    z n by block, ``information`` their covariances under noise alone.
    """
    n_blocks, p = scores.shape
    total = information.sum(axis=0)
    if not np.trace(total) > 0:
        return None
    before = np.cumsum(information, axis=0)[:-1]
    share = np.trace(before, axis1=1, axis2=2) / np.trace(total)
    at = np.flatnonzero((share > TRIM) & (share < 1 - TRIM))
    if at.size == 0:
        return None
    before = before[at]
    inverse = np.linalg.pinv(total, rcond=1e-9)
    bridge = np.linalg.pinv(before - before @ inverse @ before, rcond=1e-9, hermitian=True)

    def largest(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        path = np.cumsum(sums, axis=-2)
        S = path[..., at, :] - np.einsum("kij,jl,...l->...ki", before, inverse, path[..., -1, :])
        lm = np.einsum("...ki,kij,...kj->...k", S, bridge, S)
        return lm.argmax(axis=-1), lm.max(axis=-1)

    best, found = largest(scores)
    rng = np.random.default_rng(0)  # the reference distribution, the same for equal data
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :] @ vectors.swapaxes(1, 2)
    draws = np.einsum("bij,dbj->dbi", root, rng.standard_normal((N_DRAWS, n_blocks, p)))
    _, reference = largest(draws)
    if np.isfinite(free):
        reference = reference / (rng.chisquare(free, N_DRAWS) / free)
    k = int(best)
    first = np.linalg.pinv(before[k]) @ scores[: at[k] + 1].sum(axis=0)
    last = np.linalg.pinv(total - before[k]) @ scores[at[k] + 1 :].sum(axis=0)
    p_value = tail_probability(float(found), reference)
    return Break(int(at[k]), float(found), p_value, first, last)


def tail_probability(value: float, reference: np.ndarray) -> float:
    """Fraction of draws beyond a value; beyond the last ones, their exponential tail goes on."""
    n = reference.size
    top = np.sort(reference)[-(n // 20) :]
    if value <= top[0]:
        return float((1 + np.sum(reference >= value)) / (1 + n))
    return float(top.size / n * np.exp(-(value - top[0]) / np.mean(top - top[0])))


N_BLOCKS = 160
Sums = tuple[np.ndarray, np.ndarray]  # of z r and of z z' in blocks of time


@dataclass(frozen=True)
class BlockSums:
    """Sums over blocks of time that tests of changes start from, by run.

    ``gains`` test: with what the response owes to causes outside the loop. ``placing``, with the
    whole response, show when, and would test nothing in a closed loop.
    """

    edges: np.ndarray
    gains: list[Sums]
    placing: list[Sums]
    powers: list[Sums]
    means: list[Sums]
    outlier: Test

    @classmethod
    def of(cls, signals: Signals, ceiling: Ceiling) -> BlockSums:
        """Walk through the runs once."""
        start, stop = time_span(signals)
        edges = np.linspace(start, stop, N_BLOCKS + 1)
        gains, placing, powers, means, largest = [], [], [], [], (0.0, np.nan)
        n_rows, of_run = 0, ""
        for group, remnant in zip(signals.groups, ceiling.remnant, strict=True):
            repeated = ceiling.route is Route.REPEATS and group.n_runs > 1
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
            response = coherent_part(signals, group, "predicted")
            if response is not None:
                gains += _gain_sums(signals, ceiling, group, response, edges)
                whole = signals.predicted[group.rows]
                placing += _gain_sums(signals, ceiling, group, whole, edges)
        p = float(correct_for_several(2 * norm.sf(largest[0]), n_rows))
        outlier = Test(
            "outlier",
            of_run,
            largest[0],
            p,
            where=largest[1],
            size=largest[0],
            description="largest whitened residual, in standard deviations",
        )
        return cls(edges, gains, placing, powers, means, outlier)


def tests_of_changes(signals: Signals, ceiling: Ceiling, sums: BlockSums) -> list[Test]:
    """Changes of the response, of the remnant's power and of the mean; single outliers."""
    found = [sums.outlier]
    change = _largest(sums.gains)
    if change is not None:
        rows = np.concatenate([group.rows.ravel() for group in signals.groups])
        share = np.sum(signals.predicted[rows] ** 2) / np.sum(signals.y[rows] ** 2)
        before = (change.block + 1) / N_BLOCKS
        step = float(change.after[0] - change.before[0])
        cost = float(100 * step**2 * before * (1 - before) * share)
        size = change.ratio - 1
        placed = _largest(sums.placing) or change
        test = _test("gain change", change, sums, size, "of the response", cost)
        found.append(replace(test, where=float(sums.edges[placed.block + 1])))
    change = _largest(sums.powers)
    if change is not None:
        found.append(_test("remnant power change", change, sums, change.ratio - 1, "of its power"))
    change = _largest(sums.means, ceiling.noise.free)
    if change is not None:
        before = (change.block + 1) / N_BLOCKS
        step = float(change.after[0] - change.before[0])
        power = float(np.mean(signals.y[signals.scored] ** 2))
        cost = 100 * step**2 * before * (1 - before) / power
        found.append(_test("mean change", change, sums, step, "of the mean residual", cost))
    return found


def _largest(parts: list[Sums], free: float = np.inf) -> Break | None:
    if not parts:
        return None
    scores = np.sum([part[0] for part in parts], axis=0)
    return largest_break(scores, np.sum([part[1] for part in parts], axis=0), free)


def _test(
    name: str, change: Break, sums: BlockSums, size: float, what: str, cost: float = np.nan
) -> Test:
    return Test(
        name,
        "residual",
        change.statistic,
        change.p,
        where=float(sums.edges[change.block + 1]),
        size=size,
        cost=cost,
        description=f"largest single change {what} in the run",
    )


def gain_over_time(signals: Signals, ceiling: Ceiling, edges: np.ndarray) -> pd.DataFrame | None:
    """Gain of the measured response relative to the predicted one, in windows."""
    sums: list[Sums] = []
    for group in signals.groups:
        response = coherent_part(signals, group, "predicted")
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
) -> list[Sums]:
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
) -> Sums:
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
) -> Sums:
    """Relative power in blocks less its mean, and its variance in stationary Gaussian noise."""
    count = np.bincount(block, known, N_BLOCKS)
    average = float(np.mean(remnant[known] ** 2)) or 1.0
    # Information per sample, so that the coefficient is the relative power.
    each = per_record * 2 * ceiling.noise.correlation_time / ceiling.noise.dt
    scores = (np.bincount(block, remnant**2, N_BLOCKS) / average - count) / each
    return scores[:, None], (count / each)[:, None, None]


def time_span(signals: Signals) -> tuple[float, float]:
    time = np.concatenate([signals.layout.time[group.rows].ravel() for group in signals.groups])
    return float(time.min()), float(time.max()) + signals.dt


N_WINDOWS = 16
SHORTEST = 1.0  # s, of a window
N_BANDS = 14  # of the map


def by_time(signals: Signals, ceiling: Ceiling) -> pd.DataFrame:
    """Residual of all runs, and of each, in windows of time in the run."""
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
    table = _table_of_windows(edges, names, np.array(sums), signals.dt, ceiling)
    together = table[: np.count_nonzero(sums[0][0])]
    more = pd.DataFrame(_repeating(signals, ceiling, edges, together), index=together.index)
    gain = gain_over_time(signals, ceiling, edges)
    if gain is not None and len(together) == len(gain):
        more = more.join(gain)
    table = table.join(more)
    table["exceeds"] = table["p"] < FALSE_ALARM
    return table


def _table_of_windows(
    edges: np.ndarray,
    names: list[str],
    sums: np.ndarray,
    dt: float,
    ceiling: Ceiling,
) -> pd.DataFrame:
    """Rows for the windows of all runs, and of each; ``sums`` of samples, y² and r²."""
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
    p = correct_for_several(2 * np.where(np.isfinite(F), tail, 0.5), n_windows)
    views = np.where(run == 0, 1, len(names) - 1)
    each = of_one(FALSE_ALARM / views, n_windows) / 2
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
        "p_explainable": correct_for_several(np.nan_to_num(p, nan=1.0))[used],
    }


def _edges(signals: Signals) -> np.ndarray:
    time = signals.layout.time[signals.scored]
    start, stop = float(time.min()), float(time.max()) + signals.dt
    n = int(np.clip((stop - start) / SHORTEST, 1, N_WINDOWS))
    return np.linspace(start, stop, n + 1)


def _windows(edges: np.ndarray, time: np.ndarray, dt: float) -> np.ndarray:
    """Number of the window that each instant is in."""
    return np.clip(np.searchsorted(edges, time + dt / 4, side="right") - 1, 0, edges.size - 2)


def time_frequency(signals: Signals, ceiling: Ceiling) -> pd.DataFrame:
    """Residual power over time and frequency, relative to the noise expected there."""
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
    beyond = of_one(FALSE_ALARM, table.size)
    table.attrs["limit"] = (chi2.isf(beyond, free) / free).tolist()
    return table
