"""A simulator for fits in which thresholds scale with the gains, so that events stay the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..effects.dimension import U
from .fitting import Fit
from .simulator import Simulator


class Tied(Simulator):
    """A simulator whose thresholds of the command follow the gains.

    A command and its thresholds that grow by the same factor have the same events. In vectors
    theta, thresholds are those at the gain of ``reference``, which is such a vector too.
    """

    def __init__(self, simulator: Simulator, reference: np.ndarray):
        super().__init__(simulator.core, simulator.effects, simulator.record)
        tied = [
            f"{name}__{p.name}"
            for name, effect in self.effects
            for p in effect.free
            if effect.place == "command" and p.dimension == U
        ]
        gains = self.core.gains
        self.gain = self.names.index(gains[0]) if gains else 0
        self.reference = abs(float(reference[self.gain])) if gains else 0.0
        self.tied = np.array([self.reference > 0.0 and name in tied for name in self.names])

    def factor(self, theta: np.ndarray) -> float:
        return self.reference / max(abs(theta[self.gain]), 1e-3 * self.reference)

    def to(self, theta: np.ndarray) -> np.ndarray:
        return np.where(self.tied, theta * self.factor(theta), theta) if self.tied.any() else theta

    def back(self, theta: np.ndarray) -> np.ndarray:
        if not self.tied.any():
            return theta
        return np.clip(np.where(self.tied, theta / self.factor(theta), theta), self.low, self.high)

    def run(self, theta: np.ndarray) -> np.ndarray:
        self._given = theta
        return super().run(self.back(theta))

    def run_with_change(self, position: int, value: float) -> np.ndarray:
        if position != self.gain or not self.tied.any():
            theta = self._given.copy()
            theta[position] = value
            return super().run_with_change(position, float(self.back(theta)[position]))
        before = self._theta
        theta = self._given.copy()
        theta[position] = value
        # The gain comes before the thresholds: every stage after it runs again.
        self._theta = self.back(theta)
        output = super().run_with_change(position, value)
        self._theta = before
        return output

    def back_fit(self, fit: Fit) -> Fit:
        """The fit with its normal equations in the parameters of the model."""
        if not self.tied.any():
            return fit
        by = np.eye(fit.theta.size)
        by[self.tied, self.tied] = self.factor(fit.theta)
        by[self.tied, self.gain] = -fit.theta[self.tied] / (fit.theta[self.gain] or 1.0)
        theta, normal = self.back(fit.theta), by.T @ fit.normal @ by
        return replace(fit, theta=theta, normal=normal, gradient=by.T @ fit.gradient)
