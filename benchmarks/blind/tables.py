"""Shares, intervals and other figures as they stand in the tables."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.stats import beta


def clopper_pearson(k: int, n: int) -> tuple[float, float]:
    """The exact 95 % interval of a share of k in n, in percent."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return 100 * float(low), 100 * float(high)


def share(values: Iterable[bool]) -> str:
    """A percentage with its interval and counts."""
    values = list(values)
    k, n = sum(map(bool, values)), len(values)
    if not n:
        return "no cases"
    low, high = clopper_pearson(k, n)
    return f"{100 * k / n:.1f} % [{low:.1f}, {high:.1f}] ({k}/{n})"


def quantiles(values: Iterable[float], form: str = ".2f") -> str:
    """Median and the value that 90 % do not exceed."""
    values = list(values)
    if not values:
        return "no cases"
    return " / ".join(format(float(q), form) for q in np.percentile(values, [50, 90]))
