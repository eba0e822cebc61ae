"""The file formats that can be read, by the extension of a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ._mat import read_mat
from ._npz import read_npz
from ._parquet import read_parquet
from ._sheet import read_csv
from ._table import FileTable
from ._xdf import read_xdf

__all__ = ["DOTTED", "READERS", "open_table"]

READERS: dict[str, Callable[[Path], FileTable]] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".pq": read_parquet,
    ".mat": read_mat,
    ".npz": read_npz,
    ".xdf": read_xdf,
}
DOTTED = (".mat", ".xdf")  # whose names may be paths, of which the last part names the channel


def open_table(path: Path) -> FileTable:
    """One file as a table, by its extension."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path} has the extension {path.suffix!r}; skhoid reads {', '.join(READERS)}."
        )
    return reader(path)
