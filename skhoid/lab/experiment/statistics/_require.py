"""The optional package behind these statistics, and the error where it is missing."""

from __future__ import annotations

import importlib
from typing import Any


def require(module: str, what: str) -> Any:
    """Import a module of statsmodels, or say which extra installs it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f'{what} needs the package {module.split(".")[0]}: pip install "skhoid[statistics]"'
        ) from error
