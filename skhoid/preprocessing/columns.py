"""Columns of a table, which are computed with in 64 bits and kept as they came."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from .gate import check_not_infinite, check_not_too_large, check_not_too_small

TESTS = (np.isnan, np.isinf, np.isfinite)  # which are the same in single precision


def as_column(values: Any) -> Any:
    """Numbers of a column: an array of 64-bit floats, or a :class:`SingleColumn`."""
    given = values.to_numpy() if isinstance(values, pd.Series) else np.asarray(values)
    if given.dtype == np.float32:
        return SingleColumn(given)
    if given.dtype == np.float64:
        return given
    return np.asarray(values, dtype=np.float64)


def checked_column(values: Any, name: Any) -> Any:
    """The same of a column of X, of finite values or NaN, neither too large nor too small."""
    column = as_column(values)
    given = column.given if isinstance(column, SingleColumn) else column
    check_not_infinite(given, "X", [name])
    check_not_too_large(given, "X", [name])
    check_not_too_small(given, "X", [name])
    return column


class SingleColumn(np.lib.mixins.NDArrayOperatorsMixin):
    """A column of single precision, which is not copied: its parts are arrays of 64-bit floats.

    So is what is computed of the whole. It may lie in a file.
    """

    def __init__(self, given: np.ndarray) -> None:
        self.given = given
        self.shape, self.size, self.ndim = given.shape, given.size, given.ndim

    def __len__(self) -> int:
        return len(self.given)

    def __getitem__(self, rows: Any) -> Any:
        return self.given[rows].astype(np.float64)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.given.astype(np.float64 if dtype is None else dtype)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if ufunc in TESTS:
            return ufunc(self.given, **options)
        taken = [np.asarray(one) if one.__class__ is SingleColumn else one for one in inputs]
        return getattr(ufunc, method)(*taken, **options)
