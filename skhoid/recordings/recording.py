"""A recording as it was read: signals by role, runs and clock; and what is found in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError
from ..preprocessing.gate import (
    as_output,
    as_table,
    check_not_infinite,
    check_not_too_small,
    check_numbers,
    checked_column,
)
from ..runs import (
    GAP,
    TIME,
    check_alignment,
    check_increasing,
    contiguous_runs,
    numbered,
    output_name,
    read_layout,
    run_column,
    run_name,
    time_in_seconds,
    within_runs,
)
from ..runs.roles import check_named, column_of_role, role_of
from ..text import Summary


@dataclass(frozen=True, repr=False)
class Finding:
    """One finding about a recording or about the residual of a model.

    Parameters
    ----------
    name : str
        Short identifier of this kind of finding, such as ``"rate unit"``.
    title : str
        What was found, in one line.
    evidence : str
        The numbers behind it.
    meaning : str
        What it means, in the terms of manual-control research.
    next_step : str
        What to do about it.
    picture : str, default=""
        What ``plot(kind)`` of the comparison draws to show it; empty if there is none.
    severity : float, default=nan
        VAF points that it costs; NaN if unknown.
    about : str, default=""
        Channels that it is about, if it is about some.

    Examples
    --------
    >>> from skhoid.recordings.recording import Finding
    >>> print(
    ...     Finding(
    ...         "constant channel",
    ...         "FiveVolts is constant",
    ...         "5 V in all 100 rows.",
    ...         "It carries no information.",
    ...         "Leave it out.",
    ...     )
    ... )
    FiveVolts is constant
      Evidence: 5 V in all 100 rows.
      Meaning:  It carries no information.
      Next:     Leave it out.
    """

    name: str
    title: str
    evidence: str
    meaning: str
    next_step: str
    picture: str = ""
    severity: float = np.nan
    about: str = ""

    def __repr__(self) -> str:
        cost = f" ({self.severity:.1f} VAF points)" if np.isfinite(self.severity) else ""
        return f"<Finding {self.name!r}: {self.title}{cost}>"

    def _repr_html_(self) -> str:
        return Summary(self)._repr_html_()

    def __str__(self) -> str:
        return (
            f"{self.title}\n"
            f"  Evidence: {self.evidence}\n"
            f"  Meaning:  {self.meaning}\n"
            f"  Next:     {self.next_step}"
        )


class NamedSignals:
    """Channels of a table and the output beside them, as columns of numbers.

    A signal is asked for by its role: ``roles`` first, then the column name. An output that has
    the name or role of a channel, as the cursor ``x`` of a recording has, answers for it too.
    """

    def __init__(self, X: Any, y: Any, *, roles: Any = None, run: Any = None) -> None:
        check_alignment(X, y)
        X = as_table(X)
        frame = X if isinstance(X, pd.DataFrame) else pd.DataFrame(np.asarray(X))
        names = list(frame.columns)
        self.output_name = output_name(y)
        check_named(names, roles, self.output_name)
        if run is not None:
            frame = frame.loc[:, np.arange(len(names)) != run_column(names, run)]
        check_numbers(frame, "X")
        self.channels = list(frame.columns)
        self.columns = [checked_column(column, name) for name, column in frame.items()]
        self.output = None if y is None else _numbers(y, len(frame))
        self.units = {**getattr(X, "attrs", {}).get("units", {})}
        self.units |= getattr(y, "attrs", {}).get("units", {})
        self._roles = roles

    def of_role(self, role: str) -> tuple[np.ndarray | None, str | None]:
        """Values and unit of the signal with a role; None where there is none."""
        found = column_of_role(self.channels, role, self._roles)
        if found is not None:
            return self.columns[found], self.units.get(self.channels[found])
        if self.output is not None and role_of(self.output_name, self._roles) == role:
            return self.output, self.units.get(self.output_name)
        return None, None


def _numbers(y: Any, n_rows: int) -> np.ndarray:
    output = as_output(y)
    if output.size != n_rows:
        raise ValueError(f"y has {output.size} values but X has {n_rows} rows.")
    check_not_infinite(output, "y")
    check_not_too_small(output, "y")
    return output


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


def join_names(names: list[Any]) -> str:
    """Names in a sentence; of many, the first few and how many more."""
    listed = [str(name) for name in names]
    if len(listed) > MOST_NAMED:
        listed = [*listed[:MOST_NAMED], f"{len(listed) - MOST_NAMED} more"]
    return listed[0] if len(listed) == 1 else f"{', '.join(listed[:-1])} and {listed[-1]}"
