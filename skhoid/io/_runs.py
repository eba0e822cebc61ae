"""Cut the columns of one file into runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..exceptions import UsageError
from ..runs import RUN
from ._labels import combined_labels, plain_labels
from ._paths import shown
from ._table import FileTable, as_numbers, split_header

__all__ = ["FileRuns", "runs_of"]

_PER_SECOND = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "ms": 1e3,
    "us": 1e6,
    "ns": 1e9,
    "µs": 1e6,  # micro sign
    "μs": 1e6,  # Greek mu
}


@dataclass(frozen=True)
class FileRuns:
    """The runs of one file, one after another.

    ``labels`` and ``lengths`` have one entry for each run; ``time`` (s) and each of the
    ``channels`` one for each row of them all.
    """

    path: Path
    labels: list[Any]
    lengths: np.ndarray
    time: np.ndarray
    channels: list[np.ndarray]


def runs_of(
    table: FileTable,
    asked: list[str],
    *,
    clock: str | float,
    time_unit: str | None,
    run: str | None,
    levels: Sequence[str] | None = None,
) -> FileRuns:
    """Take the requested columns from a table and cut them into runs.

    ``clock`` is the name of the time column, or the sampling time in seconds. ``levels`` are outer
    columns, such as the subject, whose labels come first in the tuple that labels a run; if they
    are given, runs also begin where time restarts and no column says so.
    """
    names = [*asked, clock] if isinstance(clock, str) else asked
    positions = [table.find(name) for name in names]
    if table.faults:
        raise ValueError(f"In {table.path} {table.faults[0]}")
    run = table.run_name if run is None else run
    by = _run_column(table, positions) if run is None else table.find(run)
    raw, labels = table.load(positions, by)
    found = [_matrix(table, at, raw.pop(0)) for at in positions]
    columns = dict(zip(asked, found, strict=False))
    widths = {name: values.shape[1] for name, values in columns.items()}
    n_runs = max(widths.values())
    if set(widths.values()) != {n_runs}:
        raise ValueError(
            f"In {table.path} the {table.kind}s have different numbers of columns, {widths}: "
            "each must be one vector (one run), or each must have one column per run."
        )
    lengths = {name: len(values) for name, values in columns.items()}
    n_rows = lengths[asked[0]]
    if isinstance(clock, str):
        per_second = per_second_of(table, clock, time_unit)
        time = found[-1] if per_second == 1 else found[-1] / per_second
        if time.shape[1] not in (1, n_runs):
            raise ValueError(
                f"{table.where(clock)} has {time.shape[1]} columns, but the channels have "
                f"{n_runs}: give one time vector for all runs or one column per run."
            )
        lengths[clock] = len(time)
    else:
        time = (np.arange(n_rows) * clock)[:, None]
    _check_lengths(table, lengths)
    channels = [values.reshape(-1, order="F") for values in found[: len(asked)]]
    if levels is not None and n_runs == 1:
        labels = combined_labels(table, run, labels, list(levels), time[:, 0], n_rows)
        run = run or (levels[-1] if levels else table.names[positions[0]])
        if labels is not None:
            restart = not isinstance(clock, str)
            return _split(table, run, labels, time[:, 0], channels, restart=restart)
        run = None
    if labels is None or run is None:
        if labels is not None:
            _check_one_run(table, labels)
        stem = shown(table.path.stem)
        names = [stem] if n_runs == 1 else [f"{stem}-{k + 1}" for k in range(n_runs)]
        each = (
            np.tile(time[:, 0], n_runs) if time.shape[1] < n_runs else time.reshape(-1, order="F")
        )
        return FileRuns(table.path, names, np.full(n_runs, n_rows), each, channels)
    if n_runs > 1:
        raise ValueError(
            f"In {table.path} the columns of each {table.kind} are runs ({n_runs}), so run="
            f"{run!r} has no meaning: leave run=None."
        )
    return _split(table, run, labels, time[:, 0], channels, restart=not isinstance(clock, str))


def _run_column(table: FileTable, asked: list[int]) -> int | None:
    """The column whose name suggests run labels, where none was given."""
    if table.kind != "column":
        return None
    names = [split_header(name)[0].casefold() for name in table.names]
    found = [position for position, name in enumerate(names) if name == RUN]
    return found[0] if len(found) == 1 and found[0] not in asked else None


def _check_one_run(table: FileTable, labels: tuple[np.ndarray, list[Any]]) -> None:
    """Refuse to take several runs in a file for one."""
    n_labels = len(labels[1])
    if n_labels > 1:
        position = _run_column(table, [])
        assert position is not None
        name = table.names[position]
        raise UsageError(
            f"{table.where(name)} has {n_labels} labels, but no column of run labels is given: "
            "all rows would be one run, with lags across its parts. If it does not label runs, "
            "give it another name in the file.",
            hint=f"Give run={name!r}.",
            options=[("run", name)],
        )


def _matrix(table: FileTable, position: int, raw: Any) -> np.ndarray:
    """Return the samples of a column as an array of shape (n_rows, n_runs)."""
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


def per_second_of(table: FileTable, time: str, stated: str | None) -> float:
    """Number of units of the clock per second."""
    unit = stated or table.unit_of(table.find(time)) or "s"
    if unit not in _PER_SECOND:
        raise UsageError(
            f"The unit {unit!r} of the time, {table.where(time)}, is not one of "
            f"{', '.join(_PER_SECOND)}.",
            hint="State it with units={'time': ...}.",
            options=["unit"],
        )
    return _PER_SECOND[unit]


def _check_lengths(table: FileTable, lengths: dict[str, int]) -> None:
    if len(set(lengths.values())) > 1:
        raise ValueError(
            f"In {table.path} the {table.kind}s differ in length, {lengths}: all need one value "
            "per sample. A matrix must have one column per run: is it transposed?"
        )


def _split(
    table: FileTable,
    run: str,
    coded: tuple[np.ndarray, list[Any]],
    time: np.ndarray,
    channels: list[np.ndarray],
    restart: bool,
) -> FileRuns:
    where = table.where(table.names[table.find(run)])
    codes, labels = plain_labels(coded, where)
    _check_lengths(table, {run: len(codes), "the channels": len(channels[0])})
    starts = np.append(0, np.flatnonzero(codes[1:] != codes[:-1]) + 1)
    order = codes[starts].tolist()
    seen: dict[int, int] = {}
    for start, code in zip(starts.tolist(), order, strict=True):
        if code in seen:
            raise ValueError(
                f"The rows of run {labels[code]!r} in {where} are not contiguous: the run begins "
                f"at row {seen[code] + 1} and resumes at row {start + 1}, after another run. "
                "Sort the file by run and time, or give every run its own label."
            )
        seen[code] = start
    lengths = np.diff(starts, append=len(codes))
    if restart:  # without a time column, every run starts at 0
        time = np.concatenate([time[:length] for length in lengths])
    return FileRuns(table.path, [labels[code] for code in order], lengths, time, channels)
