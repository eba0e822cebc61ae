"""The judge by instruments: target and disturbance tell what the remnant in the error hides."""

import numpy as np
import pytest
from support.person_in_loop import pursued

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import AsymmetricGain, DeadZone, Feedforward
from skhoid.search.instruments import Curves, InstrumentJudge

ASKED = 12.5  # nats


def judged(X, y, text):
    """Evidence of feedforward, by the free run and by instruments."""
    search = EffectSearchCV(OperatorRegressor(), controlled_element=text)
    data = search.read_data(OperatorRegressor(), X, y)
    parent = OperatorRegressor().first_fit(data.searched)
    model = OperatorRegressor(effects=Feedforward(form="inverse")).first_fit(data.searched)
    judge = InstrumentJudge.of(data.record, ASKED)
    n = model.fit.n
    free = n / 2 * np.log(parent.sse / model.sse) - np.log(n)
    return free, judge.evidence(parent, model)


@pytest.mark.parametrize(
    ("text", "columns"), [("1/s", ["e", "x", "f_t"]), ("1/(s(s+1))", ["e", "x"])]
)
def test_an_answer_to_the_target_is_told_from_remnant_in_the_error(text, columns):
    """Where the target is not recorded it is the error and what the output moved."""
    nothing, answered = (
        pursued(text, 3, feedforward=share, early=-0.1, n_runs=3, duration=40.0)
        for share in (0.0, 0.6)
    )
    for (X, y, _), there in ((nothing, False), (answered, True)):
        free, found = judged(X[columns], y, text)
        assert free > ASKED
        assert (found > ASKED) == there


def test_without_target_or_element_nothing_is_known():
    X, y, _ = pursued("1/s", 1, n_runs=2, duration=20.0)
    data = EffectSearchCV(OperatorRegressor()).read_data(OperatorRegressor(), X[["e"]], y)
    assert InstrumentJudge.of(data.record, ASKED) is None


@pytest.mark.slow
def test_what_instruments_grant_counts_whatever_a_noise_model_takes_up():
    X, y, _ = pursued("1/(s(s+1))", 4, feedforward=0.6, early=-0.1, n_runs=3)
    search = EffectSearchCV(
        OperatorRegressor(), effects=["feedforward"], controlled_element="1/(s(s+1))"
    ).fit(X, y)
    first = search.ranking_.iloc[0]
    assert first["instruments"] > ASKED
    assert first["evidence"] == np.nanmax([first["instruments"], first["likelihood"]])


def weigh_another_form(X, y, effects):
    """Nats of another form beside a fitted model with effects."""
    model = OperatorRegressor(effects=effects)
    data = EffectSearchCV(model).read_data(model, X, y)
    curves = Curves(data.record, InstrumentJudge.of(data.record, ASKED))
    return curves.weigh(model.first_fit(data.searched))[0]


def test_a_form_that_is_wrong_leaves_what_the_right_one_does_not():
    """Also where nothing is known of what comes from outside."""
    options = {"n_runs": 3, "remnant_intensity": 0.1, "random_state": 1}
    X, y = make_tracking_runs("C1", effects=DeadZone(width=0.5), **options)
    nothing, right, wrong = (
        weigh_another_form(X, y, effects) for effects in (None, DeadZone(), AsymmetricGain())
    )
    assert right < 5.0 < ASKED < min(wrong, nothing)
    X, y = make_tracking_runs("C1", **options)
    assert weigh_another_form(X, y, None) < 5.0
