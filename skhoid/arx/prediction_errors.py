"""Output error, Box-Jenkins and ARMAX models: the parameters with the least errors one step ahead.

y = B/F u + C/D n with white n; F is the A of other ARX models, and D is F in an ARMAX model (Ljung
1999, chapters 4 and 7). Derivatives are exact, by filters. What precedes the rows of a run is not
assumed: of output error and Box-Jenkins models it is estimated, as the free response of 1/F that
fits best (variable projection; Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from ..preprocessing.grid import HeldInputs
from .orders import Orders, regressors

PREFILTERS = (0.0, 0.8, 0.95, 0.99)  # poles of low-pass filters before the first least squares
N_ROUNDS = 6  # of Steiglitz and McBride
N_FOLLOWED = 2  # starts, best first
STABLE_RADIUS = 0.9995  # of poles of starts and prefilters
LONG_ORDER = 20  # of the autoregression whose errors stand for n in a first C and D
TOLERANCE = 1e-8  # relative, of squares and parameters
MOST_STEPS = 60


class PredictionErrorEstimate(NamedTuple):
    """Parameters [a b c d], errors of ``rows`` and their slopes, and the runs' free parameters."""

    theta: np.ndarray
    errors: np.ndarray
    slopes: np.ndarray
    rows: np.ndarray
    n_states: int
    n_missing: int
    converged: bool


class Stretch(NamedTuple):
    """Rows whose inputs are known: lagged inputs (and 1), and the output, in which NaN may be."""

    first: int
    inputs: np.ndarray
    y: np.ndarray

    def known(self) -> Iterator[slice]:
        """Rows without gaps in the output."""
        edges = np.flatnonzero(np.diff(np.r_[False, ~np.isnan(self.y), False]))
        for begin, end in edges.reshape(-1, 2):
            yield slice(int(begin), int(end))


def cut_stretches(
    y: np.ndarray, X: np.ndarray, begin: np.ndarray, end: np.ndarray, orders: Orders
) -> list[Stretch]:
    """Stretches from the first row on whose lags are known; NaN inputs hold the last value."""
    held = HeldInputs(X, range(X.shape[1]), list(zip(begin.tolist(), end.tolist(), strict=True)))
    parts = []
    for a, b in zip(begin.tolist(), end.tolist(), strict=True):
        first, table = a + orders.first_row, held[a:b]
        if first >= b or np.isnan(y[first:b]).all():
            continue
        columns = [
            table[first - a - lag : b - a - lag, j]
            for j, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True))
            for lag in range(nk, nk + nb)
        ]
        columns += [np.ones(b - first)] * orders.intercept
        parts.append(Stretch(first, np.column_stack(columns), y[first:b].astype(np.float64)))
    return parts


def stabilise(a: np.ndarray) -> np.ndarray:
    """A polynomial with its roots brought inside the unit circle."""
    poles = np.roots(a)
    size = np.abs(poles)
    if size.size == 0 or size.max() < STABLE_RADIUS:
        return a
    inside = np.minimum(1 / np.maximum(size, STABLE_RADIUS), STABLE_RADIUS)
    inward = inside * np.exp(1j * np.angle(poles))
    return np.real(np.poly(np.where(size >= STABLE_RADIUS, inward, poles)))


