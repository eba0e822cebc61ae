"""Free runs of an ARX core with forces in its recursion, or dynamics that follow a channel."""

from __future__ import annotations

import numpy as np

from .. import _kernels
from ..effects.operator_signals import Spring

AT_ONE = 1e-9  # distance from 1 within which a pole integrates


def simulate_inside(
    x: np.ndarray,
    polynomials: tuple[np.ndarray, np.ndarray, float],
    n_late: int,
    spring: Spring,
    omega: np.ndarray,
    dt: float,
    bound: float,
    begun: np.ndarray | None = None,
) -> np.ndarray:
    """Output of shape (n_samples, n_runs) for an input of that shape.

    ``polynomials`` are the coefficients a and b, the first ``n_late`` of b being dead time, and the
    constant; forces pass through b without the dead time, as a machine's friction acts at once, but
    springs pass through all of it.
    ``omega`` of shape (1 or n_samples, 1 or n_runs) multiplies the natural frequencies. ``begun``
    adds the effect of what came before to the first samples of the recursion; None begins at rest.
    """
    first = np.zeros((0, x.shape[1])) if begun is None else begun
    a, b, constant = polynomials
    force = _kernels.gate(b[n_late:])
    stiff = np.array([spring.cubic, spring.square])
    tables, rows = spring.tables, spring.table
    springs = (rows[:, 0] == _kernels.inside.TABLE) & (rows[:, 1] == 0.0)
    bends, terms = _kernels.gate(rows[springs]), _kernels.gate(rows[~springs])

    def run(x: np.ndarray, factor: np.ndarray, first: np.ndarray) -> np.ndarray:
        shifted, gain = scale_frequencies(a, factor)
        return _kernels.inside.arx_inside(
            _kernels.gate(x),
            _kernels.gate(shifted),
            _kernels.gate(gain[:, None] * b),
            force,
            stiff,
            bends,
            terms,
            tables,
            constant,
            _kernels.gate(first),
            dt,
            bound,
        )

    if omega.shape[1] == 1:
        return run(x, omega[:, 0], first)
    columns = [run(x[:, [j]], omega[:, j], first[:, [j]]) for j in range(x.shape[1])]
    return np.concatenate(columns, axis=1)


def scale_frequencies(a: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients a for each factor on the frequencies of the poles, and the gain that keeps B/A.

    A pole exp(s dt) becomes exp(factor s dt): frequencies and decay rates change, damping ratios do
    not. The gain on b keeps the static gain, or that of an integration.
    """
    if factor.size == 1 and factor[0] == 1.0:
        return a[None], np.ones(1)
    poles = np.roots(np.r_[1.0, a]).astype(complex)
    size = np.abs(poles)[None] ** factor[:, None]
    angle = np.angle(poles)[None]
    on_axis = np.abs(poles.imag) == 0.0  # a real pole stays real
    moved = size * np.exp(1j * np.where(on_axis, angle, angle * factor[:, None]))
    shifted = np.zeros((factor.size, poles.size + 1), dtype=complex)
    shifted[:, 0] = 1.0
    gain = np.ones(factor.size, dtype=complex)
    for i, pole in enumerate(poles):
        shifted[:, 1 : i + 2] -= moved[:, [i]] * shifted[:, : i + 1]
        integrates = abs(1.0 - pole) < AT_ONE
        gain *= factor if integrates else (1.0 - moved[:, i]) / (1.0 - pole)
    full = np.zeros((factor.size, a.size))
    full[:, : poles.size] = shifted[:, 1:].real
    return full, gain.real
