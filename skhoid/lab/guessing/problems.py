"""What a guess says, and all that is unclear or wrong in the columns of a file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...exceptions import ColumnError, IrregularSamplingError
from ...io.assembling import per_second_of, restarts_of
from ...io.files import FileTable, as_numbers, numbers_of, shown
from ...runs import RUN, read_layout
from ...runs.clock import JITTER_TOLERANCE
from ...runs.roles import role_of

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
        return self.said_by(in_python)

    def said_by(self, shown: Any) -> str:
        """The text with its options as ``shown(name, value)`` writes them."""
        if not self.options:
            return self.text
        return f"{self.text} Say {' or '.join(shown(*option) for option in self.options)}."


def in_python(name: str, value: str) -> str:
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
        super().__init__(self.said_by(in_python))

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
            parts.append(f"{MEANING.get(role, channel)} {quoted(name)}")
            if role == "e" and self.error_from == "-e":
                parts[-1] += " with its sign turned, as it is x - f_t"
        if self.error_from == "f_t - x":
            parts.append("error e = f_t - x")
        if self.output is not None:
            parts.append(f"output u {quoted(self.output[0])}")
        text = f"Columns: {', '.join(parts)}"
        if self.unused:
            text += f"; not used: {', '.join(map(quoted, self.unused))}"
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


_FILLS = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0, 65535.0)
_FAR = 10.0  # times beyond all other values
_COMMA = r"^\s*([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\s*$"
_POINT = _COMMA.replace(",", r"\.", 1)
_SHOWN = 5


def columns_of(
    table: FileTable, names: Iterable[str], found: list[Problem]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Numbers of columns, NaN in place of other cells, and which rows of the file they are.

    Rows that repeat the header are left out. What is wrong is added to ``found``.
    """
    raw: dict[str, Any] = {}
    for name in names:
        try:
            at = table.find(name)
            raw[name] = table.load([at], None)[0][0] if table.raw is None else table.raw(at)
        except ValueError as error:
            found.append(Problem(said_alone(error)))
    n_rows = max((np.size(values) for values in raw.values()), default=0)
    again = _repeated_header(raw, n_rows, found)
    kept = np.setdiff1d(np.arange(n_rows), again)
    if again.size:
        raw = {name: pd.Series(values).iloc[kept] for name, values in raw.items()}
    _mixed_decimals(raw, found)
    columns = {}
    for name, values in raw.items():
        shape = np.shape(values)
        numbers = numbers_of(values)
        columns[name] = numbers.reshape(shape) if len(shape) == 2 and 1 not in shape else numbers
        try:
            as_numbers(_with_points(values), f"{table.kind.capitalize()} {quoted(name)}")
        except ValueError as error:
            found.append(Problem(str(error)))
    return columns, kept


def _texts(values: Any) -> pd.Series | None:
    """Cells of a column that holds texts; None if they are numbers."""
    series = values if isinstance(values, pd.Series) else pd.Series(np.ravel(values))
    if series.dtype.kind in "biufcmM" or pd.api.types.is_numeric_dtype(series.dtype):
        return None
    return series


def _with_points(values: Any) -> Any:
    texts = _texts(values)
    if texts is None:
        return values
    return texts.where(texts.isna(), texts.astype(str).str.replace(_COMMA, r"\1.\2", regex=True))


def _repeated_header(raw: dict[str, Any], n_rows: int, found: list[Problem]) -> np.ndarray:
    """Rows in which a column holds its own name."""
    again: set[int] = set()
    for name, values in raw.items():
        texts = _texts(values)
        if texts is not None and len(texts) == n_rows:
            again |= set(np.flatnonzero(texts.astype(str).str.strip() == name).tolist())
    rows = np.array(sorted(again), dtype=int)
    if rows.size:
        places = ", ".join(str(row + 1) for row in rows[:_SHOWN])
        more = ", ..." if rows.size > _SHOWN else ""
        found.append(
            Problem(
                f"The header stands again below itself (row{'s' if rows.size > 1 else ''} "
                f"{places}{more} of the data), as where files were put one after another: delete "
                "it there."
            )
        )
    return rows


