"""A delay that the model was given is a claim, and tested."""

import pytest
from support.person_in_loop import answered

from skhoid import EffectSearchCV, OperatorRegressor

CLAIM = "wrong_delay"
LEAST_GAIN_OF_CLAIM = 0.6  # points of VAF


def searched(X, y, delay, effects, text=None):
    estimator = OperatorRegressor(delay=delay)
    return EffectSearchCV(estimator, effects=effects, controlled_element=text).fit(X, y)


def first_claim(search):
    rows = search.ranking_[search.ranking_["effect"] == CLAIM]
    return rows[rows["step"] == 1].iloc[0]


OPEN = ["dead_zone", "extra_lag", CLAIM]


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "samples"), [(0.5, 10)])
def test_wrong_delay_is_named_and_hides_nothing(dead, samples):
    """Of someone who answers given errors after 0.2 s."""
    X, y = answered(dead=dead)
    wrong = 0.2 + samples / 50
    found = searched(X, y, wrong, OPEN)
    assert set(found.best_effects_) == ({"dead_zone", CLAIM} if dead else {CLAIM})
    added = found.ranking_.query("status == 'added'")
    assert set(added["effect"]) == set(found.best_effects_)
    extra = found.best_estimator_.parameters_["value"]["wrong_delay__extra"]
    free = searched(X, y, None, OPEN).best_estimator_.parameters_["value"]["tau_e"]
    assert wrong + extra == pytest.approx(free, abs=0.005)
    assert free == pytest.approx(0.2, abs=0.04)


@pytest.mark.slow
def test_wrong_delay_that_costs_little_is_not_named():
    """Without a dead zone the other parameters make up for most of it."""
    found = searched(*answered(dead=0.0), 0.1, OPEN)
    claim = first_claim(found)
    assert found.best_effects_ == []
    assert claim["status"] == "not better"
    assert 0 < claim["vaf_gain"] < LEAST_GAIN_OF_CLAIM


@pytest.mark.slow
def test_right_delay_adds_nothing():
    X, y = answered(dead=0.5)
    found = searched(X, y, 0.2, OPEN)
    assert found.best_effects_ == ["dead_zone"]
    assert first_claim(found)["status"] == "not better"
    added = found.ranking_.query("status == 'added'")
    assert added["effect"].tolist() == ["dead_zone"]  # once, where it was
