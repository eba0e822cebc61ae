"""Files, or what they hold of one person, as runs with their labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._assembling import gather_units
from .._runs import FileRuns, runs_of
from .._table import FileTable
from .arrays import Dims, runs_of_arrays
from .columns import Columns
from .levels import FIELDS, LEVELS

__all__ = ["Part", "parts_of"]


@dataclass(frozen=True)
class Part:
    """One run, and its labels by level."""

    labels: dict[str, Any]
    runs: FileRuns


def parts_of(
    groups: Sequence[tuple[dict[str, str], FileTable]],
    from_file: dict[str, str],
    columns: Columns,
    dims: Dims | None,
) -> tuple[list[Part], Dims | None]:
    """The runs of one file, and what the dimensions of its arrays are, if it has any."""
    found: list[Part] = []
    order = None
    for of_struct, whole in groups:
        channels = columns.of_file(whole)
        clock, unit = columns.clock_of(whole)
        gather_units(whole, channels, columns.units, columns.known)
        asked = [channel.asked for channel in channels]
        tables: list[tuple[dict[str, str], FileTable]] = [({}, whole)]
        if whole.kind == "variable":
            known = [level for level in LEVELS if level in from_file or level in of_struct]
            tables, of_arrays = runs_of_arrays(whole, asked, clock, dims, known)
            order = of_arrays or order
        for of_run, table in tables:
            given = {**from_file, **of_struct, **of_run}
            found += _of_table(table, asked, clock, unit, columns, given)
    if not found:
        raise ValueError(f"{groups[0][1].path} has no run with numbers.")
    return found, order


def _of_table(
    table: FileTable,
    asked: list[str],
    clock: str | float,
    unit: str | None,
    columns: Columns,
    given: dict[str, str],
) -> list[Part]:
    outer = {name: level for name, level in columns.outer.items() if level not in given}
    run = columns.run if "run" not in given else None
    run = table.run_name if run is None and "run" not in given else run
    cut = bool(outer) or "run" not in given  # runs may begin where time begins anew
    runs = runs_of(
        table,
        asked,
        clock=clock,
        time_unit=unit,
        run=run,
        levels=list(outer) if cut else None,
    )
    found = []
    for label, piece in _each(runs):
        inside = label if isinstance(label, tuple) else (label,)
        labels: dict[str, Any] = (
            dict(zip([*outer.values(), "run"], inside, strict=True))
            if (len(inside) == len(outer) + 1)
            else {"run": label}
        )
        if run is None:
            labels["run"] = "1" if len(runs.labels) == 1 or outer else str(labels["run"])
        labels |= given
        found.append(Part(_in_order(labels), replace(piece, labels=[label])))
    return found


def _each(runs: FileRuns) -> list[tuple[Any, FileRuns]]:
    """The runs of a file one by one."""
    stops = np.cumsum(runs.lengths)
    found = []
    for label, length, stop in zip(runs.labels, runs.lengths, stops.tolist(), strict=True):
        rows = slice(stop - int(length), stop)
        channels = [values[rows] for values in runs.channels]
        found.append(
            (
                label,
                FileRuns(runs.path, [label], np.array([length]), runs.time[rows], channels),
            )
        )
    return found


def _in_order(labels: dict[str, Any]) -> dict[str, Any]:
    return {level: labels[level] for level in FIELDS if level in labels}
