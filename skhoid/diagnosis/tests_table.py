"""``Test`` and the table of tests of a residual, with corrections for several tests."""

from __future__ import annotations

from dataclasses import KW_ONLY, asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Test:
    """Outcome of one test; ``cost`` in VAF points; a ``rule`` of thumb has no p."""

    test: str
    signal: str
    statistic: float
    p: float
    _: KW_ONLY
    where: float = np.nan
    size: float = np.nan
    cost: float = np.nan
    valid: bool = True
    description: str = ""
    rule: bool | None = None

    __test__ = False  # not a test of pytest


N_DRAWS = 2000
FALSE_ALARM = 0.01  # of each test, and of each table as a whole, with nothing missing
COLUMNS = (
    "test",
    "signal",
    "statistic",
    "p",
    "exceeds",
    "where",
    "size",
    "cost",
    "valid",
    "description",
)


def tests_table(tests: list[Test]) -> pd.DataFrame:
    frame = pd.DataFrame([asdict(test) for test in tests])
    if frame.empty:
        return pd.DataFrame(columns=list(COLUMNS))
    by_rule = np.array([test.rule is True for test in tests])
    frame["exceeds"] = frame["valid"] & ((frame["p"] < FALSE_ALARM) | by_rule)
    return frame[list(COLUMNS)]


def correct_for_several(p: np.ndarray, n: Any = None) -> np.ndarray:
    """P-values of ``n`` independent tests (None: all finite), corrected as by Sidak."""
    p = np.asarray(p, dtype=float)
    n = np.sum(np.isfinite(p)) if n is None else n
    return -np.expm1(n * np.log1p(-np.minimum(p, 1 - 1e-16)))


def of_one(false_alarm: Any, n: Any) -> Any:
    """Rate of each of n independent tests that together have a false-alarm rate."""
    return -np.expm1(np.log1p(-false_alarm) / n)


def draw_normals(covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Normal draws (rows) with a covariance; equal data are to have equal ones."""
    values, vectors = np.linalg.eigh(covariance)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return rng.standard_normal((N_DRAWS, len(covariance))) @ root.T
