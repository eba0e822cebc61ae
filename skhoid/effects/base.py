"""What an effect is."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, clone

from .error_scan import ErrorScan
from .record import Record
from .traces import Signature

PLACES = ("input", "delay", "gain", "path", "command", "spring", "sum", "output")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Parameters
    ----------
    name : str
        Name of the constructor argument; None there means that it is estimated.
    unit : str
        Unit, in which ``{e}`` and ``{u}`` stand for those of input and output.
    low, high : float
        Physical bounds, times ``scale``.
    starts : tuple of float
        Values to start estimation from, times ``scale``; one of each parameter at a time.
    scale : str
        ``"e"``, ``"u"`` or a product like ``"u/e"``: bounds and starts are in standard deviations
        of input and output; ``"T"`` in durations of a run; ``""`` as they are.
    meaning : str
        What it is, for tables.

    Examples
    --------
    >>> from skhoid.effects import Parameter
    >>> Parameter("width", "{e}", 0.0, 3.0, starts=(0.3, 1.0), scale="e").name
    'width'
    """

    name: str
    unit: str = "-"
    low: float = -np.inf
    high: float = np.inf
    starts: tuple[float, ...] = (1.0,)
    scale: str = ""
    meaning: str = ""

    def scale_of(self, record: Record) -> float:
        """The unit that bounds and starts are in."""
        value = 1.0
        if not self.scale:
            return value
        for i, factor in enumerate(self.scale.split("/")):
            for name in factor.split("*"):
                size = {"T": record.duration, "1": 1.0, "{s}": record.time_unit}.get(name)
                value *= (record.sd(name) if size is None else size) ** (1 if i == 0 else -1)
        return value


