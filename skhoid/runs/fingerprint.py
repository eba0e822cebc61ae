"""Checksums of data, by which the same data are recognised."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd


def as_frame(data: Any) -> pd.DataFrame:
    """Channels with their names; those of an array are x0, x1 ..."""
    if isinstance(data, pd.DataFrame):
        return data
    frame = pd.DataFrame(np.asarray(data))
    names = getattr(data, "columns", None)
    return frame.rename(columns="x{}".format) if names is None else frame.set_axis(names, axis=1)


def fingerprint_of(*tables: Any) -> str:
    """SHA-256 of index, names and values, in the order of rows; numbers as 64-bit floats."""
    digest = hashlib.sha256()
    for table in tables:
        data = pd.DataFrame(table) if isinstance(table, pd.Series) else as_frame(table)
        for name, values in _parts(data):
            if np.issubdtype(values.dtype, np.number):
                content = np.ascontiguousarray(values, dtype=float).tobytes()
            else:  # run labels that are text
                content = repr(values.tolist()).encode()
            digest.update(repr(name).encode() + content)
    return digest.hexdigest()


def _parts(data: pd.DataFrame) -> Iterator[tuple[Any, np.ndarray]]:
    # A level and a column may have one name.
    for name in range(data.index.nlevels):
        level = data.index.get_level_values(name)
        yield ("level", level.name), level.to_numpy()
    for name, column in data.items():
        yield name, column.to_numpy()
