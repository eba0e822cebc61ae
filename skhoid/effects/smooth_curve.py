"""Smooth curves of one variable by their values at knots, in a basis of known roughness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

LEVEL, SLOPE = 0, 1  # degrees of the polynomials that have no roughness


@dataclass(frozen=True)
class SmoothCurve:
    """Natural cubic splines with given knots, linear beyond the outermost.

    Demmler and Reinsch's basis: the level and the slope, if they are in ``kept``, and then ever
    rougher curves, orthogonal at the knots and of mean square one there. Where knots are quantiles
    of a signal, that is the mean square over the signal. Curves whose coefficients have variances
    proportional to 1 / roughness are as likely as penalised splines make them, whose penalty is the
    integral of the squared second derivative.

    Parameters
    ----------
    knots : tuple of float
        At least four, rising.
    kept : tuple of int
        Which of LEVEL and SLOPE belong to the curves; what a model has already does not.

    References
    ----------
    Demmler and Reinsch, Oscillation matrices with spline smoothing (1975). Wood, Generalized
    additive models (2017), section 5.3.
    """

    knots: tuple[float, ...]
    kept: tuple[int, ...] = (LEVEL, SLOPE)

    @property
    def _found(self) -> tuple[np.ndarray, np.ndarray]:
        return _basis_of(self.knots, self.kept)

    @property
    def basis(self) -> np.ndarray:
        """Values at the knots of each curve of the basis, of shape (n_knots, n_coefficients)."""
        return self._found[0]

    @property
    def roughness(self) -> np.ndarray:
        """Of each curve of the basis, relative to the smoothest one that is not a line."""
        return self._found[1]

    def __call__(self, values: np.ndarray, at: np.ndarray) -> np.ndarray:
        """A curve, or several as columns, with ``values`` at the knots, at any points."""
        spline = CubicSpline(np.asarray(self.knots), values, bc_type="natural")
        low, high = self.knots[0], self.knots[-1]
        inside = np.clip(at, low, high)
        found = spline(inside)
        beyond = at - inside
        if beyond.any():
            slopes = spline([low, high], 1)
            tail = (...,) + (None,) * (np.ndim(values) - 1)
            found = found + np.where((at < low)[tail], slopes[0], slopes[1]) * beyond[tail]
        return np.asarray(found)


@lru_cache(maxsize=64)
def _basis_of(knots: tuple[float, ...], kept: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Values at the knots of each curve of the basis, and their roughness."""
    points = np.asarray(knots)
    span = points[-1] - points[0]
    at = (points - points.mean()) / span
    bends = CubicSpline(at, np.eye(at.size), bc_type="natural")(at, 2)
    widths = np.diff(at)
    mass = np.diag(np.r_[widths, 0.0] + np.r_[0.0, widths]) / 3
    mass += (np.diag(widths, 1) + np.diag(widths, -1)) / 6
    roughness, basis = eigh(bends.T @ mass @ bends, np.eye(at.size) / at.size)
    flat = [np.ones(at.size), at / np.sqrt(np.mean(at**2))]
    columns = [flat[degree] for degree in kept] + list(basis.T[2:])
    relative = roughness[2:] / roughness[2]
    return np.stack(columns, axis=1), np.r_[np.zeros(len(kept)), relative]
