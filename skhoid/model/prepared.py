"""Data read and checked for a model with effects, and what a search asks of such a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from ..arx.base import ESTIMATE, REST
from ..effects.record import LARGE, Record, RowChannels, few_runs
from ..exceptions import RankDeficiencyError, ShortRunError
from ..human import LinearElement
from ..preprocessing.grid import HeldInputs, ModelGrid
from ..regression import bad_output, segments, still
from ..runs.roles import EXACT, target_is_sum
from .cores import Core
from .fitting import AR_ORDER, Criterion, RemnantModel
from .initial import FORGOTTEN, LASTING
from .model import Model


@dataclass(frozen=True)
class SimulatedCore:
    """The core that an estimator's settings describe, how to fit it, and its given values.

    ``estimated`` finds the core without effects at the minimum of the simulation error; ``given``
    are parameters that are not estimated, for the table; ``start`` are further start values;
    ``check`` refuses runs that the core cannot be fitted to.
    """

    core: Core
    estimated: Callable[[Any, Record, Criterion], Model]
    description: str
    errors_note: str
    given: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    check: Callable[[ModelGrid], None] | None = None


@dataclass(frozen=True)
class Prepared:
    """Data to fit, read and checked, and the core to fit to them.

    ``record`` has the runs side by side and ``columns`` says where they come from; ``table`` has
    all columns of X, called ``names``, at full rate; ``channels`` are the positions of those in the
    record, and ``roles`` their roles. ``units`` are the units of the data, as tables of parameters
    need them; ``output`` is the name of the output. ``measured`` are the samples of the record with
    a measured output, including the settling time; ``known`` are the corresponding rows of X.
    """

    spec: SimulatedCore
    record: Record
    columns: SegmentColumns
    grid: ModelGrid
    table: np.ndarray
    names: list[Any]
    channels: list[int]
    roles: dict[str, str]
    units: dict[str, str | None]
    n_missing: int
    output: str
    measured: np.ndarray
    known: np.ndarray

    @property
    def core(self) -> Core:
        return self.spec.core

    @property
    def run_of_columns(self) -> np.ndarray:
        """Number of the run that each column is a part of."""
        first = self.columns.begin
        rows = first if self.grid.rows is None else self.grid.rows[first]
        return self.grid.layout.run_of(rows)


def choose_beginning(core: Core, record: Record, initial: str | None, settling: float) -> str:
    """How the simulations of a fit begin, according to the user's choice."""
    if initial == REST:
        return REST
    forgets = core.kind.is_operator and settling >= FORGOTTEN and len(core.forgetting) == 1
    if forgets or not core.has_states:
        return LASTING
    return ESTIMATE if initial == ESTIMATE or not core.at_rest(record) else REST


def check_rows(record: Record, n_parameters: int, grid: ModelGrid, settling: float) -> None:
    """Refuse data too short for the parameters and the noise model."""
    criterion = Criterion(record, RemnantModel(np.zeros(AR_ORDER), np.ones(record.n_runs)))
    if criterion.n > 0 and criterion.known.sum() > n_parameters:
        return
    counting = (max(AR_ORDER, n_parameters) + 1) * criterion.thin
    # Settling takes a quarter of a run at most.
    needed = min(counting + round(settling / grid.dt), -(-4 * counting // 3))
    seconds = needed * grid.dt
    raise ShortRunError(
        f"{record.known.sum()} rows are left for {n_parameters} parameters and the remnant model "
        f"(n_samples = {grid.layout.n_rows} rows of X; settling, missing "
        f"values and a run-in take the rest). They need a run of {round(seconds / grid.layout.dt)} "
        f"rows ({seconds:.3g} s) without a gap.",
        hint="Use more data, a shorter settling, or an ARX model, which needs less.",
        options=[("core", "arx")],
    )


def check_moving(record: Record, values: np.ndarray, name: str, output: str) -> None:
    """Refuse an input or an output that does not move."""
    assert record.y is not None
    found = bad_output(output, record.y[record.known])
    if found is None:
        found = still(f"Input {name!r}", values[~np.isnan(values)])
        if found is not None:
            found += ": it excites nothing. Use data in which it moves; is it the right column?"
    if found is not None:
        raise RankDeficiencyError(f"The parameters cannot be estimated. {found}")


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
    weights: np.ndarray | None = None,
    settling: float = 0.0,
    controlled_element: LinearElement | None = None,
) -> tuple[Record, SegmentColumns]:
    """Put the rows of a grid side by side."""
    columns = SegmentColumns.of(grid)
    known = mark_measured(grid, columns, output)
    channels, roles = _read_channels(columns, names, values, dict(roles))
    y = None
    if output is not None:
        y = np.nan_to_num(columns.beside(output, dtype=np.float64), copy=False)
        for j, (a, b) in enumerate(zip(columns.begin, columns.end, strict=True)):
            known[: min(round(settling / grid.dt), (b - a) // 4), j] = False
    beside = None
    if weights is not None and known.any():
        beside = columns.beside(weights)
        beside = beside / beside[known].mean()
    record = Record(
        dt=grid.dt,
        t=_read_times(columns, grid),
        channels=channels,
        roles=roles,
        inputs=tuple(inputs),
        known=known,
        y=y,
        weights=beside,
        controlled_element=controlled_element,
    )
    return record, columns


def _read_channels(
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


def _read_times(columns: SegmentColumns, grid: ModelGrid) -> np.ndarray:
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


def mark_measured(
    grid: ModelGrid, columns: SegmentColumns, output: np.ndarray | None
) -> np.ndarray:
    """Samples (length, n_columns) outside run-ins in which the output is a number."""
    rows = np.ones(int(columns.end[-1]), dtype=bool) if output is None else ~np.isnan(output)
    for begin, end in zip(grid.begin[~grid.measured], grid.end[~grid.measured], strict=True):
        rows[begin:end] = False
    return columns.beside(rows, fill=False)
