"""Recursive least squares, and free runs along its paths, several side by side.

The covariance is kept as P = U D U', U unit upper triangular and D diagonal (Bierman 1977): it is
symmetric and positive definite whatever the rounding. :func:`recursion` computes on vectors of
lanes, :func:`free_runs` in loops over them; both compile for one number of parameters and lanes.
Nothing is reordered or fused but by :func:`~skhoid._kernels.lanes.fma`: a lane gives the same bits
alone and beside others. Some loops over pairs skip what a shorter range would leave out: only loops
of constant length are unrolled, and only then does the state of few parameters stay in registers.

Factor k is not forgotten further where D_k max(phi_k^2) exceeds ``HELD`` (the bound on P of
Salgado, Goodwin and Middleton 1988, taken in the factors), nor is anything where all regressors are
negligible compared with what they were: information that is not replaced is kept.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numba.extending import register_jitable

from .lanes import (
    VERSION,
    every,
    everywhere,
    fma,
    load,
    maximum,
    minimum,
    rows,
    rows_of,
    select,
    spread,
    store,
)

MANY = 16  # lanes: two of the widest vectors, so that one works while the other waits
CHUNK = 256  # rows taken at a time in streaming

HELD = 1e11  # D_k max(phi_k^2) up to which factor k is forgotten,
CLIPPED = 1e3  # and this many times that, from which it is cut back
GENTLE = HELD**-2  # the inverse of U_ik^2 max(phi_i^2) / max(phi_k^2) up to which k is tilted
LARGEST = 1e150  # D, whatever the power
REMEMBERED = 1 - 2.0**-12  # of the largest square, at each instant with a regressor that is not 0
GROWTH = 1 / REMEMBERED
SHORTEST = 0.5  # variable forgetting factor
TOO_LARGE = 1e40  # of data, as at the gate in preprocessing


def layout(n_params):
    """Offsets of the quantities in a state buffer, in lanes."""
    vectors = ["D", "theta", "power", "cap", "inflation"]
    numbers = ["total", "updates", "held", "instants"]
    sizes = [n_params * (n_params - 1) // 2] + [n_params] * len(vectors) + [1] * len(numbers)
    offsets = np.concatenate(([0], np.cumsum(sizes))).tolist()
    return dict(zip(["U", *vectors, *numbers, "size"], offsets, strict=True))


@cache
def recursion(n_params, lanes, shared=False, wide=False):
    """Compile ``advance`` for a number of parameters and lanes.

    Lanes may share their signals; ``wide`` forgetting has one factor for each parameter.
    """
    N, L, WIDE = n_params, lanes, wide
    W = 1 if shared else lanes
    at = layout(n_params)
    U, D, THETA, INFLATION, SIZE = at["U"], at["D"], at["theta"], at["inflation"], at["size"]
    TOTAL, UPDATES, HELDS, INSTANTS = at["total"], at["updates"], at["held"], at["instants"]
    POWERS, CAPS = at["power"] * lanes, at["cap"] * lanes
    PAIRS = N * (N - 1) // 2
    TILT = SIZE
    F, GAIN = TILT + PAIRS, TILT + PAIRS + N
    ALPHA, PRODUCT, INVERSE, MOST = (THETA + k * N for k in range(1, 5))
    F_NOW, GAIN_NOW = THETA + 5 * N, THETA + 6 * N
    N_HOT, WAITING, N_COLD = THETA + 7 * N, GAIN + N, GAIN + N + 1
    POWER, CAP, PHI, N_SHARED = 0, N, 2 * N, 3 * N
    EXCITED, N_LIMITS = N, N + 1
    FEW = N <= 16
    N_HEAP = 0 if FEW else (N_HOT + N_COLD) * L
    COLD = N_HOT * L

    @register_jitable
    def forget_with_care(c, limits, diagonal):
        """Forget in the lanes that wait and are excited, and hold what would grow too large."""
        forget = (c[WAITING] > 0.0) & spread(limits[EXCITED] > 0.0, L)
        held = ~everywhere(L)
        if diagonal:
            for k in range(N):
                p = c[D + k]
                for i in range(k + 1, N):
                    u = c[U + i * (i - 1) // 2 + k]
                    p = p + u * u * c[D + i]
                factor = c[INFLATION + k]
                hold = (factor > 1.0) & (p * factor > spread(limits[k], L))
                held = held | hold
                c[GAIN + k] = select(forget & ~hold, p * (factor - 1.0), 0.0)
            for m in range(N):  # P + w e e' (Agee and Turner 1972)
                w = c[GAIN + m]
                for i in range(m):
                    c[F + i] = spread(0.0, L)
                c[F + m] = spread(1.0, L)
                for k in range(m, -1, -1):
                    v, before = c[F + k], c[D + k]
                    d = before + w * v * v
                    c[D + k] = d
                    for i in range(k):
                        u = c[U + k * (k - 1) // 2 + i]
                        rest = c[F + i] - v * u
                        c[F + i] = rest
                        c[U + k * (k - 1) // 2 + i] = u + w * v / d * rest
                    w = w * (before / d)
        else:
            for k in range(N):
                d, cap = c[D + k], spread(limits[k], L)
                grown, least = d * c[INFLATION + k], cap * GENTLE
                hold = grown > maximum(d, cap)
                first = k * (k - 1) // 2
                if WIDE:
                    for i in range(k):
                        u = c[U + first + i]
                        tilted = u * c[TILT + first + i]
                        cap_i = spread(limits[i], L)
                        square, tilted = u * u, tilted * tilted
                        hold = hold | (tilted * grown > maximum(square * d, cap_i))
                        hold = hold | (tilted * least > maximum(square * least, cap_i))
                    for i in range(k):
                        u = c[U + first + i]
                        c[U + first + i] = select(forget & ~hold, u * c[TILT + first + i], u)
                held = held | hold
                c[D + k] = select(forget & ~hold, grown, d)
        c[HELDS] = c[HELDS] + select(forget & held, 1.0, 0.0)
        c[INSTANTS] = c[INSTANTS] + select(forget, 1.0, 0.0)
        c[WAITING] = select(forget, 0.0, c[WAITING])

    def advance(
        Z, target, columns, lags, begin, end, inflate, tilt, offset, diagonal, nominal, state,
        path, factors, priors, errors, alphas, used,
    ):  # fmt: skip
        """Advance recursions over the instants from ``begin`` to ``end``.

        Z, of shape (n_signals, n_instants, n_runs, 1 if shared or lanes), holds the signals of
        which regressor k is that of ``columns[k]`` at ``lags[k]`` instants before; ``target`` the
        output, NaN where it gives no update. At each instant runs are taken in turn, and P forgets
        once. ``inflate`` is 1 / lambda, of shape (1 or n_instants, n_params if wide or 1, lanes),
        from instant ``offset`` on; ``tilt`` sqrt(lambda_k / lambda_i) for i < k by columns (Eq.
        20); ``diagonal`` inflates the diagonal of P alone. A positive ``nominal`` memory horizon
        makes the forgetting factor variable. ``state`` is laid out by ``layout``.

        Outputs, which are left alone if of size 0, for each instant: theta; the factors U and D of
        P; those after forgetting and before the first update (one lane only); of each run the
        one-step error and 1 + phi' P phi, NaN without an update; the variable forgetting factor.
        """
        n_instants, n_runs = Z.shape[1], Z.shape[2]
        starts = np.empty(N, dtype=np.int64)
        for k in range(N):
            starts[k] = (columns[k] * n_instants - lags[k]) * n_runs * W
        # s and q are what every instant needs, in registers if they can be: no other function gets
        # them. c has the rest of the state, and copies for the function that takes care.
        heap = np.empty(N_HEAP)
        if FEW:
            s, c = rows(N_HOT, L), rows(N_COLD, L)
        else:
            s, c = rows_of(heap, 0, L), rows_of(heap, COLD, L)
        q, limits = rows(N_SHARED, W), rows(N_LIMITS, W)
        for i in range(SIZE):
            c[i] = load(state, i * L, L)
        for i in range(THETA + N):
            s[i] = load(state, i * L, L)
        for k in range(N):
            q[POWER + k] = load(state, POWERS + k * L, W)
            q[CAP + k] = load(state, CAPS + k * L, W)
        one = spread(1.0, L)
        plain = 0.0  # instants at which all lanes forgot in full
        for t in range(begin, end):
            if t == begin or inflate.shape[0] > 1:
                now = 0 if inflate.shape[0] == 1 else t - offset
                if nominal == 0.0:
                    for k in range(N):
                        i = now * inflate.shape[1] + (k if WIDE else 0)
                        c[INFLATION + k] = load(inflate, i * L, L)
                if WIDE:
                    for i in range(PAIRS):
                        c[TILT + i] = load(tilt, (now * PAIRS + i) * L, L)
            if used.size > 0:
                store(used, t * L, one / c[INFLATION])
            if priors.size > 0:
                for i in range(THETA):
                    store(priors, (t * THETA + i) * L, s[i])
            pending = True
            total, updates = spread(0.0, L), spread(0.0, L)
            for r in range(n_runs):
                row = (t * n_runs + r) * W
                y = load(target, row, W)
                taken = y == y
                for k in range(N):
                    p = load(Z, starts[k] + row, W)
                    q[PHI + k] = p
                    taken = taken & (p == p) & (p != 0.0)
                # What is usual in all lanes needs no masks: the same bits, in less time.
                excited = taken & (q[PHI] * q[PHI] * HELD > q[POWER])
                easy = every(excited)
                if easy:
                    for k in range(N):
                        q[POWER + k] = q[POWER + k] * REMEMBERED
                        q[CAP + k] = minimum(q[CAP + k] * GROWTH, LARGEST)
                else:
                    taken, excited = y == y, ~everywhere(W)
                    for k in range(N):
                        p = q[PHI + k]
                        taken = taken & (p == p)
                        excited = excited | (p * p * HELD > q[POWER + k])
                    y, excited = select(taken, y, 0.0), excited & taken
                    for k in range(N):
                        p = select(taken, q[PHI + k], 0.0)
                        moved = excited & (p != 0.0)
                        q[PHI + k] = p
                        q[POWER + k] = q[POWER + k] * select(moved, REMEMBERED, 1.0)
                        q[CAP + k] = minimum(q[CAP + k] * select(moved, GROWTH, 1.0), LARGEST)
                below = everywhere(W)
                for k in range(N):
                    below = below & (q[PHI + k] * q[PHI + k] <= q[POWER + k])
                if not every(below):
                    for k in range(N):
                        square, d = q[PHI + k] * q[PHI + k], s[D + k]
                        below = square <= q[POWER + k]
                        cap = minimum(HELD / select(below, 1.0, square), LARGEST)
                        cap = select(below, q[CAP + k], cap)
                        clipped = minimum(d, spread(CLIPPED * cap, L))
                        s[D + k] = select(spread(below, L), d, clipped)
                        q[POWER + k], q[CAP + k] = maximum(square, q[POWER + k]), cap
                forgot = False
                if pending:
                    fits = everywhere(L)
                    if WIDE:
                        for k in range(N):
                            grown = s[D + k] * c[INFLATION + k]
                            s[MOST + k] = maximum(grown, spread(q[CAP + k], L) * GENTLE)
                        for i in range(N):
                            most = s[MOST + i]
                            for k in range(N):
                                if k <= i:
                                    continue
                                above = k * (k - 1) // 2 + i
                                tilted = s[U + above] * c[TILT + above]
                                most = fma(tilted * tilted, s[MOST + k], most)
                            fits = fits & (most <= spread(q[CAP + i], L))
                    else:
                        for k in range(N):
                            grown = s[D + k] * c[INFLATION + k]
                            fits = fits & (grown <= spread(q[CAP + k], L))
                    forgot = every(fits) and easy and r == 0 and not diagonal
                    if forgot:
                        for k in range(N):
                            s[D + k] = s[D + k] * c[INFLATION + k]
                        if WIDE:
                            for i in range(PAIRS):
                                s[U + i] = s[U + i] * c[TILT + i]
                        plain += 1.0
                    else:
                        for i in range(THETA):
                            c[i] = s[i]
                        for k in range(N):
                            limits[k] = q[CAP + k]
                        limits[EXCITED] = select(excited, 1.0, 0.0)
                        if r == 0:
                            c[WAITING] = one
                        forget_with_care(c, limits, diagonal)
                        for i in range(THETA):
                            s[i] = c[i]
                        forgot = every(c[WAITING] == 0.0)
                if forgot:
                    pending = False
                    if priors.size > 0:
                        for i in range(THETA):
                            store(priors, (t * THETA + i) * L, s[i])
                e = spread(y, L)
                alpha = one
                for k in range(N):
                    f = spread(q[PHI + k], L)
                    e = fma(-f, s[THETA + k], e)
                    for i in range(N):
                        if i >= k:
                            continue
                        f = fma(s[U + k * (k - 1) // 2 + i], spread(q[PHI + i], L), f)
                    g = s[D + k] * f
                    alpha = fma(f, g, alpha)
                    s[F_NOW + k], s[GAIN_NOW + k], s[ALPHA + k] = f, g, alpha
                for first in range(0, N, 4):  # one division for four
                    last = min(first + 4, N)
                    product = one
                    for k in range(first, last):
                        s[PRODUCT + k] = product
                        product = product * s[ALPHA + k]
                    inverse = one / product
                    for k in range(last - 1, first - 1, -1):
                        s[INVERSE + k] = inverse * s[PRODUCT + k]
                        inverse = inverse * s[ALPHA + k]
                    if not every(product < LARGEST):
                        for k in range(first, last):
                            inverse = one / s[ALPHA + k]
                            s[INVERSE + k] = select(product < LARGEST, s[INVERSE + k], inverse)
                before, inverse = one, one
                for k in range(N):
                    w, g = -s[F_NOW + k] * inverse, s[GAIN_NOW + k]
                    inverse = s[INVERSE + k]
                    s[D + k] = s[D + k] * (before * inverse)
                    before = s[ALPHA + k]
                    for i in range(N):
                        if i >= k:
                            continue
                        u, b = s[U + k * (k - 1) // 2 + i], s[GAIN_NOW + i]
                        s[U + k * (k - 1) // 2 + i] = fma(b, w, u)
                        s[GAIN_NOW + i] = fma(u, g, b)
                gain = inverse * e
                for k in range(N):
                    s[THETA + k] = fma(s[GAIN_NOW + k], gain, s[THETA + k])
                total = fma(e, gain, total)
                updates = updates + select(spread(taken, L), 1.0, 0.0)
                if errors.size > 0:
                    store(errors, (t * n_runs + r) * L, select(spread(taken, L), e, np.nan))
                if alphas.size > 0:
                    store(alphas, (t * n_runs + r) * L, select(spread(taken, L), alpha, np.nan))
            c[TOTAL] = c[TOTAL] + total
            c[UPDATES] = c[UPDATES] + updates
            if pending:
                c[HELDS] = c[HELDS] + select(updates > 0.0, c[WAITING], 0.0)
            if nominal > 0.0:
                mean = c[TOTAL] / maximum(c[UPDATES], 1.0)
                latest = total / maximum(updates, 1.0)
                factor = select(mean > 0.0, 1.0 - latest / (mean * nominal), 1.0)
                factor = one / maximum(factor, SHORTEST)
                for k in range(N):
                    c[INFLATION + k] = select(updates > 0.0, factor, c[INFLATION + k])
            if path.size > 0:
                for k in range(N):
                    store(path, (t * N + k) * L, s[THETA + k])
            if factors.size > 0:
                for i in range(THETA):
                    store(factors, (t * THETA + i) * L, s[i])
        c[INSTANTS] = c[INSTANTS] + plain
        for i in range(THETA + N):
            c[i] = s[i]
        for i in range(SIZE):
            store(state, i * L, c[i])
        for k in range(N):
            store(state, POWERS + k * L, spread(q[POWER + k], L))
            store(state, CAPS + k * L, spread(q[CAP + k], L))

    # Cached functions of one name from different processes would be mistaken for each other, also
    # those that others call.
    kind = f"{n_params}_{lanes}{'s' * shared}{'w' * wide}_{VERSION}"
    advance.__name__ = advance.__qualname__ = f"advance_{kind}"
    forget_with_care.__name__ = forget_with_care.__qualname__ = f"forget_with_care_{kind}"
    return njit(cache=True, nogil=True, error_model="numpy")(advance)


@cache
def stream(n_params, wide=False):
    """Compile ``take`` for a number of parameters."""
    # Not the compiled function: a closure that holds one is cached anew by every process.
    compiled = recursion(n_params, 1, wide=wide)
    advance = register_jitable(getattr(compiled, "py_func", compiled))

    def take(
        X, y, inputs, Z, target, columns, lags, depth, inflate, tilt, diagonal, nominal, s, since
    ):
        """Take rows of X and y into a recursion that began earlier; see ``recursion``.

        ``Z`` and ``target`` have room for ``depth`` rows, those that came last, and ``CHUNK`` more;
        ``since[0]`` counts the rows known without a break. Signals of Z are -y, the columns
        ``inputs`` of X, and ones where there is an intercept. Returns False, with nothing done, if
        a value is too large.
        """
        empty, unused = np.empty((0, 0, 0)), np.empty((0, 0))
        n_rows, n_columns = X.shape
        for i in range(n_rows):
            if abs(y[i]) > TOO_LARGE:
                return False
            for c in range(n_columns):
                if abs(X[i, c]) > TOO_LARGE:
                    return False
        chunk = target.shape[0] - depth
        done = 0
        while done < n_rows:
            m = min(chunk, n_rows - done)
            for i in range(m):
                now = depth + i
                Z[0, now, 0, 0] = -y[done + i]
                for c in range(inputs.size):
                    Z[c + 1, now, 0, 0] = X[done + i, inputs[c]]
                target[now, 0, 0] = y[done + i] if since[0] >= depth else np.nan
                since[0] += 1
            advance(
                Z, target, columns, lags, depth, depth + m, inflate, tilt, depth - done,
                diagonal, nominal, s, empty, empty, empty, empty, empty, unused,
            )  # fmt: skip
            for c in range(inputs.size + 1):
                for i in range(depth):
                    Z[c, i, 0, 0] = Z[c, m + i, 0, 0]
            done += m
        return True

    take.__name__ = take.__qualname__ = f"take_{n_params}{'w' * wide}_{VERSION}"
    return njit(cache=True, nogil=True, error_model="numpy")(take)


@njit(cache=True, nogil=True, error_model="numpy")
def smooth(theta, P, factors, priors, cut):
    """Smooth a path in place, from its end, with the random walk that forgetting implies.

    ``factors`` are U and D of P after each instant, ``priors`` those of P + Q after forgetting, at
    the instant after it: forgetting by one factor leaves U as it is, and a D that was cut back
    counts as not forgotten. With C = P (P + Q)^-1
    = U (D / D_prior) U^-1,

        theta(t) += C (theta(t + 1) - theta(t)),
        P(t) = (I - C) P(t) (I - C)' + C (P(t + 1) + Q) C'.

    Instants in ``cut`` say nothing about the one before. P may have size 0.
    """
    n_instants, n = theta.shape
    n_above = n * (n - 1) // 2
    C, Q, new = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    x = np.empty(n)
    for t in range(n_instants - 2, -1, -1):
        if cut[t + 1]:
            continue
        u, d, prior = factors[t], factors[t, n_above:], priors[t + 1, n_above:]
        for column in range(n):
            for i in range(n):
                x[i] = 1.0 if i == column else 0.0
            for k in range(n - 1, -1, -1):
                for i in range(k):
                    x[i] -= u[k * (k - 1) // 2 + i] * x[k]
            for k in range(n):
                x[k] *= d[k] / max(prior[k], d[k])
            for k in range(n):
                for i in range(k):
                    x[i] += u[k * (k - 1) // 2 + i] * x[k]
            for i in range(n):
                C[i, column] = x[i]
        for i in range(n):
            x[i] = theta[t + 1, i] - theta[t, i]
        for i in range(n):
            for k in range(n):
                theta[t, i] += C[i, k] * x[k]
        if P.size == 0:
            continue
        for i in range(n):
            for m in range(n):
                Q[i, m] = 0.0
                for k in range(max(i, m), n):
                    left = u[k * (k - 1) // 2 + i] if i < k else 1.0
                    right = u[k * (k - 1) // 2 + m] if m < k else 1.0
                    Q[i, m] += left * max(prior[k] - d[k], 0.0) * right
        for i in range(n):
            for m in range(i + 1):
                value = 0.0
                for k in range(n):
                    rest = (1.0 if i == k else 0.0) - C[i, k]
                    for q in range(n):
                        value += C[i, k] * (P[t + 1, k, q] + Q[k, q]) * C[m, q]
                        value += rest * P[t, k, q] * ((1.0 if m == q else 0.0) - C[m, q])
                new[i, m] = value
        for i in range(n):
            for m in range(i + 1):
                P[t, i, m] = new[i, m]
                P[t, m, i] = new[i, m]


@cache
def free_runs(na, n_params, lanes):
    """Compile ``follow`` for the orders of a model and a number of lanes."""
    NA, N, L = na, n_params, lanes

    def follow(signals, columns, lags, begin, end, past, path, at, bound, out):
        """Simulate rows of one recording freely along several parameter paths.

        Regressor ``k >= na`` is signal ``columns[k]``, of shape (n_signals, n_rows), at
        ``lags[k]`` rows before, zero before row ``past`` of its stretch; signal 0 is the output to
        compare with, NaN where not. Row t is simulated with ``path[at[t]]``, of shape (n_params,
        lanes), from zero outputs at the beginning of each stretch, and is held within ``+-bound``.

        The output of the rows from ``begin[0]`` to ``end[-1]`` is left in ``out``, unless that has
        size 0. Returns the sum of the squared errors by lane.
        """
        lost = np.zeros(L)
        phi = np.zeros(N)
        last = np.zeros(NA * L)  # outputs of the rows before, the latest first
        new = np.zeros(L)
        for stretch in range(begin.size):
            last[:] = 0.0
            for t in range(begin[stretch], end[stretch]):
                for k in range(NA, N):
                    row = t - lags[k]
                    phi[k] = signals[columns[k], row] if row >= past[stretch] else 0.0
                theta = path[at[t]]
                for j in range(L):
                    value = 0.0
                    for k in range(NA, N):
                        value += theta[k, j] * phi[k]
                    for k in range(NA):
                        value -= theta[k, j] * last[k * L + j]
                    for k in range(NA - 1, 0, -1):
                        last[k * L + j] = last[(k - 1) * L + j]
                    value = min(max(value, -bound), bound)
                    if NA > 0:
                        last[j] = value
                    new[j] = value
                if out.size > 0:
                    for j in range(L):
                        out[t - begin[0], j] = new[j]
                y = signals[0, t]
                if y == y:
                    for j in range(L):
                        lost[j] += (y - new[j]) * (y - new[j])
        return lost

    follow.__name__ = follow.__qualname__ = f"follow_{na}_{n_params}_{lanes}"
    return njit(cache=True, nogil=True, error_model="numpy")(follow)