def _mixed_decimals(raw: dict[str, Any], found: list[Problem]) -> None:
    commas: list[tuple[str, str]] = []
    points: list[tuple[str, str]] = []
    for name, values in raw.items():
        texts = _texts(values)
        if texts is None:
            if pd.Series(np.ravel(values)).dtype.kind == "f":
                points.append((name, ""))
            continue
        texts = texts.astype(str).reset_index(drop=True)
        for pattern, columns in ((_COMMA, commas), (_POINT, points)):
            rows = np.flatnonzero(texts.str.match(pattern))
            if rows.size:
                columns.append((name, f" (row {rows[0] + 1}: {texts[rows[0]].strip()})"))
    if commas and points:
        with_commas = ", ".join(quoted(name) for name, _ in commas)
        with_points = ", ".join(f"{quoted(name)}{first}" for name, first in points)
        found.append(
            Problem(
                f"Numbers have decimal commas in {with_commas}, and decimal points in "
                f"{with_points}. Write all numbers of the file with one sign, and without "
                "separators of thousands."
            )
        )


def filled(name: str, values: np.ndarray) -> list[Problem]:
    """Numbers such as -9999 that stand for missing ones."""
    there = values[np.isfinite(values)]
    if there.size < 3:
        return []
    for fill in (there.min(), there.max()):
        if abs(fill) not in _FILLS and abs(fill) < 1e30:
            continue
        rest = there[there != fill]
        if rest.size and np.abs(rest).max() * _FAR < abs(fill):
            rows = np.flatnonzero(values == fill)
            return [
                Problem(
                    f"Column {quoted(name)} is {fill:g} in {rows.size} rows, first in row "
                    f"{rows[0] + 1}, far from all its other values: if that stands for missing "
                    "numbers, leave these cells empty."
                )
            ]
    return []


def shapes_differ(table: FileTable, columns: dict[str, np.ndarray]) -> list[Problem]:
    """Variables that have not as many samples, or not as many runs, as the others."""
    shapes = {name: values.shape for name, values in columns.items() if values.size > 1}
    if table.kind != "variable" or len(set(shapes.values())) < 2:
        return []
    of_runs = [shape for shape in shapes.values() if len(shape) == 2]
    all_shapes = of_runs or list(shapes.values())
    usual = max(all_shapes, key=all_shapes.count)
    wrong = []
    for name, shape in shapes.items():
        if shape not in (usual, usual[:1]):
            advice = " and lies transposed" if shape == usual[::-1] else ""
            wrong.append(f"{quoted(name)} is {_by(shape)}{advice}")
    if not wrong:
        return []
    return [
        Problem(
            f"{'; '.join(wrong)}: the other variables are {_by(usual)}, samples down and runs "
            "across. Save all alike."
        )
    ]


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) if len(shape) > 1 else f"{shape[0]} samples"


def more_of(count: int) -> str:
    """How often else."""
    return "" if count < 2 else f", and in {count - 1} place{'s' if count > 2 else ''} more"


_SIGNAL = "a signal that never changes tells nothing"
_STRETCHES = 20  # of a run, from where on its rows lie among those of others
_NEARLY = 0.99
_OFTEN = 0.01  # of the rows


def problems_of_runs(X: pd.DataFrame, y: pd.Series, *, irregular: bool = False) -> list[Problem]:
    """What is wrong with runs that could be read."""
    found = []
    try:
        read_layout(X)
    except IrregularSamplingError as error:
        if not irregular:
            found.append(Problem(error.message, (("resample", ""),)))
    except ValueError as error:
        found.append(Problem(str(error)))
    inputs = [X[name] for name in X.columns if name == "e"]
    for signal in (*inputs, y):
        values = signal.to_numpy()
        if _is_constant(values):
            found.append(Problem(f"{signal.name} is constant"))
        found += filled(str(signal.name), values)
    return found


def problems_of_files(tables: list[FileTable], guess: ColumnGuess) -> list[Problem]:
    """What is wrong with the columns of files, column by column."""
    found: list[Problem] = []
    for table in tables:
        before = f"{table.path.name}: " if len(tables) > 1 else ""
        found += [
            Problem(f"{before}{problem.text}", problem.options)
            for problem in _of_file(table, guess)
        ]
    return list(dict.fromkeys(found))


