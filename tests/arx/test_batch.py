"""ARXRegressor: exact coefficients, causes of rank deficiency, covariance, simulation."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict, cross_val_score
from sklearn.multioutput import MultiOutputRegressor
from support import naive
from support.synthetic import A, B, arx_runs, run_time, stretches_of

from skhoid import ARXRegressor, RankDeficiencyError, run_labels, vaf_score

ORDERS = [
    # na, nb, nk, inputs, intercept
    (2, 2, 3, ["e"], False),
    (0, 3, 0, ["e"], False),
    (3, 1, 1, ["e"], True),
    (2, [2, 3], [3, 0], ["e", "x"], False),
    (1, 2, [0, 5], ["x", "e"], True),
]


def per_input(value, n_inputs):
    return [value] * n_inputs if np.ndim(value) == 0 else list(value)


@pytest.mark.parametrize("n_runs", [1, 5])
@pytest.mark.parametrize(("na", "nb", "nk", "inputs", "intercept"), ORDERS)
def test_coefficients_are_least_squares(n_runs, na, nb, nk, inputs, intercept):
    X, y = arx_runs(n_runs, 150)
    y = y + 3.0 * intercept
    model = ARXRegressor(na, nb, nk, inputs=inputs, fit_intercept=intercept).fit(X, y)
    n_inputs = len(inputs)
    nbs, nks = per_input(nb, n_inputs), per_input(nk, n_inputs)
    phi, output, rows, _ = naive.regressor_rows(
        y.to_numpy(), X[inputs].to_numpy(), stretches_of(X), na, nbs, nks, intercept
    )
    theta, rss, *_ = np.linalg.lstsq(phi, output, rcond=None)
    np.testing.assert_allclose(model.coef_, theta, rtol=1e-10, atol=1e-10)
    variance = rss[0] / (len(rows) - theta.size)
    assert model.noise_variance_ == pytest.approx(variance, rel=1e-10)
    np.testing.assert_allclose(
        model.covariance_, variance * np.linalg.inv(phi.T @ phi), rtol=1e-8, atol=1e-14
    )
    np.testing.assert_allclose(model.standard_errors_**2, np.diag(model.covariance_), rtol=1e-12)
    assert model.n_rows_used_ == len(rows)
    assert len(model.parameter_names_) == theta.size
    np.testing.assert_array_equal(model.a_, model.coef_[:na])
    b = model.b_ if n_inputs > 1 else [model.b_]
    np.testing.assert_array_equal(np.concatenate(b), model.coef_[na : na + sum(nbs)])
    assert [len(row) for row in b] == nbs
    assert model.intercept_ == (model.coef_[-1] if intercept else 0.0)


def normalised_errors(kind, make, truth, n_samples=100, **params):
    """Mean over recordings of d' P^-1 d / p, d the error of theta; 1 when P is right."""
    total = 0.0
    for seed in range(n_samples):
        model = ARXRegressor(covariance=kind, **params).fit(*make(seed))
        error = model.coef_ - truth
        total += error @ np.linalg.solve(model.covariance_, error) / truth.size
    return total / n_samples


@pytest.mark.slow
def test_hac_covariance_with_coloured_error():
    """Input and error are AR(1) with pole 0.6: their product has correlations 0.36^k.

    "ols" is then too small by (1 + 0.36)/(1 - 0.36) = 2.1. The mean of 100 chi-squared(1) has a
    standard deviation of 0.14.
    """

    def make(seed):
        rng = np.random.default_rng(seed)
        e, noise = lfilter([1.0], [1.0, -0.6], rng.standard_normal((2, 1000)))
        return pd.DataFrame({"e": e}, index=run_time([1000])), e + noise

    white = normalised_errors("ols", make, np.array([1.0]), na=0, nb=1)
    robust = normalised_errors("hac", make, np.array([1.0]), na=0, nb=1)
    assert white == pytest.approx(2.1, abs=1.2)  # 4 sigma of 0.3
    assert robust == pytest.approx(1.0, abs=0.6)


# Standard errors of inputs that hardly move


