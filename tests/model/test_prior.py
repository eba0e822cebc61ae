"""What is usual, beside the squares of residuals."""

import numpy as np
import pytest

from skhoid.model.cores import Prior, Usual

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
