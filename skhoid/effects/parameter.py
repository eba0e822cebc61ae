"""Parameters of effects: dimensions, bounds and starts, also in the units of the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from ..parameters import ModelParameter

if TYPE_CHECKING:
    from .record import Record


class CoreKind(StrEnum):
    """Kind of linear core that an effect acts in: the argument ``core`` of ``Effect.refusal``.

    Attributes
    ----------
    OPERATOR
        A human operator with a given delay.
    OPERATOR_FREE_DELAY
        A human operator whose delay is estimated with the other parameters.
    CONTROLLER
        A PI or PID controller.
    ARX
        An ARX model.

    Examples
    --------
    >>> from skhoid.effects import CoreKind
    >>> [kind.is_operator for kind in CoreKind]
    [True, True, True, False]
    >>> CoreKind("arx")
    <CoreKind.ARX: 'arx'>
    """

    OPERATOR = "operator"
    OPERATOR_FREE_DELAY = "operator, free delay"
    CONTROLLER = "controller"
    ARX = "arx"

    @property
    def is_operator(self) -> bool:
        """Whether it is an operator, human or a controller, whose command has the output's unit."""
        return self is not CoreKind.ARX

    @property
    def has_limb(self) -> bool:
        """Whether it is human, with a neuromuscular system behind its command."""
        return self in (CoreKind.OPERATOR, CoreKind.OPERATOR_FREE_DELAY)


_EXPONENTS = ("u", "e", "s", "rad", "Hz", "T")
OPEN = "None"  # stands for a channel that is not chosen yet


class RoleName(str):
    """A role in place of the name of a channel, which data may call otherwise."""


