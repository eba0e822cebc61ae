"""What a controlled element received, from its response: band, low-pass, inverse of low order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import fft

LEAST_INSTRUMENT = 0.05  # of the power of the element's rate, explained by the target
ORDER = 8  # of the low-pass filter
NULL = 1e-3  # of the gain of the numerator at rest; at its zeros nothing can be divided
N_INSTRUMENTS = 24  # taps of the target from which the element is estimated
EXTERNAL = ("target", "disturbance")


def band_edge(outputs: Sequence[np.ndarray], dt: float, power_share: float) -> float:
    """Frequency (Hz) below which outputs have a share of their power; 0 of those that rest."""
    longest = max(output.size for output in outputs)
    power = np.zeros(longest // 2 + 1)
    for output in outputs:
        power += np.abs(fft.rfft(output - output.mean(), longest)) ** 2
    if not power.any():
        return 0.0
    share = np.cumsum(power) / power.sum()
    return float(fft.rfftfreq(longest, dt)[max(int(np.searchsorted(share, power_share)), 1)])


def low_passed(
    signal: np.ndarray, dt: float, edge: float, divide: np.ndarray | None = None
) -> np.ndarray:
    """A signal below the edge (Hz), without delay; divided there by a polynomial of q^-1.

    Odd reflections at both ends continue what neither starts nor ends at zero.
    """
    n = signal.size
    pad = min(n - 1, int(2 / (edge * dt)) + 1)
    longer = np.concatenate(
        [
            2 * signal[0] - signal[pad:0:-1],
            signal,
            2 * signal[-1] - signal[-2 : -pad - 2 : -1],
        ]
    )
    size = fft.next_fast_len(longer.size, real=True)
    frequency = fft.rfftfreq(size, dt)
    gain = 1 / (1 + (frequency / edge) ** ORDER) + 0j
    if divide is not None:
        b = np.polynomial.polynomial.polyval(np.exp(-2j * np.pi * frequency * dt), divide)
        small = np.abs(b) < NULL * np.abs(b).max()
        gain = np.where(small, 0.0, gain / np.where(small, 1.0, b))
    # What an offset at one end leaves in the transform would ring: it is taken out, and put back.
    level = longer.mean()
    filtered = fft.irfft(fft.rfft(longer - level, size) * gain, size)[pad : pad + n]
    return filtered + level * gain[0].real


def estimated_inverse(
    low: Sequence[Mapping[str, np.ndarray]], dt: float, taps: int
) -> list[np.ndarray] | str:
    """The inverse of an element of second order at most, u = c2 x'' + c1 x' + c0 x + c.

    Two-stage least squares: u answers the disturbance in the loop, and the target owes nothing to
    it. A recorded disturbance acts beside u. Derivatives are central differences of what has been
    low-passed.
    """
    if not any(name in piece for piece in low for name in EXTERNAL):
        return (
            "the controlled element is not given, and without a target its estimate from u and x "
            "is biased by the loop"
        )
    rates, instruments = [], []
    for piece in low:
        x = piece["x"]
        rate = np.gradient(x, dt)
        beside = [piece["disturbance"]] if "disturbance" in piece else []
        rates.append(np.column_stack([np.gradient(rate, dt), rate, x, np.ones_like(x), *beside]))
        lags = np.arange(-2, N_INSTRUMENTS - 2) * taps
        outside = [lagged(piece[name], lags) for name in EXTERNAL if name in piece]
        instruments.append(np.column_stack([*outside, np.ones_like(x), *beside]))
    kept = [np.isfinite(Z).all(axis=1) for Z in instruments]
    D, Z = (
        np.concatenate([part[rows] for part, rows in zip(parts, kept, strict=True)])
        for parts in (rates, instruments)
    )
    if len(Z) <= 2 * Z.shape[1]:
        return "the runs are too short to estimate the controlled element"
    u = np.concatenate([piece["u"][rows] for piece, rows in zip(low, kept, strict=True)])
    caused = Z @ np.linalg.lstsq(Z, D, rcond=1e-9)[0]
    if not np.var(caused[:, 1]) > LEAST_INSTRUMENT * np.var(D[:, 1]):
        return (
            "the controlled element is not given, and its response to the target is too weak to "
            "estimate it from"
        )
    scale = np.sqrt(np.mean(caused**2, axis=0))
    scale[scale == 0] = 1.0
    c = np.linalg.lstsq(caused / scale, u, rcond=1e-6)[0] / scale
    return [rate[:, :4] @ c[:4] for rate in rates]


def lagged(signal: np.ndarray, lags: Any) -> np.ndarray:
    """Columns signal(t - lag), NaN where the signal is not known."""
    n = signal.size
    out = np.full((n, len(lags)), np.nan)
    for column, lag in enumerate(lags):
        if abs(lag) < n:
            out[max(lag, 0) : n + min(lag, 0), column] = signal[max(-lag, 0) : n - max(lag, 0)]
    return out
