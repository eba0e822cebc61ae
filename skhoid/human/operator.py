"""``HumanOperator``: gains, lead, delay and neuromuscular system (Eqs. 3-5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .checks import check_finite, check_parameters, check_positive
from .variation import Parameter, Product, evaluate, frozen

PURSUIT_GAINS = {"f_t": ("K_t", "K_tdot"), "x": ("K_x", "K_xdot")}
PURSUIT = tuple(name for names in PURSUIT_GAINS.values() for name in names)


@dataclass(frozen=True, kw_only=True)
class HumanOperator:
    """Linear response of a human operator (Eqs. 3-5).

    H(s, t) = K_e(t) [T_L(t) s + 1] exp(-s tau_e) H_nm(s) from the error e to the control output
    u, with H_nm(s) = omega_nm² / (s² + 2 zeta_nm omega_nm s + omega_nm²). Gains that vary in time
    act before the neuromuscular filter (Eq. D.3): before its delay the output y follows
    y'' + 2 zeta_nm omega_nm y' + omega_nm² y = omega_nm² K_e e + d/dt (omega_nm² K_edot e).

    Parameters
    ----------
    K_e : float or callable, default=0.09
        Error gain, in units of u per unit of e. A function of time takes an array of instants (s).
    T_L : float, callable or None, default=None
        Lead time constant in s. None together with ``K_edot=None`` means 0.4 s.
    K_edot : float, callable or None, default=None
        Error-rate gain K_e T_L in s (Eq. 5), given in place of ``T_L``.
    tau_e : float, default=0.28
        Effective time delay in s.
    omega_nm : float or callable, default=11.25
        Neuromuscular frequency in rad/s.
    zeta_nm : float or callable, default=0.35
        Neuromuscular damping ratio.
    K_t, K_tdot : float or callable, default=0.0
        Gains on target and target rate (s), for a pursuit display.
    K_x, K_xdot : float or callable, default=0.0
        Gains on the controlled element's output and its rate (s), also for a pursuit display. They
        add to u, so feedback of x has negative gains.

    Raises
    ------
    ValueError
        If a parameter is negative or not finite, or both ``T_L`` and ``K_edot`` are given.

    See Also
    --------
    operator_parameters : These parameters from an identified ARX model.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> operator = HumanOperator(K_e=0.07, T_L=1.2)
    >>> operator
    HumanOperator(K_e=0.07, T_L=1.2, tau_e=0.28, omega_nm=11.25, zeta_nm=0.35)
    >>> abs(operator.frequency_response([0.0, 11.25])).round(3)
    array([0.07 , 1.354])
    """

    K_e: Parameter = 0.09
    T_L: Parameter | None = None
    K_edot: Parameter | None = None
    tau_e: float = 0.28
    omega_nm: Parameter = 11.25
    zeta_nm: Parameter = 0.35
    K_t: Parameter = 0.0
    K_tdot: Parameter = 0.0
    K_x: Parameter = 0.0
    K_xdot: Parameter = 0.0

    def __post_init__(self) -> None:
        if self.T_L is not None and self.K_edot is not None:
            raise ValueError(
                "HumanOperator: give T_L or K_edot = K_e T_L, not both; got "
                f"T_L={self.T_L!r} and K_edot={self.K_edot!r}."
            )
        if self.T_L is None and self.K_edot is None:
            object.__setattr__(self, "T_L", 0.4)
        if callable(self.tau_e):
            raise ValueError("HumanOperator: tau_e must be constant; got a function of time.")
        check_positive(self, "tau_e", zero=True)
        check_parameters(self, "K_e", "T_L" if self.K_edot is None else "K_edot")
        check_parameters(self, "omega_nm", "zeta_nm", zero=False)
        for name in PURSUIT:
            if not callable(getattr(self, name)):
                check_finite(self, name)

    def __repr__(self) -> str:
        shown = {name: getattr(self, name) for name in self.__dataclass_fields__}
        hidden: dict[str, Any] = {"T_L": None, "K_edot": None} | dict.fromkeys(PURSUIT, 0.0)
        parts = [
            f"{name}={value!r}"
            for name, value in shown.items()
            if name not in hidden or value != hidden[name]
        ]
        return f"HumanOperator({', '.join(parts)})"

    def gains(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K_e and K_edot over time.

        Parameters
        ----------
        t : ndarray of shape (n_instants,)
            Instants in s.

        Returns
        -------
        K_e, K_edot : ndarray of shape (n_instants,)
        """
        return evaluate(self.K_e, t), evaluate(self.rate_gain, t)

    @property
    def rate_gain(self) -> Parameter:
        """K_edot, also where T_L was given: a number or a function of time."""
        if self.K_edot is not None:
            return self.K_edot
        assert self.T_L is not None
        if callable(self.K_e) or callable(self.T_L):
            return Product(self.K_e, self.T_L)
        return float(f"{self.K_e * self.T_L:.15g}")  # 0.036, not 0.036000000000000004

    @property
    def adaptable(self) -> dict[str, Parameter]:
        """The parameters that may vary in time, as given."""
        lead = "T_L" if self.K_edot is None else "K_edot"
        names = ("K_e", lead, "omega_nm", "zeta_nm", *PURSUIT)
        return {name: getattr(self, name) for name in names}

    def with_rate_gain(self) -> HumanOperator:
        """The same operator, given by K_edot.

        Returns
        -------
        operator : HumanOperator
        """
        return replace(self, T_L=None, K_edot=self.rate_gain)

    def over_time(self, t: np.ndarray) -> dict[str, np.ndarray]:
        """K_e, T_L, K_edot, tau_e, omega_nm and zeta_nm at instants.

        Parameters
        ----------
        t : ndarray of shape (n_instants,)
            Instants in s.

        Returns
        -------
        values : dict of ndarray of shape (n_instants,)
        """
        K_e, K_edot = self.gains(t)
        with np.errstate(divide="ignore", invalid="ignore"):
            T_L = K_edot / K_e if self.T_L is None else evaluate(self.T_L, t)
        values = {"K_e": K_e, "T_L": T_L, "K_edot": K_edot, "tau_e": evaluate(self.tau_e, t)}
        return values | {name: evaluate(getattr(self, name), t) for name in ("omega_nm", "zeta_nm")}

    def at(self, t: float) -> HumanOperator:
        """The operator frozen at one instant.

        Parameters
        ----------
        t : float
            Time in s.

        Returns
        -------
        operator : HumanOperator
        """
        return HumanOperator(tau_e=self.tau_e, **frozen(self, t, *self.adaptable))

    def frequency_response(self, omega: Any, t: float = 0.0, input: str = "e") -> np.ndarray:
        """Response H(j omega) to an input, with parameters frozen at ``t``.

        Parameters
        ----------
        omega : array-like of shape (n_frequencies,)
            Frequencies in rad/s.
        t : float, default=0.0
            Time in s.
        input : {"e", "f_t", "x"}, default="e"
            Error, or what a pursuit display shows in addition. As e = f_t - x, identified responses
            to e and x alone are H_e + H_ft and H_x + H_ft.

        Returns
        -------
        H : ndarray of complex, shape (n_frequencies,)
        """
        s = 1j * np.asarray(omega, dtype=float)
        if input == "e":
            K, K_dot = (float(gain) for gain in self.gains(np.asarray(t, dtype=float)))
        elif input in PURSUIT_GAINS:
            K, K_dot = frozen(self, t, *PURSUIT_GAINS[input]).values()
        else:
            raise ValueError(
                f"input must be 'e', or 'f_t' or 'x' for a pursuit display; got {input!r}."
            )
        muscle = neuromuscular(s, *frozen(self, t, "omega_nm", "zeta_nm").values())
        return (K_dot * s + K) * np.exp(-s * self.tau_e) * muscle


def neuromuscular(s: np.ndarray, omega_nm: float, zeta_nm: float) -> np.ndarray:
    """H_nm(s) of Eq. 4."""
    return omega_nm**2 / (s**2 + 2 * zeta_nm * omega_nm * s + omega_nm**2)
