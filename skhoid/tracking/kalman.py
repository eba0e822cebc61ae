"""Kalman filters on an operator: how they begin, their settings, and runs side by side."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.linalg import expm, solve_continuous_lyapunov

from .. import _kernels
from ..arx.rls import Instants
from ..arx.streaming import Recursion
from ..exceptions import PoorExcitationWarning, RankDeficiencyError, ShortRunError
from ..model.operator_regressor import OperatorRegressor
from ..preprocessing.grid import bridged
from ..regression import DataToFit

NAMES = ("omega_nm", "zeta_nm", "tau_e", "K_e", "K_edot")  # as in the state of the kernel
SETTLING = 3.0  # s before residuals count
LAGS = np.geomspace(0.02, 0.5, 15)  # s, time constants of a remnant that are tried
SHARES = 10.0 ** np.arange(-4.0, 0.6, 0.5)  # of white noise in the remnant's variance, tried
BAND = (0.1, 4.0)  # Hz in which a residual shows the remnant: not errors of parameters or hold
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

    ``usual_square`` is that of an innovation over its variance; ``intercept`` the constant part of
    the output, which the filter does not see.
    """

    parameters: np.ndarray
    noise: Noise
    errors: np.ndarray  # standard deviations of the logarithms
    sizes: np.ndarray  # variances of z and z'
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
    known = {name: float(value) for name, value in init.items()}
    if set(known) != set(NAMES):
        raise ValueError(
            f"init must be 'batch' or a dict with {', '.join(NAMES)}; got {sorted(init)}."
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
    """Start values, and standard errors of their logarithms, by a batch fit of windows."""
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


def make_settings(
    start: Start,
    dt: float,
    walk: np.ndarray,
    bounds: np.ndarray,
    options: Mapping[str, float],
) -> np.ndarray:
    """Settings of the kernel for a lane.

    ``walk`` are the standard deviations of the change of each logarithm in a second; ``bounds``
    those of the logarithms of omega_nm, zeta_nm and tau_e.
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


def read_state(start: Start, dt: float, p0: np.ndarray, bounds: np.ndarray) -> np.ndarray:
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
    }
    settings = make_settings(start, dt, np.zeros(5), bounds, options)
    state = read_state(start, dt, start.errors, bounds)
    kernel, nothing = _kernels.kalman, np.empty((0, 0, 0))
    errors, filtered = np.full((1, y.size, 2), np.nan), np.zeros((1, y.size, 56))
    kernel.advance(
        kernel.EKF, state[None], settings[None], e[None], y[None], fresh[None], 0, y.size,
        nothing, errors, filtered, nothing, np.empty((0, 0, 0, 0)),
    )  # fmt: skip
    return errors[0, :, 0], filtered[0, :, 5:7]


def fitted_noise(residuals: list[np.ndarray], dt: float, order: int) -> Noise:
    """The remnant of an order most likely behind residuals of runs (Whittle)."""
    variance = float(np.mean(np.concatenate([r[~np.isnan(r)] for r in residuals]) ** 2))
    variance = max(variance, 1e-300)
    if order == 0:
        return Noise(0, 1.0, 0.0, variance)
    powers, angles = zip(*(periodogram(r, dt) for r in residuals), strict=True)
    power, angle = np.concatenate(powers), np.concatenate(angles)
    z = np.exp(1j * angle)
    best = (np.inf, Noise(order, 0.06, variance, 1e-3 * variance))
    for lag in LAGS:
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


def cascade_spectrum(transition: np.ndarray, drive: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Spectrum of the last state of x(t+1) = transition x(t) + noise at points of the circle."""
    order = len(transition)
    rows = np.zeros((order, z.size), dtype=complex)  # last row of (z - transition)^-1
    rows[-1] = 1 / (z - transition[-1, -1])
    for j in range(order - 2, -1, -1):
        total = sum(rows[k] * transition[k, j] for k in range(j + 1, order))
        rows[j] = total / (z - transition[j, j])
    return np.einsum("iz,ij,jz->z", rows, drive, rows.conj()).real


METHODS = {
    "ukf": "unscented Kalman filter",
    "ekf": "extended Kalman filter",
    "dual_ekf": "dual extended Kalman filter",
}
BOUNDS = np.log([[3.0, 30.0], [0.05, 1.0], [0.05, 0.6]])  # omega_nm (rad/s), zeta_nm, tau_e (s)
GATE = 4.0  # standard deviations of an innovation from which on its influence no longer grows
NOISE_MEMORY = 10.0  # s over which the scale of the noise follows the innovations
RATIOS = np.array([0.1, 0.1, 0.1, 1.0, 1.0])  # of the walks of logarithms to that of gains
REACH = 3.0**0.5  # of sigma points: alpha = 1, kappa = 3 - n
BEND = 1.0  # beta - alpha^2 with beta = 2
MOST_VARIANCE = 1.0
SCALES = (0.05, 50.0)  # between which the noise's scale stays
GIVEN_ERROR = 0.3  # standard deviation of logarithms of parameters that are given
NOTHING, NOTHING_WIDE = np.empty((0, 0, 0)), np.empty((0, 0, 0, 0))
OFFSET = 0.2  # of the output's standard deviation, from which on a constant part is told
REMEMBERED = 0.5  # s between residuals that have little to do with each other
BY_CHANCE = 4.0  # standard errors of a mean, up to which it may be chance
GAP, NO_ROW = 1, 2
GAP_ROWS = 100  # between rows of a stream that do not follow each other


class Window(NamedTuple):
    """The first seconds of a run: sample numbers, error, output, and where signals begin anew."""

    numbers: np.ndarray
    e: np.ndarray
    y: np.ndarray
    fresh: np.ndarray


@dataclass(frozen=True)
class Lanes:
    """Runs side by side, aligned by time in the run; arrays of shape (n_runs, n_instants).

    ``fresh`` is 1 where a run begins or goes on after a gap, 2 where a run has no row.
    """

    numbers: np.ndarray
    e: np.ndarray
    y: np.ndarray
    fresh: np.ndarray

    @property
    def n_lanes(self) -> int:
        return len(self.e)

    @classmethod
    def of_rows(cls, e: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> Lanes:
        """A lane of rows one after the other, with a gap where they do not follow each other."""
        begins = fresh.astype(np.int8)
        begins[:1] = GAP
        numbers = np.arange(y.size) + GAP_ROWS * (np.cumsum(begins) - 1)
        return cls(numbers, e[None], y[None], begins[None])

    def windows(self, n_rows: int) -> list[Window]:
        """The first rows of each run from the first one that is known."""
        found = []
        for e, y, fresh in zip(self.e, self.y, self.fresh, strict=True):
            rows = np.flatnonzero(fresh != NO_ROW)
            known = np.flatnonzero(~np.isnan(e[rows]) & ~np.isnan(y[rows]))
            if known.size == 0:
                continue
            rows = rows[known[0] : known[0] + n_rows]
            flags = fresh[rows]
            flags[0] = GAP
            found.append(Window(self.numbers[rows], e[rows], y[rows], flags))
        return found


def make_lanes(data: DataToFit, instants: Instants) -> Lanes:
    """Lanes of the runs of data to fit; a run-in gives its error alone."""
    shape = instants.n_runs, len(instants)
    e, y = np.full(shape, np.nan), np.full(shape, np.nan)
    fresh = np.full(shape, NO_ROW, dtype=np.int8)
    place = instants.run, instants.of_row
    grid = data.grid
    measured = np.zeros(grid.n_rows, dtype=bool)
    for begin, end, use in zip(grid.begin, grid.end, grid.measured, strict=True):
        measured[begin:end] = use
    begins = np.zeros(grid.n_rows, dtype=np.int8)
    begins[grid.past] = GAP
    e[place] = data.inputs[:, 0]
    y[place] = np.where(measured, data.output, np.nan)
    fresh[place] = begins
    return Lanes(instants.number, e, y, fresh)


class KalmanPlan:
    """What all filters of a model have in common."""

    def __init__(self, model: Any, dt: float) -> None:
        self.model, self.dt = model, dt
        self.method = [*METHODS].index(model.method)

    def start(self, windows: list[Window]) -> Start:
        """Parameters and noise to begin with."""
        model = self.model
        init = model.init
        if isinstance(init, Mapping):
            values, deviations = given_values(init), np.full(5, GIVEN_ERROR)
        else:
            rows = [(w.numbers, w.e, w.y) for w in windows]
            if model.fit_intercept:
                levels = [np.nanmean(np.concatenate([row[i] for row in rows])) for i in (1, 2)]
                rows = [(numbers, e - levels[0], y - levels[1]) for numbers, e, y in rows]
            values, deviations = batch_values(rows, self.dt)
        values[:3] = np.clip(values[:3], *np.exp(BOUNDS.T))
        residuals, states = [], []
        for w in windows:
            e = np.where(np.isnan(w.e), 0.0, w.e)
            residual, z = simulated(values, e, w.y, w.fresh, self.dt)
            residuals.append(residual[min(round(SETTLING / self.dt), residual.size // 2) :])
            states.append(z)
        sizes = np.mean(np.concatenate([*states, np.zeros((1, 2))]) ** 2, axis=0)
        intercept = self._intercept(residuals, windows)
        residuals = [residual - intercept for residual in residuals]
        noise = self._noise(residuals, windows)
        start = Start(values, noise, deviations, sizes, intercept=intercept)
        return replace(start, usual_square=self._usual_square(start, windows))

    def _intercept(self, residuals: list[np.ndarray], windows: list[Window]) -> float:
        """Constant part of the output; a large one of which the model does not know is told."""
        left = np.concatenate([*residuals, np.empty(0)])
        left = left[~np.isnan(left)]
        if left.size == 0 and self.model.fit_intercept:
            raise ShortRunError(
                "fit_intercept=True estimates the constant part of the output in the first window, "
                "in which nothing was measured. Give a longer init_window."
            )
        if left.size == 0:
            return 0.0
        found = float(left.mean())
        if self.model.fit_intercept:
            return found
        moves = float(np.nanstd(np.concatenate([w.y for w in windows])))
        by_chance = float(left.std()) * np.sqrt(REMEMBERED / (left.size * self.dt))
        if abs(found) > max(OFFSET * moves, BY_CHANCE * by_chance) and moves > 0:
            warnings.warn(
                f"The output has a constant part of {found:.3g}, {abs(found) / moves:.1f} times "
                "its standard deviation, which biases the parameters. Use fit_intercept=True, or "
                "subtract it.",
                PoorExcitationWarning,
                stacklevel=4,
            )
        return 0.0

    def _noise(self, residuals: list[np.ndarray], windows: list[Window]) -> Noise:
        if not residuals or max(int((~np.isnan(r)).sum()) for r in residuals) < 50:
            raise ShortRunError(
                f"The first window holds {sum(w.y.size for w in windows)} rows, too few to "
                "estimate the remnant. Give a longer init_window."
            )
        return fitted_noise(residuals, self.dt, int(self.model.remnant_order))

    def _usual_square(self, start: Start, windows: list[Window]) -> float:
        """Mean square of innovations over their variance with the parameters of the start.

        It is below 1 where the remnant has less power at high frequencies than assumed.
        """
        squares, updates = 0.0, 0.0
        for w in windows:
            rows = KalmanRows(self, start, method=_kernels.kalman.EKF, fixed=True)
            rows.run(w.e, w.y, w.fresh)
            squares += float(rows.number("squares")[0])
            updates += float(rows.number("updates")[0])
        return squares / updates if squares > 0 else 1.0

    def options(self, *, fixed: bool) -> dict[str, float]:
        """Settings of the kernel that are numbers."""
        return {
            "reach": REACH,
            "bend": BEND,
            "gate": np.inf if fixed else GATE,
            "usual_square": 1.0,
            "scale_gain": 0.0 if fixed else min(self.dt / NOISE_MEMORY, 0.1),
            "least_scale": SCALES[0],
            "most_scale": SCALES[1],
            "most_variance": MOST_VARIANCE,
        }


class KalmanRows(Recursion):
    """A filter that goes on from row to row."""

    def __init__(
        self,
        plan: KalmanPlan,
        start: Start,
        *,
        method: int | None = None,
        fixed: bool = False,
    ) -> None:
        self.start = start
        walk = np.zeros(5) if fixed else float(plan.model.process_noise) * RATIOS
        options = plan.options(fixed=fixed)
        options["usual_square"] = start.usual_square
        self.settings = make_settings(start, plan.dt, walk, BOUNDS, options)[None]
        deviations = np.zeros(5) if fixed else start.errors
        self.state = read_state(start, plan.dt, deviations, BOUNDS)[None]
        order = start.noise.order
        self.method = plan.method if method is None else method
        self.at, self.n = _kernels.kalman.layout(order), 7 + order
        self._signs = np.sign(start.parameters)
        self.fresh = True

    def __deepcopy__(self, memo: Any) -> KalmanRows:
        other = object.__new__(KalmanRows)
        other.__dict__.update(self.__dict__)
        other.state = self.state.copy()
        return other

    @property
    def covariance(self) -> np.ndarray:
        """P, as a view of the state."""
        begin = self.at["P"]
        return self.state[0, begin : begin + self.n**2].reshape(self.n, self.n)

    def number(self, name: str, size: int = 1) -> np.ndarray:
        """Numbers of the state by their name."""
        return self.state[0, self.at[name] : self.at[name] + size]

    def rest(self) -> None:
        self.fresh = True

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        fresh = np.zeros(y.size, dtype=np.int8)
        fresh[0] = self.fresh
        self.fresh = False
        self.run(X.reshape(-1), y, fresh)

    def run(self, e: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> None:
        """Take rows with flags of where signals begin anew."""
        y = y - self.start.intercept
        _kernels.kalman.advance(
            self.method, self.state, self.settings, e.reshape(1, -1), y.reshape(1, -1),
            fresh.reshape(1, -1), 0, y.size, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING_WIDE,
        )  # fmt: skip

    def latest(self) -> np.ndarray:
        """The last parameters as a row, in the order of an OperatorPath."""
        omega, zeta, tau, K_e, K_edot = (self._signs * np.exp(self.state[0, :5])).tolist()
        return np.array([[K_e, K_edot, tau, omega, zeta]])

    def last_path(self) -> np.ndarray:
        """The last row of a path as the kernel gives it."""
        P = self.covariance
        row = [*self.state[0, :5], *np.diag(P)[:5], P[3, 4]]
        return np.array(row).reshape(1, 1, -1)


class Found(NamedTuple):
    """What filters found: path (n_runs, n_instants, N_PATH), errors, and where runs have rows."""

    path: np.ndarray
    errors: np.ndarray
    present: np.ndarray


def run_lanes(filters: list[KalmanRows], lanes: Lanes, *, smooth: bool) -> Found:
    """Run each filter over its lane, which leaves it at the end."""
    kernel, n = _kernels.kalman, filters[0].n
    shape, n_instants = lanes.e.shape, lanes.e.shape[1]
    path, errors = np.zeros((*shape, kernel.N_PATH)), np.full((*shape, 2), np.nan)
    y = lanes.y - filters[0].start.intercept
    filtered, priors, crosses = NOTHING, NOTHING, NOTHING_WIDE
    for lane, one in enumerate(filters):
        own = slice(lane, lane + 1)
        if smooth:
            filtered, priors = np.zeros((2, 1, n_instants, n + n * n))
            crosses = np.zeros((1, n_instants, n, n))
        kernel.advance(
            one.method, one.state, one.settings, lanes.e[own], y[own], lanes.fresh[own],
            0, n_instants, path[own], errors[own], filtered, priors, crosses,
        )  # fmt: skip
        one.fresh = False
        if smooth:
            kernel.smooth_kalman(filtered, priors, crosses, lanes.fresh[own])
            covariance = filtered[0, :, n:].reshape(-1, n, n)
            variances = np.diagonal(covariance, axis1=1, axis2=2)[:, :5]
            at = kernel.settings_layout(n - 7)
            low, high = (one.settings[0, at[name] : at[name] + 5] for name in ("low", "high"))
            path[lane, :, :5] = np.clip(filtered[0, :, :5], low, high)
            path[lane, :, 5:10] = np.maximum(variances, 0.0)
            path[lane, :, 10] = covariance[:, 3, 4]
    return Found(path, errors[..., 0], lanes.fresh != NO_ROW)


def combined(
    path: np.ndarray, present: np.ndarray, start: Start
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Parameters over instants and their standard errors, of runs weighed by certainty."""
    logarithms, variances = path[..., :5], np.maximum(path[..., 5:10], 1e-300)
    weights = np.where(present[..., None], 1 / variances, 0.0)
    precision = weights.sum(axis=0)
    weights /= precision
    mean = np.einsum("rtp,rtp->tp", weights, logarithms)
    values = dict(zip(NAMES, (np.sign(start.parameters) * np.exp(mean)).T, strict=True))
    deviation = 1 / np.sqrt(precision)
    deviations = {
        name: np.abs(values[name]) * sd for name, sd in zip(NAMES, deviation.T, strict=True)
    }
    shared = np.einsum("rt,rt,rt->t", weights[..., 3], weights[..., 4], path[..., 10])
    lead = np.maximum(deviation[:, 3] ** 2 + deviation[:, 4] ** 2 - 2 * shared, 0.0)
    deviations["T_L"] = np.abs(values["K_edot"] / values["K_e"]) * np.sqrt(lead)
    return values, deviations
