"""Signals of the trial: forcing functions, noise, and channels that differ from run to run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from loop import DT, RATE
from scipy.signal import lfilter

PERIOD, RUN_IN = 81.92, 8.08  # s
N_FINE = round((PERIOD + RUN_IN) * RATE)
START = round(RUN_IN * RATE)  # the row at which the recording begins
KEPT = slice(START, None, RATE // 100)  # 100 Hz
TIME = np.round(np.arange(8192) / 100, 9)
FINE_TIME = (np.arange(N_FINE) - START) * DT

# The thesis's Table I: multiples of 2 pi / 81.92 s and amplitudes (deg). Lines of f_d lie between.
MULTIPLES = np.array([3, 5, 8, 13, 22, 34, 53, 86, 139, 229])
AMPLITUDES = np.array([1.186, 1.121, 0.991, 0.756, 0.447, 0.245, 0.123, 0.061, 0.036, 0.025])
MULTIPLES_D = np.array([4, 7, 11, 18, 28, 43, 67, 109, 181, 263])


@dataclass(frozen=True)
class Multisine:
    """Sines of given frequencies (rad/s), amplitudes and phases.

    Parameters
    ----------
    omega, amplitude, phase : ndarray of shape (n_lines,)
        Frequencies in rad/s, amplitudes, phases in rad.
    """

    omega: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """The signal at instants that are evenly spaced."""
        step = np.exp(1j * self.omega * (t[1] - t[0]))
        n, block = len(t), 250
        first = np.exp(1j * (self.omega * t[0] + self.phase)) * self.amplitude
        # exp(j w t) of a block of instants, times that of each block's beginning.
        within = step ** np.arange(block)[:, None]
        begins = first * (step**block) ** np.arange(-(-n // block))[:, None]
        return np.imag(begins @ within.T).ravel()[:n]

    def through(self, response: Callable[[np.ndarray], np.ndarray]) -> Multisine:
        """The steady answer of a linear filter with this frequency response."""
        gain = response(1j * self.omega)
        return replace(
            self, amplitude=self.amplitude * np.abs(gain), phase=self.phase + np.angle(gain)
        )


def target(rng: np.random.Generator, scale: float) -> Multisine:
    """The thesis's forcing function with random phases."""
    phase = rng.uniform(-np.pi, np.pi, len(MULTIPLES))
    return Multisine(2 * np.pi * MULTIPLES / PERIOD, scale * AMPLITUDES, phase)


def disturbance(rng: np.random.Generator) -> Multisine:
    """A multisine on lines of its own, of unit rms."""
    amplitude = AMPLITUDES / np.sqrt(np.sum(AMPLITUDES**2) / 2)
    phase = rng.uniform(-np.pi, np.pi, len(MULTIPLES_D))
    return Multisine(2 * np.pi * MULTIPLES_D / PERIOD, amplitude, phase)


def low_passed(white: np.ndarray, lag: float, order: int, dt: float = DT) -> np.ndarray:
    """Noise through 1 / (lag s + 1)^order."""
    pole = np.exp(-dt / lag)
    for _ in range(order):
        white = lfilter([1 - pole], [1, -pole], white)
    return white


def coloured(
    rng: np.random.Generator, lag: float, order: int, n: int = N_FINE, dt: float = DT
) -> np.ndarray:
    """Low-passed noise of unit variance, in its steady state from the beginning."""
    before = round(8 * order * lag / dt)
    noise = low_passed(rng.standard_normal(n + before), lag, order, dt)
    # Divided by the standard deviation of the process, not of the realisation.
    impulse = low_passed(np.eye(1, before + 2)[0], lag, order, dt)
    return noise[before:] / np.sqrt(np.sum(impulse**2))


def remnant(rng: np.random.Generator, lag: float, order: int, kind: str) -> np.ndarray:
    """White noise through 1 / (lag s + 1)^order, of variance one over the run where it is steady.

    ``kind`` is "gaussian", "heavy" (Student's t with 3 degrees of freedom drives it) or "growing"
    (three times as strong at the end of the recording as at its beginning).
    """
    if kind == "heavy":
        white = rng.standard_t(3, N_FINE) / np.sqrt(3)
        # At 500 Hz the filter would make it normal again: bursts that last.
        white = np.repeat(white[::25], 25)
    else:
        white = rng.standard_normal(N_FINE)
    impulse = low_passed(np.eye(1, round(20 * order * lag / DT))[0], lag, order)
    noise = low_passed(white, lag, order) / np.sqrt(np.sum(impulse**2))
    if kind == "growing":
        noise *= 0.5 + np.clip(FINE_TIME / PERIOD, 0, 1)
    return noise


def wandering(rng: np.random.Generator) -> np.ndarray:
    """A slow channel: random, or a staircase with rounded steps; about zero, of unit size."""
    if rng.random() < 0.5:
        return coloured(rng, rng.uniform(2.0, 5.0), 2)
    edges = np.cumsum(rng.uniform(6.0, 20.0, 20)) - RUN_IN - 6.0
    levels = rng.choice([-1.3, -0.7, 0.0, 0.7, 1.3], len(edges) + 1)
    levels += 0.2 * rng.standard_normal(len(levels))
    return low_passed(levels[np.searchsorted(edges, FINE_TIME)], 0.2, 2)
