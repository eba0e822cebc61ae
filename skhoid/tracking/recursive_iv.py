"""RecursiveIV: a varying operator by recursive instrumental variables."""

from __future__ import annotations

from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np

from .. import _kernels
from .._sklearn import Interval
from ..arx.instruments import estimate, instrument_columns, instrument_lags
from ..exceptions import ShortRunError
from .whitened import Start, WhitenedFilter, WhitenedRecursion, Window, stabilised


class InstrumentsFilter(WhitenedFilter):
    """Sums of products with instruments, from those of a window."""

    def __init__(
        self,
        start: Start,
        window: Window,
        lags: np.ndarray,
        lam: np.ndarray,
        dt: float,
        n_runs: int,
    ) -> None:
        orders = window.orders
        super().__init__(start, orders, lam, dt)
        self.advance, self.before = _kernels.whitened.instruments, (lags,)
        self.forgetting = np.r_[lam[0], self.shares]
        n, n_external, nd = orders.n_params, window.external[0].shape[1], start.d.size
        nz = n_external * lags.size
        self.sums = slice(0, nz * nz + nz * n + nz)
        self.shared = np.concatenate([np.zeros(self.sums.stop + n * n), self.largest])
        length = 2 + nd + orders.na + 1
        for nb, nk in zip(orders.nb, orders.nk, strict=True):
            length += nk + nb + nd + max(nb + nd, orders.na + 1) + nb
        reach = int(lags[-1]) + 1
        length += n_external * (max(nd, orders.na) + 1 + reach)
        self.memory = np.zeros((n_runs, length))
        self.waits += max(reach - (self.waits[1] - nd), 0.0)
        self._add_up(window)

    def _add_up(self, window: Window) -> None:
        """Begin with the sums of a window, made worth the memory."""
        counts, memory, forgetting = self.counts.copy(), self.memory, self.forgetting
        self.memory, self.forgetting = memory[:1], np.r_[0.0, self.shares]
        for (X, y), external in zip(window.parts, window.external, strict=True):
            self.rest()
            self.take(np.hstack([X, external]), y)
        self.rest()
        self.memory, self.forgetting, self.counts = memory, forgetting, counts
        self.shared[self.sums] *= self.worth
        # Until the first update, what the window told.
        nz = next(k for k in range(1, self.sums.stop) if k * (k + self.n + 1) == self.sums.stop)
        ZZ, ZP = np.split(self.shared[: nz * (nz + self.n)], [nz * nz])
        ZZ, ZP = ZZ.reshape(nz, nz), ZP.reshape(nz, self.n)
        size = np.sqrt(np.where(np.diag(ZZ) > 0, np.diag(ZZ), 1.0))
        middle = np.linalg.pinv(ZZ / np.outer(size, size), rcond=1e-13, hermitian=True)
        G = ZP / size[:, None]
        self.information[:] = G.T @ middle @ G

    @property
    def information(self) -> np.ndarray:
        return self.shared[self.sums.stop :][: self.n**2].reshape(self.n, self.n)


