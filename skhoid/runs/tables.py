"""Tables as users have them: what marks their rows, and what is refused and by which words."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.sparse import issparse

from ..exceptions import RunIndexError
from .roles import (
    LABEL_WORDS,
    LABELS,
    OUTER,
    OUTER_WORDS,
    RUN,
    TIME,
    label_word,
    names_time,
    plain_name,
)

JITTER_TOLERANCE = 0.10  # of a sampling time; beyond it, lags in samples mean nothing
RUN_IN_LEVEL = "run-in"
_RUN_COLUMN_LEVEL = "runs from column "  # and the name of a column that is no input
_DECIMATION_LEVEL = re.compile(r"^decimation 1/(\d+) (\S+) (\S+)$")
_ARRAY_LIKE = ("__len__", "shape", "__array__")
_CLOCKS = (TIME, "t", "timestamp", "seconds")  # of which only "time" can be nothing else
_TICKS = 0.9  # share of a clock's steps that are alike
_SHARE = 0.1  # most stretches of labels in a row, on average


@dataclass(frozen=True)
class DecimationMark:
    """What :class:`skhoid.Decimator` says about the rows it marks: factor, filter and its ends."""

    factor: int
    method: str
    padding: str

    @property
    def level(self) -> str:
        return f"decimation 1/{self.factor} {self.method} {self.padding}"


def mark_run_in(frame: pd.DataFrame, trimmed: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the run-in rows marked in an extra index level."""
    return _with_level(frame, RUN_IN_LEVEL, trimmed)


