"""Intervals of effects' parameters by profile likelihood."""

import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import GainDrift


@pytest.mark.slow
def test_a_normal_likelihood_has_the_interval_of_the_standard_error():
    X, y = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.1, random_state=3, effects=GainDrift(rate=0.004)
    )
    row = OperatorRegressor(effects=GainDrift()).fit(X, y).parameters_.loc["gain_drift__rate"]
    for end, sign in (("low", -1), ("high", 1)):
        assert row[end] == pytest.approx(
            row["value"] + sign * 1.96 * row["sd"], abs=0.4 * row["sd"]
        )
        assert row[end] != row["value"] + sign * 1.96 * row["sd"]  # it is the likelihood's own
