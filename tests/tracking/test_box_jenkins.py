"""RecursiveBoxJenkins: exact where it is linear, unbiased where least squares is not."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter
from support.whitened_runs import DT as STEP
from support.whitened_runs import NK, THETA

from skhoid import (
    RecursiveARX,
    RecursiveBoxJenkins,
    make_tracking_runs,
    operator_parameters,
)
from skhoid.tracking.whitened import SETTLE, START_WORTH

DT = 0.01


def linear_run(n=3000, noise=0.2, seed=0):
    rng = np.random.default_rng(seed)
    e = rng.standard_normal((n, 1))
    u = 0.5 * np.r_[0, e[:-1, 0]] - 0.2 * np.r_[0, 0, e[:-2, 0]]
    return e, u + noise * rng.standard_normal(n)


def test_without_poles_and_noise_model_it_is_weighted_least_squares():
    """With na = 0 and noise_order = 0 the model is linear, and the recursion exact."""
    e, u = linear_run()
    lam, m = 0.99, 1000
    model = RecursiveBoxJenkins(
        0, 2, 1, noise_order=0, memory_time=DT / (1 - lam), init_window=m * DT, dt=DT
    ).fit(e, u)
    phi = np.stack([np.r_[0, e[:-1, 0]], np.r_[0, 0, e[:-2, 0]]], axis=1)
    skip = 2 + round(SETTLE / DT)  # rows before lags are known, and of settling
    R = phi[skip:m].T @ phi[skip:m]
    theta = np.linalg.solve(R, phi[skip:m].T @ u[skip:m])
    np.testing.assert_allclose(model.initial_coef_, theta, rtol=1e-7)
    R = R * START_WORTH * min(1 / (1 - lam), m - skip) / (m - skip)
    s = R @ theta
    for t in range(3 + round(SETTLE / DT), u.size):
        R = lam * R + np.outer(phi[t], phi[t])
        s = lam * s + phi[t] * u[t]
        if t % 500 == 0:
            np.testing.assert_allclose(model.coef_path_[t], np.linalg.solve(R, s), rtol=1e-6)
    np.testing.assert_allclose(model.coef_, np.linalg.solve(R, s), rtol=1e-6)
    expected = model.noise_variance_ * np.linalg.inv(R) / (1 + lam)
    np.testing.assert_allclose(model.covariance_, expected, rtol=1e-6)


@pytest.fixture(scope="module")
def loop():
    return make_tracking_runs(
        "C1", n_runs=5, remnant_intensity=0.15, remnant_order=2, random_state=42, run_in=20.0
    )


def test_remnant_does_not_bias_it(loop):
    """Standard deviations of these means, by 60 seeds: 2.5 % of omega_nm, 9 % of zeta_nm."""
    ends = {}
    for cls in (RecursiveARX, RecursiveBoxJenkins):
        path = operator_parameters(cls(nk=29, memory_time=10.24).fit(*loop))
        ends[cls] = path.loc[60:, ["omega_nm", "zeta_nm"]].mean() / [11.25, 0.35] - 1
    assert (ends[RecursiveARX] > [0.2, 0.25]).all()
    assert (ends[RecursiveBoxJenkins].abs() < [0.08, 0.25]).all()


def test_intervals(loop):
    X, y = loop
    model = RecursiveBoxJenkins(nk=29, memory_time=10.24, store_covariance=True).fit(X, y)
    path = operator_parameters(model).loc[20:]
    z = (path["omega_nm"] - 11.25) / path["sd_omega_nm"]
    assert z.abs().max() < 5
    assert 0.3 < z.std() < 2
    np.testing.assert_allclose(model.covariance_path_[-1], model.covariance_)


@pytest.mark.slow
def test_one_memory_per_parameter(loop):
    X, y = loop
    slow = RecursiveBoxJenkins(nk=29, memory_time=[20.0, 20.0, 5.0, 5.0]).fit(X, y)
    fast = RecursiveBoxJenkins(nk=29, memory_time=5.0).fit(X, y)
    a_slow, a_fast = (m.coef_path_[4000:, 0].std() for m in (slow, fast))
    assert a_slow < 0.7 * a_fast


def test_predictions_ahead_use_the_noise(loop):
    X, y = loop
    model = RecursiveBoxJenkins(nk=29, memory_time=5.0).fit(X, y)
    one, ten = (np.std(y - model.predict_ahead(X, y, h)) for h in (1, 10))
    free = np.std(y - model.predict(X))
    assert one < 0.1 * free
    assert one < ten < free


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"memory_time": [9.0, 9.0, 9.0]}, "one per parameter"),
        ({"noise_order": -1}, "noise_order"),
        ({"nk": -1}, "nk"),
    ],
)
def test_errors(loop, options, message):
    with pytest.raises(ValueError, match=message):
        RecursiveBoxJenkins(**{"nk": 29, **options}).fit(*loop)


SMALL = {"nk": NK, "inputs": [0], "noise_order": 0, "dt": STEP, "init_window": 20.0}


def output_error_run(n, seed, noise=1.0):
    rng = np.random.default_rng(seed)
    e = rng.standard_normal(n)
    w = lfilter(np.r_[np.zeros(NK), THETA[2:]], np.r_[1, THETA[:2]], e)
    return e, w + noise * rng.standard_normal(n)


def output_error_estimate(e, u):
    """Least squares of the simulation, and its covariance, by SciPy."""

    def errors(theta):
        return u - lfilter(np.r_[np.zeros(NK), theta[2:]], np.r_[1, theta[:2]], e)

    found = least_squares(errors, THETA, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    variance = np.mean(found.fun**2)
    return found.x, variance * np.linalg.inv(found.jac.T @ found.jac)


def test_it_ends_at_output_error_least_squares():
    """Beside white noise, λ = 1. What is left is the window's double weight and early steps."""
    off, spread = [], []
    for seed in range(3):
        e, u = output_error_run(6_000, seed)
        theta, covariance = output_error_estimate(e, u)
        sd = np.sqrt(np.diag(covariance))
        found = RecursiveBoxJenkins(**SMALL).fit(e[:, None], u)
        off.append((found.coef_ - theta) / sd)
        spread.append(found.standard_errors_ / sd)
    assert np.sqrt(np.mean(np.square(off))) < 0.5
    np.testing.assert_allclose(np.mean(spread, axis=0), 1.0, atol=0.08)


@pytest.mark.slow
def test_nothing_diverges():
    """Of 300 runs none has a coefficient of 100 times the largest (truth 0.04 to 0.1)."""
    for order in (1, 4):
        X, y = make_tracking_runs(
            "C4", n_runs=2, remnant_intensity=0.25, remnant_order=order, random_state=100 + order
        )
        for run in range(2):
            model = RecursiveBoxJenkins(nk=29, memory_time=2.56).fit(X.loc[[run]], y.loc[[run]])
            assert np.isfinite(model.coef_path_).all()
            assert np.abs(model.coef_path_[:, :2]).max() <= 2.0
            assert np.abs(model.coef_path_[:, 2:]).max() < 10.0