@dataclass(frozen=True)
class Dimension:
    """Dimension of a number: exponents of the units of output, input and time.

    Dimensions can be multiplied, divided and raised to whole powers; labels follow from them.

    Parameters
    ----------
    u : int, default=0
        Of the unit of the output.
    e : int, default=0
        Of the unit of the input: the error, where there is one.
    s : int, default=0
        Of the second.
    rad : int, default=0
        Of the radian, which appears in the label only.
    Hz : int, default=0
        Of the hertz, one over the second under its own name.
    T : int, default=0
        Of the duration of a run: for the ``scale`` of a parameter only, in place of seconds.
    channels : tuple of (str, int), default=()
        Of the units of other channels, by their names. See ``Dimension.of_channel``.

    See Also
    --------
    Parameter : One number of an effect.

    Examples
    --------
    >>> from skhoid.effects import Dimension
    >>> Dimension(u=1, s=1, e=-1).label({"u": "deg", "e": "mm"})
    'deg s/mm'
    >>> (Dimension(u=1) / Dimension.of_channel("speed")).label()
    '[u]/[speed]'
    >>> Dimension().label()
    '-'
    """

    u: int = 0
    e: int = 0
    s: int = 0
    rad: int = 0
    Hz: int = 0
    T: int = 0
    channels: tuple[tuple[str, int], ...] = ()

    @classmethod
    def of_channel(cls, name: str | None) -> Dimension:
        """The unit of a channel, by its name; None while the choice is open."""
        return cls(channels=((OPEN if name is None else str(name), 1),))

    @classmethod
    def of_role(cls, role: str) -> Dimension:
        """The unit of the channel of a role, whatever its name."""
        return cls(channels=((RoleName(role), 1),))

    @property
    def seconds(self) -> int:
        """Exponent of time, whatever its name in the label."""
        return self.s - self.Hz + self.T

    @property
    def inputs(self) -> int:
        """Sum of the exponents of input and channels."""
        return self.e + sum(power for _, power in self.channels)

    def __pow__(self, power: int) -> Dimension:
        own = {name: getattr(self, name) * power for name in _EXPONENTS}
        return Dimension(**own, channels=tuple((n, p * power) for n, p in self.channels if power))

    def __mul__(self, other: Dimension) -> Dimension:
        powers = dict(self.channels)
        for name, power in other.channels:
            powers[name] = powers.get(name, 0) + power
        own = {name: getattr(self, name) + getattr(other, name) for name in _EXPONENTS}
        return Dimension(**own, channels=tuple(sorted((n, p) for n, p in powers.items() if p)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def with_output_as_input(self) -> Dimension:
        """The same dimension, with the unit of the output replaced by that of the input."""
        return replace(self, u=0, e=self.e + self.u)

    def with_input_as_output(self) -> Dimension:
        """The same dimension, with the unit of the input replaced by that of the output."""
        return replace(self, e=0, u=self.u + self.e)

    def with_channel(self, name: str) -> Dimension:
        """The same dimension, with a channel in the place of the one that is open."""
        channels = tuple((name if n == OPEN else n, p) for n, p in self.channels)
        return replace(self, channels=channels)

    def label(self, units: Mapping[str, str | None] | None = None) -> str:
        """The unit as text; ``units`` has those of ``"u"``, ``"e"`` and ``"[channel]"``."""
        known = units or {}
        signals = [("[u]", "u", self.u), ("[e]", "e", self.e)]
        signals += [(f"[{name}]", f"[{name}]", power) for name, power in self.channels]
        powers = [(known.get(key) or name, power) for name, key, power in signals]
        powers += [(name, getattr(self, name)) for name in ("rad", "Hz", "s", "T")]
        over = [_to_power(name, power) for name, power in powers if power > 0]
        under = [_to_power(name, -power) for name, power in powers if power < 0]
        if not under:
            return " ".join(over) or "-"
        below = f"({' '.join(under)})" if len(under) > 1 else under[0]
        return f"{' '.join(over) or '1'}/{below}"


def _to_power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def checked(dimension: Any, what: str) -> Dimension:
    """The dimension itself, or an error that says how one is written."""
    if isinstance(dimension, Dimension):
        return dimension
    raise TypeError(
        f"{what} must be a Dimension (exponents of units); got {dimension!r}. Write "
        "Dimension(u=1, e=-1) for units of the output per unit of the input, Dimension(s=1) for "
        "seconds, Dimension() for a number without unit; its label follows."
    )


ONE = Dimension()
U = Dimension(u=1)
E = Dimension(e=1)
S = Dimension(s=1)
RAD = Dimension(rad=1)
HZ = Dimension(Hz=1)
T = Dimension(T=1)
CHANNEL = Dimension.of_channel(None)  # that an effect follows


@dataclass(frozen=True)
class ScaledParameter(ModelParameter):
    """A parameter of a model on a record: its dimension, and what starts and bounds are in.

    ``behind`` are titles of effects that the signal it is of has passed: its unit is that of the
    signal behind them, which nobody recorded.
    """

    dimension: Dimension = ONE
    scale: float = 1.0
    behind: tuple[str, ...] = ()

    def label(self, units: Mapping[str, str | None] | None = None) -> str:
        """The unit as text, with the units of the data."""
        unit = self.dimension.label(units)
        return f"{unit} behind {' and '.join(self.behind)}" if self.behind else unit


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Parameters
    ----------
    name : str
        Name of the constructor argument; None there means that it is estimated.
    dimension : Dimension, default=Dimension()
        Exponents of the units of output, input and time, from which its label follows.
    low, high : float
        Physical bounds, times the size of ``scale``.
    starts : tuple of float
        Values to start estimation from, times the size of ``scale``; one of each parameter at a
        time.
    meaning : str
        What it is, for tables.
    scale : Dimension or None, default=None
        What bounds and starts are in. None: standard deviations of the signals that ``dimension``
        names, and seconds as a person has them: on an ARX model times its own time, since a
        machine may be faster or slower. ``Dimension()``: the units of the data, and plain seconds
        on every model. ``T`` stands for seconds that are durations of a run,
        ``Dimension(u=1, T=-1)``; ``e`` may stand for a channel.
    forms : tuple of str, default=()
        Choices of the effect, such as forms, that have this number; () means all.

    See Also
    --------
    Dimension : Exponents of units.

    Examples
    --------
    >>> from skhoid.effects import Dimension, Parameter
    >>> width = Parameter("width", Dimension(e=1), 0.0, 3.0, starts=(0.3, 1.0))
    >>> width.dimension.label({"e": "deg"})
    'deg'
    """

    name: str
    dimension: Dimension = ONE
    low: float = -np.inf
    high: float = np.inf
    starts: tuple[float, ...] = (1.0,)
    meaning: str = ""
    scale: Dimension | None = None
    forms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        own = checked(self.dimension, f"The dimension of the parameter {self.name!r}")
        scale = self.scale
        if own.T:
            raise ValueError(
                f"The dimension of the parameter {self.name!r} must be in seconds, s; got "
                "durations of a run, T. Those are for its scale."
            )
        if scale is None or checked(scale, f"The scale of the parameter {self.name!r}") == ONE:
            return
        if scale.u != own.u or scale.inputs != own.inputs or scale.seconds not in (0, own.seconds):
            raise ValueError(
                f"The scale of the parameter {self.name!r}, {scale.label()}, does not fit its "
                f"dimension, {own.label()}. Leave it out for standard deviations of what the "
                "dimension names, or write Dimension() for the units of the data."
            )

    def on(
        self,
        record: Record,
        place: str = "",
        name: str = "",
        bounds: tuple[float, float] | None = None,
    ) -> ScaledParameter:
        """The same in the units of a record, for an effect of a place, under its full name."""
        scale = self.find_scale(record, place)
        low, high = (self.low * scale, self.high * scale) if bounds is None else bounds
        return ScaledParameter(
            name or self.name,
            meaning=self.meaning,
            min=low,
            max=high,
            dimension=self.find_dimension(record, place) if place else self.dimension,
            scale=scale,
        )

    def find_scale(self, record: Record, place: str = "") -> float:
        """What bounds and starts are in, as a number, for an effect of a place."""
        named = self.dimension if self.scale is None else self.scale
        output, on_arx = "u", record.core == CoreKind.ARX
        if on_arx and place in ("path", "command"):
            output = "e"
        elif on_arx and place == "spring" and named.u:
            named = named * E / U
        sizes = [(record.sd(name), p) for name, p in [(output, named.u), ("e", named.e)] if p]
        sizes += [(record.sd(name), p) for name, p in named.channels]
        if named.T:
            sizes.append((record.duration, named.T))
        elif self.scale != ONE:
            sizes.append((record.time_unit, self.dimension.seconds))
        value = 1.0
        for size, power in sizes:
            for _ in range(power):
                value *= size
        for size, power in sizes:
            for _ in range(-power):
                value *= size**-1
        return value

    def find_dimension(self, record: Record, place: str) -> Dimension:
        """The dimension in the core of a record, for an effect of a place.

        Written for operators, whose command has the unit of the output. The command of an ARX model
        has that of its input; there the output determines what is slow or fast.
        """
        if record.core != CoreKind.ARX:
            return self.dimension
        if place in ("path", "command"):
            return self.dimension.with_output_as_input()
        return self.dimension * E / U if place == "spring" and self.dimension.u else self.dimension
