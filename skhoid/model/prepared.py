"""Data for a model with effects, read and checked: errors for data that cannot determine it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..effects.record import Record
from ..exceptions import RankDeficiencyError, ShortRunError
from ..human.controlled_element import simplest
from ..preprocessing.grid import ModelGrid
from ..regression import DataToFit, bad_output, still
from ..runs import run_column
from ..runs.roles import EXACT, roles_of
from .cores import Core
from .element import estimate_element
from .element_timing import given_element
from .fitting import AR_ORDER, Criterion, RemnantModel
from .initial import ESTIMATE, FORGOTTEN, HELD, REST
from .model import Model
from .side_by_side import SegmentColumns, build_record, measured
from .some_runs import record_of_some


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
    need them. ``measured`` are the samples of the record with a measured output, including the
    settling time; ``known`` are the corresponding rows of X.
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


def prepared_for(estimator: Any, data: DataToFit) -> Prepared:
    """Data as a record for the core of an estimator, on which it sets the controlled element."""
    grid, _, output, thinned, values, known = data
    if estimator._takes_first and estimator.inputs is None and len(estimator._columns) > 1:
        # None has the role e.
        estimator._columns, estimator.inputs_ = estimator._columns[:1], estimator.inputs_[:1]
    if len(estimator._columns) != 1:
        raise ValueError(
            f"{type(estimator).__name__} with effects responds to one channel, but got inputs="
            f'{estimator.inputs_}. Name it by inputs=["..."]; effects may use the other columns.'
        )
    columns = estimator._names or list(range(values.shape[1]))
    skipped = None if estimator._run is None else run_column(columns, estimator._run)
    channels = [i for i in range(values.shape[1]) if i != skipped]
    names = estimator._channel_names(channels)
    found = roles_of([columns[i] for i in channels], estimator.roles)
    roles = dict(zip(names, found.values(), strict=True))
    error, output_name = estimator.inputs_[0], estimator._output_name
    roles[error] = "e"
    held = estimator._hold(grid, thinned, channels, names)
    given = estimator.controlled_element
    record, sides = build_record(
        grid,
        names,
        held,
        roles,
        estimator.inputs_,
        output=output,
        settling=estimator.settling,
    )
    if given is not None:
        some = record_of_some(record) or record
        record = replace(record, controlled_element=given_element(given, some))
    spec = estimator._simulated_core()
    if spec.check is not None:
        spec.check(grid)
    record = spec.core.on(record)
    initial = getattr(estimator, "initial", None)
    record = replace(record, initial=beginning(spec.core, record, initial, estimator.settling))
    check_rows(record, len(spec.core.parameters), grid, estimator.settling)
    check_moving(record, thinned[:, estimator._columns[0]], error, output_name)
    if given is None:
        some = record_of_some(record) or record
        record = replace(record, controlled_element=estimate_element(some))
    element = record.controlled_element
    estimator.controlled_element_ = None if element is None else simplest(element)
    units = estimator._units
    return Prepared(
        spec=spec,
        record=record,
        columns=sides,
        grid=grid,
        table=values,
        names=columns,
        channels=channels,
        roles=roles,
        units={"u": units.get(output_name), "e": units.get(error)}
        | {f"[{role}]": units.get(name) for name, role in roles.items() if role in EXACT}
        | {f"[{name}]": unit for name, unit in units.items()},
        n_missing=int(np.isnan(output).sum()),
        measured=measured(grid, sides, output),
        known=known,
    )


def beginning(core: Core, record: Record, initial: str | None, settling: float) -> str:
    """How the simulations of a fit begin, according to the user's choice."""
    if initial == REST or not getattr(core, "has_states", False):
        return REST
    if core.kind.is_operator and settling >= FORGOTTEN:
        return REST if initial is None else HELD
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
        f"rows ({seconds:.3g} s) without a gap. Use more data, or a shorter settling."
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
