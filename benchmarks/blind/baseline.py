"""The best linear operator, of five parameters, fitted by least squares in simulation at 100 Hz."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.optimize import least_squares

RATE = 100  # Hz
SKIPPED = 500  # samples at the beginning of each run
STARTS = ((0.25, 10.0, 0.4), (0.12, 6.0, 0.7), (0.4, 15.0, 0.3))
BOUNDS = ((0.02, np.log(2.0), np.log(0.05)), (0.9, np.log(60.0), np.log(3.0)))


@njit(cache=True, nogil=True)
def _responses(errors: np.ndarray, tau: float, w: float, zeta: float, out: np.ndarray) -> None:
    """H_nm and s H_nm, tau later, for errors of shape (n_runs, n_samples)."""
    h = 0.5 / RATE
    below = 1 + 2 * zeta * w * h + (w * h) ** 2
    above = 1 - 2 * zeta * w * h - (w * h) ** 2
    whole = int(tau * RATE)
    part = tau * RATE - whole
    for i in range(errors.shape[0]):
        v = vd = before = 0.0
        for k in range(errors.shape[1]):
            now = 0.0
            if k > whole:
                now = errors[i, k - whole] * (1 - part) + errors[i, k - whole - 1] * part
            faster = (vd * above + h * w * w * (before + now - 2 * v)) / below
            v += h * (vd + faster)
            vd, before = faster, now
            out[0, i, k], out[1, i, k] = v, vd


class LinearOperator:
    """u = H_nm (K_e e + K_edot de/dt), tau seconds later.

    The gains are solved for; delay and neuromuscular filter are searched, from several starts.

    Parameters
    ----------
    delay : float or None
        The delay in s; None fits it.
    """

    def __init__(self, delay: float | None = None) -> None:
        self.delay = delay

    def fit(self, e: np.ndarray, u: np.ndarray) -> LinearOperator:
        """Fit; both of shape (n_runs, n_samples)."""
        e = np.ascontiguousarray(e)
        out = np.empty((2, *e.shape))
        target = u[:, SKIPPED:].ravel()
        scale = 1 / np.sqrt(np.sum(target**2))
        free = slice(0 if self.delay is None else 1, 3)

        def parts(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            full = np.array([self.delay or 0.0, 0.0, 0.0])
            full[free] = p
            _responses(e, full[0], np.exp(full[1]), np.exp(full[2]), out)
            z = out[:, :, SKIPPED:].reshape(2, -1)
            gains = np.linalg.lstsq(z @ z.T, z @ target, rcond=None)[0]
            return full, gains, (gains @ z - target) * scale

        low, high = (np.array(bound)[free] for bound in BOUNDS)
        best = None
        for tau, w, zeta in STARTS:
            start = np.array([tau, np.log(w), np.log(zeta)])[free]
            fit = least_squares(
                lambda p: parts(p)[2], start, bounds=(low, high), x_scale=0.2, diff_step=1e-4,
                xtol=1e-5, ftol=1e-7, max_nfev=40,
            )  # fmt: skip
            if best is None or fit.cost < best.cost:
                best = fit
        assert best is not None
        full, self.gains, _ = parts(best.x)
        self.tau, self.omega_nm, self.zeta_nm = full[0], np.exp(full[1]), np.exp(full[2])
        return self

    def predict(self, e: np.ndarray) -> np.ndarray:
        """Output for errors of shape (n_runs, n_samples)."""
        out = np.empty((2, *e.shape))
        _responses(np.ascontiguousarray(e), self.tau, self.omega_nm, self.zeta_nm, out)
        return np.tensordot(self.gains, out, 1)


def vaf(u: np.ndarray, predicted: np.ndarray) -> float:
    """Percent of the power of u, pooled over runs, without their first 5 s; not clipped.

    Parameters
    ----------
    u, predicted : ndarray of shape (n_runs, n_samples)

    Returns
    -------
    vaf : float
    """
    u, predicted = u[:, SKIPPED:], predicted[:, SKIPPED:]
    return float(100 * (1 - np.sum((u - predicted) ** 2) / np.sum(u**2)))
