"""A weighted linear mixed model with one random effect: REML, and tests by Kenward and Roger.

y = X β + b[group] + ε, Var(b) = σ_b², Var(ε_i) = σ² / w_i. No package at hand has these degrees of
freedom; statsmodels, to whose likelihood the tests hold this, has no weights either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

LEAST_DF = 1.0
# Ratios σ_b² / σ² among which the minimum is looked for before it is located exactly.
FLAT = 1e-6  # of the criterion
RATIOS = np.concatenate([[0.0], np.logspace(-8, 8, 65)])


class FTest(NamedTuple):
    """An F test: the scaled statistic, its degrees of freedom and its p-value."""

    F: float
    df1: float
    df2: float
    p: float


class _Sums:
    """Sums over all rows and over each group, of which everything is made; w scales the rows."""

    def __init__(
        self, y: np.ndarray, X: np.ndarray, group: np.ndarray | None, w: np.ndarray
    ) -> None:
        root = np.sqrt(w)
        self.X, self.n = root[:, None] * X, y.size
        if np.linalg.matrix_rank(self.X) < X.shape[1] or y.size <= X.shape[1]:
            raise ValueError(
                f"{y.size} rows do not determine {X.shape[1]} fixed effects and a variance."
            )
        self.ordinary = np.linalg.lstsq(self.X, root * y, rcond=None)[0]
        self.y = root * (y - X @ self.ordinary)  # the rest of least squares: no digits are lost
        scale = max(1.0, float(np.sum(self.ordinary**2)))
        if self.y @ self.y <= 1e-20 * scale * self.n:
            raise ValueError("The rows do not scatter at all: there is no variance to estimate.")
        n_groups = 0 if group is None else int(group.max()) + 1
        self.Z = np.zeros((self.n, n_groups))
        if group is not None:
            self.Z[np.arange(self.n), group] = root
        self.zz, self.zx, self.zy = np.sum(self.Z**2, axis=0), self.Z.T @ self.X, self.Z.T @ self.y

    def at(self, ratio: float) -> tuple[float, float, float, np.ndarray, np.ndarray]:
        """-2 log of the restricted likelihood but for constants, and its slope, at σ_b² / σ².

        Also σ², β beyond least squares, and the information X'V⁻¹X σ². By Woodbury, V⁻¹ σ² = 1 -
        Z k Z' with k = ratio / (1 + ratio Z'Z).
        """
        k = ratio / (1.0 + ratio * self.zz)
        information = self.X.T @ self.X - self.zx.T @ (k[:, None] * self.zx)
        beta = np.linalg.solve(information, self.X.T @ self.y - self.zx.T @ (k * self.zy))
        rest = self.zy - self.zx @ beta
        residual = self.y - self.X @ beta
        df = self.n - beta.size
        left = float(residual @ residual - k @ rest**2)
        value = (
            np.log1p(ratio * self.zz).sum()
            + np.linalg.slogdet(information)[1]
            + df * np.log(left / df)
        )
        change = 1.0 / (1.0 + ratio * self.zz) ** 2  # of k
        spread = np.einsum("gi,ij,gj->g", self.zx, np.linalg.inv(information), self.zx)
        slope = np.sum(self.zz / (1.0 + ratio * self.zz) - change * spread)
        slope -= df * float(change @ rest**2) / left
        return float(value), float(slope), left / df, beta, information

    def best_ratio(self) -> float:
        """The ratio of highest likelihood; 0 where the likelihood rises towards it."""
        if not self.Z.size:
            return 0.0
        values = np.array([self.at(ratio)[0] for ratio in RATIOS])
        if np.ptp(values) < FLAT:  # three cells do not tell two variances apart
            return 1.0
        best = int(values.argmin())
        low, high = RATIOS[max(best - 1, 0)], RATIOS[min(best + 1, RATIOS.size - 1)]
        slopes = [self.at(ratio)[1] for ratio in (low, high)]
        if slopes[0] >= 0.0 or slopes[1] <= 0.0:  # at an end of what is looked at
            return float(low if slopes[0] >= 0.0 else high)
        return float(optimize.brentq(lambda r: self.at(r)[1], low, high, xtol=1e-14, rtol=1e-13))


@dataclass(frozen=True, eq=False)
class MixedFit:
    """The model at its REML estimates.

    ``variances`` are σ_b² (if there are groups) and σ², ``variance_covariance`` theirs: the inverse
    of their expected information. ``criterion`` is -2 log of the restricted likelihood, as lme4 has
    it. ``plain`` is (X'V⁻¹X)⁻¹, ``covariance`` that of the fixed effects as Kenward and Roger
    adjust it: larger by what the estimated variances add. ``effects`` are those of the groups
    (BLUP), ``effect_covariance`` that of their errors, and ``cross_covariance`` that with the fixed
    effects.
    """

    beta: np.ndarray
    variances: np.ndarray
    variance_covariance: np.ndarray
    criterion: float
    plain: np.ndarray
    covariance: np.ndarray
    effects: np.ndarray
    effect_covariance: np.ndarray
    cross_covariance: np.ndarray
    slopes: tuple[np.ndarray, ...]

    def estimate(self, L: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimate, standard error and degrees of freedom of each row of L β."""
        se = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", L, self.covariance, L), 0.0))
        df = np.array([2.0 / max(self._moments(row[None])[1], 1e-12) for row in L])
        return L @ self.beta, se, np.maximum(df, LEAST_DF)

    def test(self, L: np.ndarray) -> FTest:
        """The F test of L β = 0."""
        size = L.shape[0]
        found = L @ self.beta
        wald = float(found @ np.linalg.solve(L @ self.covariance @ L.T, found)) / size
        scale, df = self._match(L)
        return FTest(scale * wald, float(size), df, float(stats.f.sf(scale * wald, size, df)))

    def _match(self, L: np.ndarray) -> tuple[float, float]:
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
        return 1.0, float(self.estimate(L)[2].min())

    def _moments(self, L: np.ndarray) -> tuple[float, float]:
        """A1 and A2 of Kenward and Roger."""
        theta = L.T @ np.linalg.solve(L @ self.plain @ L.T, L)
        parts = [theta @ self.plain @ slope @ self.plain for slope in self.slopes]
        traces = np.array([np.trace(part) for part in parts])
        pairs = np.array([[np.sum(one * other.T) for other in parts] for one in parts])
        w = self.variance_covariance
        return float(traces @ w @ traces), float(np.sum(w * pairs))


def fit_reml(y: np.ndarray, X: np.ndarray, group: np.ndarray | None, w: np.ndarray) -> MixedFit:
    """Fit the model; ``group`` numbers groups from 0, and None means no random effect.

    A variance that would be below 0 is 0. A ValueError says if the rows do not determine the fixed
    effects and a variance, or do not scatter.
    """
    sums = _Sums(y, X, group, w)
    ratio = sums.best_ratio()
    value, _, residual, change, information = sums.at(ratio)
    df = sums.n - change.size
    criterion = value + df * (1.0 + np.log(2.0 * np.pi)) - np.log(w).sum()
    plain = residual * np.linalg.inv(information)
    # In the dimension of the rows, from here on: V = σ_b² ZZ' + σ², and P of the residuals.
    k = ratio / (1.0 + ratio * sums.zz)
    inverse = (np.eye(sums.n) - sums.Z @ (k[:, None] * sums.Z.T)) / residual
    A = inverse @ sums.X
    P = inverse - A @ plain @ A.T
    PZ = P @ sums.Z
    has = bool(sums.Z.size)
    G_A = [sums.Z @ (sums.Z.T @ A)] * has + [A]
    traces = np.array(
        [[np.sum((sums.Z.T @ PZ) ** 2), np.sum(PZ**2)], [np.sum(PZ**2), np.sum(P**2)]]
    )
    of_variances = np.linalg.pinv(0.5 * traces[1 - has :, 1 - has :], hermitian=True)
    slopes = tuple(-A.T @ g for g in G_A)
    inner = sum(
        of_variances[i, j] * (G_A[i].T @ inverse @ G_A[j] - slopes[i] @ plain @ slopes[j])
        for i in range(len(G_A))
        for j in range(len(G_A))
    )
    covariance = plain + 2.0 * plain @ inner @ plain
    between = ratio * residual
    return MixedFit(
        beta=sums.ordinary + change,
        variances=np.array([between] * has + [residual]),
        variance_covariance=of_variances,
        criterion=float(criterion),
        plain=plain,
        covariance=0.5 * (covariance + covariance.T),
        effects=between * (PZ.T @ sums.y),
        effect_covariance=between * np.eye(sums.zz.size) - between**2 * (sums.Z.T @ PZ),
        cross_covariance=-plain @ (between * (sums.Z.T @ A)).T,
        slopes=slopes,
    )
