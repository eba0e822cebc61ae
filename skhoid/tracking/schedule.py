"""Schedule: the known functions of a scheduling signal in which coefficients are linear.

Open it for what ``LPVARX(basis=...)`` may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import issparse
from sklearn.base import clone
from sklearn.preprocessing import PolynomialFeatures

from ..arx.rls import grid_numbers
from ..preprocessing.grid import ModelGrid

TIME = "time"  # the scheduling that is no channel


@dataclass(frozen=True)
class Schedule:
    """A basis as a user gives it, fitted if it is a transformer."""

    basis: Any
    channels: list[str]
    descriptions: list[str]

    @classmethod
    def fitted(cls, basis: Any, degree: int, signal: np.ndarray, channels: list[str]) -> Schedule:
        """Check a basis on a signal of shape (n, n_channels) without NaN, and fit transformers."""
        if len(signal) == 0:
            raise ValueError(
                f"scheduling {', '.join(map(repr, channels))} contains NaN in all rows: nothing "
                "was measured."
            )
        if isinstance(basis, str):
            basis = PolynomialFeatures(1 if basis == "linear" else degree)
        if hasattr(basis, "transform"):
            basis = clone(basis).fit(signal)
            names = [str(n) for n in basis.get_feature_names_out(channels)]
            return cls(basis, channels, names)
        if not callable(basis) and not all(map(callable, basis)):
            raise ValueError(
                f"basis must be 'linear', 'polynomial', a function, a list of functions, or a "
                f"transformer; got {basis!r}."
            )
        n_functions = cls(basis, channels, [])._evaluated(signal).shape[1]
        if isinstance(basis, Sequence):
            return cls(basis, channels, ["1", *map(_name, basis)])
        argument = signal[:, 0] if signal.shape[1] == 1 else signal
        if np.ndim(basis(argument.copy())) == 1:
            return cls(basis, channels, ["1", _name(basis)])
        return cls(basis, channels, [f"{_name(basis)}[{j}]" for j in range(n_functions)])

    def described(self) -> list[str]:
        return [f"{j}: {text}" for j, text in enumerate(self.descriptions)]

    def functions(self, signal: np.ndarray) -> np.ndarray:
        """Functions of a signal (n, n_channels), of shape (n, n_functions); NaN where it is."""
        known = ~np.isnan(signal).any(axis=1)
        values = np.full((len(signal), len(self.descriptions)), np.nan)
        if known.any():
            found = self._evaluated(signal[known])
            if found.shape[1] != values.shape[1]:
                raise ValueError(
                    f"basis gave {values.shape[1]} functions in fit, and now {found.shape[1]}."
                )
            values[known] = found
        return values

    def _evaluated(self, signal: np.ndarray) -> np.ndarray:
        if hasattr(self.basis, "transform"):
            found = self.basis.transform(signal)
            return np.asarray(found.toarray() if issparse(found) else found, dtype=np.float64)
        argument = signal[:, 0] if signal.shape[1] == 1 else signal
        if not isinstance(self.basis, Sequence):
            return _checked(self.basis, argument, may_be_table=True)
        columns = [_checked(f, argument, may_be_table=False)[:, 1] for f in self.basis]
        return np.column_stack([np.ones(len(signal)), *columns])


def _checked(function: Any, argument: np.ndarray, *, may_be_table: bool) -> np.ndarray:
    """Values of a function, with 1 before them where it gives one number per row."""
    name, n = _name(function), len(argument)
    try:
        values = np.asarray(function(argument.copy()), dtype=np.float64)
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise ValueError(
            f"The basis {name} failed for the array s of {argument.shape} values ({error}). It is "
            "called with all rows at once: choose between values with np.where, not if."
        ) from error
    allowed = (n,) == values.shape or (may_be_table and values.ndim == 2 and len(values) == n)
    if not allowed or (values.ndim == 2 and values.shape[1] == 0):
        wanted = f"({n},) or ({n}, n_functions)" if may_be_table else f"({n},)"
        raise ValueError(
            f"The basis {name} returned the shape {values.shape} for the scheduling s of shape "
            f"{argument.shape}. It must return {wanted}."
        )
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values.reshape(n, -1)).all(axis=1))[0])
        raise ValueError(
            f"The basis {name} is not finite for s = {argument[row]}. It must be finite wherever s "
            "is."
        )
    return np.column_stack([np.ones(n), values]) if values.ndim == 1 else values


def _name(function: Any) -> str:
    return str(getattr(function, "__name__", repr(function)))


def grid_times(grid: ModelGrid) -> np.ndarray:
    """Time in the run in seconds of each row of a grid."""
    return grid_numbers(grid) * grid.dt