def _of_file(table: FileTable, guess: ColumnGuess) -> list[Problem]:
    found: list[Problem] = []
    asked = dict(guess.channels)
    if guess.output is not None:
        asked[guess.output[0]] = "u"
    names = [*asked, *([] if guess.time is None else [guess.time])]
    columns, kept = columns_of(table, names, found)
    found += shapes_differ(table, columns)
    codes, labels = _labels(table, guess, found, kept)
    signals: dict[str, tuple[str, np.ndarray]] = {}
    for name, channel in asked.items():
        if name not in columns:
            continue
        values = columns[name].ravel(order="F")
        signals[role_of(channel, guess.roles) or channel] = name, values
        if not np.isfinite(values).any():
            found.append(Problem(f"Column {quoted(name)} has no numbers."))
        elif channel in ("e", "u") and _is_constant(values):
            found.append(Problem(_constant(name, channel, values, asked)))
        elif channel in ("e", "u"):
            found += _dead_runs(name, values, codes, labels)
        found += filled(name, values)
        missing = np.count_nonzero(np.isnan(values))
        if channel in ("e", "u") and missing and not any(quoted(name) in p.text for p in found):
            rows = f"{missing} of {values.size} rows"
            guess.remarks.append(f"{quoted(name)} has no number in {rows}, which are not measured")
    if guess.error_from == "f_t - x" and {"f_t", "x"} <= signals.keys():
        (target, one), (place, other) = signals["f_t"], signals["x"]
        if np.array_equal(one, other, equal_nan=True):
            found.append(
                Problem(
                    f"The target f_t, {quoted(target)}, and x, {quoted(place)}, are the same, so "
                    "that the error f_t - x is 0 in every row: save them anew."
                )
            )
    if guess.time is not None and guess.time in columns:
        found += _of_time(table, guess, columns[guess.time].ravel(order="F"), codes, labels, kept)
    return found


def _constant(name: str, channel: str, values: np.ndarray, asked: dict[str, str]) -> str:
    what = "error e" if channel == "e" else "output u"
    text = f"The {what}, {quoted(name)}, is {np.nanmax(values):g} in every row: {_SIGNAL}."
    if channel == "e" and {"f_t", "x"} <= set(asked.values()):
        text += " Delete the column, and the error is formed as f_t - x."
    return text


def _dead_runs(
    name: str, values: np.ndarray, codes: np.ndarray | None, labels: list[Any]
) -> list[Problem]:
    """Runs in which a signal has no numbers, or never changes."""
    if codes is None or codes.size != values.size or len(labels) < 2:
        return []
    empty, still = [], []
    for code, label in enumerate(labels):
        own = values[codes == code]
        own = own[np.isfinite(own)]
        if not own.size:
            empty.append(label)
        elif own.size > 2 and np.ptp(own) == 0:
            still.append(label)
    found = []
    for runs, what in ((empty, "has no numbers"), (still, "never changes")):
        if runs:
            text = ", ".join(map(repr, runs[:5])) + (", ..." if len(runs) > 5 else "")
            plural = "s" if len(runs) > 1 else ""
            found.append(
                Problem(
                    f"Column {quoted(name)} {what} in run{plural} {text}: leave the run{plural} "
                    "out."
                )
            )
    return found


def _labels(
    table: FileTable, guess: ColumnGuess, found: list[Problem], kept: np.ndarray
) -> tuple[np.ndarray | None, list[Any]]:
    """Codes of the runs of rows, and their labels."""
    names = [*guess.levels, *([] if guess.run is None else [guess.run])]
    parts = []
    for name in names:
        try:
            coded = table.load([], table.find(name))[1]
        except ValueError as error:
            found.append(Problem(str(error)))
            continue
        if coded is None:
            continue
        codes, labels = coded
        empty_labels = [k for k, label in enumerate(labels) if label == "" or pd.isna(label)]
        codes = np.where(np.isin(codes, empty_labels), -1, codes)[kept[kept < codes.size]]
        empty = np.flatnonzero(codes < 0)
        if empty.size:
            found.append(
                Problem(
                    f"Column {quoted(name)} has no label in row {empty[0] + 1} "
                    f"({empty.size} of {codes.size} rows)."
                )
            )
        parts.append((codes, labels))
    if not parts or len({len(codes) for codes, _ in parts}) > 1:
        return None, []
    frame = pd.DataFrame({k: codes for k, (codes, _) in enumerate(parts)})
    codes = frame.groupby(list(frame.columns), sort=False).ngroup().to_numpy()
    changes = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
    order = codes[changes]
    last = parts[-1]
    named = {c: last[1][last[0][row]] for row, c in zip(changes, order, strict=True)}
    n_runs = len(set(order.tolist()))
    own = last[0][last[0] >= 0]
    if guess.run is not None and order.size > _STRETCHES * n_runs:
        found.append(
            Problem(
                f"The rows of the {np.unique(own).size} runs of column {quoted(guess.run)} lie "
                "through one another: sort the file by run, and then by time."
            )
        )
        return last[0], []
    if guess.run is not None and n_runs < order.size:
        seen: set[int] = set()
        for row, code in zip(changes.tolist(), order.tolist(), strict=True):
            if code in seen:
                found.append(
                    Problem(
                        f"Run {named[code]!r} in column {quoted(guess.run)} comes back at row "
                        f"{row + 1}, after another run: sort the file by run and time."
                    )
                )
                break
            seen.add(code)
    return codes, [named[code] for code in range(len(named))]


