"""LPVARX against least squares written out, the truth behind simulated runs, and other models."""

import numpy as np
import pandas as pd
import pytest
from sklearn.preprocessing import PolynomialFeatures, SplineTransformer
from support.synthetic import DT, NK, arx_runs, run_time, stretches_of

from skhoid import (
    ARXRegressor,
    MissingDataWarning,
    RankDeficiencyError,
    ShortRunError,
    Sigmoid,
)
from skhoid.tracking.lpv_arx import LPVARX

T_M = 1.0
STEP = Sigmoid(0.0, 1.0, rate=6.0, time=T_M)
THETA = np.array([[-1.5, 0.7, 1.0, 0.5], [0.1, 0.05, 1.0, -0.8]])  # times 1 and v or STEP


def simulated(v, e, white):
    """u of an ARX model with θ = THETA[0] + v THETA[1]."""
    theta = THETA[0] + np.multiply.outer(v, THETA[1])
    u = np.zeros(e.size)
    for t in range(e.size):
        for i in (1, 2):
            u[t] -= theta[t, i - 1] * (u[t - i] if t >= i else 0.0)
        for i in (0, 1):
            u[t] += theta[t, 2 + i] * (e[t - NK - i] if t >= NK + i else 0.0)
        u[t] += white[t]
    return u


def recording(lengths=(300, 260), noise=0.1, seed=0, by="v"):
    rng = np.random.default_rng(seed)
    index = run_time(lengths)
    time = index.get_level_values("time").to_numpy()
    e, f = rng.standard_normal((2, len(index)))
    v = STEP(time) if by == "time" else 0.5 * np.sin(3 * time + index.get_level_values("run"))
    u = np.concatenate(
        [
            simulated(v[a:b], e[a:b], noise * f[a:b])
            for a, b in stretches_of(pd.DataFrame(index=index))
        ]
    )
    X = pd.DataFrame({"e": e, "v": v}, index=index)
    return X, pd.Series(u, index=index, name="u")


def model(**params):
    return LPVARX(**{"nk": NK, "scheduling": "v", **params})


def stacked(X, y, functions, constant=False):
    """Products μ_j φ_i, entry by entry, of the rows with known lags."""
    tables, outputs = [], []
    e, u = X["e"].to_numpy(), y.to_numpy()
    for a, b in stretches_of(X):
        for t in range(a + NK + 1, b):
            phi = [-u[t - 1], -u[t - 2], e[t - NK], e[t - NK - 1]] + [1.0] * constant
            tables.append(np.kron(phi, functions[t]))
            outputs.append(u[t])
    return np.array(tables), np.array(outputs)


X, Y = recording()
V = X["v"].to_numpy()
BASES = {
    "linear": ({"basis": "linear"}, np.stack([V**0, V], 1)),
    "table": ({"basis": lambda s: np.stack([np.cos(s), s, s**2], 1)},
              np.stack([np.cos(V), V, V**2], 1)),
    "one": ({"basis": np.tanh}, np.stack([V**0, np.tanh(V)], 1)),
    "spline": ({"basis": SplineTransformer(n_knots=3, degree=2)},
               SplineTransformer(n_knots=3, degree=2).fit_transform(V[:, None])),
}  # fmt: skip
each_basis = pytest.mark.parametrize(("params", "functions"), BASES.values(), ids=BASES.keys())


# The estimate


@each_basis
@pytest.mark.parametrize("intercept", [False, True])
def test_it_is_least_squares_on_stacked_regressors(params, functions, intercept):
    fitted = model(fit_intercept=intercept, **params).fit(X, Y)
    table, u = stacked(X, Y, functions, intercept)
    found, rest, rank, _ = np.linalg.lstsq(table, u, rcond=None)
    assert rank == table.shape[1]
    np.testing.assert_allclose(fitted.estimates_, found, rtol=1e-10, atol=1e-10)
    variance = rest[0] / (len(u) - rank)
    assert fitted.noise_variance_ == pytest.approx(variance, rel=1e-9)
    covariance = variance * np.linalg.inv(table.T @ table)
    np.testing.assert_allclose(
        fitted.estimates_covariance_, covariance, rtol=1e-7, atol=1e-9 * covariance.max()
    )
    theta = functions @ found.reshape(-1, functions.shape[1]).T
    np.testing.assert_allclose(fitted.coef_at(V), theta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fitted.coef_, theta.mean(axis=0), rtol=1e-9)
    G = np.kron(np.eye(4 + intercept), functions.mean(axis=0))
    sd = np.sqrt(np.diag(G @ fitted.estimates_covariance_ @ G.T))
    np.testing.assert_allclose(fitted.standard_errors_, sd, rtol=1e-6)


def test_a_constant_basis_is_the_batch_model():
    Xc, Yc = arx_runs(3, 200)
    one = ARXRegressor(nk=NK, fit_intercept=True).fit(Xc, Yc)
    for basis in (PolynomialFeatures(0), lambda t: np.ones((t.size, 1))):
        other = LPVARX(nk=NK, fit_intercept=True, basis=basis).fit(Xc, Yc)
        np.testing.assert_allclose(other.coef_, one.coef_, rtol=1e-12)
        np.testing.assert_allclose(other.covariance_, one.covariance_, rtol=1e-12)
        np.testing.assert_allclose(other.coef_path_, np.tile(one.coef_, (200, 1)), rtol=1e-12)
        np.testing.assert_allclose(
            other.predict_ahead(Xc, Yc, 3), one.predict_ahead(Xc, Yc, 3), rtol=1e-9, atol=1e-12
        )


