"""DelaySearchCV: the search for the input delay (thesis step 3)."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.callback import with_callbacks

from ..._sklearn import HasMethods, Interval, StrOptions, fit_context
from ...exceptions import RankDeficiencyError
from ...metrics import VAFScorer
from ...pipelines import raw_layout, reach_model
from ...text import TextTable, number, vaf_name
from ..batch import ARXRegressor
from ..least_squares import Triangle
from .best_model import BestModel
from .candidates import CandidateTable, as_candidate, has_fast_path, with_orders
from .text import highest, lowest, standard_error_over_folds
from .validation import Validation

MOST_WINDOWS = 1_000_000
N_CANDIDATES = 50


class DelaySearchCV(BestModel):
    """Find the input delay of an ARX model.

    Every candidate ``nk`` is fitted on the same rows, and the one with the lowest loss is refitted.

    Parameters
    ----------
    estimator : ARXRegressor or Pipeline that ends in one, or None, default=None
        Model whose ``nk`` is searched; its other parameters are kept. None means
        ``ARXRegressor()``.
    nk : sequence of int, or of one tuple per input, or None, default=None
        Candidates, in samples of the grid the model is fitted on. An int is the delay of every
        input. None means 1 to 50, but at most a quarter of the shortest run.
    criterion : {"one_step", "vaf"}, default="one_step"
        ``"one_step"`` is the mean squared one-step prediction error on all rows (Eq. 24, with the
        square that is missing in print). ``"vaf"`` is 100 minus the cross-validated VAF of the free
        run.
    cv : int, splitter, iterable or None, default=None
        Folds for ``"vaf"``; an int is a number of folds of whole runs. None leaves out one run at a
        time; a single run is fitted on its first half and scored on its second.
    scoring : VAFScorer or None, default=None
        How ``"vaf"`` computes the VAF: run-in, window, centring, average.
    window : float or None, default=None
        Length in seconds of a sliding window, for the delay over time in addition to the overall
        one. Needs ``criterion="one_step"``.
    step : float or None, default=None
        Step of the window in seconds; None means a quarter of it.

    Attributes
    ----------
    best_nk_ : int or tuple
        Candidate with the lowest loss.
    best_delay_ : float or tuple
        The same in seconds, n_k / f_s. It includes the sample of zero-order hold, and adds to a
        :class:`DelayShift` in the pipeline.
    best_score_ : float
        Its cross-validated VAF in percent; only with ``criterion="vaf"``.
    loss_ : ndarray of shape (n_candidates,)
        Loss of each candidate; NaN where its regressors are linearly dependent.
    cv_results_ : dict
        Columns ``nk``, ``delay`` (s), ``loss``, and for ``"vaf"`` ``mean_test_score``,
        ``std_test_score`` and ``split<i>_test_score``.
    best_estimator_ : estimator
        The model refitted on all data with ``best_nk_``.
    dt_ : float
        Sampling time of the model's grid in seconds.
    window_time_ : ndarray of shape (n_windows,)
        Centres of the windows, in seconds of the time index.
    nk_path_, delay_path_ : ndarray of shape (n_windows,)
        Best candidate in each window, in samples and seconds (the longest of several inputs); NaN
        where the window holds too little data. Windows pool the runs by their time index.
    loss_path_ : ndarray of shape (n_windows, n_candidates)
        Loss of every candidate in each window.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    Notes
    -----
    For :class:`ARXRegressor` with ``method="ols"`` all candidates come from one QR factorisation.
    The two criteria can differ: with coloured remnant the one-step loss is biased towards other
    delays (Fig. 9 of the thesis). For progress, call
    ``search.set_callbacks(sklearn.callback.ProgressBar())`` before ``fit``.

    References
    ----------
    Van Grootheest, thesis, Section III-D step 3.

    Examples
    --------
    >>> from skhoid import ARXRegressor, DelaySearchCV, load_human_tracking
    >>> X, y = load_human_tracking(1)
    >>> search = DelaySearchCV(ARXRegressor(fit_intercept=True)).fit(X, y)
    >>> round(search.best_delay_, 3)
    0.1
    """

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict"]), None],
        "nk": ["array-like", None],
        "criterion": [StrOptions({"one_step", "vaf"})],
        "cv": ["cv_object"],
        "scoring": [VAFScorer, None],
        "window": [Interval(Real, 0, None, closed="neither"), None],
        "step": [Interval(Real, 0, None, closed="neither"), None],
    }

    def __init__(
        self,
        estimator: Any = None,
        nk: Any = None,
        *,
        criterion: str = "one_step",
        cv: Any = None,
        scoring: VAFScorer | None = None,
        window: float | None = None,
        step: float | None = None,
    ) -> None:
        self.estimator = estimator
        self.nk = nk
        self.criterion = criterion
        self.cv = cv
        self.scoring = scoring
        self.window = window
        self.step = step

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None, **params: Any) -> DelaySearchCV:
        """Search the delay and refit the best model.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Output.
        groups : array-like of shape (n_rows,) or None, default=None
            Group of each row, as in ``GridSearchCV``: what ``cv`` keeps together, and what
            ``cv=None`` leaves out one at a time. Groups consist of whole runs. None uses the runs.
        **params : dict
            Anything else that ``cv`` requests, if metadata routing is enabled.

        Returns
        -------
        self : DelaySearchCV
        """
        if self.window is not None and self.criterion != "one_step":
            raise ValueError("window= needs criterion='one_step'.")
        estimator = ARXRegressor() if self.estimator is None else clone(self.estimator)
        table = CandidateTable(estimator, X, y)
        routed = self._routed(X, raw_layout(estimator, X), groups, params)
        self.dt_ = table.dt
        candidates = self._candidates(table.shortest_run)
        fast = has_fast_path(estimator)
        if fast:
            table.set_candidates([{"nk": nk} for nk in candidates])
        together = fast
        if self.criterion == "vaf":
            validation = Validation(estimator, X, y, table.known, self.scoring or VAFScorer())
            validation.split(self.cv, routed)
            together = fast and validation.goes_by_runs_of(table)
        context = self._init_callback_context(max_subtasks=1 if together else 1 + len(candidates))
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        if self.window is not None:
            if not fast:
                raise ValueError("window= needs an ARXRegressor with method='ols'.")
            self._slide(table, candidates)
        results: dict[str, Any] = {"nk": candidates, "delay": self._seconds(candidates)}
        if self.criterion == "one_step":
            if fast:
                self.loss_ = _one_step_losses(table, table.whole())
            else:
                self.loss_ = self._generic_one_step(estimator, X, y, candidates, context)
        else:
            if together:
                scores = _score_together(table, validation)
            else:
                scores = self._score_refitted(estimator, X, y, candidates, validation, context)
            for i, column in enumerate(scores.T):
                results[f"split{i}_test_score"] = column
            results["mean_test_score"] = scores.mean(axis=1)
            results["std_test_score"] = scores.std(axis=1)
            self.loss_ = 100.0 - results["mean_test_score"]
        if np.all(np.isnan(self.loss_)):
            with_orders(estimator, nk=candidates[0]).fit(X, y)  # raises the error with its cause
            raise ValueError("Every candidate delay leaves linearly dependent regressors.")
        self.best_index_ = int(np.nanargmin(self.loss_))
        self.best_nk_ = candidates[self.best_index_]
        self.best_delay_ = results["delay"][self.best_index_]
        self.cv_results_ = results | {"loss": self.loss_}
        self._vaf_name = vaf_name(centered=getattr(self.scoring, "centered", False))
        if self.criterion == "vaf":
            self.best_score_ = 100.0 - float(self.loss_[self.best_index_])
        del table  # which holds what the refit reads again
        refit = context.subcontext(task_name="refit")
        refit.call_on_fit_task_begin(estimator=self, X=X, y=y)
        self.best_estimator_ = with_orders(estimator, nk=self.best_nk_).fit(X, y)
        refit.call_on_fit_task_end(estimator=self, X=X, y=y)
        self._keep_names()
        context.call_on_fit_task_end(estimator=self, X=X, y=y)
        return self

    def _found(self) -> tuple[str, TextTable]:
        results, nk = self.cv_results_, self.cv_results_["nk"]
        seconds = [_delay_text(delay, number) for delay in results["delay"]]
        best = seconds[self.best_index_].strip("()")
        found = (
            f"DelaySearchCV: nk = {_delay_text(self.best_nk_)} ({best} s) is the best of "
            f"{len(nk)} candidates, {_delay_text(nk[0])} to {_delay_text(nk[-1])}, by "
        )
        header = ["nk", "delay (s)"]
        if "mean_test_score" not in results:
            found += "the mean squared error one step ahead."
            shown, caption = lowest(self.loss_), "Lowest losses"
            header += ["loss", "over the best"]
            least = max(self.loss_[self.best_index_], 1e-300)
            cells = [[f"{x:.5g}", f"{100 * (x / least - 1):.2f} %"] for x in self.loss_]
        else:
            found += f"cross-validated {self._vaf_name} of the free run, {self.best_score_:.1f} %."
            vaf = results["mean_test_score"]
            shown, caption = highest(vaf, standard_error_over_folds(results, self.best_index_))
            header += ["VAF (%)"]
            cells = [[f"{v:.2f}"] for v in vaf]
        rows = [[_delay_text(nk[i]), seconds[i], *cells[i]] for i in shown]
        return found, TextTable(caption, header, rows)

    def _candidates(self, shortest_run: int) -> list[Any]:
        if self.nk is not None:
            return _as_candidates(self.nk)
        limit = max(1, min(N_CANDIDATES, shortest_run // 4))
        return list(range(1, limit + 1))

    def _seconds(self, candidates: list[Any]) -> list[Any]:
        return [
            tuple(k * self.dt_ for k in nk) if isinstance(nk, tuple) else nk * self.dt_
            for nk in candidates
        ]

    def _generic_one_step(
        self, estimator: Any, X: Any, y: Any, candidates: list[Any], context: Any
    ) -> np.ndarray:
        """One-step errors of models fitted one by one, on the rows that all of them can predict."""
        errors: list[np.ndarray | None] = []
        for nk in candidates:
            task = context.subcontext(task_name="candidate").call_on_fit_task_begin(estimator=self)
            try:
                model, passed_on = reach_model(with_orders(estimator, nk=nk).fit(X, y), X)
                errors.append(model._one_step_errors(passed_on, y))
            except RankDeficiencyError:
                errors.append(None)
            task.call_on_fit_task_end(estimator=self)
        known = np.logical_and.reduce([~np.isnan(e) for e in errors if e is not None])
        return np.array([np.nan if e is None else np.mean(e[known] ** 2) for e in errors])

    def _score_refitted(
        self,
        estimator: Any,
        X: Any,
        y: Any,
        candidates: list[Any],
        validation: Validation,
        context: Any,
    ) -> np.ndarray:
        scores = np.empty((len(candidates), len(validation.folds)))
        for i, nk in enumerate(candidates):
            task = context.subcontext(task_name="candidate").call_on_fit_task_begin(estimator=self)
            model = with_orders(estimator, nk=nk)
            for j, fold in enumerate(validation.folds):
                scores[i, j], _ = validation.score_refitted(model, X, y, fold)
            task.call_on_fit_task_end(estimator=self)
        return scores

    def _slide(self, table: CandidateTable, candidates: list[Any]) -> None:
        assert self.window is not None
        step = self.step if self.step is not None else self.window / 4
        first, last = table.time_span()
        last += self.dt_
        n_windows = np.floor((last - first - self.window) / step + 1e-6) + 1
        if n_windows > MOST_WINDOWS:
            raise ValueError(
                f"window={self.window:g} s with step={step:g} s makes {n_windows:.3g} windows; "
                f"the limit is {MOST_WINDOWS}. Give a longer window= or step=, in seconds."
            )
        n_windows = int(n_windows)
        if n_windows < 1:
            raise ValueError(
                f"window={self.window:g} s is longer than the {last - first:g} s of data that "
                "have known lags."
            )
        begin = first + step * np.arange(n_windows)
        self.window_time_ = begin + self.window / 2
        losses = np.full((n_windows, len(candidates)), np.nan)
        slack = 1e-6 * self.dt_
        for i, start in enumerate((begin - slack).tolist()):
            part = table.between(start, start + self.window)
            if part.n_rows > len(part.R):
                losses[i] = _one_step_losses(table, part)
        self.loss_path_ = losses
        some = ~np.isnan(losses).all(axis=1)
        values = np.array([np.max(nk) for nk in candidates], dtype=float)
        self.nk_path_ = np.full(n_windows, np.nan)
        self.nk_path_[some] = values[np.nanargmin(losses[some], axis=1)]
        self.delay_path_ = self.nk_path_ * self.dt_


def _delay_text(value: Any, form: Any = str) -> str:
    """A delay, or those of several inputs."""
    return f"({', '.join(map(form, value))})" if isinstance(value, tuple) else str(form(value))


def _as_candidates(nk: Any) -> list[Any]:
    candidates = [as_candidate("nk", value) for value in nk]
    if not candidates:
        raise ValueError("nk is empty; give at least one candidate, or None for 1 to 50.")
    return candidates


def _one_step_losses(table: CandidateTable, triangle: Triangle) -> np.ndarray:
    """Mean squared one-step errors of all candidates on the same rows (Eq. 24)."""
    return np.array([table.one_step_loss(triangle, orders) for orders in table.orders])


def _score_together(table: CandidateTable, validation: Validation) -> np.ndarray:
    """VAF of candidates (rows) on folds."""
    parts, _ = table.triangles([fold.train for fold in validation.folds])
    models = table.fitted(parts)
    scores = [validation.score_together(table, models, part)[0] for part in range(len(parts))]
    return np.array(scores).T
