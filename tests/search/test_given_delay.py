"""A delay that the model was given is a claim, and tested."""

import pytest
from support.person_in_loop import answered, pursued

from skhoid import EffectSearchCV, OperatorRegressor

CLAIM = "wrong_delay"
LEAST_GAIN_OF_CLAIM = 0.6  # points of VAF
RATE = 60
SHORT = {"n_runs": 3, "duration": 30.0}


def searched(X, y, delay, effects, text=None):
    estimator = OperatorRegressor(delay=delay)
    return EffectSearchCV(estimator, effects=effects, controlled_element=text).fit(X, y)


def first_claim(search):
    rows = search.ranking_[search.ranking_["effect"] == CLAIM]
    return rows[rows["step"] == 1].iloc[0]


OPEN = ["dead_zone", "extra_lag", CLAIM]


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "samples"), [(0.5, 10), (0.5, -5), (0.0, 15)])
def test_wrong_delay_is_named_and_hides_nothing(dead, samples):
    """Of someone who answers given errors after 0.2 s."""
    X, y = answered(dead=dead)
    wrong = 0.2 + samples / 50
    found = searched(X, y, wrong, OPEN)
    assert set(found.best_effects_) == ({"dead_zone", CLAIM} if dead else {CLAIM})
    added = found.ranking_.query("status == 'added'")
    assert added["effect"].tolist() == [CLAIM, "dead_zone"][: len(found.best_effects_)]
    assert first_claim(found)["status"] == "added"
    assert first_claim(found)["reason"] == ""
    extra = found.best_estimator_.parameters_["value"]["wrong_delay__extra"]
    free = searched(X, y, None, OPEN).best_estimator_.parameters_["value"]["tau_e"]
    assert wrong + extra == pytest.approx(free, abs=0.005)
    assert free == pytest.approx(0.2, abs=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [-5])
def test_wrong_delay_that_costs_little_is_not_named(samples):
    """Without a dead zone the other parameters make up for most of it."""
    found = searched(*answered(dead=0.0), 0.2 + samples / 50, OPEN)
    claim = first_claim(found)
    assert found.best_effects_ == []
    assert claim["status"] == "not better"
    assert 0 < claim["vaf_gain"] < LEAST_GAIN_OF_CLAIM


@pytest.mark.slow
@pytest.mark.parametrize("dead", [0.0, 0.5])
def test_right_delay_adds_nothing(dead):
    X, y = answered(dead=dead)
    found = searched(X, y, 0.2, OPEN)
    names = ["dead_zone"] if dead else []
    assert found.best_effects_ == names
    assert first_claim(found)["status"] == "not better"
    added = found.ranking_.query("status == 'added'")
    assert added["effect"].tolist() == names  # once, where it was


LOOP = ["feedforward", CLAIM]


@pytest.fixture(scope="module")
def tracked():
    return pursued("1/s", 2, feedforward=0.6, early=-0.1, **SHORT)


@pytest.fixture(scope="module")
def free(tracked):
    X, y, _ = tracked
    return searched(X, y, None, LOOP, "1/s")


def named(search):
    return {*search.best_effects_} - {"unknown", CLAIM}


@pytest.mark.slow
def test_free_delay_needs_no_claim(free):
    assert free.best_effects_ == ["feedforward"]
    claim = first_claim(free)
    assert claim["status"] == "does not apply"
    assert "already estimates its delay" in claim["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [10])
def test_wrong_delay_in_a_loop_does_not_change_the_names(tracked, free, samples):
    X, y, person = tracked
    found = searched(X, y, person.tau_e + samples / RATE, LOOP, "1/s")
    assert named(found) == named(free)


@pytest.mark.slow
@pytest.mark.parametrize("feedforward", [0.0, 0.5])
@pytest.mark.parametrize("seed", [60])
def test_right_delay_in_a_loop_is_not_refuted(seed, feedforward):
    X, y, person = pursued("1/s", seed, feedforward=feedforward, early=-0.1)
    found = searched(X, y, person.tau_e, LOOP, "1/s")
    assert CLAIM not in found.best_effects_
    assert named(found) == named(searched(X, y, None, LOOP, "1/s"))
    assert named(found) <= ({"feedforward"} if feedforward else set())
