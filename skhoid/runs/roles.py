"""What names of columns say: roles of channels, the output, labels and clocks.

A channel has the role that ``roles={column: role}`` gives it, else the one its name implies: ``e``,
``x`` and ``f_t`` exactly, ``motion...`` and ``dist...`` as prefixes. The rest of skhoid asks here.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunIndexError, UsageError

RUN, TIME = "run", "time"  # levels of the row index
EXACT = ("e", "x", "f_t")
PREFIXES = ("motion", "dist")
OTHER = ""  # role of a channel that has none
OUTPUT = "u"  # what an output without a name is called
OUTER = ("subject", "condition")
LABELS = (RUN, "trial", "subject")  # of which only "run" can be nothing else
# What labels rows, from the shortest recording to the longest.
LABEL_WORDS: tuple[str, ...] = (RUN, "trial", "rep", "repetition", "recording", "block", "session")
LABEL_WORDS += ("subject", "participant")
# Levels of the row index outside of runs.
OUTER_WORDS = {"subject": "subject", "participant": "subject", "condition": "condition"}
OUTER_WORDS |= {"session": "session", "block": "block"}
_TIME_WORDS = (TIME, "timestamp", "elapsed")
_SECONDS = ("second", "sec", "msec", "ms")
_UNITS = (*_SECONDS, "s", "us")
_NUMBERING = ("id", "no", "nr", "num", "number", "index", "idx")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_A-Za-z]+")  # also those of camelCase
_UNIT = re.compile(r"\s*(\([^()]*\)|\[[^][]*\])\s*$")


def output_name(y: Any) -> str:
    """Name of the output."""
    name = y.columns[0] if isinstance(y, pd.DataFrame) else getattr(y, "name", None)
    return str(name or OUTPUT)


def is_role(role: str) -> bool:
    """Whether there is such a role."""
    return role in EXACT or role.startswith(PREFIXES)


def of_person(roles: Iterable[str]) -> bool:
    """Whether channels of these roles are those of a person at a display: e, with x or f_t."""
    there = set(roles)
    return "e" in there and bool(there & {"x", "f_t"})


def role_of(name: Any, roles: Mapping[Any, Any] | None = None) -> Any:
    """Role of a column, from ``roles`` or its name; "" for none.

    A ColumnTransformer calls it ``scaler__e``.
    """
    if name in (roles or {}):
        return roles[name]  # type: ignore[index]
    names = [name, name.rpartition("__")[2]] if isinstance(name, str) else []
    return next(filter(is_role, names), OTHER)


def roles_of(names: Sequence[Any], roles: Mapping[Any, Any] | None = None) -> dict[Any, str]:
    """Role of each column, from ``roles`` or its name, checked; "" for none."""
    found = {name: role_of(name, roles) for name in names}
    for name, role in found.items():
        if role != OTHER and not (isinstance(role, str) and is_role(role)):
            raise ValueError(
                f"roles gives {name!r} the role {role!r}; the roles are 'e', 'x', 'f_t', names "
                "that begin with 'dist' or 'motion', and '' for none."
            )
    return found


def check_named(names: Sequence[Any], roles: Any, *others: Any) -> None:
    """Refuse ``roles`` of columns that are not there; ``others`` are names besides columns."""
    if roles is not None and not isinstance(roles, Mapping):
        raise TypeError(f"roles must be a dict {{column: role}}; got {roles!r}.")
    known = [*names, *others]
    unknown = [column for column in roles or {} if column not in known]
    if unknown:
        raise RunIndexError(
            f"roles names {unknown[0]!r}, which is not a column of X; the columns are "
            f"{list(names)}."
        )


def columns_of_role(names: Sequence[Any], role: Any, roles: Any = None) -> list[int]:
    """Positions of the columns of a role."""
    return [i for i, name in enumerate(names) if role_of(name, roles) == role]


def column_of_role(names: Sequence[Any], role: str, roles: Any = None) -> int | None:
    """Position of the only column of a role; None where there is none."""
    found = columns_of_role(names, role, roles)
    if len(found) > 1:
        raise UsageError(
            f"{len(found)} columns of X have the role {role!r}: {[names[i] for i in found]}. Keep "
            "it for one, and give each other column another role, or none.",
            hint="Write roles={column: ''}.",
            options=["role"],
        )
    return found[0] if found else None


def columns_by_role(names: Sequence[Any], roles: Any = None) -> dict[str, int]:
    """Position of the column of each role there is, checked."""
    found = {}
    for role in roles_of(names, roles).values():
        position = None if role == OTHER else column_of_role(names, role, roles)
        if position is not None:
            found[role] = position
    return found


def _hint_at_prefix(column: Any, names: Sequence[Any]) -> str:
    """How a column keeps its name in a ColumnTransformer, where one has put its step before it."""
    found = any(str(name).endswith(f"__{column}") for name in names)
    return " ColumnTransformer(verbose_feature_names_out=False) keeps names." if found else ""


def input_columns(
    columns: list[Any] | None,
    n_columns: int,
    inputs: Any,
    run: Any,
    roles: Any = None,
    what: str = "inputs",
) -> list[int]:
    """Positions of the linear inputs: ``inputs``, else the column of role ``e``, else all."""
    names: list[Any] = list(range(n_columns)) if columns is None else list(columns)
    check_named(names, roles)
    run_position = None if run is None else run_column(names, run)
    if inputs is None:
        errors = [i for i in columns_of_role(names, "e", roles) if i != run_position]
        chosen = errors or [i for i in range(n_columns) if i != run_position]
        if not chosen:
            raise ValueError(f"X has no channel, only the run column {run!r}.")
        labels = not_channels(names[i] for i in chosen)
        if labels:
            raise RunIndexError(
                f"X has no column 'e', so that all its columns are {what}, including "
                f"{labels[0]!r}, which does not look like a signal. Name the ones to use: "
                f"{what}=[...]."
            )
        return chosen
    wanted = list(inputs) if np.iterable(inputs) and not isinstance(inputs, str) else [inputs]
    if not wanted:
        raise ValueError(f"{what} is empty; give at least one column, or None for the default.")
    positions = []
    for column in wanted:
        position = _position(names, column)
        if position is None:
            raise ValueError(
                f"{what} names {column!r}, which is not a column of X; the columns are {names}."
                + _hint_at_prefix(column, names)
            )
        positions.append(position)
    if len(set(positions)) < len(positions):
        raise ValueError(f"{what} names a column twice: {wanted}.")
    if run_position in positions:
        raise ValueError(f"{what} names {names[run_position]!r}, which is the run column (run=).")
    return positions


def run_column(names: list[Any], run: Any) -> int:
    """Position of the run column."""
    position = _position(names, run)
    if position is None:
        raise RunIndexError(
            f"run={run!r} names the column with the run labels (or, for an array, its position), "
            f"but X has the columns {names}."
        )
    return position


def _position(names: list[Any], column: Any) -> int | None:
    """Position of a column given by its name, or by its position where all names are text."""
    try:
        hash(column)
    except TypeError:
        return None
    # By hash: some objects cannot be asked whether they are equal.
    positions = {name: i for i, name in reversed(list(enumerate(names)))}
    if column in positions:
        return positions[column]
    whole = isinstance(column, (int, np.integer)) and not isinstance(column, bool)
    named = all(isinstance(name, str) for name in names) or names == list(range(len(names)))
    if whole and named and -len(names) <= column < len(names):
        return int(column) % len(names)
    return None


def is_external(role: str) -> bool:
    """Whether signals of this role come from outside the loop."""
    return role == "f_t" or role.startswith("dist")


def target_is_sum(roles: Collection[str]) -> bool:
    """Whether the target follows from the channels of these roles, and is not one of them."""
    return "f_t" not in roles and "e" in roles and "x" in roles


def with_target(signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Signals by role, with the target f_t = e + x where it was not recorded."""
    if not target_is_sum(signals):
        return signals
    return {**signals, "f_t": signals["e"] + signals["x"]}


