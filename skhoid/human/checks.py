"""Checks of physical parameters: finite, positive, or functions of time."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np


def as_floats(value: Any, what: str) -> np.ndarray:
    """One number or several as an array; anything else raises an error that names it."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise TypeError(f"{what} must hold numbers; got {value!r}.") from None


def check_finite(owner: Any, *names: str) -> None:
    """Raise unless these attributes are finite numbers."""
    for name in names:
        value = getattr(owner, name)
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not (number and -np.inf < value < np.inf):
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
