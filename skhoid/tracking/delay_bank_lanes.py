"""The recursions of a bank of delays in lanes, and how they compete, over runs or a stream.

Open it for what a bank keeps; :mod:`~skhoid.tracking.delay_bank` has the model.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import _kernels
from ..arx.forgetting import Forgetting
from ..arx.rls import RecursionData, RecursionState, kernel_regressors, recurse
from ..runs import whole_samples

if TYPE_CHECKING:
    from .delay_bank import DelayBankARX

VARIANCE_MEMORY = 20.48  # s
TEMPER = 3.0  # over the horizon in samples: the power of the likelihood
LANES = 16  # as many as the widest kernels of the recursion take


class BankPaths(NamedTuple):
    """What a bank records at each instant, axis 0 of the first three being the blocks of lanes.

    ``factors`` of P are empty unless wanted; ``fits`` are log-likelihoods of the candidates, up to
    a number for each instant.
    """

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
        forgetting: Forgetting,
        starts: list[tuple[np.ndarray, np.ndarray]],
    ) -> None:
        dt, each = model.dt_, model._each_orders
        self.forgetting, self.orders = forgetting, each[0]
        self.first_row = each[-1].first_row  # of the longest delay
        self.horizon = max(round(whole_samples(model.ahead, dt)), 1)
        self.leave = dt / model.stay_time if len(starts) > 1 else 0.0
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

    def state_of(self, lane: int) -> RecursionState:
        """State of the recursion of one candidate."""
        return self.block(lane // LANES).lane(lane % LANES)

    def block(self, number: int) -> RecursionState:
        """State of the recursions of a block of lanes."""
        state = copy(self.kind)
        state.buffer = self.buffers[number]
        return state

    def theta_of(self, lane: int) -> np.ndarray:
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


class BankRows:
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

    def take(self, X: np.ndarray, y: np.ndarray) -> None:
        """Take rows that follow those before."""
        bank, done = self.bank, 0
        advance = _kernels.delay_bank.stream(bank.orders.n_params, self.arrays[0].shape[1] > 1)
        while done < y.size:
            if self.at == len(self.since):
                self._move_back()
            end = min(self.at + y.size - done, len(self.since))
            m = end - self.at
            rows = slice(done, done + m)
            advance(
                X[rows], y[rows], bank.shifts, self.Z, self.target, self.theta, self.since,
                *bank.regressors, bank.orders.na, bank.first_row, self.at, *self.arrays,
                bank.forgetting.diagonal, bank.buffers, *bank.mixing, self.probabilities,
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
