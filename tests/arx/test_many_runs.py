"""Batch arithmetic of the studies against the estimators, and its kernels against slow twins."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from support import naive
from support import thesis_recursion as thesis

from skhoid import ARXRegressor, DelaySearchCV
from skhoid._kernels.rls import MANY, free_runs
from skhoid._kernels.trade_off import free_runs_of_many
from skhoid.arx.many_runs import fit_runs, score_horizons, search_delays

pytestmark = pytest.mark.slow  # compiles for many runs side by side

BEFORE, NK = thesis.BEFORE, 29
SHORT = slice(60, 160)  # what is scored of short runs
HORIZONS = [4.0, 64.0, 256.0, np.inf]
compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="takes minutes uncompiled")


def short_runs(noise, n_runs=3, n=200, seed=0):
    """Smooth e and the u of an operator whose gain doubles halfway, from before the window."""
    e, white = np.random.default_rng(seed).standard_normal((2, n_runs, BEFORE + n))
    e = lfilter([0.1], [1, -1.7, 0.8], e, axis=1)
    drive = noise * white
    gain = np.where(np.arange(n + BEFORE - NK - 1) < BEFORE + n // 2, 1.0, 2.0)
    drive[:, NK + 1 :] += gain * (0.3 * e[:, 1:-NK] - 0.25 * e[:, : -NK - 1])
    return e, lfilter([1], [1, -1.6, 0.75], drive, axis=1)


def shifted(e, u):
    """e from one sample before the window, delayed by NK; u from its beginning."""
    return e[:, BEFORE - NK - 1 : -NK], u[:, BEFORE:]


# Delays


def check_delays(e, u, nks, rtol):
    losses, theta = search_delays(e, u, BEFORE, nks)
    assert losses.shape == (len(e), len(nks))
    assert theta.shape == (len(e), len(nks), 4)
    for run, (x, y) in enumerate(zip(e[:, BEFORE:, None], u[:, BEFORE:], strict=True)):
        search = DelaySearchCV(ARXRegressor(), nk=nks).fit(x, y)
        np.testing.assert_allclose(losses[run], search.loss_, rtol=rtol)
        assert nks[losses[run].argmin()] == search.best_nk_
        longest = ARXRegressor(nk=max(nks)).fit(x, y)  # it alone has the rows of all candidates
        found = theta[run, list(nks).index(max(nks))]
        np.testing.assert_allclose(found, longest.coef_, rtol=1e3 * rtol)


@compiled
@pytest.mark.parametrize(("condition", "P_n"), [("C1", 0.0), ("C4", 0.3)])
def test_delays_are_those_of_the_search(condition, P_n):
    """Without remnant too, where losses are next to nothing."""
    check_delays(*thesis.e_and_u(condition, P_n, 2), range(15, 49), 1e-11)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31), st.lists(st.integers(0, 6), min_size=1, max_size=4, unique=True))
def test_delays_against_the_naive_twin(seed, nks):
    e, u = np.random.default_rng(seed).standard_normal((2, 2, 30))
    losses, _ = search_delays(e, u, 3, nks)
    for x, y, found in zip(e[:, 3:, None], u[:, 3:], losses, strict=True):
        twin = naive.one_step_losses(y, x, [(0, 27)], 2, 2, nks)
        np.testing.assert_allclose(found, twin, rtol=1e-9)


def nearly_a_line(rest):
    """Inputs that are straight lines but for some noise, and an output of delay 3."""
    rng = np.random.default_rng(5)
    e = np.arange(200) / 100 + rest * rng.standard_normal((2, 200))
    u = np.zeros((2, 200))
    for t in range(4, 200):
        u[:, t] = 0.5 * u[:, t - 1] + 0.2 * e[:, t - 3] - 0.1 * e[:, t - 4]
    return e, u + 1e-9 * rng.standard_normal((2, 200))


def test_what_normal_equations_cannot_solve():
    """Regressors whose squares agree in 14 digits: by QR, as in the search."""
    e, u = nearly_a_line(1e-7)
    losses, theta = search_delays(e, u, 0, range(6))
    for run in range(2):
        search = DelaySearchCV(ARXRegressor(), nk=range(6)).fit(e[run, :, None], u[run])
        np.testing.assert_allclose(losses[run], search.loss_, rtol=1e-6)
    batch = ARXRegressor(nk=5).fit(e[1, :, None], u[1])
    np.testing.assert_allclose(theta[1, 5], batch.coef_, rtol=1e-4)


def test_dependent_regressors_have_no_loss():
    e, u = np.random.default_rng(0).standard_normal((2, 2, 60))
    e[1] = 0.0
    losses, theta = search_delays(e, u, 0, [1, 2])
    np.testing.assert_array_equal(np.isnan(losses), [[False] * 2, [True] * 2])
    np.testing.assert_array_equal(np.isnan(theta).all(axis=2), np.isnan(losses))
    assert np.isnan(fit_runs(e, u)).any(axis=1).tolist() == [False, True]


@pytest.mark.parametrize("n", [200, 203])
def test_a_delay_gives_the_same_bits_beside_others(n):
    """However rows and delays are grouped."""
    e, u = short_runs(0.1, 1, n)
    losses, theta = search_delays(e, u, BEFORE, range(40))
    for shortest in (1, 8, 39):
        alone = search_delays(e, u, BEFORE, range(shortest, 40))
        np.testing.assert_array_equal(alone[0], losses[:, shortest:])
        np.testing.assert_array_equal(alone[1], theta[:, shortest:])


# Batch fits


# Forgetting


@pytest.mark.parametrize(("begin", "end"), [(13, 41), (0, 3)])
def test_free_runs_of_many_are_those_of_one(begin, end):
    """Bit for bit, however rows are grouped; the fastest lanes are unstable and reach the bound."""
    rng = np.random.default_rng(end)
    na, nb, n_runs, bound = 2, 2, 3, 1e9
    e, u = rng.standard_normal((n_runs, end + nb - 1)), rng.standard_normal((n_runs, end + 3))
    u[rng.random(u.shape) < 0.1] = np.nan
    path = rng.standard_normal((end, na + nb, MANY)) * np.linspace(0.1, 2, MANY)
    lost = free_runs_of_many(e, u, path, begin, end, bound)
    columns, lags = np.repeat([0, 1], [na, nb]), np.r_[1 : na + 1, 0:nb]
    edges = [np.array([at]) for at in (nb - 1, end + nb - 1, 0)]
    at = np.maximum(np.arange(1 - nb, end), 0)
    for r in range(n_runs):
        signals, out = np.full((2, end + nb - 1), np.nan), np.empty((end, MANY))
        signals[1] = e[r]
        free_runs(signals, columns, lags, na, *edges, path, at, bound, out)
        squares = np.square(u[r, begin:end, None] - out[begin:])
        np.testing.assert_array_equal(lost[r], np.nancumsum(squares, axis=0)[-1])  # one by one
        for lane in (0, MANY - 1):
            twin = naive.free_run_along(
                e[r, :, None], [(nb - 1, end + nb - 1)],
                lambda theta: (theta[:na], [theta[na:]], 0.0),
                path[at, :, lane], [0], past=[0], bound=bound,
            )[nb - 1 :]  # fmt: skip
            scored = np.arange(begin, end)[~np.isnan(u[r, begin:end])]
            expected = np.sum((u[r, scored] - twin[scored]) ** 2)
            np.testing.assert_allclose(lost[r, lane], expected, rtol=1e-9)


def check_trade_off(e, u, window):
    """The arithmetic of the thesis' tests, run by run, gives the same bits."""
    end = window[1]
    theta0 = thesis.of_first_part(e[0, 1:], u[0])
    vaf = score_horizons(e[0], u[0], theta0, e[1:], u[1:], thesis.HORIZONS, window=window)
    assert vaf.shape == (2, len(thesis.HORIZONS), len(e))
    for form, inflation in enumerate(thesis.settings()):
        path = thesis.paths(e[0, 1:, None], u[0, :, None], inflation)
        for run in range(len(e)):
            found = thesis.vaf_along(path, e[run, : end + 1], u[run])
            np.testing.assert_array_equal(vaf[form, :, run], found[: len(thesis.HORIZONS)])
    return vaf


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_trade_off_of_short_runs(noise, monkeypatch):
    monkeypatch.setattr(thesis, "TRANSITION", SHORT)
    check_trade_off(*shifted(*short_runs(noise)), (SHORT.start, SHORT.stop))
