"""What displays refuse, and why: unfitted or foreign estimators, unknown options, wrong columns.

Open it to change what a Display says to the wrong argument.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ..pipelines import taken_apart


def check_search(search: Any, expected: type, display: str) -> None:
    """Refuse anything but a fitted search of the expected class."""
    if not isinstance(search, expected):
        raise TypeError(
            f"{display}.from_estimator draws a fitted {expected.__name__}; got "
            f"{type(search).__name__}."
        )
    check_is_fitted(search, "best_estimator_")


def fitted_end(estimator: Any) -> Any:
    """The fitted estimator at the end of searches and pipelines."""
    _, last = taken_apart(estimator)
    if hasattr(last, "fit"):
        check_is_fitted(last)
    return last


def check_option(name: str, value: Any, known: Iterable[str]) -> None:
    """Refuse a value that is not among those known."""
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}; got {value!r}.")


def check_some_column(table: pd.DataFrame, names: Sequence[str], what: str) -> None:
    """Refuse a table with none of these columns."""
    if not any(name in table for name in names):
        raise ValueError(
            f"{what} has none of the columns {', '.join(names)}; it has "
            f"{', '.join(map(str, table.columns))}."
        )
