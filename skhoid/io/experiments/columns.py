"""Which columns of the files are channels, clock and labels: as named, or guessed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...runs.roles import role_of
from .._column_guess import ColumnGuess, Problem, UnclearColumnsError, without_list
from .._guessing import guess_of
from .._header_words import unit_by_name
from .._paths import shown
from .._table import FileTable, split_header
from .._wanted import (
    Channel,
    by_field,
    check_names,
    checked_clock,
    checked_units,
    wanted_channels,
)
from .levels import LEVELS

__all__ = ["Asked", "Columns", "columns_of"]


@dataclass(frozen=True)
class Asked:
    """What a user has said about columns."""

    inputs: Any
    output: Any
    time: str | None
    units: Mapping[str, str] | None
    dt: float | None
    levels: Mapping[str, str]  # level: column

    @property
    def channels(self) -> list[str] | None:
        """Columns of the channels that are named; None if none is."""
        named = [
            channel.asked
            for spec, what in ((self.inputs, "inputs"), (self.output, "output"))
            if spec is not None
            for channel in wanted_channels(spec, what)
        ]
        return named or None

    @property
    def complete(self) -> bool:
        """Whether nothing about channels and clock has to be guessed."""
        clock = self.time is not None or self.dt is not None
        return self.inputs is not None and self.output is not None and clock


@dataclass
class Columns:
    """Channels with the output last, clock and labels (column: level) of the files."""

    channels: list[Channel]
    clock: str | float
    units: dict[str, str]
    levels: dict[str, str]
    guess: ColumnGuess
    stated: bool = False  # whether the user gave the unit of the time
    known: dict[str, tuple[str, Path]] = field(default_factory=dict)

    @property
    def run(self) -> str | None:
        """The column that labels runs."""
        return next((name for name, level in self.levels.items() if level == "run"), None)

    @property
    def outer(self) -> dict[str, str]:
        """The other columns of labels."""
        return {name: level for name, level in self.levels.items() if level != "run"}

    @property
    def unit_by_steps(self) -> bool:
        """Whether the unit of the time was guessed from the steps of the first file."""
        by_name = isinstance(self.clock, str) and unit_by_name(self.clock, time=True)
        return "time" in self.units and not self.stated and not by_name

    def take_seconds(self) -> None:
        """Drop the unit that was guessed, as the clocks of other files do not look like it."""
        unit = self.units.pop("time")
        self.guess.units.pop("time", None)
        self.guess.remarks = [
            f"the clock of the first file looks like {unit}, that of others does not: all are "
            "read as s"
            if remark.startswith(f"time is in {unit}")
            else remark
            for remark in self.guess.remarks
        ]

    def of_file(self, table: FileTable) -> list[Channel]:
        """The channels under the names that they have in a file, whose units may differ."""
        return [
            Channel(_name_in(table, channel.asked), channel.name, renamed=True)
            for channel in self.channels
        ]

    def clock_of(self, table: FileTable) -> tuple[str | float, str | None]:
        """The clock of a file, and its unit if the header does not say it."""
        if not isinstance(self.clock, str):
            return self.clock, None
        unit = self.units.get("time")
        try:
            name = _name_in(table, self.clock)
        except ValueError:
            if not self.guess.guessed:
                raise
            own = guess_of(
                table,
                table.path,
                roles={},
                output=None,
                time=None,
                run=None,
                units=None,
                dt=None,
                signals=False,
            )
            if own.time is None:
                raise
            name, unit = own.time, own.units.get("time")
        if self.stated:
            return name, self.units["time"]
        header = table.names[table.find(name)]
        return name, table.unit_of(table.find(name)) or unit_by_name(header, time=True) or unit


def columns_of(table: FileTable, paths: Any, asked: Asked) -> Columns:
    """The columns of the first file; what is not clear is one error."""
    guess = _guess(table, paths, asked)
    if guess.problems:
        where = shown(table.path)
        unclear = UnclearColumnsError(where, guess.problems, guess.columns, guess.remarks)
        raise unclear if guess.guessed else ValueError(str(unclear))
    levels = dict(guess.levels)
    if guess.run is not None:
        levels[guess.run] = "run"
    named = {table.names[table.find(column)]: level for level, column in asked.levels.items()}
    levels = {
        name: level
        for name, level in levels.items()
        if level not in named.values() and name not in named
    }
    levels = named | levels
    used = {*levels, *asked.levels.values()}
    guess.unused = [name for name in guess.unused if name not in used]
    guess.run = next((name for name, level in levels.items() if level == "run"), None)
    guess.levels = {name: level for name, level in levels.items() if level != "run"}
    if asked.inputs is not None:
        inputs = wanted_channels(asked.inputs, "inputs")
        inputs = by_field(inputs) if table.kind == "variable" else inputs
    else:
        inputs = [
            Channel(column, name, renamed=True)
            for column, name in guess.channels.items()
            if column not in used
        ]
    assert guess.output is not None
    channels = [*inputs, Channel(*guess.output, renamed=True)]
    check_names(channels)
    clock = checked_clock(guess.time, guess.dt)
    given = dict(guess.units if not asked.complete else asked.units or {})
    units = checked_units(given, channels, guess.time)
    stated = "time" in checked_units(dict(asked.units or {}), channels, guess.time)
    return Columns(channels, clock, units, levels, guess, stated)


def _guess(table: FileTable, paths: Any, asked: Asked) -> ColumnGuess:
    named = (
        {}
        if asked.inputs is None
        else {channel.asked: channel.name for channel in wanted_channels(asked.inputs, "inputs")}
    )
    if asked.complete:
        checked_clock(asked.time, asked.dt)
    guess = guess_of(
        table,
        paths,
        roles={column: role_of(name) for column, name in named.items()},
        output=asked.output,
        time=asked.time,
        run=asked.levels.get("run"),
        units=asked.units,
        dt=asked.dt,
        signals=asked.inputs is None,
    )
    for level in LEVELS[:2]:
        column = asked.levels.get(level)
        if column is not None:
            try:
                table.find(column)
            except ValueError as error:
                guess.problems.append(Problem(without_list(str(error), table.path)))
    if asked.output is not None and not guess.problems:
        (output,) = wanted_channels(asked.output, "output")
        if table.kind == "variable":
            (output,) = by_field([output])
        guess.output = (output.asked, output.name)
    guess.guessed = not asked.complete
    return guess


def _name_in(table: FileTable, asked: str) -> str:
    """The header by which a file has a column: of the same text, or with another unit."""
    try:
        table.find(asked)
    except ValueError:
        short = split_header(asked)[0]
        if short == asked:
            raise
        table.find(short)
        return short
    return asked
