"""CSV files as tables."""

from __future__ import annotations

import csv
import itertools
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

import pandas as pd

from ..text import counted
from ._header_words import are_units, ungarbled
from ._plain import EXACT, plain_columns
from ._table import FileTable, coded
from ._text import Text, survey

__all__ = ["Sheet", "read_csv"]

_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_DECIMAL_POINT = re.compile(_DECIMAL_COMMA.pattern.replace(",", r"\."))


def read_csv(path: Path) -> FileTable:
    """Read a text file with one header row; separator comma, semicolon or tab."""
    sheet = _sheet(survey(path))
    names = [ungarbled(name) for name in sheet.names]
    note = ""
    if all(_is_number(name) for name in names):
        note = "Its first row holds numbers: add a header row with the names of the columns."
    elif len(names) == 1 and len(names[0].split()) > 1:
        note = "Separate cells with commas, semicolons or tabs, not with spaces."

    def load(numbers: Sequence[int], labels: int | None) -> tuple[list[Any], Any]:
        plain = plain_columns(sheet, numbers, labels)
        if plain is not None:
            columns, label = plain
            if columns or label is not None:
                sheet.refuse_long_cells(len(columns[0] if label is None else label[0]))
            return plain
        found = [sheet.column(position) for position in numbers]
        return found, None if labels is None else coded(sheet.column(labels))

    table = FileTable(path, names, load, note=note, peek=sheet.peek, raw=sheet.raw)
    if sheet.above:
        table.remarks.append(f"{counted(sheet.above, 'line')} above the header skipped")
    garbled = [name for name in sheet.names if ungarbled(name) != name]
    if garbled:
        table.remarks.append(
            f"letters of headers are garbled, as UTF-8 was read as Latin-1, and were mended: "
            f'"{ungarbled(garbled[0])}"'
        )
    if any("\ufffd" in name for name in names):
        table.remarks.append("letters of headers are lost: save the file as UTF-8")
    if sheet.units:
        table.units |= {name: unit for name, unit in zip(names, sheet.units, strict=True) if unit}
        table.remarks.append("units from the row below the header")
    return table


def _sheet(text: Text) -> Sheet:
    """Read the header of a file, and make sure that rows follow."""
    above = _lines_above_header(text)
    with text.open() as file:
        blank = above
        for _ in range(above):
            file.readline()
        while not (first := file.readline()).strip():
            blank += 1
            if not first:
                raise ValueError(f"{text.path} is empty.")
        separator = next((sign for sign in "\t;" if sign in first), ",")
        rows = csv.reader(
            itertools.chain([first], file), delimiter=separator, skipinitialspace=True
        )
        skip = blank
        try:
            names = [name.strip() for name in next(rows)]
            skip += rows.line_num
            row, units = _next_row(rows), list[str]()
            if row is not None and are_units(row) and not any(map(_is_number, row)):
                end = rows.line_num
                after = _next_row(rows)
                if after is not None and any(map(_is_number, after)):
                    units, row, skip = [_unit(cell) for cell in row], after, blank + end
        except csv.Error as error:  # a cell of more than 128 kB
            raise ValueError(_open_quote(text.path, skip + 1)) from error
    if row is None:
        if skip > blank + 1:
            raise ValueError(_open_quote(text.path, blank + 1))
        raise ValueError(f"{text.path} has a header but no rows.")
    if any(_holds_rows(name, separator) for name in names):
        raise ValueError(_open_quote(text.path, blank + 1))
    units = (units + [""] * len(names))[: len(names)] if units else []
    sheet = Sheet(_without_head(text, skip), separator, names, skip, above, tuple(units))
    if len(row) > len(names):
        raise ValueError(sheet.wrong_row(""))
    return sheet


_FAR = 200  # lines in which the header must come


def _lines_above_header(text: Text) -> int:
    """How many lines of other text stand above the header.

    The rows below it have as many cells and hold numbers; the first line is the header unless it
    has fewer cells.
    """
    with text.open() as file:
        lines = list(itertools.islice(file, _FAR))
    first = next((k for k, line in enumerate(lines) if line.strip()), 0)
    for sign in "\t;,":
        rows = [_cells(line, sign) for line in lines]
        starts = (k for k in range(first + 2, len(rows)) if _is_sample(rows[k - 1], rows[k]))
        data = next(starts, None)
        if data is None:
            continue
        data -= 1
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


