"""The operator fitted to frequency responses: one residual with weights, and one minimiser.

Paths of ARX models and responses that wavelets estimate are fitted here, thousands side by side:
SciPy's ``least_squares``, one at a time, took 2 to 4 times as long along paths, for the same minima
to 1e-7.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

MOST_STEPS = 60
SETTLED = 1e-10  # of the weighed squares, that a step may still save
EXACT = 1e-28  # of the weighed squares of the response, below which nothing is left to save
GREATEST = 1e12  # damping, at which no step helps
UNUSUAL = 1e6  # times the squares, of starts with a negative gain


class ResponseModel(Protocol):
    """Responses (n, n_frequencies) for p of shape (n, 5): K_e, K_edot, log omega, log zeta, tau."""

    def gains(self, p: np.ndarray) -> np.ndarray:
        """Responses to which K_e and K_edot are the gains, of shape (n, n_frequencies, 2)."""

    def slopes(self, p: np.ndarray) -> np.ndarray:
        """Derivatives of the response to p, of shape (n, n_frequencies, 5); gains come first."""


class ResponseFit:
    """Weighed squares of what models leave of responses H (n, n_frequencies), and their minima."""

    def __init__(
        self,
        model: ResponseModel,
        H: np.ndarray,
        weight: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
    ) -> None:
        self.model, self.H, self.weight = model, H, weight
        self.low, self.high = low, high

    def look(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighed residuals (n, 2 n_frequencies) and slopes: real parts, then imaginary ones."""
        slopes = self.model.slopes(p)
        response = slopes[..., 0] * p[:, :1] + slopes[..., 1] * p[:, 1:2]
        slopes *= self.weight[..., None]
        return stack_parts(self.weight * (self.H - response)), stack_parts(slopes, axis=1)

    def starts(
        self, dynamics: Iterable[np.ndarray], n_best: int = 1, *, positive: bool = False
    ) -> list[np.ndarray]:
        """The best of some (log omega, log zeta, tau) for each response, with their best gains.

        ``positive`` prefers gains that are: a negative one with a filter to match it may be a
        minimum, too.
        """
        tried, squares = [], []
        target = stack_parts(self.weight * self.H)
        for point in dynamics:
            p = np.zeros((len(self.H), 5))
            p[:, 2:] = np.clip(point, self.low[2:], self.high[2:])
            slopes = stack_parts(self.weight[..., None] * self.model.gains(p[:1]), axis=1)
            normal = np.einsum("nfi,nfj->nij", slopes, slopes)
            right = np.einsum("nfi,nf->ni", slopes, target)
            p[:, :2] = np.linalg.solve(_damp(normal, 1e-9), right[..., None])[..., 0]
            left = ((target - np.einsum("nfi,ni->nf", slopes, p[:, :2])) ** 2).sum(axis=1)
            if positive:
                left[(p[:, :2] < 0).any(axis=1)] *= UNUSUAL
            tried.append(p)
            squares.append(left)
        order = np.argsort(squares, axis=0, kind="stable")[:n_best]
        return [np.stack(tried)[best, np.arange(len(self.H))] for best in order]

    def refined(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters at a minimum, by Levenberg-Marquardt with bounds, and the weighed squares."""
        p = np.clip(p, self.low, self.high)
        residuals, slopes = self.look(p)
        squares = (residuals**2).sum(axis=1)
        least = EXACT * (self.weight**2 * np.abs(self.H) ** 2).sum(axis=1)
        damping = np.full(len(p), 1e-3)
        going = np.ones(len(p), dtype=bool)
        for _ in range(MOST_STEPS):
            some = self.of(going)
            normal, gradient = some.normal_equations(p[going], residuals[going], slopes[going])
            step = np.linalg.solve(_damp(normal, damping[going]), gradient[..., None])[..., 0]
            trial = np.clip(p[going] + step, self.low, self.high)
            new, new_slopes = some.look(trial)
            left = (new**2).sum(axis=1)
            before = squares[going]
            better = left < before
            at = np.flatnonzero(going)
            p[at[better]], residuals[at[better]] = trial[better], new[better]
            slopes[at[better]] = new_slopes[better]
            squares[at[better]] = left[better]
            damping[at] = np.where(better, damping[at] / 10, np.minimum(5 * damping[at], GREATEST))
            saved = np.where(better, before - left, 0.0)
            unsettled = (saved > SETTLED * squares[at]) | (~better & (damping[at] < GREATEST))
            going[at] = unsettled & (squares[at] > least[at])
            if not going.any():
                break
        return p, squares

    def find_best_minima(self, starts: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """The best minimum of each response from several starts; of equals the first."""
        p, squares = zip(*(self.refined(start) for start in starts), strict=True)
        best = np.argmin(squares, axis=0)
        rows = np.arange(len(self.H))
        return np.stack(p)[best, rows], np.stack(squares)[best, rows]

    def of(self, rows: np.ndarray) -> ResponseFit:
        """The same for some of the responses."""
        return ResponseFit(self.model, self.H[rows], self.weight[rows], self.low, self.high)

    def normal_equations(
        self, p: np.ndarray, residuals: np.ndarray, slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient, in which what is stuck at a bound does not move."""
        gradient = (residuals[:, None] @ slopes)[:, 0]
        stuck = ((p <= self.low) & (gradient <= 0)) | ((p >= self.high) & (gradient >= 0))
        normal = np.swapaxes(slopes, 1, 2) @ slopes
        rows, places = np.nonzero(stuck)
        normal[rows, places] = normal[rows, :, places] = 0.0
        normal[rows, places, places] = 1.0
        return normal, np.where(stuck, 0.0, gradient)


def stack_parts(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Real parts, then imaginary ones."""
    return np.concatenate([values.real, values.imag], axis=axis)


def _damp(normal: np.ndarray, damping: np.ndarray | float) -> np.ndarray:
    """Normal matrices whose diagonals have grown by a factor 1 + damping."""
    out = normal.copy()
    diagonal = np.einsum("nii->ni", out)
    diagonal *= 1 + np.reshape(damping, (-1, 1))
    diagonal += 1e-300
    return out
