"""Structure left in a residual: what free forms explain beside the effects found."""

import pytest
from support.person_in_loop import pursued
from support.synthetic import arx_runs

from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor
from skhoid.search import Verdict


@pytest.mark.slow
@pytest.mark.parametrize(("feedforward", "answers"), [(0.5, True), (0.0, False)])
def test_an_answer_to_the_target_is_left_only_where_there_is_one(feedforward, answers):
    """Of a remnant that comes back, judges see that nobody answers the target."""
    text = "1/(s(s+1))"
    X, y, _ = pursued(text, 3, feedforward=feedforward, early=0.2, n_runs=3, duration=40.0)
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"], controlled_element=text)
    left = search.fit(X, y).unexplained_
    points = left.loc[left["at"] == "f_t", "points"]
    assert (points > 1.0).any() if answers else points.empty


def test_an_exact_model_leaves_nothing():
    X, y = arx_runs(2, 150)
    X = X[["e"]].assign(e=y)  # the output itself, which leaves no residual at all
    search = EffectSearchCV(ARXRegressor(), effects=["bias"]).fit(X, y)
    assert search.verdict_ is Verdict.NOTHING
    assert search.unexplained_.empty
