"""From named columns of files to X and y: roles, labels, clock and units, once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import UsageError
from ..runs import RUN, TIME, run_index
from .files import FileTable, as_numbers, is_plain_clock, read_clock, shown, split_header


@dataclass(frozen=True)
class Channel:
    asked: str
    name: str
    renamed: bool = False


def wanted_channels(spec: Any, argument: str) -> list[Channel]:
    items: list[tuple[Any, Any]]
    if isinstance(spec, str):
        items = [(spec, split_header(spec)[0])]
    elif isinstance(spec, Mapping):
        items = list(spec.items())
    elif isinstance(spec, Iterable) and argument == "inputs":
        items = [(name, split_header(name)[0] if isinstance(name, str) else name) for name in spec]
    else:
        items = [(spec, spec)]
    for item in items:
        if not all(isinstance(name, str) for name in item):
            raise TypeError(f"{argument} must name channels by strings; got {spec!r}.")
    if not items:
        raise ValueError(f"{argument} is empty: name at least one channel.")
    if argument == "output" and len(items) > 1:
        raise ValueError(f"output must name one channel; got {spec!r}.")
    return [Channel(*item, renamed=isinstance(spec, Mapping)) for item in items]


def by_field(channels: list[Channel]) -> list[Channel]:
    """Fields of structs under their own names, for guessing roles, where these are unique."""
    fields = [channel.name.rpartition(".")[2] for channel in channels]
    return [
        replace(channel, name=field)
        if not channel.renamed and fields.count(field) == 1
        else channel
        for channel, field in zip(channels, fields, strict=True)
    ]


def check_names(channels: list[Channel]) -> None:
    names = [channel.name for channel in channels]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(
            f"The channel {twice!r} is named more than once among inputs and output "
            f"({names}). Name it once, or rename with a dict {{name in the file: channel}}."
        )


def checked_clock(time: str | None, dt: float | None) -> str | float:
    if time is not None and dt is not None:
        raise ValueError(f"Give the time column ({time!r}) or dt ({dt!r}), not both.")
    if time is not None:
        return time
    if dt is None:
        raise UsageError(
            "There is no clock: name the time column, or, if the files have none, give the "
            "sampling time in seconds.",
            hint="Give time='t' or dt=0.01.",
            options=["time", "dt"],
        )
    return float(dt)


def checked_units(
    units: Mapping[str, str], channels: list[Channel], time: str | None
) -> dict[str, str]:
    """Return the given units by channel name, those of the time under ``"time"``."""
    keys = {"time": "time"}
    if time is not None:
        keys |= {time: "time", split_header(time)[0]: "time"}
    for channel in channels:
        keys |= {channel.asked: channel.name, split_header(channel.asked)[0]: channel.name}
    keys |= {channel.name: channel.name for channel in channels}
    unknown = [key for key in units if key not in keys]
    if unknown:
        raise ValueError(
            f"units has {unknown[0]!r}, which is not one of the channels, {list(keys)}."
        )
    return {keys[key]: unit for key, unit in units.items()}


Coded = tuple[np.ndarray, list[Any]]  # which label each row has, and the labels


def combined_labels(
    table: FileTable,
    run: str | None,
    labels: Any,
    levels: list[str],
    time: np.ndarray,
    n_rows: int,
) -> Coded | None:
    """Labels of runs with those of the outer levels, as tuples; None where there is one run."""
    if run is None:
        labels = find_restarts(time)
        if labels is None and not levels:
            return None
        labels = labels or (np.zeros(n_rows, dtype=np.int32), [1])
    parts = []
    for name in levels:
        coded = table.load([], table.find(name))[1]
        assert coded is not None
        parts.append(plain_labels(coded, table.where(name)))
    parts.append(plain_labels(labels, table.where(run) if run else "time"))
    for part, _ in parts:
        if part.size != n_rows:
            raise ValueError(
                f"In {table.path} the run labels have {part.size} rows, but the channels have "
                f"{n_rows}."
            )
    if not levels:
        return parts[-1]
    return _tuples(parts)


def _tuples(parts: list[Coded]) -> Coded:
    codes, n_rows = parts[0][0].astype(np.int64), parts[0][0].size
    for part, names in parts[1:]:
        codes = codes * len(names) + part
    inner, names = parts[-1]
    for of_run in (codes, inner):
        starts = np.append(0, np.flatnonzero(np.diff(of_run)) + 1)
        if np.unique(of_run[starts]).size == starts.size:
            break  # a level that varies within runs: its first label counts
    labels = [tuple(known[part[row]] for part, known in parts) for row in starts.tolist()]
    places = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    each = np.array([places[label] for label in labels], dtype=np.int32)
    return np.repeat(each, np.diff(starts, append=n_rows)), list(places)


def find_restarts(time: np.ndarray) -> tuple[np.ndarray, list[Any]] | None:
    """Runs that begin where time returns to its first value; None where it never does."""
    if time.size < 3:
        return None
    step = np.diff(time)
    falls = np.flatnonzero(step < 0) + 1
    if not falls.size:
        return None
    slack = 2.0 * float(np.nanmedian(np.abs(step)))
    if np.any(np.abs(time[falls] - time[0]) > slack):
        return None
    codes = np.zeros(time.size, dtype=np.int32)
    codes[falls] = 1
    return np.cumsum(codes).astype(np.int32), list(range(1, falls.size + 2))


def plain_labels(coded: tuple[np.ndarray, list[Any]], where: str) -> tuple[np.ndarray, list[Any]]:
    """Labels in the form in which they are compared, and which of them each row has."""
    codes, found = coded
    known: dict[Any, int] = {}
    missing = [-1]
    places = []
    for place, label in enumerate(found):
        if isinstance(label, tuple):
            pass
        elif pd.isna(label) or label == "":
            missing.append(place)
        elif isinstance(label, str):
            label = label.strip()
        # MATLAB numbers are floats: a run 1 there is the run 1 of a CSV file.
        elif isinstance(label, float) and label.is_integer():
            label = int(label)
        places.append(known.setdefault(label, len(known)))
    if len(missing) > 1 or codes.min(initial=0) < 0:
        row = int(np.flatnonzero(np.isin(codes, missing))[0])
        raise ValueError(f"{where} has no run label in row {row + 1}.")
    return np.array(places, dtype=np.int32)[codes], list(known)


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


def cut_runs(
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
    if isinstance(clock, str) and np.size(raw[-1]) and not is_plain_clock(raw[-1]):
        raw[-1], time_unit = read_clock(raw[-1]), "s"
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
        per_second = count_per_second(table, clock, time_unit)
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


def count_per_second(table: FileTable, time: str, stated: str | None) -> float:
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


def gather_units(
    table: FileTable,
    channels: list[Channel],
    given: dict[str, str],
    known: dict[str, tuple[str, Path]],
) -> None:
    """Add the units of a file to those that are known; files that differ are refused."""
    for channel in channels:
        unit = given.get(channel.name) or table.unit_of(table.find(channel.asked))
        if not unit:
            continue
        other, path = known.setdefault(channel.name, (unit, table.path))
        if other != unit:
            raise UsageError(
                f"The unit of channel {channel.name!r} is {other!r} in {path} and {unit!r} in "
                f"{table.path}: convert one file, or state the unit.",
                hint="State it in units=.",
                options=["unit"],
            )


def assemble(
    pieces: list[FileRuns],
    names: list[str],
    known: dict[str, tuple[str, Path]],
    levels: list[str] | None = None,
    *,
    every_level: bool = False,
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y; of ``levels`` outside the run, those of one label are left out unless told."""
    for piece in pieces:
        _check_instants(piece)
    labels = [label for piece in pieces for label in piece.labels]
    lengths = np.concatenate([piece.lengths for piece in pieces])
    time = np.concatenate([piece.time for piece in pieces])
    index = _index(labels, lengths, time, levels, every_level)
    *inputs, output = (
        np.concatenate([piece.channels[k] for piece in pieces]) for k in range(len(names))
    )
    X = pd.DataFrame(dict(zip(names[:-1], inputs, strict=True)), index)
    y = pd.Series(output, index, name=names[-1])
    units = {name: unit for name, (unit, _) in known.items()}
    X.attrs["units"] = {name: units[name] for name in names[:-1] if name in units}
    y.attrs["units"] = {name: units[name] for name in names[-1:] if name in units}
    return X, y


