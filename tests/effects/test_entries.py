"""What follows from an entry; compositions; effects of a user's own, and the checks of them."""

import inspect
import pickle

import numpy as np
import pytest
from sklearn.base import clone
from support.own_effect import Compressed

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import (
    Argument,
    Backlash,
    Bias,
    CrossAxis,
    DeadZone,
    Dimension,
    Disturbance,
    Drift,
    Effect,
    Effects,
    Parameter,
    Stiction,
    TimeVaryingGain,
    effect,
)
from skhoid.testing import check_effect, synthetic_record


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        n_runs=2, duration=20.48, remnant_intensity=0.1, run_in=10.24, random_state=0
    )


class Bent(Effect):
    """Errors are bent, one way or the other."""

    name = "bent"
    place = "input"
    physics = "Errors are bent."
    formula = "e + size e |e|"
    source = "Nobody (2026)"
    parameters = (
        Parameter("size", Dimension(e=-1), -0.1, 0.1, (0.05,), "of the bend", forms=("up",)),
        Parameter("fall", Dimension(e=-1), -0.1, 0.1, (-0.05,), "of the fall", forms=("down",)),
    )
    choices = {"form": ("up", "down")}
    arguments = {"level": Argument("Added to the error.", kind="float", default=0.0)}
    examples = ({"form": "up", "size": 0.1},)

    def apply(self, signal, record, size=0.0, fall=0.0):
        return signal + (size + fall) * signal * np.abs(signal) + self.level


def test_arguments_and_docstring_follow_from_the_entry():
    assert str(inspect.signature(Bent)) == "(*, size=None, fall=None, level=0.0, form=None)"
    one = Bent(size=0.1, level=0.2)
    assert repr(one) == "Bent(level=0.2, size=0.1)"
    assert repr(clone(one)) == repr(pickle.loads(pickle.dumps(one))) == repr(one)
    assert [p.name for p in one.parameters] == ["size"]
    assert [p.name for p in Bent(form="down").free] == ["fall"]
    for told in (
        'Of the bend, in 1/[e] ("up"); None estimates it.',
        "level : float, default=0.0\n    Added to the error.",
        "References\n----------\nNobody (2026).",
    ):
        assert told in Bent.__doc__
    check_effect(Bent())
    with pytest.raises(
        TypeError, match="Bent has no argument sise; it takes size, fall, level, form"
    ):
        Bent(sise=0.1)


def test_each_variant_has_its_choices_made():
    record = synthetic_record(["heat"])
    assert [v.form for v in DeadZone().variants(record)] == ["gap", "smooth", "jump"]
    assert [v.form for v in DeadZone(form="jump").variants(record)] == ["jump"]
    assert {v.channel for v in CrossAxis().variants(record)} == {"speed", "heat"}
    assert {v.channel for v in Disturbance().variants(record)} == {"dist"}
    assert Drift().variants(record)[0].reference == pytest.approx(record.t.mean())
    assert Drift(reference=3.0).variants(record)[0].reference == 3.0


def test_what_is_given_is_not_estimated():
    one = Stiction(kinetic=0.2)
    assert one.fixed == {"kinetic": 0.2}
    assert [p.name for p in one.free] == ["breakaway"]
    assert TimeVaryingGain().fixed == {"omega_nm_change": 0.0, "zeta_nm_change": 0.0}


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


def test_an_own_effect_keeps_the_rules_and_is_recovered():
    check_effect(Compressed(), recovers={"knee": 0.7})
    check_effect(Compressed(), core="arx")


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


def broken(**changes):
    return type("Broken", (Compressed,), changes)


def _init_with_default(self, *, knee=1.0):
    self.knee = 2 * knee if knee else knee


def _adds_in_place(self, signal, record, knee):
    signal += knee
    return signal


def _random(self, signal, record, knee):
    return signal + np.random.default_rng().standard_normal(signal.shape)


def _by_row(self, signal, record, knee):
    return signal * np.arange(len(signal))[:, None]


def _mixes_runs(self, signal, record, knee):
    return np.cumsum(signal, axis=1)


BROKEN = [
    ({"name": "two words"}, "name must be a word"),
    ({"physics": ""}, "physics is empty"),
    ({"parameters": Compressed.parameters[0]}, "must be a tuple"),
    ({"__init__": _init_with_default}, "must only store"),
    ({"apply": lambda self, signal, record: signal}, "apply fails at knee"),
    ({"apply": lambda self, signal, record, knee: signal[:-1]}, "must give shape"),
    ({"apply": _adds_in_place}, "changes the signal"),
    ({"apply": _random}, "a different result the second time"),
    ({"apply": _by_row}, "Take time from record.t"),
    ({"apply": _mixes_runs}, "does not treat runs alike"),
    ({"neutral": {"knee": 1.0}}, "at its neutral values"),
    ({"place": "path"}, "must return Command"),
    ({"starts": lambda self, record: [{"knee": 99.0}]}, "not within its limits"),
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
        ("output_feedback", "no column of role x"),
        ("disturbance", "no column of role dist"),
        (CrossAxis(channel="e_y"), "no channel 'e_y'"),
    ],
    ids=str,
)
def test_an_effect_that_does_not_apply_says_why(runs, one, reason):
    with pytest.raises(ValueError, match=f"does not apply: .*{reason}"):
        OperatorRegressor(effects=one).fit(*runs)
