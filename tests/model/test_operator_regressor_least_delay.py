"""What the loop moves is not answered at once."""

import numpy as np
import pandas as pd
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Disturbance, OutputFeedback, WrongDelay
from skhoid.model.cores import OperatorCore


@pytest.fixture(scope="module")
def quick():
    """Somebody who answers at once, whose delay would be 0."""
    X, _ = make_tracking_runs(duration=20.48, channels=["e", "x"], random_state=0)
    e = X["e"].to_numpy()
    filtered = np.convolve(e, np.exp(-np.arange(60) / 8.0), "full")[: e.size]
    return X, pd.Series(filtered, X.index, name="u")


def test_delay_is_at_least_that_of_a_person(quick):
    X, y = quick
    found = OperatorRegressor().fit(X, y)
    assert found.parameters_.loc["tau_e", "value"] == 0.1
    assert np.isnan(found.parameters_.loc["tau_e", "sd"])
    assert "tau_e is at its lower bound, 0.10 s" in " ".join(found.summary().split())


def test_least_delay_is_a_parameter(quick):
    X, y = quick
    found = OperatorRegressor(least_delay=0.02).fit(X, y)
    assert 0.02 <= found.parameters_.loc["tau_e", "value"] < 0.1


def test_shorter_delay_is_taken_as_given_and_said(quick):
    X, y = quick
    found = OperatorRegressor(delay=0.03).fit(X, y)
    assert found.parameters_.loc["tau_e", "value"] == 0.03
    assert "The delay given, 0.03 s, is below the least" in " ".join(found.summary().split())


def test_bounds_of_effects_follow(quick):
    X, y = quick
    least = low = 0.25
    prepared = OperatorRegressor(least_delay=least).prepare(X, y)
    assert OutputFeedback().limits(prepared.record)["delay"][0] == low
    given = OperatorCore(0.3, least).add_to_record(prepared.record)
    assert WrongDelay().limits(given)["extra"][0] == pytest.approx(least - 0.3)


@pytest.mark.parametrize(("least", "low"), [(None, 0.02), (0.25, 0.02), (0.0, 0.0)])
def test_a_disturbance_is_answered_no_sooner_than_by_a_reflex(quick, least, low):
    """It comes from outside, and may be felt sooner than what is seen is answered."""
    X, y = quick
    felt = X.assign(dist=np.sin(np.arange(len(X)) / 40))
    prepared = OperatorRegressor(least_delay=least).prepare(felt, y)
    assert Disturbance(channel="dist").limits(prepared.record)["delay"][0] == low
