"""How a report was made: versions, settings, and a fingerprint of the data."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from sklearn.base import BaseEstimator

from ..._version import __version__
from ...runs.fingerprint import fingerprint

LIBRARIES = ("numpy", "scipy", "scikit-learn", "pandas", "numba", "matplotlib")


def provenance(model: Any, X: Any, y: Any, made_with: dict[str, str] | None) -> dict[str, str]:
    """What is needed to make the same report again, by name."""
    stated = {name[:1].upper() + name[1:]: str(text) for name, text in (made_with or {}).items()}
    others = [f"{name} {version(name)}" for name in LIBRARIES]
    made = {
        "Date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "Python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "Libraries": ", ".join([f"skhoid {__version__}", *others]),
        "Data (SHA-256 of X, y)": fingerprint(X, y),
        **{f"Settings of {name}": text for name, text in settings(model).items()},
    }
    return stated | {name: text for name, text in made.items() if name not in stated}


def settings(model: Any, name: str = "") -> dict[str, str]:
    """All parameters of the estimator and of what is inside it, by class and name there."""
    title = type(model).__name__ + (f" ({name})" if name else "")
    if not isinstance(model, BaseEstimator):
        return {title: repr(model)}
    given = model.get_params(deep=False)
    inside = {k: v for k, v in given.items() if isinstance(v, BaseEstimator)}
    inside |= {k: v for k, v in given.get("steps", []) if isinstance(v, BaseEstimator)}
    own = {k: v for k, v in given.items() if k not in inside and k != "steps"}
    found = {title: ", ".join(f"{k}={' '.join(repr(v).split())}" for k, v in own.items())}
    for key, value in inside.items():
        found |= settings(value, key)
    return found
