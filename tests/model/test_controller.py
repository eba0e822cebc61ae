"""PI and PID controllers: their gains come back, whatever came before the recording."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone

GAINS = {"K_e": 0.6, "K_i": 0.9}
RATE = {"K_edot": 0.12, "T_f": 0.03}


def record(form, seed, n_runs=1, noise=0.1, level=30.0, dt=0.02, n=1500):
    """Runs of a loop around 2 / ((0.8 s + 1)(0.1 s + 1)) that begin with any integral."""
    rng = np.random.default_rng(seed)
    rate = RATE if "d" in form else {"K_edot": 0.0, "T_f": 0.0}
    tables = []
    for run in range(n_runs):
        target = level + 4 * np.repeat(rng.standard_normal(n // 100), 100)
        remnant = noise * lfilter([0.3], [1, -0.95], rng.standard_normal(n))
        x1 = x2 = level + rng.standard_normal()
        total, rated, before = rng.uniform(0, 30), 0.0, None
        rows = []
        for f_t, more in zip(target, remnant, strict=True):
            x = x2 + 0.01 * rng.standard_normal()
            e = f_t - x
            total += e * dt
            seen = -x if form == "pi-d" else e
            change = 0.0 if before is None else seen - before
            rated, before = (rate["T_f"] * rated + change) / (rate["T_f"] + dt), seen
            proportional = -x if form == "i-p" else e
            u = GAINS["K_e"] * proportional + GAINS["K_i"] * total + rate["K_edot"] * rated + more
            rows.append((e, x, f_t, u))
            for _ in range(4):
                x1 += (2 * u - x1) / 0.8 * dt / 4
                x2 += (x1 - x2) / 0.1 * dt / 4
        index = pd.MultiIndex.from_product([[run], dt * np.arange(n)], names=["run", "time"])
        tables.append(pd.DataFrame(rows, index, columns=["e", "x", "f_t", "u"]))
    table = pd.concat(tables)
    return table[["e", "x", "f_t"]], table["u"]


def is_near(model, gains=GAINS, within=0.05):
    found = model.parameters_["value"]
    return all(abs(found[name] / value - 1) < within for name, value in gains.items())


@pytest.mark.parametrize("form", ["pid", "i-p"])
def test_form_and_gains_are_found(form):
    model = OperatorRegressor(controller="any").fit(*record(form, seed=len(form)))
    assert model.controller_ == form
    assert is_near(model)
    if "d" in form:
        assert is_near(model, {"K_edot": RATE["K_edot"]}, within=0.1)


def test_each_run_begins_at_a_level_of_its_own():
    X, y = record("pi", 1, n_runs=3)
    model = OperatorRegressor(controller="pi").fit(X, y)
    assert is_near(model)
    assert model.vaf_ > 99
    assert model.initial_ == "estimate"


def test_means_that_were_removed_are_estimated():
    X, y = record("pi", 3)
    model = OperatorRegressor(controller="any").fit(X - X.mean(), y - y.mean())
    assert is_near(model)
    assert model.parameters_["value"]["e_0"] == pytest.approx(-X["e"].mean(), rel=0.3)


def test_prediction_begins_where_the_fitted_run_did():
    X, y = record("pi", 4)
    model = OperatorRegressor(controller="pi").fit(X, y)
    assert np.sqrt(np.mean((y - model.predict(X)) ** 2)) < 0.05 * y.std()


def test_search_finds_out_that_a_controller_answers():
    X, y = record("pi", 5)
    search = EffectSearchCV(OperatorRegressor(), effects=["quantised"]).fit(X, y)
    assert search.best_estimator_.controller_ == "pi"
    assert search.best_effects_ == []
    assert is_near(search.best_estimator_)
    assert "controller" in [note.kind for note in search.notes_]


@pytest.mark.parametrize("options", [{"domain": "human"}, {"display": "compensatory"}])
def test_who_says_that_it_is_a_person_gets_one(options):
    X, y = record("pi", 7, n=800)
    model = OperatorRegressor()
    search = EffectSearchCV(model, effects=["bias"], max_effects=0, **options).fit(X, y)
    assert search.baseline_.controller_ is None


def test_people_are_no_controllers():
    X, y = make_tracking_runs("C3", 2, sampling_rate=50, remnant_intensity=0.1, random_state=8)
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0).fit(X, y)
    assert search.baseline_.controller_ is None


def test_action_on_the_measurement_needs_it():
    X, y = record("i-p", 9, n=500)
    with pytest.raises(ValueError, match="role x"):
        OperatorRegressor(controller="i-p").fit(X[["e"]], y)


def test_effects_of_a_limb_are_refused():
    X, y = record("pi", 10, n=500)
    with pytest.raises(ValueError, match="no limb"):
        OperatorRegressor(controller="pi", effects=["hardening_stiffness"]).fit(X, y)


def test_a_person_with_an_offset_is_no_controller():
    """An integral that begins anywhere would make it up."""
    hidden = DeadZone(width=0.35) + Bias(level=-0.06)
    task = {"sampling_rate": 50, "remnant_intensity": 0.12, "random_state": 77}
    X, y = make_tracking_runs("C1", 2, channels=["e", "x", "f_t"], effects=hidden, **task)
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0).fit(X, y)
    assert search.baseline_.controller_ is None
