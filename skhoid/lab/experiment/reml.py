"""A linear mixed model with one random effect: REML, and tests by Kenward and Roger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize, stats

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
