"""Tables as text or Parquet files, all of them or none."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ._table import require
from .whole import failing_as, written_whole

__all__ = ["TABLE_FORMATS", "check_table_format", "write_tables"]

TABLE_FORMATS = ("tsv", "csv", "parquet")
_SEPARATORS = {".tsv": "\t", ".csv": ","}


def check_table_format(form: str) -> None:
    """Refuse a format that cannot be written here before long work begins."""
    if form not in TABLE_FORMATS:
        raise ValueError(f"Tables can be written as {', '.join(TABLE_FORMATS)}; got {form!r}.")
    if form == "parquet":
        require("pyarrow", "Writing Parquet tables")


def write_tables(tables: Mapping[str, pd.DataFrame], folder: str | Path) -> list[Path]:
    """Write tables to a folder, by file name.

    Names end in ``.tsv`` or ``.csv``, with or without ``.gz``, or in ``.parquet``. Named row
    indexes become columns, and lists become text; the second of two columns of the same name gets
    the suffix ``_2``. The files are written under temporary names and moved into place when all are
    complete.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in tables]
    with ExitStack() as moves:
        parts = [moves.enter_context(written_whole(path)) for path in paths]
        for table, path, part in zip(tables.values(), paths, parts, strict=True):
            with failing_as(path):
                _write(_plain(table), part)
    return paths


def _write(table: pd.DataFrame, path: Path) -> None:
    if path.suffix == ".parquet":
        table.to_parquet(path, engine="pyarrow", index=False)
    else:
        suffixes = [suffix for suffix in path.suffixes if suffix != ".gz"]
        table.to_csv(path, sep=_SEPARATORS[suffixes[-1]], index=False)


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns of one type each, under distinct names that are text."""
    unnamed = all(name is None for name in frame.index.names)
    table = frame.reset_index(drop=unnamed, allow_duplicates=True)
    table.attrs = {}
    names: list[str] = []
    for name in table.columns:
        parts = name if isinstance(name, tuple) else (name,)
        text = "_".join(str(part) for part in parts if part != "")
        while text in names:
            text += "_2"
        names.append(text)
    table.columns = names
    for name in table.columns:
        if table[name].dtype != object:
            continue
        cells = table[name].map(_as_text)
        if pd.api.types.infer_dtype(cells, skipna=True).startswith("mixed"):
            cells = cells.map(str, na_action="ignore")
        table[name] = cells
    return table


def _as_text(value: Any) -> Any:
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(map(str, value))
    return value
