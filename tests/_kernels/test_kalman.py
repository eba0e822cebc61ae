"""Kalman filters on the operator against naive twins, exact filters, and themselves in pieces."""

import numpy as np
import pytest
from numba import njit
from scipy.linalg import expm

from skhoid._kernels import kalman
from skhoid.human.operator import held_filter
from tests.support import kalman_twin as twin

pytestmark = pytest.mark.slow  # compiles for many seconds, and fits

PARAMETERS = np.array([11.25, 0.35, 0.284, 0.09, 0.036])
METHODS = {"ukf": kalman.UKF, "ekf": kalman.EKF, "dual_ekf": kalman.DUAL}


def signals(n_rows=400, seed=0):
    """An error, and an output that has little to do with it."""
    rng = np.random.default_rng(seed)
    e = np.convolve(rng.standard_normal(n_rows + 30), np.hanning(30) / 5, "valid")[:n_rows]
    return e, 0.1 * np.roll(e, 40) + 0.01 * rng.standard_normal(n_rows)


@njit
def discretised(omega, zeta, dt, slopes):
    kalman.held_slopes(omega, zeta, dt, slopes)
    return kalman.held(omega, zeta, dt)


@pytest.mark.parametrize("zeta", [0.05, 0.999, 1.6])
@pytest.mark.parametrize("omega_dt", [0.02, 0.499, 3.0])
def test_the_discretisation_is_that_of_the_operator(zeta, omega_dt):
    omega, dt = omega_dt / 0.04, 0.04
    slopes = np.zeros((2, 6))
    a11, a12, a21, a22, b1, b2 = discretised(omega, zeta, dt, slopes)
    block = np.zeros((3, 3))
    block[:2] = [[0, 1, 0], [-(omega**2), -2 * zeta * omega, 1]]
    exact = expm(block * dt)[:2]
    np.testing.assert_allclose([[a11, a12, b1], [a21, a22, b2]], exact, rtol=1e-11, atol=1e-14)
    a1, a2, step, rate = held_filter(omega, zeta, dt)
    np.testing.assert_allclose([-a11 - a22, a11 * a22 - a12 * a21], [a1, a2], rtol=1e-12)
    np.testing.assert_allclose([omega**2 * b1, omega**2 * b2], [step, rate], rtol=1e-10)
    for row, (up, down) in zip(
        slopes,
        [
            ((omega * np.exp(1e-5), zeta), (omega * np.exp(-1e-5), zeta)),
            ((omega, zeta * np.exp(1e-5)), (omega, zeta * np.exp(-1e-5))),
        ],
        strict=True,
    ):
        after, before = (discretised(*at, dt, np.zeros((2, 6))) for at in (up, down))
        change = (np.array(after) - before) / 2e-5
        np.testing.assert_allclose(row, change, rtol=1e-6, atol=1e-8 * abs(change).max())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [0, 2])
def test_a_filter_is_its_textbook(method, m):
    e, y = signals(120)
    y[70:75] = np.nan
    wide = np.append(np.log([99, 9, 0.6]), [9, 9])
    row = twin.settings(m, jitter=np.array([1e-9, 1e-7]), high=wide)
    lane = twin.state(m, PARAMETERS, 0.1)
    n, at = 7 + m, kalman.layout(m)
    naive = twin.Twin(m, row, lane[:n], lane[at["P"] : at["P"] + n * n].reshape(n, n), e)
    found = twin.advance(m, METHODS[method], lane[None], row[None], e[None], y[None])
    step = {"ukf": naive.unscented, "ekf": naive.extended, "dual_ekf": naive.dual}[method]
    for t in range(e.size):
        if naive.ready(t):
            # Without a measurement nothing is forgotten.
            naive.noise[:5, :5] = np.diag(naive.walk) * np.isfinite(y[t])
            step(t, y[t])
        x, P = found["filtered"][0, t, :n], found["filtered"][0, t, n:].reshape(n, n)
        tolerance = 1e-9 if method == "ukf" else 1e-5  # slopes of the twin are differences
        np.testing.assert_allclose(x, naive.x, rtol=tolerance, atol=tolerance * 1e-2)
        np.testing.assert_allclose(P, naive.P, rtol=tolerance, atol=tolerance * abs(P).max())
    assert abs(x[:5] - np.log(PARAMETERS)).max() > 0.01


