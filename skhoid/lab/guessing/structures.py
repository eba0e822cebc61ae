"""People and runs in the structs and arrays of one file, and in data sets of BIDS."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...io.files import FileTable, as_numbers, first_run, one_by_one, read_as, squeezed
from ...io.matlab import read_tree
from ...runs import TIME
from .names import LEVELS, labelled
from .words import find_label, roles_by_name

_NAMES = (TIME, *LEVELS)
_MANY = {TIME: "samples", "run": "runs", "condition": "conditions", "subject": "people"}


@dataclass(frozen=True)
class Dims:
    """What each dimension is, and labels of those for which some were given."""

    names: tuple[str, ...]
    labels: Mapping[str, Sequence[Any]]

    def __str__(self) -> str:
        said = ", ".join(f'"{name}"' for name in self.names)
        return f"arrays are {' x '.join(_MANY[n] for n in self.names)} (dims=({said}))"


def checked_dims(dims: Any) -> Dims | None:
    """The dimensions as a user gives them: names, or a dict of names and labels."""
    if dims is None:
        return None
    if isinstance(dims, str) or not isinstance(dims, Sequence | Mapping):
        raise TypeError(
            f'dims must be names of dimensions, such as ("time", "run", "subject"); got {dims!r}.'
        )
    names = tuple(dims)
    if not all(isinstance(name, str) for name in names):
        raise TypeError(f"dims must name dimensions by text; got {dims!r}.")
    if len(set(names)) < len(names) or TIME not in names or not set(names) <= set(_NAMES):
        raise ValueError(
            f'dims must name each dimension once, "time" and others of {", ".join(LEVELS)}; got '
            f"{names!r}."
        )
    given = dims if isinstance(dims, Mapping) else {}
    labels = {n: list(some) for n, some in given.items() if some is not None and n != TIME}
    for name, some in labels.items():
        if len(set(some)) < len(some):
            raise ValueError(f"The labels of dims[{name!r}] are not different: {some!r}.")
    return Dims(names, labels)


def guess_order(table: FileTable, shape: tuple[int, ...], known: Collection[str]) -> Dims:
    """What the dimensions are if nothing is said: samples, runs, then conditions and people."""
    rest = [level for level in ("run", "condition", "subject") if level not in known]
    count = len(shape) - 1
    if count == 2 and len(rest) == 3:
        rest = ["run", "subject"]
    if count > len(rest) or "run" in known:
        raise ValueError(
            f"The arrays of {table.path} have the shape {shape}, and "
            f"{' and '.join(known) or 'nothing'} is known from elsewhere: say what the dimensions "
            f'are, as dims=("time", "run", "subject").'
        )
    names = (TIME, *rest[:count])
    if shape[0] < max(shape):
        raise ValueError(
            f"The arrays of {table.path} have the shape {shape}: the first dimension is not the "
            f"longest, so it may not be the samples. If it is, say dims={names!r}; if not, name "
            "the dimensions in their order."
        )
    return Dims(names, {})


def runs_of_arrays(
    table: FileTable,
    asked: Sequence[str],
    clock: str | float,
    dims: Dims | None,
    known: Collection[str],
) -> tuple[list[tuple[dict[str, str], FileTable]], Dims | None]:
    """One table of vectors for each run, with its labels; vectors stay as they are.

    Rows at the end in which no channel has a number fill a run up to the length of the longest,
    and are left out; so are runs without any number.
    """
    names = [*asked, clock] if isinstance(clock, str) else list(asked)
    if table.faults:
        raise ValueError(f"In {table.path} {table.faults[0]}")
    positions = [table.find(name) for name in names]
    raw = table.load(positions, None)[0]
    arrays = {name: squeezed(np.asarray(values)) for name, values in zip(names, raw, strict=True)}
    shapes = {name: arrays[name].shape for name in asked}
    shape = max(shapes.values(), key=len)
    if len(shape) == 1:
        return [({}, table)], None
    if set(shapes.values()) != {shape}:
        raise ValueError(
            f"In {table.path} the {table.kind}s have different shapes, {shapes}: each must have "
            "the same dimensions."
        )
    if dims is None:
        dims = guess_order(table, shape, known)
    _check_fit(table, dims, shape, known)
    numbers = {
        name: as_numbers(arrays[name], table.where(name)).reshape(arrays[name].shape)
        for name in names
    }
    channels = np.stack([_arranged(numbers[name], dims) for name in asked])
    time = None if not isinstance(clock, str) else _clock(table, clock, numbers[clock], dims, shape)
    return list(_each_run(table, names, channels, time, dims)), dims


def _each_run(
    table: FileTable,
    names: list[str],
    channels: np.ndarray,
    time: np.ndarray | None,
    dims: Dims,
) -> Iterator[tuple[dict[str, str], FileTable]]:
    sizes = dict(zip(("subject", "condition", "run"), channels.shape[1:4], strict=True))
    labels = {
        level: [str(label) for label in dims.labels.get(level, range(1, size + 1))]
        for level, size in sizes.items()
    }
    units = {name: unit for name in names if (unit := table.unit_of(table.find(name))) is not None}
    for at in product(*map(range, channels.shape[1:4])):
        own = channels[:, at[0], at[1], at[2]]
        measured = np.flatnonzero(np.isfinite(own).any(axis=0))
        if not measured.size:
            continue
        stop = int(measured[-1]) + 1
        columns = [values[:stop] for values in own]
        if time is not None:
            columns.append(time[at][:stop])
        where = {
            level: labels[level][k]
            for level, k in zip(sizes, at, strict=True)
            if level in dims.names
        }
        yield (
            where,
            FileTable(table.path, names, one_by_one(columns.__getitem__), units, kind=table.kind),
        )


def first_slices(table: FileTable, dims: Dims | None) -> FileTable:
    """The table with the first run that has numbers as its first rows, for a guess."""
    if dims is None:
        return table
    axis = dims.names.index(TIME)

    def peek(count: int | None) -> list[Any]:
        arrays, _ = table.load(range(len(table.names)), None)
        return [first_run(values, axis)[:count] for values in arrays]

    return replace(table, first_rows=peek)


def _check_fit(
    table: FileTable, dims: Dims, shape: tuple[int, ...], known: Collection[str]
) -> None:
    if len(dims.names) < len(shape):
        raise ValueError(
            f"The arrays of {table.path} have {len(shape)} dimensions, {shape}, but dims names "
            f"{len(dims.names)}, {dims.names!r}."
        )
    both = [name for name in dims.names if name in known]
    if both:
        raise ValueError(
            f"The {both[0]} is a dimension of the arrays of {table.path} by dims, and a field of "
            "the names of files or structs too: leave it out of one."
        )
    for name, labels in dims.labels.items():
        place = dims.names.index(name)
        size = shape[place] if place < len(shape) else 1
        if len(labels) != size:
            raise ValueError(
                f"dims has {len(labels)} labels of the {name}, but the arrays of {table.path} "
                f"have {size} there: {shape}."
            )


def _arranged(values: np.ndarray, dims: Dims) -> np.ndarray:
    """As people x conditions x runs x samples."""
    values = values.reshape(values.shape + (1,) * (len(dims.names) - values.ndim))
    order = [n for n in ("subject", "condition", "run", TIME) if n in dims.names]
    values = values.transpose([dims.names.index(name) for name in order])
    for k, name in enumerate(("subject", "condition", "run")):
        if name not in dims.names:
            values = np.expand_dims(values, k)
    return values


def _clock(
    table: FileTable, clock: str, values: np.ndarray, dims: Dims, shape: tuple[int, ...]
) -> np.ndarray:
    """The time of each run: of one vector for all, or of an array like the channels'."""
    whole = _arranged(np.empty(shape, dtype=bool), dims).shape
    if values.ndim == 1 and values.size == whole[-1]:
        return np.broadcast_to(values, whole)
    if values.shape == shape:
        return _arranged(values, dims)
    raise ValueError(
        f"{table.where(clock)} has the shape {values.shape}, but the channels have {shape}: give "
        "one time vector for all runs, or an array like theirs."
    )


