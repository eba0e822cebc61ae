"""Parameters of effects: name, dimension, bounds and starts, also in units of the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .core_kind import CoreKind
from .dimension import ONE, Dimension, E, U, checked
from .record import Record


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

    def __post_init__(self) -> None:
        own = checked(self.dimension, f"The dimension of the parameter {self.name!r}")
        if own.T:
            raise ValueError(
                f"The dimension of the parameter {self.name!r} must be in seconds, s; got "
                "durations of a run, T. Those are for its scale."
            )
        if self.scale is None:
            return
        scale = checked(self.scale, f"The scale of the parameter {self.name!r}")
        fits = scale.u == own.u and scale.inputs == own.inputs and scale.seconds in (0, own.seconds)
        if scale != ONE and not fits:
            raise ValueError(
                f"The scale of the parameter {self.name!r}, {scale.label()}, does not fit its "
                f"dimension, {own.label()}. Leave it out for standard deviations of what the "
                "dimension names, or write Dimension() for the units of the data."
            )

    def scale_of(self, record: Record, place: str = "") -> float:
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

    def dimension_on(self, record: Record, place: str) -> Dimension:
        """The dimension in the core of a record, for an effect of a place.

        Written for operators, whose command has the unit of the output. The command of an ARX model
        has that of its input; there the output determines what is slow or fast.
        """
        if record.core != CoreKind.ARX:
            return self.dimension
        if place in ("path", "command"):
            return self.dimension.with_output_as_input()
        return self.dimension * E / U if place == "spring" and self.dimension.u else self.dimension
