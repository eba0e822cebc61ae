"""A tracking loop with a disturbance that is recorded nowhere, for tests; own code, at 60 Hz.

A person answers the error with a delay, and the target with a preview where ``preview`` is not 0;
the element receives u + d. Many seeds run side by side, a column each.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter

DT = 1 / 60
ELEMENTS = {"1/s": [1, 0], "1/(s(s+1))": [1, 1, 0]}


@dataclass
class Loop:
    """Signals (rows are samples, columns runs), the element, and the person's answer alone."""

    u: np.ndarray
    x: np.ndarray
    e: np.ndarray
    f: np.ndarray
    d: np.ndarray
    answer: np.ndarray
    b: np.ndarray
    a: np.ndarray


def sines(rng, n_samples, n_runs, fastest, shared=False):
    """Sums of ten sines of unit rms, slower ones larger; one for all runs where shared."""
    t = np.arange(n_samples)[:, None] * DT
    columns = 1 if shared else n_runs
    total = np.zeros((n_samples, columns))
    for _ in range(10):
        f = np.exp(rng.uniform(np.log(0.05), np.log(fastest), columns))
        phase = rng.uniform(0, 2 * np.pi, columns)
        total += np.sin(2 * np.pi * f * t + phase) / (1 + (f / 0.5) ** 2)
    return np.broadcast_to(total / total.std(axis=0), (n_samples, n_runs)).copy()


def noise(rng, n_samples, n_runs, bandwidth):
    """Second-order coloured noise of unit rms."""
    pole = np.exp(-2 * np.pi * bandwidth * DT)
    white = rng.standard_normal((n_samples + 300, n_runs))
    for _ in range(2):
        white = lfilter([1 - pole], [1, -pole], white, axis=0)
    return white[300:] / white[300:].std(axis=0)


def simulate(
    element="1/s",
    n_runs=20,
    duration=40.0,
    *,
    seed=0,
    disturbance=1.0,
    remnant=0.6,
    preview=0.0,
    shared_target=False,
    target=None,
    delay=(0.15, 0.25),
):
    """Simulate runs of a person each; delays, gains and limbs differ between the columns."""
    rng = np.random.default_rng(seed)
    n = round(duration / DT)
    b, a, _ = cont2discrete(([1.0], ELEMENTS[element]), DT)
    b = np.ravel(b)
    first = element == "1/s"
    gain = rng.uniform(1.0, 1.8, n_runs) * (1.0 if first else 0.8)
    lead = 0.0 if first else 1.0
    limb = rng.uniform(9, 13, n_runs)
    late = np.round(rng.uniform(*delay, n_runs) / DT).astype(int)
    f = 2 * sines(rng, n, n_runs, 1.2, shared_target) if target is None else target(n, n_runs)
    d = disturbance * sines(rng, n, n_runs, 2.5)
    w = remnant * noise(rng, n, n_runs, 1.5)
    ahead = preview * np.gradient(np.roll(f, -18, axis=0), DT, axis=0)
    u, x, e, v = np.zeros((4, n, n_runs))
    command = np.zeros((n, n_runs))
    q, rate = np.zeros((2, n_runs))
    column = np.arange(n_runs)
    for k in range(n):
        for j in range(1, min(len(a) - 1, k) + 1):
            x[k] += b[j] * v[k - j] - a[j] * x[k - j]
        e[k] = f[k] - x[k]
        command[k] = gain * (e[k] + lead * (e[k] - e[k - 1]) / DT * (k > 0)) + ahead[k]
        then = k - late
        c = np.where(then > 0, command[then, column], 0.0) + w[k]
        for _ in range(2):
            rate = rate + DT / 2 * (limb**2 * (c - q) - limb * rate)
            q = q + DT / 2 * rate
        u[k], v[k] = q, q + d[k]
    answer, q, rate = np.zeros((n, n_runs)), np.zeros(n_runs), np.zeros(n_runs)
    for k in range(n):
        then = k - late
        c = np.where(then > 0, command[then, column], 0.0)
        for _ in range(2):
            rate = rate + DT / 2 * (limb**2 * (c - q) - limb * rate)
            q = q + DT / 2 * rate
        answer[k] = q
    return Loop(u, x, e, f, d, answer, b, a)


def second_difference(loop):
    """What a model of x alone, without delay, takes for the output: the element's inverse of x."""
    rate = np.gradient(loop.x, DT, axis=0)
    return rate if len(loop.a) == 2 else np.gradient(rate, DT, axis=0) + rate
