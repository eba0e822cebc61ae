"""An identified effect is drawn as what its ``apply`` makes."""

import copy
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from sklearn.exceptions import NotFittedError
from support.plot_checks import covers_nothing
from support.shapes import a_shape

from skhoid import EffectSearchCV, OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import (
    Backlash,
    Bias,
    CrossAxis,
    DeadZone,
    Dimension,
    Disturbance,
    Effect,
    Effects,
    ExtraLag,
    Feedforward,
    FreeGain,
    Friction,
    GainDrift,
    HardeningStiffness,
    HigherOrder,
    Intermittent,
    Lapses,
    MotionFeedback,
    Parameter,
    Preview,
    Quantised,
    RateLimit,
    Saturation,
    ScheduledGain,
    Stiction,
    TimeVaryingGain,
    WrongDelay,
    title_of,
)
from skhoid.plotting import EffectDisplay

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def runs():
    X, y = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.1, channels=["e", "x", "f_t"], random_state=0
    )
    time = X.index.get_level_values("time").to_numpy()
    X = X.assign(
        motion=np.sin(time),
        dist=np.cos(time),
        speed=20 + 5 * np.sin(0.1 * time),
        e_y=np.sin(2 * time),
    )
    X.attrs["units"] = {"e": "deg", "x": "deg", "f_t": "deg", "dist": "V", "speed": "m/s"}
    y.attrs["units"] = {"u": "deg"}
    return X, y


@pytest.fixture(scope="module")
def baseline(runs):
    return OperatorRegressor().fit(*runs)


def with_found(model, effect, sd=0.1):
    """A fitted model as if it had an effect, whose numbers have relative standard deviations."""
    found = copy.copy(model)
    found.effects_ = Effects.of(effect)
    (name,) = found.effects_.names
    keys = {f"{name}__{p.name}": float(getattr(effect, p.name)) for p in effect.parameters}
    names = [*model.covariance_.index, *keys]
    found.covariance_ = model.covariance_.reindex(index=names, columns=names, fill_value=0.0)
    rows = {"value": keys, "sd": {key: sd * abs(value) for key, value in keys.items()}}
    for key, deviation in rows["sd"].items():
        found.covariance_.loc[key, key] = deviation**2
    table = pd.DataFrame(rows).assign(low=0.0, high=0.0, unit="-", meaning="")
    found.parameters_ = pd.concat([model.parameters_, table])
    return found


class SquareRoot(Effect):
    """An effect of a user's own."""

    name = "square_root"
    place = "input"
    physics = "The response to large errors is less than proportional."
    parameters = (Parameter("knee", Dimension(e=1), 0.01, 10.0),)

    def __init__(self, *, knee=None):
        self.knee = knee

    def apply(self, signal, record, knee):
        return np.sign(signal) * np.sqrt(np.abs(signal) * knee)


class AwakeByError(Effect):
    """An own effect on the gains that follows the error."""

    name = "awake"
    place = "gain"
    parameters = (Parameter("slope", Dimension(e=-1), -1.0, 1.0, (0.1,)),)

    def __init__(self, *, slope=None):
        self.slope = slope

    def apply(self, signal, record, slope):
        return signal.times(1 + slope * np.abs(record.input))


MAPS = {
    DeadZone(width=0.3, form="gap"): lambda e: e - np.clip(e, -0.3, 0.3),
    Saturation(limit=0.1, form="hard"): lambda u: np.clip(u, -0.1, 0.1),
    Saturation(limit=0.1, form="hard", at="command"): lambda c: np.clip(c, -0.1, 0.1),
    HardeningStiffness(stiffness=3.0): lambda u: u + 3 * u**3,
    SquareRoot(knee=0.5): lambda e: np.sign(e) * np.sqrt(0.5 * np.abs(e)),
}
OTHERS = {
    WrongDelay(extra=0.08): "delay",
    Intermittent(trigger="clock", hold_time=0.4, phase=0.0): "hold",
    TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.3, rate=0.5, time=41.0): "gains",
    Lapses(depth=0.9, shift=0.0, intervals=[(10, 12.0)]): "gains",
    AwakeByError(slope=0.2): "gains",
    RateLimit(limit=0.3): "loop",
    Stiction(breakaway=0.1, kinetic=0.3): "loop",
    Bias(level=0.1): "course",
    Feedforward(gain=0.5, delay=0.2, form="inverse"): "path",
    MotionFeedback(gain=0.05, delay=0.02, channel="motion", form="feedthrough"): "path",
    CrossAxis(gain=0.3, channel="e_y"): "path",
    HigherOrder(zero_frequency=3.0, zero_damping=0.3, pole_frequency=6.0, pole_damping=0.3): "gain",
}


