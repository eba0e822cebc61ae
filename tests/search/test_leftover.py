"""Structure left in a residual: what linear responses explain in the closed loop, at two rates."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.person_in_loop import pursued
from support.searching import search_of
from support.synthetic import arx_runs

from skhoid import ARXRegressor, EffectSearchCV
from skhoid.search import Verdict, leftover
from skhoid.search.judges import RATES
from skhoid.search.leftover import Leftover, leftovers


def item(where, points):
    return Leftover(where, "f_t", "words", points, 100.0)


def judge_of(output=(0.0,)):
    fit = SimpleNamespace(output=np.array(output))
    return SimpleNamespace(around=lambda model: SimpleNamespace(fit=fit), folds=[])


@pytest.mark.parametrize(
    ("inside", "left"),
    [
        ((2.0, 1.5), 1.5),
        ((1.2, 1.5), 1.2),
        ((4.0, 5.0), 3.0),
        ((2.0, None), 0),
        ((None, 2.0), 0),
    ],
)
def test_linear_responses_count_for_what_they_explain_at_both_rates(monkeypatch, inside, left):
    by_rate = dict(zip((None, RATES[0]), inside, strict=True))

    def found(model, folds, rate=None, asked=None):
        if model == "model":
            return [item("channel", 3.0), item("amplitude", 2.5)]
        assert {where for where, _, _ in asked} <= {"channel"}  # others are not computed there
        return [] if by_rate[rate] is None else [item("channel", by_rate[rate])]

    monkeypatch.setattr(leftover, "_found", found)
    points = {one.where: one.points for one in leftovers("model", [], judge_of())}
    assert points == {"amplitude": 2.5} | ({"channel": left} if left else {})
    assert {one.where: one.points for one in leftovers("model", [])}["channel"] == 3.0
    unsolved = leftovers("model", [], judge_of((np.nan,)))
    assert {one.where: one.points for one in unsolved}["channel"] == 3.0


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
