"""``partial_fit`` of recursive ARX models, for rows that arrive one by one."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import replace
from operator import attrgetter, is_
from typing import Any, Self

import numpy as np
from sklearn.exceptions import NotFittedError

from .. import _kernels
from .._sklearn import fit_context
from ..exceptions import ShortRunError
from ..regression import columns_of
from .base import BaseARX
from .forgetting import Forgetting
from .orders import Orders
from .rls import RecursionState, window_rows
from .start import needs_data, start_of
from .streaming import Clock, Piece, Stream, first_rows

MOST_ROWS_BACK, MOST_PARAMETERS = 1_000_000, 1_000  # for which a stream keeps rows and squares

OF_RUNS = (  # attributes that describe recorded runs
    "coef_path_",
    "time_path_",
    "covariance_path_",
    "coef_paths_",
    "one_step_errors_",
    "log_likelihood_",
    "n_rows_missing_",
    "run_labels_",
)
READ_ANEW = attrgetter(  # parameters that partial_fit looks at in each call
    "na",
    "nb",
    "nk",
    "fit_intercept",
    "forgetting",
    "memory_horizon",
    "memory_time",
    "forgetting_form",
    "reset_times",
)


def check_streamable(orders: Orders) -> None:
    """Refuse more lags than a stream can keep."""
    if orders.first_row > MOST_ROWS_BACK or orders.n_params > MOST_PARAMETERS:
        raise ValueError(
            f"{orders.n_params} parameters with lags that reach {orders.first_row} samples "
            f"back are too many to stream; the limits are {MOST_PARAMETERS} parameters and "
            f"{MOST_ROWS_BACK} samples. Use fewer lags na and nb, or a smaller delay nk (in "
            "samples)."
        )


class PartialFit(BaseARX):
    """``partial_fit`` of a recursive model."""

    fit_intercept: bool
    forgetting: Any
    init: Any
    init_window: float
    p0: Any
    smooth: bool
    combine: str
    _read_forgetting: Any
    _reset_times: Any
    _set_forgetting: Any

    def partial_fit(self, X: Any, y: Any, *, new_run: bool = False) -> Self:
        """Update the estimates with rows that follow those seen before, one or many.

        The estimates do not depend on how the stream is cut: with the same θ0 and P0 they equal
        those of ``fit``, bit for bit. With ``init="ols"`` or ``p0=None`` rows are collected until
        ``init_window`` is full; until then there is no estimate. Give ``init`` and ``p0`` to have
        one from the first row with known lags. After ``fit`` the stream continues from its end.

        Parameters set since the last call take effect as follows: forgetting and reset times from
        this call on; changed orders raise an error; all others when a new stream begins.

        A new run, or a gap, clears the lags; θ and P are kept. Runs are taken one after the other,
        so several runs give a different result from ``fit``, which aligns them. No path is kept:
        ``coef_`` and what derives from it are current, and predictions use it.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels. Runs and gaps are read from the index, or from the run column. A float64 array
            is fastest (about 4 µs per call); give the delay as ``nk``, since pipelines have no
            ``partial_fit``.
        y : Series or array of shape (n_rows,)
            Output. NaN means no measurement.
        new_run : bool, default=False
            Whether a new run begins with the first row.

        Returns
        -------
        self : RecursiveARX

        Raises
        ------
        ValueError
            If X is decimated, if orders were changed, or the options need whole runs:
            ``combine="average_estimates"``, an array over time, ``forgetting="auto"`` that was set
            since, and before ``fit`` also ``smooth`` and ``forgetting="auto"``.
        RunIndexError
            If time goes backwards within a run.
        """
        stream = vars(self).get("_stream")
        if not (
            stream is not None
            and stream.plain
            and all(map(is_, stream.asked, READ_ANEW(self)))
            and self._run is None
            and not self._indexed
            and self._names is None
            and not new_run
            and type(X) is np.ndarray
            and type(y) is np.ndarray
            and X.dtype == np.float64
            and y.dtype == np.float64
            and X.ndim == 2
            and X.shape[1] == self.n_features_in_
            and X.shape[0] == y.size > 0
            and y.ndim == 1
            and stream.take(
                X if X.flags.carray else _kernels.gate(X), y if y.flags.carray else _kernels.gate(y)
            )
        ):
            return self._partial_fit(X, y, new_run)
        self.coef_ = stream.state.theta
        if "coef_path_" in vars(self) or stream.forgetting.nominal:
            self._refresh(stream)
        return self

    @fit_context(prefer_skip_nested_validation=True)
    def _partial_fit(self, X: Any, y: Any, new_run: bool) -> Self:
        """Take what :meth:`partial_fit` does not take by its fast path."""
        stream, pending = vars(self).get("_stream"), vars(self).get("_pending")
        self._check_streaming("coef_" in vars(self))
        if "coef_" not in vars(self) and pending is None:
            grid, _, output, values, *_ = self._read_data(X, y, "nothing")
        else:
            grid, values = self._read_X(X, reset=False)
            output = self._read_y(X, y)
        if grid.layout.mark is not None:
            raise ValueError(
                "partial_fit cannot take decimated rows: the Decimator's filter needs the samples "
                "after them. Stream at the rate of the model."
            )
        self._read_orders(begun=stream is not None or pending is not None)
        # Nothing is kept of rows that are refused.
        clock = copy(vars(self).get("_clock", Clock()))
        inputs, output = columns_of(values, self._columns), _kernels.gate(output)
        pieces = list(clock.pieces(grid.layout, inputs, output, new_run))
        if stream is None:
            collected = list(pending or [])
            stream = self._started_stream([*collected, *pieces])
            if stream is None:  # the caller may write other rows into the same table
                collected += [replace(p, X=p.X.copy(), y=p.y.copy()) for p in pieces]
                self._pending, self._clock = collected, clock
                return self
            pieces = [*collected, *pieces]
        else:
            stream = deepcopy(stream)
            before, stream.asked = stream.asked, READ_ANEW(self)
            if not all(map(np.array_equal, before, stream.asked)):
                stream.go_on_with(self._stream_forgetting(), self._reset_times())
                stream.state.set_factor(stream.forgetting)
        for piece in pieces:
            stream.feed(piece, self._indexed)
        self._stream, self._clock = stream, clock
        self._forget("_pending")
        self._refresh(stream)
        return self

    def _read_orders(self, *, begun: bool) -> None:
        orders = Orders.of(self.na, self.nb, self.nk, len(self._columns), bool(self.fit_intercept))
        if begun and orders != self.orders_:
            raise ValueError(
                f"The stream began with {self.orders_} and now has {orders}. Orders cannot change "
                "within a stream: call fit, or begin a new stream with sklearn.base.clone."
            )
        check_streamable(orders)
        self.orders_ = orders
        self.parameter_names_ = orders.parameter_names(self.inputs_)
        if callable(self.forgetting) or isinstance(self.forgetting, str):
            return
        if np.shape(self.forgetting) not in ((), (orders.n_params,)):
            raise ValueError(
                f"partial_fit cannot take forgetting as an array of shape "
                f"{np.shape(self.forgetting)} over instants, since their number is not known in "
                "advance. Give it as a function of the time in the run, in seconds."
            )

    def __sklearn_is_fitted__(self) -> bool:
        return "coef_" in vars(self)

    def _check_fitted(self) -> None:
        if "_pending" in vars(self):
            rows = sum(piece.y.size for piece in self._pending)
            raise NotFittedError(
                f"There is no estimate yet: partial_fit has collected {rows} rows of the "
                f"{window_rows(self.init_window, self.dt_)} of init_window={self.init_window:g} s. "
                "Give init= and p0= to have one from the start."
            )
        super()._check_fitted()

    def _check_streaming(self, fitted: bool) -> None:
        if self.combine == "average_estimates" or "coef_paths_" in vars(self):
            raise ValueError(
                "partial_fit cannot continue with combine='average_estimates', one recursion per "
                "run."
            )
        automatic = isinstance(self.forgetting, str) and self.forgetting == "auto"
        for option, chosen in (("smooth=True", self.smooth), ("forgetting='auto'", automatic)):
            if chosen and not fitted:
                raise ValueError(
                    f"partial_fit cannot start with {option}, which needs whole runs. Call fit on "
                    "recorded runs first."
                )

    def _started_stream(self, pieces: list[Piece]) -> Stream | None:
        """A stream from the rows so far, if they suffice."""
        table, n_rows = None, window_rows(self.init_window, self.dt_)
        if needs_data(self.init, self.p0):
            if sum(piece.y.size for piece in pieces) < n_rows:
                return None
            table = first_rows(pieces, n_rows, self.orders_)
            if table is None:
                return None
        theta0, P0 = self._start_from(table, sum(piece.y.size for piece in pieces))
        forgetting = self._stream_forgetting()
        state = RecursionState(theta0, P0)
        state.set_factor(forgetting)
        self.initial_coef_, self.initial_covariance_ = theta0, P0
        return self._new_stream(state, forgetting, P0)

    def _start_from(
        self, table: np.ndarray | None, n_samples: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """theta0 and P0, from the regressors of the first window where they come from data."""
        if table is not None and len(table) < len(self.parameter_names_):
            clocked = self._indexed or self.dt is not None
            clock = "" if clocked else " X has no time index, so each row counts as 1 s."
            raise ShortRunError(
                f"The first {self.init_window:g} s hold {len(table)} usable rows for "
                f"{len(self.parameter_names_)} parameters (n_samples = {n_samples}).{clock}",
                hint=f"Give {'' if clocked else 'dt=, or '}a longer init_window, or init= and p0=.",
                options=[] if clocked else ["dt"],
            )
        return start_of(self.init, self.p0, self.parameter_names_, table)

    def _stream_forgetting(self) -> Forgetting:
        forgetting = self._read_forgetting(np.zeros(1))
        if forgetting.automatic:
            raise ValueError(
                "forgetting='auto' needs whole runs, which partial_fit does not have: give the "
                "forgetting factor, or call fit."
            )
        return forgetting

    def _new_stream(self, state: RecursionState, forgetting: Forgetting, P0: np.ndarray) -> Stream:
        stream = Stream(state, self.orders_, self._columns, P0, self.dt_)
        stream.asked = READ_ANEW(self)
        stream.go_on_with(forgetting, self._reset_times())
        return stream

    def _refresh(self, stream: Stream) -> None:
        """Set the fitted attributes from the stream."""
        self.coef_ = stream.state.theta
        self._forget(*OF_RUNS)
        self._states, self._last_share = [stream.state], np.ones(1)
        self._set_forgetting(stream.forgetting, stream.state.factor)

    def _forget(self, *names: str) -> None:
        for name in names:
            self.__dict__.pop(name, None)
