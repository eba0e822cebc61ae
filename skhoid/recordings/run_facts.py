"""What is compared between people: size, smoothness, relations and clock of every run."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from ..preprocessing.gate import as_table
from ..runs import RUN, TIME, run_name
from .named_signals import NamedSignals

__all__ = ["LAGS", "Recordings", "RunFacts", "facts_of"]

LAGS = np.linspace(-1.0, 1.0, 21)  # s
_MOST = 6  # channels that are compared
_LEAST_ROWS = 20
_SAME_CLOCK = 5.0  # times the usual step, up to which a clock may be right


@dataclass(frozen=True)
class RunFacts:
    """One run: labels, clock, and by channel the spread and the spread of steps.

    ``curves`` are correlations of the second channel, later by ``LAGS``, with the first.
    ``digest`` is the same for the same numbers.
    """

    subject: Any
    condition: Any
    run: Any
    rows: int
    step: float
    duration: float
    missing: int
    size: dict[str, float]
    rough: dict[str, float]
    curves: dict[tuple[str, str], np.ndarray]
    digest: bytes


@dataclass(frozen=True)
class Recordings:
    """The runs of an experiment, and the usual step (s) of their clocks."""

    runs: list[RunFacts]
    step: float

    @cached_property
    def subjects(self) -> list[Any]:
        return list(dict.fromkeys(run.subject for run in self.runs))

    @cached_property
    def conditions(self) -> list[Any]:
        return list(dict.fromkeys(run.condition for run in self.runs))

    @property
    def channels(self) -> list[str]:
        return list(self.runs[0].size)

    @cached_property
    def _cells(self) -> dict[tuple[Any, Any], list[RunFacts]]:
        cells: dict[tuple[Any, Any], list[RunFacts]] = defaultdict(list)
        for run in self.runs:
            cells[run.subject, run.condition].append(run)
        return dict(cells)

    @cached_property
    def curves(self) -> dict[tuple[tuple[str, str], Any], dict[Any, np.ndarray]]:
        """By pair of channels and condition, the median relation of each person."""
        found: dict[tuple[tuple[str, str], Any], dict[Any, np.ndarray]] = defaultdict(dict)
        for (subject, condition), runs in self._cells.items():
            for pair in {pair for run in runs for pair in run.curves}:
                own = [run.curves[pair] for run in runs if pair in run.curves]
                found[pair, condition][subject] = np.median(own, axis=0)
        return dict(found)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Pairs of channels that are related in any run."""
        return list(dict.fromkeys(pair for run in self.runs for pair in run.curves))

    def of(self, subject: Any, condition: Any = None) -> list[RunFacts]:
        """The runs of a person, in one condition if it is given."""
        conditions = self.conditions if condition is None else [condition]
        return [run for c in conditions for run in self._cells.get((subject, c), [])]


def facts_of(X: pd.DataFrame, y: Any) -> Recordings:
    """The facts of all runs of an experiment."""
    X = as_table(X)
    if not isinstance(X, pd.DataFrame):
        raise TypeError(
            "X must be a DataFrame with the row index levels run and time, as read_experiment "
            f"makes it; got {type(X).__name__}."
        )
    names = list(X.index.names)
    if TIME not in names or RUN not in names:
        raise ValueError(
            f"X must have the row index levels run and time, and subject and condition where there "
            f"are any; it has {names!r}. read_experiment makes them."
        )
    if not len(X):
        raise ValueError("X has no rows, so there is nothing to check.")
    signals = NamedSignals(X, y)
    values = {
        str(name): np.asarray(column, dtype=np.float64)
        for name, column in zip(signals.channels, signals.columns, strict=True)
    }
    values = dict(list(values.items())[:_MOST])
    if signals.output is not None:
        output = str(signals.output_name)
        values[f"{output} (y)" if output in values else output] = signals.output
    every = np.stack(
        [np.asarray(column, dtype=np.float64) for column in (*signals.columns,)]
        + ([] if signals.output is None else [signals.output])
    )
    time = X.index.get_level_values(TIME).to_numpy(dtype=np.float64)
    stretches = list(_stretches(X.index))
    steps = [float(np.median(np.diff(time[rows]))) for _, rows in stretches if _long(rows)]
    usual = float(np.median(steps)) if steps else 1.0
    runs = [_facts(labels, rows, time, values, every, usual) for labels, rows in stretches]
    return Recordings(runs, usual)


def _long(rows: slice) -> bool:
    return rows.stop - rows.start > 1


def _stretches(index: pd.MultiIndex) -> Iterator[tuple[tuple[Any, Any, Any], slice]]:
    """Labels and rows of the runs; levels that are not there are ``"all"``."""
    keys = [name for name in index.names if name != TIME]
    codes = np.stack([index.codes[index.names.index(name)] for name in keys])
    starts = np.append(0, np.flatnonzero((np.diff(codes) != 0).any(axis=0)) + 1)
    stops = np.append(starts[1:], codes.shape[1])
    others = [name for name in keys if name not in ("subject", "condition")]
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        label = dict(zip(index.names, index[start], strict=True))
        inner = tuple(label[name] for name in others)
        run = inner[0] if len(inner) == 1 else run_name(inner)
        yield (label.get("subject", "all"), label.get("condition", "all"), run), slice(start, stop)


def _facts(
    labels: tuple[Any, Any, Any],
    rows: slice,
    time: np.ndarray,
    values: dict[str, np.ndarray],
    every: np.ndarray,
    usual: float,
) -> RunFacts:
    step = float(np.median(np.diff(time[rows]))) if _long(rows) else usual
    own = {name: column[rows] for name, column in values.items()}
    size = {name: _spread(column) for name, column in own.items()}
    rough = {name: _spread(np.diff(column)) for name, column in own.items()}
    trusted = step if usual / _SAME_CLOCK < step < usual * _SAME_CLOCK else usual
    curves = {
        pair: curve
        for pair in combinations(own, 2)
        if (curve := _curve(own[pair[0]], own[pair[1]], trusted)) is not None
    }
    table = every[:, rows]
    return RunFacts(
        *labels,
        rows=rows.stop - rows.start,
        step=step,
        duration=float(time[rows.stop - 1] - time[rows.start]),
        missing=int(np.isnan(table).sum()),
        size=size,
        rough=rough,
        curves=curves,
        digest=hashlib.blake2b(np.ascontiguousarray(table).tobytes(), digest_size=16).digest(),
    )


def _spread(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.std()) if there.size > 1 else 0.0


def _curve(one: np.ndarray, other: np.ndarray, step: float) -> np.ndarray | None:
    """Correlations of ``other``, later by each of the lags, with ``one``."""
    shifts = np.round(LAGS / step).astype(int)
    if one.size < max(_LEAST_ROWS, 2 * int(np.abs(shifts).max())):
        return None
    a, b = (np.nan_to_num(v - np.nanmean(v)) if np.isfinite(v).any() else v for v in (one, other))
    size = float(np.sqrt((a @ a) * (b @ b)))
    if not size > 0 or not np.isfinite(size):
        return None
    n = a.size
    return np.array(
        [a[max(-k, 0) : n - max(k, 0)] @ b[max(k, 0) : n - max(-k, 0)] / size for k in shifts]
    )
