"""Rows of one parameter: which are used, on which scale, and with which weights.

Open it to change who is left out and why, or how standard errors become weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from ...text import counted
from .groups import ALL

COLUMNS = (
    "subject",
    "condition",
    "run",
    "parameter",
    "estimate",
    "se",
    "unit",
    "outlying",
    "failure",
)
CELL = ["subject", "condition"]
TRANSFORMS = (None, "log")
OUTLYING = ("keep", "leave_out")
MOST_NAMED = 5


@dataclass(frozen=True)
class Rows:
    """The rows of one parameter, and the cells, a person in a condition each, that they make.

    ``data`` holds all rows, with ``value`` and ``value_se`` (on the scale of the model), ``weight``
    (the run's share of its cell), ``cell_weight`` and ``left_out`` (the reason, or nothing).
    ``cells`` are the subjects (``subject``, a number), conditions, values, errors and weights of
    the cells. ``runs`` are the rows without a reason, and ``cell`` the cell of each. ``tau`` is the
    standard deviation between runs beyond their standard errors, ``tau_cells`` that of cells beyond
    theirs around the additive model.
    """

    parameter: str
    unit: str
    data: pd.DataFrame
    runs: pd.DataFrame
    cell: np.ndarray
    cells: Cells
    subjects: list[Any]
    conditions: list[Any]
    tau: float
    tau_cells: float
    notes: list[str]

    @property
    def subject(self) -> np.ndarray:
        return self.cells.subject

    @property
    def condition(self) -> np.ndarray:
        return self.cells.condition

    @property
    def y(self) -> np.ndarray:
        return self.cells.value

    @property
    def weights(self) -> np.ndarray:
        return self.cells.weight


class Cells(NamedTuple):
    """A person in a condition each, as arrays."""

    subject: np.ndarray
    condition: np.ndarray
    value: np.ndarray
    error: np.ndarray
    weight: np.ndarray


class Combined(NamedTuple):
    """Cells of runs, the share of each run in its cell, and what runs and cells scatter beyond."""

    cells: Cells
    share: np.ndarray
    tau: float
    tau_cells: float


def check_reference(reference: Any, conditions: list[Any]) -> None:
    """Refuse a reference that is none of the conditions."""
    if reference is not None and reference not in conditions:
        raise ValueError(
            f"reference is one of {', '.join(map(str, conditions))}; got {reference!r}."
        )


def combined(
    values: np.ndarray,
    errors: np.ndarray | None,
    subject: np.ndarray,
    condition: np.ndarray,
) -> Combined:
    """Mean values of cells with their weights, first stage of two; ``errors`` None: no weights.

    Cells are in the order of subjects, and of conditions.
    """
    key, cell = np.unique(subject * (condition.max() + 1) + condition, return_inverse=True)
    of_cells = np.divmod(key, condition.max() + 1)
    if errors is None:
        share = 1.0 / np.bincount(cell)[cell]
        plain = np.bincount(cell, share * values)
        ones = np.ones(key.size)
        return Combined(Cells(*of_cells, plain, np.full(key.size, np.nan), ones), share, 0.0, 0.0)
    between = variance_between_runs(values, errors, cell)
    w: Any = 1.0 / (errors**2 + between)
    total: Any = np.bincount(cell, w)
    value, error = np.bincount(cell, w * values) / total, 1.0 / np.sqrt(total)
    beyond = variance_beyond(value, error, *of_cells)
    weight = 1.0 / (error**2 + beyond)
    cells = Cells(*of_cells, value, error, weight / weight.mean())
    return Combined(cells, w / total[cell], float(np.sqrt(between)), float(np.sqrt(beyond)))


def select(
    table: pd.DataFrame,
    parameter: str,
    *,
    weighted: bool = True,
    transform: str | None = None,
    outlying: str = "keep",
) -> Rows:
    """Take the rows of a parameter from a tidy table."""
    for name, given, known in (
        ("transform", transform, TRANSFORMS),
        ("outlying", outlying, OUTLYING),
    ):
        if given not in known:
            raise ValueError(f"{name} is {' or '.join(map(repr, known))}; got {given!r}.")
    data = _candidates(table, parameter, outlying)
    used = data[data["left_out"] == ""]
    if used.empty:
        reasons = ", ".join(f"{n} of them: {why}" for why, n in _reasons(data).items())
        raise ValueError(f"No row of {parameter} can be used ({reasons}).")
    _refuse_twins(used, parameter)
    notes = [f"{counted(n, 'row')} left out: {why}" for why, n in _reasons(data).items()]
    data["value"], data["value_se"] = data["estimate"], data["se"]
    if transform == "log":
        _refuse_negative(used, parameter)
        with np.errstate(invalid="ignore", divide="ignore"):
            data["value"] = np.log(data["estimate"])
            data["value_se"] = data["se"] / data["estimate"].abs()
    used = data[data["left_out"] == ""].copy()
    subjects, conditions = (list(dict.fromkeys(used[name])) for name in CELL)
    codes = [
        pd.Index(labels).get_indexer(pd.Index(used[name]))
        for name, labels in zip(CELL, (subjects, conditions), strict=True)
    ]
    if weighted:
        notes += _fill_missing_errors(used, parameter)
    values, errors = (used[name].to_numpy(dtype=float) for name in ("value", "value_se"))
    found = combined(values, errors if weighted else None, *codes)
    cell = np.unique(codes[0] * len(conditions) + codes[1], return_inverse=True)[1]
    used["weight"], used["cell_weight"] = found.share, found.cells.weight[cell]
    for name in ("weight", "cell_weight", "value_se"):
        data[name] = used[name].reindex(data.index)
    units = [unit for unit in dict.fromkeys(used["unit"]) if unit]
    if len(units) > 1:
        raise ValueError(
            f"{parameter} has several units: {', '.join(units)}. Convert its rows to one of them."
        )
    return Rows(
        parameter=parameter,
        unit=units[0] if units else "",
        data=data,
        runs=used,
        cell=cell,
        cells=found.cells,
        subjects=subjects,
        conditions=conditions,
        tau=found.tau,
        tau_cells=found.tau_cells,
        notes=notes,
    )


def variance_between_runs(values: np.ndarray, errors: np.ndarray, cell: np.ndarray) -> float:
    """The variance of runs of the same cell beyond their standard errors (Paule and Mandel)."""

    def rest(w: np.ndarray) -> np.ndarray:
        return values - (np.bincount(cell, w * values) / np.bincount(cell, w))[cell]

    return _paule_mandel(values, errors, rest, float(values.size - int(cell.max()) - 1))


def variance_beyond(
    values: np.ndarray, errors: np.ndarray, subject: np.ndarray, condition: np.ndarray
) -> float:
    """The variance of cells beyond their standard errors, around subject + condition.

    Where people have one condition each, around the means of conditions. Taken one standard
    deviation large: an estimate that is too small, often 0, lets the most precise people decide
    alone, and tests are too bold then.
    """
    design = np.column_stack([np.eye(subject.max() + 1)[subject], _others(condition)])
    if subject.max() + 1 == values.size:
        design = np.column_stack([np.ones(values.size), _others(condition)])

    def rest(w: np.ndarray) -> np.ndarray:
        root = np.sqrt(w)
        fit = np.linalg.lstsq(root[:, None] * design, root * values, rcond=None)[0]
        return values - design @ fit

    df = values.size - int(np.linalg.matrix_rank(design))
    return _paule_mandel(values, errors, rest, max(df - np.sqrt(2.0 * df), 0.5 * df))


def _paule_mandel(
    values: np.ndarray,
    errors: np.ndarray,
    rest: Callable[[np.ndarray], np.ndarray],
    wanted: float,
) -> float:
    """The variance with which weighted squares add up to so many; 0 if they are fewer without.

    Their expectation is the number of degrees of freedom.
    """
    if not wanted > 0.0:
        return 0.0

    def squares(variance: float) -> float:
        w = 1.0 / (errors**2 + variance)
        return float(w @ rest(w) ** 2)

    if squares(0.0) <= wanted:
        return 0.0
    high = max(float(np.var(values)), float(np.max(errors)) ** 2)
    while squares(high) > wanted:
        high *= 4.0
    return float(optimize.brentq(lambda v: squares(v) - wanted, 0.0, high, xtol=1e-14 * high))


def _others(codes: np.ndarray) -> np.ndarray:
    return np.eye(codes.max() + 1)[codes][:, 1:]


def _candidates(table: pd.DataFrame, parameter: str, outlying: str) -> pd.DataFrame:
    """Rows of the parameter, and of fits that failed, each with why it is left out."""
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise ValueError(
            f"The table has no column {', '.join(missing)}. A tidy table of parameters is needed, "
            "as identify_people gives: one row for each fit and parameter."
        )
    failed = table["failure"].fillna("") != ""
    known = list(dict.fromkeys(table.loc[~failed, "parameter"]))
    if parameter not in known:
        raise ValueError(
            f"There is no parameter {parameter!r}; there are {', '.join(map(str, known))}."
        )
    kept = (table["parameter"] == parameter) | (failed & (table["parameter"].fillna("") == ""))
    data = table.loc[kept, list(COLUMNS)].reset_index(drop=True)
    for name in ("estimate", "se"):
        data[name] = data[name].astype(float)
    for name in ("unit", "outlying", "failure"):
        data[name] = data[name].fillna("").astype(str)
    data["left_out"] = ""
    for why, where in (
        ("the fit failed", data["failure"] != ""),
        ("no estimate", ~np.isfinite(data["estimate"])),
        ("a fit of all conditions, where they have fits of their own", _pooled(data, "condition")),
        ("a fit of all runs, where they have fits of their own", _pooled(data, "run")),
        ("outlying", (data["outlying"] != "") & (outlying == "leave_out")),
    ):
        data.loc[(data["left_out"] == "") & where, "left_out"] = why
    return data


def _pooled(data: pd.DataFrame, level: str) -> pd.Series:
    """Which rows are of all labels of a level, beside rows of single ones."""
    by = ["subject"] if level == "condition" else CELL
    pooled = data[level].astype(str) == ALL
    single = (~pooled & np.isfinite(data["estimate"])).groupby([data[name] for name in by])
    return pooled & single.transform("any")


def _reasons(data: pd.DataFrame) -> dict[str, int]:
    return data.loc[data["left_out"] != "", "left_out"].value_counts(sort=False).to_dict()


def _who(rows: pd.DataFrame) -> str:
    """Subject, condition and run of rows, for a message."""
    named = [
        f"{row['subject']}, {row['condition']}, run {row['run']}"
        for row in rows.head(MOST_NAMED).to_dict("records")
    ]
    more = len(rows) - len(named)
    return "; ".join(named) + (f"; and {more} more" if more else "")


def _refuse_twins(used: pd.DataFrame, parameter: str) -> None:
    twins = used.duplicated([*CELL, "run"], keep=False)
    if twins.any():
        raise ValueError(
            f"{parameter} has several rows of the same run: {_who(used[twins])}. Leave one of "
            "each in the table."
        )


def _refuse_negative(used: pd.DataFrame, parameter: str) -> None:
    wrong = used[used["estimate"] <= 0.0]
    if len(wrong):
        raise ValueError(
            f"{parameter} is not above 0 in {counted(len(wrong), 'row')} ({_who(wrong)}), so it "
            "has no logarithm. Use transform=None; or say in the column outlying what is wrong "
            'with these rows, and use outlying="leave_out".'
        )


def _fill_missing_errors(used: pd.DataFrame, parameter: str) -> list[str]:
    """Give rows without a standard error the largest of their cell, else person, else all."""
    errors = used["value_se"].where(np.isfinite(used["value_se"]) & (used["value_se"] > 0.0))
    unknown = errors.isna()
    if unknown.all():
        raise ValueError(
            f"No row of {parameter} has a standard error above 0, so there are no weights. Use "
            "weighted=False."
        )
    if not unknown.any():
        return []
    filled = errors
    for by in (CELL, ["subject"]):
        filled = filled.fillna(errors.groupby([used[name] for name in by]).transform("max"))
    used["value_se"] = filled.fillna(errors.max())
    return [
        f"{counted(int(unknown.sum()), 'row')} without a standard error ({_who(used[unknown])}) "
        "weighted by the largest of the same person and condition, or else person, or else of all"
    ]