def find_starts(
    parts: list[Stretch],
    y: np.ndarray,
    X: np.ndarray,
    begin: np.ndarray,
    end: np.ndarray,
    orders: Orders,
) -> list[np.ndarray]:
    """Parameters [a b] from which to start, those of the least error of simulation first.

    Least squares on signals behind low-pass filters, which noise of fast sampling biases less, and
    then behind the last 1/A (Steiglitz and McBride 1965).
    """
    table, rows, _ = regressors(y, X, begin, end, orders)
    pieces = np.split(table, np.flatnonzero(np.diff(rows) > 1) + 1)
    simulation = SimulationErrors(parts, orders, 0, 0)
    tried = []
    for pole in PREFILTERS if orders.na else PREFILTERS[:1]:
        a = np.poly([pole] * orders.na)
        for _ in range(N_ROUNDS if orders.na else 1):
            table = np.concatenate([lfilter([1.0], a, piece, axis=0) for piece in pieces])
            scale = np.sqrt(np.mean(table**2, axis=0)) + np.finfo(float).tiny
            theta = np.linalg.lstsq((table / scale)[:, :-1], table[:, -1], rcond=None)[0]
            theta /= scale[:-1]
            a = stabilise(np.r_[1.0, theta[: orders.na]])
            tried.append(simulation.fit_inputs(a))
    tried.sort(key=lambda one: one[0])
    return [theta for _, theta in tried]


