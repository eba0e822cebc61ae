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
}
SMALL = ARXRegressor(na=1, nb=1)
RECURSIONS = [{"memory_horizon": 50, "init_window": 1000}, {"init": "zeros", "p0": 100}]
# Not RecursiveARXCV: the checks have one run, and it validates on others.
ESTIMATORS = [
    SMALL,
    # Of four parameters, as elsewhere: a recursion is compiled for each number of them.
    RecursiveARX(inputs=[0], **RECURSIONS[0]),
    OperatorRegressor(),
    Decimator(),
    DelayShift(),
    RunInTrimmer(),
]
COSTLY = [
    DelaySearchCV(SMALL, nk=[0, 1]),
    OrderSearchCV(ARXRegressor(inputs=[0]), na=[1], nb=[1]),
    EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0),
    RecursiveBoxJenkins(na=1, nb=1, inputs=[0], noise_order=0, init_window=1000),
    RecursiveARX(inputs=[0], **RECURSIONS[1]),
    *(RecursiveARX(na=1, nb=1, **options) for options in RECURSIONS),
]
TRANSFORMERS = (Decimator, DelayShift, RunInTrimmer)


def waived(estimator):
    return {} if isinstance(estimator, TRANSFORMERS) else WAIVED


@parametrize_with_checks(ESTIMATORS, expected_failed_checks=waived)
def test_sklearn_checks(estimator, check):
    check(estimator)


@pytest.mark.slow
@parametrize_with_checks(COSTLY, expected_failed_checks=waived)
def test_costly_sklearn_checks(estimator, check):
    check(estimator)
