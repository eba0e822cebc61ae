"""From rows of a table to runs side by side in a record, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effects.record import LARGE, Record
from ..human import LinearElement
from ..preprocessing.grid import ModelGrid
from ..regression import segments
from ..runs.roles import EXACT, target_is_sum, with_target


@dataclass(frozen=True)
class SegmentColumns:
    """Begin and end of the gapless stretches of rows; each becomes a column of a record."""

    begin: np.ndarray
    end: np.ndarray

    @classmethod
    def of(cls, grid: ModelGrid) -> SegmentColumns:
        begin, end = np.array(segments(grid)).T
        return cls(begin, end)

    @property
    def length(self) -> int:
        return int((self.end - self.begin).max())

    def beside(self, rows: np.ndarray, fill: Any = 0.0) -> np.ndarray:
        """Values of rows as an array of shape (length, n_columns).

        The runs of a large table lie one after the other in memory, so that a few of them are a
        piece of it.
        """
        shape = (self.length, self.begin.size)
        out = np.full(shape, fill, dtype=rows.dtype, order="F" if np.prod(shape) > LARGE else "C")
        for j, (a, b) in enumerate(zip(self.begin, self.end, strict=True)):
            out[: b - a, j] = rows[a:b]
        return out

    def rows(self, beside: np.ndarray) -> np.ndarray:
        """The reverse."""
        out = np.empty(int(self.end[-1]), dtype=beside.dtype)
        for j, (a, b) in enumerate(zip(self.begin, self.end, strict=True)):
            out[a:b] = beside[: b - a, j]
        return out


def build_record(
    grid: ModelGrid,
    names: Sequence[str],
    values: np.ndarray,
    roles: Mapping[str, str],
    inputs: Sequence[str],
    *,
    output: np.ndarray | None = None,
    settling: float = 0.0,
    controlled_element: LinearElement | None = None,
) -> tuple[Record, SegmentColumns]:
    """Put the rows of a grid side by side; NaN inputs must have been replaced before."""
    columns = SegmentColumns.of(grid)
    channels = {n: columns.beside(values[:, i]) for i, n in enumerate(names)}
    roles = dict(roles)
    by_role = {role: channels[name] for name, role in roles.items() if role in EXACT}
    if target_is_sum(by_role):
        channels["f_t"] = with_target(by_role)["f_t"]
        roles["f_t"] = "f_t"
    time = grid.layout.time if grid.rows is None else grid.layout.time[grid.rows]
    t = columns.beside(time)
    for j, (a, b) in enumerate(zip(columns.begin, columns.end, strict=True)):
        t[b - a :, j] = t[b - a - 1, j] + grid.dt * np.arange(1, columns.length - (b - a) + 1)
    if np.ptp(t, axis=1).max() < 0.5 * grid.dt:
        t = np.ascontiguousarray(t[:, :1])
    known = measured(grid, columns, output)
    y = None
    if output is not None:
        y = columns.beside(np.nan_to_num(output))
        for j, (a, b) in enumerate(zip(columns.begin, columns.end, strict=True)):
            known[: min(round(settling / grid.dt), (b - a) // 4), j] = False
    record = Record(
        dt=grid.dt,
        t=t,
        channels=channels,
        roles=roles,
        inputs=tuple(inputs),
        known=known,
        y=y,
        controlled_element=controlled_element,
    )
    return record, columns


def measured(grid: ModelGrid, columns: SegmentColumns, output: np.ndarray | None) -> np.ndarray:
    """Samples (length, n_columns) outside run-ins in which the output is a number."""
    rows = np.ones(int(columns.end[-1]), dtype=bool) if output is None else ~np.isnan(output)
    for begin, end in zip(grid.begin[~grid.measured], grid.end[~grid.measured], strict=True):
        rows[begin:end] = False
    return columns.beside(rows, fill=False)