def completed(effect):
    """An effect in which every number is given."""
    missing = {p.name: p.starts[0] for p in effect.parameters if getattr(effect, p.name) is None}
    return effect.with_choices(**missing)


@pytest.mark.parametrize(("effect", "formula"), MAPS.items(), ids=[e.name for e in MAPS])
def test_maps_are_what_apply_makes(effect, formula, baseline, runs):
    model = with_found(baseline, effect)
    display = EffectDisplay.from_estimator(model, effect.name, runs[0])
    assert display.curves.kind in ("map", "spring")
    (line,) = display.lines_.values()
    np.testing.assert_allclose(line.get_ydata(), formula(line.get_xdata()), atol=1e-9)
    ((low, high),) = [(c.low, c.high) for c in display.curves.curves.values()]
    assert np.all(low <= line.get_ydata() + 1e-12)
    assert np.all(line.get_ydata() <= high + 1e-12)
    measured = effect.place != "command"
    assert len(display.axes_) == 1 + measured  # with the density
    assert display.ax_.get_title().lower().startswith(title_of(effect.name))


@pytest.mark.parametrize(("effect", "kind"), OTHERS.items(), ids=[f"{e.name}" for e in OTHERS])
def test_effects_are_drawn_by_what_they_answer(effect, kind, baseline, runs):
    model = with_found(baseline, completed(effect), sd=0.05)
    display = EffectDisplay.from_estimator(model, X=runs[0])
    assert display.curves.kind == kind
    assert display.lines_
    for line in display.lines_.values():
        assert np.isfinite(line.get_ydata()).all()


def test_levels_are_steps(baseline, runs):
    model = with_found(baseline, completed(Quantised(step=0.1)))
    display = EffectDisplay.from_estimator(model, X=runs[0])
    assert display.curves.kind == "map"
    steps = np.diff(np.unique(display.lines_["with the effect"].get_ydata().round(9)))
    np.testing.assert_allclose(steps, 0.1)


def test_band_is_that_of_the_estimate(baseline, runs):
    """The curve of a dead zone moves by the width: 95 % within 1.96 standard deviations."""
    model = with_found(baseline, DeadZone(width=0.3, form="gap"), sd=0.1)
    display = EffectDisplay.from_estimator(model, X=runs[0])
    (curve,) = display.curves.curves.values()
    far = curve.x > 0.6
    # Percentiles of 300 draws are within 20 % (3 sigma) of these.
    np.testing.assert_allclose((curve.high - curve.low)[far], 2 * 1.96 * 0.03, rtol=0.2)


def test_draws_keep_to_the_bounds(baseline, runs):
    """A steepness known to 150 % is never negative, nor is half of its draws at the bound."""
    effect = completed(TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.3, rate=15.0, time=41.0))
    model = with_found(baseline, effect, sd=0.01)
    model.covariance_.loc["tv_gain__rate", "tv_gain__rate"] = 22.0**2
    display = EffectDisplay.from_estimator(model, X=runs[0])
    curve = next(iter(display.curves.curves.values()))
    early = curve.x < 30.0
    np.testing.assert_allclose(curve.low[early], 1.0, atol=0.02)


def test_density_is_that_of_the_runs(baseline, runs):
    X, y = runs
    model = with_found(baseline, DeadZone(width=0.3, form="gap"))
    display = EffectDisplay.from_estimator(model, "dead_zone", X)
    heights, edges, _ = display.axes_[1].patches[0].get_data()
    inside = X["e"][X["e"].abs() < edges[-1]]
    assert np.sum(heights * np.diff(edges)) == pytest.approx(1.0)
    expected, _ = np.histogram(inside, edges, density=True)
    np.testing.assert_allclose(heights, expected)
    model = with_found(baseline, Saturation(limit=0.1, form="hard"))
    display = EffectDisplay.from_estimator(model, X=X, y=y)
    np.testing.assert_array_equal(display.curves.measured, y)


