"""What plots of Monte-Carlo studies share: checks of tables, and labels of cells and results."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import pandas as pd

from ..interpret.conversion import FROM_POLES, UNITS
from ._axes import parameter_symbol, with_unit

REPLICATION = "replication"
QUANTITIES = {
    "condition": "condition",
    "remnant_order": "remnant filter",
    "remnant_intensity": "remnant intensity $P_n$",
    "nk": "delay $n_k$, samples",
    "vaf_estimation": "VAF of estimation, %",
    "vaf_validation": "VAF of validation, %",
}
SAID = {
    "delay": {"fixed": "fixed $n_k^0$", "estimated": "estimated $n_k^*$"},
    "form": {"lambda": r"$\lambda$", "Lambda": r"$\Lambda$"},
    "method": {"fc": "Fourier coefficients", "batch": "batch ARX", "recursive": "recursive ARX"},
}


def check_table(table: Any, needed: Iterable[str], display: str) -> None:
    """Refuse anything but a table with rows and these columns."""
    if not isinstance(table, pd.DataFrame):
        raise TypeError(f"{display} draws a DataFrame; got {type(table).__name__}.")
    missing = [name for name in dict.fromkeys(needed) if name not in table]
    if missing:
        raise ValueError(
            f"{display}: the table has no column {', '.join(map(repr, missing))}; it has "
            f"{', '.join(map(str, table.columns))}."
        )
    if table.empty:
        raise ValueError(f"{display}: the table has no rows.")


def ordered(values: pd.Series) -> list[Any]:
    """The different values: numbers by size, then strings as they come, then what is missing."""
    different = values.drop_duplicates().tolist()
    known = [value for value in different if not pd.isna(value)]
    numbers = [value for value in known if isinstance(value, (int, float))]
    others = [value for value in known if not isinstance(value, (int, float))]
    return sorted(numbers) + others + [value for value in different if pd.isna(value)][:1]


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
    return f"{name.replace('_', ' ')} {number}"


def quantity(name: str) -> str:
    """A column of results as the label of an axis, with its unit."""
    if name in FROM_POLES:
        return with_unit(parameter_symbol(name), UNITS[name])
    if name.startswith("bias_"):
        return f"relative bias of {parameter_symbol(name.removeprefix('bias_'))}"
    if re.fullmatch(r"[ab]\d+", name):
        return parameter_symbol(name)
    return QUANTITIES.get(name, name.replace("_", " "))
