"""Output error, Box-Jenkins and ARMAX: unbiased, as certain as they say, and right ahead."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from support.synthetic import run_time

from skhoid import ARXRegressor

A, B = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5]
NOISE = {
    "oe": ([1.0], [1.0]),
    "bj": ([1.0, 0.8, 0.2], [1.0, -0.9, 0.3]),
    "armax": ([1.0, -1.0, 0.2], A),
}
SYSTEM = [-1.5, 0.7, 1.0, 0.5]
TRUTH = {"oe": SYSTEM, "bj": [*SYSTEM, 0.8, 0.2, -0.9, 0.3], "armax": [*SYSTEM, -1.0, 0.2]}
METHODS = list(NOISE)


def data(method, seed, n=600, level=0.0, sd=0.5):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(n // 5 + 1), 5)[:n]
    white = sd * rng.standard_normal(n + 200)
    y = lfilter(B, A, u) + lfilter(*NOISE[method], white)[200:] + level
    return u[:, None], y, white[200:]


def model(method, **options):
    return ARXRegressor(2, 2, 1, dt=0.1, method=method, **options)


@pytest.mark.slow
@pytest.mark.parametrize("covariance", ["ols", "hac"])
@pytest.mark.parametrize("method", METHODS)
def test_bias_and_coverage(method, covariance):
    """100 repetitions: the mean scatters by a tenth of a deviation, a share of 95 % by 2.2 %."""
    found, said = [], []
    for seed in range(100):
        table = model(method, covariance=covariance).fit(*data(method, seed, 1500)[:2]).parameters_
        found.append(table["value"])
        said.append(table["sd"])
    found, said = np.array(found), np.array(said)
    truth = np.array(TRUTH[method])
    assert np.all(np.abs(found.mean(axis=0) - truth) < 0.35 * found.std(axis=0))
    covered = np.mean(np.abs(found - truth) < 1.96 * said, axis=0)
    assert np.all(covered > 0.86)


@pytest.mark.parametrize("method", METHODS)
def test_errors_are_the_white_noise(method):
    X, y, white = data(method, 0, 2000, sd=0.05)
    fitted = model(method).fit(X, y)
    errors = fitted.one_step_errors(X, y)[100:]
    assert np.std(errors - white[100:]) < 0.1 * np.std(white)
    assert np.sqrt(fitted.noise_variance_) == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(fitted.parameters_["value"], TRUTH[method], atol=0.15)


@pytest.mark.parametrize("horizon", [1, 2, 7])
@pytest.mark.parametrize("method", METHODS)
def test_errors_ahead_grow_as_the_noise_says(method, horizon):
    """Errors of k steps are h_0 n(t) + ... + h_(k-1) n(t - k + 1), with h the answer of C/D."""
    X, y, white = data(method, 1, 4000, sd=0.05)
    fitted = model(method).fit(X, y)
    left = (y - fitted.predict_ahead(X, y, horizon))[200:]
    answer = lfilter(*NOISE[method], np.r_[1.0, np.zeros(horizon - 1)])
    expected = lfilter(answer, [1.0], white)[200:]
    assert np.std(left - expected) < 0.15 * np.std(expected)


@pytest.mark.parametrize("method", METHODS)
def test_far_ahead_is_the_free_run(method):
    X, y, _ = data(method, 2)
    fitted = model(method).fit(X, y)
    np.testing.assert_allclose(fitted.predict_ahead(X, y, 10**6), fitted.predict(X), atol=1e-9)
    nearly = fitted.predict_ahead(X, y, 500)
    np.testing.assert_allclose(nearly[100:], fitted.predict(X)[100:], atol=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_runs_gaps_and_starts_of_their_own(method):
    """Runs begin anywhere, rows are missing, and nothing of this moves the estimates."""
    rng = np.random.default_rng(4)
    parts = [data(method, seed, 700, sd=0.1) for seed in (5, 6, 7)]
    X = np.concatenate([X[100:] for X, *_ in parts])
    y = np.concatenate([y[100:] for _, y, _ in parts])
    y[250:270] = np.nan
    y[rng.choice(y.size, 15)] = np.nan
    index = run_time([600] * 3)
    with pytest.warns(UserWarning, match="are NaN"):
        fitted = ARXRegressor(2, 2, 1, method=method).fit(
            pd.DataFrame({"u": X[:, 0]}, index=index), pd.Series(y, index=index)
        )
    error = fitted.parameters_["value"] - TRUTH[method]
    assert np.all(np.abs(error) < 4 * fitted.parameters_["sd"])
    ahead = fitted.predict_ahead(
        pd.DataFrame({"u": X[:, 0]}, index=index), pd.Series(y, index=index)
    )
    assert np.isfinite(ahead).all()


@pytest.mark.parametrize("method", METHODS)
def test_several_inputs_delays_and_a_constant(method):
    rng = np.random.default_rng(8)
    X = rng.standard_normal((2000, 2))
    white = 0.1 * rng.standard_normal(2000)
    y = lfilter([0, 0, 0, 1.0, 0.5], A, X[:, 0]) + lfilter([0, 0.4], A, X[:, 1]) + 20.0
    y += lfilter(*NOISE[method], white)
    fitted = ARXRegressor(2, [2, 1], [3, 1], dt=0.1, fit_intercept=True, method=method).fit(X, y)
    truth = [-1.5, 0.7, 1.0, 0.5, 0.4, 20.0 * 0.2]
    assert np.all(np.abs(fitted.coef_ - truth) < 4 * fitted.standard_errors_)
    systems = fitted.to_transfer_function()
    assert list(systems) == ["x0", "x1"]


def test_armax_is_that_of_statsmodels():
    statsmodels = pytest.importorskip("statsmodels.tsa.statespace.sarimax")
    rng = np.random.default_rng(1)
    u, white = rng.standard_normal((2, 3000))
    y = lfilter([0, 1.0], [1, -0.7], u) + lfilter([1, 0.5], [1, -0.7], white)
    fitted = ARXRegressor(1, 1, 1, dt=1.0, method="armax", nc=1).fit(u[:, None], y)
    # Of errors that are ARMA: y = b/(1 - .7 q) u cannot be said there, so the noise alone is.
    noise = lfilter([1, 0.5], [1, -0.7], white)
    told = statsmodels.SARIMAX(noise, order=(1, 0, 1)).fit(disp=False).params
    ours = ARXRegressor(1, 1, 1, dt=1.0, method="bj", nc=1, nd=1).fit(u[:, None], y)
    assert ours.c_[0] == pytest.approx(told[1], abs=0.02)
    assert -ours.d_[0] == pytest.approx(told[0], abs=0.02)
    assert fitted.c_[0] == pytest.approx(0.5, abs=4 * fitted.parameters_.loc["c1", "sd"])


def test_output_error_without_noise_is_exact():
    X, y, _ = data("oe", 3, sd=0.0)
    for method in METHODS[:1]:
        np.testing.assert_allclose(model(method).fit(X, y).coef_, SYSTEM, rtol=1e-6)


def test_names_of_the_field():
    X, y, _ = data("bj", 0)
    fitted = model("bj").fit(X, y)
    np.testing.assert_array_equal(fitted.f_, fitted.a_)
    assert fitted.parameters_.index.tolist() == ["a1", "a2", "b0", "b1", "c1", "c2", "d1", "d2"]
    assert (fitted.c_.size, fitted.d_.size) == (2, 2)
    assert "Box-Jenkins" in str(fitted.summary())
    plain = model("ols").fit(X, y)
    assert (plain.c_.size, plain.d_.size) == (0, 0)
    with pytest.raises(AttributeError, match="has no F"):
        _ = plain.f_


def test_what_cannot_be_combined():
    X, y, _ = data("oe", 0)
    with pytest.raises(ValueError, match="does not take effects"):
        model("oe").with_effect("bias")
    with pytest.raises(ValueError, match="cannot weigh rows"):
        model("bj").fit(X, y, sample_weight=np.linspace(1, 2, y.size))
    with pytest.raises(ValueError, match="method"):
        model("box").fit(X, y)
