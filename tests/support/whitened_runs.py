"""Small recordings of a Box-Jenkins system inside a loop, for the recursions that whiten."""

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from support.synthetic import run_time

F, B, NK, DT = (-1.2, 0.5), (0.5, 0.3), 2, 0.05
THETA = np.array([*F, *B])


def whitened_runs(n_runs=1, n_rows=1500, *, noise=0.1, seed=0):
    """u = B/F e + n with n of order 1; e follows a target f_t, and past n, as in a loop."""
    rng = np.random.default_rng(seed)
    lengths = [n_rows] * n_runs if np.ndim(n_rows) == 0 else n_rows
    tables, outputs = [], []
    for n in lengths:
        f_t = lfilter([1.0], [1.0, -0.5], rng.standard_normal(n))
        remnant = lfilter([1.0], [1.0, -0.8], noise * rng.standard_normal(n))
        e = f_t + 0.5 * np.r_[0, f_t[:-1]] - 0.6 * np.r_[0, 0, remnant[:-2]]
        u = lfilter(np.r_[np.zeros(NK), B], np.r_[1, F], e) + remnant
        tables.append(np.column_stack([e, f_t]))
        outputs.append(u)
    index = run_time(lengths, DT)
    X = pd.DataFrame(np.concatenate(tables), index=index, columns=["e", "f_t"])
    return X, pd.Series(np.concatenate(outputs), index=index, name="u")


def arrays_of(X, y):
    return X.to_numpy(), y.to_numpy()