def test_without_noise_the_coefficients_are_found():
    fitted = model().fit(*recording(noise=0.0))
    np.testing.assert_allclose(fitted.scheduled_coef_, THETA, atol=1e-10)
    np.testing.assert_allclose(fitted.predict(X), recording(noise=0.0)[1], atol=1e-9)
    by_time = LPVARX(nk=NK, basis=STEP).fit(*recording(noise=0.0, by="time"))
    np.testing.assert_allclose(by_time.scheduled_coef_, THETA, atol=1e-10)


# Uncertainty


def test_covariance_of_the_path_is_propagated():
    fitted = LPVARX(nk=NK, basis=STEP).fit(*recording(by="time"))
    assert fitted.coef_path_.shape == (300, 4)
    np.testing.assert_allclose(fitted.time_path_, np.arange(300) * DT)
    for t in (0, 120, 299):
        G = np.kron(np.eye(4), [1.0, STEP([t * DT])[0]])
        expected = G @ fitted.estimates_covariance_ @ G.T
        np.testing.assert_allclose(fitted.covariance_path_[t], expected, rtol=1e-10)


# Predictions


def test_predictions_follow_the_scheduling_of_the_rows_given():
    fitted = model().fit(X, Y)
    new, _ = recording((90,), seed=9)
    theta = fitted.coef_at(new["v"])
    e, u = new["e"].to_numpy(), np.zeros(90)
    for t in range(90):
        for i in (1, 2):
            u[t] -= theta[t, i - 1] * (u[t - i] if t >= i else 0.0)
        for i in (0, 1):
            u[t] += theta[t, 2 + i] * (e[t - NK - i] if t >= NK + i else 0.0)
    np.testing.assert_allclose(fitted.predict(new), u, rtol=1e-9, atol=1e-12)
    errors = fitted.one_step_errors(X, Y)
    known = ~np.isnan(errors)
    assert known.sum() == fitted.n_rows_used_
    assert errors[known] @ errors[known] == pytest.approx(
        fitted.noise_variance_ * (known.sum() - 8), rel=1e-9
    )
    ahead = fitted.predict_ahead(X, Y)
    np.testing.assert_allclose((Y - ahead).to_numpy()[known], errors[known], atol=1e-9)


def test_nan_in_any_channel_leaves_out_rows():
    Xn, Yn = X.copy(), Y.copy()
    Xn.iloc[50:53, 1] = np.nan  # v: these rows alone
    Xn.iloc[100, 0] = np.nan  # e: two rows, by its lags
    Yn.iloc[150] = np.nan  # y: three
    with pytest.warns(MissingDataWarning, match="5 rows of 'u', 'e', 'v' are NaN"):
        fitted = model().fit(Xn, Yn)
    table, u = stacked(Xn, Yn, np.stack([V**0, Xn["v"]], 1))
    known = ~np.isnan(table).any(axis=1) & ~np.isnan(u)
    found = np.linalg.lstsq(table[known], u[known], rcond=None)[0]
    np.testing.assert_allclose(fitted.estimates_, found, rtol=1e-10)
    assert fitted.n_rows_missing_ == (~known).sum() == 8
    with pytest.warns(MissingDataWarning, match="8 rows whose lags need them are left out"):
        assert np.isfinite(model(varying="inputs").fit(Xn, Yn).estimates_).all()
    with pytest.warns(MissingDataWarning, match=r"3 rows of the inputs \['v'\] are NaN"):
        held = fitted.predict(X.assign(v=Xn["v"]))
    np.testing.assert_array_equal(held, fitted.predict(X.assign(v=Xn["v"].ffill())))


# The API


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"scheduling": "w"}, "scheduling names 'w', which is not a column of X"),
        ({"inputs": ["e", "v"]}, "'v' is in scheduling and in inputs"),
        ({"scheduling": ["v", "e"], "inputs": None}, "no column left|'e' is in scheduling"),
        ({"basis": lambda s: s[:3]}, r"returned the shape \(3,\) for the scheduling"),
        ({"basis": lambda s: 1.0 if s > 0 else 0.0}, "choose between values with np.where"),
        ({"basis": lambda s: np.log(s)}, "is not finite for s = "),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value encountered in log")
def test_options_without_sense(params, message):
    with pytest.raises(ValueError, match=message):
        model(**params).fit(X, Y)


def test_what_cannot_be_estimated():
    with pytest.raises(RankDeficiencyError, match="scheduling hardly changes"):
        model().fit(X.assign(v=2.0), Y)
    with pytest.raises(RankDeficiencyError, match="excites nothing"):
        model().fit(X.assign(e=0.0), Y)
    with pytest.raises(ShortRunError, match="successive rows"):
        model().fit(X[:4], Y[:4])
    with pytest.raises(ValueError, match="'v' contains NaN in all rows"):
        model().fit(X.assign(v=np.nan), Y)
    with pytest.raises(ValueError, match=r"must have the shape \(n,\)"):
        model().fit(X, Y).coef_at(np.ones((3, 2)))
