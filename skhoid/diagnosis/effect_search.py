"""The search for missing effects, as an estimator."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.model_selection import check_cv
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from .._sklearn import HasMethods, Interval, StrOptions, fit_context
from ..effects.base import Effect
from ..effects.catalogue import CLASSES
from ..effects.composition import Effects
from ..effects.record import Record
from ..greybox.fitting import Criterion
from ..greybox.lanes import Lanes
from ..greybox.model import fit_core, operator_starts
from ..greybox.operator import likelihood_fit
from ..human.controlled_element import ControlledElement
from .search_engine import Fold, Path, Search, forward

GUARD = 5.0  # s beside held-out blocks of a single run


class EffectSearchCV(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Which physical effects a model is missing, judged on held-out runs.

    Parameters
    ----------
    estimator : OperatorRegressor
    """

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict", "with_effect"])],
        "effects": [StrOptions({"all"}), list, tuple, str, Effect, Effects],
        "cv": ["cv_object"],
        "display": [StrOptions({"compensatory", "pursuit", "preview"})],
        "controlled_element": [ControlledElement, None],
        "max_effects": [Interval(Integral, 0, None, closed="left")],
        "false_alarm": [Interval(Real, 0, 1, closed="neither")],
        "n_jobs": [Integral, None],
    }

    def __init__(
        self,
        estimator: Any,
        effects: Any = "all",
        cv: Any = None,
        display: str = "compensatory",
        controlled_element: ControlledElement | None = None,
        *,
        max_effects: int = 4,
        false_alarm: float = 0.01,
        n_jobs: int | None = None,
    ):
        self.estimator = estimator
        self.effects = effects
        self.cv = cv
        self.display = display
        self.controlled_element = controlled_element
        self.max_effects = max_effects
        self.false_alarm = false_alarm
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any) -> EffectSearchCV:
        with threadpool_limits(1):
            return self._fit(X, y)

    def _fit(self, X: Any, y: Any) -> EffectSearchCV:
        model = clone(self.estimator)
        if self.controlled_element is not None:
            model.set_params(controlled_element=self.controlled_element)
        record, core, lanes = model._prepare(X, y)
        candidates = self._candidates()
        folds = self._folds(X, y, record, lanes)
        search = Search(core, record, candidates, folds)
        criterion = Criterion(record)
        baseline = fit_core(core, record, criterion, operator_starts(core, record, criterion))
        path = forward(search, baseline, int(self.max_effects))
        self._set_results(model, record, lanes, path)
        self.n_features_in_ = model.n_features_in_
        if hasattr(model, "feature_names_in_"):
            self.feature_names_in_ = model.feature_names_in_
        return self

    def _candidates(self) -> list[Effect]:
        if isinstance(self.effects, str) and self.effects == "all":
            return [c() for c in CLASSES if c.name != "tremor"]
        return [e for _, e in Effects.of(self.effects) if e.name != "tremor"]

    def _folds(self, X: Any, y: Any, record: Record, lanes: Lanes) -> list[Fold]:
        known = record.known
        if self.cv is None:
            if record.n_runs > 1:
                tests = [np.zeros_like(known) for _ in range(record.n_runs)]
                for j, test in enumerate(tests):
                    test[:, j] = known[:, j]
                return [Fold(t, known & ~t) for t in tests]
            rows = np.flatnonzero(known[:, 0])
            folds = []
            guard = round(GUARD / record.dt)
            for block in np.array_split(rows, 3):
                test, train = np.zeros_like(known), known.copy()
                test[block, 0] = True
                train[max(block[0] - guard, 0) : block[-1] + guard + 1, 0] = False
                folds.append(Fold(test, train))
            return folds
        groups = lanes.rows(np.broadcast_to(np.arange(record.n_runs), known.shape).copy())
        folds = []
        for _, held in check_cv(self.cv).split(X, y, groups):
            rows = np.zeros(int(lanes.end[-1]), dtype=bool)
            rows[held] = True
            test = lanes.beside(rows, fill=False) & known
            folds.append(Fold(test, known & ~test))
        return folds

    def _set_results(self, model: Any, record: Record, lanes: Lanes, path: Path) -> None:
        criterion = Criterion(record)
        model._set_model(likelihood_fit(path.model, criterion))
        self.best_estimator_ = model
        self.best_effects_ = path.ids
        rows = []
        for number, step in enumerate(path.steps, 1):
            for rank, c in enumerate(step.candidates, 1):
                rows.append(
                    {
                        "step": number,
                        "rank": rank,
                        "effect": c.id,
                        "n_parameters": c.n_parameters,
                        "delta_loglik": c.loglik,
                        "delta_bic": c.evidence,
                        "vaf_before": step.vaf,
                        "vaf_after": c.vaf,
                        "vaf_gain": c.gain,
                        "p_value": c.p_value,
                        "passes": c.passes,
                        "confused_with": c.confused_with,
                        "reason": c.reason,
                    }
                )
        self.ranking_ = pd.DataFrame(rows)
        self.explainable_gap_ = path.vaf - path.steps[0].vaf

    def predict(self, X: Any) -> np.ndarray:
        check_is_fitted(self)
        return self.best_estimator_.predict(X)
