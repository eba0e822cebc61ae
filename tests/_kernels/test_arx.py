"""Compiled loops and array code against their naive twins."""

from fractions import Fraction
from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from support import naive

from skhoid import _kernels
from skhoid.arx.candidates import FittedCandidates
from skhoid.arx.least_squares import Triangle, robust_covariance, solutions
from skhoid.arx.orders import Orders, regressors

BOUND = 1e100


@st.composite
def problems(draw, *, missing=True):
    """Stretches of a recording, with gaps in between, and a model for it."""
    n_inputs = draw(st.integers(1, 3))
    lengths = draw(st.lists(st.integers(1, 14), min_size=1, max_size=4))
    skips = draw(st.lists(st.integers(0, 2), min_size=len(lengths), max_size=len(lengths)))
    stretches, at = [], 0
    for length, skip in zip(lengths, skips, strict=True):
        stretches.append((at + skip, at + skip + length))
        at += skip + length
    orders = Orders(
        draw(st.integers(0, 3)),
        tuple(draw(st.integers(1, 3)) for _ in range(n_inputs)),
        tuple(draw(st.integers(0, 4)) for _ in range(n_inputs)),
        draw(st.booleans()),
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    X, y = rng.standard_normal((at, n_inputs)), rng.standard_normal(at)
    if missing and draw(st.booleans()):
        y[rng.random(at) < 0.15] = np.nan
    scale = draw(st.sampled_from([0.3, 1.0, 50.0]))  # the larger ones are unstable
    theta = scale * rng.standard_normal(orders.n_params)
    return X, y, stretches, orders, theta


def edges(stretches):
    begin, end = np.array(stretches, dtype=np.int64).T
    return _kernels.gate(begin, np.int64), _kernels.gate(end, np.int64)


def unpadded(orders, b):
    return [row[:nb] for row, nb in zip(b, orders.nb, strict=True)]


def run_free(X, stretches, orders, theta, past=None, y0=None):
    a, b, intercept = orders.split(theta)
    begin, end = edges(stretches)
    known_from = begin if past is None else _kernels.gate(past, np.int64)
    initial = np.zeros((begin.size, max(a.size, 1))) if y0 is None else _kernels.gate(y0)
    found = _kernels.arx.free_run(
        _kernels.gate(X), begin, end, known_from, theta[None].copy(),
        np.zeros(len(X), dtype=np.int64), orders.na,
        np.array(orders.nb), np.array(orders.nk), initial, BOUND, False,
    )  # fmt: skip
    twin = naive.free_run(X, stretches, a, unpadded(orders, b), orders.nk, intercept, past, y0)
    return found, twin


def run_ahead(y, X, stretches, orders, theta, horizon):
    a, b, intercept = orders.split(theta)
    begin, end = edges(stretches)
    found = np.zeros(len(X))
    _kernels.arx.predict_ahead(
        np.array(y), _kernels.gate(X), 0, begin, end, begin, theta[None].copy(),
        np.zeros(len(X), dtype=np.int64), orders.na,
        np.array(orders.nb), np.array(orders.nk), horizon, BOUND, found,
    )  # fmt: skip
    twin = naive.predict_ahead(
        y, X, stretches, a, unpadded(orders, b), orders.nk, intercept, horizon
    )
    return found, twin


def assert_same(found, twin):
    # Unstable runs grow by many decades, and rounding with them.
    assert np.isfinite(found).all()
    assert np.abs(found).max(initial=0.0) <= BOUND
    np.testing.assert_allclose(found, twin, rtol=1e-7, atol=1e-10)


@settings(max_examples=150, deadline=None)
@given(problem=problems())
def test_regressors(problem):
    X, y, stretches, orders, _ = problem
    begin, end = np.array(stretches).T
    table, rows, n_missing = regressors(y, X, begin, end, orders)
    phi, output, twin_rows, twin_missing = naive.regressor_rows(
        y, X, stretches, orders.na, orders.nb, orders.nk, orders.intercept
    )
    np.testing.assert_array_equal(rows, twin_rows)
    np.testing.assert_array_equal(table[:, :-1], phi)
    np.testing.assert_array_equal(table[:, -1], output)
    assert n_missing == twin_missing


@settings(max_examples=80, deadline=None)
@given(problem=problems(missing=False), seed=st.integers(0, 2**31))
def test_free_run_with_past_inputs_and_initial_outputs(problem, seed):
    X, _, stretches, orders, theta = problem
    rng = np.random.default_rng(seed)
    lowest = [0, *[end for _, end in stretches[:-1]]]
    past = np.array(
        [rng.integers(low, b + 1) for low, (b, _) in zip(lowest, stretches, strict=True)]
    )
    y0 = rng.standard_normal((len(stretches), max(orders.na, 1)))
    assert_same(*run_free(X, stretches, orders, theta, past, y0))


@pytest.mark.parametrize("horizon", [1, 3, 40])
@settings(max_examples=40, deadline=None)
@given(problem=problems())
def test_predict_ahead(horizon, problem):
    X, y, stretches, orders, theta = problem
    assert_same(*run_ahead(y, X, stretches, orders, theta, horizon))


@pytest.mark.slow
@pytest.mark.parametrize("theta", [(-3.0, 2.0, 1.0), (-1e200, 1e200, 1e200)])
def test_unstable_models_stay_within_the_bound(theta):
    X = np.random.default_rng(0).standard_normal((3000, 1))
    y = X[:, 0] + 1.0
    orders = Orders(2, (1,), (0,))
    found, twin = run_free(X, [(0, 3000)], orders, np.array(theta))
    assert np.isfinite(found).all()
    assert np.abs(found).max() == BOUND
    np.testing.assert_allclose(found, twin, rtol=1e-6)
    assert np.isfinite(np.sum((found / 3000) ** 2))
    ahead, _ = run_ahead(y, X, [(0, 3000)], orders, np.array(theta), 5)
    assert np.isfinite(ahead).all()


def test_gate_accepts_what_pandas_and_memmaps_give(tmp_path):
    locked = np.arange(6.0).reshape(3, 2)
    locked.setflags(write=False)
    np.save(tmp_path / "a.npy", locked)
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r")
    for array in (locked, locked.T, locked[::2], mapped, locked.astype(np.float32), [[1, 2]]):
        gated = _kernels.gate(array)
        assert gated.flags.c_contiguous
        assert gated.flags.writeable
        assert gated.dtype == np.float64
        np.testing.assert_array_equal(gated, array)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(4, 60), st.integers(1, 4))
