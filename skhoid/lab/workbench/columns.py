"""Columns of the files, and what the user chose: from there to X, y and a script that makes them.

``look`` says which column is what, ``read`` makes X and y of it.
"""

from __future__ import annotations

import math
import pprint
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ... import check_channels
from ...io import FileTable, first_table, numbers_of, split_header
from ...runs import read_layout, role_of
from ...text import counted
from ..guessing import ColumnGuess, Problem, guess_columns
from ..opening import read_chosen, read_element

WIDTH = 96  # columns of the script
PEEK = 1000  # rows
POINTS = 120  # of the small picture of a column
OF_OPTION = {"input": "e", "output": "u", "target": "f_t"}
NOT_USED = ""
KINDS = {
    NOT_USED: "not used",
    "time": "time",
    "run": "run",
    "subject": "subject",
    "condition": "condition",
    "session": "session",
    "block": "block",
    "e": "error e",
    "u": "output u, what the person did",
    "x": "x, output of the controlled element",
    "f_t": "target f_t",
    "dist": "disturbance",
    "motion": "motion",
    "other": "other channel",
}
LEVELS = ("subject", "condition", "session", "block")
CHANNELS = ("e", "x", "f_t", "dist", "motion", "other")
CORES = ("operator", "arx")
DISPLAYS = ("compensatory", "pursuit", "preview")
LONGEST = 200  # characters of a unit
METHODS = ("ideal", "aggregate", "downsample")
PADDINGS = ("periodic", "odd")
SECONDS = {
    "dt": "The sampling time",
    "until": "The end",
    "run_in": "The run-in",
    "measurement_time": "The end that is kept",
    "shift": "The delay shift",
    "delay": "The delay",
}
MAY_BE_ZERO = ("run_in", "shift", "delay")
COUNTS = {"decimate": 1, "na": 1, "nb": 1, "nk": 0}  # and the least of each
OF_READING = ("named", "kinds", "units", "dt", "subject", "condition", "resample")


class UnfitChoiceError(ValueError):
    """A choice that is not possible, or not with these data; ``field`` is its name."""

    def __init__(self, text: str, field: str):
        super().__init__(text)
        self.field = field


@dataclass(frozen=True)
class Choices:
    """All that is needed, beside the files, to make X, y and the model of them.

    ``named`` is what the command line says of columns, for the guess; ``kinds`` and ``units`` are
    by column, as corrected in the page, and None as long as the guess is left as it is.
    """

    named: dict[str, Any] = field(default_factory=dict)
    kinds: dict[str, str] | None = None
    units: dict[str, str] | None = None
    dt: float | None = None
    subject: str | None = None
    condition: str | None = None
    resample: bool = False
    until: float | None = None
    remove_means: bool = False
    run_in: float | None = None
    measurement_time: float | None = None
    decimate: int = 1
    method: str = METHODS[0]
    padding: str = PADDINGS[0]
    shift: float | None = None
    core: str = "operator"
    delay: float | None = None
    na: int | None = None
    nb: int | None = None
    nk: int | None = None
    display: str | None = None
    controlled_element: str | None = None
    effects: list[str] | None = None
    max_effects: int | None = None
    lost_control: str = "leave_out"
    time_limit: float | None = None
    exhaustive: bool = False

    @property
    def clock(self) -> float | None:
        """The sampling time where no column is the time; of a resampled one it is the new."""
        return None if self.resample else self.dt

    @property
    def of_reading(self) -> dict[str, Any]:
        """Those that say how the files are read."""
        return {name: getattr(self, name) for name in OF_READING}

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return asdict(self)

    def corrected(self, asked: Mapping[str, Any], columns: list[str]) -> Choices:
        """These choices with what the page sends, which is checked.

        ``columns`` are those of the files, the only ones that may be named.
        """
        told = {**self.as_dict(), **asked}
        kinds, units = told["kinds"], told["units"]
        seconds: dict[str, Any] = {name: _read_seconds(told[name], name) for name in SECONDS}
        counts: dict[str, Any] = {name: _read_count(told[name], name) for name in COUNTS}
        if seconds["run_in"] and seconds["measurement_time"]:
            raise UnfitChoiceError("Give the run-in or this, not both.", "measurement_time")
        return replace(
            self,
            kinds=None if kinds is None else _by_column(kinds, columns, "kind", KINDS),
            units=None if units is None else _by_column(units, columns, "unit", None),
            core=_one_of(told["core"], CORES, "core"),
            display=_one_of(told["display"] or None, (None, *DISPLAYS), "display"),
            method=_one_of(told["method"], METHODS, "filter"),
            padding=_one_of(told["padding"], PADDINGS, "end of runs"),
            remove_means=bool(told["remove_means"]),
            resample=bool(told["resample"]),
            **seconds,
            **counts | {"decimate": counts["decimate"] or 1},
        )


