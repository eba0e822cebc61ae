"""Recursions side by side: every lane has the bits that it has alone.

What a recursion finds is compared with its naive twin in ``tests/arx/test_recursive.py``.
"""

import numpy as np
import pytest

from skhoid import _kernels
from skhoid.arx.forgetting import kernel_arrays
from skhoid.arx.rls import RecursionState

N_ROWS, MOST = 300, _kernels.rls.MANY
ORDERS = np.array([0, 0, 1, 1]), np.array([1, 2, 3, 4])  # signal and lag of each regressor
KINDS = ["one", "by parameter", "diagonal", "variable", "over time"]


def odd_runs(n_runs, seed=0):
    """-y and e of shape (2, N_ROWS, n_runs), and y with missing values; each run has its own flaw.

    Pauses, pauses of one signal, missing values, jumps in scale, and tiny values.
    """
    rng = np.random.default_rng(seed)
    y, e = np.cumsum(rng.standard_normal((2, N_ROWS, n_runs)), axis=1) * 0.3
    for run in range(n_runs):
        at = int(rng.integers(20, 120))
        part = slice(at, at + 150)
        flaw = run % 6
        if flaw == 1:
            y[part, run] = e[part, run] = 0.0
        elif flaw == 2:
            e[part, run] = 0.0
        elif flaw == 3:
            e[rng.random(N_ROWS) < 0.1, run] = np.nan
            y[rng.random(N_ROWS) < 0.1, run] = np.nan
        elif flaw == 4:
            y[part, run] *= 1e6
            e[part, run] *= 1e-7
        elif flaw == 5:
            y[part, run] *= 1e-160
            e[part, run] = 1e-90
    return np.stack([-y, e]), y


def forgetting_of(kind, lanes):
    """λ of shape (1 or N_ROWS, 1 or 4, lanes); short memories are held in pauses."""
    factors = np.linspace(0.5, 1.0, MOST)[None, None, :lanes]
    if kind in ("one", "variable"):
        return factors
    factors = np.repeat(factors, 4, axis=1) ** np.array([0.0, 0.3, 2.0, 1.0])[:, None]
    if kind == "over time":
        return factors ** np.linspace(0.0, 1.0, N_ROWS)[:, None, None]
    return factors


def recursions(signals, target, kind, factors, n_params=0):
    """All that a kernel leaves, each with its lanes last."""
    lanes, n_runs = factors.shape[2], signals.shape[2]
    state = RecursionState(np.full(4, 0.1), 1e3 * np.eye(4), lanes)
    state.rows("inflation")[:] = 1 / factors[0, :1]
    inflate, tilt = (np.ascontiguousarray(array) for array in kernel_arrays(factors))
    advance = _kernels.rls.recursion(lanes, signals.shape[3] < lanes, n_params)
    path, U_and_D = np.zeros((N_ROWS, 4, lanes)), np.zeros((N_ROWS, 10, lanes))
    errors, alphas = np.zeros((2, N_ROWS, n_runs, lanes))
    used, none = np.zeros((N_ROWS, lanes)), np.empty((0, 0, 0))
    nominal = 20.0 if kind == "variable" else 0.0
    for begin, end in ((4, 123), (123, N_ROWS)):
        advance(
            signals, target, *ORDERS, begin, end, inflate, tilt, 0, kind == "diagonal", nominal,
            state.buffer, path, U_and_D, none, errors, alphas, used,
        )  # fmt: skip
    return [path, U_and_D, errors, alphas, used, state.buffer.reshape(-1, lanes)]


def in_lanes(array, lanes):
    return np.ascontiguousarray(array[..., None, lanes])


widths = [pytest.param(n, marks=[] if n == MOST else pytest.mark.slow) for n in (1, MOST)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lanes", widths)
def test_runs_side_by_side(lanes, kind):
    signals, y = odd_runs(MOST)
    factors = forgetting_of(kind, MOST)
    chosen = range(MOST - lanes, MOST)
    beside = recursions(
        in_lanes(signals, chosen), in_lanes(y, chosen), kind, factors[:, :, list(chosen)]
    )
    assert np.isfinite(beside[0]).all()
    for lane, run in enumerate(chosen):
        alone = recursions(in_lanes(signals, [run]), in_lanes(y, [run]), kind, factors[:, :, [run]])
        for one, many in zip(alone, beside, strict=True):
            np.testing.assert_array_equal(many[..., lane], one[..., 0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lanes", widths)
def test_settings_side_by_side(lanes, kind):
    """Of three pooled runs, which all lanes share."""
    factors = forgetting_of(kind, MOST)[:, :, MOST - lanes :]
    for seed in range(2):
        signals, y = odd_runs(3 + 3 * seed, seed)
        signals, target = signals[:, :, -3:, None].copy(), y[:, -3:, None].copy()
        beside = recursions(signals, target, kind, factors)
        assert np.isfinite(beside[0]).all()
        for lane in range(lanes):
            alone = recursions(signals, target, kind, factors[:, :, [lane]])
            for one, many in zip(alone, beside, strict=True):
                np.testing.assert_array_equal(many[..., lane], one[..., 0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_of_four_parameters_gives_the_bits_of_that_for_all(kind):
    signals, y = odd_runs(6)
    for run in range(6):
        data = in_lanes(signals, [run]), in_lanes(y, [run]), kind, forgetting_of(kind, 1)
        for own, one in zip(recursions(*data, n_params=4), recursions(*data), strict=True):
            np.testing.assert_array_equal(own, one)


def test_one_division_for_all_does_not_overflow():
    """Where 1 + phi' P phi is so large that a product of them is not a number."""
    state = RecursionState(np.zeros(4), np.eye(4))
    state.rows("U")[:, 0] = [1e80, 0, 0, 1e80, 0, 0]
    before = state.buffer.copy()
    ones, none = np.ones((2, N_ROWS, 1, 1)), np.empty((0, 0, 0))
    inflate, tilt = kernel_arrays(np.ones((1, 1, 1)))
    path = np.zeros((N_ROWS, 4, 1))
    _kernels.rls.recursion(1)(
        ones, np.ones((N_ROWS, 1, 1)), *ORDERS, 4, 5, inflate, tilt, 0, False, 0.0, state.buffer,
        path, none, none, none, none, np.empty((0, 0)),
    )  # fmt: skip
    assert np.isfinite(path[4]).all()
    phi_P = np.array([1.0, 1e80, 1.0, 1e80])  # U' phi
    alphas = 1.0 + np.cumsum(phi_P**2)
    wanted = np.concatenate(([1.0], alphas[:-1])) / alphas
    np.testing.assert_allclose(state.rows("D")[:, 0], wanted, rtol=1e-14)
    assert not np.array_equal(state.buffer, before)