def stepping(n, *rows):
    u = np.zeros(n)
    for size, row in enumerate(rows, 1):
        u[row:] = size * (-0.6) ** size
    return u


def pulsing(n, *rows):
    u = np.zeros(n)
    u[list(rows)] = 1.0
    return u


FEW = {
    "one step": stepping(300, 30),
    "steps up and down": stepping(400, 20, 60, 150, 220, 330),
    "one pulse": pulsing(200, 40, 41, 42),
    "ramp": np.clip((np.arange(250) - 50) / 20, 0, 1),
    "step of a large mean": 500 + stepping(200, 60, 130),
}


@pytest.mark.parametrize("u", FEW.values(), ids=FEW)
def test_hac_is_least_squares_where_a_coefficient_acts_in_few_rows(u):
    """Of a white error the standard errors are known; a residual of nearly zero is not precise."""
    ratios = []
    for seed in range(12):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(u.size)
        y = lfilter([0, 0.5, 0.3, 0.2, 0.1], [1, -0.9], u) + lfilter([1], [1, -0.9], noise)
        ols, hac = (
            ARXRegressor(1, 4, 1, dt=1.0, fit_intercept=True, covariance=kind)
            .fit(u[:, None], y)
            .standard_errors_
            for kind in ("ols", "hac")
        )
        ratios.append(hac / ols)
    assert np.all(np.min(ratios, axis=0) > 0.6)
    assert np.all(np.max(ratios, axis=0) < 1.6)
    assert np.all(np.abs(np.median(ratios, axis=0) - 1) < 0.15)


