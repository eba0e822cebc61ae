"""The start of recursions beside noise: derivatives, optimum, factors."""

import numpy as np
import pytest
from scipy.signal import lfilter

from skhoid.arx.orders import Orders
from skhoid.tracking.whitened import (
    Window,
    stabilised,
    stable,
)

ORDERS = Orders.of(2, 2, 3, 1)
THETA = np.array([-1.5, 0.7, 0.3, -0.1])
AR = np.array([-0.9])


def recording(n=3000, noise=0.1, seed=0):
    rng = np.random.default_rng(seed)
    e = lfilter([0.3], [1, -0.7], rng.standard_normal(n))
    w = lfilter(np.r_[np.zeros(3), THETA[2:]], np.r_[1, THETA[:2]], e)
    return e[:, None], w + noise * lfilter([1.0], np.r_[1, AR], rng.standard_normal(n))


def test_slopes_are_derivatives():
    X, y = recording(600)
    window = Window([(X, y)], ORDERS, 2, 0.05)
    at = np.r_[THETA + np.array([0.01, -0.02, 0.01, 0.02]), -0.8, 0.1]
    steps = 1e-6 * np.eye(at.size)
    slopes = [(window.errors(at + h) - window.errors(at - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(window.slopes(at), np.stack(slopes, axis=1), atol=1e-6)


def test_the_truth_is_found_beside_noise_that_least_squares_takes_for_the_system():
    X, y = recording(noise=0.3)
    start = Window([(X[:1500], y[:1500]), (X[1500:], y[1500:])], ORDERS, 2, 0.05).estimate()
    sd = np.sqrt(start.noise_variance * np.diag(np.linalg.inv(start.information)))
    assert (np.abs(start.theta - THETA) < 4 * sd).all()
    assert start.d[0] == pytest.approx(AR[0], abs=0.06)
    assert start.noise_variance == pytest.approx(0.09, rel=0.1)


def test_poles_outside_are_moved_inside():
    assert stable(THETA[:2])
    np.testing.assert_array_equal(stabilised(THETA, 2), THETA)
    moved = stabilised(np.r_[-2.5, 1.0, 0.3, 0.1], 2)  # poles at 2 and 0.5
    assert stable(moved[:2])
    assert np.sort(np.roots(np.r_[1.0, moved[:2]])) == pytest.approx([0.5, 0.97])
    np.testing.assert_array_equal(moved[2:], [0.3, 0.1])
