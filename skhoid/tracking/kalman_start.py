"""How a Kalman filter on an operator begins: parameters, remnant and noise of the first window.

Open it to see where the numbers that nobody gave come from.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.linalg import expm, solve_continuous_lyapunov

from .. import _kernels
from ..exceptions import RankDeficiencyError, ShortRunError
from ..model.operator_regressor import OperatorRegressor

NAMES = ("omega_nm", "zeta_nm", "tau_e", "K_e", "K_edot")  # as in the state of the kernel
SETTLING = 3.0  # s before residuals count
LAGS = np.geomspace(0.02, 0.5, 15)  # s, time constants of a remnant that are tried
SHARES = 10.0 ** np.arange(-4.0, 0.6, 0.5)  # of white noise in the remnant's variance, tried
BAND = (0.1, 4.0)  # Hz in which a residual shows the remnant: not errors of parameters or hold
MOST_REMNANT_ORDER = 4
DOUBTFUL = 2.0  # standard errors below which the sign of a gain is not believed
JITTER = 1e-6  # of the variance of z, per second, as noise that keeps covariances regular
ERRORS = (0.05, 0.3)  # of logarithms, between which those of a batch fit are taken
BRIDGE = 0.1  # s of missing output that a batch fit interpolates
GAIN_RANGE = 50.0  # factor around its start within which a gain stays


@dataclass(frozen=True)
class Noise:
    """Remnant as a cascade of ``order`` lags, with its variance, and white measurement noise."""

    order: int
    time_constant: float
    variance: float
    white: float

    def matrices(self, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transition, covariance of the drive, and stationary covariance of its states."""
        transition, stationary = cascade(self.order, self.time_constant, dt)
        stationary = stationary * self.variance
        return transition, stationary - transition @ stationary @ transition.T, stationary


@dataclass(frozen=True)
class Start:
    """What a filter begins with: parameters in the order of ``NAMES``, and noise.

    With a ``covariance``, it is kept. ``usual_square`` is that of an innovation over its variance.
    ``intercept`` is the constant part of the output, which the filter does not see.
    """

    parameters: np.ndarray
    noise: Noise
    errors: np.ndarray  # standard deviations of the logarithms
    sizes: np.ndarray  # variances of z and z'
    spread: float = np.nan  # of the logarithm of a gain after a second, if all is constant
    covariance: np.ndarray | None = None
    usual_square: float = 1.0
    intercept: float = 0.0


