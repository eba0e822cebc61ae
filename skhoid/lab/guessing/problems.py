"""What a guess says, and all that is unclear or wrong in the columns of a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...exceptions import ColumnError, IrregularSamplingError, RunIndexError
from ...io.assembling import count_per_second, find_restarts, plain_labels
from ...io.files import FileTable, as_numbers, is_plain_clock, numbers_of, read_clock, shown
from ...runs import GAP, RUN, TIME, contiguous_runs, read_layout
from ...runs.roles import role_of
from ...runs.tables import JITTER_TOLERANCE

MEANING = {
    "e": "error e",
    "u": "output u",
    "x": "x",
    "f_t": "target f_t",
    "dist": "disturbance",
    "motion": "motion",
    "time": "time",
    "run": "run",
}
OPTION = {"e": "input", "u": "output", "x": "x", "f_t": "target", "time": "time", "run": "run"}
MOST = 30  # names in a message
_ORDER = ("e", "f_t", "x", "dist", "motion")


@dataclass(frozen=True)
class Problem:
    """What is unclear or wrong in a file, and the options that settle it, as (name, value)."""

    text: str
    options: tuple[tuple[str, str], ...] = ()

    def __str__(self) -> str:
        return self.said_by(write_in_python)

    def said_by(self, shown: Any) -> str:
        """The text with its options as ``shown(name, value)`` writes them."""
        if not self.options:
            return self.text
        return f"{self.text} Say {' or '.join(shown(*option) for option in self.options)}."


def write_in_python(name: str, value: str) -> str:
    """An option as an argument of :func:`skhoid.read_runs`."""
    if name in ("input", "x", "target"):
        role = {"input": "e", "x": "x", "target": "f_t"}[name]
        return f"inputs={{{value!r}: {role!r}}}"
    if name == "unit":
        key, _, unit = value.partition("=")
        return f"units={{{key!r}: {unit!r}}}"
    if name == "dt":
        return f"dt={value}"
    if name == "resample":
        return "the names of all columns, and then resample_runs"
    return f"{name}={value!r}"


class UnclearColumnsError(ValueError):
    """Columns of a file cannot be guessed or used; ``problems`` holds all there is to say."""

    def __init__(
        self,
        where: str,
        problems: list[Problem],
        columns: list[str],
        remarks: Sequence[str] = (),
    ):
        self.where, self.problems, self.columns = where, problems, columns
        self.remarks = list(remarks)
        super().__init__(self.said_by(write_in_python))

    def said_by(self, shown: Any) -> str:
        """The message, with options as ``shown(name, value)`` writes them."""
        texts = [problem.said_by(shown) for problem in self.problems]
        there = f"It has: {', '.join(map(repr, self.columns[:MOST])) or 'no columns'}"
        more = len(self.columns) - MOST
        there += f" and {more} more." if more > 0 else "."
        if self.remarks:
            there = f"Also: {'; '.join(self.remarks)}.\n  {there}".replace("?.", "?")
        if len(texts) == 1:
            between = "\n  " if self.remarks else " "
            return f"{self.where}: {texts[0]}{between}{there}"
        listed = "".join(f"\n  {number}. {text}" for number, text in enumerate(texts, 1))
        return f"{self.where}: {len(texts)} problems.{listed}\n  {there}"


def said_alone(error: ValueError) -> str:
    """What is wrong with one column, as a sentence of several about the same file."""
    return error.alone if isinstance(error, ColumnError) else str(error)


def quoted(name: str) -> str:
    """A name in quotes."""
    return f'"{name}"'


@dataclass
class ColumnGuess:
    """Which column of the files is which.

    ``channels`` maps the columns to channels of X, ``roles`` these to their roles where their
    names do not say them; ``output`` is the column and the name of y. ``levels`` are columns that
    label runs from outside, such as the subject. ``remarks`` tell what else was decided,
    ``problems`` what is not clear.
    """

    paths: Any
    channels: dict[str, str] = field(default_factory=dict)
    roles: dict[str, str] = field(default_factory=dict)
    output: tuple[str, str] | None = None
    time: str | None = None
    dt: float | None = None
    run: str | None = None
    levels: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    error_from: str = ""  # how e is made of f_t and x: "f_t - x", or "-e"
    unused: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    time_remark: str = ""  # what the steps of the clock say of its unit
    problems: list[Problem] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    guessed: bool = True
    is_driven: bool = False  # an element that u drives, and no person who answers an error

    @property
    def all_remarks(self) -> list[str]:
        """What else was decided, that about the clock first."""
        return [self.time_remark, *self.remarks] if self.time_remark else self.remarks

    def __str__(self) -> str:
        """One line that says which column is which."""
        parts = []
        if self.time is not None:
            unit = self.units.get("time")
            parts.append(f"time {quoted(self.time)}" + (f" in {unit}" if unit else ""))
        elif self.dt is not None:
            parts.append(f"dt = {self.dt:.6g} s")
        if self.run is not None:
            parts.append(f"run {quoted(self.run)}")
        parts += [f"{level} {quoted(name)}" for name, level in self.levels.items()]
        by_role = {self._role(channel): (name, channel) for name, channel in self.channels.items()}
        for role in sorted(by_role, key=lambda r: _ORDER.index(r) if r in _ORDER else 9):
            name, channel = by_role[role]
            plain = "input" if channel == name else channel
            meaning = "input" if role == "e" and self.is_driven else MEANING.get(role, plain)
            parts.append(f"{meaning} {quoted(name)}")
            if role == "e" and self.error_from == "-e":
                parts[-1] += " with its sign turned, as it is x - f_t"
        if self.error_from == "f_t - x":
            parts.append("error e = f_t - x")
        if self.output is not None:
            parts.append(f"output{'' if self.is_driven else ' u'} {quoted(self.output[0])}")
        text = f"Columns: {', '.join(parts)}"
        if self.unused:
            text += f"; not used: {', '.join(map(quoted, self.unused[:MOST]))}"
            text += f" and {len(self.unused) - MOST} more" * (len(self.unused) > MOST)
        return text + "".join(f"; {remark}" for remark in self.all_remarks)

    def _role(self, channel: str) -> str:
        role = role_of(channel, self.roles)
        return role or channel

    def as_dict(self) -> dict[str, Any]:
        """The same by name, for JSON."""
        return {
            "time": self.time,
            "run": self.run,
            "levels": self.levels,
            "channels": self.channels,
            "output": self.output and self.output[0],
            "error_from": self.error_from or None,
            "unused": self.unused,
            "remarks": self.all_remarks,
        }

    @property
    def inputs(self) -> list[str]:
        """The channel that a person answers: e, or else the target, or else the first there is."""
        names = list(self.channels.values())
        if self.error_from == "f_t - x":
            return ["e"]
        for role in ("e", "f_t"):
            found = [name for name in names if self._role(name) == role]
            if found:
                return found[:1]
        return names[:1]


def where_of(paths: list[Path]) -> str:
    """Files as the beginning of a message."""
    return shown(paths[0]) if len(paths) == 1 else f"{shown(paths[0])} and {len(paths) - 1} more"


_FILLS = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0, 65535.0)  # for missing numbers
_FAR = 10.0  # times beyond all other values
_OFTEN = 0.01  # share of the steps of a clock
_TICK_ERROR = 1e-3  # of a tick, by which floats may miss whole ones
_WHOLE = 0.6  # share of the times that are written no finer; of few digits, not all are
_FEWEST_TICKS, _HALF = 2.0, 0.6  # in a row, and by which a clock that is rounded misses
_FEWEST_ROWS = 10  # of a run; a line through few rows fits any clock
_TICKS = 3.5  # in a row at least: a lost row is then more than rounding
_ROUNDED = 1.5  # ticks, by which a clock that is read late and rounded misses an even one
_SIGNAL = "a signal that never changes tells nothing"


def even_times(index: pd.MultiIndex) -> tuple[np.ndarray, str] | None:
    """Times of a clock that is even but for its rounding, and what to say; None for others."""
    time = index.get_level_values(TIME).to_numpy()
    for tick in 10.0 ** np.arange(0, -7, -1):
        ticks = time / tick
        if np.mean(np.abs(ticks - np.round(ticks)) <= _TICK_ERROR) > _WHOLE:
            break
    else:
        return None
    codes = pd.factorize(index.droplevel(TIME))[0]
    starts = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
    even, uneven, steps = ticks.copy(), 0.0, []
    for start, stop in zip(starts, np.append(starts[1:], time.size), strict=True):
        rows, own = np.arange(stop - start), ticks[start:stop]
        step = np.polyfit(rows, own, 1)[0] if rows.size >= _FEWEST_ROWS else 0.0
        if step < _FEWEST_TICKS:
            return None
        rest = own - step * rows
        even[start:stop] = step * rows + (rest.min() + rest.max()) / 2
        uneven = max(uneven, np.abs(np.diff(own) / step - 1).max())
        steps.append(step)
    slack = _ROUNDED if min(steps) >= _TICKS else _HALF
    if np.abs(even - ticks).max() > slack or uneven <= JITTER_TOLERANCE:
        return None
    unit = {1e-3: " ms", 1e-6: " us"}.get(tick, "")
    written = f"in whole{unit}" if unit else f"written to {tick:g} s"
    but = f"{slack:g}{unit}" if unit else f"{slack * tick:g} s"
    return even * tick, (
        f"the clock is {written} and even but for {but}, and is taken as even, "
        f"{np.median(steps) * tick:.6g} s a row"
    )


def problems_of_runs(X: pd.DataFrame, y: pd.Series, *, irregular: bool = False) -> list[Problem]:
    """What is wrong with runs that could be read."""
    found = _problems_of_clock(X, irregular=irregular)
    for signal in (*(X[name] for name in X.columns if name == "e"), y):
        values = signal.to_numpy()
        if _is_constant(values):
            found.append(Problem(f"{signal.name} is constant"))
        found += _filled(str(signal.name), values)
    return found


def _problems_of_clock(X: pd.DataFrame, *, irregular: bool = False) -> list[Problem]:
    try:
        read_layout(X)
    except IrregularSamplingError as error:
        return [] if irregular else [Problem(error.message, (("resample", ""),))]
    except ValueError as error:
        return [Problem(str(error))]
    return []


def _filled(name: str, values: np.ndarray) -> list[Problem]:
    """Numbers such as -9999 that stand for missing ones."""
    there = values[np.isfinite(values)]
    if there.size < 3:
        return []
    for fill in (there.min(), there.max()):
        rest = there[there != fill]
        is_fill = abs(fill) in _FILLS or abs(fill) >= 1e30
        if is_fill and rest.size and np.abs(rest).max() * _FAR < abs(fill):
            rows = np.flatnonzero(values == fill)
            return [
                Problem(
                    f"Column {quoted(name)} is {fill:g} in {rows.size} rows, first in row "
                    f"{rows[0] + 1}, far from all its other values: if that stands for missing "
                    "numbers, leave these cells empty."
                )
            ]
    return []


def problems_of_files(tables: list[FileTable], guess: ColumnGuess) -> list[Problem]:
    """What is wrong with the columns of files, column by column."""
    found: list[Problem] = []
    for table in tables:
        before = f"{table.path.name}: " if len(tables) > 1 else ""
        found += [
            Problem(f"{before}{problem.text}", problem.options)
            for problem in _find_problems(table, guess)
        ]
    return list(dict.fromkeys(found))


def _find_problems(table: FileTable, guess: ColumnGuess) -> list[Problem]:
    found: list[Problem] = []
    asked = dict(guess.channels)
    if guess.output is not None:
        asked[guess.output[0]] = "u"
    names = [*asked, *([] if guess.time is None else [guess.time])]
    columns = {name: _numbers(table, name, found, name == guess.time) for name in names}
    codes, labels = _runs(table, guess, found)
    signals: dict[str, tuple[str, np.ndarray]] = {}
    for name, channel in asked.items():
        values = columns[name]
        if values is None:
            continue
        signals[role_of(channel, guess.roles) or channel] = name, values
        if not np.isfinite(values).any():
            found.append(Problem(f"Column {quoted(name)} has no numbers."))
        elif channel in ("e", "u") and _is_constant(values):
            found.append(Problem(_constant(name, channel, values, asked)))
        elif channel in ("e", "u") and len(labels) > 1 and codes.size == values.size:
            found += _dead_runs(name, values, codes, labels)
        found += _filled(name, values)
    if guess.error_from == "f_t - x" and {"f_t", "x"} <= signals.keys():
        (target, one), (place, other) = signals["f_t"], signals["x"]
        if np.array_equal(one, other, equal_nan=True):
            found.append(
                Problem(
                    f"The target f_t, {quoted(target)}, and x, {quoted(place)}, are the same, so "
                    "that the error f_t - x is 0 in every row: save them anew."
                )
            )
    time = None if guess.time is None else columns[guess.time]
    return (
        found if time is None else [*found, *_problems_of_time(table, guess, time, codes, labels)]
    )


def _numbers(
    table: FileTable, name: str, found: list[Problem], is_clock: bool
) -> np.ndarray | None:
    """Numbers of a column, NaN in place of other cells; what is wrong is added to ``found``."""
    try:
        values = table.load([table.find(name)], None)[0][0]
    except ValueError as error:
        found.append(Problem(said_alone(error)))
        return None
    times = read_clock(values) if is_clock and not is_plain_clock(values) else None
    if times is not None and np.isfinite(times).any():
        return times
    try:
        as_numbers(values, f"{table.kind.capitalize()} {quoted(name)}")
    except ValueError as error:
        found.append(Problem(str(error)))
    return numbers_of(values).ravel(order="F")


def _constant(name: str, channel: str, values: np.ndarray, asked: dict[str, str]) -> str:
    what = "error e" if channel == "e" else "output u"
    text = f"The {what}, {quoted(name)}, is {np.nanmax(values) + 0.0:g} in every row: {_SIGNAL}."
    if channel == "e" and {"f_t", "x"} <= set(asked.values()):
        text += " Delete the column, and the error is formed as f_t - x."
    return text


def _dead_runs(
    name: str, values: np.ndarray, codes: np.ndarray, labels: list[Any]
) -> list[Problem]:
    """Runs in which a signal has no numbers, or never changes."""
    found = []
    for code, label in enumerate(labels):
        own = values[codes == code]
        empty = not np.isfinite(own).any()
        if empty or (own.size > 2 and _is_constant(own)):
            what = "has no numbers" if empty else "never changes"
            text = f"Column {quoted(name)} {what} in run {label!r}: leave the run out."
            found.append(Problem(text))
    return found


def _runs(
    table: FileTable, guess: ColumnGuess, found: list[Problem]
) -> tuple[np.ndarray, list[Any]]:
    """Which run each row belongs to, counted from 0, and the labels of the runs."""
    parts = []
    for name in [*guess.levels, *([] if guess.run is None else [guess.run])]:
        try:
            coded = table.load([], table.find(name))[1]
            assert coded is not None
            parts.append(plain_labels(coded, table.where(name)))
        except ValueError as error:
            found.append(Problem(said_alone(error)))
    if not parts or len({codes.size for codes, _ in parts}) > 1:
        return np.zeros(0, dtype=int), []
    codes, first = pd.factorize(pd.MultiIndex.from_arrays([codes for codes, _ in parts]))
    labels = [parts[-1][1][each[-1]] for each in first]
    try:
        contiguous_runs(codes, labels)
    except RunIndexError:
        found.append(
            Problem(
                f"The rows of the runs of column {quoted(str(guess.run))} do not lie together: "
                "sort the file by run and time."
            )
        )
        return codes, []
    return codes, labels


def _problems_of_time(
    table: FileTable, guess: ColumnGuess, time: np.ndarray, codes: np.ndarray, labels: list[Any]
) -> list[Problem]:
    name = quoted(guess.time or "")
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        text = f"The time {name} is missing in row {missing[0] + 1}"
        return [Problem(f"{text} ({missing.size} of {time.size} rows).")]
    apart = codes.size == time.size and not labels  # runs whose rows do not lie together
    if codes.size != time.size:
        again = find_restarts(time)
        codes = np.zeros(time.size, dtype=int) if again is None else again[0]
        labels = [] if again is None else list(again[1])
    step, within = np.diff(time), codes[1:] == codes[:-1]
    found = []
    for bad, what in ((step < 0, "runs backwards"), (step == 0, "stands still")):
        rows = np.flatnonzero(bad & within)
        if not rows.size:
            continue
        row = int(rows[0])
        run = f" in run {labels[codes[row]]!r}" if len(labels) > 1 else ""
        text = (
            f"The time {name} {what}{run} at row {row + 2}: {time[row]:.10g} is followed by "
            f"{time[row + 1]:.10g} ({rows.size} such rows)."
        )
        if guess.run is None and what == "runs backwards":
            text += " If runs begin there, a column has to label them."
            found.append(Problem(text, (("run", "NAME"),)))
        else:
            found.append(Problem(text))
    if found or apart:
        return found
    try:
        per_second = count_per_second(table, guess.time or "", guess.units.get("time"))
    except ValueError as error:
        return [Problem(str(error))]
    index = pd.MultiIndex.from_arrays([codes, time / per_second], names=[RUN, TIME])
    steps = step[within]
    gaps = int(np.count_nonzero(steps > GAP * np.median(steps))) if steps.size else 0
    if even_times(index) is not None:
        return []
    irregular = _problems_of_clock(pd.DataFrame({"e": np.zeros(time.size)}, index=index))
    if irregular or gaps <= _OFTEN * steps.size:
        return irregular
    return [
        Problem(
            f"The time {name} has {gaps} gaps, at each of which a model starts anew: too many to "
            "be pauses. Find out why the clock hangs."
        )
    ]


def _is_constant(values: np.ndarray) -> bool:
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) == 0)
