"""Text files of numbers: their encoding and form, and the fastest reader that is exact."""

from __future__ import annotations

import codecs
import csv
import importlib
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pandas as pd

from ..text import counted
from .files import FileTable, coded

UNITS = {"deg": "deg", "degree": "deg", "rad": "rad", "px": "px", "pixel": "px", "mm": "mm"}
UNITS |= {"cm": "cm", "m": "m", "nm": "Nm", "volt": "V", "v": "V", "mv": "mV", "pct": "%"}
UNITS |= {"percent": "%", "degs": "deg/s", "g": "g", "n": "N"}
TIME_UNITS = {"s": "s", "sec": "s", "second": "s", "ms": "ms", "msec": "ms", "us": "us"}
TIME_UNITS |= {"millisecond": "ms", "milli": "ms", "usec": "us"}
_CHUNK = 1 << 20  # bytes
_MARKS = {  # the marks of UTF-32 begin with those of UTF-16
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
# Which of the first four bytes are not 0 in a text without a mark that begins in ASCII.
_NOT_ZERO = {
    "0001": "utf-32-be",
    "1000": "utf-32-le",
    "0101": "utf-16-be",
    "1010": "utf-16-le",
}


@dataclass(frozen=True)
class Text:
    """A text file: its encoding, and how many lines, quotes, points and commas it has.

    Blank lines at the end do not count; with mixed line endings the number of lines may be too
    small.
    """

    path: Path
    encoding: str
    n_lines: int
    quotes: int
    points: int
    commas: int

    def open(self, skip: int = 0) -> TextIO:
        r"""Open the file after some lines; every line ends in ``\n``."""
        errors = "replace" if self.encoding == "cp1252" else "strict"
        file = self.path.open(encoding=self.encoding, errors=errors)
        for _ in range(skip):
            file.readline()
        return file


def survey(path: Path) -> Text:
    """Find the encoding of a text file, and count what decides how its numbers are read."""
    with path.open("rb") as file:
        head = file.read(4)
        wide = next((name for mark, name in _MARKS.items() if head.startswith(mark)), None)
        wide = wide or _NOT_ZERO.get("".join("01"[byte > 0] for byte in head))
        decoder = codecs.getincrementaldecoder(wide or "utf-8")()
        file.seek(0)
        counts = dict.fromkeys(b'\n\r",.', 0)
        is_ascii = is_utf8 = True
        ended = False
        last = b""
        while not ended:
            chunk = file.read(_CHUNK)
            ended = not chunk  # a last call tells whether the last character is whole
            try:
                if wide:
                    chunk = decoder.decode(chunk, final=ended).encode("utf-8")
                elif is_utf8 and not (is_ascii := is_ascii and chunk.isascii()):
                    decoder.decode(chunk, final=ended)
            except UnicodeDecodeError as error:
                if wide:
                    raise ValueError(
                        f"{path} begins as {wide.upper()} text but does not continue as such "
                        f"({error.reason}). Save it as UTF-8."
                    ) from error
                # Western European Windows: what spreadsheets write for the degree sign in "e [°]".
                is_utf8 = False
            if b"\0" in chunk:
                lines = counts[ord("\n")] + chunk[: chunk.index(b"\0")].count(b"\n")
                raise ValueError(
                    f"{path} has a zero byte in line {lines + 1}, which no text has: it is "
                    "damaged, or not a text file. Save it again, as UTF-8."
                )
            for sign in counts:
                counts[sign] += chunk.count(sign)
            last = chunk or last
    blank = last[len(last.rstrip(b" \r\n")) :]
    for sign in b"\n\r":
        counts[sign] -= blank.count(sign)
    line_feeds, returns, quotes, commas, points = counts.values()
    encoding = wide or ("utf-8-sig" if is_utf8 else "cp1252")
    ends = line_feeds if line_feeds == returns else line_feeds + returns
    return Text(path, encoding, ends + 1, quotes, points, commas)


# Columns of some rows, the codes of their labels (-1: missing), and what these stand for.
Block = tuple[list[np.ndarray], np.ndarray | None, list[Any]]


def gathered(blocks: Iterator[Block], n_columns: int, most: int, labelled: bool) -> Block:
    """Float64 columns of at most ``most`` rows in all, and their labels by number."""
    columns = [np.empty(most) for _ in range(n_columns)]
    codes = np.empty(most, dtype=np.int32) if labelled else None
    known: dict[Any, int] = {}
    stop = 0
    for parts, own, labels in blocks:
        start, stop = stop, stop + len(parts[0] if own is None else own)
        for column, part in zip(columns, parts, strict=True):
            column[start:stop] = part
        if codes is not None:
            places = [known.setdefault(label, len(known)) for label in labels]
            codes[start:stop] = np.array([*places, -1], dtype=np.int32)[own]
    columns = [column[:stop] for column in columns]
    return columns, None if codes is None else codes[:stop], list(known)


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


# The default parser of pandas < 3.1 is off by an ulp for some numbers; later it is exact, and the
# option deprecated.
EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    else {}
)
_BYTES, _ROWS = 1 << 22, 1 << 17  # of a block
# What pandas takes for missing.
_MISSING = ["", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND"]
_MISSING += ["1.#QNAN", "<NA>", "N/A", "NA", "NULL", "NaN", "None", "n/a", "nan", "null"]


def plain_columns(
    sheet: Sheet, numbers: Sequence[int], labels: int | None
) -> tuple[list[np.ndarray], tuple[np.ndarray, list[Any]] | None] | None:
    """Columns as float64 arrays, and one as codes and labels; None if a cell is not a plain number.

    What is not plain (text, truth values, a mixture of decimal commas and points) is left to
    pandas' own inference, which looks at all cells at once.
    """
    if sheet.decimal is None:
        return None
    wanted = list(dict.fromkeys(numbers))
    for blocks in (_by_arrow, _by_pandas):
        try:
            columns, codes, texts = gathered(
                blocks(sheet, wanted, labels), len(wanted), sheet.text.n_lines, labels is not None
            )
            found = dict(zip(wanted, columns, strict=True))
            label = None if codes is None else (codes, _inferred(texts, sheet.decimal))
            return [found[position] for position in numbers], label
        # Errors of PyArrow and pandas are ValueErrors.
        except (ValueError, pd.errors.ParserWarning, ImportError):
            continue
    return None


def _by_arrow(sheet: Sheet, wanted: list[int], labels: int | None) -> Iterator[Block]:
    """Of files without quotes; PyArrow refuses most of what pandas reads in another way."""
    pyarrow = importlib.import_module("pyarrow")
    reader = importlib.import_module("pyarrow.csv")
    if sheet.text.encoding != "utf-8-sig" or sheet.has_quotes or labels in wanted:
        raise ValueError
    types = {str(position): pyarrow.float64() for position in wanted}
    if labels is not None:
        types[str(labels)] = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    names = [str(position) for position in range(len(sheet.names))]
    # PyArrow opens no files whose names are not UTF-8.
    with (
        sheet.text.path.open("rb") as file,
        reader.open_csv(
            file,
            reader.ReadOptions(column_names=names, skip_rows=sheet.skip, block_size=_BYTES),
            reader.ParseOptions(delimiter=sheet.separator, quote_char=False),
            reader.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=_MISSING,
                decimal_point=sheet.decimal,
            ),
        ) as batches,
    ):
        for batch in batches:
            parts = [part.to_numpy(zero_copy_only=False) for part in batch.columns[: len(wanted)]]
            for part, column in zip(parts, batch.columns, strict=False):
                if np.isnan(part).sum() != column.null_count:
                    raise ValueError  # "Nan" and "nan(1)", which are text for pandas
            if labels is None:
                yield parts, None, []
                continue
            label = batch.columns[-1]
            texts = [text.lstrip() for text in label.dictionary.to_pylist()]
            yield parts, label.indices.to_numpy(), texts


