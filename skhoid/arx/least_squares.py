"""Least squares by QR factorisation: rank, covariance, and the error that names what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dgeqrf, dgeqrf_lwork, dtpqrt
from scipy.signal import lfilter

from ..exceptions import RankDeficiencyError
from ..regression import STILL, bad_output, still
from .orders import Orders

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


def weighted(table: np.ndarray, rows: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    """A table of regressors and output whose squares count by the weights of its rows."""
    return table if weights is None else table * np.sqrt(weights[rows])[:, None]


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


PRIOR = 30.0  # degrees of freedom, at which 95 % of Student's t is 4 % wider than of the normal
MOST_LEVERAGE = 0.99  # of a row; one that a coefficient follows has no residual to enlarge
MOST_CORRELATED = 0.97  # of one score with the next (Andrews and Monahan 1992)


def robust_covariance(
    weights: np.ndarray,
    leverage: np.ndarray,
    errors: np.ndarray,
    rows: np.ndarray,
    begin: np.ndarray,
) -> np.ndarray:
    """Covariance of sums of ``weights`` (n, p) times errors that are coloured or vary in size.

    D of an autoregressive model D e = n of the errors is moved to the weights (den Haan and Levin
    1997), so that the products of weights and the white n are hardly correlated. Their long-run
    covariance (Newey and West 1987; bandwidth of Andrews 1991; n over sqrt(1 - h), MacKinnon and
    White 1985) knows only rows in which a coefficient acts: at a step, one or two. So it and the
    covariance for a stationary n are averaged by degrees of freedom: its own (Satterthwaite), and
    ``PRIOR`` (Smyth 2004). ``begin`` are the first rows of the stretches, between which nothing is
    correlated; left-out rows count as zero.
    """
    n, p = weights.shape
    correction = np.sqrt(n / max(n - p, 1))
    stretch = np.searchsorted(begin, rows, side="right")
    parts = np.split(np.arange(n), np.flatnonzero(np.diff(stretch)) + 1)
    columns = np.column_stack(
        [weights, errors, 1 / np.sqrt(1 - np.minimum(leverage, MOST_LEVERAGE))]
    )
    dense = []
    for part in parts:
        at = rows[part] - rows[part[0]]
        dense.append(np.zeros((at[-1] + 1, p + 2)))
        dense[-1][at] = columns[part]
    D, sd = _whitening([table[:, p] for table in dense], n)
    sd *= correction
    stationary, acting, scores = np.zeros((p, p)), [], []
    for table in dense:
        # What precedes the first row has an influence on the errors too.
        ahead = np.concatenate([table[::-1, :p], np.zeros((len(table) if D.size > 1 else 0, p))])
        ahead = lfilter([1.0], D, ahead, axis=0)
        stationary += ahead.T @ ahead
        acting.append(ahead[len(table) - 1 :: -1])
        white = lfilter(D, [1.0], table[:, p]) * table[:, p + 1]
        scores.append(acting[-1] * white[:, None])
    stationary *= sd**2
    bandwidth = _bandwidth(scores, n)
    long_run = np.zeros((p, p))
    spread = np.zeros(p)
    for lag in range(int(bandwidth) + 1):
        share = 1 - lag / (bandwidth + 1)
        for score, act in zip(scores, acting, strict=True):
            earlier = slice(max(len(score) - lag, 0))  # none in a stretch as short as the lag
            cross = share * score[lag:].T @ score[earlier]
            long_run += cross + cross.T if lag else cross
            squares = np.einsum("tp,tp->p", act[lag:] ** 2, act[earlier] ** 2)
            spread += (2 if lag else 1) * share**2 * squares
    power = sum(np.einsum("tp,tp->p", act, act) for act in acting)
    known = power**2 / np.maximum(spread, np.finfo(float).tiny)
    share = np.sqrt(known / (known + PRIOR))
    rest = np.sqrt(PRIOR / (known + PRIOR))
    return np.outer(share, share) * long_run + np.outer(rest, rest) * stationary


def _whitening(errors: list[np.ndarray], n: int) -> tuple[np.ndarray, float]:
    """D of an autoregressive model of errors, by the BIC, and the sd of what is left."""
    most = min(int(10 * np.log10(n)), n // 10)
    covariance = np.zeros(most + 1)
    for error in errors:
        for lag in range(min(most, len(error) - 1) + 1):
            covariance[lag] += error[lag:] @ error[: len(error) - lag]
    D, variance = np.ones(1), covariance[0] / n
    best, found = n * np.log(max(variance, np.finfo(float).tiny)), (D, variance)
    for order in range(1, most + 1):  # Levinson and Durbin
        if variance <= 0:
            break
        turn = -(D @ covariance[order:0:-1]) / (n * variance)
        D = np.r_[D, 0.0] + turn * np.r_[0.0, D[::-1]]
        variance *= 1 - turn**2
        bic = n * np.log(max(variance, np.finfo(float).tiny)) + order * np.log(n)
        if bic < best:
            best, found = bic, (D, variance)
    return found[0], float(np.sqrt(found[1]))


def _bandwidth(scores: list[np.ndarray], n: int) -> float:
    """Lags of the Bartlett window for scores that are like autoregressions of order 1."""
    power = sum(np.einsum("tp,tp->p", s, s) for s in scores)
    next_one = sum(np.einsum("tp,tp->p", s[1:], s[:-1]) for s in scores)
    rho = np.clip(next_one / np.maximum(power, np.finfo(float).tiny), -1, 1) * MOST_CORRELATED
    alpha = np.sum(4 * rho**2 / ((1 - rho) ** 6 * (1 + rho) ** 2)) / np.sum(1 / (1 - rho) ** 4)
    return float(min(1.1447 * (alpha * n) ** (1 / 3), n // 4))


def rank_error(
    null_space: np.ndarray,
    names: list[str],
    channels: list[str],
    X: np.ndarray,
    y: np.ndarray,
    output: str,
    orders: Orders,
) -> RankDeficiencyError:
    """Build the error that names the cause; ``X`` and ``y`` are the finite rows."""
    n_params = len(names)
    head = (
        f"The {n_params} parameters cannot all be estimated: the regressors have rank "
        f"{n_params - len(null_space)}. "
    )
    bad = _bad_channel(channels, X, orders)
    relation = None if bad else _linear_relation(channels, X)
    if relation is not None:
        return RankDeficiencyError(
            head + relation, hint="inputs=[...] says which to keep.", options=["input"]
        )
    cause = bad or (bad_output(output, y) if orders.na else None) or _generic(null_space, names)
    return RankDeficiencyError(head + cause, options=["na", "nb"])


def _bad_channel(channels: list[str], X: np.ndarray, orders: Orders) -> str | None:
    for position, channel in enumerate(channels):
        found = still(f"Input {channel!r}", X[:, position])
        if found is not None and not X[:, position].any():
            return f"{found}: it excites nothing. Leave it out."
        if found is not None and (orders.nb[position] > 1 or orders.intercept):
            return (
                f"{found}: its lags cannot be told apart. Leave it out, or use data in which "
                "it changes; for an offset use fit_intercept=True."
            )
    return None


def _linear_relation(channels: list[str], X: np.ndarray) -> str | None:
    """Find a channel that is a combination of the others, such as e = f_t - x."""
    if len(channels) < 2:
        return None
    norms = np.sqrt(np.mean(X**2, axis=0))
    for position in np.argsort([name != "e" for name in channels], kind="stable"):
        others = [i for i in range(len(channels)) if i != position]
        weights = np.linalg.lstsq(X[:, others] / norms[others], X[:, position], rcond=1e-10)[0]
        misfit = X[:, position] - (X[:, others] / norms[others]) @ weights
        if np.sqrt(np.mean(misfit**2)) > STILL * norms[position]:
            continue
        weights = weights / norms[others]
        terms = [
            (w, channels[i])
            for w, i in zip(weights, others, strict=True)
            if abs(w) * norms[i] > 1e-6 * norms[position]
        ]
        if len(terms) == 1 and abs(terms[0][0] - 1) < 1e-9:
            return (
                f"Inputs {channels[position]!r} and {terms[0][1]!r} are the same signal. "
                "Leave one out."
            )
        return (
            f"The inputs are linearly dependent: {channels[position]} = {_formula(terms)}. "
            "Leave one of them out."
        )
    return None


def _formula(terms: list[tuple[float, str]]) -> str:
    text = ""
    for weight, name in sorted(terms, reverse=True):
        sign = ("- " if weight < 0 else "") if not text else (" - " if weight < 0 else " + ")
        size = "" if abs(abs(weight) - 1) < 1e-9 else f"{abs(weight):.4g} "
        text += f"{sign}{size}{name}"
    return text


def _generic(null_space: np.ndarray, names: list[str]) -> str:
    weight = np.abs(null_space).max(axis=0)
    involved = [n for n, w in zip(names, weight, strict=True) if w > 1e-3]
    if not any(name.startswith("a") for name in involved):
        return (
            f"The inputs do not excite {', '.join(involved)}: n sine waves can distinguish at "
            "most 2 n lags of an input, a step only one. Use a smaller nb, or a richer forcing "
            "function."
        )
    return (
        f"{', '.join(involved)} are linearly dependent. Either the data are free of noise and "
        "fewer lags explain them exactly (use smaller na and nb), or the inputs excite too few "
        "frequencies."
    )
