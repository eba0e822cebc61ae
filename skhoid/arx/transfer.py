"""ARX coefficients as transfer functions of other libraries."""

from __future__ import annotations

from typing import Any

import numpy as np

from .orders import Orders


def transfer_function(
    orders: Orders, theta: np.ndarray, dt: float, inputs: list[str], output: str, backend: str
) -> Any:
    """Discrete-time transfer functions in positive powers of z."""
    a, b, _ = orders.split(theta)
    polynomials = []
    for row, nb, nk in zip(b, orders.nb, orders.nk, strict=True):
        degree = max(orders.na, nk + nb - 1)
        denominator = np.zeros(degree + 1)
        denominator[: orders.na + 1] = [1.0, *a]
        numerator = np.zeros(degree + 1)
        numerator[nk : nk + nb] = row[:nb]
        # Leading zeros are not coefficients; SciPy warns about them.
        numerator = np.trim_zeros(numerator, "f")
        polynomials.append((numerator if numerator.size else np.zeros(1), denominator))
    if backend == "control":
        try:
            import control
        except ImportError as error:
            raise ImportError(
                'backend="control" needs python-control: pip install "skhoid[control]".'
            ) from error
        numerators, denominators = zip(*polynomials, strict=True)
        return control.TransferFunction(
            [[n.tolist() for n in numerators]],
            [[d.tolist() for d in denominators]],
            dt,
            inputs=list(inputs),
            outputs=[output],
        )
    from scipy import signal

    systems = [signal.dlti(n, d, dt=dt) for n, d in polynomials]
    return systems[0] if len(systems) == 1 else dict(zip(inputs, systems, strict=True))
