"""The files that a user names, and what each is once it is open: a table."""

from __future__ import annotations

import difflib
import glob
import importlib
import os
import re
import reprlib
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import ColumnError

_BOOKS = (".xlsx", ".xlsm")  # of which one sheet can be named behind #
Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


def expand_paths(paths: Paths) -> list[Path]:
    """List the files; lists keep their order, the matches of a pattern are in natural order."""
    items = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    if not items:
        raise ValueError("paths is empty: name at least one file or glob pattern.")
    return [path for item in items for path in _expand(item)]


def shown(name: str | os.PathLike[str]) -> str:
    r"""A file name that can be printed: bytes that are not UTF-8 become ``\xff``."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _expand(item: Any) -> list[Path]:
    if not isinstance(item, str | os.PathLike):
        raise TypeError(
            f"paths must be a path, a glob pattern or a list of these; it holds {item!r} "
            f"({type(item).__name__})."
        )
    path = Path(item).expanduser()
    book, sign, sheet = str(path).partition("#")
    if sign and book.casefold().endswith(_BOOKS):
        return [Path(f"{one}#{sheet}") for one in _expand(book)]
    if path.is_dir():
        return find_files(path)[0]
    # A file whose name has brackets is taken as a file before it is taken as a pattern.
    if path.is_file():
        return [path]
    pattern = os.fspath(path)
    if glob.has_magic(pattern):
        found = [Path(name) for name in glob.glob(pattern, recursive=True)]
        files = sorted((match for match in found if match.is_file()), key=_natural)
        if not files:
            raise FileNotFoundError(
                f"No file matches the pattern {pattern!r} (working folder: {Path.cwd()})."
            )
        return files
    if path.exists():
        raise ValueError(f"{path} is not a regular file and cannot be read.")
    raise FileNotFoundError(f"There is no file {path} (working folder: {Path.cwd()}).")


MOTION = "_motion.tsv"
# Tables beside the recordings in a data set of BIDS, and notes.
_ASIDE = ("participants", "_channels", "_events", "_scans", "_sessions", "samples", "readme")
_NOTES = (".txt", ".log")  # that may stand beside recordings of another kind


def find_files(folder: Path) -> tuple[list[Path], int]:
    """The recordings in a folder and those below it, and how many other files were left out."""
    from .delimited import is_text
    from .reading import READERS

    there = [
        path
        for path in folder.rglob("*")
        if path.is_file()
        and not any(part.startswith((".", "_", "~$")) for part in path.relative_to(folder).parts)
    ]
    found = [path for path in there if path.suffix.lower() in READERS]
    found = found or [path for path in there if path.stat().st_size and is_text(path)]
    motion = [path for path in found if path.name.endswith(MOTION)]
    kept = motion or [path for path in found if not _is_aside(path.stem)]
    if not kept:
        raise FileNotFoundError(
            f"The folder {shown(folder)} has no file that can be read ({', '.join(READERS)})."
        )
    kinds = Counter(path.suffix.lower() for path in kept)
    if len(set(kinds) - {*_NOTES}) == 1:
        kinds = Counter({kind: n for kind, n in kinds.items() if kind not in _NOTES})
    if len(kinds) > 1:
        counts = ", ".join(f"{number} {kind}" for kind, number in kinds.most_common())
        example = os.fspath(folder / "**" / f"*{kinds.most_common(1)[0][0]}")
        raise ValueError(
            f"The folder {shown(folder)} has files of several kinds ({counts}): say which are the "
            f"recordings, as {example!r}, or with a pattern."
        )
    kept = [path for path in kept if path.suffix.lower() in kinds]
    return sorted(kept, key=_natural), 0 if motion else len(found) - len(kept)


def _is_aside(stem: str) -> bool:
    stem = stem.casefold()
    return any(stem == name or (name[0] == "_" and stem.endswith(name)) for name in _ASIDE)


def _natural(path: Path) -> list[Any]:
    """Sort run2 before run10."""
    parts = re.split(r"(\d+)", os.fspath(path))
    # re.split alternates text and digits, so equal positions always hold equal types.
    return [int(part) if part.isdecimal() else part for part in parts]


# A bracket is a unit; a parenthesis only if it holds a letter or a unit sign, not in "e (2)".
_HEADER = re.compile(
    r"^(?P<name>.*\S)(?:\s*\[(?P<square>[^\[\]]*)\]|\s+\((?P<round>[^()]*[^\W\d_][^()]*|[%°])\))$"
)
_MOST_NAMES = 30
_DATE = re.compile(r"\s*\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]")
_SHUFFLED = 0.01  # falls of a clock in a row, from which they are no beginnings of runs
_CLOSE = 0.6  # likeness of names, from 0 to 1
# Columns, and the codes and labels of one of them if it is asked for.
Columns = tuple[list[Any], tuple[np.ndarray, list[Any]] | None]


def split_header(header: str) -> tuple[str, str | None]:
    """Split ``"e [deg]"`` or ``"e (deg)"`` into name and unit; the unit is None without one."""
    match = _HEADER.match(header)
    if match is None:
        return header, None
    square = match["square"]
    return match["name"], (match["round"] if square is None else square).strip() or None


def require(module: str, what: str, extra: str = "io") -> Any:
    """Import an optional package, or say which extra installs it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f'{what} needs the package {module}: pip install "skhoid[{extra}]"'
        ) from error


