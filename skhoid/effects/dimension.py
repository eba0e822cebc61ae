"""Dimensions of parameters as exponents of units; add a unit for labels here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any


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

    def __post_init__(self) -> None:
        exponents = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "channels"}
        exponents.update({f"[{name}]": power for name, power in self.channels})
        for name, power in exponents.items():
            if not isinstance(power, int) or isinstance(power, bool):
                raise TypeError(
                    f"Dimension: the exponent of {name} must be a whole number; got {power!r}. "
                    "Write, say, Dimension(u=1, e=-2) for the output per square of the input."
                )

    @classmethod
    def of_channel(cls, name: str | None) -> Dimension:
        """The unit of a channel.

        Parameters
        ----------
        name : str or None
            Its name; None while the choice is open.

        Returns
        -------
        dimension : Dimension
        """
        return cls(channels=((str(name), 1),))

    @classmethod
    def of_role(cls, role: str) -> Dimension:
        """The unit of the channel of a role, whatever its name.

        Parameters
        ----------
        role : {"x", "f_t"}
            Role.

        Returns
        -------
        dimension : Dimension
        """
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
        own = {f.name: getattr(self, f.name) * power for f in fields(self) if f.name != "channels"}
        return Dimension(**own, channels=tuple((n, p * power) for n, p in self.channels if power))

    def __mul__(self, other: Dimension) -> Dimension:
        if not isinstance(other, Dimension):
            return NotImplemented
        powers = dict(self.channels)
        for name, power in other.channels:
            powers[name] = powers.get(name, 0) + power
        own = {
            f.name: getattr(self, f.name) + getattr(other, f.name)
            for f in fields(self)
            if f.name != "channels"
        }
        return Dimension(**own, channels=tuple(sorted((n, p) for n, p in powers.items() if p)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1 if isinstance(other, Dimension) else NotImplemented

    def with_output_as_input(self) -> Dimension:
        """The same dimension, with the unit of the output replaced by that of the input."""
        return replace(self, u=0, e=self.e + self.u)

    def label(self, units: Mapping[str, str | None] | None = None) -> str:
        """The unit as text.

        Parameters
        ----------
        units : dict of str to str or None, default=None
            Units of ``"u"``, ``"e"`` and, by the name in brackets, of channels: ``"[speed]"``.
            Unknown units are shown as names in brackets.

        Returns
        -------
        label : str
        """
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
        'seconds, Dimension(e=1) / Dimension.of_channel("speed") for the input per unit of a '
        "channel, Dimension() for a number without unit; its label follows."
    )


ONE = Dimension()
U = Dimension(u=1)
E = Dimension(e=1)
S = Dimension(s=1)
RAD = Dimension(rad=1)
HZ = Dimension(Hz=1)
T = Dimension(T=1)
