"""Parameters that vary in time, their values at instants, and checks of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
from scipy.special import expit


def as_floats(value: Any, what: str) -> np.ndarray:
    """One number or several as an array; anything else raises an error that names it."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise TypeError(f"{what} must hold numbers; got {value!r}.") from None


def check_finite(owner: Any, *names: str) -> None:
    """Raise unless these attributes are finite numbers."""
    for name in names:
        value = getattr(owner, name)
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not (number and -np.inf < value < np.inf):
            raise ValueError(
                f"{type(owner).__name__}: {name} must be a finite number; got {value!r}."
            )


def check_positive(owner: Any, *names: str, zero: bool = False) -> None:
    """Raise unless these attributes are finite and positive (or zero)."""
    check_finite(owner, *names)
    for name in names:
        value = getattr(owner, name)
        if value < 0 or (value == 0 and not zero):
            what = "zero or positive" if zero else "positive"
            raise ValueError(f"{type(owner).__name__}: {name} must be {what}; got {value!r}.")


def check_parameters(owner: Any, *names: str, zero: bool = True) -> None:
    """Raise unless these parameters are functions of time, or positive numbers (or zero)."""
    for name in names:
        if not callable(getattr(owner, name)):
            check_positive(owner, name, zero=zero)


INSTANTS = ("time", "start", "end")  # parameters of transitions that are times
SATURATED = 40.0  # exp(-40) is below rounding
Parameter = float | Callable[[np.ndarray], np.ndarray]
Span = tuple[float, float]


@dataclass(frozen=True)
class Transition:
    """What :class:`Sigmoid`, :class:`Step` and :class:`Ramp` share: values before and after."""

    initial: float
    final: float

    def __call__(self, t: Any) -> np.ndarray:
        progress = self._progress(np.asarray(t, dtype=float))
        return (1.0 - progress) * self.initial + progress * self.final

    def _progress(self, t: np.ndarray) -> np.ndarray:
        """How much of the transition has happened, 0 to 1."""
        raise NotImplementedError


@dataclass(frozen=True)
class Sigmoid(Transition):
    """Smooth transition between two values (Eq. 2, Fig. 2).

    p(t) = p_i + (p_f - p_i) / (1 + exp(-G (t - t_M))).

    Parameters
    ----------
    initial, final : float
        Values p_i and p_f, in the unit of the parameter.
    rate : float
        G in 1/s. The steepest slope is G (p_f - p_i) / 4; from G = 10 1/s on the transition is
        close to a step.
    time : float
        t_M in s: the instant at which half of the transition has happened.

    Examples
    --------
    >>> from skhoid import Sigmoid
    >>> K_c = Sigmoid(90.0, 30.0, rate=0.5, time=40.96)
    >>> K_c([0.0, 40.96, 81.92]).round(3)
    array([90., 60., 30.])
    """

    rate: float
    time: float

    def __post_init__(self) -> None:
        check_finite(self, "initial", "final", "time")
        check_positive(self, "rate")

    def _progress(self, t: np.ndarray) -> np.ndarray:
        return expit(self.rate * (t - self.time))

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes, to rounding."""
        return self.time - SATURATED / self.rate, self.time + SATURATED / self.rate


@dataclass(frozen=True)
class Step(Transition):
    """Sudden transition between two values.

    Parameters
    ----------
    initial, final : float
        Values before, and from ``time`` on.
    time : float
        Instant of the step in s.

    Examples
    --------
    >>> from skhoid import Step
    >>> Step(0.0, 1.0, time=2.0)([1.9, 2.0])
    array([0., 1.])
    """

    time: float

    def __post_init__(self) -> None:
        check_finite(self, "initial", "final", "time")

    def _progress(self, t: np.ndarray) -> np.ndarray:
        return np.where(t >= self.time, 1.0, 0.0)

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes."""
        return self.time, self.time


