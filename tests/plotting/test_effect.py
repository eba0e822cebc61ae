"""An identified effect is drawn as what its ``apply`` makes."""

import matplotlib as mpl

mpl.use("Agg")

import copy
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from sklearn.exceptions import NotFittedError

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import (
    AbsoluteValue,
    AsymmetricGain,
    Backlash,
    Bias,
    CrossAxis,
    CubicGain,
    DeadZone,
    Dimension,
    Disturbance,
    Drift,
    Effect,
    Effects,
    ExtraLag,
    ExtraLead,
    Feedforward,
    Friction,
    GainDrift,
    HardeningStiffness,
    HigherOrder,
    InputFilter,
    Intermittent,
    Lapses,
    MotionFeedback,
    NeuromuscularMode,
    OutputFeedback,
    Parameter,
    Preview,
    Quantised,
    RateLimit,
    RateReflex,
    Rectified,
    RootFlow,
    Saturation,
    ScheduledDynamics,
    ScheduledGain,
    SensorMagnitude,
    Stiction,
    Stops,
    TimeVaryingDelay,
    TimeVaryingGain,
    Tremor,
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
    AsymmetricGain(asymmetry=0.2): lambda e: e + 0.2 * np.abs(e),
    Rectified(leak=0.1, side="positive"): lambda e: np.where(e > 0, e, 0.1 * e),
    CubicGain(hardening=0.2, form="cubic"): lambda e: e + 0.2 * e**3,
    AbsoluteValue(gain=0.1): lambda e: 0.1 * np.abs(e),
    Saturation(limit=0.1, form="hard"): lambda u: np.clip(u, -0.1, 0.1),
    Saturation(limit=0.1, form="hard", at="error"): lambda e: np.clip(e, -0.1, 0.1),
    Saturation(limit=0.1, form="hard", at="command"): lambda c: np.clip(c, -0.1, 0.1),
    DeadZone(width=0.1, form="gap", at="output"): lambda u: u - np.clip(u, -0.1, 0.1),
    HardeningStiffness(stiffness=3.0): lambda u: u + 3 * u**3,
    SquareRoot(knee=0.5): lambda e: np.sign(e) * np.sqrt(0.5 * np.abs(e)),
}
OTHERS = {
    WrongDelay(extra=0.08): "delay",
    TimeVaryingDelay(change=0.1, rate=0.5, time=40.0): "delay",
    Intermittent(trigger="clock", hold_time=0.4, phase=0.0): "hold",
    Intermittent(trigger="event", hold_time=0.2, threshold=0.05): "hold",
    TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.3, rate=0.5, time=41.0): "gains",
    GainDrift(rate=-0.005, reference=41.0): "gains",
    Lapses(depth=0.9, shift=0.0, intervals=[(10, 12.0)]): "gains",
    Lapses(depth=0.9, shift=0.0, intervals=[(10, 12.0)], form="gain"): "gains",
    ScheduledGain(slope=0.04, channel="speed", reference=20.0): "gains",
    AwakeByError(slope=0.2): "gains",
    RateLimit(limit=0.3): "loop",
    Backlash(gap=0.05): "loop",
    Stiction(breakaway=0.1, kinetic=0.3): "loop",
    Bias(level=0.1): "course",
    Drift(rate=0.01, reference=41.0): "course",
    Tremor(frequency=9.0, amplitude=0.05): "course",
    Feedforward(gain=0.5, delay=0.2, form="inverse"): "path",
    Preview(gain=0.1, time=0.5, form="rate"): "path",
    OutputFeedback(gain=0.05, rate_gain=0.05, delay=0.2): "path",
    MotionFeedback(gain=0.05, delay=0.2, channel="motion", form="canal"): "path",
    MotionFeedback(gain=0.05, delay=0.02, channel="motion", form="feedthrough"): "path",
    Disturbance(gain=0.1, delay=0.2, channel="dist"): "path",
    CrossAxis(gain=0.3, channel="e_y"): "path",
    ExtraLag(time=0.3): "gain",
    ExtraLead(time=0.1): "gain",
    NeuromuscularMode(omega=20.0, zeta=0.2): "gain",
    HigherOrder(zero_frequency=3.0, zero_damping=0.3, pole_frequency=6.0, pole_damping=0.3): "gain",
}


