"""Recursive least squares, and free runs along its paths, several side by side.

The covariance is kept as P = U D U', U unit upper triangular and D diagonal (Bierman 1977): it is
symmetric and positive definite whatever the rounding. :func:`recursion` computes on vectors of
lanes, :func:`free_runs` in loops over them. Nothing is reordered or fused but by
:func:`~skhoid._kernels.lanes.fma`: a lane gives the same bits alone and beside others, and a kernel
for one number of parameters the same as that for all.

Factor k is not forgotten further where D_k max(phi_k^2) exceeds ``HELD`` (the bound on P of
Salgado, Goodwin and Middleton 1988, taken in the factors), nor is anything where all regressors are
negligible compared with what they were: information that is not replaced is kept.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba.extending import register_jitable

from .kernel import kernel
from .lanes import (
    VERSION,
    every,
    everywhere,
    find_rows,
    fma,
    load,
    maximum,
    minimum,
    rows,
    select,
    spread,
    store,
)

MANY = 16  # lanes: two of the widest vectors, so that one works while the other waits
# Lanes, whether they share their signals, and the number of parameters or 0 for any.
VARIANTS = ((1, False, 0), (1, False, 4), (MANY, False, 0), (MANY, True, 0))
CHUNK = 256  # rows taken at a time in streaming

HELD = 1e11  # D_k max(phi_k^2) up to which factor k is forgotten,
CLIPPED = 1e3  # and this many times that, from which it is cut back
GENTLE = HELD**-2  # the inverse of U_ik^2 max(phi_i^2) / max(phi_k^2) up to which k is tilted
LARGEST = 1e150  # D, whatever the power
REMEMBERED = 1 - 2.0**-12  # of the largest square, at each instant with a regressor that is not 0
GROWTH = 1 / REMEMBERED
SHORTEST = 0.5  # variable forgetting factor
TOO_LARGE = 1e40  # of data, as at the gate in preprocessing


NAMES = (
    "U", "D", "theta", "power", "cap", "inflation", "total", "updates", "held", "instants", "size",
)  # fmt: skip


@register_jitable
def offsets(n):
    """Where each of ``NAMES`` begins in a state buffer, in lanes, for n parameters."""
    theta = n * (n + 1) // 2
    total = theta + 4 * n
    return (
        0, theta - n, theta, theta + n, theta + 2 * n, theta + 3 * n,
        total, total + 1, total + 2, total + 3, total + 4,
    )  # fmt: skip


def layout(n_params):
    """The offsets by name."""
    return dict(zip(NAMES, offsets(n_params), strict=True))


def recursion(lanes, shared=False, n_params=0):
    """``advance`` for a number of lanes, which may share their signals.

    One for a number of parameters has its state in registers, and is up to twice as fast.
    """
    return _recursion(lanes, shared, n_params)


@cache
def _recursion(lanes, shared, n_params):
    L, W, FIXED = lanes, 1 if shared else lanes, n_params
    at = layout(n_params)
    HOT, COLD = at["theta"] + 7 * n_params, at["size"] + at["theta"] + n_params + 1
    SHARED, LIMITS = 3 * n_params, n_params + 1

    @register_jitable
    def forget_with_care(c, limits, N, diagonal, wide):
        """Forget in the lanes that wait and are excited, and hold what would grow too large."""
        U, D, _, _, _, INFLATION, _, _, HELDS, INSTANTS, TILT = offsets(N)
        F, GAIN = TILT + D, TILT + D + N
        WAITING, EXCITED = GAIN + N, N
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
                if wide:
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
        N = FIXED if FIXED > 0 else columns.size
        wide = inflate.shape[1] > 1
        U, D, THETA, POWERS, CAPS, INFLATION, TOTAL, UPDATES, HELDS, INSTANTS, SIZE = offsets(N)
        PAIRS, TILT = D, SIZE
        ALPHA, PRODUCT, INVERSE, MOST = THETA + N, THETA + 2 * N, THETA + 3 * N, THETA + 4 * N
        F_NOW, GAIN_NOW = THETA + 5 * N, THETA + 6 * N
        WAITING = TILT + PAIRS + 2 * N
        POWER, CAP, PHI = 0, N, 2 * N
        EXCITED = N
        n_instants, n_runs = Z.shape[1], Z.shape[2]
        starts = np.empty(N, dtype=np.int64)
        for k in range(N):
            starts[k] = (columns[k] * n_instants - lags[k]) * n_runs * W
        # s and q are what every instant needs, in registers if they can be: no other function gets
        # them. c has the rest of the state, and copies for the function that takes care.
        after_s, after_c = (THETA + 7 * N) * L, (THETA + 7 * N + WAITING + 1) * L
        after_q = after_c + 3 * N * W
        heap = np.empty(1 if FIXED > 0 else after_q + (N + 1) * W)
        if FIXED > 0:
            s, c, q, limits = rows(HOT, L), rows(COLD, L), rows(SHARED, W), rows(LIMITS, W)
        else:
            s, c = find_rows(heap, 0, L), find_rows(heap, after_s, L)
            q, limits = find_rows(heap, after_c, W), find_rows(heap, after_q, W)
        for i in range(SIZE):
            c[i] = load(state, i * L, L)
        for i in range(THETA + N):
            s[i] = load(state, i * L, L)
        for k in range(N):
            q[POWER + k] = load(state, (POWERS + k) * L, W)
            q[CAP + k] = load(state, (CAPS + k) * L, W)
        one = spread(1.0, L)
        plain = 0.0  # instants at which all lanes forgot in full
        for t in range(begin, end):
            if t == begin or inflate.shape[0] > 1:
                now = 0 if inflate.shape[0] == 1 else t - offset
                if nominal == 0.0:
                    for k in range(N):
                        i = now * inflate.shape[1] + (k if wide else 0)
                        c[INFLATION + k] = load(inflate, i * L, L)
                if wide:
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
                below = everywhere(W)
                if easy:
                    for k in range(N):
                        power = q[POWER + k] * REMEMBERED
                        q[POWER + k] = power
                        q[CAP + k] = minimum(q[CAP + k] * GROWTH, LARGEST)
                        below = below & (q[PHI + k] * q[PHI + k] <= power)
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
                        power = q[POWER + k] * select(moved, REMEMBERED, 1.0)
                        q[POWER + k] = power
                        q[CAP + k] = minimum(q[CAP + k] * select(moved, GROWTH, 1.0), LARGEST)
                        below = below & (p * p <= power)
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
                    if wide:
                        for k in range(N):
                            grown = s[D + k] * c[INFLATION + k]
                            s[MOST + k] = maximum(grown, spread(q[CAP + k], L) * GENTLE)
                        for i in range(N):
                            most = s[MOST + i]
                            for k in range(i + 1, N):
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
                        if wide:
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
                        forget_with_care(c, limits, N, diagonal, wide)
                        for i in range(THETA):
                            s[i] = c[i]
                        forgot = every(c[WAITING] == 0.0)
                if forgot:
                    pending = False
                    if priors.size > 0:
                        for i in range(THETA):
                            store(priors, (t * THETA + i) * L, s[i])
                e = spread(y, L)
                alpha, product = one, one
                for k in range(N):
                    f = spread(q[PHI + k], L)
                    e = fma(-f, s[THETA + k], e)
                    first = k * (k - 1) // 2
                    for i in range(k):
                        f = fma(s[U + first + i], spread(q[PHI + i], L), f)
                    g = s[D + k] * f
                    alpha = fma(f, g, alpha)
                    s[F_NOW + k], s[GAIN_NOW + k], s[ALPHA + k] = f, g, alpha
                    s[PRODUCT + k] = product
                    product = product * alpha
                inverse = one / product  # one division for all
                for k in range(N - 1, -1, -1):
                    s[INVERSE + k] = inverse * s[PRODUCT + k]
                    inverse = inverse * s[ALPHA + k]
                if not every(product < LARGEST):
                    for k in range(N):
                        inverse = one / s[ALPHA + k]
                        s[INVERSE + k] = select(product < LARGEST, s[INVERSE + k], inverse)
                before, inverse = one, one
                for k in range(N):
                    w, g = -s[F_NOW + k] * inverse, s[GAIN_NOW + k]
                    inverse = s[INVERSE + k]
                    s[D + k] = s[D + k] * (before * inverse)
                    before = s[ALPHA + k]
                    first = k * (k - 1) // 2
                    for i in range(k):
                        u, b = s[U + first + i], s[GAIN_NOW + i]
                        s[U + first + i] = fma(b, w, u)
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
            store(state, (POWERS + k) * L, spread(q[POWER + k], L))
            store(state, (CAPS + k) * L, spread(q[CAP + k], L))
        heap[0] = 0.0  # so that it is not freed before

    # Cached functions of one name from different processes would be mistaken for each other, also
    # those that others call.
    kind = f"{lanes}{'s' * shared}_{n_params or 'any'}_{VERSION}"
    advance.__name__ = advance.__qualname__ = f"advance_{kind}"
    forget_with_care.__name__ = forget_with_care.__qualname__ = f"forget_with_care_{kind}"
    return kernel(
        "f8[:,:,:,::1], f8[:,:,::1], i8[::1], i8[::1], i8, i8, f8[:,:,::1], f8[:,:,::1], i8, b1, "
        "f8, f8[::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1]",
        3,
    )(advance)


for _variant in VARIANTS:
    recursion(*_variant)
_advance_one = recursion(1).dispatcher


def take(X, y, inputs, Z, target, columns, lags, depth, inflate, tilt, diagonal, nominal, s, since):
    """Take rows of X and y into a recursion that began earlier; see ``recursion``.

    ``Z`` and ``target`` have room for ``depth`` rows, those that came last, and ``CHUNK`` more;
    ``since[0]`` counts the rows known without a break. Signals of Z are -y, the columns ``inputs``
    of X, and ones where there is an intercept. Returns False, with nothing done, if a value is too
    large.
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
        _advance_one(
            Z, target, columns, lags, depth, depth + m, inflate, tilt, depth - done,
            diagonal, nominal, s, empty, empty, empty, empty, empty, unused,
        )  # fmt: skip
        for c in range(inputs.size + 1):
            for i in range(depth):
                Z[c, i, 0, 0] = Z[c, m + i, 0, 0]
        done += m
    return True