def _by_column(
    given: Any, columns: list[str], what: str, allowed: Mapping[str, str] | None
) -> dict[str, str]:
    if not isinstance(given, Mapping):
        raise ValueError(f"The {what}s of the columns must be an object; got {given!r:.80}.")
    for column, value in given.items():
        if column not in columns:
            raise ValueError(f"The files have no column {column!r:.200}.")
        if not isinstance(value, str) or (allowed is not None and value not in allowed):
            raise ValueError(f"Column {column!r:.200} cannot be {value!r:.80}.")
        if len(value) > LONGEST:
            raise ValueError(f"The {what} of column {column!r:.200} is too long: {len(value)}.")
    return {str(column): value.strip() for column, value in given.items()}


def _read_seconds(value: Any, field: str) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    least = "0 or more" if field in MAY_BE_ZERO else "above 0"
    if not math.isfinite(number) or number < 0 or (number == 0 and field not in MAY_BE_ZERO):
        text = f"{SECONDS[field]} must be a number {least}, in seconds; got {value!r:.80}."
        raise UnfitChoiceError(text, field)
    return number


def _read_count(value: Any, field: str) -> int | None:
    if value is None or value == "":
        return None
    text = str(value).strip()
    if not (text.isascii() and text.isdecimal() and len(text) < 7 and int(text) >= COUNTS[field]):
        raise UnfitChoiceError(
            f"It must be a whole number, at least {COUNTS[field]}; got {value!r:.80}.", field
        )
    return int(text)


def _one_of(value: Any, allowed: tuple[Any, ...], what: str) -> Any:
    if value not in allowed:
        raise ValueError(f"There is no {what} {value!r:.80}.")
    return value


@dataclass(frozen=True)
class Columns:
    """The columns of the files, how they are read, and what of it is not a guess."""

    guess: ColumnGuess
    table: list[dict[str, Any]]
    problems: list[dict[str, Any]]
    asked: dict[str, Any]

    @property
    def names(self) -> list[str]:
        """Headers, in the order of the file."""
        return [column["name"] for column in self.table]


def look(paths: list[Path], choices: Choices) -> Columns:
    """Look at the first file, and say which column is what."""
    opened = first_table(paths)
    asked = {**choices.named, "dt": choices.clock}
    guess = guess_columns(paths, **asked)
    kinds, units = _list_kinds(guess), _read_units(guess, opened)
    if _differs(choices.kinds, kinds) or _differs(choices.units, units):
        kinds |= choices.kinds or {}
        units |= choices.units or {}
        if choices.clock is not None:  # then no column is the time
            kinds = {name: NOT_USED if kind == "time" else kind for name, kind in kinds.items()}
        twice = list(_find_doubled(kinds))
        asked |= _as_options(kinds, units)
        before, guess = guess, guess_columns(paths, **asked)
        guess.levels = {name: kind for name, kind in kinds.items() if kind in LEVELS}
        guess.error_from = _form_error(before, kinds)
        guess.problems = [*twice, *guess.problems]
        kinds = kinds if twice else _list_kinds(guess)
    table = list(_table(opened, kinds, units))
    problems = [noted(problem, table) for problem in guess.problems]
    said = {key: value for key, value in asked.items() if value or key == "signals"}
    return Columns(guess, table, problems, said)


def _differs(chosen: Mapping[str, str] | None, guessed: Mapping[str, str]) -> bool:
    return any(guessed.get(name, "") != value for name, value in (chosen or {}).items())


def _as_options(kinds: Mapping[str, str], units: Mapping[str, str]) -> dict[str, Any]:
    """What a guess is told, so that it takes these columns and no others."""
    first = {kind: name for name, kind in reversed(list(kinds.items()))}
    return {
        "roles": {n: "" if k == "other" else k for n, k in kinds.items() if k in CHANNELS},
        "output": first.get("u"),
        "time": first.get("time"),
        "run": first.get("run"),
        "units": {name: unit for name, unit in units.items() if unit and kinds.get(name)},
        "signals": not any(kind in CHANNELS for kind in kinds.values()),
    }


def _form_error(before: ColumnGuess, kinds: Mapping[str, str]) -> str:
    """How the error is made: of f_t and x where no column holds it; its sign stays as found."""
    roles = set(kinds.values()) & {"e", "x", "f_t"}
    if roles == {"x", "f_t"}:
        return "f_t - x"
    same = {n for n, k in kinds.items() if k in roles} <= set(before.channels)
    return "-e" if before.error_from == "-e" and len(roles) == 3 and same else ""


def _find_doubled(kinds: Mapping[str, str]) -> Iterator[Problem]:
    for kind in ("time", "run", "u", "e", "x", "f_t"):
        names = [name for name, other in kinds.items() if other == kind]
        if len(names) > 1:
            listed = " and ".join(f'"{name}"' for name in names)
            options = tuple((_option(kind), name) for name in names)
            yield Problem(f"{listed} are both called {KINDS[kind]}.", options)