class RecursiveIV(WhitenedRecursion):
    """ARX model whose parameters follow the data, by recursive instrumental variables.

    F(q) u = B(q) e(t - nk) + F(q) n, with remnant n of any colour. Signals from outside the loop,
    such as the target f_t, are correlated with e and u and not with n: their lags are instruments
    z. With phi = [-u(t-1) ... e(t-nk) ...], at each instant

    theta = (S_zp' S_zz^-1 S_zp)^-1 S_zp' S_zz^-1 S_zu,  S_zp = sum_k λ^(t-k) z(k) phi(k)'

    and so on, with all of them filtered by D/F: 1/F makes n of the error, and D, an autoregressive
    model that follows n, whitens it. It is ``ARXRegressor(method="iv")`` made recursive.

    Parameters
    ----------
    {orders, inputs}
    instruments : list of column names or positions, or None, default=None
        External signals; None means the columns of role f_t or dist or, without such, the inputs
        where none has the role e or x. Naming the inputs says that nothing feeds the output back.
    noise_order : int, default=8
        Order of D.
    {memory_time}
    init_window : float, default=30.72
        Seconds of data, from the first row that is not NaN, of which the first theta and D are
        those of instrumental variables in batch.
    {store_covariance, roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        theta(t) = [f_1 ... b_0 ...] after each instant. Absent after ``partial_fit``.
    noise_path_ : ndarray of shape (n_instants, noise_order)
        Coefficients of D.
    {time_path_}
    coef_, noise_ar_ : ndarray
        The last theta and coefficients of D.
    a_, b_ : ndarray, ndarray or list of them
        The parts of ``coef_``.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``: σ² (S_zp' S_zz^-1 S_zp)^-1 (1 + λ^n) / (1 + λ).
    {standard_errors_, last_parameters_, covariance_path_}
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        Filtered error of each row of the fitted grid by the estimates before it; NaN where there
        was no update.
    noise_variance_ : float
        σ², the mean of their squares.
    forgetting_, memory_horizon_ : float
        λ used, and 1 / (1 - λ) in samples.
    initial_coef_ : ndarray of shape (n_params,)
        theta of the first window.
    n_updates_, n_held_ : int
        Updates; and instants at which nothing was forgotten, as no information came.
    {parameter_names_, dt_, inputs_, n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveBoxJenkins : Unbiased without instruments, of less variance.
    ARXRegressor : ``method="iv"`` in batch.

    Notes
    -----
    Only what the external signals bring about in e counts, so the variance is larger than that of
    prediction errors, which also use what remnant brings about; but a wrong noise model costs
    variance alone, and no bias. Where the solution has a pole outside the unit circle the estimate
    stays. Lags of the instruments: the input delay, and geometric steps after it from 0.05 to
    1.6 s, as in ``ARXRegressor``; a run counts from 2 s after them.

    References
    ----------
    Soderstrom and Stoica, System Identification (1989), ch. 8. Young, Recursive Estimation and
    Time-Series Analysis (1984).

    Examples
    --------
    >>> from skhoid import RecursiveIV, make_tracking_runs, operator_parameters
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.1, channels=["e", "f_t"], random_state=1
    ... )
    >>> model = RecursiveIV(nk=29, memory_time=10.24).fit(X, y)
    >>> operator_parameters(model)[["K_e", "K_edot", "omega_nm"]].iloc[-1].round(2).tolist()
    [0.09, 0.04, 11.2]
    """

    _parameter_constraints: dict = {
        **WhitenedRecursion._parameter_constraints,
        "memory_time": [Interval(Real, 0, None, closed="neither"), None],
        "instruments": "no_validation",
    }
    method_name = "recursive instrumental variables"

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        instruments: Any = None,
        noise_order: int = 8,
        memory_time: float | None = None,
        init_window: float = 30.72,
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.instruments = instruments
        self.noise_order = noise_order
        self.memory_time = memory_time
        self.init_window = init_window
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    def _signal_columns(self, n_columns: int) -> list[int]:
        names = self._reading.names or list(range(n_columns))
        told = self.instruments, self._columns, self.roles, self._reading.run
        return [*self._columns, *instrument_columns(names, *told, "RecursiveIV")]

    def _start(self, window: Window) -> Start:
        lags = self._lags(window)
        first = int(lags[-1]) + window.skip
        if sum(max(y.size - first, 0) for _, y in window.parts) < 2 * self.orders_.n_params:
            raise ShortRunError(
                f"The instruments reach {int(lags[-1])} samples ({lags[-1] * self.dt_:.3g} s) "
                f"back, and no stretch of the first {self.init_window:g} s is much longer than "
                f"{first} rows. Use longer runs or a longer init_window, or RecursiveBoxJenkins."
            )
        edges = np.cumsum([0, *(y.size for _, y in window.parts)])
        begin, end = np.array(list(pairwise(edges))).T
        found = estimate(
            np.concatenate([y for _, y in window.parts]),
            np.concatenate([X for X, _ in window.parts]),
            np.concatenate(window.external),
            begin,
            end,
            self.orders_,
            self.dt_,
            ["external signals"],
            False,
        )
        return window.at(stabilised(found.theta, self.orders_.na))

    def _lags(self, window: Window) -> np.ndarray:
        orders = self.orders_
        n_external = window.external[0].shape[1]
        return instrument_lags(self.dt_, min(orders.nk), orders.n_params, n_external)

    def _filter(self, window: Window, lam: np.ndarray, n_runs: int) -> InstrumentsFilter:
        lags = self._lags(window)
        return InstrumentsFilter(self._start(window), window, lags, lam, self.dt_, n_runs)
