"""RecursiveARXCV against GridSearchCV and its own definitions."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut, LeavePGroupsOut
from sklearn.pipeline import make_pipeline
from support.synthetic import NK, arx_runs, with_levels

from skhoid import (
    Decimator,
    DelayShift,
    RecursiveARX,
    RecursiveARXCV,
    RunInTrimmer,
    VAFScorer,
    forgetting_factor,
    run_labels,
    vaf_score,
)

HORIZONS = [10, 40, (np.inf, np.inf, 40, 20), 200, np.inf]
LENGTHS = [300, 260, 320, 290]


@pytest.fixture(scope="module")
def runs():
    X, y = arx_runs(lengths=LENGTHS, noise=0.5)
    y = y.copy()
    y.iloc[[20, 21, 400]] = np.nan
    return X, y


pytestmark = [pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning"), pytest.mark.slow]


def before(steps, model):
    return make_pipeline(*(clone(step) for step in steps), model)


PIPELINES = {
    "alone": [],
    "decimated": [Decimator(2), DelayShift(0.03)],
    "trimmed": [RunInTrimmer(0.2), DelayShift(0.03), Decimator(3)],
    "run-in": [RunInTrimmer(0.5)],
}
SCORERS = {
    "pooled": VAFScorer(),
    "window": VAFScorer(window=(1.0, 2.0)),
    "mean": VAFScorer(average="mean", run_in=0.3),
    "centred": VAFScorer(centered=True),
}


PAIRS = [
    pytest.param(
        steps,
        scorer,
        id=f"{before_it}-{by}",
    )
    for (before_it, steps), (by, scorer) in zip(PIPELINES.items(), SCORERS.items(), strict=True)
]


@pytest.mark.parametrize(("steps", "scorer"), PAIRS)
def test_scores_are_those_of_grid_search(runs, steps, scorer):
    X, y = runs
    nk = 0 if any(isinstance(step, DelayShift) for step in steps) else NK
    grid = {"recursivearx__memory_horizon": HORIZONS}
    slow = GridSearchCV(
        before(steps, RecursiveARX(nk=nk, init_window=1.0)), grid, scoring=scorer,
        cv=LeaveOneGroupOut(), return_train_score=True,
    ).fit(X, y, groups=run_labels(X))  # fmt: skip
    model = RecursiveARXCV(HORIZONS, nk=nk, init_window=1.0, scoring=scorer)
    search = before(steps, model).fit(X, y)[-1]
    for name in ("mean_test_score", "mean_train_score", "std_test_score", "split2_test_score"):
        np.testing.assert_allclose(search.cv_results_[name], slow.cv_results_[name], atol=1e-9)
    assert search.best_score_ == search.cv_results_["mean_test_score"][search.best_index_]
    assert search.best_memory_horizon_ == HORIZONS[search.best_index_]
    assert search.n_runs_pooled_ == 3


def test_results_by_their_definitions(runs):
    X, y = runs
    search = RecursiveARXCV(HORIZONS, nk=NK).fit(X, y)
    results = search.cv_results_
    test, train = results["mean_test_score"], results["mean_train_score"]
    np.testing.assert_array_equal(results["gain"], test - test[-1])
    np.testing.assert_array_equal(results["overfit_difference"], train - test)
    np.testing.assert_array_equal(results["overfit_ratio"], train / test)
    assert results["forgetting"][1] == forgetting_factor(40)
    np.testing.assert_array_equal(results["forgetting"][2], forgetting_factor(HORIZONS[2]))
    assert np.isnan(RecursiveARXCV([10, 20], nk=NK).fit(X, y).cv_results_["gain"]).all()


def test_one_run_trains_and_the_others_validate(runs):
    """As in Fig. 13: every path is scored on every other run."""
    X, y = runs
    search = RecursiveARXCV([40], nk=NK, cv=LeavePGroupsOut(3)).fit(X, y)
    assert search.n_runs_pooled_ == 1
    scores = []
    for train in range(4, 0, -1):
        model = RecursiveARX(nk=NK, memory_horizon=40).fit(X.loc[[train]], y.loc[[train]])
        others = [run for run in range(1, 5) if run != train]
        scores.append(vaf_score(y.loc[others], model.predict(X.loc[others])))
    found = [search.cv_results_[f"split{i}_test_score"][0] for i in range(4)]
    np.testing.assert_allclose(sorted(found), sorted(scores), atol=1e-9)


def test_the_best_is_fitted_on_all_runs(runs):
    X, y = runs
    search = RecursiveARXCV(HORIZONS, nk=NK, cv=2).fit(X, y)
    model = RecursiveARX(nk=NK, memory_horizon=search.best_memory_horizon_).fit(X, y)
    np.testing.assert_array_equal(search.coef_path_, model.coef_path_)
    np.testing.assert_array_equal(search.covariance_, model.covariance_)
    np.testing.assert_array_equal(search.predict(X), model.predict(X))
    assert search.n_runs_pooled_ == 2
    again = clone(search)
    assert again.get_params()["memory_horizons"] == HORIZONS
    more = [with_levels(table.loc[[1]], run=9) for table in (X, y)]
    np.testing.assert_array_equal(search.partial_fit(*more).coef_, model.partial_fit(*more).coef_)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"memory_horizons": []}, ["memory_horizons is empty"]),
        ({"memory_horizons": 256}, ["sequence", "256"]),
        ({"memory_horizons": [None, 2]}, ["numbers of samples"]),
        ({"scoring": VAFScorer(window=(90, 99))}, ["No row is left to score"]),
        ({"memory_horizons": [0.5]}, ["longer than one sample", "0.5"]),
        ({"memory_horizons": [(10, 20)]}, ["one per parameter (4)"]),
        ({"scoring": VAFScorer(rate="model")}, ["full rate"]),
        ({"cv": [(np.arange(300), np.arange(200, 500))]}, ["within a run"]),
        ({"cv": [(np.arange(200), np.arange(300, 500))]}, ["parts of runs", "LeaveOneGroupOut"]),
    ],
)
def test_errors(runs, params, words):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        RecursiveARXCV(nk=NK, **params).fit(*runs)
    assert [word for word in words if word not in str(error.value)] == [], error.value


def test_a_single_run_needs_another_criterion(runs):
    X, y = runs
    with pytest.raises(ValueError, match="forgetting='auto'"):
        RecursiveARXCV(nk=NK).fit(X.loc[[1]], y.loc[[1]])
    with pytest.raises(ValueError, match="only after fit"):
        RecursiveARXCV(nk=NK).partial_fit(X.loc[[1]], y.loc[[1]])