def test_triangle_is_least_squares(seed, n_extra, p):
    rng = np.random.default_rng(seed)
    table = rng.standard_normal((p + n_extra, p + 1)) * 10.0 ** rng.integers(-3, 4, p + 1)
    phi, output = table[:, :-1].copy(), table[:, -1].copy()
    scale, size = np.linalg.norm(phi, axis=0), np.linalg.norm(output)
    whole = Triangle.of(np.array(table, order="F"))
    chosen = [int(i) for i in rng.permutation(p)[: max(1, p - 1)]]
    for triangle, columns in ((whole, list(range(p))), (whole.subset(chosen), chosen)):
        scaled = phi[:, columns] / scale[columns]
        theta, rss, *_ = np.linalg.lstsq(scaled, output, rcond=None)
        rounding = 1e-13 * size * np.linalg.cond(scaled) ** 2
        np.testing.assert_allclose(triangle.solve() * scale[columns], theta, atol=rounding, rtol=0)
        np.testing.assert_allclose(triangle.rss, rss[0], atol=rounding * size, rtol=0)


@pytest.mark.parametrize("pole", [0.0, 0.7])
@pytest.mark.parametrize("n", [30, 120])
def test_robust_covariance_of_one_run(n, pole):
    rng = np.random.default_rng(n)
    Phi, noise = rng.standard_normal((n, 3)), rng.standard_normal(n)
    Phi[n // 2 :, 2] = 0.0
    errors = lfilter([1.0], [1.0, -pole], noise)
    errors -= Phi @ np.linalg.lstsq(Phi, errors, rcond=None)[0]
    weights = Phi @ np.linalg.inv(Phi.T @ Phi)
    leverage = np.sum(weights * Phi, axis=1)
    found = robust_covariance(weights, leverage, errors, np.arange(n) + 7, np.array([0]))
    twin = naive.robust_covariance(weights, leverage, errors)
    np.testing.assert_allclose(found, twin, rtol=1e-8, atol=1e-12 * twin.max())


def test_robust_covariance_of_runs_is_that_of_each():
    rng = np.random.default_rng(0)
    weights, errors = rng.standard_normal((120, 2)), rng.standard_normal(120)
    apart = np.r_[np.arange(60), np.arange(60) + 500]
    both = [
        robust_covariance(weights, np.zeros(120), errors, rows, np.array([0, begin]))
        for rows, begin in ((np.arange(120), 60), (apart, 500), (apart, 400))
    ]
    np.testing.assert_allclose(both[1], both[0], rtol=1e-12)
    np.testing.assert_allclose(both[2], both[0], rtol=1e-12)


@settings(max_examples=60, deadline=None)
@given(problems(missing=False), st.integers(1, 4))
def test_free_runs_side_by_side_are_those_of_each_model(problem, n_models):
    X, _, stretches, orders, theta = problem
    rng = np.random.default_rng(n_models)
    n_inputs = X.shape[1]
    models = [
        Orders(
            int(rng.integers(0, 4)),
            tuple(rng.integers(1, 4, n_inputs).tolist()),
            tuple(rng.integers(0, 5, n_inputs).tolist()),
            bool(rng.integers(2)),
        )
        for _ in range(n_models - 1)
    ]
    models.append(orders)
    thetas = [rng.standard_normal(model.n_params) for model in models[:-1]] + [theta]
    fitted = FittedCandidates.of(models, [each[None] for each in thetas])
    begin, end = edges(stretches)
    grid = SimpleNamespace(begin=begin, end=end, past=begin, n_rows=len(X))
    found = fitted.simulate(0, slice(None), grid, X)
    for column, model, each in zip(found.T, models, thetas, strict=True):
        alone, _ = run_free(X, stretches, model, each)
        for a, b in stretches:
            np.testing.assert_array_equal(column[a:b], alone[a:b])


def ill_conditioned(n_rows, p):
    """Lags of a slow signal and an output, in multiples of 2^-30, with exact least squares."""
    rng = np.random.default_rng(0)
    slow = np.cumsum(np.cumsum(rng.standard_normal(n_rows + p))) / 1e3
    table = np.column_stack([slow[lag : lag + n_rows] for lag in range(p)])
    table = np.column_stack([table, table @ rng.standard_normal(p) + rng.standard_normal(n_rows)])
    whole_numbers = np.rint(table * 2.0**30).astype(np.int64)
    exact = whole_numbers.astype(object)
    system = [[Fraction(int(v)) for v in row] for row in exact[:, :-1].T @ exact]
    for k in range(p):  # Gauss-Jordan
        system[k] = [v / system[k][k] for v in system[k]]
        for i in set(range(p)) - {k}:
            system[i] = [a - system[i][k] * b for a, b in zip(system[i], system[k], strict=True)]
    return whole_numbers / 2.0**30, np.array([float(row[-1]) for row in system])


@pytest.mark.parametrize("parts", [1, 2, 7, 40])
def test_merged_triangles_are_as_accurate_as_that_of_all_rows(parts):
    table, theta = ill_conditioned(5000, 5)
    size = np.linalg.norm(theta)
    normal = np.linalg.solve(*np.split(table[:, :-1].T @ table, [5], axis=1))[:, 0]
    assert np.linalg.norm(normal - theta) > 1e-8 * size  # which QR alone keeps right
    whole = Triangle.of(np.array(table, order="F"))
    n_columns = table.shape[1]
    pieces = [
        Triangle.of_blocks([np.array(b, order="F") for b in np.array_split(piece, 3)], n_columns)
        for piece in np.array_split(table, parts)
    ]
    merged = reduce(Triangle.merged, pieces)
    assert merged.n_rows == whole.n_rows == len(table)
    for triangle in (merged, whole):
        assert np.linalg.norm(triangle.solve() - theta) < 1e-9 * size
    np.testing.assert_allclose(merged.rss, whole.rss, rtol=1e-12)
    first = [0, 2, 3]
    found = solutions([merged, pieces[0], whole], first)
    for row, triangle in zip(found, [merged, pieces[0], whole], strict=True):
        np.testing.assert_allclose(row, triangle.subset(first).solve(), rtol=1e-10)
