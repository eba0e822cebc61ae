"""Levels at which a stick was held are marked."""

import numpy as np
from support.hidden_effects import Effects, simulate_runs
from support.plot_checks import labels_in

from skhoid import ARXRegressor
from skhoid.plotting import OperatingPointDisplay


def test_levels_of_a_stop_are_marked():
    X, y, _ = simulate_runs("C1", 3, effects=Effects(saturation=0.15))
    display = OperatingPointDisplay.from_estimator(ARXRegressor(nk=29).fit(X, y), X, y)
    np.testing.assert_allclose(np.abs(display.levels_["u"]), 0.15, atol=1e-6)
    assert {"level held, measured"} <= labels_in(display)
