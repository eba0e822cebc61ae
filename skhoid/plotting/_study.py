"""What plots of Monte-Carlo studies share: checks of tables, and labels of cells and results.

Open it when a study has a new kind of cell or result, to say how it is labelled.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..interpret.conversion import FROM_POLES, UNITS
from ._axes import parameter_symbol, with_unit

REPLICATION = "replication"
LISTED = 8  # values in a message
# Results, wherever they stand in a table.
RESULT = re.compile(r"[ab]\d+|bias_\w+|vaf_\w+|nk|P_n|H_(real|imag)|\w+_sd|weight_ratio")
OPERATOR = tuple(FROM_POLES)
QUANTITIES = {
    "condition": "condition",
    "remnant_order": "remnant filter",
    "remnant_intensity": "remnant intensity $P_n$",
    "sampling_rate": "sampling rate $f_s$, Hz",
    "nk": "delay $n_k$, samples",
    "vaf_estimation": "VAF of estimation, %",
    "vaf_validation": "VAF of validation, %",
    "weight_ratio": "$|A|^2$ at 100 / at 20 rad/s",
    "P_n": "$P_n$ of the run",
}
SAID = {
    "open_loop": {"True": "open loop", "False": "closed loop"},
    "delay": {"fixed": "fixed $n_k^0$", "estimated": "estimated $n_k^*$"},
    "form": {"lambda": r"$\lambda$", "Lambda": r"$\Lambda$"},
    "method": {"fc": "Fourier coefficients", "batch": "batch ARX", "recursive": "recursive ARX"},
}


def check_table(table: Any, needed: Iterable[str], display: str) -> None:
    """Refuse anything but a table with rows and these columns."""
    if not isinstance(table, pd.DataFrame):
        raise TypeError(
            f"{display} draws the table of a study, a DataFrame; got {type(table).__name__}."
        )
    missing = [name for name in dict.fromkeys(needed) if name not in table]
    if missing:
        raise ValueError(
            f"{display}: the table has no column {', '.join(map(repr, missing))}; it has "
            f"{', '.join(map(str, table.columns))}."
        )
    if table.empty:
        raise ValueError(f"{display}: the table has no rows.")


def cells_of(table: pd.DataFrame) -> list[str]:
    """The columns before the replication, which name the cell of the study."""
    columns = list(table.columns)
    before = columns[: columns.index(REPLICATION)]
    return [name for name in before if name not in OPERATOR and not RESULT.fullmatch(str(name))]


def refuse_mixtures(table: pd.DataFrame, drawn: Sequence[str], display: str) -> None:
    """Refuse cells that differ in something that the plot does not show."""
    mixed = [c for c in cells_of(table) if c not in drawn and _varies(table[c])]
    again = table.duplicated([*drawn, REPLICATION])
    if again.any():
        others = [
            c
            for c in table
            if c not in (*drawn, *mixed, REPLICATION)
            and not pd.api.types.is_float_dtype(table[c])
            and _varies(table[c])
        ]
        # Integers such as n_k are results as a rule; they are to blame only where nothing else is.
        kinds = [c for c in others if not pd.api.types.is_integer_dtype(table[c])]
        mixed += kinds or (others if not mixed else [])
        if not mixed:
            raise ValueError(f"{display}: the table has several rows of one replication.")
    if mixed:
        name = mixed[0]
        raise ValueError(
            f"{display} would mix {name} = {listed(table[name])}: choose one, as "
            f"table[table[{name!r}] == ...] does."
        )


def _varies(column: pd.Series) -> bool:
    return len(column.drop_duplicates()) > 1


def chosen(table: pd.DataFrame, cells: Mapping[str, Any], display: str) -> pd.DataFrame:
    """The rows of a cell; a number need not be exact."""
    for name, value in cells.items():
        if pd.api.types.is_numeric_dtype(table[name]) and isinstance(value, (int, float)):
            found = np.isclose(table[name].to_numpy(dtype=float), value)
        else:
            found = (table[name] == value).to_numpy()
        if not found.any():
            raise ValueError(
                f"{display}: no row has {name} = {value}; the table has {listed(table[name])}."
            )
        table = table[found]
    return table


def chosen_panels(
    table: pd.DataFrame, condition: str | None, remnant_intensity: Any, display: str
) -> pd.DataFrame:
    """The rows of a condition and of some remnant intensities, in their order; None for all."""
    if condition is not None:
        table = chosen(table, {"condition": condition}, display)
    if remnant_intensity is not None:
        wanted = np.atleast_1d(np.asarray(remnant_intensity, dtype=float)).tolist()
        table = pd.concat([chosen(table, {"remnant_intensity": P}, display) for P in wanted])
    return table


def ordered(values: pd.Series) -> list[Any]:
    """The different values: numbers by size, then strings as they come, then what is missing."""
    different = values.drop_duplicates().tolist()
    known = [value for value in different if not pd.isna(value)]
    numbers = [value for value in known if isinstance(value, (int, float))]
    others = [value for value in known if not isinstance(value, (int, float))]
    return sorted(numbers) + others + [value for value in different if pd.isna(value)][:1]


def listed(values: pd.Series) -> str:
    """The first of the different values, for a message."""
    different = [str(v) for v in ordered(values)]
    return ", ".join(different[:LISTED]) + ", ..." * (len(different) > LISTED)


def cell_text(name: str, value: Any) -> str:
    """A value of a column that names cells, as titles and legends show it."""
    if pd.isna(value):
        return "no remnant" if name == "remnant_order" else f"no {name.replace('_', ' ')}"
    number = f"{value:g}" if isinstance(value, (int, float)) else str(value)
    if name in SAID:
        return SAID[name].get(str(value), str(value))
    if name == "condition":
        return str(value)
    if name == "remnant_order":
        return f"$H_n^{{{number}}}$"
    if name == "remnant_intensity":
        return f"$P_n$ = {number}"
    if name == "sampling_rate":
        return f"$f_s$ = {number} Hz"
    return f"{name.replace('_', ' ')} {number}"


def quantity(name: str) -> str:
    """A column of results as the label of an axis, with its unit."""
    if name in OPERATOR:
        return with_unit(parameter_symbol(name), UNITS[name])
    if name.startswith("bias_"):
        return f"relative bias of {parameter_symbol(name.removeprefix('bias_'))}"
    if re.fullmatch(r"[ab]\d+", name):
        return parameter_symbol(name)
    return QUANTITIES.get(name, name.replace("_", " "))
