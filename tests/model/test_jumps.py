"""Fits of effects that jump: the likeliest of many narrow minima."""

import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Stiction


@pytest.mark.slow
def test_breakaway_and_friction_of_jumps_are_found():
    hidden = Stiction(form="jump", breakaway=0.06, kinetic=0.6)
    options = {"n_runs": 2, "duration": 40.96, "sampling_rate": 50, "remnant_intensity": 0.03}
    X, y = make_tracking_runs("C1", effects=hidden, random_state=2, **options)
    found = OperatorRegressor(effects=Stiction(form="jump")).fit(X, y).parameters_["value"]
    assert found["stiction__breakaway"] == pytest.approx(0.06, rel=0.05)
    assert found["stiction__kinetic"] == pytest.approx(0.6, rel=0.05)
