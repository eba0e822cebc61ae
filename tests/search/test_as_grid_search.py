"""EffectSearchCV beside GridSearchCV: all that its name promises, or an error that says why not."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.linear_model import Ridge
from sklearn.model_selection import (
    GridSearchCV,
    GroupKFold,
    LeaveOneGroupOut,
    cross_val_score,
    cross_validate,
)
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    DelayShift,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    make_tracking_runs,
    run_labels,
    vaf_score,
)

X, Y = make_tracking_runs(
    "C1", 3, duration=20.48, sampling_rate=50, remnant_intensity=0.1, random_state=0
)
Y = Y.clip(-0.12, 0.12).rename("u")
G = np.asarray(run_labels(X))
SEARCH = EffectSearchCV(OperatorRegressor(), effects=["bias", "saturation"], max_effects=1)


@pytest.fixture(scope="module")
def fitted():
    return clone(SEARCH).fit(X, Y)


def test_parameters_are_nested_cloned_and_set():
    assert SEARCH.get_params()["estimator__delay"] is None
    other = clone(SEARCH).set_params(estimator__delay=0.3, max_effects=2)
    assert (other.estimator.delay, other.max_effects) == (0.3, 2)
    assert SEARCH.estimator.delay is None
    assert clone(other).get_params()["estimator__delay"] == 0.3
    with pytest.raises(ValueError, match="Invalid parameter 'alpha'"):
        other.set_params(alpha=1)


def test_what_was_found_has_the_names_of_grid_search(fitted):
    assert fitted.best_effects_ == ["saturation"]
    best = fitted.best_index_
    assert fitted.best_params_ == fitted.cv_results_["params"][best]
    assert fitted.best_score_ == fitted.cv_results_["mean_test_score"][best]
    assert fitted.n_splits_ == 3
    assert fitted.refit is True
    assert fitted.multimetric_ is False
    assert (fitted.n_features_in_, fitted.feature_names_in_.tolist()) == (1, ["e"])
    np.testing.assert_array_equal(fitted.predict(X), fitted.best_estimator_.predict(X))
    assert fitted.score(X, Y) == fitted.best_estimator_.score(X, Y)
    assert fitted.scorer_(fitted.best_estimator_, X, Y) == fitted.score(X, Y)
    assert not hasattr(fitted, "predict_proba")


def test_results_are_a_table(fitted):
    table = pd.DataFrame(fitted.cv_results_)
    assert {"params", "param_effects", "mean_test_score", "rank_test_score"} <= {*table.columns}
    splits = table[[f"split{i}_test_score" for i in range(fitted.n_splits_)]]
    settled = X.index.get_level_values("time") >= fitted.best_estimator_.settling
    best = fitted.predictions_[["measured", fitted.predictions_.columns[-1]]][settled]
    for run, score in zip(best.index.unique("run"), splits.loc[fitted.best_index_], strict=True):
        measured, predicted = best.xs(run, level="run").to_numpy().T
        assert score == pytest.approx(vaf_score(measured, predicted))
    assert table.loc[0, "std_test_score"] == pytest.approx(splits.loc[0].std(ddof=0))
    assert [one["effects"] for one in table["params"]] == table["param_effects"].tolist()
    assert table.loc[table["rank_test_score"].idxmin(), "mean_test_score"] == pytest.approx(
        table["mean_test_score"].max()
    )


def test_it_pickles(fitted):
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.predict(X), fitted.predict(X))
    assert again.best_effects_ == fitted.best_effects_


@pytest.mark.parametrize(
    ("cv", "folds"),
    [(2, 2), (list(GroupKFold(3).split(X, Y, G)), 3)],
)
def test_folds_are_those_of_cv(cv, folds):
    search = clone(SEARCH).set_params(cv=cv, max_effects=0).fit(X, Y, groups=G)
    assert search.n_splits_ == folds


def test_groups_are_kept_together():
    search = clone(SEARCH).set_params(max_effects=0)
    assert search.fit(X, Y, groups=np.where(G == 0, "a", "b")).n_splits_ == 2


def test_it_is_a_step_of_pipelines(fitted):
    pipe = make_pipeline(DelayShift(0.0), clone(SEARCH)).fit(X, Y)
    assert pipe.score(X, Y) == fitted.score(X, Y)


@pytest.mark.slow
def test_other_searches_and_validations_take_it():
    of_runs = {"cv": LeaveOneGroupOut(), "groups": G, "error_score": "raise"}
    assert (cross_val_score(SEARCH, X, Y, **of_runs) > 80).all()
    found = cross_validate(SEARCH, X, Y, scoring=["r2", "neg_mean_squared_error"], **of_runs)
    assert (found["test_r2"] > 0.8).all()
    assert (found["test_neg_mean_squared_error"] < 0).all()
    outer = GridSearchCV(clone(SEARCH), {"max_effects": [0, 1]}, cv=LeaveOneGroupOut())
    assert outer.fit(X, Y, groups=G).best_params_ == {"max_effects": 1}


@pytest.mark.parametrize(
    "search", [SEARCH, OrderSearchCV(ARXRegressor(), na=[1], nb=[1]), RecursiveARXCV([64])]
)
def test_searches_take_no_weights(search):
    with pytest.raises(TypeError, match=r"takes no sample_weight.*Make y NaN"):
        clone(search).fit(X, Y, sample_weight=np.ones(len(Y)))


@pytest.mark.parametrize(
    ("estimator", "says"),
    [
        (Ridge(), "got Ridge"),
        (RecursiveARX(), "got RecursiveARX"),
        (OperatorRegressor, r"pass OperatorRegressor\(\)"),
        (make_pipeline(DelayShift(0.1), OperatorRegressor()), r"make_pipeline\(\.\.\., EffectSear"),
    ],
)
def test_what_it_cannot_search_with(estimator, says):
    with pytest.raises(TypeError, match=says):
        EffectSearchCV(estimator).fit(X, Y)


@pytest.mark.parametrize("use", ["predict", "score", "summary", "ranking_table"])
def test_before_a_fit(use):
    given = {"predict": (X,), "score": (X, Y)}.get(use, ())
    with pytest.raises(AttributeError, match="not fitted yet"):
        getattr(clone(SEARCH), use)(*given)
