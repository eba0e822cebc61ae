"""Motion tables of BIDS: numbers without a header; names, units and rate are in files beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from .._table import FileTable, one_by_one, read_as

__all__ = ["is_motion", "read_motion"]

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
        peek=lambda count: [column[:count] for column in columns],
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