def test_gains_over_time_and_channel(baseline, runs):
    model = with_found(baseline, GainDrift(rate=-0.005, reference=41.0))
    (line,) = EffectDisplay.from_estimator(model, X=runs[0]).lines_.values()
    np.testing.assert_allclose(line.get_ydata(), 1 - 0.005 * (line.get_xdata() - 41.0))
    model = with_found(baseline, ScheduledGain(slope=0.04, channel="speed", reference=20.0))
    display = EffectDisplay.from_estimator(model, X=runs[0])
    (line,) = display.lines_.values()
    np.testing.assert_allclose(line.get_ydata(), 1 + 0.04 * (line.get_xdata() - 20.0))
    assert display.axes_[-1].get_xlabel() == "speed, m/s"
    np.testing.assert_array_equal(
        line.get_xdata()[[0, -1]], [runs[0]["speed"].min(), runs[0]["speed"].max()]
    )


def test_changed_gains_have_their_values(baseline, runs):
    effect = completed(TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.3, rate=0.5, time=41.0))
    display = EffectDisplay.from_estimator(with_found(baseline, effect), X=runs[0])
    K_e = baseline.parameters_.loc["K_e", "value"]
    first, second = display.lines_
    assert first == f"K_e: {K_e:.3g} to {0.6 * K_e:.3g} deg/deg"
    assert second.startswith("K_edot: ")


def test_delay_starts_from_that_of_the_model(baseline, runs):
    model = with_found(baseline, WrongDelay(extra=0.08))
    display = EffectDisplay.from_estimator(model, X=runs[0])
    tau = baseline.parameters_.loc["tau_e", "value"]
    np.testing.assert_allclose(display.ax_.lines[0].get_ydata(), tau)
    np.testing.assert_allclose(display.lines_["delay"].get_ydata(), tau + 0.08)


def test_path_begins_after_its_delay(baseline, runs):
    effect = Disturbance(gain=0.1, delay=0.2, channel="dist")
    display = EffectDisplay.from_estimator(with_found(baseline, effect), X=runs[0])
    (line,) = display.lines_.values()
    t, u = line.get_data()
    assert np.abs(u[t < 0.19]).max() < 1e-3 * np.abs(u).max()
    # The neuromuscular system has a gain of one: the area is that of the path.
    assert np.sum(u) * baseline.dt_ == pytest.approx(-0.1, rel=0.03)
    assert display.ax_.get_ylabel() == "impulse response, deg/(V s)"
    ahead = Preview(gain=0.1, time=0.5, form="rate")
    display = EffectDisplay.from_estimator(with_found(baseline, ahead), X=runs[0])
    (line,) = display.lines_.values()
    t, u = line.get_data()
    assert t[np.abs(u).argmax()] < 0


def test_filters_have_their_gain(baseline, runs):
    model = with_found(baseline, ExtraLag(time=0.3))
    (line,) = EffectDisplay.from_estimator(model, X=runs[0]).lines_.values()
    omega, gain = line.get_data()
    np.testing.assert_allclose(gain, 1 / np.hypot(1, 0.3 * omega), rtol=0.02)


def test_loops_close_and_maps_do_not(baseline, runs):
    model = with_found(baseline, Backlash(gap=0.05))
    display = EffectDisplay.from_estimator(model, X=runs[0])
    (line,) = display.lines_.values()
    x, y = line.get_data()
    rising = np.diff(x, append=x[0]) > 0
    middle = np.abs(x) < 0.02
    np.testing.assert_allclose((x - y)[rising & middle], 0.05, atol=1e-9)
    np.testing.assert_allclose((x - y)[~rising & middle], -0.05, atol=1e-9)


def test_which_effect(baseline, runs):
    model = with_found(baseline, DeadZone(width=0.3, form="gap"))
    search = SimpleNamespace(best_estimator_=model)
    assert EffectDisplay.from_estimator(search).title == "Dead zone"
    with pytest.raises(ValueError, match="no effect 'bias'; it has dead_zone"):
        EffectDisplay.from_estimator(model, "bias")
    with pytest.raises(ValueError, match="no effects"):
        EffectDisplay.from_estimator(baseline)
    with pytest.raises(NotFittedError):
        EffectDisplay.from_estimator(OperatorRegressor())


