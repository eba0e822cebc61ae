"""The mixed model of one parameter: fitted, with the tests of its conditions, as arrays.

Open it for which random effects there are, and for what is asked of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from ._kenward_roger import FTest, KenwardRoger
from ._reml import At, equations, reml
from .rows import Cells, Rows

ADJUSTED = ("holm", "bonferroni", "fdr", "none")
SUBJECT = "between people"


@dataclass(frozen=True)
class Contrasts:
    """Differences of pairs of conditions (positions), with their t tests."""

    pairs: list[tuple[int, int]]
    difference: np.ndarray
    se: np.ndarray
    df: np.ndarray
    p: np.ndarray

    @property
    def t(self) -> np.ndarray:
        return self.difference / self.se


@dataclass(frozen=True)
class Fitted:
    """A fitted model, and its tests. ``groups`` names its random effects."""

    rows: Rows
    groups: tuple[str, ...]
    at: At
    kr: KenwardRoger

    @property
    def design(self) -> np.ndarray:
        return np.eye(len(self.rows.conditions))[self.rows.condition]

    def variance(self, group: str) -> float:
        """Variance of a random effect; 0 where the model has none."""
        return float(self.at.variances[self.groups.index(group)]) if group in self.groups else 0.0

    def residuals(self) -> np.ndarray:
        """What the fixed and the random effects leave, in standard deviations of the cell."""
        rows = self.rows
        rest = rows.y - self.design @ self.at.beta
        if self.groups:
            rest = rest - self.at.predicted()[rows.subject]
        return rest * np.sqrt(rows.weights / self.at.variances[-1])

    def omnibus(self) -> FTest | None:
        """All conditions are the same."""
        n = len(self.rows.conditions)
        return self.kr.test(np.eye(n)[1:] - np.eye(n)[:1]) if n > 1 else None

    def contrasts(self, reference: int | None) -> Contrasts:
        """All pairs, or all against the reference."""
        n = len(self.rows.conditions)
        pairs = [(j, i) for i, j in combinations(range(n), 2)]
        if reference is not None:
            pairs = [(i, reference) for i in range(n) if i != reference]
        L = np.array([np.eye(n)[i] - np.eye(n)[j] for i, j in pairs]).reshape(-1, n)
        difference, se, df = self.kr.rows(L)
        return Contrasts(pairs, difference, se, df, 2.0 * stats.t.sf(abs(difference / se), df))


def adjusted(p: np.ndarray, adjust: str) -> np.ndarray:
    """p-values that pay for their number.

    multipletests of statsmodels, which tests hold this to, collects garbage at each call: 0.1 s.
    """
    if adjust == "none" or p.size < 2:
        return p
    if adjust == "bonferroni":
        return np.minimum(p.size * p, 1.0)
    if adjust == "fdr":
        return stats.false_discovery_control(p)
    order = np.argsort(p)
    steps = np.maximum.accumulate((p.size - np.arange(p.size)) * p[order])
    holm = np.empty(p.size)
    holm[order] = np.minimum(steps, 1.0)
    return holm


def fit(rows: Rows) -> Fitted:
    """Fit it by REML; people are a random effect where some have several conditions."""
    groups = (SUBJECT,) if rows.y.size > len(rows.subjects) else ()
    design = np.eye(len(rows.conditions))[rows.condition]
    try:
        at = reml(equations(rows.y, design, [rows.subject for _ in groups], rows.weights))
    except ValueError as error:
        raise ValueError(f"The mixed model of {rows.parameter} cannot be fitted: {error}") from None
    return Fitted(rows, groups, at, KenwardRoger(at))


def without(rows: Rows, subject: Any) -> Rows | None:
    """The same cells without a person; None where too few people, or a condition less, are left."""
    kept = rows.subject != rows.subjects.index(subject)
    subjects = [name for name in rows.subjects if name != subject]
    if len(subjects) < 2 or np.unique(rows.condition[kept]).size < len(rows.conditions):
        return None
    cells = Cells(*(column[kept] for column in rows.cells))
    renumbered = np.unique(cells.subject, return_inverse=True)[1]
    return replace(rows, cells=cells._replace(subject=renumbered), subjects=subjects)
