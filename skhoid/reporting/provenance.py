"""How a report was made: versions, settings, and a fingerprint of the data."""

from __future__ import annotations

import hashlib
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator

LIBRARIES = ("skhoid", "numpy", "scipy", "scikit-learn", "pandas", "numba", "matplotlib")


def provenance(model: Any, X: Any, y: Any, made_with: dict[str, str] | None) -> dict[str, str]:
    """What, by which name, to make the same report again."""
    told = {name[:1].upper() + name[1:]: str(text) for name, text in (made_with or {}).items()}
    told["Date"] = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    told["Python"] = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    told["Libraries"] = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    told["Data (SHA-256 of X, y)"] = fingerprint(X, y)
    return told | {f"Settings of {name}": text for name, text in settings(model).items()}


def settings(model: Any, name: str = "") -> dict[str, str]:
    """All parameters of the estimator and of what is inside it, by class and name there."""
    title = type(model).__name__ + (f" ({name})" if name else "")
    if not isinstance(model, BaseEstimator):
        return {title: repr(model)}
    given = model.get_params(deep=False)
    inside = {k: v for k, v in given.items() if isinstance(v, BaseEstimator)}
    inside |= {k: v for k, v in given.get("steps", []) if isinstance(v, BaseEstimator)}
    own = {k: v for k, v in given.items() if k not in inside and k != "steps"}
    told = {title: ", ".join(f"{k}={' '.join(repr(v).split())}" for k, v in own.items())}
    for key, value in inside.items():
        told |= settings(value, key)
    return told


def fingerprint(X: Any, y: Any) -> str:
    """Hash of index, names and values, in the order of rows; numbers as 64-bit floats."""
    digest = hashlib.sha256()
    for data in (X, y):
        table = pd.DataFrame(data)
        for name, column in table.reset_index().items():
            values = column.to_numpy()
            if np.issubdtype(values.dtype, np.number):
                content = np.ascontiguousarray(values, dtype=float).tobytes()
            else:  # run labels that are words
                content = repr(values.tolist()).encode()
            digest.update(repr(name).encode() + content)
    return digest.hexdigest()
