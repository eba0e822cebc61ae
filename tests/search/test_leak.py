"""The leak test of models of a search."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.hidden_disturbance import tracked

from skhoid.effects import Disturbance, Effects
from skhoid.search.judges import InLoop, leak_of
from skhoid.search.judging import Candidate
from skhoid.search.steps import SearchStep


@pytest.fixture(scope="module")
def record():
    return replace(tracked("1/(s(s+1))", runs=3, disturbance=2.5), controlled_element=None)


def model_of(record, output, effects=()):
    effects = Effects(list(effects))
    return SimpleNamespace(
        simulator=SimpleNamespace(record=record, effects=effects), effects=effects, output=output
    )


def without(record, *names):
    channels = {n: v for n, v in record.channels.items() if n not in names}
    return replace(record, channels=channels, roles={n: n for n in channels}, _derived={})


def rebuilt(record):
    return record.y + record.channels["dist"]  # what the element's inverse gives of x


@pytest.mark.parametrize("hidden", [True, False])
def test_output_rebuilt_from_x_leaks(record, hidden):
    known = without(record, "dist") if hidden else record
    found = leak_of(model_of(known, rebuilt(record)))
    assert found.leaks
    assert "unseen disturbance" in found.reason


def test_x_that_follows_from_target_and_error_leaks_too(record):
    assert leak_of(model_of(without(record, "x", "dist"), rebuilt(record))).leaks


def test_the_output_itself_less_noise_does_not(record):
    found = leak_of(model_of(record, 0.9 * record.y))
    assert not found.leaks


def test_a_model_that_is_told_the_disturbance_may_hold_it(record):
    told = [("disturbance", Disturbance(channel="dist"))]
    assert not leak_of(model_of(record, rebuilt(record), told)).leaks


def test_there_is_none_without_x_or_where_nobody_steers(record):
    assert leak_of(model_of(without(record, "x", "f_t"), record.y)) is None
    assert leak_of(model_of(replace(record, y=None), record.y)) is None
    other = replace(record, inputs=("f_t",), _derived={})
    assert leak_of(model_of(other, record.y)) is None


def test_outputs_that_are_not_finite_raise_no_warning(record):
    found = leak_of(model_of(record, np.full_like(record.y, np.nan)))
    assert not found.leaks


@pytest.mark.parametrize("of_parent", [0.0, 0.5])
def test_a_candidate_is_refused_for_what_leaks_beside_its_parent(record, of_parent):
    """An element that was estimated badly makes the parent leak as well."""
    disturbance = record.channels["dist"]
    hidden = without(record, "dist")
    parent = model_of(hidden, 0.9 * record.y + of_parent * disturbance)
    more = model_of(hidden, 0.95 * record.y + 0.6 * disturbance)
    assert leak_of(more).leaks
    assert bool(leak_of(parent).leaks) == (of_parent > 0)
    effect = SimpleNamespace(name="saturation", neutral={})
    candidate = Candidate("saturation", effect, delta_bic=90.0, gain=2.0)
    candidate.model, candidate.in_loop = more, InLoop()
    vafs = {id(parent): 80.0, id(more): 81.0}
    step = SearchStep(
        parent, parent, 80.0, record.y, [candidate], None, lambda model: vafs[id(model)]
    )
    assert step.judge(candidate) == (of_parent > 0)
    assert (candidate.refused is not None) == (of_parent == 0)
