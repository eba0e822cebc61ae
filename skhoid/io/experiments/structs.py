"""Structs of people in MATLAB files: one field, or one element of a struct array, per person."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._header_words import label_of, roles_by_name
from .._mat import content_of, is_hdf5
from .._table import FileTable, one_by_one
from .levels import LEVELS, labelled

__all__ = ["groups_of"]

_LEAST = 10  # samples of a signal
Place = tuple[str, ...]


def groups_of(
    table: FileTable, wanted: Sequence[str] | None, known: Collection[str]
) -> list[tuple[dict[str, str], FileTable]] | None:
    """One table for each struct that holds channels, with its labels; None where there is one.

    ``wanted`` are the channels that were named, if they were.
    """
    if table.path.suffix.lower() != ".mat":
        return None
    tree = _tree(table)
    holding = [place for place, leaves in tree.items() if _holds(leaves, wanted)]
    if len(holding) < 2 or () in holding:
        return None
    if len({len(place) for place in holding}) > 1:
        names = " and ".join(repr(_shown(p)) for p in sorted(holding, key=len)[:: len(holding) - 1])
        raise ValueError(
            f"In {table.path} structs at different depths hold channels, such as {names}: bring "
            "them to one depth, as data.S1.C1 and data.S2.C1."
        )
    if all(_is_run(leaves) for place, leaves in tree.items() if place in holding) and all(
        place[-1].startswith("(") for place in holding
    ):
        return None  # a struct array of vectors: each element is a run, of read_runs
    shared = next((k for k in range(len(holding[0])) if len({p[k] for p in holding}) > 1), 0)
    parts = [place[shared:] for place in holding]
    levels = _levels(table.path, parts, known)
    found = []
    for place, part in zip(holding, parts, strict=True):
        leaves: dict[str, Any] = {}
        for depth in range(len(place) + 1):
            leaves |= tree.get(place[:depth], {})
        labels = {
            level: labelled(text.strip("()"))[2] for level, text in zip(levels, part, strict=True)
        }
        labels |= _own_labels(tree[place])
        found.append((labels, _table_of(table, leaves, _shown(place))))
    return found


def _tree(table: FileTable) -> dict[Place, dict[str, Any]]:
    """Arrays, or what loads them, by the struct that holds them and their own name."""
    tree: dict[Place, dict[str, Any]] = {}
    if is_hdf5(table.path):
        for position, name in enumerate(table.names):
            *place, leaf = name.split(".")
            tree.setdefault(tuple(place), {})[leaf] = table.load([position], None)[0][0]
        return tree
    for name, value in content_of(table.path).items():
        if not name.startswith("__"):
            _walk((), name, value, tree)
    return tree


def _walk(place: Place, name: str, value: Any, tree: dict[Place, dict[str, Any]]) -> None:
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names:
        several = value.size > 1
        for number, element in enumerate(value.flat, 1):
            below = (*place, name, f"({number})") if several else (*place, name)
            for key in value.dtype.names:
                _walk(below, key, element[key], tree)
    elif value.dtype.kind in "biufU":
        tree.setdefault(place, {})[name] = value


def _holds(leaves: Mapping[str, Any], wanted: Sequence[str] | None) -> bool:
    if wanted is not None:
        return any(name in leaves for name in wanted)
    signals = [n for n, v in leaves.items() if v.dtype.kind in "biuf" and v.size >= _LEAST]
    roles = {role for name in signals for role in roles_by_name(name)}
    return "u" in roles or bool(roles & {"e", "f_t"})


def _is_run(leaves: Mapping[str, Any]) -> bool:
    """Whether all arrays are vectors."""
    return all(max(value.shape, default=1) == value.size for value in leaves.values())


def _levels(path: Path, parts: list[Place], known: Collection[str]) -> list[str]:
    """What the structs are, from the outermost inwards: by their names, or in the usual order."""
    depth = len(parts[0])
    said: list[str] = []
    for k in range(depth):
        found = {labelled(part[k].strip("()"))[0] for part in parts}
        said.append(found.pop() if len(found) == 1 else "")
    free = [level for level in LEVELS if level not in known and level not in said]
    levels = [level or (free.pop(0) if free else "") for level in said]
    if "" in levels or len(set(levels)) < depth or set(levels) & set(known):
        names = ", ".join(repr(".".join(part)) for part in parts[:3])
        raise ValueError(
            f"The structs of {path}, {names}, do not say what is the subject, the condition and "
            "the run: name their fields like S1.C1.run1."
        )
    return levels


def _own_labels(leaves: Mapping[str, Any]) -> dict[str, str]:
    """Labels that a struct holds as text, such as its field ``subject``."""
    found = {}
    for name, value in leaves.items():
        level = label_of(name)
        if level in LEVELS and value.dtype.kind == "U" and value.size == 1:
            found[level] = str(value.item()).strip()
    return found


def _table_of(table: FileTable, leaves: Mapping[str, Any], where: str) -> FileTable:
    names = [name for name, value in leaves.items() if value.dtype.kind != "U"]
    return FileTable(
        table.path,
        names,
        one_by_one(lambda position: leaves[names[position]]),
        kind="variable",
        note=f"This is of its struct {where!r}.",
    )


def _shown(place: Place) -> str:
    return ".".join(place).replace(".(", "(")
