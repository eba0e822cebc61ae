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
