"""Targets, disturbances, remnant and other channels at the rate of the simulation.

Open it for how a run is excited. Everything is drawn from the generator it is given; shapes are
(n,) at step dt (s).
"""

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31)  # of 0.05 Hz: 0.1 to 1.55 Hz


def unit(values: np.ndarray) -> np.ndarray:
    """The signal with standard deviation 1 and its own mean taken away."""
    return (values - values.mean()) / values.std()


def sines(
    t: np.ndarray, frequencies: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray
) -> np.ndarray:
    """Sum of sines, frequencies in rad/s."""
    return (amplitudes[:, None] * np.sin(frequencies[:, None] * t + phases[:, None])).sum(0)


def noise(
    n: int, dt: float, corner: float, order: int, rng: np.random.Generator, tails: bool = False
) -> np.ndarray:
    """White noise through ``order`` lags of ``corner`` rad/s, stationary from its first sample,
    standard deviation about 1.
    """
    ahead = int(min(8.0 / corner, 20.0) / dt)
    w = rng.standard_t(2.5, n + ahead) if tails else rng.standard_normal(n + ahead)
    if tails:  # few and wide apart: bursts, since a lag makes dense heavy-tailed noise normal again
        w = w * (rng.random(n + ahead) < 0.02)
    pole = np.exp(-corner * dt)
    for _ in range(order):
        w = lfilter([1 - pole], [1, -pole], w)
    return w[ahead:] / w[ahead:].std()


class Forcing:
    """A family of forcing functions; ``run`` draws one member, so that runs differ.

    kinds: ``sines`` (own frequencies each run), ``phases`` (the same, other phases), ``noise``.
    """

    def __init__(self, rng: np.random.Generator, *, fast: bool, bandwidth: float | None = None):
        self.kind = str(rng.choice(["sines", "phases", "noise"]))
        self.bandwidth = bandwidth or float(rng.uniform(0.9, 2.0) * (1.3 if fast else 1.0))
        self.count = int(rng.integers(6, 13))
        self.shelf = float(rng.uniform(0.05, 0.2))
        self.quiet = bool(rng.random() < 0.3)
        self.order = int(rng.integers(2, 5))
        self.frequencies = self._frequencies(rng)

    def _frequencies(self, rng: np.random.Generator) -> np.ndarray:
        grid = np.geomspace(0.25, 12.0, self.count)
        return grid * rng.uniform(0.9, 1.1, self.count)

    def run(self, n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
        t = np.arange(n) * dt
        if self.kind == "noise":
            sos = butter(self.order, self.bandwidth, fs=2 * np.pi / dt, output="sos")
            ahead = int(15 / dt)
            out = sosfilt(sos, rng.standard_normal(n + ahead))[ahead:]
            out = out / out.std()
        else:
            omega = self._frequencies(rng) if self.kind == "sines" else self.frequencies
            size = np.where(omega < self.bandwidth, 1.0, self.shelf)
            out = sines(t, omega, size, rng.uniform(0, 2 * np.pi, len(omega))) / np.sqrt(
                (size**2).sum() / 2
            )
        if self.quiet:
            start = rng.uniform(0.2, 0.7) * n * dt
            length = rng.uniform(4.0, 8.0)
            out = out * (
                1 - 0.5 * (np.tanh((t - start) / 0.4) - np.tanh((t - start - length) / 0.4))
            )
        return out


class PrimeSines:
    """The forcing of the pursuit experiment: sines at prime multiples of 0.05 Hz, amplitude
    falling with frequency.
    """

    def __init__(self, highest_hz: float, which: str):
        multiples = np.array([p for p in PRIMES if p * 0.05 <= highest_hz + 1e-9])
        self.multiples = {"all": multiples, "even": multiples[::2], "odd": multiples[1::2]}[which]

    def run(self, n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
        t = np.arange(n) * dt
        omega = 2 * np.pi * 0.05 * self.multiples
        size = 1.0 / self.multiples
        sign = rng.choice([-1.0, 1.0], len(omega))
        out = sines(t, omega, size * sign, rng.uniform(0, 2 * np.pi, len(omega)))
        return out / np.sqrt((size**2).sum() / 2) * np.clip(t / 5.0, 0.0, 1.0)


def slow_channel(n: int, dt: float, rng: np.random.Generator, first: float) -> np.ndarray:
    """A channel between -1 and 1 that moves within tens of seconds, like airspeed; ``first``
    shifts its phase.
    """
    t = np.arange(n) * dt
    slow = 2 * np.pi / rng.uniform(18.0, 35.0)
    return np.clip(
        0.75 * np.sin(slow * t + first) + 0.35 * np.sin(1.7 * slow * t + 2.1 * first), -1, 1
    )


def tremor(n: int, dt: float, hertz: float, wander: float, rng: np.random.Generator) -> np.ndarray:
    """A sine of ``hertz`` whose phase walks at random, ``wander`` rad per square root of a second;
    amplitude 1.
    """
    walk = np.cumsum(rng.standard_normal(n)) * np.sqrt(dt) * wander
    return np.sin(2 * np.pi * hertz * np.arange(n) * dt + walk + rng.uniform(0, 2 * np.pi))


def rate(values: np.ndarray, dt: float) -> np.ndarray:
    """Derivative by central differences."""
    return np.gradient(values, dt)


def delayed(values: np.ndarray, seconds: float, dt: float) -> np.ndarray:
    """values(t - seconds), linear between steps; negative seconds look ahead; the ends are held."""
    k = np.arange(len(values))
    return np.interp(k - seconds / dt, k, values)


def lag(values: np.ndarray, seconds: float, dt: float) -> np.ndarray:
    """First-order lag of time constant ``seconds``, at rest at the first value."""
    pole = np.exp(-dt / seconds)
    return lfilter([1 - pole], [1, -pole], values - values[0]) + values[0]
