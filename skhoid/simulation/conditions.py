"""The conditions of the thesis, C1 to C6 (Tables II, III), mixtures, and remnant (Eqs. 27-28)."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import Interval, checked
from ..exceptions import did_you_mean
from ..human import ControlledElement, HumanOperator
from ..human.operator import respond_neuromuscular
from ..human.variation import Parameter, Sigmoid, check_positive, evaluate, mix

# Table II.
_STATES = {
    1: (ControlledElement(K_c=90.0, omega_b=6.0), HumanOperator(K_e=0.09, T_L=0.4)),
    2: (ControlledElement(K_c=30.0, omega_b=0.2), HumanOperator(K_e=0.07, T_L=1.2)),
}
# Table III: states, and the rate G (1/s) of the transition between them at t_M.
_TRANSITIONS = {"C1": (1, 1), "C2": (2, 2), "C3": (1, 2), "C4": (1, 2), "C5": (2, 1), "C6": (2, 1)}
RATES = {"C3": 0.5, "C4": 100.0, "C5": 0.5, "C6": 100.0}
T_M = 40.96  # s


@dataclass(frozen=True)
class Condition:
    """A controlled element and the operator who controls it.

    Parameters
    ----------
    name : str
        For titles and messages.
    controlled_element : ControlledElement
        What is controlled.
    operator : HumanOperator
        Who controls it.

    Examples
    --------
    >>> from skhoid import ControlledElement, HumanOperator
    >>> from skhoid.simulation import Condition
    >>> Condition("rate control", ControlledElement(K_c=50.0, omega_b=20.0), HumanOperator()).name
    'rate control'
    """

    name: str
    controlled_element: ControlledElement
    operator: HumanOperator


def tracking_condition(name: str) -> Condition:
    """A condition of the thesis by its name (Tables II and III).

    Parameters
    ----------
    name : {"C1", "C2", "C3", "C4", "C5", "C6"}
        C1: mostly 1/s; C2: mostly 1/s²; C3 and C4: from C1 to C2, gradually (G = 0.5 1/s) and
        suddenly (100 1/s) at 40.96 s in the measurement window; C5 and C6: from C2 to C1.

    Examples
    --------
    >>> from skhoid import tracking_condition
    >>> tracking_condition("C2").controlled_element
    ControlledElement(K_c=30.0, omega_b=0.2)
    """
    name = known_name(name)
    begin, end = (_STATES[state] for state in _TRANSITIONS[name])
    if begin == end:
        return Condition(name, *begin)
    progress = Sigmoid(0.0, 1.0, rate=RATES[name], time=T_M)
    return _mix_conditions(name, Condition("", *begin), Condition("", *end), progress)


@checked(weight=[Interval(Real, 0, 1, closed="both"), callable])
def mixed_condition(
    first: str | Condition, second: str | Condition, weight: Parameter
) -> Condition:
    """Mix two conditions, parameter by parameter, with a weight that may vary over time.

    p(t) = (1 - w(t)) p_1(t) + w(t) p_2(t), for K_c, omega_b, K_e, K_edot, omega_nm, zeta_nm and
    the gains of a pursuit display (Eq. 3.7; T_L is then the ratio of K_edot and K_e). The delays
    must be equal. With w a sigmoid from 0 to 1 this turns C1 and C2 into C3 to C6.

    Parameters
    ----------
    first, second : str or Condition
        Conditions, or names of those of the thesis.
    weight : float or callable
        w: a number from 0 to 1, or a function of time (s), such as ``Ramp(0, 1, 20, 60)``.

    Examples
    --------
    >>> from skhoid import Sigmoid, mixed_condition
    >>> slower = mixed_condition("C1", "C2", Sigmoid(0, 1, rate=2.0, time=30.0))
    >>> slower.operator.K_e
    Sigmoid(initial=0.09, final=0.07, rate=2.0, time=30.0)
    """
    one, two = (c if isinstance(c, Condition) else tracking_condition(c) for c in (first, second))
    return _mix_conditions(f"{one.name} to {two.name}", one, two, weight)


def _mix_conditions(name: str, one: Condition, two: Condition, weight: Parameter) -> Condition:
    a, b = one.operator, two.operator
    if a.tau_e != b.tau_e:
        raise ValueError(
            f"The delay cannot vary over time: {one.name} has tau_e = {a.tau_e} s and {two.name} "
            f"{b.tau_e} s."
        )
    a, b = a.with_rate_gain(), b.with_rate_gain()
    gains: dict[str, Any] = {
        name: mix(value, getattr(b, name), weight) for name, value in a.adaptable.items()
    }
    x, y = one.controlled_element, two.controlled_element
    element = ControlledElement(
        K_c=mix(x.K_c, y.K_c, weight), omega_b=mix(x.omega_b, y.omega_b, weight)
    )
    return Condition(name, element, HumanOperator(tau_e=a.tau_e, **gains))


def known_name(name: Any) -> str:
    """The name of a condition, or an error that suggests the nearest."""
    if isinstance(name, str) and name.upper() in _TRANSITIONS:
        return name.upper()
    raise ValueError(
        f"Unknown condition {name!r}; known are {', '.join(_TRANSITIONS)}."
        f"{did_you_mean(str(name).upper(), _TRANSITIONS)}"
    )


ORDERS = (1, 2, 3, 4, "nm")
OMEGA_NM, ZETA_NM = 11.25, 0.35  # rad/s; of Eq. 28, Table II
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

    H_n(s) = K_n / (T_n s + 1)^m, or K_n H_nm(s) with 11.25 rad/s and a damping ratio of 0.35 for
    ``order="nm"``, driven by white noise of unit intensity. A gain that varies in time acts before
    the filter.

    Parameters
    ----------
    order : {1, 2, 3, 4, "nm"}, default=2
        Order m of the low-pass filter, or the neuromuscular filter.
    intensity : float or None, default=None
        Desired P_n = var(n) / var(u) in the measurement window, below 1, in place of ``gain``;
        :func:`tune_remnant` then finds the gain for a task.
    gain : float, callable or None, default=None
        K_n in units of u times s^0.5; a function of time takes an array of times (s).
    time_constant : float, default=0.06
        T_n in s.

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

    def __post_init__(self) -> None:
        whole = isinstance(self.order, (str, int, np.integer)) and not isinstance(self.order, bool)
        if not whole or self.order not in ORDERS:
            raise ValueError(f"Remnant: order must be 1, 2, 3, 4 or 'nm'; got {self.order!r}.")
        if (self.intensity is None) == (self.gain is None):
            raise ValueError(
                "Remnant: give either intensity (P_n, for which the gain is then found) or gain "
                f"(K_n); got intensity={self.intensity!r} and gain={self.gain!r}."
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
        check_positive(self, "time_constant")

    def __repr__(self) -> str:
        names = ["order", "intensity" if self.gain is None else "gain"]
        names += [] if self.order == "nm" else ["time_constant"]
        return f"Remnant({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    @classmethod
    def from_table(cls, condition: str, intensity: float, order: int | str = 2) -> Remnant:
        """The gains of Table G.1; in C3-C6 they follow the sigmoid of the other parameters.

        Parameters
        ----------
        condition : {"C1", "C2", "C3", "C4", "C5", "C6"}
            Name of the condition.
        intensity : {0.05, 0.10, 0.15, 0.20, 0.25, 0.30}
            P_n for which the gains were tuned, at 100 Hz.
        order : {1, 2, 3, 4, "nm"}, default=2
            Order of the filter.
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
        """
        if self.gain is None:
            raise ValueError(
                f"{self!r} has no gain yet: tune_remnant(task) finds it for a task, "
                "Remnant.from_table takes it from Table G.1."
            )
        s = 1j * np.asarray(omega, dtype=float)
        K_n = evaluate(self.gain, np.asarray(t, dtype=float))
        if isinstance(self.order, str):
            return K_n * respond_neuromuscular(s, OMEGA_NM, ZETA_NM)
        return K_n / (self.time_constant * s + 1) ** self.order

    def filter_coefficients(self) -> np.ndarray:
        """Coefficients of the filter's state equations, as the kernel takes them."""
        output = np.zeros(4)
        if isinstance(self.order, str):
            w = OMEGA_NM
            output[1] = 1.0
            return np.array([-2 * ZETA_NM * w, -(w**2), w**2, 1.0, 0.0, 0.0, *output])
        a = 1 / self.time_constant
        output[self.order - 1] = 1.0
        return np.array([-a, 0.0, a, a, -a, a, *output])
