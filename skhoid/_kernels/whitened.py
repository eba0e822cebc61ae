"""Recursions beside autoregressive noise: prediction errors, and instrumental variables."""

from __future__ import annotations

import numpy as np

from .kernel import inner, kernel

STILL = 3e-6  # of the largest regressors: below, nothing is forgotten
ORDINARY, LARGE = 4.0, 9.0  # squared errors over their variance
LARGEST = 1e100  # of simulated outputs


@inner
def push(m, at, length):
    """Make room for the latest of ``length`` values from ``at`` on, of which the oldest goes."""
    for k in range(length - 1, 0, -1):
        m[at + k] = m[at + k - 1]


@inner
def factorised(R, L, least):
    """R = L L', of the lower triangle; pivots below ``least`` of the diagonal are a failure."""
    n = L.shape[0]
    good = True
    for i in range(n):
        for k in range(i + 1):
            value = R[i, k]
            for j in range(k):
                value -= L[i, j] * L[k, j]
            if i > k:
                L[i, k] = value / L[k, k]
            else:
                if R[i, i] == 0.0:  # nothing is known of it yet: the others go on without
                    value = 1.0
                elif not value > least * R[i, i]:
                    good = False
                    value = 1.0
                L[i, i] = np.sqrt(value)
    return good


@inner
def solve(L, right, out):
    """Solve L L' out = right."""
    n = right.size
    for i in range(n):
        value = right[i]
        for j in range(i):
            value -= L[i, j] * out[j]
        out[i] = value / L[i, i]
    for i in range(n - 1, -1, -1):
        value = out[i]
        for j in range(i + 1, n):
            value -= L[j, i] * out[j]
        out[i] = value / L[i, i]


@inner
def inside_unit_circle(f, na, work):
    """Whether 1 + f_1 q^-1 + ... has all roots inside the unit circle (Schur and Cohn)."""
    for k in range(na):
        work[0, k] = f[k]
    for order in range(na, 0, -1):
        last = work[0, order - 1]
        if not abs(last) < 1.0 - 1e-9:
            return False
        for k in range(order - 1):
            work[1, k] = (work[0, k] - last * work[0, order - 2 - k]) / (1.0 - last * last)
        for k in range(order - 1):
            work[0, k] = work[1, k]
    return True


