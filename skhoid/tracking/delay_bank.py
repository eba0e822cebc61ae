"""DelayBankARX: a delay that varies, followed by a bank of recursive ARX models."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import replace
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from .. import _kernels
from .._sklearn import Interval, StrOptions, fit_context
from ..arx.base import BaseARX, check_lengths, check_row_count
from ..arx.forgetting import Forgetting, factor_of_time
from ..arx.orders import Orders, whole_number
from ..arx.recursive import (
    MOST_ROWS_BACK,
    OF_RUNS,
    RecursiveLeastSquares,
    check_streamable,
)
from ..arx.rls import (
    RecursionData,
    RecursionState,
    covariance_along,
    kernel_regressors,
    recurse,
)
from ..arx.streaming import Recursion
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from ..runs import whole_samples
from ..text import ModelSummary, number

VARIANCE_MEMORY = 20.48  # s
TEMPER = 3.0  # over the horizon in samples: the power of the likelihood
AHEAD = 0.2  # s that errors predict ahead; of 0 to 0.2 s the best in simulated loops
STAY_TIME = 5.0  # s for which the operator stays at a delay, on average
LANES = 16  # as many as the widest kernels of the recursion take


class BankPaths(NamedTuple):
    """What a bank records at each instant, axis 0 of the first three being the blocks of lanes."""

    theta: np.ndarray
    errors: np.ndarray
    factors: np.ndarray
    probabilities: np.ndarray
    fits: np.ndarray


class Bank:
    """Recursions of all candidates in blocks of lanes, and their probabilities."""

    def __init__(
        self,
        model: DelayBankARX,
        each: list[Orders],
        forgetting: Forgetting,
        starts: list[tuple[np.ndarray, np.ndarray]],
    ) -> None:
        dt = model.dt_
        self.forgetting, self.orders = forgetting, each[0]
        self.first_row = each[-1].first_row  # of the longest delay
        self.horizon = max(round(whole_samples(AHEAD, dt)), 1)
        self.leave = min(dt / STAY_TIME, 1.0) if len(starts) > 1 else 0.0
        self.power = min(1.0, TEMPER / self.horizon)
        self.memory = max(VARIANCE_MEMORY / dt, 2.0 * _kernels.delay_bank.SETTLED)
        self.n_delays = len(starts)
        n_blocks = -(-self.n_delays // LANES)
        lanes = np.minimum(np.arange(n_blocks * LANES), self.n_delays - 1).reshape(n_blocks, LANES)
        self.shifts = (model.candidates_ - model.candidates_[0])[lanes]
        theta0, P0 = (np.array(part) for part in zip(*starts, strict=True))
        self.kind = RecursionState(theta0[lanes[0]], P0[lanes[0]], LANES)
        offsets = _kernels.rls.layout(self.orders.n_params)
        self.where = slice(offsets["theta"], offsets["power"])
        self.buffers = np.stack(
            [RecursionState(theta0[block], P0[block], LANES).buffer for block in lanes]
        )
        self.weights = np.full(self.n_delays, 1.0 / self.n_delays)
        self.moments = np.zeros(3)
        self.regressors = kernel_regressors(self.orders)

    @property
    def mixing(self) -> tuple[Any, ...]:
        """How the kernels mix, and where they have come to."""
        options = self.horizon, self.n_delays, self.leave, self.power, self.memory
        return *options, self.weights, self.moments

    def read_state(self, lane: int) -> RecursionState:
        """State of the recursion of one candidate."""
        return self.block(lane // LANES).lane(lane % LANES)

    def block(self, number: int) -> RecursionState:
        """State of the recursions of a block of lanes."""
        state = copy(self.kind)
        state.buffer = self.buffers[number]
        return state

    def read_theta(self, lane: int) -> np.ndarray:
        """Parameters of one candidate."""
        block, place = divmod(lane, LANES)
        return self.buffers[block].reshape(-1, LANES)[self.where, place].copy()

    def run(self, data: RecursionData, with_factors: bool) -> BankPaths:
        """Run over recorded runs."""
        Z, target = self._signals(data)
        keep = ["theta", "errors", *(["factors"] if with_factors else [])]
        paths = [
            recurse(self.block(b), Z[b], target[b], self.orders, self.forgetting, keep=keep)
            for b in range(len(Z))
        ]
        theta = np.stack([path.theta for path in paths])
        since = rows_since_break(data)
        probabilities = np.empty((len(since), self.n_delays))
        fits = np.zeros_like(probabilities)
        _kernels.delay_bank.follow(
            Z, target, theta, since, *self.regressors, self.orders.na, max(self.first_row, 1),
            0, len(since), *self.mixing, probabilities, fits,
        )  # fmt: skip
        errors, factors = (
            np.stack([getattr(path, name) for path in paths]) for name in ("errors", "factors")
        )
        return BankPaths(theta, errors, factors, probabilities, fits)

    def _signals(self, data: RecursionData) -> tuple[np.ndarray, np.ndarray]:
        """Signals and targets of the lanes, with the inputs delayed."""
        n_blocks, (n_signals, n_instants, n_runs, _) = len(self.buffers), data.signals.shape
        Z = np.full((n_blocks, n_signals, n_instants, n_runs, LANES), np.nan)
        n_inputs = len(self.orders.nb)
        for (block, place), shift in np.ndenumerate(self.shifts):
            for signal in range(n_signals):
                by = min(int(shift) if 0 < signal <= n_inputs else 0, n_instants)
                Z[block, signal, by:, :, place] = data.signals[signal, : n_instants - by, :, 0]
        target = np.repeat(data.target[None], n_blocks, axis=0).repeat(LANES, axis=-1)
        columns, lags = self.regressors
        unknown = np.zeros(data.target.shape[:2], dtype=bool)
        for column, lag in zip(columns[self.orders.na :], lags[self.orders.na :], strict=True):
            missing = np.isnan(Z[:, column]).any(axis=(0, 3))
            unknown[lag:] |= missing[: n_instants - lag]
        target[:, unknown] = np.nan
        return Z, target


class BankRows(Recursion):
    """A bank that takes rows one after the other, with the rows that it needs to go on."""

    def __init__(
        self, bank: Bank, data: RecursionData | None = None, theta: np.ndarray | None = None
    ) -> None:
        """Begin anew, or after the end of a single run along whose path it has been."""
        self.bank = bank
        self.depth = bank.first_row + bank.horizon + 2
        n_blocks, rows = len(bank.buffers), self.depth + _kernels.rls.CHUNK
        orders = bank.orders
        n_signals = 1 + len(orders.nb) + orders.intercept
        ahead = rows + int(bank.shifts.max())
        self.Z = np.full((n_blocks, n_signals, ahead, 1, LANES), np.nan)
        if orders.intercept:
            self.Z[:, -1] = 1.0
        self.target = np.full((n_blocks, rows, 1, LANES), np.nan)
        self.theta = np.zeros((n_blocks, rows, orders.n_params, LANES))
        self.since = np.zeros((rows, 1), dtype=np.int64)
        self.probabilities = np.zeros((rows, bank.n_delays))
        self.at = self.depth
        self.arrays = bank.forgetting.arrays(LANES)
        if data is not None and theta is not None:
            self._go_on_after(data, theta)

    def _go_on_after(self, data: RecursionData, theta: np.ndarray) -> None:
        since = rows_since_break(data)[:, 0]
        kept = min(self.depth - 1, int(since[-1]))
        begin = self.depth - kept
        self.since[begin - 1, 0] = since[-1] - kept
        if kept:
            self.theta[:, begin : self.depth] = theta[:, -kept:]
            X, y = _kernels.gate(data.inputs[-kept:]), _kernels.gate(data.output[-kept:])
            _kernels.delay_bank.fill(
                X, y, self.bank.shifts, self.Z, self.target, self.since, self.bank.first_row,
                begin, *self.bank.regressors, self.bank.orders.na,
            )  # fmt: skip

    def rest(self) -> None:
        """Forget the rows before; keep estimates and probabilities."""
        self.since[self.at - 1] = 0

    def take(self, X: np.ndarray, y: np.ndarray, time: np.ndarray | None = None) -> None:
        """Take rows that follow those before."""
        bank, done = self.bank, 0
        advance = _kernels.rls.recursion(LANES)
        empty, unused = np.empty((0, 0, 0)), np.empty((0, 0))
        while done < y.size:
            if self.at == len(self.since):
                self._move_back()
            end = min(self.at + y.size - done, len(self.since))
            m = end - self.at
            rows = slice(done, done + m)
            _kernels.delay_bank.fill(
                X[rows], y[rows], bank.shifts, self.Z, self.target, self.since, bank.first_row,
                self.at, *bank.regressors, bank.orders.na,
            )  # fmt: skip
            for block in range(len(self.Z)):
                advance(
                    self.Z[block], self.target[block], *bank.regressors, self.at, end,
                    *self.arrays, self.at, bank.forgetting.diagonal, 0.0, bank.buffers[block],
                    self.theta[block], empty, empty, empty, empty, unused,
                )  # fmt: skip
            _kernels.delay_bank.follow(
                self.Z, self.target, self.theta, self.since, *bank.regressors, bank.orders.na,
                max(bank.first_row, 1), self.at, end, *bank.mixing, self.probabilities, unused,
            )  # fmt: skip
            self.at = end
            done += m

    def _move_back(self) -> None:
        """Make room: the last rows to the beginning."""
        by = self.at - self.depth
        for rows, axis in ((self.Z, 2), (self.theta, 1), (self.target, 1), (self.since, 0)):
            moved = np.moveaxis(rows, axis, 0)
            moved[: len(moved) - by] = moved[by:].copy()
        self.at = self.depth


def rows_since_break(data: RecursionData) -> np.ndarray:
    """How many rows of each stretch there are up to each instant, of shape (n_instants, n_runs)."""
    grid, instants = data.grid, data.instants
    since = np.zeros((len(instants), instants.n_runs), dtype=np.int64)
    for begin, end, measured in zip(grid.begin, grid.end, grid.measured, strict=True):
        if measured:
            rows = slice(begin, end)
            since[instants.of_row[rows], instants.run[rows]] = np.arange(1, end - begin + 1)
    return since


SHORTEST, LONGEST, N_DELAYS = 0.1, 0.5, 21  # s, of the candidates by default
PATHS = ("nk_path_", "delay_path_", "delay_sd_path_", "probabilities_")


class DelayBankARX(RecursiveLeastSquares):
    """ARX model whose delay varies too, by a bank of recursive ARX models of different delays.

    Each candidate n_k has its own recursion, exactly that of :class:`RecursiveARX`. They compete by
    their prediction errors, as models between which the operator changes (Plaetinck):

    w_j(t) ∝ exp(-γ ε_j(t)² / 2σ²) Σ_i π_ij w_i(t-1),  delay(t) = Σ_j w_j(t) n_k,j dt

    Parameters
    ----------
    nk : int, sequence of int or None, default=None
        Candidates of the input delay in samples, the same for all inputs, with the sample of
        zero-order hold. None means 21 from 0.1 to 0.5 s, plus that sample.
    na, nb : int, or one per input for nb, default=2, 2
        Orders, as for :class:`ARXRegressor`.
    {inputs}
    fit_intercept : bool, default=False
        Add a constant to the regressors.
    path : {"filtered", "viterbi"}, default="filtered"
        Delay at each instant from the data up to it, or the most probable path from all data
        (Viterbi). The latter is not for streaming.
    {memory_time, init_window, store_covariance, roles, dt, run}

    Attributes
    ----------
    candidates_ : ndarray of int of shape (n_delays,)
        Delays n_k in samples, in ascending order.
    delay_path_ : ndarray of shape (n_instants,)
        Delay in seconds with the sample of zero-order hold: the mean over the candidates, or
        ``nk_path_`` times ``dt_`` with ``path="viterbi"``. Paths are absent after ``partial_fit``.
    delay_sd_path_ : ndarray of shape (n_instants,)
        Standard deviation of the filtered probabilities about ``delay_path_``, in seconds.
    nk_path_ : ndarray of int of shape (n_instants,)
        The most probable delay in samples; predictions use it.
    probabilities_ : ndarray of shape (n_instants, n_delays)
        w, from the data up to each instant.
    last_probabilities_ : ndarray of shape (n_delays,)
        The last w.
    delay_, delay_sd_ : float
        The last delay in seconds and its standard deviation.
    nk_ : int
        The last of ``nk_path_``, to which ``coef_`` belongs.
    coef_path_ : ndarray of shape (n_instants, n_params)
        θ(t) of the recursion with the delay ``nk_path_``.
    {time_path_}
    coef_ : ndarray of shape (n_params,)
        The last θ.
    covariance_, standard_errors_, covariance_path_ : ndarray
        Of the recursion with that delay, as for :class:`RecursiveARX`: given the delay.
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        ε one step ahead of that recursion.
    noise_variance_, n_updates_, n_held_ : float, int, int
        Of the recursion with the delay ``nk_``.
    initial_coef_, initial_covariance_ : ndarray
        θ0 and P0 of the first of ``nk_path_``; after ``partial_fit`` of ``nk_``.
    parameter_names_ : list of str
        Names of the entries of ``coef_``.

    See Also
    --------
    RecursiveARX : The recursion, for a delay that is known.
    DelaySearchCV : Finds one delay for all time.

    Notes
    -----
    All candidates take the same rows: those whose regressors are known with every delay. Several
    runs are pooled as in :class:`RecursiveARX`. With one candidate this is that model, bit for bit.
    Only probabilities are mixed, not θ and P, which mean different things with different delays
    (unlike the interacting multiple models of Blom and Bar-Shalom 1988).

    ε_j is the error of a simulation that begins 0.2 s before, with the θ of then. σ² is the mean of
    Σ w_j ε_j² over the last 20 s, and γ = min(1, 3 / k) for k samples ahead, since errors k ahead
    overlap. The operator stays at a candidate for 5 s on average before it changes to one of the
    two beside it: π_jj = 1 - dt / 5 s.

    Measured on single runs in the loop (C2, 21 candidates two samples apart) whose delay changes by
    ±0.12 s, the root mean square error of the delay is 0.01-0.02 s without remnant, 0.03 s at P_n =
    0.15 with remnant of order 2, and 0.05 s with remnant of order 1. Most of the latter is bias,
    here towards *long* delays, that more data do not remove: the noise model 1 / A(q) of ARX does
    not fit such remnant. ``delay_sd_path_`` does not contain this bias, nor the lag behind changes.

    References
    ----------
    Plaetinck, thesis, TU Delft. Blom and Bar-Shalom, IEEE Trans. Autom. Control 33 (1988) 780-783.
    Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260-269.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.effects import TimeVaryingDelay
    >>> from skhoid.tracking.delay_bank import DelayBankARX
    >>> slower = TimeVaryingDelay(change=0.1, rate=2.0, time=40.0)
    >>> X, y = make_tracking_runs("C1", n_runs=1, effects=[slower], random_state=0)
    >>> model = DelayBankARX(memory_time=2.56).fit(X, y)
    >>> model.delay_path_[[3000, 8000]].round(2)
    array([0.29, 0.39])
    """

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "nk": "no_validation",
        "memory_time": [Interval(Real, 0, None, closed="neither"), None],
        "init_window": [Interval(Real, 0, None, closed="neither")],
        "store_covariance": ["boolean"],
        "path": [StrOptions({"filtered", "viterbi"})],
    }

    init, p0 = "ols", None
    _last_share = np.ones(1)

    def __init__(
        self,
        nk: Any = None,
        *,
        na: int = 2,
        nb: Any = 2,
        inputs: Any = None,
        fit_intercept: bool = False,
        path: str = "filtered",
        memory_time: float | None = None,
        init_window: float = 30.72,
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.nk = nk
        self.na = na
        self.nb = nb
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.path = path
        self.memory_time = memory_time
        self.init_window = init_window
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> DelayBankARX:
        """Run the bank over recorded runs.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : DelayBankARX

        Raises
        ------
        {run_errors}

        Warns
        -----
        PoorExcitationWarning
            If OLS on the first window has no unique solution.
        MissingDataWarning
            With the number of rows that are NaN.
        """
        data = self._read_recursion(X, y)
        forgetting = self._read_forgetting(data.instants.time)
        self._check_shared_times(data.instants, data.grid)
        check_row_count(int((~np.isnan(data.target)).sum()), 1, data.grid)
        self._end_stream(*OF_RUNS, *PATHS)
        starts = [self._start(replace(data, orders=orders), None) for orders in self._each_orders]
        bank = Bank(self, self._each_orders, forgetting, starts)
        self._set_forgetting(forgetting, None)
        self._follow(data, bank, starts)
        self._report_missing(data.grid, data.inputs, data.output, self.n_updates_, self.inputs_)
        return self

    def _read_recursion(self, X: Any, y: Any) -> RecursionData:
        grid, inputs, output, *_ = self._read_data(X, y)
        self._read_candidates()
        self._set_orders(grid)
        return RecursionData.of(grid, inputs, output, self.orders_)

    def _set_orders(self, grid: ModelGrid) -> None:
        check_lengths(grid, self.orders_)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)

    def _read_candidates(self) -> None:
        """Set the candidates, and the orders with each of them."""
        given = _candidates(self.nk, self.dt_)
        n_inputs, intercept = len(self._columns), bool(self.fit_intercept)
        self._each_orders = [
            Orders.of(self.na, self.nb, nk, n_inputs, intercept) for nk in given.tolist()
        ]
        self.candidates_ = given
        self.orders_ = self._each_orders[-1]

    def _read_forgetting(self, time: np.ndarray) -> Forgetting:
        return Forgetting(np.array([[factor_of_time(self.memory_time, self.dt_)]]))

    def _follow(
        self,
        data: RecursionData,
        bank: Bank,
        starts: list[tuple[np.ndarray, np.ndarray]],
    ) -> None:
        """Run the bank, and set paths and what else describes the runs."""
        paths = bank.run(data, self.store_covariance)
        if self.path == "viterbi":
            lane = _kernels.delay_bank.most_probable(paths.fits, bank.leave)
        else:
            lane = np.argmax(paths.probabilities, axis=1)
        at = np.arange(lane.size)
        block, place = np.divmod(lane, LANES)
        self.probabilities_ = paths.probabilities
        self.last_probabilities_ = bank.weights.copy()
        self.nk_path_ = self.candidates_[lane]
        delays = self.candidates_ * self.dt_
        mean = self.probabilities_ @ delays
        self.delay_path_ = self.nk_path_ * self.dt_ if self.path == "viterbi" else mean
        spread = (delays - self.delay_path_[:, None]) ** 2
        self.delay_sd_path_ = np.sqrt(np.einsum("tj,tj->t", self.probabilities_, spread))
        self.coef_path_ = paths.theta[block, at, :, place]
        self._keep_runs(data, paths.errors[block, at, :, place])
        self._starts = starts
        self.initial_coef_, self.initial_covariance_ = starts[int(lane[0])]
        self._set_last(bank, int(lane[-1]))
        if self.store_covariance:
            chosen = paths.factors[block, at, :, place]
            updated = ~np.isnan(paths.errors[0, :, :, 0]).all(axis=1)
            covariance = covariance_along(
                chosen, len(self.parameter_names_), bank.forgetting.factors, np.cumsum(updated)
            )
            each = np.arange(self.candidates_.size).tolist()
            variance = np.array([bank.read_state(one).noise_variance for one in each])
            self.covariance_path_ = covariance * variance[lane][:, None, None]
        if data.grid.rows is None and self.path == "filtered":
            alone = data.instants.n_runs == 1
            rows = BankRows(bank, data, paths.theta) if alone else BankRows(bank)
            self._leave_for_streams(rows, data.grid.layout)

    def _set_last(self, bank: Bank, lane: int) -> None:
        """Set what holds at the end, with the delay of one lane."""
        self.nk_ = int(self.candidates_[lane])
        self.orders_ = self._each_orders[lane]
        self._bank, self._lane = bank, lane
        self.coef_ = bank.read_theta(lane)

    @property
    def _states(self) -> list[RecursionState]:  # type: ignore[override]
        return [self._bank.read_state(self._lane)]

    @property
    def delay_(self) -> float:
        self._check_fitted()
        if "nk_path_" in vars(self) and as_fitted(self).path == "viterbi":
            return float(self.nk_ * self.dt_)
        return float(self.last_probabilities_ @ self.candidates_ * self.dt_)

    @property
    def delay_sd_(self) -> float:
        spread = (self.candidates_ * self.dt_ - self.delay_) ** 2
        return float(np.sqrt(self.last_probabilities_ @ spread))

    def summary_table(self) -> ModelSummary:
        found = super().summary_table()
        facts = {**found.facts, "Method": "bank of recursive least squares over delays"}
        first, last = self.candidates_[0], self.candidates_[-1]
        facts["Candidates"] = f"{self.candidates_.size} delays, nk = {first} to {last}"
        facts["Delay at the end"] = f"{number(self.delay_)} s, sd {number(self.delay_sd_)} s"
        notes = [*found.notes, "The sd of the delay does not contain its bias by coloured remnant."]
        return replace(found, facts=facts, notes=notes)

    def _following(self, grid: ModelGrid, values: np.ndarray) -> DelayBankARX:
        """The same model with one delay, and taps for all candidates."""
        if not self._follows_path or self.candidates_.size == 1:
            return self
        orders, wide = self.orders_, copy(self)
        least, most = int(self.candidates_[0]), int(self.candidates_[-1])
        taps = tuple(nb + most - least for nb in orders.nb)
        wide.orders_ = Orders(orders.na, taps, (least,) * len(taps), orders.intercept)
        wide.coef_path_ = _spread_out(self.coef_path_, self.nk_path_ - least, orders, wide.orders_)
        first = self.nk_path_[:1] - least
        wide.initial_coef_ = _spread_out(self.initial_coef_[None], first, orders, wide.orders_)[0]
        return wide

    def _check_streaming(self) -> None:
        if self.path == "viterbi":
            raise ValueError(
                "partial_fit cannot find the most probable path, which needs whole runs: give "
                "path='filtered', or call fit."
            )

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> BankRows:
        self._read_candidates()
        check_streamable(self.orders_)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        tables = [self._first_table(X, y, fresh, orders) for orders in self._each_orders]
        starts = [self._start_from(table, y.size) for table in tables]
        self._starts = starts
        return BankRows(Bank(self, self._each_orders, self._read_forgetting(np.zeros(1)), starts))

    def _refresh_estimates(self, recursion: Any) -> None:
        self._refresh(recursion)

    def _refresh(self, recursion: Any) -> None:
        bank = recursion.bank
        if "coef_path_" in vars(self) or "_forgetting" not in vars(self):
            for name in (*OF_RUNS, *PATHS):
                self.__dict__.pop(name, None)
            self._set_forgetting(bank.forgetting, None)
        lane = int(bank.weights.argmax())
        self.initial_coef_, self.initial_covariance_ = self._starts[lane]
        self.last_probabilities_ = bank.weights.copy()
        self._set_last(bank, lane)


def _candidates(nk: Any, dt: float) -> np.ndarray:
    """Delays in samples, in ascending order."""
    if nk is None:
        seconds = np.linspace(SHORTEST, LONGEST, N_DELAYS)
        return np.unique(np.rint(seconds / dt).astype(np.int64) + 1)
    given = list(nk) if isinstance(nk, Iterable) and not isinstance(nk, str) else [nk]
    if not given:
        raise ValueError("nk is empty; give the delays to choose from, such as range(15, 56, 2).")
    delays = [whole_number("Each delay in nk", delay, 0) for delay in given]
    if max(delays) > MOST_ROWS_BACK:
        raise ValueError(f"Delays in nk are at most {MOST_ROWS_BACK} samples; got {max(delays)}.")
    if len(set(delays)) < len(delays):
        raise ValueError(f"nk has a delay twice: {delays}. Give each candidate once.")
    return np.array(sorted(delays), dtype=np.int64)


def _spread_out(theta: np.ndarray, by: np.ndarray, orders: Orders, wide: Orders) -> np.ndarray:
    """Parameters in the places that delays longer ``by`` some samples have among more lags."""
    na = orders.na
    out = np.zeros((len(theta), wide.n_params))
    out[:, :na] = theta[:, :na]
    rows, at, into = np.arange(len(theta)), na, na
    for nb, taps in zip(orders.nb, wide.nb, strict=True):
        for k in range(nb):
            out[rows, into + by + k] = theta[:, at + k]
        at, into = at + nb, into + taps
    if orders.intercept:
        out[:, -1] = theta[:, -1]
    return out
