"""A special case is named before the general form, unless what that has beyond it counts."""

from types import SimpleNamespace

import numpy as np
import pytest

from skhoid.effects.catalogue import BY_NAME, CLASSES
from skhoid.search.candidates import LEAST_DELTA_BIC, LEAST_GAIN, Candidate
from skhoid.search.in_loop import InLoop
from skhoid.search.special_cases import as_good, special_first


def candidate(name, weight, gain, within=(), in_loop=None):
    """A candidate that passes, of twice the weight in the free run."""
    effect = SimpleNamespace(name=name, neutral={}, within=within)
    n = 1 if within else 3
    one = Candidate(name, effect, delta_bic=weight, joint=weight / 2, gain=gain, n_parameters=n)
    one.in_loop = in_loop
    return one


def step_of(*candidates, judges=lambda one: True):
    return SimpleNamespace(
        candidates=list(candidates), best=candidates[0], judge=lambda one: judges(one)
    )


def names(step):
    return [c.id for c in step.candidates]


def special(weight=900.0, gain=4.9, **options):
    return candidate("gain_drift", weight, gain, within=("tv_gain",), **options)


def test_a_special_case_goes_first_where_it_is_as_good():
    step = step_of(candidate("tv_gain", 1000.0, 5.0), candidate("bias", 990.0, 5.0), special())
    special_first(step)
    assert names(step) == ["gain_drift", "tv_gain", "bias"]


def test_the_general_form_stays_where_what_it_has_beyond_would_count():
    general = candidate("tv_gain", 1000.0, 4.9 + 1.1 * LEAST_GAIN)
    step = step_of(general, special())
    special_first(step)
    assert names(step) == ["tv_gain", "gain_drift"]
    assert not as_good(special(1000.0 - 1.1 * LEAST_DELTA_BIC), general)
    assert as_good(special(1000.0 - 0.9 * LEAST_DELTA_BIC), general)


def test_one_of_as_many_parameters_is_as_good_by_likelihood_alone():
    general = candidate("friction", 1000.0, 5.0)
    play = candidate("backlash", 800.0, 5.0, within=("friction",))
    assert as_good(play, general)
    general.n_parameters = play.n_parameters
    assert not as_good(play, general)
    play.joint = general.joint - 0.9 * LEAST_DELTA_BIC
    assert as_good(play, general)


def test_one_that_does_not_pass_stays_behind():
    step = step_of(candidate("tv_gain", 1000.0, 5.0), special(), judges=lambda one: False)
    special_first(step)
    assert names(step) == ["tv_gain", "gain_drift"]
    step = step_of(candidate("tv_gain", 1000.0, 5.0), special(weight=1.0))
    special_first(step)
    assert names(step) == ["tv_gain", "gain_drift"]


@pytest.mark.parametrize(("gain", "expected"), [(0.02, True), (1.0, False)])
def test_of_linear_effects_the_loop_says_it(gain, expected):
    general = candidate("higher_order", 9000.0, 9.0, in_loop=InLoop(90.0 + gain, 500.0, 3 + gain))
    one = candidate("extra_lead", 4000.0, 5.0, ("higher_order",), InLoop(90.0, 400.0, 3.0))
    general.in_loop, one.in_loop = (
        InLoop(c.in_loop.vaf, c.in_loop.delta_bic, c.in_loop.gain, bends=False)
        for c in (general, one)
    )
    assert as_good(one, general) == expected


def test_containment_is_of_effects_that_there_are_and_has_no_rings():
    for kind in CLASSES:
        for general in kind.within:
            assert kind.name not in BY_NAME[general].within
    assert np.sum([bool(kind.within) for kind in CLASSES]) >= 5
