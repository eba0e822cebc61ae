"""The runs of all files as X and y, each with its own labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from .._assembling import assemble
from .columns import Columns
from .levels import FIELDS, LEVELS, natural
from .parts import Part

__all__ = ["joined"]


def joined(
    parts: Sequence[Part], columns: Columns, *, keep_order: bool
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y; runs are in natural order of their labels unless told to keep theirs."""
    levels = [level for level in FIELDS if any(level in part.labels for part in parts)]
    for part in parts:
        lacking = [level for level in levels if level not in part.labels and level in LEVELS]
        if lacking:
            raise ValueError(
                f"{part.runs.path} gives no {lacking[0]}, which other files give: give the "
                f"pattern, or read such files alone."
            )
    if not keep_order:
        parts = sorted(parts, key=lambda part: [natural(part.labels.get(k, "")) for k in levels])
    # Sessions and blocks have no level of their own.
    more = [
        level
        for level in ("session", "block")
        if len({part.labels.get(level) for part in parts}) > 1
    ]
    outer = [level for level in levels if level in LEVELS[:2]]
    seen: dict[tuple[Any, ...], Part] = {}
    pieces = []
    for part in parts:
        run = part.labels["run"]
        if more:
            before = [str(part.labels[level]) for level in more if level in part.labels]
            run = "-".join([*before, str(run)])
        label = (*(part.labels[level] for level in outer), run)
        other = seen.setdefault(label, part)
        if other is not part:
            raise ValueError(_twice(other, part, [*outer, "run"], label))
        _check_clock(part, _named([*outer, "run"], label))
        pieces.append(replace(part.runs, labels=[label if outer else run]))
    names = [channel.name for channel in columns.channels]
    return assemble(pieces, names, columns.known, outer or None, every_level=True)


def _named(levels: list[str], label: tuple[Any, ...]) -> str:
    return ", ".join(f"{level} {own!r}" for level, own in zip(levels, label, strict=True))


def _twice(one: Part, other: Part, levels: list[str], label: tuple[Any, ...]) -> str:
    what = _named(levels, label)
    if one.runs.path == other.runs.path:
        return (
            f"{one.runs.path} has two runs of {what}: give each its own label, or name the column "
            "that tells them apart."
        )
    return (
        f"Two files give {what}: {one.runs.path} and {other.runs.path}. Leave one out, or give "
        "the pattern of the names with all that tells them apart, such as "
        "'{subject}/{condition}_{run}.csv'."
    )


def _check_clock(part: Part, what: str) -> None:
    """Refuse a run whose time does not increase."""
    time = part.runs.time
    back = np.flatnonzero(~(np.diff(time) > 0) & ~np.isnan(time[1:]) & ~np.isnan(time[:-1]))
    if back.size:
        row = int(back[0])
        raise ValueError(
            f"The time of {what} in {part.runs.path} does not increase at row {row + 2}: "
            f"{time[row]:.10g} s is followed by {time[row + 1]:.10g} s ({back.size} such rows). "
            "If another run begins there, name the column that labels runs."
        )
