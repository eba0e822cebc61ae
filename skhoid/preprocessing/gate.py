"""The gate for data: tables, outputs and columns, checked and read."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import column_or_1d

from ..runs import check_alignment, output_name, refuse_container

# Squares, their products and sums over all rows, and ratios of channels stay far from the limits
# of float64 between these.
LARGEST, SMALLEST = 1e40, 1e-40
FIRST = 1000  # rows, which mostly tell that a signal is not too small

DOUBLE = (np.float64,)
AS_GIVEN = (np.float64, np.float32)  # what is read in parts, and need not be copied as a whole


def as_table(X: Any) -> Any:
    """Channels as a frame or an array that NumPy reads: masked values as NaN, sparse ones dense."""
    if isinstance(X, pd.DataFrame):
        _check_columns(X)
        return _dense(X)
    refuse_container(X)
    return unmasked(X)


def as_output(
    y: Any, what: str = "y", *, warn: bool = False, dtypes: tuple[type, ...] = DOUBLE
) -> np.ndarray:
    """Values of an output, one per row: masked ones as NaN; ``warn`` of a column vector."""
    if isinstance(y, pd.DataFrame):
        _check_columns(y, what)
        y = _dense(y)
    elif isinstance(y, np.ndarray) and y.dtype.kind == "V":
        raise TypeError(f"{what} is an array of {y.dtype}, not numbers: pass one of its fields.")
    shape = np.asarray(y).shape
    if len(shape) == 2 and shape[1] > 1:
        raise ValueError(
            f"{what} should be a 1d array, got an array of shape {shape} instead: a model "
            "has one output. sklearn.multioutput.MultiOutputRegressor(model) fits one for each "
            "column."
        )
    values = column_or_1d(unmasked(y), warn=warn)
    if values.dtype.kind not in "iufb":
        table = pd.DataFrame({output_name(y): values})
        check_numbers(table, what)
        values = without_text(table).iloc[:, 0].to_numpy(np.float64)
    if values.dtype not in dtypes:
        values = values.astype(np.float64)
    check_not_too_large(values, what)
    return values


def as_weights(given: Any, X: Any, n_rows: int) -> np.ndarray | None:
    """Weights of rows, checked; None where none are given, and one number is the same for all."""
    if given is None:
        return None
    weights = np.asarray(unmasked(given), dtype=np.float64)
    if weights.ndim == 0:
        weights = np.full(n_rows, weights)
    else:
        check_alignment(X, given, ("X", "sample_weight"))
    if weights.ndim != 1:
        raise ValueError(
            f"Sample weights must be 1D array or scalar; got sample_weight of shape "
            f"{weights.shape}, for {n_rows} rows of X."
        )
    if weights.size != n_rows:
        raise ValueError(
            f"sample_weight.shape == {weights.shape}, expected {(n_rows,)}: give one weight for "
            "each row of X, the rows without a measurement too."
        )
    bad = ~(np.isfinite(weights) & (weights >= 0.0))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"sample_weight is {weights[row]:g} in row {row}; weights must be finite numbers, 0 or "
            "more. 0 means that y was not measured."
        )
    return weights


def _dense(table: pd.DataFrame) -> pd.DataFrame:
    sparse = {n: t.subtype for n, t in table.dtypes.items() if isinstance(t, pd.SparseDtype)}
    return table.astype(sparse) if sparse else table


def unmasked(data: Any) -> Any:
    """Data with NaN where a mask says that nothing was measured."""
    if not isinstance(data, np.ma.MaskedArray):
        return data
    if not np.ma.is_masked(data):
        return data.data
    kind = np.float64 if data.dtype.kind in "iufb" else object  # which is refused by name
    return np.ma.filled(data.astype(kind), np.nan)


def check_not_too_large(values: np.ndarray, what: str, names: list[Any] | None = None) -> None:
    """Refuse finite values that are too large to compute with."""
    # float: the limit is none of float32, and -128 has no opposite in int8. NaN is told by column.
    if not values.size or max(float(values.max()), -float(values.min())) <= LARGEST:
        return
    sizes = _sizes(values)
    bad = np.flatnonzero((sizes > LARGEST) & (sizes < np.inf))
    if bad.size:
        raise ValueError(
            f"{_place(what, names, bad[0])} holds values of {sizes[bad[0]]:.6g}, too large to "
            f"compute with (at most {LARGEST:g}). Mark missing values by NaN, or use other units."
        )


def check_not_infinite(values: np.ndarray, what: str, names: list[Any] | None = None) -> None:
    """Refuse infinite values."""
    infinite = np.isinf(values)
    if infinite.any():
        row, column = np.argwhere(infinite.reshape(len(values), -1))[0].tolist()
        where = f"column {column if names is None else names[column]!r}, " if what == "X" else ""
        raise ValueError(
            f"Input {what} contains infinity or a value too large for dtype('float64'), first in "
            f"{where}row {row}. Mark missing values by NaN."
        )


def check_not_too_small(values: np.ndarray, what: str, names: list[Any] | None = None) -> None:
    """Refuse signals that are next to zero throughout, other than zero itself."""
    if (_sizes(values[:FIRST]) >= SMALLEST).all():
        return
    sizes = _sizes(values)
    bad = np.flatnonzero((sizes > 0) & (sizes < SMALLEST))
    if bad.size:
        raise ValueError(
            f"{_place(what, names, bad[0])} is never larger than {sizes[bad[0]]:.6g}, too small "
            f"to compute with (at least {SMALLEST:g}). Use other units, or zeros if it is at rest."
        )


def _sizes(values: np.ndarray) -> np.ndarray:
    """Largest size in each column, NaN where nothing is known."""
    table = values if values.ndim == 2 else values[:, None]
    if not table.size:
        return np.zeros(table.shape[1])
    sizes = np.fmax(np.fmax.reduce(table, axis=0), -np.fmin.reduce(table, axis=0))
    return sizes.astype(np.float64)


def _place(what: str, names: list[Any] | None, column: int) -> str:
    if what != "X":
        return what
    return f"Column {int(column) if names is None else names[column]!r} of X"


def _check_columns(X: pd.DataFrame, what: str = "X") -> None:
    if X.shape[1] == 0 and what == "X":
        raise ValueError(
            "X has no columns (0 feature(s), while a minimum of 1 is required): there is no input "
            "channel."
        )
    if not X.columns.is_unique:
        twice = X.columns[X.columns.duplicated()][0]
        raise ValueError(
            f"{int((X.columns == twice).sum())} columns of {what} are called {twice!r}; give each "
            "a different name."
        )


def check_numbers(table: pd.DataFrame, what: str) -> None:
    """Name the first entry of a table that is not a real number."""
    for position, dtype in enumerate(table.dtypes):
        if dtype.kind in "iufb":
            continue
        column = table.iloc[:, position]
        where = f"column {column.name!r} of {what}"
        if dtype.kind == "c":
            raise ValueError(
                f"Complex data not supported: {where} is complex; give its "
                "real and imaginary parts as two columns."
            )
        if dtype.kind in "mM":
            raise ValueError(f"The {where} holds times: give them as numbers, or another column.")
        if dtype.kind in "OSUT":
            try:
                column.to_numpy(dtype=np.float64)
            except (TypeError, ValueError, OverflowError) as error:
                row = next(i for i, entry in enumerate(column) if not _reads_as_number(entry))
                raise ValueError(
                    f"The {where} holds {column.iloc[row]!r} in row {row}, which is not "
                    "a number. Use another column, or mark missing values by NaN."
                ) from error


def without_text(table: pd.DataFrame) -> pd.DataFrame:
    """A table whose columns of text, which was checked to be numbers, are such, NaN if missing."""
    texts = [i for i, dtype in enumerate(table.dtypes) if isinstance(dtype, pd.StringDtype)]
    if texts:
        table = table.copy(deep=False)
        for i in texts:
            column = table.iloc[:, i].to_numpy(dtype=np.float64, na_value=np.nan)
            table.isetitem(i, column)
    return table


def refuse_objects(X: Any) -> None:
    """Name what an array or a list holds in place of numbers, if it is that."""
    listed = isinstance(X, (list, tuple))
    if not (listed or (isinstance(X, np.ndarray) and X.ndim > 0 and X.dtype.kind in "OSU")):
        return
    try:
        np.asarray(X, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        rows = [_entries(row) for row in X]
        for number, row in enumerate(rows):
            if len(row) != len(rows[0]):
                raise ValueError(
                    f"Row {number} of X holds {len(row)} values but row 0 holds {len(rows[0])}: "
                    "give all rows the same number, with NaN where one is missing."
                ) from error
            for position, entry in enumerate(row):
                if not _reads_as_number(entry):
                    kind = TypeError if isinstance(error, TypeError) else ValueError
                    raise kind(
                        f"Row {number} of X holds {reprlib.repr(entry)} in column {position}; each "
                        "argument must be a string of a number, or a number. Mark missing values "
                        "by NaN."
                    ) from error
        raise


def _entries(row: Any) -> list[Any]:
    return list(row) if isinstance(row, (list, tuple, np.ndarray)) else [row]


def _reads_as_number(entry: Any) -> bool:
    """Whether NumPy makes a float of an entry of a column; None is NaN."""
    try:
        np.array([entry], dtype=object).astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    return np.ndim(entry) == 0


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
