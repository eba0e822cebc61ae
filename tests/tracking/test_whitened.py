"""What both recursions beside autoregressive noise have to bear, and where they end."""

from itertools import pairwise

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from support.whitened_runs import DT, NK, THETA, arrays_of, whitened_runs

from skhoid import (
    RecursiveBoxJenkins,
    RecursiveIV,
    RunIndexError,
    ShortRunError,
)

SMALL = {"nk": NK, "noise_order": 2, "memory_time": 10.0, "init_window": 20.0}
MODELS = {
    "box jenkins": RecursiveBoxJenkins(inputs=["e"], **SMALL),
    "instruments": RecursiveIV(inputs=["e"], **SMALL),
}
each = pytest.mark.parametrize("name", MODELS)
SPIKE = 1000  # row of outliers


def model(name, **options):
    return clone(MODELS[name]).set_params(**options)


def by_position(name, **options):
    given = {"inputs": [0], "dt": DT}
    if name == "instruments":
        given["instruments"] = [1]
    return model(name, **given, **options)


@pytest.fixture(scope="module")
def run():
    return whitened_runs(1, 3000)


# The same data in other clothes


@each
@pytest.mark.parametrize(("of_X", "of_y"), [(1e-3, 1), (57.3, 1e3)])
def test_units(name, run, of_X, of_y):
    X, y = run
    scale = np.array([1, 1, of_y / of_X, of_y / of_X])
    one, other = model(name).fit(X, y), model(name).fit(X * of_X, y * of_y)
    np.testing.assert_allclose(other.coef_path_ / scale, one.coef_path_, rtol=1e-6)
    np.testing.assert_allclose(other.standard_errors_ / scale, one.standard_errors_, rtol=1e-6)
    assert other.noise_variance_ / one.noise_variance_ == pytest.approx(of_y**2, rel=1e-6)


# What is found


@each
def test_the_truth_beside_noise(name, run):
    found = model(name, memory_time=None).fit(*run)
    z = (found.coef_ - THETA) / found.standard_errors_
    assert np.abs(z).max() < 4
    np.testing.assert_allclose(found.noise_ar_, [-0.8, 0.0], atol=0.1)
    assert found.noise_variance_ == pytest.approx(0.1**2, rel=0.15)


# Hostile signals


@each
def test_a_rest_before_the_task_is_borne(name):
    X, y = whitened_runs(1, 3000)
    A = np.concatenate([np.zeros((350, 2)), X])
    u = np.concatenate([np.zeros(350), y])
    found = by_position(name).fit(A, u)
    np.testing.assert_allclose(found.coef_, THETA, atol=0.1)


@each
def test_scattered_nan_say_what_to_do(name, run):
    """One missing row every two seconds leaves no stretch in which a simulation settles."""
    X, y = run[0], run[1].copy()
    y.iloc[::40] = np.nan
    with pytest.raises(ShortRunError, match="stretches longer than"):
        model(name).fit(X, y)


# As a part of scikit-learn


@each
def test_wrong_options(name, run):
    for options, message in [
        ({"noise_order": 51}, "noise_order"),
        ({"memory_time": 0.01}, "longer than one sample"),
        ({"init_window": 0.0}, "init_window"),
        ({"nb": [1, 2]}, "nb has 2 entries for 1 inputs"),
        ({"inputs": ["missing"]}, "missing"),
    ]:
        with pytest.raises(ValueError, match=message):
            model(name, **options).fit(*run)


# Predictions


@each
def test_predictions_ahead_do_not_look_ahead(name):
    """What comes later changes the path from there on, and no prediction before."""
    horizon = 7
    X, y = whitened_runs(1, 1500)
    other = y.copy()
    other.iloc[SPIKE:] += np.random.default_rng(0).standard_normal(1500 - SPIKE) * y.std()
    fits = [model(name, memory_time=1.0).fit(X, output) for output in (y, other)]
    ahead = [fit.predict_ahead(X, y, horizon) for fit in fits]
    np.testing.assert_array_equal(ahead[0][: SPIKE + horizon], ahead[1][: SPIKE + horizon])
    assert (ahead[0][SPIKE + horizon :] != ahead[1][SPIKE + horizon :]).any()


# Streams


N, WINDOW = 900, 400
OPTIONS = {"memory_time": 5.0, "init_window": WINDOW * DT}
X, Y = whitened_runs(1, N)
A, U = arrays_of(X, Y)


def stream(fresh, inputs, output, cuts):
    for begin, end in pairwise([0, *cuts, len(output)]):
        fresh.partial_fit(inputs[begin:end], output[begin:end])
    return fresh


def assert_same_bits(found, expected):
    for name in ("coef_", "noise_ar_", "covariance_", "noise_variance_", "n_updates_", "n_held_"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@each
@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_missing_values_anywhere_in_a_stream(name):
    rng = np.random.default_rng(0)
    inputs, output = A.copy(), U.copy()
    # The first window has to have stretches in which simulations settle.
    output[(np.arange(N) > WINDOW) & (rng.random(N) < 0.1)] = np.nan
    inputs[rng.integers(WINDOW, N, 3), [0, 1, 1]] = np.nan
    inputs[0], output[1], output[300] = np.nan, np.nan, np.nan
    whole = by_position(name, **OPTIONS).fit(inputs, output)
    cut = stream(by_position(name, **OPTIONS), inputs, output, [1, 2, 399, 400, 733])
    assert_same_bits(cut, whole)


@each
def test_a_gap_within_the_first_window_of_a_stream(name):
    kept = np.r_[0:250, 255:N]
    holed = X.iloc[kept], Y.iloc[kept]
    cut = stream(model(name, dt=DT, **OPTIONS), *holed, [100, 249, 250, 251, 600])
    assert_same_bits(cut, model(name, dt=DT, **OPTIONS).fit(*holed))


@each
def test_a_new_run_is_told_by_its_label_or_by_the_option(name):
    Xs, Ys = whitened_runs(2, [600, 500], seed=4)
    told = stream(model(name, dt=DT, **OPTIONS), Xs, Ys, [600])
    values, output = arrays_of(Xs, Ys)
    found = by_position(name, **OPTIONS).partial_fit(values[:600], output[:600])
    found.partial_fit(values[600:], output[600:], new_run=True)
    assert_same_bits(found, told)


@each
@pytest.mark.parametrize("first", [200, 500])
def test_refused_rows_leave_nothing(name, first):
    found = model(name, dt=DT, **OPTIONS).partial_fit(X.iloc[:first], Y.iloc[:first])
    bad = X.iloc[first : first + 10].copy()
    bad.iloc[3, 0] = np.inf
    with pytest.raises(ValueError, match="inf"):
        found.partial_fit(bad, Y.iloc[first : first + 10])
    with pytest.raises(RunIndexError, match="goes back in time"):
        found.partial_fit(X.iloc[100:120], Y.iloc[100:120])
    found.partial_fit(X.iloc[first:], Y.iloc[first:])
    assert_same_bits(found, model(name, dt=DT, **OPTIONS).fit(X, Y))


@each
def test_there_is_no_estimate_before_the_window_is_full(name):
    found = by_position(name, **OPTIONS).partial_fit(A[: WINDOW - 1], U[: WINDOW - 1])
    with pytest.raises(NotFittedError, match=f"collected 399 rows of the {WINDOW}"):
        found.predict(A)
    found.partial_fit(A[WINDOW - 1 : WINDOW], U[WINDOW - 1 : WINDOW])
    assert found.predict(A).shape == (N,)