def test_of_a_fitted_model(runs):
    """Numbers that come out of a fit, not out of this file."""
    X, y = runs
    bare = X[["e"]]
    bare.attrs["units"] = X.attrs["units"]
    model = OperatorRegressor(effects=Bias()).fit(bare, y + 0.1)
    display = EffectDisplay.from_estimator(model, "bias", bare)
    level = model.parameters_.loc["bias__level"]
    np.testing.assert_allclose(display.lines_["with the effect"].get_ydata(), level["value"])
    (curve,) = display.curves.curves.values()
    np.testing.assert_allclose(curve.low, level["low"], rtol=0.1)
    np.testing.assert_allclose(curve.high, level["high"], rtol=0.1)
    texts = [text.get_text() for text in display.figure_.findobj(Text)]
    assert any("level = " in text.replace("\xa0", " ") for text in texts)


def test_of_an_arx_model():
    """A Duffing oscillator: the steady command is (1 + a1 + a2) / b0 times y, and the cube."""
    rng = np.random.default_rng(0)
    v = np.convolve(rng.standard_normal(2000), np.ones(20), "same") / 3
    y, w = np.zeros((2, 2000))
    for k in range(2, 2000):
        y[k] = 1.6 * y[k - 1] - 0.7 * y[k - 2] + 0.1 * w[k - 1]
        w[k] = v[k] - 0.3 * y[k] ** 3
    y += 0.01 * rng.standard_normal(2000)
    index = pd.MultiIndex.from_product([[1], np.arange(2000) * 0.02], names=["run", "time"])
    X = pd.DataFrame({"v": v}, index)
    model = SimulatedARX(na=2, nb=1, nk=1, effects="hardening_stiffness").fit(
        X, pd.Series(y, index)
    )
    display = EffectDisplay.from_estimator(model, X=X)
    (line,) = display.lines_.values()
    at, command = line.get_data()
    np.testing.assert_allclose(command, at + 0.3 * at**3, atol=0.03 * np.abs(command).max())
    delayed = SimulatedARX(na=2, nb=1, nk=1, effects="wrong_delay").fit(X, pd.Series(y, index))
    assert "beside nk" in EffectDisplay.from_estimator(delayed).ax_.get_ylabel()


def test_friction_in_the_limb_is_a_force_over_the_rate(baseline):
    model = with_found(baseline, Friction(of="limb", form="coulomb", coulomb=0.02))
    display = EffectDisplay.from_estimator(model)
    rate, force = display.lines_["with the effect"].get_data()
    far = np.abs(rate) > 0.01
    np.testing.assert_allclose(force[far], 0.02 * np.sign(rate[far]))
    assert display.ax_.get_ylabel().startswith("force against the command")


def found_nothing():
    """A search that is fitted, and has no shape until a test gives it one."""
    search = EffectSearchCV(OperatorRegressor())
    search.best_estimator_, search.shape_, search.verdict_ = object(), None, "nothing found"
    return search


def test_curve_band_and_nearest_name_of_what_has_no_name():
    search = found_nothing()
    search.shape_ = a_shape()
    display = EffectDisplay.from_shape(search)
    curve = search.shape_.curve
    np.testing.assert_array_equal(display.lines_["curve"].get_xdata(), curve.index)
    np.testing.assert_array_equal(display.lines_["curve"].get_ydata(), curve["value"])
    (path,) = display.ax_.collections[0].get_paths()
    assert path.vertices[:, 1].min() == curve["low"].min()
    assert path.vertices[:, 1].max() == curve["high"].max()
    (nearest,) = [x for x in display.ax_.lines if x.get_label().startswith("nearest")]
    assert nearest.get_label() == "nearest name: cubic gain"
    np.testing.assert_array_equal(nearest.get_ydata(), search.shape_.nearest_curve)
    assert display.ax_.get_title() == (
        "It acts on the error, as a function of its size and sign\n+9.9 points of held-out VAF"
    )
    covers_nothing(display)


def test_a_name_that_is_far_is_not_drawn_and_a_factor_does_nothing_where_it_is_one():
    far = a_shape(nearest=a_shape().nearest.assign(distance=[0.75, 0.9]))
    labels = [line.get_label() for line in EffectDisplay.from_shape(far).ax_.lines]
    assert not any("nearest" in label for label in labels)
    factor = a_shape(effect=FreeGain(knots=(0.0, 1.0), values=(0.0, 0.0)))
    assert set(EffectDisplay.from_shape(factor).ax_.lines[0].get_ydata()) == {1.0}


def test_a_search_without_a_shape_is_refused():
    with pytest.raises(ValueError, match="no shape to draw: nothing found"):
        EffectDisplay.from_shape(found_nothing())
    with pytest.raises(TypeError, match="draws a fitted EffectSearchCV"):
        EffectDisplay.from_shape(OperatorRegressor())
