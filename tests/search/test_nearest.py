"""Tests of the effects of the catalogue whose curves are nearest to that of a shape."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from skhoid.effects import (
    Backlash,
    CoreKind,
    DeadZone,
    Effect,
    FreeDelay,
    FreeGain,
    FreeHysteresis,
    FreeMap,
    Friction,
    GainDrift,
    HardeningStiffness,
    Saturation,
    TimeVaryingDelay,
)
from skhoid.effects.free_form import SmoothCurve
from skhoid.search.likeness import find_departure, nearest_effects, nearest_table, recordings_for
from skhoid.testing import synthetic_record

DIVIDED = ("gain", "input", "output", "command", "spring")
UNITS = {"u": "deg", "e": "mm"}


def shape(form, effect, record, *, n_knots=61, half=0.05):
    """A free form whose curve is that of an effect, as a model shows it, and its band."""
    form = form.variants(record)[0]
    ends = form.knots[0], form.knots[-1]
    knots = np.linspace(*ends, n_knots)
    form = form.with_choices(knots=tuple(knots.tolist()), values=(0.0,) * n_knots)
    delta = find_departure(form, effect, effect.fixed, record)(knots)
    if isinstance(form.curve, SmoothCurve):
        for degree in (0, 1):  # what the model refits, as a fit would find it
            if degree not in form.kept:
                unit = knots**degree
                part = np.polynomial.polynomial.polyfit(knots, delta, degree)[degree]
                divides = degree == (0 if form.place == "gain" else 1) and form.place in DIVIDED
                divides = divides and form.over != "du/dt"
                delta = (delta - part * unit) / (1 + part * divides)
    values = delta + form.at_rest
    band = half * np.abs(delta).max()
    curve = pd.DataFrame({"value": values, "low": values - band, "high": values + band}, knots)
    return form.with_choices(values=tuple(delta.tolist())), curve


@pytest.fixture(scope="module")
def operator():
    return synthetic_record()


CASES = [
    (FreeMap(at="error"), DeadZone(form="gap", width=0.5), "width = 0.5"),
    (FreeMap(at="output"), Saturation(form="soft", limit=0.6, at="output"), "limit = 0.6"),
    (FreeMap(at="spring"), HardeningStiffness(form="cubic", stiffness=0.1), "stiffness"),
    (FreeHysteresis(at="output"), Backlash(gap=0.2), "gap = 0.2"),
    (FreeGain(), GainDrift(rate=0.03, reference=12.0), "rate"),
    (FreeDelay(), TimeVaryingDelay(change=0.1, rate=1.0, time=12.0), "change = 0.1"),
]


@pytest.mark.parametrize(("form", "effect", "numbers"), CASES, ids=lambda case: str(case)[:24])
def test_a_named_effect_is_nearest_to_its_own_curve(form, effect, numbers, operator):
    found = nearest_effects(*shape(form, effect, operator), operator, UNITS)
    first = found[0]
    assert first.name == effect.name
    assert first.distance < 0.02
    assert first.within_band
    assert numbers in first.parameters


def test_friction_of_a_machine(operator):
    y = 0.1 * operator.channels["x"]
    machine = replace(operator, core=CoreKind.ARX, domain="machine", y=y, remembered={})
    truth = Friction(form="smooth", of="rate", coulomb=0.4, width=0.04)
    found = nearest_effects(*shape(FreeMap(at="rate"), truth, machine, n_knots=201), machine, UNITS)
    assert found[0].name == "friction"
    assert found[0].distance < 0.02


def test_recordings_say_what_separates_the_nearest_two(operator):
    form, curve = shape(FreeMap(), DeadZone(form="gap", width=0.5), operator, half=3.0)
    found = nearest_effects(form, curve, operator, UNITS)
    told = recordings_for(form, curve, found, "mm")
    assert found[1].within_band
    assert told[-1].startswith(f"To tell dead zone from {nearest_table(found)['title'].iloc[1]}, ")


def test_a_curve_is_compared_whatever_the_gain(operator):
    """What the model refits, a gain and nothing else, does not count as a difference."""

    class Louder(Effect):
        name = "louder"
        place = "input"

        def apply(self, signal, record):
            return 3.0 * DeadZone(form="gap", width=0.5).apply(signal, record, width=0.5)

    form, curve = shape(FreeMap(), Louder(), operator)
    first = nearest_effects(form, curve, operator, UNITS)[0]
    assert first.name == "dead_zone"
    assert first.distance < 0.02
