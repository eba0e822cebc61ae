"""What a controlled element received, from its response: band, low-pass, inverse of low order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
    rows, n = triangle(_instruments_rates_output(piece, dt, taps) for piece in low)
    n_rates = 4 + ("disturbance" in low[0])
    Z, D, u = rows[:, : -n_rates - 1], rows[:, -n_rates - 1 : -1], rows[:, -1]
    if n <= 2 * Z.shape[1]:
        return "the runs are too short to estimate the controlled element"
    caused = Z @ np.linalg.lstsq(Z, D, rcond=1e-9)[0]
    ones = D[:, 3]
    caused_rate, rate = (each[:, 1] - ones * (ones @ each[:, 1]) / n for each in (caused, D))
    if not caused_rate @ caused_rate > LEAST_INSTRUMENT * (rate @ rate):
        return (
            "the controlled element is not given, and its response to the target is too weak to "
            "estimate it from"
        )
    scale = np.sqrt(np.sum(caused**2, axis=0) / n)
    scale[scale == 0] = 1.0
    c = np.linalg.lstsq(caused / scale, u, rcond=1e-6)[0] / scale
    return [_rates(piece["x"], dt) @ c[:4] for piece in low]


def _instruments_rates_output(piece: Mapping[str, np.ndarray], dt: float, taps: int) -> np.ndarray:
    """What the element answers, what it does, and the output, in rows where all are known."""
    lags = np.arange(-2, N_INSTRUMENTS - 2) * taps
    beside = [piece["disturbance"]] if "disturbance" in piece else []
    outside = [lagged(piece[name], lags) for name in EXTERNAL if name in piece]
    table = np.column_stack(
        [*outside, np.ones_like(piece["x"]), *beside, _rates(piece["x"], dt), *beside, piece["u"]]
    )
    return table[np.isfinite(table[:, : len(lags) * len(outside)]).all(axis=1)]


def _rates(x: np.ndarray, dt: float) -> np.ndarray:
    """Derivatives of the element's output, itself, and ones."""
    rate = np.gradient(x, dt)
    return np.column_stack([np.gradient(rate, dt), rate, x, np.ones_like(x)])


def triangle(tables: Iterable[np.ndarray]) -> tuple[np.ndarray, int]:
    """A table of few rows with the sums of products of all tables, one below the other.

    That is R of their QR factorisation; least squares with it are those with the whole. Also the
    number of rows of the whole.
    """
    R: Any = None
    n = 0
    for table in tables:
        n += len(table)
        R = np.linalg.qr(table if R is None else np.concatenate([R, table]), mode="r")
    return R, n


def lagged(signal: np.ndarray, lags: Any) -> np.ndarray:
    """Columns signal(t - lag), NaN where the signal is not known."""
    n = signal.size
    out = np.full((n, len(lags)), np.nan)
    for column, lag in enumerate(lags):
        if abs(lag) < n:
            out[max(lag, 0) : n + min(lag, 0), column] = signal[max(-lag, 0) : n - max(lag, 0)]
    return out
