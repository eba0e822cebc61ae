"""From rows of a table to runs side by side in a record, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from ..effects.record import LARGE, Record, few_runs
from ..effects.row_channels import RowChannels
from ..human import LinearElement
from ..preprocessing.grid import ModelGrid
from ..preprocessing.held_inputs import HeldInputs
from ..regression import segments
from ..runs.roles import EXACT, target_is_sum


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

    def beside(self, rows: np.ndarray, fill: Any = 0.0, dtype: Any = None) -> np.ndarray:
        """Values of rows as an array of shape (length, n_columns).

        The runs of a large table lie one after the other in memory, so that a few of them are a
        piece of it.
        """
        shape = (self.length, self.begin.size)
        order: Literal["C", "F"] = "F" if np.prod(shape) > LARGE else "C"
        out = np.full(shape, fill, dtype=rows.dtype if dtype is None else dtype, order=order)
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
    values: HeldInputs,
    roles: Mapping[str, str],
    inputs: Sequence[str],
    *,
    output: np.ndarray | None = None,
    settling: float = 0.0,
    controlled_element: LinearElement | None = None,
) -> tuple[Record, SegmentColumns]:
    """Put the rows of a grid side by side."""
    columns = SegmentColumns.of(grid)
    known = measured(grid, columns, output)
    channels, roles = _channels(columns, names, values, dict(roles))
    y = None
    if output is not None:
        y = np.nan_to_num(columns.beside(output, dtype=np.float64), copy=False)
        for j, (a, b) in enumerate(zip(columns.begin, columns.end, strict=True)):
            known[: min(round(settling / grid.dt), (b - a) // 4), j] = False
    record = Record(
        dt=grid.dt,
        t=_times(columns, grid),
        channels=channels,
        roles=roles,
        inputs=tuple(inputs),
        known=known,
        y=y,
        controlled_element=controlled_element,
    )
    return record, columns


def _channels(
    columns: SegmentColumns, names: Sequence[str], values: HeldInputs, roles: dict[str, str]
) -> tuple[RowChannels, dict[str, str]]:
    """All channels, with the target where it is the sum of two, and their roles."""
    of_role = {role: name for name, role in roles.items() if role in EXACT}
    sums = {}
    if target_is_sum(of_role):
        sums, roles = {"f_t": (of_role["e"], of_role["x"])}, {**roles, "f_t": "f_t"}
    channels = RowChannels(
        {name: partial(values.column, i) for i, name in enumerate(names)},
        columns.begin,
        columns.end,
        columns.length,
        sums,
        order="F" if few_runs(columns.length, columns.begin.size) else "C",
    )
    return channels, roles


def _times(columns: SegmentColumns, grid: ModelGrid) -> np.ndarray:
    """Time in the runs, in one column where they share it; it continues behind short ones."""
    time = grid.layout.time if grid.rows is None else grid.layout.time[grid.rows]
    more = grid.dt * np.arange(1, columns.length + 1)
    runs = list(zip(columns.begin.tolist(), columns.end.tolist(), strict=True))

    def of_run(a: int, b: int) -> np.ndarray:
        return np.concatenate([time[a:b], time[b - 1] + more[: columns.length - (b - a)]])

    first = of_run(*runs[0])
    low, high = first.copy(), first.copy()
    for run in runs[1:]:
        here = of_run(*run)
        np.minimum(low, here, out=low)
        np.maximum(high, here, out=high)
    if (high - low).max() < 0.5 * grid.dt:
        return first[:, None]
    t = columns.beside(time)
    for j, run in enumerate(runs):
        t[:, j] = of_run(*run)
    return t


def measured(grid: ModelGrid, columns: SegmentColumns, output: np.ndarray | None) -> np.ndarray:
    """Samples (length, n_columns) outside run-ins in which the output is a number."""
    rows = np.ones(int(columns.end[-1]), dtype=bool) if output is None else ~np.isnan(output)
    for begin, end in zip(grid.begin[~grid.measured], grid.end[~grid.measured], strict=True):
        rows[begin:end] = False
    return columns.beside(rows, fill=False)
