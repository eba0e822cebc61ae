"""scikit-learn's own checks on every estimator, and the twins of the waived ones."""

from __future__ import annotations

import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveBoxJenkins,
    RunInTrimmer,
)

ROW_ORDER = "row order is the data: a lag is the row before"
WAIVED = {
    "check_methods_sample_order_invariance": ROW_ORDER + "; twin: permuted runs",
    "check_methods_subset_invariance": ROW_ORDER + "; twin: predicting a subset of runs",
    "check_sample_weight_equivalence_on_dense_data": ROW_ORDER + "; twin: weights of whole runs",
}
SMALL = ARXRegressor(na=1, nb=1)
# Not RecursiveARXCV: the checks have one run, and it validates on others.
ESTIMATORS = [
    SMALL,
    # Of four parameters, as elsewhere: a recursion is compiled for each number of them.
    RecursiveARX(inputs=[0], memory_horizon=50, init_window=1000),
    OperatorRegressor(dt=1.0),
    Decimator(),
    DelayShift(),
    RunInTrimmer(),
]
COSTLY = [
    DelaySearchCV(SMALL, nk=[0, 1]),
    OrderSearchCV(ARXRegressor(inputs=[0]), na=[1], nb=[1]),
    EffectSearchCV(OperatorRegressor(delay=1.0, dt=1.0), effects=["bias"], max_effects=0),
    RecursiveBoxJenkins(na=1, nb=1, inputs=[0], noise_order=0, init_window=1000),
]
# Searches of three seconds each, in which scikit-learn looks at the model's numbers
OF_ITS_MODEL = {
    "check_regressors_train",
    "check_regressor_data_not_an_array",
    "check_supervised_y_2d",
    "check_estimators_dtypes",
    "check_regressors_int",
}
TRANSFORMERS = (Decimator, DelayShift, RunInTrimmer)


def waived(estimator):
    return {} if isinstance(estimator, TRANSFORMERS) else WAIVED


@parametrize_with_checks(ESTIMATORS, expected_failed_checks=waived)
def test_sklearn_checks(estimator, check):
    check(estimator)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skhoid.exceptions.NothingExplainedWarning")  # of random data
@parametrize_with_checks(COSTLY, expected_failed_checks=waived)
def test_costly_sklearn_checks(estimator, check):
    if (
        isinstance(estimator, EffectSearchCV)
        and getattr(check, "func", check).__name__ in OF_ITS_MODEL
    ):
        pytest.skip("the model that it searches with is checked above")
    check(estimator)
