"""What both recursions beside autoregressive noise have to bear, and where they end."""

import numpy as np
import pytest
from sklearn.base import clone
from support.whitened_runs import DT, NK, THETA, F, arrays_of, whitened_runs

from skhoid import (
    RecursiveBoxJenkins,
    RecursiveIV,
    ShortRunError,
)

pytestmark = pytest.mark.slow  # compiles for many seconds

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


@pytest.fixture(scope="module")
def runs():
    return whitened_runs(3, [1500, 1400, 1450], seed=7)


# The same data in other clothes


@each
def test_arrays_are_tables(name, run):
    found = by_position(name).fit(*arrays_of(*run))
    expected = model(name).fit(*run)
    np.testing.assert_array_equal(found.coef_path_, expected.coef_path_)
    np.testing.assert_array_equal(found.noise_path_, expected.noise_path_)


@each
def test_the_order_of_runs_does_not_matter(name, runs):
    X, y = runs
    order = [3, 1, 2]
    one, other = model(name).fit(X, y), model(name).fit(X.loc[order], y.loc[order])
    # D takes the rows of an instant in turn, so not to the last bit.
    size = np.abs(one.coef_path_).max()
    np.testing.assert_allclose(other.coef_path_, one.coef_path_, atol=2e-3 * size)
    without_noise = {"noise_order": 0}
    one, other = (
        model(name, **without_noise).fit(*data) for data in (runs, (X.loc[order], y.loc[order]))
    )
    np.testing.assert_allclose(other.coef_path_, one.coef_path_, rtol=1e-6, atol=1e-9)


@each
def test_rows_that_lack_are_rows_that_are_nan(name, runs):
    """A run that begins late, among others, has no rows before; NaN is the same."""
    X, y = runs
    late = (X.index.get_level_values("run") == 2) & (X.index.get_level_values("time") < 9.99)
    options = {"noise_order": 0, "init_window": 50.0}
    lacking = model(name, **options).fit(X[~late], y[~late])
    holed = X.copy(), y.copy()
    holed[0][late], holed[1][late] = np.nan, np.nan
    missing = model(name, **options).fit(*holed)
    assert missing.n_rows_missing_ == 200
    # A run that begins rests for 2 s, after a NaN only lags have to be known.
    assert missing.n_updates_ >= lacking.n_updates_
    np.testing.assert_allclose(missing.coef_, lacking.coef_, rtol=1e-3)


@each
@pytest.mark.parametrize(("of_X", "of_y"), [(1, 1e3), (1e-3, 1), (57.3, 57.3), (2.0**40, 1)])
def test_units(name, run, of_X, of_y):
    X, y = run
    scale = np.array([1, 1, of_y / of_X, of_y / of_X])
    one, other = model(name).fit(X, y), model(name).fit(X * of_X, y * of_y)
    np.testing.assert_allclose(other.coef_path_ / scale, one.coef_path_, rtol=1e-6)
    np.testing.assert_allclose(other.standard_errors_ / scale, one.standard_errors_, rtol=1e-6)
    assert other.noise_variance_ / one.noise_variance_ == pytest.approx(of_y**2, rel=1e-6)


# What is found


@each
@pytest.mark.parametrize(("noise_order", "within"), [(0, 1e-10), (2, 1e-5)])
def test_the_truth_without_noise(name, noise_order, within):
    """To rounding; but D of rounding errors makes prediction errors settle slowly."""
    X, y = whitened_runs(1, 3000, noise=0.0)
    found = model(name, noise_order=noise_order).fit(X, y)
    np.testing.assert_allclose(found.coef_, THETA, atol=within)


@each
def test_the_truth_beside_noise(name, run):
    found = model(name, memory_time=None).fit(*run)
    z = (found.coef_ - THETA) / found.standard_errors_
    assert np.abs(z).max() < 4
    np.testing.assert_allclose(found.noise_ar_, [-0.8, 0.0], atol=0.1)
    assert found.noise_variance_ == pytest.approx(0.1**2, rel=0.15)


@each
def test_runs_are_pooled(name, runs):
    X, y = runs
    pooled = model(name, memory_time=None).fit(X, y)
    alone = [model(name, memory_time=None).fit(X.loc[[r]], y.loc[[r]]) for r in (1, 2, 3)]
    weights = np.stack([1 / m.standard_errors_**2 for m in alone])
    mean = (weights * [m.coef_ for m in alone]).sum(axis=0) / weights.sum(axis=0)
    sd = 1 / np.sqrt(weights.sum(axis=0))
    np.testing.assert_allclose(pooled.standard_errors_, sd, rtol=0.15)
    np.testing.assert_array_less(np.abs(pooled.coef_ - mean), 1.0 * sd)


