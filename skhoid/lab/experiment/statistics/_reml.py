"""Variances of a linear mixed model by REML, for any design matrix and any groups.

Open it to see what is maximised. Everything is in the dimension of the groups, not of the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import linalg, optimize

MOST_STEPS = 60
MOST_HALVINGS = 30
CONVERGED = 1e-15  # decrease that a step promises, in units of the criterion
CLOSE = 1e-8  # such a decrease, below which rounding hides whether the criterion fell
LEAST = 1e-10  # residual variance, relative to that of least squares
STARTS = ((1.0, 1.0), (0.1, 0.1))  # variance of each group, and of rows, relative to the same


@dataclass(frozen=True)
class Equations:
    """Cross products of y, X and the groups' indicators Z, the rows scaled by sqrt(weight).

    y is that which least squares leave of it, ``ordinary`` their coefficients, and ``scale`` its
    variance. ``parts`` are the columns of Z that belong to each group.
    """

    n: int
    parts: tuple[slice, ...]
    xx: np.ndarray
    zx: np.ndarray
    zz: np.ndarray
    xy: np.ndarray
    zy: np.ndarray
    yy: float
    log_weights: float
    ordinary: np.ndarray
    scale: float


@dataclass(frozen=True)
class At:
    """What follows from given variances: of the groups in order, and last that of the rows.

    ``criterion`` is that of lme4 and others, -2 log of the restricted likelihood. ``covariance`` is
    (X'V⁻¹X)⁻¹; ``zvz``, ``zvx`` and ``zpz`` are Z'V⁻¹Z, Z'V⁻¹X and Z'PZ with P = V⁻¹ -
    V⁻¹X(X'V⁻¹X)⁻¹X'V⁻¹; ``zpy`` is Z'Py.
    """

    variances: np.ndarray
    criterion: float
    beta: np.ndarray
    covariance: np.ndarray
    zvz: np.ndarray
    zvx: np.ndarray
    zpz: np.ndarray
    zpy: np.ndarray
    ypy: float
    equations: Equations

    @property
    def parts(self) -> tuple[slice, ...]:
        return self.equations.parts

    def traces(self) -> tuple[np.ndarray, np.ndarray]:
        """tr(P Gᵢ) and tr(P Gᵢ P Gⱼ), where V = Σ vᵢ Gᵢ and the last G is that of the rows."""
        v, k = self.variances, len(self.parts)
        rank = self.equations.n - self.beta.size
        first, second = np.empty(k + 1), np.empty((k + 1, k + 1))
        for i, one in enumerate(self.parts):
            first[i] = np.trace(self.zpz[one, one])
            for j, other in enumerate(self.parts):
                second[i, j] = np.sum(self.zpz[one, other] ** 2)
        # P V P = P gives what belongs to the rows.
        first[k] = (rank - v[:k] @ first[:k]) / v[k]
        second[:k, k] = second[k, :k] = (first[:k] - second[:k, :k] @ v[:k]) / v[k]
        second[k, k] = (first[k] - v[:k] @ second[:k, k]) / v[k]
        return first, second

    def gradient(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of half the criterion: gradient, expected information, and Hessian matrix."""
        v, k = self.variances, len(self.parts)
        first, second = self.traces()
        # In the same way y'P Gᵢ P y, and y'P Gᵢ P Gⱼ P y.
        squares, fourth = np.empty(k + 1), np.empty((k + 1, k + 1))
        for i, one in enumerate(self.parts):
            squares[i] = self.zpy[one] @ self.zpy[one]
            for j, other in enumerate(self.parts):
                fourth[i, j] = self.zpy[one] @ self.zpz[one, other] @ self.zpy[other]
        squares[k] = (self.ypy - v[:k] @ squares[:k]) / v[k]
        fourth[:k, k] = fourth[k, :k] = (squares[:k] - fourth[:k, :k] @ v[:k]) / v[k]
        fourth[k, k] = (squares[k] - v[:k] @ fourth[:k, k]) / v[k]
        return 0.5 * (first - squares), 0.5 * second, fourth - 0.5 * second

    def predicted(self) -> np.ndarray:
        """The random effects of all groups (BLUP)."""
        return self.spread() * self.zpy

    def spread(self) -> np.ndarray:
        """The variance of each random effect."""
        return _spread(self.variances, self.equations)


def equations(
    y: np.ndarray, X: np.ndarray, groups: Sequence[np.ndarray], weights: np.ndarray | None = None
) -> Equations:
    """Cross products of the data.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Observations.
    X : ndarray, shape (n, p)
        Design matrix of full rank.
    groups : sequence of ndarray of int, shape (n,)
        Group of each row, numbered from 0, for each random effect.
    weights : ndarray, shape (n,), or None
        The variance of a row is the residual variance divided by its weight.
    """
    w = np.ones(y.size) if weights is None else weights
    root = np.sqrt(w)
    if np.linalg.matrix_rank(root[:, None] * X) < X.shape[1] or y.size <= X.shape[1]:
        raise ValueError(
            f"{y.size} rows do not determine {X.shape[1]} fixed effects and a variance."
        )
    ordinary = np.linalg.lstsq(root[:, None] * X, root * y, rcond=None)[0]
    rest = y - X @ ordinary
    sizes = [int(codes.max()) + 1 for codes in groups]
    ends = np.cumsum([0, *sizes])
    parts = tuple(slice(a, b) for a, b in pairwise(ends))
    zz = np.zeros((ends[-1], ends[-1]))
    zx, zy = np.zeros((ends[-1], X.shape[1])), np.zeros(ends[-1])
    for one, codes in zip(parts, groups, strict=True):
        zy[one] = np.bincount(codes, w * rest, one.stop - one.start)
        np.add.at(zx, one.start + codes, w[:, None] * X)
        for other, others in zip(parts, groups, strict=True):
            np.add.at(zz, (one.start + codes, other.start + others), w)
    yy = float(w @ rest**2)
    return Equations(
        y.size,
        parts,
        X.T @ (w[:, None] * X),
        zx,
        zz,
        X.T @ (w * rest),
        zy,
        yy,
        float(np.log(w).sum()),
        ordinary,
        yy / (y.size - X.shape[1]),
    )


def evaluate(data: Equations, variances: np.ndarray) -> At:
    """The restricted likelihood and the estimates at given variances."""
    residual = variances[-1]
    root = np.sqrt(_spread(variances, data) / residual)
    q = root.size
    inner = root[:, None] * data.zz * root
    inner.flat[:: q + 1] += 1.0
    lower = np.linalg.cholesky(inner)
    right = root[:, None] * np.column_stack([data.zz, data.zx, data.zy])
    solved = linalg.solve_triangular(lower, right, lower=True, check_finite=False)
    reach, across, along = solved[:, :q], solved[:, q:-1], solved[:, -1]
    products = reach.T @ solved
    zvz = (data.zz - products[:, :q]) / residual
    zvx = (data.zx - products[:, q:-1]) / residual
    zvy = (data.zy - products[:, -1]) / residual
    information = (data.xx - across.T @ across) / residual
    factor = linalg.cho_factor(information, lower=True)
    xvy = (data.xy - across.T @ along) / residual
    change = linalg.cho_solve(factor, xvy)
    covariance = linalg.cho_solve(factor, np.eye(change.size))
    ypy = (data.yy - along @ along) / residual - xvy @ change
    criterion = (
        2.0 * np.log(np.diag(lower)).sum()
        + data.n * np.log(residual)
        - data.log_weights
        + 2.0 * np.log(np.diag(factor[0])).sum()
        + ypy
        + (data.n - change.size) * np.log(2.0 * np.pi)
    )
    return At(
        variances,
        float(criterion),
        data.ordinary + change,
        covariance,
        zvz,
        zvx,
        zvz - zvx @ covariance @ zvx.T,
        zvy - zvx @ change,
        float(ypy),
        data,
    )


def reml(data: Equations, starts: Sequence[np.ndarray] = ()) -> At:
    """The variances with the highest restricted likelihood, none of them below 0.

    Newton's method, or Fisher's scoring where the criterion is not convex, from several starts, of
    which the best result counts. Steps end at 0, where a variance stays as long as the likelihood
    rises towards it. Where the first end has no such variance, one start of our own is enough.
    """
    k = len(data.parts)
    if data.yy <= 1e-20 * max(1.0, float(np.sum(data.ordinary**2))) * data.n:
        raise ValueError("The rows do not scatter at all: there is no variance to estimate.")
    if not k:
        return evaluate(data, np.array([data.scale]))
    given = [np.maximum(start, [0.0] * k + [LEAST * data.scale]) for start in starts]
    own = [np.array([share] * k + [rest]) * data.scale / 2.0 for share, rest in STARTS]
    ends: list[At] = []
    for start in (*given, *own):
        ends.append(_climbed(data, start))
        if len(ends) > len(given) and np.all(ends[-1].variances > 0.0):
            break
    return min(ends, key=lambda end: end.criterion)


def _climbed(data: Equations, start: np.ndarray) -> At:
    here = evaluate(data, start)
    for _ in range(MOST_STEPS):
        slope, information, hessian = here.gradient()
        free = (here.variances > LEAST * data.scale) | (slope < 0.0)
        step = np.zeros(start.size)
        step[free] = _step(slope[free], *(m[np.ix_(free, free)] for m in (hessian, information)))
        promised = -step @ slope
        if promised < CONVERGED:
            return here
        there = next(_lower(here, step, CLOSE if promised < CLOSE else 0.0), None)
        if there is None:
            break
        here = there
    return _searched(data, here)


def _step(slope: np.ndarray, hessian: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Newton's step where the criterion is convex, else that of Fisher's scoring."""
    if np.linalg.eigvalsh(hessian)[0] > 1e-3 * np.linalg.eigvalsh(information)[0]:
        return -np.linalg.solve(hessian, slope)
    return -np.linalg.lstsq(information, slope, rcond=None)[0]


def _lower(here: At, step: np.ndarray, slack: float) -> Iterator[At]:
    """Ends of shorter and shorter steps, kept within bounds, with a lower criterion."""
    least = np.zeros(step.size)
    least[-1] = LEAST * here.equations.scale
    for halvings in range(MOST_HALVINGS):
        wanted = np.maximum(here.variances + 0.5**halvings * step, least)
        there = evaluate(here.equations, wanted)
        if there.criterion < here.criterion + slack:
            yield there


def _searched(data: Equations, start: At) -> At:
    """The optimum by a general method, where scoring does not get on."""

    def value(relative: np.ndarray) -> tuple[float, np.ndarray]:
        at = evaluate(data, relative * data.scale)
        return 0.5 * at.criterion, at.gradient()[0] * data.scale

    found = optimize.minimize(
        value,
        start.variances / data.scale,
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0, None)] * len(data.parts) + [(LEAST, None)],
        options={"ftol": 1e-15, "gtol": 1e-9},
    )
    end = evaluate(data, found.x * data.scale)
    return end if end.criterion < start.criterion else start


def _spread(variances: np.ndarray, data: Equations) -> np.ndarray:
    sizes = [part.stop - part.start for part in data.parts]
    return np.repeat(variances[:-1], sizes)
