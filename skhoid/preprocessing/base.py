"""What the row-preserving transformers share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from .._sklearn import fit_context, output_container
from ..exceptions import RunIndexError
from ..runs import SET_OUTPUT_HINT, RunLayout, read_layout, run_time_index


def read_table(estimator: Any, X: Any, *, reset: bool) -> tuple[RunLayout, np.ndarray]:
    """Read the layout and the checked values of X, with the ``dt`` and ``run`` of an estimator.

    Labels in a run column that are not numbers count up from 0 in the values.
    """
    known_dt = None if reset else estimator._full_dt
    layout = None
    if isinstance(X, pd.DataFrame) and len(X):
        layout = read_layout(X, dt=estimator.dt, run=estimator.run, fallback_dt=known_dt)
        if estimator.run is not None and X[estimator.run].dtype.kind not in "iufb":
            X = X.assign(**{estimator.run: layout.run_of(np.arange(len(X)))})
    values = validate_data(
        estimator, X, reset=reset, dtype=np.float64, ensure_all_finite="allow-nan"
    )
    if layout is None:
        layout = read_layout(values, dt=estimator.dt, run=estimator.run, fallback_dt=known_dt)
    if reset:
        estimator._full_dt, estimator._indexed = layout.dt, layout.indexed
    elif estimator._indexed and not layout.indexed:
        raise RunIndexError(
            f"{type(estimator).__name__} was fitted on X with run and time in its index and now "
            "gets X without. " + SET_OUTPUT_HINT
        )
    return layout, values


class RowPreservingTransformer(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):
    """A transformer that returns as many rows as it gets and keeps runs and time."""

    dt: float | None
    run: Any

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any = None) -> Any:
        """Read the sampling time of the runs.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
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
        if not reset:
            check_is_fitted(self)
        return read_table(self, X, reset=reset)

    def _channels(self, n_columns: int) -> list[int]:
        """Positions of all columns but the run column."""
        if self.run is None:
            return list(range(n_columns))
        names = list(getattr(self, "feature_names_in_", range(n_columns)))
        run = names.index(self.run) if self.run in names else int(self.run) % n_columns
        return [column for column in range(n_columns) if column != run]

    def _frame(self, X: Any, values: np.ndarray, layout: RunLayout) -> pd.DataFrame:
        """Wrap values as a frame with a run and time index, ready to carry a mark."""
        container = output_container(self)
        if container not in {"default", "pandas"}:
            raise RunIndexError(
                f"{type(self).__name__} marks rows in a pandas row index, which a {container} "
                'table cannot carry. Use .set_output(transform="pandas") on this step, and make '
                f"{type(self).__name__} a step of the pipeline itself, after any step that needs "
                f"{container}."
            )
        index = X.index if isinstance(X, pd.DataFrame) else None
        if not isinstance(index, pd.MultiIndex):
            index = run_time_index(layout)
        frame = pd.DataFrame(values, index=index, columns=self.get_feature_names_out(), copy=False)
        return self._restore(X, frame)

    def _like_input(self, X: Any, values: np.ndarray) -> Any:
        """Return values in the container that came in."""
        if not isinstance(X, pd.DataFrame):
            return values
        return self._restore(X, pd.DataFrame(values, index=X.index, columns=X.columns))

    def _restore(self, X: Any, frame: pd.DataFrame) -> pd.DataFrame:
        """Give back the run labels and the units of the table that came in."""
        if isinstance(X, pd.DataFrame):
            if self.run is not None:
                frame[self.run] = X[self.run].to_numpy()
            frame.attrs = dict(X.attrs)
        return frame

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags
