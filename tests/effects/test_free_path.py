"""Responses of any smooth memory to a channel and to the error."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import FreeDynamics, FreePath, TimeVaryingDelay
from skhoid.effects.free_form import SmoothCurve
from skhoid.effects.free_forms import convolved, shakes


def test_a_convolution_is_the_sum_over_lags_and_holds_at_the_ends():
    rng = np.random.default_rng(0)
    signal = rng.normal(size=(60, 2))
    knots = (-0.05, 0.0, 0.1, 0.2)
    values = np.array([0.5, 1.0, -0.4, 0.2])
    dt = 0.01
    curve = SmoothCurve(knots)
    got = convolved(signal, lambda at: curve(values, at), knots, dt)
    lags = np.arange(-5, 21)
    weights = curve(values, lags * dt) * dt
    weights[[0, -1]] /= 2
    expected = np.zeros_like(signal)
    for k in range(60):
        for lag, weight in zip(lags, weights, strict=True):
            expected[k] += weight * signal[np.clip(k - lag, 0, 59)]
    np.testing.assert_allclose(got, expected, atol=1e-12)


def with_response(seed, gain, lag):
    """Runs in which the output also follows a channel, a while later and smeared over 0.1 s."""
    X, y = make_tracking_runs(condition="C1", n_runs=4, remnant_intensity=0.1, random_state=seed)
    rng = np.random.default_rng(seed)
    other = np.concatenate(
        [np.convolve(rng.normal(size=len(run)), np.ones(40) / 40, "same")
         for _, run in X.groupby(level="run")]
    )  # fmt: skip
    late = np.roll(other, round(lag / 0.01))
    spread = np.convolve(late, np.ones(10) / 10, "same")
    return X.assign(other=other), y + gain * spread


@pytest.mark.slow
def test_a_response_to_a_channel_is_found_with_its_lag():
    X, y = with_response(0, 0.3, 0.4)
    model = OperatorRegressor(effects=FreePath(channel="other")).fit(X, y)
    effect = dict(model.effects_.steps)["free_path"]
    at = np.linspace(effect.knots[0], effect.knots[-1], 200)
    response = effect.curve(np.asarray(effect.values), at)
    without = OperatorRegressor().fit(X, y)
    assert model.vaf_ > without.vaf_ + 5.0
    peak = at[np.argmax(response)]
    assert abs(peak - 0.4) < 0.16  # the limb and distances of knots of 0.15 s
    assert abs(np.trapezoid(response, at) - 0.3) < 0.08


@pytest.mark.slow
def test_dynamics_that_are_there_already_stay_away():
    X, y = make_tracking_runs(condition="C1", n_runs=4, remnant_intensity=0.1, random_state=1)
    model, plain = (OperatorRegressor(effects=e).fit(X, y) for e in (FreeDynamics(), None))
    assert model.vaf_ < plain.vaf_ + 0.5


def test_each_channel_is_tried_and_a_target_ahead_too():
    X, y = make_tracking_runs(condition="C1", n_runs=1, remnant_intensity=0.1, random_state=1)
    X = X.assign(f_t=X["e"].cumsum(), x=X["e"].cumsum() - X["e"])
    record = OperatorRegressor().prepare(X, y).record
    tried = [(one.channel, one.ahead) for one in FreePath().alternatives(record)]
    others = [name for name in record.channels if name not in record.inputs]
    assert {name for name, _ in tried} == set(others)
    assert ("f_t", 1.0) in tried
    assert FreePath(channel="f_t", ahead=1.0).first_lag(record) == -1.0
    assert FreePath(channel="x").first_lag(record) == record.least_delay


def shaken(seed, gain):
    """Runs in which motion of its own, and motion that follows the target, are measured."""
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=4,
        remnant_intensity=0.1,
        random_state=seed,
        channels=("e", "x", "f_t"),
    )
    rng = np.random.default_rng(seed)
    white = [rng.normal(size=len(run)) for _, run in X.groupby(level="run")]
    alone = np.concatenate([np.convolve(one, np.ones(30) / np.sqrt(30), "same") for one in white])
    late = np.roll(X["x"].to_numpy(), 20)
    moved = X.assign(motion_alone=alone, motion_moved=late + 0.3 * alone)
    return moved, y + gain * y.std() * alone


def test_motion_that_the_loop_does_not_move_may_act_at_once():
    X, y = shaken(2, 0.3)
    record = OperatorRegressor().prepare(X, y).record
    assert shakes("motion_alone", record)
    assert not shakes("motion_moved", record)  # it carries the target
    assert not shakes("x", record)
    at_once = [one for one in FreePath().alternatives(record) if one.at == "output"]
    assert [one.channel for one in at_once] == ["motion_alone"]
    assert at_once[0].place == "sum"
    assert at_once[0].first_lag(record) == 0.0
    no_target = OperatorRegressor().prepare(X.drop(columns=["f_t", "x"]), y).record
    assert not shakes("motion_alone", no_target)


@pytest.mark.slow
def test_motion_that_the_loop_moves_otherwise_in_the_second_half_may_not():
    """An operator whose delay changes half-way moves the vehicle, too."""
    X, y = make_tracking_runs(
        condition="C1",
        effects=TimeVaryingDelay(change=0.2, rate=100.0, time=40.0),
        n_runs=3,
        remnant_intensity=0.4,
        random_state=1,
        channels=("e", "x", "f_t"),
    )
    twice = [np.gradient(np.gradient(run["x"], 0.01), 0.01) for _, run in X.groupby(level="run")]
    shaking = np.random.default_rng(1).normal(size=len(X))
    moved = np.concatenate(twice)
    record = (
        OperatorRegressor().prepare(X.assign(motion=moved + 0.5 * moved.std() * shaking), y).record
    )
    assert not shakes("motion", record)


@pytest.mark.slow
def test_what_shakes_the_output_is_found_without_a_delay():
    X, y = shaken(3, 0.3)
    fitted = {
        at: OperatorRegressor(effects=FreePath(channel="motion_alone", at=at)).fit(X, y)
        for at in ("output", "command")
    }
    assert fitted["output"].vaf_ > fitted["command"].vaf_ + 2.0
    effect = dict(fitted["output"].effects_.steps)["free_path"]
    at = np.linspace(0.0, effect.knots[-1], 200)
    response = effect.curve(np.asarray(effect.values), at)
    assert at[np.argmax(response)] < 0.05
    assert np.trapezoid(response, at) == pytest.approx(0.3 * y.std(), rel=0.3)  # knots: 0.05 s
