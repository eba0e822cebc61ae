"""Runs against each other: outliers, learning, lost control, and VAF and RMSE of each."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import norm

from ..metrics import VAF_FLOOR
from ..recordings.loss_of_control import WINDOW, ControlCheck
from .ceiling import Ceiling
from .signals import Signals
from .tests_table import Test, correct_for_several


def by_run(signals: Signals, data: str) -> pd.DataFrame:
    """VAF, one-step VAF and RMSE of each run."""
    keep = signals.scored
    free = _vaf(signals, signals.predicted)
    known = keep & np.isfinite(signals.one_step)
    ahead = _vaf(signals, np.where(known, signals.one_step, np.nan), known)
    target = np.full(len(signals.layout.labels), -1)
    for number, group in enumerate(signals.groups):
        target[group.runs] = number
    rows = np.flatnonzero(keep)
    run = signals.layout.run_of(rows)
    n = len(signals.layout.labels)
    count = np.bincount(run, minlength=n)
    lost = np.bincount(run, signals.residual[rows] ** 2, n)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_square = lost / count
        ratio = mean_square / np.nanmedian(mean_square) if lost.any() else np.ones(n)
    return pd.DataFrame(
        {
            "data": data,
            "run": [signals.run_label(k) for k in range(n)],
            "target": target,
            "duration": count * signals.dt,
            "vaf": free,
            "one_step_vaf": ahead,
            "rmse": np.sqrt(mean_square),
            "ratio": ratio,
            "p": np.nan,
            "exceeds": False,
        }
    )


def _vaf(signals: Signals, prediction: np.ndarray, keep: np.ndarray | None = None) -> np.ndarray:
    rows = np.flatnonzero(signals.scored if keep is None else keep)
    run, n = signals.layout.run_of(rows), len(signals.layout.labels)
    lost = np.bincount(run, (signals.y[rows] - prediction[rows]) ** 2, n)
    power = np.bincount(run, signals.y[rows] ** 2, n)
    with np.errstate(invalid="ignore", divide="ignore"):
        vaf = np.maximum(100 * (1 - lost / power), VAF_FLOOR)
    return np.where(power > 0, vaf, np.nan)  # a run in which the output is at rest has no VAF


def tests_over_runs(signals: Signals, ceiling: Ceiling) -> tuple[np.ndarray, list[Test]]:
    """P-value of each run's residual power, and tests of outlying runs, learning, lost control."""
    n = len(signals.layout.labels)
    p = np.full(n, np.nan)
    tests = []
    used = np.array([r for group in signals.groups for r in group.runs])
    duration = np.array(
        [group.n_samples * signals.dt for group in signals.groups for _ in group.runs]
    )
    power = np.array(
        [np.mean(signals.residual[rows] ** 2) for group in signals.groups for rows in group.rows]
    )
    if used.size >= 3 and np.all(power > 0):
        order = np.argsort(used)
        used, duration, power = used[order], duration[order], power[order]
        free = duration / (ceiling.noise.correlation_time * ceiling.noise.unevenness)
        # The logarithm of a mean square with f degrees of freedom scatters by about sqrt(2 / f).
        log = np.log(power)
        scatter = np.sqrt(2 / free)
        each = (log - _centre_of_others(log)) / np.sqrt(scatter**2 + _spread_of_centre(scatter))
        alone = correct_for_several(2 * norm.sf(np.abs(each)))
        p[used] = alone
        worst = int(np.argmax(np.abs(each)))
        tests.append(
            Test(
                "outlying run",
                signals.run_label(int(used[worst])),
                float(each[worst]),
                float(alone[worst]),
                where=float(used[worst]),
                size=float(np.exp(log[worst] - np.median(log))),
                description="residual power of one run compared with the others",
            )
        )
        centred = np.arange(used.size) - (used.size - 1) / 2
        slope = float(centred @ log / (centred @ centred))
        sd = float(np.sqrt((centred**2) @ scatter**2) / (centred @ centred))
        tests.append(
            Test(
                "learning",
                signals.output,
                slope / sd,
                float(2 * norm.sf(abs(slope / sd))),
                size=float(100 * np.expm1(slope)),
                description="trend of the residual power from run to run (percent per run)",
            )
        )
    tests += _lost_control(signals)
    return p, tests


def _centre_of_others(values: np.ndarray) -> np.ndarray:
    """Median (of many values) or mean (of few) of all values but each."""
    n = values.size - 1
    if n < 4:
        return (values.sum() - values) / n
    order = np.argsort(values, kind="stable")
    place = np.empty(n + 1, dtype=int)
    place[order] = np.arange(n + 1)
    # Without one value, those that were beyond it move down by a place.
    middle = [values[order[at + (place <= at)]] for at in ((n - 1) // 2, n // 2)]
    return (middle[0] + middle[1]) / 2


def _spread_of_centre(scatter: np.ndarray) -> np.ndarray:
    """Variance of that centre, of independent values with these standard deviations."""
    n = scatter.size - 1
    factor = np.pi / 2 if n >= 4 else 1.0
    return factor * (np.sum(scatter**2) - scatter**2) / n**2


def _lost_control(signals: Signals) -> list[Test]:
    """Each run in which control was lost; else the one with the largest error for what is usual."""
    found = signals.control if signals.driving == "e" else ControlCheck()
    seen: dict[str, tuple[float, float]] = {}
    for stretch in found.stretches:
        begin, times = seen.get(stretch.label, (stretch.begin, 0.0))
        seen[stretch.label] = begin, max(times, stretch.times)
    if not seen and found.run >= 0:
        seen[signals.run_label(found.run)] = found.begin, found.times
    return [
        Test(
            "lost control",
            run,
            times,
            np.nan,
            where=begin,
            size=times,
            description=f"largest error over {WINDOW:g} s, over what is usual in the runs",
            rule=bool(found.stretches),
        )
        for run, (begin, times) in seen.items()
    ]
