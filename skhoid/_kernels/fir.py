"""Regularised recursive least squares in information form, for finite impulse responses.

Row by row R = f R + phi phi', S = f² S + phi phi' and s = f s + phi y, with f = lambda at the first
row of an instant and 1 at the others. Symmetric matrices are kept above their diagonal, by rows, so
that every inner loop runs over neighbours in memory. The same rows give the same bits however they
are cut into calls.
"""

from __future__ import annotations

import numpy as np

from .kernel import inner, kernel

UNEXCITED = (
    1e-12  # of the mean power of the inputs, below which a row says nothing and costs nothing
)
DETERMINED = 1e-12  # of the diagonal: the least pivot of a matrix that is inverted

MATRICES = ("R", "S", "A", "meat")
VECTORS = ("s", "theta")
NUMBERS = ("weight", "instants", "fresh", "solved", "updates", "total", "judged", "held")


def layout(n_params):
    """Offsets of the quantities in a state buffer.

    Of the last solution, ``A`` is the factor U of R + penalty = U'U, and ``meat`` is S + penalty:
    what is between two inverses in the covariance of theta. Numbers: the sum of the weights of all
    rows; instants so far; updates since the last solution; whether there is one; updates; the sum
    of the squared errors over their expected size in sigma², and how many they are; instants
    without new information.
    """
    sizes = [n_params**2] * len(MATRICES) + [n_params] * len(VECTORS) + [1] * len(NUMBERS)
    offsets = np.concatenate(([0], np.cumsum(sizes))).tolist()
    return dict(zip([*MATRICES, *VECTORS, *NUMBERS, "size"], offsets, strict=True))


@inner
def penalties(R, weight, owner, ridge, out):
    """ridge trace(R) / weight of each input, for its parameters; 0 for those of none."""
    n = owner.size
    for j in range(owner.max() + 1):
        total = 0.0
        for i in range(n):
            if owner[i] == j:
                total += R[i, i]
        for i in range(n):
            if owner[i] == j:
                out[i] = ridge * total / weight
    for i in range(n):
        if owner[i] < 0:
            out[i] = 0.0


@inner
def factorise(U):
    """Cholesky factor U of U'U, in place above the diagonal; False if it is not determined."""
    for k in range(U.shape[0]):
        row = U[k, k:]
        least = DETERMINED * row[0]
        alone = k % 4
        for i in range(alone):
            above = U[i, k:]
            share = above[0]
            for c in range(row.size):
                row[c] -= share * above[c]
        for i in range(alone, k, 4):  # four at once: five times as fast with 100 rows
            first, second, third, fourth = U[i, k:], U[i + 1, k:], U[i + 2, k:], U[i + 3, k:]
            f, g, h, m = first[0], second[0], third[0], fourth[0]
            for c in range(row.size):
                row[c] -= (f * first[c] + g * second[c]) + (h * third[c] + m * fourth[c])
        if not (row[0] > least and row[0] > 0.0):
            return False
        scale = 1.0 / np.sqrt(row[0])
        for c in range(row.size):
            row[c] *= scale
    return True


@inner
def solve(U, b, x):
    """Solve U'U x = b."""
    n = U.shape[0]
    for i in range(n):
        x[i] = b[i]
    for i in range(n):
        x[i] /= U[i, i]
        share = x[i]
        for k in range(i + 1, n):
            x[k] -= share * U[i, k]
    for i in range(n - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, n):
            value -= U[i, k] * x[k]
        x[i] = value / U[i, i]


@inner
def square(S, x):
    """x'S x."""
    total = 0.0
    for i in range(x.size):
        value = 0.0
        for k in range(i + 1, x.size):
            value += S[i, k] * x[k]
        total += x[i] * (S[i, i] * x[i] + 2.0 * value)
    return total


@inner
def sandwich(A, S, out):
    """(R + penalty)^-1 S (R + penalty)^-1, the covariance of theta over sigma²; S is ``meat``."""
    n = A.shape[0]
    column, found = np.empty(n), np.empty(n)
    half = np.empty((n, n))
    for k in range(n):
        for i in range(n):
            column[i] = S[min(i, k), max(i, k)]
        solve(A, column, found)
        for i in range(n):
            half[i, k] = found[i]
    for k in range(n):
        solve(A, half[k], out[k])
    for i in range(n):
        for k in range(i):
            mean = 0.5 * (out[i, k] + out[k, i])
            out[i, k] = mean
            out[k, i] = mean


