"""The conditions of the thesis, C1 to C6 (Tables II and III), and mixtures of conditions."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any

from .._sklearn import Interval, checked
from ..exceptions import did_you_mean
from ..human import ControlledElement, HumanOperator, Sigmoid
from ..human.variation import Parameter, mix

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

    See Also
    --------
    tracking_condition : The conditions of the thesis.

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

    Returns
    -------
    condition : Condition

    Raises
    ------
    ValueError
        If there is no such condition.

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
    return _mixture(name, Condition("", *begin), Condition("", *end), progress)


@checked(weight=[Interval(Real, 0, 1, closed="both"), callable], name=[str, None])
def mixed_condition(
    first: str | Condition, second: str | Condition, weight: Parameter, name: str | None = None
) -> Condition:
    """Mix two conditions, parameter by parameter, with a weight that may vary over time.

    p(t) = (1 - w(t)) p_1(t) + w(t) p_2(t), for K_c, omega_b, K_e, K_edot, omega_nm, zeta_nm and
    the gains of a pursuit display (Eq. 3.7; T_L is then the ratio of K_edot and K_e). With w a
    sigmoid from 0 to 1 this turns C1 and C2 into C3 to C6.

    Parameters
    ----------
    first, second : str or Condition
        Conditions, or names of those of the thesis.
    weight : float or callable
        w: a number from 0 to 1, or a function of time (s), such as ``Ramp(0, 1, 20, 60)``.
    name : str or None, default=None
        Name of the mixture; None makes one from the two names.

    Returns
    -------
    condition : Condition

    Raises
    ------
    ValueError
        If the operators differ in their delay, which cannot vary over time.

    Examples
    --------
    >>> from skhoid import Sigmoid, mixed_condition
    >>> slower = mixed_condition("C1", "C2", Sigmoid(0, 1, rate=2.0, time=30.0))
    >>> slower.operator.K_e
    Sigmoid(initial=0.09, final=0.07, rate=2.0, time=30.0)
    """
    one, two = (c if isinstance(c, Condition) else tracking_condition(c) for c in (first, second))
    return _mixture(name or f"{one.name} to {two.name}", one, two, weight)


def _mixture(name: str, one: Condition, two: Condition, weight: Parameter) -> Condition:
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
