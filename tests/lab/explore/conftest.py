"""Runs of a person with a dead zone and a bias, and a search that found both."""

import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone


@pytest.fixture(scope="session")
def runs():
    return make_tracking_runs(
        "C1",
        3,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        duration=20.48,
        remnant_intensity=0.05,
        random_state=3,
    )


@pytest.fixture(scope="session")
def search(runs):
    return EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone", "saturation"]).fit(
        *runs
    )
