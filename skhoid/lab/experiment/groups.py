"""The runs of an experiment by subject and condition, and notes on what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ... import RunIndexError, ShortRunError
from ...preprocessing import run_in_rows
from ...runs import (
    RUN,
    TIME,
    check_alignment,
    check_levels,
    contiguous_runs,
    fingerprint_of,
    is_mark,
    mark_run_in,
    read_layout,
    run_name,
)

SUBJECT: str = "subject"
CONDITION: str = "condition"
ALL: str = "all"
RECORDING = "the recording"  # the name of an unnamed cell


@dataclass(frozen=True)
class Cell:
    """The runs of a subject in a condition; the run-in is marked in the index of X."""

    subject: Any
    condition: Any
    name: str
    X: pd.DataFrame
    y: pd.Series
    starts: np.ndarray
    labels: list[Any]
    start: float
    stop: float

    @property
    def runs(self) -> Iterator[tuple[pd.DataFrame, pd.Series]]:
        return (
            (self.X.iloc[a:b], self.y.iloc[a:b])
            for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)
        )


def read_cells(
    X: pd.DataFrame,
    y: Any,
    last: int | None,
    input: str,
    run_in: float | None,
    measurement_time: float | None,
    region: float,
) -> tuple[list[Cell], float, list[str]]:
    """The last runs of each subject and condition without run-in, dt, and notes."""
    if not isinstance(getattr(X, "index", None), pd.MultiIndex):
        raise RunIndexError(
            "analyse_experiment needs the index levels 'run' and 'time' in X, and uses 'subject' "
            "and 'condition' if there are such levels (skhoid.read_runs makes the first two)."
        )
    check_alignment(X, y)
    layout = read_layout(X)
    names = [name for name in X.index.names if name not in (RUN, TIME)]
    if others := [name for name in names if name not in (SUBJECT, CONDITION)]:
        raise RunIndexError(
            f"X has the index level {others[0]!r}; an experiment has only 'subject' and "
            "'condition' besides 'run' and 'time'. Rename it, drop it, or join it with one of "
            "these."
        )
    if input not in X.columns:
        raise ValueError(
            f"X has no column {input!r} for the error that the operator sees; the columns are "
            f"{', '.join(map(str, X.columns))}. Give input=."
        )
    notes = []
    if run_in is None and measurement_time is None:
        trimmed = layout.time < -1e-6 * layout.dt
        if not trimmed.any():
            notes.append(
                "nothing was left out as run-in; for that give run_in= or measurement_time=, or "
                "count times before the measurement as negative"
            )
    else:
        trimmed = run_in_rows(layout, run_in=run_in, measurement_time=measurement_time)
    output = pd.Series(np.asarray(y, dtype=float).ravel(), index=X.index, name="u")
    if isinstance(y, pd.Series):
        output.name, output.attrs = y.name, dict(y.attrs)
    run_index = X.index[layout.run_starts[:-1]].to_frame(index=False)
    groups: dict[tuple[Any, Any], list[int]] = {}
    for number, row in enumerate(run_index.to_dict("records")):
        pair = row.get(SUBJECT, ALL), row.get(CONDITION, ALL)
        groups.setdefault(pair, []).append(number)
    cells = []
    for (subject, condition), numbers in groups.items():
        labels = {SUBJECT: subject, CONDITION: condition}
        name = " ".join(str(label) for level, label in labels.items() if level in names)
        if last is not None and len(numbers) < last:
            notes.append(f"{name or RECORDING} has {len(numbers)} of the last {last} runs")
        kept = numbers if last is None else numbers[-last:]
        slices = [slice(*layout.run_starts[number : number + 2]) for number in kept]
        rows = np.concatenate([np.arange(s.start, s.stop) for s in slices])
        runs = run_index[RUN].iloc[kept].tolist()
        start, stop = _shared_time(
            [layout.time[s][~trimmed[s]] for s in slices], layout.dt, name, runs, region, notes
        )
        part, of_part = (
            table.iloc[rows].droplevel(names) if names else table.iloc[rows].copy()
            for table in (X, output)
        )
        lost = int((part[input].isna() | of_part.isna()).sum())
        if lost:
            notes.append(f"{name or RECORDING} has {lost} rows with missing values")
        starts = np.concatenate([[0], np.cumsum([s.stop - s.start for s in slices])])
        marked = mark_run_in(part, trimmed[rows])
        cells.append(Cell(subject, condition, name, marked, of_part, starts, runs, start, stop))
    if SUBJECT in names and CONDITION in names:
        subjects = list(dict.fromkeys(subject for subject, _ in groups))
        for condition in dict.fromkeys(condition for _, condition in groups):
            absent = [str(s) for s in subjects if (s, condition) not in groups]
            if absent:
                notes.append(f"{condition} has no runs of {', '.join(absent)}")
    return cells, layout.dt, notes


def _shared_time(
    times: list[np.ndarray],
    dt: float,
    name: str,
    labels: list[Any],
    region: float,
    notes: list[str],
) -> tuple[float, float]:
    """The time that the runs share, long enough for a first and a last region."""
    for time, label in zip(times, labels, strict=True):
        length = 0.0 if time.size == 0 else time[-1] - time[0] + dt
        if length < 2 * region - dt / 2:
            raise ShortRunError(
                f"{name + ', run' if name else 'Run'} {label!r} lasts {length:g} s without its "
                f"run-in, but the first and last region of {region:g} s need {2 * region:g} s. "
                "Leave it out, or give a shorter region=."
            )
    first = np.array([time[0] for time in times])
    end = np.array([time[-1] for time in times]) + dt
    start, stop = float(first.max()), float(end.min())
    if stop - start < 2 * region - dt / 2:
        late, early = labels[int(first.argmax())], labels[int(end.argmin())]
        raise ShortRunError(
            f"{name or 'The recording'}: run {late!r} begins at {start:g} s and run {early!r} "
            f"ends at {stop:g} s, so the runs share less than the {2 * region:g} s of a first "
            "and a last region. Times must count from the start of the forcing function."
        )
    if np.ptp(first) > dt / 2 or np.ptp(end) > dt / 2:
        notes.append(
            f"the runs of {name or RECORDING} do not begin and end at the same times; they are "
            f"compared from {start:g} to {stop:g} s, which they share"
        )
    return start, stop


LEVELS = (SUBJECT, CONDITION)


@dataclass(frozen=True)
class Group:
    """The runs of a person in a condition; ``starts`` are row offsets that end with their number.

    The index of ``X`` has no level any more in which the group does not vary by definition.
    """

    subject: Any
    condition: Any
    labels: list[Any]
    starts: np.ndarray
    X: pd.DataFrame
    y: pd.Series

    def __str__(self) -> str:
        named = [str(name) for name in (self.subject, self.condition) if name != ALL]
        return " ".join(named) or "all runs"

    def run(self, number: int) -> tuple[pd.DataFrame, pd.Series]:
        rows = slice(*self.starts[number : number + 2])
        return self.X.iloc[rows], self.y.iloc[rows]

    def identity(self) -> str:
        return fingerprint_of(self.X, self.y)[:16]


def levels_of(X: Any, by: Sequence[str] | str | None) -> list[str]:
    """The index levels to tell people and conditions apart by."""
    if not isinstance(getattr(X, "index", None), pd.MultiIndex):
        raise RunIndexError(
            "identify_people needs a DataFrame with the index levels 'run' and 'time', and "
            f"'subject' and 'condition' if there are such levels; got {type(X).__name__}"
            f"{' without them' if isinstance(X, pd.DataFrame) else ''}. skhoid.read_experiment "
            "makes such a table from files."
        )
    check_levels(X.index)
    names = list(X.index.names)
    for name in (RUN, TIME):
        if name not in names:
            raise RunIndexError(
                f"X has no index level {name!r}; its levels are {names}. identify_people needs "
                "'run' and 'time' (s)."
            )
    if by is None:
        return [name for name in LEVELS if name in names]
    chosen = [by] if isinstance(by, str) else list(by)
    for name in chosen:
        if name not in LEVELS:
            raise ValueError(
                f"by={by!r}: people are told apart by 'subject' and 'condition'; got {name!r}. "
                "Rename the level with X.index.set_names([...])."
            )
        if name not in names:
            raise RunIndexError(
                f"by={by!r}, but X has no index level {name!r}; its levels are {names}."
            )
    return chosen


def read_groups(X: pd.DataFrame, y: Any, by: list[str]) -> list[Group]:
    """Groups in the order of their first rows."""
    if not hasattr(y, "__len__"):
        raise TypeError(f"y must be a Series or an array of {len(X)} values; got {y!r}.")
    check_alignment(X, y)
    if len(y) != len(X):
        raise ValueError(f"X has {len(X)} rows but y has {len(y)}: one value of y for each row.")
    if len(X) == 0:
        raise ValueError("X has no rows.")
    starts, runs = _runs(X.index)
    found: dict[tuple[Any, ...], list[int]] = {}
    for number, row in enumerate(runs[by].itertuples(index=False, name=None)):
        found.setdefault(row, []).append(number)
    output = y if isinstance(y, pd.Series) else pd.Series(np.asarray(y).ravel(), name="u")
    rest = [name for name in runs.columns if name not in by]
    table = list(runs[rest].itertuples(index=False, name=None))
    labels = [row[0] if len(row) == 1 else run_name(row) for row in table]
    return [
        _group(dict(zip(by, key, strict=True)), numbers, starts, labels, X, output)
        for key, numbers in found.items()
    ]


def _runs(index: pd.MultiIndex) -> tuple[np.ndarray, pd.DataFrame]:
    """Row offsets of runs, and their labels by level.

    Clocks are left to the fits: one bad clock then does not stop the others.
    """
    keys = [i for i, name in enumerate(index.names) if name != TIME and not is_mark(str(name))]
    codes: Any = np.zeros(len(index), dtype=np.int64)
    for key in keys:
        of_level = np.asarray(index.codes[key])
        if of_level.min() < 0:
            row = int(np.flatnonzero(of_level < 0)[0])
            raise RunIndexError(
                f"Row {row} has no label in the index level {index.names[key]!r} (NaN)."
            )
        codes = codes * len(index.levels[key]) + of_level
    firsts = np.concatenate([[0], np.flatnonzero(codes[1:] != codes[:-1]) + 1])
    labels = {
        index.names[key]: index.levels[key].take(np.asarray(index.codes[key])[firsts]).tolist()
        for key in keys
    }
    runs = pd.DataFrame(labels, dtype=object)
    starts = np.append(firsts, len(index))
    block, unique = pd.factorize(codes[firsts])
    if len(unique) < len(firsts):
        names = [run_name(tuple(row)) for row in runs.drop_duplicates().itertuples(index=False)]
        contiguous_runs(np.repeat(block, np.diff(starts)), names)
    return starts, runs


def _group(
    key: dict[str, Any],
    numbers: list[int],
    starts: np.ndarray,
    labels: list[Any],
    X: pd.DataFrame,
    y: pd.Series,
) -> Group:
    first, last = starts[numbers[0]], starts[numbers[-1] + 1]
    lengths = [starts[number + 1] - starts[number] for number in numbers]
    rows: Any = slice(first, last)
    if sum(lengths) != last - first:  # other groups in between
        rows = np.concatenate([np.arange(starts[n], starts[n + 1]) for n in numbers])
    part, output = X.iloc[rows], y.iloc[rows]
    # Unused labels, such as the times of other runs, would go with each group to its worker.
    part.index = part.index.droplevel(list(key)).remove_unused_levels()
    output.index = part.index
    return Group(
        subject=key.get(SUBJECT, ALL),
        condition=key.get(CONDITION, ALL),
        labels=[labels[number] for number in numbers],
        starts=np.concatenate([[0], np.cumsum(lengths)]),
        X=part,
        y=output,
    )