def completed(effect):
    """An effect in which every number is given."""
    missing = {p.name: p.starts[0] for p in effect.parameters if getattr(effect, p.name) is None}
    return effect.with_choices(**missing)


@pytest.mark.parametrize("with_runs", [True, False])
@pytest.mark.parametrize(("effect", "formula"), MAPS.items(), ids=[e.name for e in MAPS])
def test_maps_are_what_apply_makes(effect, formula, with_runs, baseline, runs):
    model = with_found(baseline, effect)
    display = EffectDisplay.from_estimator(model, effect.name, runs[0] if with_runs else None)
    assert display.curves.kind in ("map", "spring")
    (line,) = display.lines_.values()
    np.testing.assert_allclose(line.get_ydata(), formula(line.get_xdata()), atol=1e-9)
    ((low, high),) = [(c.low, c.high) for c in display.curves.curves.values()]
    assert np.all(low <= line.get_ydata() + 1e-12)
    assert np.all(line.get_ydata() <= high + 1e-12)
    assert list(display.bands_) == list(display.lines_)
    measured = effect.place != "command"
    assert (display.density_ is not None) == (with_runs and measured)
    assert display.ax_.get_title().lower().startswith(title_of(effect.name))


@pytest.mark.parametrize(("effect", "kind"), OTHERS.items(), ids=[f"{e.name}" for e in OTHERS])
def test_effects_are_drawn_by_what_they_answer(effect, kind, baseline, runs):
    model = with_found(baseline, completed(effect), sd=0.05)
    display = EffectDisplay.from_estimator(model, X=runs[0], n_draws=20)
    assert display.curves.kind == kind
    assert set(display.bands_) == set(display.lines_) != set()
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
    display = EffectDisplay.from_estimator(model, X=runs[0], n_draws=4000)
    (curve,) = display.curves.curves.values()
    far = curve.x > 0.6
    # Percentiles of 4000 draws are within 5 % (3 sigma) of these.
    np.testing.assert_allclose((curve.high - curve.low)[far], 2 * 1.96 * 0.03, rtol=0.06)
    bare = EffectDisplay.from_estimator(model, X=runs[0], n_draws=0)
    assert bare.bands_ == {}


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
    heights, edges, _ = display.density_.get_data()
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
    np.testing.assert_allclose(display.without_.get_ydata(), tau)
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


IN_MACHINES = {
    Friction(coulomb=0.4, form="smooth", width=0.2, of="output"): (
        "spring",
        lambda x: 0.25 * x + 0.4 * np.tanh(x / 0.2),
    ),
    Friction(coulomb=0.4, form="smooth", width=0.2, of="rate", reference=1.0): (
        "spring",
        lambda x: 0.4 * np.tanh(x / 0.2),
    ),
    RootFlow(flow=0.5, form="zero", reference=1.0): (
        "spring",
        lambda x: 0.25 * x + 0.5 * np.sqrt(np.maximum(x, 0.0)),
    ),
    Stops(low=-0.2, high=0.3, form="both"): ("map", lambda x: np.clip(x, -0.2, 0.3)),
    SensorMagnitude(): ("map", np.abs),
    InputFilter(time=0.1, width=0.3, form="dead_zone"): ("loop", None),
    RateReflex(gain=0.3, delay=0.1, omega=12.0, zeta=1.0, side="positive"): ("path", None),
    ScheduledDynamics(slope=0.04, channel="speed", reference=20.0): (
        "gains",
        lambda speed: 1 + 0.04 * (speed - 20.0),
    ),
}


@pytest.fixture(scope="module")
def machine():
    rng = np.random.default_rng(0)
    index = pd.MultiIndex.from_product([[1], np.arange(600) * 0.02], names=["run", "time"])
    force = np.convolve(rng.standard_normal(600), np.ones(20), "same") / 3
    X = pd.DataFrame({"force": force, "speed": 20 + np.sin(np.arange(600) / 50)}, index)
    y = pd.Series(np.zeros(600), index, name="velocity")
    for k in range(1, 600):
        y.iloc[k] = 0.8 * y.iloc[k - 1] + 0.8 * force[k]
    X.attrs["units"], y.attrs["units"] = {"force": "N"}, {"velocity": "m/s"}
    return SimulatedARX(1, 1, inputs=["force"], effects=Bias(level=0.0)).fit(X, y), X
