"""Text files of numbers: encoding, separator, header, units, and cells as pandas reads them."""

from __future__ import annotations

import codecs
import csv
import itertools
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pandas as pd

from ..text import counted
from .files import Columns, FileTable, coded

UNITS = {"deg": "deg", "degree": "deg", "rad": "rad", "px": "px", "pixel": "px", "mm": "mm"}
UNITS |= {"cm": "cm", "m": "m", "nm": "Nm", "volt": "V", "v": "V", "mv": "mV", "pct": "%"}
UNITS |= {"percent": "%", "degs": "deg/s", "g": "g", "n": "N"}
TIME_UNITS = {"s": "s", "sec": "s", "second": "s", "ms": "ms", "msec": "ms", "us": "us"}
TIME_UNITS |= {"millisecond": "ms", "milli": "ms", "usec": "us"}
_KNOWN_UNITS = {*UNITS, *TIME_UNITS, *UNITS.values()}
_KNOWN_UNITS |= {"\u00b0", "%", "m/s", "rad/s", "hz", "\u00b0/s"}
_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*$")
_DECIMAL_POINT = re.compile(_DECIMAL_COMMA.pattern.replace(",", r"\."))
_CHUNK = 1 << 20  # bytes, or characters
_FAR = 200  # lines in which the header must come
# The default parser of pandas < 3.1 is off by an ulp for some numbers; later it is exact, and the
# option deprecated.
_EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    else {}
)


def read_csv(path: Path) -> FileTable:
    """Read a text file with a header row; separator comma, semicolon or tab."""
    sheet = _find_header(path)
    names = [_mend(name) for name in sheet.names]
    note = ""
    if all(map(_is_number, names)):
        note = "Its first row holds numbers: add a header row with the names of the columns."
    elif len(names) == 1 and len(names[0].split()) > 1:
        note = "Separate cells with commas, semicolons or tabs, not with spaces."

    def load(numbers: Sequence[int], labels: int | None) -> Columns:
        columns = [sheet.column(position) for position in numbers]
        return columns, None if labels is None else coded(sheet.column(labels))

    table = FileTable(path, names, load, note=note, first_rows=sheet.peek)
    if sheet.above:
        table.remarks.append(f"{counted(sheet.above, 'line')} above the header skipped")
    garbled = [new for old, new in zip(sheet.names, names, strict=True) if old != new]
    if garbled:
        table.remarks.append(
            "letters of headers are garbled, as UTF-8 was read as Latin-1, and were mended: "
            f'"{garbled[0]}"'
        )
    if any("\ufffd" in name for name in names):
        table.remarks.append("letters of headers are lost: save the file as UTF-8")
    if sheet.units:
        table.units |= {name: unit for name, unit in zip(names, sheet.units, strict=False) if unit}
        table.remarks.append("units from the row below the header")
    return table


