"""Instrumental variables: ARX models without the bias of output noise, and of remnant in a loop.

A(q) u = sum B_i(q) e_i + w, where w is coloured (w = A n for a noise n added to u) and, through a
loop, correlated with u and e. External signals (f_t, f_d) are not: their lags are instruments. In
an open loop the inputs are such signals, and the best instruments are the regressors of the output
that they alone bring about: the simulated one (IV4; Ljung 1999, section 15.3).

Plain two-stage least squares is consistent, but scatters up to three times more than need be. So
the equation and the instruments are filtered by D / A of the previous round until the parameters
settle: 1 / A turns the equation error into the remnant n, and D, an autoregressive model of n,
whitens it (refined instrumental variables; Young 1984, Soderstrom and Stoica 1989, ch. 8).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from ..exceptions import RankDeficiencyError, ShortRunError
from ..preprocessing.grid import HeldInputs
from ..runs import input_columns
from ..runs.roles import is_external, role_of
from .base import free_run_output
from .least_squares import robust_covariance
from .orders import Orders, regressors
from .prediction_errors import cut_stretches, find_starts, stabilise

FIRST_LAG, LAST_LAG = 0.05, 1.6  # s after the input delay; geometric steps between them
N_LAGS = 6  # besides the input delay itself
SETTLE = 2.0  # s of start-up left out of the remnant model; bandwidth of the covariance
NOISE_ORDER = 10
MAX_ROUNDS, TOLERANCE = 20, 1e-6
WEAK = 1e-6  # relative size of directions of the instruments that carry no excitation


@dataclass(frozen=True)
class InstrumentalEstimate:
    """Parameters, their covariance, and how it went."""

    theta: np.ndarray
    covariance: np.ndarray
    noise_variance: float
    n_rows: int
    n_missing: int
    n_rounds: int
    converged: bool


@dataclass(frozen=True)
class _Stretch:
    """Regressors, output and instruments of rows without gaps."""

    rows: np.ndarray
    Phi: np.ndarray
    y: np.ndarray
    Z: np.ndarray

    def filtered(
        self, numerator: np.ndarray, denominator: np.ndarray, begun: bool = False
    ) -> _Stretch:
        """Behind a filter from rest, or as it is ``begun`` best.

        From rest each row is a sum of rows of the same equation, but noise before the first row
        leaves a free response of the filter, which can be large: it is projected out.
        """
        columns = np.column_stack([self.Phi, self.y, self.Z])
        columns = lfilter(numerator, denominator, columns, axis=0)
        if begun and denominator.size > 1:
            free = lfilter(
                numerator, denominator, np.eye(self.y.size, denominator.size - 1), axis=0
            )
            basis = np.linalg.qr(free)[0]
            columns -= basis @ (basis.T @ columns)
        p = self.Phi.shape[1]
        return _Stretch(self.rows, columns[:, :p], columns[:, p], columns[:, p + 1 :])

    def simulated(self, output: np.ndarray, na: int) -> _Stretch:
        """With the regressors of a simulated output as further instruments."""
        past = -output[np.subtract.outer(self.rows, np.arange(1, na + 1))]
        return replace(self, Z=np.hstack([past, self.Phi[:, na:], self.Z]))


def estimate(
    y: np.ndarray,
    X: np.ndarray,
    R: np.ndarray,
    begin: np.ndarray,
    end: np.ndarray,
    orders: Orders,
    dt: float,
    names: list[str],
    coloured: bool,
    open_loop: bool = False,
) -> InstrumentalEstimate:
    """Estimate theta from output ``y``, inputs ``X`` and external signals ``R`` on model rows.

    ``coloured`` asks for a covariance that allows for a coloured filtered error; in an
    ``open_loop`` the inputs are instruments too, and so is the output that they bring about.
    """
    n_signals = R.shape[1] or X.shape[1]
    lags = instrument_lags(dt, min(orders.nk), orders.n_params - orders.intercept, n_signals)
    lags = lags if R.shape[1] else lags[:1]
    parts, n_missing = _stretches(y, X, R, begin, end, orders, lags)
    if not parts:
        raise ShortRunError(
            f"The instruments reach {int(lags[-1])} samples ({lags[-1] * dt:.3g} s) back, but no "
            "run is longer. Use longer runs, or method='ols'."
        )
    held = HeldInputs(X, range(X.shape[1]), list(zip(begin, end, strict=True)))
    everywhere = np.zeros(len(X), dtype=np.int64)

    def with_simulated(theta: np.ndarray, a: np.ndarray) -> list[_Stretch]:
        if not open_loop:
            return parts
        stable = np.r_[a[1:], theta[orders.na :]]
        output = free_run_output(held, (begin, end, begin), orders, stable[None], everywhere)
        return [part.simulated(output, orders.na) for part in parts]

    raw_Phi, raw_output, Z = _stack(parts)
    settle = round(SETTLE / dt)
    if open_loop:
        theta = find_starts(cut_stretches(y, X, begin, end, orders), y, X, begin, end, orders)[0]
    else:
        theta, Q = _two_stage(raw_Phi, raw_output, Z, orders, names)
    converged, rounds = False, 0
    # Coefficients by what they make of the output, whatever the units.
    weight = _find_scale(raw_Phi) / _find_scale(raw_output)
    while not converged and rounds < MAX_ROUNDS:
        a = stabilise(np.r_[1.0, theta[: orders.na]])
        whitening = _remnant_model(parts, theta, a, settle, open_loop)
        told = with_simulated(theta, a)
        Phi, output, Z = _stack([part.filtered(whitening, a, open_loop) for part in told])
        previous = theta
        theta, Q = _two_stage(Phi, output, Z, orders, names)
        rounds += 1
        step, size = (np.max(np.abs(v) * weight) for v in (theta - previous, theta))
        converged = bool(step <= TOLERANCE * max(1.0, size))
    error = raw_output - raw_Phi @ theta
    filtered_error = output - Phi @ theta
    projected = Q @ (Q.T @ Phi)
    scale = _find_scale(projected)
    scaled = projected / scale
    bread = np.linalg.inv(scaled.T @ scaled) / np.outer(scale, scale)
    if coloured:
        begin_of_part = np.cumsum([0, *(part.y.size for part in parts[:-1])])
        weights = projected @ bread
        leverage = np.einsum("tp,tp->t", weights, projected)
        rows = np.arange(error.size)
        covariance = robust_covariance(weights, leverage, filtered_error, rows, begin_of_part)
    else:
        covariance = bread * (filtered_error @ filtered_error) / max(error.size - theta.size, 1)
    return InstrumentalEstimate(
        theta,
        covariance,
        float(error @ error) / max(error.size - theta.size, 1),
        error.size,
        n_missing,
        rounds,
        converged,
    )


def instrument_lags(dt: float, nk: int, n_params: int, n_signals: int) -> np.ndarray:
    """Lags in samples: the input delay, and geometric steps after it from 0.05 s to 1.6 s.

    At least 1.5 instruments per parameter; at 100 Hz and nk = 29: 29, 34, 39, 49, 69, 109, 189.
    """
    count = max(N_LAGS, int(np.ceil(1.5 * n_params / n_signals)) - 1)
    steps = np.geomspace(max(FIRST_LAG / dt, 1.0), max(LAST_LAG / dt, count), count)
    offsets = set(np.rint(steps).astype(int).tolist()) | {0}
    extra = iter(range(1, count + 1))
    while len(offsets) <= count:  # at a coarse dt, steps round together
        offsets.add(next(extra))
    return nk + np.array(sorted(offsets))


def _stretches(
    y: np.ndarray,
    X: np.ndarray,
    R: np.ndarray,
    begin: np.ndarray,
    end: np.ndarray,
    orders: Orders,
    lags: np.ndarray,
) -> tuple[list[_Stretch], int]:
    """Stack rows with known lags; filters start anew after rows that are left out."""
    first = max(orders.first_row, int(lags[-1]))
    possible = int(np.maximum(end - begin - first, 0).sum())
    parts = []
    for a, b in zip(begin, end, strict=True):
        table, rows, _ = regressors(y, X, np.array([a]), np.array([b]), orders)
        early = rows < a + first
        table, rows = table[~early], rows[~early]
        Z = np.hstack([R[rows - lag] for lag in lags])
        if orders.intercept:
            Z = np.column_stack([Z, np.ones(len(Z))])
        complete = ~np.isnan(Z).any(axis=1)
        table, rows, Z = table[complete], rows[complete], Z[complete]
        for piece in np.split(np.arange(rows.size), np.flatnonzero(np.diff(rows) > 1) + 1):
            if piece.size:
                parts.append(_Stretch(rows[piece], table[piece, :-1], table[piece, -1], Z[piece]))
    return parts, possible - sum(part.y.size for part in parts)


def _stack(parts: list[_Stretch]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.concatenate([p.Phi for p in parts]),
        np.concatenate([p.y for p in parts]),
        np.concatenate([p.Z for p in parts]),
    )


def _basis(Z: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the excited directions of the instruments."""
    U, sizes, _ = np.linalg.svd(Z / _find_scale(Z), full_matrices=False)
    return U[:, sizes > WEAK * sizes[0]]


