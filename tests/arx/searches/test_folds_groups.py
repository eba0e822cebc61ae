"""``groups`` of the searches: checked against the runs, with metadata routing and without."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.pipeline import make_pipeline
from support.synthetic import arx_runs

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    DelayShift,
    EffectSearchCV,
    OrderSearchCV,
    RecursiveARXCV,
    RunIndexError,
    VAFScorer,
    run_labels,
)

pytestmark = pytest.mark.slow  # searches

X, Y = arx_runs(4, 200)
RUN = run_labels(X)
PEOPLE = np.array(["a", "a", "b", "c"])[RUN - 1]
MODEL = ARXRegressor(1, 1)
SEARCHES = {
    "delay": lambda cv=None: DelaySearchCV(MODEL, nk=[1, 3], criterion="vaf", cv=cv),
    "delay, one step": lambda cv=None: DelaySearchCV(MODEL, nk=[1, 3], cv=cv),
    "order": lambda cv=None: OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[1], nk=[3], cv=cv),
    "memory": lambda cv=None: RecursiveARXCV([16, 64], nk=3, cv=cv),
    "effects": lambda cv=None: EffectSearchCV(ARXRegressor(2, 2, 3), [], cv),
}
SCORED = ["delay", "order", "memory"]


@pytest.fixture
def routing():
    with sklearn.config_context(enable_metadata_routing=True):
        yield


def scores(search):
    return search.cv_results_["mean_test_score"]


@pytest.mark.parametrize("name", SEARCHES)
def test_a_run_in_two_groups_is_named(name):
    groups = PEOPLE.copy()
    groups[250:300] = "b"  # of run 2
    with pytest.raises(RunIndexError, match=r"Run 2 is in two groups: 'a', and 'b' from run 2, "):
        SEARCHES[name]().fit(X, Y, groups=groups)


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (PEOPLE[:-1], r"shape \(799,\) and X has 800 rows"),
        (np.where(np.arange(800) < 20, None, PEOPLE), "no label at run 1, t = 0 s"),
        (np.ma.masked_where(RUN == 2, PEOPLE), r"groups has no label at run 2, t = "),
        (np.ma.masked_equal(RUN, 1), r"groups has no label at run 1, t = 0 s \(row 0\)"),
        (pd.Series(PEOPLE, X.index)[::-1], "row indexes of X and groups disagree"),
    ],
)
def test_groups_that_do_not_fit_the_rows_are_refused(groups, message):
    with pytest.raises(ValueError, match=message):
        next(iter(SEARCHES.values()))().fit(X, Y, groups=groups)


@pytest.mark.parametrize("name", SCORED)
@pytest.mark.usefixtures("routing")
def test_routing_changes_nothing(name):
    with sklearn.config_context(enable_metadata_routing=False):
        expected = [SEARCHES[name](GroupKFold(3)).fit(X, Y, groups=g) for g in (PEOPLE, None)]
    found = [SEARCHES[name](GroupKFold(3)).fit(X, Y, groups=g) for g in (PEOPLE, None)]
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(scores(one), scores(other))


@pytest.mark.parametrize("steps", [[], [DelayShift(0.01)]])
def test_a_search_within_a_grid_search(steps):
    """Its groups, with routing, are those of the rows it is fitted on; else it takes the runs."""
    model = make_pipeline(*steps, DelaySearchCV(MODEL, nk=[1, 2], criterion="vaf"))
    search = GridSearchCV(
        model, {"delaysearchcv__estimator__na": [1, 2]}, scoring=VAFScorer(), cv=GroupKFold(3)
    )
    n_splits = []
    for enabled in (False, True):
        with sklearn.config_context(enable_metadata_routing=enabled):
            best = search.fit(X, Y, groups=PEOPLE).best_estimator_[-1]
        n_splits.append(sum(key.startswith("split") for key in best.cv_results_))
    assert n_splits == [4, 3]
