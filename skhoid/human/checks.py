"""Checks of physical parameters: finite, positive, or functions of time."""

from __future__ import annotations

from typing import Any

import numpy as np


def check_finite(owner: Any, *names: str) -> None:
    """Raise unless these attributes are finite numbers."""
    for name in names:
        value = getattr(owner, name)
        if isinstance(value, (str, bool)) or not np.isscalar(value) or not np.isfinite(value):
            raise ValueError(
                f"{type(owner).__name__}: {name} must be a finite number; got {value!r}."
            )


def check_positive(owner: Any, *names: str, zero: bool = False) -> None:
    """Raise unless these attributes are finite and positive (or zero)."""
    check_finite(owner, *names)
    for name in names:
        value = getattr(owner, name)
        if value < 0 or (value == 0 and not zero):
            what = "zero or positive" if zero else "positive"
            raise ValueError(f"{type(owner).__name__}: {name} must be {what}; got {value!r}.")


def check_parameters(owner: Any, *names: str, zero: bool = True) -> None:
    """Raise unless these parameters are functions of time, or positive numbers (or zero)."""
    for name in names:
        if not callable(getattr(owner, name)):
            check_positive(owner, name, zero=zero)
