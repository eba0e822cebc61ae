"""When the parameters of a task change: the windows in which estimates are judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....simulation.task import change_times

WINDOWS = ("all", "before", "around", "after")
START = 15 / 81.92  # of the duration, which is left to methods to begin
BASELINE = 30.72 / 81.92  # of the duration, by which the estimate before a change is known
HALF_WIDTH = 1 / 8  # of the duration, on either side of the middle of a change
MARGIN = 1 / 16  # of the duration, at least, from its ends


@dataclass(frozen=True)
class Change:
    """When a task's parameters change, in seconds of the run.

    Parameters
    ----------
    start : float
        From when on estimates are judged.
    end : float
        Duration of the run.
    times : tuple of float or None
        When 5, 50 and 95 % of the way of all parameters have been gone; None if nothing changes.
    """

    start: float
    end: float
    times: tuple[float, float, float] | None

    @classmethod
    def of(cls, task: Any) -> Change:
        """Of a task."""
        return cls(START * task.duration, float(task.duration), change_times(task))

    @property
    def baseline(self) -> tuple[float, float]:
        """From when to when the level before a change is taken."""
        last = BASELINE * self.end
        if self.times is not None:
            last = min(last, self.times[0])
        return self.start, max(last, self.start)

    def windows(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """Which instants lie in each window.

        Parameters
        ----------
        time : ndarray of shape (n_instants,)

        Returns
        -------
        windows : dict of ndarray of bool
            ``"all"``, and if something changes ``"before"``, ``"around"`` and ``"after"``:
            around is an eighth of the duration on either side of the middle between 5 and 95 % of
            the change, or a sixteenth from these, whichever is longer.
        """
        judged = time >= self.start
        if self.times is None:
            return {"all": judged}
        early, _, late = self.times
        middle, taken = (early + late) / 2, (late - early) / 2
        half = max(HALF_WIDTH * self.end, taken + MARGIN * self.end)
        return {
            "all": judged,
            "before": judged & (time < middle - half),
            "around": judged & (time >= middle - half) & (time <= middle + half),
            "after": judged & (time > middle + half),
        }
