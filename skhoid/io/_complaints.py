"""All that is wrong with the columns of files, at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError
from ..runs import RUN, read_layout
from ._labels import restarts_of
from ._runs import per_second_of
from ._table import FileTable, as_numbers
from .guess import ColumnGuess, Problem, quoted, without_list

__all__ = ["problems_of_files", "problems_of_runs"]

_SIGNAL = "A signal that never changes tells nothing"


def problems_of_runs(X: pd.DataFrame, y: pd.Series, *, irregular: bool = False) -> list[Problem]:
    """What is wrong with runs that could be read."""
    found = []
    try:
        read_layout(X)
    except IrregularSamplingError as error:
        if not irregular:
            found.append(Problem(str(error), (("resample", ""),)))
    except ValueError as error:
        found.append(Problem(str(error)))
    inputs = [X[name] for name in X.columns if name == "e"]
    found += [Problem(f"{s.name} is constant") for s in (*inputs, y) if _is_constant(s.to_numpy())]
    return found


def problems_of_files(tables: list[FileTable], guess: ColumnGuess) -> list[Problem]:
    """What is wrong with the columns of files, column by column."""
    found: list[Problem] = []
    for table in tables:
        before = f"{table.path.name}: " if len(tables) > 1 else ""
        found += [
            Problem(f"{before}{problem.text}", problem.options)
            for problem in _of_file(table, guess)
        ]
    return list(dict.fromkeys(found))


def _of_file(table: FileTable, guess: ColumnGuess) -> list[Problem]:
    found: list[Problem] = []
    asked = dict(guess.channels)
    if guess.output is not None:
        asked[guess.output[0]] = "u"
    sizes: dict[str, int] = {}
    for name, channel in asked.items():
        values = _column(table, name, found)
        if values is None:
            continue
        sizes[name] = len(values)
        if not np.isfinite(values).any():
            found.append(Problem(f"Column {quoted(name)} has no numbers."))
        elif channel in ("e", "u") and _is_constant(values):
            what = "error e" if channel == "e" else "output u"
            found.append(
                Problem(
                    f"The {what}, {quoted(name)}, is {np.nanmax(values):g} in every row: {_SIGNAL}."
                )
            )
    codes, labels = _labels(table, guess, found)
    if guess.time is not None:
        time = _column(table, guess.time, found)
        if time is not None:
            found += _of_time(table, guess, time, codes, labels)
    return found


def _column(table: FileTable, name: str, found: list[Problem]) -> np.ndarray | None:
    """Numbers of a column; None, and a problem, where it has none."""
    try:
        position = table.find(name)
        raw = table.load([position], None)[0][0]
        return np.ravel(np.asarray(as_numbers(raw, f"{table.kind} {quoted(name)}")), order="F")
    except ValueError as error:
        found.append(Problem(without_list(str(error), table.path)))
        return None


def _labels(
    table: FileTable, guess: ColumnGuess, found: list[Problem]
) -> tuple[np.ndarray | None, list[Any]]:
    """Codes of the runs of rows, and their labels."""
    names = [*guess.levels, *([] if guess.run is None else [guess.run])]
    parts = []
    for name in names:
        try:
            coded = table.load([], table.find(name))[1]
        except ValueError as error:
            found.append(Problem(str(error)))
            continue
        if coded is None:
            continue
        codes, labels = coded
        empty = np.flatnonzero(codes < 0)
        if empty.size:
            found.append(
                Problem(
                    f"Column {quoted(name)} has no label in row {empty[0] + 1} "
                    f"({empty.size} of {codes.size} rows)."
                )
            )
        parts.append((codes, labels))
    if not parts or len({len(codes) for codes, _ in parts}) > 1:
        return None, []
    frame = pd.DataFrame({k: codes for k, (codes, _) in enumerate(parts)})
    codes = frame.groupby(list(frame.columns), sort=False).ngroup().to_numpy()
    changes = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
    order = codes[changes]
    last = parts[-1]
    named = {c: last[1][last[0][row]] for row, c in zip(changes, order, strict=True)}
    if guess.run is not None and len(set(order.tolist())) < order.size:
        seen: set[int] = set()
        for row, code in zip(changes.tolist(), order.tolist(), strict=True):
            if code in seen:
                found.append(
                    Problem(
                        f"Run {named[code]!r} in column {quoted(guess.run)} comes back at row "
                        f"{row + 1}, after another run: sort the file by run and time."
                    )
                )
                break
            seen.add(code)
    return codes, [named[code] for code in range(len(named))]


def _of_time(
    table: FileTable,
    guess: ColumnGuess,
    time: np.ndarray,
    codes: np.ndarray | None,
    labels: list[Any],
) -> list[Problem]:
    found = []
    name = quoted(guess.time or "")
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        found.append(
            Problem(
                f"The time {name} is missing in row {missing[0] + 1} "
                f"({missing.size} of {time.size} rows)."
            )
        )
    if codes is None:
        again = restarts_of(time)
        codes = np.zeros(time.size, dtype=int) if again is None else again[0]
        labels = list(again[1]) if again is not None else []
    if len(codes) != time.size:
        return found
    step, within = np.diff(time), codes[1:] == codes[:-1]
    typical = float(np.nanmedian(np.abs(step))) if step.size else 0.0
    for bad, what in ((step < 0, "runs backwards"), (step == 0, "stands still")):
        rows = np.flatnonzero(bad & within)
        if not rows.size:
            continue
        row = int(rows[0])
        run = f" in run {labels[codes[row]]!r}" if len(labels) > 1 else ""
        more = f", and in {rows.size - 1} places more" if rows.size > 1 else ""
        text = (
            f"The time {name} {what}{run} at row {row + 2}: {time[row]:g} is followed by "
            f"{time[row + 1]:g}{more}."
        )
        back = time[rows + 1] <= time[0] + 2 * typical
        if guess.run is None and what == "runs backwards" and back.mean() > 0.5:
            text += " If runs begin there, a column has to label them."
            found.append(Problem(text, (("run", "NAME"),)))
        else:
            found.append(Problem(text))
    if found or not typical:
        return found
    try:
        per_second = per_second_of(table, guess.time or "", guess.units.get("time"))
    except ValueError as error:
        return [Problem(str(error))]
    index = pd.MultiIndex.from_arrays([codes, time / per_second], names=[RUN, "time"])
    try:
        read_layout(pd.DataFrame({"e": np.zeros(time.size)}, index=index))
    except IrregularSamplingError as error:
        found.append(Problem(str(error), (("resample", ""),)))
    except ValueError as error:
        found.append(Problem(str(error)))
    return found


def _is_constant(values: np.ndarray) -> bool:
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) == 0)
