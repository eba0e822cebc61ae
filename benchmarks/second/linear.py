"""The best linear person of five parameters for given e and u: the yardstick of how much a hidden
effect matters.

Open it for how ``gap`` is measured: gain, lead, delay and limb are fitted by least squares in
simulation to the person's own noise-free answer; what they leave of its power, in points of VAF, is
what a name can win.
"""

import numpy as np
from scipy.optimize import minimize
from scipy.signal import cont2discrete, lfilter

from .signals import delayed


def residual(
    free: np.ndarray, e: list[np.ndarray], u: list[np.ndarray], dt: float, skip: int
) -> float:
    """Share of the power of u that is left by the best gain and lead at log delay, log omega, log
    zeta.
    """
    delay, omega, zeta = np.exp(np.clip(free, np.log([0.005, 1.5, 0.03]), np.log([1.0, 60.0, 3.0])))
    den = [1.0, 2 * zeta * omega, omega**2]
    columns, wanted = [], []
    filters = [cont2discrete((num, den), dt, "bilinear") for num in ([omega**2], [omega**2, 0.0])]
    for e_run, u_run in zip(e, u, strict=True):
        late = delayed(e_run, delay, dt)
        columns.append(np.stack([lfilter(b.ravel(), a, late)[skip:] for b, a, _ in filters], 1))
        wanted.append(u_run[skip:])
    phi, y = np.concatenate(columns), np.concatenate(wanted)
    theta = np.linalg.lstsq(phi, y, rcond=None)[0]
    return float(((y - phi @ theta) ** 2).sum() / (y**2).sum())


def gap(
    e: list[np.ndarray],
    u: list[np.ndarray],
    dt: float,
    start: tuple[float, float, float],
    least: float = 0.0,
) -> float:
    """Points of VAF that the best linear person misses of u; 3 s of each run are not counted.

    Two starts; the second is left out if the first already falls below ``least``.
    """
    skip = int(3.0 / dt)
    best = 1.0
    for factor in (1.0, 1.6):
        found = minimize(
            residual,
            np.log([start[0] * factor, *start[1:]]),
            (e, u, dt, skip),
            "Nelder-Mead",
            options={"maxiter": 120, "xatol": 1e-3, "fatol": 1e-6},
        )
        best = min(best, float(found.fun))
        if 100.0 * best < least:
            break
    return 100.0 * best
