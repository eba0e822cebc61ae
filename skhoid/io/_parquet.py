"""Parquet files as tables."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ._blocks import Block, gathered
from ._table import Columns, FileTable, coded, read_as, require

__all__ = ["read_parquet"]

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