def _of_time(
    table: FileTable,
    guess: ColumnGuess,
    time: np.ndarray,
    codes: np.ndarray | None,
    labels: list[Any],
    kept: np.ndarray,
) -> list[Problem]:
    found = []
    name = quoted(guess.time or "")
    instants = np.unique(time[np.isfinite(time)]).size
    if time.size > 100 * max(instants, len(labels)):
        return [
            Problem(
                f"The time {name} has {instants} different values in {time.size} rows: it was "
                "rounded when it was stored, as Unix time is in 32 bits. Store it in 64 bits, or "
                "drop the column and give the sampling time.",
                (("dt", "SECONDS"),),
            )
        ]
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        found.append(
            Problem(
                f"The time {name} is missing in row {missing[0] + 1} "
                f"({missing.size} of {time.size} rows)."
            )
        )
    if codes is not None and not labels:  # rows of runs lie through one another
        return found
    if codes is None:
        again = restarts_of(time)
        codes = np.zeros(time.size, dtype=int) if again is None else again[0]
        labels = list(again[1]) if again is not None else []
    if len(codes) != time.size:
        return found
    step, within = np.diff(time), codes[1:] == codes[:-1]
    typical = float(np.nanmedian(np.abs(step))) if step.size else 0.0
    for bad, what in ((step < 0, "runs backwards"), (step == 0, "stands still")):
        rows = np.flatnonzero(bad & within)
        if not rows.size:
            continue
        row = int(rows[0])
        run = f" in run {labels[codes[row]]!r}" if len(labels) > 1 else ""
        values = f"{time[row]:.10g} is followed by {time[row + 1]:.10g}"
        if what == "stands still":
            values = "its value is that of the row before"
        place = f"{run} at row {kept[row + 1] + 1}: {values}{more_of(rows.size)}."
        text = f"The time {name} {what}{place}"
        full = _full_counter(time[rows]) if what == "runs backwards" else 0
        if full:
            text = f"The time {name} rolls over at {full}{place} Add {full} to the rows behind."
            found.append(Problem(text))
            continue
        back = time[rows + 1] <= time[0] + 2 * typical
        if guess.run is None and what == "runs backwards" and back.mean() > 0.5:
            text += " If runs begin there, a column has to label them."
            found.append(Problem(text, (("run", "NAME"),)))
        else:
            found.append(Problem(text))
    if found or not typical:
        return found + _uneven(name, step[within & (step > 0)], bool(guess.time))
    try:
        per_second = per_second_of(table, guess.time or "", guess.units.get("time"))
    except ValueError as error:
        return [Problem(str(error))]
    known = len(set(map(str, labels))) == len(labels) > 0
    runs = pd.Categorical.from_codes(codes, [str(label) for label in labels]) if known else codes
    index = pd.MultiIndex.from_arrays([runs, time / per_second], names=[RUN, "time"])
    try:
        read_layout(pd.DataFrame({"e": np.zeros(time.size)}, index=index))
    except IrregularSamplingError as error:
        found.append(Problem(error.message, (("resample", ""),)))
    except ValueError as error:
        found.append(Problem(str(error)))
    return found or _uneven(name, step[within], False)


def _uneven(name: str, steps: np.ndarray, also_jitter: bool) -> list[Problem]:
    """Steps of a clock that are so often too long or short that it is no regular one."""
    if steps.size < 100:
        return []
    apart = steps / np.median(steps) - 1
    gaps, off = np.mean(apart > 0.5), np.mean(np.abs(apart) > JITTER_TOLERANCE)
    if also_jitter and off - gaps > _OFTEN:
        return [
            Problem(
                f"The time {name} is irregular: {off:.0%} of its steps are more than "
                f"{JITTER_TOLERANCE:.0%} off the usual one.",
                (("resample", ""),),
            )
        ]
    if gaps > _OFTEN:
        return [
            Problem(
                f"The time {name} has {int(gaps * steps.size)} gaps, steps of at least 1.5 times "
                "the usual one, at each of which a model starts anew: too many to be pauses. "
                "Find out why the clock hangs."
            )
        ]
    return []


def _full_counter(last: np.ndarray) -> int:
    """The number at which a counter of some bits begins anew, if its last values are just below."""
    for full in (2**15, 2**16, 2**31, 2**32):
        if np.all((last > _NEARLY * full) & (last < full)):
            return int(full)
    return 0


def _is_constant(values: np.ndarray) -> bool:
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) == 0)
