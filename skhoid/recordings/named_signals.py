"""Signals of a recording by their role, and the names and units they go by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunIndexError
from ..preprocessing.base import check_numbers
from ..runs import check_alignment, run_column

OUTPUT = "u"  # what an output without a name is called


class NamedSignals:
    """Channels of a table and the output beside them, as columns of numbers.

    A signal is asked for by its role: ``roles`` first, then the column name. An output that has
    the name or role of a channel, as the cursor ``x`` of a recording has, answers for it too.
    """

    def __init__(self, X: Any, y: Any, *, roles: Any = None, run: Any = None) -> None:
        check_alignment(X, y)
        frame = X if isinstance(X, pd.DataFrame) else pd.DataFrame(np.asarray(X))
        names = list(frame.columns)
        unknown = [column for column in roles or {} if column not in [*names, _name(y)]]
        if unknown:
            raise RunIndexError(
                f"roles names {unknown[0]!r}, which is not a column of X; the columns are {names}."
            )
        if run is not None:
            frame = frame.loc[:, np.arange(len(names)) != run_column(names, run)]
        check_numbers(frame, "X")
        self.channels = list(frame.columns)
        self.numbers = frame.to_numpy(dtype=float)
        self.output_name = _name(y)
        self.output = None if y is None else _numbers(y, len(frame))
        self.units = {**getattr(X, "attrs", {}).get("units", {})}
        self.units |= getattr(y, "attrs", {}).get("units", {})
        self._roles = roles or {}

    def of_role(self, role: str) -> tuple[np.ndarray | None, str | None]:
        """Values and unit of the signal with a role; None where there is none."""
        found = [i for i, name in enumerate(self.channels) if self._roles.get(name, name) == role]
        if len(found) > 1:
            raise ValueError(
                f"{len(found)} columns of X have the role {role!r}: "
                f"{[self.channels[i] for i in found]}; give one of them."
            )
        if found:
            return self.numbers[:, found[0]], self.units.get(self.channels[found[0]])
        if self.output is not None and self._roles.get(self.output_name, self.output_name) == role:
            return self.output, self.units.get(self.output_name)
        return None, None


def _name(y: Any) -> Any:
    name = getattr(y, "name", None)
    if isinstance(y, pd.DataFrame):
        name = y.columns[0]
    return OUTPUT if name is None else name


def _numbers(y: Any, n_rows: int) -> np.ndarray:
    output = np.asarray(y, dtype=float)
    if output.size != n_rows:
        raise ValueError(f"y has {output.size} values and X has {n_rows} rows.")
    return output.ravel()
