"""What conditions are combinations of, and what a factor changes in each person."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from .rows import Cells, Rows, cautious, paule_mandel


def list_pairs(conditions: Sequence[Any], reference: Any) -> list[tuple[int, int]]:
    """Positions of all pairs of conditions, or of all with the reference."""
    n = len(conditions)
    if reference is None:
        return [(j, i) for i, j in combinations(range(n), 2)]
    if reference not in conditions:
        raise ValueError(
            f"reference is one of {', '.join(map(str, conditions))}; got {reference!r}."
        )
    at = list(conditions).index(reference)
    return [(i, at) for i in range(n) if i != at]


def find_factors(conditions: Sequence[Any]) -> dict[str, dict[Any, Any]]:
    """Factors that the names of conditions are combinations of, if all of them are there.

    By the words of the names: ``{"fast/slow": {"fast_tired": "fast", ...}, ...}``.
    """
    words = [re.split(r"[\s_/+,.-]+", str(name)) for name in conditions]
    if len(set(map(len, words))) > 1:
        return {}
    places = [place for place in zip(*words, strict=True) if len(set(place)) > 1]
    if len(places) < 2 or math.prod(len(set(place)) for place in places) != len(conditions):
        return {}
    found: dict[str, dict[Any, Any]] = {}
    for place in places:
        name = "/".join(dict.fromkeys(place))
        name = f"{name} ({len(found) + 1})" if name in found else name
        found[name] = dict(zip(conditions, place, strict=True))
    return found


Factors = Mapping[str, Mapping[Any, Any]] | Sequence[str]


def read_factors(rows: Rows, factors: Factors | None) -> dict[str, dict[Any, Any]]:
    """The level of each condition, by factor: given, in columns of the table, or in names."""
    if factors is None:
        return find_factors(rows.conditions)
    found: dict[str, dict[Any, Any]] = {}
    for name in factors:
        if isinstance(factors, Mapping):
            levels = dict(factors[name])
        elif name in rows.table:
            pairs = rows.table[["condition", name]].drop_duplicates()
            several = pairs.loc[pairs["condition"].duplicated(), "condition"]
            if len(several):
                raise ValueError(f"{several.iloc[0]} has several levels of the factor {name!r}.")
            levels = dict(pairs.itertuples(index=False, name=None))
        else:
            raise ValueError(f"The table has no column {name!r} for a factor.")
        unknown = [str(condition) for condition in rows.conditions if condition not in levels]
        if unknown:
            raise ValueError(f"The factor {name!r} has no level for {', '.join(unknown)}.")
        found[name] = {condition: levels[condition] for condition in rows.conditions}
    return found


class Step(NamedTuple):
    """From a level of a factor to another, or from one such difference to another.

    ``weights`` are those of the conditions.
    """

    factor: str
    level: str
    against: str
    weights: np.ndarray


def list_steps(factors: Mapping[str, Mapping[Any, Any]], reference: Any) -> list[Step]:
    """Differences between all levels (or those with the level of a reference), and interactions.

    An interaction is what a factor changes in one level of another less what it does in another.
    """
    where = {
        name: {
            level: np.array([one == level for one in levels.values()], dtype=float)
            for level in levels.values()
        }
        for name, levels in factors.items()
    }
    pairs = {
        name: [
            (list(own)[j], list(own)[i])
            for j, i in list_pairs(list(own), factors[name].get(reference))
        ]
        for name, own in where.items()
    }
    steps = [
        Step(name, str(a), str(b), _mean(where[name][a]) - _mean(where[name][b]))
        for name, own in pairs.items()
        for a, b in own
    ]
    for one, other in combinations(factors, 2):
        for a, b in pairs[one]:
            for c, d in pairs[other]:
                apart = [
                    _mean(where[one][here] * where[other][c])
                    - _mean(where[one][here] * where[other][d])
                    for here in (a, b)
                ]
                said = (f"{one} x {other}", f"{c} - {d} in {a}", f"in {b}")
                steps.append(Step(*said, apart[0] - apart[1]))
    return [step for step in steps if np.isfinite(step.weights).all()]


def _mean(chosen: np.ndarray) -> np.ndarray:
    """Weights of a mean over chosen conditions; NaN where there is none."""
    with np.errstate(invalid="ignore"):
        return chosen / chosen.sum()


def find_answers(cells: Cells, weights: np.ndarray) -> tuple[tuple[float, float, float], list[int]]:
    """Mean over people of a weighted sum of conditions: estimate, se, df; and who lacks one."""
    n = int(cells.subject.max()) + 1
    values, errors = (np.full((n, weights.size), np.nan) for _ in range(2))
    values[cells.subject, cells.condition] = cells.value
    errors[cells.subject, cells.condition] = cells.error
    used = weights != 0.0
    whole = np.isfinite(values[:, used]).all(axis=1)
    lacking = np.flatnonzero(~whole).tolist()
    own = values[whole][:, used] @ weights[used]
    if own.size < 2 or np.ptp(own) <= 1e-9 * np.abs(values[whole]).max():  # nothing to test it by
        return (np.nan, np.nan, np.nan), lacking
    w = np.ones(own.size)
    spread = np.sqrt(errors[whole][:, used] ** 2 @ weights[used] ** 2)
    if np.isfinite(spread).all():
        beyond = paule_mandel(
            own, spread, lambda w: own - w @ own / w.sum(), cautious(own.size - 1)
        )
        w = 1.0 / (spread**2 + beyond)
    mean = float(w @ own / w.sum())
    se = float(np.sqrt(w @ (own - mean) ** 2 / ((own.size - 1.0) * w.sum())))
    return (mean, se, own.size - 1.0), lacking
