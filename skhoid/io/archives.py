"""NumPy archives, Parquet, Feather, Excel and XDF files as tables."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import UsageError
from .delimited import read_csv
from .files import Columns, FileTable, coded, one_by_one, read_as, require
from .structs import as_table, find_columns


def read_npz(path: Path) -> FileTable:
    """Read the arrays of an NPZ file; never objects, whose loading could run code."""
    arrays: dict[str, Any] = {}
    unreadable: dict[str, str] = {}
    with read_as(path, "a NumPy archive"), np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                values = archive[name]
            except ValueError as error:
                unreadable[name] = f"cannot be read: {error}. Save plain arrays of numbers."
                continue
            if values.dtype.names:
                unreadable[name] = "has named fields: save one plain array per channel."
            else:
                is_text = values.dtype.kind == "U" and values.size > 1
                arrays[name] = values.tolist() if is_text else values
    table = as_table(path, "a NumPy archive", arrays, find_columns(arrays))
    table.unreadable |= unreadable
    return table


def read_parquet(path: Path) -> FileTable:
    """Read a Parquet or Feather file; the named levels of a stored row index count as columns."""
    is_feather = path.suffix.lower() in (".feather", ".arrow")
    kind = "Feather" if is_feather else "Parquet"
    require("pyarrow", f"Reading the {kind} file {path}")
    # PyArrow opens no files whose names are not UTF-8.
    with read_as(path, kind), path.open("rb") as file:
        if is_feather:
            frame = pd.read_feather(file)
        else:
            frame = pd.read_parquet(file, engine="pyarrow")
    units = {str(key): str(unit) for key, unit in (frame.attrs.get("units") or {}).items()}
    named = [name for name in frame.index.names if name is not None]
    frame = frame.reset_index(level=named, allow_duplicates=True) if named else frame
    names = [str(name) for name in frame.columns]
    load = one_by_one(lambda position: frame.iloc[:, position])
    return FileTable(path, names, load, units=units)


def read_excel(path: Path) -> FileTable:
    """Read a workbook: sheets with the same columns are runs; ``file.xlsx#sheet`` is one of them.

    A sheet is read as the text that it would be if it were saved as such.
    """
    book, _, sheet = str(path).partition("#")
    require("openpyxl", f"Reading the Excel file {book}", "excel")
    with read_as(path, "an Excel workbook"):
        frames = pd.read_excel(book, sheet_name=None, header=None, engine="openpyxl")
    if sheet and sheet not in frames:
        raise ValueError(f"{book} has no sheet {sheet!r}, only {', '.join(map(repr, frames))}.")
    tables, faults = {}, {}
    for name, frame in frames.items():
        if sheet in ("", name):
            try:
                tables[name] = _sheet(path, name, frame)
            except ValueError as error:
                faults[name] = error
    if not tables:
        raise next(iter(faults.values()))
    longest = max(tables, key=lambda name: len(tables[name][1][0]))
    names, _, units, remarks = tables[longest]
    runs = [name for name, (own, *_) in tables.items() if own == names]
    aside = [name for name in frames if name not in runs and sheet == ""]
    if aside:
        said = ", ".join(f'"{name}"' for name in aside)
        remarks = [*remarks, f"sheets with other columns are not read: {said}"]
    columns = [
        pd.concat([tables[run][1][k] for run in runs], ignore_index=True) for k in range(len(names))
    ]
    run_name = None
    if len(runs) > 1:
        run_name = "sheet"
        names = [*names, run_name]
        lengths = [len(tables[run][1][0]) for run in runs]
        columns.append(pd.Series(np.repeat(np.array(runs, dtype=object), lengths)))
        remarks = [*remarks, "each sheet is a run"]
    return FileTable(
        path,
        names,
        one_by_one(columns.__getitem__),
        units=units,
        run_name=run_name,
        remarks=remarks,
    )


_Sheet = tuple[list[str], list[pd.Series], dict[str, str], list[str]]


def _sheet(path: Path, name: str, frame: pd.DataFrame) -> _Sheet:
    """Names, columns, units and remarks of a sheet, by the rules for text."""
    filled = frame.dropna(how="all").dropna(axis=1, how="all")
    with TemporaryDirectory() as folder:
        text = Path(folder) / "sheet.tsv"
        filled.to_csv(text, sep="\t", header=False, index=False)
        try:
            table = read_csv(text)
            columns = [pd.Series(v) for v in table.load(range(len(table.names)), None)[0]]
        except ValueError as error:
            said = str(error).replace(str(text), f"The sheet {name!r} of {path}")
            raise ValueError(said) from error
    return table.names, columns, table.units, table.remarks


TIME_NAME = "time"
_LIKE = 0.01  # of a step
_LONGEST_GAP = 3.5  # steps of a stream, across which nothing is interpolated


@dataclass(frozen=True)
class Stream:
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
    pyxdf = require("pyxdf", f"Reading the XDF file {path}", "xdf")
    quiet = logging.getLogger("pyxdf")
    level = quiet.level
    quiet.setLevel(logging.ERROR)
    try:
        with read_as(path, "XDF"):
            found, _ = pyxdf.load_xdf(path, synchronize_clocks=True, dejitter_timestamps=True)
    finally:
        quiet.setLevel(level)
    streams: list[Stream] = []
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
            streams.append(Stream(name, stamps[kept], values[kept], rate))
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
        instants, start = grid_of(path, [streams[k] for k in own], dt)
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


def stream(name: str, clock: np.ndarray, values: np.ndarray) -> Stream:
    """A signal with a clock of its own, at the rate that its instants have."""
    later = np.append(True, np.diff(clock) > 0)
    clock, values = clock[later], values[later]
    step, mean = float(np.median(np.diff(clock))), float(np.mean(np.diff(clock)))
    step = (
        mean if abs(mean - step) < _LIKE * step else step
    )  # the median of stamps that are rounded
    return Stream(name, clock, values[:, None], 1 / step)


def grid_of(path: Path, streams: list[Stream], dt: float | None) -> tuple[np.ndarray, float]:
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
