"""Spectrum and envelope of the part of residuals that does not repeat.

A test asks whether a known pattern z(t) is in the residual r(t) = c z(t) + n(t), whose noise n is
coloured: both go through the filter that makes the noise white, and then it is least squares.
That holds for any colour, and in a closed loop if the pattern owes nothing to the noise of its own
run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import uniform_filter1d

LEAKAGE = 1e-3  # of the largest density; below, a transform of a finite run holds leakage
SMOOTHING = 0.15  # of the frequency, half width of the average over bins
LEAST_BINS = 8  # half width of that average, at least
ENVELOPE = 10.0  # s, over which the power of the noise is averaged


@dataclass(frozen=True)
class NoiseDensity:
    """Density of noise over frequency, per bin of a Fourier transform of unit length.

    ``density`` at the frequencies ``omega`` (rad/s) averages to the variance of a sample over
    all bins; ``envelope`` is the power over time, relative to its mean, at the instants ``time``.
    The density has ``free`` degrees of freedom at least.
    """

    omega: np.ndarray
    density: np.ndarray
    time: np.ndarray
    envelope: np.ndarray
    dt: float
    free: float

    def at(self, omega: np.ndarray) -> np.ndarray:
        return np.interp(omega, self.omega, self.density)

    def scale(self, time: np.ndarray) -> np.ndarray:
        """Standard deviation over time, relative to its rms."""
        return np.sqrt(np.interp(time, self.time, self.envelope))

    @property
    def correlation_time(self) -> float:
        """Integral of the squared autocorrelation over both signs of the lag, in s."""
        spacing = np.gradient(self.omega)
        return (
            np.pi
            * float(np.sum(self.density**2 * spacing))
            / float(np.sum(self.density * spacing)) ** 2
        )

    @property
    def unevenness(self) -> float:
        """Mean of the squared power over time, over the square of the mean power; 1 if steady."""
        return float(np.mean(self.envelope**2) / np.mean(self.envelope) ** 2)

    def covariance(self, Z: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Covariance of Z' n under noise alone."""
        # Real and imaginary parts beside each other: products of both are those of real numbers.
        Fz = fft.rfft(Z.T * self.scale(time), axis=1, norm="ortho")
        parts = (Fz * np.sqrt(self._density_of_bins(len(Z)))).view(float)
        return parts @ parts.T

    def _density_of_bins(self, n: int) -> np.ndarray:
        """Density of the bins of n samples, twice that of bins that stand for two."""
        S = 2 * self.at(2 * np.pi * fft.rfftfreq(n, self.dt))
        S[0] = S[min(1, S.size - 1)] / 2
        if n % 2 == 0:
            S[-1] /= 2
        return S

    def known(self, omega: np.ndarray) -> np.ndarray:
        """Where the density is more than the leakage of strong frequencies into weak ones."""
        return self.at(omega) > LEAKAGE * self.density.max()

    def whitened(self, values: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Signals (columns) through the zero-phase filter that makes the noise white, of power 1.

        Frequencies at which the noise is not known are taken out.
        """
        n = len(values)
        omega = 2 * np.pi * fft.rfftfreq(n, self.dt)
        S = self.at(omega)
        gain = np.where(self.known(omega), 1 / np.sqrt(np.maximum(S, 1e-300)), 0.0)
        spectrum = fft.rfft(values / self.scale(time)[:, None], axis=0)
        return fft.irfft(spectrum * gain[:, None], n, axis=0)


def noise_density(
    records: list[np.ndarray],
    times: list[np.ndarray],
    dt: float,
    without: list[np.ndarray | None],
    scored: list[np.ndarray],
    independent: float,
    floor: float,
) -> NoiseDensity:
    """Noise density of records, whose excited bins (``without``) say nothing about it.

    Records are zero where they are not ``scored``. So many of them are ``independent``: deviations
    from a mean are one less. Rounding errors are below the density ``floor``.
    """
    longest = max(len(record) for record in records)
    omega = 2 * np.pi * fft.rfftfreq(longest, dt)[1:]
    power, count = np.zeros(omega.size), np.zeros(omega.size)
    for record, bins, known in zip(records, without, scored, strict=True):
        n = len(record)
        periodogram = np.abs(fft.rfft(record, norm="ortho")) ** 2 / known.mean()
        used = np.ones(periodogram.size)
        used[0] = 0.0
        if bins is not None:
            used[bins] = 0.0
        at = np.clip(np.round(np.arange(1, periodogram.size) * longest / n).astype(int), 1, None)
        at = np.minimum(at - 1, omega.size - 1)
        np.add.at(power, at, (periodogram * used)[1:])
        np.add.at(count, at, used[1:])
    density = np.maximum(_smoothed(power, count), floor)
    time, envelope = _envelope(records, times, scored, dt)
    free = 2 * (2 * LEAST_BINS + 1) * independent
    return NoiseDensity(omega, density, time, envelope, dt, free)


def _smoothed(power: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Average over bins within a fraction of the frequency."""
    n = power.size
    bins = np.arange(n)
    half = np.maximum(LEAST_BINS, SMOOTHING * bins).astype(int)
    # As many bins below as above, so that a slope in the density does not tilt the average.
    low, high = np.maximum(bins - half, 0), np.minimum(bins + half + 1, n)
    total = np.concatenate([[0.0], np.cumsum(power)])
    number = np.concatenate([[0.0], np.cumsum(count)])
    used = number[high] - number[low]
    with np.errstate(invalid="ignore", divide="ignore"):
        density = (total[high] - total[low]) / used
    known = used > 0
    return np.interp(bins, bins[known], density[known])


def _envelope(
    records: list[np.ndarray], times: list[np.ndarray], scored: list[np.ndarray], dt: float
) -> tuple[np.ndarray, np.ndarray]:
    start = min(float(time[0]) for time in times)
    stop = max(float(time[-1]) for time in times)
    grid = np.arange(start, stop + dt, min(ENVELOPE / 10, (stop - start) / 4 + dt))
    power, count = np.zeros(grid.size), np.zeros(grid.size)
    for record, time, known in zip(records, times, scored, strict=True):
        at = np.searchsorted(grid, time, side="right") - 1
        power += np.bincount(at, record**2, grid.size)
        count += np.bincount(at, known, grid.size)
    width = min(max(round(ENVELOPE / (grid[1] - grid[0])), 1), grid.size)
    mean = uniform_filter1d(power, width, mode="nearest")
    mean = mean / np.maximum(uniform_filter1d(count, width, mode="nearest"), 1e-9)
    average = power.sum() / count.sum()
    centre = grid + (grid[1] - grid[0]) / 2
    if not average > 0:
        return centre, np.ones(grid.size)
    return centre, np.maximum(mean / average, 0.05)