def _by_pandas(sheet: Sheet, wanted: list[int], labels: int | None) -> Iterator[Block]:
    if labels in wanted:
        raise ValueError
    types: dict[int, Any] = dict.fromkeys(wanted, np.float64)
    if labels is not None:
        types[labels] = str
    with sheet.text.open(sheet.skip) as file, warnings.catch_warnings():
        # Rows with more cells than the header; in Sheet.parse they become an error.
        warnings.simplefilter("error", pd.errors.ParserWarning)
        options = {"dtype": types, "decimal": sheet.decimal, "low_memory": False}
        for block in sheet.read(file, chunksize=_ROWS, **options):
            parts = [block[position].to_numpy() for position in wanted]
            if labels is None:
                yield parts, None, []
                continue
            own, texts = pd.factorize(block[labels])
            yield parts, own, list(texts)


def _inferred(texts: list[str], decimal: str) -> list[Any]:
    """Numbers or texts, as pandas reads a column of these cells."""
    if decimal == "," and any("," in text for text in texts):
        raise ValueError
    cells = io.StringIO()
    csv.writer(cells, quoting=csv.QUOTE_ALL).writerows([text] for text in texts)
    cells.seek(0)
    frame = pd.read_csv(cells, header=None, names=[0], skip_blank_lines=False, **EXACT)
    return frame[0].tolist()


def ungarbled(header: str) -> str:
    """A header in which UTF-8 was read as Latin-1 or Windows-1252, as it was."""
    if not re.search("[\u00c2\u00c3\u00e2\u00ce]", header):
        return header
    for encoding in ("cp1252", "latin-1"):
        try:
            return header.encode(encoding).decode("utf-8")
        except UnicodeError:
            continue
    return header


def are_units(cells: list[str]) -> bool:
    """Whether the cells of a row are units: all short, at least one of them well known."""
    bare = [cell.strip().strip("[]()").casefold() for cell in cells]
    known = {*UNITS, *TIME_UNITS, *UNITS.values(), "\u00b0", "%", "m/s", "rad/s", "hz", "\u00b0/s"}
    return all(len(cell) <= 12 for cell in bare) and any(cell in known for cell in bare)
