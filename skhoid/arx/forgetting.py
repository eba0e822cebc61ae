"""Forgetting factors and what they mean in samples and seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

NOMINAL_HORIZON = 256.0  # samples; best over all conditions of the thesis (Section V-B)


def forgetting_factor(memory_horizon: Any) -> Any:
    """Forgetting factor for a memory horizon: λ = 1 - 1 / N0 (Section III-B, Table V).

    A measurement N0 samples old has e^-1 (about 37 %) of the weight of the newest.

    Parameters
    ----------
    memory_horizon : float or array-like
        N0 in samples of the grid the model is fitted on, more than 1; infinity means λ = 1.

    Returns
    -------
    forgetting : float or ndarray
        λ, of the shape given.

    Raises
    ------
    ValueError
        If a horizon is not longer than one sample.

    Examples
    --------
    >>> from skhoid import forgetting_factor
    >>> forgetting_factor([16, 256, float("inf")])
    array([0.9375    , 0.99609375, 1.        ])
    """
    horizon = _read_memory(memory_horizon)
    if not (horizon > 1).all():
        raise ValueError(
            f"A memory horizon must be longer than one sample; got {horizon.tolist()!r} samples."
        )
    forgetting = 1.0 - 1.0 / horizon
    return float(forgetting) if forgetting.ndim == 0 else forgetting


def factor_of_time(memory_time: Any, dt: float) -> Any:
    """The same for a memory time in seconds; None forgets nothing."""
    if memory_time is None:
        return 1.0
    return forgetting_factor(_read_memory(memory_time) / dt)


def _read_memory(memory: Any) -> np.ndarray:
    try:
        return np.asarray(memory, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(
            f"The memory must be a number, or one per parameter; got {memory!r}."
        ) from None


@dataclass(frozen=True)
class Forgetting:
    """Forgetting as the recursion takes it.

    ``factors`` is λ, of shape (1 or n_instants, 1 or n_params); ``function`` gives it for other
    times; ``nominal`` is the memory horizon of a variable factor, or 0; ``automatic`` leaves the
    choice to the data.
    """

    factors: np.ndarray
    diagonal: bool = False
    nominal: float = 0.0
    automatic: bool = False
    function: Callable[[np.ndarray], Any] | None = None

    @property
    def over_time(self) -> bool:
        return len(self.factors) > 1 or self.function is not None

    @property
    def value(self) -> Any:
        """λ in the shape in which users give it."""
        factors = self.factors[:, 0] if self.factors.shape[1] == 1 else self.factors
        last = factors if len(factors) > 1 else factors[0]
        return float(last) if np.ndim(last) == 0 else last

    def arrays(self, lanes: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """1 / λ and the ratios of Eq. 20 for the kernel, the same in all lanes."""
        return kernel_arrays(np.repeat(self.factors[:, :, None], lanes, axis=2))

    def with_horizon(self, memory_horizon: float) -> Forgetting:
        """The same with one memory horizon in samples."""
        return Forgetting(np.array([[1.0 - 1.0 / memory_horizon]]), self.diagonal)

    def at(self, time: np.ndarray, n_params: int) -> Forgetting:
        """The same for other instants, if it is a function of time."""
        if self.function is None:
            return self
        factors = _evaluated(self.function, time, n_params)
        return Forgetting(factors, self.diagonal, function=self.function)


def kernel_arrays(factors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1 / λ and sqrt(λ_k / λ_i) for i < k by columns; λ is (n, 1 or n_params, lanes)."""
    pairs = [(i, k) for k in range(factors.shape[1]) for i in range(k)] or [(0, 0)]
    above, column = np.array(pairs).T
    ratios = np.sqrt(factors[:, column] / factors[:, above])
    return 1.0 / factors, np.ascontiguousarray(ratios)


def read_forgetting(
    forgetting: Any,
    memory_horizon: Any,
    memory_time: Any,
    *,
    form: str,
    n_params: int,
    time: np.ndarray,
    dt: float,
) -> Forgetting:
    """Check forgetting as a user gives it, for the instants ``time`` in seconds."""
    names = ("forgetting", "memory_horizon", "memory_time")
    values = (forgetting, memory_horizon, memory_time)
    given = {n: v for n, v in zip(names, values, strict=True) if v is not None}
    by_name = isinstance(forgetting, str)
    if by_name and forgetting not in ("auto", "variable"):
        raise ValueError(
            "forgetting must be a number λ, one per parameter, a function of time, 'auto' or "
            f"'variable'; got {forgetting!r}."
        )
    if len(given) > 1 + (forgetting == "variable" if by_name else False):
        raise ValueError(
            "Give at most one of forgetting (λ), memory_horizon (N0, samples) and memory_time "
            f"(T0, s); got {', '.join(f'{n}={v!r}' for n, v in given.items())}."
        )
    diagonal = form == "diagonal"
    if by_name and forgetting == "auto":
        return Forgetting(np.ones((1, 1)), diagonal, automatic=True)
    if memory_horizon is not None or memory_time is not None:
        by_time = memory_horizon is None
        factors = np.asarray(
            factor_of_time(memory_time, dt) if by_time else forgetting_factor(memory_horizon)
        )
        if factors.shape not in ((), (n_params,)):
            name = names[2] if by_time else names[1]
            raise ValueError(
                f"{name} must be one number or one per parameter ({n_params}); got the shape "
                f"{factors.shape}."
            )
        factors = factors.reshape(1, -1)
    elif by_name or forgetting is None:
        factors = np.array([[1.0 - 1.0 / NOMINAL_HORIZON if by_name else 1.0]])
    elif callable(forgetting):
        factors = _evaluated(forgetting, time, n_params)
        return Forgetting(factors, diagonal, function=forgetting)
    else:
        factors = _checked("forgetting", forgetting, [(), (n_params,)]).reshape(1, -1)
    if by_name:
        if factors.size > 1 or factors[0, 0] == 1.0:
            raise ValueError(
                "forgetting='variable' takes one finite memory horizon, its mean; got "
                f"{', '.join(f'{n}={v!r}' for n, v in given.items() if n != 'forgetting')}."
            )
        return Forgetting(factors, diagonal, nominal=1.0 / (1.0 - float(factors[0, 0])))
    return Forgetting(factors, diagonal)


def _evaluated(function: Callable[[np.ndarray], Any], time: np.ndarray, n_params: int) -> Any:
    """λ of a function; a shape (n_params,) is refused, as it may also mean that many instants."""
    n, what = time.size, "The function forgetting(t)"
    try:
        values = function(time.copy())
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise ValueError(
            f"{what} failed for the array t of {n} times ({error}). It is called with all times at "
            "once: choose between values with np.where, not if."
        ) from error
    factors = _checked(what, values, [(), (n,), (n, 1), (n, n_params)])
    return factors.reshape(factors.size if factors.ndim < 2 else n, -1)


def _checked(what: str, values: Any, shapes: list[tuple[int, ...]]) -> np.ndarray:
    """λ as an array of one of some shapes, between 0 and 1."""
    try:
        factors = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be a number, or numbers; got {values!r}.") from error
    if factors.shape not in shapes:
        wanted = ", ".join(map(str, shapes[1:]))
        raise ValueError(
            f"{what} has the shape {factors.shape}. It must be a number, or of the shape {wanted}."
        )
    wrong = ~((factors > 0) & (factors <= 1))
    if wrong.any():
        raise ValueError(f"{what} must be greater than 0 and at most 1; got {factors[wrong][0]:g}.")
    return factors
