"""Recordings for tests of the recursion, and what the twins in ``naive.py`` need of them."""

from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from support import naive
from support.synthetic import DT, A, recording

from skhoid import RecursiveARX

ORDERS = {"na": 2, "nb": 2, "nk": 3}
P = 4
THETA0 = np.array([-1.0, 0.3, 0.2, 0.1])
P0 = 10 * np.eye(P) + np.diag([1.0, 1.0, 1.0], 1) + np.diag([1.0, 1.0, 1.0], -1)


def sample_numbers(X):
    return np.rint(X.index.get_level_values("time").to_numpy() / DT).astype(int)


def stretches_of(X):
    """Begin and end of each piece of a run between gaps."""
    runs = X.index.get_level_values("run").to_numpy()
    cuts = (runs[1:] != runs[:-1]) | (np.diff(sample_numbers(X)) != 1)
    edges = [0, *(np.flatnonzero(cuts) + 1).tolist(), len(X)]
    return list(pairwise(edges))


def instants_of(X, y, na=2, nb=2, nk=3, inputs=("e",), intercept=False):
    n = len(inputs)
    nbs, nks = np.broadcast_to(nb, n).tolist(), np.broadcast_to(nk, n).tolist()
    return naive.measurements(
        y.to_numpy(), X[list(inputs)].to_numpy(), stretches_of(X), sample_numbers(X).tolist(),
        na, nbs, nks, intercept,
    )  # fmt: skip


def recursive(**params):
    return RecursiveARX(**{**ORDERS, "init": THETA0, "p0": P0, **params})


def respond_to_gain(b0, e, white):
    """u with b0(t) over time, after the zeros of its first four rows."""
    drive = np.zeros(e.size)
    drive[4:] = b0[4:] * e[1:-3] + 0.5 * e[:-4] + white[4:]
    return lfilter([1.0], [1, *A], drive)


def changing_runs(n_rows=1500, n_runs=1, seed=0, noise=0.1):
    """Runs whose b0 steps from 1 to 3 in the middle, white equation error."""
    b0 = np.where(np.arange(n_rows) < n_rows // 2, 1.0, 3.0)
    runs = {}
    for run in range(1, n_runs + 1):
        e, white = np.random.default_rng([seed, run]).standard_normal((2, n_rows))
        runs[run] = ([e], respond_to_gain(b0, e, noise * white))
    return recording(runs)


def shifted(table, seconds):
    run, time = (table.index.get_level_values(name) for name in ("run", "time"))
    index = pd.MultiIndex.from_arrays([run, time + seconds], names=["run", "time"])
    return table.set_axis(index)
