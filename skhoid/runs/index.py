"""The row index of runs, without sorting times that runs share."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from .clock import RUN, TIME

__all__ = ["run_index"]


def run_index(labels: list[Any], lengths: np.ndarray, time: np.ndarray) -> pd.MultiIndex:
    """The row index of runs that follow one another, with the levels ``run`` and ``time`` (s)."""
    runs = pd.Categorical(pd.Index(labels))
    clock, ticks = _ticks(time, np.concatenate(([0], np.cumsum(lengths))))
    return pd.MultiIndex(
        levels=[runs.categories, clock],
        codes=[np.repeat(runs.codes, lengths), ticks],
        names=(RUN, TIME),
        verify_integrity=False,
    )


def _ticks(time: np.ndarray, starts: np.ndarray) -> tuple[pd.Index, np.ndarray]:
    """Instants in order, and the place among them of each row's."""
    if _increases(time):
        return pd.Index(time.copy()), np.arange(time.size, dtype=np.int32)
    lengths = np.diff(starts)
    longest = int(np.argmax(lengths))
    clock = time[starts[longest] : starts[longest + 1]].copy()
    pairs = pairwise(starts)
    if _increases(clock) and all(np.array_equal(time[a:b], clock[: b - a]) for a, b in pairs):
        ticks = np.arange(clock.size, dtype=np.min_scalar_type(-clock.size))
        return pd.Index(clock), np.concatenate([ticks[:length] for length in lengths])
    found = pd.Categorical(time)
    return found.categories, found.codes


def _increases(time: np.ndarray) -> bool:
    return bool((time[1:] > time[:-1]).all())
