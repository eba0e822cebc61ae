"""``HumanOperator`` (Eqs. 3-5), on a sampling grid (App. F), and its crossover."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import HasMethods, Interval, checked
from ..runs import whole_samples
from .variation import (
    Parameter,
    Product,
    check_finite,
    check_parameters,
    check_positive,
    evaluate,
    freeze,
    read_instants,
)

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
    K_t, K_tdot, K_x, K_xdot : float or callable, default=0.0
        Gains on target and controlled output and on their rates (s), for a pursuit display. They
        add to u, so feedback of x has negative gains.

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
        """K_e and K_edot over time, each of shape (n_instants,).

        Parameters
        ----------
        t : ndarray of shape (n_instants,)
            Instants in s.
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
        """The same operator, given by K_edot."""
        return replace(self, T_L=None, K_edot=self.rate_gain)

    def over_time(self, t: np.ndarray) -> dict[str, np.ndarray]:
        """K_e, T_L, K_edot, tau_e, omega_nm and zeta_nm at instants.

        Parameters
        ----------
        t : ndarray of shape (n_instants,)
            Instants in s.
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
        """
        return HumanOperator(tau_e=self.tau_e, **freeze(self, t, *self.adaptable))

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
        """
        s = 1j * np.asarray(omega, dtype=float)
        if input == "e":
            K, K_dot = (float(gain) for gain in self.gains(np.asarray(t, dtype=float)))
        elif input in PURSUIT_GAINS:
            K, K_dot = freeze(self, t, *PURSUIT_GAINS[input]).values()
        else:
            raise ValueError(
                f"input must be 'e', or 'f_t' or 'x' for a pursuit display; got {input!r}."
            )
        muscle = respond_neuromuscular(s, *freeze(self, t, "omega_nm", "zeta_nm").values())
        return (K_dot * s + K) * np.exp(-s * self.tau_e) * muscle


def respond_neuromuscular(s: np.ndarray, omega_nm: float, zeta_nm: float) -> np.ndarray:
    """H_nm(s) of Eq. 4."""
    return omega_nm**2 / (s**2 + 2 * zeta_nm * omega_nm * s + omega_nm**2)


SERIES = 1e-2  # below this angle in rad, sin(x)/x by its series, which does not cancel


@checked(
    operator=[HasMethods("gains")],
    t=[Real, "array-like"],
    dt=[Interval(Real, 0, 1e100, closed="neither")],
)
def zoh_parameters(operator: HumanOperator, dt: float, t: Any = 0.0) -> np.ndarray:
    """ARX parameters of an operator without delay, under zero-order hold.

    H(z) = z^-1 (b_0 + b_1 z^-1) / (1 + a_1 z^-1 + a_2 z^-2) (Eqs. 21 and F.3-F.4) responds to an
    input that is held between samples exactly as the operator does. An ARX model with these
    parameters and ``nk=delay_samples(operator, dt)`` is the operator with its delay;
    :func:`skhoid.arx_to_operator` is the inverse.

    Parameters
    ----------
    operator : HumanOperator
        Operator whose response to the error is converted, without its delay. Any damping ratio.
    dt : float
        Sampling time in seconds.
    t : float or array-like of shape (n_instants,), default=0.0
        Instants in s at which parameters that vary are frozen.

    Returns
    -------
    theta : ndarray of shape (4,) or (n_instants, 4)
        [a_1, a_2, b_0, b_1].

    References
    ----------
    Van Grootheest, thesis, Tables IV, F.1 and F.3.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> from skhoid import zoh_parameters
    >>> zoh_parameters(HumanOperator(K_e=0.09, T_L=0.4), dt=0.01).round(4)
    array([-1.9121,  0.9243,  0.0443, -0.0432])
    """
    instants = read_instants(t)
    K_e, K_edot = operator.gains(instants)
    # Constant dynamics are discretised once, however many instants there are.
    omega_nm, zeta_nm = (
        evaluate(value, instants) if callable(value) else np.asarray(value, dtype=float)
        for value in (operator.omega_nm, operator.zeta_nm)
    )
    a1, a2, step, rate = held_filter(omega_nm, zeta_nm, dt)
    b0 = K_e * step + K_edot * rate
    return np.stack(np.broadcast_arrays(a1, a2, b0, K_e * (1 + a1 + a2) - b0), axis=-1)


def held_filter(omega_nm: Any, zeta_nm: Any, dt: float) -> tuple[Any, Any, Any, Any]:
    """a_1 and a_2 of the neuromuscular filter, and its step response and the rate of it at dt."""
    sigma = zeta_nm * omega_nm
    root = omega_nm * np.sqrt(1 - np.asarray(zeta_nm, dtype=float) ** 2 + 0j)
    # Real angles oscillate, imaginary ones do not; each exponential alone cannot overflow.
    rise, fall = np.exp((-sigma + 1j * root) * dt), np.exp((-sigma - 1j * root) * dt)
    angle2 = (root * dt) ** 2
    series = np.exp(-sigma * dt) * dt * (1 - angle2 / 6 + angle2**2 / 120)
    near = np.abs(angle2) < SERIES**2
    cosine = ((rise + fall) / 2).real
    sine = np.where(near, series, (rise - fall) / np.where(near, 1, 2j * root)).real
    step = 1 - cosine - sigma * sine
    return -2 * cosine, np.exp(-2 * sigma * dt), step, omega_nm**2 * sine


@checked(dt=[Interval(Real, 0, 1e100, closed="neither")])
def delay_samples(operator: HumanOperator, dt: float, *, nearest: bool = False) -> int:
    """Input delay n_k of the operator in samples, with the sample that zero-order hold adds.

    n_k = tau_e / dt + 1, such as 29 at 100 Hz for tau_e = 0.28 s.

    Parameters
    ----------
    operator : HumanOperator
        Operator whose ``tau_e`` is used.
    dt : float
        Sampling time of the recording in seconds.
    nearest : bool, default=False
        Round a delay that is not a whole number of samples (within 1e-6); otherwise it is an error.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> from skhoid.human import delay_samples
    >>> [delay_samples(HumanOperator(tau_e=0.28), dt) for dt in (0.02, 0.01, 0.005)]
    [15, 29, 57]
    """
    samples = whole_samples(operator.tau_e, dt)
    if samples != round(samples) and not nearest:
        raise ValueError(
            f"tau_e = {operator.tau_e:g} s is {samples:.6g} samples at dt = {dt:g} s, but an ARX "
            f"model needs a whole number. nearest=True uses {round(samples)} + 1, that is tau_e = "
            f"{round(samples) * dt:.6g} s; finer sampling, or more coefficients, preserves it."
        )
    return round(samples) + 1


# The grid only brackets the crossing; gains of operators are smooth on this scale.
GRID = np.geomspace(1e-3, 1e3, 400)  # rad/s
BLOCK = 2048  # open loops at a time, for memory
N_HALVINGS = 50  # of a grid interval: to rounding


@checked(
    operator=[HasMethods("frequency_response")],
    controlled_element=[HasMethods("frequency_response")],
    t=[Real, "array-like"],
)
def crossover(operator: Any, controlled_element: Any, t: Any = 0.0) -> tuple[Any, Any]:
    """Crossover frequency and phase margin of operator and controlled element.

    omega_c solves ``|H_OL(j omega_c)| = 1`` with H_OL = H_HO H_CE, to rounding; the phase margin is
    180 deg plus the phase of H_OL there (Eqs. 5.9-5.10, which are read on multiples of 2 pi / T_m).

    Parameters
    ----------
    operator : HumanOperator, or object with ``frequency_response(omega, t)``
        Response to the error.
    controlled_element : ControlledElement, or object with ``frequency_response(omega, t)``
        Controlled element.
    t : float or array-like of shape (n_instants,), default=0.0
        Instants in s at which both are frozen.

    Returns
    -------
    omega_c : float, or ndarray of shape (n_instants,)
        Crossover frequency in rad/s: the highest between 1e-3 and 1e3 rad/s at which the gain
        falls through 1. NaN, with a warning, where there is none.
    phase_margin : float, or ndarray of shape (n_instants,)
        Phase margin in degrees, in (-180, 180].

    Examples
    --------
    >>> from skhoid import ControlledElement, HumanOperator
    >>> from skhoid import crossover
    >>> omega_c, phase_margin = crossover(HumanOperator(), ControlledElement())
    >>> round(omega_c, 3), round(phase_margin, 2)
    (1.563, 76.67)
    """
    instants = np.atleast_1d(read_instants(t))
    omega_c, margin = np.full((2, instants.size), np.nan)
    for i, instant in enumerate(instants.tolist()):

        def open_loop(w: np.ndarray, rows: Any, t: float = instant) -> np.ndarray:
            loop = operator.frequency_response(w, t) * controlled_element.frequency_response(w, t)
            return np.atleast_2d(loop)

        omega_c[i : i + 1], margin[i : i + 1] = find_last_crossings(open_loop, GRID, 1)
    warn_no_crossover(int(np.isnan(omega_c).sum()), instants.size, "instants")
    if np.ndim(t) == 0:
        return float(omega_c[0]), float(margin[0])
    return omega_c, margin


def find_last_crossings(
    open_loop: Callable[[np.ndarray, Any], np.ndarray], grid: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Highest frequencies at which the gains of ``n`` open loops fall through 1, and margins.

    ``open_loop(omega, rows)`` gives some of them at frequencies of shape (n_frequencies,) or
    (n_rows, 1). NaN where none is found on the grid.
    """
    omega_c, margin = np.full((2, n), np.nan)
    for begin in range(0, n, BLOCK):
        gain = np.abs(open_loop(grid, slice(begin, begin + BLOCK)))
        down = (gain[:, :-1] >= 1) & (gain[:, 1:] < 1)
        found = np.flatnonzero(down.any(axis=1))
        if not found.size:
            continue
        last = down.shape[1] - 1 - np.argmax(down[found, ::-1], axis=1)
        low, high = grid[last], grid[last + 1]
        rows = begin + found
        for _ in range(N_HALVINGS):
            middle = np.sqrt(low * high)
            above = np.abs(open_loop(middle[:, None], rows)[:, 0]) >= 1
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        omega_c[rows] = low
        margin[rows] = find_phase_margin(open_loop(low[:, None], rows)[:, 0])
    return omega_c, margin


def warn_no_crossover(n_lost: int, n_all: int, what: str) -> None:
    if n_lost:
        warnings.warn(
            f"{n_lost} of {n_all} {what} have no crossover: the open loop does not fall from "
            "above 1 to below it at the frequencies given. Crossover and margin are NaN there.",
            UserWarning,
            stacklevel=3,
        )


def find_phase_margin(response: Any) -> Any:
    """Angle of an open loop from the negative real axis in degrees, in (-180, 180]."""
    return np.degrees(np.angle(-response))
