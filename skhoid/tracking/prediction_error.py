"""Box-Jenkins models by the prediction-error method: the start of their recursion.

u = B/F e + (1/D) eps: the output is that of a simulation, plus autoregressive noise. Open it for
what a recursion begins with: the estimate of a first window, by Gauss-Newton steps from two starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.signal import lfilter

from ..arx.orders import Orders, regressors
from .follower import first_telling_row

SETTLE = 2.0  # s after a beginning in which simulations forget that they began at rest
LARGEST_POLE = 0.9995
REFLECTED = 0.97  # radius to which a pole outside goes
STEIGLITZ_MCBRIDE = 6  # iterations of the second start
MOST_STEPS = 60
NO_NUMBER = 1e6  # times the noise: the error where F is unstable


@dataclass(frozen=True)
class Start:
    """What a recursion begins with: estimates, and information about both."""

    theta: np.ndarray
    d: np.ndarray
    information: np.ndarray
    noise_triangle: np.ndarray
    noise_variance: float
    n_rows: int


class Window:
    """Stretches of signals and output without gaps, and the model's errors in them.

    Signals are the inputs, and maybe ``external`` ones after them.
    """

    def __init__(
        self,
        parts: list[tuple[np.ndarray, np.ndarray]],
        orders: Orders,
        noise_order: int,
        dt: float,
    ) -> None:
        self.orders, self.nd = orders, noise_order
        self.skip = orders.first_row + noise_order + round(SETTLE / dt)
        n, long = len(orders.nb), self.skip + noise_order
        self.parts = [(X[:, :n], y) for X, y in parts if y.size > long]
        self.external = [X[:, n:] for X, y in parts if y.size > long]
        power = [float(np.mean(y**2)) for _, y in self.parts]
        self.scale = float(np.sqrt(np.mean(power))) if power else 1.0

    @property
    def n_rows(self) -> int:
        return sum(y.size - self.skip for _, y in self.parts)

    def simulated(self, theta: np.ndarray, X: np.ndarray) -> np.ndarray:
        f, b, _ = self.orders.split(theta)
        total = np.zeros(len(X))
        for row, nb, nk, column in zip(b, self.orders.nb, self.orders.nk, X.T, strict=True):
            total += lfilter(np.r_[np.zeros(nk), row[:nb]], np.r_[1.0, f], column)
        return total

    def errors(self, parameters: np.ndarray) -> np.ndarray:
        n = self.orders.n_params
        theta, D = parameters[:n], np.r_[1.0, parameters[n:]]
        if not stable(theta[: self.orders.na]):
            return np.full(self.n_rows, NO_NUMBER * self.scale)
        return np.concatenate(
            [lfilter(D, 1.0, y - self.simulated(theta, X))[self.skip :] for X, y in self.parts]
        )

    def slopes(self, parameters: np.ndarray) -> np.ndarray:
        """Derivatives of the errors: minus the regressors filtered by D / F, and lags of v."""
        n = self.orders.n_params
        theta, D = parameters[:n], np.r_[1.0, parameters[n:]]
        F = np.r_[1.0, theta[: self.orders.na]]
        rows = []
        for X, y in self.parts:
            w = self.simulated(theta, X)
            columns = [-lagged(lfilter(D, F, w), k + 1) for k in range(self.orders.na)]
            for nb, nk, column in zip(self.orders.nb, self.orders.nk, X.T, strict=True):
                filtered = lfilter(D, F, column)
                columns += [lagged(filtered, nk + k) for k in range(nb)]
            noise = [lagged(y - w, k + 1) for k in range(self.nd)]
            rows.append(np.stack([*(-c for c in columns), *noise], axis=1)[self.skip :])
        return np.concatenate(rows)

    def noise(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of D by least squares on v, and the triangle of its lags."""
        if self.nd == 0:
            return np.empty(0), np.empty((0, 0))
        table = []
        for X, y in self.parts:
            v = y - self.simulated(theta, X)
            lags = [-lagged(v, k + 1) for k in range(self.nd)]
            table.append(np.stack([*lags, v], axis=1)[self.skip :])
        stacked = np.concatenate(table)
        triangle = np.asarray(np.linalg.qr(stacked[:, :-1], mode="r"))
        return np.linalg.lstsq(stacked[:, :-1], stacked[:, -1], rcond=None)[0], triangle

    def estimate(self) -> Start:
        """The estimate with the smallest error from two starts."""
        n, best = self.orders.n_params, None
        for theta in self._starts():
            d, _ = self.noise(theta)
            begin = np.r_[theta, d]
            size = np.sqrt((self.slopes(begin) ** 2).mean(axis=0))
            scale = self.scale or 1.0
            unit = scale / np.where(size > 0, size, scale)  # so that tolerances have none
            found = least_squares(
                lambda q, unit=unit, scale=scale: self.errors(q * unit) / scale,
                begin / unit,
                jac=lambda q, unit=unit, scale=scale: self.slopes(q * unit) * (unit / scale),
                max_nfev=MOST_STEPS,
            )
            if best is None or found.cost < best[0]:
                best = found.cost, found.x * unit
        assert best is not None
        return self.at(best[1][:n])

    def at(self, theta: np.ndarray) -> Start:
        """What the window tells about these parameters, and the noise beside them."""
        d, triangle = self.noise(theta)
        parameters = np.r_[theta, d]
        psi = self.slopes(parameters)[:, : theta.size]
        errors = self.errors(parameters)
        return Start(theta, d, psi.T @ psi, triangle, float(np.mean(errors**2)), errors.size)

    def _starts(self) -> list[np.ndarray]:
        """Least squares, and the iteration of Steiglitz and McBride (1965), whitened."""
        first = self._least_squares(None, np.ones(1))
        theta = first
        for _ in range(STEIGLITZ_MCBRIDE):
            d, _ = self.noise(theta)
            theta = self._least_squares(theta, np.r_[1.0, d])
        return [first, theta]

    def _least_squares(self, theta: np.ndarray | None, D: np.ndarray) -> np.ndarray:
        """ARX parameters of signals filtered by D / F, with poles inside the unit circle."""
        F = np.ones(1) if theta is None else np.r_[1.0, theta[: self.orders.na]]
        y = np.concatenate([lfilter(D, F, y) for _, y in self.parts])
        X = np.concatenate([lfilter(D, F, X, axis=0) for X, _ in self.parts])
        edges = np.cumsum([0, *(y.size for _, y in self.parts)])
        begin, end = np.array(list(pairwise(edges))).T
        table = regressors(y, X, begin + self.skip - self.orders.first_row, end, self.orders)[0]
        size = np.sqrt((table[:, :-1] ** 2).sum(axis=0))
        size = np.where(size > 0, size, 1.0)
        found = np.linalg.lstsq(table[:, :-1] / size, table[:, -1], rcond=None)[0] / size
        return stabilised(found, self.orders.na)


