"""Base class of the row-preserving transformers, and the reading of their tables."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin, clone
from sklearn.utils.validation import check_is_fitted, validate_data

from .._sklearn import SharedDocs, fill_docs, fit_context, output_container
from ..exceptions import RunIndexError
from ..runs import (
    SET_OUTPUT_HINT,
    TIME,
    RunLayout,
    mark_run_column,
    read_layout,
    refuse_flat,
    run_column,
    run_time_index,
)
from .gate import (
    DOUBLE,
    as_table,
    check_not_infinite,
    check_not_too_large,
    check_numbers,
    refuse_objects,
    without_text,
)


class RemembersParameters:
    """Mixin of estimators that tell the parameters that they were fitted with."""

    _fitted_with: Any = None

    def keep_parameters(self) -> None:
        """Note the parameters that a fit begins with, for :attr:`fitted_parameters`."""
        given = self.get_params(deep=False)  # type: ignore[attr-defined]
        # Estimators and effects have parameters of their own, which can be set in place.
        own = {k: clone(v) for k, v in given.items() if isinstance(v, BaseEstimator)}
        self._fitted_with = SimpleNamespace(**{**given, **own})

    @property
    def fitted_parameters(self) -> Any:
        """The parameters as they were when the fit began; before a fit, the estimator itself."""
        return self if self._fitted_with is None else self._fitted_with


def as_fitted(estimator: Any) -> Any:
    """The parameters that an estimator was fitted with; its own before a fit.

    Fitted estimators read their parameters here: parameters set later take effect at the next fit.
    """
    return getattr(estimator, "fitted_parameters", estimator)


@dataclass(frozen=True)
class Reading:
    """How a table was read when an estimator was fitted, as later tables are.

    ``dt`` is the sampling time of the rows, ``indexed`` whether run and time were in the index,
    ``names`` those of the columns, if they had any, and ``run`` the run column.
    """

    dt: float
    indexed: bool
    names: list[Any] | None
    run: Any


def read_table(
    estimator: Any, X: Any, known: Reading | None, dtypes: tuple[type, ...] = DOUBLE
) -> tuple[RunLayout, np.ndarray, Reading]:
    """Read the layout and the checked values of X, with the ``dt`` and ``run`` of an estimator.

    ``known`` is the reading of the fit, and None when X is fitted. Labels in a run column that are
    not numbers count up from 0 in the values.
    """
    reset = known is None
    known_dt = None if known is None else known.dt
    told = as_fitted(estimator)
    X = as_table(X)
    frame = isinstance(X, pd.DataFrame)
    if known is not None and known.indexed and not (frame and TIME in X.index.names):
        raise RunIndexError(
            f"{type(estimator).__name__} was fitted on X with run and time in its index, but now "
            "gets X without them. " + SET_OUTPUT_HINT
        )
    layout = None
    names = list(X.columns) if hasattr(X, "columns") else None
    if frame and len(X):
        layout = read_layout(X, dt=told.dt, run=told.run, fallback_dt=known_dt)
        if told.run is not None:
            position = run_column(list(X.columns), told.run)
            if X.dtypes.iloc[position].kind not in "iufb":
                X = X.copy(deep=False)
                X.isetitem(position, layout.run_of(np.arange(len(X))))
    if frame:
        check_numbers(X, "X")
        X = without_text(X)
    elif names is not None:
        check_numbers(pd.DataFrame({name: np.asarray(X[name]) for name in names}), "X")
    else:
        refuse_objects(X)
    values = validate_data(estimator, X, reset=reset, dtype=dtypes, ensure_all_finite=False)
    check_not_infinite(values, "X", names)
    check_not_too_large(values, "X", names)
    if layout is None:
        refuse_flat(X, dt=told.dt, run=told.run)  # values have lost their names
        columns = names or list(range(values.shape[1]))
        run = None if told.run is None else run_column(columns, told.run)
        layout = read_layout(values, dt=told.dt, run=run, fallback_dt=known_dt)
    if known is None:
        label = layout.run_column if told.run is None else told.run
        known = Reading(layout.dt, layout.indexed, names, label)
    return layout, values, known


class RowPreservingTransformer(
    RemembersParameters, SharedDocs, OneToOneFeatureMixin, TransformerMixin, BaseEstimator
):
    """A transformer that returns as many rows as it gets and keeps runs and time."""

    dt: float | None
    run: Any
    _reading: Reading

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any = None) -> Any:
        """Read the sampling time of the runs.

        Parameters
        ----------
        {X}
        y : ignored
            Present for the scikit-learn API.

        Returns
        -------
        self : object
        """
        layout, _ = self._read(X, reset=True)
        self.dt_ = layout.dt
        self._check_layout(layout)
        return self

    def _check_layout(self, layout: RunLayout) -> None:
        """Check parameters against the runs."""

    def _read(self, X: Any, *, reset: bool) -> tuple[RunLayout, np.ndarray]:
        if reset:
            self.keep_parameters()
        else:
            check_is_fitted(self)
        layout, values, reading = read_table(self, X, None if reset else self._reading)
        if reset:
            self._reading = reading
        return layout, values

    def _channels(self, n_columns: int) -> list[int]:
        """Positions of all columns but the run column."""
        if self._reading.run is None:
            return list(range(n_columns))
        run = run_column(self._reading.names or list(range(n_columns)), self._reading.run)
        return [column for column in range(n_columns) if column != run]

    def _frame(self, X: Any, values: np.ndarray, layout: RunLayout) -> pd.DataFrame:
        """Wrap values as a frame with a run and time index, ready to carry a mark."""
        container = output_container(self)
        if container not in {"default", "pandas"}:
            raise RunIndexError(
                f"{type(self).__name__} marks rows in a pandas row index, which a {container} "
                'table does not have. Use .set_output(transform="pandas") on this step, and make '
                f"{type(self).__name__} a step of the pipeline itself, after any step that needs "
                f"{container}."
            )
        index = X.index if isinstance(X, pd.DataFrame) else None
        if not isinstance(index, pd.MultiIndex):
            index = run_time_index(layout)
        columns = list(self.get_feature_names_out())
        frame = self._restore(X, pd.DataFrame(values, index=index, columns=columns))
        if self._reading.run is not None and layout.run_column is None:
            # The next step goes by the index, and has no run= of its own.
            frame = mark_run_column(frame, columns[run_column(columns, self._reading.run)])
        return frame

    def _like_input(self, X: Any, values: np.ndarray) -> Any:
        """Return values in the container that came in."""
        if not isinstance(X, pd.DataFrame):
            return values
        return self._restore(X, pd.DataFrame(values, index=X.index, columns=X.columns))

    def _restore(self, X: Any, frame: pd.DataFrame) -> pd.DataFrame:
        """Give back the run labels and the units of the table that came in."""
        if isinstance(X, pd.DataFrame):
            run = as_fitted(self).run
            if run is not None:
                position = run_column(list(X.columns), run)
                frame.isetitem(position, X.iloc[:, position].to_numpy())
            frame.attrs = dict(X.attrs)
        return frame

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


fill_docs(RowPreservingTransformer)
