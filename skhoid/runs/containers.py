"""Containers that are not tables of channels; add one here to refuse it by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy.sparse import issparse

ARRAY_LIKE = ("__len__", "shape", "__array__")


def refuse_container(X: Any) -> None:
    """Refuse by name what is not a table of channels, and say what to pass instead."""
    if isinstance(X, pd.Series):
        raise ValueError("X is a Series, but a 2-dimensional table is needed: pass X.to_frame().")
    library = type(X).__module__.partition(".")[0]
    if isinstance(X, dict) and not issparse(X):  # scikit-learn refuses sparse ones, some dicts
        instead = "pandas.DataFrame(X)"
    elif library == "pyarrow":
        instead = "X.to_pandas()"
    elif isinstance(X, np.ndarray) and X.dtype.kind == "V":  # structured, or bytes without a type
        instead = "pandas.DataFrame(X), or a plain array of numbers"
    elif library == "polars" and hasattr(X, "collect"):
        instead = "X.collect()"
    elif isinstance(X, (str, bytes)) or not any(hasattr(X, name) for name in ARRAY_LIKE):
        instead = "a DataFrame or an array with one row per sample"
    else:
        return
    raise TypeError(
        f"X is a {type(X).__name__}, which is not supported: pass {instead}, best with levels "
        "'run' and 'time' in its index."
    )