@dataclass(frozen=True)
class _Sheet:
    """A table of text: the names in its header, and the rows below."""

    path: Path
    encoding: str
    separator: str
    names: list[str]
    skip: int  # lines
    above: int = 0  # of these, lines above the header
    units: tuple[str, ...] = ()

    @cached_property
    def cells(self) -> pd.DataFrame:
        return self._parse()

    def _parse(self, **options: Any) -> pd.DataFrame:
        with _open(self.path, self.encoding, self.skip) as file, warnings.catch_warnings():
            # pandas only warns when a row has more cells than the header, and drops the rest.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            try:
                cells = pd.read_csv(
                    file,
                    sep=self.separator,
                    header=None,
                    names=range(len(self.names)),
                    index_col=False,
                    skipinitialspace=True,
                    low_memory=False,
                    **_EXACT,
                    **options,
                )
            except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
                raise ValueError(self.wrong_row(str(error))) from error
        for _, column in cells.select_dtypes(exclude="number").items():
            broken = np.flatnonzero(column.astype(str).str.contains("\n"))
            if broken.size:  # two stray quotes make one cell of the rows between them
                raise ValueError(_open_quote(self.path, self.skip + int(broken[0]) + 1))
        return cells

    def peek(self, n_rows: int) -> list[Any]:
        """The first cells of each column."""
        cells = self._parse(nrows=n_rows)
        return [cells[position] for position in cells]

    def column(self, position: int) -> pd.Series:
        """A column; decimal commas become points if no number of the file has a point."""
        column = self.cells[position]
        if self.separator == "," or pd.api.types.is_numeric_dtype(column.dtype):
            return column
        commas = column.dropna().astype(str)
        commas = commas[commas.str.match(_DECIMAL_COMMA)]
        if commas.empty:
            return column
        if self._with_points:
            raise ValueError(
                f"{self.path} is ambiguous: some numbers have decimal commas, and those of column "
                f"{self._with_points[0]!r} have points. Write all numbers with a decimal point "
                "and without thousands separators."
            )
        numbers = column.astype(object)
        # float() and not pd.to_numeric, which is inexact in the last digit before pandas 3.1.
        numbers.loc[commas.index] = commas.map(lambda cell: float(cell.replace(",", ".")))
        return numbers

    @cached_property
    def _with_points(self) -> list[str]:
        """Names of the columns in which a number has a decimal point."""
        return [
            name
            for name, (_, column) in zip(self.names, self.cells.items(), strict=True)
            if (
                (column.dropna() % 1 != 0).any()
                if pd.api.types.is_numeric_dtype(column.dtype)
                else column.dropna().astype(str).str.match(_DECIMAL_POINT).any()
            )
        ]

    def wrong_row(self, said: str) -> str:
        """Name the first row that has more cells than the header."""
        if "EOF inside string" in said:
            last = int(said.rpartition(" ")[2])
            return _open_quote(self.path, self.skip + last + 1)
        with _open(self.path, self.encoding, self.skip) as file:
            rows = csv.reader(file, delimiter=self.separator, skipinitialspace=True)
            for row in rows:
                if len(row) > len(self.names):
                    return (
                        f"{self.path} cannot be read as a table of "
                        f"{counted(len(self.names), 'column')} separated by {self.separator!r}, as "
                        f"in its first line ({self.separator.join(self.names)[:60]!r}): line "
                        f"{self.skip + rows.line_num} has {len(row)} cells. The first line must be "
                        "the header: delete anything above the names of the columns. Every row "
                        "needs as many cells as the header."
                    )
        return f"{self.path}: {said}"


def _open(path: Path, encoding: str, skip: int = 0) -> TextIO:
    errors = "replace" if encoding == "cp1252" else "strict"
    file = path.open(encoding=encoding, errors=errors)
    for _ in range(skip):
        file.readline()
    return file


def _find_encoding(path: Path) -> str:
    with path.open("rb") as file:
        is_wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        file.seek(0)
        while not is_wide and (chunk := file.read(_CHUNK)):
            if b"\0" in chunk:
                raise ValueError(
                    f"{path} has a zero byte, which no text has: it is damaged, or not a text "
                    "file. Save it again, as UTF-8."
                )
    try:
        with path.open(encoding="utf-16" if is_wide else "utf-8") as text:
            while text.read(_CHUNK):
                pass
    except UnicodeDecodeError as error:
        if is_wide:
            raise ValueError(
                f"{path} begins as UTF-16 text, but is none. Save it as UTF-8."
            ) from error
        # Western European Windows: what spreadsheets write for the degree sign in "e [°]".
        return "cp1252"
    return "utf-16" if is_wide else "utf-8-sig"


