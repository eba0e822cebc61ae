"""Orders of an ARX model, and its regressors on the rows of a model grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

BLOCK = 4096  # rows of regressors at a time: with 50 lags they stay in cache


@dataclass(frozen=True)
class Orders:
    """``na``, and ``nb`` and ``nk`` of each input (Eqs. 7-8)."""

    na: int
    nb: tuple[int, ...]
    nk: tuple[int, ...]
    intercept: bool = False

    @classmethod
    def of(cls, na: Any, nb: Any, nk: Any, n_inputs: int, intercept: bool = False) -> Orders:
        """Check orders as a user gives them: a number for all inputs, or one number per input."""
        nbs = _per_input("nb", nb, n_inputs, least=1)
        nks = _per_input("nk", nk, n_inputs, least=0)
        return cls(whole_number("na", na, 0), nbs, nks, bool(intercept))

    @property
    def n_params(self) -> int:
        return self.na + sum(self.nb) + self.intercept

    @property
    def first_row(self) -> int:
        """Rows of a run before the first one with known regressors: k_c - 1 of the thesis."""
        return max(self.na, max(nb + nk - 1 for nb, nk in zip(self.nb, self.nk, strict=True)))

    def parameter_names(self, inputs: list[str]) -> list[str]:
        """Names in the order of theta (Eq. 9); several inputs are told apart by their names."""
        names = [f"a{i + 1}" for i in range(self.na)]
        for channel, nb in zip(inputs, self.nb, strict=True):
            suffix = f"({channel})" if len(inputs) > 1 else ""
            names += [f"b{j}{suffix}" for j in range(nb)]
        return names + ["intercept"] * self.intercept

    def split(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Split theta into a, b (padded to one row per input) and the intercept."""
        b = np.zeros((len(self.nb), max(self.nb)))
        at = self.na
        for row, nb in enumerate(self.nb):
            b[row, :nb] = theta[at : at + nb]
            at += nb
        return theta[: self.na], b, float(theta[at]) if self.intercept else 0.0

    def input_rows(self, theta: np.ndarray) -> Any:
        """b_0 ... of the input, or a list of them for several inputs."""
        b = self.split(theta)[1]
        rows = [row[:nb] for row, nb in zip(b, self.nb, strict=True)]
        return rows[0] if len(rows) == 1 else rows


def whole_number(name: str, value: Any, least: int) -> int:
    """Check a whole number that is at least ``least``."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"{name} must be a whole number; got {value!r}.")
    if value < least:
        raise ValueError(f"{name} must be at least {least}; got {value}.")
    return int(value)


def _per_input(name: str, value: Any, n_inputs: int, least: int) -> tuple[int, ...]:
    if np.ndim(value) == 0:
        return (whole_number(name, value, least),) * n_inputs
    values = tuple(whole_number(name, v, least) for v in value)
    if len(values) != n_inputs:
        raise ValueError(
            f"{name} has {len(values)} entries for {n_inputs} inputs; give one number for all "
            "inputs, or one per input."
        )
    return values


def regressors(
    y: np.ndarray, X: np.ndarray, begin: np.ndarray, end: np.ndarray, orders: Orders
) -> tuple[np.ndarray, np.ndarray, int]:
    """Regressors (Eq. 10) with the output in the last column, of rows whose lags lie in a stretch.

    With them the rows, and how many are left out because a value in their lags is NaN.
    """
    first = orders.first_row
    lengths = np.maximum(end - begin - first, 0)
    total = int(lengths.sum())
    table = np.empty((total, orders.n_params + 1), order="F")
    rows = np.empty(total, dtype=np.int64)
    at = 0
    for start, length in zip((begin + first).tolist(), lengths.tolist(), strict=True):
        if length == 0:
            continue
        into = slice(at, at + length)
        column = 0
        for lag in range(1, orders.na + 1):
            np.negative(y[start - lag : start - lag + length], out=table[into, column])
            column += 1
        for channel, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
            for lag in range(nk, nk + nb):
                table[into, column] = X[start - lag : start - lag + length, channel]
                column += 1
        if orders.intercept:
            table[into, column] = 1.0
            column += 1
        table[into, column] = y[start : start + length]
        rows[into] = np.arange(start, start + length)
        at += length
    if np.isnan(table.sum()):
        complete = ~np.isnan(table).any(axis=1)
        missing = int(total - complete.sum())
        return np.asfortranarray(table[complete]), rows[complete], missing
    return table, rows, 0


def regressor_blocks(
    y: np.ndarray, X: np.ndarray, begin: np.ndarray, end: np.ndarray, orders: Orders
) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
    """Yield :func:`regressors` in blocks of rows, which take hardly any memory together."""
    first = orders.first_row
    for start, stop in zip(begin.tolist(), end.tolist(), strict=True):
        for a in range(start, stop - first, BLOCK):
            b = min(a + first + BLOCK, stop)
            yield regressors(y, X, np.array([a]), np.array([b]), orders)
