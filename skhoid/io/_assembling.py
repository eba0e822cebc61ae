"""Runs of files as X and y."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import UsageError
from ..runs import RUN, TIME, run_index
from ._runs import FileRuns
from ._table import FileTable
from ._wanted import Channel

__all__ = ["assemble", "gather_units"]


def gather_units(
    table: FileTable,
    channels: list[Channel],
    given: dict[str, str],
    known: dict[str, tuple[str, Path]],
) -> None:
    """Add the units of a file to those that are known; files that differ are refused."""
    for channel in channels:
        unit = given.get(channel.name) or table.unit_of(table.find(channel.asked))
        if not unit:
            continue
        other, path = known.setdefault(channel.name, (unit, table.path))
        if other != unit:
            raise UsageError(
                f"The unit of channel {channel.name!r} is {other!r} in {path} and {unit!r} in "
                f"{table.path}: convert one file, or state the unit.",
                hint="State it in units=.",
                options=["unit"],
            )


def assemble(
    pieces: list[FileRuns],
    names: list[str],
    known: dict[str, tuple[str, Path]],
    levels: list[str] | None = None,
    *,
    every_level: bool = False,
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y; of ``levels`` outside the run, those of one label are left out unless told."""
    for piece in pieces:
        _check_instants(piece)
    labels = [label for piece in pieces for label in piece.labels]
    lengths = np.concatenate([piece.lengths for piece in pieces])
    index = _index(labels, lengths, _joined([piece.time for piece in pieces]), levels, every_level)
    # Each channel leaves the pieces as it is taken, so that all rows are in memory only once.
    output = _joined([piece.channels.pop() for piece in pieces])
    if len(names) == 2:
        values = _joined([piece.channels.pop() for piece in pieces])[None]
        values = values.copy() if np.may_share_memory(values, output) else values
    else:
        values = np.empty((len(names) - 1, len(index)))
        for k in reversed(range(len(values))):
            values[k] = _joined([piece.channels.pop() for piece in pieces])
    X = pd.DataFrame(np.require(values, requirements="W").T, index, names[:-1], copy=False)
    y = pd.Series(np.require(output, requirements="W"), index, name=names[-1], copy=False)
    units = {name: unit for name, (unit, _) in known.items()}
    X.attrs["units"] = {name: units[name] for name in names[:-1] if name in units}
    y.attrs["units"] = {name: units[name] for name in names[-1:] if name in units}
    return X, y


def _index(
    labels: list[Any],
    lengths: np.ndarray,
    time: np.ndarray,
    levels: list[str] | None,
    every_level: bool,
) -> pd.MultiIndex:
    """The row index, with those of the outer levels that have more than one label, or all."""
    if not levels:
        return run_index(labels, lengths, time)
    inner = run_index(list(range(len(labels))), lengths, time)
    columns = zip(*labels, strict=True)
    # In the order of the rows, which is then a sorted one to pandas.
    parts = [pd.Categorical(c, list(dict.fromkeys(c)) if every_level else None) for c in columns]
    names = [*levels, RUN]
    kept = [
        k
        for k, part in enumerate(parts)
        if every_level or len(part.categories) > 1 or k == len(levels)
    ]
    return pd.MultiIndex(
        levels=[*(parts[k].categories for k in kept), inner.levels[1]],
        codes=[*(np.repeat(parts[k].codes, lengths) for k in kept), inner.codes[1]],
        names=[*(names[k] for k in kept), TIME],
        verify_integrity=False,
    )


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _check_instants(piece: FileRuns) -> None:
    missing = np.flatnonzero(np.isnan(piece.time))
    if missing.size:
        stops = np.cumsum(piece.lengths)
        k = int(np.searchsorted(stops, missing[0], side="right"))
        row = int(missing[0] - stops[k] + piece.lengths[k])
        raise ValueError(
            f"The time of run {piece.labels[k]!r} in {piece.path} is missing in its row "
            f"{row + 1}: every sample needs a time. If the whole row is empty, delete it: lags "
            "restart after a gap."
        )
