"""Base class of the searches: predictions, score and summary of the best estimator."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin
from sklearn.callback import CallbackSupportMixin
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted

from ..._sklearn import FittedDisplay
from ...pipelines import final_step, reach_model, taken_apart
from ...preprocessing.base import keep_parameters
from ...text import Summary, TextTable, wrapped
from .folds import SplitsRuns


class BestModel(
    SplitsRuns,
    FittedDisplay,
    CallbackSupportMixin,
    MetaEstimatorMixin,
    RegressorMixin,
    BaseEstimator,
):
    """A search whose predictions are those of its best estimator."""

    estimator: Any
    scoring: Any
    best_estimator_: Any

    def predict(self, X: Any) -> np.ndarray:
        """Simulate the output with the best model (free run).

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
        """
        check_is_fitted(self, "best_estimator_")
        return self.best_estimator_.predict(X)

    @available_if(
        lambda self: (
            hasattr(taken_apart(self.best_estimator_)[1], "predict_ahead")
            if hasattr(self, "best_estimator_")
            else self.estimator is None or hasattr(final_step(self.estimator)[1], "predict_ahead")
        )
    )
    def predict_ahead(self, X: Any, y: Any, horizon: int = 1) -> np.ndarray:
        """Predict ``horizon`` steps ahead with the best model.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output.
        horizon : int, default=1
            Steps ahead, in samples of the fitted grid.

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
        """
        check_is_fitted(self, "best_estimator_")
        model, passed_on = reach_model(self.best_estimator_, X)
        return model.predict_ahead(passed_on, y, horizon)

    def score(self, X: Any, y: Any) -> float:
        """Score the free run of the best model by its VAF in percent.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output.

        Returns
        -------
        vaf : float
        """
        check_is_fitted(self, "best_estimator_")
        return self.best_estimator_.score(X, y)

    def summary(self, X: Any = None, y: Any = None) -> Summary:
        """Summarise what was searched and found, and the best model.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns), default=None
            Channels to validate the best model on, preferably of runs that were not fitted.
        y : Series or array of shape (n_rows,), default=None
            Their measured output.

        Returns
        -------
        text : Summary
            A string with lines of at most 88 columns, which notebooks show line by line.
        """
        check_is_fitted(self, "best_estimator_")
        found, candidates = self._found()
        steps, model = taken_apart(self.best_estimator_)
        lines = [*wrapped(found), "", candidates.caption, *candidates.lines(), ""]
        if steps:
            lines += [*wrapped(f"The best model follows {', '.join(map(repr, steps))}."), ""]
        if X is not None:
            model, X = reach_model(self.best_estimator_, X)
        return Summary("\n".join([*lines, model.summary(X, y)]))

    def _found(self) -> tuple[str, TextTable]:
        """What was searched and found in a sentence, and the best candidates."""
        raise NotImplementedError

    def _found_html(self) -> str:
        _, model = taken_apart(self.best_estimator_)
        return model._summary().html(self._found()[0])

    def _keep_names(self) -> None:
        keep_parameters(self)
        for name in ("n_features_in_", "feature_names_in_"):
            if hasattr(self.best_estimator_, name):
                setattr(self, name, getattr(self.best_estimator_, name))

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags
