"""All that is wrong with the columns of files, at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import IrregularSamplingError
from ..runs import RUN, read_layout
from ..runs.clock import JITTER_TOLERANCE
from ..runs.roles import role_of
from ._cells import columns_of, filled, more_of, shapes_differ
from ._labels import restarts_of
from ._runs import per_second_of
from ._table import FileTable
from .guess import ColumnGuess, Problem, quoted

__all__ = ["problems_of_files", "problems_of_runs"]

_SIGNAL = "a signal that never changes tells nothing"
_STRETCHES = 20  # of a run, from where on its rows lie among those of others
_NEARLY = 0.99
_OFTEN = 0.01  # of the rows


def problems_of_runs(X: pd.DataFrame, y: pd.Series, *, irregular: bool = False) -> list[Problem]:
    """What is wrong with runs that could be read."""
    found = []
    try:
        read_layout(X)
    except IrregularSamplingError as error:
        if not irregular:
            found.append(_irregular(error))
    except ValueError as error:
        found.append(Problem(str(error)))
    inputs = [X[name] for name in X.columns if name == "e"]
    for signal in (*inputs, y):
        values = signal.to_numpy()
        if _is_constant(values):
            found.append(Problem(f"{signal.name} is constant"))
        found += filled(str(signal.name), values)
    return found


def _irregular(error: Exception) -> Problem:
    """What the error says, without the advice for tables that are in Python already."""
    return Problem(str(error).partition(" Bring the runs")[0], (("resample", ""),))


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
    names = [*asked, *([] if guess.time is None else [guess.time])]
    columns, kept = columns_of(table, names, found)
    found += shapes_differ(table, columns)
    codes, labels = _labels(table, guess, found, kept)
    signals: dict[str, tuple[str, np.ndarray]] = {}
    for name, channel in asked.items():
        if name not in columns:
            continue
        values = columns[name].ravel(order="F")
        signals[role_of(channel, guess.roles) or channel] = name, values
        if not np.isfinite(values).any():
            found.append(Problem(f"Column {quoted(name)} has no numbers."))
        elif channel in ("e", "u") and _is_constant(values):
            found.append(Problem(_constant(name, channel, values, asked)))
        elif channel in ("e", "u"):
            found += _dead_runs(name, values, codes, labels)
        found += filled(name, values)
        missing = np.count_nonzero(np.isnan(values))
        if channel in ("e", "u") and missing and not any(quoted(name) in p.text for p in found):
            rows = f"{missing} of {values.size} rows"
            guess.remarks.append(f"{quoted(name)} has no number in {rows}, which are not measured")
    if guess.error_from == "f_t - x" and {"f_t", "x"} <= signals.keys():
        (target, one), (place, other) = signals["f_t"], signals["x"]
        if np.array_equal(one, other, equal_nan=True):
            found.append(
                Problem(
                    f"The target f_t, {quoted(target)}, and x, {quoted(place)}, are the same, so "
                    "that the error f_t - x is 0 in every row: save them anew."
                )
            )
    if guess.time is not None and guess.time in columns:
        found += _of_time(table, guess, columns[guess.time].ravel(order="F"), codes, labels, kept)
    return found


def _constant(name: str, channel: str, values: np.ndarray, asked: dict[str, str]) -> str:
    what = "error e" if channel == "e" else "output u"
    text = f"The {what}, {quoted(name)}, is {np.nanmax(values):g} in every row: {_SIGNAL}."
    if channel == "e" and {"f_t", "x"} <= set(asked.values()):
        text += " Delete the column, and the error is formed as f_t - x."
    return text


def _dead_runs(
    name: str, values: np.ndarray, codes: np.ndarray | None, labels: list[Any]
) -> list[Problem]:
    """Runs in which a signal has no numbers, or never changes."""
    if codes is None or codes.size != values.size or len(labels) < 2:
        return []
    empty, still = [], []
    for code, label in enumerate(labels):
        own = values[codes == code]
        own = own[np.isfinite(own)]
        if not own.size:
            empty.append(label)
        elif own.size > 2 and np.ptp(own) == 0:
            still.append(label)
    found = []
    for runs, what in ((empty, "has no numbers"), (still, "never changes")):
        if runs:
            text = ", ".join(map(repr, runs[:5])) + (", ..." if len(runs) > 5 else "")
            plural = "s" if len(runs) > 1 else ""
            found.append(
                Problem(
                    f"Column {quoted(name)} {what} in run{plural} {text}: leave the run{plural} "
                    "out."
                )
            )
    return found


def _labels(
    table: FileTable, guess: ColumnGuess, found: list[Problem], kept: np.ndarray
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
        empty_labels = [k for k, label in enumerate(labels) if label == "" or pd.isna(label)]
        codes = np.where(np.isin(codes, empty_labels), -1, codes)[kept[kept < codes.size]]
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
    n_runs = len(set(order.tolist()))
    own = last[0][last[0] >= 0]
    if guess.run is not None and order.size > _STRETCHES * n_runs:
        found.append(
            Problem(
                f"The rows of the {np.unique(own).size} runs of column {quoted(guess.run)} lie "
                "through one another: sort the file by run, and then by time."
            )
        )
        return last[0], []
    if guess.run is not None and n_runs < order.size:
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
    kept: np.ndarray,
) -> list[Problem]:
    found = []
    name = quoted(guess.time or "")
    instants = np.unique(time[np.isfinite(time)]).size
    if time.size > 100 * max(instants, len(labels)):
        return [
            Problem(
                f"The time {name} has {instants} different values in {time.size} rows: it was "
                "rounded when it was stored, as Unix time is in 32 bits. Store it in 64 bits, or "
                "drop the column and give the sampling time.",
                (("dt", "SECONDS"),),
            )
        ]
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        found.append(
            Problem(
                f"The time {name} is missing in row {missing[0] + 1} "
                f"({missing.size} of {time.size} rows)."
            )
        )
    if codes is not None and not labels:  # rows of runs lie through one another
        return found
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
        values = f"{time[row]:.10g} is followed by {time[row + 1]:.10g}"
        if what == "stands still":
            values = "its value is that of the row before"
        place = f"{run} at row {kept[row + 1] + 1}: {values}{more_of(rows.size)}."
        text = f"The time {name} {what}{place}"
        full = _full_counter(time[rows]) if what == "runs backwards" else 0
        if full:
            text = f"The time {name} rolls over at {full}{place} Add {full} to the rows behind."
            found.append(Problem(text))
            continue
        back = time[rows + 1] <= time[0] + 2 * typical
        if guess.run is None and what == "runs backwards" and back.mean() > 0.5:
            text += " If runs begin there, a column has to label them."
            found.append(Problem(text, (("run", "NAME"),)))
        else:
            found.append(Problem(text))
    if found or not typical:
        return found + _uneven(name, step[within & (step > 0)], bool(guess.time))
    try:
        per_second = per_second_of(table, guess.time or "", guess.units.get("time"))
    except ValueError as error:
        return [Problem(str(error))]
    known = len(set(map(str, labels))) == len(labels) > 0
    runs = pd.Categorical.from_codes(codes, [str(label) for label in labels]) if known else codes
    index = pd.MultiIndex.from_arrays([runs, time / per_second], names=[RUN, "time"])
    try:
        read_layout(pd.DataFrame({"e": np.zeros(time.size)}, index=index))
    except IrregularSamplingError as error:
        found.append(_irregular(error))
    except ValueError as error:
        found.append(Problem(str(error)))
    return found or _uneven(name, step[within], False)


def _uneven(name: str, steps: np.ndarray, also_jitter: bool) -> list[Problem]:
    """Steps of a clock that are so often too long or short that it is no regular one."""
    if steps.size < 100:
        return []
    apart = steps / np.median(steps) - 1
    gaps, off = np.mean(apart > 0.5), np.mean(np.abs(apart) > JITTER_TOLERANCE)
    if also_jitter and off - gaps > _OFTEN:
        return [
            Problem(
                f"The time {name} is irregular: {off:.0%} of its steps are more than "
                f"{JITTER_TOLERANCE:.0%} off the usual one.",
                (("resample", ""),),
            )
        ]
    if gaps > _OFTEN:
        return [
            Problem(
                f"The time {name} has {int(gaps * steps.size)} gaps, steps of at least 1.5 times "
                "the usual one, at each of which a model starts anew: too many to be pauses. "
                "Find out why the clock hangs."
            )
        ]
    return []


def _full_counter(last: np.ndarray) -> int:
    """The number at which a counter of some bits begins anew, if its last values are just below."""
    for full in (2**15, 2**16, 2**31, 2**32):
        if np.all((last > _NEARLY * full) & (last < full)):
            return int(full)
    return 0


def _is_constant(values: np.ndarray) -> bool:
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) == 0)
