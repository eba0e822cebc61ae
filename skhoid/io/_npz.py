"""NumPy archives (.npz) as tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ._mat import first_of
from ._table import FileTable, one_by_one, read_as

__all__ = ["read_npz"]

_PICKLED = "holds Python objects, which are not read: save plain arrays of numbers."
_FIELDS = "has named fields: save one plain array per channel."


def read_npz(path: Path) -> FileTable:
    """Read the arrays of an NPZ file; never objects, whose loading could run code."""
    if not path.stat().st_size:
        raise ValueError(f"{path} is empty.")
    arrays: dict[str, np.ndarray] = {}
    unreadable: dict[str, str] = {}
    with read_as(path, "a NumPy archive"), np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                values = archive[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                unreadable[name] = _PICKLED
                continue
            if values.dtype.names:
                unreadable[name] = _FIELDS
            else:
                arrays[name] = values
    names = list(arrays)
    return FileTable(
        path,
        names,
        one_by_one(lambda position: arrays[names[position]]),
        unreadable=unreadable,
        kind="variable",
        peek=lambda count: [first_of(values, count) for values in arrays.values()],
    )
