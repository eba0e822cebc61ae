"""The linear cores of models: a human operator, or an ARX system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from .. import _kernels
from ..effects.core_kind import CoreKind
from ..effects.dimension import ONE, RAD, Dimension, E, S, U
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import Parameter
from ..effects.record import Record
from .arx_inside import inside_response
from .arx_starts import arx_starts

BOUND = 1e9  # of simulated outputs
OPERATORS_MOVE = 3.0  # rad/s, half of the output's power below it: what times are written for
SLOWEST, FASTEST = 0.02, 1.0  # rad per sample, of what an ARX model describes
N_ROUNDS = 2  # of least squares for an ARX model behind an effect


@dataclass(frozen=True)
class Ratio:
    """A number that tables show with the parameters: ``over`` divided by ``under``."""

    name: str
    over: str
    under: str
    dimension: Dimension
    meaning: str


class Core(Protocol):
    """What simulation, search and tables need to know of the linear core.

    Attributes
    ----------
    kind : CoreKind
        Which core it is, for ``Effect.refusal``.
    parameters : tuple of Parameter
        What is estimated. What is in neither ``gains`` nor ``delays`` belongs to the response.
    gains : tuple of str
        Names of the parameters that ``command`` takes. Thresholds of the command grow with the
        first.
    delays : tuple of str
        Names of the parameters that ``delay`` takes.
    ordinary : mapping of str to float
        Usual values of the response's parameters, which a search starts from where what is missing
        has bent the estimates; empty where nothing is usual.
    ratios : tuple of Ratio
        What tables show with the parameters.
    sizes : mapping of str to float
        Changes of parameters that change the output by its own size, where the parameters
        themselves do not show it.
    """

    kind: CoreKind
    parameters: tuple[Parameter, ...]
    gains: tuple[str, ...]
    delays: tuple[str, ...]
    ordinary: Mapping[str, float]
    ratios: tuple[Ratio, ...]
    sizes: Mapping[str, float]

    def on(self, record: Record) -> Record:
        """The record, completed by what effects must know about the core."""

    def least_delay(self, dt: float) -> float:
        """Least delay of the input in seconds that the core can take."""

    def delay(self, values: dict[str, float]) -> float:
        """Delay of the answer to the input in seconds, without effects."""

    def command(self, error: np.ndarray, gains: Gains, values: dict[str, float]) -> tuple:
        """Position and rate command for a delayed error and gains delayed alike."""

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        """Output for a command."""

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        """Changes of parameters that make the answer that much earlier; none if it cannot be."""

    def second_order(self, values: dict[str, float]) -> tuple[float, float] | None:
        """Natural frequency and damping ratio of the response; None if it is another system."""

    def starts_for(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        """Least-squares parameters for what reaches the core; none if it is not linear in them."""


class OperatorCore:
    """Human operator: K_e e + K_edot de/dt, delayed, through the neuromuscular system (Eqs. 3-5).

    ``fixed_delay`` in seconds, or None to estimate it.
    """

    kind = CoreKind.OPERATOR
    gains: tuple[str, ...] = ("K_e", "K_edot")
    delays: tuple[str, ...] = ()
    ordinary: Mapping[str, float] = {"omega_nm": 11.0, "zeta_nm": 0.35}
    ratios: tuple[Ratio, ...] = (Ratio("T_L", "K_edot", "K_e", S, "lead time constant"),)

    def __init__(self, fixed_delay: float | None):
        self.fixed_delay = fixed_delay
        self.sizes: Mapping[str, float] = {}
        free = (
            Parameter("K_e", U / E, -50.0, 50.0, (0.5,), "gain on the error"),
            Parameter("K_edot", U * S / E, 0.0, 50.0, (0.2,), "gain on the error rate"),
            Parameter("omega_nm", RAD / S, 1.5, 60.0, (10.0,), "neuromuscular frequency"),
            Parameter("zeta_nm", ONE, 0.02, 3.0, (0.4,), "neuromuscular damping ratio"),
        )
        delay = Parameter("tau_e", S, 0.0, 1.5, (0.25,), "effective time delay")
        self.parameters: tuple[Parameter, ...] = free
        if fixed_delay is None:
            self.parameters = (*free, delay)
            self.delays = (delay.name,)
            self.kind = CoreKind.OPERATOR_FREE_DELAY

    def on(self, record: Record) -> Record:
        return record

    def least_delay(self, dt: float) -> float:
        return 0.0

    def delay(self, values: dict[str, float]) -> float:
        return self.fixed_delay if self.fixed_delay is not None else values["tau_e"]

    def command(
        self, error: np.ndarray, gains: Gains, values: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        error = _kernels.gate(error)
        position = _kernels.greybox.scaled(error, _kernels.gate(values["K_e"] * gains.error))
        rate = _kernels.greybox.scaled(error, _kernels.gate(values["K_edot"] * gains.rate))
        return position, rate

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        omega, zeta = values["omega_nm"] * gains.omega[:, 0], values["zeta_nm"] * gains.zeta[:, 0]
        if omega.size != zeta.size:
            omega, zeta = np.broadcast_arrays(omega, zeta)
        matrices = _kernels.greybox.held_linearly(_kernels.gate(omega), _kernels.gate(zeta), dt)
        return _kernels.greybox.second_order(
            _kernels.gate(command.position),
            _kernels.gate(command.rate),
            matrices,
            float(spring.cubic),
            float(spring.square),
            BOUND,
        )

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        if self.fixed_delay is None:
            return {"tau_e": -seconds}
        return {"K_edot": values["K_e"] * seconds}

    def second_order(self, values: dict[str, float]) -> tuple[float, float]:
        return values["omega_nm"], values["zeta_nm"]

    def starts_for(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        return []


class ARXCore:
    """A(q) y = B(q) x(t - nk) + c with orders of one input (Eq. 6), c only with ``intercept``.

    ``sizes``: changes of the coefficients that change the output by its own size. Coefficients of
    a fast sampled slow system differ in their last digits only, so that their own size says
    nothing.
    """

    kind = CoreKind.ARX
    gains: tuple[str, ...] = ()
    delays: tuple[str, ...] = ()
    ordinary: Mapping[str, float] = {}
    ratios: tuple[Ratio, ...] = ()

    def __init__(
        self,
        na: int,
        nb: int,
        nk: int,
        intercept: bool = False,
        sizes: Mapping[str, float] | None = None,
    ):
        self.na, self.nb, self.nk, self.intercept = na, nb, nk, intercept
        self.sizes: Mapping[str, float] = sizes or {}
        self.parameters: tuple[Parameter, ...] = (
            *(Parameter(f"a{i + 1}", ONE, meaning="of the output") for i in range(na)),
            *(Parameter(f"b{i}", U / E, meaning="of the input", scale=ONE) for i in range(nb)),
            *[Parameter("intercept", U, meaning="constant", scale=ONE)] * intercept,
        )

    def on(self, record: Record) -> Record:
        return replace(
            record,
            core=self.kind,
            time_unit=OPERATORS_MOVE / pace(record),
            criterion_rate=np.inf,
            ahead=self.nk * record.dt,
        )

    def least_delay(self, dt: float) -> float:
        return -self.nk * dt  # because nk delays as well

    def delay(self, values: dict[str, float]) -> float:
        return 0.0

    def command(
        self, error: np.ndarray, gains: Gains, values: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        return gains.error * error, np.zeros_like(error)

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        theta = np.array([values[p.name] for p in self.parameters])
        x = command.position
        if command.rate.any():
            x = x + np.gradient(command.rate, dt, axis=0)
        b = np.r_[np.zeros(self.nk), theta[self.na : self.na + self.nb]]
        constant = float(theta[-1]) if self.intercept else 0.0
        if spring.terms or gains.omega.size > 1:
            polynomials = theta[: self.na], b, constant
            return inside_response(x, polynomials, self.nk, spring, gains.omega, dt, BOUND)
        return _kernels.greybox.arx_response(
            _kernels.gate(x),
            _kernels.gate(theta[: self.na]),
            b,
            float(spring.cubic),
            float(spring.square),
            constant,
            BOUND,
        )

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        return {}

    def second_order(self, values: dict[str, float]) -> None:
        return None

    def starts_for(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        return arx_starts(self, record, command, N_ROUNDS)


def pace(record: Record) -> float:
    """Frequency in rad/s below which half of the output's power is."""
    if record.y is None:
        return OPERATORS_MOVE
    y = np.where(record.known, record.y - record.y[record.known].mean(), 0.0)
    power = (np.abs(np.fft.rfft(y, axis=0)) ** 2).sum(axis=1)
    half = np.searchsorted(np.cumsum(power), power.sum() / 2)
    omega = 2 * np.pi * half / y.shape[0]
    return float(np.clip(omega, SLOWEST, FASTEST)) / record.dt


def neutral_gains() -> Gains:
    """No effect on any gain."""
    one = np.ones((1, 1))
    return Gains(one, one, one, one)
