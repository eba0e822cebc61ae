"""Labels of runs: from one column, from several, or from where time restarts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ._table import FileTable

__all__ = ["combined_labels", "plain_labels", "restarts_of"]

Coded = tuple[np.ndarray, list[Any]]  # which label each row has, and the labels


def combined_labels(
    table: FileTable,
    run: str | None,
    labels: Any,
    levels: list[str],
    time: np.ndarray,
    n_rows: int,
) -> Coded | None:
    """Labels of runs with those of the outer levels, as tuples; None where there is one run."""
    if run is None:
        labels = restarts_of(time)
        if labels is None and not levels:
            return None
        labels = labels or (np.zeros(n_rows, dtype=np.int32), [1])
    parts = []
    for name in levels:
        coded = table.load([], table.find(name))[1]
        assert coded is not None
        parts.append(plain_labels(coded, table.where(name)))
    parts.append(plain_labels(labels, table.where(run) if run else "time"))
    for part, _ in parts:
        if part.size != n_rows:
            raise ValueError(
                f"In {table.path} the run labels have {part.size} rows, but the channels have "
                f"{n_rows}."
            )
    if not levels:
        return parts[-1]
    return _tuples(parts)


def _tuples(parts: list[Coded]) -> Coded:
    codes, n_rows = parts[0][0].astype(np.int64), parts[0][0].size
    for part, names in parts[1:]:
        codes = codes * len(names) + part
    inner, names = parts[-1]
    for of_run in (codes, inner):
        starts = np.append(0, np.flatnonzero(np.diff(of_run)) + 1)
        if np.unique(of_run[starts]).size == starts.size:
            break  # a level that varies within runs: its first label counts
    labels = [tuple(known[part[row]] for part, known in parts) for row in starts.tolist()]
    places = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    each = np.array([places[label] for label in labels], dtype=np.int32)
    return np.repeat(each, np.diff(starts, append=n_rows)), list(places)


def restarts_of(time: np.ndarray) -> tuple[np.ndarray, list[Any]] | None:
    """Runs that begin where time returns to its first value; None where it never does."""
    if time.size < 3:
        return None
    step = np.diff(time)
    falls = np.flatnonzero(step < 0) + 1
    if not falls.size:
        return None
    slack = 2.0 * float(np.nanmedian(np.abs(step)))
    if np.any(np.abs(time[falls] - time[0]) > slack):
        return None
    codes = np.zeros(time.size, dtype=np.int32)
    codes[falls] = 1
    return np.cumsum(codes).astype(np.int32), list(range(1, falls.size + 2))


def plain_labels(coded: tuple[np.ndarray, list[Any]], where: str) -> tuple[np.ndarray, list[Any]]:
    """Labels in the form in which they are compared, and which of them each row has."""
    codes, found = coded
    known: dict[Any, int] = {}
    missing = [-1]
    places = []
    for place, label in enumerate(found):
        if isinstance(label, tuple):
            pass
        elif pd.isna(label) or label == "":
            missing.append(place)
        elif isinstance(label, str):
            label = label.strip()
        # MATLAB numbers are floats: a run 1 there is the run 1 of a CSV file.
        elif isinstance(label, float) and label.is_integer():
            label = int(label)
        places.append(known.setdefault(label, len(known)))
    if len(missing) > 1 or codes.min(initial=0) < 0:
        row = int(np.flatnonzero(np.isin(codes, missing))[0])
        raise ValueError(f"{where} has no run label in row {row + 1}.")
    return np.array(places, dtype=np.int32)[codes], list(known)
