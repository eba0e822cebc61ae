"""Delays, batch fits and forgetting of many runs at once, on bare arrays: for studies.

The same results as :class:`~skhoid.DelaySearchCV`, :class:`~skhoid.ARXRegressor` and
:class:`~skhoid.RecursiveARX` for the ARX[2, 2] models of the thesis, without tables and checks of
single runs. Signals have one run per row and no missing values.
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
    """One-step losses of ARX[2, 2, nk] by ordinary least squares, for many delays and runs.

    The losses that :class:`~skhoid.DelaySearchCV` finds on the window of each run: all candidates
    are fitted to the same rows, those whose lags lie in the window even for the longest delay.

    Parameters
    ----------
    e : array-like of shape (n_runs, before + n)
        Input, such as the error in deg.
    u : array-like of shape (n_runs, before + n)
        Output, such as the control output in deg.
    before : int
        Samples before the window, which are not used.
    nks : array-like of int of shape (n_nk,)
        Candidate delays in samples. All delays between them are computed too.

    Returns
    -------
    losses : ndarray of shape (n_runs, n_nk)
        Mean squared one-step error, in units of u squared; NaN where regressors are linearly
        dependent.
    theta : ndarray of shape (n_runs, n_nk, 4)
        a1, a2, b0, b1 for each run and delay.

    Raises
    ------
    ValueError
        If shapes do not match, a value is missing, a delay is negative, or a window is too short
        for the longest one.

    Notes
    -----
    Normal equations with one step of refinement, nine times as fast as the search's factorisation
    of all lags, and losses from residuals. QR is used where the preceding regressors explain all
    but 1e-10 of a regressor's power.

    References
    ----------
    Van Grootheest, thesis, Eq. 24 (with the square missing in print) and Section III-D step 3.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.1, random_state=0)
    >>> e, u = X["e"].to_numpy().reshape(2, -1), y.to_numpy().reshape(2, -1)
    >>> nks = range(15, 49)
    >>> losses, theta = search_delays(e, u, 0, nks)
    >>> [nks[at] for at in losses.argmin(axis=1)]  # 29 without remnant
    [31, 31]
    """
    e, u = _windows(e, u, before)
    candidates = np.asarray(nks)
    if candidates.ndim != 1 or candidates.size == 0 or candidates.dtype.kind not in "iu":
        raise ValueError(f"nks must be one array of at least one whole number; got {nks!r}.")
    shortest, longest = int(candidates.min()), int(candidates.max())
    if shortest < 0:
        raise ValueError(f"A delay cannot be negative; got {shortest} samples.")
    losses, theta = _fits(e, u, shortest, longest)
    chosen = candidates - shortest
    return losses[:, chosen], theta[:, chosen]


def fit_runs(e: Any, u: Any) -> np.ndarray:
    """Ordinary least squares of ARX[2, 2, 0] for many runs, as :class:`~skhoid.ARXRegressor`.

    Parameters
    ----------
    e : array-like of shape (n_runs, n)
        Input, already delayed.
    u : array-like of shape (n_runs, n)
        Output.

    Returns
    -------
    theta : ndarray of shape (n_runs, 4)
        a1, a2, b0, b1; NaN where regressors are linearly dependent.

    Raises
    ------
    ValueError
        If shapes do not match, a value is missing, or there are fewer than 7 rows.

    References
    ----------
    Van Grootheest, thesis, Eqs. 8-10.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> e = np.random.default_rng(0).standard_normal((3, 100))
    >>> u = lfilter([0.5, 0.2], [1, -1.5, 0.7], e, axis=1)
    >>> fit_runs(e, u)[0].round(6).tolist()
    [-1.5, 0.7, 0.5, 0.2]
    """
    e, u = _windows(e, u, 0)
    return _fits(e, u, 0, 0)[1][:, 0]


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
    forgetting and memory horizon, then free runs along its path on each recording, from zero output
    at the beginning of the measurement window, with the error known one sample before.

    Parameters
    ----------
    e_est : array-like of shape (1 + n,)
        Input of the estimation run, already delayed, from one sample before the measurement window.
    u_est : array-like of shape (n,)
        Output of the estimation run, from the beginning of the window.
    theta0 : array-like of shape (4,)
        Initial a1, a2, b0, b1.
    e_val : array-like of shape (n_val, 1 + n)
        Input of validation runs, delayed like that of the estimation run.
    u_val : array-like of shape (n_val, n)
        Output of validation runs.
    horizons : array-like of shape (n_horizons,)
        Memory horizons N0 in samples; infinity means no forgetting.
    forms : sequence of {"lambda", "Lambda"}, default=("lambda", "Lambda")
        ``"lambda"`` forgets all parameters, ``"Lambda"`` only b0 and b1.
    window : tuple of int, default=(3072, 5120)
        First sample to score, and the one after the last; the default is the transition of the
        thesis at 100 Hz. Later samples are not used.

    Returns
    -------
    vaf : ndarray of shape (n_forms, n_horizons, 1 + n_val)
        VAF (clipped at 0) in percent, of the estimation run and of each validation run.

    Raises
    ------
    ValueError
        If shapes do not match, a form is unknown, or runs end before ``window`` does.

    References
    ----------
    Van Grootheest, thesis, Eqs. 17-20, 25 and Section V-B (Fig. 13).

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid import make_tracking_runs
    >>> X, y = make_tracking_runs("C4", 2, remnant_intensity=0.1, keep_run_in=1.0, random_state=0)
    >>> e, u = X["e"].to_numpy().reshape(2, -1), y.to_numpy().reshape(2, -1)[:, 100:]
    >>> e = e[:, 100 - 29 - 1 : -29]
    >>> theta0 = fit_runs(e[:1, 1:3073], u[:1, :3072])[0]
    >>> vaf = score_horizons(e[0], u[0], theta0, e[1:], u[1:], [64, 256, np.inf])
    >>> vaf[0, :, 1].round(1).tolist()  # of the other run, all parameters forgotten
    [83.4, 83.6, 72.4]
    """
    begin, end = window
    e_est, u_est, e_val, u_val = (np.asarray(x, dtype=float) for x in (e_est, u_est, e_val, u_val))
    n = u_est.size
    if (e_est.shape, u_est.shape) != ((n + 1,), (n,)):
        raise ValueError(
            "e_est must begin one sample before u_est and end with it; got shapes "
            f"{e_est.shape} and {u_est.shape}."
        )
    if (e_val.shape, u_val.shape) != ((len(u_val), n + 1), (len(u_val), n)):
        raise ValueError(
            "Validation runs must be as long as the estimation run, with e_val and u_val of shapes "
            f"(n_val, {n + 1}) and (n_val, {n}); got {e_val.shape} and {u_val.shape}."
        )
    if not 0 <= begin < end <= n:
        raise ValueError(f"window={window!r} does not lie in runs of {n} samples.")
    e = np.concatenate((e_est[None, : end + 1], e_val[:, : end + 1]))
    u = np.concatenate((u_est[None, :end], u_val[:, :end]))
    unknown = [form for form in forms if form not in FORMS]
    if unknown:
        raise ValueError(f"A form of forgetting must be one of {FORMS}; got {unknown[0]!r}.")
    factors = forgetting_factor(np.atleast_1d(np.asarray(horizons, dtype=float)))
    power = np.sum(u[:, begin:] ** 2, axis=1)
    vaf = np.empty((len(forms), factors.size, len(u)))
    lanes = _kernels.rls.MANY
    follow = _kernels.trade_off.free_runs_of_many(lanes)
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
            lost = follow(e, u, path, begin, end, BOUND)
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
    e, u = np.asarray(e, dtype=float), np.asarray(u, dtype=float)
    if e.ndim != 2 or e.shape != u.shape:
        raise ValueError(
            f"e and u must have one run per row and the same number of samples; got shapes "
            f"{e.shape} and {u.shape}."
        )
    if not 0 <= before < e.shape[1]:
        raise ValueError(f"before={before} leaves none of {e.shape[1]} samples.")
    e, u = _kernels.gate(e[:, before:]), _kernels.gate(u[:, before:])
    if not np.isfinite(e.sum() + u.sum()):
        raise ValueError("e or u has missing or infinite values; skhoid's estimators take those.")
    return e, u


def _fits(
    e: np.ndarray, u: np.ndarray, shortest: int, longest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Losses and theta of all delays in a range, on the rows that the longest one allows."""
    n_runs, n = u.shape
    first = max(ORDERS.na, longest + 1)
    if n - first <= N_PARAMS:
        raise ValueError(
            f"Runs of {n} samples are too short for lags up to {first}: at least "
            f"{first + N_PARAMS + 1} are needed."
        )
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
