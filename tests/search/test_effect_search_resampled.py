"""Small changes of the data keep the name: runs left out, drawn again, in other order, cut."""

import numpy as np
import pandas as pd
import pytest
from support.person_in_loop import pursued

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import DeadZone, Saturation

RIVALS = [
    "dead_zone",
    "cubic_gain",
    "saturation",
    "rate_limit",
    "feedforward",
    "preview",
    "output_feedback",
    "extra_lag",
    "bias",
    "tv_gain",
]
N_RUNS = 6


def tracked(effect, seed):
    X, y = make_tracking_runs(
        "C1",
        n_runs=N_RUNS,
        duration=40.96,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.1,
        random_state=seed,
        effects=effect,
    )
    return X, y, None


def person(name, seed):
    if name == "feedforward":
        X, y, _ = pursued("1/s", seed, feedforward=0.6, early=-0.1, n_runs=N_RUNS, duration=30.0)
        return X, y, "1/s"
    return tracked({"dead_zone": DeadZone(0.3), "saturation": Saturation(0.1)}[name], seed)


def with_runs(data, numbers):
    """Runs by position, as often as they are asked for, under new labels."""
    labels = data.index.unique("run")
    parts = {i: data.xs(labels[number], level="run") for i, number in enumerate(numbers)}
    return pd.concat(parts, names=["run", "time"])


def cut(data, seconds):
    return data[data.index.get_level_values("time") >= seconds]


def resampled(X, y, how, seed):
    rng = np.random.default_rng(seed)
    if how == "begin later":
        return cut(X, 4.0), cut(y, 4.0)
    numbers = {
        "first left out": np.arange(1, N_RUNS),
        "last left out": np.arange(N_RUNS - 1),
        "four in another order": rng.permutation(N_RUNS)[:4],
        "drawn with replacement": rng.integers(0, N_RUNS, N_RUNS),
    }[how]
    return with_runs(X, numbers), with_runs(y, numbers)


HOW = [
    "first left out",
    "last left out",
    "four in another order",
    "drawn with replacement",
    "begin later",
]


def first_name(X, y, element):
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS, controlled_element=element)
    return search.fit(X, y).best_effects_[:1]


@pytest.mark.slow
@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize("name", ["dead_zone", "saturation", "feedforward"])
def test_resampled_runs_give_the_same_name(name, seed, how):
    X, y, element = person(name, seed)
    assert first_name(*resampled(X, y, how, seed), element) == [name]
