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
from ...io import FileTable, numbers_of, open_table, split_header
from ...runs import OUTPUT, read_layout, role_of
from ...text import counted
from ..guessing import ColumnGuess, Problem, guess_columns
from ..opening import read_chosen, read_element, trimmed

__all__ = [
    "KINDS",
    "NOT_USED",
    "Choices",
    "Columns",
    "Recorded",
    "look",
    "noted",
    "read",
    "search_settings",
]

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
CORES = ("operator", "arx")
DISPLAYS = ("compensatory", "pursuit", "preview")
LONGEST = 200  # characters of a unit


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
    remove_means: bool = False
    run_in: float | None = None
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

    @property
    def clock(self) -> float | None:
        """The sampling time where no column is the time; of a resampled one it is the new."""
        return None if self.resample else self.dt

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return asdict(self)

    def corrected(self, asked: Mapping[str, Any], columns: list[str]) -> Choices:
        """These choices with what the page sends, which is checked.

        ``columns`` are those of the files, the only ones that may be named.
        """
        kinds = asked.get("kinds", self.kinds)
        units = asked.get("units", self.units)
        return replace(
            self,
            kinds=None if kinds is None else _by_column(kinds, columns, "kind", KINDS),
            units=None if units is None else _by_column(units, columns, "unit", None),
            dt=_number(asked.get("dt", self.dt), "The sampling time"),
            core=_one_of(asked.get("core", self.core), CORES, "core"),
            display=_one_of(
                asked.get("display", self.display) or None, (None, *DISPLAYS), "display"
            ),
            remove_means=bool(asked.get("remove_means", self.remove_means)),
            resample=bool(asked.get("resample", self.resample)),
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


def _number(value: Any, what: str) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{what} must be a number above 0, in seconds; got {value!r:.80}.")
    return number


def _one_of(value: Any, allowed: tuple[Any, ...], what: str) -> Any:
    if value not in allowed:
        raise ValueError(f"There is no {what} {value!r:.80}.")
    return value


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
    X, y = trimmed(X, y, choices)
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
        X, y, guess.inputs, guess.roles, _words(X), said, _source(paths, columns, choices)
    )


def search_settings(choices: Choices) -> dict[str, Any]:
    """Parameters of the search that the user has set."""
    names = ("display", "controlled_element", "effects", "max_effects", "lost_control")
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


def _source(paths: list[Path], columns: Columns, choices: Choices) -> list[str]:
    """Lines of Python that make X and y as they were made here; the script imports readers."""
    names = [str(path) for path in paths]
    listed = pprint.pformat(names[0] if len(names) == 1 else names, width=WIDTH - 4)
    if columns.as_guessed and not choices.resample:
        lines = [f"X, y = read_runs({listed})"]
    else:
        lines = [
            "from skhoid.lab.guessing import ColumnGuess, read_guessed",
            "",
            f"columns = ColumnGuess({listed})",
            *_set(columns.guess),
            f"X, y = read_guessed(columns{', irregular=True' if choices.resample else ''})",
        ]
    return lines + _worked_on(choices)


def _set(guess: ColumnGuess) -> list[str]:
    names = ("channels", "roles", "output", "time", "dt", "run", "levels", "units", "error_from")
    values = {name: getattr(guess, name) for name in names}
    return [
        f"columns.{name} = {pprint.pformat(value, width=WIDTH - 20, sort_dicts=False)}"
        for name, value in values.items()
        if value
    ]


def _worked_on(choices: Choices) -> list[str]:
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
    if choices.run_in:
        lines += [
            "from skhoid import RunInTrimmer",
            f"X = RunInTrimmer(run_in={choices.run_in!r}).fit_transform(X)",
        ]
    if choices.remove_means:
        lines += [
            "units = X.attrs, y.attrs",
            "X, y = X - X.mean(), y - y.mean()",
            "X.attrs, y.attrs = units",
        ]
    return lines
