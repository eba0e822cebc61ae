"""Free forms: curves of any smooth shape, given and found: maps, forces, memories, over time."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline
from support.synthetic import run_time

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import (
    Backlash,
    FreeDelay,
    FreeDynamics,
    FreeGain,
    FreeHysteresis,
    FreeMap,
    FreeOffset,
    FreePath,
    TimeVaryingDelay,
    TimeVaryingGain,
)
from skhoid.testing import synthetic_record
from skhoid.testing.records import signal_at

KNOTS = (0.0, 5.0, 10.0, 15.0, 20.0)
VALUES = (0.0, 0.2, -0.1, 0.3, 0.1)


def runs(seed, n_runs=2, remnant=0.1, effects=None):
    """At 50 Hz, with a further channel."""
    X, y = make_tracking_runs(
        "C1",
        n_runs,
        remnant_intensity=remnant,
        random_state=seed,
        sampling_rate=50,
        effects=effects,
    )
    noise = np.random.default_rng(seed).normal(size=len(X))
    return X.assign(other=np.convolve(noise, np.ones(20) / 20, "same")), y


def found_in(model, name):
    """The effect of a fitted model, points between its outer knots, and its curve there."""
    effect = dict(model.effects_.steps)[name]
    at = np.linspace(effect.knots[0], effect.knots[-1], 200)
    return effect, at, effect.curve(np.asarray(effect.values), at)


def table(x, y, dt):
    index = run_time([len(x)], dt=dt)
    return pd.DataFrame({"x": x}, index), pd.Series(y, index, name="y")


def test_a_curve_is_the_natural_spline_and_a_line_beyond():
    curve = FreeOffset(knots=KNOTS).curve
    spline = CubicSpline(KNOTS, VALUES, bc_type="natural")
    at = np.linspace(0.0, 20.0, 50)
    np.testing.assert_allclose(curve(np.array(VALUES), at), spline(at), atol=1e-12)
    beyond = curve(np.array(VALUES), np.array([20.0, 21.0, 22.0, 23.0]))
    np.testing.assert_allclose(np.diff(beyond, 2), 0.0, atol=1e-12)
    assert beyond[0] == pytest.approx(VALUES[-1])


def test_the_basis_is_orthonormal_at_the_knots_and_its_roughness_is_the_integral():
    curve = FreeOffset(knots=KNOTS).curve
    rough = curve.basis[:, 2:]
    np.testing.assert_allclose(rough.T @ rough / len(KNOTS), np.eye(len(KNOTS) - 2), atol=1e-10)
    np.testing.assert_allclose(rough.T @ curve.basis[:, :2], 0.0, atol=1e-9)
    at = np.linspace(KNOTS[0], KNOTS[-1], 20_001)
    integrals = [
        np.trapezoid(CubicSpline(KNOTS, column, bc_type="natural")(at, 2) ** 2, at)
        for column in rough.T
    ]
    np.testing.assert_allclose(curve.roughness[2:], np.array(integrals) / integrals[0], rtol=1e-6)


@pytest.mark.parametrize(("form", "fewer"), [(FreeGain, 1), (FreeMap, 1)])
def test_what_the_model_has_already_is_no_part_of_any_curve(form, fewer):
    basis = form(knots=KNOTS).curve.basis
    assert basis.shape == (len(KNOTS), len(KNOTS) - fewer)
    missing = np.ones(len(KNOTS)) if form is FreeGain else np.array(KNOTS) - np.mean(KNOTS)
    np.testing.assert_allclose(missing @ basis, 0.0, atol=1e-9)


def test_each_acts_by_its_curve():
    record = synthetic_record()
    given = signal_at("gain", record)
    gain = FreeGain(knots=KNOTS, values=VALUES)
    curve = gain.curve(np.array(VALUES), record.t)
    np.testing.assert_allclose(
        gain.apply(given, record).error, np.maximum(1 + curve, 0), atol=1e-12
    )
    only = FreeGain(of="rate", knots=KNOTS, values=VALUES).apply(given, record)
    assert only.error is given.error
    delay = FreeDelay(knots=KNOTS, values=VALUES).apply(0.2, record)
    np.testing.assert_allclose(delay, 0.2 + curve, atol=1e-12)
    output = np.zeros(record.known.shape)
    offset = FreeOffset(knots=KNOTS, values=VALUES).apply(output, record)
    np.testing.assert_allclose(offset, np.broadcast_to(curve, output.shape), atol=1e-12)


def test_a_curve_holds_beyond_what_was_seen():
    record = synthetic_record()
    channel = np.broadcast_to(
        np.linspace(-30.0, 60.0, record.known.shape[0])[:, None], record.known.shape
    )
    wide = record.changed({"speed": np.ascontiguousarray(channel)})
    delay = FreeDelay(channel="speed", knots=KNOTS, values=VALUES).apply(0.2, wide)
    np.testing.assert_allclose(delay[channel < KNOTS[0]], 0.2 + VALUES[0])
    np.testing.assert_allclose(delay[channel > KNOTS[-1]], 0.2 + VALUES[-1])


def test_a_force_by_a_table_is_the_curve():
    knots = tuple(np.linspace(-1.0, 2.0, 7).tolist())
    effect = FreeMap(at="spring", knots=knots, values=tuple((np.array(knots) ** 2).tolist()))
    at = np.linspace(-2.0, 3.0, 41)
    expected = effect.curve(np.asarray(effect.values), at) - effect.curve(
        np.asarray(effect.values), np.zeros(1)
    )
    got = effect.apply(signal_at("spring", synthetic_record()), None).force(at)
    np.testing.assert_allclose(got, expected, atol=5e-5)
    rate = FreeMap(at="rate", knots=knots, values=effect.values).apply(
        signal_at("spring", synthetic_record()), None
    )
    np.testing.assert_allclose(rate.force(np.zeros_like(at), at), expected, atol=5e-5)


def test_forces_have_no_line_and_are_zero_at_rest():
    knots = tuple(np.linspace(-1.0, 2.0, 7).tolist())
    effect = FreeMap(at="spring", knots=knots)
    given = effect.with_values({p.name: 1.0 for p in effect.free})
    assert given.curve(np.asarray(given.values), np.zeros(1)) == pytest.approx(0.0, abs=1e-12)
    assert np.polyfit(knots, given.values, 1)[0] == pytest.approx(0.0, abs=1e-9)
    total = effect.design(np.array([0.3])).sum()
    assert total == pytest.approx(float(given.curve(np.asarray(given.values), np.array([0.3]))[0]))


def test_a_fold_changes_nothing_where_it_is_greatest():
    form = FreeMap(at="output", knots=(-2.0, -1.0, 0.0, 1.0, 2.0), folded=True)
    assert len(form.parameters) == len(form.knots) - 1
    assert np.abs(form.design(np.array([2.0]))).max() < 1e-12
    (start,) = form.starts(None)
    fold = form.with_values(start)
    signal = np.array([-2.0, -0.5, 0.5, 1.5, 2.0])
    by_values, by_coefficients = fold.apply(signal, None), form.apply(signal, None, **start)
    np.testing.assert_allclose(by_coefficients, by_values, atol=1e-12)
    np.testing.assert_allclose(fold.values, [4.0, 2.0, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(by_values[[0, -1]], [2.0, 2.0], atol=1e-12)


def test_one_play_of_weight_one_is_backlash():
    effect = FreeHysteresis(knots=(0.2, 0.5, 1.0))
    x = np.random.default_rng(0).standard_normal((80, 2))
    got = effect.apply(x, None, c0=0.0, c1=1.0, c2=0.0)
    np.testing.assert_allclose(got, Backlash().apply(x, None, gap=0.5), atol=1e-12)
    given = effect.with_values({"c0": 0.0, "c1": 1.0, "c2": 0.0})
    assert given.free == []
    np.testing.assert_allclose(given.apply(x, None), got, atol=1e-12)


def test_the_curve_is_what_is_taken_from_a_first_rise():
    effect = FreeHysteresis(knots=(0.2, 0.5, 1.0)).with_values({"c0": 0.3, "c1": -0.1, "c2": 0.5})
    rise = np.linspace(0.0, 1.6, 33)
    curve = effect.curve(np.asarray(effect.values), rise)
    np.testing.assert_allclose(effect.apply(rise[:, None], None)[:, 0] - rise, curve, atol=1e-12)
    fall = effect.curve(np.asarray(effect.values), -rise)
    np.testing.assert_allclose(fall, -curve)
    by_each = FreeHysteresis(knots=(0.2, 0.5, 1.0)).design(rise) @ [0.3, -0.1, 0.5]
    np.testing.assert_allclose(by_each, curve, atol=1e-12)


def test_a_response_is_the_sum_over_lags_and_holds_at_the_ends():
    record = synthetic_record()
    form = FreePath(
        channel="speed", at="output", knots=(0.0, 0.1, 0.2, 0.3), values=(1, 0, -1, 0.5)
    )
    got = form.apply(np.zeros(record.known.shape), record)
    lags = np.arange(round(0.3 / record.dt) + 1)
    weights = form.curve(np.asarray(form.values), lags * record.dt) * record.dt
    weights[[0, -1]] /= 2
    held = np.pad(record.channels["speed"], ((lags[-1], 0), (0, 0)), mode="edge")
    n = record.known.shape[0]
    expected = sum(
        w * held[lags[-1] - lag : lags[-1] - lag + n] for lag, w in zip(lags, weights, strict=True)
    )
    np.testing.assert_allclose(got, expected, atol=1e-12)


def test_which_places_and_channels_are_tried():
    X, y = runs(1, n_runs=1)
    X = X.assign(f_t=X["e"].cumsum(), x=X["e"].cumsum() - X["e"])
    record = OperatorRegressor(inputs=["e"]).prepare(X, y).record
    of_error = {"|e|", "size of e", "de/dt", "|de/dt|"}
    tried = [(one.channel, one.ahead) for one in FreePath().alternatives(record)]
    assert {name for name, _ in tried} == {"x", "f_t", "other"}
    assert ("f_t", 1.0) in tried
    over = {one.over for one in FreeGain().alternatives(record)}
    assert over == {one.over for one in FreeDelay().alternatives(record)}
    assert over == {"time", "other", *of_error, "|df_t/dt|", "x", "|x|"}
    assert [one.at for one in FreeHysteresis().alternatives(record)] == ["output", "command"]
    assert [one.place for one in FreeMap().alternatives(record)] == [
        *("input", "path", "command", "output", "spring", "spring", "input", "path")
    ]
    assert FreePath(channel="f_t", ahead=1.0).with_knots(record).knots[0] == -1.0
    assert FreePath(channel="x").with_knots(record).knots[0] == record.least_delay


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


def at_once(X, y):
    """Channels that a search takes to shake the output."""
    record = OperatorRegressor(inputs=["e"]).prepare(X, y).record
    return [one.channel for one in FreePath().alternatives(record) if one.at == "output"]


def test_motion_that_the_loop_does_not_move_may_act_at_once():
    X, y = shaken(2, 0.3)
    assert at_once(X, y) == ["motion_alone"]  # the other carries the target
    assert at_once(X.drop(columns=["f_t", "x"]), y) == []  # without a target nobody knows


def test_signals_that_follow_from_channels():
    X, y = runs(3, n_runs=2)
    X = X.assign(f_t=X["e"].cumsum())
    record = OperatorRegressor(inputs=["e"]).prepare(X, y).record
    e, dt = record.input, record.dt
    np.testing.assert_array_equal(record.channel("|e|"), np.abs(e))
    np.testing.assert_allclose(record.channel("de/dt")[1:-1], (e[2:] - e[:-2]) / (2 * dt))
    np.testing.assert_allclose(record.channel("x"), record.channel("f_t") - e)  # not recorded
    n = round(2.0 / dt)
    size = record.channel("size of e")
    np.testing.assert_allclose(size[0], np.abs(e[0]))
    for at in (n - 1, 5 * n):  # of the last two seconds alone
        np.testing.assert_allclose(size[at], np.sqrt(np.mean(e[at - n + 1 : at + 1] ** 2, axis=0)))
    louder = record.changed({"e": 3.0 * e})  # as a simulated loop changes it
    np.testing.assert_allclose(louder.channel("size of e"), 3.0 * size, atol=1e-9)
    assert not OperatorRegressor(inputs=["e"]).prepare(X[["e"]], y).record.has("|df_t/dt|")


@pytest.mark.parametrize(
    ("form", "says", "unit"),
    [
        (FreeGain(channel="size of e"), "the gains, as a function of the running size", "deg"),
        (FreeDelay(channel="|e|"), "the delay, as a function of the size of the error", "deg"),
        (FreeGain(channel="|df_t/dt|"), "as a function of the speed of the target", "mm/s"),
        (FreeGain(channel="x"), "as a function of the controlled output x", "cm"),
        (FreeMap(at="error rate"), "the response to the rate of the error", "deg/s"),
    ],
)
def test_what_a_curve_is_over_has_words_and_a_unit(form, says, unit):
    assert says in form.sentence
    assert form.abscissa.label({"e": "deg", "[f_t]": "mm", "[x]": "cm", "u": "deg"}) == unit


def test_an_odd_curve_is_the_same_for_either_sign():
    record = synthetic_record()
    (form,) = FreeMap(at="error", odd=True).variants(record)
    assert form.ends == (-form.knots[-1], form.knots[-1])
    values = {p.name: 0.1 * (i + 1) for i, p in enumerate(form.parameters)}
    found = form.with_values(values)
    at = np.linspace(0.0, 1.2 * found.knots[-1], 50)
    both = [found.curve(np.asarray(found.values), sign * at) for sign in (1.0, -1.0)]
    np.testing.assert_allclose(both[0], -both[1], atol=1e-9)
    assert both[0][0] == 0.0
    np.testing.assert_allclose(found.apply(at, record) - at, form.apply(at, record, **values) - at)


def test_a_dead_zone_of_the_rate_is_a_curve_over_the_rate():
    record = synthetic_record()
    command = signal_at("path", record)
    rate = np.gradient(command.error, record.dt, axis=0)
    knots = tuple(np.linspace(rate.min(), rate.max(), 7).tolist())
    form = FreeMap(at="error rate", knots=knots, values=tuple((np.array(knots) ** 2).tolist()))
    curve = form.curve(np.asarray(form.values), rate)
    np.testing.assert_allclose(form.apply(command, record).position, command.position + curve)


def test_an_arx_model_has_no_gain_on_the_error_rate():
    with pytest.raises(ValueError, match="does not apply: a linear model has no gain"):
        SimulatedARX(2, 2, nk=10, inputs=["e"], effects=FreeGain(of="rate")).fit(*runs(5))


@pytest.mark.parametrize("effect", [FreeGain(channel="wind"), FreePath(channel="wind")])
def test_a_channel_that_is_not_there_is_named(effect):
    with pytest.raises(ValueError, match="X has no channel 'wind'"):
        OperatorRegressor(inputs=["e"], effects=effect).fit(*runs(5, n_runs=1))


@pytest.mark.slow
@pytest.mark.parametrize("form", [FreeDelay(), FreePath(channel="other")], ids=str)
def test_what_was_found_can_be_stored_and_given_again(form):
    X, y = runs(40, n_runs=1)
    model = OperatorRegressor(inputs=["e"], effects=form).fit(X, y)
    effect, *_ = found_in(model, form.name)
    assert effect.spread > 0
    assert not model.parameters_.index.str.contains("__").any()
    simulated = model.predict(X)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).predict(X), simulated)
    again = OperatorRegressor(inputs=["e"], effects=model.effects_).fit(X, y)
    np.testing.assert_allclose(again.predict(X), simulated, atol=1e-3 * np.std(simulated))


@pytest.mark.slow
@pytest.mark.parametrize("form", [FreeGain(), FreeDynamics()], ids=str)
def test_where_there_is_nothing_the_fit_is_hardly_better(form):
    X, y = runs(3, n_runs=2)
    model, plain = (OperatorRegressor(inputs=["e"], effects=e).fit(X, y) for e in (form, None))
    assert plain.vaf_ - 0.1 < model.vaf_ < plain.vaf_ + 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "true", "course", "most"),
    [
        (
            FreeGain(),
            TimeVaryingGain(K_e_change=0.8, K_edot_change=0.8, rate=0.5, time=40.0),
            lambda t: 0.8 / (1 + np.exp(-0.5 * (t - 40.0))),
            0.15,
        ),
        (
            FreeDelay(),
            TimeVaryingDelay(change=0.12, rate=0.5, time=40.0),
            lambda t: 0.12 / (1 + np.exp(-0.5 * (t - 40.0))),
            0.04,
        ),
    ],
    ids=["gain", "delay"],
)
def test_what_changes_is_found_over_time(form, true, course, most):
    X, y = runs(3, n_runs=4, effects=true)
    _, at, curve = found_in(OperatorRegressor(inputs=["e"], effects=form).fit(X, y), form.name)
    inner = slice(13, -13)  # five seconds at either end
    found, expected = (curve - curve.mean())[inner], (course(at) - course(at).mean())[inner]
    if form.name == "free_gain":  # relative to the gain of the model
        found, expected = 1 + curve[inner], 1 + course(at)[inner]
        found = found / (found @ expected / (expected @ expected))
    assert np.abs(found - expected).max() < most


@pytest.mark.slow
def test_a_response_to_a_channel_is_found_with_its_lag_and_its_channel():
    X, y = runs(0, n_runs=4)
    late = np.convolve(np.roll(X["other"], 20), np.ones(5) / 5, "same")
    noise = np.random.default_rng(9).normal(size=len(X))
    X = X.assign(idle=np.convolve(noise, np.ones(20) / 20, "same"), other=X["other"] + 100.0)
    model = OperatorRegressor(inputs=["e"], effects=FreePath()).fit(X, y + 0.3 * late)
    effect, at, response = found_in(model, "free_path")
    assert effect.channel == "other"
    assert effect.reference == pytest.approx(100.0, abs=0.1)
    assert abs(at[np.argmax(response)] - 0.4) < 0.16  # the limb, and knots 0.15 s apart
    assert abs(np.trapezoid(response, at) - 0.3) < 0.08


@pytest.mark.slow
def test_play_is_found_as_a_shape():
    """A curve that rises to the gap and stays there, within 30 % of the gap."""
    X, y = runs(0, n_runs=3, effects=Backlash(gap=0.05))
    model = OperatorRegressor(inputs=["e"], effects=FreeHysteresis(at="output")).fit(X, y)
    effect = dict(model.effects_.steps)["free_hysteresis"]
    size = np.linspace(0.0, 0.12, 25)
    curve = effect.curve(np.asarray(effect.values), size)
    assert np.abs(curve + np.minimum(size, 0.05)).max() < 0.3 * 0.05


def duffing(n=4000, seed=0):
    """A second-order ARX system with a cubic force of its output."""
    rng = np.random.default_rng(seed)
    x = np.convolve(rng.standard_normal(n), np.ones(4) / 2, "same")
    y = np.zeros(n)
    for k in range(2, n):
        force = 0.3 * y[k - 1] ** 3
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + 0.25 * (x[k - 1] - force)
    return table(x, y + 0.01 * rng.standard_normal(n), 0.02)


def test_the_spring_of_a_machine_is_found_as_a_shape():
    X, y = duffing()
    left = [
        float(np.mean((y - SimulatedARX(2, 1, 1, effects=e).fit(X, y).predict(X)) ** 2) / y.var())
        for e in (None, FreeMap(at="spring"))
    ]
    assert left[1] < 0.1 * left[0]
    assert left[1] < 0.002
