"""What is usual, beside the squares of residuals."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.model.cores import Prior, Usual
from skhoid.model.fitting import Criterion, minimise

NAMES = ["gain", "omega", "tau"]
USUAL = {"omega": Usual(9.0, 0.4, relative=True), "tau": Usual(0.2, 0.1), "other": Usual(1, 1)}


@pytest.fixture(scope="module")
def prior():
    return Prior.of(NAMES, USUAL).weighing(0.3)


@pytest.mark.parametrize("theta", [(1.0, 5.0, 0.4), (0.0, 30.0, 0.1), (2.0, 9.0, 0.2)])
def test_normal_equations_are_the_derivative_of_the_cost(prior, theta):
    theta = np.array(theta)
    normal, gradient = prior.normal_equations(theta)
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-6 * max(theta[i], 0.1)
        slope = (prior.cost(theta + step) - prior.cost(theta - step)) / (2 * step[i])
        assert gradient[i] == pytest.approx(-slope / 2, abs=1e-7)
    # of Gauss and Newton: products of the derivatives of the distances
    off = np.diag([0.0, 1 / (theta[1] * 0.4), 1 / 0.1])
    np.testing.assert_allclose(normal, 0.3 * off.T @ off)


@pytest.fixture(scope="module")
def fitted():
    X, y = make_tracking_runs(n_runs=2, duration=20.48, remnant_intensity=0.2, random_state=1)
    prepared = OperatorRegressor().prepare(X, y)
    return OperatorRegressor().first_fit(prepared)


def test_minimise_lowers_squares_and_cost_together(fitted):
    simulator, criterion = fitted.simulator, Criterion(fitted.simulator.record)
    heavy = Prior.of(simulator.names, {"omega_nm": Usual(20.0, 0.05, relative=True)})
    heavy = heavy.weighing(fitted.sse / criterion.n * 100)
    fit = minimise(simulator, criterion, fitted.theta, max_iter=60, tol=1e-9, prior=heavy)
    fit = minimise(simulator, criterion, fit.theta, max_iter=60, tol=1e-9, prior=heavy)

    def total(theta):
        return criterion.sse(simulator.run(theta)) + heavy.cost(theta)

    assert total(fit.theta) < total(fitted.theta)
    at = simulator.names.index("omega_nm")
    assert abs(fit.theta[at] - 20) < abs(fitted.theta[at] - 20)
    assert fit.sse == pytest.approx(criterion.sse(simulator.run(fit.theta)))  # without the cost
    # a minimum: steps either way along each parameter cost more
    for i in range(fit.theta.size):
        for sign in (1, -1):
            moved = fit.theta.copy()
            moved[i] += sign * 0.01 * simulator.size(i, moved[i])
            assert total(moved) > total(fit.theta)
