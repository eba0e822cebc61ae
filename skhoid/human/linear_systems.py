"""What describes a controlled element (text, python-control, SciPy), as a ``LinearElement``."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.signal import ss2tf

from .._sklearn import HasMethods
from .controlled_element import ControlledElement
from .element_text import EXAMPLES
from .linear_element import TINY, LinearElement

# What estimators take as ``controlled_element``: of SciPy and of python-control by their methods.
ELEMENT = [ControlledElement, LinearElement, str, HasMethods("to_tf"), HasMethods("dcgain"), None]


def as_element(system: Any, dt: float | None = None) -> LinearElement:
    """A constant controlled element, however it was given; see ``LinearElement.of``."""
    if isinstance(system, str):
        return LinearElement.from_text(system, dt)
    if dt is not None:
        raise ValueError("dt is for a controlled element written as text; others have their own.")
    if isinstance(system, LinearElement):
        return system
    if isinstance(system, ControlledElement):
        return _constant(system)
    if all(hasattr(system, name) for name in "ABCD"):
        return _of_state_space(system)
    if hasattr(system, "to_tf"):  # of SciPy
        system = system.to_tf()
    if hasattr(system, "num") and hasattr(system, "den"):
        return LinearElement(
            tuple(_only(system.num)), tuple(_only(system.den)), _sampling_time(system)
        )
    raise TypeError(
        f"controlled_element must be a ControlledElement, a text such as {EXAMPLES}, or a transfer "
        f"function or state space of python-control or SciPy; got {system!r}."
    )


def simplest(element: LinearElement) -> ControlledElement | LinearElement:
    """The same element, as a ``ControlledElement`` where it has that form."""
    constants = element.constants
    return element if constants is None else ControlledElement(*constants)


def _constant(element: ControlledElement) -> LinearElement:
    K_c, omega_b = element.K_c, element.omega_b
    if callable(K_c) or callable(omega_b):
        raise ValueError(
            "controlled_element must be constant here; got one that varies in time. Pass it at one "
            "instant, controlled_element.at(t), or None to estimate it."
        )
    return LinearElement((float(K_c),), (1.0, float(omega_b), 0.0))


def _only(coefficients: Any) -> np.ndarray:
    """The coefficients of one input and one output, which python-control nests in lists."""
    while len(coefficients) == 1 and np.ndim(coefficients[0]) > 0:
        coefficients = coefficients[0]
    if np.ndim(coefficients[0]) > 0:
        raise ValueError(
            "controlled_element has several inputs or outputs. Give the part from u to x."
        )
    return np.asarray(coefficients, dtype=float)


def _sampling_time(system: Any) -> float | None:
    dt = getattr(system, "dt", None)
    if dt is True:
        raise ValueError(
            "controlled_element is discrete and does not say its sampling time. Make it with "
            "dt=..., in seconds."
        )
    return float(dt) if dt else None


def _of_state_space(system: Any) -> LinearElement:
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(system, name), dtype=float)) for name in "ABCD")
    if D.shape != (1, 1):
        raise ValueError(
            f"controlled_element has {D.shape[1]} inputs and {D.shape[0]} outputs. Give the part "
            "from u to x."
        )
    if not A.size:
        return LinearElement((D[0, 0],), (1.0,), _sampling_time(system))
    top, bottom = ss2tf(A, B, C, D)
    poles = np.linalg.eigvals(A)
    if np.any(np.abs(poles) < TINY * max(1.0, np.abs(poles).max())):
        # Integrators, to which the characteristic polynomial gives the rounding of the others.
        poles = np.where(np.abs(poles) < TINY * max(1.0, np.abs(poles).max()), 0.0, poles)
        bottom = np.real(np.poly(poles))
    top = np.where(np.abs(top[0]) < TINY * np.abs(top).max(), 0.0, top[0])
    return LinearElement(tuple(top), tuple(bottom), _sampling_time(system))
