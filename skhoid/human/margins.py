"""Crossover frequency and phase margin of physical objects, without a frequency grid."""

from __future__ import annotations

import warnings
from numbers import Real
from typing import Any

import numpy as np
from scipy.optimize import brentq

from .._sklearn import HasMethods, checked
from .variation import instants_of

# The grid only brackets the crossing; gains of operators are smooth on this scale.
GRID = np.linspace(np.log(1e-3), np.log(1e3), 400)


@checked(
    operator=[HasMethods("frequency_response")],
    controlled_element=[HasMethods("frequency_response")],
    t=[Real, "array-like"],
)
def crossover(operator: Any, controlled_element: Any, t: Any = 0.0) -> tuple[Any, Any]:
    """Crossover frequency and phase margin of operator and controlled element.

    omega_c solves ``|H_OL(j omega_c)| = 1`` with H_OL = H_HO H_CE, to rounding; the phase margin is
    180 deg plus the phase of H_OL there (Eqs. 5.9-5.10, which are read on multiples of 2 pi / T_m).

    Parameters
    ----------
    operator : HumanOperator, or object with ``frequency_response(omega, t)``
        Response to the error.
    controlled_element : ControlledElement, or object with ``frequency_response(omega, t)``
        Controlled element.
    t : float or array-like of shape (n_instants,), default=0.0
        Instants in s at which both are frozen.

    Returns
    -------
    omega_c : float, or ndarray of shape (n_instants,)
        Crossover frequency in rad/s: the highest between 1e-3 and 1e3 rad/s at which the gain
        falls through 1. NaN where there is none.
    phase_margin : float, or ndarray of shape (n_instants,)
        Phase margin in degrees, in (-180, 180].

    Warns
    -----
    UserWarning
        With the number of instants without a crossover.

    See Also
    --------
    skhoid.interpret.crossover_path : The same from a path of ARX parameters.

    Examples
    --------
    >>> from skhoid import ControlledElement, HumanOperator
    >>> from skhoid import crossover
    >>> omega_c, phase_margin = crossover(HumanOperator(), ControlledElement())
    >>> round(omega_c, 3), round(phase_margin, 2)
    (1.563, 76.67)
    """
    instants = np.atleast_1d(instants_of(t))
    found = np.array([_at(operator, controlled_element, float(instant)) for instant in instants])
    found = found.reshape(-1, 2)
    n_lost = int(np.isnan(found[:, 0]).sum())
    if n_lost:
        warnings.warn(
            f"{n_lost} of {instants.size} instants have no crossover, the first at t = "
            f"{instants[np.isnan(found[:, 0])][0]:g} s: the gain of operator times controlled "
            "element does not fall through 1 between 1e-3 and 1e3 rad/s. Both results are NaN "
            "there.",
            UserWarning,
            stacklevel=2,
        )
    if np.ndim(t) == 0:
        return float(found[0, 0]), float(found[0, 1])
    return found[:, 0], found[:, 1]


def _at(operator: Any, controlled_element: Any, t: float) -> tuple[float, float]:
    def open_loop(log_omega: Any) -> Any:
        omega = np.exp(log_omega)
        return operator.frequency_response(omega, t) * controlled_element.frequency_response(
            omega, t
        )

    def log_gain(log_omega: Any) -> Any:
        with np.errstate(divide="ignore"):
            return np.log(np.abs(open_loop(log_omega)))

    gain = log_gain(GRID)
    falling = np.flatnonzero((gain[:-1] > 0) & (gain[1:] <= 0))
    if falling.size == 0:
        return np.nan, np.nan
    low, high = GRID[falling[-1]], GRID[falling[-1] + 1]
    root = brentq(log_gain, low, high, xtol=1e-14, rtol=8.9e-16)
    return float(np.exp(root)), float(phase_margin(open_loop(root)))


def phase_margin(response: Any) -> Any:
    """Angle of an open loop from the negative real axis in degrees, in (-180, 180]."""
    return np.degrees(np.angle(-response))
