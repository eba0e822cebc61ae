"""Small changes of the data keep the name: runs left out, in another order, cut, and in parts.

No run is drawn twice: its copy repeats the remnant too, which is then structure of the data.
"""

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
    return tracked(
        {"dead_zone": DeadZone(width=0.3), "saturation": Saturation(limit=0.1)}[name], seed
    )


def runs_of(data):
    return [data.xs(label, level="run") for label in data.index.unique("run")]


def halves_of(data):
    return [half for run in runs_of(data) for half in (run[: len(run) // 2], run[len(run) // 2 :])]


def chosen(parts, numbers):
    """Runs by their numbers, under new labels."""
    return pd.concat({i: parts[n] for i, n in enumerate(numbers)}, names=["run", "time"])


def resampled(X, y, how, seed):
    rng = np.random.default_rng(seed)
    if how == "begin later":
        late = X.index.get_level_values("time") >= 4.0
        return X[late], y[late]
    if how == "eight of the halves":
        numbers = rng.permutation(2 * N_RUNS)[:8]
        return tuple(chosen(halves_of(data), numbers) for data in (X, y))
    numbers = {
        "first left out": np.arange(1, N_RUNS),
        "last left out": np.arange(N_RUNS - 1),
        "four in another order": rng.permutation(N_RUNS)[:4],
    }[how]
    return tuple(chosen(runs_of(data), numbers) for data in (X, y))


HOW = [
    "first left out",
    "last left out",
    "four in another order",
    "eight of the halves",
    "begin later",
]


def first_name(X, y, element):
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS, controlled_element=element)
    return search.fit(X, y).best_effects_[:1]


def cases():
    """All ways for all persons are a study; of each person one way is not."""
    slow = {("dead_zone", HOW[0]), ("saturation", HOW[3]), ("feedforward", HOW[2])}
    for name in ("dead_zone", "saturation", "feedforward"):
        for how in HOW:
            for seed in (11, 12):
                is_slow = seed == 12 and (name, how) in slow
                mark = pytest.mark.slow if is_slow else pytest.mark.whole
                yield pytest.param(name, seed, how, marks=mark)


@pytest.mark.parametrize(("name", "seed", "how"), list(cases()))
def test_resampled_runs_give_the_same_name(name, seed, how):
    X, y, element = person(name, seed)
    assert first_name(*resampled(X, y, how, seed), element) == [name]
