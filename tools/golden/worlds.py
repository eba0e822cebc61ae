"""The runs that cases share: small worlds on fixed seeds, simulated once."""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd

import skhoid

CHANNELS = ("e", "x", "f_t")
RATE = 50.0  # Hz: a delay of 14 samples and one of the zero-order hold
NK = 15


@cache
def loop(condition: str = "C1", n_runs: int = 3, seed: int = 0, **options: Any) -> Any:
    """Runs of the closed loop, as X and y."""
    options = {"remnant_intensity": 0.1, "sampling_rate": RATE, "channels": CHANNELS} | options
    return skhoid.make_tracking_runs(condition, n_runs, random_state=seed, **options)


@cache
def arx(n_runs: int = 3, n_rows: int = 400, n_inputs: int = 1, seed: int = 0) -> Any:
    """Runs of an ARX system driven by noise, with an input the output does not depend on last."""
    rng = np.random.default_rng(seed)
    tables = []
    for run in range(n_runs):
        e = rng.standard_normal((n_rows, n_inputs + 1))
        u, noise = np.zeros(n_rows), 0.1 * rng.standard_normal(n_rows)
        for k in range(4, n_rows):
            answer = sum(e[k - 3, j] / (j + 1) + 0.5 * e[k - 4, j] for j in range(n_inputs))
            u[k] = 1.5 * u[k - 1] - 0.7 * u[k - 2] + answer + noise[k]
        names = [*("e", "motion", "dist")[:n_inputs], "x"]
        time = np.round(np.arange(n_rows) * 0.04, 9)
        index = pd.MultiIndex.from_arrays([np.full(n_rows, run + 1), time], names=["run", "time"])
        tables.append(pd.DataFrame(e, index=index, columns=names).assign(u=u))
    table = pd.concat(tables)
    return table.drop(columns="u"), table["u"]


def bent(shape: str, condition: str = "C1", n_runs: int = 3, **options: Any) -> Any:
    """Runs of the loop whose output something outside the operator has changed."""
    X, y = loop(condition, n_runs, **options)
    changes = {
        "stop": lambda u: u.clip(-0.1, 0.1),
        "offset": lambda u: u + 0.05,
        "squared": lambda u: u + 4 * u * u.abs() ** 1.5 * np.sin(40 * u),
    }
    changed = changes[shape](y)
    return X, changed
