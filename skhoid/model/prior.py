"""What is known about a person's parameters before any data, as squares to add to a fit's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Usual:
    """A parameter is usually ``centre``, give or take ``spread`` (one standard deviation).

    ``relative`` spreads are those of the logarithm.
    """

    centre: float
    spread: float
    relative: bool = False

    def distance(self, value: float) -> tuple[float, float]:
        """How many spreads a value is from the centre, and the derivative of that."""
        if not self.relative:
            return (value - self.centre) / self.spread, 1.0 / self.spread
        value = max(value, 1e-6 * self.centre)
        return np.log(value / self.centre) / self.spread, 1.0 / (value * self.spread)


@dataclass(frozen=True)
class Prior:
    """Usual values of some of the parameters, by position; ``weight`` is the noise's variance."""

    usual: tuple[tuple[int, Usual], ...] = ()
    weight: float = 1.0

    @classmethod
    def of(cls, names: Sequence[str], usual: Mapping[str, Usual]) -> Prior:
        return cls(tuple((names.index(name), one) for name, one in usual.items() if name in names))

    def __add__(self, other: Prior) -> Prior:
        """What both know, with the weight of the first."""
        return replace(self, usual=(*self.usual, *other.usual))

    def weighing(self, weight: float) -> Prior:
        """The prior for residuals of a given variance."""
        return replace(self, weight=weight)

    def distance(self, theta: np.ndarray) -> float:
        """Sum of the squared distances of parameters from their centres, in spreads."""
        return sum(one.distance(float(theta[i]))[0] ** 2 for i, one in self.usual)

    def cost(self, theta: np.ndarray) -> float:
        """Squares to add to those of residuals."""
        return self.weight * self.distance(theta)

    def normal_equations(self, theta: np.ndarray) -> tuple[Any, Any]:
        """What to add to the normal equations of residuals."""
        if not self.usual:
            return 0.0, 0.0
        normal, gradient = np.zeros((theta.size, theta.size)), np.zeros(theta.size)
        for i, one in self.usual:
            off, slope = one.distance(float(theta[i]))
            normal[i, i] = self.weight * slope**2
            gradient[i] = -self.weight * slope * off
        return normal, gradient


NO_PRIOR = Prior()
