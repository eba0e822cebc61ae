"""RecursiveARX.partial_fit: any cut of a stream gives the same bits; scikit-learn's contracts."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.recursion_twin import THETA0, changing_runs, recursive
from support.synthetic import DT, arx_runs

N = 300
X, Y = changing_runs(N)
ARRAYS = (X.to_numpy(), Y.to_numpy())
FORGETTING = {
    "number": {"forgetting": 0.97},
    "matrix": {"forgetting": (1.0, 1.0, 0.97, 0.95)},
    "diagonal": {"forgetting": (1.0, 1.0, 0.97, 0.95), "forgetting_form": "diagonal"},
    "none": {},
    "variable": {"forgetting": "variable", "memory_horizon": 50},
}
COMPILED = ("matrix", "diagonal")  # for long
each_forgetting = pytest.mark.parametrize(
    "params",
    [
        pytest.param(params, id=name, marks=[pytest.mark.slow] * (name in COMPILED))
        for name, params in FORGETTING.items()
    ],
)
cut_places = st.lists(st.integers(1, N - 1), unique=True, max_size=8).map(sorted)

pytestmark = pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")


def stream(model, X, y, cuts, between=lambda model: model):
    for begin, end in pairwise([0, *cuts, len(y)]):
        model = between(model)
        model.partial_fit(X[begin:end], y[begin:end])
    return model


def assert_same_bits(one, other):
    for name in ("coef_", "covariance_", "standard_errors_", "a_"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(np.hstack(one.b_), np.hstack(other.b_))
    for name in ("noise_variance_", "n_updates_", "n_held_", "dt_", "intercept_"):
        assert getattr(one, name) == getattr(other, name), name


# Cuts


@each_forgetting
@settings(max_examples=4, deadline=None)
@given(cuts=cut_places)
def test_any_cut_of_arrays(params, cuts):
    whole = recursive(**params).fit(*ARRAYS)
    assert_same_bits(stream(recursive(**params), *ARRAYS, cuts), whole)


def test_one_row_at_a_time():
    params = FORGETTING["number"]
    whole = recursive(**params, dt=DT).fit(X, Y)
    bare = stream(recursive(**params, dt=DT), *ARRAYS, range(1, N))
    assert_same_bits(bare, whole)


# Start


@pytest.mark.parametrize("start", [{"init": "ols"}, {"init": "zeros"}, {"init": THETA0}])
@settings(max_examples=3, deadline=None)
@given(cuts=cut_places)
def test_buffers_until_the_initial_window_is_full(start, cuts):
    params = {**start, "p0": None, "init_window": 1.0, "dt": DT}
    whole = recursive(forgetting=0.97, **params).fit(*ARRAYS)
    model = stream(recursive(forgetting=0.97, **params), *ARRAYS, cuts)
    assert_same_bits(model, whole)
    given_start = recursive(
        forgetting=0.97, init=whole.initial_coef_, p0=whole.initial_covariance_, dt=DT
    ).fit(*ARRAYS)
    assert_same_bits(model, given_start)


# Runs and gaps


RUNS_X, RUNS_Y = arx_runs(lengths=[120, 90, 100], seed=5)
BORDERS = [120, 210]


def test_new_run_said_by_the_caller():
    inputs, output = RUNS_X.to_numpy(), RUNS_Y.to_numpy()
    by_index = recursive(forgetting=0.97, inputs=["e"]).partial_fit(RUNS_X, RUNS_Y)
    by_word = recursive(forgetting=0.97, inputs=[0], dt=DT)
    for begin, end in pairwise([0, *BORDERS, 310]):
        by_word.partial_fit(inputs[begin:end], output[begin:end], new_run=True)
    assert_same_bits(by_word, by_index)
    one_by_one = recursive(forgetting=0.97, inputs=[0], dt=DT)
    for row in range(310):
        one_by_one.partial_fit(
            inputs[row : row + 1], output[row : row + 1], new_run=row in (0, *BORDERS)
        )
    assert_same_bits(one_by_one, by_index)
    unsaid = stream(recursive(forgetting=0.97, inputs=[0], dt=DT), inputs, output, BORDERS)
    assert unsaid.n_updates_ == by_index.n_updates_ + 2 * 4
    assert (unsaid.coef_ != by_index.coef_).any()


# What is fitted


def test_a_stream_keeps_no_path():
    model = recursive(forgetting=0.97, dt=DT).fit(X, Y)
    assert hasattr(model, "coef_path_")
    model.partial_fit(X[:100], Y[:100], new_run=True)
    assert not hasattr(model, "coef_path_")
    last = recursive(forgetting=0.97, parameters="last", dt=DT).fit(X, Y)
    streamed = recursive(forgetting=0.97, dt=DT).partial_fit(X, Y)
    np.testing.assert_array_equal(streamed.predict(X), last.predict(X))
    assert streamed.score(X, Y) == last.score(X, Y)
    np.testing.assert_array_equal(streamed.predict_ahead(X, Y), last.predict_ahead(X, Y))


def test_resets_follow_the_time_of_the_run():
    whole = recursive(forgetting=0.97, reset_times=[1.0, 2.0]).fit(X, Y)
    for cuts in ([70, 71, 200], [100, 101, 200]):
        model = recursive(forgetting=0.97, reset_times=[1.0, 2.0], dt=DT)
        assert_same_bits(stream(model, X, Y, cuts), whole)
