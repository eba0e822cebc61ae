"""What fast motion says about a controlled element: its gain, and which sample of u moves x first.

A disturbance is smooth and the response to it late: what x does within a tenth of a second is due
to u.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.record import Record
from ..human import LinearElement

FAST = 0.15  # s over which motion is averaged and compared with that before
FEWEST = 50  # known rows of a run
SURE = 3.0  # standard errors
CLOSE = 0.4  # of the share of a sample's answer, to one and to zero


@dataclass(frozen=True)
class FastMotion:
    """Fast motion of x compared with what u would cause through an element.

    ``gain`` is 1 for a true element, ``agreement`` is the squared correlation.
    """

    gain: float
    sd: float
    agreement: float


def fast_motion(element: LinearElement, record: Record, u: np.ndarray, x: np.ndarray) -> FastMotion:
    """Compare changes of denominator x and numerator u, as averages over some samples."""
    b, a = element.discrete(record.dt)
    m = max(1, round(FAST / record.dt))
    made, seen = np.zeros(0), np.zeros(0)
    for j in range(record.n_runs):
        span = known_span(record, j)
        if span is not None and span.stop - span.start > b.size + 2 * m:
            made = np.append(made, _changes(np.convolve(u[span, j], b, "valid"), m))
            seen = np.append(seen, _changes(np.convolve(x[span, j], a, "valid"), m))
    power = float(made @ made)
    if not power > 0:
        return FastMotion(0.0, np.inf, 0.0)
    gain = float(made @ seen) / power
    error = seen - gain * made
    # Averages over m samples overlap.
    sd = np.sqrt(float(error @ error) / power / max(len(made) / (2 * m) - 1, 1))
    agreement = 1 - float(error @ error) / max(float(seen @ seen), 1e-300)
    return FastMotion(gain, float(sd), agreement)


def _changes(signal: np.ndarray, m: int) -> np.ndarray:
    averages = np.convolve(signal, np.full(m, 1 / m), "valid")
    return averages[m:] - averages[:-m]


def given_element(given: Any, record: Record) -> LinearElement:
    """An element given by the user, with the timing found in the data."""
    element = LinearElement.of(given)
    names = record.with_role("x")
    if not names or record.y is None:
        return element
    return with_timing(element, record, record.y, record.channels[names[0]])


def with_timing(
    element: LinearElement, record: Record, u: np.ndarray, x: np.ndarray
) -> LinearElement:
    """The element with ``direct`` from the data: whether x(k) already depends on u(k).

    The part of x that one sample of u moves is compared with u at both samples, by their changes:
    a disturbance is smooth.
    """
    if element.dt is not None or len(element.numerator) == len(element.denominator):
        return element
    b, a = replace(element, direct=False).discrete(record.dt)
    now, before, moved = [], [], []
    for j in range(record.n_runs):
        span = known_span(record, j)
        if span is None:
            continue
        # b[0] is zero: the late answer of sample k is the early one of sample k - 1.
        early = np.convolve(u[span, j], b[1:])[b.size : u[span, j].size]
        left = np.convolve(x[span, j], a)[b.size : x[span, j].size]
        early, left = np.diff(early), np.diff(left)
        now.append(early[1:])
        before.append(early[:-1])
        moved.append(left[1:])
    if not now:
        return element
    table = np.stack([np.concatenate(now), np.concatenate(before)], 1)
    answer = np.concatenate(moved)
    share, *_ = np.linalg.lstsq(table, answer, rcond=None)
    error = answer - table @ share
    normal = np.linalg.pinv(table.T @ table)
    contrast = np.array([1.0, -1.0])
    sd = np.sqrt(error @ error / max(len(error) - 2, 1) * contrast @ normal @ contrast)
    # For a true element one share is 1 and the other 0; a wrong element proves nothing.
    surely = share[0] - share[1] > SURE * sd and np.abs(share - [1.0, 0.0]).max() < CLOSE
    return replace(element, direct=bool(surely))


def known_span(record: Record, j: int) -> slice | None:
    known = np.flatnonzero(record.known[:, j])
    return slice(known[0], known[-1] + 1) if known.size >= FEWEST else None
