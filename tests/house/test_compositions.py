"""scikit-learn's tools that do not pass runs on, or take coef_ for one number per column."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.ensemble import AdaBoostRegressor, BaggingRegressor, StackingRegressor, VotingRegressor
from sklearn.feature_selection import RFE, SelectFromModel
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.utils import resample
from support.synthetic import arx_runs

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    OperatorRegressor,
    RecursiveARX,
    RunIndexError,
    run_labels,
)

X, Y = arx_runs(2, 300)
MODEL = ARXRegressor(nk=3)


@pytest.mark.parametrize("model", [MODEL, RecursiveARX(nk=3), OperatorRegressor()])
def test_rows_drawn_from_a_table_are_refused(model):
    with pytest.raises(RunIndexError, match=r"shuffled, or drawn one by one"):
        model.fit(*resample(X, Y, random_state=0))
    drawn = np.sort(np.random.default_rng(0).choice(300, 200))  # of one run, and put in order
    with pytest.raises(RunIndexError, match="time"):
        model.fit(X.iloc[drawn], Y.iloc[drawn])


@pytest.mark.filterwarnings("ignore::skhoid.RunCutWarning")  # the bare rows are doubted
@pytest.mark.parametrize("kind", [BaggingRegressor, AdaBoostRegressor])
def test_bagging_and_boosting_pass_bare_rows_as_the_docs_say(kind):
    class Seen(ARXRegressor):
        def fit(self, X, y):
            assert type(X) is type(y) is np.ndarray
            return super().fit(X, y)

    kind(Seen(nk=3), n_estimators=1, random_state=0).fit(X, Y)


def test_bagging_draws_by_weights_and_keeps_the_order_of_rows():
    x, y = X.loc[[1]].to_numpy(), Y.loc[[1]].to_numpy()
    model = ARXRegressor(nk=3)
    bag = BaggingRegressor(model, n_estimators=5, random_state=0).fit(x, y)
    twin = model.fit(x, y)
    assert np.mean([one.coef_ for one in bag.estimators_], axis=0) == pytest.approx(
        twin.coef_, abs=5 * twin.standard_errors_.max()
    )
    assert bag.score(x, y) > twin.score(x, y) / 100 - 0.02


def test_stacking_and_voting_pass_runs_on():
    expected = ARXRegressor(nk=3).fit(X, Y).predict(X)
    voted = VotingRegressor([("model", MODEL)]).fit(X, Y)
    np.testing.assert_array_equal(voted.predict(X), expected)
    stacked = StackingRegressor([("model", MODEL)], cv="prefit")
    stacked.estimators = [("model", ARXRegressor(nk=3).fit(X, Y))]
    np.testing.assert_array_equal(stacked.fit(X, Y).transform(X)[:, 0], expected)


@pytest.mark.parametrize("model", [MODEL, RecursiveARX(nk=3), ARXRegressor(1, 1, 3, inputs=["e"])])
def test_selection_by_importance_does_not_take_lags_for_columns(model):
    told = r"one number per lag \(a1, .*b0, .*\), and selection by importance needs one per column"
    with pytest.raises(TypeError, match=told):
        SelectFromModel(model).fit(X, Y).transform(X)
    bare = clone(model).set_params(inputs=[0])
    with pytest.raises(TypeError, match=told):
        RFE(bare).fit(X.to_numpy(), Y.to_numpy())
    fitted = clone(model).fit(X, Y)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fitted)).coef_, fitted.coef_)
    assert not hasattr(clone(model), "coef_")
    selected = SelectFromModel(model, importance_getter=lambda fitted: fitted.coef_[:2])
    assert selected.fit(X, Y).transform(X).shape[1] > 0


@pytest.mark.parametrize(
    "model", [OperatorRegressor(dt=0.01), DelaySearchCV(ARXRegressor(), nk=[2, 3])]
)
def test_selection_by_importance_refuses_what_has_no_coefficients(model):
    for selector in (RFE(model), SelectFromModel(model)):
        with pytest.raises(ValueError, match="should have `coef_`"):
            selector.fit(X.to_numpy(), Y.to_numpy()).transform(X.to_numpy())


def test_selection_by_importance_is_right_for_one_lag_of_each_column():
    one_lag = ARXRegressor(na=0, nb=1, nk=3, inputs=None)
    columns = np.column_stack([X["e"], np.random.default_rng(0).standard_normal(len(X))])
    selected = RFE(one_lag, n_features_to_select=1).fit(columns, Y.to_numpy())
    assert selected.support_.tolist() == [True, False]
    assert SelectFromModel(one_lag).fit(columns, Y.to_numpy()).get_support().tolist() == [
        True,
        False,
    ]


def test_sets_of_inputs_are_compared_by_a_grid():
    grid = {"inputs": [["e"], ["x"]]}
    search = GridSearchCV(MODEL, grid, cv=LeaveOneGroupOut()).fit(X, Y, groups=run_labels(X))
    assert search.best_params_ == {"inputs": ["e"]}
