"""Cut the columns of one file into runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ._table import FileTable, as_numbers

__all__ = ["Run", "runs_of"]

_PER_SECOND = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "ms": 1e3,
    "us": 1e6,
    "µs": 1e6,  # micro sign
    "μs": 1e6,  # Greek mu
}


@dataclass(frozen=True)
class Run:
    """The samples of one run: time (s), and samples with one column per channel."""

    label: Any
    path: Path
    time: np.ndarray
    samples: np.ndarray


def runs_of(
    table: FileTable,
    asked: list[str],
    *,
    clock: str | float,
    time_unit: str | None,
    run: str | None,
) -> list[Run]:
    """Take the asked columns out of a table and cut them into runs.

    ``clock`` is the name of the time column, or the sampling time in seconds.
    """
    columns = {name: _column(table, name) for name in asked}
    widths = {name: values.shape[1] for name, values in columns.items()}
    n_runs = max(widths.values())
    if set(widths.values()) != {n_runs}:
        raise ValueError(
            f"In {table.path} the {table.kind}s have different numbers of columns, {widths}: "
            "either each is one vector (one run), or each has one column per run."
        )
    lengths = {name: len(values) for name, values in columns.items()}
    if isinstance(clock, str):
        time: np.ndarray = _column(table, clock) / _per_second(table, clock, time_unit)
        if time.shape[1] not in (1, n_runs):
            raise ValueError(
                f"{table.where(clock)} has {time.shape[1]} columns, the channels have {n_runs}: "
                "give one time vector for all runs or one column per run."
            )
        lengths[clock] = len(time)
    else:
        time = (np.arange(lengths[asked[0]]) * clock)[:, None]
    _check_lengths(table, lengths)
    samples = np.stack([columns[name] for name in asked], axis=-1)
    if run is None:
        stem = table.path.stem
        labels = [stem] if n_runs == 1 else [f"{stem}-{k + 1}" for k in range(n_runs)]
        return [
            Run(label, table.path, time[:, k % time.shape[1]], samples[:, k])
            for k, label in enumerate(labels)
        ]
    if n_runs > 1:
        raise ValueError(
            f"In {table.path} the columns of each {table.kind} are runs ({n_runs}), so run="
            f"{run!r} has no meaning: leave run=None."
        )
    return _split_runs(table, run, time[:, 0], samples[:, 0], restart=not isinstance(clock, str))


def _column(table: FileTable, asked: str) -> np.ndarray:
    """Return the samples of a column as (n_rows, n_runs)."""
    position = table.find(asked)
    raw = table.load(position)
    where = table.where(table.names[position])
    shape = np.shape(raw)
    if len(shape) > 2:
        raise ValueError(f"{where} has the shape {shape}: give one column per run, (N, M).")
    values = as_numbers(raw, where)
    if values.size == 0:
        raise ValueError(f"{where} has no samples.")
    if len(shape) < 2 or 1 in shape:
        return values.reshape(-1, 1)
    return values.reshape(shape)


def _per_second(table: FileTable, time: str, stated: str | None) -> float:
    unit = stated or table.unit_of(table.find(time)) or "s"
    if unit not in _PER_SECOND:
        raise ValueError(
            f"The unit {unit!r} of the time, {table.where(time)}, is not one of "
            f"{', '.join(_PER_SECOND)}: say which with units={{'time': ...}}."
        )
    return _PER_SECOND[unit]


def _check_lengths(table: FileTable, lengths: dict[str, int]) -> None:
    if len(set(lengths.values())) > 1:
        raise ValueError(
            f"In {table.path} the {table.kind}s differ in length, {lengths}: all need one value "
            "per sample. A matrix has one column per run, so it may be transposed."
        )


def _split_runs(
    table: FileTable, run: str, time: np.ndarray, samples: np.ndarray, restart: bool
) -> list[Run]:
    position = table.find(run)
    where = table.where(table.names[position])
    labels = [_label(label, where, k) for k, label in enumerate(_flat(table.load(position)))]
    _check_lengths(table, {run: len(labels), "the channels": len(samples)})
    starts = [k for k in range(len(labels)) if k == 0 or labels[k] != labels[k - 1]]
    seen: dict[Any, int] = {}
    for start in starts:
        label = labels[start]
        if label in seen:
            raise ValueError(
                f"The rows of run {label!r} in {where} are not contiguous: it begins at row "
                f"{seen[label] + 1}, another run follows, and it comes back at row {start + 1}. "
                "Sort the file by run and time, or give every run its own label."
            )
        seen[label] = start
    pieces = []
    for start, stop in zip(starts, [*starts[1:], len(labels)], strict=True):
        # Without a time column, every run starts at 0.
        instants = time[: stop - start] if restart else time[start:stop]
        pieces.append(Run(labels[start], table.path, instants, samples[start:stop]))
    return pieces


def _flat(labels: Any) -> list[Any]:
    return labels.tolist() if isinstance(labels, pd.Series) else np.ravel(labels).tolist()


def _label(label: Any, where: str, row: int) -> Any:
    if pd.isna(label) or label == "":
        raise ValueError(f"{where} has no run label in row {row + 1}.")
    # MATLAB numbers are floats: a run 1 there is the run 1 of a CSV file.
    if isinstance(label, float) and label.is_integer():
        return int(label)
    return label.strip() if isinstance(label, str) else label
