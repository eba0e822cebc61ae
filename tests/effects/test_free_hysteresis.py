"""Hysteresis of any shape: plays side by side, their curve, and play that is found by it."""

import numpy as np
import pytest

from skhoid import ARXRegressor, OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid._kernels import greybox
from skhoid.effects import Backlash, FreeHysteresis
from skhoid.model.extend import extended
from skhoid.model.fitting import Criterion
from skhoid.model.smoothing import posterior_of

KNOTS = (0.2, 0.5, 1.0)


def runs(effect=None, seed=0, n_runs=5):
    return make_tracking_runs(
        condition="C1", n_runs=n_runs, remnant_intensity=0.1, random_state=seed, effects=effect
    )


def added(X, y, effect):
    estimator = OperatorRegressor()
    prepared = estimator.prepare(X, y)
    criterion = Criterion(prepared.record)
    base = estimator.first_fit(prepared)
    model = extended(base, effect.name, effect, criterion, criterion.coarse())
    values = {k.split("__")[1]: v for k, v in model.values().items() if "__" in k}
    return model, dict(model.effects.steps)[effect.name].with_values(values)


def test_one_play_of_weight_one_is_backlash():
    effect = FreeHysteresis(knots=KNOTS)
    x = np.random.default_rng(0).standard_normal((80, 2))
    got = effect.apply(x, None, c0=0.0, c1=1.0, c2=0.0)
    np.testing.assert_allclose(got, Backlash().apply(x, None, gap=0.5), atol=1e-12)
    given = effect.with_values({"c0": 0.0, "c1": 1.0, "c2": 0.0})
    assert given.free == []
    np.testing.assert_allclose(given.apply(x, None), got, atol=1e-12)


def test_the_curve_is_what_is_taken_from_a_first_rise():
    effect = FreeHysteresis(knots=KNOTS).with_values({"c0": 0.3, "c1": -0.1, "c2": 0.5})
    rise = np.linspace(0.0, 1.6, 33)
    curve = effect.curve(np.asarray(effect.values), rise)
    np.testing.assert_allclose(effect.apply(rise[:, None], None)[:, 0] - rise, curve, atol=1e-12)
    fall = effect.curve(np.asarray(effect.values), -rise)
    np.testing.assert_allclose(fall, -curve)
    by_each = FreeHysteresis(knots=KNOTS).design(rise) @ [0.3, -0.1, 0.5]
    np.testing.assert_allclose(by_each, curve, atol=1e-12)


def test_play_that_has_no_weight_does_nothing():
    x = np.random.default_rng(0).standard_normal((80, 2))
    assert not greybox.stops_summed(x, np.array(KNOTS), np.zeros(3)).any()


def test_words_and_places():
    assert FreeHysteresis().place == "output"
    assert FreeHysteresis(at="command").over == "command"
    assert "memory" in FreeHysteresis().sentence


@pytest.mark.slow
@pytest.mark.parametrize("at", ["output", "command"])
def test_play_is_found_as_a_shape(at):
    """A curve that rises to the gap and stays there, within 20 % of the gap."""
    X, y = runs(Backlash(gap=0.05))
    _, effect = added(X, y, FreeHysteresis(at=at))
    at = np.linspace(0.0, 0.12, 25)
    curve = effect.curve(np.asarray(effect.values), at)
    assert np.abs(curve + np.minimum(at, 0.05)).max() < 0.2 * 0.05


def test_nothing_has_no_memory():
    X, y = runs(seed=3, n_runs=2)
    model, effect = added(X, y, FreeHysteresis())
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    assert posterior_of(model, criterion).dof[-len(effect.knots) :].sum() < 2.0


@pytest.mark.slow
def test_a_fit_through_the_public_class():
    X, y = runs(Backlash(gap=0.05), n_runs=2)
    plain = ARXRegressor(2, 2, 20).fit(X, y)
    model = SimulatedARX(2, 2, 20, effects=FreeHysteresis()).fit(X, y)
    left = [float(np.mean((y - m.predict(X)) ** 2)) for m in (plain, model)]
    assert left[1] < left[0]
