"""Arrays of several dimensions, samples x runs x people, as one table for each run."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from ...runs import TIME
from .._table import FileTable, as_numbers, one_by_one
from .levels import LEVELS

__all__ = ["Dims", "checked_dims", "first_slices", "order_of", "runs_of_arrays"]

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


def order_of(table: FileTable, shape: tuple[int, ...], known: Collection[str]) -> Dims:
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
    arrays = {name: _squeezed(np.asarray(values)) for name, values in zip(names, raw, strict=True)}
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
        dims = order_of(table, shape, known)
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
    axis = 0 if dims is None else dims.names.index(TIME)

    def peek(count: int) -> list[Any]:
        found = []
        for position in range(len(table.names)):
            values = _squeezed(np.asarray(table.load([position], None)[0][0]))
            if values.ndim > 1:
                columns = np.moveaxis(values, min(axis, values.ndim - 1), 0)
                columns = columns.reshape(columns.shape[0], -1)
                there = np.flatnonzero(
                    np.isfinite(columns).any(axis=0)
                    if columns.dtype.kind == "f"
                    else np.ones(columns.shape[1])
                )
                values = columns[:, there[0] if there.size else 0]
            found.append(values[:count])
        return found

    return replace(table, peek=peek)


def _squeezed(values: np.ndarray) -> np.ndarray:
    """Without dimensions of one at the end, as MATLAB has them; a row or column is a vector."""
    while values.ndim > 1 and values.shape[-1] == 1:
        values = values[..., 0]
    if values.ndim == 2 and values.shape[0] == 1:
        values = values[0]
    return np.atleast_1d(values)


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
