"""The thesis's identification procedure, step by step, on recorded runs (its Section III-D)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.pipeline import Pipeline, make_pipeline

from ..metrics import VAF_FLOOR, VAFScorer, vaf_of_rows
from ..pipelines import trimmed_rows
from ..preprocessing import Decimator, RunInTrimmer
from ..runs import RunLayout, read_layout, run_name, whole_samples
from ..selection import run_labels
from .batch import ARXRegressor
from .searches import DelaySearchCV, OrderSearchCV

OVERFIT_RATIO = 1.1  # of VAF on estimation to VAF on validation data, the thesis's example


@dataclass(frozen=True)
class FittedModel:
    """A model and its free-run VAF on the rows it was fitted on and on held-out ones."""

    name: str
    pipeline: Pipeline
    vaf_estimation: float
    vaf_validation: float

    @property
    def model(self) -> ARXRegressor:
        return self.pipeline[-1]

    @property
    def ratio(self) -> float:
        return self.vaf_estimation / self.vaf_validation

    @property
    def verdict(self) -> str:
        if self.vaf_validation <= VAF_FLOOR:
            return "unstable"
        if self.vaf_validation <= 0:
            return "fails on validation data"
        return "overfit" if self.ratio > OVERFIT_RATIO else "no overfit"

    def as_dict(self) -> dict[str, Any]:
        model = self.model
        return {
            "name": self.name,
            "na": model.orders_.na,
            "nb": list(model.orders_.nb),
            "nk": list(model.orders_.nk),
            "delay_s": [k * model.dt_ for k in model.orders_.nk],
            "vaf_estimation": self.vaf_estimation,
            "vaf_validation": self.vaf_validation,
            "ratio": self.ratio,
            "verdict": self.verdict,
            "parameters": [
                {"name": name, "value": value, "standard_error": error}
                for name, value, error in zip(
                    model.parameter_names_,
                    model.coef_.tolist(),
                    model.standard_errors_.tolist(),
                    strict=True,
                )
            ],
        }


@dataclass(frozen=True)
class Identification:
    """What :func:`identify` found."""

    X: pd.DataFrame
    y: pd.Series
    layout: RunLayout
    held_out: np.ndarray
    estimation: str
    validation: str
    centered: bool
    delay_search: DelaySearchCV
    vaf_delay_search: DelaySearchCV
    order_search: OrderSearchCV
    models: list[FittedModel]

    @property
    def units(self) -> dict[str, str]:
        """Units of the channels that have one."""
        return {**self.X.attrs.get("units", {}), **self.y.attrs.get("units", {})}

    @property
    def n_gaps(self) -> int:
        """Gaps in time, at which the free run starts anew from zero."""
        return self.layout.starts.size - self.layout.run_starts.size

    @property
    def held_out_view(self) -> dict[str, Any]:
        """Which runs, or which part of a single run, a picture of the validation shows."""
        first = np.flatnonzero(self.held_out)[0]
        if len(self.layout.labels) == 1:
            end = float(self.layout.time[-1]) + self.layout.dt
            return {"window": (float(self.layout.time[first]), end)}
        return {"runs": list(dict.fromkeys(run_labels(self.X)[self.held_out].tolist()))}

    @property
    def best(self) -> FittedModel:
        """The model with the searched delay and orders."""
        return self.models[-1]


def identify(
    X: pd.DataFrame,
    y: pd.Series,
    *,
    inputs: list[str] | None = None,
    run_in: float | None = None,
    factor: int = 1,
    longest_delay: float = 0.5,
    criterion: str = "one_step",
    validation_runs: list[Any] | None = None,
    centered: bool = True,
    callbacks: tuple[Any, ...] = (),
) -> Identification:
    """Discard the run-in, find delay and orders, fit, and validate on held-out data.

    The last run is held out, or ``validation_runs``, or the second half of a single run; nothing
    is chosen or fitted on it. With ``centered`` the models have an intercept and VAF is taken
    about the mean of each run.
    """
    layout = read_layout(X)
    held_out, names = _held_out_rows(layout, validation_runs)
    model = ARXRegressor(inputs=inputs, fit_intercept=centered, covariance="hac")
    pipeline = make_pipeline(RunInTrimmer(run_in), Decimator(factor), model)
    scorer = VAFScorer(run_in=run_in, centered=centered)
    X_e, y_e = X[~held_out], y[~held_out]

    grid_dt = layout.dt * factor
    candidates = range(int(np.floor(whole_samples(longest_delay, grid_dt))) + 1)
    searches = []
    for how in ("one_step", "vaf"):
        search = DelaySearchCV(pipeline, nk=candidates, criterion=how, scoring=scorer)
        searches.append(search.set_callbacks(*callbacks).fit(X_e, y_e))
    chosen = searches[0 if criterion == "one_step" else 1]
    orders = OrderSearchCV(chosen.best_estimator_, nk=[chosen.best_nk_], scoring=scorer)
    orders.set_callbacks(*callbacks).fit(X_e, y_e)

    models = []
    for label, fitted in (
        ("without delay", clone(pipeline).fit(X_e, y_e)),
        ("with delay", chosen.best_estimator_),
        ("with delay and orders", orders.best_estimator_),
    ):
        prediction = fitted.predict(X)
        keep = ~trimmed_rows(fitted, X)
        vafs = [
            vaf_of_rows(
                y.to_numpy(dtype=float), prediction, keep & rows, layout, "pooled", centered
            )
            for rows in (~held_out, held_out)
        ]
        models.append(FittedModel(label, fitted, *vafs))
    return Identification(
        X, y, layout, held_out, *names, centered, searches[0], searches[1], orders, models
    )


def _held_out_rows(
    layout: RunLayout, validation_runs: list[Any] | None
) -> tuple[np.ndarray, tuple[str, str]]:
    """Mark the validation rows, and say in words what they are."""
    run = layout.run_of(np.arange(layout.n_rows))
    labels = layout.labels
    if validation_runs is None and len(labels) == 1:
        middle = (layout.n_rows + 1) // 2
        half = layout.time[middle] - layout.time[0]
        return np.arange(layout.n_rows) >= middle, (
            f"run {labels[0]!r}, first {half:.4g} s",
            f"run {labels[0]!r}, after {half:.4g} s",
        )
    names = [run_name(label) for label in labels]
    wanted = [str(w) for w in validation_runs] if validation_runs else [names[-1]]
    unknown = [w for w in wanted if w not in names]
    if unknown:
        raise ValueError(f"There is no run {unknown[0]!r} to validate on; the runs are {names}.")
    chosen = np.isin(names, wanted)
    if chosen.all():
        raise ValueError("Every run is held out for validation; leave at least one to fit on.")

    def listed(mask: np.ndarray) -> str:
        some = [repr(name) for name, m in zip(names, mask, strict=True) if m]
        return ("run " if len(some) == 1 else f"{len(some)} runs: ") + ", ".join(some)

    return chosen[run], (listed(~chosen), listed(chosen))
