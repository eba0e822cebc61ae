"""What plots over memory horizons share: the axis, and which values limits hold.

Open it to change the axis that ends in infinity.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from ._axes import letters_across
from ._roles import GREY, scaled

MOST_TICKS, LETTERS = 14, 5  # names of horizons, and letters that one takes
AFAR = 1.5  # octaves from the longest horizon to the infinite one
REACH = 3.0  # times the distance of best and median, within which limits hold the values


def horizon_axis(panel: Axes, horizons: np.ndarray) -> float:
    """A logarithmic axis of samples with infinity at its end; return where infinity stands."""
    horizons = np.unique(horizons)
    finite = horizons[np.isfinite(horizons)]
    infinite = float(finite[-1] * 2**AFAR) if finite.size else 2.0
    panel.set_xscale("log", base=2)
    inches = panel.get_window_extent().width / panel.figure.dpi
    ticks = _apart(finite, infinite, min(MOST_TICKS, letters_across(inches) // LETTERS))
    names = [f"{tick:g}" for tick in ticks]
    if finite.size < horizons.size:
        ticks, names = [*ticks, infinite], [*names, "∞"]
        if finite.size:
            middle = finite[-1] * 2 ** (AFAR / 2)
            panel.axvline(middle, color=GREY, lw=scaled(0.8), ls=":", zorder=1)
    panel.set_xticks(ticks, names, fontsize="small")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlim(min([*finite, infinite]) / 1.5, max([*ticks, *finite]) * 1.5)
    panel.set_xlabel("memory horizon $N_0$, samples")
    return infinite


def near_best(values: np.ndarray) -> np.ndarray:
    """The values of a line, the more the better, that are not far worse than its median."""
    best, median = values.max(), np.median(values)
    near: np.ndarray = values[values >= best - REACH * (best - median)]
    return near


def _apart(horizons: np.ndarray, last: float, most: int) -> list[float]:
    """Horizons that are far enough apart for a name each."""
    ticks: list[float] = []
    for horizon in horizons:
        gap = np.log2(last / horizons[0]) / max(most, 1)
        ends = np.log2(last / horizon) < 0.5 * gap  # too near to infinity's own name
        if not ticks or (np.log2(horizon / ticks[-1]) > 0.99 * gap and not ends):
            ticks.append(float(horizon))
    return ticks
