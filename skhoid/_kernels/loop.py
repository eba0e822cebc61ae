"""The closed loop, sample by sample, for several runs at once.

Runs lie side by side in one buffer, ``MANY`` lanes to each quantity, so that the loops over them
become vector instructions. A lane gives the same bits alone and beside others.

A row of ``physics`` holds 2 zeta omega_nm; omega_nm^2; the gains times omega_nm^2 on f_t, on its
rate, on x and on its rate; K_c; omega_b; K_n. Rows are half a step apart, as Runge-Kutta needs
the middle of the step, from sample ``begin`` on; the first and the last hold before and after.
``remnant`` holds the coefficients of the remnant filter, see ``_rates``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from .kernel import OPTIONS, kernel

N_PHYSICS = 9
MANY = 8  # lanes


@kernel("npy_rng, f8, f8[:,::1], i8", 1)
def draw(generator, scale, white, run):
    """Fill a column of ``white`` with normal numbers times ``scale``.

    They are those of ``generator.standard_normal(n)``, in less than half the time.
    """
    for k in range(white.shape[0]):
        white[k, run] = generator.standard_normal() * scale


@njit(**OPTIONS, forceinline=True)
def _remnant(r0, r1, r2, r3, q, third):
    n = q[6] * r0 + q[7] * r1
    return n + q[8] * r2 + q[9] * r3 if third else n


@njit(**OPTIONS, forceinline=True)
def _rates(z0, z1, x, v, r0, r1, r2, r3, f_t, d, f_d, w, p, q, closed, third):
    """Time derivatives of operator (z), controlled element (x, v) and remnant filter (r)."""
    n = _remnant(r0, r1, r2, r3, q, third)
    rate = z1 + p[3] * f_t + p[5] * x
    return (
        rate,
        p[2] * f_t + p[4] * x - p[1] * z0 - p[0] * rate,
        v,
        p[6] * (d + closed * n + f_d) - p[7] * v,
        q[0] * r0 + q[1] * r1 + q[2] * p[8] * w,
        q[3] * r0 + q[4] * r1,
        q[5] * (r1 - r2),
        q[5] * (r2 - r3),
    )


@njit(**OPTIONS, forceinline=True)
def _row(p, i):
    return (p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5], p[i, 6], p[i, 7], p[i, 8])


@cache
def tracker(third):
    """Compile ``track`` for a remnant filter with a ``third`` state or none.

    Without, the third and fourth state are not computed, in half the time.
    """
    THIRD, lanes = third, MANY
    Z0, Z1, X, V, R0, R1, R2, R3 = range(0, 8 * lanes, lanes)
    F_T, F_D, W, BEGIN, MIDDLE, END = range(8 * lanes, 14 * lanes, lanes)

    def track(
        f_t,
        f_d,
        white,
        physics,
        begin,
        remnant,
        delay,
        weights,
        arx,
        na,
        nk,
        dt,
        closed,
        first,
        bound,
    ):
        """Simulate runs of a tracking task from rest by fourth-order Runge-Kutta.

        f_t, f_d and white noise, of shape (n_samples, 1 or n_runs), are held over the step. The
        operator's output is its own state ``delay`` samples ago, combined by ``weights`` (for the
        beginning, middle and end of the step) from the samples before, at and after it. Where
        ``arx`` (a_1 ... b_0 ...) is not empty it is the ARX response to e instead, held over the
        step. With ``closed`` = 0 the remnant is added to u but does
        not reach the controlled element.

        Returns e, u, x, n of shape (4, n_samples - first, n_runs), and for each run about where its
        error exceeded ``bound``, or -1.
        """
        n_samples, n_runs = white.shape
        out = np.empty((4, n_samples - first, n_runs))
        lost = np.full(n_runs, -1)
        s = np.zeros(14 * lanes)
        is_arx = arx.size > 0
        nb = arx.size - na
        length = max(na, nk + nb) + 1 if is_arx else delay + 3
        responses = np.zeros((length, lanes))  # rings
        errors = np.zeros((length, lanes))
        last = physics.shape[0] - 1
        own_t, own_d = int(f_t.shape[1] > 1), int(f_d.shape[1] > 1)
        q = remnant  # as scalars, which no store to another array can change
        q = (q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], q[8], q[9])
        half, sixth = dt / 2, dt / 6
        for k in range(n_samples):
            now = k % length
            for j in range(n_runs):
                s[F_T + j] = f_t[k, j * own_t]
                s[F_D + j] = f_d[k, j * own_d]
                s[W + j] = white[k, j]
            if is_arx:
                for j in range(lanes):
                    errors[now, j] = s[F_T + j] - s[X + j]
                    s[BEGIN + j] = 0.0
                for i in range(na):
                    past = (k - 1 - i) % length
                    for j in range(lanes):
                        s[BEGIN + j] -= arx[i] * responses[past, j]
                for i in range(nb):
                    past = (k - nk - i) % length
                    for j in range(lanes):
                        s[BEGIN + j] += arx[na + i] * errors[past, j]
                for j in range(lanes):
                    responses[now, j] = s[BEGIN + j]
                    s[MIDDLE + j] = s[BEGIN + j]
                    s[END + j] = s[BEGIN + j]
            else:
                for j in range(lanes):
                    responses[now, j] = s[Z0 + j]
                before = (k - delay - 1) % length
                at = (k - delay) % length
                after = (k - delay + 1) % length
                for j in range(lanes):
                    d0, d1, d2 = responses[before, j], responses[at, j], responses[after, j]
                    s[BEGIN + j] = weights[0, 0] * d0 + weights[0, 1] * d1 + weights[0, 2] * d2
                    s[MIDDLE + j] = weights[1, 0] * d0 + weights[1, 1] * d1 + weights[1, 2] * d2
                    s[END + j] = weights[2, 0] * d0 + weights[2, 1] * d1 + weights[2, 2] * d2
            if k >= first:
                for j in range(n_runs):
                    n = _remnant(s[R0 + j], s[R1 + j], s[R2 + j], s[R3 + j], q, THIRD)
                    out[0, k - first, j] = s[F_T + j] - s[X + j]
                    out[1, k - first, j] = s[BEGIN + j] + n
                    out[2, k - first, j] = s[X + j]
                    out[3, k - first, j] = n
            if k % 64 == 0 or k == n_samples - 1:
                for j in range(n_runs):
                    if lost[j] < 0 and not abs(s[F_T + j] - s[X + j]) <= bound:
                        lost[j] = k
            i = 2 * (k - begin)
            p0 = _row(physics, min(max(i, 0), last))
            pm = _row(physics, min(max(i + 1, 0), last))
            p1 = _row(physics, min(max(i + 2, 0), last))
            for j in range(lanes):
                z0, z1, x, v = s[Z0 + j], s[Z1 + j], s[X + j], s[V + j]
                r0, r1, r2, r3 = s[R0 + j], s[R1 + j], s[R2 + j], s[R3 + j]
                f, fd, w, dm = s[F_T + j], s[F_D + j], s[W + j], s[MIDDLE + j]
                k1 = _rates(
                    z0, z1, x, v, r0, r1, r2, r3, f, s[BEGIN + j], fd, w, p0, q, closed, THIRD
                )
                k2 = _rates(
                    z0 + half * k1[0], z1 + half * k1[1], x + half * k1[2], v + half * k1[3],
                    r0 + half * k1[4], r1 + half * k1[5], r2 + half * k1[6], r3 + half * k1[7],
                    f, dm, fd, w, pm, q, closed, THIRD,
                )  # fmt: skip
                k3 = _rates(
                    z0 + half * k2[0], z1 + half * k2[1], x + half * k2[2], v + half * k2[3],
                    r0 + half * k2[4], r1 + half * k2[5], r2 + half * k2[6], r3 + half * k2[7],
                    f, dm, fd, w, pm, q, closed, THIRD,
                )  # fmt: skip
                k4 = _rates(
                    z0 + dt * k3[0], z1 + dt * k3[1], x + dt * k3[2], v + dt * k3[3],
                    r0 + dt * k3[4], r1 + dt * k3[5], r2 + dt * k3[6], r3 + dt * k3[7],
                    f, s[END + j], fd, w, p1, q, closed, THIRD,
                )  # fmt: skip
                s[Z0 + j] = z0 + sixth * (k1[0] + 2 * (k2[0] + k3[0]) + k4[0])
                s[Z1 + j] = z1 + sixth * (k1[1] + 2 * (k2[1] + k3[1]) + k4[1])
                s[X + j] = x + sixth * (k1[2] + 2 * (k2[2] + k3[2]) + k4[2])
                s[V + j] = v + sixth * (k1[3] + 2 * (k2[3] + k3[3]) + k4[3])
                s[R0 + j] = r0 + sixth * (k1[4] + 2 * (k2[4] + k3[4]) + k4[4])
                s[R1 + j] = r1 + sixth * (k1[5] + 2 * (k2[5] + k3[5]) + k4[5])
                if THIRD:
                    s[R2 + j] = r2 + sixth * (k1[6] + 2 * (k2[6] + k3[6]) + k4[6])
                    s[R3 + j] = r3 + sixth * (k1[7] + 2 * (k2[7] + k3[7]) + k4[7])
        return out, lost

    # Cached functions of one name from different processes would be mistaken for each other.
    track.__name__ = track.__qualname__ = f"track_{4 if third else 2}"
    return kernel(
        "f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], i8, f8[::1], i8, f8[:,::1], f8[::1], i8, i8, "
        "f8, f8, i8, f8",
        2,
    )(track)


for _third in (False, True):
    tracker(_third)
