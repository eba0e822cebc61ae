"""ARX[2, 2] models of many delays at once, and free runs of many recordings along one path.

Delays, or recursions, lie side by side in lanes, so that the loops over them become vector
instructions. No sum is reordered or fused: a lane, and a recording, gives the same bits alone and
beside others.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

NEW = 1e-10  # of a regressor's sum of squares, what those before it must leave unexplained


@njit(inline="always")
def _solve(U, D, g, lane):
    """Solve U' D U x = g in place, U unit upper triangular by columns."""
    for k in range(4):
        for i in range(k):
            g[k] -= U[k * (k - 1) // 2 + i, lane] * g[i]
    for k in range(3, -1, -1):
        g[k] /= D[k, lane]
        for i in range(k + 1, 4):
            g[k] -= U[i * (i - 1) // 2 + k, lane] * g[i]


@njit(cache=True, nogil=True, error_model="numpy")
def fit_delays(e, u, shortest, longest, first, theta, loss):
    """Fit ARX[2, 2, nk] to the rows of one run from ``first`` on, for a range of nk.

    Normal equations, and one step of refinement on the residuals, which makes up for their
    rounding. Lane j is nk = longest - j, down to ``shortest``. Leaves theta, of shape (4, lanes),
    and the mean squared one-step error; NaN where regressors are next to dependent.
    """
    lanes = longest - shortest + 1
    n = u.size
    uu = np.zeros(5)
    s = np.zeros((9, lanes))
    for t in range(first, n):
        u0, u1, u2 = u[t], u[t - 1], u[t - 2]
        uu[0] += u1 * u1
        uu[1] += u2 * u1
        uu[2] += u2 * u2
        uu[3] -= u1 * u0
        uu[4] -= u2 * u0
        now = e[t - longest : t - shortest + 1]
        before = e[t - longest - 1 : t - shortest]
        for j in range(lanes):
            s[0, j] -= now[j] * u1
            s[1, j] -= now[j] * u2
            s[2, j] += now[j] * now[j]
            s[3, j] -= before[j] * u1
            s[4, j] -= before[j] * u2
            s[5, j] += before[j] * now[j]
            s[6, j] += before[j] * before[j]
            s[7, j] += now[j] * u0
            s[8, j] += before[j] * u0
    U, D = np.empty((6, lanes)), np.empty((4, lanes))
    A, g = np.empty((4, 4)), np.empty(4)
    for j in range(lanes):
        A[0, 0], A[1, 0], A[1, 1] = uu[0], uu[1], uu[2]
        A[2, 0], A[2, 1], A[2, 2] = s[0, j], s[1, j], s[2, j]
        A[3, 0], A[3, 1], A[3, 2], A[3, 3] = s[3, j], s[4, j], s[5, j], s[6, j]
        g[0], g[1], g[2], g[3] = uu[3], uu[4], s[7, j], s[8, j]
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
    for t in range(first, n):
        u0, u1, u2 = u[t], u[t - 1], u[t - 2]
        now = e[t - longest : t - shortest + 1]
        before = e[t - longest - 1 : t - shortest]
        for j in range(lanes):
            left = u0 + theta[0, j] * u1 + theta[1, j] * u2
            left -= theta[2, j] * now[j]
            left -= theta[3, j] * before[j]
            r[0, j] -= u1 * left
            r[1, j] -= u2 * left
            r[2, j] += now[j] * left
            r[3, j] += before[j] * left
            r[4, j] += left * left
    for j in range(lanes):
        g[:] = r[:4, j]
        _solve(U, D, g, j)
        gained = 0.0
        for k in range(4):
            theta[k, j] += g[k]
            gained += g[k] * r[k, j]
        loss[j] = (r[4, j] - gained) / (n - first)


@cache
def free_runs_of_many(na, nb, lanes):
    """Compile ``follow_many`` for the orders of a model and a number of lanes."""
    NA, NB, L = na, nb, lanes

    def follow_many(e, u, path, begin, end, bound):
        """Simulate recordings freely along the same parameter paths.

        Row t of u, of shape (n_runs, at least end), is simulated with ``path[t]``, of shape (na +
        nb, lanes), from zero outputs before row 0, and is held within ``+-bound``; e, which has no
        delay left, begins nb - 1 rows earlier.

        Returns the sum of the squared errors from row ``begin`` to ``end``, of shape (n_runs,
        lanes), without rows in which u is NaN. It has the bits of ``rls.free_runs``, which
        takes one recording at a time: here theta is fetched once for all of them, and their chains
        of operations do not wait for one another.
        """
        n_runs = u.shape[0]
        lost = np.zeros((n_runs, L))
        last = np.zeros((NA, n_runs, L))  # outputs of the rows before, the latest first
        for t in range(end):
            for r in range(n_runs):
                for j in range(L):
                    value = 0.0
                    for k in range(NB):
                        value += path[t, NA + k, j] * e[r, t + NB - 1 - k]
                    for k in range(NA):
                        value -= path[t, k, j] * last[k, r, j]
                    for k in range(NA - 1, 0, -1):
                        last[k, r, j] = last[k - 1, r, j]
                    last[0, r, j] = min(max(value, -bound), bound)
                if t >= begin:
                    y = u[r, t]
                    if y == y:
                        for j in range(L):
                            lost[r, j] += (y - last[0, r, j]) * (y - last[0, r, j])
        return lost

    follow_many.__name__ = follow_many.__qualname__ = f"follow_many_{na}_{nb}_{lanes}"
    return njit(cache=True, nogil=True, error_model="numpy")(follow_many)
