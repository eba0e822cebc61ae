"""Changes during the run: of the response, the remnant's power and the mean; CUSUMs, outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import kstwobign, norm

from .breaks import Break, largest_break
from .ceiling import Ceiling
from .coherent import coherent_part
from .repeats import Group
from .run_signals import Signals
from .tests_table import Test, of_several

N_BLOCKS = 160
Sums = tuple[np.ndarray, np.ndarray]  # of z r and of z z' in blocks of time


@dataclass(frozen=True)
class BlockSums:
    """Sums over blocks of time that tests of changes and CUSUMs start from, by run.

    ``gains`` are those with what the response owes to causes outside the loop: they test.
    ``placing`` are those with the whole response, which went on where the target rested: they
    show when, and would test nothing in a closed loop.
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
            response = coherent_part(signals, group, "predicted")
            if response is not None:
                gains += _gain_sums(signals, ceiling, group, response, edges)
                whole = signals.predicted[group.rows]
                placing += _gain_sums(signals, ceiling, group, whole, edges)
        p = float(of_several(2 * norm.sf(largest[0]), n_rows))
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


def cusum(ceiling: Ceiling, sums: BlockSums, false_alarm: float) -> pd.DataFrame:
    """CUSUM of the whitened residual, and of the squares of the remnant, over time in the run.

    Both are tied down at the ends and in standard deviations of the whole sum: Brownian bridges
    if nothing changes. ``band`` is what their largest excursion exceeds at the false-alarm rate
    (Brown, Durbin and Evans 1975; Inclan and Tiao 1994).
    """
    columns = {"time": sums.edges[1:]}
    for name, parts in (("cusum", sums.means), ("cusum_of_squares", sums.powers)):
        scores = np.sum([part[0][:, 0] for part in parts], axis=0)
        information = np.sum([part[1][:, 0, 0] for part in parts], axis=0)
        path, passed = np.cumsum(scores), np.cumsum(information)
        total = passed[-1] if passed[-1] > 0 else 1.0
        columns[name] = (path - passed / total * path[-1]) / np.sqrt(total)
    return pd.DataFrame(columns | {"band": float(kstwobign.isf(false_alarm))})


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
