"""Several files of one run: one signal a file, joined by their clock or by their rows."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..runs.roles import names_time
from ..runs.tables import advances_evenly
from .archives import grid_of, stream
from .files import FileTable, numbers_of, one_by_one, read_clock, split_header

_ROWS_LOOKED_AT = 1000
_LEAST = 20  # rows
_OFTEN = 0.05  # share of the rows in which a signal that counts has a value
_APART = 0.1  # of the rows of one topic, at most, have values of another
_DIGITS = re.compile(r"\d+")


@dataclass(frozen=True)
class _Signals:
    """One file: the positions of its signals, and of its clock."""

    table: FileTable
    at: tuple[int, ...]
    clock: int | None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.table.names[k] for k in self.at)


def are_parts(first: FileTable, second: FileTable) -> bool:
    """Whether two files may hold signals of one run: one signal each, or none in common."""
    one, other = _look(first), _look(second)
    return len(one.at) == len(other.at) == 1 or bool(
        one.at and other.at and not set(one.names) & set(other.names)
    )


def on_one_clock(table: FileTable) -> FileTable:
    """A table in whose rows one topic or another has values, as exports of bags are, on one clock.

    Other tables are returned as they are.
    """
    found = _look(table)
    if table.kind != "column" or found.clock is None or len(found.at) < 2:
        return table
    peeked = table.peek(_ROWS_LOOKED_AT)
    there = np.array([np.isfinite(numbers_of(peeked[k])) for k in found.at], dtype=float)
    often = there.mean(axis=1) > _OFTEN
    shares = there[often].mean(axis=1)
    together = there[often] @ there[often].T / there.shape[1]
    of_topics = (together < _APART * np.minimum.outer(shares, shares)).any(axis=1)
    if there.shape[1] < _LEAST or not of_topics.any():
        return table
    at = [k for k, kept in zip(found.at, often, strict=True) if kept]
    raw, *others = table.load([found.clock, *at], None)[0]
    clock, values = read_clock(raw), list(map(numbers_of, others))
    if not (np.diff(clock) >= 0).all():  # several runs, or no clock
        return table
    names = [table.names[k] for k in at]
    streams = [
        stream(name, clock[np.isfinite(own)], own[np.isfinite(own)])
        for name, own in zip(names, values, strict=True)
    ]
    topics = [one for one, own in zip(streams, of_topics, strict=True) if own]
    instants, start = grid_of(table.path, topics, None)
    columns = [instants, *(one.at(instants + start, 0) for one in streams)]
    said = "each row has values of one topic; they are interpolated onto the clock of the fastest"
    return replace(
        table,
        names=[table.names[found.clock], *names],
        load=one_by_one(columns.__getitem__),
        first_rows=None,
        remarks=[*table.remarks, said],
    )


def join_parts(tables: Sequence[FileTable]) -> list[FileTable] | None:
    """One table for each run; None if the files are none of single signals."""
    found = [_look(table) for table in tables]
    root = os.path.commonpath([table.path.absolute().parent for table in tables])
    words = [_words(table.path.absolute().relative_to(root).with_suffix("")) for table in tables]
    groups: dict[Any, list[_Signals]] = {}
    for one in found:
        groups.setdefault(one.names, []).append(one)
    named = len(groups) > 1
    if not named:  # the header is the same in all: names of files say which signal it is
        place = _place_of_signal(words)
        if place is None or any(len(one.at) != 1 for one in found):
            return None
        groups = {}
        for one, own in zip(found, words, strict=True):
            groups.setdefault(own[place], []).append(one)
    counts = {len(group) for group in groups.values()}
    if len(groups) < 2 or len(counts) > 1:
        return None
    runs = list(zip(*groups.values(), strict=True))
    numbers = {
        id(o): tuple(_DIGITS.findall(" ".join(w))) for o, w in zip(found, words, strict=True)
    }
    if any(len({numbers[id(one)] for one in run}) > 1 for run in runs):
        return None
    labels = list(map(str, groups)) if not named else None
    return [_joined(run, labels) for run in runs]


def _look(table: FileTable) -> _Signals:
    clock = None
    signals = []
    for k, (name, raw) in enumerate(zip(table.names, table.peek(_ROWS_LOOKED_AT), strict=True)):
        values = numbers_of(raw)
        if names_time(split_header(name)[0].rpartition(".")[2]) or (
            np.isfinite(values).all() and advances_evenly(values)
        ):
            clock = k if clock is None else clock
        elif values.size > 1:
            signals.append(k)
    return _Signals(table, tuple(signals), clock)


def _words(path: Path) -> list[str]:
    return [word for word in re.split(r"[\W_]+", str(path)) if word]


def _place_of_signal(rows: list[list[str]]) -> int | None:
    """The part of the names of files that is a word, another in each file of a run."""
    width = len(rows[0])
    if any(len(row) != width for row in rows):
        return None
    for place in reversed(range(width)):
        signals = {row[place] for row in rows}
        rest = {tuple(row[:place] + row[place + 1 :]) for row in rows}
        are_words = len(signals) > 1 and not any(map(_DIGITS.search, signals))
        if are_words and len(signals) * len(rest) == len(rows):
            return place
    return None


def _joined(parts: Sequence[_Signals], labels: list[str] | None) -> FileTable:
    """The signals of one run on one clock."""
    first = parts[0].table
    folder = first.path.parent
    stems = [_words(Path(one.table.path.stem)) for one in parts]
    common = "_".join(word for word in stems[0] if all(word in other for other in stems))
    number = "_".join(_DIGITS.findall(first.path.stem))
    path = folder / (common or number or folder.absolute().name)
    names: list[str] = []
    columns: list[Any] = []
    units: dict[str, str] = {}
    for k, one in enumerate(parts):
        loaded = one.table.load(one.at, None)[0]
        for position, values in zip(one.at, loaded, strict=True):
            name = one.table.names[position] if labels is None else labels[k]
            unit = one.table.unit_of(position)
            units |= {name: unit} if unit else {}
            names.append(name)
            columns.append(numbers_of(values))
    timed = [
        pd.Series(np.ravel(one.table.load([one.clock], None)[0][0]))
        for one in parts
        if one.clock is not None
    ]
    lengths = {len(values) for values in columns}
    listed = ", ".join(one.table.path.name for one in parts)
    how = "row by row"
    if len(timed) < len(parts) or all(timed[0].equals(clock) for clock in timed):
        if len(lengths) > 1:
            raise ValueError(
                f"{listed} of {folder} look like the signals of one run, but have "
                f"{' and '.join(map(str, sorted(lengths)))} rows and not all have a clock: add "
                "the column of the time to each."
            )
        how = "by their clock" if timed else how
    else:
        by_part = [(numbers_of(clock), one.at) for clock, one in zip(timed, parts, strict=True)]
        each = [clock for clock, at in by_part for _ in at]
        streams = [stream(*pair) for pair in zip(names, each, columns, strict=True)]
        instants, start = grid_of(folder, streams, None)
        columns = [stream.at(instants + start, 0) for stream in streams]
        timed = [pd.Series(instants)]
        how = "and interpolated onto one clock, with the step of the fastest"
    if timed:
        clock = next(one for one in parts if one.clock is not None)
        names.insert(0, clock.table.names[clock.clock])  # type: ignore[index]
        columns.insert(0, timed[0])
        unit = clock.table.unit_of(clock.clock)  # type: ignore[arg-type]
        units |= {names[0]: unit} if unit else {}
    return FileTable(
        path,
        names,
        one_by_one(columns.__getitem__),
        units=units,
        remarks=[f"{len(parts)} files are one run, joined {how}: {listed}"],
    )
