"""Controlled elements of the trial, exactly discretised at the rate of the simulation.

Open it to see what is steered: ``1/s``, ``1/(s(s+1))``, ``K/s^2`` and ``K/(s(s+w))`` with K and w
drawn. All are ``x' = K (u + d)`` or ``x'' + w x' = K (u + d)``: the disturbance d enters beside the
person's output u.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

NAMES = ("1/s", "1/(s(s+1))", "K/s^2", "K/(s(s+w))")


@dataclass(frozen=True)
class Element:
    """K/s (order 1) or K/(s(s+w)) (order 2, w = 0 gives K/s^2)."""

    name: str
    order: int
    gain: float
    pole: float = 0.0

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Frequency response at omega (rad/s)."""
        s = 1j * np.asarray(omega)
        return self.gain / s if self.order == 1 else self.gain / (s * (s + self.pole))

    def discrete(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Transition (2, 2) of the state (x, x') and its input column, u held over dt; x' of order
        1 is K(u + d).
        """
        if self.order == 1:
            return np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([self.gain * dt, self.gain])
        generator = np.zeros((3, 3))
        generator[0, 1] = 1.0
        generator[1, 1] = -self.pole
        generator[1, 2] = self.gain
        whole = expm(generator * dt)
        return np.ascontiguousarray(whole[:2, :2]), np.ascontiguousarray(whole[:2, 2])

    @property
    def text(self) -> str:
        """The transfer function as a user would type it."""
        if self.order == 1:
            return f"{self.gain:g}/s"
        return f"{self.gain:g}/s^2" if self.pole == 0 else f"{self.gain:g}/(s*(s+{self.pole:g}))"


def draw(name: str, rng: np.random.Generator) -> Element:
    """An element of the family ``name``; numbers are rounded so that the text given to a user is
    exact.
    """
    gain = float(f"{np.exp(rng.uniform(np.log(0.5), np.log(20.0))):.3g}")
    pole = float(f"{np.exp(rng.uniform(np.log(0.4), np.log(4.0))):.3g}")
    return {
        "1/s": Element(name, 1, 1.0),
        "1/(s(s+1))": Element(name, 2, 1.0, 1.0),
        "K/s^2": Element(name, 2, gain),
        "K/(s(s+w))": Element(name, 2, gain, pole),
    }[name]
