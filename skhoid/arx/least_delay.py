"""The least delay of channels that the output moves; with less, a model could reconstruct it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..runs import whole_samples
from ..runs.roles import of_person, role_of

HUMAN = 0.1  # s
DOMAINS = (None, "human", "machine")
FROM_X = "x is a function of the output, so a model could reconstruct the output from it"


@dataclass(frozen=True)
class LeastDelay:
    """Delay that the inputs of a model have at least, in samples of its grid and in seconds.

    ``loop`` are the inputs that the output moves; without any, nothing is bounded. ``closed`` says
    that the inputs together tell x, from which the output can be rebuilt.
    """

    samples: int
    seconds: float
    domain: str
    loop: tuple[Any, ...]
    closed: bool

    @property
    def reason(self) -> str:
        """Why, in words."""
        names = " and ".join(map(str, self.loop))
        if self.domain == "human":
            earliest = f"{self.seconds:.3g} s at the earliest"
            return f"a person responds to {names} after {earliest}; {FROM_X}"
        return f"the output moves {names}; {FROM_X}"

    def notes(self, best: Any, *, given: bool) -> list[str]:
        """What is to be said of a delay that was found or given, in samples."""
        shortest = int(np.min(best))
        if not self.samples or (given and not self.closed):
            return []
        if given and shortest < self.samples:
            return [
                f"The given delay, {shortest} samples, is shorter than the least delay, "
                f"{self.samples} ({self.seconds:.3g} s): {self.reason}. The fit may find the "
                "inverse of the controlled element."
            ]
        beside = 1 if self.domain == "human" else 0  # a minimum beside the limit is the limit's
        if not given and shortest <= self.samples + beside and self.closed:
            return [
                f"The estimated delay, {shortest} samples, is at its lower bound, {self.samples} "
                f"samples ({self.seconds:.3g} s): {self.reason}. It is not reliable."
            ]
        return []


def find_least_delay(
    inputs: Sequence[Any],
    columns: Sequence[Any],
    dt: float,
    *,
    seconds: float | None = None,
    domain: str | None = None,
    roles: Mapping[Any, Any] | None = None,
) -> LeastDelay:
    """The least delay of a model of ``inputs`` on a grid of ``dt``.

    ``seconds`` None takes 0.1 s of a person, and a sample of a machine; ``domain`` None takes data
    with an error and a target, or an error and x, to be of a person. In a person, delays from
    the eye to the hand that tracking experiments report are 0.1 to 0.25 s and more [McRuer & Jex
    1967; Boer & Kenyon 1998]. f_t alone comes from outside and is not bounded.
    """
    if domain not in DOMAINS:
        raise ValueError(f"domain must be 'human', 'machine' or None; got {domain!r}.")
    if seconds is not None and not (np.isfinite(seconds) and seconds >= 0):
        raise ValueError(f"least_delay must be zero or more, in seconds; got {seconds!r}.")
    of_inputs = {name: role_of(name, roles) for name in inputs}
    loop = tuple(name for name, role in of_inputs.items() if role in ("e", "x"))
    if domain is None:
        person = of_person(role_of(name, roles) for name in columns)
        domain = "human" if person else "machine"
    closed = "x" in of_inputs.values() or {"e", "f_t"} <= set(of_inputs.values())
    if not loop:
        return LeastDelay(0, 0.0, domain, loop, closed)
    if seconds is None:
        seconds = HUMAN if domain == "human" else dt
    samples = int(np.ceil(whole_samples(seconds, dt)))
    return LeastDelay(samples, samples * dt, domain, loop, closed)