def unit_factors(triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U by columns, above the diagonal, and D of (R'R)^-1 = U D U', for a triangle R."""
    n = len(triangle)
    if n == 0:
        return np.empty(0), np.empty(0)
    scale = np.abs(np.diag(triangle))
    least = 1e-12 * (scale.max() or 1.0)
    root = solve_triangular(triangle + np.diag(np.where(scale < least, least, 0.0)), np.eye(n))
    diagonal = np.diag(root)
    columns, rows = np.tril_indices(n, -1)
    return (root / diagonal)[rows, columns], diagonal**2


def whole_stretches(
    X: np.ndarray, y: np.ndarray, n_rows: int, fresh: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stretches without NaN in the first rows from one that is whole; ``fresh`` rows begin anew."""
    first = first_telling_row(X, y)
    if first is None:
        return []
    part = slice(first, first + n_rows)
    rows = np.flatnonzero(~np.isnan(y[part]) & ~np.isnan(X[part]).any(axis=1)) + first
    cuts = np.flatnonzero((np.diff(rows) > 1) | fresh[rows[1:]]) + 1
    return [(X[part], y[part]) for part in np.split(rows, cuts)]


def lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """The same so many rows later, zero before."""
    if lag == 0:
        return values
    return np.concatenate([np.zeros(min(lag, values.size)), values[:-lag]])


def stable(f: np.ndarray) -> bool:
    """Whether all roots of 1 + f_1 q^-1 + ... lie inside the unit circle."""
    return bool(np.abs(np.roots(np.r_[1.0, f])).max(initial=0.0) < LARGEST_POLE)


def stabilised(theta: np.ndarray, na: int) -> np.ndarray:
    """Parameters whose poles outside the unit circle are moved into it."""
    if stable(theta[:na]):
        return theta
    poles = np.roots(np.r_[1.0, theta[:na]])
    radius = np.abs(poles)
    poles = np.where(radius < LARGEST_POLE, poles, REFLECTED * poles / np.maximum(radius, 1e-300))
    return np.r_[np.real(np.poly(poles))[1:], theta[na:]]
