"""A person who answers the error, in a loop with any element and a disturbance."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from skhoid import LinearElement
from skhoid.effects.record import Record

PERIOD = 20.0  # s


def sines(rng, t, multiples, runs):
    phase = rng.uniform(0, 2 * np.pi, (len(multiples), 1, runs))
    omega = 2 * np.pi * np.array(multiples)[:, None, None] / PERIOD
    return (np.sin(omega * t[:, None] + phase) / (1 + (omega / np.pi) ** 2)).sum(axis=0)


def tracked(text, *, rate=60, direct=False, seed=0, runs=5, disturbance=0.6, remnant=0.2):
    """Runs of 43 s of someone who answers the error, in a loop with a disturbance."""
    rng = np.random.default_rng(seed)
    element = replace(LinearElement.of(text), direct=direct)
    dt, n, late = 1 / rate, round(43 * rate), round(0.2 * rate)
    t = np.arange(n) * dt
    target = sines(rng, t, [2, 5, 11, 17, 29, 41], runs)
    moved = disturbance * sines(rng, t, [3, 7, 13, 19, 31], runs)
    noise = lfilter(
        [8 * dt / 0.15], [1, -np.exp(-dt / 0.15)], rng.standard_normal((n, runs)), axis=0
    )
    gain, slope = 2.2 / element.numerator[0], element.denominator
    on_error = gain * (slope[1] if element.order == 2 else 1.0) + 0.6 * (text == "2/s^2")
    on_rate = gain if element.order == 2 else 0.0
    b, a = element.discrete(dt)
    e, u, x = np.zeros((3, n, runs))
    arm = np.zeros((2, runs))
    for k in range(n):
        if k > late:
            i = k - late
            command = on_error * e[i] + on_rate * (e[i] - e[i - 1]) / dt + remnant * noise[k]
            arm[1] += dt * (144.0 * (command - arm[0]) - 14.4 * arm[1])
            arm[0] += dt * arm[1]
        u[k] = arm[0]
        for i in range(min(k + 1, b.size)):
            x[k] += b[i] * (u + moved)[k - i] - (a[i] * x[k - i] if i else 0.0)
        e[k] = target[k] - x[k]
    known = np.ones((n, runs), dtype=bool)
    known[: 3 * rate] = False
    channels = {"e": e, "x": x, "f_t": target, "dist": moved}
    roles = dict(zip(channels, channels, strict=True))
    return Record(dt, t[:, None], channels, roles, ("e",), known, u)
