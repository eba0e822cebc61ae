"""NumPy archives, Parquet and XDF files as tables."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import UsageError
from .delimited import Block, gathered
from .files import Columns, FileTable, coded, one_by_one, read_as, require
from .matlab import first_of

_PICKLED = "holds Python objects, which are not read: save plain arrays of numbers."
_FIELDS = "has named fields: save one plain array per channel."


def read_npz(path: Path) -> FileTable:
    """Read the arrays of an NPZ file; never objects, whose loading could run code."""
    if not path.stat().st_size:
        raise ValueError(f"{path} is empty.")
    arrays: dict[str, np.ndarray] = {}
    unreadable: dict[str, str] = {}
    with read_as(path, "a NumPy archive"), np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                values = archive[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                unreadable[name] = _PICKLED
                continue
            if values.dtype.names:
                unreadable[name] = _FIELDS
            else:
                arrays[name] = values
    names = list(arrays)
    return FileTable(
        path,
        names,
        one_by_one(lambda position: arrays[names[position]]),
        unreadable=unreadable,
        kind="variable",
        peek=lambda count: [first_of(values, count) for values in arrays.values()],
    )


_ROWS = 1 << 17  # of a block


def read_parquet(path: Path) -> FileTable:
    """Read a Parquet file; the named levels of a stored row index count as columns."""
    require("pyarrow", f"Reading the Parquet file {path}")
    parquet = importlib.import_module("pyarrow.parquet")
    # PyArrow opens no files whose names are not UTF-8.
    with (
        read_as(path, "Parquet"),
        path.open("rb") as raw,
        parquet.ParquetFile(raw) as file,
    ):
        schema, n_rows = file.schema_arrow, file.metadata.num_rows
        empty = schema.empty_table().to_pandas()
        stored = empty.attrs.get("units")
        units = {str(key): str(unit) for key, unit in stored.items()} if stored else {}
        stored_index = (schema.pandas_metadata or {}).get("index_columns", [])
        regular = [level["name"] for level in stored_index if isinstance(level, dict)]
        levels = [*empty.index.names, *regular]
    names = [str(name) for name in [*levels, *empty.columns] if name is not None]

    def load(numbers: Sequence[int], labels: int | None) -> Columns:
        with (
            read_as(path, "Parquet"),
            path.open("rb") as raw,
            parquet.ParquetFile(raw) as file,
        ):
            stored = [names[position] for position in numbers]
            plain = list(dict.fromkeys(name for name in stored if _is_plain(schema, name)))
            label = None if labels is None else names[labels]
            inside = label if label in schema.names else None
            columns: list[Any] = []
            codes, found = None, list[Any]()
            if plain or inside is not None:
                columns, codes, found = gathered(
                    _blocks(file, plain, inside), len(plain), n_rows, inside is not None
                )
            taken = dict(zip(plain, columns, strict=True))
            others = {name: _any_column(file, name) for name in stored if name not in taken}
            if label is not None and codes is None:
                codes, found = coded(_any_column(file, label))
        return [(taken | others)[name] for name in stored], None if codes is None else (
            codes,
            found,
        )

    def peek(count: int) -> list[Any]:
        with (
            read_as(path, "Parquet"),
            path.open("rb") as raw,
            parquet.ParquetFile(raw) as file,
        ):
            if regular:  # an index stored as start and step only
                return [_any_column(file, name)[:count] for name in names]
            first = next(file.iter_batches(count), None)
            if first is None:
                return [pd.Series(dtype=float) for _ in names]
            return [first.column(name).to_pandas() for name in names]

    return FileTable(path, names, load, units=units, peek=peek)


def _is_plain(schema: Any, name: str) -> bool:
    """Whether a column holds numbers."""
    if name not in schema.names:
        return False
    return schema.empty_table().column(name).to_pandas().dtype.kind in "iuf"


def _blocks(file: Any, numbers: list[str], label: str | None) -> Iterator[Block]:
    for batch in file.iter_batches(_ROWS, columns=[*numbers, *([] if label is None else [label])]):
        parts = [batch.column(name).to_numpy(zero_copy_only=False) for name in numbers]
        if label is None:
            yield parts, None, []
            continue
        coded = batch.column(label).dictionary_encode()
        codes = coded.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        yield parts, codes, coded.dictionary.to_pylist()


def _any_column(file: Any, name: str) -> pd.Series:
    """A column as pandas takes it."""
    if name in file.schema_arrow.names:
        return file.read(columns=[name]).column(name).to_pandas()
    # A regular row index, stored as start and step only.
    return file.read().to_pandas().index.to_series()


TIME_NAME = "time"
_LONGEST_GAP = 3.5  # steps of a stream, across which nothing is interpolated


@dataclass(frozen=True)
class _Stream:
    """Samples of one stream; ``rate`` is the nominal one (Hz), 0 for an irregular stream."""

    name: str
    time: np.ndarray
    values: np.ndarray
    rate: float

    def at(self, instants: np.ndarray, channel: int) -> np.ndarray:
        """A channel, interpolated; NaN where samples were lost."""
        values = np.interp(instants, self.time, self.values[:, channel])
        if self.rate <= 0 or self.time.size < 2:
            return values
        after = np.clip(np.searchsorted(self.time, instants), 1, self.time.size - 1)
        gap = self.time[after] - self.time[after - 1]
        lost = (gap > _LONGEST_GAP / self.rate) & (instants < self.time[after])
        return np.where(lost & (instants > self.time[after - 1]), np.nan, values)


def read_xdf(path: Path, dt: float | None = None) -> FileTable:
    """Read an XDF file as channels on one grid, ``"stream.channel"``, and their time.

    Clocks of streams are brought together, and jitter is taken off, by pyxdf. ``dt`` (s) is the
    step of the grid; None means the nominal rate of the fastest stream that is read. The grid
    covers the span that these streams have in common, and time is 0 at its beginning.
    """
    if not path.stat().st_size:
        raise ValueError(f"{path} is empty.")
    pyxdf = require("pyxdf", f"Reading the XDF file {path}", "xdf")
    quiet = logging.getLogger("pyxdf")
    level = quiet.level
    quiet.setLevel(logging.ERROR)
    try:
        with read_as(path, "XDF"):
            found, _ = pyxdf.load_xdf(path, synchronize_clocks=True, dejitter_timestamps=True)
    finally:
        quiet.setLevel(level)
    streams: list[_Stream] = []
    names, units, of = [TIME_NAME], {TIME_NAME: "s"}, [(-1, 0)]
    unreadable: dict[str, str] = {}
    remarks: list[str] = []
    taken: set[str] = set()
    for raw in found:
        info = raw["info"]
        name = _once(str(info["name"][0]), taken)
        if info["channel_format"][0] == "string":
            remarks.append(f'the markers of stream "{name}" are not used')
            continue
        if not len(raw["time_stamps"]):
            unreadable[name] = "has no samples."
            continue
        with read_as(path, f"XDF, at its stream {name!r}"):
            values = np.asarray(raw["time_series"], dtype=np.float64)
            stamps = np.asarray(raw["time_stamps"], dtype=np.float64)
            kept = np.append(True, np.diff(stamps) > 0)  # several samples of one instant
            rate = float(info["nominal_srate"][0])
            streams.append(_Stream(name, stamps[kept], values[kept], rate))
            for k, (label, unit) in enumerate(_labels(info, values.shape[1])):
                names.append(f"{name}.{label}")
                of.append((len(streams) - 1, k))
                if unit:
                    units[names[-1]] = unit
    if not streams:
        raise ValueError(f"{path} has no stream of numbers that has samples.")
    last = [name.rpartition(".")[2] for name in names]
    aliases = {a: name for a, name in zip(last, names, strict=True) if last.count(a) == 1}

    def load(numbers: Sequence[int], labels: int | None) -> Columns:
        asked = [*numbers, *([] if labels is None else [labels])]
        own = sorted({of[k][0] for k in asked if of[k][0] >= 0}) or list(range(len(streams)))
        instants, start = _grid(path, [streams[k] for k in own], dt)
        columns: list[Any] = [
            instants if of[k][0] < 0 else streams[of[k][0]].at(instants + start, of[k][1])
            for k in asked
        ]
        return columns[: len(numbers)], None if labels is None else coded(columns[-1])

    return FileTable(
        path,
        names,
        load,
        units=units,
        unreadable=unreadable,
        kind="variable",
        peek=lambda count: [values[:count] for values in load(range(len(names)), None)[0]],
        remarks=remarks,
        aliases=aliases,
    )


def _once(name: str, taken: set[str]) -> str:
    """A name that no other stream has."""
    own, number = name, 1
    while own in taken:
        number += 1
        own = f"{name}-{number}"
    taken.add(own)
    return own


def _labels(info: dict[str, Any], count: int) -> list[tuple[str, str]]:
    """Label and unit of each channel, from the header of a stream; numbers where it has none."""
    try:
        described = info["desc"][0]["channels"][0]["channel"]
        found = [
            (str((one.get("label") or [""])[0] or ""), str((one.get("unit") or [""])[0] or ""))
            for one in described
        ]
    except (KeyError, TypeError, IndexError, AttributeError):
        found = []
    labels = [label for label, _ in found]
    if len(found) != count or not all(labels) or len(set(labels)) < count:
        return [(str(k + 1), "") for k in range(count)]
    return found


def _grid(path: Path, streams: list[_Stream], dt: float | None) -> tuple[np.ndarray, float]:
    """Instants from 0 on, and when 0 is by the clock of the file."""
    fastest = max(streams, key=lambda stream: stream.rate)
    if dt is None:
        if fastest.rate <= 0:
            raise UsageError(
                f"No stream of {path} has a nominal rate: give the sampling time in s.",
                hint="Give dt=0.01.",
                options=["dt"],
            )
        dt = 1 / fastest.rate
    start = max(float(stream.time[0]) for stream in streams)
    stop = min(float(stream.time[-1]) for stream in streams)
    if stop <= start:
        spans = ", ".join(f"{s.name!r} from {s.time[0]:.6g} to {s.time[-1]:.6g} s" for s in streams)
        raise ValueError(f"The streams of {path} have no time in common: {spans}.")
    # On the samples of the fastest stream nothing has to be interpolated.
    inside = fastest.time[(fastest.time >= start - 1e-9) & (fastest.time <= stop)]
    if inside.size:
        start = float(inside[0])
    return np.arange(int((stop - start) / dt + 1e-6) + 1) * dt, start
