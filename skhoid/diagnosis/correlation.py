"""Correlation of the residual with signals of the loop.

With signals from outside the loop (f_t, f_d) this is the test of a fault that holds in a closed
loop: whatever its colour, the remnant is independent of them. With e and x it is shown, not tested:
remnant goes round the loop, so coloured remnant correlates with past e even for the exact model.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import fft
from scipy.linalg import toeplitz

from ..runs.roles import EXACT, is_external
from .breaks import tail_probability
from .ceiling import Ceiling
from .coherent import tap_spacing
from .run_signals import Signals
from .tests_table import Test

N_LAGS = 40  # on either side
LONGEST = 3.0  # s, for lags of loops that a person closes
N_DRAWS = 2000


def correlations(
    signals: Signals, ceiling: Ceiling, false_alarm: float
) -> tuple[pd.DataFrame, list[Test]]:
    """Cross-correlation of prewhitened residual and signals, with simultaneous bands."""
    tables, tests = [], []
    shown = [n for n in signals.channels if n in EXACT or is_external(n)]
    for name in shown:
        valid = name in signals.external
        found = _correlation(signals, ceiling, name)
        if found is None:
            continue
        lags, score, scale, largest = found
        limit = float(np.quantile(largest, 1 - false_alarm))
        k = int(np.argmax(np.abs(score)))
        tables.append(
            pd.DataFrame(
                {
                    "signal": name,
                    "lag": lags,
                    "correlation": score * scale,
                    "band": limit * scale,
                    "valid": valid,
                }
            )
        )
        statistic = float(abs(score[k]))
        what = f"{name}, from outside the loop" if valid else f"{name}: no test in a closed loop"
        tests.append(
            Test(
                "cross-correlation",
                name,
                statistic,
                tail_probability(statistic, largest),
                where=float(lags[k]),
                size=float(score[k] * scale),
                cost=_cost_of_target(signals, ceiling) if name == "f_t" else np.nan,
                valid=valid,
                description=f"largest prewhitened correlation of the residual with {what}",
            )
        )
    if not tables:
        columns = ["signal", "lag", "correlation", "band", "valid"]
        return pd.DataFrame(columns=columns), tests
    return pd.concat(tables, ignore_index=True), tests


def _correlation(
    signals: Signals, ceiling: Ceiling, name: str
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray] | None:
    """Lags (s), correlations in standard deviations, one of these, and draws of the largest."""
    pairs = []
    for group in signals.groups:
        for rows in group.rows:
            r, z = signals.residual[rows], signals.channels[name][rows]
            pair = signals.tapered(rows, r - r.mean(), z - z.mean())
            pairs.append(ceiling.noise.whitened(pair, signals.layout.time[rows]))
    shortest = min(len(pair) for pair in pairs)
    step = min(
        max(min(tap_spacing(pair[:, 1][None], signals.dt) for pair in pairs), 1),
        max(int(LONGEST / N_LAGS / signals.dt), 1),
    )
    n_lags = min(N_LAGS, shortest // (8 * step))
    power_r = sum(float(np.sum(pair[:, 0] ** 2)) for pair in pairs)
    power_z = sum(float(np.sum(pair[:, 1] ** 2)) for pair in pairs)
    if n_lags < 1 or power_r == 0 or power_z == 0:
        return None
    lags = step * np.arange(-n_lags, n_lags + 1)
    cross, auto = np.zeros(lags.size), np.zeros(2 * n_lags + 1)
    for pair in pairs:
        # scipy.signal.correlate would transform each signal twice, and round otherwise.
        size = fft.next_fast_len(len(pair) + int(lags[-1]) * 2, real=True)
        R, Z = fft.rfft(pair[:, 0], size), fft.rfft(pair[:, 1], size)
        cross += fft.irfft(R * Z.conj(), size)[lags]
        auto += fft.irfft(np.abs(Z) ** 2, size)[step * np.arange(2 * n_lags + 1)]
    values, vectors = np.linalg.eigh(toeplitz(auto / power_z))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    # The same draws for equal data; the largest of them has the distribution without a fault.
    draws = np.random.default_rng(0).standard_normal((N_DRAWS, lags.size)) @ root.T
    return (
        lags * signals.dt,
        cross / np.sqrt(power_z),  # whitened noise has the density 1
        float(1 / np.sqrt(power_r)),
        np.abs(draws).max(axis=1),
    )


def _cost_of_target(signals: Signals, ceiling: Ceiling) -> float:
    """VAF points of the residual at the excited lines, less the noise there."""
    lost = power = 0.0
    for group in signals.groups:
        if group.lines is None:
            return np.nan
        R = fft.rfft(signals.residual[group.rows], axis=1, norm="ortho")[:, group.lines]
        noise = ceiling.noise.at(group.omega(signals.dt)[group.lines])
        lost += 2 * float(np.sum(group.n_runs * np.abs(R.mean(axis=0)) ** 2 - noise))
        power += float(np.sum(signals.y[group.rows] ** 2))
    return max(100 * lost / power, 0.0)
