"""``ControlledElement``: dynamics between single and double integrator (Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._sklearn import HasMethods
from .linear_element import LinearElement, is_number
from .variation import Parameter, check_parameters, freeze


@dataclass(frozen=True)
class ControlledElement:
    """Second-order controlled element (Eq. 1).

    H_CE(s, t) = K_c(t) / (s (s + omega_b(t))): a single integrator well below ``omega_b``, a
    double integrator well above. When parameters vary, v' = K_c(t) u - omega_b(t) v, x' = v. Any
    other linear element, given as text or by coefficients, becomes a :class:`LinearElement`.

    Parameters
    ----------
    K_c : float, callable or str, default=90.0
        Gain, in units of x per unit of u and s². A function of time takes an array of instants (s).
        A string such as ``"1/(s(s+1))"`` is the whole transfer function.
    omega_b : float or callable, default=6.0
        Break frequency in rad/s.
    numerator, denominator : sequence of float or None, default=None
        Coefficients in falling powers of s (of z with ``dt``), in place of ``K_c`` and ``omega_b``.
    dt : float or None, default=None
        Sampling time in seconds of a discrete element, given by a string in z or by coefficients.

    Examples
    --------
    >>> from skhoid import ControlledElement, Sigmoid
    >>> ControlledElement(K_c=30.0, omega_b=0.2).frequency_response(2.0).round(3)
    np.complex128(-7.426-0.743j)
    >>> ControlledElement(K_c=Sigmoid(90, 30, rate=0.5, time=40.96), omega_b=6.0)
    ControlledElement(K_c=Sigmoid(initial=90, final=30, rate=0.5, time=40.96), omega_b=6.0)
    >>> ControlledElement("1/(s(s+1))")
    LinearElement(numerator=(1.0,), denominator=(1.0, 1.0, 0.0))
    """

    K_c: Parameter = 90.0
    omega_b: Parameter = 6.0

    def __new__(
        cls,
        K_c: Parameter | str = 90.0,
        omega_b: Parameter = 6.0,
        *,
        numerator: Sequence[float] | None = None,
        denominator: Sequence[float] | None = None,
        dt: float | None = None,
    ) -> Any:
        """An element of this form, or a ``LinearElement`` for any other."""
        if isinstance(K_c, str) and not is_number(K_c):
            return LinearElement.of(K_c, dt)
        if numerator is not None and denominator is not None:
            return LinearElement(tuple(numerator), tuple(denominator), dt)
        if numerator is not None or denominator is not None:
            raise ValueError("ControlledElement: give numerator and denominator together.")
        if dt is not None:
            raise ValueError(
                "ControlledElement: dt is for a discrete element, given by a string in z or by "
                "coefficients; K_c and omega_b describe a continuous one."
            )
        return super().__new__(cls)

    if TYPE_CHECKING:

        def __init__(
            self,
            K_c: Parameter | str = 90.0,
            omega_b: Parameter = 6.0,
            *,
            numerator: Sequence[float] | None = None,
            denominator: Sequence[float] | None = None,
            dt: float | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        check_parameters(self, "K_c", "omega_b")

    def at(self, t: float) -> ControlledElement:
        """The controlled element frozen at one instant.

        Parameters
        ----------
        t : float
            Time in s.
        """
        K_c, omega_b = freeze(self, t, "K_c", "omega_b").values()
        return ControlledElement(K_c, omega_b)

    def constant_coefficients(self) -> tuple[tuple[float, ...], tuple[float, ...], None]:
        """Numerator, denominator (falling powers of s) and None, of a constant element."""
        K_c, omega_b = self.K_c, self.omega_b
        if callable(K_c) or callable(omega_b):
            raise ValueError(
                "controlled_element must be constant here; got one that varies in time. Freeze it "
                "at one instant, controlled_element.at(t), or pass None to estimate it."
            )
        return (float(K_c),), (1.0, float(omega_b), 0.0), None

    def frequency_response(self, omega: Any, t: float = 0.0) -> np.ndarray:
        """H_CE(j omega), with parameters frozen at ``t``; infinite at zero frequency.

        Parameters
        ----------
        omega : array-like of shape (n_frequencies,)
            Frequencies in rad/s.
        t : float, default=0.0
            Time in s.
        """
        s = 1j * np.asarray(omega, dtype=float)
        K_c, omega_b = freeze(self, t, "K_c", "omega_b").values()
        with np.errstate(divide="ignore", invalid="ignore"):
            return K_c / (s * (s + omega_b))


# What estimators accept as ``controlled_element``: SciPy and python-control objects by their
# methods.
ELEMENT = [ControlledElement, LinearElement, str, HasMethods("to_tf"), HasMethods("dcgain"), None]


def simplify(element: LinearElement) -> ControlledElement | LinearElement:
    """The same element, as a ``ControlledElement`` where it has that form."""
    constants = element.constants
    return element if constants is None else ControlledElement(*constants)
