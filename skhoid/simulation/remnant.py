"""Remnant: coloured noise in the operator's output (Eqs. 27-28)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..human.checks import check_positive
from ..human.operator import neuromuscular
from ..human.variation import Parameter, Sigmoid, evaluate
from .conditions import RATES, T_M, known_name

ORDERS = (1, 2, 3, 4, "nm")

# Table G.1: K_n for P_n = 0.05, 0.10 ... 0.30, with T_n = 0.06 s at 100 Hz.
_INTENSITIES = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
_TABLE_G1: dict[Any, dict[str, tuple[float, ...]]] = {
    1: {"C1": (0.006, 0.009, 0.011, 0.013, 0.015, 0.018),
        "C2": (0.013, 0.020, 0.026, 0.032, 0.039, 0.046)},
    2: {"C1": (0.008, 0.012, 0.016, 0.019, 0.023, 0.026),
        "C2": (0.019, 0.029, 0.039, 0.051, 0.066, 0.091)},
    3: {"C1": (0.010, 0.014, 0.018, 0.022, 0.026, 0.031),
        "C2": (0.022, 0.034, 0.047, 0.063, 0.088, 0.150)},
    4: {"C1": (0.010, 0.015, 0.020, 0.024, 0.029, 0.034),
        "C2": (0.024, 0.038, 0.053, 0.073, 0.110, 0.339)},
    "nm": {"C1": (0.006, 0.009, 0.011, 0.013, 0.016, 0.018),
           "C2": (0.013, 0.020, 0.026, 0.033, 0.040, 0.050)},
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Remnant:
    """Filtered white noise added to the operator's output (Eqs. 27-28).

    H_n(s) = K_n / (T_n s + 1)^m, or K_n H_nm(s) for ``order="nm"``, driven by white noise of unit
    intensity. A gain that varies in time acts before the filter.

    Parameters
    ----------
    order : {1, 2, 3, 4, "nm"}, default=2
        Order m of the low-pass filter, or the neuromuscular filter.
    intensity : float or None, default=None
        Desired P_n = var(n) / var(u) in the measurement window, below 1; :func:`tune_remnant` then
        finds the gain for a task.
    gain : float, callable or None, default=None
        K_n in units of u times s^0.5, instead of ``intensity``. A function of time takes an array
        of times (s).
    time_constant : float, default=0.06
        T_n in s.
    omega_nm, zeta_nm : float, default=11.25 and 0.35
        Frequency (rad/s) and damping of the neuromuscular filter, for ``order="nm"``.

    Raises
    ------
    ValueError
        If not exactly one of ``intensity`` and ``gain`` is given, or a number is out of range.

    Examples
    --------
    >>> from skhoid import Remnant
    >>> Remnant(order=2, intensity=0.15)
    Remnant(order=2, intensity=0.15, time_constant=0.06)
    >>> Remnant.from_table("C4", 0.15).gain
    Sigmoid(initial=0.016, final=0.039, rate=100.0, time=40.96)
    """

    order: int | str = 2
    intensity: float | None = None
    gain: Parameter | None = None
    time_constant: float = 0.06
    omega_nm: float = 11.25
    zeta_nm: float = 0.35

    def __post_init__(self) -> None:
        whole = isinstance(self.order, (str, int, np.integer)) and not isinstance(self.order, bool)
        if not whole or self.order not in ORDERS:
            raise ValueError(f"Remnant: order must be 1, 2, 3, 4 or 'nm'; got {self.order!r}.")
        if (self.intensity is None) == (self.gain is None):
            raise ValueError(
                "Remnant: give either intensity (P_n, for which the gain is then found) or gain "
                "(K_n); got "
                f"intensity={self.intensity!r} and gain={self.gain!r}."
            )
        if self.intensity is not None:
            check_positive(self, "intensity", zero=True)
            if self.intensity >= 1:
                raise ValueError(
                    "Remnant: intensity must be a fraction var(n) / var(u) below 1; got "
                    f"{self.intensity!r}. (15 percent is 0.15.)"
                )
        elif not callable(self.gain):
            check_positive(self, "gain", zero=True)
        check_positive(self, "time_constant", "omega_nm", "zeta_nm")

    def __repr__(self) -> str:
        names = ["order", "intensity" if self.gain is None else "gain"]
        names += ["omega_nm", "zeta_nm"] if self.order == "nm" else ["time_constant"]
        return f"Remnant({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    @classmethod
    def from_table(cls, condition: str, intensity: float, order: int | str = 2) -> Remnant:
        """The gains of Table G.1.

        Parameters
        ----------
        condition : {"C1", "C2", "C3", "C4", "C5", "C6"}
            In C3-C6 the gain follows the same sigmoid as the other parameters, between the values
            of C1 and C2.
        intensity : {0.05, 0.10, 0.15, 0.20, 0.25, 0.30}
            P_n for which the gains were tuned, at 100 Hz.
        order : {1, 2, 3, 4, "nm"}, default=2
            Order of the filter.

        Returns
        -------
        remnant : Remnant
        """
        name = known_name(condition)
        match = [i for i, P_n in enumerate(_INTENSITIES) if abs(P_n - intensity) < 1e-9]
        if order not in _TABLE_G1 or not match:
            raise ValueError(
                "Table G.1 has the orders 1, 2, 3, 4 and 'nm', and the intensities "
                f"{_INTENSITIES}; got order={order!r} and intensity={intensity!r}. "
                "For any other, use Remnant(intensity=...) and tune_remnant."
            )
        one, two = (_TABLE_G1[order][state][match[0]] for state in ("C1", "C2"))
        if name in ("C1", "C2"):
            return cls(order=order, gain=one if name == "C1" else two)
        if name in ("C5", "C6"):
            one, two = two, one
        return cls(order=order, gain=Sigmoid(one, two, rate=RATES[name], time=T_M))

    def frequency_response(self, omega: Any, t: float = 0.0) -> np.ndarray:
        """H_n(j omega) of Eq. 27 or 28, with the gain at ``t``.

        Parameters
        ----------
        omega : array-like of shape (n_frequencies,)
            Frequencies in rad/s.
        t : float, default=0.0
            Time in s.

        Returns
        -------
        H : ndarray of complex, shape (n_frequencies,)
        """
        if self.gain is None:
            raise ValueError(
                f"{self!r} has no gain yet: tune_remnant(task) finds it for a task, "
                "Remnant.from_table takes it from Table G.1."
            )
        s = 1j * np.asarray(omega, dtype=float)
        K_n = evaluate(self.gain, np.asarray(t, dtype=float))
        if isinstance(self.order, str):
            return K_n * neuromuscular(s, self.omega_nm, self.zeta_nm)
        return K_n / (self.time_constant * s + 1) ** self.order

    def filter_coefficients(self) -> np.ndarray:
        """Coefficients of the filter's state equations, as the kernel takes them."""
        output = np.zeros(4)
        if isinstance(self.order, str):
            w = self.omega_nm
            output[1] = 1.0
            return np.array([-2 * self.zeta_nm * w, -(w**2), w**2, 1.0, 0.0, 0.0, *output])
        a = 1 / self.time_constant
        output[self.order - 1] = 1.0
        return np.array([-a, 0.0, a, a, -a, a, *output])
