"""Which column of a file is which: clock, labels, signals by name, signals by value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ...io import first_table
from ...io.delimited import TIME_UNITS
from ...io.files import FileTable, is_plain_clock, numbers_of, read_clock, split_header
from ...runs.roles import OUTPUT, role_of
from ...runs.tables import advances_evenly, labelled_stretches
from .loops import ANSWERS, IGNORES, MOST_OF_LOOP, answers, find_loop, influence
from .problems import MEANING, MOST, OPTION, ColumnGuess, Problem, quoted, said_alone
from .words import (
    STRONG,
    alike,
    coherence,
    equal,
    find_axis,
    find_factor,
    find_label,
    folded,
    is_derived,
    is_no_signal,
    is_row_number,
    may_be_time,
    moves,
    roles_by_name,
    unit_by_name,
)

PEEK = 1000  # rows that are shown
_FALLS = 0.01  # most runs in a row of a clock, on average
_OUTER, _OF_A_LABEL = ("subject", "condition", "session"), 50  # rows
_OFFERED = 4  # columns in a question
_OF_PLANT = 8  # score of a name that says it is the plant's
_DECIDES, _FAR_BEHIND = 0.6, 0.25  # coherence with the error, of the winner and of all others
_THE = {"e": "the error e", "u": "the output u", "x": "x", "f_t": "the target f_t"}
_THE |= {"dist": "the disturbance", "motion": "the motion"}


def make_guess(
    table: FileTable,
    paths: Any,
    *,
    roles: Mapping[str, str] | None = None,
    output: str | Mapping[str, str] | None = None,
    time: str | None = None,
    run: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
    signals: bool = True,
) -> ColumnGuess:
    """The guess for an open file."""
    guess = ColumnGuess(paths, time=time, run=run, dt=dt, units=dict(units or {}))
    guess.columns = [name for name in table.names if name]
    guess.remarks += table.remarks
    guess.problems += map(Problem, table.faults)
    named = _Named(table, guess)
    for name, role in (roles or {}).items():
        named.take(name, role, "input" if role in ("e", "") else OPTION.get(role, "role"))
    if output is not None:
        asked = output if isinstance(output, str) else next(iter(output))
        if named.has(asked, "output"):
            own = None if isinstance(output, str) else output[asked]
            guess.output = (asked, own or named.channel(asked))
    for column, option in ((time, "time"), (run, "run")):
        if column is not None:
            named.has(column, option)
    _Guess(table, guess, named.positions).make(
        known_roles=set((roles or {}).values()) - {""},
        output_known=output is not None,
        signals=signals,
    )
    said = (output is not None, time is not None or dt is not None, run == guess.run)
    guess.guessed = signals or not all(said) or bool(guess.levels or guess.all_remarks)
    return guess


class _Named:
    """Columns that the user has named."""

    def __init__(self, table: FileTable, guess: ColumnGuess):
        self.table, self.guess = table, guess
        self.positions: dict[int, str] = {}

    def has(self, asked: str, option: str) -> bool:
        """Whether there is such a column; if not, that is a problem."""
        try:
            self.positions[self.table.find(asked)] = option
        except ValueError as error:
            self.guess.problems.append(Problem(said_alone(error)))
            return False
        return True

    def channel(self, asked: str) -> str:
        """The name of a channel, as in read_runs."""
        name = split_header(asked)[0]
        return name.rpartition(".")[2] if self.table.kind == "variable" else name

    def take(self, asked: str, role: str, option: str) -> None:
        if not self.has(asked, option):
            return
        channel = self.channel(asked)
        self.guess.channels[asked] = channel
        if role != role_of(channel):
            self.guess.roles[channel] = role


@dataclass
class _Column:
    position: int
    header: str
    numbers: np.ndarray  # float64, NaN where there is no number
    raw: Any

    @cached_property
    def is_text(self) -> bool:
        given = pd.Series(self.raw).notna().sum()
        return bool(given and np.isfinite(self.numbers).sum() < 0.5 * given)

    @cached_property
    def times(self) -> np.ndarray:
        """The values as those of a clock, of which dates and times of day are in seconds."""
        return self.numbers if is_plain_clock(self.raw) else read_clock(self.raw)

    @cached_property
    def falls(self) -> np.ndarray | None:
        """Rows in which a clock is set back, as runs begin there; None if this is no clock."""
        step = np.diff(self.times)
        falls = np.flatnonzero(step < 0) + 1
        is_clock = step.size > 1 and np.count_nonzero(step > 0) + falls.size == step.size
        return falls if is_clock and falls.size <= _FALLS * step.size else None


def _uneven(column: _Column) -> float:
    """How far the steps of a clock are from the usual one (rms, in hundredths of it)."""
    step = np.diff(column.times)
    step = step[step > 0]
    return float(np.round(np.std(step) / np.median(step), 2)) if step.size else np.inf


class _Guess:
    """The steps of a guess: clock, labels, signals by name, signals by value."""

    def __init__(self, table: FileTable, guess: ColumnGuess, taken: Mapping[int, str]):
        self.table, self.guess = table, guess
        peeked = table.peek()
        self.columns = {
            position: _Column(position, name, numbers_of(raw), raw)
            for position, (name, raw) in enumerate(zip(table.names, peeked, strict=False))
            if name and table.names.count(name) == 1
        }
        self.free = {k: c for k, c in self.columns.items() if k not in taken}
        sizes = [c.numbers.size for c in self.columns.values() if c.numbers.size > 1]
        usual = max(sorted(set(sizes), reverse=True), key=sizes.count, default=0)
        self.apart = [c for c in self.free.values() if c.numbers.size not in (0, 1, usual)]
        for column in self.apart:  # of another length than the other variables
            self.free.pop(column.position)
        of_option = {option: role for role, option in OPTION.items()}
        self.taken = {k: of_option.get(v, "") for k, v in taken.items() if k in self.columns}
        self.signals = {role: self.columns[k].numbers for k, role in self.taken.items()}
        axes = (find_axis(self.columns[k].header) for k, role in self.taken.items() if role)
        self.axis = next(filter(None, axes), "")  # that the columns found so far name

    def make(self, *, known_roles: set[str], output_known: bool, signals: bool) -> None:
        guess = self.guess
        self._find_clock()
        self._find_labels()
        open_roles = {"e", "f_t", "x", "dist", "motion"} - known_roles if signals else set()
        if not output_known:
            open_roles.add("u")
        known = set(self.signals) | known_roles
        self.found: dict[str, _Column] = {}
        self.doubled: set[str] = set()
        self.tied: dict[str, list[_Column]] = {}
        self.outputs: list[_Column] = []  # that may be the output, the likeliest first
        self._by_name(open_roles, least=STRONG)
        self._by_value(open_roles)
        self._by_name(open_roles - {"dist"}, least=1)
        self._by_value(open_roles)
        self._settle_output()
        self._by_loop(open_roles, known)
        if {*self.signals, *known} & {"e", "f_t"}:  # not of "d" or "w" among letters
            self._by_name(open_roles & {"dist"}, least=1)
        self._as_plant(open_roles, known)
        for role, column in self.found.items():
            if role == "driven":
                guess.channels[column.header], guess.roles["u"] = "u", "e"
            elif role == "answer":
                guess.output = (column.header, "y")
            elif role == "u":
                guess.output = (column.header, OUTPUT)
            else:
                guess.channels[column.header] = role
            unit = unit_by_name(column.header)
            if unit and not self.table.unit_of(column.position):
                guess.units.setdefault(role, unit)
        if signals:
            self._check_error(known)
        self._say_ties()
        self._say_doubled(open_roles)
        self._say_missing(known, output_known, signals)
        if len(guess.columns) > MOST:  # what may be asked for comes first
            guess.columns.sort(key=[c.header for c in self._nameless()].__contains__, reverse=True)
        guess.unused = [
            c.header
            for c in [*self.free.values(), *self.apart]
            if c.numbers.size > 1 and not is_row_number(c.header)
        ]

    def _take(self, position: int) -> _Column:
        return self.free.pop(position)

    def _as_plant(self, open_roles: set[str], known: set[str]) -> None:
        """Settle the roles of two signals alone, where neither is an error or a target."""
        left = [c for c in self._signals() if moves(c.numbers) and not is_row_number(c.header)]
        alone = {*self.signals, *known} & {"e", "f_t", "dist"} or "e" not in open_roles or self.tied
        if alone or len(pair := [*self.found.values(), *left]) > 2:
            return
        if "u" in known and len(pair) == 1:  # the output was said
            self.found.pop("x", None)
            self.free.setdefault(pair[0].position, pair[0])
            self._give("e", pair[0])
            self.guess.remarks.append(f"{quoted(pair[0].header)} is what is left over")
        elif "u" in open_roles and len(pair) == 2:
            x, u = self.found.get("x"), self.found.get("u")
            pair.sort(key=lambda c: (c is x) - (c is u))
            driven, answer = pair
            forth, back = influence([driven.numbers, answer.numbers])[[0, 1], [1, 0]]
            letters = [folded(c.header).casefold() for c in pair] == ["u", "y"]
            if letters or (forth > ANSWERS and back < IGNORES and self.found):
                self.found, self.guess.is_driven = {"driven": driven, "answer": answer}, True
                self.free.pop(answer.position, None)
                self.free.pop(driven.position, None)
                self.signals |= {"e": driven.numbers, "u": answer.numbers}
                self.guess.remarks.append(
                    f"there is no error and no target: {quoted(driven.header)} drives an element, "
                    f"whose output is {quoted(answer.header)}"
                )

    def _find_clock(self) -> None:
        """Take the clock; other columns that rise evenly count rows, or are clocks too."""
        self._choose_clock()
        for column in list(self.free.values()):
            named = roles_by_name(column.header) or find_label(column.header)
            if not named and column.falls is not None and advances_evenly(column.times):
                self._take(column.position)

    def _choose_clock(self) -> None:
        guess = self.guess
        if guess.time is not None:
            if guess.time in self.table.names or any(
                split_header(name)[0] == guess.time for name in self.table.names
            ):
                self._time_unit(self.table.find(guess.time), asked=True)
            return
        if guess.dt is not None:
            return
        named = [c for c in self.free.values() if self._may_be_clock(c)]
        named = [c for c in named if np.isfinite(c.times).any()] or named
        if not named:  # the column that rises in every row, but where runs begin
            rising = [
                c
                for c in self.free.values()
                if c.falls is not None
                and not is_row_number(c.header)
                and not roles_by_name(c.header)
            ]
            # A counter of rows is no clock beside one.
            rising = [c for c in rising if not self._counts(c)] or rising
            rising = [c for c in rising if len(rising) == 1 or advances_evenly(c.times)]
            named = [max(rising, key=self._clock_score)] if rising else []
        if not named:
            guess.dt = self._stored_dt()
            if guess.dt is None:
                options = (("time", "NAME"), ("dt", "SECONDS"))
                guess.problems.append(
                    Problem("No column is the time, by its name or values.", options)
                )
            return
        best = max(named, key=self._clock_score)
        less = [c for c in named if c.falls is not None and _uneven(c) > _uneven(best)]
        if less:
            names = ", ".join(quoted(c.header) for c in less)
            guess.remarks.append(f"{names} could be the time too, and is less even")
        guess.time = best.header
        self._take(best.position)
        for other in named:
            if other is not best and other.position in self.free:
                self.free.pop(other.position)
        self._time_unit(best.position)

    def _may_be_clock(self, column: _Column) -> bool:
        """Whether a column may be a clock by its name, or by a unit of time and as it rises."""
        if may_be_time(column.header):
            return column.numbers.size > 1
        return column.falls is not None and bool(unit_by_name(column.header, time=True))

    def _counts(self, column: _Column) -> bool:
        """Whether a column counts rows, and has no unit of time."""
        step = np.diff(column.times)
        timed = self.table.unit_of(column.position) in TIME_UNITS
        return not timed and not (step % 1).any() and float(np.median(step)) == 1.0

    def _clock_score(self, column: _Column) -> tuple[bool, bool, float, bool]:
        name = folded(column.header).casefold().rpartition(".")[2]
        whole = name in ("t", "time", "zeit", "temps", "tijd")
        return advances_evenly(column.times), not column.is_text, -_uneven(column), whole

    def _stored_dt(self) -> float | None:
        """Sampling time of a MATLAB file in a variable of one number."""
        for column in list(self.free.values()):
            name = column.header.casefold().rpartition(".")[2]
            if column.numbers.size != 1 or not column.numbers[0] > 0:
                continue
            # T with the letter of its language: échantillonnage, Abtastung, campionamento, muestreo
            if re.fullmatch(r"dt|t_?[acemps]|tsample|sample_?time", name):
                self._take(column.position)
                return float(column.numbers[0])
            if name in ("fs", "f_s", "fsample", "samplerate", "rate", "sampling_rate", "srate"):
                self._take(column.position)
                return 1.0 / float(column.numbers[0])
        return None

    def _time_unit(self, position: int, asked: bool = False) -> None:
        guess, column = self.guess, self.columns.get(position)
        if column is None or "time" in guess.units or guess.time in guess.units:
            return
        is_text = column.is_text and np.isfinite(column.times).any()
        if is_text or not np.array_equal(column.times, column.numbers, equal_nan=True):
            guess.units["time"] = "s"
            guess.time_remark = f"{quoted(column.header)} is read as seconds from its first row"
            return
        if self.table.unit_of(position):
            return
        stated = unit_by_name(column.header, time=True)
        if stated:
            if stated != "s":
                guess.units["time"] = stated
            return
        if column.is_text:
            return
        step = np.diff(column.numbers)
        typical = float(np.nanmedian(step)) if step.size else 0.0
        if typical == 1.0 and asked:
            guess.time_remark = "time is read in s, as its header says no unit, 1 s a row"
        elif typical == 1.0:
            options = (("unit", f"{guess.time}=ms"), ("unit", f"{guess.time}=s"))
            guess.problems.append(
                Problem(
                    f"The time {quoted(guess.time or '')} advances by 1 a row, which may be "
                    "milliseconds, seconds, or the number of the row.",
                    (*options, ("dt", "SECONDS")),
                )
            )
        elif typical >= 2.0:
            unit = "ms" if typical <= 500.0 else "us" if typical < 5e5 else "ns"
            guess.units["time"] = unit
            guess.time_remark = f"time is in {unit}, as it advances by {typical:g} a row"

    def _find_labels(self) -> None:
        guess = self.guess
        found: dict[str, list[_Column]] = {}
        for column in self.free.values():
            level = find_label(column.header)
            if not level or (column.numbers.size < 2 and self.table.kind == "variable"):
                continue
            if self._labels(column) or (level == "run" and not roles_by_name(column.header)):
                found.setdefault(level, []).append(column)
        own = next((c for c in self.free.values() if c.header == self.table.run_name), None)
        if guess.run is None and own is not None:
            guess.run = self._take(own.position).header
            found.pop("run", None)
        if guess.run is None and "run" in found:
            runs = found.pop("run")
            guess.run = self._take(runs[-1].position).header
            for column in runs[:-1]:
                guess.levels[self._take(column.position).header] = "block"
        found.pop("run", None)
        falls = None if guess.time is None else self.columns[self.table.find(guess.time)].falls
        if guess.run is None and falls is not None and falls.size:
            for column in list(self.free.values()):
                codes = pd.factorize(pd.Series(column.raw))[0]
                if guess.run is None and np.array_equal(np.flatnonzero(np.diff(codes)) + 1, falls):
                    guess.run = self._take(column.position).header
                    found = {k: [c for c in v if c is not column] for k, v in found.items()}
                    guess.remarks.append(
                        f"{quoted(guess.run)} changes where the clock is set back, and is the run"
                    )
        if guess.run is None:  # then the innermost label that there is
            for level in ("block", "session"):
                if found.get(level) and self.table.kind == "column":
                    guess.run = self._take(found.pop(level)[0].position).header
                    break
        for level in ("subject", "session", "condition", "block"):
            for column in found.get(level, ())[:1]:
                if level not in guess.levels.values():
                    guess.levels[self._take(column.position).header] = level

    def _labels(self, column: _Column) -> bool:
        values = np.asarray(pd.Series(column.raw))
        if column.is_text:
            return len(pd.unique(values)) <= max(1, values.size // 10)
        if values.size < 3 or labelled_stretches(values, "") > 0:
            return True
        there = column.numbers[np.isfinite(column.numbers)]  # rows of runs that lie interleaved
        few = len(np.unique(there)) <= max(1, values.size // _OF_A_LABEL)
        return bool(few and there.size and find_label(column.header) in _OUTER)

    def _signals(self) -> list[_Column]:
        return [c for c in self.free.values() if c.numbers.size > 1 and not c.is_text]

    def _by_name(self, open_roles: set[str], *, least: int) -> None:
        """Take columns role by role, those of the clearest names first."""
        for score in range(10, least - 1, -1):
            for role in ("e", "f_t", "u", "x", "dist", "motion"):
                if role not in open_roles or role in self.found or role in self.tied:
                    continue
                if role == "e" and score < STRONG and "f_t" in self.signals:
                    continue  # an "input" beside a target is the person's, to the plant
                columns = [
                    c
                    for c in self.free.values()
                    if c.numbers.size > 1 and roles_by_name(c.header).get(role) == score
                ]
                columns = [c for c in columns if not c.is_text] or columns
                if not columns:
                    continue
                if len(columns) > 1 and not alike([c.numbers for c in columns]):
                    if score < STRONG:
                        continue
                    columns = self._of_one_axis(columns)
                if len(columns) > 1 and not alike([c.numbers for c in columns]):
                    self.tied[role] = columns
                    continue
                self._give(role, columns[0])
        # "input" and "output" beside an error are of the person or of the plant.
        weak = {c.header: roles_by_name(c.header) for c in self.free.values()}
        both = [c for c in self.free.values() if 4 <= weak[c.header].get("u", 0) < STRONG]
        if least < STRONG and "u" in open_roles and "u" not in self.found and len(both) > 1:
            self.tied.setdefault("u", both)

    def _of_one_axis(self, columns: list[_Column]) -> list[_Column]:
        """Of columns that may be one signal, those that move, and of the axis that is known."""
        of_axis = [c for c in columns if find_axis(c.header) and find_axis(c.header) == self.axis]
        columns = of_axis or columns
        return [c for c in columns if moves(c.numbers)] or columns

    def _give(self, role: str, column: _Column) -> None:
        self.found[role] = self._take(column.position)
        self.signals[role] = column.numbers
        self.tied.pop(role, None)
        self.axis = self.axis or find_axis(column.header)
        for other, columns in list(self.tied.items()):
            left = self._of_one_axis([c for c in columns if c is not column])
            self.tied[other] = left
            if len(left) == 1:
                self._give(other, left[0])
                return

    def _settle_output(self) -> None:
        """Of several inputs of the person, take the one that alone goes with the error."""
        columns = self.tied.get("u", [])
        if not columns:
            return
        error = self._find_error()
        if error is None:
            return
        shares = [coherence(c.numbers, error) for c in columns]
        best, *others = sorted(shares, reverse=True)
        if best < _DECIDES or max(others) > _FAR_BEHIND:
            return
        column = columns[shares.index(best)]
        names = ", ".join(quoted(c.header) for c in columns if c is not column)
        self.guess.remarks.append(
            f"{quoted(column.header)} is the output and not {names}, as it alone moves with the "
            "error"
        )
        self._give("u", column)

    def _is_strong(self, role: str) -> bool:
        return roles_by_name(self.found[role].header).get(role, 0) >= STRONG

    def _find_error(self) -> np.ndarray | None:
        """The error, or what stands for it."""
        if "e" in self.signals:
            return self.signals["e"]
        if {"f_t", "x"} <= self.signals.keys():
            return self.signals["f_t"] - self.signals["x"]
        return self.signals.get("x")

    def _by_loop(self, open_roles: set[str], known: set[str]) -> None:
        """Let values and what is left over say what names do not."""
        tied = {c.header: c for columns in self.tied.values() for c in columns}
        left = list((tied | {c.header: c for c in self._nameless()}).values())
        left = list(tied.values()) if tied and len(left) > MOST_OF_LOOP else left
        there = set(self.signals) | known
        if not left and ("e" not in self.found or not self._is_strong("e")):
            left = [c for c in self._signals() if moves(c.numbers)]
        taken: list[_Column] = []
        error = self._find_error()
        if there == {"u"} and "e" in open_roles and "u" not in open_roles and len(left) == 1:
            self._give("e", left[0])  # the output was said
            taken = left
        elif "u" in open_roles - there and there & {"e", "f_t"} and len(left) == 1:
            if error is not None and answers(left[0].numbers, error):
                self._give("u", left[0])
                taken = left
        elif {"u", "e"} & open_roles - there or ({"u", "x"} <= there and not there & {"e", "f_t"}):
            columns = {c.header: c for c in left}
            own = {role: f"\0{role}" for role in self.signals if role in ("e", "f_t", "x", "u")}
            values = {name: self.signals[role] for role, name in own.items()}
            loop = find_loop(values | {name: c.numbers for name, c in columns.items()}, own)
            self.outputs = [columns[name] for name in loop.outputs if name in columns]
            self.tied = {} if loop.roles else self.tied
            for role, name in loop.roles.items():
                if role in open_roles and name in columns:
                    self._give(role, columns[name])
                    taken.append(columns[name])
        if taken:
            names = ", ".join(quoted(c.header) for c in taken)
            self.guess.remarks.append(f"{names} by values and what is left over, not by name")

    def _by_value(self, open_roles: set[str]) -> None:
        """Find what is missing of e, f_t and x by e = f_t - x."""
        triple = [role for role in ("e", "f_t", "x") if role in self.signals]
        missing = [r for r in ("e", "f_t", "x") if r not in self.signals and r in open_roles]
        if len(missing) != 1 or len(triple) != 2:
            return
        one, other = (self.signals[role] for role in triple)
        signs = {"e": [one - other, other - one], "f_t": [one + other, other - one]}
        signs["x"] = [other - one, other + one]
        role = missing[0]
        pool = self.tied.get(role) or [c for c in self._signals() if c.header]
        for wanted in signs[role]:
            close = [c for c in pool if equal(c.numbers, wanted)]
            if len(close) == 1:
                self._give(role, close[0])
                return

    def _check_error(self, known: set[str]) -> None:
        """Form e of f_t and x, or turn its sign, where that is what the values say."""
        guess, signals = self.guess, self.signals
        if not {"f_t", "x"} <= signals.keys():
            return
        difference = signals["f_t"] - signals["x"]
        if "e" not in signals and "e" not in self.tied and "e" not in known:
            guess.error_from = "f_t - x"
        elif "e" in self.found:
            if equal(signals["e"], -difference) and not equal(signals["e"], difference):
                guess.error_from = "-e"
            elif moves(signals["e"]) and moves(difference) and not equal(signals["e"], difference):
                factor = find_factor(signals["e"], difference)
                if factor is None:
                    guess.remarks.append("e is not f_t - x in this file, and is taken as it is")
                    return
                guess.error_from = "-e" if factor < 0 else ""
                guess.remarks.append(
                    f"e is {factor:.4g} times f_t - x in this file: is its unit another one than "
                    "its header says?"
                )

    def _nameless(self) -> list[_Column]:
        """Signals whose names do not say what they are."""
        return [
            c
            for c in self._signals()
            if not is_row_number(c.header)
            and not is_no_signal(c.header)
            and not is_derived(c.header)
            and max(roles_by_name(c.header).values(), default=0) < STRONG
            and moves(c.numbers)
        ]

    def _say_ties(self) -> None:
        for role, columns in self.tied.items():
            names = ", ".join(quoted(c.header) for c in columns)
            text = f"{len(columns)} columns may be {_THE[role]}: {names}."
            options = tuple((OPTION.get(role, "role"), c.header) for c in columns)
            if role in ("dist", "motion"):
                self.guess.remarks.append(f"{names} may be {MEANING[role]}, and are not used")
                for column in columns:
                    self.free.pop(column.position, None)
                continue
            self.guess.problems.append(Problem(text, options))

    def _say_doubled(self, open_roles: set[str]) -> None:
        """Headers that stand twice where a column of that name is needed."""
        names = self.table.names
        for name in dict.fromkeys(n for n in names if n and names.count(n) > 1):
            roles = [r for r, score in roles_by_name(name).items() if score >= STRONG]
            role = next((r for r in roles if r in open_roles and r not in self.found), None)
            if role is None:
                continue
            self.doubled.add(role)
            places = [k for k, other in enumerate(names) if other == name]
            raw = self.table.peek(PEEK)
            dead = [k for k in places if not moves(numbers_of(raw[k]))]
            said = f"{', '.join(str(k + 1) for k in places[:-1])} and {places[-1] + 1}"
            also = "".join(f"; column {k + 1} never changes" for k in dead)
            self.guess.problems.append(
                Problem(
                    f"{len(places)} columns are called {quoted(name)}, which would be "
                    f"{_THE[role]}: columns {said}{also}. Give each its own name in the file."
                )
            )

    def _say_missing(self, known: set[str], output_known: bool, signals: bool) -> None:
        """Ask for the output, or for the input; for both only if one would not settle the other."""
        there = set(self.signals) | known | set(self.tied) | self.doubled
        asks_error = signals and not there & {"e", "f_t"}
        left = self._nameless() or [c for c in self._signals() if moves(c.numbers)]
        left = [*self.outputs, *(c for c in left if c not in self.outputs)]
        place, output = self.found.get("x"), self.found.get("u")
        two = [c for c in (output, *left, place) if c is not None]
        plainly = "by its name, nor plainly by its values,"
        if asks_error and not output_known and len(two) == 2 and not there & {"dist"}:
            text = "Of the two signals neither is by its name the error e, or the target f_t."
            text += " Which is the output? It answers the other."
            options = [("output", c.header) for c in two]
            self.guess.problems.append(Problem(text, tuple(options)))
            return
        if not output_known and "u" not in there:
            text = f"No column is {plainly} the output u, what the person did."
            options = [("output", c.header) for c in left[:_OFFERED]]
            # A cursor may be what the person moves; a plant is not.
            if not left and place and roles_by_name(place.header).get("x", 0) < _OF_PLANT:
                text += " If the person moves x itself, that is the output."
                options = [("output", place.header)]
            options = options or self._by_number("output")
            self.guess.problems.append(Problem(text, tuple(options)))
            values = {c.header: c.numbers for c in left}
            if left and find_loop(values, {"u": left[0].header}).roles:
                asks_error = False
        if asks_error:
            text = (
                f"No column is {plainly} the error e, or the target f_t, which the person answers."
            )
            inputs = left if output_known or "u" in there or len(left) < 2 else left[1:]
            options = [("input", c.header) for c in inputs[:_OFFERED]]
            if place:  # beside x the target may have been recorded, or the error
                options = [(o, c.header) for c in inputs[:_OFFERED] for o in ("target", "input")]
            options = options or ([("input", place.header)] if place else self._by_number("input"))
            self.guess.problems.append(Problem(text, tuple(options)))

    def _by_number(self, option: str) -> list[tuple[str, str]]:
        """Columns whose names repeat, as options."""
        names = self.table.names
        places = [k + 1 for k, name in enumerate(names) if name and names.count(name) > 1]
        return [(option, str(k)) for k in places[:_OFFERED]] or [(option, "NAME")]


def guess_columns(paths: Any, **given: Any) -> ColumnGuess:
    """Guess which column of the first file is which, from headers and values.

    ``roles`` are those of columns that are known, {"err": "e"}, which keep their names; with
    ``signals=False`` no other channels are taken than these, and the output. Output, time, run,
    units and dt are as in :func:`skhoid.read_runs`; None is guessed.
    """
    return make_guess(first_table(paths), paths, **given)
