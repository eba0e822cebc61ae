"""Every estimator on every frame: a whole result, or an error that helps."""

import pickle
from copy import deepcopy

import numpy as np
import pandas as pd
from hypothesis import assume
from hypothesis import strategies as st
from sklearn.base import clone
from support.drawn_models import GOOD, REGRESSORS, SEARCHES, TRANSFORMERS, models
from support.fuzzing import fuzz, outcome
from support.hostile import good, recordings

import skhoid
from skhoid import ARXRegressor, RecursiveARX

LONG = st.sampled_from([60, 100, 150])


def check_untouched(recording, copies):
    """No call changes what it is given."""
    for given, copy in zip((recording.X, recording.y), copies, strict=True):
        if isinstance(given, pd.DataFrame):
            pd.testing.assert_frame_equal(given, copy, check_exact=True)
        elif isinstance(given, pd.Series):
            pd.testing.assert_series_equal(given, copy, check_exact=True)
        else:
            np.testing.assert_equal(np.asarray(given).tolist(), np.asarray(copy).tolist())


def check_fitted(model, X):
    """A fit has no NaN in it, and predicts one number a row, each time the same."""
    if hasattr(model, "coef_"):
        assert np.isfinite(model.coef_).all()
    predicted, error = outcome(model.predict, X)
    assert error is None, error
    assert predicted.shape == (len(X),)
    assert np.isfinite(predicted).all()
    again, _ = outcome(pickle.loads(pickle.dumps(model)).predict, X)
    np.testing.assert_array_equal(again, predicted)
    return predicted


@fuzz(recording=recordings(), model=models(*REGRESSORS), data=st.data())
def test_regressor(recording, model, data):
    X, y = recording.X, recording.y
    before = deepcopy((X, y))
    fitted, error = outcome(model.fit, X, y)
    check_untouched(recording, before)
    if error is not None:
        return
    assert fitted is model
    predicted = check_fitted(model, X)
    twin, error = outcome(clone(model).fit, X, y)
    assert error is None, error
    np.testing.assert_array_equal(outcome(twin.predict, X)[0], predicted)
    outcome(model.score, X, y)
    options = GOOD[type(model)]
    name = data.draw(st.sampled_from(sorted(options)))
    model.set_params(**{name: data.draw(st.sampled_from(options[name]))})
    np.testing.assert_array_equal(outcome(model.predict, X)[0], predicted)


@fuzz(batch=20, recording=recordings(), search=models(*SEARCHES))
def test_search(recording, search):
    X, y = recording.X, recording.y
    before = deepcopy((X, y))
    _, error = outcome(search.fit, X, y)
    check_untouched(recording, before)
    if error is None:
        check_fitted(search, X)


@fuzz(recording=recordings(), transformer=models(*TRANSFORMERS))
def test_transformer(recording, transformer):
    X, y = recording.X, recording.y
    before = deepcopy((X, y))
    Z, error = outcome(transformer.fit_transform, X, y)
    check_untouched(recording, before)
    if error is not None:
        return
    assert len(Z) == len(X)
    fitted, error = outcome(skhoid.ARXRegressor().fit, Z, y)
    if error is None:
        predicted, error = outcome(fitted.predict, Z)
        assert error is None, error
        assert np.shape(predicted) == (len(X),)


FUNCTIONS = {
    "sampling_time": lambda X, y: skhoid.sampling_time(X),
    "run_labels": lambda X, y: skhoid.run_labels(X),
    "check_channels": skhoid.check_channels,
    "lost_control": lambda X, y: skhoid.lost_control(X),
    "resample_runs": skhoid.resample_runs,
    "select_runs": lambda X, y: skhoid.select_runs(X, y, last=1),
    "vaf_score": lambda X, y: skhoid.vaf_score(y, y),
    "performance_scores": skhoid.performance_scores,
}


