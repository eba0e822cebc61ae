"""Streams of the recursions that whiten: the bits of ``fit``, however they are cut."""

import pickle
import warnings
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from support.whitened_runs import DT, NK, arrays_of, whitened_runs

from skhoid import (
    MissingDataWarning,
    RecursiveBoxJenkins,
    RecursiveIV,
    RunIndexError,
)

N, WINDOW = 900, 400
OPTIONS = {"nk": NK, "noise_order": 2, "memory_time": 5.0, "init_window": WINDOW * DT}
MODELS = {
    "box jenkins": RecursiveBoxJenkins(inputs=["e"], **OPTIONS),
    "instruments": RecursiveIV(inputs=["e"], **OPTIONS),
}
each = pytest.mark.parametrize("name", MODELS)
ATTRIBUTES = ["coef_", "noise_ar_", "covariance_", "noise_variance_", "n_updates_", "n_held_"]
cut_places = st.lists(st.integers(1, N - 1), max_size=6, unique=True).map(sorted)
X, Y = whitened_runs(1, N)
A, U = arrays_of(X, Y)

pytestmark = [pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning"), pytest.mark.slow]


def of_tables(name, **options):
    return clone(MODELS[name]).set_params(**options)


def of_arrays(name, **options):
    by_position = {"inputs": [0], "dt": DT}
    if name == "instruments":
        by_position["instruments"] = [1]
    return of_tables(name, **by_position, **options)


def stream(model, inputs, output, cuts=(), between=None):
    for begin, end in pairwise([0, *cuts, len(output)]):
        part = slice(begin, end)
        if isinstance(inputs, pd.DataFrame):
            model.partial_fit(inputs.iloc[part], output.iloc[part])
        else:
            model.partial_fit(inputs[part], output[part])
        model = model if between is None else between(model)
    return model


def assert_same_bits(found, expected):
    for attribute in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(found, attribute), getattr(expected, attribute))


@each
@settings(max_examples=8, deadline=None)
@given(cuts=cut_places)
def test_any_cut_of_arrays(name, cuts):
    assert_same_bits(stream(of_arrays(name), A, U, cuts), of_arrays(name).fit(A, U))


@each
@settings(max_examples=5, deadline=None)
@given(cuts=cut_places)
def test_any_cut_of_tables(name, cuts):
    whole = of_tables(name, dt=DT).fit(X, Y)
    assert_same_bits(stream(of_tables(name, dt=DT), X, Y, cuts), whole)


@each
@settings(max_examples=8, deadline=None)
@given(cuts=cut_places, seed=st.integers(0, 2**16))
def test_missing_values_anywhere(name, cuts, seed):
    rng = np.random.default_rng(seed)
    inputs, output = A.copy(), U.copy()
    # The first window has to have stretches in which simulations settle.
    late = np.arange(N) > WINDOW
    output[late & (rng.random(N) < 0.1)] = np.nan
    at = rng.integers(WINDOW, N, 3)
    inputs[at, rng.integers(0, 2, 3)] = np.nan
    inputs[0], output[1], output[300] = np.nan, np.nan, np.nan
    whole = of_arrays(name).fit(inputs, output)
    assert_same_bits(stream(of_arrays(name), inputs, output, cuts), whole)


@each
@pytest.mark.parametrize("gap", [(500, 560), (850, 899)])
@settings(max_examples=5, deadline=None)
@given(cuts=cut_places)
def test_gaps(name, gap, cuts):
    kept = np.ones(N, dtype=bool)
    kept[slice(*gap)] = False
    holed = X[kept], Y[kept]
    cuts = [c for c in cuts if c < kept.sum()]
    whole = of_tables(name, dt=DT).fit(*holed)
    assert whole.n_updates_ < of_tables(name, dt=DT).fit(X, Y).n_updates_
    assert_same_bits(stream(of_tables(name, dt=DT), *holed, cuts), whole)


@each
def test_one_row_at_a_time(name):
    whole = of_arrays(name).fit(A, U)
    assert_same_bits(stream(of_arrays(name), A, U, range(1, N)), whole)


@each
def test_a_gap_within_the_first_window(name):
    kept = np.ones(N, dtype=bool)
    kept[250:255] = False
    holed = X[kept], Y[kept]
    whole = of_tables(name, dt=DT).fit(*holed)
    assert_same_bits(stream(of_tables(name, dt=DT), *holed, [100, 249, 250, 251, 600]), whole)


