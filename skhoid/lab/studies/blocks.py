"""Blocks of a study: a worker simulates their data sets and calls the study's function."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ... import CompensatoryTask
from ...simulation import RunOptions, TrackingRecord, frames_of, simulate, truth_of
from .store import uniform

OWN = 5  # spawn key of a function's own random numbers; the simulator's are 0 to 3
VALIDATION = 4  # and of validation runs
REPLICATION, ERROR, SEED = "replication", "error", "seed"


@dataclass(frozen=True, eq=False)
class DataSet:
    """One simulated data set of a study.

    Parameters
    ----------
    record : TrackingRecord
        Signals of its runs.
    task : CompensatoryTask
        What was simulated, with the gain of the remnant.
    replication : int
        Its number in the cell.
    seed : tuple of int
        Entropy of the cell, and the replication.
    channels : tuple of str
        Columns of ``X``.
    validation : DataSet or None
        The cell's validation runs, shared by all of its replications.

    Attributes
    ----------
    X : DataFrame of shape (n_runs * n_samples, n_channels)
        As of :func:`skhoid.make_tracking_runs`.
    y : Series of shape (n_runs * n_samples,)
        Control output.
    truth : Bunch
        The truth behind the runs.
    random_state : int
        A seed of its own, for functions that draw random numbers.
    """

    record: TrackingRecord
    task: CompensatoryTask
    replication: int
    seed: tuple[int, ...]
    channels: tuple[str, ...] = ("e",)
    validation: DataSet | None = None

    @cached_property
    def _frames(self) -> tuple[pd.DataFrame, pd.Series]:
        return frames_of(self.record, self.channels)

    @property
    def X(self) -> pd.DataFrame:
        return self._frames[0]

    @property
    def y(self) -> pd.Series:
        return self._frames[1]

    @cached_property
    def truth(self) -> Any:
        return truth_of(self.task, self.record)

    @property
    def random_state(self) -> int:
        sequence = np.random.SeedSequence(self.seed[0], spawn_key=(OWN, *self.seed[1:]))
        return int(sequence.generate_state(1)[0])


@dataclass(frozen=True, eq=False)
class Block:
    """Replications of one cell that are simulated together, for functions with ``batched=True``.

    Parameters
    ----------
    record : TrackingRecord
        Signals of the runs of all replications, one after another.
    task : CompensatoryTask
        What was simulated, with the gain of the remnant.
    replications : range
        Their numbers in the cell.
    entropy : int
        Entropy of the cell.
    n_runs : int
        Number of runs of each replication.
    channels : tuple of str
        Columns of ``X`` of its data sets.
    validation : TrackingRecord or None
        The cell's validation runs.
    """

    record: TrackingRecord
    task: CompensatoryTask
    replications: range
    entropy: int
    n_runs: int
    channels: tuple[str, ...]
    validation: TrackingRecord | None

    def data_sets(self) -> Iterable[DataSet]:
        """Its data sets, one at a time."""
        validation = None
        if self.validation is not None:
            seed = (self.entropy, VALIDATION)
            validation = DataSet(self.validation, self.task, -1, seed, self.channels)
        for i, replication in enumerate(self.replications):
            rows = slice(i * self.n_runs, (i + 1) * self.n_runs)
            yield DataSet(
                _rows(self.record, rows),
                self.task,
                replication,
                (self.entropy, replication),
                self.channels,
                validation,
            )


def _rows(record: TrackingRecord, rows: slice) -> TrackingRecord:
    part = {name: getattr(record, name)[rows] for name in ("e", "u", "x", "n")}
    for name in ("f_t", "f_d"):
        signal = getattr(record, name)
        part[name] = signal if len(signal) == 1 else signal[rows]
    return replace(record, **part)


@dataclass(frozen=True, eq=False)
class Job:
    """What a worker needs to compute one block."""

    function: Callable[..., Any]
    batched: bool
    labels: Mapping[str, Any]
    task: CompensatoryTask | str
    simulation: Mapping[str, Any]
    settings: Mapping[str, Any]
    entropy: int
    replications: range
    n_runs: int
    n_validation: int
    channels: tuple[str, ...]

    def __str__(self) -> str:
        cell = ", ".join(f"{name}={value}" for name, value in self.labels.items())
        return f"replications {self.replications[0]} to {self.replications[-1]} of {cell}"

    def block(self, replications: range) -> Block:
        """Simulate some of the replications."""
        assert isinstance(self.task, CompensatoryTask)
        n_runs, validation = self.n_runs, None
        if self.n_validation:
            apart = np.random.SeedSequence(self.entropy, spawn_key=(VALIDATION,))
            seed = int.from_bytes(apart.generate_state(4).tobytes(), "little")
            options = RunOptions(random_state=seed, **self.simulation)
            validation = simulate(self.task, self.n_validation, options)
        options = RunOptions(
            random_state=self.entropy, first_run=replications.start * n_runs, **self.simulation
        )
        record = simulate(self.task, len(replications) * n_runs, options)
        return Block(
            record, self.task, replications, self.entropy, n_runs, self.channels, validation
        )


def compute(job: Job) -> pd.DataFrame:
    """Rows of one block."""
    tables = [table for table in _tables(job, job.replications) if len(table)]
    table = joined(tables or [pd.DataFrame({REPLICATION: np.zeros(0, dtype=np.int64)})])
    for name, value in reversed(list(job.labels.items())):
        table.insert(0, name, value)
    return uniform(table)


def joined(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate tables; errors and seeds are the last columns."""
    table = pd.concat(tables, ignore_index=True)
    last = {name: table.pop(name) if name in table else None for name in (ERROR, SEED)}
    return table.assign(**last)