@fuzz(recording=recordings(), name=st.sampled_from(sorted(FUNCTIONS)))
def test_function(recording, name):
    X, y = recording.X, recording.y
    before = deepcopy((X, y))
    found, error = outcome(FUNCTIONS[name], X, y)
    check_untouched(recording, before)
    if error is not None:
        return
    if name == "sampling_time":
        assert 0 < found < np.inf
    elif name == "run_labels":
        assert len(found) == len(X)
    elif name == "select_runs" and y is not None:
        assert len(found[0]) == len(found[1]) <= len(X)
    elif name == "vaf_score":
        assert np.isfinite(found)


SYMMETRIC = [ARXRegressor(), ARXRegressor(1, 1, 1), RecursiveARX(inputs=[0], memory_horizon=32)]


@fuzz(recording=good(min_runs=2, lengths=LONG), model=st.sampled_from(SYMMETRIC), data=st.data())
def test_order_of_runs_time_and_units(recording, model, data):
    X, y = recording.X, recording.y
    assume(y.std() > 0)
    fitted, error = outcome(clone(model).fit, X, y)
    if error is not None:
        return
    predicted = fitted.predict(X)
    runs = data.draw(st.permutations(list(X.index.unique("run"))))
    shuffled = pd.concat({run: X.loc[run] for run in runs}, names=["run"])
    other, error = outcome(clone(model).fit, shuffled, y.loc[runs].set_axis(shuffled.index))
    assert error is None, error
    np.testing.assert_allclose(other.coef_, fitted.coef_, rtol=1e-6, atol=1e-8)

    some = runs[: data.draw(st.integers(1, len(runs)))]
    rows = X.index.isin(some, level="run")
    np.testing.assert_array_equal(outcome(fitted.predict, X[rows])[0], predicted[rows])

    units = 2.0 ** data.draw(st.integers(-100, 100))
    other, error = outcome(clone(model).fit, X * units, y * units)
    assert error is None, error
    np.testing.assert_array_equal(other.coef_, fitted.coef_)
    np.testing.assert_array_equal(other.predict(X * units), predicted * units)

    time = X.index.get_level_values("time") + data.draw(st.integers(-10, 1000))
    late = pd.MultiIndex.from_arrays([X.index.get_level_values("run"), time], names=["run", "time"])
    other, error = outcome(clone(model).fit, X.set_axis(late), y.set_axis(late))
    assert error is None, error
    np.testing.assert_allclose(other.coef_, fitted.coef_, rtol=1e-6, atol=1e-8)


@fuzz(recording=good(lengths=LONG, channels=st.just(["e"])), data=st.data())
def test_cuts_of_a_stream(recording, data):
    X, y = recording.X, recording.y
    first = X.index[0][0]
    X, y = X.loc[[first]], y.loc[[first]].copy()
    dt = skhoid.sampling_time(X)
    missing = data.draw(st.lists(st.integers(0, len(X) - 1), max_size=5))
    y.iloc[missing] = np.nan
    gap = data.draw(st.lists(st.integers(1, len(X) - 1), max_size=3, unique=True))
    X, y = X.drop(X.index[gap]), y.drop(y.index[gap])
    model = RecursiveARX(
        nk=data.draw(st.integers(0, 3)),
        memory_horizon=data.draw(st.sampled_from([None, 4, 64])),
        init="zeros",
        p0=data.draw(st.sampled_from([1.0, 1e4])),
        dt=dt,  # the first part of a stream may have a gap, or one row
    )
    whole, error = outcome(clone(model).fit, X, y)
    if error is not None:
        return
    cuts = sorted(data.draw(st.lists(st.integers(1, len(X) - 1), max_size=10, unique=True)))
    stream = clone(model)
    for part in np.split(np.arange(len(X)), cuts):
        _, error = outcome(stream.partial_fit, X.iloc[part], y.iloc[part])
        assert error is None, error
    np.testing.assert_array_equal(stream.coef_, whole.coef_)
