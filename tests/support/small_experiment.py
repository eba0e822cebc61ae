"""A small experiment whose operators are ARX models, made in milliseconds."""

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from skhoid import HumanOperator, zoh_parameters

DT, NK = 0.02, 15


def made(
    subjects=3, conditions=("A", "B"), runs=3, n=500, noise=0.1, seed=0, spread=0.05, levels=None
):
    """X with the columns e and f_t, which repeats over runs, and y.

    ``levels`` says which of subject and condition the index keeps.
    """
    rng = np.random.default_rng(seed)
    target = rng.standard_normal(n).cumsum() * 0.1
    parts, outputs, keys = [], [], []
    for subject in range(1, subjects + 1):
        for condition in conditions:
            gain = 0.3 * np.exp(spread * rng.standard_normal())
            a1, a2, b0, b1 = zoh_parameters(HumanOperator(K_e=gain, T_L=0.4), dt=DT)
            for run in range(1, runs + 1):
                e = target + 0.3 * rng.standard_normal(n)
                u = lfilter([0] * NK + [b0, b1], [1, a1, a2], e)
                u += noise * u.std() * lfilter([1], [1, -0.8], rng.standard_normal(n))
                parts.append(np.stack([e, target], axis=1))
                outputs.append(u)
                keys.append((f"P{subject}", condition, run))
    labels = [np.repeat(level, n) for level in zip(*keys, strict=True)]
    time = np.tile(DT * np.arange(n), len(keys))
    index = pd.MultiIndex.from_arrays(
        [*labels, time], names=["subject", "condition", "run", "time"]
    )
    for name in ("subject", "condition"):
        if levels is not None and name not in levels:
            index = index.droplevel(name)
    X = pd.DataFrame(np.concatenate(parts), index=index, columns=["e", "f_t"])
    return X, pd.Series(np.concatenate(outputs), index=index, name="u")