def _index(
    labels: list[Any],
    lengths: np.ndarray,
    time: np.ndarray,
    levels: list[str] | None,
    every_level: bool,
) -> pd.MultiIndex:
    """The row index, with those of the outer levels that have more than one label, or all."""
    if not levels:
        return run_index(labels, lengths, time)
    columns = zip(*labels, strict=True)
    # In the order of the rows, which is then a sorted one to pandas.
    parts = [pd.Categorical(c, list(dict.fromkeys(c)) if every_level else None) for c in columns]
    named = [
        (part, name)
        for part, name in zip(parts, [*levels, RUN], strict=True)
        if every_level or len(part.categories) > 1 or name == RUN
    ]
    arrays = [part.take(np.repeat(np.arange(len(labels)), lengths)) for part, _ in named]
    return pd.MultiIndex.from_arrays([*arrays, time], names=[*(name for _, name in named), TIME])


def _check_instants(piece: FileRuns) -> None:
    missing = np.flatnonzero(np.isnan(piece.time))
    if missing.size:
        stops = np.cumsum(piece.lengths)
        k = int(np.searchsorted(stops, missing[0], side="right"))
        row = int(missing[0] - stops[k] + piece.lengths[k])
        raise ValueError(
            f"The time of run {piece.labels[k]!r} in {piece.path} is missing in its row "
            f"{row + 1}: every sample needs a time. If the whole row is empty, delete it: lags "
            "restart after a gap."
        )
