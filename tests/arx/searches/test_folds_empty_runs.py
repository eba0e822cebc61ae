"""A run in which nothing was measured, or an input not recorded, is as if it were not there."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from support.synthetic import arx_runs

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    MissingDataWarning,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    SimulatedARX,
    VAFScorer,
    make_tracking_runs,
    run_labels,
    select_runs,
)

pytestmark = pytest.mark.slow  # searches

X, Y = arx_runs(4, 200)
GONE = run_labels(X) == 2
WITHOUT = X[~GONE], Y[~GONE]
NO_E = X.assign(e=X["e"].mask(GONE)), Y
NO_Y = X, Y.mask(GONE)
KINDS = pytest.mark.parametrize(
    ("data", "channel"), [(NO_Y, "u"), (NO_E, "e")], ids=["output", "input"]
)

SEARCHES = {
    "delay": DelaySearchCV(ARXRegressor(), nk=[1, 3], criterion="vaf"),
    "delay, one by one": DelaySearchCV(
        make_pipeline(FunctionTransformer(), ARXRegressor()), nk=[1, 3], criterion="vaf"
    ),
    "orders and factors": OrderSearchCV(
        ARXRegressor(), na=[1], nb=[1], nk={1: [3], 2: [1]}, factor=[1, 2]
    ),
    "memory, two folds": RecursiveARXCV([16, 64], nk=3, cv=2),
}


def told(action, *args):
    """What an action returns, and what its warnings of missing data say."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = action(*args)
    assert {warning.category for warning in caught} <= {MissingDataWarning}
    return found, " ".join(str(warning.message) for warning in caught)


def assert_same_results(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        if name != "params":
            assert_array_equal(found[name], values, err_msg=name)


@KINDS
@pytest.mark.parametrize("name", SEARCHES)
def test_a_search_finds_what_it_finds_without_the_run(name, data, channel):
    search = SEARCHES[name]
    expected = search.fit(*WITHOUT).cv_results_
    found, warning = told(search.fit, *data)
    assert "1 of 4 runs are left out because a channel is NaN" in warning
    assert f"run 2 ({channel!r})" in warning
    assert_same_results(found.cv_results_, expected)


@KINDS
@pytest.mark.parametrize(
    "model",
    [
        ARXRegressor(2, 2, 3),
        SimulatedARX(2, 2, 3, effects=["bias"], settling=0.1),
        RecursiveARX(2, 2, 3, forgetting="auto"),
    ],
)
def test_a_fit_and_its_score_are_those_without_the_run(model, data, channel):
    expected = model.fit(*WITHOUT)
    coef, score, vaf = expected.coef_.copy(), expected.score(*WITHOUT), VAFScorer()(model, *WITHOUT)
    fitted, warning = told(model.fit, *data)
    assert f"run 2 ({channel!r})" in warning
    np.testing.assert_allclose(fitted.coef_, coef, rtol=1e-12)
    for scored, of_all in ((fitted.score, score), (lambda *d: VAFScorer()(fitted, *d), vaf)):
        found, warning = told(scored, *data)
        np.testing.assert_allclose(found, of_all, rtol=1e-12)
        assert "run 2, " in warning or "y is NaN in all rows of run 2: not scored" in warning


@pytest.fixture(scope="module")
def people():
    return make_tracking_runs(
        n_runs=4, duration=10.24, sampling_rate=50, channels=("e", "x"), random_state=0
    )


def without_channel(data, channel):
    X, y = data
    gone = run_labels(X) == 3
    if channel == "u":
        return (X[~gone], y[~gone]), (X, y.mask(gone))
    return (X[~gone], y[~gone]), (X.assign(**{channel: X[channel].mask(gone)}), y)


@pytest.mark.parametrize("channel", ["u", "x"])
def test_a_model_with_effects_needs_every_channel(people, channel):
    without, data = without_channel(people, channel)
    model = OperatorRegressor(0.28)
    expected = model.fit(*without).parameters_["value"].to_numpy()
    fitted, warning = told(model.fit, *data)
    assert f"run 3 ({channel!r})" in warning
    np.testing.assert_allclose(fitted.parameters_["value"], expected, rtol=1e-6)


@KINDS
def test_one_run_with_measurements_is_split_into_halves(data, channel):
    def first_two(X, y):
        return select_runs(X, y, runs=[1, 2])

    search = DelaySearchCV(ARXRegressor(), nk=[1, 3], criterion="vaf")
    expected = search.fit(*select_runs(X, Y, runs=1)).cv_results_
    found, _ = told(search.fit, *first_two(*data))
    assert_same_results(found.cv_results_, expected)
    with pytest.raises(ValueError, match="X has only one with measurements"):
        told(RecursiveARXCV([16], nk=3).fit, *first_two(*data))


def test_nothing_left_is_said_truly():
    search = next(iter(SEARCHES.values()))
    with pytest.raises(ValueError, match="NaN in all rows: nothing was measured"):
        search.fit(X, Y * np.nan)
    with pytest.raises(ValueError, match="Input 'e' contains NaN in all rows"):
        search.fit(X.assign(e=np.nan), Y)
    with pytest.raises(ValueError, match=r"No run is left.*run 1 \('e'\), run 2 \('u'\)"):
        search.fit(X.assign(e=X["e"].where(GONE)), NO_Y[1])
