"""Candidates fitted on parts of the data, simulated side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ... import _kernels
from ...preprocessing.grid import ModelGrid
from ..base import BOUND
from ..orders import Orders


@dataclass(frozen=True)
class FittedCandidates:
    """Coefficients of candidates, by part of the data that they were fitted on.

    ``a`` has the shape (parts, lags, candidates), ``b`` (parts, inputs, lags, candidates) and
    ``constant`` (parts, candidates), all with zeros where a candidate has fewer than others;
    ``nk`` has the shape (inputs, candidates). ``known`` is False where regressors are dependent.
    """

    a: np.ndarray
    b: np.ndarray
    constant: np.ndarray
    nk: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, orders: list[Orders], found: list[np.ndarray]) -> FittedCandidates:
        """Line up the coefficients of each candidate, of shape (parts, n_params)."""
        parts, n, n_inputs = len(found[0]), len(orders), len(orders[0].nb)
        a = np.zeros((parts, max(o.na for o in orders), n))
        b = np.zeros((parts, n_inputs, max(max(o.nb) for o in orders), n))
        constant = np.zeros((parts, n))
        for i, (o, theta) in enumerate(zip(orders, found, strict=True)):
            a[:, : o.na, i] = theta[:, : o.na]
            at = o.na
            for j, nb in enumerate(o.nb):
                b[:, j, :nb, i] = theta[:, at : at + nb]
                at += nb
            if o.intercept:
                constant[:, i] = theta[:, at]
        known = ~np.isnan(np.column_stack([theta[:, 0] for theta in found]))
        return cls(a, b, constant, np.array([o.nk for o in orders]).T, known)

    @property
    def n_candidates(self) -> int:
        return self.known.shape[1]

    def simulate(self, part: int, some: slice, grid: ModelGrid, inputs: np.ndarray) -> np.ndarray:
        """Free runs from rest on a grid, one in each column."""
        a, b, constant, nk = (
            np.ascontiguousarray(values[..., some])
            for values in (self.a[part], self.b[part], self.constant[part], self.nk)
        )
        reach = int(nk.max()) + b.shape[1]
        free = np.empty((grid.n_rows, constant.size))
        for begin, end, past in zip(grid.begin, grid.end, grid.past, strict=True):
            behind_zeros = np.zeros((len(nk), reach + end - past))
            behind_zeros[:, reach:] = inputs[past:end].T
            first = reach + begin - past
            _kernels.arx.free_runs(behind_zeros, first, a, b, nk, constant, BOUND, free[begin:end])
        return free