def _find_header(path: Path) -> _Sheet:
    """Read the header of a file, and make sure that rows follow."""
    encoding = _find_encoding(path)
    with _open(path, encoding) as file:
        above = _count_lines_above(list(itertools.islice(file, _FAR)))
    with _open(path, encoding, above) as file:
        skip = above
        while not (first := file.readline()).strip():
            skip += 1
            if not first:
                raise ValueError(f"{path} is empty.")
        separator = next((sign for sign in "\t;" if sign in first), ",")
        lines = itertools.chain([first], file)
        rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
        header = skip + 1
        try:
            names = [name.strip() for name in next(rows)]
            length, units = rows.line_num, list[str]()
            row = _next_row(rows)
            if row is not None and are_units(row) and not any(map(_is_number, row)):
                end, after = rows.line_num, _next_row(rows)
                if after is not None and any(map(_is_number, after)):
                    units, row, length = [_unit_in(cell) for cell in row], after, end
        except csv.Error as error:  # a cell of more than 128 kB
            raise ValueError(_open_quote(path, header)) from error
    # A quote that is closed further down makes rows a part of a name.
    if any(name.count("\n") > 1 for name in names):
        raise ValueError(_open_quote(path, header))
    if row is None:
        raise ValueError(f"{path} has a header but no rows.")
    sheet = _Sheet(path, encoding, separator, names, skip + length, above, tuple(units))
    if len(row) > len(names):
        raise ValueError(sheet.wrong_row(""))
    return sheet


def _count_lines_above(lines: list[str]) -> int:
    """How many lines of other text stand above the header.

    The rows below it have as many cells and hold numbers; the first line is the header unless it
    has fewer cells.
    """
    first = next((k for k, line in enumerate(lines) if line.strip()), 0)
    for sign in "\t;,":
        rows = [_split(line, sign) for line in lines]
        starts = (k for k in range(first + 1, len(rows) - 1) if _are_samples(rows[k], rows[k + 1]))
        data = next(starts, None)
        if data is None:
            continue
        width = len(rows[data])
        header = data - 1
        while header > first and len(rows[header]) <= 1:
            header -= 1
        if are_units(rows[header]) and len(rows[header - 1]) == width:
            header -= 1
        named = len(rows[header]) == width and not any(map(_is_number, rows[header]))
        filled = [cell for cell in rows[first] if cell]
        is_other = len(rows[first]) < width or 2 * len(filled) <= width
        return header if named and header > first and is_other else 0
    return 0


def _split(line: str, sign: str) -> list[str]:
    if '"' not in line:
        return [cell.strip() for cell in line.split(sign)]
    try:
        return next(csv.reader([line], delimiter=sign, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 128 kB
        return [line]


def _are_samples(row: list[str], after: list[str]) -> bool:
    """Whether two rows are samples of several columns, at least two of them numbers."""
    if len(row) < 3 or len(row) != len(after):
        return False
    pairs = zip(row, after, strict=True)
    return sum(_is_number(one) and _is_number(other) for one, other in pairs) >= 2


def _next_row(rows: Any) -> list[str] | None:
    return next((row for row in rows if len(row) > 1 or "".join(row).strip()), None)


def are_units(cells: list[str]) -> bool:
    """Whether the cells of a row are units: all short, at least one of them well known."""
    bare = [cell.strip().strip("[]()").casefold() for cell in cells]
    return all(len(cell) <= 12 for cell in bare) and any(cell in _KNOWN_UNITS for cell in bare)


def _unit_in(cell: str) -> str:
    bare = cell.strip().strip("[]()")
    return bare if bare.strip("-.") else ""


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _open_quote(path: Path, line: int) -> str:
    return (
        f'{path} cannot be read as a table: a quote (") in line {line} is closed only in another '
        "line, or never. Delete it, or close it in its line."
    )


def _mend(header: str) -> str:
    """Undo what reading UTF-8 as Latin-1 or Windows-1252 did to a header."""
    if not re.search("[\u00c2\u00c3\u00e2\u00ce]", header):
        return header
    for encoding in ("cp1252", "latin-1"):
        try:
            return header.encode(encoding).decode("utf-8")
        except UnicodeError:
            continue
    return header