@pytest.mark.parametrize(
    ("D", "n_runs"), [([1, -0.9], 1), ([1, -1.6, 0.9], 1), ([1, -1.6, 0.9], 3), ([1, 0.6], 3)]
)
def test_hac_of_a_coloured_error_is_that_of_the_truth(D, n_runs):
    """A finite impulse response: (P'P)^-1 P' C P (P'P)^-1, C the covariance of the error."""
    n = 600
    steps = np.repeat(np.random.default_rng(1).standard_normal(n // 40), 40)
    impulse = lfilter([1.0], D, np.r_[1.0, np.zeros(1999)])
    C = toeplitz([impulse[k:] @ impulse[: 2000 - k] for k in range(n - 4)])
    Phi = np.column_stack([steps[4 - lag : n - lag] for lag in range(1, 5)])
    bread = np.linalg.inv(Phi.T @ Phi)
    gain = np.ones(4)
    truth = np.r_[
        np.diag(bread @ Phi.T @ C @ Phi @ bread), gain @ bread @ Phi.T @ C @ Phi @ bread @ gain
    ]
    said = []
    index = run_time([n] * n_runs)
    for seed in range(8):
        noise = lfilter([1.0], D, np.random.default_rng(seed).standard_normal((n_runs, n + 300)))
        y = lfilter([0, 0.5, 0.3, 0.2, 0.1], 1, steps) + noise[:, 300:]
        X = pd.DataFrame({"u": np.tile(steps, n_runs)}, index=index)
        P = ARXRegressor(0, 4, 1, covariance="hac").fit(X, y.ravel()).covariance_
        said.append(np.r_[np.diag(P), gain @ P @ gain])
    ratio = np.sqrt(np.mean(said, axis=0) * n_runs / truth)
    assert np.all(np.abs(ratio - 1) < 0.2)


def test_hac_of_an_error_that_grows_with_the_input():
    """Of many rows the sandwich counts: least squares says too little of a gain."""
    u = np.random.default_rng(0).standard_normal(2000)
    found, said = [], []
    for seed in range(1, 201):
        noise = np.abs(u) ** 2 * np.random.default_rng(seed).standard_normal(u.size)
        model = ARXRegressor(0, 1, 0, covariance="hac").fit(u[:, None], u + noise)
        found.append(model.coef_[0])
        said.append(model.standard_errors_[0])
    assert np.mean(said) == pytest.approx(np.std(found), rel=0.2)
    assert np.mean(np.abs(np.array(found) - 1) < 1.96 * np.array(said)) == pytest.approx(
        0.95, abs=0.05
    )


def test_hac_of_a_row_that_a_coefficient_follows():
    """With a leverage of one its residual is nought by rounding."""
    u = pulsing(100, 50)
    y = u + 0.1 * np.random.default_rng(0).standard_normal(100)
    model = ARXRegressor(0, 1, 0, covariance="hac").fit(u[:, None], y)
    assert model.standard_errors_[0] == pytest.approx(0.1, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("u", FEW.values(), ids=FEW)
def test_intervals_of_few_steps_cover_the_truth(u):
    """400 repetitions: a share of 95 % scatters by 1.1 %."""
    truth, inside = np.array([-0.9, 0.5, 0.3, 0.2, 0.1]), []
    for seed in range(400):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(u.size)
        y = lfilter([0, 0.5, 0.3, 0.2, 0.1], [1, -0.9], u) + lfilter([1], [1, -0.9], noise)
        if u[0]:
            y -= lfilter([0, 0.5, 0.3, 0.2, 0.1], [1, -0.9], np.full(u.size, u[0])) - 11 * u[0]
        model = ARXRegressor(1, 4, 1, dt=1.0, covariance="hac").fit(u[:, None], y)
        inside.append(np.abs(model.coef_ - truth) < 1.96 * model.standard_errors_)
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.035)


# Rank


def rank_error(X, y, **params):
    with pytest.raises(RankDeficiencyError) as caught:
        ARXRegressor(**params).fit(X, y)
    message = str(caught.value)
    assert "cannot all be estimated" in message
    return message


@pytest.fixture(scope="module")
def data():
    return arx_runs(2, 150)


def test_constant_input(data):
    X, y = data
    message = rank_error(X.assign(f=3.0), y, inputs=["e", "f"])
    assert "Input 'f' is constant (3)" in message
    assert "fit_intercept" in message
    message = rank_error(X.assign(f=3.0), y, inputs=["e", "f"], nb=1, fit_intercept=True)
    assert "'f' is constant" in message


def test_the_error_is_target_minus_output(data):
    X, y = data
    closed = X.assign(f_t=X["e"] + X["x"])
    message = rank_error(closed, y, inputs=["e", "f_t", "x"])
    assert "e = f_t - x" in message
    assert "Leave one of them out" in message
    ARXRegressor(inputs=["e", "x"]).fit(closed, y)


def test_too_high_an_order_without_noise(data):
    X, y = arx_runs(2, 150, noise=0.0)
    message = rank_error(X, y, na=4, nb=4, nk=3)
    assert "free of noise" in message
    assert "a4" in message
    assert "smaller na and nb" in message
    np.testing.assert_allclose(ARXRegressor(2, 2, 3).fit(X, y).coef_, [*A, *B], rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_units_do_not_matter(data, scale):
    X, y = data
    one = ARXRegressor(2, 2, 3).fit(X, y)
    other = ARXRegressor(2, 2, 3).fit(X * scale, y)
    np.testing.assert_allclose(other.a_, one.a_, rtol=1e-9)
    np.testing.assert_allclose(other.b_ * scale, one.b_, rtol=1e-9)
    both = ARXRegressor(2, 2, 3).fit(X * scale, y * scale)
    np.testing.assert_allclose(both.coef_, one.coef_, rtol=1e-9)


# Simulation


def test_estimated_initial_state_recovers_a_homogeneous_response():
    X, _ = arx_runs(2, 150)
    X["e"] *= 0.1
    _, y = arx_runs(2, 150)
    model = ARXRegressor(2, 2, 3).fit(X, y)
    model.coef_ = np.array([*A, *B])
    starts = np.array([[3.0, -1.0], [-2.0, 5.0]])
    truth = naive.free_run(X[["e"]].to_numpy(), stretches_of(X), A, [B], (3,), y0=starts)
    u = pd.Series(truth, index=X.index)
    np.testing.assert_allclose(model.simulate(X, u), truth, rtol=1e-9, atol=1e-9)
    assert np.abs(model.simulate(X) - truth).max() > 1
    np.testing.assert_array_equal(model.simulate(X), model.predict(X))
    holed = u.where(np.arange(300) % 7 != 3)
    np.testing.assert_allclose(model.simulate(X, holed), truth, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("horizon", [1, 5])
def test_predict_ahead_through_the_public_door(data, horizon):
    X, y = data
    model = ARXRegressor(2, [2, 1], [3, 0], inputs=["e", "x"]).fit(X, y)
    twin = naive.predict_ahead(
        y.to_numpy(), X.to_numpy(), stretches_of(X), model.a_, model.b_, (3, 0), horizon=horizon
    )
    np.testing.assert_allclose(model.predict_ahead(X, y, horizon), twin, rtol=1e-10, atol=1e-12)


def test_score_is_the_vaf_of_the_free_run(data):
    X, y = data
    model = ARXRegressor(2, 2, 3).fit(X, y)
    twin = naive.free_run(X[["e"]].to_numpy(), stretches_of(X), model.a_, [model.b_], (3,))
    assert model.score(X, y) == pytest.approx(naive.vaf(y, twin), rel=1e-12)
    holed = y.where(np.arange(300) % 5 != 0)
    assert model.score(X, holed) == pytest.approx(naive.vaf(holed, twin), rel=1e-12)


@pytest.mark.parametrize(
    "theta", [(-2.5, 1.2, 1.0, 0.0), (-1e30, 1e30, 1e80, 0.0), (-1e200, 1e200, 1e200, 0.0)]
)
def test_unstable_models_stay_finite(data, theta):
    X, y = data
    model = ARXRegressor(2, 2, 3).fit(X, y)
    model.coef_ = np.array(theta)
    assert np.isfinite(model.predict(X)).all()
    assert np.isfinite(model.simulate(X, y)).all()
    assert np.isfinite(model.predict_ahead(X, y, 5)).all()
    assert model.score(X, y) == -1000.0
    assert vaf_score(y, model.predict(X)) == 0.0


def test_stock_cross_validation_over_runs():
    X, y = arx_runs(4, 120)
    groups = run_labels(X)
    scores = cross_val_score(ARXRegressor(2, 2, 3), X, y, groups=groups, cv=LeaveOneGroupOut())
    predictions = cross_val_predict(
        ARXRegressor(2, 2, 3), X, y, groups=groups, cv=LeaveOneGroupOut()
    )
    assert predictions.shape == (len(X),)
    for run, score in enumerate(scores, start=1):
        rest = [other for other in (1, 2, 3, 4) if other != run]
        model = ARXRegressor(2, 2, 3).fit(X.loc[rest], y.loc[rest])
        assert score == pytest.approx(model.score(X.loc[[run]], y.loc[[run]]), rel=1e-12)
        np.testing.assert_allclose(
            predictions[groups == run], model.predict(X.loc[[run]]), rtol=1e-12
        )


def test_hac_of_a_record_in_many_short_stretches():
    X, y = arx_runs(1, 3000)
    lost = np.random.default_rng(0).random(len(X)) < 0.05
    whole = ARXRegressor(2, 2, 3, covariance="hac").fit(X, y)
    cut = ARXRegressor(2, 2, 3, covariance="hac").fit(X[~lost], y[~lost])
    np.testing.assert_allclose(cut.coef_, whole.coef_, atol=4 * cut.standard_errors_.max())
    assert np.all(cut.standard_errors_ > whole.standard_errors_)


@pytest.mark.parametrize("kind", [np.asarray, lambda Y: Y])
def test_one_model_per_output(kind):
    X, y = arx_runs(3, 200)
    Y = pd.DataFrame({"u": y, "v": -2.0 * y}, index=y.index)
    with pytest.raises(ValueError, match=r"MultiOutputRegressor\(model\) fits one for each column"):
        ARXRegressor(2, 2, 3).fit(X, Y if kind is not np.asarray else Y.to_numpy())
    both = MultiOutputRegressor(ARXRegressor(2, 2, 3)).fit(X, kind(Y))
    alone = ARXRegressor(2, 2, 3).fit(X, y)
    np.testing.assert_allclose(both.estimators_[0].coef_, alone.coef_)
    expected = np.column_stack([alone.predict(X), -2.0 * alone.predict(X)])
    np.testing.assert_allclose(both.predict(X), expected)
