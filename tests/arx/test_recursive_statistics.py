"""RecursiveARX: what its deviations promise over many recordings, and what "auto" finds."""

import numpy as np
import pytest
from support import naive
from support.recursion_twin import (
    ORDERS,
    P0,
    THETA0,
    changing_runs,
    instants_of,
    recursive,
    respond_to_gain,
)
from support.synthetic import A, B, arx_runs

from skhoid import RecursiveARX, forgetting_factor

pytestmark = pytest.mark.slow

TRUTH = np.array([*A, *B])
GRID = [*(2.0 ** np.arange(1, 14)), np.inf]


@pytest.mark.parametrize(("forgetting", "n_rows"), [(0.98, 104)])
def test_standard_deviations(forgetting, n_rows):
    """Mean over 200 recordings of d' C^-1 d / 4, d the error of theta; 1 when C is right.

    Its standard deviation is sqrt(2 / 4 / 200) = 0.05; 4 sigma, and 0.08 for what is not small:
    sigma^2 alpha says too much of the variance of an error when memory is short, and P is random.
    """
    total, n = np.zeros(4), 200
    normalised = 0.0
    for seed in range(n):
        X, y = arx_runs(1, n_rows, seed=seed, noise=0.5)
        model = RecursiveARX(**ORDERS, forgetting=forgetting, init=TRUTH, p0=1e6).fit(X, y)
        error = model.coef_ - TRUTH
        normalised += error @ np.linalg.solve(model.covariance_, error) / 4 / n
        total += (error / model.standard_errors_) ** 2 / n
    assert normalised == pytest.approx(1.0, abs=0.20 + 0.08)
    np.testing.assert_allclose(total, 1.0, atol=4 * np.sqrt(2 / n) + 0.08)


def log_likelihoods(instants, horizons, theta0, p0):
    found = []
    for horizon in horizons:
        *_, errors = naive.recursive_least_squares(
            instants, forgetting_factor(horizon), theta0, p0, dtype=float
        )
        found.append(naive.predictive_log_likelihood(errors.values()))
    return np.array(found)


@pytest.mark.parametrize("n_runs", [1, 2])
def test_auto_maximises_the_predictive_likelihood(n_runs):
    X, y = changing_runs(300, n_runs)
    model = recursive(forgetting="auto").fit(X, y)
    found = log_likelihoods(instants_of(X, y), GRID, THETA0, P0)
    best = GRID[int(np.argmax(found))]
    assert model.memory_horizon_ == best
    fixed = recursive(memory_horizon=best).fit(X, y)
    np.testing.assert_allclose(model.coef_path_, fixed.coef_path_, rtol=1e-10, atol=1e-12)


def drifting_run(n_rows, speed, seed):
    """b0 walks at random, ``speed`` being the standard deviation of a step; errors of 0.1."""
    e, white, steps = np.random.default_rng(seed).standard_normal((3, n_rows))
    u = respond_to_gain(1 + speed * np.cumsum(steps), e, 0.1 * white)
    return e[:, None], u


def test_auto_forgets_faster_what_changes_faster():
    """One step of 0.1 / N in b0 against errors of 0.1: a memory of the order of N balances both."""
    medians = []
    for balance in (8, 64, 512):
        found = [
            recursive(forgetting="auto")
            .fit(*drifting_run(3000, 0.1 / balance, seed))
            .memory_horizon_
            for seed in range(4)
        ]
        medians.append(np.median(found))
    assert medians[0] < medians[1] < medians[2]
    for balance, median in zip((8, 64, 512), medians, strict=True):
        assert balance / 4 <= median <= 4 * balance
