"""The recursions of the thesis on its simulated runs, written out with the compiled kernels."""

import numpy as np
from support.thesis import DT

from skhoid import (
    ARXRegressor,
    forgetting_factor,
    make_tracking_runs,
)
from skhoid._kernels.rls import MANY, free_runs
from skhoid.arx.forgetting import Forgetting, kernel_arrays
from skhoid.arx.orders import Orders
from skhoid.arx.rls import RecursionState, kernel_regressors, recurse

BEFORE = 100  # samples kept of the run-in
TRANSITION = slice(3072, 5120)  # samples of the window that are scored
ORDERS = Orders.of(2, 2, 0, 1, False)
HORIZONS = [*(2.0 ** np.arange(1, 14)), np.inf]  # N0 of Table V, and no forgetting


def e_and_u(condition, P_n, n_runs):
    """e and u, of shape (n_runs, samples), with the end of the run-in; the same noise everywhere.

    K_n is that of Table G.1; in C3-C6 it goes from one state's to the other's as the operator does.
    """
    remnant = {"remnant_gain": "table", "remnant_intensity": P_n} if P_n else {}
    X, y = make_tracking_runs(
        condition, n_runs, **remnant, keep_run_in=BEFORE * DT, random_state=17
    )
    return (table.to_numpy(copy=True).reshape(n_runs, -1) for table in (X, y))


def settings():
    """The kernel's arrays for all N0 of lambda, and of Lambda, which forgets b only."""
    factors = np.ones((1, 4, MANY))
    factors[0, 2:, : len(HORIZONS)] = forgetting_factor(HORIZONS)
    return [kernel_arrays(factors[:, 2:3]), kernel_arrays(factors)]


def of_first_part(e, u):
    """OLS of the first 30.72 s."""
    return ARXRegressor().fit(e[: TRANSITION.start, None], u[: TRANSITION.start]).coef_


def paths(e, u, inflation):
    """theta(t), of shape (WINDOW, 4, MANY), by N0, or of as many runs; P0 = I.

    e and u are those of the window, of shape (WINDOW, 1 or MANY).
    """
    theta0 = np.array([of_first_part(x, y) for x, y in zip(e.T, u.T, strict=True)])
    theta0 = np.broadcast_to(theta0, (MANY, 4))
    e, u = np.ascontiguousarray(e), np.ascontiguousarray(u)  # as elsewhere: compiled once
    signals = np.stack([-u, e])[:, :, None]
    no_forgetting = Forgetting(np.ones((1, 1)))  # in place of which ``inflation`` comes
    return recurse(
        RecursionState(theta0, np.eye(4), MANY), signals, u[:, None], ORDERS, no_forgetting,
        inflation=inflation, keep=("theta",),
    ).theta  # fmt: skip


def vaf_along(path, e, u):
    """VAF of free runs from zero, the error being known one sample before the window."""
    signals = np.full((2, TRANSITION.stop + 1), np.nan)
    signals[1] = e
    instants = np.maximum(np.arange(-1, TRANSITION.stop), 0)
    begin, end, past = np.array([1]), np.array([TRANSITION.stop + 1]), np.array([0])
    free = np.empty((TRANSITION.stop, path.shape[2]))
    free_runs(
        signals, *kernel_regressors(ORDERS), ORDERS.na, begin, end, past, path, instants, 1e100,
        free,
    )  # fmt: skip
    lost = np.square(u[TRANSITION, None] - free[TRANSITION]).sum(axis=0)
    return np.maximum(0.0, 100 * (1 - lost / np.sum(u[TRANSITION] ** 2)))
