"""Why candidates of a step are not part of what was found."""

from types import SimpleNamespace

import numpy as np
import pytest

from skhoid.effects import Feedforward
from skhoid.search.candidates import Candidate
from skhoid.search.forward import CLAIM, LEAST_GAIN_OF_CLAIM
from skhoid.search.in_loop import InLoop
from skhoid.search.results import against_candidate, refuted
from skhoid.search.statuses import Against, Reason

GOOD = {"delta_bic": 100.0, "gain": 2.0, "prediction": np.zeros(1)}


def reason(winner="bias", taken_out=False, name="preview", **options):
    candidate = Candidate(name, SimpleNamespace(name=name), **{**GOOD, **options})
    return against_candidate(candidate, winner, taken_out=taken_out).text


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"inapplicable": "X has no target"}, "X has no target"),
        ({"refused": Against(Reason.AT_BOUND, "time at the bound")}, "time at the bound"),
        ({"delta_bic": 3.2}, "ΔBIC 3.2, needs more than 25"),
        ({"gain": 0.15}, "+0.15 points on held-out rows, needs at least 0.2"),
        (
            {"gain": 0.15, "prediction": None},
            "+0.15 points on the rows of the fit, needs at least 0.2",
        ),
        (
            {"delta_bic": -8.0, "gain": -0.02},
            "ΔBIC -8.0, needs more than 25; -0.02 points on held-out rows, needs at least 0.2",
        ),
        ({"trace": "levels", "gain": -0.3}, "-0.3 points on held-out rows, needs at least 0.2"),
        (
            {"in_loop": InLoop(80.0, 5.0, -0.4)},
            "in the closed loop it is no better (-0.40 points, ΔBIC 5): it may follow the "
            "remnant that returns in the error",
        ),
        (
            {"joint": 8.0, "in_loop": InLoop(80.0, 5.0, 1.1)},
            "estimated together with a noise model, it has ΔBIC 8; in the closed loop it "
            "is hardly better (+1.10 points, ΔBIC 5): it may follow the remnant that returns "
            "in the error",
        ),
        (
            {"joint": -8.0, "in_loop": InLoop()},
            "estimated together with a noise model, it has ΔBIC -8: it may follow the "
            "remnant that returns in the error",
        ),
        (
            {"joint": 90.0, "in_loop": InLoop(-np.inf, -np.inf, -np.inf)},
            "the closed loop does not settle with it",
        ),
        ({}, "it improves the free run too; bias was added instead"),
        ({"winner": ""}, "it pays, but max_effects was reached"),
        ({"taken_out": True}, "it no longer pays once the later effects are added"),
    ],
)
def test_the_reason_says_which_criterion_is_not_met(options, said):
    assert reason(**options) == said


def test_a_claim_that_gains_too_little_says_what_it_must_gain():
    """A given delay is not called wrong for less than 0.6 points."""
    said = reason(name=CLAIM, gain=0.4, least_gain=LEAST_GAIN_OF_CLAIM)
    assert said == "+0.4 points on held-out rows, needs at least 0.6"


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        (np.nan, "neither a likelihood nor the closed loop confirms it: it may follow"),
        (30.0, "the loop is not known with it, and it has ΔBIC 30: it may follow"),
    ],
)
def test_what_the_loop_is_not_known_of_is_told(joint, said):
    one = Candidate("feedforward", Feedforward(), delta_bic=100.0, gain=1.0, joint=joint)
    one.in_loop = InLoop(bends=False)
    assert one.refuted
    assert refuted(one).startswith(said)
