"""``RawRecording``: channels, runs and clock as recorded, before they are checked."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError
from ..runs import (
    GAP,
    TIME,
    check_increasing,
    contiguous_runs,
    numbered,
    read_layout,
    run_name,
    time_in_seconds,
    within_runs,
)
from .named_signals import NamedSignals

MOST_NAMED = 4  # runs or channels in a sentence


@dataclass(frozen=True)
class RawRecording:
    """Channels and output by name, runs, and the clock as it was read.

    ``segments`` are the stretches of rows between gaps; ``dt`` is the median step.
    """

    values: dict[Any, Any]
    output: Any
    signals: NamedSignals
    labels: list[str]
    runs: list[slice]
    segments: list[slice]
    time: np.ndarray
    dt: float
    clocked: bool

    @property
    def names(self) -> list[Any]:
        return list(self.values)

    @property
    def units(self) -> dict[Any, str]:
        return self.signals.units

    def where(self, row: int) -> str:
        """Run and time of a row."""
        number = int(np.searchsorted([rows.start for rows in self.runs], row, side="right")) - 1
        return f"run {self.labels[number]}, t = {self.time[row]:.6g} s"


def read_recording(X: Any, y: Any, dt: float | None, run: Any) -> RawRecording:
    """Read a table whose clock may be irregular."""
    index = getattr(X, "index", None)
    clocked = isinstance(index, pd.Index) and TIME in index.names
    run_column = run
    try:
        layout = read_layout(X, dt=dt, run=run)
        labels, starts, time = layout.labels, layout.run_starts, layout.time
        run_column = layout.run_column if run is None else run
    except IrregularSamplingError:
        labels, starts, time = _raw_clock(X, run)
    signals = NamedSignals(X, y, run=run_column)
    values = dict(zip(signals.channels, signals.columns, strict=True))
    output = None
    if signals.output is not None:
        output = signals.output_name
        output = f"{output} (y)" if output in values else output
        values[output] = signals.output
    step, within = np.diff(time), within_runs(starts)
    typical = float(np.median(step[within])) if within.any() else (dt or 1.0)
    cuts = np.union1d(starts, np.flatnonzero(within & (step > GAP * typical)) + 1)
    return RawRecording(
        values=values,
        output=output,
        signals=signals,
        labels=[run_name(label) for label in labels],
        runs=_slices(starts),
        segments=_slices(cuts),
        time=time,
        dt=typical,
        clocked=clocked,
    )


def _raw_clock(X: pd.DataFrame, run: Any) -> tuple[list[Any], np.ndarray, np.ndarray]:
    """Runs and time of a table that read_layout refuses for its clock alone."""
    time = time_in_seconds(X.index.get_level_values(TIME))
    keys = [name for name in X.index.names if name != TIME]
    if keys:
        codes, labels = numbered(X.index.droplevel(TIME), "the index")
    elif run is not None:
        codes, labels = numbered(X[run].to_numpy(), f"column {run!r}")
    else:
        codes, labels = np.zeros(len(X), dtype=int), [0]
    starts = contiguous_runs(codes, labels)
    check_increasing(time, np.diff(time), within_runs(starts), starts, labels)
    return labels, starts, time


def _slices(edges: np.ndarray) -> list[slice]:
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def of_list(names: list[Any]) -> str:
    """Names in a sentence; of many, the first few and how many more."""
    listed = [str(name) for name in names]
    if len(listed) > MOST_NAMED:
        listed = [*listed[:MOST_NAMED], f"{len(listed) - MOST_NAMED} more"]
    return listed[0] if len(listed) == 1 else f"{', '.join(listed[:-1])} and {listed[-1]}"