@contextmanager
def read_as(path: Path, kind: str) -> Iterator[None]:
    """Name the file on which a library fails: damaged ones make it fail in many ways."""
    try:
        yield
    except ImportError:
        raise
    except MemoryError as error:  # it has no text
        raise ValueError(
            f"{path} cannot be read as {kind}: its declared contents need more memory than there "
            "is. Either it is damaged, or its runs must be stored in several files."
        ) from error
    except Exception as error:
        raise ValueError(f"{path} cannot be read as {kind}: {error}") from error


@dataclass
class FileTable:
    """The columns (or MATLAB variables) of one file, read when asked for.

    ``names`` may repeat; ``load`` takes positions in it, and that of a column of labels.
    ``unreadable`` says what a name holds instead of numbers, and ``note`` is added to the error
    about a name that is not there. ``first_rows`` gives those of all columns where ``load`` is
    slow. ``run_name`` is the column that numbers runs where the format itself has them; ``remarks``
    tell how the file is built, and ``faults`` what is wrong with that. ``aliases`` are other names
    of columns, and ``resolve`` adds a column that has a name only when it is asked for.
    """

    path: Path
    names: list[str]
    load: Callable[[Sequence[int], int | None], Columns]
    units: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    note: str = ""
    kind: str = "column"
    first_rows: Callable[[int | None], list[Any]] | None = None
    run_name: str | None = None
    remarks: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    aliases: dict[str, str] = field(default_factory=dict)
    resolve: Callable[[str], bool] | None = None

    def peek(self, count: int | None = None) -> list[Any]:
        """All samples of each column, or the first; of its first run if its columns are runs."""
        if self.first_rows is not None:
            return self.first_rows(count)
        columns, _ = self.load(range(len(self.names)), None)
        return [
            (values if isinstance(values, pd.Series) else first_run(values))[:count]
            for values in columns
        ]

    def where(self, name: str) -> str:
        """Name a column for an error message."""
        return f"{self.kind} {name!r} of {self.path}"

    def find(self, asked: str) -> int:
        """Position of the column with this header, or else with this name before its unit."""
        asked = self.aliases.get(asked, asked)
        hits = [i for i, name in enumerate(self.names) if name == asked]
        if not hits:
            hits = [i for i, name in enumerate(self.names) if split_header(name)[0] == asked]
        if not hits and self.kind == "column" and len(set(self.names)) < len(self.names):
            hits = [k for k in range(len(self.names)) if asked == str(k + 1)]
        if not hits and self.resolve is not None and self.resolve(asked):
            hits = [len(self.names) - 1]
        if len(hits) == 1:
            return hits[0]
        if hits:
            headers = [self.names[i] for i in hits]
            advice = (
                "rename all but one in the file"
                if len(set(headers)) < len(headers)
                else "name one of them by its whole header"
            )
            text = f"as {len(hits)} {self.kind}s {asked!r}, with the headers {headers}: {advice}."
            raise ColumnError(f"{self.path} h{text}", f"H{text}")
        parts = asked.split(".")
        for depth in range(len(parts), 0, -1):
            name = ".".join(parts[:depth])
            # If the struct is there, its field is what is missing.
            is_open = any(other.startswith(f"{name}.") for other in self.names)
            if name in self.unreadable and (name == asked or not is_open):
                raise ColumnError(f"In {self.path}, {name!r} {self.unreadable[name]}")
        raise self._missing(asked)

    def unit_of(self, position: int) -> str | None:
        """Unit from the header, or stored with the file."""
        header = self.names[position]
        name, unit = split_header(header)
        return unit or self.units.get(header) or self.units.get(name)

    def _missing(self, asked: str) -> ColumnError:
        named = [name for name in self.names if name]
        short = [split_header(name)[0] for name in named]
        folded = {name.casefold(): name for name in [*short, *named]}
        if self.kind == "variable":
            folded |= {name.casefold(): name for name in self.unreadable}
            folded = {key: name for key, name in folded.items() if _same_field(asked, key)}
        close = difflib.get_close_matches(asked.casefold(), folded, n=3, cutoff=_CLOSE)
        listed = ", ".join(repr(name) for name in named[:_MOST_NAMES])
        if len(named) > _MOST_NAMES:
            listed += f" and {len(named) - _MOST_NAMES} more"
        near = " or ".join(repr(folded[name]) for name in close)
        near = f" Did you mean {near}?" if near else ""
        there = f"{self.path} has no {self.kind} {asked!r}. It has: {listed or 'none'}."
        return ColumnError(
            f"{there}{near} {self.note}".rstrip(), f"There is no {self.kind} {asked!r}.{near}"
        )


