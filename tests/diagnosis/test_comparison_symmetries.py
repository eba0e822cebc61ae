"""``compare`` under changes that must not matter, and with models of all kinds."""

import re

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support.comparison import DT, NK, Gives, runs, vaf
from support.hidden_effects import LinearTruth, Oracle

from skhoid import (
    ARXRegressor,
    Decimator,
    RunInTrimmer,
    VAFScorer,
    compare,
)

pytestmark = pytest.mark.slow

# What must not matter


def points(comparison):
    return [
        comparison.vaf,
        comparison.noise_ceiling,
        *comparison.noise_ceiling_interval,
        comparison.explainable_gap,
    ]


def p_of_tests(comparison, without=()):
    tests = comparison.tests[~comparison.tests["test"].isin(without)]
    return tests.set_index(["test", "signal"])["p"].sort_index()


@pytest.fixture(scope="module")
def of_truth(simulated):
    X, y, truth = simulated
    return compare(LinearTruth(truth.linear_response, 0.9), X, y)


def assert_same(found, expected, without=()):
    assert_allclose(points(found), points(expected), rtol=1e-7, atol=1e-7)
    a, b = p_of_tests(found, without), p_of_tests(expected, without)
    pd.testing.assert_series_equal(a, b, rtol=1e-5, atol=1e-12)


def test_unit_of_the_output(of_truth, simulated):
    X, y, truth = simulated
    found = compare(LinearTruth(-3.0 * truth.linear_response, 0.9), X, -3.0 * y)
    assert_same(found, of_truth)
    assert_allclose(found.rmse, 3.0 * of_truth.rmse)
    for column in ("share", "p"):
        assert_allclose(found.by_frequency[column], of_truth.by_frequency[column], rtol=1e-6)


def test_origin_of_time(of_truth, simulated):
    X, y, truth = simulated

    def later(table):
        frame = table.index.to_frame(index=False)
        frame["time"] += 500.0
        return table.set_axis(pd.MultiIndex.from_frame(frame))

    model = LinearTruth(later(truth.linear_response), 0.9)
    found = compare(model, later(X), later(y))
    assert_same(found, of_truth)
    assert_allclose(found.by_time["start"], of_truth.by_time["start"] + 500.0)
    assert_allclose(found.time_frequency.index, of_truth.time_frequency.index + 500.0)
    of_time = ["gain change", "remnant power change", "mean change", "outlier"]
    where = [c.tests.set_index("test").loc[of_time, "where"] for c in (found, of_truth)]
    assert_allclose(where[0], where[1] + 500.0)


def test_arrays(simulated):
    X, y, _ = simulated
    X = X.reset_index(level="run")[["run", "e", "x", "f_t"]].set_axis(X.index)
    table = compare(Gives(lambda rows: 0.3 * rows["e"]), X.drop(columns="run"), y)
    array = compare(
        Gives(lambda rows: 0.3 * rows[:, 1]),
        X.to_numpy(),
        y.to_numpy(),
        run=0,
        dt=DT,
        roles={1: "e", 2: "x", 3: "f_t"},
    )
    # Labels of runs are those of an array of floats there.
    assert_same(array, table, without=("outlying run", "outlier", "lost control"))
    assert_allclose(array.by_time["start"], table.by_time["start"], atol=1e-9)


@pytest.mark.parametrize(
    ("repeats", "target", "route"),
    [
        (False, [0, 1, 2], "lines"),
        ({1: "a", 2: "a"}, [0, 0, 1], "repeats"),
        (["a", "b", "a"], [0, 1, 0], "repeats"),
    ],
)
def test_repeats_that_split_the_runs(simulated, repeats, target, route):
    X, y, truth = simulated
    comparison = compare(Oracle(truth.u_without_remnant), X, y, repeats=repeats)
    assert comparison.by_run["target"].tolist() == target
    assert comparison.ceiling_route == route


# Models


def lags(X):
    """The error at a few earlier instants of the same run."""
    return np.column_stack(
        [X.groupby(level="run")["e"].shift(k).fillna(0.0) for k in range(6, 20, 2)]
    )


class OnLags(Gives):
    def fit(self, X, y=None):
        self.function.fit(lags(X), y)
        return self

    def predict(self, X):
        return self.function.predict(lags(X))


@pytest.mark.parametrize(
    "model",
    [
        make_pipeline(Decimator(2), ARXRegressor(nk=4)),
        make_pipeline(RunInTrimmer(4.0), ARXRegressor(nk=NK)),
        OnLags(LinearRegression()),
        GridSearchCV(
            ARXRegressor(), {"nk": [7, 8]}, cv=LeaveOneGroupOut(), scoring=VAFScorer(), refit=True
        ),
    ],
    ids=lambda model: type(model).__name__,
)
def test_models(model, simulated):
    X, y, _ = simulated
    X_fit, y_fit, _ = runs(2, seed=100, first_run=11)
    options = {"groups": X_fit.index.get_level_values("run")} if "cv" in vars(model) else {}
    model.fit(X_fit, y_fit, **options)
    comparison = compare(model, X, y, estimation=(X_fit, y_fit))
    traces = comparison.traces[comparison.traces["scored"]]
    assert_allclose(comparison.vaf, vaf(traces["measured"], traces["predicted"]), rtol=1e-12)
    assert_allclose(comparison.traces["predicted"], model.predict(X))
    assert comparison.vaf < comparison.noise_ceiling + 1
    assert comparison.findings
    assert not re.search(r"\bnan\b", " ".join(map(str, comparison.findings)))
    if isinstance(model, RunInTrimmer):
        late = traces.index.get_level_values("time") >= 4.0
        assert late.all()
