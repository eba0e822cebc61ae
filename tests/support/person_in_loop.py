"""A linear person in a loop with a hidden disturbance: sample by sample, and at 480 Hz."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.signal import cont2discrete, lfilter

from skhoid import LinearElement

PRIMES = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31])
FINE = 8  # times the rate of the recording


@dataclass(frozen=True)
class Person:
    """Gain and lead on the error, a delay, and a limb of second order."""

    K_e: float = 2.0
    K_edot: float = 0.0
    omega_nm: float = 9.0
    zeta_nm: float = 0.5
    tau_e: float = 0.2

    def limb(self, dt):
        """Pulse transfer function of position to position, of straight lines between samples."""
        num, den = [self.omega_nm**2], [1, 2 * self.zeta_nm * self.omega_nm, self.omega_nm**2]
        b, a, _ = cont2discrete((num, den), dt, method="foh")
        return np.ravel(b), a

    def answer(self, dt):
        """The same of the delayed error, by its gain and its lead."""
        num = np.array([self.K_edot, self.K_e]) * self.omega_nm**2
        den = [1, 2 * self.zeta_nm * self.omega_nm, self.omega_nm**2]
        b, a, _ = cont2discrete((num, den), dt, method="foh")
        return np.ravel(b), a


def sampled_loop(person, b, a, target, disturbance, remnant, dt):
    """e and u of shape (n_samples, n_runs) of the loop, from rest, one sample after the other.

    ``b`` and ``a`` are the pulse transfer function of the controlled element, which moves with
    u + disturbance; the delay is in whole samples.
    """
    num, den = person.answer(dt)
    late = round(person.tau_e / dt)
    assert abs(late * dt - person.tau_e) < 1e-9
    n = len(target)
    e, u, x, limb = (np.zeros_like(target) for _ in range(4))
    for k in range(n):
        for i in range(len(num)):
            if k - late - i >= 0:
                limb[k] += num[i] * e[k - late - i]
        for i in range(1, len(den)):
            if k - i >= 0:
                limb[k] -= den[i] * limb[k - i]
        u[k] = limb[k] + remnant[k]
        for i in range(len(b)):
            if k - i >= 0:
                x[k] += b[i] * (u[k - i] + disturbance[k - i])
        for i in range(1, len(a)):
            if k - i >= 0:
                x[k] -= a[i] * x[k - i]
        e[k] = target[k] - x[k]
    return e, u


def sines(rng, t, highest):
    """Sines of the primes of 0.05 Hz up to a frequency, with rms 1."""
    f = 0.05 * PRIMES[highest >= 0.05 * PRIMES]
    amplitude = (1 + (f / 0.4) ** 2) ** -1.5
    phase = rng.uniform(0, 2 * np.pi, f.size)
    signal = np.sin(2 * np.pi * np.multiply.outer(t, f) + phase) @ amplitude
    return signal / np.std(signal)


def pursued(
    text,
    seed,
    *,
    feedforward=0.0,
    early=0.0,
    remnant=0.4,
    disturbance=0.7,
    n_runs=5,
    duration=40.0,
    rate=60,
    person=None,
):
    """Runs of a person who answers the error, and of whom ``feedforward`` answers the target.

    The loop is that of ``text``, "1/s" or "1/(s(s+1))", at eight times the ``rate``. The remnant is
    coloured, enters before the limb, and has ``remnant`` of the target's rms times the crossover
    frequency; the disturbance at the stick is recorded nowhere. ``feedforward`` is a gain on the
    element's inverse of the target as it will be in ``early`` seconds.

    Returns X (e, x, f_t), y (u) and the person.
    """
    rng = np.random.default_rng(seed)
    h = 1 / (rate * FINE)
    single = text == "1/s"
    if person is None:
        crossover = rng.uniform(1.5, 3.0) if single else rng.uniform(1.5, 2.5)
        person = Person(
            K_e=crossover,
            K_edot=0.0 if single else crossover,
            omega_nm=rng.uniform(6, 12),
            zeta_nm=rng.uniform(0.3, 0.8),
            tau_e=round(rng.uniform(0.15, 0.25) / h) * h,
        )
    b, a = LinearElement.of(text).discrete(h)
    limb, lag = person.limb(h)
    late = round(person.tau_e / h)
    seen = np.r_[np.zeros(late), person.K_e + person.K_edot / h, -person.K_edot / h]
    open_loop = np.convolve(np.convolve(limb, seen), b)
    closed = np.convolve(lag, a)
    closed = np.r_[closed, np.zeros(open_loop.size - closed.size)] + open_loop
    corner = rng.uniform(1, 6)
    t = np.arange(round((duration + 10) * rate) * FINE) * h - 10
    highest = 1.55 if single else 0.85
    tables = []
    for run in range(n_runs):
        target = sines(rng, t, highest)
        moved = disturbance * sines(rng, t, highest)
        noise = lfilter([1.0], [1.0, -np.exp(-corner * h)], rng.standard_normal(t.size))
        command = remnant * person.K_e * noise / np.std(noise)
        if feedforward:
            ahead = np.interp(t + early, t, target)
            speed = np.gradient(ahead, h)
            command += feedforward * (speed if single else np.gradient(speed, h) + speed)
        u = lfilter(np.convolve(np.convolve(limb, seen), a), closed, target)
        u -= lfilter(open_loop, closed, moved)
        u += lfilter(np.convolve(limb, a), closed, command)
        x = lfilter(b, a, u + moved)
        kept = slice(round(10 * rate) * FINE, None, FINE)
        index = pd.MultiIndex.from_arrays(
            [np.full(t[kept].size, run + 1), np.round(t[kept], 9)], names=["run", "time"]
        )
        columns = {"e": target - x, "x": x, "f_t": target, "u": u}
        tables.append(pd.DataFrame({n: v[kept] for n, v in columns.items()}, index=index))
    table = pd.concat(tables)
    return table[["e", "x", "f_t"]].copy(), table["u"].copy(), person


def answered(*, dead=0.0, mean=0.0, seed=0, n_runs=3, duration=25.0, rate=50):
    """Runs of someone who answers given errors, in open loop, with a dead zone."""
    rng = np.random.default_rng(seed)
    dt = 1 / rate
    t = np.arange(-5, duration, dt)
    person = Person(K_e=0.5, K_edot=0.2, tau_e=0.2)
    b, a = person.answer(dt)
    tables = []
    for run in range(n_runs):
        e = sines(rng, t, 1.5)
        seen = e - np.clip(e, -dead, dead)
        late = round(person.tau_e / dt)
        u = lfilter(b, a, np.r_[np.zeros(late), seen[:-late]])
        noise = lfilter([1.0], [1, -0.8], rng.standard_normal(t.size))
        u += 0.15 * np.std(u) * noise / np.std(noise)
        u = mean + u / np.std(u)
        kept = t >= -1e-9
        index = pd.MultiIndex.from_arrays(
            [np.full(kept.sum(), run + 1), np.round(t[kept], 9)], names=["run", "time"]
        )
        tables.append(pd.DataFrame({"e": e[kept], "u": u[kept]}, index=index))
    table = pd.concat(tables)
    return table[["e"]].copy(), table["u"].copy()