def _find_scale(columns: np.ndarray) -> np.ndarray:
    """Root mean square of each column, or 1."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    return np.where(scale > 0, scale, 1.0)


def _two_stage(
    Phi: np.ndarray, y: np.ndarray, Z: np.ndarray, orders: Orders, names: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Two-stage least squares: theta, and a basis of the excited instruments."""
    Q = _basis(Z)
    scale = _find_scale(Phi)
    theta, _, rank, _ = np.linalg.lstsq(Q.T @ (Phi / scale), Q.T @ y, rcond=None)
    theta /= scale
    if rank < orders.n_params:
        raise RankDeficiencyError(
            f"The instruments {names} excite {min(rank, Q.shape[1])} directions, but there are "
            f"{orders.n_params} parameters. n sine waves give at most 2 n directions: use a "
            "richer forcing function, add an instrument, or use smaller na and nb. Is an "
            "instrument zero or constant?"
        )
    return theta, Q


def _remnant_model(
    parts: list[_Stretch], theta: np.ndarray, a: np.ndarray, settle: int, begun: bool
) -> np.ndarray:
    """D: the autoregressive polynomial, by least squares, of the remnant n = (A u - B e) / A."""
    past, now = [], []
    for part in parts:
        behind = part.filtered(np.ones(1), a, begun)
        n = (behind.y - behind.Phi @ theta)[0 if begun else min(settle, part.y.size // 4) :]
        if n.size > NOISE_ORDER:
            windows = np.lib.stride_tricks.sliding_window_view(n, NOISE_ORDER + 1)
            past.append(windows[:, -2::-1])
            now.append(windows[:, -1])
    if not past:
        return np.ones(1)
    weights = np.linalg.lstsq(np.concatenate(past), np.concatenate(now), rcond=1e-10)[0]
    return np.r_[1.0, -weights]


def instrument_columns(
    names: list[Any], given: Any, inputs: list[int], roles: Any, run: Any, what: str
) -> list[int]:
    """Columns of the external signals, as given or by their roles; ``what`` needs them.

    Where there are none the inputs are taken, unless one is part of a loop by its role.
    """
    if given is not None:
        positions = input_columns(names, len(names), given, run, what="instruments")
    else:
        positions = [i for i, n in enumerate(names) if is_external(role_of(n, roles))]
    if positions:
        return positions
    fed_back = [names[i] for i in inputs if role_of(names[i], roles) in ("e", "x")]
    if given is None and not fed_back:
        return inputs
    raise ValueError(
        f"{what} needs external signals in X, such as the target f_t or a disturbance. "
        f"Name them with instruments=[...]; the columns are {names}."
        + (f" If {fed_back[0]!r} is not fed back, it is one itself." if fed_back else "")
    )
