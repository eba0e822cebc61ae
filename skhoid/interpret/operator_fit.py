"""The operator fitted to the frequency response of an ARX model of any order."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ..human.discretisation import check_dt, check_order, held_filter, pade
from .arx_responses import response_and_gradient

NAMES = ("K_e", "T_L", "K_edot", "tau_e", "omega_nm", "zeta_nm")
N_FREQUENCIES = 60
FILTER = slice(2, 4)  # log omega_nm and log zeta_nm among the fitted parameters
ZETA = (0.02, 5.0)  # bounds; an estimate at a bound counts as no fit
FAR = 3.0  # times the rms misfit of its neighbour, beyond which an instant starts anew
DIFFERENCE = 1e-6  # of logarithms, for derivatives of the neuromuscular filter


def fit_operator(
    theta: Any,
    dt: float,
    *,
    na: int,
    delay: float,
    covariance: Any = None,
    dt_recording: float | None = None,
    band: tuple[float, float] = (0.2, 18.0),
    pade_order: int | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray, int]:
    """Fit an operator to the frequency response of ARX parameters of any order.

    Minimises the sum of |H(j omega; p) / G(j omega; theta) - 1|² over 60 frequencies, evenly
    spaced on a log scale, for K_e, K_edot, log omega_nm, log zeta_nm and tau_e. G is the ARX
    model's response with its delay; H is that of the operator under the zero-order hold of the
    recording, exactly (:func:`~skhoid.human.discretisation.zoh_parameters`).

    Parameters
    ----------
    theta : array-like of shape (n_params,) or (n_instants, n_params)
        [a_1 ... a_na, b_0 ... b_{nb-1}].
    dt : float
        Sampling time of the model in seconds.
    na : int
        Number of output lags.
    delay : float
        Delay of the model in s: ``nk`` and a delay shift, with the sample of zero-order hold.
    covariance : array-like of shape (..., n_params, n_params) or None, default=None
        Covariance of ``theta``.
    dt_recording : float or None, default=None
        Sampling time of the recording in seconds, over which e is held. None means ``dt``.
    band : (float, float), default=(0.2, 18.0)
        Lowest and highest frequency in rad/s.
    pade_order : int or None, default=None
        None uses the exact delay; with a number, the part of it beyond ``delay`` is a Padé
        approximant of that order (Eqs. 5.17-5.18).

    Returns
    -------
    values : dict of ndarray
        K_e, T_L (s), K_edot (s), tau_e (s), omega_nm (rad/s), zeta_nm, each of the leading shape of
        ``theta``. NaN where there is no fit: omega_nm or zeta_nm at a bound (half the lower and
        twice the upper end of the band; 0.02 and 5). A tau_e below 0 means that the model leads
        where an operator lags.
    deviations : dict of ndarray
        Standard deviations by the delta method, dp = (J'J)^-1 J' dG: exact where the misfit is
        zero. NaN without ``covariance``.
    misfit : ndarray
        Root mean square of the remaining relative error.
    n_failed : int
        Number of finite parameter sets without a fit.

    Raises
    ------
    ValueError
        If the band is not below the Nyquist frequency of the model, or shapes do not fit.

    Notes
    -----
    The relative error weighs gain and phase, and every octave, equally: the neuromuscular peak
    counts as much as low frequencies where the gain is ten times lower. (An absolute error would
    hardly see anything but the peak.) The gains enter linearly, so only delay and neuromuscular
    filter need starting values: 36 are tried and the best three refined. Along a path, each instant
    starts from its neighbour, and anew where that gives three times the misfit; it takes 3 to 7 ms.

    References
    ----------
    Van Grootheest, thesis, Section III-C (orders other than 2) and Eqs. 5.15-5.18.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> from skhoid import zoh_parameters
    >>> from skhoid.interpret.operator_fit import fit_operator
    >>> theta = zoh_parameters(HumanOperator(), dt=0.01)
    >>> values, _, _, _ = fit_operator(theta, 0.01, na=2, delay=0.29)
    >>> {name: round(float(value), 4) for name, value in values.items()}
    {'K_e': 0.09, 'T_L': 0.4, 'K_edot': 0.036, 'tau_e': 0.28, 'omega_nm': 11.25, 'zeta_nm': 0.35}
    """
    check_dt(dt)
    theta = np.asarray(theta, dtype=float)
    if theta.ndim not in (1, 2) or theta.shape[-1] <= na:
        raise ValueError(
            "theta must have the shape (n_params,) or (n_instants, n_params), with more than na "
            f"parameters; got {theta.shape} and na={na}."
        )
    if pade_order is not None:
        check_order(pade_order)
    omega = _frequencies(band, dt)
    hold = OperatorUnderHold(omega, delay, dt if dt_recording is None else dt_recording, pade_order)
    rows = np.atleast_2d(theta)
    response, slopes = response_and_gradient(rows, omega, dt, na, delay)
    P = None
    if covariance is not None:
        P = np.broadcast_to(np.asarray(covariance, dtype=float), (*rows.shape, rows.shape[-1]))
    table, deviations, misfit = _fit_path(hold, response, slopes, P, band)
    n_failed = int((np.isnan(table[:, 0]) & np.isfinite(rows).all(axis=1)).sum())
    shape = theta.shape[:-1]
    return (
        {name: table[:, i].reshape(shape) for i, name in enumerate(NAMES)},
        {name: deviations[:, i].reshape(shape) for i, name in enumerate(NAMES)},
        misfit.reshape(shape),
        n_failed,
    )


def _fit_path(
    hold: OperatorUnderHold,
    response: np.ndarray,
    slopes: np.ndarray,
    P: np.ndarray | None,
    band: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, standard deviations (columns as ``NAMES``) and misfit, instant by instant."""
    table, deviations = np.full((2, len(response), 6), np.nan)
    misfit = np.full(len(response), np.nan)
    bounds = np.full((2, 5), [[-np.inf], [np.inf]])
    bounds[:, FILTER] = np.log([[band[0] / 2, ZETA[0]], [2 * band[1], ZETA[1]]])
    known = np.flatnonzero(np.isfinite(response).all(axis=1) & (response != 0).all(axis=1))
    previous: tuple[np.ndarray, float] | None = None
    for row in known:
        p, misfit[row] = _fit(hold, response[row], previous, bounds)
        previous = None
        if np.any((p < bounds[0] + 1e-6) | (p > bounds[1] - 1e-6)):
            continue
        previous = (p, misfit[row])
        omega_nm, zeta_nm = np.exp(p[FILTER])
        table[row] = p[0], p[1] / p[0], p[1], p[4], omega_nm, zeta_nm
        if P is not None:
            deviations[row] = _deviations(hold, p, response[row], slopes[row], P[row])
    return table, deviations, misfit


@dataclass(frozen=True)
class OperatorUnderHold:
    """Response of the operator under zero-order hold, p = K_e, K_edot, log w, log zeta, tau."""

    omega: np.ndarray
    known_delay: float
    dt: float
    pade_order: int | None

    def gains(self, p: np.ndarray) -> np.ndarray:
        """Responses to which K_e and K_edot are the gains; two columns."""
        z = np.exp(-1j * self.omega * self.dt)
        a1, a2, step, rate = held_filter(np.exp(p[2]), np.exp(p[3]), self.dt)
        filtered = self.lag(p[4])[0] / (1 + a1 * z + a2 * z**2)
        return np.stack([step + (1 + a1 + a2 - step) * z, rate * (1 - z)], -1) * filtered[:, None]

    def lag(self, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """Response of the delay with the sample of zero-order hold, and its derivative to tau."""
        s = 1j * self.omega
        total = tau + self.dt
        if self.pade_order is None:
            response = np.exp(-s * total)
            return response, -s * response
        x = s * (total - self.known_delay)
        numerator, denominator = (np.poly1d(part) for part in pade(1.0, self.pade_order))
        n, d = numerator(x), denominator(x)
        slope = (numerator.deriv()(x) * d - n * denominator.deriv()(x)) / d**2
        whole = np.exp(-s * self.known_delay)
        return whole * n / d, whole * s * slope

    def response(self, p: np.ndarray) -> np.ndarray:
        return self.gains(p) @ p[:2]

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """Derivatives to p, of shape (n_frequencies, 5)."""
        gains = self.gains(p)
        columns = [gains[:, 0], gains[:, 1]]
        for step in DIFFERENCE * np.eye(5)[FILTER]:
            columns.append((self.response(p + step) - self.response(p - step)) / (2 * DIFFERENCE))
        value, slope = self.lag(p[4])
        columns.append(gains @ p[:2] * slope / value)
        return np.stack(columns, axis=-1)


def _fit(
    hold: OperatorUnderHold,
    target: np.ndarray,
    previous: tuple[np.ndarray, float] | None,
    bounds: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Parameters and the rms relative error, from the neighbour or from several starts."""
    if previous is not None:
        p, error = _refine(hold, target, previous[0], bounds)
        if error <= FAR * previous[1] + 1e-9:
            return p, error
    found = [_refine(hold, target, start, bounds) for start in _starts(hold, target, bounds)]
    return min(found, key=lambda result: result[1])


def _starts(hold: OperatorUnderHold, target: np.ndarray, bounds: np.ndarray) -> list[np.ndarray]:
    """The best three of a coarse grid, each with its best gains."""
    own = hold.known_delay - hold.dt
    low, high = np.exp(bounds[:, 2])
    filters = product(np.geomspace(3 * low, high / 2, 4), (0.15, 0.4, 1.0))
    candidates = []
    for (omega_nm, zeta_nm), later in product(filters, (0.0, 0.1, 0.25)):
        p = np.array([0.0, 0.0, np.log(omega_nm), np.log(zeta_nm), own + later])
        relative = _stacked(hold.gains(p) / target[:, None])
        ones = _stacked(np.ones_like(target))
        p[:2], *_ = np.linalg.lstsq(relative, ones, rcond=None)
        candidates.append((float(np.sum((relative @ p[:2] - ones) ** 2)), p))
    return [p for _, p in sorted(candidates, key=lambda candidate: candidate[0])[:3]]


def _refine(
    hold: OperatorUnderHold, target: np.ndarray, start: np.ndarray, bounds: np.ndarray
) -> tuple[np.ndarray, float]:
    result = least_squares(
        lambda p: _stacked(hold.response(p) / target - 1),
        np.clip(start, bounds[0] + 1e-5, bounds[1] - 1e-5),
        lambda p: _stacked(hold.jacobian(p) / target[:, None]),
        bounds=tuple(bounds),
        x_scale="jac",
        xtol=1e-10,
        ftol=1e-14,
        gtol=1e-12,
    )
    return result.x, float(np.sqrt(2 * result.cost / target.size))


def _deviations(
    hold: OperatorUnderHold, p: np.ndarray, target: np.ndarray, slopes: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """Standard deviations of K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm."""
    jacobian = _stacked(hold.jacobian(p) / target[:, None])
    gain = np.linalg.lstsq(jacobian, _stacked(slopes / target[:, None]), rcond=None)[0]
    K_e, K_edot = p[:2]
    lead = (gain[1] - K_edot / K_e * gain[0]) / K_e
    omega_nm, zeta_nm = np.exp(p[FILTER])
    outputs = np.stack([gain[0], lead, gain[1], gain[4], omega_nm * gain[2], zeta_nm * gain[3]])
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", outputs, P, outputs), 0.0))


def _stacked(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _frequencies(band: tuple[float, float], dt: float) -> np.ndarray:
    low, high = band
    if not 0 < low < high:
        raise ValueError(f"band must be (low, high) in rad/s with 0 < low < high; got {band}.")
    if high > np.pi / dt:
        raise ValueError(
            f"band reaches to {high:g} rad/s, above the Nyquist frequency {np.pi / dt:.4g} rad/s "
            f"of the model's sampling time {dt:g} s. Give a lower one, or decimate less."
        )
    return np.geomspace(low, high, N_FREQUENCIES)