def _same_field(asked: str, name: str) -> bool:
    """Whether fields of structs are alike by their own names; in one struct all share its name."""
    one, other = (text.casefold().rpartition(".")[2] for text in (asked, name))
    return difflib.SequenceMatcher(None, one, other).ratio() >= _CLOSE


def in_order(table: FileTable) -> FileTable:
    """A table whose rows are sorted by the dates in one column, if these all differ."""
    for name, raw in zip(table.names, table.peek(), strict=True):
        series = raw if isinstance(raw, pd.Series) else pd.Series(np.ravel(raw))
        first = str(series.iloc[0]) if series.size else ""
        if not (
            series.dtype.kind == "M" or (series.dtype.kind not in "biufc" and _DATE.match(first))
        ):
            continue
        clock = read_clock(series)
        falls = np.count_nonzero(np.diff(clock) < 0)
        if falls < _SHUFFLED * clock.size or np.unique(clock[np.isfinite(clock)]).size < clock.size:
            continue
        order = np.argsort(clock)

        def load(numbers: Sequence[int], labels: int | None, order: Any = order) -> Columns:
            columns, coded = table.load(numbers, labels)
            columns = [pd.Series(np.ravel(values)).iloc[order] for values in columns]
            return columns, coded and (coded[0][order], coded[1])

        remark = f'rows are not in the order of time, and are sorted by "{name}"'
        return replace(table, load=load, first_rows=None, remarks=[*table.remarks, remark])
    return table


def first_run(values: Any, axis: int = 0) -> np.ndarray:
    """Samples, which lie along ``axis``, of the first run of an array that has numbers."""
    values = squeezed(np.asarray(values))
    if values.ndim == 1:
        return values
    runs = np.moveaxis(values, min(axis, values.ndim - 1), 0)
    runs = runs.reshape(len(runs), -1)
    measured = np.isfinite(runs).any(axis=0) if runs.dtype.kind == "f" else [True]
    return runs[:, int(np.argmax(measured))]


