"""Standard errors, degrees of freedom and F tests of fixed effects in small samples.

Open it for the method of Kenward and Roger (1997): the covariance of the fixed effects is made
larger by what the estimated variances add, and t and F get the degrees of freedom that match.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from ._reml import At

LEAST_DF = 1.0


class FTest(NamedTuple):
    """An F test: the scaled statistic, its degrees of freedom and its p-value."""

    F: float
    df1: float
    df2: float
    p: float


class KenwardRoger:
    """Inference on the fixed effects of a fitted model.

    Parameters
    ----------
    at : At
        The model at its REML estimates.

    Attributes
    ----------
    covariance : ndarray
        Adjusted covariance of the fixed effects.
    variance_covariance : ndarray
        Covariance of the variances: the inverse of their expected information.
    """

    def __init__(self, at: At) -> None:
        self.beta = at.beta
        self._plain = at.covariance
        self.variance_covariance = np.linalg.pinv(at.gradient()[1], hermitian=True)
        self._slopes, products = _products(at)
        phi, w = self._plain, self.variance_covariance
        inner = np.zeros_like(phi)
        for i, one in enumerate(self._slopes):
            for j, other in enumerate(self._slopes):
                inner += w[i, j] * (products[i][j] - one @ phi @ other)
        self.covariance = phi + 2.0 * phi @ inner @ phi
        self.covariance = 0.5 * (self.covariance + self.covariance.T)

    def rows(self, L: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimate, standard error and degrees of freedom of each row of L β."""
        se = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", L, self.covariance, L), 0.0))
        df = np.array([2.0 / max(self._moments(row[None])[1], 1e-12) for row in L])
        return L @ self.beta, se, np.maximum(df, LEAST_DF)

    def test(self, L: np.ndarray) -> FTest:
        """The F test of L β = 0."""
        size = L.shape[0]
        found = L @ self.beta
        wald = float(found @ np.linalg.solve(L @ self.covariance @ L.T, found)) / size
        scale, df = self._matched(L)
        return FTest(scale * wald, float(size), df, float(stats.f.sf(scale * wald, size, df)))

    def _matched(self, L: np.ndarray) -> tuple[float, float]:
        """The factor of F, and the denominator's degrees of freedom, that match its moments."""
        size = L.shape[0]
        a1, a2 = self._moments(L)
        if size == 1 or a2 < 1e-10:
            return 1.0, max(2.0 * size / max(a2, 1e-12), LEAST_DF)
        b = (a1 + 6.0 * a2) / (2.0 * size)
        g = ((size + 1.0) * a1 - (size + 4.0) * a2) / ((size + 2.0) * a2)
        d = 3.0 * size + 2.0 * (1.0 - g)
        c1, c2, c3 = g / d, (size - g) / d, (size + 2.0 - g) / d
        mean = 1.0 / (1.0 - a2 / size)
        over = (1.0 - c2 * b) ** 2 * (1.0 - c3 * b)
        ratio = (1.0 + c1 * b) / over * (1.0 - a2 / size) ** 2 / size if over > 0.0 else 0.0
        if a2 < size and size * ratio > 1.0:
            df = 4.0 + (size + 2.0) / (size * ratio - 1.0)
            factor = df / (mean * (df - 2.0))
            if df > 2.0 and factor > 0.0:
                return float(factor), float(df)
        # Too few people to match the moments: the least that any row of L has.
        return 1.0, float(self.rows(L)[2].min())

    def _moments(self, L: np.ndarray) -> tuple[float, float]:
        """A1 and A2 of Kenward and Roger."""
        theta = L.T @ np.linalg.solve(L @ self._plain @ L.T, L)
        parts = [theta @ self._plain @ slope @ self._plain for slope in self._slopes]
        traces = np.array([np.trace(part) for part in parts])
        pairs = np.array([[np.sum(one * other.T) for other in parts] for one in parts])
        w = self.variance_covariance
        return float(traces @ w @ traces), float(np.sum(w * pairs))


def _products(at: At) -> tuple[list[np.ndarray], list[list[np.ndarray]]]:
    """-X'V⁻¹GᵢV⁻¹X, and X'V⁻¹GᵢV⁻¹GⱼV⁻¹X; the last G is that of the rows."""
    v, k = at.variances, len(at.parts)
    information = np.linalg.inv(at.covariance)
    spread = at.spread()
    # V V⁻¹ = 1 gives Z'V⁻²X, X'V⁻²X and X'V⁻³X.
    once = (at.zvx - at.zvz @ (spread[:, None] * at.zvx)) / v[k]
    square = (information - at.zvx.T @ (spread[:, None] * at.zvx)) / v[k]
    cube = (square - at.zvx.T @ (spread[:, None] * once)) / v[k]
    slopes = [-at.zvx[part].T @ at.zvx[part] for part in at.parts] + [-square]
    products = [[square] * (k + 1) for _ in range(k + 1)]
    for i, one in enumerate(at.parts):
        for j, other in enumerate(at.parts):
            products[i][j] = at.zvx[one].T @ at.zvz[one, other] @ at.zvx[other]
        products[i][k] = at.zvx[one].T @ once[one]
        products[k][i] = products[i][k].T
    products[k][k] = cube
    return slopes, products
