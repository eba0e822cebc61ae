"""Columns of single precision against the same values in double."""

import numpy as np
import pandas as pd
import pytest

from skhoid.preprocessing.gate import SingleColumn, as_column

VALUES = np.array([0.1, np.nan, -3.5, 1e-40, np.inf, 7.7], np.float32)


@pytest.mark.parametrize("given", [VALUES, pd.Series(VALUES), np.repeat(VALUES, 3)[::3]])
def test_a_column_of_single_precision_computes_in_double(given):
    column, twin = as_column(given), VALUES.astype(np.float64)
    assert isinstance(column, SingleColumn)
    assert np.shares_memory(column.given, np.asarray(given))
    assert (len(column), column.size, column.shape, column.ndim) == (6, 6, (6,), 1)
    for rows in (slice(1, 4), np.array([[5, 0], [2, 2]]), np.isfinite(twin), 3):
        np.testing.assert_array_equal(column[rows], twin[rows])
        assert np.asarray(column[rows]).dtype == np.float64
    with np.errstate(invalid="ignore"):
        for found, expected in (
            (column + column, twin + twin),
            (column - twin, twin - twin),
            (1.0 - column, 1.0 - twin),
            (np.where(twin > 0, column, 0.0), np.where(twin > 0, twin, 0.0)),
            (np.nanmax(column), np.nanmax(twin)),
            (np.nanstd(column[:4]), np.nanstd(twin[:4])),
            (np.zeros_like(column), np.zeros_like(twin)),
            (np.column_stack([column, twin]), np.column_stack([twin, twin])),
            (np.add.reduce(column), np.add.reduce(twin)),
        ):
            np.testing.assert_array_equal(found, expected)
            assert np.asarray(found).dtype == np.float64
    for test in (np.isnan, np.isfinite, np.isinf):
        np.testing.assert_array_equal(test(column), test(twin))


def test_other_columns_are_arrays_of_double_precision():
    double = VALUES.astype(np.float64)
    assert as_column(double) is double
    for given in ([1, 2], np.arange(3), pd.Series([True, False]), pd.Series(["1.5", None])):
        found = as_column(given)
        assert type(found) is np.ndarray
        assert found.dtype == np.float64
