"""RecursiveFIR against least squares written out, in streams, at rest, and in other units."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support import fir_twin
from support.synthetic import DT, run_time

from skhoid import (
    Decimator,
    DelayShift,
    MissingDataWarning,
    PoorExcitationWarning,
    forgetting_factor,
    make_tracking_runs,
    operator_parameters,
)
from skhoid.tracking.recursive_fir import RecursiveFIR

TAPS, NK, MEMORY, N = 6, 2, 0.4, 260
LAMBDA = forgetting_factor(MEMORY / DT)
LAGS = [range(NK, NK + TAPS)]
H = np.array([0.2, 1.0, 0.7, 0.3, -0.1, 0.05])
WHERE = [20, 60, N - 1]


def responses(e, noise, rng):
    u = np.convolve(np.r_[np.zeros(NK), H], e)[: e.size]
    return u + noise * rng.standard_normal(e.size)


def recording(lengths=(N,), noise=0.2, seed=0):
    """Runs of a finite impulse response to white noise."""
    rng = np.random.default_rng(seed)
    e = rng.standard_normal(sum(lengths))
    edges = np.cumsum([0, *lengths])
    u = np.concatenate([responses(e[a:b], noise, rng) for a, b in pairwise(edges)])
    index = run_time(lengths)
    return pd.DataFrame({"e": e}, index=index), pd.Series(u, index=index, name="u")


def model(**params):
    return RecursiveFIR(**{"n_taps": TAPS, "nk": NK, "memory_time": MEMORY, "dt": DT, **params})


X, Y = recording()
ARRAYS = (X.to_numpy(), Y.to_numpy())
PHI, ROWS = fir_twin.regressors(ARRAYS[0], 0, N, LAGS)
U = ARRAYS[1][ROWS]


def weighted(t):
    """Regressors, outputs and weights λ^k of all rows up to t."""
    so_far = t >= ROWS
    return PHI[so_far], U[so_far], LAMBDA ** (t - ROWS[so_far])


# The estimate


@pytest.mark.parametrize("t", WHERE)
def test_without_ridge_it_is_weighted_least_squares(t):
    phi, u, weights = weighted(t)
    root = np.sqrt(weights)
    theta = np.linalg.lstsq(phi * root[:, None], u * root, rcond=None)[0]
    found = model(ridge=0.0).fit(X, Y).coef_path_[t]
    np.testing.assert_allclose(found, theta, rtol=1e-8)


@pytest.mark.parametrize("t", [8, *WHERE])
def test_ridge_is_least_squares_with_rows_of_the_prior(t):
    phi, u, weights = weighted(t)
    R, _, total = fir_twin.information(phi, u, weights)
    delta = 3.0 * np.trace(R) / total
    root = np.sqrt(weights)
    theta = np.linalg.lstsq(
        np.concatenate([phi * root[:, None], np.sqrt(delta) * np.eye(TAPS)]),
        np.r_[u * root, np.zeros(TAPS)],
        rcond=None,
    )[0]
    fitted = model(ridge=3.0).fit(X, Y)
    np.testing.assert_allclose(fitted.coef_path_[t], theta, rtol=1e-8)
    if t == N - 1:
        np.testing.assert_allclose(fitted.delta_, [delta], rtol=1e-12)


def test_pooled_runs_are_stacked_least_squares():
    lengths = (N, 200, 230)
    Xs, Ys = recording(lengths, seed=3)
    fitted = model(ridge=0.0).fit(Xs, Ys)
    edges = np.cumsum([0, *lengths])
    for t in (60, 190, N - 1):
        phis, us, weights = [], [], []
        for a, b in pairwise(edges):
            phi, rows = fir_twin.regressors(Xs.to_numpy(), a, b, LAGS)
            so_far = rows - a <= t
            phis.append(phi[so_far])
            us.append(Ys.to_numpy()[rows[so_far]])
            weights.append(LAMBDA ** (t - (rows[so_far] - a)))
        root = np.sqrt(np.concatenate(weights))
        theta = np.linalg.lstsq(
            np.concatenate(phis) * root[:, None], np.concatenate(us) * root, rcond=None
        )[0]
        np.testing.assert_allclose(fitted.coef_path_[t], theta, rtol=1e-8)


# Uncertainty


def test_covariance_is_the_sandwich():
    fitted = model(ridge=1.0, store_covariance=True).fit(X, Y)
    for t in (60, N - 1):
        phi, u, weights = weighted(t)
        R, _, total = fir_twin.information(phi, u, weights)
        S, _, _ = fir_twin.information(phi, u, weights**2)
        penalty = np.trace(R) / total * np.eye(TAPS)
        A = np.linalg.inv(R + penalty)
        covariance = fitted.noise_variance_ * A @ (S + penalty) @ A
        np.testing.assert_allclose(fitted.covariance_path_[t], covariance, rtol=1e-9)
    np.testing.assert_allclose(fitted.covariance_, covariance, rtol=1e-9)


# What is missing, or at rest


def test_nan_leaves_out_rows_and_forgets_nothing():
    Xn, Yn = X.copy(), Y.copy()
    Yn.iloc[100:110] = np.nan
    Xn.iloc[150] = np.nan
    with pytest.warns(MissingDataWarning, match="11 rows"):
        fitted = model(ridge=0.0).fit(Xn, Yn)
    lost = np.isin(ROWS, np.r_[100:110, 150 + NK : 150 + NK + TAPS])
    weights = np.sqrt(LAMBDA ** np.arange((~lost).sum())[::-1])
    theta = np.linalg.lstsq(PHI[~lost] * weights[:, None], U[~lost] * weights, rcond=None)[0]
    np.testing.assert_allclose(fitted.coef_, theta, rtol=1e-8)
    assert fitted.n_rows_missing_ == lost.sum() == 16
    assert np.isnan(fitted.one_step_errors_[100:110]).all()
    np.testing.assert_array_equal(fitted.coef_path_[109], fitted.coef_path_[99])


def test_lags_do_not_cross_gaps():
    kept = np.r_[0:120, 160:N]
    fitted = model(ridge=0.0).fit(X.iloc[kept], Y.iloc[kept])
    parts = [fir_twin.regressors(ARRAYS[0], a, b, LAGS) for a, b in ((0, 120), (160, N))]
    phi, rows = (np.concatenate(part) for part in zip(*parts, strict=True))
    weights = np.sqrt(LAMBDA ** np.arange(rows.size)[::-1])
    theta = np.linalg.lstsq(phi * weights[:, None], ARRAYS[1][rows] * weights, rcond=None)[0]
    np.testing.assert_allclose(fitted.coef_, theta, rtol=1e-8)


def test_an_input_that_never_moves_is_told():
    with pytest.warns(PoorExcitationWarning, match="'x0' never determined all of the 6 taps"):
        fitted = model(ridge=0.0).fit(np.ones((N, 1)), Y.to_numpy())
    assert not fitted.coef_path_.any()
    assert np.isnan(fitted.standard_errors_).all()


# Predictions and the API


def test_free_run_follows_the_path():
    fitted = model(every=5).fit(X, Y)
    assert len(fitted.coef_path_) == len(fitted.time_path_) == N // 5
    np.testing.assert_allclose(fitted.time_path_, (np.arange(N // 5) * 5 + 4) * DT)
    padded = np.r_[np.zeros(NK + TAPS), ARRAYS[0][:, 0]]
    expected = []
    for t in range(N):
        theta = fitted.coef_path_[max((t + 1) // 5 - 1, 0)]
        expected.append(theta @ padded[t + TAPS : t : -1])
    np.testing.assert_allclose(fitted.predict(X), expected, rtol=1e-9, atol=1e-12)


def test_one_step_errors_are_those_of_predict_ahead():
    fitted = model().fit(X, Y)
    ahead = Y.to_numpy() - fitted.predict_ahead(X, Y, 1)
    np.testing.assert_allclose(ahead[ROWS], fitted.one_step_errors_[ROWS], rtol=1e-9, atol=1e-12)


def test_operator_of_a_simulated_run():
    """A delay shift and a decimator before it; without remnant the operator is found."""
    data = make_tracking_runs("C4", n_runs=2, random_state=0)
    found = make_pipeline(
        Decimator(4),
        DelayShift(0.24),
        RecursiveFIR(25, ridge=1e-3, memory_time=5.12, every=128, store_covariance=True),
    ).fit(*data)
    table = operator_parameters(found, method="fit")
    for when, gains in ((35.0, (0.09, 0.036)), (80.0, (0.07, 0.084))):
        row = table.iloc[np.searchsorted(table.index, when)]
        # Zero-order hold over 40 ms and the finite length leave some per cent.
        np.testing.assert_allclose(row[["K_e", "K_edot"]], gains, rtol=0.08)
        np.testing.assert_allclose(row[["omega_nm", "zeta_nm"]], (11.25, 0.35), rtol=0.08)
        assert row["tau_e"] == pytest.approx(0.28, abs=0.02)
        assert 0 < row["sd_K_edot"] < 0.01
    assert found.score(*data) > 95


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_taps": 2000}, "2000 taps are too many"),
        ({"ridge": -1.0}, "ridge"),
        ({"memory_time": 0.001}, "longer than one sample"),
    ],
)
def test_options_without_sense(options, message):
    with pytest.raises(ValueError, match=message):
        model(**options).fit(X, Y)
