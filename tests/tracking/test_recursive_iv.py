"""RecursiveIV: exact where it is linear, and unbiased whatever the remnant."""

import numpy as np
import pytest
from support.whitened_runs import NK, whitened_runs

from skhoid import (
    ARXRegressor,
    RankDeficiencyError,
    RecursiveIV,
    ShortRunError,
    make_tracking_runs,
    operator_parameters,
)
from skhoid.arx.instruments import instrument_lags
from skhoid.tracking.whitened import START_WORTH

DT = 0.05


def test_without_poles_and_noise_model_it_is_weighted_two_stage_least_squares():
    rng = np.random.default_rng(0)
    n, lam, m = 2000, 0.99, 800
    f_t = rng.standard_normal(n)
    remnant = rng.standard_normal(n)
    e = np.convolve(f_t, [0.5, 1.0, 0.3, -0.4])[:n] + 0.5 * np.r_[0, remnant[:-1]]
    u = 0.5 * np.r_[0, e[:-1]] - 0.2 * np.r_[0, 0, e[:-2]] + 0.3 * remnant
    X = np.column_stack([e, f_t])
    options = {"inputs": [0], "instruments": [1], "noise_order": 0, "dt": DT}
    model = RecursiveIV(0, 2, 1, memory_time=DT / (1 - lam), init_window=m * DT, **options).fit(
        X, u
    )

    lags = instrument_lags(DT, 1, 2, 1)
    phi = np.stack([np.r_[np.zeros(k), e[:-k]] for k in (1, 2)], axis=1)
    Z = np.stack([np.r_[np.zeros(k), f_t[:-k]] for k in lags], axis=1)
    wait = int(lags[-1]) + 1 + round(2.0 / DT)  # the longest lag is known, and filters settled
    A = Z[wait:m].T @ np.column_stack([Z, phi, u])[wait:m]
    skip = 2 + round(2.0 / DT)
    A = A * START_WORTH * min(1 / (1 - lam), m - skip) / (m - skip)
    for t in range(wait, n):
        A = lam * A + np.outer(Z[t], np.r_[Z[t], phi[t], u[t]])
        if t % 300 == 0:
            ZZ, ZP, ZY = A[:, : lags.size], A[:, lags.size : -1], A[:, -1]
            W = np.linalg.solve(ZZ, ZP)
            np.testing.assert_allclose(
                model.coef_path_[t], np.linalg.solve(W.T @ ZP, W.T @ ZY), rtol=1e-7
            )


@pytest.fixture(scope="module")
def loop():
    return make_tracking_runs(
        "C1",
        n_runs=5,
        remnant_intensity=0.15,
        remnant_order=1,
        channels=["e", "f_t"],
        random_state=43,
        run_in=20.0,
    )


def test_it_ends_where_the_batch_does(loop):
    model = RecursiveIV(nk=29, inputs=["e"]).fit(*loop)
    batch = ARXRegressor(nk=29, inputs=["e"], method="iv", instruments=["f_t"]).fit(*loop)
    np.testing.assert_array_less(np.abs(model.coef_ - batch.coef_), 1.5 * batch.standard_errors_)


def test_remnant_does_not_bias_it(loop):
    """Remnant of order 1, of which least squares makes real poles."""
    path = operator_parameters(RecursiveIV(nk=29, inputs=["e"], memory_time=10.24).fit(*loop))
    end = path.loc[60:, ["K_edot", "omega_nm"]].mean() / [0.036, 11.25] - 1
    assert (end.abs() < 0.1).all()


def test_errors(loop):
    X, y = loop
    with pytest.raises(ValueError, match="RecursiveIV needs external signals in X"):
        RecursiveIV(nk=29).fit(X[["e"]], y)
    with pytest.raises(ValueError, match="memory_time"):
        RecursiveIV(nk=29, inputs=["e"], memory_time=[9.0, 9.0, 5.0, 5.0]).fit(X, y)
    with pytest.raises(ShortRunError, match="Use longer runs"):
        RecursiveIV(nk=29, inputs=["e"]).fit(X.iloc[:430], y.iloc[:430])
    with pytest.raises(RankDeficiencyError, match="instruments"):
        RecursiveIV(nk=29, inputs=["e"]).fit(X.assign(f_t=0.0), y)


def test_with_all_memory_it_is_the_batch_estimate():
    """In standard deviations of the batch: its D is of order 10, and filters are the last ones."""
    off, spread = [], []
    for seed in range(3):
        X, y = whitened_runs(1, 6000, seed=seed, noise=0.3)
        model = RecursiveIV(nk=NK, inputs=["e"], noise_order=2, init_window=20.0).fit(X, y)
        batch = ARXRegressor(nk=NK, inputs=["e"], method="iv", instruments=["f_t"]).fit(X, y)
        off.append((model.coef_ - batch.coef_) / batch.standard_errors_)
        spread.append(model.standard_errors_ / batch.standard_errors_)
    assert np.sqrt(np.mean(np.square(off))) < 0.7
    np.testing.assert_allclose(np.mean(spread, axis=0), 1.0, atol=0.08)


@pytest.mark.slow
def test_nothing_is_infinite():
    """Measured largest |b| of 300 runs: 1.8 with 5.12 s, 7.6 with 2.56 s, 12.7 with 1.28 s."""
    X, y = make_tracking_runs(
        "C4", n_runs=2, remnant_intensity=0.25, remnant_order=4, channels=["e", "f_t"],
        random_state=104,
    )  # fmt: skip
    for run in range(2):
        model = RecursiveIV(nk=29, inputs=["e"], memory_time=2.56)
        path = model.fit(X.loc[[run]], y.loc[[run]]).coef_path_
        assert np.isfinite(path).all()
        assert np.abs(path[:, :2]).max() <= 2.0
        assert np.abs(path[:, 2:]).max() < 20