class Effect(BaseEstimator):
    """Base of all effects; a subclass is an effect of your own.

    A subclass names its ``parameters``, takes each as a keyword argument of ``__init__`` with the
    default None, and implements ``apply``.

    Attributes
    ----------
    name : str
        Fixed id, which tables, JSON and scripts use.
    place : str
        Where it acts: ``"input"`` maps the error, ``"delay"`` the delay, ``"gain"`` the gains on
        error and error rate, ``"path"`` adds to the command, ``"command"`` maps the command before
        the neuromuscular system, ``"spring"`` stiffens it, ``"sum"`` adds to the output and
        ``"output"`` maps it.
    physics : str
        One sentence.
    formula : str
        The same as a formula.
    source : str
        Where it comes from.
    parameters : tuple of Parameter
        Its numbers.
    smooth : bool
        Whether the response changes smoothly with the parameters; they are searched on a
        grid of their starts otherwise.
    shades : bool
        Whether the choices of ``form`` are shades of the first: a search tries the others only
        where that explains something.
    n_hidden : int
        How many numbers it finds in the data besides its parameters, such as the ends of
        intervals. They count in the BIC as parameters do.
    noise : str
        What it adds to the output, in words such as "a sine", where that is noise to a free run,
        since no input explains it; "" for all other effects. Noise is not fitted by a search but
        recognised by its ``signature``, and has a ``realisation`` for pictures.

    See Also
    --------
    skhoid.testing.check_effect : Checks of an effect of your own.

    Examples
    --------
    A response that grows ever more slowly with the error:

    >>> import numpy as np
    >>> from skhoid.effects import Effect, Parameter
    >>> class Compressed(Effect):
    ...     name = "compressed"
    ...     place = "input"
    ...     physics = "Large errors are answered less than in proportion."
    ...     formula = "e' = knee asinh(e / knee)"
    ...     parameters = (
    ...         Parameter(
    ...             "knee", "{e}", 0.01, 10.0, starts=(1.0,), scale="e", meaning="of the answer"
    ...         ),
    ...     )
    ...
    ...     def __init__(self, *, knee=None):
    ...         self.knee = knee
    ...
    ...     def apply(self, signal, record, knee):
    ...         return knee * np.arcsinh(signal / knee)
    >>> Compressed(knee=2.0)
    Compressed(knee=2.0)
    """

    name: ClassVar[str]
    place: ClassVar[str]
    physics: ClassVar[str] = ""
    formula: ClassVar[str] = ""
    source: ClassVar[str] = ""
    parameters: tuple[Parameter, ...] = ()
    smooth: bool = True
    shades: ClassVar[bool] = False
    n_hidden: int = 0
    noise: ClassVar[str] = ""

    def apply(self, signal: Any, record: Record, *args: Any, **values: Any) -> Any:
        """What comes out of the effect when ``signal`` goes in, at values of the parameters."""
        raise NotImplementedError(f"{type(self).__name__} must implement apply.")

    def refusal(self, record: Record, core: str) -> str | None:
        """Why the effect does not apply to a record and a core ("operator" or "arx"), or None."""
        return None

    def variants(self, record: Record) -> list[Effect]:
        """The effect with each choice that is open (form, channel) made: one object a choice."""
        return [self]

    def starts(self, record: Record) -> list[dict[str, float]]:
        """Values of the parameters to start estimation from, in the units of the data."""
        found: list[dict[str, float]] = [{}]
        for p in self.parameters_on(record):
            scale = p.scale_of(record)
            found = [{**f, p.name: s * scale} for f in found for s in p.starts]
        return found

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Starts found by a search of the effect's own, none by default.

        ``error_of(values, seconds)`` is what the best multiple of the simulated output leaves of
        the first seconds of the runs; see :class:`ErrorScan` for what else it tells.
        """
        return []

    def scanned_beside(
        self, error_of: ErrorScan, values: dict[str, float]
    ) -> list[dict[str, float]]:
        """Starts near values that were found, where the response is not smooth; none by default."""
        return []

    def adjusted(self, error_of: Callable[[Effect], float], record: Record) -> Effect:
        """The effect with choices that are no parameters adjusted after a first fit; itself, here.

        ``error_of(effect)`` is what the model leaves with another such effect in its place.
        """
        return self

    def softened(self, amount: float) -> Effect | None:
        """A smooth effect that becomes this one as ``amount`` goes from 0.2 to zero, or None.

        A search follows it where the effect itself is not smooth.
        """
        return None

    def signature(self, residual: np.ndarray, record: Record) -> Signature | None:
        """What the residual of a model (n_samples, n_runs) shows of ``noise``; None if nothing."""
        return None

    def realisation(
        self, values: dict[str, float], t: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times in seconds, by default such as show it well, and a course of ``noise`` at them."""
        raise NotImplementedError(f"{type(self).__name__} is noise and must implement realisation.")

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """Bounds of the parameters in the units of the data."""
        bounds = {}
        for p in self.parameters_on(record):
            scale = p.scale_of(record)
            bounds[p.name] = (p.low * scale, p.high * scale)
        return bounds

    def parameters_on(self, record: Record) -> tuple[Parameter, ...]:
        """The parameters in the units that the core of a record gives them."""
        return tuple(on_core(p, self.place, record) for p in self.parameters)

    @property
    def neutral(self) -> dict[str, float]:
        """Values at which the effect does nothing, where there are such."""
        return {}

    def derived(self, values: dict[str, float]) -> dict[str, tuple[float, str, str]]:
        """Further numbers of a fitted effect: value, unit and meaning by name.

        ``values`` holds the parameters of the core and, by their plain names, those of the effect.
        """
        return {}

    @property
    def free(self) -> list[Parameter]:
        """Parameters that are estimated."""
        return [p for p in self.parameters if getattr(self, p.name) is None]

    @property
    def fixed(self) -> dict[str, float]:
        """Parameters that are given."""
        return {
            p.name: float(getattr(self, p.name))
            for p in self.parameters
            if getattr(self, p.name) is not None
        }

    def with_choices(self, **choices: Any) -> Any:
        """A copy with some arguments set."""
        return clone(self).set_params(**choices)

    def one_of_each(self, argument: str, options: tuple[str, ...]) -> list[Any]:
        """A copy for each option of an argument, or for the one that is given."""
        given = getattr(self, argument)
        chosen = options if given is None else (given,)
        return [self.with_choices(**{argument: option}) for option in chosen]

    def __add__(self, other: Any) -> Any:
        from .composition import Effects

        return Effects.of(self) + other


def on_core(p: Parameter, place: str, record: Record) -> Parameter:
    """A parameter as the core of a record has it.

    Written for operators, whose command has the unit of the output. The command of an ARX model
    has that of its input; and what is slow or fast there, the output tells.
    """
    if record.core != "arx":
        return p
    unit, scale = p.unit, p.scale
    if place in ("path", "command"):
        unit = unit.replace("{u}", "{e}")
        unit = {"{e}/{e}": "-", "{e}/({e} s)": "1/s"}.get(unit, unit)
        scale = re.sub(r"(?<![\w.])u(?![\w.])", "e", scale)
    elif place == "spring":
        unit = {"1/{u}^2": "{e}/{u}^3", "1/{u}": "{e}/{u}^2"}.get(unit, unit)
        scale = f"e*{scale or 1}/u"
    if "T" not in re.split("[/*]", scale):
        power = power_of_seconds(p.unit)
        scale = "*".join(["{s}"] * max(power, 0) + [scale] * bool(scale)) or "1"
        scale += "/{s}" * max(-power, 0)
    return replace(p, unit=unit, scale=scale)


def power_of_seconds(unit: str) -> int:
    """Power of the second in a unit like ``{u} s/{e}`` or ``Hz``."""
    over, *under = (re.findall(r"[^\s()]+", part) for part in unit.split("/"))
    return over.count("s") - over.count("Hz") - sum(part.count("s") for part in under)
