"""What fits may cost: rows simulated for one candidate of a search, and the seconds of a search."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

# Of a record, for one candidate: of those tried in runs of people and machines, relays and steps
# among them, the costliest took 2,413 (stiction, of a relay).
MOST_SIMULATIONS = 5000


class OutOfTimeError(Exception):
    """The time of a search is over; caught where its candidates are tried."""


@dataclass
class Effort:
    """Rows that may still be simulated, and the time at which a search stops trying."""

    rows: float
    until: float


_effort: ContextVar[Effort | None] = ContextVar("effort", default=None)


@contextmanager
def bounded(rows: int, until: float = float("inf")) -> Iterator[None]:
    """Fits inside end early, with the best so far, after ``MOST_SIMULATIONS`` of so many rows.

    They do not depend on how fast the machine is. ``until`` is a time of ``time.monotonic()``, at
    which the next simulation raises :class:`OutOfTimeError`.
    """
    token = _effort.set(Effort(MOST_SIMULATIONS * rows, until))
    try:
        yield
    finally:
        _effort.reset(token)


def spend(rows: int) -> None:
    """Say that rows are simulated."""
    effort = _effort.get()
    if effort is not None:
        effort.rows -= rows
        if time.monotonic() > effort.until:
            raise OutOfTimeError


def is_spent() -> bool:
    """Whether fits are to end with the best so far."""
    effort = _effort.get()
    return effort is not None and effort.rows < 0
