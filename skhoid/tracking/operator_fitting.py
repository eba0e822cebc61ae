"""Maximum likelihood on pieces of records: an operator, its states, and an AR remnant.

What :class:`~skhoid.tracking.windowed_operator.WindowedOperator` and
:class:`~skhoid.tracking.sigmoid_operator.SigmoidOperator` share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from .. import _kernels
from ..arx.rls import grid_numbers
from ..exceptions import ShortRunError
from ..regression import DataToFit

DYNAMICS = ("omega_nm", "zeta_nm", "tau_e")
LIMITS = {"omega_nm": (2.0, 40.0), "zeta_nm": (0.02, 2.0), "tau_e": (0.05, 0.8)}
RATE = 25.0  # Hz, of the rows whose prediction errors count
NOISE_ORDER = 6  # of the AR model of the remnant at 25 Hz
FORGOTTEN = 0.25  # of a piece, at most, that is left out because the error before is not known
ROWS_PER_COEFFICIENT = 4  # of the noise model, that a piece must have beyond those for the operator
STARTS = {
    "omega_nm": (5.0, 9.0, 15.0),
    "zeta_nm": (0.25, 0.7),
    "tau_e": (0.1, 0.17, 0.24, 0.31, 0.38, 0.5),
}
N_STARTS = 3  # best ones of the grid that are refined
ROUGHLY, FINELY = 1e-2, 1e-7  # of n log(SSE), where a start or a fit is settled
ENDLESS = 1e100  # in place of an infinite variance
CONSTANT = np.full(4, -1)


class Pieces(NamedTuple):
    """Pieces of records as the kernel takes them, and the output on the rows of the criterion."""

    table: np.ndarray
    valid: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class OperatorRecord:
    """Error and output on the grid, and the stretches that a fit may use.

    A row of ``stretches`` has its first row, last row + 1 and first row from which the error is
    known. ``number`` counts samples from time zero.
    """

    e: np.ndarray
    y: np.ndarray
    known: np.ndarray
    number: np.ndarray
    time: np.ndarray
    stretches: np.ndarray
    dt: float

    @classmethod
    def of(cls, data: DataToFit, e: np.ndarray) -> OperatorRecord:
        grid = data.grid
        rows = np.stack([grid.begin, grid.end, grid.past], axis=1)[grid.measured]
        number = grid_numbers(grid)
        known = ~np.isnan(data.output)
        return cls(
            _kernels.gate(e),
            _kernels.gate(np.where(known, data.output, 0.0)),
            known,
            number,
            _kernels.gate(number * grid.dt),
            rows.astype(np.int64),
            grid.dt,
        )

    @property
    def thin(self) -> int:
        return max(1, round(1 / (RATE * self.dt)))

    def pieces(self, first: int, last: int, order: int) -> Pieces | None:
        """The rows with sample numbers from ``first`` to ``last`` - 1; None if there are none."""
        table, valid, outputs = [], [], []
        place = counting = 0
        for begin, end, past in self.stretches.tolist():
            base = int(self.number[begin])
            a, b = max(begin, begin + first - base), min(end, begin + last - base)
            wait = past + int(np.ceil(LIMITS["tau_e"][1] / self.dt)) + 2 - a
            a += min(max(wait, 0), int(FORGOTTEN * max(b - a, 0)))
            if b - a <= order * self.thin:
                continue
            rows = np.arange(a, b, self.thin)
            missing = np.cumsum(np.append(0, ~self.known[rows]))
            counts = order + np.flatnonzero(missing[order + 1 :] == missing[: -order - 1])
            if not counts.size:
                continue
            table.append([a, b, past, place, counting, counting + counts.size])
            valid.append(place + counts)
            outputs.append(self.y[rows])
            place, counting = place + rows.size, counting + counts.size
        if not table:
            return None
        return Pieces(np.array(table), np.concatenate(valid), np.concatenate(outputs))

    def enough(self, first: int, last: int, order: int, n_operator: int) -> Pieces | None:
        """Pieces with enough rows for an operator, with a lower order of noise where need be."""
        while True:
            found = self.pieces(first, last, order)
            if found is not None:
                spare = found.valid.size - n_operator - 2 * len(found.table)
                if spare >= max(1, ROWS_PER_COEFFICIENT * order):
                    return found
            if order == 0:
                return None
            order -= 1


@dataclass(frozen=True)
class OperatorFit:
    """A fit: parameters, noise model and the covariance of both.

    ``gains`` are K_e and K_edot, then the changes of those that follow a sigmoid; ``dynamics`` as
    the kernel has them. The covariance is of the gains, the ``free`` dynamics and the noise model;
    NaN for dynamics at a bound.
    """

    gains: np.ndarray
    dynamics: np.ndarray
    ar: np.ndarray
    free: np.ndarray
    stuck: np.ndarray
    squares: float
    n_rows: int
    covariance: np.ndarray

    @property
    def loss(self) -> float:
        """n log(squares / n), which a likelier fit makes smaller."""
        return self.n_rows * float(np.log(max(self.squares, 1e-300) / self.n_rows))

    def values(self) -> dict[str, float]:
        """Parameters at the beginning."""
        q = self.dynamics
        return {
            "K_e": float(self.gains[0]),
            "K_edot": float(self.gains[1]),
            "tau_e": float(q[2]),
            "omega_nm": float(np.exp(q[0])),
            "zeta_nm": float(np.exp(q[1])),
        }

    def deviations(self) -> dict[str, float]:
        """Standard errors of parameters that are constant, with that of T_L."""
        sd = np.sqrt(np.diag(self.covariance))
        values = self.values()
        found = {"K_e": sd[0], "K_edot": sd[1], "tau_e": self.find_sd(2)}
        found |= {name: values[name] * self.find_sd(i) for i, name in enumerate(DYNAMICS[:2])}
        with np.errstate(divide="ignore", invalid="ignore"):
            K_e, K_edot = self.gains[:2]
            slope = np.array([-K_edot / K_e, 1.0]) / K_e
            found["T_L"] = np.sqrt(slope @ self.covariance[:2, :2] @ slope)
        return {name: float(value) for name, value in found.items()}

    def find_column(self, dynamic: int) -> int:
        """Place of one of the free dynamics in the covariance."""
        return self.gains.size + int(np.flatnonzero(self.free == dynamic)[0])

    def find_sd(self, dynamic: int) -> float:
        """Standard error of one of the free dynamics; NaN at a bound."""
        at = self.find_column(dynamic)
        return float(np.sqrt(self.covariance[at, at]))

    def sd_along(self, slopes: np.ndarray) -> np.ndarray:
        """Standard errors of what has these derivatives to the parameters, one row each.

        A parameter of a sigmoid at its bound counts as known; what depends on another one at its
        bound has none.
        """
        known = np.nan_to_num(self.covariance, nan=0.0, posinf=ENDLESS)
        variance = np.einsum("ti,ij,tj->t", slopes, known, slopes, optimize=True)
        sd = np.sqrt(np.maximum(variance, 0.0))
        sd[variance >= ENDLESS * 1e-20] = np.inf
        of_core = [self.gains.size + i for i in np.flatnonzero(self.stuck & (self.free < 5))]
        sd[(slopes[:, of_core] != 0.0).any(axis=1)] = np.nan
        return sd


@dataclass(frozen=True)
class OperatorSearch:
    """Fits of one structure to pieces of a record.

    ``share_of`` says which sigmoid K_e, K_edot, omega_nm and zeta_nm follow, or -1.
    """

    record: OperatorRecord
    low: np.ndarray
    high: np.ndarray
    share_of: np.ndarray
    free: np.ndarray

    @classmethod
    def of(
        cls,
        record: OperatorRecord,
        share_of: Sequence[int] | np.ndarray = CONSTANT,
        sigmoids: Sequence[tuple[tuple[float, float], tuple[float, float]]] = (),
    ) -> OperatorSearch:
        """``sigmoids`` has bounds of log G and of M for each."""
        rows = [np.log(LIMITS["omega_nm"]), np.log(LIMITS["zeta_nm"]), LIMITS["tau_e"]]
        rows += rows[:2]
        for rate, middle in sigmoids:
            rows += [rate, middle]
        low, high = np.array(rows, dtype=float).T
        share_of = np.asarray(share_of, dtype=np.int64)
        free = [0, 1, 2, *(3 + i for i in range(2) if share_of[2 + i] >= 0)]
        free += range(_kernels.window.N_DYNAMIC, low.size)
        return cls(record, _kernels.gate(low), _kernels.gate(high), share_of, np.array(free))

    @property
    def n_parameters(self) -> int:
        return 2 + int((self.share_of[:2] >= 0).sum()) + self.free.size

    @property
    def n_shares(self) -> int:
        return (self.low.size - _kernels.window.N_DYNAMIC) // 2

    def scanned(self, pieces: Pieces, points: np.ndarray, ar: np.ndarray) -> np.ndarray:
        """Squares of prediction errors at many dynamics."""
        record = self.record
        return _kernels.window.scanned(
            *(record.e, record.time, pieces.y, pieces.table, pieces.valid),
            *(record.thin, record.dt, _kernels.gate(points), _kernels.gate(ar)),
            *(self.share_of, self.n_shares),
        )

    def fitted(
        self,
        pieces: Pieces,
        start: np.ndarray,
        ar: np.ndarray,
        settled: float = FINELY,
        *,
        robust: bool = False,
    ) -> OperatorFit:
        """The best fit from a start; ``robust`` errors allow for a remnant that changes in size."""
        record = self.record
        squares, gains, states, q, ar, stuck, normal, weighed, _ = _kernels.window.fitted(
            *(record.e, record.time, pieces.y, pieces.table, pieces.valid),
            *(record.thin, record.dt, _kernels.gate(start), _kernels.gate(ar)),
            *(self.share_of, self.n_shares, self.free, self.low, self.high, settled),
        )
        covariance = np.full_like(normal, np.nan)
        kept = np.ones(len(normal), dtype=bool)
        kept[gains.size : gains.size + self.free.size] = ~stuck
        kept_both = np.ix_(kept, kept)
        n, used = pieces.valid.size, int(kept.sum()) + states.size
        inverse = scaled_inverse(normal[kept_both])
        if robust and np.isfinite(inverse).all():
            inverse = inverse @ weighed[kept_both] @ inverse * (n / max(n - used, 1))
        else:
            inverse = inverse * (squares / max(n - used, 1))
        covariance[kept_both] = inverse
        return OperatorFit(gains, q, ar, self.free, stuck, squares, pieces.valid.size, covariance)

    def started(self, pieces: Pieces, order: int) -> OperatorFit:
        """A constant operator from a grid of starts."""
        grid = [
            [np.log(omega), np.log(zeta), tau, np.log(omega), np.log(zeta)]
            for omega, zeta, tau in product(*(STARTS[name] for name in DYNAMICS))
        ]
        points = np.clip(grid, self.low, self.high)
        squares = self.scanned(pieces, points, np.zeros(0))
        best = points[np.argsort(squares, kind="stable")[:N_STARTS]]
        fits = [self.fitted(pieces, point, np.zeros(order), ROUGHLY) for point in best]
        likeliest = min(fits, key=lambda fit: fit.squares)
        return self.fitted(pieces, likeliest.dynamics, likeliest.ar)


def scaled_inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of a normal matrix; what the data do not determine gets an infinite variance."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    determined = values > 1e-12 * values[-1]
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    lost = (vectors[:, ~determined] ** 2).sum(axis=1) > 1e-6
    inverse[lost, lost] = np.inf
    return inverse / np.outer(scale, scale)


def too_short(name: str, record: OperatorRecord, needed: int, n_samples: int) -> ShortRunError:
    """The error of data in which no piece has enough rows."""
    longest = int((record.stretches[:, 1] - record.stretches[:, 0]).max(initial=0))
    return ShortRunError(
        f"{name}: no piece of the record has rows for the {needed} parameters and the states of an "
        f"operator (n_samples = {n_samples} rows of X; the longest stretch without a gap has "
        f"{longest} rows, {longest * record.dt:.3g} s). Use longer runs."
    )