@dataclass(frozen=True)
class Ramp(Transition):
    """Linear transition between two values (Fig. 3.2).

    Parameters
    ----------
    initial, final : float
        Values before ``start`` and after ``end``.
    start, end : float
        Instants in s between which the value changes linearly.

    Examples
    --------
    >>> from skhoid import Ramp
    >>> Ramp(0.0, 1.0, start=10.0, end=20.0)([0.0, 15.0, 30.0])
    array([0. , 0.5, 1. ])
    """

    start: float
    end: float

    def __post_init__(self) -> None:
        check_finite(self, "initial", "final", "start", "end")
        if self.end <= self.start:
            raise ValueError(
                f"Ramp: end must be later than start; got start={self.start} s and "
                f"end={self.end} s. For a sudden change use Step."
            )

    def _progress(self, t: np.ndarray) -> np.ndarray:
        return np.interp(t, [self.start, self.end], [0.0, 1.0])

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes."""
        return self.start, self.end


@dataclass(frozen=True)
class Mixture:
    """Mixture of two functions of time (Eq. 3.7).

    p(t) = (1 - w(t)) p_1(t) + w(t) p_2(t), for parameters and forcing functions that change within
    a run.

    Parameters
    ----------
    first, second : float or callable
        p_1 and p_2: numbers or functions of time (s).
    weight : float or callable
        w(t), the control mode of Eq. 3.7: 0 is the first, 1 the second.

    Examples
    --------
    >>> from skhoid import Mixture, Ramp, Sigmoid
    >>> K_e = Mixture(0.09, Sigmoid(0.07, 0.05, rate=1.0, time=60.0), weight=Ramp(0, 1, 20, 30))
    >>> K_e([0.0, 25.0, 100.0]).round(3)
    array([0.09, 0.08, 0.05])
    """

    first: Parameter
    second: Parameter
    weight: Parameter

    def __call__(self, t: Any) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        first, second, weight = (evaluate(p, t) for p in (self.first, self.second, self.weight))
        return (1.0 - weight) * first + weight * second

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes."""
        return find_span(self.first, self.second, self.weight)


@dataclass(frozen=True)
class Shifted:
    """The function ``lag`` seconds later, plus ``extra`` (a number or function of time)."""

    function: Parameter
    lag: float = 0.0
    extra: Parameter = 0.0

    def __call__(self, t: Any) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        return evaluate(self.function, t - self.lag) + evaluate(self.extra, t)

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes."""
        own, extra = find_span(self.function), find_span(self.extra)
        return min(own[0] + self.lag, extra[0]), max(own[1] + self.lag, extra[1])


@dataclass(frozen=True)
class Product:
    """Product of two functions of time."""

    first: Parameter
    second: Parameter

    def __call__(self, t: Any) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        return evaluate(self.first, t) * evaluate(self.second, t)

    @property
    def changes(self) -> Span:
        """Times in s before and after which nothing changes."""
        return find_span(self.first, self.second)


def read_instants(t: Any) -> np.ndarray:
    """Instants in s, one or some, as an array."""
    instants = as_floats(t, "t")
    if instants.ndim > 1:
        raise ValueError(
            f"t must be an instant in s, or an array of shape (n_instants,); got {instants.shape}."
        )
    return instants


def evaluate(parameter: Parameter, t: np.ndarray) -> np.ndarray:
    """Values at the instants ``t`` (s) of a number or a function of time."""
    if not callable(parameter):
        return np.full(t.shape, float(parameter))
    try:
        return np.broadcast_to(np.asarray(parameter(t), dtype=float), t.shape)
    except Exception as error:
        raise ValueError(
            f"The function of time {parameter!r} must take an array of instants in s and return "
            f"as many numbers, or one; it failed for {t.size} instants: {error}"
        ) from error


def freeze(owner: Any, t: float, *names: str) -> dict[str, float]:
    """The parameters at one instant, as numbers."""
    instant = np.array([float(t)])
    return {name: float(evaluate(getattr(owner, name), instant)[0]) for name in names}


def mix(first: Parameter, second: Parameter, weight: Parameter) -> Parameter:
    """A :class:`Mixture`, or the number or transition to which it simplifies."""
    if not callable(first) and not callable(second):
        if first == second:
            return first
        if not callable(weight):
            return (1.0 - weight) * first + weight * second
        if isinstance(weight, Transition) and (weight.initial, weight.final) == (0, 1):
            return replace(weight, initial=float(first), final=float(second))
    return Mixture(first, second, weight)


def find_transition(*parameters: Parameter | None) -> Any:
    """The transition from 0 to 1 that the first varying parameter follows; None without any."""
    for parameter in parameters:
        if isinstance(parameter, Transition) and parameter.initial != parameter.final:
            return replace(parameter, initial=0.0, final=1.0)
        if isinstance(parameter, Shifted) and (own := find_transition(parameter.function)):
            times = {n: getattr(own, n) for n in INSTANTS if hasattr(own, n)}
            return replace(own, **{name: time + parameter.lag for name, time in times.items()})
        if isinstance(parameter, Mixture) and isinstance(parameter.weight, Transition):
            return find_transition(parameter.weight)
    return None


def find_span(*parameters: Parameter) -> Span:
    """Times in s before and after which none of the parameters changes any more, to rounding."""
    spans = [getattr(p, "changes", (-np.inf, np.inf)) for p in parameters if callable(p)]
    begins, ends = zip((np.inf, -np.inf), *spans, strict=True)
    return min(begins), max(ends)
