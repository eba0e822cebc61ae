"""Text files of numbers: encoding, separator, header, units, and cells as pandas reads them."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..text import counted
from .files import Columns, FileTable, coded, read_as

UNITS = {"deg": "deg", "degree": "deg", "rad": "rad", "px": "px", "pixel": "px", "mm": "mm"}
UNITS |= {"cm": "cm", "m": "m", "nm": "Nm", "volt": "V", "v": "V", "mv": "mV", "pct": "%"}
UNITS |= {"percent": "%", "degs": "deg/s", "g": "g", "n": "N"}
TIME_UNITS = {"s": "s", "sec": "s", "second": "s", "ms": "ms", "msec": "ms", "us": "us"}
TIME_UNITS |= {"millisecond": "ms", "milli": "ms", "millis": "ms", "usec": "us", "micros": "us"}
TIME_UNITS |= {"ns": "ns", "nsec": "ns"}
_KNOWN_UNITS = {*UNITS, *TIME_UNITS, *UNITS.values()}
_KNOWN_UNITS |= {"\u00b0", "%", "m/s", "rad/s", "hz", "\u00b0/s"}
_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*$")
_DECIMAL_POINT = re.compile(_DECIMAL_COMMA.pattern.replace(",", r"\."))
_FAR = 200  # lines in which the header must come
_COMMENT = re.compile(r"\s*[#%;!*/]+\s*(?=\S|$)")
_RULE = re.compile(r"[-=_*+|\s]*([-=_]{3}[-=_*+|\s]*)?$")
_ABOVE = 20  # rows above the last one, with which it is compared
_ARRIVAL = re.compile(r"(?m)^\[?(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)\]?[ \t]*->[ \t]*")
_LEGACY = ["cp932", "gb18030", "cp1251", "cp1253"]  # where letters are no Latin
_BLOCK = 3  # rows of numbers one below the other that begin a table
_SPACE = " "  # stands for white space of any kind
# The default parser of pandas < 3.1 is off by an ulp for some numbers; later it is exact, and the
# option deprecated.
_EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    else {}
)


def read_csv(path: Path) -> FileTable:
    """Read a text file: separator comma, semicolon, tab or white space; a header if it has one."""
    sheet = _read_sheet(path)
    first = map(sheet.names.index, sheet.names)
    twice = [k for k, j in enumerate(first) if j < k and sheet.cells[j].equals(sheet.cells[k])]
    kept = [k for k in range(len(sheet.names)) if k not in [*sheet.rests.values(), *twice]]
    names = [_mend(sheet.names[k]) for k in kept]

    def load(numbers: Sequence[int], labels: int | None) -> Columns:
        columns = [sheet.column(kept[position]) for position in numbers]
        return columns, None if labels is None else coded(sheet.column(kept[labels]))

    note = "It has no header: its columns are named by their numbers." if sheet.numbered else ""
    table = FileTable(path, names, load, note=note, first_rows=lambda n: sheet.peek(n, kept))
    if sheet.numbered:
        last = max(int(name) for name in names if name.isdecimal())
        table.remarks.append(f"no header, so that columns are numbered from 1 to {last}")
    table.remarks += sheet.remarks
    if sheet.above:
        where = "rows" if sheet.numbered else "header"
        table.remarks.append(f"{counted(sheet.above, 'line')} above the {where} skipped")
    if any(sheet.names[k] for k in twice):
        said = ", ".join(f'"{sheet.names[k]}"' for k in twice if sheet.names[k])
        table.remarks.append(f"equal columns of one name are one: {said}")
    for rest in sheet.rests.values():
        table.remarks.append(f'the nanoseconds of "{sheet.names[rest]}" are added')
    garbled = [name for name in names if name not in sheet.names]
    if garbled:
        table.remarks.append(
            "letters of headers are garbled, as UTF-8 was read as Latin-1, and were mended: "
            f'"{garbled[0]}"'
        )
    if any("\ufffd" in name for name in names):
        table.remarks.append("letters of headers are lost: save the file as UTF-8")
    if sheet.units:
        units = dict(zip(sheet.names, sheet.units, strict=False))
        table.units |= {_mend(name): unit for name, unit in units.items() if unit}
        table.remarks.append("units from the row below the header")
    return table


@dataclass(frozen=True)
class _Sheet:
    """A table of text: the names in its header, and the rows below."""

    path: Path
    text: str
    separator: str
    names: list[str]
    skip: int  # lines before the first row
    header: int = -1  # the line of the header
    above: int = 0  # of these, lines above the header
    units: tuple[str, ...] = ()
    numbered: bool = False  # there is no header
    remarks: tuple[str, ...] = ()

    @cached_property
    def body(self) -> str:
        """The rows; comments among them are blank lines."""
        rows = self.text.split("\n", self.skip)[-1] if self.skip else self.text
        commented = "#" in rows or "%" in rows  # which is much faster to see
        return re.sub(r"(?m)^[ \t]*[#%].*$", "", rows) if commented else rows

    @cached_property
    def cells(self) -> pd.DataFrame:
        return self._parse()

    def _parse(self) -> pd.DataFrame:
        try:
            cells = self._parse_text(self.body)
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            sign = re.escape(self.separator)
            whole = re.sub(rf"(?m)(?<=[^{sign}\s])[{sign} \t]+$", "", self.body)
            try:  # separators at the end of rows
                cells = self._parse_text(whole)
            except (pd.errors.ParserError, pd.errors.ParserWarning):
                raise ValueError(self.wrong_row(str(error))) from error
        for _, column in cells.select_dtypes(exclude="number").items():
            broken = np.flatnonzero(column.astype(str).str.contains("\n"))
            if broken.size:  # two stray quotes make one cell of the rows between them
                raise ValueError(_open_quote(self.path, self.skip + int(broken[0]) + 1))
        return cells

    def _parse_text(self, text: str) -> pd.DataFrame:
        with warnings.catch_warnings():
            # pandas only warns when a row has more cells than the header, and drops the rest.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                io.StringIO(text),
                sep=r"\s+" if self.separator == _SPACE else self.separator,
                header=None,
                names=range(len(self.names)),
                index_col=False,
                skipinitialspace=True,
                low_memory=False,
                **_EXACT,
            )

    def peek(self, count: int | None, columns: Sequence[int]) -> list[Any]:
        """The first cells of columns."""
        return [self.column(k, strict=False)[:count] for k in columns]

    @cached_property
    def rests(self) -> dict[int, int]:
        """Columns of whole seconds, and those of the nanoseconds that belong to them, as in ROS."""
        places = {name: k for k, name in enumerate(self.names)}
        pairs = {}
        for k, name in enumerate(self.names):
            head = re.sub("secs?$", "", name)
            for rest in ("nsecs", "nanosec", "nsec") if head != name else ():
                if f"{head}{rest}" in places:
                    pairs[k] = places[f"{head}{rest}"]
        return pairs

    def column(self, position: int, *, strict: bool = True) -> pd.Series:
        """A column; decimal commas become points if no number of the file has a point."""
        column = self.cells[position]
        if position in self.rests:
            return column + self.cells[self.rests[position]] * 1e-9
        if self.separator == "," or pd.api.types.is_numeric_dtype(column.dtype):
            return column
        commas = column.dropna().astype(str)
        commas = commas[commas.str.match(_DECIMAL_COMMA)]
        if commas.empty or (self._with_points and not strict):
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
        for number, line in enumerate(self.body.split("\n"), self.skip + 1):
            row = _without_end(_split(line, self.separator))
            if len(row) > len(self.names):
                separator = "white space" if self.separator == _SPACE else repr(self.separator)
                return (
                    f"{self.path} cannot be read as a table of "
                    f"{counted(len(self.names), 'column')} separated by {separator}, as "
                    f"in its header ({self.separator.join(self.names)[:60]!r}): line "
                    f"{number} has {len(row)} cells. Every row needs as many cells as the header."
                )
        return f"{self.path}: {said}"


def _read_text(path: Path) -> tuple[str, list[str]]:
    """The text of a file in whatever encoding, with one kind of line end; and what to say of it."""
    content, said = path.read_bytes(), []
    if content[:2] == b"\x1f\x8b":
        with read_as(path, "a gzip archive"):
            content = gzip.decompress(content)
    is_wide = content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    if not is_wide and b"\0" in content:
        raise ValueError(
            f"{path} has a zero byte, which no text has: it is damaged, or not a text "
            "file. Save it again, as UTF-8."
        )
    try:
        text = content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if is_wide:
            raise ValueError(
                f"{path} begins as UTF-16 text, but is none. Save it as UTF-8."
            ) from error
        encoding = _find_encoding(content)
        text = content.decode(encoding, "replace")
        said = [f"it is no UTF-8, and read as {encoding}"] if encoding in _LEGACY else []
    return text.replace("\r\n", "\n").replace("\r", "\n"), said


def _find_encoding(content: bytes) -> str:
    """That of Western Windows for text that is no UTF-8, unless most letters are no Latin."""
    high = re.findall(rb"[\x80-\xff]+", content)
    if sum(len(run) for run in high if len(run) > 2) > len(b"".join(high)) / 2:
        try:
            from charset_normalizer import from_bytes
        except ImportError:
            pass
        else:
            lines = (line for line in content.splitlines() if not line.isascii())
            found = from_bytes(b"\n".join(lines), cp_isolation=_LEGACY).best()
            return "cp1252" if found is None else str(found.encoding)
    return "cp1252"  # what spreadsheets write for the degree sign in "e [°]"


def is_text(path: Path) -> bool:
    """Whether a file begins as text does."""
    with path.open("rb") as file:
        start = file.read(1 << 16)
    is_wide = start[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    return is_wide or not re.search(rb"[\x00-\x08\x0e-\x19\x1c-\x1f]", start)


def _read_sheet(path: Path) -> _Sheet:
    """The table of a text, without what stands before its rows, between and below them."""
    text, said = _read_text(path)
    stamped = len(_ARRIVAL.findall(text, 0, 1 << 16))
    is_serial = 2 * stamped > text.count("\n", 0, 1 << 16)
    sheet = _find_table(path, _ARRIVAL.sub("", text) if is_serial else text)
    sheet = replace(sheet, remarks=(*said, *sheet.remarks))
    if is_serial:
        stamps = [_ARRIVAL.match(line) for line in text.split("\n")[sheet.skip :]]
        before = [stamp[1] if stamp else "" for stamp in stamps]
        remark = 'what a serial monitor wrote before each row is the column "arrival time"'
        sheet = _with_column(sheet, "arrival time", before, remark)
    return _cut(sheet)


def _with_column(sheet: _Sheet, name: str, cells: Sequence[object], remark: str) -> _Sheet:
    """The table with one more column, the first; blank lines stay blank."""
    rows = zip(cells, sheet.body.split("\n"), strict=True)
    body = "\n".join(f"{cell}{sheet.separator}{row}" if row.strip() else "" for cell, row in rows)
    return replace(
        sheet,
        text="\n" * sheet.skip + body,
        names=[name, *sheet.names],
        units=("", *sheet.units) if sheet.units else (),
        remarks=(*sheet.remarks, remark),
    )


def _cut(sheet: _Sheet) -> _Sheet:
    """Leave out what stands below the rows; a table whose header comes again is one of runs."""
    lines = sheet.body.split("\n")
    first = next((k for k, line in enumerate(lines) if line.strip()), 0)
    row = _split(lines[first], sheet.separator)
    head = sheet.text.split("\n", sheet.skip)[: sheet.skip]
    starts = [0]
    if sheet.header >= 0 and f"\n{head[sheet.header]}\n" in sheet.body:
        again = [k for k, line in enumerate(lines) if line == head[sheet.header]]
        starts += [k + sheet.skip - sheet.header for k in again]
        for k in again:
            lines[k : k + sheet.skip - sheet.header] = [""] * (sheet.skip - sheet.header)
    elif "\n\n" in sheet.body.rstrip():  # another table may stand below
        breaks = (k for k in range(first + 1, len(lines) - _BLOCK) if not lines[k].strip())
        other = next((k for k in breaks if _is_words(lines[k + 1], row, sheet.separator)), None)
        rows = [_split(line, sheet.separator) for line in lines[other:]] if other else []
        n_rows = sum(any(map(_is_number, cells)) for cells in rows)
        if other and n_rows >= _BLOCK:
            said = f"another table of {n_rows} rows below line {sheet.skip + other} is not read"
            lines, sheet = lines[:other], replace(sheet, remarks=(*sheet.remarks, said))
    dropped = []
    for start, stop in zip(starts, [*starts[1:], len(lines)], strict=True):
        below: list[int] = []
        for k in range(stop - 1, max(start, first), -1):
            if not lines[k].strip():
                continue
            is_short = _is_short(lines, k, stop, sheet.separator)
            is_empty = not any(_split(lines[k], sheet.separator))
            if not (is_short or is_empty or _is_words(lines[k], row, sheet.separator)):
                break
            below.append(k)
        # Many rows with a word before their numbers are no statistics, but of another label.
        if below and len(below) > min(_ABOVE, below[-1] - start):
            below = [k for k in below if _is_text(lines[k], sheet.separator)]
        dropped += below
    for k in dropped:
        lines[k] = ""
    if dropped:
        place = sheet.skip + min(dropped) + 1
        said = f"{counted(len(dropped), 'line')} below the rows, from line {place}, left out"
        sheet = replace(sheet, remarks=(*sheet.remarks, said))
    if not dropped and len(starts) == 1 and len(lines) == sheet.body.count("\n") + 1:
        return sheet
    sheet = replace(sheet, text="\n" * sheet.skip + "\n".join(lines))
    if len(starts) == 1:
        return sheet
    numbers = np.searchsorted(starts, np.arange(len(lines)), side="right")
    name = next(n for n in ("block", "block of rows") if n not in sheet.names)
    said = f"its header stands {len(starts)} times: each block of rows is a run"
    return _with_column(sheet, name, numbers.tolist(), said)


def _is_words(line: str, row: list[str], sign: str) -> bool:
    """Whether a line has text in the first place of a number, or in half of these or more."""
    cells = _split(line, sign)
    there = [_is_number(c) for c, other in zip(cells, row, strict=False) if c and _is_number(other)]
    many = 2 * sum(there) <= len(there) or not there[0]
    return any(cells) and any(map(_is_number, row)) and many


def _is_text(line: str, sign: str) -> bool:
    """Whether no cell of a line is a number, or hardly any."""
    filled = [_is_number(cell) for cell in _split(line, sign) if cell]
    return 2 * sum(filled) <= len(filled)


def _is_short(lines: list[str], k: int, stop: int, sign: str) -> bool:
    """Whether the last row of all has fewer cells than each of those above it."""
    if any(line.strip() for line in lines[k + 1 : stop]):
        return False
    above = [_split(line, sign) for line in lines[max(k - _ABOVE, 0) : k] if line.strip()]
    return len(above) >= _BLOCK and len(_split(lines[k], sign)) < min(map(len, above))


def _find_table(path: Path, text: str) -> _Sheet:
    """Find separator, header and first row of a text: rows of numbers say where they are."""
    lines = text.split("\n", _FAR)[:_FAR]
    for k in range(len(lines) - 1):  # a name of two lines, in quotes
        if re.search('(^|[\t;, ])"[^"]*$', lines[k]) and re.match(
            '[^"]*"($|[\t;, ])', lines[k + 1]
        ):
            lines[k : k + 2] = "", f"{lines[k]} {lines[k + 1]}"
    first = next((k for k, line in enumerate(lines) if line.strip()), None)
    if first is None:
        raise ValueError(f"{path} is empty.")
    found = max((_find_rows(lines, sign) for sign in "\t;, "), key=lambda rows: rows.weight)
    if not found.weight:  # of one column, or of text
        sign = next((sign for sign in "\t;," if sign in lines[first]), ",")
        return _below(path, text, sign, lines, first, first, _split(lines[first], sign))
    start, sign, width = found.start, found.sign, found.width
    row = _split(lines[start], sign)
    while start and _continues(_split(lines[start - 1], sign), row):  # where numbers are missing
        start -= 1
    above = [k for k in range(start) if not _RULE.match(lines[k].replace(sign, " "))]
    while above:
        names = _names(lines, above[-1], sign, width, row)
        if names and len(above) > 1 and not any(map(_is_number, names)):
            alike = len({bool(_COMMENT.match(lines[k])) for k in above[-2:]}) == 1
            over = _names(lines, above[-2], sign, width, row) if alike else None
            whole = over and all(over) and len(set(over)) == width and above[-2] == above[-1] - 1
            numbers = [_is_number(name) for name in over or []]
            if over and (not all(numbers) if are_units(names) else whole and not any(numbers)):
                return _below(path, text, sign, lines, above[-2], above[-1], over, names)
        if names and not any(map(_is_number, names)):
            return _below(path, text, sign, lines, above[-1], above[-1], names)
        is_comment = _COMMENT.match(lines[above[-1]])
        cells = _without_end(_split(lines[above[-1]], sign))
        if not is_comment and (len(cells) > 1 and sign != _SPACE):
            sheet = _below(path, text, sign, lines, above[-1], above[-1], cells)
            if len(cells) > width:
                return sheet  # rows that end early
            raise ValueError(sheet.wrong_row(""))
        if not is_comment:
            break
        above.pop()
    row = _split(lines[start], sign)
    after = next((_split(line, sign) for line in lines[start + 1 :] if line.strip()), None)
    if after and not _continues(row, after):
        return _below(path, text, sign, lines, start, start, row)
    counted_up = [[str(k + base) for k in range(width)] for base in (0, 1)]
    if after and width > 2 and row in counted_up and float(after[0] or "nan") <= int(row[0]):
        sheet = _below(path, text, sign, lines, start, start, row)
        return replace(
            sheet, remarks=(f"its first row, {', '.join(row)}, is taken for the header",)
        )
    names = [str(k + 1) for k in range(width)]
    return _Sheet(path, text, sign, names, start, above=start - first, numbered=True)


def _continues(row: list[str], after: list[str]) -> bool:
    """Whether a row is one of samples, as the next one is: there are numbers, and no names."""
    return (
        len(row) == len(after)
        and any(map(_is_number, row))
        and not any(
            cell and not _is_number(cell) and _is_number(below)
            for cell, below in zip(row, after, strict=True)
        )
    )


@dataclass(frozen=True)
class _Rows:
    """Rows of numbers in the first lines of a text, if a sign separates their cells."""

    sign: str
    weight: float  # share of filled cells that are numbers; 0 if there are no such rows
    start: int = 0
    width: int = 0


def _find_rows(lines: list[str], sign: str) -> _Rows:
    rows = {k: _without_end(_split(line, sign)) for k, line in enumerate(lines) if line.strip()}
    counts = {k: sum(map(_is_number, row)) for k, row in rows.items()}
    there = [k for k, count in counts.items() if count >= 2]
    if not there:
        return _Rows(sign, 0.0)
    widths = [len(rows[k]) for k in there]
    width = max(set(widths), key=lambda w: (widths.count(w), w))
    there = [k for k in there if len(rows[k]) == width]
    places = {k: place for place, k in enumerate(rows)}
    blocks = np.split(there, np.flatnonzero(np.diff([places[k] for k in there]) != 1) + 1)
    block = next((b for b in blocks if len(b) >= _BLOCK), max(blocks, key=len))
    there = [k for k in there if k >= block[0]]  # settings above have numbers too
    filled = sum(cell.strip() != "" for k in there for cell in rows[k])  # an empty cell is missing
    share = sum(counts[k] for k in there) / filled
    return _Rows(sign, share, int(block[0]), width)


def _names(lines: list[str], k: int, sign: str, width: int, row: list[str]) -> list[str] | None:
    """The cells of a line as names of columns, if there are as many; units may stand apart."""
    line = lines[k]
    bare = line[comment.end() :] if (comment := _COMMENT.match(line)) else line
    stands_apart = comment and comment[0][-1].isspace()  # no part of the first name
    for text in (bare, line) if stands_apart else (line, bare):
        ways = [_split(text, sign)]
        if sign == _SPACE or text != line:  # a header may be written otherwise than the rows
            ways += [_split(text, other) for other in "\t;, "]
        if sign == _SPACE:
            ways += [re.split(r"\s{2,}|\t", text.strip())]
            whole = re.sub(r"\s+(?=[\[(][^\])]*[\])])", "\0", text)
            ways += [[cell.replace("\0", " ") for cell in _split(whole, sign)]]
        for cells in ways:
            for names in (cells, _without_end(cells)):
                if len(names) == width:
                    return names
            if len(cells) == width - 1 and lines[k + 1].startswith('"'):
                return ["", *cells]  # numbers of rows, as R writes them
    return None


def _below(
    path: Path,
    text: str,
    sign: str,
    lines: list[str],
    header: int,
    last: int,
    names: list[str],
    units: list[str] | None = None,
) -> _Sheet:
    """The table whose header stands in a line; ``last`` is that of the units below it."""
    if lines[header].count('"') % 2:
        raise ValueError(_open_quote(path, header + 1))
    if not any(line.strip() for line in text.split("\n", last + 1)[last + 1 :]):
        raise ValueError(f"{path} has a header but no rows.")
    while (
        last + 1 < len(lines)
        and re.search("[-=_]{3}", lines[last + 1])
        and _RULE.match(lines[last + 1].replace(sign, " "))
    ):
        last += 1
    first = next(k for k, line in enumerate(lines) if line.strip())
    found = tuple(map(_unit_in, units or ()))
    names = [name.strip() for name in names]
    return _Sheet(path, text, sign, names, last + 1, header, header - first, found)


def _split(line: str, sign: str) -> list[str]:
    line = " ".join(line.split()) if sign == _SPACE else line
    if '"' not in line:
        return [cell.strip() for cell in line.split(sign)]
    try:
        row = next(csv.reader([line], delimiter=sign, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 128 kB
        return [line]
    return [cell.strip() for cell in row]


def _without_end(cells: list[str]) -> list[str]:
    """Cells without the empty ones at the end."""
    end = len(cells)
    while end and not cells[end - 1]:
        end -= 1
    return cells[:end]


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
