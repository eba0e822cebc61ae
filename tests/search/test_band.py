"""Bands hold the curves: of maps and of gains that swing, over simulated operators."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import FreeGain, FreeMap
from skhoid.model.fitting import Criterion
from skhoid.model.smoothing import refine_detail
from skhoid.search.shape import curve_with_band, half_width

N_SEEDS = 6
LEVELS = np.linspace(0.025, 0.975, 96)
IN_TIME = np.linspace(0.0, 82.0, 42)
SWING = FreeGain(knots=tuple(IN_TIME), values=tuple(0.4 * np.sin(2 * np.pi * IN_TIME / 20)))
ERRORS = np.linspace(-4.0, 4.0, 41)
LIMITED = FreeMap(knots=tuple(ERRORS), values=tuple(1.2 * np.tanh(ERRORS / 0.8) - ERRORS))


def shown(estimator, X, y):
    """Curve with its band of the free form that an estimator has, and degrees of freedom."""
    name = estimator.effects.name
    model = refine_detail(estimator.first_fit(estimator.prepare(X, y)), name)
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    return curve_with_band(model.refined(criterion), name)


def make_curve(hidden, seed):
    """Curve with its band and the truth, both as whole factors or maps of slope one."""
    X, y = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.1, effects=hidden, sampling_rate=50, random_state=seed
    )
    curve, dof = shown(OperatorRegressor(effects=type(hidden)()), X, y)
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


@pytest.mark.parametrize(
    "hidden",
    [pytest.param(SWING, marks=pytest.mark.whole), pytest.param(LIMITED, marks=pytest.mark.whole)],
    ids=["gain", "map"],
)
def test_bands_hold_the_whole_curve_and_are_not_idle(hidden):
    found = [make_curve(hidden, seed) for seed in range(N_SEEDS)]
    off = np.array([np.abs(apart) / half for apart, half, _ in found])
    assert np.mean(off <= 1) > 0.97
    # Of six bands that hold with 95 %, five or more do with 97 %.
    assert np.sum(off.max(axis=1) <= 1) >= N_SEEDS - 1
    # A band of a quarter of the width would hold hardly any.
    assert np.sum(off.max(axis=1) <= 1 / 4) <= 1


@pytest.mark.whole
def test_a_sensor_without_sign_has_a_narrow_band_that_holds_it():
    """An ARX model is one of samples: what is between them does not make its band wider."""
    noise = 0.1
    rng = np.random.default_rng(5)
    x = np.repeat(rng.choice([-1.0, 1.0], 100), rng.integers(3, 12, 100))
    size = np.abs(lfilter([0, 1.0, 0.4], [1, -1.6, 0.75], x))
    y = size + noise * np.std(size) * rng.standard_normal(x.size)
    time = pd.Index(np.arange(x.size) * 0.02, name="time")
    form = FreeMap(at="output", folded=True)
    curve, _ = shown(
        SimulatedARX(2, 2, 1, effects=form), pd.DataFrame({"x": x}, time), pd.Series(y, time)
    )
    at, half = curve.index.to_numpy(), (curve["high"] - curve["low"]) / 2
    off = np.abs(curve["value"] - (np.abs(at) - at))
    kink = np.abs(at) < 0.05 * at[-1]  # no smooth curve bends as sharply
    assert (off <= half + 1e-9)[~kink].mean() > 0.97
    assert off[kink].max() < 0.05 * at[-1]
    assert 0.1 < half.median() / (noise * np.std(size)) < 3.0


def test_a_band_of_independent_points_is_that_of_the_largest_of_them():
    """Of n standard normal numbers none exceeds z with probability (2 Phi(z) - 1) ** n."""
    half = half_width(np.eye(20), np.diag(np.full(20, 4.0)))
    np.testing.assert_allclose(half, 2 * 3.0162, rtol=0.02)