@kernel(
    "f8[:,:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8, i8, f8, f8, i8, f8[::1], "
    "f8[:,::1], f8[:,:,::1], f8[:,::1]",
    4,
)
def advance(
    Z, target, columns, lags, owner, begin, end, factor, ridge, every, state, path, spread, errors,
):  # fmt: skip
    """Advance a recursion over the instants from ``begin`` to ``end``.

    Z, of shape (n_signals, n_instants, n_runs), holds the signals of which regressor k is that of
    ``columns[k]`` at ``lags[k]`` instants before; ``target`` the output, NaN where it gives no
    update. Parameter k belongs to input ``owner[k]``, or to none (-1) if it is never penalised;
    the penalty is diag(:func:`penalties`). After each ``every`` instants theta is solved for.
    ``state`` is laid out by :func:`layout`.

    Outputs, which are left alone if of size 0: theta and its covariance over sigma² after each
    solution, and of each instant and run the error by the theta known before.
    """
    n = owner.size
    size = n * n
    R = state[:size].reshape(n, n)
    S = state[size : 2 * size].reshape(n, n)
    A = state[2 * size : 3 * size].reshape(n, n)
    meat = state[3 * size : 4 * size].reshape(n, n)
    s = state[4 * size : 4 * size + n]
    theta = state[4 * size + n : 4 * size + 2 * n]
    numbers = state[4 * size + 2 * n :]
    phi, z, scale = np.empty(n), np.empty(n), np.empty(n)
    U = np.empty((n, n))
    n_solved = 0
    for t in range(begin, end):
        f = factor
        informed, asked = False, False
        for r in range(target.shape[1]):
            y = target[t, r]
            if np.isnan(y):
                continue
            power, mean, known = 0.0, 0.0, True
            for k in range(n):
                value = Z[columns[k], t - lags[k], r]
                known = known and value == value
                phi[k] = value
                if owner[k] >= 0:
                    power += value * value
                    mean += R[k, k]
            if not known:
                continue
            asked = True
            error = y
            for k in range(n):
                error -= phi[k] * theta[k]
            if errors.size > 0:
                errors[t, r] = error
            numbers[4] += 1.0
            if numbers[3] > 0.0:
                solve(A, phi, z)
                numbers[5] += error * error / (1.0 + square(meat, z))
                numbers[6] += 1.0
            if power == 0.0 or (numbers[0] > 0.0 and power * numbers[0] <= UNEXCITED * mean):
                continue
            informed = True
            for i in range(n):
                value = phi[i]
                for k in range(i, n):
                    product = value * phi[k]
                    R[i, k] = f * R[i, k] + product
                    S[i, k] = f * f * S[i, k] + product
                s[i] = f * s[i] + value * y
            numbers[0] = f * numbers[0] + 1.0
            numbers[2] += 1.0
            f = 1.0
        if asked and not informed:
            numbers[7] += 1.0
        numbers[1] += 1.0
        if numbers[1] % every != 0.0:
            continue
        if numbers[2] > 0.0:
            penalties(R, numbers[0], owner, ridge, scale)
            for i in range(n):
                for k in range(i, n):
                    U[i, k] = R[i, k]
                U[i, i] += scale[i]
            if factorise(U):
                for i in range(n):
                    for k in range(i, n):
                        A[i, k], meat[i, k] = U[i, k], S[i, k]
                    meat[i, i] += scale[i]
                solve(A, s, theta)
                numbers[2], numbers[3] = 0.0, 1.0
        if path.size > 0:
            for k in range(n):
                path[n_solved, k] = theta[k]
        if spread.size > 0:
            if numbers[3] > 0.0:
                sandwich(A, meat, spread[n_solved])
            else:
                for i in range(n):
                    for k in range(n):
                        spread[n_solved, i, k] = np.nan
        n_solved += 1