take.__name__ = take.__qualname__ = f"take_{VERSION}"
take = kernel(
    "f8[:,::1], f8[::1], i8[::1], f8[:,:,:,::1], f8[:,:,::1], i8[::1], i8[::1], i8, f8[:,:,::1], "
    "f8[:,:,::1], b1, f8, f8[::1], i8[::1]",
    3,
)(take)


@kernel("f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,::1], b1[::1]", 1)
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


@kernel(
    "f8[:,::1], i8[::1], i8[::1], i8, i8[::1], i8[::1], i8[::1], f8[:,:,::1], i8[::1], f8, "
    "f8[:,::1]",
    1,
)
def free_runs(signals, columns, lags, na, begin, end, past, path, at, bound, out):
    """Simulate rows of one recording freely along several parameter paths.

    Regressor ``k >= na`` is signal ``columns[k]``, of shape (n_signals, n_rows), at ``lags[k]``
    rows before, zero before row ``past`` of its stretch. Row t is simulated with ``path[at[t]]``,
    of shape (n_params, lanes), from zero outputs at the beginning of each stretch, and is held
    within ``+-bound``.

    The output of the rows from ``begin[0]`` to ``end[-1]`` is left in ``out``.
    """
    n_params, lanes = path.shape[1:]
    ring = np.zeros((na + 1, lanes))  # outputs
    for stretch in range(begin.size):
        for t in range(begin[stretch], end[stretch]):
            theta, new = path[at[t]], ring[t % (na + 1)]
            for j in range(lanes):
                new[j] = 0.0
            for k in range(na, n_params):
                row = t - lags[k]
                phi = signals[columns[k], row] if row >= past[stretch] else 0.0
                for j in range(lanes):
                    new[j] += theta[k, j] * phi
            for k in range(min(na, t - begin[stretch])):
                last = ring[(t - 1 - k) % (na + 1)]
                for j in range(lanes):
                    new[j] -= theta[k, j] * last[j]
            for j in range(lanes):
                new[j] = min(max(new[j], -bound), bound)
                out[t - begin[0], j] = new[j]