@dataclass
class SimulationErrors:
    """Errors one step ahead of y = B/F u + C/D n, from the best initial states of each stretch."""

    parts: list[Stretch]
    orders: Orders
    nc: int
    nd: int
    _at: bytes = b""
    _found: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def rows(self) -> np.ndarray:
        return np.concatenate(
            [
                np.arange(part.first, part.first + part.y.size)[self._counting(part)]
                for part in self.parts
            ]
        )

    def _counting(self, part: Stretch) -> np.ndarray:
        """Rows before which as many outputs are known as D has coefficients."""
        counts = np.zeros(part.y.size, dtype=bool)
        for some in part.known():
            counts[some.start + self.nd : some.stop] = True
        return counts

    def split(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        a, b, c, d = np.split(
            theta, np.cumsum([self.orders.na, self.parts[0].inputs.shape[1], self.nc])
        )
        return np.r_[1.0, a], b, np.r_[1.0, c], np.r_[1.0, d]

    def fit_inputs(self, a: np.ndarray) -> tuple[float, np.ndarray]:
        """The least squares of simulation with these poles, and their [a b]: all else is linear."""
        gram, right, power = 0.0, 0.0, 0.0
        for part in self.parts:
            known = ~np.isnan(part.y)
            y = part.y[known]
            answers = lfilter([1.0], a, part.inputs, axis=0)[known]
            free = self._free_responses(a, part.y.size)[known]
            basis = np.linalg.qr(free)[0]
            answers -= basis @ (basis.T @ answers)
            y = y - basis @ (basis.T @ y)
            gram, right = gram + answers.T @ answers, right + answers.T @ y
            power += float(y @ y)
        size = np.sqrt(np.diag(gram)) + np.finfo(float).tiny
        b = np.linalg.lstsq(gram / np.outer(size, size), right / size, rcond=None)[0] / size
        return power - float(b @ right), np.r_[a[1:], b]

    def errors(self, theta: np.ndarray) -> np.ndarray:
        return self._evaluate(theta)[0]

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        return self._evaluate(theta)[1]

    def _free_responses(self, a: np.ndarray, n: int) -> np.ndarray:
        return filtered([1.0], a, np.eye(n, self.orders.na))

    def noise(self, theta: np.ndarray) -> list[np.ndarray]:
        """What the simulation leaves of the output, in pieces without gaps."""
        alone = SimulationErrors(self.parts, self.orders, 0, 0)
        a, b, *_ = self.split(theta)
        left = alone.errors(np.r_[a[1:], b])
        rows = alone.rows
        return np.split(left, np.flatnonzero(np.diff(rows) > 1) + 1)

    def _evaluate(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._found is None or theta.tobytes() != self._at:
            self._at, self._found = theta.tobytes(), self._differentiate(theta)
        return self._found

    def _differentiate(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b, c, d = self.split(theta)
        if any(np.abs(np.roots(p)).max(initial=0.0) >= 1.0 for p in (a, c)):
            n = self.rows.size
            return np.full(n, np.inf), np.zeros((n, theta.size))
        found = [self._differentiate_part(part, a, b, c, d) for part in self.parts]
        errors, slopes = zip(*found, strict=True)
        return np.concatenate(errors), np.concatenate(slopes)

    def _differentiate_part(
        self, part: Stretch, a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        counts, blocks = self._counting(part), list(part.known())

        def whitened(signals: np.ndarray, numerator: np.ndarray = d) -> np.ndarray:
            white = np.zeros_like(signals)
            for some in blocks:
                white[some] = filtered(numerator, c, signals[some])
            return white

        by_inputs = lfilter([1.0], a, part.inputs, axis=0)
        simulated = by_inputs @ b
        free = self._free_responses(a, part.y.size)
        states = whitened(free)[counts]
        basis = np.linalg.qr(states)[0]
        begun = whitened((part.y - simulated)[:, None])[counts, 0]
        simulated = simulated + free @ np.linalg.lstsq(states, begun, rcond=None)[0]
        left = np.where(np.isnan(part.y), 0.0, part.y - simulated)
        white = whitened(left[:, None])[:, 0]
        by_poles = filtered([1.0], a, _lags(simulated, a.size - 1))
        slopes = whitened(np.hstack([by_poles, -by_inputs]))
        by_noise = np.zeros((left.size, self.nc + self.nd))
        for some in blocks:
            past = np.hstack([-_lags(white[some], self.nc), _lags(left[some], self.nd)])
            by_noise[some] = filtered([1.0], c, past)
        slopes = np.hstack([slopes, by_noise])[counts]
        return white[counts], slopes - basis @ (basis.T @ slopes)


@dataclass
class EquationErrors:
    """Errors one step ahead of A y = B u + C n, from n = 0 before rows without gaps."""

    pieces: list[np.ndarray]
    nc: int
    _at: bytes = b""
    _found: tuple[np.ndarray, np.ndarray] | None = None

    def errors(self, theta: np.ndarray) -> np.ndarray:
        return self._evaluate(theta)[0]

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        return self._evaluate(theta)[1]

    def noise(self, theta: np.ndarray) -> list[np.ndarray]:
        """The errors of the equation, C n."""
        n = theta.size - self.nc
        return [piece[:, -1] - piece[:, :-1] @ theta[:n] for piece in self.pieces]

    def _evaluate(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._found is None or theta.tobytes() != self._at:
            self._at, self._found = theta.tobytes(), self._differentiate(theta)
        return self._found

    def _differentiate(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c = np.r_[1.0, theta[theta.size - self.nc :]]
        n = sum(len(piece) for piece in self.pieces)
        if np.abs(np.roots(c)).max(initial=0.0) >= 1.0:
            return np.full(n, np.inf), np.zeros((n, theta.size))
        errors, slopes = [], []
        for piece, left in zip(self.pieces, self.noise(theta), strict=True):
            white = lfilter([1.0], c, left)
            past = np.hstack([piece[:, :-1], _lags(white, self.nc)])
            errors.append(white)
            slopes.append(-lfilter([1.0], c, past, axis=0))
        return np.concatenate(errors), np.concatenate(slopes)


def filtered(b: Any, a: Any, columns: np.ndarray) -> np.ndarray:
    """Columns behind a filter; there may be none."""
    return lfilter(b, a, columns, axis=0) if columns.shape[1] else columns


def _lags(signal: np.ndarray, count: int) -> np.ndarray:
    """The signal one to ``count`` rows before, zero before its first."""
    lagged = np.zeros((signal.size, count))
    for i in range(min(count, signal.size - 1)):
        lagged[i + 1 :, i] = signal[: -i - 1]
    return lagged


def find_noise_start(pieces: list[np.ndarray], nc: int, nd: int) -> np.ndarray:
    """[c d] of C/D n by least squares on the errors of a long autoregression (Hannan, Rissanen)."""
    order = min(LONG_ORDER, max(sum(map(len, pieces)) // 10, 1))
    past = np.concatenate([_lags(piece, order) for piece in pieces])
    long = np.linalg.lstsq(past, np.concatenate(pieces), rcond=1e-8)[0]
    white = [piece - _lags(piece, order) @ long for piece in pieces]
    table = np.concatenate(
        [np.hstack([_lags(w, nc), -_lags(p, nd)]) for w, p in zip(white, pieces, strict=True)]
    )
    found = np.linalg.lstsq(table, np.concatenate(pieces), rcond=1e-8)[0]
    c, d = (stabilise(np.r_[1.0, part])[1:] for part in (found[:nc], found[nc:]))
    return np.r_[c, d]


def estimate(
    y: np.ndarray,
    X: np.ndarray,
    begin: np.ndarray,
    end: np.ndarray,
    orders: Orders,
    method: str,
    nc: int,
    nd: int,
) -> PredictionErrorEstimate:
    """Estimate [a b c d] of a model of output error (oe), Box-Jenkins (bj) or ARMAX (armax)."""
    criterion: SimulationErrors | EquationErrors
    table, rows, n_missing = regressors(y, X, begin, end, orders)
    scale = np.sqrt(np.mean(table[:, :-1] ** 2, axis=0)) + np.finfo(float).tiny
    least = np.linalg.lstsq(table[:, :-1] / scale, table[:, -1], rcond=None)[0] / scale
    if method == "armax":
        criterion = EquationErrors(np.split(table, np.flatnonzero(np.diff(rows) > 1) + 1), nc)
        starts, n_states = [least], 0
    else:
        parts = cut_stretches(y, X, begin, end, orders)
        criterion = SimulationErrors(parts, orders, nc, nd)
        rows, n_states = criterion.rows, orders.na * len(parts)
        possible = sum(max(part.y.size - nd, 0) for part in parts)
        n_missing = possible - rows.size
        starts = find_starts(parts, y, X, begin, end, orders)[:N_FOLLOWED]
        if nc + nd:
            least = np.r_[stabilise(np.r_[1.0, least[: orders.na]])[1:], least[orders.na :]]
            starts = [least, *starts]
    if nc + nd:
        empty = np.zeros(nc + nd)
        starts = [
            np.r_[theta, find_noise_start(criterion.noise(np.r_[theta, empty]), nc, nd)]
            for theta in starts
        ]
    starts.sort(key=lambda theta: float(np.sum(criterion.errors(theta) ** 2)))
    tried = []
    for theta in starts[:N_FOLLOWED]:
        tried.append(
            least_squares(
                criterion.errors,
                theta,
                criterion.slopes,
                x_scale="jac",
                ftol=TOLERANCE,
                xtol=TOLERANCE,
                gtol=TOLERANCE,
                max_nfev=MOST_STEPS,
            )
        )
    best = min(tried, key=lambda one: one.cost)
    return PredictionErrorEstimate(
        best.x, best.fun, best.jac, rows, n_states, n_missing, best.status > 0
    )


def predict_steps(
    y: np.ndarray, drive: np.ndarray, c: np.ndarray, d: np.ndarray, horizon: int
) -> np.ndarray:
    """Predictions of D y = drive + C n some rows ahead, from rest; NaN in y are foreseen too."""
    white, filled = np.zeros(y.size), np.nan_to_num(y)
    if np.isnan(y).any():
        for t in range(y.size):
            one = drive[t]
            one -= sum(d[i] * filled[t - i] for i in range(1, min(d.size, t + 1)))
            one += sum(c[i] * white[t - i] for i in range(1, min(c.size, t + 1)))
            if np.isnan(y[t]):
                filled[t] = one
            else:
                white[t] = y[t] - one
    else:
        white = lfilter([1.0], c, lfilter(d, [1.0], y) - drive)
    answer = lfilter(c, d, np.r_[1.0, np.zeros(min(horizon, y.size) - 1)])
    return filled - lfilter(answer, [1.0], white)
