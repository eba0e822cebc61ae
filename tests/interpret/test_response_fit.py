"""Operators fitted to frequency responses, against SciPy."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from skhoid.interpret.conversion import OperatorUnderHold
from skhoid.interpret.response_fit import ResponseFit
from skhoid.tracking.wavelet_operator import SampledOperator

OMEGA = np.geomspace(0.3, 18, 12)
LOW, HIGH = np.array([-9.0, -9, 0.7, -3.9, 0.0]), np.array([9.0, 9, 3.7, 0.7, 0.8])
TRUE = np.array([[0.09, 0.04, 2.4, -1.0, 0.28], [0.2, 0.1, 1.9, -0.3, 0.11]])
MODELS = [
    SampledOperator(OMEGA, 0.01),
    OperatorUnderHold(OMEGA, 0.2, 0.01),
]


def fit_of(model):
    """Two operators with errors, of which the second has a filter at a bound."""
    rng = np.random.default_rng(0)
    H = np.einsum("nfi,ni->nf", model.gains(TRUE), TRUE[:, :2])
    H = H * (1 + 0.05 * rng.standard_normal(H.shape) + 0.05j * rng.standard_normal(H.shape))
    high = HIGH.copy()
    high[3] = -0.5
    return ResponseFit(model, H, 1 / np.abs(H), LOW, high)


@pytest.mark.parametrize("model", MODELS)
def test_slopes_are_derivatives(model):
    fit = fit_of(model)
    slopes = fit.look(TRUE)[1]
    for i, step in enumerate(1e-6 * np.eye(5)):
        difference = (fit.look(TRUE - step)[0] - fit.look(TRUE + step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, :, i], difference, atol=1e-5)


@pytest.mark.parametrize("model", MODELS)
def test_minima_are_those_of_scipy(model):
    fit = fit_of(model)
    grid = [np.array([np.log(8.0), np.log(0.4), tau]) for tau in (0.1, 0.2, 0.3)]
    p, squares = fit.find_best_minima(fit.starts(grid, 2))
    assert p[1, 3] == fit.high[3]
    for row in range(2):
        one = fit.of(np.array([row]))
        found = least_squares(
            lambda q, one=one: one.look(q[None])[0][0],
            np.clip(TRUE[row], LOW + 1e-6, fit.high - 1e-6),
            bounds=(LOW, fit.high),
            x_scale=[0.1, 0.1, 1, 1, 0.1],
            ftol=1e-12,
            xtol=1e-12,
        )
        assert squares[row] == pytest.approx(2 * found.cost, rel=1e-6)
        np.testing.assert_allclose(p[row], found.x, atol=2e-3)
