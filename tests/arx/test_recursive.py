"""RecursiveARX.fit: exact against its twins, and the symmetries of the recursion."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import naive
from support.recursion_twin import (
    ORDERS,
    P0,
    THETA0,
    P,
    changing_runs,
    instants_of,
    recursive,
    sample_numbers,
)
from support.synthetic import DT, arx_runs

from skhoid import ARXRegressor, RecursiveARX, forgetting_factor

THESIS = [0.95, 1.0]

pytestmark = pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")


# Exactness


@pytest.fixture(scope="module")
def long_pool():
    X, y = arx_runs(lengths=[16_384, 5000, 1000], seed=2)
    keep = np.ones(len(X), bool)
    keep[10_000:10_050] = False  # a gap in run 1
    keep[16_384:16_800] = False  # run 2 begins later
    X, y = X[keep], y[keep].copy()
    y.iloc[1000:1300] = np.nan
    return X, y, instants_of(X, y)


def some_instants(n, n_random=60):
    random = np.random.default_rng(0).integers(0, n, n_random)
    return np.unique(np.r_[:30, np.geomspace(30, n - 1, 60).astype(int), random])


@pytest.mark.parametrize("forgetting", THESIS)
def test_exponentially_weighted_least_squares_over_many_samples(long_pool, forgetting):
    """To 1e-12 of the largest parameter, which is 1.5: the protection changes nothing."""
    X, y, instants = long_pool
    model = recursive(forgetting=forgetting).fit(X, y)
    at = some_instants(len(instants))
    exact = naive.weighted_least_squares(instants, forgetting, THETA0, P0, at)
    assert model.coef_path_.shape == (len(instants), P)
    np.testing.assert_allclose(model.coef_path_[at], exact, rtol=0, atol=1.5e-12)
    assert model.n_held_ == 0
    np.testing.assert_array_equal(model.coef_, model.coef_path_[-1])
    np.testing.assert_allclose(model.time_path_, DT * np.unique(sample_numbers(X)), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["joint", "diagonal"])
@pytest.mark.parametrize("forgetting", [(0.9, 0.95, 0.97, 1.0)])
def test_forgetting_matrix_over_a_long_run(forgetting, form):
    """Without rounding of its own: the twin counts in extended precision."""
    X, y = changing_runs(2000)
    instants = instants_of(X, y)
    factors = np.broadcast_to(forgetting, (len(instants), P))
    path, *_ = naive.recursive_least_squares(instants, factors, THETA0, P0, form)
    model = recursive(forgetting=forgetting, forgetting_form=form).fit(X, y)
    np.testing.assert_allclose(model.coef_path_, path.astype(float), rtol=0, atol=3e-12)
    assert model.n_held_ == 0


# Of few numbers of parameters: each compiles its own loop.
MODELS = [
    (["e"], {"na": 2, "nb": [2], "nk": [0]}, False),
    (["x", "e"], {"na": 1, "nb": [1, 2], "nk": [2, 0]}, False),
    (["x", "e"], {"na": 0, "nb": [1, 2], "nk": [0, 2]}, True),
    (["x", "e"], {"na": 2, "nb": [1, 1], "nk": [0, 3]}, True),
]


@st.composite
def recordings(draw, models):
    """Pooled runs with different starts, gaps and missing values, and orders for them."""
    n_runs = draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = []
    for run in range(n_runs):
        n, start = draw(st.integers(14, 40)), draw(st.integers(0, 9))
        keep = np.ones(n, bool)
        if draw(st.booleans()):
            keep[9 : draw(st.integers(10, n - 1))] = False
        index = pd.MultiIndex.from_product(
            [[f"r{run}"], DT * (start + np.arange(n))], names=["run", "time"]
        )
        table = pd.DataFrame(rng.standard_normal((n, 3)), index=index, columns=["e", "x", "u"])
        parts.append(table[keep])
    table = pd.concat(parts)
    if draw(st.booleans()):
        table = table.mask(rng.random(table.shape) < 0.08)
    inputs, orders, intercept = draw(st.sampled_from(models))
    return table[["e", "x"]], table["u"], orders, inputs, intercept, rng


def forgetting_of(kind, n_instants, n_params, rng):
    """What the user gives, and the factors of every instant and parameter."""
    shape = {
        "number": (),
        "parameters": (n_params,),
        "function": (n_instants,),
        "functions": (n_instants, n_params),
    }[kind]
    values = rng.uniform(0.7, 1.0, shape)
    factors = values[:, None] if kind == "function" else values
    return values, np.broadcast_to(factors, (n_instants, n_params))


KINDS = st.sampled_from(["number", "parameters", "function", "functions"])
FORMS = st.sampled_from(["joint", "diagonal"])


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(recording=recordings(MODELS), kind=KINDS, form=FORMS)
def test_any_runs_any_forgetting(recording, kind, form):
    X, y, orders, inputs, intercept, rng = recording
    instants = instants_of(X, y, **orders, inputs=inputs, intercept=intercept)
    n_params = orders["na"] + sum(orders["nb"]) + intercept
    given_forgetting, factors = forgetting_of(kind, len(instants), n_params, rng)
    numbers = np.unique(sample_numbers(X))
    if kind.startswith("function"):
        table = given_forgetting

        def given_forgetting(time):
            return table[np.searchsorted(numbers, np.rint(time / DT))]

    theta0 = rng.standard_normal(n_params)
    root = rng.standard_normal((n_params, n_params))
    p0 = root @ root.T + np.eye(n_params)
    model = RecursiveARX(
        **orders, inputs=inputs, fit_intercept=intercept, forgetting=given_forgetting,
        forgetting_form=form, init=theta0, p0=p0, store_covariance=True,
    ).fit(X, y)  # fmt: skip
    path, _, _, errors = naive.recursive_least_squares(instants, factors, theta0, p0, form)
    assert model.coef_path_.shape == path.shape
    np.testing.assert_allclose(
        model.coef_path_, path.astype(float), rtol=1e-9, atol=1e-9 * np.abs(path).max()
    )
    np.testing.assert_allclose(model.time_path_, DT * numbers, atol=1e-9)
    assert model.n_updates_ == len(errors)
    expected = np.full(len(X), np.nan)
    for row, (error, _) in errors.items():
        expected[row] = error
    scale = np.nanmax(np.abs(expected), initial=1.0)
    np.testing.assert_allclose(model.one_step_errors_, expected, rtol=1e-8, atol=1e-9 * scale)
    variance = np.mean([error**2 / alpha for error, alpha in errors.values()])
    assert model.noise_variance_ == pytest.approx(float(variance), rel=1e-8)
    np.testing.assert_array_equal(model.initial_coef_, theta0)
    np.testing.assert_allclose(model.initial_covariance_, p0, rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(model.coef_, model.coef_path_[-1])
    np.testing.assert_allclose(model.covariance_, model.covariance_path_[-1], rtol=1e-12)
    np.testing.assert_allclose(model.standard_errors_**2, np.diag(model.covariance_), rtol=1e-12)
    assert len(model.parameter_names_) == n_params
    a, b = model.a_, np.concatenate(model.b_) if len(inputs) > 1 else model.b_
    intercepts = [model.intercept_] if intercept else []
    np.testing.assert_array_equal(np.concatenate([a, b, intercepts]), model.coef_)


@pytest.mark.parametrize("forgetting", [0.97, 1.0])
def test_reset_times(forgetting):
    X, y = changing_runs(800)
    instants = instants_of(X, y)
    path, *_ = naive.recursive_least_squares(instants, forgetting, THETA0, P0, resets=[250, 400])
    model = recursive(forgetting=forgetting, reset_times=[2.5, 4.0]).fit(X, y)
    np.testing.assert_allclose(model.coef_path_, path.astype(float), rtol=0, atol=1e-11)


# What is given in other words


@pytest.mark.parametrize("horizon", [20, [np.inf, np.inf, 50, 20]])
def test_memory_horizon_and_time(horizon):
    X, y = arx_runs(1, 300)
    factor = forgetting_factor(horizon)
    expected = recursive(forgetting=factor).fit(X, y)
    by_horizon = recursive(memory_horizon=horizon).fit(X, y)
    by_time = recursive(memory_time=np.multiply(DT, horizon)).fit(X, y)
    for model in (by_horizon, by_time):
        np.testing.assert_allclose(model.coef_path_, expected.coef_path_, rtol=1e-11)
        np.testing.assert_allclose(model.forgetting_, factor, rtol=1e-14)
        np.testing.assert_allclose(model.memory_horizon_, horizon, rtol=1e-10)


@pytest.mark.parametrize("n_runs", [1, 3])
def test_initial_estimate_is_least_squares_of_the_first_seconds(n_runs):
    X, y = arx_runs(n_runs, 800)
    time = X.index.get_level_values("time")
    for window, n in ((2.0, 200), (30.72, 800)):
        first = time < n * DT - DT / 2
        batch = ARXRegressor(**ORDERS).fit(X[first], y[first])
        model = RecursiveARX(**ORDERS, forgetting=0.99, init_window=window).fit(X, y)
        np.testing.assert_allclose(model.initial_coef_, batch.coef_, rtol=1e-9)
    zeros = recursive(init="zeros").fit(X, y)
    np.testing.assert_array_equal(zeros.initial_coef_, np.zeros(P))
    np.testing.assert_array_equal(zeros.coef_path_[:4], np.zeros((4, P)))


def test_initial_covariance():
    X, y = arx_runs(2, 400)
    for p0, expected in (
        (7.0, 7.0 * np.eye(P)),
        ([1.0, 2.0, 3.0, 4.0], np.diag([1.0, 2.0, 3.0, 4.0])),
        (P0, P0),
    ):
        model = recursive(p0=p0).fit(X, y)
        np.testing.assert_allclose(model.initial_covariance_, expected, rtol=1e-14, atol=1e-14)
    found = recursive(p0=None, init_window=1.0).fit(X, y).initial_covariance_
    np.testing.assert_array_equal(found, np.diag(np.diag(found)))
    phi = np.array([vector for found in instants_of(X, y)[:100] for _, vector, _ in found])
    products = np.diag(found) * np.mean(phi**2, axis=0)
    np.testing.assert_allclose(products, products[0], rtol=1e-10)


# Symmetries


@settings(max_examples=4, deadline=None)
@given(at=st.integers(50, 250))
def test_the_path_is_causal(at):
    X, y = arx_runs(1, 300)
    whole, part = recursive(forgetting=0.97), recursive(forgetting=0.97)
    whole.fit(X, y)
    part.fit(X[:at], y[:at])
    np.testing.assert_array_equal(whole.coef_path_[:at], part.coef_path_)


def test_a_missing_measurement_neither_updates_nor_forgets():
    X, y = arx_runs(1, 300)
    holed = y.copy()
    holed.iloc[100:200] = np.nan
    whole = recursive(forgetting=0.9).fit(X[:100], y[:100])
    model = recursive(forgetting=0.9, store_covariance=True).fit(X, holed)
    np.testing.assert_array_equal(model.coef_path_[99:202], np.tile(whole.coef_, (103, 1)))
    # The last lag is back at row 202.
    after = recursive(forgetting=0.9, init=whole.coef_, p0=_unscaled(whole))
    after.fit(X[198:], holed[198:])
    np.testing.assert_allclose(model.coef_, after.coef_, rtol=1e-9)


def _unscaled(model):
    """P of a model of constant lambda."""
    lam, n = model.forgetting_, model.n_updates_
    return model.covariance_ * (1 + lam) / (1 + lam**n) / model.noise_variance_


# Several runs, one recursion each


def test_average_estimates_is_the_mean_of_single_fits():
    X, y = arx_runs(lengths=[200, 150, 180], seed=3)
    together = recursive(forgetting=0.97, combine="average_estimates").fit(X, y)
    singles = [recursive(forgetting=0.97).fit(X.loc[[r]], y.loc[[r]]) for r in (1, 2, 3)]
    expected = np.full((3, 200, P), np.nan)
    for path, single in zip(expected, singles, strict=True):
        path[: len(single.coef_path_)] = single.coef_path_
    np.testing.assert_allclose(together.coef_paths_, expected, rtol=1e-12)
    np.testing.assert_allclose(together.coef_path_, np.nanmean(expected, axis=0), rtol=1e-12)
    assert list(together.run_labels_) == [1, 2, 3]
    errors = np.concatenate([single.one_step_errors_ for single in singles])
    np.testing.assert_allclose(together.one_step_errors_, errors, rtol=1e-10, atol=1e-13)


# Smoothing, and forgetting that suits the problem


@pytest.mark.parametrize("forgetting", [0.97, 1.0, "over time"])
@pytest.mark.parametrize("n_runs", [1, 2])
def test_smoothing(forgetting, n_runs):
    X, y = changing_runs(400, n_runs)
    y.iloc[100:110] = np.nan
    instants = instants_of(X, y)
    factors = np.reshape(forgetting if forgetting != "over time" else 1.0, (-1, 1))
    if forgetting == "over time":
        factors = np.random.default_rng(0).uniform(0.9, 1.0, (len(instants), 1))

        def forgetting(time):
            return factors

    paths = naive.recursive_least_squares(instants, factors, THETA0, P0, "joint")[:3]
    smoothed, covariance = naive.smooth_path(*paths)
    model = recursive(forgetting=forgetting, smooth=True, store_covariance=True).fit(X, y)
    np.testing.assert_allclose(model.coef_path_, smoothed, rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.coef_, model.coef_path_[-1], rtol=1e-14)
    np.testing.assert_allclose(
        model.covariance_path_, model.noise_variance_ * covariance, rtol=1e-6, atol=1e-12
    )


def test_variable_forgetting():
    X, y = changing_runs(1500)
    instants = instants_of(X, y)
    path, factors = naive.variable_forgetting(instants, 100, THETA0, P0)
    model = recursive(forgetting="variable", memory_horizon=100).fit(X, y)
    np.testing.assert_allclose(model.coef_path_, path, rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.forgetting_, factors, rtol=1e-9)
    assert factors[745:775].min() < 0.9 < np.median(factors)  # the step at 750 is noticed
