"""Whether the rows of ``y`` are those of ``X``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunIndexError
from .clock import TIME
from .marks import is_mark

SET_OUTPUT_HINT = (
    "A scikit-learn transformer that returns NumPy arrays drops the row index; call "
    '.set_output(transform="pandas") on the pipeline to keep it, and use Decimator, DelayShift and '
    "RunInTrimmer as steps of the pipeline itself, not in one branch of a ColumnTransformer."
)


def check_alignment(X: Any, y: Any, names: tuple[str, str] = ("X", "y")) -> None:
    """Refuse ``y`` whose row index disagrees with that of ``X``."""
    x_name, y_name = names
    y_index = getattr(y, "index", None)
    if not isinstance(y_index, pd.Index):
        return
    x_index = getattr(X, "index", None)
    if not isinstance(x_index, pd.Index):
        x_index = None
    y_has_runs = TIME in y_index.names
    if x_index is None or TIME not in x_index.names:
        if y_has_runs:
            raise RunIndexError(
                f"{y_name} has a run and time index but {x_name} has none, so the runs of {x_name} "
                "are lost. " + SET_OUTPUT_HINT
            )
        if x_index is None:
            return
    elif y_index.nlevels == 1 and y_index.dtype.kind in "iu" and y_index.is_monotonic_increasing:
        return  # row numbers, as slices of a plain Series keep them
    if x_index is y_index:
        return
    marks = [name for name in x_index.names if is_mark(str(name))]
    plain = x_index.droplevel(marks) if marks else x_index
    if len(plain) != len(y_index) or plain.equals(y_index):
        return  # unequal lengths are reported by scikit-learn
    if plain.nlevels != y_index.nlevels:
        detail = (
            f"the levels are {list(plain.names)} in {x_name} and {list(y_index.names)} in {y_name}"
        )
    else:
        row = int(np.flatnonzero([a != b for a, b in zip(plain, y_index, strict=True)])[0])
        labels = [_plain_label(index[row]) for index in (plain, y_index)]
        detail = (
            f"the first difference is in row {row}: {labels[0]} in {x_name}, "
            f"{labels[1]} in {y_name}"
        )
    raise RunIndexError(
        f"The row indexes of {x_name} and {y_name} disagree; {detail}. Give both the same rows in "
        f"the same order ({y_name} = {y_name}.loc[{x_name}.index]), or pass {y_name} as an array "
        "if its index means nothing."
    )


def _plain_label(label: Any) -> Any:
    parts = label if isinstance(label, tuple) else (label,)
    return tuple(part.item() if isinstance(part, np.generic) else part for part in parts)
