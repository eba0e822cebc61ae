"""How probable a name is: one map from the evidence of a step to probabilities.

The map is a conditional logit (McFadden 1974) over what may be true: each effect that has any
evidence, "nothing", and "something else". Its few coefficients are fitted to cases whose truth is
known, by ``python -m benchmarks.calibrate``, which writes them to ``probability.json``.

Evidence of tens of nats would be certainty if models had no errors. So what counts is the logarithm
of how far it leads the other names.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from ..effects.base import Effect

TABLE = "probability.json"
MOST_TIMES = 10  # the runs there are: nobody records more for one name
# Of places that data tell apart.
FAMILIES = {
    "delay": "in time",
    "gain": "in time",
    "input": "of the error",
    "path": "path",
    "sum": "path",
}
BEHIND = "behind the delay"  # all other places
NAMES = [
    *sorted({*FAMILIES.values(), BEHIND}),  # an effect of this family
    "loop could not be asked",
    "lead over all others",  # signed log(1 + nats)
    "lead over what is not easily taken for it",
    "nothing",
    "nothing: log evidence of the best",
    "something else",
    "something else: lead of a shape",
]
# The greater the evidence, the more probable: signs that the fit must keep.
SIGNS = {
    "lead over all others": 1,
    "lead over what is not easily taken for it": 1,
    "nothing: log evidence of the best": -1,
    "something else: lead of a shape": 1,
}


@dataclass(frozen=True)
class Alternative:
    """An effect that a step tried.

    Parameters
    ----------
    effect : Effect
        What it is; a free form stands for "something else".
    evidence : float
        The least that any judge grants it, in nats.
    asked : bool
        Whether the closed loop could judge it.
    """

    effect: Effect
    evidence: float
    asked: bool = True


class Chances(NamedTuple):
    """Probabilities of what a step may have found; together they are one."""

    names: list[float]
    nothing: float
    something_else: float


def find_chances(
    tried: Sequence[Alternative], coefficients: Mapping[str, float] | None = None
) -> Chances:
    """Probabilities that each of some effects, nothing or something else is there.

    Parameters
    ----------
    tried : sequence of Alternative
        All that a step tried.
    coefficients : mapping or None, default=None
        By name; None means those of the table.

    Returns
    -------
    chances : Chances
        Of names in the order of ``tried``; a free form has none of its own.
    """
    at, features = describe_step(tried)
    known = load_table()["coefficients"] if coefficients is None else coefficients
    utility = features @ np.array([known[name] for name in NAMES])
    shares = np.exp(utility - utility.max())
    shares /= shares.sum()
    names = np.zeros(len(tried))
    names[at] = shares[:-2]
    return Chances(names.tolist(), float(shares[-2]), float(shares[-1]))


def name_probability(tried: Sequence[Alternative], chances: Chances, i: int) -> float:
    """Probability that a name is right, or one that is easily taken for it."""
    likely = zip(tried, chances.names, strict=True)
    return float(sum(p for one, p in likely if alike(one.effect, tried[i].effect)))


def runs_to_decide(
    tried: Sequence[Alternative], i: int, n_runs: int, confidence: float
) -> int | None:
    """How many more runs like these would make a name so probable, if it is right.

    Parameters
    ----------
    tried : sequence of Alternative
        All that a step tried.
    i : int
        Which of them.
    n_runs : int
        Runs that gave the evidence, which grows in proportion to their number.
    confidence : float
        Probability that is wanted.

    Returns
    -------
    more : int or None
        None where ten times the runs would not do.
    """
    for more in np.unique(np.geomspace(1, MOST_TIMES * n_runs, 50).round().astype(int)):
        grown = [replace(one, evidence=one.evidence * (1 + more / n_runs)) for one in tried]
        if name_probability(grown, find_chances(grown), i) >= confidence:
            return int(more)
    return None


def describe_step(tried: Sequence[Alternative]) -> tuple[list[int], np.ndarray]:
    """Which alternatives have evidence, and a row of features for each, nothing, something else."""
    evidence = np.array([one.evidence for one in tried])
    free = np.array([one.effect.free_form for one in tried], dtype=bool)
    at = [i for i in range(len(tried)) if evidence[i] > 0 and not free[i]]
    best = max((evidence[i] for i in at), default=0.0)
    shape = max(evidence[free & (evidence > 0)], default=0.0)
    rows = [
        {
            FAMILIES.get(tried[i].effect.place, BEHIND): 1.0,
            "loop could not be asked": float(not tried[i].asked),
            "lead over all others": signed_log(evidence[i] - best_beside(tried, i)),
            "lead over what is not easily taken for it": signed_log(
                evidence[i] - best_beside(tried, i, but_alike=True)
            ),
        }
        for i in at
    ]
    rows.append({"nothing": 1.0, "nothing: log evidence of the best": np.log1p(best)})
    lead = max(signed_log(shape - best), 0.0)
    rows.append({"something else": 1.0, "something else: lead of a shape": lead})
    return at, np.array([[row.get(name, 0.0) for name in NAMES] for row in rows])


def best_beside(tried: Sequence[Alternative], i: int, *, but_alike: bool = False) -> float:
    """The greatest evidence of others, or of those not easily taken for it; at least 0."""
    others = [one for j, one in enumerate(tried) if j != i]
    if but_alike:
        others = [one for one in others if not alike(one.effect, tried[i].effect)]
    return max([0.0, *(one.evidence for one in others if one.evidence > 0)])


def alike(one: Effect, other: Effect) -> bool:
    """Whether two effects are the same or known to be easily taken for each other."""
    return one.name == other.name or any(
        b.name in (*a.within, *a.told_apart) for a, b in ((one, other), (other, one))
    )


def signed_log(nats: float) -> float:
    """Sign and log(1 + size)."""
    return float(np.sign(nats) * np.log1p(abs(nats)))


@cache
def load_table() -> dict[str, Any]:
    """The coefficients, and where they come from."""
    return json.loads(files(__package__).joinpath(TABLE).read_text(encoding="utf-8"))
