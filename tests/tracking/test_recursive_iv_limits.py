"""RecursiveIV beside the batch estimate, several instruments, and what is missing of them."""

import warnings

import numpy as np
import pytest
from support.whitened_runs import NK, THETA, whitened_runs

from skhoid import (
    ARXRegressor,
    RecursiveIV,
    make_tracking_runs,
    operator_parameters,
)

pytestmark = pytest.mark.slow  # compiles for many seconds

SMALL = {"nk": NK, "inputs": ["e"], "noise_order": 2, "init_window": 20.0}


@pytest.mark.parametrize(("n_rows", "within"), [(3000, 1.0), (24_000, 0.3)])
def test_with_all_memory_it_is_the_batch_estimate(n_rows, within):
    """In standard deviations of the batch: its D is of order 10, and filters are the last ones."""
    off, spread = [], []
    for seed in range(6):
        X, y = whitened_runs(1, n_rows, seed=seed, noise=0.3)
        model = RecursiveIV(**SMALL).fit(X, y)
        batch = ARXRegressor(nk=NK, inputs=["e"], method="iv", instruments=["f_t"]).fit(X, y)
        off.append((model.coef_ - batch.coef_) / batch.standard_errors_)
        spread.append(model.standard_errors_ / batch.standard_errors_)
    assert np.sqrt(np.mean(np.square(off))) < within
    np.testing.assert_allclose(np.mean(spread, axis=0), 1.0, atol=0.06)


def test_it_has_no_bias_where_least_squares_of_the_same_rows_has():
    """The mean of 30 runs, in its own standard deviations."""
    found = {"iv": [], "ols": []}
    for seed in range(30):
        X, y = whitened_runs(1, 1500, seed=seed, noise=0.5)
        found["iv"].append(RecursiveIV(**SMALL).fit(X, y).coef_)
        found["ols"].append(ARXRegressor(nk=NK, inputs=["e"]).fit(X, y).coef_)
    z = {
        name: (np.mean(c, axis=0) - THETA) / (np.std(c, axis=0) / np.sqrt(30))
        for name, c in found.items()
    }
    assert np.abs(z["iv"]).max() < 4
    assert np.abs(z["ols"]).max() > 20


@pytest.mark.parametrize("condition", ["C1", "C4", "C6"])
def test_nothing_is_infinite(condition):
    """Measured largest |b| of 300 runs: 1.8 with 5.12 s, 7.6 with 2.56 s, 12.7 with 1.28 s."""
    for order in (1, 2, 3, 4):
        X, y = make_tracking_runs(
            condition, n_runs=25, remnant_intensity=0.25, remnant_order=order,
            channels=["e", "f_t"], random_state=100 + order,
        )  # fmt: skip
        for run in range(25):
            model = RecursiveIV(nk=29, inputs=["e"], memory_time=2.56)
            path = model.fit(X.loc[[run]], y.loc[[run]]).coef_path_
            assert np.isfinite(path).all()
            assert np.abs(path[:, :2]).max() <= 2.0
            assert np.abs(path[:, 2:]).max() < 20


@pytest.mark.xfail(
    strict=True, reason="beside remnant of order 4, D and F lead each other astray, for good"
)
@pytest.mark.parametrize("remnant_intensity", [0.1, 0.25])
def test_remnant_of_order_4_does_not_lose_the_operator(remnant_intensity):
    """T0 = 2.56 s. Measured at the end of 25 runs: lost 52 % at P_n = .1, 88 % at .25."""
    X, y = make_tracking_runs(
        "C1", n_runs=25, remnant_intensity=remnant_intensity, remnant_order=4,
        channels=["e", "f_t"], random_state=104,
    )  # fmt: skip
    lost = 0
    for run in range(25):
        model = RecursiveIV(nk=29, inputs=["e"], memory_time=2.56)
        model.fit(X.loc[[run]], y.loc[[run]])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            omega = operator_parameters(model)["omega_nm"].iloc[-1]
        lost += not 3 < omega < 35
    assert lost <= 3
