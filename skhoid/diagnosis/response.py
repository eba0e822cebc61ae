"""Errors of the whole response: gain, lag, bias and delay, and what the residual follows."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import fft
from scipy.linalg import toeplitz
from scipy.signal.windows import hann
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

from ..runs.roles import EXACT, is_external
from .ceiling import Ceiling
from .over_time import tail_probability
from .repeats import Group
from .signals import Signals, bandwidth, coherent_part, tap_spacing
from .tests_table import FALSE_ALARM, Test, draw_normals


def linear_misfit(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Gain, lag and bias by which the prediction differs from the measured response.

    Of u = (1 + g) û(t - τ) + b: the residual is regressed on the coherent part of û, its rate and
    1.
    """
    responses = _responses(signals)
    if not responses:
        return []
    g, V = np.zeros(3), np.zeros((3, 3))
    for group, response in responses:
        for k, rows in enumerate(group.rows):
            z = response[k]
            rate, ones = np.gradient(z, signals.dt), np.ones(rows.size)
            values = signals.tapered(rows, signals.residual[rows], z, rate, ones)
            white = ceiling.noise.whitened(values, signals.layout.time[rows])
            g += white[:, 1:].T @ white[:, 0]
            V += white[:, 1:].T @ white[:, 1:]
    scale = np.sqrt(np.diag(V))
    if np.any(scale == 0) or np.linalg.cond(V / np.outer(scale, scale)) > 1e10:
        return []
    c, sd = np.linalg.solve(V, g), np.sqrt(np.diag(np.linalg.inv(V)))
    rows = np.concatenate([group.rows.ravel() for group, _ in responses])
    power = np.sum(signals.y[rows] ** 2)
    rate = np.gradient(signals.predicted[rows], signals.dt)
    shares = np.array([np.sum(signals.predicted[rows] ** 2), np.sum(rate**2), rows.size]) / power
    tests = []
    for name, value, spread, sign, share, what in (
        (
            "gain",
            c[0],
            sd[0],
            1,
            shares[0],
            "gain of the measured response, over the predicted, less 1",
        ),
        ("lag", c[1], sd[1], -1, shares[1], "time (s) by which the measured response is later"),
        ("bias", c[2], sd[2], 1, shares[2], "mean of the residual"),
    ):
        z = value / spread
        p = float(2 * t_distribution.sf(abs(z), ceiling.noise.free))
        cost = float(100 * value**2 * share)
        tests.append(
            Test(name, signals.output, z, p, size=sign * value, cost=cost, description=what)
        )
    return tests


def _responses(signals: Signals) -> list[tuple[Group, np.ndarray]]:
    """The part of the prediction that is caused from outside the loop, without its mean."""
    found = []
    for group in signals.groups:
        response = coherent_part(signals, group, "predicted")
        if response is not None:
            response = response - response.mean(axis=1, keepdims=True)
            if response.any():
                found.append((group, response))
    return found


N_DELAYS = 61
LONGEST_DELAY = 0.6  # s
REACH = 6  # delays to either side, within which a ripple of the loss is no minimum
N_ITERATIONS = 8
MOST_BINS = 400  # of all groups
SHARE = 0.999  # of the power of the response, in the frequencies used
PARAMETERS = 5  # b0, b1, a1, a2 and the delay


def delay_test(signals: Signals, ceiling: Ceiling, lag: float) -> list[Test]:
    """Fit a gain, lead and second-order lag with every delay, to measurement and to model.

    H(jω) = (b0 + b1 jω) exp(-jωτ) / (1 + a1 jω + a2 (jω)²), as Eq. 3 of the thesis, by iterated
    least squares (Sanathanan and Koerner 1963); downhill from the model's delay, and from there by
    the ``lag``.
    """
    spectra = _spectra(signals, ceiling)
    if spectra is None:
        return []
    (omega, E, U, M, S), power = spectra
    if omega.size < PARAMETERS:
        return []
    longest = min(LONGEST_DELAY, signals.dt * min(group.n_samples for group in signals.groups) / 8)
    delays = np.linspace(0, longest, N_DELAYS)
    measured, beside = np.array([_misfit(omega, E, U, S, tau) for tau in delays]).T
    model, _ = np.array([_misfit(omega, E, M, S, tau) for tau in delays]).T
    of_model = int(np.argmin(model))
    by_lag = int(np.clip(round((delays[of_model] + lag) / delays[1]), 0, N_DELAYS - 1))
    best = min(
        (_nearest_minimum(measured, start) for start in (of_model, by_lag)),
        key=lambda k: float(measured[k]),
    )
    free = 2 * omega.size - PARAMETERS
    scatter = max(measured[best] / free, 1.0)
    fall = float((measured[of_model] - measured[best]) / scatter)
    # A response with that delay may be better than the same with another, and worse than the model.
    own = float(np.sum(2 * np.abs(U - M) ** 2))
    won = min(float(beside[of_model]), own) - float(beside[best])
    cost = 100 * max(won, 0.0) / power
    return [
        Test(
            "delay",
            signals.output,
            fall,
            float(f_distribution.sf(fall, 1, free)),
            size=_refined(delays, measured, best) - _refined(delays, model, of_model),
            cost=cost,
            where=_refined(delays, measured, best),
            description="delay (s) of the measured response, beyond that of the predicted one",
        )
    ]


