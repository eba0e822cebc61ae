"""Signals inside the operator that effects change: gains, spring, command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from .. import _kernels

if TYPE_CHECKING:
    from .record import Record

STOPS, SHARP, TABLE, SPRING = 2.0, 3.0, 4.0, 5.0  # kinds of terms, as ``arx_inside`` has them
N_PLACES = 513  # at which a force of any shape is given


class Gains(NamedTuple):
    """Factors on parameters of the core, of shape (1 or n_samples, 1 or n_runs).

    Attributes
    ----------
    error, rate : ndarray
        On the gains on error and error rate when the error is seen; an ARX model has the first
        only.
    omega, zeta : ndarray
        On neuromuscular frequency and damping, of shape (1 or n_samples, 1).
    """

    error: np.ndarray
    rate: np.ndarray
    omega: np.ndarray
    zeta: np.ndarray

    def times(self, factor: np.ndarray) -> Gains:
        """The same factor on the gains on error and error rate."""
        return self._replace(error=self.error * factor, rate=self.rate * factor)


class Spring(NamedTuple):
    """What opposes the command in addition to the linear spring: cubic u^3 + square u abs(u).

    Attributes
    ----------
    cubic, square : float
        In units of the command per unit of the output to the power 3 and 2.
    terms : tuple of (float, ...)
        Further forces of the output and its rate, and stops: the rows of numbers that the kernels
        ``arx_inside`` and ``limb_inside`` take. Operators have dry friction in the limb, and forces
        of any shape.
    curves : tuple of ndarray of shape (N_PLACES,)
        Forces given as tables, by their values at equal distances; terms refer to them.
    """

    cubic: float = 0.0
    square: float = 0.0
    terms: tuple[tuple[float, ...], ...] = ()
    curves: tuple[np.ndarray, ...] = ()

    def stiffer(self, cubic: float = 0.0, square: float = 0.0) -> Spring:
        """The spring with a further one in parallel."""
        return self._replace(cubic=self.cubic + cubic, square=self.square + square)

    def resisted(self, *term: float) -> Spring:
        """With a further force or stop: kind, of the rate or not, and four numbers."""
        return self._replace(terms=(*self.terms, tuple(float(number) for number in term)))

    def bent(self, values: np.ndarray, low: float, high: float, *, of_rate: bool = False) -> Spring:
        """With a force of the output, or of its rate, by its values from ``low`` to ``high``.

        It is linear between its N_PLACES values, and beyond them.
        """
        step = (high - low) / (N_PLACES - 1)
        term = self.resisted(TABLE, of_rate, low, step, len(self.curves), 0.0)
        return term._replace(curves=(*self.curves, values))

    @property
    def tables(self) -> np.ndarray:
        """The curves as rows of an array of shape (n_curves, N_PLACES)."""
        return np.array(self.curves, dtype=float).reshape(-1, N_PLACES)

    @property
    def table(self) -> np.ndarray:
        """The terms as rows of an array of shape (n_terms, 6)."""
        return np.array(self.terms, dtype=float).reshape(-1, 6)

    @property
    def whole_table(self) -> np.ndarray:
        """``table`` with the cubic and square spring as one of its rows."""
        return self.resisted(SPRING, 0.0, self.cubic, self.square, 0.0, 0.0).table

    def force(self, output: np.ndarray, rate: np.ndarray | None = None) -> np.ndarray:
        """Force at an output and its rate (None: zero), beyond that of the linear spring."""
        held = (self.cubic * output**2 + self.square * np.abs(output)) * output
        if not self.terms:
            return held
        rate = np.zeros_like(output) if rate is None else rate
        gate = _kernels.gate
        return held + _kernels.inside.resistances(
            gate(self.table), self.tables, gate(output), gate(rate)
        )

    @property
    def friction(self) -> float:
        """Dry friction against the motion of the limb, in units of the command."""
        return sum((t[2] for t in self.terms if t[0] == SHARP and t[1] != 0.0), 0.0)

    @property
    def stops(self) -> tuple[float, float]:
        """Least and greatest output."""
        lows, highs = zip(
            (-np.inf, np.inf), *(t[2:4] for t in self.terms if t[0] == STOPS), strict=True
        )
        return max(lows), min(highs)


class Command(NamedTuple):
    """Command before the neuromuscular system: position + d(rate)/dt.

    Attributes
    ----------
    position, rate : ndarray of shape (n_samples, n_runs)
        In units of the output, and of output times seconds.
    error : ndarray of shape (n_samples, n_runs)
        The error that the command responds to, delayed.
    delay : float or ndarray
        Delay of the response to the error in seconds.
    """

    position: np.ndarray
    rate: np.ndarray
    error: np.ndarray
    delay: float | np.ndarray

    def plus(self, position: np.ndarray, rate: np.ndarray | None = None) -> Command:
        """The command with an additional response."""
        added = self._replace(position=self.position + position)
        return added if rate is None else added._replace(rate=self.rate + rate)


def shaped(command: Any, record: Record, b: list[float], a: list[float]) -> Any:
    """A command through b(s) / a(s), both with s^2, s and 1."""
    poles = bilinear(b, a, record.dt)
    position, rate = (lfilter(*poles, x, axis=0) for x in (command.position, command.rate))
    return command._replace(position=position, rate=rate)


def bilinear(b: Any, a: Any, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients in z^-1 of b(s) / a(s), both of s^2, s and 1, by Tustin's rule."""
    c = 2.0 / dt
    to_z = np.array([[c * c, c, 1.0], [-2 * c * c, 0.0, 2.0], [c * c, -c, 1.0]])
    numerator, denominator = to_z @ np.asarray(b, float), to_z @ np.asarray(a, float)
    return numerator / denominator[0], denominator / denominator[0]
