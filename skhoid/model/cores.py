"""The linear cores of models: a human operator, or an ARX system, and what is usual for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import _kernels
from ..arx.base import held_level
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import ONE, RAD, CoreKind, Dimension, E, Parameter, S, U
from ..effects.record import Record
from .arx_inside import simulate_inside
from .arx_starts import begins_at_rest, find_arx_starts, list_blind_starts


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
BOUND = 1e60  # of simulated outputs, far from those measured
OPERATORS_MOVE = 3.0  # rad/s, half of the output's power below it: what times are written for
LEAST_DELAY = 0.1  # s, of an operator: see OperatorRegressor
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


class Core:
    """What simulation, search and tables ask of the linear core; without states of its own.

    Attributes
    ----------
    kind : CoreKind
        Which core it is, for ``Effect.refusal``.
    parameters : tuple of Parameter
        Estimated parameters. Those in neither ``gains`` nor ``delays`` belong to the response.
    gains : tuple of str
        Names of the parameters that ``command`` takes. Thresholds of the command grow with the
        first.
    delays : tuple of str
        Names of the parameters that ``delay`` takes.
    ordinary : mapping of str to float
        Usual values of the response's parameters, from which a search starts where missing effects
        have distorted the estimates.
    usual : mapping of str to Usual
        What is known about parameters before any data; it counts where the data say little.
    ratios : tuple of Ratio
        Ratios that tables show with the parameters.
    sizes : mapping of str to float
        Changes of parameters that would change the output by its own size, where the values of the
        parameters do not show it.
    has_states : bool
        Whether ``denominator`` and ``held_pulses`` are those of the response; runs begin at rest
        otherwise.
    memory : int
        Samples of the command that the response remembers besides its states.
    forgetting : tuple of float
        Coefficients [1, a_1, ...] by which an integral of the core forgets what preceded a run.
    """

    kind: CoreKind
    parameters: tuple[Parameter, ...]
    gains: tuple[str, ...] = ()
    delays: tuple[str, ...] = ()
    ordinary: Mapping[str, float] = {}
    usual: Mapping[str, Usual] = {}
    ratios: tuple[Ratio, ...] = ()
    sizes: Mapping[str, float] = {}
    has_states: bool = False
    memory: int = 0
    forgetting: tuple[float, ...] = (1.0,)

    def chosen(self, record: Record) -> Core:
        """The core with what is open about its form decided by the data."""
        return self

    def add_to_record(self, record: Record) -> Record:
        """The record, with what effects must know about the core added."""
        return record

    def least_delay(self, dt: float) -> float:
        """Least delay of the input in seconds that the core can take."""
        return 0.0

    def delay(self, values: dict[str, float]) -> float:
        """Delay of the response to the input in seconds, without effects."""
        return 0.0

    def find_seen(self, record: Record, delay: float | np.ndarray) -> np.ndarray | None:
        """What is answered besides the error, delayed like it; None where that is nothing."""
        return None

    def command(
        self,
        error: np.ndarray,
        gains: Gains,
        values: dict[str, float],
        dt: float,
        seen: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Position and rate command for a delayed error and gains delayed alike.

        ``seen`` is what :meth:`find_seen` returned; None means the error.
        """
        raise NotImplementedError

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        """Output for a command."""
        raise NotImplementedError

    def denominator(self, values: dict[str, float], dt: float) -> np.ndarray:
        """Coefficients [1, a_1, ...] of the difference equation of the core's free response.

        Without what ``forgetting`` says.
        """
        return np.ones(1)

    def at_rest(self, record: Record) -> bool:
        """Whether runs begin at rest, as far as a linear model can tell."""
        return False

    def held_pulses(
        self,
        command: Command,
        values: dict[str, float],
        dt: float,
        n: int,
        levels: tuple[float, float],
    ) -> np.ndarray:
        """What to add to the first samples (n, n_runs) of the recursion for another beginning.

        As if the command was always as in the first sample, and the output at rest at a level
        within ``levels``.
        """
        return np.zeros((n, command.position.shape[1]))

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        """Changes of parameters for a response that much earlier; none if that is impossible."""
        return {}

    def second_order(self, values: dict[str, float]) -> tuple[float, float] | None:
        """Natural frequency and damping ratio of the response; None if it is another system."""
        return None

    def starts_for(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        """Least-squares parameters for what reaches the core; none if it is not linear in them."""
        return []

    def spread(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        """Parameters spread over what is possible, where a map hides the output; none if unused."""
        return []


class OperatorCore(Core):
    """Human operator: K_e e + K_edot de/dt, delayed, through the neuromuscular system (Eqs. 3-5).

    ``fixed_delay`` in seconds, or None to estimate it; ``least`` is the least delay in seconds with
    which the operator responds to anything that the operator moves, unless a shorter one is given.
    """

    kind = CoreKind.OPERATOR
    gains = ("K_e", "K_edot")
    ordinary: Mapping[str, float] = {"omega_nm": 11.0, "zeta_nm": 0.35}
    # Of people in tracking tasks: McRuer and Jex (1967), Van Paassen (1994), Zaal et al. (2009).
    usual: Mapping[str, Usual] = {
        "omega_nm": Usual(9.5, 0.35, relative=True),
        "zeta_nm": Usual(0.45, 0.5, relative=True),
        "tau_e": Usual(0.22, 0.1),
    }
    ratios = (Ratio("T_L", "K_edot", "K_e", S, "lead time constant"),)

    def __init__(self, fixed_delay: float | None, least: float = LEAST_DELAY):
        self.fixed_delay, self.least = fixed_delay, least
        self.has_states = type(self).response is OperatorCore.response  # not of a subclass
        free = (
            Parameter("K_e", U / E, -50.0, 50.0, (0.5,), "gain on the error"),
            Parameter("K_edot", U * S / E, 0.0, 50.0, (0.2,), "gain on the error rate"),
            Parameter("omega_nm", RAD / S, 1.5, 60.0, (10.0,), "neuromuscular frequency"),
            Parameter("zeta_nm", ONE, 0.02, 3.0, (0.4,), "neuromuscular damping ratio"),
        )
        delay = Parameter("tau_e", S, least, 1.5, (0.25,), "effective time delay")
        self.parameters = free
        if fixed_delay is None:
            self.parameters = (*free, delay)
            self.delays = (delay.name,)
            self.kind = CoreKind.OPERATOR_FREE_DELAY

    def add_to_record(self, record: Record) -> Record:
        ahead = np.inf if self.fixed_delay is None else self.fixed_delay - self.least_delay(0.0)
        return replace(record, ahead=ahead, least_delay=self.least)

    def least_delay(self, dt: float) -> float:
        return self.least if self.fixed_delay is None else min(self.least, self.fixed_delay)

    def delay(self, values: dict[str, float]) -> float:
        return self.fixed_delay if self.fixed_delay is not None else values["tau_e"]

    def command(
        self,
        error: np.ndarray,
        gains: Gains,
        values: dict[str, float],
        dt: float,
        seen: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        position = error * (values["K_e"] * gains.error)
        return position, error * (values["K_edot"] * gains.rate)

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        omega, zeta = values["omega_nm"] * gains.omega[:, 0], values["zeta_nm"] * gains.zeta[:, 0]
        if omega.size != zeta.size:
            omega, zeta = np.broadcast_arrays(omega, zeta)
        omega, zeta = _kernels.gate(omega), _kernels.gate(zeta)
        matrices = _kernels.greybox.held_linearly(omega, zeta, dt)
        position, rate = _kernels.gate(command.position), _kernels.gate(command.rate)
        if spring.curves:
            table = _kernels.gate(spring.whole_table)
            return _kernels.inside.limb_inside(
                position, rate, matrices, table, spring.tables, dt, BOUND
            )
        if spring.terms:
            return _kernels.limb.rubbing(
                position,
                rate,
                matrices,
                omega,
                zeta,
                spring.friction,
                np.array([spring.cubic, spring.square], dtype=float),
                BOUND,
            )
        return _kernels.greybox.second_order(
            position,
            rate,
            matrices,
            float(spring.cubic),
            float(spring.square),
            BOUND,
        )

    def _matrices(self, values: dict[str, float], dt: float) -> np.ndarray:
        omega, zeta = (np.array([values[name]]) for name in ("omega_nm", "zeta_nm"))
        return _kernels.greybox.held_linearly(omega, zeta, dt)[0]

    def denominator(self, values: dict[str, float], dt: float) -> np.ndarray:
        a, b, c, d = self._matrices(values, dt)[:4]
        return np.array([1.0, -(a + d), a * d - b * c])

    def held_pulses(
        self,
        command: Command,
        values: dict[str, float],
        dt: float,
        n: int,
        levels: tuple[float, float],
    ) -> np.ndarray:
        q = self._matrices(values, dt)
        position, rate = command.position[0], command.rate[0]
        # The level, and the next output less that from rest: two values of a free response.
        first = np.stack([position, position - (q[4] + q[8]) * position - (q[5] + q[9]) * rate])
        pulses = np.zeros((n, position.size))
        pulses[:2] = first[:n]
        pulses[1:2] -= (q[0] + q[3]) * first[:1]
        return pulses

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        if self.fixed_delay is None:
            return {"tau_e": -seconds}
        return {"K_edot": values["K_e"] * seconds}

    def second_order(self, values: dict[str, float]) -> tuple[float, float]:
        return values["omega_nm"], values["zeta_nm"]


class ARXCore(Core):
    """A(q) y = B(q) x(t - nk) + c with orders of one input (Eq. 6), c only with ``intercept``.

    ``sizes``: changes of the coefficients that would change the output by its own size.
    Coefficients of a slow system sampled fast differ in their last digits only, so their own size
    says nothing.
    """

    kind = CoreKind.ARX
    has_states = True

    def __init__(
        self,
        na: int,
        nb: int,
        nk: int,
        intercept: bool = False,
        sizes: Mapping[str, float] | None = None,
    ):
        self.na, self.nb, self.nk, self.intercept = na, nb, nk, intercept
        self.memory = nk + nb
        self.sizes = sizes or {}
        self.parameters = (
            *(Parameter(f"a{i + 1}", ONE, meaning="of the output") for i in range(na)),
            *(Parameter(f"b{i}", U / E, meaning="of the input") for i in range(nb)),
            *[Parameter("intercept", U, meaning="constant")] * intercept,
        )

    def add_to_record(self, record: Record) -> Record:
        return replace(
            record,
            core=self.kind,
            time_unit=OPERATORS_MOVE / find_pace(record),
            criterion_rate=np.inf,
            ahead=self.nk * record.dt,
            least_delay=record.dt,
        )

    def least_delay(self, dt: float) -> float:
        return -self.nk * dt  # because nk delays as well

    def command(
        self,
        error: np.ndarray,
        gains: Gains,
        values: dict[str, float],
        dt: float,
        seen: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        return gains.error * error, np.zeros_like(error)

    def response(
        self,
        command: Command,
        gains: Gains,
        spring: Spring,
        values: dict[str, float],
        dt: float,
        begun: np.ndarray | None = None,
    ) -> np.ndarray:
        theta = np.array([values[p.name] for p in self.parameters])
        x = command.position
        if command.rate.any():
            x = x + np.gradient(command.rate, dt, axis=0)
        b = np.r_[np.zeros(self.nk), theta[self.na : self.na + self.nb]]
        constant = float(theta[-1]) if self.intercept else 0.0
        if spring.terms or gains.omega.size > 1:
            polynomials = theta[: self.na], b, constant
            return simulate_inside(x, polynomials, self.nk, spring, gains.omega, dt, BOUND, begun)
        return _kernels.greybox.arx_response(
            _kernels.gate(x),
            _kernels.gate(theta[: self.na]),
            b,
            float(spring.cubic),
            float(spring.square),
            constant,
            BOUND,
        )

    def denominator(self, values: dict[str, float], dt: float) -> np.ndarray:
        return np.r_[1.0, [values[f"a{i + 1}"] for i in range(self.na)]]

    def at_rest(self, record: Record) -> bool:
        return begins_at_rest(self, record)

    def held_pulses(
        self,
        command: Command,
        values: dict[str, float],
        dt: float,
        n: int,
        levels: tuple[float, float],
    ) -> np.ndarray:
        a = self.denominator(values, dt)
        b = np.r_[np.zeros(self.nk), [values[f"b{i}"] for i in range(self.nb)]]
        x = command.position[0]
        constant = values.get("intercept", 0.0)
        level = held_level(a, b.sum() * x + constant, levels)
        # What lags that reach before the first sample add to each of the first samples.
        before = np.zeros((n, x.size))
        for polynomial, signal in ((b, x), (-a, level)):
            m = min(n, polynomial.size)
            before[:m] += np.outer(polynomial.sum() - np.cumsum(polynomial)[:m], signal)
        return before

    def starts_for(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        return find_arx_starts(self, record, command, N_ROUNDS)

    def spread(self, record: Record, command: np.ndarray) -> list[np.ndarray]:
        return list_blind_starts(self, record, command)


def find_pace(record: Record) -> float:
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
