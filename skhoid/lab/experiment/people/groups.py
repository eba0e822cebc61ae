"""The runs of each person in each condition, cut out of a table once, by position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ....exceptions import RunIndexError
from ....runs import RUN, TIME, check_alignment, check_levels, contiguous_runs, run_name
from ....runs.fingerprint import fingerprint
from ....runs.marks import is_mark
from ..read import ALL, CONDITION, SUBJECT

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
        return fingerprint(self.X, self.y)[:16]


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