def mark_decimated(frame: pd.DataFrame, mark: DecimationMark, kept: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the kept rows marked in an extra index level."""
    return _with_level(frame, mark.level, kept)


def mark_run_column(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return ``frame`` with the name of its run column in an extra index level."""
    return _with_level(frame, _RUN_COLUMN_LEVEL + column, np.zeros(len(frame)))


def _with_level(frame: pd.DataFrame, name: str, values: np.ndarray) -> pd.DataFrame:
    index = frame.index
    if not isinstance(index, pd.MultiIndex):
        raise TypeError("marks are carried by a run and time index")
    frame.index = pd.MultiIndex(
        levels=[*index.levels, [False, True]],
        codes=[*index.codes, values.astype(np.int8)],
        names=[*index.names, name],
        verify_integrity=False,
    )
    return frame


def is_mark(level: str) -> bool:
    return (
        level == RUN_IN_LEVEL
        or level.startswith(_RUN_COLUMN_LEVEL)
        or _DECIMATION_LEVEL.match(level) is not None
    )


def read_marks(index: pd.MultiIndex) -> dict[str, Any]:
    """What the marks of an index say: ``trimmed``, ``mark`` and ``kept``, ``run_column``."""
    found: dict[str, Any] = {}
    for position, name in enumerate(map(str, index.names)):
        if name == RUN_IN_LEVEL:
            found["trimmed"] = index.get_level_values(position).to_numpy(dtype=bool)
        elif match := _DECIMATION_LEVEL.match(name):
            found["kept"] = index.get_level_values(position).to_numpy(dtype=bool)
            found["mark"] = DecimationMark(int(match[1]), match[2], match[3])
        elif name.startswith(_RUN_COLUMN_LEVEL):
            found["run_column"] = name.removeprefix(_RUN_COLUMN_LEVEL)
    return found


def refuse_container(X: Any) -> None:
    """Refuse by name what is not a table of channels, and say what to pass instead."""
    if isinstance(X, pd.Series):
        raise ValueError("X is a Series, but a 2-dimensional table is needed: pass X.to_frame().")
    library = type(X).__module__.partition(".")[0]
    if isinstance(X, dict) and not issparse(X):  # scikit-learn refuses sparse ones, some dicts
        instead = "pandas.DataFrame(X)"
    elif library == "pyarrow":
        instead = "X.to_pandas()"
    elif isinstance(X, np.ndarray) and X.dtype.kind == "V":  # structured, or bytes without a type
        instead = "pandas.DataFrame(X), or a plain array of numbers"
    elif library == "polars" and hasattr(X, "collect"):
        instead = "X.collect()"
    elif isinstance(X, (str, bytes)) or not any(hasattr(X, name) for name in _ARRAY_LIKE):
        instead = "a DataFrame or an array with one row per sample"
    else:
        return
    raise TypeError(
        f"X is a {type(X).__name__}, which is not supported: pass {instead}, best with levels "
        "'run' and 'time' in its index."
    )


def refuse_flat(X: Any, *, dt: float | None, run: Any) -> None:
    """Refuse a table whose run or time is a column that nothing names.

    It would be taken for one run with ``dt=1``. A run column is named by ``run=``; with ``dt=`` a
    column of times is just a channel, unless it shows several runs.
    """
    table = _Columns(X)
    label = None if run is not None else table.label()
    clock = None if table.level == TIME else table.clock()
    if clock is not None and dt is not None and (run is not None or not table.goes_back(clock)):
        clock = None
    if label is None and clock is None:
        return
    found = " and ".join(repr(name) for name in (label, clock) if name is not None)
    as_one = " of one run" if run is None else ""
    raise RunIndexError(
        f"X has {found} among its columns, which count as channels{as_one}. "
        f"{table.remedy(label, clock)} If {found} holds signals, give it another name."
    )


class _Columns:
    """Columns of a table, and the level of its row index if that is but one."""

    def __init__(self, X: Any) -> None:
        self.X = X
        self.names = list(getattr(X, "columns", ()))
        index = getattr(X, "index", None)
        self.level = index.name if isinstance(index, pd.Index) else None
        self._all = self.names if self.level is None else [self.level, *self.names]

    def _called(self, wanted: str) -> Iterator[tuple[Any, np.ndarray]]:
        """Names that are a word but for their unit, and values."""
        for name in self._all:
            if plain_name(name) == wanted:
                yield name, self._values(name)

    def _values(self, name: Any) -> np.ndarray:
        if name == self.level:
            return self.X.index.to_numpy()
        if isinstance(self.X, pd.DataFrame):
            return self.X.iloc[:, self.names.index(name)].to_numpy()
        return np.asarray(self.X[name])

    def _like(self, word: str) -> Iterator[tuple[Any, np.ndarray]]:
        """Names that hold a word, as ``trial_id`` does, and values; exact ones are not among."""
        for name in self._all:
            if label_word(name) == word and plain_name(name) not in (*LABELS, *OUTER):
                yield name, self._values(name)

    def label(self) -> Any:
        """The column that tells runs apart, if there is one."""
        for word in LABEL_WORDS:
            for name, values in self._called(word) if word in LABELS else ():
                if word == RUN or 1 < len(pd.unique(values)) < 0.1 * len(values):
                    return name
            for name, values in self._like(word):
                if labelled_stretches(values, word) > 1:
                    return name
        return None

    def clock(self) -> Any:
        """The column of times, if there is one."""
        for word in _CLOCKS:
            for name, values in self._called(word):
                if word == TIME or advances_evenly(values):
                    return name
        near = (n for n in self._all if names_time(n) and plain_name(n) not in _CLOCKS)
        return next((name for name in near if advances_evenly(self._values(name))), None)

    def goes_back(self, name: Any) -> bool:
        values = self._values(name)
        return values.dtype.kind in "iufmM" and bool(np.any(values[1:] < values[:-1]))

    def remedy(self, label: Any, clock: Any) -> str:
        """What to write instead."""
        timed = self.level == TIME or clock is not None
        clock = TIME if self.level == TIME or clock is None else clock
        text, more = "Put run and time, in seconds, into the row index: ", ""
        if not timed:
            text = "Add a column 'time' in seconds, and put both into the row index: "
        if label is None and self.goes_back(clock):
            times = "X.index.to_series()" if clock == self.level else f"X[{clock!r}]"
            label, more = RUN, f" after X['run'] = ({times}.diff() < 0).cumsum()"
        text += f"{self._write_index(label, clock)}{more}; y keeps its rows."
        by_run = "" if label is None or more else f"run={label!r}"
        by_dt = "" if self.level == TIME else "dt=, the sampling time in seconds"
        return f"{text} Or pass {' and '.join(filter(None, (by_run, by_dt)))}."

    def _write_index(self, label: Any, clock: Any) -> str:
        """The call that makes the row index of these columns, and of outer levels beside them."""
        outer: dict[Any, str] = {}
        for word, wanted in OUTER_WORDS.items() if label is not None else ():
            named = [name for name, _ in self._called(word)] if word in OUTER else []
            named += [n for n, values in self._like(word) if labelled_stretches(values, word)]
            for name in named:
                if name != label and wanted not in outer.values():
                    outer[name] = wanted
        names = outer | {label: RUN, clock: TIME}
        renamed = {old: new for old, new in names.items() if old not in (None, new)}
        levels = [*outer.values(), *([] if label is None else [RUN]), TIME]
        text = "X = X" if isinstance(self.X, pd.DataFrame) else "X = X.to_pandas()"
        if self.level is not None:
            text += ".reset_index()"
        if renamed:
            text += f".rename(columns={renamed})"
        return f"{text}.set_index({levels if len(levels) > 1 else levels[0]!r})"


def labelled_stretches(values: np.ndarray, word: str) -> int:
    """Number of stretches of rows that a column labels by whole numbers or text; 0: it does not."""
    try:
        codes, labels = pd.factorize(values)
    except TypeError:  # lists, say
        return 0
    if values.dtype.kind == "f":
        whole = bool(np.all(labels == np.floor(labels)))
    else:
        whole = values.dtype.kind in "iu" or all(isinstance(label, str) for label in labels)
    stretches = 1 + int(np.count_nonzero(codes[1:] != codes[:-1]))
    # A signal may well be called block, and come back to its values.
    once = word != "block" or stretches == len(labels)
    return stretches if whole and once and stretches < _SHARE * values.size else 0


def advances_evenly(values: np.ndarray) -> bool:
    """Whether values advance by equal steps, but where runs begin anew."""
    if values.dtype.kind not in "iuf" or values.size < 3:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        step = np.diff(values.astype(float))
        typical = np.median(step)
        even = np.abs(step - typical) <= JITTER_TOLERANCE * typical
    return bool(typical > 0 and np.mean(even) >= _TICKS)


def as_frame(data: Any) -> pd.DataFrame:
    """Channels with their names; those of an array are x0, x1 ..."""
    if isinstance(data, pd.DataFrame):
        return data
    frame = pd.DataFrame(np.asarray(data))
    names = getattr(data, "columns", None)
    return frame.rename(columns="x{}".format) if names is None else frame.set_axis(names, axis=1)


def fingerprint_of(*tables: Any) -> str:
    """SHA-256 of index, names and values, in the order of rows; numbers as 64-bit floats."""
    digest = hashlib.sha256()
    for table in tables:
        data = pd.DataFrame(table) if isinstance(table, pd.Series) else as_frame(table)
        for name, values in _parts(data):
            if np.issubdtype(values.dtype, np.number):
                content = np.ascontiguousarray(values, dtype=float).tobytes()
            else:  # run labels that are text
                content = repr(values.tolist()).encode()
            digest.update(repr(name).encode() + content)
    return digest.hexdigest()


def _parts(data: pd.DataFrame) -> Iterator[tuple[Any, np.ndarray]]:
    # A level and a column may have one name.
    for name in range(data.index.nlevels):
        level = data.index.get_level_values(name)
        yield ("level", level.name), level.to_numpy()
    for name, column in data.items():
        yield name, column.to_numpy()