_LEAST = 10  # samples of a signal
Place = tuple[str, ...]


def split_groups(
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
        found.append((labels, _make_table(table, leaves, _shown(place))))
    return found


def _tree(table: FileTable) -> dict[Place, dict[str, Any]]:
    """Arrays by the struct that holds them and their own name."""
    tree: dict[Place, dict[str, Any]] = {}
    for name, value in read_tree(table.path).items():
        _walk((), name, value, tree)
    return tree


def _walk(place: Place, name: str, value: Any, tree: dict[Place, dict[str, Any]]) -> None:
    if isinstance(value, dict):
        for key, below in value.items():
            _walk((*place, name), key, below, tree)
    elif isinstance(value, list):
        for number, element in enumerate(value, 1):
            if isinstance(element, dict):
                _walk((*place, name), f"({number})", element, tree)
    elif isinstance(value, str):
        tree.setdefault(place, {})[name] = np.array([value])
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size:
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
        level = find_label(name)
        if level in LEVELS and value.dtype.kind == "U" and value.size == 1:
            found[level] = str(value.item()).strip()
    return found


def _make_table(table: FileTable, leaves: Mapping[str, Any], where: str) -> FileTable:
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


_SUFFIX = "_motion.tsv"
_LEVELS_UP = 4  # folders above the table, in which a file beside it may lie (inheritance)


def is_motion(path: Path) -> bool:
    """Whether a file is a motion table by its name, with its channels described beside it."""
    return path.name.endswith(_SUFFIX) and _beside(path, "_channels.tsv") is not None


def read_motion(path: Path) -> FileTable:
    """Read a motion table with the names, units and sampling frequency of its sidecar files."""
    described = _beside(path, "_channels.tsv")
    assert described is not None
    with read_as(described, "a table of channels"):
        channels = pd.read_csv(described, sep="\t", dtype=str, keep_default_na=False)
    for column in ("name", "units"):
        if column not in channels:
            raise ValueError(f"{described} has no column {column!r}, which BIDS asks for.")
    if not path.stat().st_size:
        raise ValueError(f"{path} is empty.")
    with read_as(path, "a motion table"):
        rows = pd.read_csv(path, sep="\t", header=None, na_values=["n/a"])
    names = channels["name"].tolist()
    if rows.shape[1] != len(names):
        raise ValueError(
            f"{path} has {rows.shape[1]} columns, but {described} describes {len(names)}."
        )
    units = dict(zip(names, channels["units"], strict=True))
    units = {name: unit for name, unit in units.items() if unit not in ("", "n/a")}
    columns: list[pd.Series] = [rows[k] for k in rows]
    kinds = channels["type"].str.upper().tolist() if "type" in channels else []
    if "LATENCY" in kinds:
        names[kinds.index("LATENCY")] = "time"
        units["time"] = "s"
    elif "time" not in names:
        rate = _rate(path)
        names = ["time", *names]
        columns = [pd.Series(np.arange(len(rows)) / rate), *columns]
        units["time"] = "s"
    return FileTable(
        path,
        names,
        one_by_one(lambda position: columns[position]),
        units=units,
    )


def _rate(path: Path) -> float:
    beside = _beside(path, "_motion.json")
    if beside is None:
        raise ValueError(
            f"There is no sampling frequency for {path}: it should be in "
            f"{path.with_suffix('.json').name}, as SamplingFrequency."
        )
    with read_as(beside, "JSON"):
        content = json.loads(beside.read_text(encoding="utf-8"))
    rate = content.get("SamplingFrequency") if isinstance(content, dict) else None
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not rate > 0:
        raise ValueError(f"{beside} should have a SamplingFrequency in Hz; it has {rate!r}.")
    return float(rate)


def _beside(path: Path, suffix: str) -> Path | None:
    """The nearest file with that suffix whose name has no parts that the table's does not have."""
    own = set(path.name.removesuffix(_SUFFIX).split("_"))
    for folder in list(path.absolute().parents)[:_LEVELS_UP]:
        found = [
            other
            for other in folder.glob(f"*{suffix[1:]}")
            if set(other.name.removesuffix(suffix[1:]).rstrip("_").split("_")) - {""} <= own
        ]
        if found:
            return max(found, key=lambda other: len(other.name.split("_")))
        if (folder / "dataset_description.json").exists():
            break
    return None
