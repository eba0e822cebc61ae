"""Small recordings for tests: ARX systems, and the closed loop as tables with run and time."""

from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from support import closed_loop

A = (-1.5, 0.7)  # a1, a2: poles of modulus 0.84
B = (1.0, 0.5)
NK = 3
DT = 0.01


def run_time(lengths, dt=DT):
    """Row index of runs 1, 2, ... of the given lengths."""
    runs = np.repeat(np.arange(1, len(lengths) + 1), lengths)
    time = np.concatenate([dt * np.arange(n) for n in lengths])
    return pd.MultiIndex.from_arrays([runs, time], names=["run", "time"])


def arx_runs(n_runs=3, n_rows=120, *, lengths=None, noise=0.1, seed=0, nk=NK, smooth=0):
    """Runs of A(q) u = B(q) e(t - nk) + white noise, and a channel x that has no part in it.

    ``smooth`` low-pass filters the input that many times.
    """
    lengths = [n_rows] * n_runs if lengths is None else lengths
    rng = np.random.default_rng(seed)
    index = run_time(lengths)
    X = pd.DataFrame(rng.standard_normal((len(index), 2)), index=index, columns=["e", "x"])
    parts = []
    for run in range(1, len(lengths) + 1):
        e = X.loc[[run], "e"].to_numpy()
        for _ in range(smooth):
            e = lfilter([0.2], [1, -0.8], e)
        X.loc[[run], "e"] = e
        numerator = np.concatenate([np.zeros(nk), B])
        white = noise * rng.standard_normal(e.size)
        parts.append(lfilter(numerator, [1, *A], e) + lfilter([1], [1, *A], white))
    return X, pd.Series(np.concatenate(parts), index=index, name="u")


def stretches_of(X):
    """Begin and end of each run of X."""
    runs = X.index.get_level_values("run").to_numpy()
    cuts = np.flatnonzero(runs[1:] != runs[:-1]) + 1
    edges = [0, *cuts.tolist(), len(runs)]
    return list(pairwise(edges))


def with_levels(table, **levels):
    """Copy with some index levels replaced or added."""
    frame = table.index.to_frame(index=False)
    names = [*[n for n in levels if n not in frame], *frame.columns]
    for name, values in levels.items():
        frame[name] = values
    table = table.copy()
    table.index = pd.MultiIndex.from_frame(frame[names])
    return table


def as_table(recording, run=1):
    """A closed-loop recording as channels X and output y."""
    n = len(recording.e)
    time = DT * np.arange(n)
    index = pd.MultiIndex.from_arrays([np.full(n, run), time], names=["run", "time"])
    X = pd.DataFrame({"e": recording.e, "x": recording.x, "f_t": recording.f_t}, index=index)
    return X, pd.Series(recording.u, index=index, name="u")


def loop_runs(n_runs, *, remnant_gain):
    """Runs of the closed loop with remnant, its last period each."""
    parts = [
        as_table(
            closed_loop.simulate("C1", remnant_gain=remnant_gain, rng=i, periods=2).last(),
            run=i + 1,
        )
        for i in range(n_runs)
    ]
    return pd.concat([X for X, _ in parts]), pd.concat([y for _, y in parts])


def recording(runs, names=("e",), dt=DT, start=0.0):
    """DataFrame and Series of runs given as (channels, output)."""
    tables, outputs = [], []
    for label, (channels, u) in runs.items():
        index = pd.MultiIndex.from_product(
            [[label], start + dt * np.arange(len(u))], names=["run", "time"]
        )
        tables.append(pd.DataFrame(np.column_stack(channels), index=index, columns=list(names)))
        outputs.append(pd.Series(u, index=index, name="u"))
    return pd.concat(tables), pd.concat(outputs)


def signals(lengths, seed=0, n_columns=2):
    """White channels e and x of runs."""
    rng = np.random.default_rng(seed)
    index = run_time(lengths)
    return pd.DataFrame(rng.standard_normal((len(index), n_columns)), index, ["e", "x"][:n_columns])


def kept_rows(marked):
    """Where a Decimator keeps rows."""
    (level,) = [name for name in marked.index.names if name.startswith("decimation")]
    return marked.index.get_level_values(level).to_numpy(dtype=bool)
