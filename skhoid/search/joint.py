"""ΔBIC of an effect by likelihood, with jointly estimated noise models."""

from __future__ import annotations

import numpy as np

from ..model.fitting import Criterion
from ..model.likelihood import likeliest, usual_starts
from ..model.model import Model

RATES = (12.5, 6.25)  # Hz: faster, errors of sensors and simulation count more than the remnant
LOST = 10.0  # by which a larger model that has not been fitted well is worse


class JointParent:
    """A model against which others are judged by likelihood.

    The remnant comes back in the error, and the noise model of a simulation-error fit holds the
    bias which that makes. Here each model has the noise model with which it is likeliest. What is
    likely at one rate only is an error of the simulation or of a sensor, or structure that the
    noise model cannot hold: ΔBIC is the least of all rates.
    """

    def __init__(self, parent: Model):
        self.parent = parent
        simulator = parent.simulator
        starts = [parent.theta, *usual_starts(simulator, parent.theta)]
        self.found = [likeliest(simulator, starts, RATES[0])]
        for rate in RATES[1:]:  # its minimum is near that of the rate before
            last = self.found[-1]
            starts = starts if last is None else [last[1], parent.theta]
            self.found.append(likeliest(simulator, starts, rate))

    def delta_bic(self, model: Model, least: float = -np.inf) -> float:
        """Of what a model has beside the parent; NaN where a likelihood has no maximum.

        Rates after one at which it is not above ``least`` are left out.
        """
        found = np.inf
        for at_parent, rate in zip(self.found, RATES, strict=True):
            found = float(np.minimum(found, self._at_rate(model, at_parent, rate)))
            if not found > least:
                break
        return found

    def _at_rate(self, model: Model, found: tuple[float, np.ndarray] | None, rate: float) -> float:
        simulator, parent = model.simulator, self.parent.simulator
        shared = [simulator.names.index(name) for name in parent.names]
        starts = [model.theta]
        if found is not None:
            beside = model.theta.copy()
            beside[shared] = found[1]
            starts.append(beside)
        larger = likeliest(simulator, starts, rate)
        if larger is None:
            return np.nan
        fewer = likeliest(parent, [larger[1][shared]], rate, known=found)
        if fewer is None or fewer[0] < larger[0] - LOST:
            return np.nan
        n = Criterion(simulator.record, rate=rate).n
        added = model.n_parameters - self.parent.n_parameters
        return fewer[0] - larger[0] - added * float(np.log(n))
