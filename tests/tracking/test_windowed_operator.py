"""Windowed maximum likelihood: its kernel against a plain twin, and what it finds."""

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from support import window_twin as twin

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid._kernels import window as kernel
from skhoid.exceptions import ShortRunError
from skhoid.tracking.operator_fitting import OperatorRecord, OperatorSearch
from skhoid.tracking.windowed_operator import WindowedOperator

DT = 0.01
TRUE = pd.Series({"K_e": 0.09, "K_edot": 0.036, "tau_e": 0.28, "omega_nm": 11.25, "zeta_nm": 0.35})
NO_SHARE = np.full(4, -1)


def signal(n=1500, seed=0):
    """A smooth error."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    omega = np.array([0.5, 1.1, 2.3, 3.7, 5.9, 8.3, 12.1])
    return np.sin(np.outer(t, omega) + rng.uniform(0, 6, 7)) @ (1 / (1 + omega / 3))


def make_record(e, y, known=None):
    n = e.size
    return OperatorRecord(
        e=e,
        y=y,
        known=np.ones(n, dtype=bool) if known is None else known,
        number=np.arange(n),
        time=np.arange(n) * DT,
        stretches=np.array([[0, n, 0]]),
        dt=DT,
    )


def coloured(n, scale, seed):
    white = np.random.default_rng(seed).standard_normal(n + 100)
    x = np.zeros(n + 100)
    for k in range(1, n + 100):
        x[k] = 0.9 * x[k - 1] + white[k]
    return scale * x[100:]


@pytest.fixture(scope="module")
def noisy():
    return make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=3, duration=40.0)


@pytest.mark.parametrize(
    ("omega", "zeta", "dt"), [(11.25, 0.35, 0.01), (5.0, 1.0, 0.02), (30, 1.9, 0.05)]
)
def test_matrices_are_those_of_the_matrix_exponential(omega, zeta, dt):
    q = np.array([np.log(omega), np.log(zeta), 0.3, 0.0, 0.0])
    e = signal(200)
    pieces = np.array([[100, 160, 0, 0, 0, 60]])
    gains, states = np.array([0.09, 0.036]), np.array([[0.2, -1.0]])
    time = np.arange(200) * dt
    found = kernel.simulated(e, time, pieces, 1, dt, q, gains, states, NO_SHARE, 0, 60)
    expected = twin.output(e, 100, 160, dt, *gains, omega, zeta, 0.3, states[0])
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)


def test_sigmoids_act_before_the_delay():
    e = signal(600)
    share_of = np.array([0, 1, 0, 1])
    q = np.array([np.log(9.0), np.log(0.3), 0.2537, np.log(13.0), np.log(0.8)])
    q = np.append(q, [np.log(4.0), 3.0, np.log(9.0), 3.5])
    gains, states = np.array([0.09, 0.04, -0.03, 0.05]), np.array([[0.1, 0.3]])
    time, pieces = np.arange(600) * DT, np.array([[100, 600, 0, 0, 0, 120]])
    found = kernel.simulated(e, time, pieces, 4, DT, q, gains, states, share_of, 2, 125)
    t = time[100:] - 0.2537
    one, two = 1 / (1 + np.exp(-4 * (t - 3.0))), 1 / (1 + np.exp(-9 * (t - 3.5)))
    expected = twin.output(
        e, 100, 600, DT, 0.09 - 0.03 * one, 0.04 + 0.05 * two, 9 + 4 * one, 0.3 + 0.5 * two, 0.2537,
        states[0],
    )  # fmt: skip
    np.testing.assert_allclose(found, expected[::4], rtol=1e-9, atol=1e-11)


def test_the_delay_is_a_cubic_convolution_with_a_continuous_slope():
    e = signal(400)
    for delay in (28.0, 27.3, 5.999999):
        out = np.empty(100)
        kernel._delayed(e, 200, 300, 0, delay, out)
        np.testing.assert_allclose(out, twin.delayed(e, np.arange(200, 300), delay), atol=1e-13)
    slopes = []
    for delay in (28 - 1e-4, 28 + 1e-4):
        ends = np.empty((2, 100))
        for row, d in zip(ends, (delay - 5e-5, delay + 5e-5), strict=True):
            kernel._delayed(e, 200, 300, 0, d, row)
        slopes.append((ends[1] - ends[0]) / 1e-4)
    assert abs(slopes[0] - slopes[1]).max() < 1e-4 * abs(slopes[0]).max()


def test_fit_is_the_minimum_that_scipy_finds_for_the_same_criterion():
    e = signal(900)
    y = twin.output(e, 0, 900, DT, 0.09, 0.04, 10.0, 0.4, 0.253) + coloured(900, 0.01, 1)
    record = make_record(e, y)
    search = OperatorSearch.of(record)
    pieces = record.pieces(100, 800, 3)
    start = np.array([np.log(8.0), np.log(0.5), 0.3, np.log(8.0), np.log(0.5)])
    fit = search.fitted(pieces, start, np.zeros(3), 1e-14)
    floor = kernel.FLOOR * (pieces.y[pieces.valid] ** 2).sum()

    def errors(theta):
        out = twin.output(
            e, 100, 800, DT, theta[0], theta[1], np.exp(theta[2]), np.exp(theta[3]), theta[4],
            theta[8:10],
        )[::4]  # fmt: skip
        white = twin.prediction_errors(pieces.y - out, theta[5:8], pieces.valid)
        return np.append(white, np.sqrt(floor) * theta[5:8])

    begin = np.concatenate([[0.08, 0.03], start[:3], np.zeros(3), [0.0, 0.0]])
    best = least_squares(errors, begin, x_scale="jac", xtol=1e-13, ftol=1e-14, gtol=1e-14)
    theirs = best.x[:8]
    ours = np.concatenate([fit.gains, fit.dynamics[:3], fit.ar])
    np.testing.assert_allclose(ours, theirs, rtol=2e-6, atol=1e-8)
    J = best.jac[: pieces.valid.size]
    normal = J.T @ J + np.diag([0] * 5 + [floor] * 3 + [0, 0])
    expected = np.linalg.inv(normal)[:8, :8] * fit.squares / (pieces.valid.size - 10)
    np.testing.assert_allclose(np.diag(fit.covariance), np.diag(expected), rtol=1e-3)


def test_without_remnant_the_true_parameters_are_found():
    e = signal(6000)
    y = twin.output(e, 0, 6000, DT, 0.09, 0.036, 11.25, 0.35, 0.2837)
    model = WindowedOperator(8.0, 4.0, dt=DT, inputs=[0]).fit(e[:, None], y)
    path = model.parameters_path_[list(TRUE.index)]
    expected = TRUE.replace({0.28: 0.2837})
    assert abs(path / expected - 1).max().max() < 1e-3
    np.testing.assert_allclose(model.predict(e[:, None])[500:], y[500:], atol=3e-3 * y.std())


def test_whole_records_agree_with_the_operator_regressor():
    X, y = make_tracking_runs("C1", n_runs=1, remnant_intensity=0.1, random_state=8)
    model = WindowedOperator(81.9, 81.9).fit(X, y)
    other = OperatorRegressor().fit(X, y).parameters_
    for name in ("K_e", "K_edot", "omega_nm", "zeta_nm"):
        mine = model.parameters_.loc[name]
        assert abs(mine.value - other.value[name]) < 0.6 * mine.sd, name
        assert 0.5 < mine.sd / other.sd[name] < 2, name
    # The regressor's inputs are linear between samples, which takes half a sample less.
    assert abs(model.parameters_.value["tau_e"] + DT / 2 - other.value["tau_e"]) < 0.006


def test_a_fast_change_is_missed_in_the_windows_that_contain_it():
    X, y, truth = make_tracking_runs(
        "C4", n_runs=3, remnant_intensity=0.05, random_state=2, return_truth=True
    )
    path = WindowedOperator(10.0, 1.0).fit(X, y).parameters_path_
    error = abs(path["K_edot"] / truth.parameters["K_edot"].reindex(path.index) - 1)
    around = error[abs(path.index.to_numpy() - 40.96) < 3].mean()
    after = error[path.index > 50].mean()
    assert around > 3 * after
    assert after < 0.15


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"window": 100.0}, ShortRunError, "window = 100 s, but the longest stretch"),
        ({"window": 0.1}, ShortRunError, "no piece of the record has rows"),
        ({"window": -1}, ValueError, "The 'window' parameter"),
    ],
)
def test_bad_options_are_refused(noisy, options, error, match):
    with pytest.raises(error, match=match):
        WindowedOperator(**options).fit(*noisy)
