"""Recordings in open loop with one effect hidden, and searches of them."""

import numpy as np
import pandas as pd
from scipy.signal import lfilter, lsim

from skhoid import EffectSearchCV, OperatorRegressor

RATE = 50.0
K_E, K_EDOT, OMEGA, ZETA, TAU = 0.5, 0.25, 10.0, 0.35, 0.24  # TAU in whole samples
REMNANT = 0.1  # of the output's power
RIVALS = ["dead_zone", "asym_gain", "saturation", "bias", "gain_drift", "extra_lag", "lapses"]


def recorded(
    n_runs=3, duration=40.0, *, seed=0, inner=None, gain=None, outer=None, remnant=REMNANT
):
    """Runs of an operator that answers given errors, in open loop, by SciPy's simulation.

    ``inner`` maps e, ``gain`` is a factor over time, ``outer`` maps what the operator and its
    remnant do.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * RATE)) / RATE
    warm = np.arange(-10, 0, 1 / RATE)  # before the recording
    whole = np.concatenate([warm, t])
    omega = 2 * np.pi * np.array([0.05, 0.11, 0.19, 0.31, 0.47, 0.71, 1.03, 1.51, 2.2])
    tables = []
    for run in range(n_runs):
        phase = rng.uniform(0, 2 * np.pi, omega.size)
        e = np.sin(np.multiply.outer(whole, omega) + phase) @ (1 / (1 + omega / 3))
        answered = e if inner is None else inner(e)
        answered = answered * (1.0 if gain is None else gain(whole))
        late = np.concatenate([np.zeros(round(TAU * RATE)), answered])[: whole.size]
        numerator = OMEGA**2 * np.array([K_EDOT, K_E])
        u = lsim((numerator, [1, 2 * ZETA * OMEGA, OMEGA**2]), late, whole - whole[0])[1]
        n = lfilter([1.0], [1.0, -0.75], rng.standard_normal(whole.size))
        u = u + np.sqrt(remnant) * np.std(u) * n / np.std(n)
        u = u if outer is None else outer(u)
        index = pd.MultiIndex.from_arrays(
            [np.full(t.size, run + 1), np.round(t, 9)], names=["run", "time"]
        )
        tables.append(pd.DataFrame({"e": e[-t.size :], "u": u[-t.size :]}, index=index))
    table = pd.concat(tables)
    X, y = table[["e"]].copy(), table["u"].copy()
    X.attrs["units"], y.attrs["units"] = {"e": "deg"}, {"u": "deg"}
    return X, y


def dead(e):
    return e - np.clip(e, -0.3, 0.3)


def searched(data, effects=None, **options):
    options = {"effects": RIVALS if effects is None else effects, **options}
    return EffectSearchCV(OperatorRegressor(), **options).fit(*data)
