"""Estimates of least simulation error beside those of maximum likelihood."""

import pytest
from numpy.testing import assert_allclose
from sklearn.pipeline import make_pipeline
from support.person_in_loop import pursued

from skhoid import EffectSearchCV, OperatorRegressor, compare, make_tracking_runs
from skhoid.effects import Bias, DeadZone
from skhoid.model.parameters import difference_notes, find_differing


@pytest.fixture(scope="module")
def person():
    X, y, person = pursued("1/s", 3, n_runs=3, duration=30.0)
    return X, y, person, OperatorRegressor().fit(X, y)


def test_both_are_shown_where_the_loop_biases_one(person):
    _, _, truth, model = person
    likelihood, least_error = model.parameters_, model.simulation_parameters_
    assert "tau_e" in find_differing(likelihood, least_error)
    off = abs(least_error["value"]["tau_e"] - truth.tau_e)
    assert abs(likelihood["value"]["tau_e"] - truth.tau_e) < off / 2
    note = difference_notes(likelihood, least_error)[0]
    text = " ".join(model.summary().split())
    assert note in text
    for one in (likelihood, least_error):
        assert f"{one['value']['tau_e']:.3f} ±" in note


def test_nothing_is_said_where_they_agree():
    X, y, _ = pursued("1/s", 3, n_runs=2, duration=20.0, remnant=0.0)
    model = OperatorRegressor().fit(X, y)
    assert difference_notes(model.parameters_, model.simulation_parameters_) == []
    assert "Two estimates" not in model.summary()


def test_predictions_are_those_of_least_error_where_that_is_worth_more_than_a_point():
    X, y, _ = pursued("1/s", 5, n_runs=3, duration=30.0)
    model = OperatorRegressor().fit(X, y)
    shown = model.by_likelihood()
    assert model.score(X, y) > shown.score(X, y) + 1
    assert shown.parameters_ is model.parameters_
    all_of_them = model.parameters_["value"][model.covariance_.index].to_dict()
    assert_allclose(shown.predict(X), model.with_parameters(all_of_them).predict(X))
    late = X.index.get_level_values("time") >= 3.0
    lost = ((y - model.predict(X))[late] ** 2).sum() / (y[late] ** 2).sum()
    assert model.vaf_ == pytest.approx(100 * (1 - lost), abs=0.2)
    assert "compare keep to the likelihood" in " ".join(model.summary().split())
    # A comparison is of the parameters that the model shows, also at the end of a pipeline.
    found = compare(model, X, y, run_in=3.0)
    assert_allclose(found.traces["predicted"][late], shown.predict(X)[late])
    assert "two estimates" in [note.kind for note in found.notes]
    assert compare(make_pipeline(model), X, y, run_in=3.0).vaf == found.vaf


def test_predictions_are_those_of_the_parameters_shown_where_that_costs_less():
    X, y, _ = pursued("1/s", 0, n_runs=2, duration=20.0, remnant=0.0)
    model = OperatorRegressor().fit(X, y)
    assert model.by_likelihood() is model
    assert "keep to the likelihood" not in model.summary()


def test_the_least_error_is_not_in_the_valley_of_the_likelihood():
    """A bias that the model lacks sends the likelihood far away."""
    hidden = DeadZone(width=0.3) + Bias(level=0.05)
    X, y = make_tracking_runs(
        "C1",
        2,
        duration=41.0,
        remnant_intensity=0.1,
        sampling_rate=50.0,
        effects=hidden,
        random_state=3,
    )
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0).fit(X, y)
    assert OperatorRegressor().fit(X, y).vaf_ > search.best_score_
    assert search.baseline_.vaf_ > search.best_score_
