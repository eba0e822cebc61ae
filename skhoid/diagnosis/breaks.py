"""Where in time something changes, with a p-value that accounts for the search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TRIM = 0.05  # of the information, at either end, where no change is looked for
N_DRAWS = 2000


@dataclass(frozen=True)
class Break:
    """The most likely change: the block after which it is, its statistic, p, and coefficients."""

    block: int
    statistic: float
    p: float
    before: np.ndarray
    after: np.ndarray

    @property
    def ratio(self) -> float:
        """One plus the first coefficient, after the change over before."""
        return float((1 + self.after[0]) / max(1 + self.before[0], 1e-3))


def largest_break(
    scores: np.ndarray, information: np.ndarray, free: float = np.inf
) -> Break | None:
    """Look for one change of coefficients c in r = Z c + n over all instants.

    ``scores`` are the sums of z n in each block of time, of shape (n_blocks, n_coefficients), and
    ``information`` their covariances under noise alone, in units in which the information on c is
    the same matrix. The statistic is the largest Lagrange multiplier (Andrews 1993, Econometrica
    61: 821), its p-value that of independent normal scores with these covariances (the fixed
    regressor bootstrap of Hansen 2000, Journal of Econometrics 97: 93); ``free`` are the degrees of
    freedom with which the level of the noise is known. None where there is no information.
    """
    n_blocks, p = scores.shape
    total = information.sum(axis=0)
    if not np.trace(total) > 0:
        return None
    before = np.cumsum(information, axis=0)[:-1]
    share = np.trace(before, axis1=1, axis2=2) / np.trace(total)
    at = np.flatnonzero((share > TRIM) & (share < 1 - TRIM))
    if at.size == 0:
        return None
    before = before[at]
    inverse = np.linalg.pinv(total, rcond=1e-9)
    bridge = np.linalg.pinv(before - before @ inverse @ before, rcond=1e-9, hermitian=True)

    def largest(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        path = np.cumsum(sums, axis=-2)
        S = path[..., at, :] - np.einsum("kij,jl,...l->...ki", before, inverse, path[..., -1, :])
        lm = np.einsum("...ki,kij,...kj->...k", S, bridge, S)
        return lm.argmax(axis=-1), lm.max(axis=-1)

    best, found = largest(scores)
    rng = np.random.default_rng(0)  # the reference distribution, the same for equal data
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :] @ vectors.swapaxes(1, 2)
    draws = np.einsum("bij,dbj->dbi", root, rng.standard_normal((N_DRAWS, n_blocks, p)))
    _, reference = largest(draws)
    if np.isfinite(free):
        reference = reference / (rng.chisquare(free, N_DRAWS) / free)
    k = int(best)
    first = np.linalg.pinv(before[k]) @ scores[: at[k] + 1].sum(axis=0)
    last = np.linalg.pinv(total - before[k]) @ scores[at[k] + 1 :].sum(axis=0)
    p_value = tail_probability(float(found), reference)
    return Break(int(at[k]), float(found), p_value, first, last)


def tail_probability(value: float, reference: np.ndarray) -> float:
    """Fraction of draws beyond a value; beyond the last ones, their exponential tail goes on."""
    n = reference.size
    top = np.sort(reference)[-(n // 20) :]
    if value <= top[0]:
        return float((1 + np.sum(reference >= value)) / (1 + n))
    return float(top.size / n * np.exp(-(value - top[0]) / np.mean(top - top[0])))
