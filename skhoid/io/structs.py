"""What the variables of a MATLAB file hold: signals, matrices of channels, and runs.

A tree is of dicts (structs), lists (cells; :class:`Structs` are struct arrays), arrays and text.
One rule tells signals from runs: an element with one signal beside its clock is a signal, one with
several is a run.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from ..runs.tables import advances_evenly
from .files import FileTable, one_by_one, read_as

LEAST = 10  # samples of a signal
_IS_STRUCT = "is a struct: ask for one of its fields by a dotted path, such as {}."
_IS_STRUCTS = "is a struct array: save one plain variable per channel, one column per run."
_IS_CELL = "is a cell array: save one plain variable per channel, one column per run."
_IS_MATRIX = "is a matrix of {} channels: name one of them, such as {}."
_ARE_NAMES = "is text: the names of the channels of a matrix."
_OF_NAMES = ("name", "label", "labels", "title", "channel", "signal", "blockname", "path")


class Structs(list[Any]):
    """The elements of a struct array."""


@dataclass(frozen=True)
class Unreadable:
    """Something that is not numbers, and why."""

    why: str
    is_object: bool = False


@dataclass
class Columns:
    """Signals by name, what other names hold, and the variable that numbers runs."""

    arrays: dict[str, Any] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    run_name: str | None = None
    faults: list[str] = field(default_factory=list)
    aliases: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Run:
    where: str
    label: Any
    columns: Columns


@dataclass(frozen=True)
class _Runs:
    prefix: str  # of the names of their signals
    runs: list[_Run]
    parts: list[str]  # names of the variables that hold them


def find_columns(tree: Mapping[str, Any]) -> Columns:
    """The signals of a file; runs that lie in its structs or cells are joined."""
    shapes = Counter(v.shape for v in _each_array(tree) if v.ndim == 2 and min(v.shape) > 1)
    found = Columns()
    runs = _find_runs("", tree, shapes)
    _spread("", tree, found, shapes, skipped=() if runs is None else runs.parts)
    if runs is not None:
        _join(runs, found)
    last = [name.rpartition(".")[2] for name in found.arrays]
    once = {own: name for own, name in zip(last, found.arrays, strict=True) if last.count(own) == 1}
    found.aliases |= {
        own: name for own, name in once.items() if found.aliases.get(name) is not None
    }
    return found


def _each_array(node: Any) -> Iterator[np.ndarray]:
    if isinstance(node, np.ndarray):
        yield node
    elif isinstance(node, dict | list):
        for below in node.values() if isinstance(node, dict) else node:
            yield from _each_array(below)


def _is_signal(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size > 1


def _is_clock(values: np.ndarray) -> bool:
    return _length(values) >= 3 and advances_evenly(values.ravel())


def _length(values: np.ndarray) -> int:
    """Samples of a vector; 0 of a matrix."""
    return values.size if max(values.shape) == values.size else 0


def _named(prefix: str, key: str) -> str:
    between = "." if prefix and key and not key.startswith("(") else ""
    return f"{prefix}{between}{key}"


def _spread(
    name: str, node: Any, found: Columns, shapes: Counter[Any], skipped: Iterable[str] = ()
) -> None:
    """Add the signals below a node, under dotted names."""
    if name and name in skipped:
        return
    if isinstance(node, Unreadable):
        found.unreadable[name] = node.why
    elif isinstance(node, str):
        found.arrays[name] = np.array([node])
    elif sparse.issparse(node):
        found.arrays[name] = node
    elif isinstance(node, np.ndarray):
        if node.size:
            found.arrays[name] = node.ravel() if node.ndim > 2 and _length(node) else node
        else:
            found.unreadable[name] = "is empty: it has no samples."
    elif isinstance(node, list):
        _spread_list(name, node, found, shapes)
    elif isinstance(node, dict):
        _spread_struct(name, node, found, shapes, skipped)


def _spread_list(name: str, items: list[Any], found: Columns, shapes: Counter[Any]) -> None:
    signals = _named_signals(items)
    if signals:
        for label, values in signals.items():
            _spread(_named(name, label), values, found, shapes)
            found.aliases[_named(name, label)] = _named(name, label)
    elif items and all(isinstance(item, str) for item in items):
        found.arrays[name] = np.array(items)
    else:
        rows = isinstance(items, Structs) and len(items) >= LEAST
        if rows and all(np.size(v) == 1 for item in items for v in item.values()):
            for key in items[0]:  # each element is a sample
                values = np.array([np.ravel(item[key])[0] for item in items])
                _spread(f"{name}.{key}", values, found, shapes)
            return
        found.unreadable[name] = _IS_STRUCTS if isinstance(items, Structs) else _IS_CELL
        for key in items[0] if isinstance(items, Structs) and items else ():
            found.unreadable[f"{name}.{key}"] = _IS_STRUCTS


def _spread_struct(
    name: str, node: dict[str, Any], found: Columns, shapes: Counter[Any], skipped: Iterable[str]
) -> None:
    if name:
        found.unreadable[name] = _IS_STRUCT.format(f"{name}.{next(iter(node), 'field')}")
    recorded = _recorded(node)
    fields = {k: _side_by_side(v) for k, v in (node if recorded is None else recorded).items()}
    channels = {key: _labels_of(key, value, node, shapes) for key, value in fields.items()}
    counts = {len(labels) for labels in channels.values() if labels}
    for key, value in fields.items():
        own, labels = _named(name, key), channels[key]
        if labels is None or own in skipped:
            if len(_as_names(value)) in counts:
                found.unreadable[own] = _ARE_NAMES
            else:
                _spread(own, value, found, shapes, skipped)
            continue
        by_column = value if value.shape[1] == len(labels) else value.T
        if own:
            found.unreadable[own] = _IS_MATRIX.format(len(labels), own + labels[0])
        for number, (label, values) in enumerate(zip(labels, by_column.T, strict=True), 1):
            column = (own + label).lstrip(".")
            found.arrays[column] = values
            found.aliases |= {f"{own}:{number}": column, column: column}
            found.aliases |= {f"{own}(:,{number})": column} if value is by_column else {}
            found.aliases |= {f"{own}({number},:)": column} if value is not by_column else {}


def _side_by_side(value: Any) -> Any:
    """Vectors of one length in a cell as a matrix; anything else as it is."""
    vectors = isinstance(value, list) and all(_is_signal(v) and _length(v) for v in value)
    if vectors and len(value) > 1 and len({v.size for v in value}) == 1:
        return np.column_stack([v.ravel() for v in value])
    return value


def _recorded(node: dict[str, Any]) -> dict[str, Any] | None:
    """Signals and clock of what Simulink ("structure with time") and dSPACE write."""
    if {"time", "signals"} <= node.keys():
        clock, held = node["time"], node["signals"]
        items = held if isinstance(held, list) else [held]
        if not all(isinstance(item, dict) and "values" in item for item in items):
            return None
        labels = _names_of(items) or [f"signals({k})" for k in range(1, len(items) + 1)]
        if len(items) == 1:
            label = items[0].get("label")
            labels = [label if isinstance(label, str) else ""]
        values = [item["values"] for item in items]
    elif {"X", "Y"} <= node.keys():
        first = node["X"][0] if isinstance(node["X"], list) and node["X"] else node["X"]
        clock = first.get("Data") if isinstance(first, dict) else None
        items = node["Y"] if isinstance(node["Y"], list) else [node["Y"]]
        if not all(isinstance(item, dict) and "Data" in item for item in items):
            return None
        labels = _names_of(items) or [f"Y({k})" for k in range(1, len(items) + 1)]
        values = [item["Data"] for item in items]
    else:
        return None
    signals = dict(zip(labels, values, strict=True))
    return {"time": clock} | signals if _is_signal(clock) else signals


def _names_of(items: list[dict[str, Any]]) -> list[str] | None:
    """The texts by which elements are told apart, from the field that is most like a name."""
    first = items[0] if items else {}
    keys = [k for k in first if all(isinstance(e.get(k), str) and e[k] for e in items)]
    keys = [k for k in keys if len({e[k] for e in items}) == len(items)]
    keys.sort(key=lambda k: _OF_NAMES.index(k.casefold()) if k.casefold() in _OF_NAMES else 99)
    return [e[keys[0]].strip() for e in items] if keys else None


def _named_signals(items: list[Any]) -> dict[str, Any] | None:
    """Elements that hold one signal each, and its name."""
    if not items or not all(isinstance(item, dict) for item in items):
        return None
    names = _names_of(items)
    if names is None:
        return None
    signals: dict[str, Any] = {}
    clocks: dict[str, Any] = {}
    for name, item in zip(names, items, strict=True):
        held = {key: value for key, value in item.items() if _is_signal(value)}
        if len(held) < sum(map(_is_signal, _each_array(item))):
            return None  # there are others in structs of its own
        moving = {k: v for k, v in held.items() if not _is_clock(v)} if len(held) > 1 else held
        if len(moving) != 1 or not _length(next(iter(moving.values()))) >= LEAST:
            return None
        signals[name] = next(iter(moving.values()))
        clocks |= zip([name], (v for k, v in held.items() if k not in moving), strict=False)
    times = list(clocks.values())
    if times and all(np.array_equal(times[0].ravel(), t.ravel()) for t in times):
        return {"time": times[0]} | signals
    return signals | {f"{name}.time": time for name, time in clocks.items()}


def _labels_of(
    key: str, value: Any, beside: Mapping[str, Any], shapes: Counter[Any]
) -> list[str] | None:
    """What follows the name of a matrix in those of its channels; None if it is none of channels.

    It is one where no other matrix of the file has its shape, or one of its columns is a clock;
    else its columns are runs. A list beside it may name them.
    """
    if not _is_signal(value) or value.ndim != 2 or min(value.shape) < 2:
        return None
    count = min(value.shape)
    if max(value.shape) < max(LEAST, 2 * count):
        return None
    by_column = value if value.shape[1] == count else value.T
    if shapes[value.shape] > 1 and sum(map(_is_clock, by_column.T)) != 1:
        return None
    lists = {k: _as_names(v) for k, v in beside.items()}
    lists = {k: names for k, names in lists.items() if len(set(names)) == count == len(names)}
    near = [k for k in lists if k[:3].casefold() == key[:3].casefold()]  # InputName, InputData
    if lists:
        return [f".{text}" for text in lists[(near or list(lists))[0]]]
    form = "(:,{})" if value.shape[1] == count else "({},:)"
    return [form.format(number) for number in range(1, count + 1)]


def _as_names(value: Any) -> list[str]:
    """Names in a cell of text, in elements of a struct array, or in one text with separators."""
    if isinstance(value, str):
        value = re.split(r"\s*[,;\t]\s*", value.strip())
    elif isinstance(value, list) and value and isinstance(value[0], list):
        value = value[0]
    elif isinstance(value, Structs) and value and not any(map(_is_signal, _each_array(value))):
        value = _names_of(value)
    texts = isinstance(value, list) and all(isinstance(v, str) and v.strip() for v in value)
    return [text.strip() for text in value] if texts else []


def _find_runs(
    prefix: str, node: Mapping[str, Any], shapes: Counter[Any], least: int = 2
) -> _Runs | None:
    """Runs in a struct: in its elements, in fields that are built alike, or in one field."""
    for parts in _collections(prefix, node, shapes):
        if len(parts) < least:
            continue
        runs: list[_Run] = []
        for where, label, element, _ in parts:
            holds = any(map(_is_signal, element.values()))
            inner = _find_runs(where, element, shapes, least=2 if holds else 1)
            if inner is not None:
                runs += [_Run(r.where, f"{label} {r.label}", r.columns) for r in inner.runs]
                continue
            columns = Columns()
            _spread("", element, columns, shapes)
            if not _is_run(columns, node):
                break
            runs.append(_Run(where, label, columns))
        else:
            names = list(dict.fromkeys(name for *_, held in parts for name in held))
            own = names[0] if len(names) == 1 and isinstance(parts[0][1], int) else prefix
            return _Runs(own, runs, names)
    below = [
        found
        for key, value in node.items()
        if isinstance(value, dict)
        and _recorded(value) is None
        and (found := _find_runs(_named(prefix, key), value, shapes))
    ]
    return below[0] if len(below) == 1 else None


_Part = tuple[str, Any, dict[str, Any], list[str]]  # where, label, struct, variables that hold it
_STEM = re.compile(r"\d+")


def _collections(
    prefix: str, node: Mapping[str, Any], shapes: Counter[Any]
) -> Iterator[list[_Part]]:
    """What may be runs: elements of an array, fields of one build, and cells side by side."""
    alike: dict[Any, list[_Part]] = {}
    cells: dict[int, dict[str, list[Any]]] = {}
    for key, value in node.items():
        own = _named(prefix, key)
        if isinstance(value, list) and value and _named_signals(value) is None:
            sign = "({})" if isinstance(value, Structs) else "{{{}}}"
            wheres = [own + sign.format(k) for k in range(1, len(value) + 1)]
            several = len(value) > 1 or not isinstance(value, Structs)
            if several and all(isinstance(item, dict) for item in value):
                yield [
                    (where, k, _with_names(element, node), [own])
                    for k, (where, element) in enumerate(zip(wheres, value, strict=True), 1)
                ]
            elif all(_is_signal(item) for item in value):
                if all(item.ndim == 2 and min(item.shape) > 1 for item in value):
                    yield [
                        (where, k, _with_names({"": matrix}, node), [own])
                        for k, (where, matrix) in enumerate(zip(wheres, value, strict=True), 1)
                    ]
                cells.setdefault(len(value), {})[key] = value
        elif isinstance(value, dict) and _recorded(value) is None:
            stem = _STEM.sub("", key)
            if not any(map(_is_signal, value.values())):
                build: tuple[Any, ...] = ("structs",)
            elif stem != key:
                build = ("struct", stem)
            else:
                build = ("struct", *sorted(value))
            alike.setdefault(build, []).append((own, key, _with_names(value, node), [own]))
        elif _labels_of(key, value, node, shapes) is not None:
            stem = _STEM.sub("", key)
            build = ("matrix", stem, min(value.shape))
            alike.setdefault(build, []).append((own, key, _with_names({"": value}, node), [own]))
    yield from ([*parts] for parts in alike.values() if _are_alike(parts))
    yield from _numbered(prefix, node)
    for count, held in cells.items():
        if len(held) > 1:
            names = [_named(prefix, key) for key in held]
            yield [
                (prefix, k + 1, {key: items[k] for key, items in held.items()}, names)
                for k in range(count)
            ]


def _with_names(element: dict[str, Any], beside: Mapping[str, Any]) -> dict[str, Any]:
    """An element with the lists beside its array that may name the columns of its matrices."""
    counts = {min(v.shape) for v in element.values() if _is_signal(v) and v.ndim == 2} - {1}
    lists = {k: v for k, v in beside.items() if len(_as_names(v)) in counts}
    return {**lists, **element}


def _numbered(prefix: str, node: Mapping[str, Any]) -> Iterator[list[_Part]]:
    """Vectors t1, e1, u1, t2, e2, u2: each number is a run, and has a clock."""
    by_number: dict[str, dict[str, Any]] = {}
    for key, value in node.items():
        found = re.fullmatch(r"(.*?)(\d+)", key)
        if found and _is_signal(value):
            by_number.setdefault(found[2], {})[found[1].rstrip("_")] = value
    kinds = {tuple(sorted(held)) for held in by_number.values()}
    clocks = all(any(map(_is_clock, held.values())) for held in by_number.values())
    if len(by_number) > 1 and len(kinds) == 1 and clocks:
        yield [
            (f"run {k}", int(k), held, [_named(prefix, key) for key in node if key.endswith(k)])
            for k, held in by_number.items()
        ]


def _are_alike(parts: list[_Part]) -> bool:
    """Whether fields are runs by their names, which differ in a number, or as all have a clock."""
    if len({_STEM.sub("", key) for _, key, *_ in parts}) == 1:
        return True
    return all(
        any(isinstance(v, dict) or (_is_signal(v) and _is_clock(v)) for v in element.values())
        for _, _, element, _ in parts
    )


def _is_run(columns: Columns, beside: Mapping[str, Any]) -> bool:
    """Whether signals of a struct are a run: several vectors, and not one with its clock."""
    arrays = [v for v in columns.arrays.values() if _is_signal(v)]
    vectors = [v for v in arrays if _length(v)]
    moving = [v for v in vectors if not _is_clock(v)]
    return len(vectors) == len(arrays) and len(moving) > 1 and bool(beside)


def _join(runs: _Runs, found: Columns) -> None:
    """One vector of each signal for all runs, and one that tells the runs apart."""
    parts = [run.columns.arrays for run in runs.runs]
    lengths = []
    for own in parts:
        sizes = [v.size for v in own.values() if v.size > 1]
        lengths.append(max(set(sizes), key=sizes.count))
    for key in dict.fromkeys(key for own in parts for key in own):
        name = _named(runs.prefix, key)
        if not all(key in own for own in parts):
            found.unreadable[name] = "is not in every run of its struct array."
            continue
        values = [own[key].ravel() for own in parts]
        if all(v.size == 1 and v[0] == values[0][0] and v.dtype.kind in "biuf" for v in values):
            found.arrays[name] = values[0]  # a number of all runs, such as the sampling time
            continue
        for k, (run, length) in enumerate(zip(runs.runs, lengths, strict=True)):
            if values[k].size not in (1, length):
                found.faults.append(
                    f'"{run.where}.{key}" has {values[k].size} samples, the other fields of '
                    f"{run.where} {length}: all need one value per sample."
                )
            values[k] = np.resize(values[k], length)
        found.arrays[name] = np.concatenate(values)
    name = runs.prefix if runs.prefix not in ("", *found.arrays) else _named(runs.prefix, "run")
    labels = [run.label for run in runs.runs]
    found.arrays[name] = np.repeat(np.array(labels), lengths)
    found.unreadable.pop(name, None)
    found.run_name = name


_STEP = re.compile(r"\.?([A-Za-z]\w*)|\((:|\d+),(:|\d+)\)|[({](\d+)[)}]|:(\d+)$")


def value_at(tree: Mapping[str, Any], asked: str) -> np.ndarray | None:
    """A signal by what one types in MATLAB, ``rec.Y(3).Data`` or ``CMD(:,4)``, or ``CMD:4``."""
    node: Any = tree
    position = 0
    while position < len(asked):
        step = _STEP.match(asked, position)
        if step is None:
            return None
        key, row, column, number, short = step.groups()
        try:
            if key is not None:
                node = node[key]
            elif number is not None:
                node = node[int(number) - 1]
            elif short is not None:
                by_column = node if node.shape[0] >= node.shape[1] else node.T
                node = by_column[:, int(short) - 1]
            else:
                at = [slice(None) if p == ":" else int(p) - 1 for p in (row, column)]
                node = node[tuple(at)]
        except (KeyError, IndexError, TypeError, AttributeError):
            return None
        position = step.end()
    return node if _is_signal(node) and _length(node) else None


def as_table(path: Path, kind: str, tree: Mapping[str, Any], found: Columns) -> FileTable:
    """The signals of a file as a table, in which others are found by what one types in MATLAB."""
    names = list(found.arrays)

    def load(position: int) -> np.ndarray:
        values = found.arrays[names[position]]
        if not sparse.issparse(values):
            return values
        with read_as(path, f"{kind}, at its variable {names[position]!r}"):
            return values.toarray()

    def resolve(asked: str) -> bool:
        values = value_at(tree, asked)
        if values is not None:
            found.arrays[asked] = values
            names.append(asked)
        return values is not None

    return FileTable(
        path,
        names,
        one_by_one(load),
        unreadable=found.unreadable,
        kind="variable",
        run_name=found.run_name,
        faults=found.faults,
        aliases=found.aliases,
        resolve=resolve,
    )
