"""What a search can say, as enumerations: its verdict, what became of a candidate, and why."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import NamedTuple

UNKNOWN = "unknown"  # the last of ``best_effects_`` where something has no name


class Verdict(Enum):
    """How a search ends; ``str()`` of it is a sentence, and the last three leave something unnamed.

    ``NOTHING`` is not that nothing is there: ``limits_`` says how large what was tried may be.
    ``TOO_LITTLE`` is for a best model whose held-out VAF is below half of the noise ceiling, or,
    where that is not known, below 5 % (both about the mean).

    Compare with the members: ``search.verdict_ is Verdict.NOTHING``.

    Examples
    --------
    >>> from skhoid.search import Verdict
    >>> str(Verdict.NOTHING), Verdict.NOTHING.leaves_unknown
    ('nothing found', False)
    """

    NOTHING = "nothing found"
    FOUND = "effects found"
    POSSIBLE = "something is missing, and no name for it is sure"
    TOO_LITTLE = "the model explains too little to say"
    NOT_IN_CATALOGUE = "something is missing, not in the catalogue"
    NOT_TRIED = "something is missing, not among the effects tried"
    CUT_SHORT = "something is missing, and max_effects is reached"

    @classmethod
    def beyond(cls, tries_all: bool) -> Verdict:
        """That of what has no name, where the whole catalogue was tried or a part of it."""
        return cls.NOT_IN_CATALOGUE if tries_all else cls.NOT_TRIED

    @property
    def leaves_unknown(self) -> bool:
        """Whether something is missing that has no name."""
        return self not in (Verdict.NOTHING, Verdict.FOUND, Verdict.TOO_LITTLE)

    @property
    def kind(self) -> str:
        """``"nothing"``, ``"found"`` or ``"unknown"``."""
        if self.leaves_unknown or self is Verdict.TOO_LITTLE:
            return "unknown"
        return "found" if self is Verdict.FOUND else "nothing"

    def __str__(self) -> str:
        return self.value

    def __eq__(self, other: object) -> bool:
        # The sentence was the verdict once: a comparison with it would be false without a word.
        if isinstance(other, str) and other in [str(one) for one in Verdict]:
            raise TypeError(
                f"A verdict is no longer a sentence. Write search.verdict_ is "
                f"Verdict.{Verdict(other).name} (from skhoid.search import Verdict), or compare "
                "str(search.verdict_)."
            )
        return self is other

    __hash__ = Enum.__hash__


class Status(StrEnum):
    """What became of a candidate of a search.

    Examples
    --------
    >>> from skhoid.search import Status
    >>> Status("added") is Status.ADDED
    True
    """

    ADDED = "added"
    NOT_BETTER = "not better"
    REFUSED = "does not apply"
    NOT_FITTED = "could not be fitted"
    NOT_TRIED = "not tried"

    @classmethod
    def of(cls, reason: Reason) -> Status:
        """That of a candidate that was not added for a reason."""
        return {
            Reason.REFUSED: cls.REFUSED,
            Reason.NOT_FITTED: cls.NOT_FITTED,
            Reason.TIME: cls.NOT_TRIED,
        }.get(reason, cls.NOT_BETTER)


class Reason(StrEnum):
    """Why a candidate was not added.

    Examples
    --------
    >>> from skhoid.search import Reason
    >>> Reason("rival_added").counts, Reason.AT_BOUND.counts
    (True, False)
    """

    NONE = ""
    REFUSED = "does_not_apply"  # the effect says what it needs
    TOO_LITTLE = "too_little"  # ΔBIC or points on held-out rows
    NOT_DETERMINED = "not_determined"  # the data leave its numbers open
    AT_BOUND = "at_bound"
    NOT_SEEN = "not_seen"  # nothing shows of it with the number at which it ended
    MAY_BE_ZERO = "may_be_zero"
    REBUILDS = "rebuilds_output"  # from x, by the inverse of the controlled element
    REFUTED = "refuted"  # by instruments, or by a noise model that is estimated along
    SUPERFLUOUS = "superfluous"  # once later effects are there
    RIVAL = "rival_added"  # it counts, and another was added instead
    NOT_FOLLOWED = "not_followed"  # its fit was only begun: others have more
    NOT_FITTED = "not_fitted"  # arithmetic failed, such as overflow
    TIME = "time_limit"  # which was reached before
    CUT_SHORT = "max_effects"  # it counts, and no more effects may be added

    @property
    def counts(self) -> bool:
        """Whether the candidate meets all criteria in spite of it."""
        return self in (Reason.RIVAL, Reason.CUT_SHORT)


TRIED = (Status.ADDED, Status.NOT_BETTER)  # candidates that were fitted and judged


class Against(NamedTuple):
    """What speaks against a candidate, as a code and in words."""

    code: Reason
    text: str


@dataclass(frozen=True)
class Ending:
    """The end of a search: ids of effects that are named, and of those that stand in for others."""

    verdict: Verdict
    named: list[str]
    stand_ins: list[str]

    @property
    def best_effects(self) -> list[str]:
        return [*self.named, UNKNOWN] if self.verdict.leaves_unknown else self.named
