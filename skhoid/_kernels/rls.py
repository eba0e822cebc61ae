"""Recursive least squares, and free runs along its paths, several side by side.

The covariance is kept as P = U D U', U unit upper triangular and D diagonal (Bierman 1977): it is
symmetric and positive definite whatever the rounding. Loops over parameters have constant lengths
and the lanes of a quantity lie side by side, so that the loop over lanes becomes vector
instructions; :func:`recursion` and :func:`free_runs` compile for one number of parameters and
lanes. No operation is reordered or fused: a lane gives the same bits alone and beside others.

Factor k is not forgotten further where D_k max(phi_k^2) exceeds ``HELD`` (the bound on P of
Salgado, Goodwin and Middleton 1988, taken in the factors), nor is anything where all regressors are
negligible compared with what they were: information that is not replaced is kept.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numba.extending import register_jitable

MANY = 16  # lanes; fewer are unrolled before they could be vectorised
CHUNK = 256  # rows taken at a time in streaming

HELD = 1e11  # D_k max(phi_k^2) up to which factor k is forgotten,
CLIPPED = 1e3  # and this many times that, from which it is cut back
STEEPEST = HELD**2  # U_ik^2 max(phi_i^2) / max(phi_k^2) up to which column k is tilted
LARGEST = 1e150  # D, whatever the power
REMEMBERED = 1 - 2.0**-12  # of the largest square, at each instant with a regressor that is not 0
SHORTEST = 0.5  # variable forgetting factor
TOO_LARGE = 1e40  # of data, as at the gate in preprocessing


def layout(n_params):
    """Offsets of the quantities in a state buffer, in lanes."""
    pairs = n_params * (n_params - 1) // 2
    vectors = ["D", "theta", "power", "cap", "phi", "gain", "spare", "inflation"]
    numbers = ["error", "alpha", "use", "forget", "now", "held_now"]
    numbers += ["total", "updates", "held", "instants", "total_now", "updates_now"]
    sizes = [pairs] + [n_params] * len(vectors) + [pairs] + [1] * len(numbers)
    offsets = np.concatenate(([0], np.cumsum(sizes))).tolist()
    return dict(zip(["U", *vectors, "tilt", *numbers, "size"], offsets, strict=True))


@cache
def recursion(n_params, lanes):
    """Compile ``advance`` for a number of parameters and lanes."""
    N, L = n_params, lanes
    at = {name: offset * lanes for name, offset in layout(n_params).items()}
    D, THETA, POWER, CAP = at["D"], at["theta"], at["power"], at["cap"]
    PHI, GAIN, SPARE, ERROR, ALPHA = at["phi"], at["gain"], at["spare"], at["error"], at["alpha"]
    USE, FORGET, INFLATION, TILT = at["use"], at["forget"], at["inflation"], at["tilt"]
    TOTAL, UPDATES, HELDS, INSTANTS = at["total"], at["updates"], at["held"], at["instants"]
    TOTAL_NOW, UPDATES_NOW = at["total_now"], at["updates_now"]
    NOW, HELD_NOW = at["now"], at["held_now"]
    N_FACTORS = N * (N + 1) // 2

    def advance(
        Z, target, columns, lags, begin, end, inflate, tilt, offset, diagonal, nominal, s,
        path, factors, priors, errors, alphas, used,
    ):  # fmt: skip
        """Advance recursions over the instants from ``begin`` to ``end``.

        Z, of shape (n_signals, n_instants, n_runs, 1 or lanes), holds the signals of which
        regressor k is that of ``columns[k]`` at ``lags[k]`` instants before; ``target`` the output,
        NaN where it gives no update. At each instant runs are taken in turn, and P forgets once.
        ``inflate`` is 1 / lambda, of shape (1 or n_instants, 1 or n_params, lanes), from instant
        ``offset`` on, and ``tilt`` sqrt(lambda_k / lambda_i) for i < k by columns (Eq. 20);
        ``diagonal`` inflates the diagonal of P alone. A positive ``nominal`` memory horizon makes
        the forgetting factor variable. ``s`` is the state, see ``layout``.

        Outputs, which are left alone if of size 0, for each instant: theta; the factors U and D of
        P; those after forgetting and before the first update (one lane only); of each run the
        one-step error and 1 + phi' P phi, NaN without an update; the variable forgetting factor.
        """
        n_runs, shared = Z.shape[2], Z.shape[3] == 1
        wide = 1 if inflate.shape[1] > 1 else 0
        apart = wide == 1 or diagonal
        for t in range(begin, end):
            if t == begin or inflate.shape[0] > 1:
                now = 0 if inflate.shape[0] == 1 else t - offset
                if nominal == 0.0:
                    for k in range(N):
                        for j in range(L):
                            s[INFLATION + k * L + j] = inflate[now, k * wide, j]
                for i in range(N * (N - 1) // 2):
                    for j in range(L):
                        s[TILT + i * L + j] = tilt[now, i * wide, j] if wide == 1 else 1.0
            pending = True
            for j in range(L):
                s[FORGET + j] = 1.0
                s[TOTAL_NOW + j] = 0.0
                s[UPDATES_NOW + j] = 0.0
            if used.size > 0:
                for j in range(L):
                    used[t, j] = 1.0 / s[INFLATION + j]
            if priors.size > 0:
                for i in range(N_FACTORS):
                    priors[t, i, 0] = s[i * L]
            for r in range(n_runs):
                if shared:
                    y = target[t, r, 0]
                    known = y == y
                    for k in range(N):
                        p = Z[columns[k], t - lags[k], r, 0]
                        known = known and p == p
                        s[PHI + k * L] = p
                    if not known:
                        if errors.size > 0:
                            for j in range(L):
                                errors[t, r, j] = np.nan
                        if alphas.size > 0:
                            for j in range(L):
                                alphas[t, r, j] = np.nan
                        continue
                    excited = False
                    for k in range(N):
                        p = s[PHI + k * L]
                        excited = excited or p * p * HELD > s[POWER + k * L]
                    decay = REMEMBERED if excited else 1.0
                    growth = 1.0 / REMEMBERED if excited else 1.0
                    for k in range(N):
                        p = s[PHI + k * L]
                        power, cap = s[POWER + k * L], s[CAP + k * L]
                        if p != 0.0:
                            power *= decay
                            cap = min(cap * growth, LARGEST)
                        if p * p > power:
                            power = p * p
                            cap = min(HELD / power, LARGEST)
                            for j in range(L):
                                s[D + k * L + j] = min(s[D + k * L + j], CLIPPED * cap)
                        s[POWER + k * L] = power
                        for j in range(L):
                            s[PHI + k * L + j] = p
                            s[CAP + k * L + j] = cap
                    for j in range(L):
                        s[ERROR + j] = y
                        s[USE + j] = 2.0 if excited else 1.0
                else:
                    for k in range(N):
                        for j in range(L):
                            s[PHI + k * L + j] = Z[columns[k], t - lags[k], r, j]
                    above = 0
                    for j in range(L):
                        y = target[t, r, j]
                        known = y == y
                        excited = False
                        for k in range(N):
                            p = s[PHI + k * L + j]
                            known = known & (p == p)
                            excited = excited | (p * p * HELD > s[POWER + k * L + j])
                        use = 2.0 if excited else 1.0
                        s[USE + j] = use if known else 0.0
                        s[ERROR + j] = y if known else 0.0
                        for k in range(N):
                            p = s[PHI + k * L + j]
                            p = p if known else 0.0
                            moved = excited & (p != 0.0)
                            power = s[POWER + k * L + j] * (REMEMBERED if moved else 1.0)
                            growth = 1.0 / REMEMBERED if moved else 1.0
                            s[PHI + k * L + j] = p
                            s[POWER + k * L + j] = power
                            s[CAP + k * L + j] = min(s[CAP + k * L + j] * growth, LARGEST)
                            above |= p * p > power
                    if above:
                        for k in range(N):
                            for j in range(L):
                                p = s[PHI + k * L + j]
                                if p * p > s[POWER + k * L + j]:
                                    cap = min(HELD / (p * p), LARGEST)
                                    s[POWER + k * L + j] = p * p
                                    s[CAP + k * L + j] = cap
                                    s[D + k * L + j] = min(s[D + k * L + j], CLIPPED * cap)
                if pending and not apart:
                    for j in range(L):
                        forget = (s[FORGET + j] > 0.0) & (s[USE + j] > 1.0)
                        s[FORGET + j] = 0.0 if forget else s[FORGET + j]
                        s[INSTANTS + j] += 1.0 if forget else 0.0
                        factor = s[INFLATION + j] if forget else 1.0
                        held = 0.0
                        for k in range(N):
                            d = s[D + k * L + j]
                            grown = d * factor
                            hold = grown > max(d, s[CAP + k * L + j])
                            held = 1.0 if hold else held
                            s[D + k * L + j] = d if hold else grown
                        s[HELDS + j] += held
                elif pending:
                    for j in range(L):
                        forget = (s[FORGET + j] > 0.0) & (s[USE + j] > 1.0)
                        s[FORGET + j] = 0.0 if forget else s[FORGET + j]
                        s[INSTANTS + j] += 1.0 if forget else 0.0
                        s[NOW + j] = 1.0 if forget else 0.0
                        s[HELD_NOW + j] = 0.0
                    if diagonal:
                        for j in range(L):
                            if s[NOW + j] == 0.0:
                                continue
                            for k in range(N):
                                p = s[D + k * L + j]
                                for i in range(k + 1, N):
                                    u = s[(i * (i - 1) // 2 + k) * L + j]
                                    p += u * u * s[D + i * L + j]
                                factor = s[INFLATION + k * L + j]
                                if factor > 1.0 and p * factor > s[CAP + k * L + j]:
                                    s[HELD_NOW + j] = 1.0
                                    factor = 1.0
                                s[GAIN + k * L + j] = p * (factor - 1.0)
                            for m in range(N):  # P + c e e' (Agee and Turner 1972)
                                c = s[GAIN + m * L + j]
                                for i in range(m + 1):
                                    s[SPARE + i * L + j] = 1.0 if i == m else 0.0
                                for k in range(m, -1, -1):
                                    v = s[SPARE + k * L + j]
                                    before = s[D + k * L + j]
                                    d = before + c * v * v
                                    s[D + k * L + j] = d
                                    for i in range(k):
                                        u = s[(k * (k - 1) // 2 + i) * L + j]
                                        rest = s[SPARE + i * L + j] - v * u
                                        s[SPARE + i * L + j] = rest
                                        s[(k * (k - 1) // 2 + i) * L + j] = u + c * v / d * rest
                                    c *= before / d
                    else:
                        for j in range(L):
                            for k in range(N):
                                d = s[D + k * L + j]
                                grown = d * s[INFLATION + k * L + j]
                                cap = s[CAP + k * L + j]
                                over = grown - max(d, cap)
                                for i in range(N):
                                    if i >= k:
                                        continue
                                    u = s[(k * (k - 1) // 2 + i) * L + j]
                                    tilted = u * s[TILT + (k * (k - 1) // 2 + i) * L + j]
                                    cap_i = s[CAP + i * L + j]
                                    most = max(u * u * d, cap_i)
                                    over = max(over, tilted * tilted * grown - most)
                                    most = max(u * u * cap, STEEPEST * cap_i)
                                    over = max(over, tilted * tilted * cap - most)
                                move = (over <= 0.0) & (s[NOW + j] > 0.0)
                                hold = (over > 0.0) & (s[NOW + j] > 0.0)
                                s[HELD_NOW + j] = 1.0 if hold else s[HELD_NOW + j]
                                s[D + k * L + j] = grown if move else d
                                for i in range(N):
                                    if i >= k:
                                        continue
                                    u = s[(k * (k - 1) // 2 + i) * L + j]
                                    ratio = s[TILT + (k * (k - 1) // 2 + i) * L + j]
                                    s[(k * (k - 1) // 2 + i) * L + j] = u * (ratio if move else 1.0)
                    for j in range(L):
                        s[HELDS + j] += s[HELD_NOW + j]
                if pending and shared and s[FORGET] == 0.0:
                    pending = False
                    if priors.size > 0:
                        for i in range(N_FACTORS):
                            priors[t, i, 0] = s[i * L]
                for j in range(L):
                    e = s[ERROR + j]
                    for k in range(N):
                        e -= s[PHI + k * L + j] * s[THETA + k * L + j]
                    alpha = 1.0
                    inverse = 1.0
                    for k in range(N):
                        f = s[PHI + k * L + j]
                        for i in range(k):
                            f += s[(k * (k - 1) // 2 + i) * L + j] * s[PHI + i * L + j]
                        d = s[D + k * L + j]
                        g = d * f
                        before = alpha
                        alpha = before + f * g
                        w = -f * inverse
                        inverse = 1.0 / alpha
                        s[D + k * L + j] = d * (before * inverse)
                        s[GAIN + k * L + j] = g
                        for i in range(k):
                            u = s[(k * (k - 1) // 2 + i) * L + j]
                            b = s[GAIN + i * L + j]
                            s[(k * (k - 1) // 2 + i) * L + j] = u + b * w
                            s[GAIN + i * L + j] = b + u * g
                    gain = inverse * e
                    for k in range(N):
                        s[THETA + k * L + j] += s[GAIN + k * L + j] * gain
                    s[TOTAL_NOW + j] += e * gain
                    s[UPDATES_NOW + j] += 1.0 if s[USE + j] > 0.0 else 0.0
                    s[ERROR + j] = e
                    s[ALPHA + j] = alpha
                if errors.size > 0:
                    for j in range(L):
                        errors[t, r, j] = s[ERROR + j] if s[USE + j] > 0.0 else np.nan
                if alphas.size > 0:
                    for j in range(L):
                        alphas[t, r, j] = s[ALPHA + j] if s[USE + j] > 0.0 else np.nan
            for j in range(L):
                s[TOTAL + j] += s[TOTAL_NOW + j]
                s[UPDATES + j] += s[UPDATES_NOW + j]
                idle = (s[UPDATES_NOW + j] > 0.0) & (s[FORGET + j] > 0.0)
                s[HELDS + j] += 1.0 if idle else 0.0
            if nominal > 0.0:
                for j in range(L):
                    if s[UPDATES_NOW + j] > 0.0:
                        mean = s[TOTAL + j] / s[UPDATES + j]
                        latest = s[TOTAL_NOW + j] / s[UPDATES_NOW + j]
                        factor = 1.0 - latest / (mean * nominal) if mean > 0.0 else 1.0
                        for k in range(N):
                            s[INFLATION + k * L + j] = 1.0 / max(factor, SHORTEST)
            if path.size > 0:
                for k in range(N):
                    for j in range(L):
                        path[t, k, j] = s[THETA + k * L + j]
            if factors.size > 0:
                for i in range(N_FACTORS):
                    for j in range(L):
                        factors[t, i, j] = s[i * L + j]

    # Cached functions of one name from different processes would be mistaken for each other.
    advance.__name__ = advance.__qualname__ = f"advance_{n_params}_{lanes}"
    return njit(cache=True, nogil=True, error_model="numpy")(advance)


@cache
def stream(n_params):
    """Compile ``take`` for a number of parameters."""
    # Not the compiled function: a closure that holds one is cached anew by every process.
    compiled = recursion(n_params, 1)
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

    take.__name__ = take.__qualname__ = f"take_{n_params}"
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
