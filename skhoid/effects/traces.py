"""Traces of effects in the output or the residual alone (levels, stops), found without a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .record import Record

PILED = 0.02  # least share of the samples that lie at a stop
AT_STOP = 1e-3  # standard deviations of the output within which a sample lies at a stop
NEAR_STOP = 0.05  # the same for samples a little below
PILED_RATES = 0.10  # least share of the rates that lie at the greatest rate
RECURRING = 0.02  # distinct values are levels if fewer than this share of the samples
COARSE = 0.1  # least step, in standard deviations of the output


@dataclass(frozen=True)
class Signature:
    """What a residual shows of an effect that is noise to the free run.

    Parameters
    ----------
    where : str
        Over what it shows, such as ``"frequency"``.
    share : float
        Of the output's variance.
    words : str
        What is seen, for tables.
    parameters : str
        Values of the effect's parameters with their units, for tables.

    See Also
    --------
    Effect : Its ``signature`` returns one.

    Examples
    --------
    >>> from skhoid.effects import Signature
    >>> Signature("frequency", 0.02, "a line at 9.0 Hz", "frequency = 9.00 Hz").share
    0.02
    """

    where: str
    share: float
    words: str
    parameters: str


def step_of(record: Record) -> float | None:
    """Typical distance between the levels that the output takes; None where it takes too many."""
    return record.once("step", lambda: _step(record))


def _step(record: Record) -> float | None:
    y, spread = _output(record)
    if spread == 0.0:
        return None
    rounded = np.unique(np.round(y / spread, 6))
    if rounded.size < 2 or rounded.size > RECURRING * y.size:
        return None
    step = float(np.median(np.diff(rounded)))
    return step * spread if step > COARSE else None


class Stop(NamedTuple):
    """Samples of the output at a stop.

    Attributes
    ----------
    share : float
        Of all samples.
    limit : float
        Size of the output there.
    where : str
        The stop in words, with its sign: both where the output stops to either side.
    """

    share: float
    limit: float
    where: str


def stop_of(record: Record) -> Stop | None:
    """Where samples of the output pile up; None where they do not."""
    return record.once("stop", lambda: _stop(record))


def _stop(record: Record) -> Stop | None:
    y, spread = _output(record)
    if spread == 0.0 or step_of(record) is not None:
        return None
    found = []
    for side in (1.0, -1.0):
        top = float(np.max(side * y))
        below = top - side * y
        there = float(np.mean(below < AT_STOP * spread))
        near = float(np.mean(below < NEAR_STOP * spread)) - there
        # A wave that turns is slow at its top too, but as many samples are a little below.
        if top > 0.0 and there > PILED / 2 and there > near:
            found.append((there, top, side))
    if not found:
        return None
    share, limit, side = max(found)
    where = f"{side * limit:.3g}"
    if len(found) == 2 and abs(found[0][1] - found[1][1]) < NEAR_STOP * spread:
        share, where = found[0][0] + found[1][0], f"±{limit:.3g}"
    return Stop(share, limit, where) if share > PILED else None


def fastest_of(record: Record) -> tuple[float, float] | None:
    """Share of the rates that lie at the greatest rate, and that rate per second."""
    return record.once("fastest", lambda: _fastest(record))


def _fastest(record: Record) -> tuple[float, float] | None:
    if record.y is None or step_of(record) is not None:
        return None
    rates = np.abs(np.diff(record.y, axis=0))[record.known[1:] & record.known[:-1]] / record.dt
    top = float(np.quantile(rates, 0.998)) if rates.size else 0.0
    if not top > 0.0:
        return None
    share = float(np.mean(np.abs(rates - top) < 2e-3 * top))
    return (share, top) if share > PILED_RATES else None


def _output(record: Record) -> tuple[np.ndarray, float]:
    if record.y is None:
        return np.zeros(1), 0.0
    y = record.y[record.known]
    return y, float(np.std(y)) if y.size else 0.0
