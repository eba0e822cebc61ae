"""Bands hold the curves: of maps and of gains that swing, over simulated operators."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import FreeGain, FreeMap
from skhoid.greybox.fitting import Criterion
from skhoid.greybox.smoothing import in_detail
from skhoid.search.band import curve_with_band, half_width

N_SEEDS = 6
LEVELS = np.linspace(0.025, 0.975, 96)
IN_TIME = np.linspace(0.0, 82.0, 42)
SWING = FreeGain(knots=tuple(IN_TIME), values=tuple(0.4 * np.sin(2 * np.pi * IN_TIME / 20)))
ERRORS = np.linspace(-4.0, 4.0, 41)
LIMITED = FreeMap(knots=tuple(ERRORS), values=tuple(1.2 * np.tanh(ERRORS / 0.8) - ERRORS))


def curve_of(hidden, seed):
    """Curve with its band and the truth, both as whole factors or maps of slope one."""
    X, y = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.1, effects=hidden, sampling_rate=50, random_state=seed
    )
    form = type(hidden)()
    estimator = OperatorRegressor(effects=form)
    model = in_detail(estimator.first_fit(estimator.prepare(X, y)), form.name)
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    curve, dof = curve_with_band(model.refined(criterion), form.name)
    data = X.index.get_level_values("time") if hidden is SWING else X["e"]
    at = np.quantile(data.to_numpy(), LEVELS)
    said = np.interp(at, curve.index, curve["value"])
    half = np.interp(at, curve.index, (curve["high"] - curve["low"]) / 2)
    true = np.interp(at, hidden.knots, hidden.values)
    if hidden is SWING:
        true = (1 + true) * said.mean() / (1 + true).mean()
    else:
        slope = np.polyfit(at, said, 1)[0]
        whole = at + true
        gain, level = np.polyfit(at, whole, 1)
        true = (whole - level) * (1 + slope) / gain - at
        true += said.mean() - true.mean()
    return said - true, half, dof


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [SWING, LIMITED], ids=["gain", "map"])
def test_bands_hold_the_whole_curve_and_are_not_idle(hidden):
    found = [curve_of(hidden, seed) for seed in range(N_SEEDS)]
    off = np.array([np.abs(apart) / half for apart, half, _ in found])
    assert np.mean(off <= 1) > 0.97
    # Of six bands that hold with 95 %, five or more do with 97 %.
    assert np.sum(off.max(axis=1) <= 1) >= N_SEEDS - 1
    # A band of a quarter of the width would hold hardly any.
    assert np.sum(off.max(axis=1) <= 1 / 4) <= 1


def test_a_band_of_independent_points_is_that_of_the_largest_of_them():
    """Of n standard normal numbers none exceeds z with probability (2 Phi(z) - 1) ** n."""
    half = half_width(np.eye(20), np.diag(np.full(20, 4.0)))
    np.testing.assert_allclose(half, 2 * 3.0162, rtol=0.02)
