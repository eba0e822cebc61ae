"""Cells of a study: rows of conditions, as options of the simulation and of the function."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from ....exceptions import did_you_mean
from ....simulation.tracking_runs import OF_TASK, task_of
from .identity import described, digest

LISTS = (list, tuple, range, np.ndarray, pd.Series, pd.Index)
LONGEST = 40  # characters of what stands for an object in a table
OF_SIMULATION = ("random_phases", "open_loop", "keep_run_in")
OF_STUDY = {
    "n_runs": "n_runs of the study",
    "random_state": "random_state of the study",
    "n_jobs": "n_jobs of run()",
    "progress": "progress of run()",
    "noise": "random_state of the study",
    "return_truth": "data.truth in the function",
    "channels": "simulation={'channels': ...}",
}


def rows_of(conditions: Any) -> list[dict[str, Any]]:
    """The cells as given, one dict each."""
    if isinstance(conditions, pd.DataFrame):
        rows = [
            {str(k): v for k, v in row.items() if np.ndim(v) or not pd.isna(v)}
            for row in conditions.to_dict("records")
        ]
    elif isinstance(conditions, Mapping):
        lists = {
            name: list(values) if isinstance(values, LISTS) else [values]
            for name, values in conditions.items()
        }
        rows = [dict(zip(lists, row, strict=True)) for row in product(*lists.values())]
    else:
        rows = [dict(row) for row in conditions]
    if not any(rows):
        raise ValueError("conditions is empty: a study needs at least one cell.")
    return rows


def labels_of(rows: list[dict[str, Any]], before: bool = False) -> list[dict[str, Any]]:
    """The cells as text and numbers, for the columns of the results."""

    def mark(value: Any) -> str:
        return digest(described(value, before=before))

    meant: dict[tuple[str, str], set[str]] = {}
    labels = [{name: _label(value, mark) for name, value in row.items()} for row in rows]
    for row, of_row in zip(rows, labels, strict=True):
        for name, label in of_row.items():
            if isinstance(label, str):
                meant.setdefault((name, label), set()).add(mark(row[name]))
    for row, of_row in zip(rows, labels, strict=True):
        for name, label in of_row.items():
            if isinstance(label, str) and len(meant[name, label]) > 1:
                of_row[name] = f"{label} {mark(row[name])[:6]}"
    return labels


def _label(value: Any, mark: Callable[[Any], str]) -> Any:
    if value is None or isinstance(value, (bool, int, float, str, np.bool_, np.number)):
        return value
    text = str(value)
    if len(text) <= LONGEST and not re.search(r"\bat 0x|\n", text):
        return text
    name = getattr(value, "name", None) or getattr(value, "__name__", None)
    return name if isinstance(name, str) else f"{type(value).__name__} {mark(value)[:6]}"


def read_cell(
    row: dict[str, Any], shared: dict[str, Any], function: Callable[..., Any]
) -> dict[str, Any]:
    """What a cell simulates, and the settings it passes to the function."""
    both = shared | row
    known = {"condition", *OF_TASK, *OF_SIMULATION}
    for name in both:
        if name in OF_STUDY:
            raise ValueError(f"{name} is not an option of a cell; use {OF_STUDY[name]}.")
    settings = {name: value for name, value in both.items() if name not in known}
    _check_settings(settings, function, known)
    task = task_of(
        both.get("condition", "C1"), {name: both[name] for name in OF_TASK if name in both}
    )
    simulation = {name: both[name] for name in OF_SIMULATION if both.get(name) is not None}
    return {
        "row": row,
        "shared": shared,
        "task": task,
        "simulation": simulation,
        "settings": settings,
    }


def _check_settings(
    settings: Mapping[str, Any], function: Callable[..., Any], known: set[str]
) -> None:
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # not a function, or a compiled one
        if not callable(function):
            raise TypeError(
                f"function must be callable with a data set; got {function!r}."
            ) from None
        return
    needed = [
        p.name
        for p in parameters[1:]
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    for name in needed:
        if name not in settings:
            raise ValueError(
                f"conditions: the function needs {name!r}; give it as a column, such as "
                f"{{{name!r}: [...]}}."
            )
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters):
        return
    accepted = {p.name for p in parameters[1:]}
    for name in settings:
        if name not in accepted:
            raise ValueError(
                f"conditions: {name!r} is neither an option of make_tracking_runs nor an argument "
                f"of the function ({', '.join(sorted(accepted)) or 'it has none'})."
                f"{did_you_mean(name, [*known, *accepted])}"
            )
