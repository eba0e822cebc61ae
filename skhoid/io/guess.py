"""Which column of a file is which: guessed from the headers and the first rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..runs.roles import role_of

__all__ = ["ColumnGuess", "Problem", "UnclearColumnsError", "guess_columns"]

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


def without_list(text: str, path: Any) -> str:
    """A message about one column as a sentence of several: without the file, and what it has."""
    text = text.removeprefix(f"{path} ")
    before, mark, after = text.partition(" It has: ")
    if mark:
        near = after.rpartition(" Did you mean ")
        text = before + (f" Did you mean {near[2]}" if near[1] else "")
    text = re.sub(r"^has no (column|variable) ", r"There is no \1 ", text)
    return text[:1].upper() + text[1:]


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
    problems: list[Problem] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    guessed: bool = True

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
        return text + "".join(f"; {remark}" for remark in self.remarks)

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
            "remarks": self.remarks,
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


def guess_columns(
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
    """Guess which column of a file is which, from the headers and the first 1,000 rows.

    Parameters
    ----------
    paths : path, glob pattern, or list of these
        As in :func:`skhoid.read_runs`; the first file is looked at.
    roles : dict or None, default=None
        Columns that are known, with their roles: ``{"err": "e"}``. They keep their names.
    output, time, run, units, dt
        As in :func:`skhoid.read_runs`; None is guessed.
    signals : bool, default=True
        False takes no other channels than those of `roles`, and the output.

    Returns
    -------
    guess : ColumnGuess
        Its text says in one line which column is which; ``problems`` what is not clear.

    See Also
    --------
    skhoid.read_runs : Reads files, by a guess for what is not named.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid.io.guess import guess_columns
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "s1.csv"
    ...     _ = path.write_text("Time [ms],Tracking error (deg),Stick\\n0,1.5,0\\n10,1.2,.1\\n")
    ...     print(guess_columns(path))
    Columns: time "Time [ms]", error e "Tracking error (deg)", output u "Stick"
    """
    from ._guessing import guess_of
    from .readers import first_table

    given: dict[str, Any] = {"roles": roles, "output": output, "time": time, "run": run}
    return guess_of(first_table(paths), paths, **given, units=units, dt=dt, signals=signals)


def where_of(paths: list[Path]) -> str:
    """Files as the beginning of a message."""
    from ._paths import shown

    return shown(paths[0]) if len(paths) == 1 else f"{shown(paths[0])} and {len(paths) - 1} more"