@inner
def follow_noise(v, d, U, D, forgetting, share, variance, work):
    """Least squares of v on what came before it, P = U D U' (Bierman); the new error variance.

    ``v`` is the latest first. Large errors, as those that a change of the operator makes, say
    little about the remnant, and count the less the larger they are.
    """
    nd = d.size
    f, b = work[0], work[1]
    error = v[0]
    for k in range(nd):
        error += d[k] * v[1 + k]
    square = error * error
    alpha = max(1.0, square / (ORDINARY * variance))
    for k in range(nd):
        D[k] /= forgetting
        f[k] = -v[1 + k]
        for i in range(k):
            f[k] -= U[k * (k - 1) // 2 + i] * v[1 + i]
        b[k] = D[k] * f[k]
        before = alpha
        alpha += f[k] * b[k]
        D[k] *= before / alpha
        ratio = -f[k] / before
        for i in range(k):
            u = U[k * (k - 1) // 2 + i]
            U[k * (k - 1) // 2 + i] = u + b[i] * ratio
            b[i] += u * b[k]
    for k in range(nd):
        d[k] += b[k] * error / alpha
    return variance + share * (min(square, LARGE * variance) - variance)


@inner
def residual(theta, orders, n_inputs, m, out_filtered, first_input, v):
    """v = u - w by these parameters, now and nd rows back: (F u - B e) filtered by 1 / slow F."""
    na, nd = orders[0], orders[1]
    for i in range(nd + 1):
        v[i] = m[out_filtered + i]
        for k in range(na):
            v[i] += theta[k] * m[out_filtered + i + 1 + k]
    at, p = first_input, na
    for i in range(n_inputs):
        nb, nk = orders[2 + i], orders[2 + n_inputs + i]
        filtered = at + nk + nb + nd
        for j in range(nd + 1):
            for k in range(nb):
                v[j] -= theta[p + k] * m[filtered + j + k]
        at = filtered + max(nb + nd, na + 1) + nb
        p += nb


@kernel(
    "f8[:,:,::1], f8[:,::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], "
    "f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1]",
    5,
)
def prediction_errors(
    signals, target, orders, forgetting, waits, theta, slow, noise, shared, memory, counts, path,
    noise_path, information, errors,
):  # fmt: skip
    """Follow u = B/F e + (1/D) eps over instants, from a state that it changes.

    ``signals`` are the inputs, of shape (n_inputs, n_instants, n_runs), ``target`` the output; NaN
    is what was not measured. ``orders`` is [na, nd, nb..., nk...]. ``forgetting`` has the square
    roots of lambda of each parameter, then lambda of the noise, then the shares by which the slow
    F follows F, and the variance of ordinary errors their squares. ``waits`` are the rows that
    signals need after a rest, and after a NaN.

    The state: ``theta`` and ``slow``, F of the filters; ``noise`` D and the factors of its P
    (U by columns, then its diagonal); ``shared`` the information matrix, then the largest regressor
    so far of each parameter; ``memory`` by run: rows since a rest, rows to leave out, and the
    signals before, the latest first. ``counts`` are updates, their sum of squared errors,
    instants that did not forget, the variance of ordinary errors, and instants with updates.
    """
    na, nd = orders[0], orders[1]
    n_inputs, n_instants, n_runs = signals.shape
    nb, nk = orders[2 : 2 + n_inputs], orders[2 + n_inputs : 2 + 2 * n_inputs]
    n = theta.size
    R, largest = shared[: n * n].reshape(n, n), shared[n * n :]
    d, U, D = noise[:nd], noise[nd : nd + nd * (nd - 1) // 2], noise[nd + nd * (nd - 1) // 2 :]
    # Where signals begin: D w, u, u / F, D w / F; and of each input e, e / F and D e.
    DW, OUT = 2, 2 + na + 1
    UF = OUT + nd + 1
    DWF = UF + nd + na + 1
    first_input = DWF + na + 1
    g, step, psi, new = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    L = np.empty((n, n))
    v, work = np.empty(nd + 1), np.empty((2, max(na, nd, 1)))
    usable = np.empty(n_runs, dtype=np.bool_)
    for t in range(n_instants):
        for k in range(n):
            g[k] = 0.0
        n_used = 0
        for r in range(n_runs):
            m = memory[r]
            broken = False
            # D comes before B / F: after it, D would take every step of theta for noise.
            white = 0.0
            for k in range(na):
                white -= theta[k] * m[DW + k]
            at, p = first_input, na
            for i in range(n_inputs):
                depth = nk[i] + nb[i] + nd
                value = signals[i, t, r]
                if not np.isfinite(value):
                    broken = True
                    value = m[at] if m[0] > 0 else 0.0
                push(m, at, depth)
                m[at] = value
                filtered, length = at + depth, max(nb[i] + nd, na + 1)
                push(m, filtered, length)
                value = m[at + nk[i]]
                for k in range(na):
                    value -= slow[k] * m[filtered + 1 + k]
                m[filtered] = value
                whitened = filtered + length
                for k in range(nb[i]):
                    value = m[at + nk[i] + k]
                    for j in range(nd):
                        value += d[j] * m[at + nk[i] + k + 1 + j]
                    m[whitened + k] = value
                    white += theta[p + k] * value
                at = whitened + nb[i]
                p += nb[i]
            white = min(max(white, -LARGEST), LARGEST)
            forecast = white
            for k in range(nd):
                forecast -= d[k] * m[OUT + k]
            y = target[t, r]
            measured = np.isfinite(y)
            if not measured:
                y = forecast
            m[1] = waits[1] if broken else max(m[1] - 1.0, 0.0)
            usable[r] = measured and m[0] >= waits[0] and m[1] == 0.0
            error = y - forecast
            if usable[r]:
                for k in range(na):
                    psi[k] = -m[DWF + k]
                at, p = first_input, na
                for i in range(n_inputs):
                    filtered = at + nk[i] + nb[i] + nd
                    for k in range(nb[i]):
                        value = m[filtered + k]
                        for j in range(nd):
                            value += d[j] * m[filtered + k + 1 + j]
                        psi[p + k] = value
                    at = filtered + max(nb[i] + nd, na + 1) + nb[i]
                    p += nb[i]
                excited = False
                for k in range(n):
                    size = abs(psi[k])
                    excited = excited or size > STILL * largest[k]
                    largest[k] = max(largest[k], size)
                if excited:
                    if n_used == 0:
                        for i in range(n):
                            for k in range(n):
                                R[i, k] *= forgetting[i] * forgetting[k]
                    for i in range(n):
                        g[i] += psi[i] * error
                        for k in range(n):
                            R[i, k] += psi[i] * psi[k]
                    n_used += 1
                    counts[0] += 1
                    counts[1] += error * error
                else:
                    usable[r] = False
            if errors.size > 0:
                errors[t, r] = error if usable[r] else np.nan
            m[0] += 1.0
            value = white
            for k in range(na):
                value -= slow[k] * m[DWF + k]
            push(m, DWF, na + 1)
            push(m, DW, na + 1)
            m[DWF], m[DW] = value, white
            value = y
            for k in range(na):
                value -= slow[k] * m[UF + k]
            push(m, UF, nd + na + 1)
            m[UF] = value
            push(m, OUT, nd + 1)
            m[OUT] = y
        if n_used == 0:
            counts[2] += 1
        else:
            counts[4] += 1
            if factorised(R, L, 1e-14):
                solve(L, g, step)
                # F stays inside the unit circle: half the step, and half of that, as need be.
                inside = False
                for _ in range(10):
                    for k in range(na):
                        new[k] = theta[k] + step[k]
                    inside = inside_unit_circle(new, na, work)
                    if inside:
                        break
                    for k in range(n):
                        step[k] *= 0.5
                if inside:
                    for k in range(n):
                        theta[k] += step[k]
                    for k in range(na):
                        slow[k] += forgetting[n + 1] * (theta[k] - slow[k])
            for r in range(n_runs):
                if usable[r] and nd > 0:
                    residual(theta, orders, n_inputs, memory[r], UF, first_input, v)
                    counts[3] = follow_noise(
                        v, d, U, D, forgetting[n], forgetting[n + 2], counts[3], work
                    )
        if path.size > 0:
            for k in range(n):
                path[t, k] = theta[k]
            for k in range(nd):
                noise_path[t, k] = d[k]
        if information.size > 0:
            for i in range(n):
                for k in range(n):
                    information[t, i, k] = R[i, k]


@kernel(
    "f8[:,:,::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], "
    "f8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1]",
    4,
)
def instruments(
    signals, target, orders, lags, forgetting, waits, theta, slow, noise, shared, memory, counts,
    path, noise_path, information, errors,
):  # fmt: skip
    """Follow F u = B e by instruments over instants, from a state that it changes.

    The equation and the instruments, ``lags`` rows old, are filtered by D / slow F, and theta is
    their two-stage least squares with exponential weights. ``signals`` are inputs, then external
    signals; the rest is as in ``prediction_errors``, but ``forgetting`` begins with one lambda, of
    all parameters (0: filters, noise and estimates stay, and statistics alone add up), and
    ``shared`` are the sums of z z', z phi', z u, the information matrix, and the largest
    regressors.
    """
    na, nd = orders[0], orders[1]
    n_signals, n_instants, n_runs = signals.shape
    n_inputs = (orders.size - 2) // 2
    nb, nk = orders[2 : 2 + n_inputs], orders[2 + n_inputs :]
    n, n_external, reach = theta.size, n_signals - n_inputs, lags[-1] + 1
    nz = n_external * lags.size
    a, b = nz * nz, nz * nz + nz * n
    ZZ, ZP = shared[:a].reshape(nz, nz), shared[a:b].reshape(nz, n)
    ZY, R = shared[b : b + nz], shared[b + nz : b + nz + n * n].reshape(n, n)
    largest = shared[b + nz + n * n :]
    d, U, D = noise[:nd], noise[nd : nd + nd * (nd - 1) // 2], noise[nd + nd * (nd - 1) // 2 :]
    UF = 2
    first_input = UF + nd + na + 1
    phi, z, new, right = np.empty(n), np.empty(nz), np.empty(n), np.empty(n)
    L, G, h, M = np.empty((nz, nz)), np.empty((nz, n)), np.empty(nz), np.empty((n, n))
    v, work = np.empty(nd + 1), np.empty((2, max(na, nd, 1)))
    usable = np.empty(n_runs, dtype=np.bool_)
    frozen = forgetting[0] == 0.0
    for t in range(n_instants):
        n_used = 0
        for r in range(n_runs):
            m = memory[r]
            broken = False
            predicted = 0.0  # of the output filtered by D / F
            for k in range(na):
                value = m[UF + k]
                for j in range(nd):
                    value += d[j] * m[UF + k + 1 + j]
                phi[k] = -value
                predicted += theta[k] * phi[k]
            at, p = first_input, na
            for i in range(n_inputs):
                depth = nk[i] + nb[i] + nd
                value = signals[i, t, r]
                if not np.isfinite(value):
                    broken = True
                    value = m[at] if m[0] > 0 else 0.0
                push(m, at, depth)
                m[at] = value
                filtered, length = at + depth, max(nb[i] + nd, na + 1)
                push(m, filtered, length)
                value = m[at + nk[i]]
                for k in range(na):
                    value -= slow[k] * m[filtered + 1 + k]
                m[filtered] = value
                for k in range(nb[i]):
                    value = m[filtered + k]
                    for j in range(nd):
                        value += d[j] * m[filtered + k + 1 + j]
                    phi[p + k] = value
                    predicted += theta[p + k] * value
                at = filtered + length + nb[i]
                p += nb[i]
            q = 0
            for i in range(n_external):
                value = signals[n_inputs + i, t, r]
                if not np.isfinite(value):
                    broken = True
                    value = 0.0
                length = max(nd, na) + 1
                push(m, at, length)
                for k in range(na):
                    value -= slow[k] * m[at + 1 + k]
                m[at] = value
                for j in range(nd):
                    value += d[j] * m[at + 1 + j]
                whitened = at + length
                push(m, whitened, reach)
                m[whitened] = value
                for lag in lags:
                    z[q] = m[whitened + lag]
                    q += 1
                at = whitened + reach
            y = target[t, r]
            rest = 0.0  # of D u / F, but for its newest value
            for j in range(nd):
                rest += d[j] * m[UF + j]
            old = 0.0
            for k in range(na):
                old += slow[k] * m[UF + k]
            measured = np.isfinite(y)
            value = y - old if measured else predicted - rest
            push(m, UF, nd + na + 1)
            m[UF] = value
            m[1] = waits[1] if broken else max(m[1] - 1.0, 0.0)
            usable[r] = measured and m[0] >= waits[0] and m[1] == 0.0
            m[0] += 1.0
            error = value + rest - predicted
            if usable[r]:
                excited = False
                for k in range(n):
                    excited = excited or abs(phi[k]) > STILL * largest[k]
                    largest[k] = max(largest[k], abs(phi[k]))
                usable[r] = excited
            if usable[r]:
                if n_used == 0 and not frozen:
                    for i in range(b + nz):  # ZZ, ZP and ZY
                        shared[i] *= forgetting[0]
                for i in range(nz):
                    for k in range(nz):
                        ZZ[i, k] += z[i] * z[k]
                    for k in range(n):
                        ZP[i, k] += z[i] * phi[k]
                    ZY[i] += z[i] * (value + rest)
                n_used += 1
                counts[0] += 1
                counts[1] += error * error
            if errors.size > 0:
                errors[t, r] = error if usable[r] else np.nan
        if n_used == 0:
            counts[2] += 1
        elif not frozen:
            counts[4] += 1
            factorised(ZZ, L, 1e-13)
            for i in range(nz):  # G = L^-1 ZP and h = L^-1 ZY
                h[i] = ZY[i]
                for k in range(n):
                    G[i, k] = ZP[i, k]
                for j in range(i):
                    h[i] -= L[i, j] * h[j]
                    for k in range(n):
                        G[i, k] -= L[i, j] * G[j, k]
                h[i] /= L[i, i]
                for k in range(n):
                    G[i, k] /= L[i, i]
            for i in range(n):
                right[i] = 0.0
                for j in range(nz):
                    right[i] += G[j, i] * h[j]
                for k in range(n):
                    R[i, k] = 0.0
                    for j in range(nz):
                        R[i, k] += G[j, i] * G[j, k]
            if factorised(R, M, 1e-13):
                solve(M, right, new)
                if inside_unit_circle(new, na, work):
                    for k in range(n):
                        theta[k] = new[k]
                    for k in range(na):
                        slow[k] += forgetting[2] * (theta[k] - slow[k])
            for r in range(n_runs):
                if usable[r] and nd > 0:
                    residual(theta, orders, n_inputs, memory[r], UF, first_input, v)
                    counts[3] = follow_noise(
                        v, d, U, D, forgetting[1], forgetting[3], counts[3], work
                    )
        if path.size > 0:
            for k in range(n):
                path[t, k] = theta[k]
            for k in range(nd):
                noise_path[t, k] = d[k]
        if information.size > 0:
            for i in range(n):
                for k in range(n):
                    information[t, i, k] = R[i, k]