def known_parameters(method, m, y):
    """Filter and smoother when only z and the remnant are not known, and the exact ones."""
    e, _ = signals(y.size)
    row = twin.settings(m, walk=np.zeros(5), jitter=np.array([1e-7, 1e-5]))
    lane = twin.state(m, PARAMETERS, 0.0)
    found = twin.advance(m, METHODS[method], lane[None], row[None], e[None], y[None])
    model = twin.Twin(m, row, lane[: 7 + m], np.zeros((7 + m, 7 + m)), e)
    F = model.slopes(lambda x: model.moved(x, 100))[5:, 5:]
    omega, zeta, tau, K_e, K_edot = PARAMETERS
    block = np.zeros((3, 3))
    block[:2] = [[0, 1, 0], [-(omega**2), -2 * zeta * omega, 1]]
    step = expm(block * 0.01)
    F = np.zeros((2 + m, 2 + m))
    F[:2, :2], F[2:, 2:] = step[:2, :2], model.transition
    h = np.zeros(2 + m)
    h[:2] = omega**2 * np.array([K_e, K_edot])
    h[2:] = np.arange(m) == m - 1
    drives = [None] * y.size
    for t in range(y.size):
        if model.ready(t):
            drives[t] = np.append(step[:2, 2] * model.delayed(t, tau), np.zeros(m))
    exact = (F, drives, model.noise[5:, 5:], h, 1e-4, np.zeros(2 + m), model.P[5:, 5:], y)
    return found, exact


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [0, 2])
def test_with_known_parameters_it_is_the_exact_filter_and_smoother(method, m):
    _, y = signals(300)
    y[150:170] = np.nan
    found, exact = known_parameters(method, m, y)
    means, covariances, smooth, spreads = twin.linear(*exact)
    n, filtered = 7 + m, found["filtered"]

    def matches(x, P):
        np.testing.assert_allclose(filtered[0, :, 5:n], x, rtol=1e-9, atol=1e-12)
        found_P = filtered[0, :, n:].reshape(-1, n, n)
        np.testing.assert_allclose(found_P[:, 5:, 5:], P, rtol=1e-9, atol=1e-9 * abs(P).max())
        np.testing.assert_array_equal(found_P[:, :5], 0)

    matches(means, covariances)
    kalman.smooth_kalman(filtered, found["priors"], found["crosses"], found["fresh"])
    matches(smooth, spreads)
    assert abs(smooth - means).max() > 1e-4


@pytest.mark.parametrize("method", METHODS)
def test_a_filter_goes_on_bit_for_bit_and_beside_others(method):
    e, y = (np.stack(both) for both in zip(*(signals(300, seed) for seed in range(3)), strict=True))
    y[1, 100:140], e[2, 160] = np.nan, np.nan
    rows = np.stack([twin.settings(2, gate=3.0, scale_gain=0.001)] * 3)
    states = np.stack([twin.state(2, PARAMETERS * f) for f in (1.0, 0.9, 1.1)])
    alone, pieces = states.copy(), states.copy()
    whole = twin.advance(2, METHODS[method], states, rows, e, y)
    assert np.isfinite(whole["path"]).all()
    for lane in range(3):
        own = slice(lane, lane + 1)
        found = twin.advance(2, METHODS[method], alone[own], rows[own], e[own], y[own])
        np.testing.assert_array_equal(found["path"][0], whole["path"][lane])
    fresh = whole["fresh"]
    for begin, end in ((0, 1), (1, 31), (31, 150), (150, 300)):
        cut = (np.ascontiguousarray(values[:, begin:end]) for values in (e, y, fresh))
        twin.advance(2, METHODS[method], pieces, rows, *cut)
    np.testing.assert_array_equal(pieces, states)


def test_parameters_keep_to_their_bounds_and_are_counted():
    e, y = signals(2000)
    row = twin.settings(1, gate=4.0)
    row[kalman.settings_layout(1)["walk"] :][:5] = 1e-2
    lanes = twin.state(1, PARAMETERS)[None]
    low, high = (row[kalman.settings_layout(1)[name] :][:5] for name in ("low", "high"))
    found = twin.advance(1, kalman.EKF, lanes, row[None], e[None], y[None])
    path = found["path"][0, :, :5]
    assert ((path >= low) & (path <= high)).all()
    clamped = lanes[0, kalman.layout(1)["clamped"] :][:5]
    assert clamped.sum() > 10
    at_bound = ((path == low) | (path == high)).sum(axis=0)
    assert (at_bound >= clamped).all()


def test_an_outlier_counts_no_more_than_the_gate():
    e, y = signals(300)
    moved = []
    for size in (0.0, 1e3, 1e6):
        lane = twin.state(1, PARAMETERS, 0.1)[None]
        beyond = y.copy()
        beyond[250] += size
        twin.advance(1, kalman.UKF, lane, twin.settings(1, gate=4.0)[None], e[None], beyond[None])
        moved.append(lane[0, :5].copy())
    assert abs(moved[2] - moved[0]).max() < 0.3
    assert abs(moved[2] - moved[1]).max() < 0.2
