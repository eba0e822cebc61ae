"""The linear person: McRuer's crossover model with a delay and a second-order limb, drawn with
sensible margins.

Open it for what a person without any hidden effect is: u = K (1 + T s) exp(-tau s) w^2 / (s^2 + 2 z
w s + w^2) e. The pure delay tau is the effective delay that answers are judged by.
"""

from dataclasses import dataclass

import numpy as np

from .elements import Element


@dataclass(frozen=True)
class Person:
    """Gain, lead (s), pure delay (s), limb (rad/s, damping ratio), and the crossover frequency
    they were drawn for.
    """

    gain: float
    lead: float
    delay: float
    omega: float
    zeta: float
    crossover: float

    def response(self, w: np.ndarray) -> np.ndarray:
        """Frequency response at w (rad/s)."""
        s = 1j * np.asarray(w)
        limb = self.omega**2 / (s**2 + 2 * self.zeta * self.omega * s + self.omega**2)
        return self.gain * (1 + self.lead * s) * np.exp(-s * self.delay) * limb


def margins(element: Element, person: Person) -> tuple[float, float]:
    """Least phase margin (degrees) over all crossings of gain 1, least gain margin (dB) over all
    crossings of -180.
    """
    w = np.geomspace(0.05, 60.0, 3000)
    loop = element.response(w) * person.response(w)
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    phase -= 2 * np.pi * np.round((phase[0] + np.pi / 2 * element.order) / (2 * np.pi))
    crossing = np.flatnonzero(np.diff(np.sign(size - 1)))
    turning = np.flatnonzero(np.diff(np.sign(phase + np.pi)) < 0)
    if not len(crossing) or not len(turning):
        return -180.0, -99.0
    phase_margin = float(np.rad2deg(phase[crossing] + np.pi).min())
    return phase_margin, float((-20 * np.log10(size[turning])).min())


def draw_person(
    element: Element, rng: np.random.Generator, delays: tuple[float, float] = (0.12, 0.35)
) -> Person:
    """A person who steers ``element`` stably: phase margin 25 degrees and gain margin 3.5 dB at
    least.
    """
    for _ in range(5000):
        delay = float(rng.uniform(*delays))
        crossover = float(rng.uniform(2.0, 4.5))
        if element.order == 1:
            lead = 0.0 if rng.random() < 0.6 else float(rng.uniform(0.03, 0.2))
        elif element.pole == 0:
            lead = float(rng.uniform(0.9, 4.0))
        else:
            lead = float(rng.uniform(0.6, 1.2) / element.pole)
        person = Person(
            1.0, lead, delay, float(rng.uniform(5, 15)), float(rng.uniform(0.2, 0.75)), crossover
        )
        at = np.array([crossover])
        gain = 1.0 / float(np.abs(element.response(at) * person.response(at))[0])
        person = Person(gain, lead, delay, person.omega, person.zeta, crossover)
        phase, size = margins(element, person)
        if phase >= 25.0 and size >= 3.5:
            return person
    raise RuntimeError(f"no stable person found for {element.text}")
