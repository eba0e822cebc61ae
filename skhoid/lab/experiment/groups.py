"""The runs of an experiment by subject and condition, and notes on what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
MOST_NAMED = 6  # people in a sentence


def listed(names: list[Any]) -> str:
    """Names in a sentence; of many, how many."""
    shown = [str(name) for name in names[:MOST_NAMED]]
    if len(names) > MOST_NAMED:
        return f"{', '.join(shown)} and {len(names) - MOST_NAMED} more"
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def runs_of_each(numbers: pd.Series) -> str:
    """How many runs there are of each, from the numbers."""
    few, many = int(numbers.min()), int(numbers.max())
    return f"{few if few == many else f'{few} to {many}'} run{'s' * (many > 1)} of each"


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
        return " ".join(named) or "the recording"

    def run(self, number: int) -> tuple[pd.DataFrame, pd.Series]:
        rows = slice(*self.starts[number : number + 2])
        return self.X.iloc[rows], self.y.iloc[rows]

    def last(self, n: int | None) -> Group:
        """The last runs."""
        first = 0 if n is None else max(len(self.labels) - n, 0)
        starts = self.starts[first:]
        rows = slice(starts[0], None)
        X, y = self.X.iloc[rows], self.y.iloc[rows]
        return replace(self, labels=self.labels[first:], starts=starts - starts[0], X=X, y=y)

    def identity(self) -> str:
        return fingerprint_of(self.X, self.y)[:16]


def read_groups(X: pd.DataFrame, y: Any) -> list[Group]:
    """Groups in the order of their first rows."""
    if not isinstance(getattr(X, "index", None), pd.MultiIndex):
        raise RunIndexError(
            "An experiment needs a DataFrame with the index levels 'run' and 'time', and 'subject' "
            f"and 'condition' if there are such levels; got {type(X).__name__}"
            f"{' without them' if isinstance(X, pd.DataFrame) else ''}. skhoid.read_experiment "
            "makes such a table from files."
        )
    check_levels(X.index)
    names = list(X.index.names)
    for name in (RUN, TIME):
        if name not in names:
            raise RunIndexError(f"X has no index level {name!r} (s for 'time'); it has {names}.")
    if not hasattr(y, "__len__"):
        raise TypeError(f"y must be a Series or an array, a value per row of X; got {y!r:.60}.")
    if len(y) != len(X):
        raise ValueError(f"X has {len(X)} rows but y has {len(y)}: one value of y for each row.")
    check_alignment(X, y)
    if len(X) == 0:
        raise ValueError("X has no rows.")
    starts, runs = _runs(X.index)
    by = [name for name in (SUBJECT, CONDITION) if name in names]
    found: dict[tuple[Any, ...], list[int]] = {}
    for number, row in enumerate(map(tuple, runs[by].to_numpy(dtype=object))):
        found.setdefault(row, []).append(number)
    output = y if isinstance(y, pd.Series) else pd.Series(np.asarray(y).ravel(), name="u")
    table = list(runs.drop(columns=by).itertuples(index=False, name=None))
    labels = [row[0] if len(row) == 1 else run_name(row) for row in table]
    return [
        _group(dict(zip(by, key, strict=True)), numbers, starts, labels, X, output)
        for key, numbers in found.items()
    ]


def absent_people(there: Iterable[tuple[Any, Any]]) -> list[str]:
    """Notes on subjects without runs in a condition, from the pairs that there are."""
    pairs = dict.fromkeys(there)
    notes = []
    for condition in dict.fromkeys(condition for _, condition in pairs):
        subjects = dict.fromkeys(subject for subject, _ in pairs)
        absent = [str(name) for name in subjects if (name, condition) not in pairs]
        if absent:
            notes.append(f"{condition} has no runs of {', '.join(absent)}")
    return notes


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


@dataclass(frozen=True)
class Cell(Group):
    """A group whose runs are compared from ``start`` to ``stop`` (s); its run-in is marked."""

    start: float
    stop: float


def read_cells(
    X: pd.DataFrame,
    y: Any,
    last: int | None,
    input: str,
    measurement_time: float | None,
    region: float,
) -> tuple[list[Cell], float, list[str]]:
    """The last runs of each subject and condition, dt, and notes."""
    groups = read_groups(X, y)
    if input not in X.columns:
        raise ValueError(
            f"X has no column {input!r} for the error that the operator sees; the columns are "
            f"{', '.join(map(str, X.columns))}. Give input=."
        )
    whole = read_layout(X)
    notes = []
    if measurement_time is None and not (whole.time < -1e-6 * whole.dt).any():
        notes.append(
            "nothing was left out as run-in; for that give measurement_time=, or count times "
            "before the measurement as negative"
        )
    cells = []
    for group in groups:
        if last is not None and len(group.labels) < last:
            notes.append(f"{group} has {len(group.labels)} of the last {last} runs")
        part = group.last(last)
        layout = read_layout(part.X)
        if measurement_time is None:
            trimmed = layout.time < -1e-6 * layout.dt
        else:
            trimmed = run_in_rows(layout, measurement_time=measurement_time)
        if lost := int((part.X[input].isna() | part.y.isna()).sum()):
            notes.append(f"{part} has {lost} rows with missing values")
        slices = [slice(*part.starts[n : n + 2]) for n in range(len(part.labels))]
        times = [layout.time[rows][~trimmed[rows]] for rows in slices]
        start, stop = _shared_time(part, times, layout.dt, region, notes)
        fields = vars(part) | {"X": mark_run_in(part.X, trimmed), "y": part.y.astype(float)}
        cells.append(Cell(**fields, start=start, stop=stop))
    pairs = [(group.subject, group.condition) for group in groups]
    return cells, whole.dt, [*notes, *absent_people(pairs)]


def _shared_time(
    group: Group, times: list[np.ndarray], dt: float, region: float, notes: list[str]
) -> tuple[float, float]:
    """The time that the runs share, long enough for a first and a last region."""
    for time, label in zip(times, group.labels, strict=True):
        length = 0.0 if time.size == 0 else time[-1] - time[0] + dt
        if length < 2 * region - dt / 2:
            raise ShortRunError(
                f"{group}, run {label!r} lasts {length:g} s without its run-in, but the first and "
                f"last region of {region:g} s need {2 * region:g} s. Leave it out, or give a "
                "shorter region=."
            )
    first = np.array([time[0] for time in times])
    end = np.array([time[-1] for time in times]) + dt
    start, stop = float(first.max()), float(end.min())
    if stop - start < 2 * region - dt / 2:
        late, early = group.labels[int(first.argmax())], group.labels[int(end.argmin())]
        raise ShortRunError(
            f"{group}: run {late!r} begins at {start:g} s and run {early!r} "
            f"ends at {stop:g} s, so the runs share less than the {2 * region:g} s of a first "
            "and a last region. Times must count from the start of the forcing function."
        )
    if np.ptp(first) > dt / 2 or np.ptp(end) > dt / 2:
        notes.append(
            f"the runs of {group} do not begin and end at the same times; they are "
            f"compared from {start:g} to {stop:g} s, which they share"
        )
    return start, stop
