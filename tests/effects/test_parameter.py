"""Dimensions of numbers, their labels, and what bounds are in."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid import LinearElement
from skhoid.effects import CoreKind, Dimension, HardeningStiffness, Parameter, catalogue
from skhoid.effects.operator_signals import Command, Spring
from skhoid.effects.parameter import HZ, ONE, RAD, E, S, T, U
from skhoid.effects.registry import effect
from skhoid.testing import synthetic_record
from skhoid.testing.records import signal_at, split_parts

X = Dimension.of_channel("x")

LABELS = {
    ONE: "-",
    U: "{u}",
    S: "s",
    HZ: "Hz",
    ONE / S: "1/s",
    RAD / S: "rad/s",
    U / E: "{u}/{e}",
    U * S / E: "{u} s/{e}",
    U / S: "{u}/s",
    U / (E * S): "{u}/({e} s)",
    ONE / E**2: "1/{e}^2",
    E / U**3: "{e}/{u}^3",
    U * S / X: "{u} s/[x]",
    E / E: "-",
    X / X: "-",
}


@pytest.mark.parametrize(("dimension", "label"), LABELS.items(), ids=str)
def test_a_label_follows_from_exponents(dimension, label):
    assert dimension.label({"u": "{u}", "e": "{e}"}) == label


def test_units_of_the_data_are_put_in():
    units = {"u": "mm", "e": None, "[x]": "deg"}
    assert (U * S / E).label(units) == "mm s/[e]"
    assert (U / X).label(units) == "mm/deg"
    assert (U / X).label() == "[u]/[x]"


def test_dimensions_are_multiplied_divided_and_raised():
    assert Dimension(u=1, s=1, e=-1) == U * S / E
    assert (U / E) ** -2 == E**2 / U**2
    assert X**0 == ONE
    assert (RAD / S).seconds == HZ.seconds == -1
    assert len({U / E, Dimension(u=1, e=-1)}) == 1


@pytest.mark.parametrize("wrong", ["{u} s/{e}", None], ids=str)
def test_what_is_no_dimension_is_refused(wrong):
    with pytest.raises(TypeError, match=r"dimension of the parameter 'knee' .*Write Dimension\(u"):
        Parameter("knee", wrong)
    if wrong is not None:
        with pytest.raises(TypeError, match=r"scale of the parameter 'knee' must be a Dimension"):
            Parameter("knee", E, scale=wrong)


@pytest.mark.parametrize(("dimension", "scale"), [(U, E), (U / S, U * T), (ONE, T)])
def test_a_scale_that_does_not_fit_is_refused(dimension, scale):
    with pytest.raises(
        ValueError, match=r"scale of the parameter 'knee', .*does not fit its dimens"
    ):
        Parameter("knee", dimension, scale=scale)
    with pytest.raises(ValueError, match=r"must be in seconds, s; got durations of a run, T"):
        Parameter("knee", T)


def test_bounds_are_in_standard_deviations_of_what_the_dimension_names():
    record = synthetic_record()
    u, e = record.sd("u"), record.sd("e")
    sizes = {
        Parameter("a"): 1.0,
        Parameter("a", S): 1.0,
        Parameter("a", U * S / E): u / e,
        Parameter("a", ONE / U**2): 1 / u**2,
        Parameter("a", U / X): u / record.sd("x"),
        Parameter("a", U / X, scale=U / E): u / e,
        Parameter("a", U / E, scale=ONE): 1.0,
        Parameter("a", U / S, scale=U / T): u / record.duration,
        Parameter("a", S, scale=T): record.duration,
    }
    for parameter, size in sizes.items():
        assert parameter.find_scale(record) == pytest.approx(size, rel=1e-15)
        assert parameter.find_dimension(record, "path") == parameter.dimension


def test_on_an_arx_model_the_command_is_an_input_and_seconds_are_its_own():
    record = replace(synthetic_record(), core=CoreKind.ARX, time_unit=3.0)
    u, e = record.sd("u"), record.sd("e")
    gain = Parameter("a", U / (E * S))
    assert gain.find_dimension(record, "path") == ONE / S
    assert gain.find_scale(record, "path") == pytest.approx(1 / 3, rel=1e-15)
    assert gain.find_dimension(record, "sum") == U / (E * S)
    assert gain.find_scale(record, "sum") == pytest.approx(u / e / 3, rel=1e-15)
    assert Parameter("a", HZ).find_scale(record, "sum") == pytest.approx(1 / 3, rel=1e-15)
    assert Parameter("a", S, scale=T).find_scale(record, "sum") == record.duration
    for form, power in {"cubic": 3, "square": 2}.items():
        (stiffness,) = HardeningStiffness(form=form).parameters
        assert stiffness.find_dimension(record, "spring") == E / U**power
        assert stiffness.find_scale(record, "spring") == pytest.approx(e / u**power, rel=1e-14)
    assert Parameter("a").find_scale(record, "spring") == 1.0


@pytest.mark.parametrize("core", [CoreKind.OPERATOR, CoreKind.ARX])
def test_bounds_in_the_units_of_the_data_are_not_stretched(core):
    record = replace(synthetic_record(), core=core, time_unit=60.0)
    as_written = Parameter("time", S, 2.0, 90.0, (30.0,), scale=Dimension())
    assert as_written.find_scale(record, "command") == 1.0
    of_a_person = Parameter("time", S, 0.1, 1.5, (0.5,))
    assert of_a_person.find_scale(record, "command") == 60.0


FACTORS = {"u": 2.0, "e": 4.0, "x": 4.0, "f_t": 4.0, "motion_acc": 8.0, "dist": 16.0, "speed": 32.0}


def in_other_units(record):
    element = record.controlled_element
    K_c = element.numerator[0] * FACTORS["x"] / FACTORS["u"]
    return replace(
        record,
        y=FACTORS["u"] * record.y,
        prediction=FACTORS["u"] * record.prediction,
        channels={name: FACTORS[name] * values for name, values in record.channels.items()},
        controlled_element=LinearElement((K_c,), element.denominator),
        remembered={},
    )


def signal_in_other_units(signal, place):
    """What effects of a place get and return; powers of two change no digit."""
    u, e = FACTORS["u"], FACTORS["e"]
    if place in ("path", "command"):
        return Command(u * signal.position, u * signal.rate, e * signal.error, signal.delay)
    if place == "spring":
        return Spring(signal.cubic / u**2, signal.square / u)
    if place in ("delay", "gain"):
        return signal
    return signal * (e if place == "input" else u)


def same_force(found, expected, limb):
    """Forces and stops inside, of the output and its rate in other units."""
    u, e = FACTORS["u"], FACTORS["u" if limb else "e"]
    y, rate = np.linspace(-3, 3, 61), np.linspace(5, -5, 61)
    np.testing.assert_allclose(found.force(u * y, u * rate), e * expected.force(y, rate))
    np.testing.assert_allclose(np.clip(u * y, *found.stops), u * np.clip(y, *expected.stops))


@pytest.mark.parametrize("name", catalogue().index)
def test_dimensions_of_the_catalogue_are_right(name):
    """In other units, with numbers as their dimensions say, the answer is the same."""
    record = synthetic_record()
    other = in_other_units(record)
    pairs = zip(effect(name).variants(record), effect(name).variants(other), strict=True)
    for one, same in pairs:
        start = one.starts(record)[-1]
        values = {p.name: start[p.name] for p in one.free} | one.fixed
        changed = {}
        for p in one.parameters:
            powers = {"u": p.dimension.u, "e": p.dimension.e, **dict(p.dimension.channels)}
            changed[p.name] = values[p.name] * np.prod([FACTORS[n] ** k for n, k in powers.items()])
        signal = signal_at(one.place, record)
        if one.place == "inside":
            found, expected = (
                same.apply(signal, other, **changed),
                one.apply(signal, record, **values),
            )
            same_force(found, expected, getattr(one, "of", None) == "limb")
            continue
        expected = signal_in_other_units(one.apply(signal, record, **values), one.place)
        found = same.apply(signal_in_other_units(signal, one.place), other, **changed)
        for a, b in zip(split_parts(found).values(), split_parts(expected).values(), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
