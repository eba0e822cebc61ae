"""``ControlledElement``: dynamics between single and double integrator (Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .checks import check_parameters
from .variation import Parameter, frozen


@dataclass(frozen=True)
class ControlledElement:
    """Second-order controlled element (Eq. 1).

    H_CE(s, t) = K_c(t) / (s (s + omega_b(t))): a single integrator well below ``omega_b``, a
    double integrator well above. When parameters vary, v' = K_c(t) u - omega_b(t) v, x' = v.

    Parameters
    ----------
    K_c : float or callable, default=90.0
        Gain, in units of x per unit of u and s². A function of time takes an array of instants (s).
    omega_b : float or callable, default=6.0
        Break frequency in rad/s.

    Raises
    ------
    ValueError
        If a parameter is negative or not finite.

    Examples
    --------
    >>> from skhoid import ControlledElement, Sigmoid
    >>> ControlledElement(K_c=30.0, omega_b=0.2).frequency_response(2.0).round(3)
    np.complex128(-7.426-0.743j)
    >>> ControlledElement(K_c=Sigmoid(90, 30, rate=0.5, time=40.96), omega_b=6.0)
    ControlledElement(K_c=Sigmoid(initial=90, final=30, rate=0.5, time=40.96), omega_b=6.0)
    """

    K_c: Parameter = 90.0
    omega_b: Parameter = 6.0

    def __post_init__(self) -> None:
        check_parameters(self, "K_c", "omega_b")

    def at(self, t: float) -> ControlledElement:
        """The controlled element frozen at one instant.

        Parameters
        ----------
        t : float
            Time in s.

        Returns
        -------
        controlled_element : ControlledElement
        """
        return ControlledElement(**frozen(self, t, "K_c", "omega_b"))

    def frequency_response(self, omega: Any, t: float = 0.0) -> np.ndarray:
        """H_CE(j omega), with parameters frozen at ``t``.

        Parameters
        ----------
        omega : array-like of shape (n_frequencies,)
            Frequencies in rad/s.
        t : float, default=0.0
            Time in s.

        Returns
        -------
        H : ndarray of complex, shape (n_frequencies,)
            Infinite at zero frequency.
        """
        s = 1j * np.asarray(omega, dtype=float)
        K_c, omega_b = frozen(self, t, "K_c", "omega_b").values()
        with np.errstate(divide="ignore", invalid="ignore"):
            return K_c / (s * (s + omega_b))