def cascade(order: int, time_constant: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition of a cascade of lags, and its stationary covariance for unit variance."""
    rates = (np.eye(order, k=-1) - np.eye(order)) / time_constant
    drive = np.zeros((order, order))
    if order == 0:
        return drive, drive
    drive[0, 0] = 1.0
    stationary = np.atleast_2d(solve_continuous_lyapunov(rates, -drive))
    return expm(rates * dt), stationary / stationary[-1, -1]


def given_values(init: Mapping[str, Any]) -> np.ndarray:
    """Start values from a dict, in the order of ``NAMES``."""
    known = {name: float(value) for name, value in init.items() if name != "remnant"}
    if "T_L" in known and "K_edot" not in known and "K_e" in known:
        known["K_edot"] = known.pop("T_L") * known["K_e"]
    if set(known) != set(NAMES):
        raise ValueError(
            f"init must be 'batch' or a dict with {', '.join(NAMES)} (T_L instead of K_edot is "
            f"fine) and, if known, remnant, its standard deviation; got {sorted(init)}."
        )
    values = np.array([known[name] for name in NAMES])
    if not np.isfinite(values).all() or (values[:3] <= 0).any() or (values[3:] == 0).any():
        raise ValueError(
            "init: omega_nm, zeta_nm and tau_e must be positive, K_e and K_edot not zero, since "
            f"the filter works in logarithms; got {init!r}."
        )
    return values


def batch_values(
    window: list[tuple[np.ndarray, np.ndarray, np.ndarray]], dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Start values, and standard errors of their logarithms, by a batch fit of windows.

    Windows are sample numbers, e and y of each run.
    """
    index = pd.MultiIndex.from_arrays(
        [
            np.concatenate([np.full(numbers.size, i) for i, (numbers, *_) in enumerate(window)]),
            np.concatenate([numbers * dt for numbers, *_ in window]),
        ],
        names=["run", "time"],
    )
    X = pd.DataFrame({"e": np.concatenate([e for _, e, _ in window])}, index=index)
    output = np.concatenate([bridged(y, round(BRIDGE / dt)) for *_, y in window])
    y = pd.Series(output, index=index, name="u")
    sign = 1.0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = OperatorRegressor(inputs=["e"]).fit(X, y)
            if (model.parameters_["value"][["K_e", "K_edot"]] <= 0).any():
                # Its start takes gains to be positive.
                other = OperatorRegressor(inputs=["e"]).fit(X, -y)
                if other.loglik_ > model.loglik_:
                    model, sign = other, -1.0
    except (ShortRunError, RankDeficiencyError) as error:
        raise type(error)(
            f"The start of the filter, a batch fit of the first window, failed: {error} Give a "
            "longer init_window, or init={...} with the parameters to start from."
        ) from error
    value, sd = model.parameters_["value"], model.parameters_["sd"].fillna(0.0)
    values = np.array([value[name] for name in NAMES])
    doubt = np.abs(values[3:]) / np.maximum([sd["K_e"], sd["K_edot"]], 1e-300)
    weak = int(np.argmin(doubt))
    if values[3] * values[4] <= 0 and doubt[weak] < DOUBTFUL:
        size = max(abs(values[3 + weak]), float(sd[NAMES[3 + weak]]))
        values[3 + weak] = np.copysign(size, values[4 - weak])
    values[3:] = np.where(values[3:] == 0, 1e-3 * values[4:2:-1], values[3:])
    values[3:] *= sign
    errors = np.array([sd[name] for name in NAMES]) / np.maximum(np.abs(values), 1e-300)
    return values, np.clip(errors, *ERRORS)


def settings_of(
    start: Start,
    dt: float,
    walk: np.ndarray,
    bounds: np.ndarray,
    options: Mapping[str, float],
) -> np.ndarray:
    """Settings of the kernel for a lane.

    ``walk`` are the standard deviations of the change of each logarithm in a second; ``bounds``
    the logarithms of the bounds of omega_nm, zeta_nm and tau_e.
    """
    kernel = _kernels.kalman
    at = kernel.settings_layout(start.noise.order)
    settings = np.zeros(at["size"])
    numbers = {
        "dt": dt,
        "measurement_noise": start.noise.white,
        "sign_gain": np.sign(start.parameters[3]),
        "sign_rate": np.sign(start.parameters[4]),
        **options,
    }
    settings[: kernel.N_SETTINGS] = [numbers[name] for name in kernel.SETTINGS]
    gains = np.log(np.abs(start.parameters[3:]))
    around = np.log(GAIN_RANGE)
    transition, drive, stationary = start.noise.matrices(dt)
    arrays = {
        "walk": walk**2 * dt,
        "low": np.append(bounds[:, 0], gains - around),
        "high": np.append(bounds[:, 1], gains + around),
        "jitter": JITTER * dt * start.sizes,
        "start": start.sizes,
        "transition": transition,
        "drive": drive,
        "stationary": stationary,
    }
    for name, values in arrays.items():
        settings[at[name] : at[name] + values.size] = values.ravel()
    return settings


def state_of(start: Start, dt: float, p0: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """State of a lane before its first row; ``p0`` are standard deviations of logarithms."""
    order = start.noise.order
    at, n = _kernels.kalman.layout(order), 7 + order
    longest = int(np.ceil(np.exp(bounds[2, 1]) / dt)) + 3
    state = np.zeros(at["ring"] + longest)
    logarithms = np.log(np.abs(start.parameters))
    state[:3] = np.clip(logarithms[:3], bounds[:, 0], bounds[:, 1])
    state[3:5] = logarithms[3:]
    covariance = np.zeros((n, n))
    covariance[:5, :5] = np.diag(p0**2)
    state[at["P"] : at["P"] + n * n] = covariance.ravel()
    state[at["scale"]] = 1.0
    state[at["error"]] = np.nan
    return state


def simulated(
    values: np.ndarray, e: np.ndarray, y: np.ndarray, fresh: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Residual of a free run with constant parameters, and z and z', of shape (n_rows, 2)."""
    bounds = np.log(np.abs(values[:3]))[:, None] + np.array([-1e-9, 1e-9])
    start = Start(values, Noise(0, 1.0, 0.0, 1.0), np.zeros(5), np.zeros(2))
    options = {
        "reach": 1.0,
        "bend": 0.0,
        "gate": np.inf,
        "usual_square": 1.0,
        "scale_gain": 0.0,
        "least_scale": 1.0,
        "most_scale": 1.0,
        "most_variance": 1.0,
        "frozen": 0.0,
    }
    settings = settings_of(start, dt, np.zeros(5), bounds, options)
    state = state_of(start, dt, start.errors, bounds)
    kernel, nothing = _kernels.kalman, np.empty((0, 0, 0))
    errors, filtered = np.full((1, y.size, 2), np.nan), np.zeros((1, y.size, 56))
    kernel.filters(0, kernel.EKF)(
        state[None], settings[None], e[None], y[None], fresh[None], 0, y.size,
        nothing, errors, filtered, nothing, np.empty((0, 0, 0, 0)),
    )  # fmt: skip
    return errors[0, :, 0], filtered[0, :, 5:7]


def fitted_noise(
    residuals: list[np.ndarray], dt: float, orders: list[int], time_constant: float | None
) -> Noise:
    """The remnant most likely behind residuals of runs (Whittle), of the likeliest order.

    Each residual's periodogram is compared with the spectrum of a sampled cascade of lags with
    white noise added.
    """
    variance = float(np.mean(np.concatenate([r[~np.isnan(r)] for r in residuals]) ** 2))
    variance = max(variance, 1e-300)
    if orders == [0]:
        return Noise(0, 1.0, 0.0, variance)
    powers, angles = zip(*(periodogram(r, dt) for r in residuals), strict=True)
    power, angle = np.concatenate(powers), np.concatenate(angles)
    z = np.exp(1j * angle)
    best = (np.inf, Noise(max(orders), 0.06, variance, 1e-3 * variance))
    for order in orders:
        for lag in LAGS if time_constant is None else [time_constant]:
            transition, stationary = cascade(order, lag, dt)
            drive = stationary - transition @ stationary @ transition.T
            spectrum = cascade_spectrum(transition, drive, z)
            for share in SHARES:
                shape = spectrum + share
                scale = float(np.mean(power / shape))
                cost = float(np.mean(np.log(shape)) + np.log(max(scale, 1e-300)))
                if cost < best[0]:
                    best = (cost, Noise(order, float(lag), scale, scale * share))
    return best[1]


def periodogram(residual: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Periodogram, with Hann's window, and its angles per sample, without the slow ones."""
    window = np.hanning(residual.size)
    power = np.abs(np.fft.rfft(np.nan_to_num(bridged(residual)) * window)) ** 2 / max(
        np.sum(window**2), 1e-300
    )
    angles = 2 * np.pi * np.arange(power.size) / residual.size
    hertz = angles / (2 * np.pi * dt)
    kept = (hertz > BAND[0]) & (hertz < BAND[1]) & (angles < np.pi)
    return power[kept], angles[kept]


def bridged(values: np.ndarray, longest: float = np.inf) -> np.ndarray:
    """Values with straight lines across stretches of NaN of at most so many rows."""
    known = np.flatnonzero(~np.isnan(values))
    if known.size in (0, values.size):
        return values.copy()
    after = np.clip(np.searchsorted(known, np.arange(values.size)), 1, known.size - 1)
    near = known[after] - known[after - 1] <= longest + 1
    lines = np.interp(np.arange(values.size), known, values[known])
    return np.where(near | ~np.isnan(values), lines, np.nan)


def cascade_spectrum(transition: np.ndarray, drive: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Spectrum of the last state of x(t+1) = transition x(t) + noise at points of the circle."""
    order = len(transition)
    rows = np.zeros((order, z.size), dtype=complex)  # last row of (z - transition)^-1
    rows[-1] = 1 / (z - transition[-1, -1])
    for j in range(order - 2, -1, -1):
        total = sum(rows[k] * transition[k, j] for k in range(j + 1, order))
        rows[j] = total / (z - transition[j, j])
    return np.einsum("iz,ij,jz->z", rows, drive, rows.conj()).real
