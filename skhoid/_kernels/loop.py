"""The closed loop, sample by sample, for several runs at once.

Runs lie side by side in memory, so that the loops over them become vector instructions.

Physics at an instant is a row of ``physics``: 2 zeta omega_nm; omega_nm^2 times the gains on f_t and
on its rate, and on x and on its rate; K_c; omega_b; K_n. Rows are half a step apart, since
Runge-Kutta asks for the middle of the step; one row alone holds for all time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

DAMPING, STIFFNESS, F, F_RATE, X, X_RATE, K_C, OMEGA_B, K_N = range(9)


@njit(inline="always")
def _rates(z0, z1, x, v, r0, r1, r2, r3, f, d, f_d, w, p, i, filter_, closed):
    """Time derivatives of operator (z), controlled element (x, v) and remnant filter (r)."""
    n = filter_[6] * r0 + filter_[7] * r1 + filter_[8] * r2 + filter_[9] * r3
    return (
        z1 - p[i, DAMPING] * z0 + p[i, F_RATE] * f + p[i, X_RATE] * x,
        -p[i, STIFFNESS] * z0 + p[i, F] * f + p[i, X] * x,
        v,
        p[i, K_C] * (d + closed * n + f_d) - p[i, OMEGA_B] * v,
        filter_[0] * r0 + filter_[1] * r1 + filter_[2] * p[i, K_N] * w,
        filter_[3] * r0 + filter_[4] * r1,
        filter_[5] * (r1 - r2),
        filter_[5] * (r2 - r3),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def track(
    f_t, f_d, white, physics, filter_, delay, weights, theta, na, nk, dt, closed, first, bound
):
    """Simulate runs of a tracking task from rest by fourth-order Runge-Kutta.

    The operator's output ``d`` is its own state ``delay`` samples ago, combined by ``weights`` (at
    the beginning, middle and end of the step) from the samples before, at and after it. Where
    ``theta`` has columns, it is an ARX response to e instead, held over the step. f_t, f_d and the
    white noise are held too.

    Returns e, u, x, n of shape (4, n_samples - first, n_runs), and for each run the sample at which
    its error exceeded ``bound``, or -1.
    """
    n_samples, n_runs = white.shape
    out = np.empty((4, n_samples - first, n_runs))
    unstable = np.full(n_runs, -1)
    z0, z1, x, v, r0, r1, r2, r3 = np.zeros((8, n_runs))
    is_arx = theta.shape[1] > 0
    nb = theta.shape[1] - na
    length = delay + 3 if not is_arx else max(na, nk + nb) + 1
    states = np.zeros((length, n_runs))  # of the operator, or the ARX response; a ring
    errors = np.zeros((length, n_runs))
    f, fd, begin, middle, end = np.zeros((5, n_runs))
    moving = 2 if physics.shape[0] > 1 else 0
    theta_moving = 1 if theta.shape[0] > 1 else 0
    half, sixth = dt / 2, dt / 6
    for k in range(n_samples):
        now = k % length
        for j in range(n_runs):
            f[j] = f_t[k, j % f_t.shape[1]]
            fd[j] = f_d[k, j % f_d.shape[1]]
        if is_arx:
            row = k * theta_moving
            for j in range(n_runs):
                errors[now, j] = f[j] - x[j]
                begin[j] = 0.0
            for i in range(na):
                past = (k - 1 - i) % length
                for j in range(n_runs):
                    begin[j] -= theta[row, i] * states[past, j]
            for i in range(nb):
                past = (k - nk - i) % length
                for j in range(n_runs):
                    begin[j] += theta[row, na + i] * errors[past, j]
            for j in range(n_runs):
                states[now, j] = begin[j]
                middle[j] = begin[j]
                end[j] = begin[j]
        else:
            before, at, after = (
                (k - delay - 1) % length,
                (k - delay) % length,
                (k - delay + 1) % length,
            )
            for j in range(n_runs):
                states[now, j] = z0[j]
            for j in range(n_runs):
                s0, s1, s2 = states[before, j], states[at, j], states[after, j]
                begin[j] = weights[0, 0] * s0 + weights[0, 1] * s1 + weights[0, 2] * s2
                middle[j] = weights[1, 0] * s0 + weights[1, 1] * s1 + weights[1, 2] * s2
                end[j] = weights[2, 0] * s0 + weights[2, 1] * s1 + weights[2, 2] * s2
        if k >= first:
            for j in range(n_runs):
                n = filter_[6] * r0[j] + filter_[7] * r1[j] + filter_[8] * r2[j] + filter_[9] * r3[j]
                out[0, k - first, j] = f[j] - x[j]
                out[1, k - first, j] = begin[j] + n
                out[2, k - first, j] = x[j]
                out[3, k - first, j] = n
        if k % 64 == 0 or k == n_samples - 1:
            for j in range(n_runs):
                if unstable[j] < 0 and not abs(f[j] - x[j]) <= bound:
                    unstable[j] = k
        i0 = k * moving
        im = i0 + moving // 2
        i1 = i0 + moving
        for j in range(n_runs):
            a = (z0[j], z1[j], x[j], v[j], r0[j], r1[j], r2[j], r3[j])
            fj, qj, wj = f[j], fd[j], white[k, j]
            k1 = _rates(
                a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7],
                fj, begin[j], qj, wj, physics, i0, filter_, closed,
            )  # fmt: skip
            k2 = _rates(
                a[0] + half * k1[0], a[1] + half * k1[1], a[2] + half * k1[2], a[3] + half * k1[3],
                a[4] + half * k1[4], a[5] + half * k1[5], a[6] + half * k1[6], a[7] + half * k1[7],
                fj, middle[j], qj, wj, physics, im, filter_, closed,
            )  # fmt: skip
            k3 = _rates(
                a[0] + half * k2[0], a[1] + half * k2[1], a[2] + half * k2[2], a[3] + half * k2[3],
                a[4] + half * k2[4], a[5] + half * k2[5], a[6] + half * k2[6], a[7] + half * k2[7],
                fj, middle[j], qj, wj, physics, im, filter_, closed,
            )  # fmt: skip
            k4 = _rates(
                a[0] + dt * k3[0], a[1] + dt * k3[1], a[2] + dt * k3[2], a[3] + dt * k3[3],
                a[4] + dt * k3[4], a[5] + dt * k3[5], a[6] + dt * k3[6], a[7] + dt * k3[7],
                fj, end[j], qj, wj, physics, i1, filter_, closed,
            )  # fmt: skip
            z0[j] = a[0] + sixth * (k1[0] + 2 * (k2[0] + k3[0]) + k4[0])
            z1[j] = a[1] + sixth * (k1[1] + 2 * (k2[1] + k3[1]) + k4[1])
            x[j] = a[2] + sixth * (k1[2] + 2 * (k2[2] + k3[2]) + k4[2])
            v[j] = a[3] + sixth * (k1[3] + 2 * (k2[3] + k3[3]) + k4[3])
            r0[j] = a[4] + sixth * (k1[4] + 2 * (k2[4] + k3[4]) + k4[4])
            r1[j] = a[5] + sixth * (k1[5] + 2 * (k2[5] + k3[5]) + k4[5])
            r2[j] = a[6] + sixth * (k1[6] + 2 * (k2[6] + k3[6]) + k4[6])
            r3[j] = a[7] + sixth * (k1[7] + 2 * (k2[7] + k3[7]) + k4[7])
    return out, unstable
