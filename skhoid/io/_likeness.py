"""Whether columns of numbers are one signal, or go with another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

__all__ = ["alike", "coherence", "equal", "factor_of", "moves", "numbers_of"]

_EXACT = 0.01  # of the spread of the smaller: what rounding in a file leaves of f_t - x - e


def numbers_of(raw: Any) -> np.ndarray:
    """A column as float64, NaN where there is no number."""
    series = raw if isinstance(raw, pd.Series) else pd.Series(np.ravel(raw))
    if series.dtype.kind in "mM":
        return np.full(len(series), np.nan)
    if series.dtype == object or not pd.api.types.is_numeric_dtype(series.dtype):
        texts = series.astype(str).str.replace(",", ".", regex=False)
        series = pd.to_numeric(texts, errors="coerce")
    if series.dtype.kind == "c":
        return np.full(len(series), np.nan)
    return series.to_numpy(dtype=float, na_value=np.nan)


def moves(values: np.ndarray) -> bool:
    """Whether a signal is ever another than at first."""
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) > 0)


def _spread(values: np.ndarray) -> float:
    """How much most values differ, whatever fill values there are."""
    return float(np.subtract(*np.quantile(values, [0.9, 0.1])))


def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two signals are the same but for rounding and a few rows."""
    if one.shape != other.shape:
        return False
    there = np.isfinite(one) & np.isfinite(other)
    if there.sum() < 3 or not moves(one[there]) or not moves(other[there]):
        return False
    apart = np.quantile(np.abs(one[there] - other[there]), 0.9)
    return bool(apart <= _EXACT * min(_spread(one[there]), _spread(other[there])))


def factor_of(one: np.ndarray, other: np.ndarray) -> float | None:
    """The factor between two signals that are otherwise the same."""
    there = np.isfinite(one) & np.isfinite(other)
    if one.shape != other.shape or there.sum() < 3 or not moves(other[there]):
        return None
    factor = float(one[there] @ other[there] / (other[there] @ other[there]))
    return factor if equal(one, factor * other) else None


def coherence(one: np.ndarray, other: np.ndarray) -> float:
    """Share of the changes of a signal that go with those of another, at whatever delay."""
    from scipy import signal

    there = np.isfinite(one) & np.isfinite(other)
    if one.shape != other.shape or there.sum() < 300 or not moves(one[there]):
        return 0.0
    changes = np.diff(one[there]), np.diff(other[there])
    n_rows = min(256, there.sum() // 8)
    with np.errstate(invalid="ignore", divide="ignore"):
        _, share = signal.coherence(*changes, nperseg=n_rows)
    power = signal.welch(changes[1], nperseg=n_rows)[1]
    return float(np.nansum(share * power) / power.sum()) if power.sum() else 0.0


def alike(signals: list[np.ndarray]) -> bool:
    """Whether columns are one signal, in other units."""
    first = signals[0]
    for other in signals[1:]:
        if other.shape != first.shape:
            return False
        there = np.isfinite(first) & np.isfinite(other)
        if there.sum() < 3 or not moves(first[there]) or not moves(other[there]):
            return False
        if np.corrcoef(first[there], other[there])[0, 1] < 0.9999:
            return False
    return True
