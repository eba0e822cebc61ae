"""Columns of the files: what each was guessed to be, or is by the user's correction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...io._column_guess import ColumnGuess, Problem
from ...io._formats import open_table
from ...io._likeness import numbers_of
from ...io._table import FileTable, split_header
from ...io.guess import guess_columns
from ...runs.roles import OUTPUT, role_of
from .choices import KINDS, NOT_USED, Choices

__all__ = ["Columns", "look", "noted"]

PEEK = 1000  # rows
POINTS = 120  # of the small picture of a column
OF_OPTION = {"input": "e", "output": "u", "target": "f_t"}


@dataclass(frozen=True)
class Columns:
    """The columns of the files, and how they are read."""

    guess: ColumnGuess
    table: list[dict[str, Any]]
    problems: list[dict[str, Any]]
    as_guessed: bool = True

    @property
    def names(self) -> list[str]:
        """Headers, in the order of the file."""
        return [column["name"] for column in self.table]


def look(paths: list[Path], choices: Choices) -> Columns:
    """Look at the first file, and say which column is what."""
    opened = open_table(paths[0])
    base = guess_columns(paths, **_named(choices))
    kinds, units = _kinds_of(base), _units_of(base, opened)
    as_guessed = not _differs(choices.kinds, kinds) and not _differs(choices.units, units)
    kinds |= choices.kinds or {}
    units |= choices.units or {}
    guess = base if as_guessed else _corrected(base, kinds, units, choices)
    table = list(_table(opened, kinds, units))
    problems = [noted(problem, table) for problem in guess.problems]
    plain = as_guessed and not any(choices.named.values()) and choices.clock is None
    return Columns(guess, table, problems, plain)


def _named(choices: Choices) -> dict[str, Any]:
    return choices.named | {"dt": choices.clock}


def _differs(chosen: Mapping[str, str] | None, guessed: Mapping[str, str]) -> bool:
    return any(guessed.get(name, "") != value for name, value in (chosen or {}).items())


def _kinds_of(guess: ColumnGuess) -> dict[str, str]:
    kinds = dict.fromkeys(guess.columns, NOT_USED)
    for name, channel in guess.channels.items():
        role = role_of(channel, guess.roles)
        kinds[_whole(name, guess.columns)] = _kind_of(role)
    kinds |= {_whole(name, guess.columns): level for name, level in guess.levels.items()}
    single = (("time", guess.time), ("run", guess.run), ("u", guess.output and guess.output[0]))
    kinds |= {_whole(name, guess.columns): kind for kind, name in single if name}
    return {name: kind if kind in KINDS else "other" for name, kind in kinds.items()}


def _kind_of(role: str) -> str:
    """A role as a kind; there may be several disturbances and motions."""
    several = next((kind for kind in ("dist", "motion") if role.startswith(kind)), role)
    return several if several in KINDS and several else "other"


def _whole(asked: str, columns: list[str]) -> str:
    """The header of a column that was named without its unit."""
    if asked in columns:
        return asked
    return next((name for name in columns if split_header(name)[0] == asked), asked)


def _units_of(guess: ColumnGuess, opened: FileTable) -> dict[str, str]:
    keys = {_whole(name, guess.columns): channel for name, channel in guess.channels.items()}
    if guess.output is not None:
        keys[_whole(guess.output[0], guess.columns)] = guess.output[1]
    if guess.time is not None:
        keys[_whole(guess.time, guess.columns)] = "time"
    found = {}
    for position, name in enumerate(opened.names):
        unit = guess.units.get(keys.get(name, name)) or guess.units.get(name)
        found[name] = unit or opened.unit_of(position) or ""
    return {name: unit for name, unit in found.items() if name}


def _corrected(
    base: ColumnGuess, kinds: dict[str, str], units: dict[str, str], choices: Choices
) -> ColumnGuess:
    """The guess that says what the user says, and nothing else."""
    if choices.clock is not None:  # then no column is the time
        kinds.update({name: NOT_USED for name, kind in kinds.items() if kind == "time"})
    single: dict[str, str | None] = {}
    problems = []
    for kind in ("time", "run", "u", "e", "x", "f_t"):
        names = [name for name, other in kinds.items() if other == kind]
        if len(names) > 1:
            listed = " and ".join(f'"{name}"' for name in names)
            options = tuple((_option(kind), name) for name in names)
            problems.append(Problem(f"{listed} are both called {KINDS[kind]}.", options))
        single[kind] = names[0] if names else None
    guess = ColumnGuess(
        base.paths, time=single["time"], run=single["run"], columns=base.columns, guessed=False
    )
    guess.dt = choices.clock
    guess.levels = {
        name: kind
        for name, kind in kinds.items()
        if kind in ("subject", "condition", "session", "block")
    }
    own = base.output is not None and _whole(base.output[0], base.columns) == single["u"]
    if single["u"] is not None:
        guess.output = base.output if own else (single["u"], OUTPUT)
    taken = {guess.output[1]} if guess.output else set()
    _name_channels(base, guess, kinds, taken)
    _form_error(base, guess, single)
    _set_units(guess, units)
    used = {*guess.channels, *guess.levels, *filter(None, single.values())}
    guess.unused = [name for name in base.columns if name not in used]
    guess.problems = problems + _missing(guess, single)
    return guess


def _name_channels(
    base: ColumnGuess, guess: ColumnGuess, kinds: dict[str, str], taken: set[str]
) -> None:
    """A channel is called as in the guess, or by its role, or as its column."""
    before = {_whole(name, base.columns): channel for name, channel in base.channels.items()}
    for name, kind in kinds.items():
        if kind not in ("e", "x", "f_t", "dist", "motion", "other"):
            continue
        role = "" if kind == "other" else kind
        header = split_header(name)[0]
        kept = before.get(name, "")
        if kept and _kind_of(role_of(kept, base.roles)) == kind and kept not in taken:
            channel, role = kept, role_of(kept, base.roles)
        elif kind == "other":
            channel = header if header not in taken else name
        else:
            channel = role = kind if kind not in taken else f"{kind}_{header}"
        taken.add(channel)
        guess.channels[name] = channel
        if role_of(channel) != role:
            guess.roles[channel] = role


def _form_error(base: ColumnGuess, guess: ColumnGuess, single: dict[str, str | None]) -> None:
    """Form e of f_t and x where no column holds it; its sign stays as it was found."""
    if single["f_t"] and single["x"] and not single["e"]:
        guess.error_from = "f_t - x"
    elif base.error_from == "-e":
        before = _kinds_of(base)
        same = all(before.get(single[kind] or "") == kind for kind in ("e", "x", "f_t"))
        guess.error_from = "-e" if same else ""


def _set_units(guess: ColumnGuess, units: dict[str, str]) -> None:
    keys = dict(guess.channels)
    if guess.output is not None:
        keys[guess.output[0]] = guess.output[1]
    if guess.time is not None:
        keys[guess.time] = "time"
    guess.units = {keys[name]: unit for name, unit in units.items() if unit and name in keys}


def _missing(guess: ColumnGuess, single: dict[str, str | None]) -> list[Problem]:
    found = []
    if guess.output is None:
        found.append(Problem("No column is called the output u, what the person did."))
    if not guess.channels:
        found.append(Problem("No column is called the error e, the target f_t, or a channel."))
    if guess.time is None and guess.dt is None:
        options = (("dt", "SECONDS"),)
        found.append(Problem("No column is called the time.", options))
    return found


def _option(kind: str) -> str:
    return {role: option for option, role in OF_OPTION.items()}.get(kind, kind)


def noted(problem: Problem, table: list[dict[str, Any]]) -> dict[str, Any]:
    """A problem in words, with what each column concerned may be; noted beside these, too."""
    offers = []
    for option, value in problem.options:
        name, _, unit = value.partition("=") if option == "unit" else (value, "", "")
        row = next((one for one in table if one["name"] == name), None)
        if row is None:
            continue
        kind = row["kind"] if option == "unit" else OF_OPTION.get(option, option)
        offers.append({"column": name, "kind": kind, "unit": unit})
        row["note"] = " ".join(filter(None, [row.get("note", ""), problem.text]))
    return {
        "text": problem.text,
        "offers": offers,
        "dt": any(option == "dt" for option, _ in problem.options),
    }


def _table(
    opened: FileTable, kinds: dict[str, str], units: dict[str, str]
) -> Iterator[dict[str, Any]]:
    peeked = opened.peek(PEEK)
    for name, raw in zip(opened.names, peeked, strict=False):
        if not name or opened.names.count(name) > 1:
            continue
        first = [_text(value) for value in np.ravel(np.asarray(raw, dtype=object))[:3]]
        yield {
            "name": name,
            "kind": kinds.get(name, NOT_USED),
            "unit": units.get(name, ""),
            "first": ", ".join(first),
            "points": _points(numbers_of(raw)),
            "note": "",
        }


def _text(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    return str(value)[:40]


def _points(values: np.ndarray) -> list[float | None]:
    """A picture of the first rows, from 0 to 1; None where there is no number."""
    values = np.ravel(values)
    if values.size > POINTS:
        values = values[np.linspace(0, values.size - 1, POINTS).astype(int)]
    known = np.isfinite(values)
    if not known.any():
        return []
    low, high = float(values[known].min()), float(values[known].max())
    with np.errstate(over="ignore", invalid="ignore"):
        level = (values - low) / (high - low) if high > low else np.full(values.size, 0.5)
    return [round(float(one), 3) if np.isfinite(one) else None for one in level]