def _cells(line: str, sign: str) -> list[str]:
    if line.count(sign) == 0:
        return [line.strip()]
    if '"' in line:
        try:
            return next(csv.reader([line], delimiter=sign, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 128 kB
            return [line]
    return [cell.strip() for cell in line.rstrip("\r\n").split(sign)]


def _is_sample(row: list[str], after: list[str]) -> bool:
    """Whether two rows are samples of several columns, at least two of them numbers."""
    if len(row) < 3 or len(row) != len(after):
        return False
    numbers = sum(
        _is_number(one) and _is_number(other) for one, other in zip(row, after, strict=True)
    )
    return numbers >= 2


def _next_row(rows: Any) -> list[str] | None:
    return next((row for row in rows if len(row) > 1 or "".join(row).strip()), None)


def _unit(cell: str) -> str:
    bare = cell.strip().strip("[]()")
    return bare if bare.strip("-.") else ""


def _without_head(text: Text, skip: int) -> Text:
    """The counts of the lines behind the header, whose points and commas say what is a number."""
    with text.open() as file:
        head = "".join(itertools.islice(file, skip))
    return replace(text, points=text.points - head.count("."), commas=text.commas - head.count(","))


@dataclass(frozen=True)
class Sheet:
    """A table of text: the names in its header, and the rows below."""

    text: Text
    separator: str
    names: list[str]
    skip: int  # lines
    above: int = 0  # of these, lines above the header
    units: tuple[str, ...] = ()

    @cached_property
    def cells(self) -> pd.DataFrame:
        return self.parse()

    @cached_property
    def has_quotes(self) -> bool:
        with self.text.open() as file:
            header = itertools.islice(file, self.skip)
            return self.text.quotes > sum(line.count('"') for line in header)

    @cached_property
    def decimal(self) -> str | None:
        """The decimal sign, if only one is possible."""
        if self.separator == "," or not self.text.commas:
            return "."
        return None if self.text.points else ","

    def read(self, file: TextIO, **options: Any) -> Any:
        """Let pandas read the cells of an open file; rows that are too long are a ParserWarning."""
        return pd.read_csv(
            file,
            sep=self.separator,
            header=None,
            names=range(len(self.names)),
            index_col=False,
            skipinitialspace=True,
            **EXACT,
            **options,
        )

    def parse(self, dtype: Any = None) -> pd.DataFrame:
        """All cells."""
        with self.text.open(self.skip) as file, warnings.catch_warnings():
            # pandas only warns when a row has more cells than the header, and drops the rest.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            try:
                cells = self.read(file, dtype=dtype, low_memory=False)
            except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
                raise ValueError(self.wrong_row(str(error))) from error
        self.refuse_long_cells(len(cells))
        return cells

    def peek(self, n_rows: int) -> list[Any]:
        """The first cells of each column, as numbers where most of them are."""
        options: dict[str, Any] = {"decimal": self.decimal or ",", "nrows": n_rows}
        with self.text.open(self.skip) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.ParserWarning)
            try:
                cells = self.read(file, **options)
            except pd.errors.ParserError as error:
                raise ValueError(self.wrong_row(str(error)) or str(error)) from error
        return [cells[position] for position in cells]

    def refuse_long_cells(self, n_rows: int) -> None:
        """Refuse quoted cells that continue in the next line: two stray quotes swallow the rows."""
        if not self.has_quotes or self.skip + n_rows >= self.text.n_lines:
            return
        wrong = self.wrong_row("")  # or lines between the rows are blank
        if wrong:
            raise ValueError(wrong)

    def column(self, position: int) -> pd.Series:
        """A column; decimal commas become points if no other number has a point."""
        column = self.cells[position]
        if self.separator == "," or pd.api.types.is_numeric_dtype(column.dtype):
            return column
        commas = column.dropna().astype(str)
        commas = commas[commas.map(_DECIMAL_COMMA.fullmatch).notna()]
        if commas.empty:
            return column
        texts = self.parse(dtype=str)
        for name, other in zip(self.names, texts, strict=True):
            points = texts[other].dropna()
            if points.map(_DECIMAL_POINT.fullmatch).notna().any():
                raise ValueError(
                    f"{self.text.path} is ambiguous: column {self.names[position]!r} has commas in "
                    f"its numbers ({commas.iloc[0]!r}) and column {name!r} has points. Write all "
                    "numbers with a decimal point and without thousands separators."
                )
        numbers = column.astype(object)
        # float() and not pd.to_numeric, which is inexact in the last digit before pandas 3.1.
        numbers.loc[commas.index] = commas.map(lambda cell: float(cell.replace(",", ".")))
        return numbers

    def raw(self, position: int) -> pd.Series:
        """A column as the file has it."""
        return self.cells[position]

    def wrong_row(self, said: str) -> str:
        """What is wrong with the first row that is not one line of as many cells as the header."""
        path, separator, names = self.text.path, self.separator, self.names
        begin = end = 0  # of a row, in lines
        with self.text.open() as file:
            rows = csv.reader(file, delimiter=separator, skipinitialspace=True)
            try:
                for row in rows:
                    begin, end = end, rows.line_num
                    if begin < self.skip:
                        continue
                    if end > begin + 1:
                        if "EOF inside string" in said and next(rows, None) is None:
                            return _open_quote(path, begin + 1)
                        return (
                            f'{path} cannot be read as a table: a quote (") in line {begin + 1} is '
                            f"closed only in line {end}, which makes these lines one row. Delete "
                            "it, or close it in its line; if the cell is a text of several lines, "
                            "put it into one."
                        )
                    if len(row) > len(names):
                        columns = counted(len(names), "column")
                        return (
                            f"{path} cannot be read as a table of {columns} separated by "
                            f"{separator!r}, as in its first line "
                            f"({separator.join(names)[:60]!r}): line {end} has {len(row)} cells. "
                            "The first line must be the header: delete anything above the names "
                            "of the columns. Every row needs as many cells as the header."
                        )
            except csv.Error:  # a cell of more than 128 kB
                return _open_quote(path, end + 1)
        return f"{path}: {said}" if said else ""


def _holds_rows(name: str, separator: str) -> bool:
    """Whether a quote in the header was closed further down, so that rows are part of a name."""
    lines = [line.split(separator) for line in name.split("\n")[1:]]
    return any(len(line) > 1 and any(map(_is_number, line)) for line in lines)


def _open_quote(path: Path, line: int) -> str:
    return (
        f'{path} cannot be read as a table: a quote (") in line {line} is never '
        "closed, or only far below. Delete it, or close it."
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