@each
@pytest.mark.parametrize("first", [WINDOW, 600, N - 1])
def test_after_a_fit_of_one_run(name, first):
    model = of_arrays(name).fit(A[:first], U[:first])
    model.partial_fit(A[first:], U[first:])
    assert_same_bits(model, of_arrays(name).fit(A, U))
    assert not hasattr(model, "coef_path_")
    assert not hasattr(model, "one_step_errors_")


@each
def test_after_a_fit_of_one_run_a_gap_is_seen(name):
    model = of_tables(name, dt=DT).fit(X.iloc[:600], Y.iloc[:600])
    model.partial_fit(X.iloc[650:], Y.iloc[650:])
    kept = np.r_[0:600, 650:N]
    assert_same_bits(model, of_tables(name, dt=DT).fit(X.iloc[kept], Y.iloc[kept]))


@each
def test_a_new_run_is_told_by_its_label_or_by_the_option(name):
    Xs, Ys = whitened_runs(2, [600, 500], seed=4)
    told = stream(of_tables(name, dt=DT), Xs, Ys, [600])
    uncut = stream(of_tables(name, dt=DT), Xs, Ys)
    assert_same_bits(told, uncut)
    values, output = arrays_of(Xs, Ys)
    model = of_arrays(name).partial_fit(values[:600], output[:600])
    model.partial_fit(values[600:], output[600:], new_run=True)
    assert_same_bits(model, told)
    on = stream(of_arrays(name), values, output, [600])
    assert on.n_updates_ > told.n_updates_  # it takes the rows for one run


@each
def test_pickled_in_between(name):
    def again(model):
        return pickle.loads(pickle.dumps(model))

    cuts = [100, 399, 400, 401, 800]
    assert_same_bits(stream(of_arrays(name), A, U, cuts, again), of_arrays(name).fit(A, U))


@each
def test_there_is_no_estimate_before_the_window_is_full(name):
    model = of_arrays(name).partial_fit(A[: WINDOW - 1], U[: WINDOW - 1])
    with pytest.raises(NotFittedError, match=f"collected 399 rows of the {WINDOW}"):
        model.predict(A)
    model.partial_fit(A[WINDOW - 1 : WINDOW], U[WINDOW - 1 : WINDOW])
    assert model.predict(A).shape == (N,)


@each
@pytest.mark.parametrize("fitted", [False, True])
def test_refused_rows_leave_nothing(name, fitted):
    model = of_tables(name, dt=DT)
    first = 500 if fitted else 200
    model.partial_fit(X.iloc[:first], Y.iloc[:first])
    bad = X.iloc[first : first + 10].copy()
    bad.iloc[3, 0] = np.inf
    with pytest.raises(ValueError, match="inf"):
        model.partial_fit(bad, Y.iloc[first : first + 10])
    with pytest.raises(RunIndexError, match="goes back in time"):
        model.partial_fit(X.iloc[100:120], Y.iloc[100:120])
    with pytest.raises(ValueError, match=r"inconsistent|rows"):
        model.partial_fit(X.iloc[first : first + 10], Y.iloc[first : first + 9].to_numpy())
    model.partial_fit(X.iloc[first:], Y.iloc[first:])
    assert_same_bits(model, of_tables(name, dt=DT).fit(X, Y))


@each
def test_after_a_fit_of_several_runs_a_stream_begins_anew(name):
    model = of_tables(name, dt=DT).fit(*whitened_runs(2, 600, seed=2))
    model.partial_fit(X, Y)
    assert_same_bits(model, of_tables(name, dt=DT).fit(X, Y))


@each
def test_nothing_measured_for_a_while(name):
    """NaN for half of the stream: nothing moves, and nothing is forgotten."""
    output = U.copy()
    output[450:700] = np.nan
    model = of_arrays(name).partial_fit(A[:450], output[:450])
    coef, covariance, held = model.coef_, model.covariance_, model.n_held_
    with warnings.catch_warnings():
        warnings.simplefilter("error", MissingDataWarning)  # a stream does not tell
        model.partial_fit(A[450:700], output[450:700])
    np.testing.assert_array_equal(model.coef_, coef)
    np.testing.assert_array_equal(model.covariance_, covariance)
    assert model.n_held_ == held + 250
    model.partial_fit(A[700:], output[700:])
    assert (model.coef_ != coef).any()
