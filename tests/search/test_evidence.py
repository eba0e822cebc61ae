"""Evidence for and against effects in one person's runs."""

import numpy as np
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone, Effects, Feedforward, Saturation
from skhoid.search.evidence import evidence_of


@pytest.fixture(scope="module")
def stopped():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=4)
    return X, y.clip(-0.1, 0.1)


@pytest.mark.slow
def test_what_is_there_has_evidence_and_what_is_not_has_none(stopped):
    search = EffectSearchCV(OperatorRegressor())
    tried = [Saturation(), DeadZone(), Bias(), Feedforward()]
    table = evidence_of(search, Effects.of([Saturation()]), tried, *stopped)
    rows = table.set_index(["instead_of", "effect"])
    assert rows.loc[("saturation", "saturation"), "evidence"] > 50
    assert rows.loc[("", "bias"), "evidence"] < 0
    assert rows.loc[("", "dead_zone"), "evidence"] < 0
    # It needs a target, which is not recorded.
    assert np.isnan(rows.loc[("", "feedforward"), "evidence"])
    assert rows.loc[("", "feedforward"), "reason"]


@pytest.mark.slow
def test_what_a_search_has_told_is_not_asked_again(stopped):
    search = EffectSearchCV(OperatorRegressor(), effects=["saturation", "dead_zone", "bias"])
    ranking = search.fit(*stopped).ranking_
    found, tried = search.best_estimator_.effects_, search.list_effects()
    again, told = (
        evidence_of(search, found, tried, *stopped, known).set_index(["instead_of", "effect"])
        for known in (None, ranking)
    )
    assert set(told.index) == set(again.index)
    own = ("saturation", "saturation")
    assert told.loc[own, "evidence"] == pytest.approx(again.loc[own, "evidence"], rel=0.01)
    others = told.index.drop([own])
    assert (told.loc[others, "evidence"] < 0).all()
    assert (again.loc[others, "evidence"] < 0).all()
