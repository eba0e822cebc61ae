"""Integral action of people, in runs that are cut out of longer ones: nobody knows how it began."""

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Integral

GAIN = 0.05
RIVALS = ["bias", "drift", "integral", "feedforward", "output_feedback"]
STICK = 0.3  # deg


def cut_runs(condition, seed, gain=GAIN, n_runs=2, duration=60.0):
    """Runs after 40 s in which the integral has come to hold a load of the stick, other in each."""
    loads = STICK * np.random.default_rng(seed).uniform(-0.3, 0.8, n_runs)
    tables = []
    for run, load in enumerate(loads):
        X, y = make_tracking_runs(
            condition,
            1,
            remnant_intensity=0.1,
            channels=("e", "x", "f_t"),
            sampling_rate=40.0,
            duration=duration,
            run_in=40.0,
            disturbance=lambda t, load=load: np.full(np.shape(t), load),
            effects=Integral(form="pure", gain=gain) if gain else None,
            random_state=100 * seed + run,
        )
        times = X.index.get_level_values("time")
        index = pd.MultiIndex.from_product([[run], times], names=["run", "time"])
        tables.append(X.assign(u=y).set_index(index))
    table = pd.concat(tables)
    return table[["e", "x", "f_t"]], table["u"]


@pytest.mark.slow
@pytest.mark.parametrize(("condition", "seed"), [("C2", 1), ("C1", 2)])
def test_it_is_named_with_its_gain(condition, seed):
    X, y = cut_runs(condition, seed)
    found = EffectSearchCV(OperatorRegressor(), effects=RIVALS, domain="human").fit(X, y)
    assert found.best_effects_ == ["integral"]
    gain = found.best_estimator_.parameters_.loc["integral__gain"]
    assert gain["value"] == pytest.approx(GAIN, abs=max(0.1 * GAIN, 2 * gain["sd"]))


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_levels_of_runs_are_no_integral(seed):
    X, y = cut_runs(("C1", "C2")[seed % 2], seed, gain=0.0)
    found = EffectSearchCV(OperatorRegressor(), effects=RIVALS, domain="human").fit(X, y)
    assert found.best_effects_ == []
    limit = found.limits_.set_index("effect").loc["integral"]
    assert 0 <= limit["limit"] < GAIN
    assert limit["shown_from"] < 2 * GAIN


def test_other_runs_begin_where_they_began():
    """Their output tells where; without it they begin at the level of the runs that were fitted."""
    X, y = cut_runs("C1", 7)
    model = OperatorRegressor(effects=Integral(form="pure")).fit(X, y)
    assert model.initial_ == "estimate"
    others = cut_runs("C1", 8)
    assert model.score(*others) > model.vaf_ - 5
    fitted = pd.Series(model.predict(X), X.index)
    assert fitted[40:].mean() == pytest.approx(y[40:].mean(), abs=0.1 * STICK)
    plain = OperatorRegressor().fit(X, y)
    assert model.vaf_ > plain.vaf_ + 5
