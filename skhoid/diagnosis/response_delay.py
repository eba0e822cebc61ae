"""The delay of the measured response against that of the model."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.signal.windows import hann
from scipy.stats import f as f_distribution

from .ceiling import Ceiling
from .coherent import bandwidth, coherent_part
from .repeats import Group
from .run_signals import Signals
from .tests_table import Test

N_DELAYS = 61
LONGEST = 0.6  # s
REACH = 6  # delays to either side, within which a ripple of the loss is no minimum
N_ITERATIONS = 8
MOST_BINS = 400  # of all groups
SHARE = 0.999  # of the power of the response, in the frequencies used
PARAMETERS = 5  # b0, b1, a1, a2 and the delay


def delay_test(signals: Signals, ceiling: Ceiling, lag: float) -> list[Test]:
    """Fit a gain, lead and second-order lag with every delay, to measurement and to model.

    H(jω) = (b0 + b1 jω) exp(-jωτ) / (1 + a1 jω + a2 (jω)²), the structure of Eq. 3 of the thesis,
    by iterated least squares (Sanathanan and Koerner 1963) at the frequencies at which there is a
    response, between the parts of signals that are caused from outside the loop. The search goes
    downhill from the delay of the model, and from there by the ``lag`` of the response (s).
    """
    spectra = _spectra(signals, ceiling)
    if spectra is None:
        return []
    (omega, E, U, M, S), power = spectra
    if omega.size < PARAMETERS:
        return []
    longest = min(LONGEST, signals.dt * min(group.n_samples for group in signals.groups) / 8)
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