def with_error(signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Signals by role, with the error e = f_t - x where it was not recorded."""
    if "e" in signals or not {"f_t", "x"} <= signals.keys():
        return signals
    return {**signals, "e": signals["f_t"] - signals["x"]}


def plain_name(name: Any) -> str:
    """A name in lower case and without its unit: ``Time [s]`` is ``time``."""
    return _UNIT.sub("", name).strip().casefold() if isinstance(name, str) else ""


def not_channels(names: Iterable[Any]) -> list[Any]:
    """Those of the names that are labels or clocks of rows, never signals."""
    return [name for name in names if plain_name(name) in (*LABELS, *OUTER, TIME)]


def put_in_words(name: Any) -> list[str]:
    """Words of a name in lower case, without figures and plurals."""
    if not isinstance(name, str):
        return []
    return [singular(word.casefold()) for word in _WORD.findall(name)]


def label_word(name: Any) -> str:
    """The word for what a column labels, if its name has no other; ``Trial No.`` is a trial."""
    words = [word for word in put_in_words(name) if word not in _NUMBERING]
    return words[0] if len(words) == 1 and words[0] in {*LABEL_WORDS, *OUTER_WORDS} else ""


def names_time(name: Any) -> bool:
    """Whether a column may be a clock by its name."""
    words = put_in_words(name)
    if len(words) == 1 and words[0] in _SECONDS:
        return True
    while len(words) > 1 and words[-1] in _UNITS:
        words.pop()
    return words == ["t"] or any(word in _TIME_WORDS for word in words)


def singular(word: str) -> str:
    """A word without the s of a plural."""
    return word[:-1] if len(word) > 2 and word.endswith("s") else word
