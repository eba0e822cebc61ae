"""When the parameters of a task change."""

from __future__ import annotations

import numpy as np

from ..human.variation import evaluate
from .physics import parameters_of
from .task import CompensatoryTask

SHARES = (0.05, 0.5, 0.95)  # of the change
NOTHING = 1e-9  # of relative steps, summed


def change_times(task: CompensatoryTask) -> tuple[float, float, float] | None:
    """Seconds after which 5, 50 and 95 % of the change are done; None if nothing changes.

    The change is the way of all parameters, but for the gain of the remnant: the sum of their steps
    relative to their largest values.
    """
    t = np.arange(task.n_samples + 1) / task.sampling_rate
    travelled = np.zeros(task.n_samples)
    for name, parameter in parameters_of(task).items():
        if callable(parameter) and name != "K_n":
            values = evaluate(parameter, t)
            travelled += np.abs(np.diff(values)) / (np.abs(values).max() or 1.0)
    so_far = np.cumsum(travelled)
    if so_far[-1] <= NOTHING:
        return None
    early, middle, late = (float(t[np.searchsorted(so_far, s * so_far[-1])]) for s in SHARES)
    return early, middle, late
