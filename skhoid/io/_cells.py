"""Cells that are no numbers, or that stand for none, column by column."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from ._likeness import numbers_of
from ._table import FileTable, as_numbers
from .guess import Problem, quoted, without_list

__all__ = ["columns_of", "filled", "more_of", "shapes_differ"]

_FILLS = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0, 65535.0)
_FAR = 10.0  # times beyond all other values
_COMMA = r"^\s*([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\s*$"
_POINT = _COMMA.replace(",", r"\.", 1)
_SHOWN = 5


def columns_of(
    table: FileTable, names: Iterable[str], found: list[Problem]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Numbers of columns, NaN in place of other cells, and which rows of the file they are.

    Rows that repeat the header are left out. What is wrong is added to ``found``.
    """
    raw: dict[str, Any] = {}
    for name in names:
        try:
            at = table.find(name)
            raw[name] = table.load([at], None)[0][0] if table.raw is None else table.raw(at)
        except ValueError as error:
            found.append(Problem(without_list(str(error), table.path)))
    n_rows = max((np.size(values) for values in raw.values()), default=0)
    again = _repeated_header(raw, n_rows, found)
    kept = np.setdiff1d(np.arange(n_rows), again)
    if again.size:
        raw = {name: pd.Series(values).iloc[kept] for name, values in raw.items()}
    _mixed_decimals(raw, found)
    columns = {}
    for name, values in raw.items():
        shape = np.shape(values)
        numbers = numbers_of(values)
        columns[name] = numbers.reshape(shape) if len(shape) == 2 and 1 not in shape else numbers
        try:
            as_numbers(_with_points(values), f"{table.kind.capitalize()} {quoted(name)}")
        except ValueError as error:
            found.append(Problem(str(error)))
    return columns, kept


def _texts(values: Any) -> pd.Series | None:
    """Cells of a column that holds texts; None if they are numbers."""
    series = values if isinstance(values, pd.Series) else pd.Series(np.ravel(values))
    if series.dtype.kind in "biufcmM" or pd.api.types.is_numeric_dtype(series.dtype):
        return None
    return series


def _with_points(values: Any) -> Any:
    texts = _texts(values)
    if texts is None:
        return values
    return texts.where(texts.isna(), texts.astype(str).str.replace(_COMMA, r"\1.\2", regex=True))


def _repeated_header(raw: dict[str, Any], n_rows: int, found: list[Problem]) -> np.ndarray:
    """Rows in which a column holds its own name."""
    again: set[int] = set()
    for name, values in raw.items():
        texts = _texts(values)
        if texts is not None and len(texts) == n_rows:
            again |= set(np.flatnonzero(texts.astype(str).str.strip() == name).tolist())
    rows = np.array(sorted(again), dtype=int)
    if rows.size:
        places = ", ".join(str(row + 1) for row in rows[:_SHOWN])
        more = ", ..." if rows.size > _SHOWN else ""
        found.append(
            Problem(
                f"The header stands again below itself (row{'s' if rows.size > 1 else ''} "
                f"{places}{more} of the data), as where files were put one after another: delete "
                "it there."
            )
        )
    return rows


def _mixed_decimals(raw: dict[str, Any], found: list[Problem]) -> None:
    commas: list[tuple[str, str]] = []
    points: list[tuple[str, str]] = []
    for name, values in raw.items():
        texts = _texts(values)
        if texts is None:
            if pd.Series(np.ravel(values)).dtype.kind == "f":
                points.append((name, ""))
            continue
        texts = texts.astype(str).reset_index(drop=True)
        for pattern, columns in ((_COMMA, commas), (_POINT, points)):
            rows = np.flatnonzero(texts.str.match(pattern))
            if rows.size:
                columns.append((name, f" (row {rows[0] + 1}: {texts[rows[0]].strip()})"))
    if commas and points:
        with_commas = ", ".join(quoted(name) for name, _ in commas)
        with_points = ", ".join(f"{quoted(name)}{first}" for name, first in points)
        found.append(
            Problem(
                f"Numbers have decimal commas in {with_commas}, and decimal points in "
                f"{with_points}. Write all numbers of the file with one sign, and without "
                "separators of thousands."
            )
        )


def filled(name: str, values: np.ndarray) -> list[Problem]:
    """Numbers such as -9999 that stand for missing ones."""
    there = values[np.isfinite(values)]
    if there.size < 3:
        return []
    for fill in (there.min(), there.max()):
        if abs(fill) not in _FILLS and abs(fill) < 1e30:
            continue
        rest = there[there != fill]
        if rest.size and np.abs(rest).max() * _FAR < abs(fill):
            rows = np.flatnonzero(values == fill)
            return [
                Problem(
                    f"Column {quoted(name)} is {fill:g} in {rows.size} rows, first in row "
                    f"{rows[0] + 1}, far from all its other values: if that stands for missing "
                    "numbers, leave these cells empty."
                )
            ]
    return []


def shapes_differ(table: FileTable, columns: dict[str, np.ndarray]) -> list[Problem]:
    """Variables that have not as many samples, or not as many runs, as the others."""
    shapes = {name: values.shape for name, values in columns.items() if values.size > 1}
    if table.kind != "variable" or len(set(shapes.values())) < 2:
        return []
    of_runs = [shape for shape in shapes.values() if len(shape) == 2]
    all_shapes = of_runs or list(shapes.values())
    usual = max(all_shapes, key=all_shapes.count)
    wrong = []
    for name, shape in shapes.items():
        if shape not in (usual, usual[:1]):
            advice = " and lies transposed" if shape == usual[::-1] else ""
            wrong.append(f"{quoted(name)} is {_by(shape)}{advice}")
    if not wrong:
        return []
    return [
        Problem(
            f"{'; '.join(wrong)}: the other variables are {_by(usual)}, samples down and runs "
            "across. Save all alike."
        )
    ]


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) if len(shape) > 1 else f"{shape[0]} samples"


def more_of(count: int) -> str:
    """How often else."""
    return "" if count < 2 else f", and in {count - 1} place{'s' if count > 2 else ''} more"
