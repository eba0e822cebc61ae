"""ARX[2, 2] models of many delays at once, and free runs of many recordings along one path.

Delays, or recursions, lie side by side in lanes, so that the loops over them become vector
instructions. Four rows are taken at a time, so that sums and outputs stay in registers from row to
row. No sum is reordered or fused: a lane, and a recording, gives the same bits alone and beside
others.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ROWS = 4  # taken at a time
WIDTH = 16  # lanes; fewer are unrolled before they could be vectorised
# Offsets in a buffer: what is in one array is not tested for overlap before each of the loops.
THETA, BUFFER = 5 * WIDTH, 9 * WIDTH
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


@njit(inline="always")
def _sums(s, j):
    return s[j], s[WIDTH + j], s[2 * WIDTH + j], s[3 * WIDTH + j], s[4 * WIDTH + j]


@njit(inline="always")
def _set_sums(s, j, new):
    s[j], s[WIDTH + j], s[2 * WIDTH + j], s[3 * WIDTH + j], s[4 * WIDTH + j] = new


@njit(inline="always")
def _theta(s, j):
    return s[THETA + j], s[THETA + WIDTH + j], s[THETA + 2 * WIDTH + j], s[THETA + 3 * WIDTH + j]


@njit(inline="always")
def _products(sums, before, now, u0, u1, u2):
    """Add a row: the earlier input times u, times itself, and times the later."""
    return (
        sums[0] + before * u0,
        sums[1] - before * u1,
        sums[2] - before * u2,
        sums[3] + before * before,
        sums[4] + before * now,
    )


@njit(inline="always")
def _residuals(sums, theta, before, now, u0, u1, u2):
    """Add a row: regressors times the residual, and its square."""
    left = u0 + theta[0] * u1 + theta[1] * u2
    left -= theta[2] * now
    left -= theta[3] * before
    return (
        sums[0] - u1 * left,
        sums[1] - u2 * left,
        sums[2] + now * left,
        sums[3] + before * left,
        sums[4] + left * left,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def fit_delays(e, u, shortest, longest, first, theta, loss):
    """Fit ARX[2, 2, nk] to the rows of one run from ``first`` on, for a range of nk.

    Normal equations, and one step of refinement on the residuals, which makes up for their
    rounding. Lane j is nk = longest - j, down to ``shortest``. Leaves theta, of shape (4, lanes),
    and the mean squared one-step error; NaN where regressors are next to dependent.
    """
    lanes = longest - shortest + 1
    n = u.size
    whole = first + (n - first) // ROWS * ROWS
    uu = np.zeros(5)
    for t in range(first, n):
        u0, u1, u2 = u[t], u[t - 1], u[t - 2]
        uu[0] += u1 * u1
        uu[1] += u2 * u1
        uu[2] += u2 * u2
        uu[3] -= u1 * u0
        uu[4] -= u2 * u0
    past = np.zeros(n + 2 * WIDTH)  # delays are taken WIDTH at a time, also the last of them
    past[:n] = e
    buffer = np.empty(BUFFER)
    # The later input of a delay is the earlier one of the delay before it.
    s = np.empty((5, lanes + WIDTH))
    for some in range(0, lanes + 1, WIDTH):
        buffer[:] = 0.0
        for t in range(first, whole, ROWS):
            x = past[t - longest - 1 + some :]
            u0, u1, u2, u3, u4, u5 = u[t - 2], u[t - 1], u[t], u[t + 1], u[t + 2], u[t + 3]
            for j in range(WIDTH):
                new = _products(_sums(buffer, j), x[j], x[j + 1], u2, u1, u0)
                new = _products(new, x[j + 1], x[j + 2], u3, u2, u1)
                new = _products(new, x[j + 2], x[j + 3], u4, u3, u2)
                new = _products(new, x[j + 3], x[j + 4], u5, u4, u3)
                _set_sums(buffer, j, new)
        for t in range(whole, n):
            x = past[t - longest - 1 + some :]
            for j in range(WIDTH):
                new = _products(_sums(buffer, j), x[j], x[j + 1], u[t], u[t - 1], u[t - 2])
                _set_sums(buffer, j, new)
        s[:, some : some + WIDTH] = buffer[:THETA].reshape(5, WIDTH)
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
    r = np.empty((5, lanes + WIDTH))  # sums of regressors times residual, and of its square
    for some in range(0, lanes, WIDTH):
        buffer[:] = 0.0
        last = min(some + WIDTH, lanes)
        buffer[THETA:].reshape(4, WIDTH)[:, : last - some] = theta[:, some:last]
        for t in range(first, whole, ROWS):
            x = past[t - longest - 1 + some :]
            u0, u1, u2, u3, u4, u5 = u[t - 2], u[t - 1], u[t], u[t + 1], u[t + 2], u[t + 3]
            for j in range(WIDTH):
                fitted = _theta(buffer, j)
                new = _residuals(_sums(buffer, j), fitted, x[j], x[j + 1], u2, u1, u0)
                new = _residuals(new, fitted, x[j + 1], x[j + 2], u3, u2, u1)
                new = _residuals(new, fitted, x[j + 2], x[j + 3], u4, u3, u2)
                new = _residuals(new, fitted, x[j + 3], x[j + 4], u5, u4, u3)
                _set_sums(buffer, j, new)
        for t in range(whole, n):
            x = past[t - longest - 1 + some :]
            for j in range(WIDTH):
                new, fitted = _sums(buffer, j), _theta(buffer, j)
                new = _residuals(new, fitted, x[j], x[j + 1], u[t], u[t - 1], u[t - 2])
                _set_sums(buffer, j, new)
        r[:, some : some + WIDTH] = buffer[:THETA].reshape(5, WIDTH)
    for j in range(lanes):
        g[:] = r[:4, j]
        _solve(U, D, g, j)
        gained = 0.0
        for k in range(4):
            theta[k, j] += g[k]
            gained += g[k] * r[k, j]
        loss[j] = (r[4, j] - gained) / (n - first)


@njit(inline="always")
def _output(p, at, now, before, last, last_but_one, bound):
    """The output of a row, held within the bound; its parameters begin at ``p[at]``."""
    value = 0.0 + p[2 * WIDTH + at] * now
    value += p[3 * WIDTH + at] * before
    value -= p[at] * last
    value -= p[WIDTH + at] * last_but_one
    return min(max(value, -bound), bound)


@njit(inline="always")
def _squared(y, value):
    """The squared error of a row, 0 where the recording has no measurement."""
    off = y - value if y == y else 0.0
    return off * off


LAST, LAST_BUT_ONE, LOST = range(0, 3 * WIDTH, WIDTH)  # offsets in what is kept of a recording


@njit(cache=True, nogil=True, error_model="numpy")
def free_runs_of_many(e, u, path, begin, end, bound):
    """Simulate recordings freely along the same parameter paths.

    Row t of u, of shape (n_runs, at least end), is simulated with ``path[t]``, a1, a2, b0, b1
    of shape (4, WIDTH), from zero outputs before row 0, and is held within ``+-bound``; e,
    which has no delay left, begins one row earlier.

    Returns the sum of the squared errors from row ``begin`` to ``end``, of shape (n_runs,
    WIDTH), without rows in which u is NaN. It has the bits of ``rls.free_runs``, which
    takes one recording at a time: here theta is fetched once for all of them, and their chains
    of operations do not wait for one another: five times as fast.
    """
    n_runs = u.shape[0]
    states = np.zeros((n_runs, 3 * WIDTH))
    theta = path.reshape(-1)
    alone, row = end % ROWS, 4 * WIDTH
    for t in range(alone):
        p = theta[t * row :]
        for r in range(n_runs):
            s, e0, e1 = states[r], e[r, t], e[r, t + 1]
            y = u[r, t] if t >= begin else np.nan
            for j in range(WIDTH):
                value = _output(p, j, e1, e0, s[LAST + j], s[LAST_BUT_ONE + j], bound)
                s[LAST_BUT_ONE + j] = s[LAST + j]
                s[LAST + j] = value
                s[LOST + j] += _squared(y, value)
    for t in range(alone, end, ROWS):
        p = theta[t * row :]
        for r in range(n_runs):
            s = states[r]
            e0, e1, e2, e3, e4 = e[r, t], e[r, t + 1], e[r, t + 2], e[r, t + 3], e[r, t + 4]
            y0 = u[r, t] if t >= begin else np.nan
            y1 = u[r, t + 1] if t + 1 >= begin else np.nan
            y2 = u[r, t + 2] if t + 2 >= begin else np.nan
            y3 = u[r, t + 3] if t + 3 >= begin else np.nan
            for j in range(WIDTH):
                one, two = s[LAST + j], s[LAST_BUT_ONE + j]
                v0 = _output(p, j, e1, e0, one, two, bound)
                v1 = _output(p, row + j, e2, e1, v0, one, bound)
                v2 = _output(p, 2 * row + j, e3, e2, v1, v0, bound)
                v3 = _output(p, 3 * row + j, e4, e3, v2, v1, bound)
                s[LAST + j], s[LAST_BUT_ONE + j] = v3, v2
                if t + ROWS > begin:
                    lost = s[LOST + j] + _squared(y0, v0)
                    lost += _squared(y1, v1)
                    lost += _squared(y2, v2)
                    s[LOST + j] = lost + _squared(y3, v3)
    return states[:, LOST:].copy()
