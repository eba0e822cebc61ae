"""Tables with run and time as columns, where they would count as channels of one run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunIndexError
from .clock import RUN, TIME
from .words import (
    LABEL_WORDS,
    OUTER_WORDS,
    advances_evenly,
    in_milliseconds,
    label_word,
    labelled_stretches,
    names_time,
)

OUTER = ("subject", "condition")
LABELS = (RUN, "trial", "subject")  # of which only "run" can be nothing else
CLOCKS = (TIME, "t", "timestamp", "seconds")  # of which only "time" can be nothing else
_UNIT = re.compile(r"\s*(\([^()]*\)|\[[^][]*\])\s*$")


def plain_name(name: Any) -> str:
    """A name in lower case and without its unit: ``Time [s]`` is ``time``."""
    return _UNIT.sub("", name).strip().casefold() if isinstance(name, str) else ""


def not_channels(names: Iterable[Any]) -> list[Any]:
    """Those of the names that are labels or clocks of rows, never signals."""
    return [name for name in names if plain_name(name) in (*LABELS, *OUTER, TIME)]


def refuse_flat(X: Any, *, dt: float | None, run: Any) -> None:
    """Refuse a table whose run or time is a column that nothing names.

    It would be taken for one run with ``dt=1``. A run column is named by ``run=``; with ``dt=`` a
    column of times is just a channel, unless it shows several runs.
    """
    table = _Columns(X)
    label = None if run is not None else table.label()
    clock = None if table.timed else table.clock()
    if clock is not None and dt is not None and (run is not None or not table.goes_back(clock)):
        clock = None
    if label is None and clock is None:
        return
    found = [name for name in (label, clock) if name is not None]
    many = len(found) > 1
    unsure = label is not None and plain_name(label) not in (*LABELS, *OUTER)
    raise RunIndexError(
        f"X has {' and '.join(map(repr, found))} as {'columns' if many else 'a column'}, where "
        f"{'they count' if many else 'it counts'} as {'channels' if many else 'a channel'}"
        + (" of one run" if run is None else "")
        + (", with dt = 1" if dt is None and not table.timed else "")
        + f". {table.remedy(label, clock)}"
        + (f" If {label!r} is a channel, give it another name." if unsure else "")
    )


class _Columns:
    """Columns of a table, and the level of its row index if that is but one."""

    def __init__(self, X: Any) -> None:
        self.X = X
        self.names = list(getattr(X, "columns", ()))
        index = getattr(X, "index", None)
        self.level = index.name if isinstance(index, pd.Index) else None
        self.timed = self.level == TIME
        self._all = self.names if self.level is None else [self.level, *self.names]

    def _called(self, wanted: tuple[str, ...]) -> Iterator[tuple[str, Any, np.ndarray]]:
        """Plain name, name and values, in the order wanted."""
        for kind in wanted:
            for name in self._all:
                if plain_name(name) == kind:
                    yield kind, name, self._values(name)

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
            for _, name, values in self._called((word,) if word in LABELS else ()):
                if word == RUN or 1 < len(pd.unique(values)) < 0.1 * len(values):
                    return name
            for name, values in self._like(word):
                if labelled_stretches(values, word) > 1:
                    return name
        return None

    def clock(self) -> Any:
        """The column of times, if there is one."""
        for kind, name, values in self._called(CLOCKS):
            if kind == TIME or advances_evenly(values):
                return name
        for name in self._all:
            near = names_time(name) and plain_name(name) not in CLOCKS
            if near and advances_evenly(self._values(name)):
                return name
        return None

    def goes_back(self, name: Any) -> bool:
        values = self._values(name)
        return values.dtype.kind in "iufmM" and bool(np.any(values[1:] < values[:-1]))

    def remedy(self, label: Any, clock: Any) -> str:
        """What to write instead."""
        clock = TIME if self.timed else clock
        if clock is None:
            return (
                f"Pass it with the sampling time in seconds, run={label!r} and dt=...; or add a "
                f"column 'time' in seconds, and put both into the row index: "
                f"{self._index_of(label, TIME)}."
            )
        several = label is None and self.goes_back(clock)
        more = ""
        if several:
            times = "X.index.to_series()" if clock == self.level else f"X[{clock!r}]"
            more = f" after X['run'] = ({times}.diff() < 0).cumsum(), which counts the runs"
        text = f"Put {'both' if label is not None else 'it'} into the row index, time in seconds"
        text += f" ({clock!r} divided by 1000): " if in_milliseconds(clock) else ": "
        text += self._index_of(RUN if several else label, clock) + more
        text += "; y keeps its rows, and its index if it is a plain one"
        if self.timed:
            return f"{text}. Or pass run={label!r}."
        if label is None:
            return f"{text}. Or drop it and give the sampling time in seconds as dt=."
        return f"{text}. Or pass run={label!r}, with the sampling time as dt=."

    def _index_of(self, label: Any, clock: Any) -> str:
        """The call that makes the row index of these columns, and of outer levels beside them."""
        renamed = {label: RUN, clock: TIME}
        outer = {}
        for wanted in OUTER if label is not None else ():
            for _, name, _ in self._called((wanted,)):
                if name != label:
                    outer[name] = wanted
        for word, wanted in OUTER_WORDS.items() if label is not None else ():
            for name, values in self._like(word):
                free = name != label and wanted not in outer.values()
                if free and labelled_stretches(values, word):
                    outer[name] = wanted
        renamed = {old: new for old, new in (outer | renamed).items() if old not in (None, new)}
        levels = [*outer.values(), *([] if label is None else [RUN]), TIME]
        text = "X = X" if isinstance(self.X, pd.DataFrame) else "X = X.to_pandas()"
        if self.level is not None:
            text += ".reset_index()"
        if renamed:
            text += f".rename(columns={renamed})"
        return f"{text}.set_index({levels if len(levels) > 1 else levels[0]!r})"
