"""ARX[2, 2] models of many delays at once, and free runs of many recordings along one path.

Delays, or recursions, lie side by side in lanes, so that the loops over them become vector
instructions. No sum is reordered or fused: a lane, and a recording, gives the same bits alone and
beside others.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .kernel import OPTIONS, kernel

WIDTH = 16  # lanes of a path
NEW = 1e-10  # of a regressor's sum of squares, what those before it must leave unexplained


@njit(**OPTIONS, forceinline=True)
def _solve(U, D, g, lane):
    """Solve U' D U x = g in place, U unit upper triangular by columns."""
    for k in range(4):
        for i in range(k):
            g[k] -= U[k * (k - 1) // 2 + i, lane] * g[i]
    for k in range(3, -1, -1):
        g[k] /= D[k, lane]
        for i in range(k + 1, 4):
            g[k] -= U[i * (i - 1) // 2 + k, lane] * g[i]


@kernel("f8[::1], f8[::1], i8, i8, i8, f8[:,::1], f8[::1]", 2)
def fit_delays(e, u, shortest, longest, first, theta, loss):
    """Fit ARX[2, 2, nk] to the rows of one run from ``first`` on, for a range of nk.

    Normal equations, and one step of refinement on the residuals, which makes up for their
    rounding. Lane j is nk = longest - j, down to ``shortest``. Leaves theta, of shape (4, lanes),
    and the mean squared one-step error; NaN where regressors are next to dependent.
    """
    lanes = longest - shortest + 1
    n = u.size
    uu = np.zeros(5)
    for t in range(first, n):
        u0, u1, u2 = u[t], u[t - 1], u[t - 2]
        uu[0] += u1 * u1
        uu[1] += u2 * u1
        uu[2] += u2 * u2
        uu[3] -= u1 * u0
        uu[4] -= u2 * u0
    # The later input of a delay is the earlier one of the delay before it.
    s = np.zeros((5, lanes + 1))  # the earlier input times u, times itself, and times the later
    by_0, by_1, by_2, squares, products = s[0], s[1], s[2], s[3], s[4]
    for t in range(first, n):
        u0, u1, u2, x = u[t], u[t - 1], u[t - 2], e[t - longest - 1 :]
        for j in range(lanes + 1):
            by_0[j] += x[j] * u0
            by_1[j] -= x[j] * u1
            by_2[j] -= x[j] * u2
            squares[j] += x[j] * x[j]
        for j in range(lanes):
            products[j] += x[j] * x[j + 1]
    U, D = np.empty((6, lanes)), np.empty((4, lanes))
    A, g = np.empty((4, 4)), np.empty(4)
    for j in range(lanes):
        A[0, 0], A[1, 0], A[1, 1] = uu[0], uu[1], uu[2]
        A[2, 0], A[2, 1], A[2, 2] = s[1, j + 1], s[2, j + 1], s[3, j + 1]
        A[3, 0], A[3, 1], A[3, 2], A[3, 3] = s[1, j], s[2, j], s[4, j], s[3, j]
        g[0], g[1], g[2], g[3] = uu[3], uu[4], s[0, j + 1], s[0, j]
        good = True
        for k in range(4):
            d = A[k, k]
            for i in range(k):
                c = A[k, i]
                for m in range(i):
                    c -= U[i * (i - 1) // 2 + m, j] * D[m, j] * U[k * (k - 1) // 2 + m, j]
                c /= D[i, j]
                U[k * (k - 1) // 2 + i, j] = c
                d -= c * c * D[i, j]
            good = good and d > NEW * A[k, k]
            D[k, j] = d if good else 1.0
        _solve(U, D, g, j)
        for k in range(4):
            theta[k, j] = g[k] if good else np.nan
    r = np.zeros((5, lanes))  # sums of regressors times residual, and of its square
    r0, r1, r2, r3, r4 = r[0], r[1], r[2], r[3], r[4]
    a1, a2, b0, b1 = theta[0], theta[1], theta[2], theta[3]
    for t in range(first, n):
        u0, u1, u2, x = u[t], u[t - 1], u[t - 2], e[t - longest - 1 :]
        for j in range(lanes):
            left = u0 + a1[j] * u1 + a2[j] * u2 - b0[j] * x[j + 1] - b1[j] * x[j]
            r0[j] -= u1 * left
            r1[j] -= u2 * left
            r2[j] += x[j + 1] * left
            r3[j] += x[j] * left
            r4[j] += left * left
    for j in range(lanes):
        for k in range(4):
            g[k] = r[k, j]
        _solve(U, D, g, j)
        gained = 0.0
        for k in range(4):
            theta[k, j] += g[k]
            gained += g[k] * r[k, j]
        loss[j] = (r[4, j] - gained) / (n - first)


LAST, LAST_BUT_ONE, LOST = range(0, 3 * WIDTH, WIDTH)  # offsets in what is kept of a recording


@kernel("f8[:,::1], f8[:,::1], f8[:,:,::1], i8, i8, f8", 1)
def free_runs_of_many(e, u, path, begin, end, bound):
    """Simulate recordings freely along the same parameter paths.

    Row t of u, of shape (n_runs, at least end), is simulated with ``path[t]``, a1, a2, b0, b1
    of shape (4, WIDTH), from zero outputs before row 0, and is held within ``+-bound``; e,
    which has no delay left, begins one row earlier.

    Returns the sum of the squared errors from row ``begin`` to ``end``, of shape (n_runs,
    WIDTH), without rows in which u is NaN. It has the bits of ``rls.free_runs``, which
    takes one recording at a time, in a fifth of the time: theta is fetched once for all of
    them, and their chains of operations do not wait for one another.
    """
    n_runs = u.shape[0]
    states = np.zeros((n_runs, 3 * WIDTH))
    theta = path.reshape(-1)
    row = 4 * WIDTH
    for t in range(end):
        p = theta[t * row :]
        for r in range(n_runs):
            s, e0, e1 = states[r], e[r, t], e[r, t + 1]
            y = u[r, t] if t >= begin else np.nan
            for j in range(WIDTH):
                value = 0.0 + p[2 * WIDTH + j] * e1
                value += p[3 * WIDTH + j] * e0
                value -= p[j] * s[LAST + j]
                value -= p[WIDTH + j] * s[LAST_BUT_ONE + j]
                value = min(max(value, -bound), bound)
                s[LAST_BUT_ONE + j] = s[LAST + j]
                s[LAST + j] = value
                off = y - value if y == y else 0.0
                s[LOST + j] += off * off
    return states[:, LOST:].copy()
