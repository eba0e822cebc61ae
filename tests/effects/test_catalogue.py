"""Effects: the catalogue keeps its own rules, compositions, grid search, errors."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from support.own_effect import Compressed

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs, run_labels
from skhoid import effects as module
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
    Integral,
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
    Stiction,
    Stops,
    TimeVaryingDelay,
    TimeVaryingGain,
    Tremor,
    WrongDelay,
    catalogue,
    effect,
)
from skhoid.effects.catalogue import CLASSES
from skhoid.testing import check_effect, synthetic_record

# The ids that tables, JSON and scripts rely on.
IDS = [
    *("wrong_delay", "tv_delay", "intermittent"),
    *("tv_gain", "gain_drift", "lapses", "scheduled_gain"),
    *("dead_zone", "asym_gain", "rectified", "cubic_gain", "absolute_value"),
    *("saturation", "rate_limit", "backlash", "stiction", "quantised", "hardening_stiffness"),
    *("bias", "drift", "integral"),
    *("feedforward", "preview", "output_feedback", "motion_feedback", "disturbance", "cross_axis"),
    *("extra_lag", "extra_lead", "nm_mode", "higher_order"),
    *("friction", "root_flow", "stops", "sensor_magnitude", "input_filter", "rate_reflex"),
    *("scheduled_dynamics", "tremor"),
]
# Values to simulate 3 x 24 s with; the error has a standard deviation of 1.
RECOVERED = [
    (WrongDelay(), {"extra": 0.07}),
    (TimeVaryingDelay(), {"change": 0.12, "rate": 1.0, "time": 12.0}),
    (Intermittent(trigger="clock"), {"hold_time": 0.35, "phase": 0.1}),
    (Intermittent(trigger="error"), {"hold_time": 0.1, "threshold": 0.5}),
    (Intermittent(trigger="error"), {"hold_time": 0.15, "threshold": 0.2}),
    (TimeVaryingGain(), {"K_e_change": 0.6, "K_edot_change": -0.5, "rate": 2.0, "time": 12.0}),
    (
        TimeVaryingGain(form="ramp"),
        {"K_e_change": 0.6, "K_edot_change": -0.5, "rate": 1.0, "time": 12.0},
    ),
    (GainDrift(), {"rate": 0.02}),
    (GainDrift(form="curved"), {"rate": 0.02, "curve": 0.15}),
    (Lapses(intervals=[(6.0, 8.0), (14.0, 16.0)]), {"depth": 0.8, "shift": 0.1}),
    (Lapses(intervals=[(6.0, 8.0), (14.0, 16.0)], form="gain"), {"depth": 0.8, "shift": 0.1}),
    (Lapses(intervals=[(6.0, 8.0), (14.0, 16.0)], form="hold"), {"depth": 0.8, "shift": 0.1}),
    (ScheduledGain(), {"slope": 0.3}),
    (DeadZone(form="gap"), {"width": 0.4}),
    (DeadZone(form="smooth"), {"width": 0.4}),
    (DeadZone(form="jump"), {"width": 0.4}),
    (AsymmetricGain(), {"asymmetry": 0.3}),
    (AsymmetricGain(form="large"), {"asymmetry": 0.4, "level": 0.5}),
    (Rectified(side="negative"), {"leak": 0.1}),
    (Rectified(side="negative", form="soft"), {"width": 0.3}),
    (CubicGain(form="cubic"), {"hardening": 0.2}),
    (CubicGain(form="cubic"), {"hardening": -0.04}),
    (CubicGain(form="square"), {"hardening": 0.2}),
    (CubicGain(form="power"), {"hardening": -0.3}),
    (AbsoluteValue(), {"gain": 0.2}),
    (AbsoluteValue(form="apart"), {"gain": 0.2, "later": 0.15}),
    (Saturation(form="hard"), {"limit": 0.8}),
    (Saturation(form="soft"), {"limit": 0.8}),
    (Saturation(form="behind"), {"limit": 0.8, "remnant": 0.3}),
    (RateLimit(), {"limit": 3.0}),
    (Backlash(), {"gap": 0.2}),
    (Stiction(), {"breakaway": 0.3, "kinetic": 0.3}),
    (Stiction(form="jump"), {"breakaway": 0.3, "kinetic": 0.3}),
    (Quantised(form="behind"), {"step": 1.0, "offset": 0.1, "remnant": 0.2}),
    (HardeningStiffness(), {"stiffness": 0.3}),
    (HardeningStiffness(form="square"), {"stiffness": 0.5}),
    (Bias(), {"level": 0.2}),
    (Drift(), {"rate": 0.03}),
    (Drift(form="settling"), {"rate": 0.1, "tau": 6.0, "level": 0.2}),
    (Integral(form="pure"), {"gain": 0.3}),
    (Integral(form="leaky"), {"gain": 0.3, "leak": 0.2}),
    (Feedforward(form="inverse"), {"gain": 0.5, "delay": 0.2}),
    (Feedforward(form="rate"), {"gain": 0.2, "delay": 0.2}),
    (Feedforward(form="gain"), {"gain": 0.5, "delay": 0.2}),
    (Preview(form="inverse"), {"gain": 0.4, "time": 0.3}),
    (Preview(form="spread"), {"gain": 0.4, "time": 0.4, "stretch": 0.5}),
    (Preview(form="rate"), {"gain": 0.2, "time": 0.4}),
    (OutputFeedback(), {"gain": 0.4, "rate_gain": 0.1, "delay": 0.25}),
    (MotionFeedback(form="direct"), {"gain": 0.3, "delay": 0.2}),
    (MotionFeedback(form="canal"), {"gain": 2.0, "delay": 0.2}),
    (MotionFeedback(form="feedthrough"), {"gain": 0.3, "delay": 0.02}),
    (Disturbance(), {"gain": 0.5, "delay": 0.3}),
    (CrossAxis(), {"gain": 0.4}),
    (CrossAxis(form="command"), {"gain": 0.1}),
    (ExtraLag(), {"time": 0.5}),
    (ExtraLead(), {"time": 0.1}),
    (Friction(), {"coulomb": 0.15}),
    (NeuromuscularMode(), {"omega": 15.0, "zeta": 0.2}),
    (
        HigherOrder(),
        {
            "zero_frequency": 2.0,
            "zero_damping": 0.3,
            "pole_frequency": 4.0,
            "pole_damping": 0.5,
        },
    ),
]
# In an ARX model; the speed of friction and the level of a tank are the output.
RECOVERED_INSIDE = [
    (Friction(form="coulomb", of="output"), {"coulomb": 0.4}),
    (Friction(form="smooth", of="output"), {"coulomb": 0.4, "width": 0.2}),
    (Friction(form="coulomb", of="rate", reference=1.0), {"coulomb": 0.3}),
    (RootFlow(form="zero", reference=1.0), {"flow": 0.5}),
    (Stops(form="both"), {"low": -0.6, "high": 0.9}),
    (Stops(form="high"), {"high": 0.5}),
    (InputFilter(form="dead_zone"), {"time": 0.3, "width": 0.4}),
    (InputFilter(form="cubic"), {"time": 0.3, "hardening": 0.3}),
    (InputFilter(form="clipped", order="second", omega=8.0, zeta=0.5), {"width": 0.8, "skew": 0.2}),
    (RateReflex(side="negative", sense=1), {"gain": 0.3, "delay": 0.1, "omega": 12.0, "zeta": 0.8}),
    (ScheduledDynamics(channel="speed"), {"slope": 0.3}),
]
# Where the search ends beside the best fit.
STUCK = [
    (Quantised(form="sharp"), {"step": 0.8, "offset": 0.1}),
    (Quantised(form="uneven"), {"step": 0.8, "power": 1.3}),
]


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        n_runs=2, duration=20.48, remnant_intensity=0.1, run_in=10.24, random_state=0
    )


def test_the_catalogue_has_the_ids_of_the_issue():
    assert [c.name for c in CLASSES] == IDS
    table = catalogue()
    assert list(table.index) == IDS
    assert table["source"].str.len().min() > 3
    assert set(table["class"]) == set(module.__all__) & {c.__name__ for c in CLASSES}
    assert len(table["class"]) == len(CLASSES)


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("core", ["operator", pytest.param("arx", marks=pytest.mark.slow)])
def test_every_effect_keeps_the_rules(name, core):
    if effect(name).refusal(synthetic_record(), core) is not None:
        pytest.skip(f"{name} does not apply to {core}")
    check_effect(effect(name), core=core)


def first_of_each_class(cases):
    """The further forms of a class are slow."""
    kinds = [type(one) for one, _ in cases]
    return [
        pytest.param(*case, marks=[pytest.mark.slow] * (kinds[i] in kinds[:i]))
        for i, case in enumerate(cases)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "values"), first_of_each_class(RECOVERED), ids=str)
def test_values_are_recovered(one, values):
    check_effect(one, recovers=values)


@pytest.mark.slow
@pytest.mark.parametrize(("one", "values"), first_of_each_class(RECOVERED_INSIDE), ids=str)
def test_values_in_an_arx_model_are_recovered(one, values):
    check_effect(one, core="arx", recovers=values)


@pytest.mark.xfail(reason="the search of non-smooth effects stops beside the minimum", strict=True)
@pytest.mark.parametrize(("one", "values"), first_of_each_class(STUCK), ids=str)
def test_values_of_steps_and_events_are_recovered(one, values):
    check_effect(one, recovers=values)


def test_each_variant_has_its_choices_made():
    record = synthetic_record(["heat"])
    forms = [v.form for v in DeadZone().variants(record)]
    assert forms == ["gap", "smooth", "jump"]
    assert [v.form for v in DeadZone(form="jump").variants(record)] == ["jump"]
    channels = {v.channel for v in CrossAxis().variants(record)}
    assert channels == {"speed", "heat"}
    assert {v.channel for v in Disturbance().variants(record)} == {"dist"}
    middle = Drift().variants(record)[0]
    assert middle.reference == pytest.approx(record.t.mean())
    assert Drift(reference=3.0).variants(record)[0].reference == 3.0


def test_what_is_given_is_not_estimated():
    one = Stiction(kinetic=0.2)
    assert one.fixed == {"kinetic": 0.2}
    assert [p.name for p in one.free] == ["breakaway"]
    assert TimeVaryingGain().fixed == {"omega_nm_change": 0.0, "zeta_nm_change": 0.0}


def test_starts_and_limits_are_in_units_of_the_data():
    record = synthetic_record()
    sd_u, sd_e = record.sd("u"), record.sd("e")
    assert DeadZone().limits(record)["width"] == (0.02 * sd_e, 3 * sd_e)
    low, high = Saturation(form="hard").limits(record)["limit"]
    assert (low, high) == pytest.approx((0.1 * sd_u, 4 * sd_u))
    assert AbsoluteValue().limits(record)["gain"][1] == pytest.approx(5 * sd_u / sd_e)
    starts = TimeVaryingDelay().starts(record)
    assert {s["time"] for s in starts} == {0.3 * record.duration, 0.7 * record.duration}


def test_maps_are_what_their_formulas_say():
    record, e = synthetic_record(), np.array([[-2.0, -0.5, -0.1, 0.0, 0.1, 0.5, 2.0]])
    gap = DeadZone(form="gap").apply(e, record, 0.3)
    np.testing.assert_allclose(gap, [[-1.7, -0.2, 0.0, 0.0, 0.0, 0.2, 1.7]], atol=1e-15)
    jump = DeadZone(form="jump").apply(e, record, 0.3)
    np.testing.assert_allclose(jump, [[-2.0, -0.5, 0.0, 0.0, 0.0, 0.5, 2.0]])
    smooth = DeadZone(form="smooth").apply(e, record, 0.3)
    np.testing.assert_allclose(smooth, e - 0.3 * np.tanh(e / 0.3))
    np.testing.assert_allclose(
        AsymmetricGain().apply(e, record, 0.2), e * np.where(e > 0, 1.2, 0.8)
    )
    leaking = Rectified(side="negative").apply(e, record, 0.1)
    np.testing.assert_allclose(leaking, np.where(e < 0, e, 0.1 * e))
    np.testing.assert_allclose(CubicGain(form="cubic").apply(e, record, 0.4), e + 0.4 * e**3)
    np.testing.assert_allclose(
        CubicGain(form="square").apply(e, record, 0.4), e + 0.4 * e * np.abs(e)
    )
    power = CubicGain(form="power", reference=0.5).apply(e, record, 0.4)
    np.testing.assert_allclose(power, np.sign(e) * 0.5 * (np.abs(e) / 0.5) ** 1.4, atol=1e-9)
    np.testing.assert_allclose(Saturation(form="hard").apply(e, record, 0.4), np.clip(e, -0.4, 0.4))
    np.testing.assert_allclose(
        Saturation(form="soft").apply(e, record, 0.4), 0.4 * np.tanh(e / 0.4)
    )
    np.testing.assert_allclose(
        Quantised(form="sharp").apply(e, record, 0.25, 0.0), 0.25 * np.round(e / 0.25)
    )


@pytest.mark.parametrize(
    ("behind", "hard", "values", "sd"),
    [
        (Saturation(form="behind"), Saturation(form="hard"), {"limit": 0.8}, 0.3),
        (Quantised(form="behind"), Quantised(form="sharp"), {"step": 0.5, "offset": 0.1}, 0.15),
    ],
    ids=["saturation", "quantised"],
)
def test_behind_is_the_mean_over_remnant(behind, hard, values, sd):
    record, u = synthetic_record(), np.linspace(-2, 2, 41)[:, None]
    # The mean over the remnant by its quantiles, midpoints of 20000 equal shares.
    from scipy.stats import norm

    remnant = sd * norm.ppf((np.arange(20000) + 0.5) / 20000)
    mean = hard.apply(u + remnant, record, **values).mean(axis=1, keepdims=True)
    share = sd / values.get("step", 1.0)  # a quantiser's remnant is in steps
    got = behind.apply(u, record, **values, remnant=share)
    np.testing.assert_allclose(got, mean, atol=2e-3)


def test_extra_lag_is_a_lag_and_a_second_lead_undoes_it():
    record = synthetic_record()
    given = ExtraLead().apply(_command(record), record, time=0.3)
    back = ExtraLag().apply(given, record, time=0.3)
    plain = _command(record)

    def whole(command):
        return command.position + np.gradient(command.rate, record.dt, axis=0)

    error = whole(back) - whole(plain)
    assert np.std(error) < 0.02 * np.std(whole(plain))


def _command(record):
    from skhoid.effects.operator_signals import Command

    e = record.input
    return Command(0.8 * e, 0.0 * e, e, 0.2)


def test_a_sum_is_flat_and_named():
    both = DeadZone(width=0.3) + Bias()
    more = both + (Backlash() + DeadZone())
    assert isinstance(more, Effects)
    assert more.names == ["dead_zone", "bias", "backlash", "dead_zone-2"]
    assert both.names == ["dead_zone", "bias"], "the parts stay what they were"
    assert (Bias() + "dead_zone").names == ["bias", "dead_zone"]
    assert (Effects.of(None) + Bias()).names == ["bias"]
    assert Effects.of([both, "bias", Bias()]).names == ["dead_zone", "bias", "bias-2", "bias-3"]
    assert len(Effects.of(None)) == 0
    assert [name for name, _ in more] == more.names


def test_with_effect_stores_a_composition_and_leaves_the_model(runs):
    model = OperatorRegressor()
    once = model.with_effect(DeadZone())
    twice = once.with_effect("dead_zone").with_effect(Bias() + Backlash())
    assert model.effects is None
    assert isinstance(once.effects, Effects)
    assert twice.effects.names == ["dead_zone", "dead_zone-2", "bias", "backlash"]
    assert not hasattr(once, "parameters_")
    fitted = OperatorRegressor().fit(*runs).with_effect("bias")
    assert not hasattr(fitted, "parameters_"), "a new model is not fitted"


def test_parameters_of_effects_are_those_of_the_model():
    model = OperatorRegressor(effects=DeadZone(width=0.3) + Bias() + DeadZone())
    params = model.get_params()
    assert params["effects__dead_zone__width"] == 0.3
    assert params["effects__dead_zone-2__width"] is None
    model.set_params(effects__dead_zone__width=0.5, effects__bias=Bias(level=1.0))
    assert dict(model.effects.steps)["dead_zone"].width == 0.5
    assert dict(model.effects.steps)["bias"].level == 1.0
    copied = clone(model)
    assert copied.get_params()["effects__dead_zone__width"] == 0.5
    copied.set_params(effects__dead_zone__width=9.0)
    assert model.get_params()["effects__dead_zone__width"] == 0.5
    stored = pickle.loads(pickle.dumps(model))
    assert stored.get_params()["effects__bias__level"] == 1.0


@pytest.mark.parametrize("n_jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_grid_search_over_a_parameter_of_an_effect(runs, n_jobs):
    X, y = runs
    y = y + 0.05
    search = GridSearchCV(
        OperatorRegressor(effects=Bias() + DeadZone(form="gap")),
        {"effects__bias__level": [0.0, 0.05, 0.1], "effects__dead_zone__width": [0.05]},
        cv=LeaveOneGroupOut(),
        n_jobs=n_jobs,
    ).fit(X, y, groups=run_labels(X))
    assert search.best_params_["effects__bias__level"] == 0.05
    assert search.best_estimator_.parameters_.loc["bias__level", "value"] == 0.05


def test_an_own_effect_keeps_the_rules_and_is_recovered():
    check_effect(Compressed(), recovers={"knee": 0.7})
    check_effect(Compressed(), core="arx")


def test_choices_that_are_open_are_all_tried():
    class Chosen(Compressed):
        choices = {"form": ("soft", "hard"), "side": ("left", "right")}

        def __init__(self, *, knee=None, form=None, side=None):
            self.knee, self.form, self.side = knee, form, side

    record = synthetic_record()
    check_effect(Chosen())
    made = [(v.form, v.side) for v in Chosen().variants(record)]
    assert made == [("soft", "left"), ("soft", "right"), ("hard", "left"), ("hard", "right")]
    assert [v.side for v in Chosen(form="hard").variants(record)] == ["left", "right"]


def test_derived_numbers_have_dimensions(runs):
    class WithSquare(Compressed):
        unit: object = Dimension(e=2)

        def derived(self, values):
            return {"square": (values["knee"] ** 2, self.unit, "of the knee")}

    class WithLabel(WithSquare):
        unit = "deg^2"

    table = OperatorRegressor(effects=WithSquare()).fit(*runs).parameters_
    assert table.loc["compressed__square", "unit"] == "deg^2"
    with pytest.raises(TypeError, match=r"WithLabel.derived, square: the dimension must be a Dim"):
        OperatorRegressor(effects=WithLabel()).fit(*runs)


def test_a_class_defined_on_the_spot_passes_too():
    class Halved(Compressed):
        name = "halved"

    check_effect(Halved())


def broken(**changes):
    return type("Broken", (Compressed,), changes)


def _init_with_default(self, *, knee=1.0):
    self.knee = 2 * knee if knee else knee


def _adds_in_place(self, signal, record, knee):
    signal += knee
    return signal


def _moves_a_channel(self, signal, record, knee):
    record.channels["e"][0] += 1.0
    return signal


def _random(self, signal, record, knee):
    return signal + np.random.default_rng().standard_normal(signal.shape)


def _remembers(self, signal, record, knee):
    self.last = knee
    return signal


def _by_row(self, signal, record, knee):
    return signal * np.arange(len(signal))[:, None]


def _mixes_runs(self, signal, record, knee):
    return np.cumsum(signal, axis=1)


BROKEN = [
    ({"name": "two words"}, "name must be a word"),
    ({"place": "elsewhere"}, "place must be one of"),
    ({"physics": ""}, "physics is empty"),
    ({"formula": " "}, "formula is empty"),
    ({"parameters": Compressed.parameters[0]}, "must be a tuple"),
    ({"parameters": (Parameter("knee"),)}, "has no meaning"),
    ({"parameters": (Parameter("knee", low=2, high=1, meaning="m"),)}, "low < high"),
    ({"parameters": (Parameter("knee", starts=(-1.0,), low=0, meaning="m"),)}, "needs starts"),
    ({"parameters": (Parameter("other", meaning="m"),)}, "must take other as a keyword"),
    ({"parameters": Compressed.parameters * 2}, "the same name twice"),
    ({"__init__": _init_with_default}, "must only store"),
    ({"apply": lambda self, signal, record: signal}, "apply fails at knee"),
    ({"apply": lambda self, signal, record, knee: signal[:-1]}, "must give shape"),
    ({"apply": lambda self, signal, record, knee: np.log(-abs(signal))}, "not finite"),
    ({"apply": _adds_in_place}, "changes the signal"),
    ({"apply": _moves_a_channel}, "changes a channel"),
    ({"apply": _random}, "a different result the second time"),
    ({"apply": _remembers}, "changes the effect itself"),
    ({"apply": _by_row}, "Take time from record.t"),
    ({"apply": _mixes_runs}, "does not treat runs alike"),
    ({"neutral": {"knee": 1.0}}, "at its neutral values"),
    ({"neutral": {"elbow": 1.0}}, "which are not parameters"),
    ({"place": "path"}, "must return Command"),
    ({"place": "gain"}, "must return Gains"),
    ({"variants": lambda self, record: []}, "variants must return a list"),
    ({"choices": {"form": ("soft", "hard")}}, "choices must map arguments"),
    ({"choices": {"knee": "soft"}}, "choices must map arguments"),
    ({"starts": lambda self, record: [{"knee": 99.0}]}, "not within its limits"),
    ({"starts": lambda self, record: [{}]}, "must give each parameter"),
    ({"limits": lambda self, record: {}}, "limits must name each parameter"),
    ({"refusal": lambda self, record, core: "no reason"}, "does not apply to the runs"),
]


@pytest.mark.parametrize(("changes", "message"), BROKEN, ids=[m for _, m in BROKEN])
def test_what_is_broken_is_told(changes, message):
    # A signal of another kind than the effect expects fails in NumPy before it is reported.
    if changes.get("place") in ("path", "gain"):
        changes = {**changes, "apply": lambda self, signal, record, knee: record.input}
    with pytest.raises(AssertionError, match=message):
        check_effect(broken(**changes)())


def test_a_wrong_value_is_told():
    with pytest.raises(AssertionError, match=r"simulated as .* and estimated as"):
        # The clip keeps the estimate from where the simulation was.
        check_effect(
            broken(limits=lambda self, record: {"knee": (0.1, 1.5)})(), recovers={"knee": 3.0}
        )
    with pytest.raises(AssertionError, match="recovers must give a value for each"):
        check_effect(Compressed(), recovers={"elbow": 3.0})


def test_no_instance_no_core():
    with pytest.raises(AssertionError, match="pass an instance, not the class"):
        check_effect(Compressed)
    with pytest.raises(ValueError, match="core must be"):
        check_effect(Compressed(), core="muscle")


def test_other_channels_are_named():
    with pytest.raises(AssertionError, match=r"no channel 'heat'.*channels="):
        check_effect(CrossAxis(channel="heat"))
    check_effect(CrossAxis(channel="heat"), channels=["heat"])


@pytest.mark.parametrize("wrong", [DeadZone, "dead zone", 3, [DeadZone(), None, 4]])
def test_what_is_no_effect_is_refused(runs, wrong):
    with pytest.raises((TypeError, ValueError)):
        OperatorRegressor(effects=wrong).fit(*runs)


def test_errors_say_what_to_do(runs):
    with pytest.raises(ValueError, match=r"No effect is called 'dead zone'.*dead_zone"):
        effect("dead zone")
    with pytest.raises(TypeError, match=r"Pass an instance, DeadZone\(\), not the class"):
        OperatorRegressor().with_effect(DeadZone)
    with pytest.raises(ValueError, match=r"place must be one of input, delay.*elsewhere"):
        OperatorRegressor().with_effect(broken(place="elsewhere")())
    with pytest.raises(TypeError, match="An effect must be an instance"):
        Effects.of([3])
    with pytest.raises(NotImplementedError, match="must implement apply"):
        Effect().apply(0.0, None)


@pytest.mark.parametrize(
    ("one", "reason"),
    [
        ("wrong_delay", "already estimates its delay"),
        ("feedforward", "no target"),
        ("preview", "no target"),
        ("output_feedback", "no column of role x"),
        ("motion_feedback", "no column of role motion"),
        ("disturbance", "no column of role dist"),
        ("scheduled_gain", "no a channel|no channel"),
        (CrossAxis(channel="e_y"), "no channel 'e_y'"),
    ],
    ids=str,
)
def test_an_effect_that_does_not_apply_says_why(runs, one, reason):
    with pytest.raises(ValueError, match=f"does not apply: .*{reason}"):
        OperatorRegressor(effects=one).fit(*runs)


def test_an_effect_that_does_not_apply_is_listed_with_its_reason(runs):
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "disturbance"]).fit(*runs)
    row = search.ranking_.set_index("effect").loc["disturbance"]
    assert row["status"] == "does not apply"
    assert "role dist" in row["reason"]


def test_the_index_of_parameters_is_flat_and_named(runs):
    X, y = runs
    model = OperatorRegressor(effects=Bias() + Bias(level=0.1) + Tremor(frequency=9.0)).fit(X, y)
    names = list(model.parameters_.index)
    assert {"bias__level", "bias-2__level", "tremor__amplitude", "tremor__frequency"} <= set(names)
    assert isinstance(model.parameters_, pd.DataFrame)
    assert model.parameters_.loc["bias-2__level", "value"] == 0.1
    assert "given" in model.parameters_.loc["bias-2__level", "meaning"]
    assert model.effects_.names == ["bias", "bias-2", "tremor"]