def squeezed(values: np.ndarray) -> np.ndarray:
    """Without dimensions of one at the end, as MATLAB has them; a row or column is a vector."""
    while values.ndim > 1 and values.shape[-1] == 1:
        values = values[..., 0]
    if values.ndim == 2 and values.shape[0] == 1:
        values = values[0]
    return np.atleast_1d(values)


def one_by_one(load: Callable[[int], Any]) -> Callable[[Sequence[int], int | None], Columns]:
    """Load columns of a file in which each can be read alone."""

    def load_all(numbers: Sequence[int], labels: int | None) -> Columns:
        columns = [load(position) for position in numbers]
        return columns, None if labels is None else coded(load(labels))

    return load_all


def coded(labels: Any) -> tuple[np.ndarray, list[Any]]:
    """Labels in order of appearance, and which of them each row has; -1 is a missing one."""
    values = labels if isinstance(labels, pd.Series) else pd.Series(np.ravel(labels))
    codes, found = pd.factorize(values)
    return codes, pd.Index(found).tolist()


def _read_float(cell: Any) -> float:
    """A cell as a number, infinite if it is too large; NaN if it is not a number."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan


def as_numbers(values: Any, where: str) -> np.ndarray:
    """Float64 array of a column, or an error that names the first value that is not a number."""
    series = values if isinstance(values, pd.Series) else None
    dtype = np.asarray(values).dtype if series is None else series.dtype
    if pd.api.types.is_complex_dtype(dtype):
        raise ValueError(
            f"{where} is complex: give real signals, such as its real part or its magnitude."
        )
    if pd.api.types.is_datetime64_any_dtype(dtype) or pd.api.types.is_timedelta64_dtype(dtype):
        raise ValueError(
            f"{where} holds dates or time differences ({dtype}): store seconds as numbers, such "
            "as (t - t[0]).dt.total_seconds()."
        )
    if pd.api.types.is_numeric_dtype(dtype):
        if series is None:
            return np.asarray(values, dtype=np.float64)
        return series.to_numpy(dtype=np.float64, na_value=np.nan)
    text = pd.Series(np.asarray(values).ravel(), dtype=object) if series is None else series
    try:
        numbers = pd.to_numeric(text, errors="coerce")
    except OverflowError:  # an integer of more than 308 digits
        numbers = text.map(_read_float).astype(np.float64)
    bad = np.flatnonzero(numbers.isna().to_numpy() & text.notna().to_numpy())
    if bad.size:
        advice = "Leave a cell empty, or write NaN, where nothing was measured."
        if bad.size == text.size:
            advice = "Name another column, or store it as numbers, time in seconds."
        elif bad.size == 1 and bad[0] == 0:
            advice = (
                "If that is a unit, delete the row, and write units into the header, as in 'e "
                "[deg]'."
            )
        raise ValueError(
            f"{where} is not numeric: row {bad[0] + 1} (the first sample is row 1) is "
            f"{reprlib.repr(text.iloc[bad[0]])} ({bad.size} of {text.size} rows are not numbers). "
            f"{advice}"
        )
    return numbers.to_numpy(dtype=np.float64, na_value=np.nan)


_DAY = 86400.0  # s
_SHORTEST = 1e-5  # of a clock in s, whose steps are longer: it would be 0.9 s in days
_TIME_OF_DAY = re.compile(
    r"(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:[.,:]\d+)?)"
    r"\s*(?:([AaPp])\.?\s?[Mm]\.?)?\s*(?:Z|UTC|GMT|[+-]\d\d:?\d\d)?$"
)


def read_clock(raw: Any) -> np.ndarray:
    """A column of times as numbers; dates and times of day as seconds from the first of them.

    A time of day that falls by more than half a day has passed midnight.
    """
    series = raw if isinstance(raw, pd.Series) else pd.Series(np.ravel(raw))
    numbers = numbers_of(series)
    if 2 * np.isfinite(numbers).sum() >= series.notna().sum():
        return _DAY * _since_first(numbers) if _are_days(numbers) else numbers
    if series.dtype.kind in "mM":
        return (series - series[series.first_valid_index()]).dt.total_seconds().to_numpy()
    texts = series.where(series.notna(), "").astype(str).str.strip().tolist()
    found = [_TIME_OF_DAY.search(text) for text in texts]
    if 2 * sum(map(bool, found)) < series.notna().sum():
        return numbers
    hours, minutes, seconds = np.array(
        [
            (float(m[1] or 0), float(m[2]), float(re.sub("[,:]", ".", m[3]))) if m else [np.nan] * 3
            for m in found
        ]
    ).T
    half = np.array([(m[4] or "").casefold() if m else "" for m in found])
    hours = np.where(half == "", hours, hours % 12 + 12 * (half == "p"))
    time = 3600 * hours + 60 * minutes + seconds
    dates = pd.Series(
        [t[: m.start()].rstrip("T_, ") if m else "" for t, m in zip(texts, found, strict=True)]
    )
    if dates.str.len().max() > 0:
        return _since_first(time + _DAY * dates.map(_days_of(dates)).to_numpy(dtype=float))
    twelve = (half == "").all() and np.nanmin(hours) >= 1 and np.nanmax(hours) < 13
    whole = _DAY / 2 if twelve else _DAY
    return _since_first(time + whole * np.cumsum(np.diff(time, prepend=time[0]) < -whole / 2))


def is_plain_clock(raw: Any) -> bool:
    """Whether times are numbers, and not dates, times of day or days."""
    numbers = numbers_of(raw)
    return bool(np.isfinite(numbers).any()) and not _are_days(numbers)


def _are_days(numbers: np.ndarray) -> bool:
    """Whether a clock counts days, as MATLAB's datenum and Excel do, in years from 1998 to 2064."""
    there = numbers[np.isfinite(numbers)]
    if there.size < 3:
        return False
    step = float(np.median(np.diff(there)))
    of_matlab, of_excel = (730_000, 754_000), (35_800, 60_000)
    inside = any(low < there.min() and there.max() < high for low, high in (of_matlab, of_excel))
    return inside and 0 < step < _SHORTEST


