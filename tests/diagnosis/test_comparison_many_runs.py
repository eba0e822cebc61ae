"""A comparison of many runs: what is done once a run, held against doing it by pairs."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from skhoid import compare
from skhoid.diagnosis import over_runs
from skhoid.diagnosis import repeats as same_target
from skhoid.diagnosis import signals as coherent
from skhoid.diagnosis.comparison import read_signals
from skhoid.diagnosis.leaks import triangle
from skhoid.runs import read_layout

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


def full_comparisons(monkeypatch, X, y):
    """How often two runs were compared over all of their samples."""
    seen = []
    whole = same_target._Groups._different
    monkeypatch.setattr(
        same_target._Groups, "_different", lambda *pair: seen.append(pair) or whole(*pair)
    )
    compare(Halved(), X, y, run_in=0.0)
    return len(seen)


def test_runs_of_other_targets_are_told_apart_by_a_few_samples(monkeypatch):
    assert full_comparisons(monkeypatch, *table(noise(60))) <= 5


def test_runs_of_other_disturbances_are_told_apart_by_a_few_samples(monkeypatch):
    X, y = table(np.repeat(noise(1), 60, axis=0), noise(60, seed=4))
    assert full_comparisons(monkeypatch, X, y) <= 5


def test_response_to_the_target_is_estimated_once_a_run(monkeypatch):
    calls = []
    solve = np.linalg.lstsq
    monkeypatch.setattr(
        coherent.np.linalg, "lstsq", lambda *a, **k: calls.append(a) or solve(*a, **k)
    )
    compare(Halved(), *table(noise(6)), run_in=0.0)
    assert len(calls) == 6


def test_response_to_the_target_is_least_squares():
    X, y = table(noise(2))
    signals = read_signals(Halved(), X, y, run_in=0.0)
    target = X["f_t"].to_numpy()[:N]
    taps = signals.target_responses[0].taps
    past = np.column_stack([coherent.lagged_from_rest(target - target.mean(), taps), np.ones(N)])
    for name in ("y", "residual", "predicted"):
        values = signals.named(name)[:N]
        expected = past @ np.linalg.lstsq(past, values, rcond=None)[0]
        found = coherent.coherent_part(signals, signals.groups[0], name)
        assert_allclose(found, expected[None], atol=1e-12)


@pytest.mark.slow
def test_windows_of_a_run_are_those_of_the_run_alone():
    X, y = table(noise(5))
    together = compare(Halved(), X, y, run_in=0.0).by_time
    for run in range(5):
        alone = compare(Halved(), X.loc[[run]], y.loc[[run]], run_in=0.0).by_time
        one = together[together["run"] == str(run)].reset_index(drop=True)
        columns = ["start", "stop", "rmse", "vaf", "share", "ratio"]
        pd.testing.assert_frame_equal(
            one[columns], alone.loc[alone["run"] != "all", columns].reset_index(drop=True)
        )


@pytest.mark.parametrize("n", [3, 4, 5, 6, 9, 10])
def test_each_run_is_held_against_all_others(n):
    values = np.random.default_rng(n).standard_normal(n)
    values[1] = values[0]
    others = [np.delete(values, k) for k in range(n)]
    middle = np.median if n > 4 else np.mean
    assert_allclose(over_runs._centre_of_others(values), [middle(rest) for rest in others])
    factor = np.pi / 2 if n > 4 else 1.0
    spread = [factor * np.mean(rest**2) / rest.size for rest in others]
    assert_allclose(over_runs._spread_of_centre(values), spread)


def test_triangle_has_the_products_of_all_tables():
    rng = np.random.default_rng(5)
    tables = [rng.standard_normal((n, 4)) for n in (2, 0, 30, 7)]
    rows, n = triangle(tables)
    whole = np.concatenate(tables)
    assert n == len(whole)
    assert rows.shape == (4, 4)
    assert_allclose(rows.T @ rows, whole.T @ whole)


def test_data_are_left_as_they_were():
    X, y = table(noise(3))
    before = X.copy(), y.copy()
    comparison = compare(Halved(), X, y, run_in=0.0)
    comparison.traces.loc[:, ["measured", "f_t"]] = 0.0
    pd.testing.assert_frame_equal(X, before[0])
    pd.testing.assert_series_equal(y, before[1])
    assert read_layout(X).n_rows == len(comparison.traces)
