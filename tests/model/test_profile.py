"""Intervals of effects' parameters by profile likelihood."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import GainDrift
from skhoid.model.fitting import Criterion
from skhoid.model.likelihood import collect_prior, likelihood_fit
from skhoid.model.uncertainty import (
    CHI2_95,
    NEAR,
    _Profile,
    estimate_covariance,
    find_profile_intervals,
)

pytestmark = pytest.mark.slow  # fits many models


def runs(**options):
    given = {"condition": "C1", "n_runs": 2, "remnant_intensity": 0.1, "random_state": 3}
    return make_tracking_runs(**{**given, **options})


def fit_of(X, y, effect):
    estimator = OperatorRegressor(effects=effect)
    prepared = estimator.prepare(X, y)
    model, noise = likelihood_fit(estimator.first_fit(prepared), Criterion(prepared.record))
    criterion = Criterion(prepared.record, noise)
    covariance = estimate_covariance(
        model.simulator, criterion, model.fit, collect_prior(model.simulator)
    )
    return model, criterion, covariance


@pytest.fixture(scope="module")
def drifting():
    return fit_of(*runs(effects=GainDrift(rate=0.004)), GainDrift())


def test_ends_are_where_the_deviance_is_that_of_the_interval(drifting):
    model, criterion, covariance = drifting
    profile = _Profile(model, criterion, covariance)
    profile.more[:] = 0.0  # the likelihood alone
    i = model.simulator.names.index("gain_drift__rate")
    for end in profile.intervals([i])["gain_drift__rate"]:
        found = profile.at(i, end, model.theta)
        assert found.deviance == pytest.approx(CHI2_95, rel=3 * NEAR)
        assert found.theta[i] == end


def test_a_normal_likelihood_has_the_interval_of_the_standard_error(drifting):
    model, criterion, covariance = drifting
    found = find_profile_intervals(model, criterion, covariance)
    i = model.simulator.names.index("gain_drift__rate")
    sd = np.sqrt(covariance[i, i])
    assert found["gain_drift__rate"] == pytest.approx(
        (model.theta[i] - 1.96 * sd, model.theta[i] + 1.96 * sd), abs=0.4 * sd
    )
