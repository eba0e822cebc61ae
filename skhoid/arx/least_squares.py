"""Least squares by QR factorisation, with rank and covariance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf, dgeqrf_lwork, dtpqrt

PANEL = 8  # columns that dtpqrt reduces at a time; the fastest of 4 to 32


@dataclass(frozen=True)
class Triangle:
    """R of a QR factorisation of regressors with the output as last column."""

    R: np.ndarray
    n_rows: int

    @classmethod
    def of(cls, table: np.ndarray) -> Triangle:
        """Factorise a table of regressors and output, which is overwritten; Q is not formed."""
        lwork = int(dgeqrf_lwork(*table.shape)[0])
        factored, _, _, _ = dgeqrf(table, lwork=lwork, overwrite_a=True)
        n = table.shape[1]
        return cls(np.triu(factored[:n]), table.shape[0])

    @classmethod
    def of_blocks(cls, blocks: Iterable[np.ndarray], n_columns: int) -> Triangle:
        """Factorise a table that comes in blocks of rows, which are overwritten."""
        R, n_rows = np.zeros((n_columns, n_columns), order="F"), 0
        for block in blocks:
            if len(block):
                R = _absorbed(R, block, 0)
                n_rows += len(block)
        return cls(R, n_rows)

    def merged(self, other: Triangle) -> Triangle:
        """The triangle of the rows of both."""
        R = np.array(self.R, order="F")
        below = np.array(other.R, order="F")
        return Triangle(_absorbed(R, below, len(below)), self.n_rows + other.n_rows)

    def subset(self, columns: list[int]) -> Triangle:
        """Factorise some of the regressors, and the output, from R alone."""
        chosen = self.R[:, [*columns, self.R.shape[1] - 1]]
        factored, _, _, _ = dgeqrf(chosen)
        return Triangle(np.triu(factored[: chosen.shape[1]]), self.n_rows)

    @property
    def scale(self) -> np.ndarray:
        """Euclidean norm of each regressor."""
        return np.sqrt(np.sum(self.R[:, :-1] ** 2, axis=0))

    def null_space(self) -> np.ndarray:
        """Scaled combinations of regressors that vanish; no rows for full rank."""
        p = self.R.shape[1] - 1
        scale = self.scale
        safe = np.where(scale > 0, scale, 1.0)
        if p == 0:
            return np.empty((0, 0))
        _, sizes, Vt = np.linalg.svd(self.R[:p, :p] / safe)
        tolerance = sizes[0] * max(self.n_rows, p) * np.finfo(float).eps
        return Vt[sizes <= tolerance]

    def solve(self) -> np.ndarray:
        p = self.R.shape[1] - 1
        return solve_triangular(self.R[:p, :p], self.R[:p, p], check_finite=False)

    @property
    def rss(self) -> float:
        """Residual sum of squares."""
        p = self.R.shape[1] - 1
        return float(self.R[p, p] ** 2) if self.R.shape[0] > p else 0.0

    def inverse_information(self) -> np.ndarray:
        """(Phi' Phi)^-1."""
        p = self.R.shape[1] - 1
        inverse = solve_triangular(self.R[:p, :p], np.eye(p), check_finite=False)
        return inverse @ inverse.T


def _absorbed(R: np.ndarray, below: np.ndarray, triangular: int) -> np.ndarray:
    """R of the rows of R and those below it, of which the last ``triangular`` are a triangle."""
    return dtpqrt(triangular, min(PANEL, len(R)), R, below, overwrite_a=True, overwrite_b=True)[0]


def solutions(triangles: list[Triangle], columns: list[int]) -> np.ndarray:
    """Least squares of some of the regressors in each triangle; NaN where they are dependent."""
    p = len(columns)
    chosen = np.stack([triangle.R[:, [*columns, -1]] for triangle in triangles])
    R = np.asarray(np.linalg.qr(chosen, mode="r"))
    scale = np.sqrt(np.sum(R[:, :p, :p] ** 2, axis=1, keepdims=True))
    sizes = np.linalg.svd(R[:, :p, :p] / np.where(scale > 0, scale, 1.0), compute_uv=False)
    n_rows = np.array([triangle.n_rows for triangle in triangles])
    tolerance = sizes[:, 0] * np.maximum(n_rows, p) * np.finfo(float).eps
    known = sizes[:, -1] > tolerance
    found = np.full((len(triangles), p), np.nan)
    found[known] = np.linalg.solve(R[known, :p, :p], R[known, :p, p:])[..., 0]
    return found


def newey_west(
    scores: np.ndarray, rows: np.ndarray, begin: np.ndarray, n_lags: int | None = None
) -> np.ndarray:
    """Long-run covariance of regression scores with Bartlett weights.

    ``scores`` are phi(t) eps(t) of ``rows``, ``begin`` the first rows of the stretches, between
    which nothing is correlated; left-out rows count as zero. The number of lags is by default
    floor(4 (n / 100)^(2/9)) (Newey and West 1994).
    """
    if n_lags is None:
        n_lags = int(4 * (len(scores) / 100) ** (2 / 9))
    stretch = np.searchsorted(begin, rows, side="right")
    spaced = rows + stretch * n_lags
    dense = np.zeros((spaced[-1] + 1, scores.shape[1]))
    dense[spaced] = scores
    total = scores.T @ scores
    for lag in range(1, min(n_lags, len(dense) - 1) + 1):
        cross = dense[lag:].T @ dense[:-lag]
        total += (1 - lag / (n_lags + 1)) * (cross + cross.T)
    return total
