"""Rows of one parameter: which are used, on which scale, and with which weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from ...text import counted
from .groups import ALL

COLUMNS = [
    "subject",
    "condition",
    "run",
    "parameter",
    "estimate",
    "se",
    "unit",
    "outlying",
    "failure",
]
CELL = ["subject", "condition"]
MOST_NAMED = 5


class Cells(NamedTuple):
    """A person in a condition each; ``subject`` and ``condition`` are numbers, errors s."""

    subject: np.ndarray
    condition: np.ndarray
    value: np.ndarray
    error: np.ndarray
    weight: np.ndarray

    @property
    def n_conditions(self) -> int:
        return int(self.condition.max()) + 1


class Combined(NamedTuple):
    """Cells of runs, the share of each run in its cell, and what runs and cells scatter beyond."""

    cells: Cells
    share: np.ndarray
    tau: float
    tau_cells: float


@dataclass(frozen=True)
class Rows:
    """The rows of one parameter.

    ``data`` holds all, with ``value`` and ``value_se`` (on the scale of the model) and ``left_out``
    (the reason, or nothing); ``used`` are those without a reason. ``table`` is all that was
    given.
    """

    parameter: str
    unit: str
    data: pd.DataFrame
    notes: list[str]
    table: pd.DataFrame

    @property
    def used(self) -> pd.DataFrame:
        return self.data[self.data["left_out"] == ""]

    @property
    def subjects(self) -> list[Any]:
        return list(dict.fromkeys(self.used["subject"]))

    @property
    def conditions(self) -> list[Any]:
        return list(dict.fromkeys(self.used["condition"]))


def select(
    table: pd.DataFrame, parameter: str, *, transform: str | None = None, outlying: str = "keep"
) -> Rows:
    """Take the rows of a parameter from a tidy table."""
    for name, given, known in (
        ("transform", transform, (None, "log")),
        ("outlying", outlying, ("keep", "leave_out")),
    ):
        if given not in known:
            raise ValueError(f"{name} is {' or '.join(map(repr, known))}; got {given!r}.")
    data = _candidates(table, parameter, outlying)
    reasons = data.loc[data["left_out"] != "", "left_out"].value_counts(sort=False).to_dict()
    used = data[data["left_out"] == ""]
    if used.empty:
        said = ", ".join(f"{n} of them: {why}" for why, n in reasons.items())
        raise ValueError(f"No row of {parameter} can be used ({said}).")
    twins = used.duplicated([*CELL, "run"], keep=False)
    if twins.any():
        raise ValueError(
            f"{parameter} has several rows of the same run: {_who(used[twins])}. Leave one of "
            "each in the table."
        )
    units = [unit for unit in dict.fromkeys(used["unit"]) if unit]
    if len(units) > 1:
        raise ValueError(
            f"{parameter} has several units: {', '.join(units)}. Convert its rows to one of them."
        )
    data["value"], data["value_se"] = data["estimate"], data["se"]
    if transform == "log":
        wrong = used[used["estimate"] <= 0.0]
        if len(wrong):
            raise ValueError(
                f"{parameter} is not above 0 in {counted(len(wrong), 'row')} ({_who(wrong)}), so "
                "it has no logarithm. Use transform=None; or say in the column outlying what is "
                'wrong with these rows, and use outlying="leave_out".'
            )
        with np.errstate(invalid="ignore", divide="ignore"):
            data["value"] = np.log(data["estimate"])
            data["value_se"] = data["se"] / data["estimate"].abs()
    notes = [f"{counted(n, 'row')} left out: {why}" for why, n in reasons.items()]
    return Rows(parameter, units[0] if units else "", data, notes, table)


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
    data = table.loc[kept, COLUMNS].reset_index(drop=True)
    data = data.astype({"estimate": float, "se": float})
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


def _who(rows: pd.DataFrame) -> str:
    """Subject, condition and run of rows, for a message."""
    named = [
        f"{row['subject']}, {row['condition']}, run {row['run']}"
        for row in rows.head(MOST_NAMED).to_dict("records")
    ]
    more = len(rows) - len(named)
    return "; ".join(named) + (f"; and {more} more" if more else "")


def weigh(rows: Rows) -> Combined:
    """Combine runs to cells; weights are added to ``rows.data``.

    Rows without a standard error get the largest of their person and condition, else person, else
    all; where no row has one, all count alike.
    """
    used = rows.used
    errors = used["value_se"].where(np.isfinite(used["value_se"]) & (used["value_se"] > 0.0))
    unknown = errors.isna()
    if unknown.all():
        rows.notes.append("no row has a standard error: all count alike")
    elif unknown.any():
        rows.notes.append(
            f"{counted(int(unknown.sum()), 'row')} without a standard error "
            f"({_who(used[unknown])}) weighted by the largest of the same person and condition, or "
            "else person, or else of all"
        )
        filled = errors
        for by in (CELL, ["subject"]):
            filled = filled.fillna(errors.groupby([used[name] for name in by]).transform("max"))
        errors = filled.fillna(errors.max())
    subject, condition = (pd.factorize(used[name])[0] for name in CELL)
    values = used["value"].to_numpy(dtype=float)
    known = None if unknown.all() else errors.to_numpy(dtype=float)
    found = combine(values, known, subject, condition)
    cell = np.unique(subject * (condition.max() + 1) + condition, return_inverse=True)[1]
    for name, column in (
        ("weight", found.share),
        ("cell_weight", found.cells.weight[cell]),
        ("value_se", errors),
    ):
        rows.data[name] = pd.Series(np.asarray(column), used.index)
    return found


def combine(
    values: np.ndarray, errors: np.ndarray | None, subject: np.ndarray, condition: np.ndarray
) -> Combined:
    """Mean values of cells with their weights, in the order of subjects, and of conditions.

    ``errors`` None: all runs, and all cells, weigh the same.
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
    beyond = _variance_between_cells(value, error, *of_cells)
    weight = 1.0 / (error**2 + beyond)
    cells = Cells(*of_cells, value, error, weight / weight.mean())
    return Combined(cells, w / total[cell], float(np.sqrt(between)), float(np.sqrt(beyond)))


