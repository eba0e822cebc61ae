"""Whether a judge can know an effect: the evidence it is expected to grant one that is there.

A judge that would not see an effect of the size in question has nothing to say against it. What it
would see is what no fit of the parent imitates: with a target alone, an answer to the target and
one to x are nearly the same closed loop, and a parent with the one leaves little of the other.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.stats import norm

from ..model.fitting import Criterion, minimise
from ..model.model import Model

ITERATIONS = 8  # from each of two starts; the parent begins near its best
SURELY = float(norm.ppf(0.9))  # standard deviations, below which one of ten lies


def expected_evidence(parent: Model, model: Model, criterion: Criterion, variance: float) -> float:
    """Log likelihood in nats by which a model would exceed its parent if it were true.

    The parent is fitted to what the model puts out at its parameters. Both are of one judge: free
    runs or loops of the same record, with squares and noise model of the judge's ``criterion``,
    whose whitened residuals have a ``variance``. NaN where the model does not settle.
    """
    output = model.output
    if not np.isfinite(output).all():
        return np.nan
    imitating = copy(criterion)
    imitating.y = output[:: criterion.thin]
    known = {**parent.values(), **model.values()}
    starts = [parent.theta, np.array([known[name] for name in parent.simulator.names])]
    left = [
        minimise(parent.simulator, imitating, start, max_iter=ITERATIONS, tol=1e-3).sse
        for start in starts
    ]
    return min(left) / (2 * variance)


def could_know(expected: float, penalty: float, asked: float) -> bool:
    """Whether nine of ten effects with so much expected would be granted the evidence asked.

    All in nats: log likelihood ``expected`` has a standard deviation of √(2 · ``expected``), and
    the ``penalty`` for more parameters is taken from it.
    """
    return bool(expected - SURELY * np.sqrt(2 * expected) - penalty > asked)
