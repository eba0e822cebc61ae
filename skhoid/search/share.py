"""How much of the explainable gap effects close, with an interval."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from ..effects.record import Record
from .judges import BLOCK
from .leftover import SearchNumbers

HALF = float(norm.ppf(0.975))  # standard errors, of a 95 % interval


class Share(NamedTuple):
    """Share of the explainable gap that effects close, and its 95 % interval.

    Where the noise ceiling is not known, the gap reaches at least to what effects and free forms
    explain: the share is at most ``value``, and ``low`` is 0.

    Parameters
    ----------
    value, low, high : float
        From 0 to 1; NaN where no effect was added.
    of_ceiling : bool
        Whether the gap is that to the noise ceiling.

    Examples
    --------
    >>> from skhoid.search import Share
    >>> str(Share(0.93, 0.88, 0.98, of_ceiling=True))
    '93 % (88 to 98 %) of the gap to the noise ceiling'
    """

    value: float
    low: float
    high: float
    of_ceiling: bool

    def __str__(self) -> str:
        value, low, high = (f"{100 * number:.0f}" for number in self[:3])
        if not self.of_ceiling:
            return f"at most {value} % of the gap, since the noise ceiling is not known"
        return f"{value} % ({low} to {high} %) of the gap to the noise ceiling"


def find_share(found: SearchNumbers, record: Record) -> Share:
    """What the effects added close of the gap: by errors of blocks, and that of the ceiling."""
    first, last = found.steps[0], found.steps[-1]
    of_ceiling = bool(np.isfinite(found.ceiling))
    if not found.added:
        return Share(np.nan, np.nan, np.nan, of_ceiling)
    gained, left = last.vaf - first.vaf, found.worst
    if not of_ceiling:
        most = gained / (gained + left)
        return Share(most, 0.0, most, of_ceiling)
    left = max(found.ceiling - last.vaf, 0.0)
    sd = gain_error(record, first.prediction, last.prediction)
    share = gained / (gained + left)
    half = HALF * float(np.hypot(left * sd, gained * found.ceiling_sd)) / (gained + left) ** 2
    return Share(share, max(share - half, 0.0), min(share + half, 1.0), of_ceiling)


def gain_error(record: Record, before: np.ndarray, after: np.ndarray) -> float:
    """Standard error of the points of VAF that one simulation gains over another."""
    assert record.y is not None
    y = np.where(record.known, record.y, 0.0)
    gained = np.where(record.known, (y - before) ** 2 - (y - after) ** 2, 0.0)
    starts = np.arange(0, len(y), max(round(BLOCK / record.dt), 1))
    there = np.logical_or.reduceat(record.known, starts, axis=0)
    blocks = np.add.reduceat(gained, starts, axis=0)[there]
    spread = float(np.sqrt(blocks.size) * np.std(blocks, ddof=1)) if blocks.size > 1 else np.inf
    return 100 * spread / max(float((y**2).sum()), 1e-300)
