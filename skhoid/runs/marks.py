"""Marks that stay with rows, in extra levels of their index: run-in, decimation, run column."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

RUN_IN_LEVEL = "run-in"
_RUN_COLUMN_LEVEL = "runs from column "  # and the name of a column that is no input
_DECIMATION_LEVEL = re.compile(r"^decimation 1/(\d+) (\S+) (\S+)$")


@dataclass(frozen=True)
class DecimationMark:
    """What :class:`skhoid.Decimator` says about the rows it marks: factor, filter and its ends."""

    factor: int
    method: str
    padding: str

    @property
    def level(self) -> str:
        return f"decimation 1/{self.factor} {self.method} {self.padding}"


def mark_run_in(frame: pd.DataFrame, trimmed: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the run-in rows marked in an extra index level."""
    return _with_level(frame, RUN_IN_LEVEL, trimmed)


def mark_decimated(frame: pd.DataFrame, mark: DecimationMark, kept: np.ndarray) -> pd.DataFrame:
    """Return ``frame`` with the kept rows marked in an extra index level."""
    return _with_level(frame, mark.level, kept)


def mark_run_column(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return ``frame`` with the name of its run column in an extra index level."""
    return _with_level(frame, _RUN_COLUMN_LEVEL + column, np.zeros(len(frame)))


def _with_level(frame: pd.DataFrame, name: str, values: np.ndarray) -> pd.DataFrame:
    index = frame.index
    if not isinstance(index, pd.MultiIndex):
        raise TypeError("marks are carried by a run and time index")
    frame.index = pd.MultiIndex(
        levels=[*index.levels, [False, True]],
        codes=[*index.codes, values.astype(np.int8)],
        names=[*index.names, name],
        verify_integrity=False,
    )
    return frame


def is_mark(level: str) -> bool:
    return (
        level == RUN_IN_LEVEL
        or level.startswith(_RUN_COLUMN_LEVEL)
        or _DECIMATION_LEVEL.match(level) is not None
    )


def read_marks(index: pd.MultiIndex) -> dict[str, Any]:
    """What the marks of an index say: ``trimmed``, ``mark`` and ``kept``, ``run_column``."""
    found: dict[str, Any] = {}
    for position, name in enumerate(map(str, index.names)):
        if name == RUN_IN_LEVEL:
            found["trimmed"] = index.get_level_values(position).to_numpy(dtype=bool)
        elif match := _DECIMATION_LEVEL.match(name):
            found["kept"] = index.get_level_values(position).to_numpy(dtype=bool)
            found["mark"] = DecimationMark(int(match[1]), match[2], match[3])
        elif name.startswith(_RUN_COLUMN_LEVEL):
            found["run_column"] = name.removeprefix(_RUN_COLUMN_LEVEL)
    return found
