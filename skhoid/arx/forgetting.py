"""Forgetting factors and what they mean in samples and seconds."""

from __future__ import annotations

from typing import Any

import numpy as np


def forgetting_factor(
    memory_horizon: Any = None, *, memory_time: Any = None, dt: float | None = None
) -> Any:
    """Forgetting factor of a memory horizon: λ = 1 - 1 / N0 (Section III-B, Table V).

    A measurement N0 samples old has e^-1, about 37 %, of the weight of the newest one.

    Parameters
    ----------
    memory_horizon : float or array-like, default=None
        N0 in samples of the grid the model is fitted on, more than 1; infinity means λ = 1.
    memory_time : float or array-like, default=None
        T0 = N0 dt in s, in place of N0; needs ``dt``.
    dt : float or None, default=None
        Sampling time of that grid in s.

    Returns
    -------
    forgetting : float or ndarray
        λ, of the shape given.

    Raises
    ------
    ValueError
        If not just one of N0 and T0 is given, or a horizon is not longer than one sample.

    Examples
    --------
    >>> from skhoid import forgetting_factor
    >>> forgetting_factor([16, 256, float("inf")])
    array([0.9375    , 0.99609375, 1.        ])
    >>> forgetting_factor(memory_time=2.56, dt=0.01)
    0.99609375
    """
    if (memory_horizon is None) == (memory_time is None):
        raise ValueError(
            "Give either memory_horizon (N0, samples) or memory_time (T0, s); got "
            f"{memory_horizon!r} and {memory_time!r}."
        )
    if memory_time is not None:
        if dt is None or not dt > 0:
            raise ValueError(f"memory_time needs the sampling time dt in s; got dt={dt!r}.")
        memory_horizon = np.asarray(memory_time, dtype=float) / dt
    horizon = np.asarray(memory_horizon, dtype=float)
    if not (horizon > 1).all():
        raise ValueError(
            f"A memory horizon must be longer than one sample; got {memory_horizon!r} samples."
        )
    forgetting = 1.0 - 1.0 / horizon
    return float(forgetting) if forgetting.ndim == 0 else forgetting
