"""How free runs begin: at rest, or as the inputs and outputs of a recording show."""

from __future__ import annotations

import numpy as np

from ..preprocessing.grid import ModelGrid

REST, HELD, ESTIMATE = "rest", "held", "estimate"
SHARE_OF_ERROR, SHARE_OF_POWER = 0.1, 0.01  # by which a start must lower the squares to be taken


def pays(rest: float, other: float, y: np.ndarray) -> bool:
    """Whether another start reduces the squares enough to show that runs do not begin at rest.

    ``y`` is all that was measured; its power about the mean says how much that is.
    """
    if not y.size:
        return False
    moves = y - y.mean()
    power = float(np.square(moves, out=moves).sum())
    return bool(rest - other > max(SHARE_OF_ERROR * rest, SHARE_OF_POWER * power))


def held_level(a: np.ndarray, drive: np.ndarray, levels: tuple[float, float]) -> np.ndarray:
    """Output at rest under a constant drive, within limits; 0, or next to it, where there is none.

    A slow or integrating model amplifies its errors, so a level that the output never had is not
    believed.
    """
    rest = np.clip(np.zeros_like(drive), *levels)
    if levels[0] == levels[1]:
        return rest
    return np.clip(drive / a.sum(), *levels) if is_stable(a) else rest


def is_stable(denominator: np.ndarray) -> bool:
    """Whether all poles lie inside the unit circle, and none of them integrates."""
    poles = np.roots(denominator)
    return bool((np.abs(poles) < 1.0 - 1e-6).all())


def measured_rows(grid: ModelGrid, most: int | None = None) -> np.ndarray:
    """Rows outside run-ins, or the first ``most`` of each stretch."""
    rows = np.zeros(grid.n_rows, dtype=bool)
    for begin, end in zip(grid.begin[grid.measured], grid.end[grid.measured], strict=True):
        rows[begin : end if most is None else min(end, begin + most)] = True
    return rows
