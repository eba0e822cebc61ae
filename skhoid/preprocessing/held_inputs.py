"""HeldInputs: columns of a table as a simulation takes them, read a few rows at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

BLOCK = 100_000  # values, or rows of a channel


class HeldInputs:
    """Columns on a grid, in which NaN hold the last value, and are zero before the first.

    Rows are read when they are asked for, by a slice or by their numbers: a table of single
    precision, or one that lies in a file, is never copied whole. ``stretches`` are first rows and
    last rows + 1 of what belongs together.
    """

    def __init__(
        self,
        values: np.ndarray,
        columns: Sequence[int],
        stretches: Sequence[tuple[int, int]],
    ) -> None:
        self.values, self.columns = values, list(columns)
        self.shape = (len(values), len(self.columns))
        begin, end = np.array(stretches).reshape(-1, 2).T
        found: dict[int, list[np.ndarray]] = {}
        block = max(1, BLOCK // max(values.shape[1], 1))
        for a in range(0, len(values), block):
            missing = np.isnan(values[a : a + block])[:, self.columns]
            for i in np.flatnonzero(missing.any(axis=0)).tolist():
                found.setdefault(i, []).append(a + np.flatnonzero(missing[:, i]))
        self.gaps = {i: _Gaps.of(np.concatenate(rows), begin, end) for i, rows in found.items()}

    def __getitem__(self, rows: Any) -> np.ndarray:
        columns = [self.column(i, rows) for i in range(self.shape[1])]
        return np.stack(columns, axis=-1, dtype=np.float64)

    def column(self, position: int, rows: Any) -> np.ndarray:
        """Values of one of the columns, in its precision; maybe a view."""
        column = self.columns[position]
        found = self.values[rows, column]
        if position in self.gaps:
            found = found.copy()
            missing, last, _ = self.gaps[position]
            holes = np.flatnonzero(np.isnan(found))
            if isinstance(rows, slice):
                rows = np.arange(*rows.indices(len(self.values)))
            before = last[np.searchsorted(missing, rows[holes])]
            found[holes] = np.where(before >= 0, self.values[before, column], 0.0)
        return found


class _Gaps(NamedTuple):
    """Rows of a column that are NaN, the last row before each that is not (or -1), and what counts.

    Rows before the first value only lack a past (DelayShift), unless none ever comes.
    """

    rows: np.ndarray
    last: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray, begin: np.ndarray, end: np.ndarray) -> _Gaps:
        stretch = np.searchsorted(begin, rows, side="right") - 1
        first = rows == begin[stretch]
        opens = np.flatnonzero(first | (np.diff(rows, prepend=-2) > 1))
        last = np.where(first, -1, rows - 1)[opens]
        last = np.repeat(last, np.diff(opens, append=rows.size))
        never = np.bincount(stretch, minlength=begin.size) == end - begin
        return cls(rows, last, (last >= 0) | never[stretch])
