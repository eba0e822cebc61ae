"""Taking pipelines and searches apart: first step, last step, and run-in trimmers in between."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import _num_samples

from .preprocessing.base import as_fitted
from .preprocessing.transformers import RunInTrimmer, run_in_rows
from .runs import RunLayout, read_layout


def unwrapped(estimator: Any) -> Any:
    """The estimator inside fitted searches."""
    while hasattr(estimator, "best_estimator_"):
        estimator = estimator.best_estimator_
    return estimator


def final_step(estimator: Any) -> tuple[str, Any]:
    """Parameter prefix and last step of a pipeline, or the estimator itself."""
    if isinstance(estimator, Pipeline):
        name, step = estimator.steps[-1]
        return f"{name}__", step
    return "", estimator


def taken_apart(estimator: Any) -> tuple[list[Any], Any]:
    """Steps before the model at the end of searches and pipelines, and the model."""
    steps: list[Any] = []
    model = unwrapped(estimator)
    while isinstance(model, Pipeline):
        steps += [step for _, step in model.steps[:-1]]
        model = unwrapped(model.steps[-1][1])
    return steps, model


def reach_model(estimator: Any, X: Any) -> tuple[Any, Any]:
    """The fitted model at the end of searches and pipelines, and what they pass to it."""
    estimator = unwrapped(estimator)
    while isinstance(estimator, Pipeline):
        if len(estimator.steps) > 1:
            X = estimator[:-1].transform(X)
        estimator = unwrapped(estimator.steps[-1][1])
    return estimator, X


def by_likelihood(estimator: Any) -> Any:
    """The estimator, but its model predicts by ``parameters_`` even if others simulate better."""
    estimator = unwrapped(estimator)
    if isinstance(estimator, Pipeline):
        name, last = estimator.steps[-1]
        return Pipeline([*estimator.steps[:-1], (name, by_likelihood(last))])
    return estimator.by_likelihood() if hasattr(estimator, "by_likelihood") else estimator


def raw_layout(estimator: Any, X: Any, *, dt: float | None = None, run: Any = None) -> RunLayout:
    """Runs and time of X as the first step sees them, unless ``dt`` and ``run`` say otherwise."""
    first = unwrapped(estimator)
    while isinstance(first, Pipeline):
        first = unwrapped(first.steps[0][1])
    told = as_fitted(first)
    return read_layout(
        X,
        dt=getattr(told, "dt", None) if dt is None else dt,
        run=getattr(told, "run", None) if run is None else run,
    )


def trimmed_rows(estimator: Any, X: Any) -> np.ndarray:
    """Rows that a RunInTrimmer inside ``estimator`` leaves out."""
    trimmed = np.zeros(_num_samples(X), dtype=bool)
    for _, step in getattr(unwrapped(estimator), "steps", []):
        if isinstance(step, RunInTrimmer):
            told = as_fitted(step)
            trimmed |= run_in_rows(
                read_layout(X, dt=told.dt, run=told.run),
                run_in=told.run_in,
                measurement_time=told.measurement_time,
            )
    return trimmed


def prediction_from(estimator: Any, X: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
    """Free run of X that begins where y does, of models that can; else what they predict.

    With it the rows to compare: not those of runs in which an input was never recorded.
    """
    model, passed = reach_model(estimator, X)
    if not hasattr(model, "prediction_from"):
        prediction = np.asarray(estimator.predict(X), dtype=float).ravel()
        return prediction, np.ones(prediction.size, dtype=bool)
    return model.prediction_from(passed, y)
