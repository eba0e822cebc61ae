"""Signals of a recording by their role, and the names and units they go by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..preprocessing.columns import checked_column
from ..preprocessing.gate import (
    as_output,
    as_table,
    check_not_infinite,
    check_not_too_small,
    check_numbers,
)
from ..runs import check_alignment, output_name, run_column
from ..runs.roles import check_named, column_of_role, role_of


class NamedSignals:
    """Channels of a table and the output beside them, as columns of numbers.

    A signal is asked for by its role: ``roles`` first, then the column name. An output that has
    the name or role of a channel, as the cursor ``x`` of a recording has, answers for it too.
    """

    def __init__(self, X: Any, y: Any, *, roles: Any = None, run: Any = None) -> None:
        check_alignment(X, y)
        X = as_table(X)
        frame = X if isinstance(X, pd.DataFrame) else pd.DataFrame(np.asarray(X))
        names = list(frame.columns)
        self.output_name = output_name(y)
        check_named(names, roles, self.output_name)
        if run is not None:
            frame = frame.loc[:, np.arange(len(names)) != run_column(names, run)]
        check_numbers(frame, "X")
        self.channels = list(frame.columns)
        self.columns = [checked_column(column, name) for name, column in frame.items()]
        self.output = None if y is None else _numbers(y, len(frame))
        self.units = {**getattr(X, "attrs", {}).get("units", {})}
        self.units |= getattr(y, "attrs", {}).get("units", {})
        self._roles = roles

    def of_role(self, role: str) -> tuple[np.ndarray | None, str | None]:
        """Values and unit of the signal with a role; None where there is none."""
        found = column_of_role(self.channels, role, self._roles)
        if found is not None:
            return self.columns[found], self.units.get(self.channels[found])
        if self.output is not None and role_of(self.output_name, self._roles) == role:
            return self.output, self.units.get(self.output_name)
        return None, None


def _numbers(y: Any, n_rows: int) -> np.ndarray:
    output = as_output(y)
    if output.size != n_rows:
        raise ValueError(f"y has {output.size} values but X has {n_rows} rows.")
    check_not_infinite(output, "y")
    check_not_too_small(output, "y")
    return output
