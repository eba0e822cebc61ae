"""The operator on a sampling grid: zero-order hold, whole delays, Padé approximants (App. F)."""

from __future__ import annotations

from math import comb, factorial
from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import HasMethods, Interval, checked
from ..runs import whole_samples
from .operator import HumanOperator
from .variation import evaluate, instants_of

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
    parameters and ``nk=delay_samples(operator, dt)`` is the operator with its delay.

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

    Raises
    ------
    ValueError
        If ``dt`` is not positive.

    See Also
    --------
    skhoid.interpret.conversion.arx_to_operator : The inverse conversion.

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
    instants = instants_of(t)
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
        Round a delay that is not a whole number of samples; by default it raises an error.

    Returns
    -------
    nk : int

    Raises
    ------
    ValueError
        If ``tau_e`` is not a whole number of samples within 1e-6, or ``dt`` is not positive.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> from skhoid.human import delay_samples
    >>> [delay_samples(HumanOperator(tau_e=0.28), dt) for dt in (0.02, 0.01, 0.005)]
    [15, 29, 57]
    """
    check_dt(dt)
    samples = whole_samples(operator.tau_e, dt)
    if samples != round(samples) and not nearest:
        raise ValueError(
            f"tau_e = {operator.tau_e:g} s is {samples:.6g} samples at dt = {dt:g} s, but an ARX "
            f"model needs a whole number. nearest=True uses {round(samples)} + 1, that is tau_e = "
            f"{round(samples) * dt:.6g} s; finer sampling, or more coefficients, preserves it."
        )
    return round(samples) + 1


def pade(delay: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Padé approximant of a pure time delay.

    exp(-s tau) is about (1 - h_1 s tau + h_2 (s tau)² - ...) / (1 + h_1 s tau + h_2 (s tau)² + ...)
    with h_k = C(n, k) (2n - k)! / (2n)! for order n (Eq. 5.17; Eq. 5.18 is order 1, h_1 = 1/2).

    Parameters
    ----------
    delay : float
        Delay tau in seconds.
    order : int
        Order n; 0 is no delay at all.

    Returns
    -------
    numerator, denominator : ndarray of shape (order + 1,)
        Polynomials in s, highest power first, as in SciPy.

    Raises
    ------
    ValueError
        If ``order`` is not a whole number, at least 0.

    Examples
    --------
    >>> from skhoid.human import pade
    >>> numerator, denominator = pade(0.28, order=1)
    >>> numerator
    array([-0.14,  1.  ])
    >>> denominator
    array([0.14, 1.  ])
    """
    check_order(order)
    # In closed form; scipy.interpolate.pade solves a system that loses digits as the order grows.
    n = int(order)
    h = [comb(n, k) * factorial(2 * n - k) / factorial(2 * n) for k in range(n, -1, -1)]
    powers = np.arange(n, -1, -1)
    return np.array(h) * (-delay) ** powers, np.array(h) * delay**powers


def pade_response(delay: float, order: int, omega: Any) -> np.ndarray:
    """Frequency response of a Padé approximant of a time delay.

    Its gain is 1 at every frequency, like that of the delay; its phase falls short of -omega tau
    from about omega tau = 2 n on.

    Parameters
    ----------
    delay : float
        Delay in seconds.
    order : int
        Order n of the approximant, see :func:`pade`.
    omega : array-like of shape (n_frequencies,)
        Frequencies in rad/s.

    Returns
    -------
    H : ndarray of complex, shape (n_frequencies,)

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid.human.discretisation import pade_response
    >>> np.angle(pade_response(0.28, 1, [1.0, 5.0])).round(3)
    array([-0.278, -1.221])
    """
    numerator, denominator = pade(delay, order)
    s = 1j * np.asarray(omega, dtype=float)
    return np.polyval(numerator, s) / np.polyval(denominator, s)


def check_dt(dt: Any) -> None:
    """Refuse a sampling time that is not a positive number."""
    if np.ndim(dt) or not 0 < float(dt) < np.inf:
        raise ValueError(f"dt must be a positive sampling time in seconds; got {dt!r}.")


def check_order(order: Any) -> None:
    """Refuse an order of a Padé approximant that is not a whole number."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 0:
        raise ValueError(
            f"The order of a Padé approximant must be a whole number, at least 0; got {order!r}."
        )
