"""Conditions compared by how many people have an effect there."""

from __future__ import annotations

from itertools import combinations

import pandas as pd
from scipy.stats import binomtest

from ..statistics._model import adjusted

COLUMNS = (
    "effect",
    "condition",
    "other",
    "n_people",
    "n_with",
    "n_other",
    "only_here",
    "only_there",
    "p",
    "p_adjusted",
)


def condition_contrasts(members: pd.DataFrame) -> pd.DataFrame:
    """For each effect and pair of conditions an exact McNemar test over people with both."""
    rows = []
    for effect, table in members.groupby("effect", sort=False):
        has = table.pivot_table(
            index="subject", columns="condition", values="has", sort=False, aggfunc="first"
        )
        for here, there in combinations(has.columns, 2):
            both = has[[here, there]].dropna().astype(bool)
            a, b = both[here].to_numpy(), both[there].to_numpy()
            only_here, only_there = int((a & ~b).sum()), int((~a & b).sum())
            n = only_here + only_there
            p = float(binomtest(only_here, n).pvalue) if n else 1.0
            row = (effect, here, there, len(both), int(a.sum()), int(b.sum()))
            rows.append((*row, only_here, only_there, p))
    found = pd.DataFrame(rows, columns=COLUMNS[:-1])
    return found.assign(p_adjusted=adjusted(found["p"].to_numpy(dtype=float), "holm"))
