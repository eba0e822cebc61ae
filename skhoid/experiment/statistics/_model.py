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
from .rows import Rows

ADJUSTED = ("holm", "bonferroni", "fdr", "none")
SUBJECT, CELL = "between people", "people x condition"


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
        """What the fixed and the random effects leave, in standard deviations of the row."""
        rows = self.rows
        rest = rows.y - self.design @ self.at.beta
        for name, part in zip(self.groups, self.at.parts, strict=True):
            rest = rest - self.at.predicted()[part][codes_of(rows, name)]
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


def codes_of(rows: Rows, group: str) -> np.ndarray:
    return rows.subject if group == SUBJECT else rows.cell


def fit(rows: Rows) -> Fitted:
    """Fit it by REML.

    People are a random effect where some have several rows, and person x condition where some
    have several in a condition, and conditions differ within people.
    """
    n_subjects, n_cells = len(rows.subjects), int(rows.cell.max()) + 1
    groups = [SUBJECT] * (len(rows.used) > n_subjects)
    groups += [CELL] * (rows.repeated and n_cells > n_subjects)
    design = np.eye(len(rows.conditions))[rows.condition]
    try:
        data = equations(rows.y, design, [codes_of(rows, name) for name in groups], rows.weights)
        at = reml(data)
    except ValueError as error:
        raise ValueError(f"The mixed model of {rows.parameter} cannot be fitted: {error}") from None
    return Fitted(rows, tuple(groups), at, KenwardRoger(at))


def without(rows: Rows, subject: Any) -> Rows | None:
    """The same rows without a person; None where too few people, or a condition less, are left."""
    kept = rows.subject != rows.subjects.index(subject)
    subjects = [name for name in rows.subjects if name != subject]
    if len(subjects) < 2 or np.unique(rows.condition[kept]).size < len(rows.conditions):
        return None
    return replace(
        rows,
        used=rows.used[kept],
        subjects=subjects,
        subject=np.unique(rows.subject[kept], return_inverse=True)[1],
        condition=rows.condition[kept],
        cell=np.unique(rows.cell[kept], return_inverse=True)[1],
    )
