"""Naive Kalman filters on the operator, in plain NumPy, as their textbooks write them."""

from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from skhoid._kernels import kalman


def settings(m=1, **changes):
    """Settings of a kernel's lane: an operator at 100 Hz with a remnant of order m."""
    dt, T, variance = changes.pop("dt", 0.01), changes.pop("T", 0.06), changes.pop("variance", 1e-3)
    numbers = {
        "dt": dt,
        "measurement_noise": 1e-4,
        "reach": 3**0.5,
        "bend": 1.0,
        "gate": np.inf,
        "usual_square": 1.0,
        "scale_gain": 0.0,
        "least_scale": 0.05,
        "most_scale": 50.0,
        "most_variance": 1.0,
        "sign_gain": 1.0,
        "sign_rate": 1.0,
    }
    arrays = {
        "walk": np.full(5, 1e-6),
        "low": np.append(np.log([2, 0.05, 0.05]), [-9, -9]),
        "high": np.append(np.log([40, 1, 0.6]), [9, 9]),
        "jitter": np.zeros(2),
        "start": np.array([1e-4, 1e-2]),
        **dict(
            zip(("transition", "drive", "stationary"), cascade(m, T, dt, variance), strict=True)
        ),
    }
    for name, value in changes.items():
        (numbers if name in numbers else arrays)[name] = value
    at = kalman.settings_layout(m)
    row = np.zeros(at["size"])
    row[: kalman.N_SETTINGS] = [numbers[name] for name in kalman.SETTINGS]
    for name, values in arrays.items():
        values = np.ravel(values)
        row[at[name] : at[name] + values.size] = values
    return row


def cascade(m, T, dt, variance):
    """Transition, drive and stationary covariance of a cascade of lags, by a long sum."""
    if m == 0:
        return np.zeros((3, 0))
    rates = (np.eye(m, k=-1) - np.eye(m)) / T
    steps = np.linspace(0, 30 * T, 30001)
    paths = np.stack([expm(rates * t)[:, 0] for t in steps[::30]])
    stationary = np.einsum("ti,tj->ij", paths, paths) * (steps[30] - steps[0])
    stationary *= variance / stationary[-1, -1]
    transition = expm(rates * dt)
    return transition, stationary - transition @ stationary @ transition.T, stationary


def state(m, parameters, deviation=0.3, longest=0.6, dt=0.01):
    """State of a lane that has not begun; parameters omega, zeta, tau, K_e, K_edot."""
    at, n = kalman.layout(m), 7 + m
    row = np.zeros(at["ring"] + int(np.ceil(longest / dt)) + 3)
    row[:5] = np.log(parameters)
    covariance = np.zeros((n, n))
    covariance[:5, :5] = np.eye(5) * deviation**2
    row[at["P"] : at["P"] + n * n] = covariance.ravel()
    row[at["scale"]] = 1.0
    row[at["error"]] = np.nan
    return row


def advance(m, method, states, rows, e, y, fresh=None):
    """All outputs of the kernel, by name."""
    lanes, n, length = len(states), 7 + m, e.shape[1]
    if fresh is None:
        fresh = np.zeros(e.shape, dtype=np.int8)
        fresh[:, 0] = 1
    found = {
        "path": np.zeros((lanes, length, kalman.N_PATH)),
        "errors": np.zeros((lanes, length, 2)),
        "filtered": np.zeros((lanes, length, n + n * n)),
        "priors": np.zeros((lanes, length, n + n * n)),
        "crosses": np.zeros((lanes, length, n, n)),
    }
    kalman.advance(method, states, rows, e, y, fresh, 0, length, *found.values())
    return found | {"fresh": fresh}


