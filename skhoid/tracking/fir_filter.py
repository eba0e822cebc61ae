"""FIRFilter: the recursion behind RecursiveFIR, which goes on from row to row.

Open it for how a stream keeps its lags, and for the pseudoinverse; the loops are ``_kernels.fir``.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _kernels
from ..arx.orders import Orders, whole_number
from ..arx.rls import kernel_regressors
from ..exceptions import PoorExcitationWarning

if TYPE_CHECKING:
    from .recursive_fir import RecursiveFIR

CHUNK = 256  # rows that a stream takes at a time
FADED = 0.01  # of the variance of the first tap, by the last one, under penalty="tc"


@dataclass
class FIRFilter:
    """The recursion of a model, with its state and the rows that its lags reach back to."""

    orders: Orders
    factor: float
    ridge: float
    every: int
    pseudoinverse: bool
    penalty: np.ndarray
    prior: np.ndarray

    def __post_init__(self) -> None:
        self.columns, self.lags = kernel_regressors(self.orders)
        self.owner = np.where(self.columns <= len(self.orders.nb), self.columns - 1, -1)
        offsets = list(_kernels.fir.layout(self.owner.size).items())
        self._where = {name: slice(begin, end) for (name, begin), (_, end) in pairwise(offsets)}
        self.state = np.zeros(offsets[-1][1])
        self.depth, self.since = self.orders.first_row, 0
        self._signals = np.full(
            (1 + len(self.orders.nb) + self.orders.intercept, self.depth + CHUNK, 1), np.nan
        )
        if self.orders.intercept:
            self._signals[-1] = 1.0
        self._target = np.full((self.depth + CHUNK, 1), np.nan)
        n = self.owner.size
        self._no_path, self._no_spread = np.empty((0, n)), np.empty((0, n, n))
        self._no_errors = np.empty((0, 0))

    @classmethod
    def of(cls, model: RecursiveFIR) -> FIRFilter:
        orders = model.orders_
        pseudoinverse = model.form == "pseudoinverse"
        if pseudoinverse and model.penalty != "identity":
            raise ValueError(
                f"form='pseudoinverse' has no penalty, but penalty={model.penalty!r}; it goes with "
                "form='regularized'."
            )
        prior = np.eye(orders.n_params)
        penalty = np.eye(orders.n_params)
        if model.penalty == "tc":
            at = 0
            for taps in orders.nb:
                block = slice(at, at + taps)
                prior[block, block], penalty[block, block] = tc_kernel(taps)
                at += taps
        every = whole_number("every", model.every, 1)
        return cls(
            orders, model._factor(), float(model.ridge), every, pseudoinverse, penalty, prior
        )

    def part(self, name: str) -> np.ndarray:
        """A quantity of the kernel's layout: a matrix, flat, a vector, or one number."""
        return self.state[self._where[name]]

    def matrix(self, name: str) -> np.ndarray:
        """A symmetric matrix of the kernel, which keeps what is above the diagonal."""
        n = self.owner.size
        above = np.triu(self.part(name).reshape(n, n))
        return above + np.triu(above, 1).T

    def advance(
        self,
        signals: np.ndarray,
        target: np.ndarray,
        errors: np.ndarray,
        with_covariance: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take all instants; the path of theta, and its covariance over σ²."""
        n, end = self.owner.size, len(target)
        solutions = end // self.every
        path = np.empty((solutions, n))
        spread = np.empty((solutions * with_covariance, n, n))
        if not self.pseudoinverse:
            self._run(signals, target, 0, end, self.every, path, spread, errors)
            return path, spread
        for row in range(solutions):
            self._accumulate(signals, target, row * self.every, (row + 1) * self.every, errors)
            path[row] = self.part("theta")
            if with_covariance:
                spread[row] = self.spread()
        self._accumulate(signals, target, solutions * self.every, end, errors)
        return path, spread

    def _accumulate(
        self, signals: np.ndarray, target: np.ndarray, begin: int, end: int, errors: np.ndarray
    ) -> None:
        """Take instants, and solve where it is due if the kernel cannot."""
        every = 0 if self.pseudoinverse else self.every
        while begin < end:
            so_far = int(self.part("instants")[0])
            due = self.every - so_far % self.every if self.pseudoinverse else end - begin
            stop = min(begin + due, end)
            self._run(signals, target, begin, stop, every, self._no_path, self._no_spread, errors)
            if self.pseudoinverse and stop - begin == due:
                self._invert()
            begin = stop

    def _run(self, signals: Any, target: Any, begin: int, end: int, every: int, *out: Any) -> None:
        _kernels.fir.advance(
            signals, target, self.columns, self.lags, self.owner, self.penalty, self.prior, begin,
            end, self.factor, self.ridge, every, self.state, *out,
        )  # fmt: skip

    def _invert(self) -> None:
        """Solve for theta by the pseudoinverse of R, each input in units of its mean power."""
        if self.part("fresh")[0] == 0.0:
            return
        R, n = self.matrix("R"), self.owner.size
        scale = np.ones(n)
        for j in range(len(self.orders.nb)):
            own = self.owner == j
            power = R.diagonal()[own].sum() / self.part("weight")[0]
            scale[own] = np.sqrt(power) if power > 0 else 1.0
        values, vectors = np.linalg.eigh(R / np.outer(scale, scale))
        kept = values > max(self.ridge, n * np.finfo(float).eps * values[-1])
        if not kept.any():
            return
        vectors = vectors[:, kept] / scale[:, None]
        inverse = (vectors / values[kept]) @ vectors.T
        self.part("A")[:] = inverse.ravel()
        self.part("meat")[:] = self.part("S")
        self.part("theta")[:] = inverse @ self.part("s")
        self.part("fresh")[:], self.part("solved")[:] = 0.0, 1.0

    def spread(self) -> np.ndarray:
        """Covariance of theta over σ²; NaN before the first solution."""
        n = self.owner.size
        out = np.full((n, n), np.nan)
        if self.part("solved")[0]:
            A, S = (self.part(name).reshape(n, n) for name in ("A", "meat"))
            _kernels.fir.sandwich(A, self.pseudoinverse, S, out)
        return out

    def covariance(self) -> np.ndarray:
        return self.noise_variance * self.spread()

    @property
    def noise_variance(self) -> float:
        judged = self.part("judged")[0]
        return float(self.part("total")[0] / judged) if judged else np.nan

    def delta(self) -> np.ndarray:
        """The last δ of each input."""
        if self.part("weight")[0] == 0.0:
            return np.zeros(len(self.orders.nb))
        of_tap = np.zeros(self.owner.size)
        _kernels.fir.penalties(
            self.matrix("R"), self.part("weight")[0], self.owner, self.prior, self.ridge, of_tap
        )
        return np.array([of_tap[self.owner == j][0] for j in range(len(self.orders.nb))])

    def warn_undetermined(self, inputs: list[str]) -> None:
        if self.part("solved")[0]:
            return
        cause = (
            f"no direction of the input {', '.join(map(repr, inputs))} weighs more than ridge="
            f"{self.ridge:g} rows, so all {self.owner.size} taps are zero. Use a smaller ridge"
            if self.pseudoinverse
            else f"the input {', '.join(map(repr, inputs))} never determined all of the "
            f"{self.owner.size} taps, so they are zero throughout. Use ridge > 0, fewer taps"
        )
        warnings.warn(
            f"There is no estimate: {cause}, or a richer input.",
            PoorExcitationWarning,
            stacklevel=4,
        )

    def remember(self, signals: np.ndarray) -> None:
        """Take over the lags at the end of a run, of shape (n_signals, n_rows)."""
        self.since = signals.shape[1]
        kept = min(self.since, self.depth)
        if kept:
            self._signals[:, self.depth - kept : self.depth, 0] = signals[:, -kept:]

    def rest(self) -> None:
        """Forget the rows before."""
        self.since = 0

    def take(self, X: np.ndarray, y: np.ndarray) -> None:
        """Take rows that follow those before."""
        depth, inputs = self.depth, slice(1, 1 + X.shape[1])
        for first in range(0, y.size, CHUNK):
            m = min(CHUNK, y.size - first)
            self._signals[inputs, depth : depth + m, 0] = X[first : first + m].T
            self._target[depth : depth + m, 0] = y[first : first + m]
            if self.since < depth:
                self._target[depth : 2 * depth - self.since, 0] = np.nan
            self.since += m
            self._accumulate(self._signals, self._target, depth, depth + m, self._no_errors)
            self._signals[inputs, :depth] = self._signals[inputs, m : m + depth]


def tc_kernel(n_taps: int) -> tuple[np.ndarray, np.ndarray]:
    """The kernel min(ρ^i, ρ^k) of a smooth response that fades, and its inverse."""
    variance = FADED ** (np.arange(n_taps) / max(n_taps - 1, 1))
    kernel = np.minimum.outer(variance, variance)
    steps = np.append(-np.diff(variance), variance[-1])  # variances of independent increments
    diagonal = 1 / steps
    inverse = np.diag(diagonal + np.append(0.0, diagonal[:-1]))
    if n_taps > 1:
        beside = np.arange(n_taps - 1)
        inverse[beside, beside + 1] = inverse[beside + 1, beside] = -diagonal[:-1]
    return kernel, inverse
