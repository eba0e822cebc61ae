"""The verdict of a search: when an effect is named, and when something is still missing."""

from __future__ import annotations

from dataclasses import dataclass

from .search_numbers import SearchNumbers
from .statuses import Verdict

# Structure left counts as unknown if it exceeds so many points (about the mean) and the first share
# of what could be explained. Above the second share the effects found do not name it: several
# effects that leave something may together imitate what is missing. That share grows with what
# they gain, up to the third, since hardly anything else imitates much. The first of several may
# stay named.
BESIDE_ONE = (0.6, 0.1, 0.12, 0.5)
BESIDE_SEVERAL = (0.4, 0.04, 0.04, 0.25)
MUCH = 10.0  # points about the mean, for which the last share holds


@dataclass(frozen=True)
class Ending:
    """The end of a search: ids of effects that are named, and of those that stand in for others."""

    verdict: Verdict
    named: list[str]
    stand_ins: list[str]

    @property
    def best_effects(self) -> list[str]:
        return [*self.named, "unknown"] if self.verdict.leaves_unknown else self.named


def decided(found: SearchNumbers, *, tries_all: bool) -> Ending:
    """Whether what was found can be named, and whether something else is missing."""
    ids, stand_ins, worst = found.ids, [], found.worst
    share = worst / max(worst + found.gained, 1e-300)
    limits = BESIDE_SEVERAL if len(found.added) > 1 else BESIDE_ONE
    least, small = limits[:2]
    large = largest_left(limits, found.gained, found)
    left = worst >= least * found.share and share > small
    if not (left or found.one_cause):
        return Ending(Verdict.FOUND if ids else Verdict.NOTHING, ids, [])
    if found.one_cause:
        ids, stand_ins = [], ids
    elif share > large:
        kept = 1 if len(found.added) > 1 and first_explains(found) else 0
        ids, stand_ins = ids[:kept], ids[kept:]
    if found.path.steps[-1].best is not None:
        return Ending(Verdict.CUT_SHORT, ids, stand_ins)
    return Ending(unnamed(tries_all), ids, stand_ins)


def unnamed(tries_all: bool) -> Verdict:
    """The verdict of a search that leaves something without a name."""
    return Verdict.NOT_IN_CATALOGUE if tries_all else Verdict.NOT_TRIED


def first_explains(found: SearchNumbers) -> bool:
    """Whether the first effect would stay named on its own: later ones take nothing from it."""
    gained = found.steps[1].vaf - found.steps[0].vaf
    left = found.worst + found.gained - gained
    return left <= largest_left(BESIDE_ONE, gained, found) * (left + gained)


def largest_left(
    limits: tuple[float, float, float, float], gained: float, found: SearchNumbers
) -> float:
    """Share of what could be explained that may be left when a named effect gains so much."""
    return max(limits[2], limits[3] * min(gained / (MUCH * found.share), 1.0))
