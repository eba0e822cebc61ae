"""How probable a name is: one map from the evidence of a step to probabilities.

The map is a conditional logit (McFadden 1974) over what may be true: each effect that has any
evidence, "nothing", and "something else". Its few coefficients are fitted to cases whose truth is
known, by ``python -m benchmarks.calibrate``, which writes them to ``probability.json``.

Evidence of tens of nats would be certainty if models had no errors. So what counts is the logarithm
of how far it leads the other names. Where an effect acts was tried beside it, and made the figures
of forms that the fit had not seen worse.
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
from .judging import THRESHOLD

TABLE = "probability.json"
CERTAIN = 2 * THRESHOLD  # nats: behind it errors of models count, and forms left out
LITTLE = 1e-9  # nats, in the place of none: names with none are not weighed
N_APPLYING = 27  # effects that apply in most cases of the table, with e, x and the target
MOST_ASKED = 1e4  # nats: what strong effects in long records have
MOST_TIMES = 10  # the runs there are: nobody records more for one name
# Each coefficient, and the sign that the fit must keep: more evidence is never less probable.
# "Nothing" has utility 0 where there is no evidence at all.
COEFFICIENTS = {
    "a name": 0,
    "a name: lead": 1,  # over what is not easily taken for it; sign and log(1 + nats)
    "nothing: evidence of the best": -1,  # nats, up to ``CERTAIN``
    "something else": 0,
    "something else: lead of a shape": 1,  # over the best name
    "something else: left by the names": 1,  # log(1 + nats)
}


@dataclass(frozen=True)
class Alternative:
    """An effect that a step tried, and the least evidence that any judge grants it, in nats.

    None is "something else": its evidence is that of a free form, and ``left`` are nats of what the
    names found leave, by :func:`skhoid.search.instruments.weigh_curved`.
    """

    effect: Effect | None
    evidence: float
    left: float = 0.0


class Chances(NamedTuple):
    """Probabilities of what a step may have found; together they are one."""

    names: list[float]  # in the order of what was tried; what is no effect has none of its own
    nothing: float
    something_else: float


def find_chances(
    tried: Sequence[Alternative], coefficients: Mapping[str, float] | None = None
) -> Chances:
    """Probabilities of all that a step tried; coefficients are those of the table unless given."""
    at, features = describe_features(tried)
    known = load_table()["coefficients"] if coefficients is None else coefficients
    utility = features @ np.array([known[name] for name in COEFFICIENTS])
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
    """How many more runs like these would make a name as probable as asked, if it is right.

    Evidence grows in proportion to the runs. None where ten times the runs would not do.
    """
    for more in np.unique(np.geomspace(1, MOST_TIMES * n_runs, 50).round().astype(int)):
        times = 1 + more / n_runs
        grown = [replace(o, evidence=o.evidence * times, left=o.left * times) for o in tried]
        if name_probability(grown, find_chances(grown), i) >= confidence:
            return int(more)
    return None


def find_needed(effect: Effect, confidence: float) -> float:
    """Nats from which an effect without rivals is as probable as asked; infinite where none are."""
    nats = np.geomspace(1.0, MOST_ASKED, 100)
    found = [find_chances([Alternative(effect, one)]).names[0] for one in nats.tolist()]
    return float(np.append(nats, np.inf)[np.searchsorted(found, confidence)])


def log_factor(effect: Effect, evidence: float) -> float:
    """Logarithm of the Bayes factor of an effect with so many nats against nothing.

    Odds of the map over those before any data: of the share of names, each of ``N_APPLYING`` has
    its part. With no evidence it is of how often effects have none, if there and if not.
    """
    if not evidence > 0.0:
        unseen = load_table()["unseen"]
        return float(np.log(unseen["there"] / unseen["not there"]))
    chances, shares = find_chances([Alternative(effect, evidence)]), load_table()["shares"]
    odds = chances.names[0] / chances.nothing
    return float(np.log(N_APPLYING * odds * shares["nothing"] / shares["name"]))


def log_lead(one: tuple[Effect, float], other: tuple[Effect, float]) -> float:
    """Logarithm of the odds of an effect with its evidence against another in its place."""
    tried = [Alternative(effect, max(evidence, LITTLE)) for effect, evidence in (one, other)]
    names = find_chances(tried).names
    return float(np.log(names[0] / names[1]))


def describe_features(tried: Sequence[Alternative]) -> tuple[list[int], np.ndarray]:
    """Which names have evidence, and a row of features for each, nothing, something else."""
    evidence = np.array([one.evidence for one in tried])
    at = [i for i, one in enumerate(tried) if one.effect is not None and one.evidence > 0]
    best = max((evidence[i] for i in at), default=0.0)
    others = [one for one in tried if one.effect is None]
    shape = max((one.evidence for one in others), default=0.0)
    left = max((one.left for one in others), default=0.0)
    rows: list[dict[str, float]] = []
    for i in at:
        rivals = [evidence[j] for j in at if not alike(tried[j].effect, tried[i].effect)]
        lead = evidence[i] - max([0.0, *rivals])
        rows.append({"a name": 1.0, "a name: lead": of_lead(lead)})
    rows.append({"nothing: evidence of the best": min(best, CERTAIN)})
    other = {"lead of a shape": of_lead(max(shape, 0.0) - best), "left by the names": of_lead(left)}
    rows.append({"something else": 1.0} | {f"something else: {k}": v for k, v in other.items()})
    return at, np.array([[row.get(name, 0.0) for name in COEFFICIENTS] for row in rows])


def of_lead(nats: float) -> float:
    """A lead as it counts: tens of nats would be certainty if models had no errors."""
    return float(np.sign(nats) * np.log1p(abs(nats)))


def alike(one: Effect | type[Effect] | None, other: Effect | type[Effect] | None) -> bool:
    """Whether two effects are the same or known to be easily taken for each other."""
    if one is None or other is None:
        return one is other
    return one.name == other.name or any(
        b.name in (*a.within, *a.told_apart) for a, b in ((one, other), (other, one))
    )


@cache
def load_table() -> dict[str, Any]:
    """The coefficients, and where they come from."""
    return json.loads(files(__package__).joinpath(TABLE).read_text(encoding="utf-8"))
