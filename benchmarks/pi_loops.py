"""PI and PID loops: is their controller found, with its gains, where nobody says that it is one?

    pip install -e .
    python benchmarks/pi_loops.py [--loops 20] [--seed 100]

Each loop is drawn anew: the form of the controller (PI, PID with a filtered rate, either action on
the measurement alone), gains, the process behind it, the sampling time, staircases or sums of sines
far from zero as set points, the noise and its colour. Recordings begin in the middle of the run,
where the integral is at a level that nobody recorded. Exits with 1 if in fewer than nine of ten the
search names or builds in integral action, both of whose gains are within 5 %, or if it names
something else beside it.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from skhoid import EffectSearchCV, OperatorRegressor

FORMS = ("pi", "pi", "pid", "i-p", "pi-d")
WITHIN = 0.05
FINE = 8  # steps of the process in one of the controller
STARTED = 0.25  # of a run, which is not recorded


@dataclass
class Truth:
    """A controller, and the loop around it."""

    form: str
    K_e: float
    K_i: float
    K_edot: float
    T_f: float
    dt: float
    noise: float

    def __str__(self) -> str:
        return f"{self.form:5s} dt {self.dt:5.3f} s, noise {100 * self.noise:4.1f} %"


def draw_loop(seed: int) -> tuple[Truth, pd.DataFrame, pd.Series]:
    """A loop and what is recorded of it: error, measurement and set point, and what answers."""
    rng = np.random.default_rng(seed)
    form = FORMS[seed % len(FORMS)]
    dt = float(rng.choice([0.002, 0.01, 0.02, 0.05, 0.2, 1.0]))
    lag = dt * rng.uniform(25, 120)  # of the process, K / ((lag s + 1) (second s + 1))
    second, K = lag * rng.uniform(0.02, 0.2), np.exp(rng.uniform(-1.5, 1.5))
    closed = lag * rng.uniform(0.25, 1.0)
    K_e = lag / (K * (closed + second))
    K_i = K_e / (lag * rng.uniform(0.5, 1.2))
    rate = "d" in form
    T_d = 0.8 * second if rate else 0.0
    truth = Truth(form, K_e, K_i, K_e * T_d, T_d / 5, dt, float(rng.choice([0.0, 0.03, 0.1])))
    n, noisy = 4000, truth.noise * rng.uniform(0.5, 1.5)
    size, level = np.exp(rng.uniform(-1, 3)), rng.uniform(-8, 8)
    t = np.arange(n) * dt
    if rng.random() < 0.5:
        steps = np.cumsum(rng.uniform(1.5, 6, 400) * closed)
        target = rng.standard_normal(401)[np.searchsorted(steps, t)]
    else:
        waves = rng.uniform(0.05, 1.5, 8) / closed
        target = np.cos(np.outer(t, waves) + rng.uniform(0, 6.28, 8)).sum(axis=1) / 2
    target = size * (level + target)
    pole = float(rng.choice([0.0, 0.9, 0.99]))
    remnant = lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.standard_normal(n))
    remnant *= noisy * size / K
    sensor = 0.002 * size * rng.standard_normal(n)
    x1 = x2 = rated = total = 0.0
    before = np.zeros(2)
    e, x, u = np.zeros((3, n))
    for i in range(n):
        x[i] = x2 + sensor[i]
        e[i] = target[i] - x[i]
        total += e[i] * dt
        seen = {"e": e[i], "x": -x[i]}
        of_rate = seen["x" if form == "pi-d" else "e"]
        rated = (truth.T_f * rated + (of_rate - before[0] if i else 0.0)) / (truth.T_f + dt)
        before[0] = of_rate
        u[i] = K_e * seen["x" if form == "i-p" else "e"] + K_i * total + remnant[i]
        u[i] += truth.K_edot * rated
        for _ in range(FINE):
            x1 += (K * u[i] - x1) / lag * dt / FINE
            x2 += (x1 - x2) / second * dt / FINE
    rows = slice(int(STARTED * n), None)
    index = pd.MultiIndex.from_product([["run"], t[rows] - t[rows][0]], names=["run", "time"])
    X = pd.DataFrame({"e": e[rows], "x": x[rows], "f_t": target[rows]}, index)
    return truth, X, pd.Series(u[rows], index, name="u")


def errors_of(search: EffectSearchCV, truth: Truth) -> dict[str, float]:
    """Relative errors of the gains found; empty where no integral action is found."""
    found: Any = search.best_estimator_.parameters_["value"]
    integral = found.get("K_i", found.get("integral__gain"))
    if integral is None:
        return {}
    return {"K_e": found["K_e"] / truth.K_e - 1, "K_i": integral / truth.K_i - 1}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loops", type=int, default=20)
    parser.add_argument("--seed", type=int, default=100, help="of the first")
    options = parser.parse_args()
    right = clean = 0
    for seed in range(options.seed, options.seed + options.loops):
        truth, X, y = draw_loop(seed)
        begun = time.process_time()
        search = EffectSearchCV(OperatorRegressor(settling=0.0)).fit(X, y)
        errors = errors_of(search, truth)
        within = bool(errors) and all(abs(error) <= WITHIN for error in errors.values())
        others = [name for name in search.best_effects_ if name != "integral"]
        right, clean = right + within, clean + (not others)
        text = ", ".join(f"{name} {100 * error:+.1f} %" for name, error in errors.items())
        print(
            f"{seed}: {truth}: {'right' if within else 'WRONG'} ({text or 'no integral'})"
            f"{', named: ' + ', '.join(others) if others else ''}"
            f", VAF {search.best_estimator_.vaf_:.1f} %, {time.process_time() - begun:.1f} s"
        )
    n = options.loops
    print(f"gains within 5 %: {right} of {n}; nothing else named: {clean} of {n}")
    return int(right < 0.9 * n or clean < 0.9 * n)


if __name__ == "__main__":
    sys.exit(main())
