"""Records that do not begin at rest: furnaces, tanks, channels with a mean, jumps at once."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone

from skhoid import (
    OperatorRegressor,
    SimulatedARX,
    VAFScorer,
    compare,
    make_tracking_runs,
    vaf_score,
)


def furnace(level=900.0, seed=0):
    """First order, 200 s, clock 9 s; its steps are small beside its level."""
    rng = np.random.default_rng(seed)
    u = 50.0 + 2.5 * np.repeat(rng.choice([-1.0, 1.0], 20), 20)
    pole = np.exp(-9.0 / 200.0)
    y = np.empty(u.size)
    y[0] = level
    for k in range(1, u.size):
        y[k] = pole * y[k - 1] + (1 - pole) * 18.0 * u[k - 1]
    return u[:, None], y + 0.3 * rng.standard_normal(u.size)


@pytest.mark.parametrize(("effects", "level"), [(None, 900.0), ("dead_zone", 600.0)])
def test_furnace_is_hot_at_first(effects, level):
    X, y = furnace(level)
    model = SimulatedARX(1, 1, 1, dt=9.0, effects=effects).fit(X, y)
    assert model.initial_ == "estimate"
    assert VAFScorer(centered=True)(model, X, y) > 98.0
    assert model.score(X, y) > 99.99
    assert model.a_[0] == pytest.approx(-np.exp(-9.0 / 200.0), abs=0.01)
    cold = clone(model).set_params(initial="rest").fit(X, y)
    assert cold.score(X, y) < 99.8
    if level == 900.0:  # it was in balance with its first input
        assert np.abs(model.predict(X) - y).max() < 50.0
        assert np.abs(cold.predict(X) - y).max() > 800.0


def test_score_finds_the_state_of_other_runs():
    rng = np.random.default_rng(2)
    u = rng.standard_normal(600)
    y = lfilter([0.0, 0.1], [1.0, -1.9, 0.95], u)  # from rest
    u, y = u[:, None], y + 0.01 * rng.standard_normal(600)
    for effects in (None, "cubic_gain"):
        model = SimulatedARX(2, 1, 1, dt=0.01, effects=effects).fit(u[:300], y[:300])
        assert model.initial_ == "rest"
        later = vaf_score(y[300:], model.predict(u[300:]))
        assert model.score(u[:300], y[:300]) == vaf_score(y[:300], model.predict(u[:300]))
        assert model.score(u[300:], y[300:]) > max(later + 1.5, 99.5)


@pytest.mark.parametrize("effects", [None, "bias"])
def test_start_of_a_run_does_not_depend_on_the_runs_beside_it(effects):
    rng = np.random.default_rng(4)
    u = rng.standard_normal(900)
    y = lfilter([0.0, 0.1], [1.0, -1.9, 0.95], u) + 0.01 * rng.standard_normal(900)
    # 1 and 2 begin at rest, 3 in the middle of 1, and so quiet that it is lost beside 2
    X = pd.DataFrame({"run": np.repeat([1, 2, 3], [300, 600, 60]), "e": 0.0})
    X["e"] = np.r_[u[:300], 30.0 * u[:600], u[240:300]]
    out = np.r_[y[:300], 30.0 * y[:600], y[240:300]]
    model = SimulatedARX(2, 1, 1, dt=0.01, run="run", effects=effects)
    first, others = X["run"] == 1, X["run"] != 1
    model.fit(X[first], out[first])
    assert model.initial_ == "rest"
    assert model.score(X[X["run"] == 3], out[-60:]) > vaf_score(out[-60:], model.predict(X)[-60:])
    left = sum(
        (1 - model.score(X[rows], out[rows]) / 100) * (out[rows] @ out[rows])
        for rows in (X["run"] == 2, X["run"] == 3)
    )
    together = 100 * (1 - left / (out[others] @ out[others]))
    assert model.score(X[others], out[others]) == pytest.approx(together, abs=1e-9)


def test_channel_with_a_mean_does_not_begin_with_a_jump():
    """Runs that begin in the middle of tracking, with a mean on every channel."""
    X, y = make_tracking_runs(
        "C1", 1, duration=20.48, sampling_rate=50, channels=["e", "x"], random_state=0
    )
    X = X + np.array([20.0, 100.0])
    model = OperatorRegressor(effects="output_feedback").fit(X, y)
    first = X.index.get_level_values("time") < 3.0
    assert np.abs(model.predict(X)[first]).max() < 2 * y.abs().max()
    assert model.score(X, y) > 80.0
    assert compare(model, X, y).vaf > 80.0
