"""Triangles of runs, merged by folds: exact against refits of each fold, and linear in rows."""

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import KFold, ShuffleSplit
from support import naive
from support.synthetic import arx_runs, stretches_of

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    run_labels,
)
from skhoid.arx.folds import make_folds
from skhoid.runs import read_layout

pytestmark = pytest.mark.slow

quiet = pytest.mark.filterwarnings(
    "ignore::skhoid.RunCutWarning", "ignore::skhoid.MissingDataWarning"
)

FIRST, LAST = 1, 7  # lags of the input that the candidates reach together
CANDIDATES = [1, 3, 6]
INPUTS = {1: ["e"], 2: ["e", "x"]}


def refitted(X, y, inputs, nk, train, test, intercept):
    """VAF of a candidate by least squares on the rows whose lags are all known and in ``train``."""
    n, n_inputs, stretches = len(X), len(inputs), stretches_of(X)
    values, output = X[inputs].to_numpy(), y.to_numpy()
    *_, rows, _ = naive.regressor_rows(
        output, values, stretches, 2, [LAST - FIRST + 1] * n_inputs, [FIRST] * n_inputs
    )
    rows = [t for t in rows if train[t - LAST : t + 1].all()]
    phi, measured, own, _ = naive.regressor_rows(
        output, values, stretches, 2, [2] * n_inputs, [nk] * n_inputs, intercept
    )
    use = np.isin(own, rows)
    theta = np.linalg.lstsq(phi[use], measured[use], rcond=None)[0]
    held = pd.DataFrame(values).groupby(run_labels(X)).ffill().fillna(0.0).to_numpy()
    free = naive.free_run(
        held, stretches, theta[:2], np.split(theta[2 : 2 + 2 * n_inputs], n_inputs),
        [nk] * n_inputs, theta[-1] if intercept else 0.0,
    )  # fmt: skip
    known = test & ~np.isnan(output)
    assert known.sum() < n
    return naive.vaf(output[known], free[known])


@pytest.fixture(scope="module")
def holed():
    X, y = arx_runs(lengths=[90, 140, 60, 120, 75], noise=0.4, seed=5)
    X.iloc[[100, 250], 0] = np.nan
    y.iloc[[30, 31, 300]] = np.nan
    return X, y


def split(X, y, cv, groups=None):
    return make_folds(read_layout(X), cv, {"groups": groups}, ~np.isnan(y.to_numpy()))


SPLITS = {
    "runs": None,
    "two groups": 2,
    "given runs": [(np.arange(230), np.arange(230, 485)), (np.arange(290, 485), np.arange(90))],
    "cut": KFold(4),
    "cut beside whole": [(np.r_[0:150, 200:400], np.r_[150:200, 420:485])],
    "rows": ShuffleSplit(2, test_size=0.01, random_state=0),
}


@quiet
@pytest.mark.parametrize("cv", SPLITS.values(), ids=SPLITS)
@pytest.mark.parametrize(("n_inputs", "intercept"), [(1, False), (2, True)])
def test_folds_equal_refits(holed, cv, n_inputs, intercept):
    X, y = holed
    inputs = INPUTS[n_inputs]
    model = ARXRegressor(inputs=inputs, fit_intercept=intercept)
    results = DelaySearchCV(model, nk=CANDIDATES, criterion="vaf", cv=cv).fit(X, y).cv_results_
    folds = split(X, y, cv)
    for number, fold in enumerate(folds):
        train, test = fold.train.mask(), fold.test.mask()
        twins = [refitted(X, y, inputs, nk, train, test, intercept) for nk in CANDIDATES]
        found = results[f"split{number}_test_score"]
        np.testing.assert_allclose(100 - found, 100 - np.array(twins), rtol=1e-9)
