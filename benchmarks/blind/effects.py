"""What a hidden effect is, what it may draw on, and what it wires into the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from loop import (
    A1,
    B0,
    FRICTION,
    K_E,
    K_EDOT,
    N_COLUMNS,
    N_MUSCLE,
    N_PATHS,
    N_PLAYS,
    OMEGA_NM,
    TAU,
    WEIGHT,
    ZETA_NM,
    run_loop,
)
from signals import FINE_TIME, N_FINE, START, Multisine

CANONICAL = "canonical"
OUTPUT_ROW = 3 + 2 * N_PLAYS
N_CURVE = 1001  # points of a tabled curve


@dataclass(frozen=True)
class Operator:
    """The linear operator: u = H_nm (K_e e + K_edot de/dt), tau seconds later.

    Parameters
    ----------
    K_e, K_edot : float
        Gains on the error (1) and on its rate (s).
    tau : float
        Delay in s.
    omega_nm, zeta_nm : float
        Neuromuscular frequency (rad/s) and damping.
    """

    K_e: float
    K_edot: float
    tau: float
    omega_nm: float
    zeta_nm: float


@dataclass(frozen=True)
class Effect:
    """A hidden effect.

    Parameters
    ----------
    name : str
        Its id in the catalogue.
    parameters : dict
        Those of the canonical form.
    form : str
        "canonical", or what it is instead.
    extra : dict
        What the other form needs besides.
    """

    name: str
    parameters: dict[str, Any]
    form: str = CANONICAL
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def canonical(self) -> bool:
        return self.form == CANONICAL


@dataclass(frozen=True)
class RunInputs:
    """What is given from outside in one run, at 500 Hz.

    Parameters
    ----------
    f_t : Multisine
        The target.
    f_d, e_y, speed, platform, noise : ndarray of shape (n_fine,)
        Disturbance at the stick, error of the other axis, speed, acceleration of the platform
        by itself, and the remnant.
    chance : int
        Seed of what an effect draws anew in each run.
    """

    f_t: Multisine
    f_d: np.ndarray
    e_y: np.ndarray
    speed: np.ndarray
    platform: np.ndarray
    noise: np.ndarray
    chance: int


@dataclass(frozen=True)
class Context:
    """What sizes of effects are drawn from: the loop without effects and without remnant.

    Parameters
    ----------
    operator : Operator
        The linear operator.
    element : tuple of float
        K_c and omega_b.
    rms : dict
        Root mean squares of e, x, u, c, du (rate of u), acc, and of the channels dist, e_y,
        speed, platform; e_max is the greatest abs(e).
    speed_mean : float
        Of the channel, over the training runs.
    pull : float
        Constant part of the disturbance.
    motion : str
        Whose acceleration is felt and measured: "x", "x and platform" or "platform".
    off : bool
        Whether the form shall differ from the catalogue's.
    """

    operator: Operator
    element: tuple[float, float]
    rms: dict[str, float]
    speed_mean: float
    pull: float
    motion: str
    off: bool


class Wiring:
    """One run's loop, as the kernel takes it; effects change it in place.

    ``nominal`` leaves out what cannot be foreseen in another run, such as the phase of a tremor.
    """

    def __init__(self, run: RunInputs, operator: Operator, context: Context, nominal: bool) -> None:
        self.given, self.operator, self.context, self.nominal = run, operator, context, nominal
        self.t = FINE_TIME
        self.table = np.zeros((N_FINE, N_COLUMNS))
        self.table[:, K_E] = operator.K_e
        self.table[:, K_EDOT] = operator.K_edot
        self.table[:, TAU] = operator.tau
        self.table[:, WEIGHT] = 1.0
        self.maps: list[list[float]] = []
        self.outputs: list[list[float]] = []
        self.paths = np.zeros(N_PATHS)
        self.hold = np.zeros(3)
        self.muscle = np.zeros(N_MUSCLE)
        self.muscle[OMEGA_NM], self.muscle[ZETA_NM] = operator.omega_nm, operator.zeta_nm
        self.muscle[B0] = 1.0
        self.curves: list[list[float]] = []
        self.sections: list[np.ndarray] = []

    @property
    def rng(self) -> np.random.Generator:
        return np.random.default_rng(self.given.chance)

    def gain(self, factor: np.ndarray) -> None:
        """Multiply both gains."""
        self.table[:, K_E] *= factor
        self.table[:, K_EDOT] *= factor

    def filter(self, numerator: list[float], denominator: list[float]) -> None:
        """A second-order filter of the command, by the trapezoidal rule; powers of s rise."""
        self.muscle[B0 : A1 + 2] = self._recursion(numerator, denominator)

    def section(self, numerator: list[float], denominator: list[float]) -> None:
        """One more such filter behind ``filter``, as many as are wanted."""
        self.sections.append(self._recursion(numerator, denominator))

    def _recursion(self, numerator: list[float], denominator: list[float]) -> np.ndarray:
        """b_0, b_1, b_2, a_1, a_2."""
        s = 2 / (self.t[1] - self.t[0])
        b, a = (
            (
                p[0] + p[1] * s + p[2] * s * s,
                2 * (p[0] - p[2] * s * s),
                p[0] - p[1] * s + p[2] * s * s,
            )
            for p in (numerator, denominator)
        )
        return np.array([*b, *a[1:]]) / a[0]

    def curve(self, place: int, of: Callable[[np.ndarray], np.ndarray], reach: float) -> None:
        """A static curve at a place of the loop, tabled over +-reach and straight beyond."""
        x = np.linspace(-reach, reach, N_CURVE)
        self.curves.append([place, x[0], x[1] - x[0], *of(x)])

    def run(self, out: np.ndarray, begin: int, closed: bool) -> bool:
        """Simulate from the row ``begin`` on, into ``out``; False where the loop runs away."""
        maps, outputs = _padded(self.maps, 4), _padded(self.outputs, OUTPUT_ROW)
        sections, curves = np.reshape(self.sections, (-1, 5)), None
        if self.curves or len(sections) or self.muscle[FRICTION]:
            curves = _padded(self.curves, 3 + N_CURVE)
        rest = (self.paths, self.hold, self.muscle, curves, sections, START - begin, out, closed)
        return bool(run_loop(self.table[begin:], maps, outputs, *rest))


def _padded(rows: list[list[float]], width: int) -> np.ndarray:
    return np.array([[*r, *[0.0] * (width - len(r))] for r in rows]).reshape(-1, width)


Draw = Callable[[np.random.Generator, Context, float], Effect]
Wire = Callable[[Wiring, Effect], None]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def choose(rng: np.random.Generator, context: Context, *forms: str) -> str:
    """The canonical form, or one of the others."""
    return str(rng.choice(forms)) if context.off else CANONICAL