def _spectra(signals: Signals, ceiling: Ceiling) -> tuple[tuple[np.ndarray, ...], float] | None:
    """Frequencies, and driving signal, output, prediction and noise there; power of the output."""
    if signals.driving is None:
        return None
    parts = []
    power = 0.0
    for group in signals.groups:
        found = _of_group(signals, ceiling, group, signals.driving)
        if found is not None:
            parts.append(found)
            power += float(np.sum(signals.y[group.rows] ** 2))
    if not parts:
        return None
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True)), power


def _of_group(
    signals: Signals, ceiling: Ceiling, group: Group, driving: str
) -> tuple[np.ndarray, ...] | None:
    means = []
    for name in (driving, "y", "predicted"):
        if group.n_runs == 1 and group.lines is None and driving != "f_t":
            coherent = coherent_part(signals, group, name)
            if coherent is None:
                return None
            of_runs = coherent
        else:
            of_runs = signals.named(name)[group.rows]
        # The mean over runs adds no remnant of its own but what is over their number.
        means.append(of_runs.mean(axis=0))
    omega = group.omega(signals.dt)
    top = bandwidth(means[2][None], signals.dt, SHARE)
    bins = np.flatnonzero((omega > 0) & (omega <= top))
    window = np.ones(group.n_samples)
    if group.lines is not None:
        bins = np.intersect1d(group.lines, np.flatnonzero(ceiling.noise.known(omega)))
    else:
        window = hann(group.n_samples, sym=False)
        window /= np.sqrt(np.mean(window**2))
    if not bins.size or not means[2].any():
        return None
    bins = bins[:: -(-bins.size * len(signals.groups) // MOST_BINS)]
    root = np.sqrt(group.n_runs)
    spectra = [root * fft.rfft((mean - mean.mean()) * window, norm="ortho")[bins] for mean in means]
    return omega[bins], *spectra, ceiling.noise.at(omega[bins])


def _misfit(
    omega: np.ndarray, E: np.ndarray, U: np.ndarray, S: np.ndarray, delay: float
) -> tuple[float, float]:
    """Squared misfit of the best response with one delay: over the noise, and in power."""
    s = 1j * omega / omega.max()
    input_ = E * np.exp(-1j * omega * delay)
    denominator = np.ones_like(s)
    columns = np.column_stack([input_, s * input_, -s * U, -(s**2) * U])
    error = U
    for _ in range(N_ITERATIONS):
        weight = 1 / (np.sqrt(S) * np.abs(denominator))
        A, b = columns * weight[:, None], U * weight
        unit = np.sqrt(np.sum(np.abs(A) ** 2, axis=0))
        A /= np.where(unit > 0, unit, 1.0)
        gram = np.real(A.conj().T @ A) + 1e-12 * np.eye(A.shape[1])
        c = np.linalg.solve(gram, np.real(A.conj().T @ b)) / np.where(unit > 0, unit, 1.0)
        denominator = 1 + c[2] * s + c[3] * s**2
        error = U - (c[0] + c[1] * s) * input_ / denominator
    return float(np.sum(2 * np.abs(error) ** 2 / S)), float(np.sum(2 * np.abs(error) ** 2))


def _nearest_minimum(loss: np.ndarray, start: int) -> int:
    """Downhill from the start: a slow target allows far delays with a lead of equal size."""
    at = start
    while True:
        around = range(max(at - REACH, 0), min(at + REACH + 1, loss.size))
        lowest = min(around, key=lambda k: float(loss[k]))
        if loss[lowest] >= loss[at]:
            return at
        at = lowest


def _refined(delays: np.ndarray, loss: np.ndarray, k: int) -> float:
    """Minimum of a parabola through a smallest loss and its neighbours."""
    if k in (0, loss.size - 1):
        return float(delays[k])
    below, at, above = loss[k - 1 : k + 2]
    curvature = below - 2 * at + above
    shift = 0.5 * (below - above) / curvature if curvature > 0 else 0.0
    return float(delays[k] + shift * (delays[1] - delays[0]))


N_LAGS = 40  # on either side
LONGEST_LAG = 3.0  # s, for lags of loops that a person closes


def correlations(signals: Signals, ceiling: Ceiling) -> tuple[pd.DataFrame, list[Test]]:
    """Cross-correlation of prewhitened residual and signals, with simultaneous bands."""
    tables, tests = [], []
    shown = [n for n in signals.channels if n in EXACT or is_external(n)]
    for name in shown:
        valid = name in signals.external
        found = _correlation(signals, ceiling, name)
        if found is None:
            continue
        lags, score, scale, largest = found
        limit = float(np.quantile(largest, 1 - FALSE_ALARM))
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
        max(int(LONGEST_LAG / N_LAGS / signals.dt), 1),
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
    # The largest of them has the distribution without a fault.
    draws = draw_normals(toeplitz(auto / power_z), np.random.default_rng(0))
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
