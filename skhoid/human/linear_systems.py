"""Transfer functions and state spaces of python-control and SciPy, as coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.signal import ss2tf

from .element_text import EXAMPLES

TINY = 1e-12  # relative to the largest coefficient: rounding

# Numerator, denominator and, of a discrete one, the sampling time in seconds.
Coefficients = tuple[tuple[float, ...], tuple[float, ...], float | None]


def coefficients_of(system: Any) -> Coefficients:
    """Numerator, denominator and sampling time of a system of one input and one output."""
    if hasattr(system, "constant_coefficients"):  # a ControlledElement
        return system.constant_coefficients()
    if all(hasattr(system, name) for name in "ABCD"):
        return _of_state_space(system)
    if hasattr(system, "to_tf"):  # of SciPy
        system = system.to_tf()
    if hasattr(system, "num") and hasattr(system, "den"):
        return tuple(_only(system.num)), tuple(_only(system.den)), _sampling_time(system)
    raise TypeError(
        f"controlled_element must be a ControlledElement, a text such as {EXAMPLES}, or a transfer "
        f"function or state space of python-control or SciPy; got {system!r}."
    )


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
            "controlled_element is discrete but has no sampling time. Make it with "
            "dt=..., in seconds."
        )
    return float(dt) if dt else None


def _of_state_space(system: Any) -> Coefficients:
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(system, name), dtype=float)) for name in "ABCD")
    if D.shape != (1, 1):
        raise ValueError(
            f"controlled_element has {D.shape[1]} inputs and {D.shape[0]} outputs. Give the part "
            "from u to x."
        )
    if not A.size:
        return (D[0, 0],), (1.0,), _sampling_time(system)
    top, bottom = ss2tf(A, B, C, D)
    poles = np.linalg.eigvals(A)
    if np.any(np.abs(poles) < TINY * max(1.0, np.abs(poles).max())):
        # Integrators, to which the characteristic polynomial gives the rounding of the others.
        poles = np.where(np.abs(poles) < TINY * max(1.0, np.abs(poles).max()), 0.0, poles)
        bottom = np.real(np.poly(poles))
    top = np.where(np.abs(top[0]) < TINY * np.abs(top).max(), 0.0, top[0])
    return tuple(top), tuple(bottom), _sampling_time(system)
