"""Files of every format, opened by their extension, and read as runs by the names of columns."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from .archives import read_excel, read_npz, read_parquet, read_xdf
from .assembling import Channel, FileRuns, assemble, cut_runs, gather_units
from .delimited import is_text, read_csv
from .files import FileTable, Paths, expand_paths, in_order, shown
from .joining import are_parts, join_parts, on_one_clock
from .matlab import read_mat

READERS: dict[str, Callable[[Path], FileTable]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".asc", ".log", ".res", ".gz"), read_csv),
    ".parquet": read_parquet,
    ".pq": read_parquet,
    ".feather": read_parquet,
    ".arrow": read_parquet,
    ".xlsx": read_excel,
    ".xlsm": read_excel,
    ".mat": read_mat,
    ".npz": read_npz,
    ".xdf": read_xdf,
}
DOTTED = (".mat", ".xdf")  # whose names may be paths, of which the last part names the channel


def open_table(path: Path) -> FileTable:
    """One file as a table, by its extension; as text if it has another one and is text."""
    reader = READERS.get(path.suffix.lower().partition("#")[0])
    if reader is None and is_text(path):
        reader = read_csv
    if reader is None:
        raise ValueError(
            f"{path} is no text, and has the extension {path.suffix!r}; skhoid reads text and "
            f"{', '.join(READERS)}."
        )
    return on_one_clock(in_order(reader(path)))


def each_table(paths: Paths, opened: FileTable | None = None) -> Iterator[FileTable]:
    """The files as tables, one by one; those that hold signals of one run as one table."""
    files = expand_paths(paths)
    first = opened if opened is not None and opened.path == files[0] else open_table(files[0])
    second = open_table(files[1]) if len(files) > 1 else None
    if second is not None and are_parts(first, second):
        tables = [first, second, *map(open_table, files[2:])]
        yield from join_parts(tables) or tables
        return
    yield first
    yield from () if second is None else (second,)
    yield from map(open_table, files[2:])


def read_named(
    tables: Iterable[FileTable],
    channels: list[Channel],
    clock: str | float,
    given: dict[str, str],
    run: str | None,
    levels: Mapping[str, str] | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y of files; ``levels`` as in cut_runs, with the names of their levels."""
    pieces: list[FileRuns] = []
    known: dict[str, tuple[str, Path]] = {}
    for table in tables:
        pieces.append(
            cut_runs(
                table,
                [channel.asked for channel in channels],
                clock=clock,
                time_unit=given.get("time"),
                run=run,
                levels=None if levels is None else list(levels),
            )
        )
        gather_units(table, channels, given, known)
    if levels is not None:
        pieces = _told_apart(pieces)
    if run is None:
        pieces = _by_folder(pieces)
    _check_labels(pieces, run)
    return assemble(
        pieces, [channel.name for channel in channels], known, list((levels or {}).values())
    )


def _told_apart(pieces: list[FileRuns]) -> list[FileRuns]:
    """Files that number their runs alike: the file name is put before the label."""
    labels = [label for piece in pieces for label in piece.labels]
    if len(set(labels)) == len(labels) or len({piece.path for piece in pieces}) < len(pieces):
        return pieces

    def named(piece: FileRuns, label: Any) -> Any:
        own = label[-1] if isinstance(label, tuple) else label
        text = (
            shown(piece.path.stem) if len(piece.labels) == 1 else f"{shown(piece.path.stem)} {own}"
        )
        return (*label[:-1], text) if isinstance(label, tuple) else text

    return [
        replace(piece, labels=[named(piece, label) for label in piece.labels]) for piece in pieces
    ]


def _by_folder(pieces: list[FileRuns]) -> list[FileRuns]:
    """Files of the same name in several folders: the run is labelled by the folder too."""
    stems = [shown(piece.path.stem) for piece in pieces]
    paths = {piece.path.absolute() for piece in pieces}
    alone = all(piece.labels == [stem] for piece, stem in zip(pieces, stems, strict=True))
    if not alone or len(set(stems)) == len(stems) or len(paths) < len(pieces):
        return pieces
    root = os.path.commonpath([path.parent for path in paths])
    return [
        replace(piece, labels=[shown(os.path.relpath(piece.path.with_suffix(""), root))])
        for piece in pieces
    ]


def first_table(paths: Paths) -> FileTable:
    """The first of the files, opened; joined with others if these are of the same run."""
    return next(each_table(paths))


def _check_labels(pieces: list[FileRuns], run: str | None) -> None:
    first: dict[Any, Path] = {}
    for piece in pieces:
        for label in piece.labels:
            other = first.setdefault(label, piece.path)
            if other is piece.path:
                continue
            if other == piece.path:
                raise ValueError(f"{piece.path} is named twice in paths.")
            advice = (
                "rename a file, or name a column with run labels"
                if run is None
                else "give every run its own label"
            )
            raise ValueError(
                f"Two files have a run labelled {label!r}, {other} and {piece.path}: {advice}."
            )
