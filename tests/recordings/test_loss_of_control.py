"""Lost control is found where a person loses it, and in nothing that honest data have."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.places import RECORDINGS

from skhoid.recordings import lost_control

RATE = 50
T = np.arange(40 * RATE) / RATE
PURSUIT = RECORDINGS / "human_pursuit_1dof"


def tracked(seed, size=1.0, scatter=0.3):
    """Target and error of a run: sums of sines, and noise that the hand adds."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * 0.05 * np.array([2, 3, 5, 7, 11, 17, 23, 31])
    phase = rng.uniform(0, 2 * np.pi, (2, omega.size))
    target, error = (
        np.sin(np.multiply.outer(T, omega) + p) @ (1 / (1 + (omega / w) ** 2))
        for p, w in zip(phase, (1.5, 4.0), strict=True)
    )
    noise = np.convolve(rng.standard_normal(T.size + 24), np.ones(25) / 5, "valid")
    error = 0.3 * error + scatter * 0.3 * noise
    return size * target, size * error


def table(*runs, target=True):
    parts = []
    for number, (f_t, e) in enumerate(runs, 1):
        index = pd.MultiIndex.from_arrays(
            [np.full(len(e), number), T[: len(e)]], names=["run", "time"]
        )
        parts.append(pd.DataFrame({"e": e, "f_t": f_t}, index=index))
    X = pd.concat(parts)
    return X if target else X[["e"]]


def lost(run, begin=20.0, end=30.0, size=12.0):
    """The same run, in which the person runs away and comes back."""
    f_t, e = run
    inside = (begin <= T) & (end > T)
    away = np.where(inside, size * np.minimum(1, (T - begin) / 2), 0.0)
    return f_t, e + away * np.cos(1.5 * (T - begin))


@pytest.mark.parametrize("target", [True, False])
def test_a_stretch_of_lost_control_is_found(target):
    for seed in range(2):
        runs = [tracked(10 * seed + k) for k in range(3)]
        found = lost_control(table(*runs[:-1], lost(runs[-1]), target=target))
        assert found["run"].tolist() == ["3"]
        assert_allclose(found["from"], 20.0, atol=3.5)
        assert_allclose(found["to"], 30.0, atol=3.5)
        assert found["times"].item() > 3
        assert "its usual size in these runs" in found["reason"].item()


def test_control_that_never_comes_back_is_lost_to_the_end():
    runs = [tracked(seed) for seed in range(4)]
    found = lost_control(table(*runs[:3], lost(runs[3], begin=8.0, end=37.0)))
    assert found["to"].tolist() == [T[-1]]
    assert_allclose(found["from"], 8.0, atol=3.5)


def test_a_run_that_was_never_under_control_is_found_where_the_target_is_known():
    runs = [tracked(seed) for seed in range(4)]
    never = lost(runs[3], begin=-2.0, end=99.0, size=20.0)
    found = lost_control(table(*runs[:3], never))
    assert found[["run", "from", "to"]].to_numpy().tolist() == [["4", 0.0, T[-1]]]


def with_transient(run, size=12.0, seconds=3.0):
    f_t, e = run
    return f_t, e + size * np.exp(-T / seconds)


def with_slow_step(run):
    """The same with an element that takes long: nothing but the target's own range."""
    step = 15.0 * (T >= 22)
    return run[0] + step, run[1] + step * np.exp(-np.maximum(T - 22.4, 0) / 4.0)


def test_a_slow_answer_to_a_step_in_a_single_run_is_not_struck():
    for seed in range(2):
        odd = with_slow_step(tracked(seed, scatter=0.05))
        assert lost_control(table(odd)).empty
        assert lost_control(table(odd, target=False)).empty


def test_a_run_alone_that_runs_away_is_found_where_the_target_is_known():
    away = lost(tracked(3), size=60.0)
    assert lost_control(table(away))["run"].tolist() == ["1"]
    assert lost_control(table(away, target=False)).empty


def with_outliers(run):
    f_t, e = run[0], run[1].copy()
    e[[500, 1000, 1004, 1010, 1500]] += 200.0
    return f_t, e


def with_step(run):
    """A target that steps once: the error is the step, until the person has moved."""
    step = 15.0 * (T >= 22)
    return run[0] + step, run[1] + step * np.exp(-np.maximum(T - 22.4, 0) / 0.5)


@pytest.mark.parametrize("target", [True, False])
@pytest.mark.parametrize("n_runs", [1, 4])
@pytest.mark.parametrize(
    "odd",
    [
        lambda run: run,
        lambda run: (6 * run[0], 6 * run[1]),
        with_transient,
        with_outliers,
        with_step,
        lambda run: (run[0] + 50.0, run[1]),
    ],
    ids=["plain", "larger target", "first transient", "outliers", "step", "far from zero"],
)
def test_honest_runs_are_not_struck(odd, n_runs, target):
    for seed in range(2):
        runs = [tracked(100 + 10 * seed + k) for k in range(n_runs)]
        assert lost_control(table(*runs[:-1], odd(runs[-1]), target=target)).empty


def test_arrays_gaps_and_missing_errors_are_read():
    X = table(*(tracked(seed) for seed in range(3)), lost(tracked(3)))
    expected = lost_control(X)
    array = np.column_stack([X["e"], X.index.get_level_values("run")])
    found = lost_control(array, roles={0: "e"}, dt=1 / RATE, run=1)
    assert found["run"].tolist() == ["4.0"]
    holed = X.drop(X.index[7000:7040]).copy()
    holed.iloc[100:110, 0] = np.nan
    found = lost_control(holed)
    assert_allclose(found[["from", "to"]], expected[["from", "to"]], atol=1.0)
    named = X.rename(columns={"e": "distance"})
    pd.testing.assert_frame_equal(lost_control(named, roles={"distance": "e"}), expected)
    without = X.assign(x=X["f_t"] - X["e"]).drop(columns="e")
    pd.testing.assert_frame_equal(lost_control(without), expected)


@pytest.mark.slow
@pytest.mark.skipif(not PURSUIT.exists(), reason="needs the recordings beside the checkout")
def test_few_trials_of_real_people_are_struck():
    """Of 210 trials of four people, those whose error runs away stand apart from all others."""
    trials = pd.read_parquet(PURSUIT / "trials.parquet")
    meta = pd.read_csv(PURSUIT / "trials_meta.csv")
    trials["e"] = trials["ref"] - trials["pos"]
    names = {"trial": "run", "ref": "f_t"}
    found = []
    for _, of_set in meta.groupby(["subject", "plant"]):
        some = trials[trials["trial"].isin(of_set["trial"])].rename(columns=names)
        found.append(lost_control(some.set_index(["run", "time"])[["e", "f_t"]]))
    struck = pd.concat(found)
    assert 1 <= len(struck) <= 4
    assert struck["times"].min() > 3.5
