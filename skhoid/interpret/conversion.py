"""Operator parameters from ARX models: from their poles, or from their frequency response."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import product
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import Interval, StrOptions, checked
from ..human.operator import held_filter
from ..human.variation import as_floats
from ..pipelines import taken_apart
from .arx_channel import ARXChannel, differentiate_response, find_delay_before, respond
from .response_fit import ResponseFit, stack_parts

NAMES = ("K_e", "T_L", "K_edot", "tau_e", "omega_nm", "zeta_nm")
N_FREQUENCIES = 60
FILTER = slice(2, 4)  # log omega_nm and log zeta_nm among the fitted parameters
ZETA = (0.02, 5.0)  # bounds; an estimate at a bound counts as no fit
N_REFINED = 3  # best starts of the grid that are refined
BLOCK = 2048  # instants at a time, for memory
STRIDE = 16  # instants, of which one is fitted from all starts
ALIKE = 0.1  # of the logarithms of the filter, and s of the delay: what lies between is alike
DIFFERENCE = 1e-6  # of logarithms, for derivatives of the neuromuscular filter


def fit_operator(
    theta: np.ndarray,
    dt: float,
    *,
    na: int,
    delay: float,
    covariance: np.ndarray | None = None,
    dt_recording: float | None = None,
    band: tuple[float, float] = (0.2, 18.0),
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray, int]:
    """Values, deviations and misfit of operators fitted to ARX responses, and how many failed.

    Minimises the sum of |H(j omega; p) / G(j omega; theta) - 1|² over 60 frequencies, evenly
    spaced on a log scale, for K_e, K_edot, log omega_nm, log zeta_nm and tau_e. G is the ARX
    model's response with its ``delay`` (with the sample of zero-order hold); H is that of the
    operator under the hold of the recording, exactly. The relative error weighs gain and phase, and
    every octave, equally; an absolute one would hardly see anything but the neuromuscular peak.
    ``theta`` is (n_params,) or (n_instants, n_params). NaN where omega_nm or zeta_nm is at a bound
    (half the lower and twice the upper end of the band; 0.02 and 5). Deviations are by the delta
    method, dp = (J'J)^-1 J' dG.
    """
    omega = _choose_frequencies(band, dt)
    hold = OperatorUnderHold(omega, delay, dt if dt_recording is None else dt_recording)
    rows = np.atleast_2d(theta)
    table, misfit, fitted = _fit_path(hold, respond(rows, omega, dt, na, delay), band)
    deviations = np.full_like(table, np.nan)
    if covariance is not None:
        P = np.broadcast_to(covariance, (*rows.shape, rows.shape[-1]))
        for row in np.flatnonzero(np.isfinite(table[:, 0])):
            target, slopes = differentiate_response(rows[row], omega, dt, na, delay)
            J, G = (
                stack_parts(of / target[:, None], axis=0)
                for of in (hold.slopes(fitted[row : row + 1])[0], slopes)
            )
            deviations[row] = _propagate(fitted[row], J, G, P[row])
    n_failed = int((np.isnan(table[:, 0]) & np.isfinite(rows).all(axis=1)).sum())
    shape = np.shape(theta)[:-1]
    return (
        {name: table[:, i].reshape(shape) for i, name in enumerate(NAMES)},
        {name: deviations[:, i].reshape(shape) for i, name in enumerate(NAMES)},
        misfit.reshape(shape),
        n_failed,
    )


def _fit_path(
    hold: OperatorUnderHold, response: np.ndarray, band: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (columns as ``NAMES``), misfit and fitted parameters of each instant.

    Every ``STRIDE``-th instant is fitted from the best of all starts. What lies between two whose
    minima are alike begins there; elsewhere all starts are tried.
    """
    table = np.full((len(response), 6), np.nan)
    misfit, fitted = np.full(len(response), np.nan), np.full((len(response), 5), np.nan)
    bounds = np.full((2, 5), [[-np.inf], [np.inf]])
    bounds[:, FILTER] = np.log([[band[0] / 2, ZETA[0]], [2 * band[1], ZETA[1]]])
    # A coarse grid of neuromuscular filters and delays to start from.
    low, high = np.exp(bounds[:, 2])
    grid = product(np.geomspace(3 * low, high / 2, 4), (0.15, 0.4, 1.0), (0.0, 0.1, 0.25))
    filters = [np.array([np.log(w), np.log(z), hold.known_delay - hold.dt + t]) for w, z, t in grid]
    known = np.flatnonzero(np.isfinite(response).all(axis=1) & (response != 0).all(axis=1))
    squares = np.full(len(response), np.nan)

    def fit(rows: np.ndarray) -> ResponseFit:
        return ResponseFit(hold, response[rows], 1 / np.abs(response[rows]), *bounds)

    def fit_from_all(rows: np.ndarray) -> None:
        for some in np.array_split(rows, -(-rows.size // BLOCK)) if rows.size else []:
            found = fit(some)
            fitted[some], squares[some] = found.find_best_minima(found.starts(filters, N_REFINED))

    first = np.append(known[:-1:STRIDE], known[-1:])
    fit_from_all(first)
    between = np.setdiff1d(known, first)
    after = np.searchsorted(first, between)
    left, right = first[after - 1], first[after]
    alike = (np.abs(fitted[right] - fitted[left])[:, 2:] <= ALIKE).all(axis=1)
    fit_from_all(between[~alike])
    share = ((between - left) / (right - left))[:, None]
    starts = ((1 - share) * fitted[left] + share * fitted[right])[alike]
    rows = between[alike]
    for some in np.array_split(np.arange(rows.size), -(-rows.size // BLOCK)) if rows.size else []:
        fitted[rows[some]], squares[rows[some]] = fit(rows[some]).refined(starts[some])
    misfit[known] = np.sqrt(squares[known] / response.shape[1])
    inside = ~np.any((fitted < bounds[0] + 1e-6) | (fitted > bounds[1] - 1e-6), axis=1)
    rows = known[inside[known]]
    p = fitted[rows]
    omega_nm, zeta_nm = np.exp(p[:, FILTER]).T
    columns = [p[:, 0], p[:, 1] / p[:, 0], p[:, 1], p[:, 4], omega_nm, zeta_nm]
    table[rows] = np.stack(columns, axis=1)
    return table, misfit, fitted


@dataclass(frozen=True)
class OperatorUnderHold:
    """Response of the operator under zero-order hold, p = K_e, K_edot, log w, log zeta, tau."""

    omega: np.ndarray
    known_delay: float
    dt: float

    def gains(self, p: np.ndarray) -> np.ndarray:
        """Responses to which K_e and K_edot are the gains; two columns."""
        z = np.exp(-1j * self.omega * self.dt)
        a1, a2, step, rate = held_filter(np.exp(p[:, 2:3]), np.exp(p[:, 3:4]), self.dt)
        lag = np.exp(-1j * self.omega * (p[:, 4:5] + self.dt))  # with the sample of the hold
        filtered = lag / (1 + a1 * z + a2 * z**2)
        columns = [step + (1 + a1 + a2 - step) * z, rate * (1 - z)]
        return np.stack(columns, -1) * filtered[..., None]

    def slopes(self, p: np.ndarray) -> np.ndarray:
        """Derivatives to p, of shape (n, n_frequencies, 5)."""
        z = np.exp(-1j * self.omega * self.dt)
        a1, a2, step, rate = held_filter(np.exp(p[:, 2:3]), np.exp(p[:, 3:4]), self.dt)
        shape = 1 / (1 + a1 * z + a2 * z**2)
        lag = np.exp(-1j * self.omega * (p[:, 4:5] + self.dt)) * shape
        of_error, of_rate = (step + (1 + a1 + a2 - step) * z) * lag, rate * (1 - z) * lag
        response = of_error * p[:, :1] + of_rate * p[:, 1:2]
        slopes = np.empty((*response.shape, 5), dtype=complex)
        slopes[..., 0], slopes[..., 1], slopes[..., 4] = (
            of_error,
            of_rate,
            -1j * self.omega * response,
        )
        for k, move in enumerate(DIFFERENCE * np.eye(2), 2):
            up, down = (
                held_filter(np.exp(p[:, 2:3] + w), np.exp(p[:, 3:4] + more), self.dt)
                for w, more in (move, -move)
            )
            d1, d2, d_step, d_rate = (
                (a - b) / (2 * DIFFERENCE) for a, b in zip(up, down, strict=True)
            )
            still = p[:, :1] * d_step + p[:, 1:2] * d_rate
            numerator = still + (p[:, :1] * (d1 + d2) - still) * z
            slopes[..., k] = lag * numerator - response * shape * (d1 * z + d2 * z**2)
        return slopes


def _propagate(
    p: np.ndarray, jacobian: np.ndarray, slopes: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """Standard deviations of K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm."""
    gain = np.linalg.lstsq(jacobian, slopes, rcond=None)[0]
    K_e, K_edot = p[:2]
    lead = (gain[1] - K_edot / K_e * gain[0]) / K_e
    omega_nm, zeta_nm = np.exp(p[FILTER])
    outputs = np.stack([gain[0], lead, gain[1], gain[4], omega_nm * gain[2], zeta_nm * gain[3]])
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", outputs, P, outputs), 0.0))


def _choose_frequencies(band: tuple[float, float], dt: float) -> np.ndarray:
    low, high = band
    if not 0 < low < high:
        raise ValueError(f"band must be (low, high) in rad/s with 0 < low < high; got {band}.")
    if high > np.pi / dt:
        raise ValueError(
            f"band reaches to {high:g} rad/s, above the Nyquist frequency {np.pi / dt:.4g} rad/s "
            f"of the model's sampling time {dt:g} s. Give a lower one, or decimate less."
        )
    return np.geomspace(low, high, N_FREQUENCIES)


FROM_POLES = ("K_e", "T_L", "K_edot", "omega_nm", "zeta_nm")
UNITS = {"K_e": "", "T_L": "s", "K_edot": "s", "tau_e": "s", "omega_nm": "rad/s", "zeta_nm": ""}
STEP = 1e-30  # of complex-step derivatives, which have no rounding to balance


@checked(
    theta=["array-like"],
    dt=[Interval(Real, 1e-100, 1e100, closed="neither")],
    covariance=["array-like", None],
)
def arx_to_operator(
    theta: Any, dt: float, covariance: Any = None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], int]:
    """Operator parameters from ARX parameters with two output and two input coefficients.

    Inverts zero-order hold: poles by z = exp(s dt) (Eq. 22), gains by the step response, then K_e =
    b_0c / a_0c, T_L = b_1c / b_0c, K_edot = b_1c / a_0c, omega_nm = sqrt(a_0c) and zeta_nm = a_1c /
    (2 sqrt(a_0c)) (Eq. 23). :func:`skhoid.zoh_parameters` is the inverse.

    Parameters
    ----------
    theta : array-like of shape (..., 4)
        [a_1, a_2, b_0, b_1]; leading axes, such as instants, are kept.
    dt : float
        Sampling time of the model in seconds.
    covariance : array-like of shape (..., 4, 4) or None, default=None
        Covariance of ``theta``.

    Returns
    -------
    values : dict of ndarray of shape (...)
        K_e, T_L (s), K_edot (s), omega_nm (rad/s), zeta_nm. NaN where the poles are not a pair
        of complex numbers; an unstable pair has a negative zeta_nm.
    deviations : dict of ndarray of shape (...)
        Their standard deviations by the delta method, valid while errors are small; NaN without
        ``covariance``.
    n_not_complex : int
        Number of finite parameter sets whose poles are not a complex pair.

    Examples
    --------
    >>> from skhoid import HumanOperator
    >>> from skhoid import arx_to_operator
    >>> from skhoid import zoh_parameters
    >>> theta = zoh_parameters(HumanOperator(K_e=0.07, T_L=1.2), dt=0.01)
    >>> values, deviations, n_not_complex = arx_to_operator(theta, dt=0.01)
    >>> {name: round(float(value), 6) for name, value in values.items()}
    {'K_e': 0.07, 'T_L': 1.2, 'K_edot': 0.084, 'omega_nm': 11.25, 'zeta_nm': 0.35}
    """
    theta = as_floats(theta, "theta")
    if theta.ndim == 0 or theta.shape[-1] != 4:
        raise ValueError(
            f"theta must have the shape (..., 4), [a_1, a_2, b_0, b_1]; got {theta.shape}."
        )
    # a_1² < 4 a_2: only then is the pair complex, and its logarithm a pair too.
    complex_pair = theta[..., 0] ** 2 < 4 * theta[..., 1]
    n_not_complex = int((np.isfinite(theta).all(axis=-1) & ~complex_pair).sum())
    theta = np.where(complex_pair[..., None], theta, np.nan)
    physics = _invert_hold(theta, dt)
    variances = np.full(physics.shape, np.nan)
    if covariance is not None:
        covariance = as_floats(covariance, "covariance")
        if covariance.shape[-2:] != (4, 4):
            raise ValueError(f"covariance must have the shape (..., 4, 4); got {covariance.shape}.")
        steps = STEP * 1j * np.eye(4)
        slopes = np.stack([_invert_hold(theta + step, dt).imag / STEP for step in steps], axis=-1)
        variances = np.einsum("...ij,...jk,...ik->...i", slopes, covariance, slopes)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    return (
        {name: physics[..., i] for i, name in enumerate(FROM_POLES)},
        {name: deviations[..., i] for i, name in enumerate(FROM_POLES)},
        n_not_complex,
    )


def _invert_hold(theta: np.ndarray, dt: float) -> np.ndarray:
    """The parameters of FROM_POLES on the last axis, real or by complex step."""
    a1, a2, b0, b1 = np.moveaxis(theta, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = -np.log(a2) / (2 * dt)
        omega_d = np.arccos(-a1 / (2 * np.sqrt(a2))) / dt
        a0c = sigma**2 + omega_d**2
        decay = np.exp(-sigma * dt)
        cosine, sine = decay * np.cos(omega_d * dt), decay * np.sin(omega_d * dt) / omega_d
        K_e = (b0 + b1) / (1 + a1 + a2)
        K_edot = (b0 - K_e * (1 - cosine - sigma * sine)) / (a0c * sine)
        physics = [K_e, K_edot / K_e, K_edot, np.sqrt(a0c), sigma / np.sqrt(a0c)]
    return np.stack(physics, axis=-1)


@checked(
    method=[StrOptions({"poles", "fit"})],
    input=[str, None],
)
def operator_parameters(
    model: Any,
    *,
    method: str = "poles",
    input: str | None = None,
    band: tuple[float, float] = (0.2, 18.0),
) -> pd.DataFrame:
    """Operator parameters of a fitted ARX model, over time if its parameters vary.

    Parameters
    ----------
    model : ARXRegressor, or pipeline or search that ends in one
        Fitted. If it has parameters over time (``coef_path_``), each instant is converted.
    method : {"poles", "fit"}, default="poles"
        ``"poles"`` inverts zero-order hold (Eqs. 22-23, :func:`arx_to_operator`) and needs ``na =
        nb = 2``. ``"fit"`` fits the operator to the model's frequency response, with the same
        relative error at all frequencies: any orders, and it estimates the delay.
    input : str or None, default=None
        Input whose response is converted. None means the only one, or the one of role ``e``.
    band : (float, float), default=(0.2, 18.0)
        Frequency range in rad/s for ``method="fit"``: that of the thesis's forcing function.

    Returns
    -------
    parameters : DataFrame
        Columns K_e, T_L (s), K_edot (s), tau_e (s), omega_nm (rad/s) and zeta_nm, and standard
        deviations ``sd_K_e`` and so on, NaN if the model has no covariance and for a tau_e that is
        the model's own delay. ``method="fit"`` adds ``misfit``, the root mean square of the
        relative error of the response. One row, or one per instant with the index ``time`` in s.
        ``attrs`` holds ``units``, ``method``, and the number ``n_nan`` of rows that are NaN, of
        which a UserWarning tells: no complex pair of poles, or no fit.

    Raises
    ------
    TypeError
        If it is not an ARX model.
    ValueError
        If orders, input, band or delay do not allow the conversion.

    See Also
    --------
    skhoid.plotting.ParametersDisplay : Plots them.

    Notes
    -----
    The delay of ``"poles"`` is tau_e = (n_k - 1) / f_s at the rate of the recording. Standard
    deviations do not include bias: remnant biases omega_nm and zeta_nm upwards. On decimated
    recordings ``"poles"`` assumes that e is held over the decimated step, which is not the case;
    ``"fit"`` holds it over the step of the recording.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from skhoid import ARXRegressor, HumanOperator
    >>> from skhoid import operator_parameters
    >>> from skhoid import zoh_parameters
    >>> a1, a2, b0, b1 = zoh_parameters(HumanOperator(), dt=0.01)
    >>> e = np.random.default_rng(0).standard_normal(2000)
    >>> u = lfilter(29 * [0] + [b0, b1], [1, a1, a2], e)
    >>> model = ARXRegressor(na=2, nb=2, nk=29, dt=0.01).fit(e[:, None], u)
    >>> operator_parameters(model)[["K_e", "T_L", "tau_e", "omega_nm", "zeta_nm"]].round(3)
        K_e  T_L  tau_e  omega_nm  zeta_nm
    0  0.09  0.4   0.28     11.25     0.35
    """
    followed = _read_path(model)
    if followed is not None:
        return followed
    arx = ARXChannel.of(model, input, "operator_parameters")
    misfit: dict[str, Any] = {}
    if method == "poles":
        values, deviations, n_failed = _convert_poles(arx)
        reason = "have no pair of complex poles"
    elif arx.delay_path is not None and np.ndim(arx.delay_path):
        raise ValueError("method='fit' needs one delay; the delay of this model varies in time.")
    else:
        values, deviations, misfit["misfit"], n_failed = fit_operator(
            arx.theta,
            arx.dt,
            na=arx.na,
            delay=arx.delay,
            covariance=arx.covariance,
            dt_recording=arx.dt_recording,
            band=band,
        )
        reason = "have a response that does not fit an operator"
    columns = {name: values[name] for name in NAMES}
    columns |= {f"sd_{name}": deviations[name] for name in NAMES}
    index = None if arx.time is None else pd.Index(arx.time, name="time")
    frame = pd.DataFrame(
        {name: np.atleast_1d(column) for name, column in (columns | misfit).items()}, index=index
    )
    units = UNITS | {f"sd_{name}": unit for name, unit in UNITS.items()}
    frame.attrs = {"units": units, "n_nan": int(frame["K_e"].isna().sum()), "method": method}
    if n_failed:
        warnings.warn(
            f"{n_failed} of {len(frame)} ARX models {reason}; their operator parameters are NaN.",
            UserWarning,
            stacklevel=2,
        )
    return frame


def _read_path(model: Any) -> pd.DataFrame | None:
    """The table of a model that has the operator's own parameters over time, if it is one."""
    steps, found = taken_apart(model)
    if not hasattr(found, "operator_frame"):
        return None
    frame = found.operator_frame().copy()
    frame["tau_e"] += find_delay_before(steps, found, 0, "operator_parameters")
    units = UNITS | {f"sd_{name}": unit for name, unit in UNITS.items()}
    n_nan = int(frame["K_e"].isna().sum())
    frame.attrs = {"units": units, "n_nan": n_nan, "method": type(found).__name__}
    return frame


def _convert_poles(arx: ARXChannel) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], int]:
    """Operator parameters by Eqs. 22-23, and the delay."""
    nb = arx.theta.shape[-1] - arx.na
    if (arx.na, nb) != (2, 2):
        raise ValueError(
            f"method='poles' converts ARX models with na=2 and nb=2; this one has na={arx.na} "
            f"and nb={nb}. method='fit' converts any orders."
        )
    tau_e = arx.delays - arx.dt_recording
    if np.min(tau_e) < -1e-9:
        raise ValueError(
            f"The model's delay is {np.min(arx.delays):g} s but zero-order hold alone takes "
            f"{arx.dt_recording:g} s, so tau_e would be negative. Give the model a delay (nk, or "
            "a DelayShift before it; DelaySearchCV finds it)."
        )
    values, deviations, n_not_complex = arx_to_operator(arx.theta, arx.dt, arx.covariance)
    values["tau_e"] = np.broadcast_to(np.maximum(tau_e, 0.0), arx.theta.shape[:-1])
    deviations["tau_e"] = np.broadcast_to(arx.delay_sd, arx.theta.shape[:-1])
    return values, deviations, n_not_complex
