"""Delays, batch fits and forgetting of many runs at once, for studies of the thesis's ARX[2, 2].

Signals are bare arrays with one run per row and no missing values.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cache, lru_cache
from typing import Any

import numpy as np

from .. import _kernels
from .base import BOUND
from .forgetting import Forgetting, forgetting_factor, kernel_arrays
from .least_squares import Triangle
from .orders import Orders, regressors
from .recursive_cv import HORIZONS as HORIZONS
from .rls import RecursionState, recurse

FORMS = ("lambda", "Lambda")
TRANSITION = (3072, 5120)  # samples of the window, 30.72 to 51.20 s
FIRST_FORGOTTEN = {"lambda": 0, "Lambda": 2}  # parameter from which on a form forgets
ORDERS = Orders.of(2, 2, 0, 1, False)
PARAMETERS = ("a1", "a2", "b0", "b1")
N_PARAMS = ORDERS.n_params


def search_delays(e: Any, u: Any, before: int, nks: Any) -> tuple[np.ndarray, np.ndarray]:
    """One-step losses of ARX[2, 2, nk] by least squares (Eq. 24), for many delays and runs.

    Signals have the shape (n_runs, before + n), of which ``before`` samples are not used. Returns
    losses (n_runs, n_nk), as those of :class:`~skhoid.DelaySearchCV`: NaN where regressors are
    linearly dependent, and on the rows that the longest delay leaves; and theta (n_runs, n_nk, 4).

    Normal equations with one step of refinement are nine times as fast as the search's
    factorisation of all lags. QR is used where the preceding regressors explain all but 1e-10 of a
    regressor's power.
    """
    candidates = np.asarray(nks)
    shortest, longest = int(candidates.min()), int(candidates.max())
    losses, theta = _fits(*_windows(e, u, before), shortest, longest)
    chosen = candidates - shortest
    return losses[:, chosen], theta[:, chosen]


def fit_runs(e: Any, u: Any) -> np.ndarray:
    """Least squares of ARX[2, 2, 0] for many runs, of shape (n_runs, 4); ``e`` is delayed already.

    NaN where regressors are linearly dependent.
    """
    return _fits(*_windows(e, u, 0), 0, 0)[1][:, 0]


def score_horizons(
    e_est: Any,
    u_est: Any,
    theta0: Any,
    e_val: Any,
    u_val: Any,
    horizons: Any,
    forms: Sequence[str] = FORMS,
    window: tuple[int, int] = TRANSITION,
) -> np.ndarray:
    """VAF of recursions of one run by memory horizon, on that run and on validation runs.

    Recursive least squares of ARX[2, 2, 0] from ``theta0`` and P0 = I, once for each form of
    forgetting and memory horizon in samples, then free runs along its path on each recording, from
    zero output at the beginning of the measurement window (Section V-B and Fig. 13). Inputs
    ``e_est`` of shape (1 + n,) and ``e_val`` (n_val, 1 + n) are delayed, and begin one sample
    before the outputs ``u_est`` and ``u_val``. ``window`` are the first sample to score, and the
    one after the last. The VAF (clipped at 0, in percent) has the shape (n_forms, n_horizons,
    1 + n_val).
    """
    begin, end = window
    e_est, u_est, e_val, u_val = (np.asarray(x, dtype=float) for x in (e_est, u_est, e_val, u_val))
    e = np.concatenate((e_est[None, : end + 1], e_val[:, : end + 1]))
    u = np.concatenate((u_est[None, :end], u_val[:, :end]))
    factors = forgetting_factor(np.atleast_1d(np.asarray(horizons, dtype=float)))
    power = np.sum(u[:, begin:] ** 2, axis=1)
    vaf = np.empty((len(forms), factors.size, len(u)))
    lanes = _kernels.trade_off.WIDTH
    signals = np.stack([-u[0], e[0, 1:]])[:, :, None, None]
    target = u[0, :, None, None].copy()
    theta0 = np.asarray(theta0, dtype=float)
    for first in range(0, factors.size, lanes):
        some = slice(first, min(first + lanes, factors.size))
        for form, name in enumerate(forms):
            inflation = _inflation(tuple(factors[some].tolist()), name, lanes)
            path = recurse(
                _begun(theta0, lanes), signals, target, ORDERS, NO_FORGETTING,
                inflation=inflation, keep=("theta",),
            ).theta  # fmt: skip
            lost = _kernels.trade_off.free_runs_of_many(e, u, path, begin, end, BOUND)
            found = 100 * (1 - lost / power[:, None])
            vaf[form, some] = np.maximum(0.0, found[:, : some.stop - first].T)
    return vaf


NO_FORGETTING = Forgetting(np.ones((1, 1)))  # stands in for the factors of the lanes


def _begun(theta0: np.ndarray, lanes: int) -> RecursionState:
    """A recursion before its first row, with P0 = I."""
    state = copy(_model(lanes))
    state.buffer = state.buffer.copy()
    state.rows("theta")[:] = theta0[:, None]
    return state


@cache
def _model(lanes: int) -> RecursionState:
    """The model from which recursions are copied, as factoring P0 takes longer than many rows."""
    return RecursionState(np.zeros(N_PARAMS), np.eye(N_PARAMS), lanes)


@lru_cache(maxsize=8)
def _inflation(factors: tuple[float, ...], form: str, lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """The kernel's arrays of forgetting, one factor a lane; lanes left over forget nothing."""
    first = FIRST_FORGOTTEN[form]
    by_parameter = np.ones((1, N_PARAMS if first else 1, lanes))
    by_parameter[0, first:, : len(factors)] = factors
    return kernel_arrays(by_parameter)


def _windows(e: Any, u: Any, before: int) -> tuple[np.ndarray, np.ndarray]:
    """Signals of the window, as the kernels take them."""
    e, u = (_kernels.gate(np.asarray(x, dtype=float)[:, before:]) for x in (e, u))
    return e, u


def _fits(
    e: np.ndarray, u: np.ndarray, shortest: int, longest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Losses and theta of all delays in a range, on the rows that the longest one allows."""
    n_runs = len(u)
    first = max(ORDERS.na, longest + 1)
    lanes = longest - shortest + 1
    losses, theta = np.empty((n_runs, lanes)), np.empty((n_runs, N_PARAMS, lanes))
    for run in range(n_runs):
        _kernels.trade_off.fit_delays(
            e[run], u[run], shortest, longest, first, theta[run], losses[run]
        )
    losses, theta = losses[:, ::-1], theta[:, :, ::-1].swapaxes(1, 2)
    for run, lane in np.argwhere(np.isnan(losses)).tolist():
        losses[run, lane], theta[run, lane] = _by_qr(e[run], u[run], shortest + lane, first)
    return losses, theta


def _by_qr(e: np.ndarray, u: np.ndarray, nk: int, first: int) -> tuple[float, np.ndarray]:
    """Loss and theta of one delay and run, on the rows from ``first`` on."""
    orders = Orders.of(ORDERS.na, ORDERS.nb[0], nk, 1, False)
    begin, end = np.array([first - orders.first_row]), np.array([u.size])
    table, _, _ = regressors(u, e[:, None], begin, end, orders)
    triangle = Triangle.of(table)
    if len(triangle.null_space()):
        return np.nan, np.full(N_PARAMS, np.nan)
    return triangle.rss / triangle.n_rows, triangle.solve()
