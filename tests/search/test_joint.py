"""Evidence with a noise model that is estimated along: nothing where the remnant comes back."""

import pytest
from support.person_in_loop import pursued
from support.searching import search_of

from skhoid.search.judges import JointParent
from skhoid.search.judging import THRESHOLD

SHORT = {"n_runs": 3, "duration": 30.0}


def weigh(text, seed, **options):
    """Of feedforward, from the free run of the measured error and unbiased."""
    X, y, _ = pursued(text, seed, **SHORT, **options)
    search, baseline = search_of(X, y, ["feedforward"], text)
    (candidate,) = search.step(baseline).candidates
    return candidate.delta_bic / 2, JointParent(baseline).weigh(candidate.model)


@pytest.mark.slow
def test_remnant_that_comes_back_has_no_evidence():
    free, joint = weigh("1/s", 1)
    assert free > THRESHOLD
    assert joint < THRESHOLD


@pytest.mark.parametrize("text", ["1/s", pytest.param("1/(s(s+1))", marks=pytest.mark.slow)])
def test_a_response_to_the_target_is(text):
    _, joint = weigh(text, 2, feedforward=0.5, early=-0.1, remnant=0.2)
    assert joint > THRESHOLD
