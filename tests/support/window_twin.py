"""The model of the windowed fit once more, plainly: exact matrices, one row after the other."""

import numpy as np
from scipy.linalg import expm


def keys(x):
    """Keys's cubic convolution kernel, a = -1/2."""
    x = abs(x)
    near = 1.5 * x**3 - 2.5 * x**2 + 1
    far = -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2
    return np.where(x < 1, near, np.where(x < 2, far, 0.0))


def delayed(e, rows, delay):
    """Signal ``delay`` samples before the rows; the first and last value hold outside."""
    at = np.asarray(rows) - delay
    near = np.floor(at).astype(int)[:, None] + np.arange(-1, 3)
    return (e[near.clip(0, e.size - 1)] * keys(near - at[:, None])).sum(axis=1)


def held_matrices(omega, zeta, dt):
    """phi and gamma of y' = -2 zeta omega y + v + omega^2 r, v' = omega^2 (p - y), held inputs."""
    M = np.zeros((4, 4))
    M[:2, :2] = [[-2 * zeta * omega, 1.0], [-(omega**2), 0.0]]
    M[:2, 2:] = omega**2 * np.array([[0.0, 1.0], [1.0, 0.0]])
    whole = expm(M * dt)
    return whole[:2, :2], whole[:2, 2:]


def output(e, first, last, dt, K_e, K_edot, omega, zeta, tau, state=(0.0, 0.0)):
    """Output at rows ``first`` to ``last`` - 1; parameters but tau may be arrays over these rows.

    Gains are those that act on the delayed error at a row.
    """
    n = last - first
    into = delayed(e, np.arange(first, last), tau / dt)
    position, rate = np.broadcast_to(K_e, n) * into, np.broadcast_to(K_edot, n) * into
    omega, zeta = np.broadcast_to(omega, n), np.broadcast_to(zeta, n)
    (y, v), out = state, []
    known = None
    for k, (p, r) in enumerate(zip(position.tolist(), rate.tolist(), strict=True)):
        if known != (omega[k], zeta[k]):
            known = (omega[k], zeta[k])
            ((a, b), (c, d)), ((f, g), (h, i)) = (m.tolist() for m in held_matrices(*known, dt))
        out.append(y)
        y, v = a * y + b * v + f * p + g * r, c * y + d * v + h * p + i * r
    return np.array(out)


def prediction_errors(residual, ar, valid):
    """A(q) residual at the rows that count."""
    return residual[valid] + residual[valid[:, None] - 1 - np.arange(ar.size)] @ ar
