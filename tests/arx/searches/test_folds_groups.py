"""``groups`` of the searches: checked against the runs, with metadata routing and without."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.model_selection import GridSearchCV, GroupKFold, KFold, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from sklearn.utils.metadata_routing import get_routing_for_object
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
    "order": lambda cv=None: OrderSearchCV(na=[1, 2], nb=[1], nk=[3], cv=cv),
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


def test_the_label_of_a_run_column_is_named_as_it_is():
    table = X.reset_index("run").assign(run=RUN - 1).reset_index(drop=True)
    search = DelaySearchCV(ARXRegressor(1, 1, run="run", dt=0.01), nk=[1, 3])
    with pytest.raises(RunIndexError, match=r"^Run 0 is in two groups: 0, and 1 from run 0, t = "):
        search.fit(table, Y.to_numpy(), groups=np.arange(800) // 100)


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
@pytest.mark.parametrize("name", SEARCHES)
def test_groups_that_do_not_fit_the_rows_are_refused(name, groups, message):
    with pytest.raises(ValueError, match=message):
        SEARCHES[name]().fit(X, Y, groups=groups)


@pytest.mark.parametrize("name", SCORED)
@pytest.mark.parametrize("people", [PEOPLE, PEOPLE.tolist(), pd.Series(PEOPLE)])
def test_groups_of_any_kind_are_those_of_their_rows(name, people):
    expected = SEARCHES[name](LeaveOneGroupOut()).fit(X, Y, groups=pd.factorize(PEOPLE)[0])
    found = SEARCHES[name]().fit(X, Y, groups=people)
    assert np.array_equal(scores(found), scores(expected))
    assert not np.array_equal(scores(found), scores(SEARCHES[name]().fit(X, Y)))


@pytest.mark.parametrize("name", SCORED)
@pytest.mark.parametrize("cv", [None, 3, GroupKFold(3)])
@pytest.mark.usefixtures("routing")
def test_routing_changes_nothing(name, cv):
    with sklearn.config_context(enable_metadata_routing=False):
        expected = [SEARCHES[name](cv).fit(X, Y, groups=g) for g in (PEOPLE, None)]
    found = [SEARCHES[name](cv).fit(X, Y, groups=g) for g in (PEOPLE, None)]
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(scores(one), scores(other))


@pytest.mark.usefixtures("routing")
def test_a_splitter_asks_by_the_name_it_likes():
    search = SEARCHES["delay"](GroupKFold(3).set_split_request(groups="people"))
    expected = SEARCHES["delay"](GroupKFold(3)).fit(X, Y, groups=PEOPLE)
    assert np.array_equal(scores(search.fit(X, Y, people=PEOPLE)), scores(expected))
    with pytest.raises(RunIndexError, match="Run 1 is in two groups"):
        search.fit(X, Y, people=np.arange(800) // 100)


@pytest.mark.parametrize("name", SCORED)
@pytest.mark.usefixtures("routing")
def test_a_splitter_that_wants_no_groups_gets_runs(name):
    cv = GroupKFold(2).set_split_request(groups=False)
    assert np.array_equal(
        scores(SEARCHES[name](cv).fit(X, Y, groups=PEOPLE)),
        scores(SEARCHES[name](GroupKFold(2)).fit(X, Y)),
    )


@pytest.mark.usefixtures("routing")
def test_splits_from_a_generator_are_not_used_up():
    search = SEARCHES["delay"](LeaveOneGroupOut().split(X, groups=RUN))
    assert np.array_equal(
        scores(search.fit(X, Y, groups=PEOPLE)), scores(SEARCHES["delay"]().fit(X, Y))
    )


@pytest.mark.parametrize("name", SEARCHES)
def test_other_metadata_are_refused(name):
    search = SEARCHES[name]()
    with pytest.raises(ValueError, match="sample_weight"):
        search.fit(X, Y, sample_weight=np.ones(800))
    with (
        sklearn.config_context(enable_metadata_routing=True),
        pytest.raises(TypeError, match="sample_weight"),
    ):
        search.fit(X, Y, sample_weight=np.ones(800))


@pytest.mark.parametrize("name", SEARCHES)
def test_what_is_requested(name):
    for cv in (None, 3, GroupKFold(3)):
        router = get_routing_for_object(SEARCHES[name](cv))
        assert router.consumes("fit", ["groups", "people"]) == {"groups"}
        assert "splitter" in router._route_mappings
    with sklearn.config_context(enable_metadata_routing=True):
        renamed = SEARCHES[name](KFold()).set_fit_request(groups="people")
        assert get_routing_for_object(renamed).consumes("fit", ["groups", "people"]) == {"people"}


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


@pytest.mark.usefixtures("routing")
def test_a_bare_search_within_a_grid_search():
    search = GridSearchCV(SEARCHES["delay"](), {"estimator__na": [1]}, cv=GroupKFold(3))
    assert "split3_test_score" not in search.fit(X, Y, groups=PEOPLE).best_estimator_.cv_results_