class Twin:
    """The model of a lane: transition and measurement of a state, and a filter in plain words."""

    def __init__(self, m, row, x, P, e):
        at = kalman.settings_layout(m)
        names = list(at)
        self.m, self.n, self.x, self.P, self.e = m, 7 + m, x.copy(), P.copy(), e
        for name, after in pairwise(names):
            setattr(self, name, row[at[name] : at[after]])
        for name, value in zip(kalman.SETTINGS, row, strict=False):
            setattr(self, name, value)
        self.transition = self.transition.reshape(m, m)
        self.noise = np.zeros((self.n, self.n))
        self.noise[:5, :5] = np.diag(self.walk)
        self.noise[5:7, 5:7] = np.diag(self.jitter)
        self.noise[7:, 7:] = self.drive.reshape(m, m)
        self.P[5:7, 5:7] = np.diag(self.start)
        self.P[7:, 7:] = self.stationary.reshape(m, m)

    def delayed(self, t, tau):
        lag = min(tau / self.dt, t - 2.0)  # not before the first row
        whole = int(lag)
        recent, older = t - 1 - whole, t - 2 - whole
        return self.e[recent] + (lag - whole) * (self.e[older] - self.e[recent])

    def moved(self, x, t):
        """State at row t from that at row t - 1."""
        omega, zeta, tau = np.exp(np.clip(x[:3], self.low[:3], self.high[:3]))
        block = np.zeros((3, 3))
        block[:2] = [[0, 1, 0], [-(omega**2), -2 * zeta * omega, 1]]
        step = expm(block * self.dt)
        z = step[:2, :2] @ x[5:7] + step[:2, 2] * self.delayed(t, tau)
        return np.concatenate([x[:5], z, self.transition @ x[7:]])

    def output(self, x):
        omega = np.exp(np.clip(x[0], self.low[0], self.high[0]))
        u = omega**2 * (np.exp(x[3]) * x[5] + np.exp(x[4]) * x[6])
        return u + (x[-1] if self.m else 0.0)

    def ready(self, t):
        return t >= np.exp(self.x[2]) / self.dt + 2

    def slopes(self, function):
        columns = []
        for i in range(self.n):
            step = np.zeros(self.n)
            step[i] = 1e-5 * max(abs(self.x[i]), 1e-3)
            columns.append((function(self.x + step) - function(self.x - step)) / (2 * step[i]))
        return np.array(columns).T

    def correct(self, cross, innovation, variance):
        self.x = self.x + cross * innovation / variance
        self.P = self.P - np.outer(cross, cross) / variance

    def extended(self, t, y):
        F = self.slopes(lambda x: self.moved(x, t))
        self.x = self.moved(self.x, t)
        self.P = F @ self.P @ F.T + self.noise
        if np.isfinite(y):
            h = self.slopes(self.output)
            cross = self.P @ h
            self.correct(cross, y - self.output(self.x), h @ cross + self.measurement_noise)

    def dual(self, t, y):
        """A state filter with the gains, and one of omega, zeta and tau by its sensitivities W."""
        own, other = slice(3, None), slice(0, 3)
        if not hasattr(self, "W"):
            self.W = np.zeros((self.n - 3, 3))
        F = self.slopes(lambda x: self.moved(x, t))
        self.x = self.moved(self.x, t)
        P, P_other = self.P[own, own], self.P[other, other]
        P = F[own, own] @ P @ F[own, own].T + self.noise[own, own]
        P_other = P_other + self.noise[other, other]
        self.W = F[own, own] @ self.W + F[own, other]
        if np.isfinite(y):
            h, innovation = self.slopes(self.output), y - self.output(self.x)
            cross = P @ h[own]
            variance = h[own] @ cross + self.measurement_noise
            slope = h[own] @ self.W + h[other]
            moved = P_other @ slope
            spread = variance + slope @ moved
            self.x = self.x + np.append(moved / spread, cross / variance) * innovation
            self.W = self.W - np.outer(cross / variance, slope)
            P = P - np.outer(cross, cross) / variance
            P_other = P_other - np.outer(moved, moved) / spread
        self.P = np.block([[P_other, np.zeros((3, len(P)))], [np.zeros((len(P), 3)), P]])

    def points(self):
        root = np.linalg.cholesky(self.P + 1e-300 * np.eye(self.n))
        steps = self.reach * np.hstack([np.zeros((self.n, 1)), root, -root])
        weights = np.full(2 * self.n + 1, 1 / (2 * self.reach**2))
        weights[0] = 1 - self.n / self.reach**2
        spread = weights.copy()
        spread[0] += 1 + self.bend  # 1 - alpha^2 + beta
        return self.x[:, None] + steps, weights, spread

    def unscented(self, t, y):
        points, weights, spread = self.points()
        moved = np.array([self.moved(x, t) for x in points.T]).T
        self.x = moved @ weights
        rest = moved - self.x[:, None]
        self.P = (rest * spread) @ rest.T + self.noise
        if np.isfinite(y):
            points, weights, spread = self.points()
            outputs = np.array([self.output(x) for x in points.T])
            mean = outputs @ weights
            rest, error = points - self.x[:, None], outputs - mean
            variance = (error**2) @ spread + self.measurement_noise
            self.correct((rest * spread) @ error, y - mean, variance)


def linear(F, drives, noise, h, variance, x, P, y):
    """Kalman filter and smoother of x(t) = F x(t-1) + drive(t); y = h'x + noise, NaN if not known.

    Returns filtered and smoothed means and covariances; ``drives`` is None before the first step.
    """
    means, covariances, priors, predicted = [], [], [], []
    for drive, value in zip(drives, y, strict=True):
        if drive is not None:
            x, P = F @ x + drive, F @ P @ F.T + noise
        priors.append(x), predicted.append(P)
        if drive is not None and np.isfinite(value):
            gain = P @ h / (h @ P @ h + variance)
            x = x + gain * (value - h @ x)
            I_KH = np.eye(len(x)) - np.outer(gain, h)
            P = I_KH @ P @ I_KH.T + variance * np.outer(gain, gain)
        means.append(x), covariances.append(P)
    smooth, spreads = [means[-1]], [covariances[-1]]
    for t in range(len(y) - 2, -1, -1):
        step = F if drives[t + 1] is not None else np.eye(len(x))
        gain = np.linalg.solve(predicted[t + 1], step @ covariances[t]).T
        smooth.insert(0, means[t] + gain @ (smooth[0] - priors[t + 1]))
        spreads.insert(0, covariances[t] + gain @ (spreads[0] - predicted[t + 1]) @ gain.T)
    return map(np.array, (means, covariances, smooth, spreads))