def _tables(job: Job, replications: range) -> list[pd.DataFrame]:
    if isinstance(job.task, str):  # why there is no task
        return [_failure(job, replication, job.task) for replication in replications]
    try:
        block = job.block(replications)
        if job.batched:
            return [_of_batch(job, job.function(block, **job.settings), replications)]
    except MemoryError:
        raise
    except Exception as error:
        if len(replications) == 1:
            return [_failure(job, replications[0], error)]
        # To find the culprit, try each half on its own.
        middle = len(replications) // 2
        return [*_tables(job, replications[:middle]), *_tables(job, replications[middle:])]
    return [_of_one(job, data) for data in block.data_sets()]


def _of_one(job: Job, data: DataSet) -> pd.DataFrame:
    try:
        table = _as_table(job.function(data, **job.settings))
        _check_names(table, {*job.labels, REPLICATION, ERROR, SEED})
    except MemoryError:
        raise
    except Exception as error:
        return _failure(job, data.replication, error)
    table.insert(0, REPLICATION, data.replication)
    return table


def _of_batch(job: Job, found: Any, replications: range) -> pd.DataFrame:
    table = _as_table(found)
    _check_names(table, {*job.labels, ERROR, SEED})
    if REPLICATION not in table:
        raise ValueError(
            f"A batched function must return a table with a column 'replication' "
            f"(block.replications); its columns are {list(table.columns)}."
        )
    if set(table[REPLICATION]) - set(replications):
        raise ValueError("A batched function returned rows for replications of other blocks.")
    table.insert(0, REPLICATION, table.pop(REPLICATION))
    return table


def _check_names(table: pd.DataFrame, taken: set[str]) -> None:
    """Refuse columns of results that the study itself has, and those it cannot keep."""
    for name in table.columns:
        if name in taken:
            raise ValueError(
                f"The function returned {name!r}, which is a column of the study (its cells, "
                "replication, error, seed): give it another name."
            )
        column = table[name]
        kept = column.dtype.kind != "c"
        if column.dtype == object:
            kept = all(np.ndim(value) == 0 and not np.iscomplexobj(value) for value in column)
        if not kept:
            raise TypeError(
                f"The function returned {name!r} with complex numbers, arrays or lists in it: "
                "put their parts or elements into columns of their own."
            )


def _as_table(found: Any) -> pd.DataFrame:
    """The rows that a function returned."""
    if isinstance(found, pd.DataFrame):
        table = found.reset_index(drop=True)
    elif isinstance(found, Mapping):
        scalar = all(np.ndim(value) == 0 for value in found.values())
        table = pd.DataFrame([dict(found)] if scalar else dict(found))
    elif np.ndim(found) == 0 and isinstance(found, (bool, float, int, np.ndarray, np.generic)):
        table = pd.DataFrame({"value": [np.asarray(found).item()]})
    elif isinstance(found, (list, tuple)) and all(isinstance(row, Mapping) for row in found):
        table = pd.DataFrame(list(found))
    else:
        raise TypeError(
            f"The function of a study must return a number, a dict (one row), a list of dicts or "
            f"a DataFrame (several rows); got {type(found).__name__}."
        )
    table.columns = [str(name) for name in table.columns]
    return table


def _failure(job: Job, replication: int, error: Exception | str) -> pd.DataFrame:
    text = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
    seed = f"{job.entropy}/{replication}"
    return pd.DataFrame({REPLICATION: [replication], ERROR: [text], SEED: [seed]})
