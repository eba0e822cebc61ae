"""Operators fitted to many frequency responses at once, each with weights of its own."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from .operator_fitting import DYNAMICS, STARTS

LEAK = 0.01  # of abs(H), an error of any response by wavelets
MOST_STEPS = 60
SETTLED = 1e-10  # of the weighed squares, that a step may still save
GREATEST = 1e12  # damping, at which no step helps
UNUSUAL = 1e6  # times the squares, of starts with a negative gain
N_DATA = 2  # real numbers in a complex one


class ResponseFits(NamedTuple):
    """Values and standard errors, one row a response.

    Columns are K_e, K_edot, tau_e, omega_nm, zeta_nm, T_L; ``stuck`` says which of omega_nm,
    zeta_nm and tau_e are at a bound.
    """

    values: np.ndarray
    deviations: np.ndarray
    stuck: np.ndarray


def fit_responses(
    omega: np.ndarray,
    H: np.ndarray,
    sd: np.ndarray,
    dt: float,
    limits: Mapping[str, tuple[float, float]],
) -> ResponseFits:
    """Fit K_e, K_edot, tau_e, omega_nm and zeta_nm to responses (n, n_frequencies), NaN if unknown.

    Minimises the squares of (H - H_model) / sd by Levenberg-Marquardt, for all responses side by
    side; each starts from the best of a grid, and from what fits the mean of all, and keeps the
    better.
    """
    low, high = np.transpose(
        [[-np.inf, np.inf]] * 2
        + [np.log(limits["omega_nm"]), np.log(limits["zeta_nm"]), limits["tau_e"]]
    )
    known = np.isfinite(H)
    H = np.where(known, H, 0.0)
    spread = np.hypot(np.where(np.isfinite(sd), sd, 0.0), LEAK * abs(H))
    weight = np.where(known, np.sqrt(2.0) / np.maximum(spread, 1e-300), 0.0)
    problem = _Problem(omega, H, weight, dt, low, high)
    total = (weight**2).sum(axis=0)
    mean = (weight**2 * H).sum(axis=0) / np.maximum(total, 1e-300)
    together = _Problem(omega, mean[None], np.sqrt(total)[None], dt, low, high)
    general, _ = together.refined(together.best_of_grid())
    tries = [
        problem.refined(start) for start in (problem.best_of_grid(), np.tile(general, (len(H), 1)))
    ]
    first = tries[0][1] <= tries[1][1]
    p = np.where(first[:, None], tries[0][0], tries[1][0])
    return problem.finished(p)


class _Problem:
    """Weighed squares of many responses; parameters are K_e, K_edot, log omega, log zeta, tau."""

    def __init__(
        self,
        omega: np.ndarray,
        H: np.ndarray,
        weight: np.ndarray,
        dt: float,
        low: np.ndarray,
        high: np.ndarray,
    ) -> None:
        self.s, self.H, self.weight = 1j * omega, H, weight
        self.dt, self.low, self.high = dt, low, high

    def _filter(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Response to a gain of 1, with delay and hold, and derivatives of its log."""
        natural, zeta, tau = np.exp(p[:, 2:3]), np.exp(p[:, 3:4]), p[:, 4:5]
        damped, square = 2 * zeta * natural * self.s, natural**2
        below = self.s**2 + damped + square
        by_omega = 2 - (damped + 2 * square) / below
        return square / below * np.exp(-self.s * (tau + self.dt / 2)), by_omega, -damped / below

    def residuals(self, p: np.ndarray) -> np.ndarray:
        response = self._filter(p)[0] * (p[:, :1] + p[:, 1:2] * self.s)
        return _stacked(self.weight * (self.H - response))

    def slopes(self, p: np.ndarray) -> np.ndarray:
        """Derivatives of the weighed response, of shape (n, 2 n_frequencies, 5)."""
        unit, by_omega, by_zeta = self._filter(p)
        whole = unit * (p[:, :1] + p[:, 1:2] * self.s)
        columns = [unit, unit * self.s, whole * by_omega, whole * by_zeta, -self.s * whole]
        return np.stack([_stacked(self.weight * column) for column in columns], axis=-1)

    def best_of_grid(self) -> np.ndarray:
        """Parameters of each response from a grid of dynamics, with the best gains of each.

        Where they can be, gains are positive: a negative one with a filter to match it may be a
        minimum, too.
        """
        best = np.full(len(self.H), np.inf)
        found = np.zeros((len(self.H), 5))
        for omega, zeta, tau in product(*(STARTS[name] for name in DYNAMICS)):
            dynamics = np.clip([np.log(omega), np.log(zeta), tau], self.low[2:], self.high[2:])
            p = np.zeros((len(self.H), 5))
            p[:, 2:] = dynamics
            slopes, target = self.slopes(p)[:, :, :2], _stacked(self.weight * self.H)
            normal = np.einsum("nfi,nfj->nij", slopes, slopes)
            right = np.einsum("nfi,nf->ni", slopes, target)
            p[:, :2] = np.linalg.solve(_damped(normal, 1e-9), right[..., None])[..., 0]
            squares = (self.residuals(p) ** 2).sum(axis=1)
            squares[(p[:, :2] < 0).any(axis=1)] *= UNUSUAL
            better = squares < best
            best[better], found[better] = squares[better], p[better]
        return found

    def refined(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters at a minimum, and the weighed squares."""
        p = np.clip(p, self.low, self.high)
        residuals = self.residuals(p)
        squares = (residuals**2).sum(axis=1)
        damping = np.full(len(p), 1e-3)
        for _ in range(MOST_STEPS):
            normal, gradient = self._normal(p, residuals)
            step = np.linalg.solve(_damped(normal, damping), gradient[..., None])[..., 0]
            trial = np.clip(p + step, self.low, self.high)
            new = self.residuals(trial)
            least = (new**2).sum(axis=1)
            better = least < squares
            saved = np.where(better, squares - least, 0.0)
            p[better], residuals[better] = trial[better], new[better]
            squares = np.where(better, least, squares)
            damping = np.where(better, damping / 10, np.minimum(5 * damping, GREATEST))
            if not ((saved > SETTLED * squares) | (~better & (damping < GREATEST))).any():
                break
        return p, squares

    def _normal(self, p: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient, in which what is stuck at a bound does not move."""
        slopes = self.slopes(p)
        gradient = np.einsum("nfi,nf->ni", slopes, residuals)
        stuck = ((p <= self.low) & (gradient <= 0)) | ((p >= self.high) & (gradient >= 0))
        slopes = np.where(stuck[:, None, :], 0.0, slopes)
        normal = np.einsum("nfi,nfj->nij", slopes, slopes)
        rows, places = np.nonzero(stuck)
        normal[rows, places, places] = 1.0
        return normal, np.where(stuck, 0.0, gradient)

    def finished(self, p: np.ndarray) -> ResponseFits:
        """Values and standard errors; these grow with a misfit beyond what weights allow."""
        stuck = ((p <= self.low) | (p >= self.high))[:, 2:]
        residuals = self.residuals(p)
        normal, _ = self._normal(p, residuals)
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
        inverse = np.linalg.pinv(normal / (scale[:, :, None] * scale[:, None, :]), 1e-12, True)
        covariance = inverse / (scale[:, :, None] * scale[:, None, :])
        degrees = np.maximum(N_DATA * (self.weight > 0).sum(axis=1) - p.shape[1], 1)
        excess = np.maximum((residuals**2).sum(axis=1) / degrees, 1.0)
        covariance *= excess[:, None, None]
        sd = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
        sd[:, 2:][stuck] = np.nan
        natural, zeta = np.exp(p[:, 2]), np.exp(p[:, 3])
        with np.errstate(divide="ignore", invalid="ignore"):
            lead = p[:, 1] / p[:, 0]
            slope = np.stack([-lead, np.ones(len(p))], axis=1) / p[:, :1]
        of_lead = np.sqrt(
            np.maximum(np.einsum("ni,nij,nj->n", slope, covariance[:, :2, :2], slope), 0)
        )
        return ResponseFits(
            np.stack([p[:, 0], p[:, 1], p[:, 4], natural, zeta, lead], axis=1),
            np.stack(
                [sd[:, 0], sd[:, 1], sd[:, 4], natural * sd[:, 2], zeta * sd[:, 3], of_lead], 1
            ),
            stuck,
        )


def _damped(normal: np.ndarray, damping: np.ndarray | float) -> np.ndarray:
    """Normal matrices whose diagonals have grown by a factor 1 + damping."""
    out = normal.copy()
    diagonal = np.einsum("nii->ni", out)
    diagonal *= 1 + np.reshape(damping, (-1, 1))
    diagonal += 1e-300
    return out


def _stacked(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag], axis=-1)