def variance_between_runs(values: np.ndarray, errors: np.ndarray, cell: np.ndarray) -> float:
    """The variance of runs of the same cell beyond their standard errors (Paule and Mandel)."""

    def rest(w: np.ndarray) -> np.ndarray:
        return values - (np.bincount(cell, w * values) / np.bincount(cell, w))[cell]

    return paule_mandel(values, errors, rest, float(values.size - int(cell.max()) - 1))


def _variance_between_cells(
    values: np.ndarray, errors: np.ndarray, subject: np.ndarray, condition: np.ndarray
) -> float:
    """The variance of cells beyond their standard errors, around subject + condition.

    Where people have one condition each, around the means of conditions. Taken one standard
    deviation large: an estimate that is too small, often 0, lets the most precise people decide
    alone, and tests are too bold then.
    """
    others = np.eye(condition.max() + 1)[condition][:, 1:]
    one_each = subject.max() + 1 == values.size
    people = np.ones((values.size, 1)) if one_each else np.eye(subject.max() + 1)[subject]
    design = np.column_stack([people, others])

    def rest(w: np.ndarray) -> np.ndarray:
        root = np.sqrt(w)
        fit = np.linalg.lstsq(root[:, None] * design, root * values, rcond=None)[0]
        return values - design @ fit

    df = values.size - int(np.linalg.matrix_rank(design))
    return paule_mandel(values, errors, rest, cautious(df))


def cautious(df: int) -> float:
    """Degrees of freedom less a standard deviation of their χ²: with them a variance is large."""
    return max(df - float(np.sqrt(2.0 * df)), 0.5 * df)


def paule_mandel(
    values: np.ndarray,
    errors: np.ndarray,
    rest: Callable[[np.ndarray], np.ndarray],
    wanted: float,
) -> float:
    """The variance with which weighted squares add up to so many; 0 if they are fewer without."""
    if not wanted > 0.0:
        return 0.0

    def excess(variance: float) -> float:
        w = 1.0 / (errors**2 + variance)
        return float(w @ rest(w) ** 2) - wanted

    if excess(0.0) <= 0.0:
        return 0.0
    high = max(float(np.var(values)), float(np.max(errors)) ** 2)
    while excess(high) > 0.0:
        high *= 4.0
    return float(optimize.brentq(excess, 0.0, high, xtol=1e-14 * high))
