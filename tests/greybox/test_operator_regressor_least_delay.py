"""What the loop moves is not answered at once."""

import numpy as np
import pandas as pd
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import OutputFeedback, WrongDelay
from skhoid.greybox.cores import OperatorCore


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
    assert "tau_e is at its least, 0.10 s" in " ".join(found.summary().split())


def test_least_delay_is_a_parameter(quick):
    X, y = quick
    found = OperatorRegressor(least_delay=0.02).fit(X, y)
    assert 0.02 <= found.parameters_.loc["tau_e", "value"] < 0.1


def test_shorter_delay_is_taken_as_given_and_said(quick):
    X, y = quick
    found = OperatorRegressor(delay=0.03).fit(X, y)
    assert found.parameters_.loc["tau_e", "value"] == 0.03
    assert "The delay given, 0.03 s, is below the least" in " ".join(found.summary().split())


@pytest.mark.parametrize(("least", "low"), [(0.1, 0.1), (0.25, 0.25)])
def test_bounds_of_effects_follow(quick, least, low):
    X, y = quick
    prepared = OperatorRegressor(least_delay=least).prepare(X, y)
    assert OutputFeedback().limits(prepared.record)["delay"][0] == low
    given = OperatorCore(0.3, least).on(prepared.record)
    assert WrongDelay().limits(given)["extra"][0] == pytest.approx(least - 0.3)
