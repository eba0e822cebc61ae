"""Structure left in a residual: what linear responses explain in the closed loop, at two rates."""

import pytest
from support.person_in_loop import pursued
from support.searching import search_of
from support.synthetic import arx_runs

from skhoid import ARXRegressor, EffectSearchCV
from skhoid.search import Verdict
from skhoid.search.leftover import leftovers


@pytest.mark.slow
@pytest.mark.parametrize(("feedforward", "answers"), [(0.5, True), (0.0, False)])
def test_an_answer_to_the_target_is_left_only_where_there_is_one(feedforward, answers):
    X, y, _ = pursued("1/(s(s+1))", 3, feedforward=feedforward, early=0.2)
    search, baseline = search_of(X, y, ["bias"], "1/(s(s+1))")
    left = leftovers(baseline, search.folds, search.loop)
    points = sum(one.points for one in left if one.at == "f_t")
    assert points > 1.0 if answers else points < 0.2


def test_an_exact_model_leaves_nothing():
    X, y = arx_runs(2, 150)
    X = X[["e"]].assign(e=y)  # the output itself, which leaves no residual at all
    search = EffectSearchCV(ARXRegressor(), effects=["bias"]).fit(X, y)
    assert search.verdict_ is Verdict.NOTHING
    assert search.unexplained_.empty
