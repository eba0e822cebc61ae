"""A delay that the model was given is a claim, and tested."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.person_in_loop import answered, pursued

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import DeadZone, OutputFeedback, WrongDelay
from skhoid.search import Verdict
from skhoid.search.candidates import Candidate
from skhoid.search.forward import CLAIM, LEAST_GAIN_OF_CLAIM, Search
from skhoid.search.given_delay import GivenDelay, with_given_delay
from skhoid.search.in_loop import InLoop
from skhoid.search.verdict import Ending

RATE = 60
SHORT = {"n_runs": 3, "duration": 30.0}


def searched(X, y, delay, effects, text=None):
    estimator = OperatorRegressor(delay=delay)
    return EffectSearchCV(estimator, effects=effects, controlled_element=text).fit(X, y)


def first_claim(search):
    rows = search.ranking_[search.ranking_["effect"] == CLAIM]
    return rows[rows["step"] == 1].iloc[0]


OPEN = ["dead_zone", "extra_lag", CLAIM]


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "samples"), [(0.5, 10), (0.5, -5), (0.0, 15)])
def test_wrong_delay_is_named_and_hides_nothing(dead, samples):
    """Of someone who answers given errors after 0.2 s."""
    X, y = answered(dead=dead)
    wrong = 0.2 + samples / 50
    found = searched(X, y, wrong, OPEN)
    assert set(found.best_effects_) == ({"dead_zone", CLAIM} if dead else {CLAIM})
    added = found.ranking_.query("status == 'added'")
    assert added["effect"].tolist() == [CLAIM, "dead_zone"][: len(found.best_effects_)]
    assert first_claim(found)["status"] == "added"
    assert first_claim(found)["reason"] == ""
    extra = found.best_estimator_.parameters_["value"]["wrong_delay__extra"]
    free = searched(X, y, None, OPEN).best_estimator_.parameters_["value"]["tau_e"]
    assert wrong + extra == pytest.approx(free, abs=0.005)
    assert free == pytest.approx(0.2, abs=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [10, -5])
def test_wrong_delay_that_costs_little_is_not_named(samples):
    """Without a dead zone the other parameters make up for most of it."""
    found = searched(*answered(dead=0.0), 0.2 + samples / 50, OPEN)
    claim = first_claim(found)
    assert found.best_effects_ == []
    assert claim["status"] == "not better"
    assert 0 < claim["vaf_gain"] < LEAST_GAIN_OF_CLAIM


@pytest.mark.slow
@pytest.mark.parametrize("dead", [0.0, 0.5])
def test_right_delay_adds_nothing(dead):
    X, y = answered(dead=dead)
    found = searched(X, y, 0.2, OPEN)
    names = ["dead_zone"] if dead else []
    assert found.best_effects_ == names
    assert first_claim(found)["status"] == "not better"
    added = found.ranking_.query("status == 'added'")
    assert added["effect"].tolist() == names  # once, where it was


def test_the_first_step_has_all_effects_with_the_given_delay():
    """As found beside it from the start, though a search with a free delay comes before."""
    X, y = answered(dead=0.5)
    estimator = OperatorRegressor(delay=0.24)
    prepared = estimator.prepare(X, y)
    search = Search(prepared.core, prepared.record, [WrongDelay(), DeadZone()], [])
    given = GivenDelay.of(search, estimator.first_fit(prepared))
    _, beside, baseline = given.freed(prepared, estimator)
    step = given._first_beside(beside.step(baseline))
    alone = search.step(estimator.first_fit(prepared))
    assert {c.name for c in step.candidates} == {CLAIM, "dead_zone"}
    for one, other in zip(step.candidates, alone.candidates, strict=True):
        assert one.name == other.name
        assert one.model.sse == pytest.approx(other.model.sse, rel=1e-3)


LOOP = ["feedforward", CLAIM]


@pytest.fixture(scope="module")
def tracked():
    return pursued("1/s", 2, feedforward=0.6, early=-0.1, **SHORT)


@pytest.fixture(scope="module")
def free(tracked):
    X, y, _ = tracked
    return searched(X, y, None, LOOP, "1/s")


def named(search):
    return {*search.best_effects_} - {"unknown", CLAIM}


@pytest.mark.slow
def test_free_delay_needs_no_claim(free):
    assert free.best_effects_ == ["feedforward"]
    claim = first_claim(free)
    assert claim["status"] == "does not apply"
    assert "already estimates its delay" in claim["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [10, pytest.param(-5, marks=pytest.mark.slow)])
def test_wrong_delay_in_a_loop_does_not_change_the_names(tracked, free, samples):
    X, y, person = tracked
    found = searched(X, y, person.tau_e + samples / RATE, LOOP, "1/s")
    assert named(found) == named(free)


@pytest.mark.slow
@pytest.mark.parametrize("feedforward", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(60, 62))
def test_right_delay_in_a_loop_is_not_refuted(seed, feedforward):
    X, y, person = pursued("1/s", seed, feedforward=feedforward, early=-0.1)
    found = searched(X, y, person.tau_e, LOOP, "1/s")
    assert CLAIM not in found.best_effects_
    assert named(found) == named(searched(X, y, None, LOOP, "1/s"))
    assert named(found) <= ({"feedforward"} if feedforward else set())


def path_of(ids):
    return SimpleNamespace(ids=ids)


@pytest.mark.parametrize(
    ("named", "free", "path", "best"),
    [
        (["dead_zone"], ["dead_zone"], [CLAIM, "dead_zone"], [CLAIM, "dead_zone"]),
        (["dead_zone"], ["dead_zone"], ["dead_zone"], ["dead_zone"]),
        (["dead_zone", "remnant"], ["dead_zone"], [CLAIM], [CLAIM, "remnant"]),
        ([], [], [CLAIM], [CLAIM]),
        ([], [], [], []),
        (["dead_zone"], ["dead_zone"], [], []),
    ],
)
def test_the_verdict_is_that_of_a_free_delay(named, free, path, best):
    verdict = Ending(Verdict.FOUND if named else Verdict.NOTHING, named, [])
    found = with_given_delay(verdict, path_of(free), path_of(path))
    assert found.best_effects == best
    assert found.verdict == (Verdict.FOUND if best else Verdict.NOTHING)


def test_what_is_unknown_with_a_free_delay_is_with_a_given_one():
    verdict = Ending(Verdict.NOT_IN_CATALOGUE, ["dead_zone"], ["bias"])
    found = with_given_delay(verdict, path_of(["dead_zone", "bias"]), path_of([CLAIM, "dead_zone"]))
    assert found.best_effects == [CLAIM, "dead_zone", "unknown"]
    assert found.stand_ins == ["bias"]


@pytest.mark.parametrize(
    ("joint", "gain", "bends", "added", "stands"),
    [
        (200.0, 5.0, False, [CLAIM], True),
        (120.0, 5.0, False, [CLAIM], False),  # hardly likelier than another delay
        (200.0, 1.0, False, [CLAIM], False),  # which gains more
        (200.0, 5.0, True, [CLAIM], False),  # the loop does not decide
        (200.0, 5.0, False, [CLAIM, "dead_zone"], False),  # found beside another delay
        (200.0, 5.0, False, [], False),
    ],
)
def test_a_given_delay_stands_where_one_effect_explains_clearly_more(
    joint, gain, bends, added, stands
):
    claim = Candidate(CLAIM, WrongDelay(), delta_bic=200.0, joint=100.0, gain=1.5)
    path = OutputFeedback()
    in_loop = InLoop(80.0, 150.0, 1.5, bends)
    best = Candidate(path.name, path, delta_bic=700.0, joint=joint, gain=gain, in_loop=in_loop)
    first = SimpleNamespace(best=best, candidates=[best, claim], judge=lambda candidate: True)
    given = GivenDelay(None, None, CLAIM, claim.effect, None)
    assert given.stands(SimpleNamespace(steps=[first], added=added)) is stands


def test_a_given_delay_does_not_stand_where_the_claim_is_the_best():
    claim = Candidate(CLAIM, WrongDelay(), delta_bic=200.0, joint=100.0, gain=1.5)
    first = SimpleNamespace(best=claim, candidates=[claim], judge=lambda candidate: True)
    given = GivenDelay(None, None, CLAIM, claim.effect, None)
    assert not given.stands(SimpleNamespace(steps=[first], added=[CLAIM]))


@pytest.mark.slow
def test_a_free_model_told_with_a_given_delay_is_the_same_model():
    X, y = answered(dead=0.5)
    estimator = OperatorRegressor(delay=0.3)
    prepared = estimator.prepare(X, y)
    search = Search(prepared.core, prepared.record, [WrongDelay(), DeadZone()], [])
    given = GivenDelay.of(search, estimator.first_fit(prepared))
    _, beside, baseline = given.freed(prepared, estimator)
    free = beside.step(baseline).candidates[0].model
    told = given._told(free)
    assert told.effects.names == [CLAIM, "dead_zone"]
    np.testing.assert_allclose(told.output, free.output, atol=1e-12)
    assert told.values()["wrong_delay__extra"] == pytest.approx(free.values()["tau_e"] - 0.3)
    sd = np.sqrt(np.diag(told.covariance()))[told.simulator.names.index("wrong_delay__extra")]
    assert sd == np.sqrt(np.diag(free.covariance()))[free.simulator.names.index("tau_e")]


def test_no_claim_where_none_is_tested():
    X, y = answered(dead=0.5)
    for delay, effects in ((None, [WrongDelay()]), (0.3, [DeadZone()])):
        estimator = OperatorRegressor(delay=delay)
        prepared = estimator.prepare(X, y)
        search = Search(prepared.core, prepared.record, effects, [])
        assert GivenDelay.of(search, estimator.first_fit(prepared)) is None
