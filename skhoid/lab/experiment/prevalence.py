"""How many people have which effect: evidence of each person, and a prevalence of the group.

Random-effects model selection (Stephan et al., 2009, doi 10.1016/j.neuroimage.2009.03.025; for
single effects that are there or not, as in the prevalence of Donhauser et al., 2018): the data of
a person are more likely with some effects than with others, by the map that gives a name its
probability, and how many people of the population have an effect is estimated along. Evidence adds
up over people, and what is rare in the group asks for more evidence in one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.special import expit, logit

from ...effects import Effect
from ...search import log_factor, log_lead

CAP = 6.0  # logarithm of the odds of one person, at most: no record is beyond doubt
GRID = (np.arange(400) + 0.5) / 400  # prevalence
ROUNDS, TOLERANCE = 200, 1e-4  # of the logarithm of odds


@dataclass(frozen=True)
class PersonEvidence:
    """What is known of one person: the effects that a search named, and the table of evidence.

    ``effects`` has all of them by id.
    """

    named: tuple[str, ...]
    table: pd.DataFrame
    effects: Mapping[str, Effect]

    @cached_property
    def known(self) -> dict[str, dict[str, float]]:
        """Evidence of each effect, by what it would stand in place of (or ``""``)."""
        found: dict[str, dict[str, float]] = {}
        columns = (self.table[name] for name in ("instead_of", "effect", "evidence"))
        for out, effect, evidence in zip(*columns, strict=True):
            if np.isfinite(evidence):
                found.setdefault(str(out), {})[str(effect)] = float(evidence)
        return found

    def states(self) -> list[tuple[frozenset[str], float]]:
        """Sets of effects that may be the person's, with log Bayes factors over what was named.

        What was named, with one effect more, without one, or with one in place of another.
        """
        base, effects = frozenset(self.named), self.effects
        found = [(base, 0.0)]
        for out, known in self.known.items():
            more = {e: (effects[e], nats) for e, nats in known.items() if e not in base}
            if not out:
                found += [(base | {e}, log_factor(*one)) for e, one in more.items()]
            elif out in base and out in known:
                own, rest = (effects[out], known[out]), base - {out}
                found.append((rest, -log_factor(*own)))
                found += [(rest | {e}, log_lead(one, own)) for e, one in more.items()]
        return found

    def knows(self, effect: str) -> bool:
        """Whether the person's data can tell anything about an effect."""
        return effect in self.named or any(effect in known for known in self.known.values())


@dataclass(frozen=True)
class JoinedEvidence:
    """What all conditions together say of one person: log Bayes factors of effects."""

    factors: Mapping[str, float]

    def states(self) -> list[tuple[frozenset[str], float]]:
        """No effect, or one, with log Bayes factors over none."""
        return [(frozenset(), 0.0), *((frozenset({e}), f) for e, f in self.factors.items())]

    def knows(self, effect: str) -> bool:
        """Whether the person's data can tell anything about an effect."""
        return effect in self.factors


@dataclass(frozen=True)
class Prevalence:
    """The share of people who have an effect, and who they are.

    ``has`` has the probability that each person has it (NaN where the data cannot tell), ``low``
    and ``high`` are the ends of a credible interval of the share of the population.
    """

    effect: str
    has: np.ndarray
    share: float
    low: float
    high: float
    posterior: np.ndarray

    @property
    def n_people(self) -> int:
        return int(np.isfinite(self.has).sum())

    @property
    def n_with(self) -> int:
        return int((self.has > 0.5).sum())

    def more_than(self, share: float) -> float:
        """Probability that more than a share of people have it."""
        return float(self.posterior[share < GRID].sum())


def prevalences(
    people: Sequence[PersonEvidence | JoinedEvidence], effects: Sequence[str]
) -> list[Prevalence]:
    """The prevalence of each effect, in their order, all estimated together."""
    states = [person.states() for person in people]
    members = [
        np.array([[effect in state for effect in effects] for state, _ in one], dtype=bool)
        for one in states
    ]
    weights = [np.array([weight for _, weight in one]) for one in states]
    known = np.array([[person.knows(effect) for effect in effects] for person in people])
    odds = np.zeros(len(effects))  # logarithms
    factors = np.zeros((len(people), len(effects)))
    for _ in range(ROUNDS):
        has = np.array([_has(*one, odds) for one in zip(members, weights, strict=True)])
        factors = np.clip(logit(has), -3 * CAP, 3 * CAP) - odds
        posteriors = [_posterior(factors[known[:, e], e]) for e in range(len(effects))]
        means = np.array([float(GRID @ p) for p in posteriors])
        before, odds = odds, logit(np.clip(means, 1e-9, 1 - 1e-9))
        if np.abs(odds - before).max(initial=0.0) < TOLERANCE:
            break
    found = []
    for e, effect in enumerate(effects):
        low, high = _interval(posteriors[e])
        of_people = np.where(known[:, e], has[:, e], np.nan)
        found.append(Prevalence(effect, of_people, float(means[e]), low, high, posteriors[e]))
    return found


def _has(members: np.ndarray, weights: np.ndarray, odds: np.ndarray) -> np.ndarray:
    """Probability of each effect of a person, from the sets that contain it."""
    score = weights + members @ odds
    share = np.exp(score - score.max())
    share /= share.sum()
    return np.clip(share @ members, expit(-3 * CAP), expit(3 * CAP))


def _posterior(factors: np.ndarray) -> np.ndarray:
    """Posterior of the prevalence over the grid, from log Bayes factors; uniform before."""
    # Of a person: r B + 1 - r.
    score = np.logaddexp(np.log(GRID)[:, None] + factors[None, :], np.log1p(-GRID)[:, None]).sum(
        axis=1
    )
    found = np.exp(score - score.max())
    return found / found.sum()


def _interval(posterior: np.ndarray) -> tuple[float, float]:
    """The 95 % credible interval."""
    ends = GRID + 0.5 / GRID.size  # of the cells of the grid
    low, high = np.interp([0.025, 0.975], np.cumsum(posterior), ends)
    return float(low), float(high)


def summed(
    people: Sequence[Sequence[PersonEvidence]], effects: Sequence[str]
) -> list[JoinedEvidence]:
    """Each person over all conditions, as if the effects were the same in all of them.

    Evidence of an effect adds up over the conditions.
    """
    return [
        JoinedEvidence(
            {
                effect: float(
                    sum(_find_factor(cell, effect) for cell in cells if cell.knows(effect))
                )
                for effect in effects
                if any(cell.knows(effect) for cell in cells)
            }
        )
        for cells in people
    ]


def _find_factor(cell: PersonEvidence, effect: str) -> float:
    """Log Bayes factor for an effect in one condition, whatever else there is."""
    states = cell.states()
    inside = [weight for state, weight in states if effect in state]
    outside = [weight for state, weight in states if effect not in state]
    if not inside or not outside:
        return CAP if inside else -CAP
    # The best of each kind: how many others were tried says nothing.
    return float(np.clip(max(inside) - max(outside), -CAP, CAP))
