"""Base class of all regressors on runs: reads and checks data, predicts, scores, summarises."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_consistent_length, check_is_fitted

from ._sklearn import FittedDisplay, SharedDocs, fill_docs
from .exceptions import MissingDataWarning, RunCutWarning, RunIndexError, RunTimeWarning
from .metrics import scored_rows, vaf_of_rows, warn_of_unscored
from .preprocessing.base import Reading, RemembersParameters, read_table
from .preprocessing.gate import (
    AS_GIVEN,
    DOUBLE,
    as_output,
    as_weights,
    check_not_infinite,
    check_not_too_small,
)
from .preprocessing.grid import HeldInputs, ModelGrid
from .runs import (
    DecimationMark,
    RunLayout,
    check_alignment,
    check_pieces,
    empty_runs,
    input_columns,
    output_name,
    rows_of_runs,
    run_column,
    warn_of_pooled,
)
from .text import ModelSummary, Summary

NOTED_JITTER = 0.01  # of a sampling time
LEAST_ORDERED, WHITE = 500, 3.0  # rows; standard deviations of a correlation of white noise
STILL = 1e-9  # relative to the norm of a channel


class DataToFit(NamedTuple):
    """Data on the grid: inputs, output and all columns of X, and the latter at full rate too.

    ``known`` are the rows at full rate with an output to fit; elsewhere it is NaN. ``weights`` are
    those of the rows of the grid, if any are given; where they are 0 the output is NaN.
    """

    grid: ModelGrid
    inputs: np.ndarray
    output: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    known: np.ndarray
    weights: np.ndarray | None = None

    @property
    def told(self) -> np.ndarray:
        """The output in which only what was not measured is NaN, not what weights leave out."""
        return self.output if self.weights is None else np.where(self.weights > 0, self.output, 0)


class RunRegressor(RemembersParameters, SharedDocs, FittedDisplay, RegressorMixin, BaseEstimator):
    """A regressor that predicts the output of runs by simulation, on the grid that marks leave."""

    inputs: Any
    roles: dict | None
    dt: float | None
    run: Any
    _reading: Reading

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        """Simulated output on the grid, from all columns of X at full rate."""
        raise NotImplementedError

    def _run_from(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        """The same, from initial states that fit the first seconds of an output on the grid."""
        return self._free_run(grid, values)

    def _read_X(self, X: Any, *, reset: bool) -> tuple[ModelGrid, np.ndarray]:
        """Read the layout and all columns of X, checked, in single precision if they are so."""
        if reset:
            self.keep_parameters()
        known = None if reset else self._reading
        layout, values, reading = read_table(self, X, known, AS_GIVEN)
        if reset:
            self._reading = reading
            self._mark = layout.mark
        elif layout.mark != self._mark:
            raise RunIndexError(
                f"{type(self).__name__} was fitted on X {_marked(self._mark)}, but now gets X "
                f"{_marked(layout.mark)}. Pass X through the same Decimator, preferably by "
                "putting both in one Pipeline."
            )
        return ModelGrid.of(layout), values

    def _read_y(self, X: Any, y: Any, dtypes: tuple[type, ...] = DOUBLE) -> np.ndarray:
        """Read y, in which NaN means no measurement."""
        if y is None:
            raise ValueError(
                f"{type(self).__name__} requires y to be passed, but the target y is None."
            )
        check_alignment(X, y)
        output = as_output(y, warn=True, dtypes=dtypes)
        check_consistent_length(X, output)
        check_not_infinite(output, "y")
        return output

    def _channel_names(self, positions: list[int]) -> list[str]:
        names = self._reading.names
        return [f"x{p}" if names is None else str(names[p]) for p in positions]

    def _read_data(
        self,
        X: Any,
        y: Any,
        needs: str = "inputs",
        *,
        in_parts: bool = False,
        sample_weight: Any = None,
    ) -> DataToFit:
        """Read data to fit, without the runs in which a channel it ``needs`` was never recorded.

        Those are the ``"inputs"``, or ``"all"`` channels; ``"nothing"`` leaves out no run. Inputs
        and output are of 64 bits, but for a fit that reads them ``in_parts``.
        """
        dtypes = AS_GIVEN if in_parts else DOUBLE
        grid, values = self._read_X(X, reset=True)
        warn_of_pooled(X)
        output = self._read_y(X, y, dtypes)
        if needs != "nothing":
            check_not_too_small(values, "X", self._reading.names)
            check_not_too_small(output, "y")
        self._output_name = output_name(y)
        self._columns = self._linear_columns(values.shape[1])
        self.inputs_ = self._channel_names(self._columns)
        self._needed = self._columns
        if needs == "all":
            names = self._reading.names or [*range(values.shape[1])]
            run = None if self._reading.run is None else run_column(names, self._reading.run)
            self._needed = [i for i in range(values.shape[1]) if i != run]
        if needs != "nothing":
            output = self._drop_empty_runs(grid.layout, values, output)
        if not hasattr(X, "index") and getattr(self, "na", True):
            warn_of_no_order([*values[:, self._columns].T, output])
        weights = as_weights(sample_weight, X, output.size)
        if weights is not None:
            output = np.where(weights > 0.0, output, np.nan)
            if needs != "nothing" and np.isnan(output).all():
                raise ValueError(
                    "Sample weights are zero in all rows in which y was measured: nothing is left "
                    "to fit."
                )
            weights = weights if grid.rows is None else weights[grid.rows]
        self._units = {**units_of(X), **units_of(y)}
        self._n_runs = len(grid.layout.labels)
        self.dt_ = grid.dt
        self.jitter_ = grid.layout.jitter
        if self.jitter_ > NOTED_JITTER:
            warnings.warn(
                RunTimeWarning(
                    f"The sampling instants jitter by up to {100 * self.jitter_:.1f} % of "
                    f"{grid.layout.dt:.6g} s. The model treats them as regular.",
                    hint="skhoid.resample_runs(X, y) puts them on a regular grid.",
                    options=["resample"],
                ),
                stacklevel=4,
            )
        thinned = grid.thin_inputs(values)
        inputs = find_columns(thinned, self._columns)
        if inputs.dtype not in dtypes:
            inputs = inputs.astype(np.float64)
        thin = grid.thin_output(output)
        return DataToFit(grid, inputs, thin, thinned, values, ~np.isnan(output), weights)

    @property
    def column_names(self) -> list[Any] | None:
        """Names of the columns of X that was fitted; None if they had none."""
        return self._reading.names

    @property
    def output_name(self) -> str:
        """Name of the output that was fitted."""
        return self._output_name

    @property
    def input_positions(self) -> list[int]:
        """Positions in X of the columns that are the linear inputs."""
        return self._columns

    @property
    def recorded_dt(self) -> float:
        """Sampling time of the data before a Decimator, in seconds."""
        return self.dt_ if self._mark is None else self.dt_ / self._mark.factor

    def _linear_columns(self, n_columns: int) -> list[int]:
        """Columns of the linear inputs."""
        read = self._reading
        return input_columns(read.names, n_columns, self.inputs, read.run, self.roles)

    def _drop_empty_runs(
        self, layout: RunLayout, values: np.ndarray, output: np.ndarray
    ) -> np.ndarray:
        """An output that is missing in runs without any measurement, of which a warning tells."""
        names = self._channel_names(self._needed)
        empty = empty_runs(layout, values, self._needed)
        unfed = {run: names[self._needed.index(column)] for run, column in empty.items()}
        silent = dict.fromkeys(empty_runs(layout, output[:, None], [0]), self.output_name)
        left_out = dict(sorted((unfed | silent).items()))
        if not left_out:
            return output
        if len(silent) == len(layout.labels):
            raise ValueError("Input y contains NaN in all rows: nothing was measured.")
        named = {*left_out.values()}
        if len(left_out) == len(layout.labels) and len(named) == 1:
            raise ValueError(
                f"Input {named.pop()!r} contains NaN in all rows: nothing was measured."
            )
        told = [f"run {layout.labels[run]!r} ({name!r})" for run, name in left_out.items()]
        if len(left_out) == len(layout.labels):
            raise ValueError(
                f"No run is left to fit; in each, a channel is NaN in all rows: "
                f"{', '.join(told)}. Leave out the column if the model does not need it."
            )
        warnings.warn(
            f"{len(told)} of {len(layout.labels)} runs are left out because a channel is NaN in "
            f"all their rows: {', '.join(told)}.",
            MissingDataWarning,
            stacklevel=5,
        )
        if unfed:
            output = np.where(rows_of_runs(layout, unfed), np.nan, output)
        return output

    def _fed(self, layout: RunLayout, values: np.ndarray) -> np.ndarray:
        """Rows of runs in which every channel that the model needs was recorded."""
        return ~rows_of_runs(layout, empty_runs(layout, values, self._needed))

    def _check_fitted(self) -> None:
        check_is_fitted(self)

    def _rows_to_forget(self, dt: float) -> int:
        """Rows after which a free run no longer shows how it began."""
        return 1

    def _hold(
        self,
        grid: ModelGrid,
        values: np.ndarray,
        columns: list[int] | None = None,
        names: list[str] | None = None,
    ) -> HeldInputs:
        """Inputs on the grid whose NaN hold the last value; ``columns`` of values, or all."""
        columns = list(range(values.shape[1])) if columns is None else columns
        held = HeldInputs(values, columns, segments(grid))
        counting = {i: gaps.rows[gaps.counts] for i, gaps in held.gaps.items() if gaps.counts.any()}
        if counting:
            rows = np.unique(np.concatenate(list(counting.values())))
            named = [(names or self.inputs_)[i] for i in counting]
            warnings.warn(
                f"{rows.size} rows of the inputs {named} are NaN, the first at "
                f"{grid.layout.where(grid.full_row(int(rows[0])))}; the simulation holds the last "
                "value there, or zero if there is none.",
                MissingDataWarning,
                stacklevel=4,
            )
        return held

    def predict(self, X: Any) -> np.ndarray:
        """Simulate the output from the inputs alone (free run).

        The output is zero before each run, and before the first row after a gap or a marked run-in;
        inputs are zero before the recording begins. Models with ``initial_`` equal to
        ``"estimate"`` begin as if the inputs had always been as in the first row. A NaN input is
        replaced by the last value, and a warning says how many. Unstable models stay finite (within
        1e100).

        Parameters
        ----------
        {X}

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
            Simulated output, in the unit of ``y``.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        check_segments(grid, self._rows_to_forget(grid.dt))
        return grid.to_full_rate(self._free_run(grid, values))

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:
        """Score the free run by its VAF in percent, pooled over runs: 100 is perfect, not 1.

        Models that estimate initial states use those that fit the first seconds of each run best:
        at most 10 s (or 200 rows), and a quarter of what was measured in the run. All else is
        foreseen. ``VAFScorer(fraction=True)`` is at most 1.

        Parameters
        ----------
        {X, y}
        sample_weight : array-like of shape (n_rows,), float or None, default=None
            Weight of each row in the sums of squares; rows of weight 0 are not scored.

        Returns
        -------
        vaf : float
            Unclipped, at least -1000; rows of a marked run-in are left out.
        """
        self._check_fitted()
        layout = self._read_X(X, reset=False)[0].layout
        measured = self._read_y(X, y)
        weights = as_weights(sample_weight, X, measured.size)
        counts = np.ones(measured.size) if weights is None else weights
        # A row that does not count does not say how a run began either.
        told = y if weights is None else np.where(counts > 0.0, measured, np.nan)
        prediction, fed = self.prediction_from(X, told)
        keep = scored_rows(layout, None, None) & fed & (counts > 0.0)
        warn_of_unscored(layout, measured, keep)
        measured, prediction = (np.sqrt(counts) * signal for signal in (measured, prediction))
        return vaf_of_rows(measured, prediction, keep, layout, "pooled", False)

    def prediction_from(self, X: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        """Free run from states that fit y's first seconds, if the model has such; else ``predict``.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
            Simulated output, in the unit of ``y``.
        fed : ndarray of bool of shape (n_rows,)
            Rows of runs in which the channels that the model needs were recorded.
        """
        self._check_fitted()
        grid, values = self._read_X(X, reset=False)
        check_segments(grid, self._rows_to_forget(grid.dt))
        output = grid.thin_output(self._read_y(X, y))
        return self._predict_read(grid, values, output), self._fed(grid.layout, values)

    def _predict_read(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        """The same free run of data that have been read."""
        return grid.to_full_rate(self._run_from(grid, values, output))

    def summary(self, X: Any = None, y: Any = None) -> Summary:
        """Summarise in a table what was fitted, how, and how certain the parameters are.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns), default=None
            Channels to validate on, preferably of runs that were not fitted.
        y : Series or array of shape (n_rows,), default=None
            Their measured output. With data, the header shows the VAF of the free run and, if the
            model makes them, of predictions one step ahead: the free run is what counts.

        Returns
        -------
        text : Summary
            A string with lines of at most 88 columns, which notebooks show line by line.
        """
        self._check_fitted()
        found = self.summary_table()
        if X is not None:
            found = replace(found, facts=found.facts | self._validation(X, y))
        return found.text()

    def summary_table(self) -> ModelSummary:
        """What :meth:`summary` tells, as a structure that renders itself as text or as HTML."""
        raise NotImplementedError

    def _signal_facts(self) -> dict[str, str]:
        """Output and inputs with their units."""

        def named(channel: str) -> str:
            unit = self._units.get(channel)
            return f"{channel} ({unit})" if unit else channel

        several = "Inputs" if len(self.inputs_) > 1 else "Input"
        return {
            "Output": named(self.output_name),
            several: ", ".join(map(named, self.inputs_)),
        }

    def _grid_facts(self) -> dict[str, str]:
        """Sampling time of the data, and that of the grid the model is fitted on."""
        facts = {"Sampling time": f"{self.recorded_dt:.6g} s"}
        if self._mark is not None:
            facts["Fitted grid"] = f"{self.dt_:.6g} s (1 in {self._mark.factor} rows)"
        return facts

    def _found_html(self) -> str:
        return self.summary_table().html()

    def _validation(self, X: Any, y: Any) -> dict[str, str]:
        """VAF on the data of a summary."""
        facts = {"VAF, free run": f"{self.score(X, y):.1f} % of the data given"}
        if hasattr(self, "predict_ahead"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MissingDataWarning)  # score has said so
                ahead = self.predict_ahead(X, y)
                grid, values = self._read_X(X, reset=False)
            keep = scored_rows(grid.layout, None, None) & self._fed(grid.layout, values)
            vaf = vaf_of_rows(self._read_y(X, y), ahead, keep, grid.layout, "pooled", False)
            facts["VAF, one step"] = f"{vaf:.1f} % (high even for wrong models)"
        return facts

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


fill_docs(RunRegressor)


def _marked(mark: DecimationMark | None) -> str:
    return "not decimated" if mark is None else f"decimated by {mark.factor} ({mark.method})"


def units_of(data: Any) -> dict[str, str]:
    """Units that a pandas object carries."""
    units = getattr(data, "attrs", {}).get("units")
    return {str(k): str(v) for k, v in units.items() if v} if isinstance(units, Mapping) else {}


def segments(grid: ModelGrid) -> list[tuple[int, int]]:
    """Begin and end of runs, cut at gaps but not at the end of a run-in."""
    return list(pairwise([*np.unique(grid.past).tolist(), *grid.end[-1:].tolist()]))


def warn_of_no_order(channels: list[np.ndarray]) -> None:
    """Warn of arrays, which have no clock, in which no row has to do with the one before it."""
    n = len(channels[0])
    if n < LEAST_ORDERED or not all(map(np.ptp, channels)):  # NaN are some order
        return
    near = max(abs(float(np.corrcoef(one[1:], one[:-1])[0, 1])) for one in channels)
    if near < WHITE / np.sqrt(n):
        warnings.warn(
            "No row of X and y has to do with the row before it (correlation at most "
            f"{near:.2g}). If a split or a bootstrap drew them (train_test_split, "
            "BaggingRegressor), a fit means nothing, and an array has no clock that shows it.",
            RunCutWarning,
            stacklevel=5,
        )


def check_segments(grid: ModelGrid, needed: int) -> None:
    """Refuse rows in pieces shorter than a model needs to forget how each begins."""
    begin, end = np.array(segments(grid)).reshape(-1, 2).T
    check_pieces(grid.layout, end - begin, needed, grid.dt)


def find_columns(table: np.ndarray, columns: list[int]) -> np.ndarray:
    """Some columns of a table, as a view where they are evenly apart."""
    steps = np.diff(columns)
    if len(columns) and (steps == steps[:1]).all() and (steps > 0).all():
        return table[:, columns[0] : columns[-1] + 1 : int(steps[0]) if steps.size else 1]
    return table[:, columns]


def still(what: str, values: np.ndarray) -> str | None:
    """Say that a channel is zero or constant, if it is."""
    size = np.abs(values).max()
    if size == 0:
        return f"{what} is zero in all rows"
    return f"{what} is constant ({values[0]:g})" if np.ptp(values) <= STILL * size else None


def bad_output(output: str, y: np.ndarray) -> str | None:
    """What is wrong with an output that does not change."""
    found = still(f"The output {output!r}", y)
    return None if found is None else f"{found}; is it the right column?"
