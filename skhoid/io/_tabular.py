"""CSV and Parquet files as tables."""

from __future__ import annotations

import csv
import io
import re
import warnings
from pathlib import Path
from typing import Any

import pandas as pd

from ..summaries import counted
from ._table import FileTable, require

__all__ = ["read_csv", "read_parquet"]

# The default parser of pandas < 3.1 is off by an ulp for some numbers; later it is exact, and the
# option deprecated.
_EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    else {}
)
_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_DECIMAL_POINT = re.compile(_DECIMAL_COMMA.pattern.replace(",", r"\."))


def read_csv(path: Path) -> FileTable:
    """Read a text file with one header row; separator comma, semicolon or tab."""
    text = _decode(path.read_bytes()).replace("\r\n", "\n").replace("\r", "\n").lstrip("\n")
    if not text.strip():
        raise ValueError(f"{path} is empty.")
    first_line = text.split("\n", 1)[0]
    separator = next((sign for sign in "\t;" if sign in first_line), ",")
    header_reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in next(header_reader)]
    n_header = header_reader.line_num
    if not "".join(text.split("\n", n_header)[n_header:]).strip():
        raise ValueError(f"{path} has a header but no rows.")
    frame = _parse(path, text, separator, names, n_header)
    note = ""
    if all(_is_number(name) for name in names):
        note = "Its first row holds numbers: write a header row with the names of the columns."
    elif len(names) == 1 and len(names[0].split()) > 1:
        note = "Separate cells by commas, semicolons or tabs, not by blanks."

    def load(position: int) -> pd.Series:
        column = frame[position]
        if separator == "," or pd.api.types.is_numeric_dtype(column.dtype):
            return column
        commas = column.dropna().astype(str)
        commas = commas[commas.map(_DECIMAL_COMMA.fullmatch).notna()]
        if commas.empty:
            return column
        cells = _parse(path, text, separator, names, n_header, dtype=str)
        for name, other in zip(names, cells, strict=True):
            points = cells[other].dropna()
            if points.map(_DECIMAL_POINT.fullmatch).notna().any():
                raise ValueError(
                    f"{path} is ambiguous: column {names[position]!r} has commas in its numbers "
                    f"({commas.iloc[0]!r}) and column {name!r} has points. Write all numbers "
                    "with a decimal point and without separators of thousands."
                )
        numbers = column.astype(object)
        # float() and not pd.to_numeric, which is inexact in the last digit before pandas 3.1.
        numbers.loc[commas.index] = commas.map(lambda cell: float(cell.replace(",", ".")))
        return numbers

    return FileTable(path, names, load, note=note)


def read_parquet(path: Path) -> FileTable:
    """Read a Parquet file; the named levels of a stored row index count as columns."""
    require("pyarrow", f"Reading the Parquet file {path}")
    try:
        frame = pd.read_parquet(path, engine="pyarrow")
    except (ValueError, OSError) as error:
        raise ValueError(f"{path} cannot be read as Parquet: {error}") from error
    stored = frame.attrs.get("units")
    levels = [level for level in frame.index.names if level is not None]
    # One column per header: duplicates must survive to be reported by name.
    columns = [frame.index.get_level_values(level).to_series() for level in levels]
    columns += [frame.iloc[:, position] for position in range(frame.shape[1])]
    names = [str(name) for name in [*levels, *frame.columns]]
    units = {str(key): str(unit) for key, unit in stored.items()} if stored else {}
    return FileTable(path, names, columns.__getitem__, units=units)


def _decode(raw: bytes) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Western European Windows: what spreadsheets write for the degree sign in "e [°]".
        return raw.decode("cp1252", errors="replace")


def _parse(
    path: Path, text: str, separator: str, names: list[str], skip: int, dtype: Any = None
) -> pd.DataFrame:
    with warnings.catch_warnings():
        # pandas only warns when a row has more cells than the header, and drops the rest.
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            return pd.read_csv(
                io.StringIO(text),
                sep=separator,
                header=None,
                names=range(len(names)),
                skiprows=skip,
                index_col=False,
                skipinitialspace=True,
                dtype=dtype,
                low_memory=False,
                **_EXACT,
            )
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            raise ValueError(
                _ragged_row(path, text, separator, names) or f"{path}: {error}"
            ) from error


def _ragged_row(path: Path, text: str, separator: str, names: list[str]) -> str:
    """What is wrong with a table of which a row has more cells than the header."""
    rows = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    for row in rows:
        if len(row) > len(names):
            columns = counted(len(names), "column")
            return (
                f"{path} cannot be read as a table of {columns} separated by {separator!r}, as in "
                f"its first line ({separator.join(names)[:60]!r}): line {rows.line_num} has "
                f"{len(row)} cells. The first line must be the header: delete what stands above "
                "the names of the columns. Every row needs as many cells as the header."
            )
    return ""


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
