"""A comparison of many runs: what is done once a run, held against doing it by pairs."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from skhoid.diagnosis import repeats as same_target
from skhoid.diagnosis.comparison import read_signals

N = 200  # samples a run


class Halved:
    """Predicts half the target."""

    def predict(self, X):
        return 0.5 * X["f_t"].to_numpy()


def table(targets, dist=None, seed=0):
    """Runs with these targets (rows)."""
    rng = np.random.default_rng(seed)
    targets = np.atleast_2d(targets)
    index = pd.MultiIndex.from_product(
        [range(len(targets)), np.arange(targets.shape[1]) * 0.05], names=["run", "time"]
    )
    X = pd.DataFrame({"f_t": targets.ravel()}, index=index)
    if dist is not None:
        X["dist"] = np.ravel(dist)
    y = X["f_t"] * 0.8 + 0.3 * rng.standard_normal(len(X))
    if dist is not None:
        y += X["dist"]  # one that nobody answers splits no group
    return X, y.rename("u")


def noise(n_runs, seed=1, n=N):
    return lfilter([0.3], [1, -0.7], np.random.default_rng(seed).standard_normal((n_runs, n)))


def pairs_in_full(X, y):
    """Groups as they were found by comparing each run with the first of every group."""
    groups = []
    signals = X.to_numpy().reshape(-1, N, X.shape[1])
    for run, own in enumerate(signals):
        for group in groups:
            other = signals[group[0]]
            power = np.maximum(np.mean(own**2, axis=0), np.mean(other**2, axis=0))
            if np.all(np.mean((own - other) ** 2, axis=0) <= same_target.SAME_TARGET**2 * power):
                group.append(run)
                break
        else:
            groups.append([run])
    return groups


@pytest.mark.parametrize("jitter", [0.0, 0.03, 0.0499, 0.0501, 0.2])
def test_runs_are_grouped_as_by_all_pairs(jitter):
    kinds = noise(4)[[0, 1, 1, 2, 0, 3, 1, 0, 2, 3, 3, 1]]
    rms = np.sqrt(np.mean(kinds**2, axis=1, keepdims=True))
    change = noise(12, seed=2)
    change *= jitter * rms / np.sqrt(np.mean(change**2, axis=1, keepdims=True))
    dist = noise(3, seed=3)[[0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 2, 1]]
    X, y = table(kinds + change, dist)
    found = read_signals(Halved(), X, y, run_in=0.0)
    expected = sorted(pairs_in_full(X, y))
    assert sorted(group.runs.tolist() for group in found.groups) == expected


def test_runs_of_other_length_are_grouped_over_what_they_share():
    target = noise(1)[0]
    X, y = table(np.array([target] * 4))
    time, run = X.index.get_level_values("time"), X.index.get_level_values("run")
    keep = ~((run == 1) & (time > 8.6)) & ~((run == 2) & (time < 1.0)) & ~((run == 3) & (time > 5))
    found = read_signals(Halved(), X[keep], y[keep], run_in=0.0)
    groups = {tuple(group.runs): group for group in found.groups}
    assert set(groups) == {(0, 1, 2), (3,)}
    together = found.layout.time[groups[0, 1, 2].rows]
    assert (together == together[0]).all()
    assert_allclose(together[0, [0, -1]], [1.0, 8.6])