@each
def test_a_change_is_followed(name):
    parts = [whitened_runs(1, 2000, seed=s, f=f) for s, f in ((1, F), (2, (-1.5, 0.7)))]
    A = np.concatenate([X.to_numpy() for X, _ in parts])
    u = np.concatenate([y.to_numpy() for _, y in parts])
    found = by_position(name, memory_time=5.0).fit(A, u)
    np.testing.assert_allclose(found.coef_path_[1999, :2], F, atol=0.1)
    np.testing.assert_allclose(found.coef_[:2], [-1.5, 0.7], atol=0.1)


# Hostile signals


@each
def test_a_pause_is_survived_and_what_follows_is_followed(name):
    parts = [whitened_runs(1, 2000, seed=s, f=f) for s, f in ((1, F), (2, (-1.5, 0.7)))]
    rest = np.zeros((16_000, 2))
    A = np.concatenate([parts[0][0], rest, parts[1][0]])
    u = np.concatenate([parts[0][1], rest[:, 0], parts[1][1]])
    found = by_position(name, memory_time=5.0).fit(A, u)
    path = found.coef_path_
    np.testing.assert_allclose(path[1999], THETA, atol=0.1)
    assert np.abs(path[2000:18000]).max() < 1.7
    np.testing.assert_array_equal(path[2500], path[17999])  # held
    np.testing.assert_allclose(path[-1, :2], [-1.5, 0.7], atol=0.1)
    assert found.n_held_ > 15_500


@pytest.mark.parametrize("rows", [100, 350])
@each
def test_a_rest_before_the_task_is_borne(name, rows):
    X, y = whitened_runs(1, 3000)
    A = np.concatenate([np.zeros((rows, 2)), X])
    u = np.concatenate([np.zeros(rows), y])
    found = by_position(name).fit(A, u)
    np.testing.assert_allclose(found.coef_, THETA, atol=0.1)


@each
def test_nothing_measured(name, run):
    X, y = run
    with pytest.raises(ValueError, match="y contains NaN in all rows: nothing was measured"):
        model(name).fit(X, y * np.nan)
    with pytest.raises(ValueError, match="'e' contains NaN in all rows"):
        model(name).fit(X.assign(e=np.nan), y)


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
        ({"forgetting": 0.0}, "forgetting"),
        ({"forgetting": 1.1}, "forgetting"),
        ({"forgetting": lambda t: 0.9}, "must be a number"),
        ({"init_window": 0.0}, "init_window"),
        ({"nb": [1, 2]}, "nb has 2 entries for 1 inputs"),
        ({"parameters": "first"}, "parameters"),
        ({"inputs": ["missing"]}, "missing"),
    ]:
        with pytest.raises(ValueError, match=message):
            model(name, **options).fit(*run)


# Predictions


@each
def test_one_step_errors_are_nearly_those_of_predictions(name, run):
    """D of the last moment, and another order of filters, change them by a few percent."""
    X, y = run
    fitted = model(name, memory_time=60.0).fit(X, y)
    known = np.isfinite(fitted.one_step_errors_)
    wrong = (y - fitted.predict_ahead(X, y)).to_numpy()[known] - fitted.one_step_errors_[known]
    assert np.std(wrong) < 0.1 * np.std(fitted.one_step_errors_[known])
    assert known.sum() == fitted.n_updates_


@each
@pytest.mark.parametrize("horizon", [1, 7])
def test_predictions_ahead_do_not_look_ahead(name, horizon):
    """What comes later changes the path from there on, and no prediction before."""
    X, y = whitened_runs(1, 1500)
    other = y.copy()
    other.iloc[SPIKE:] += np.random.default_rng(0).standard_normal(1500 - SPIKE) * y.std()
    fits = [model(name, memory_time=1.0).fit(X, output) for output in (y, other)]
    ahead = [fit.predict_ahead(X, y, horizon) for fit in fits]
    np.testing.assert_array_equal(ahead[0][: SPIKE + horizon], ahead[1][: SPIKE + horizon])
    assert (ahead[0][SPIKE + horizon :] != ahead[1][SPIKE + horizon :]).any()