def _list_kinds(guess: ColumnGuess) -> dict[str, str]:
    kinds = dict.fromkeys(guess.columns, NOT_USED)
    for name, channel in guess.channels.items():
        role = role_of(channel, guess.roles)
        # There may be several disturbances and motions.
        several = next((kind for kind in ("dist", "motion") if role.startswith(kind)), role)
        kinds[_whole(name, guess.columns)] = several if several in CHANNELS else "other"
    kinds |= {_whole(name, guess.columns): level for name, level in guess.levels.items()}
    single = (("time", guess.time), ("run", guess.run), ("u", guess.output and guess.output[0]))
    return kinds | {_whole(name, guess.columns): kind for kind, name in single if name}


def _whole(asked: str, columns: list[str]) -> str:
    """The header of a column that was named without its unit."""
    if asked in columns:
        return asked
    return next((name for name in columns if split_header(name)[0] == asked), asked)


def _read_units(guess: ColumnGuess, opened: FileTable) -> dict[str, str]:
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


# X and y of them.


@dataclass(frozen=True)
class Recorded:
    """X and y, what they are in words, what is wrong with them, and the script that reads them."""

    X: Any
    y: Any
    inputs: list[str]
    roles: dict[str, str]
    words: str
    findings: list[dict[str, str]]
    source: list[str]


def read(paths: list[Path], columns: Columns, choices: Choices) -> Recorded:
    """Read all files, and check units, clocks and channels."""
    guess = columns.guess
    X, y = read_chosen(guess, choices)
    findings = [] if choices.resample else check_channels(X, y)
    said = [
        {
            "title": one.title,
            "evidence": one.evidence,
            "meaning": one.meaning,
            "next_step": one.next_step,
        }
        for one in findings
    ]
    return Recorded(
        X, y, guess.inputs, guess.roles, _words(X), said, _source(paths, columns, choices, X)
    )


def search_settings(choices: Choices) -> dict[str, Any]:
    """Parameters of the search that the user has set."""
    names = (
        "display",
        "controlled_element",
        "effects",
        "max_effects",
        "lost_control",
        "time_limit",
        "exhaustive",
    )
    settings = {name: getattr(choices, name) for name in names}
    settings["controlled_element"] = read_element(choices.controlled_element)
    return {name: value for name, value in settings.items() if value is not None}


def _words(X: Any) -> str:
    """How much there is: runs, rows, duration, rate."""
    levels = [name for name in X.index.names if name != "time"]
    time = X.index.get_level_values("time").to_numpy()
    n_runs = len(read_layout(X).labels)
    step = np.diff(time[: min(len(time), 1000)])
    dt = float(np.median(step)) if step.size else float("nan")
    people = X.index.unique("subject") if "subject" in levels else []
    who = f" of {len(people)} people" if len(people) > 1 else ""
    seconds = len(X) * dt
    return (
        f"{counted(n_runs, 'run')}{who}, {counted(len(X), 'row')}: {seconds:.4g} s in all, one "
        f"row every {dt:.4g} s."
    )


def _source(paths: list[Path], columns: Columns, choices: Choices, X: Any) -> list[str]:
    """Lines of Python that make X and y as they were made here; the script imports the names."""
    names = [str(path) for path in paths]
    listed = pprint.pformat(names[0] if len(names) == 1 else names, width=WIDTH - 4)
    if not columns.asked and not choices.resample:
        return [f"X, y = read_runs({listed})", *_choose_runs(choices)]
    guess = columns.guess
    assert guess.output is not None
    said: dict[str, Any] = {"inputs": guess.channels, "output": dict([guess.output])}
    said |= {name: getattr(guess, name) for name in ("time", "run", "units", "dt")}
    said = {name: value for name, value in said.items() if value}
    if guess.levels or (guess.run is None and len(read_layout(X).labels) > len(paths)):
        said["levels"] = guess.levels  # without any they say that runs begin where time restarts
    lines = ["X, y = read_runs(", f"    {listed},"]
    lines += [*(f"    {name}={value!r}," for name, value in said.items()), ")"]
    if guess.error_from == "-e":
        lines += ['X["e"] = -X["e"]']
    elif guess.error_from:
        x, f_t = (next(n for n in X if role_of(n, guess.roles) == role) for role in ("x", "f_t"))
        lines += [f'X.insert(0, "e", X[{f_t!r}] - X[{x!r}])']
        if unit := X.attrs["units"].get("e"):
            lines += [f'X.attrs["units"]["e"] = {unit!r}']
    return lines + _choose_runs(choices)


def _choose_runs(choices: Choices) -> list[str]:
    lines = []
    for level in ("subject", "condition"):
        label = getattr(choices, level)
        if label is not None:
            lines += [
                f"chosen = X.index.get_level_values({level!r}).astype(str) == {label!r}",
                f"X, y = X[chosen].droplevel({level!r}), y[chosen].droplevel({level!r})",
                "X.index, y.index = (part.index.remove_unused_levels() for part in (X, y))",
            ]
    if choices.resample:
        lines += [f"X, y = resample_runs(X, y, dt={choices.dt})"]
    return lines
