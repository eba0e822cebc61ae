"""Axes that are linear around zero and logarithmic beyond, with plain numbers at their ticks.

Open it to change how values that differ by powers of ten and by sign share a panel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from ._roles import GREY, scaled

LINEAR = 1.5  # decades that half of the linear part is as high as


def bend_axes(panels: Any, bend: float, every: np.ndarray) -> None:
    """Axes that are linear within ``bend`` of zero."""
    low, high = min(every.min(), -0.5 * bend), max(every.max(), 0.5 * bend)
    bottom, top = _further(low, bend), _further(high, bend)
    inner = bend * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    ticks = np.array([*-_beyond(-bottom, bend)[::-1], *inner, *_beyond(top, bend)])
    ticks = ticks[(ticks >= bottom) & (ticks <= top)]
    for panel in panels:
        panel.set_yscale("symlog", linthresh=bend, linscale=LINEAR)
        panel.set_ylim(bottom, top)
        panel.yaxis.set_major_locator(FixedLocator(ticks.tolist()))
        panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.yaxis.set_minor_locator(NullLocator())
        for edge in (-bend, bend):
            panel.axhline(edge, color=GREY, lw=scaled(0.6), alpha=0.6, zorder=1)


def round_up(value: float) -> float:
    """The next of 1, 2, 5, 10 ... that is not below."""
    if value <= 0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= 0.999 * value))


def _further(value: float, bend: float) -> float:
    """A limit a little beyond a value of a bent axis."""
    return 1.25 * value if abs(value) > bend else value + 0.15 * float(np.sign(value)) * bend


def _beyond(limit: float, bend: float) -> np.ndarray:
    """Ticks of the logarithmic part: its decades, or one where there is none."""
    decades = bend * 10.0 ** np.arange(1, 12)
    if (decades <= limit).any():
        return decades[decades <= limit]
    return bend * np.array([step for step in (5.0, 2.0) if step * bend <= limit][:1])
