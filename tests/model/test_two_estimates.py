"""Estimates of least simulation error beside those of maximum likelihood."""

import pytest
from support.person_in_loop import pursued

from skhoid import OperatorRegressor
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
    (note,) = difference_notes(likelihood, least_error)
    text = " ".join(model.summary().split())
    assert note in text
    for one in (likelihood, least_error):
        assert f"{one['value']['tau_e']:.3f} ±" in note


def test_nothing_is_said_where_they_agree():
    X, y, _ = pursued("1/s", 3, n_runs=2, duration=20.0, remnant=0.0)
    model = OperatorRegressor().fit(X, y)
    assert difference_notes(model.parameters_, model.simulation_parameters_) == []
    assert "Two estimates" not in model.summary()