def _since_first(time: np.ndarray) -> np.ndarray:
    there = time[np.isfinite(time)]
    return time - there[0] if there.size else time


def _days_of(dates: pd.Series) -> dict[str, float]:
    """Days of dates as they are written, from an arbitrary one; NaN where one cannot be read."""
    written = [date for date in dates.unique() if date]
    spans = {date: re.fullmatch(r"(-?\d+) days?", date) for date in written}
    if all(spans.values()):
        return {date: float(span[1]) for date, span in spans.items() if span}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # each date may be of another form
        ways = [
            pd.to_datetime(pd.Series(written), errors="coerce", dayfirst=first, format="mixed")
            for first in (True, False)
        ]
    days = min(ways, key=lambda way: (way.isna().sum(), way.max() - way.min()))
    return dict(zip(written, (days - days[0]).dt.total_seconds() / _DAY, strict=True))


def numbers_of(raw: Any) -> np.ndarray:
    """A column as float64, NaN where there is no number."""
    series = raw if isinstance(raw, pd.Series) else pd.Series(np.ravel(raw))
    if series.dtype.kind in "mM":
        return np.full(len(series), np.nan)
    if series.dtype == object or not pd.api.types.is_numeric_dtype(series.dtype):
        texts = series.astype(str).str.replace(",", ".", regex=False)
        series = pd.to_numeric(texts, errors="coerce")
    if series.dtype.kind == "c":
        return np.full(len(series), np.nan)
    return series.to_numpy(dtype=float, na_value=np.nan)
