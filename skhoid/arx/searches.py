"""DelaySearchCV and OrderSearchCV: the delay, orders and decimation factor of an ARX model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from numbers import Integral, Real
from typing import Any, Self

import numpy as np
from scipy.stats import rankdata, sem
from sklearn.base import clone
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.utils.validation import check_is_fitted

from .._sklearn import (
    BaseSearchCV,
    FittedDisplay,
    HasMethods,
    Interval,
    StrOptions,
    fit_context,
    with_callbacks,
)
from ..metrics import VAFScorer
from ..pipelines import final_step, raw_layout, reach_model, taken_apart
from ..preprocessing import Decimator, RunInTrimmer
from ..preprocessing.base import RemembersParameters, as_fitted
from ..text import Summary, TextTable, number, vaf_name, wrapped
from .base import longest_stretches
from .candidates import (
    CandidateTable,
    Evaluated,
    Validation,
    as_candidate,
    evaluated,
    has_fast_path,
    with_orders,
)
from .folds import Fold, SplitsRuns
from .model_summary import one_or_all
from .orders import whole_number

N_SHOWN = 5
MOST_WINDOWS = 1_000_000
N_CANDIDATES = 50
DEFAULT_ORDERS = (1, 2, 3, 4)
PENALTY = 3.0  # weight of the complexity in the modified BIC (Drop et al. 2018)

Evaluate = Callable[[Any, Callable[[CandidateTable], list[dict[str, Any]]], str], Evaluated]


class ModelSearch(RemembersParameters, SplitsRuns, FittedDisplay, BaseSearchCV):
    """scikit-learn's search, with an evaluation of its own: only ``fit`` differs.

    ``BaseSearchCV.fit`` fits each candidate anew to a copy of each fold's rows. Here candidates are
    compared on the same rows, which the longest lags of all leave, share one factorisation of each
    run, and may be judged without folds.
    """

    criterion: str
    n_jobs: Any = None
    refit = True
    multimetric_ = False

    def _run_search(self, evaluate_candidates: Evaluate, variants: dict[Any, Any]) -> Any:
        """Evaluate candidates of each variant, set ``cv_results_``, return the best unfitted."""
        raise NotImplementedError

    def _variants(self, estimator: Any) -> dict[Any, Any]:
        """Clones of the estimator by decimation factor."""
        return {None: estimator}

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None, **params: Any) -> Self:
        """Evaluate all candidates and refit the best model.

        Parameters
        ----------
        {X, y, groups}
        **params : dict
            Anything else that ``cv`` requests, if metadata routing is enabled.

        Returns
        -------
        self : estimator
        """
        variants = self._variants(clone(self.estimator))
        context = self._init_callback_context(max_subtasks=len(variants) + 1)
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        routed: dict[str, Any] | None = None
        folds: list[Fold] | None = None
        self.scorer_ = self.scoring or VAFScorer()

        def evaluate_candidates(
            variant: Any, candidates: Callable[[CandidateTable], list[dict[str, Any]]], what: str
        ) -> Evaluated:
            nonlocal routed, folds
            task = context.subcontext(task_name=what, max_subtasks=1)
            task.call_on_fit_task_begin(estimator=self, X=X, y=y)
            table = CandidateTable(variant, X, y)
            if routed is None:
                routed = self._routed(X, raw_layout(variant, X), groups, params)
            table.set_candidates(candidates(table), check=has_fast_path(variant))
            validation = None
            if self.criterion == "vaf":
                validation = Validation(variant, X, y, table.known, self.scorer_)
                if folds is None:
                    folds = validation.split(self.cv, routed)
                validation.folds = folds
            if self.criterion == "impulse":
                nothing = np.empty((len(table.candidates), 0))
                losses = table.impulse_losses()
                found = Evaluated(table, (X, y), losses, nothing, 0, nothing, nothing)
            else:
                found = evaluated(variant, X, y, table, validation, self.n_jobs)
            task.call_on_fit_task_end(estimator=self, X=X, y=y)
            return found

        best = self._run_search(evaluate_candidates, variants)
        if self.criterion == "vaf":
            self._doubt_best(self.best_score_)
        self.n_splits_ = len(folds or [])
        refit = context.subcontext(task_name="refit")
        refit.call_on_fit_task_begin(estimator=self, X=X, y=y)
        self.best_estimator_ = best.fit(X, y)
        refit.call_on_fit_task_end(estimator=self, X=X, y=y)
        self.keep_parameters()
        if hasattr(self.best_estimator_, "feature_names_in_"):
            self.feature_names_in_ = self.best_estimator_.feature_names_in_
        context.call_on_fit_task_end(estimator=self, X=X, y=y)
        return self

    @property
    def _vaf_name(self) -> str:
        return vaf_name(centered=self.scorer_.centered)

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
        check_is_fitted(self)
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
        return model.summary_table().html(self._found()[0])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


class DelaySearchCV(ModelSearch):
    """Find the input delay of an ARX model.

    Every candidate ``nk`` is fitted on the same rows, and the one with the lowest loss is refitted.

    Parameters
    ----------
    estimator : ARXRegressor or Pipeline that ends in one
        Model whose ``nk`` is searched; its other parameters are kept.
    nk : sequence of int, or of one tuple per input, or None, default=None
        Candidates, in samples of the grid the model is fitted on. An int is the delay of every
        input. None means 1 to 50, but at most a quarter of the shortest run.
    criterion : {"one_step", "impulse", "vaf"}, default="one_step"
        ``"one_step"`` is the mean squared one-step prediction error on all rows (Eq. 24, with the
        square that is missing in print). ``"impulse"`` is how unlikely it is (-2 ln of the marginal
        likelihood, per row) that an impulse response of any smooth form begins at the delay: noise
        on the output and low orders do not lead it astray. ``"vaf"`` is 100 minus the VAF of the
        free run, by folds.
    {folds, scoring}
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
    best_params_ : dict
        ``{"nk": best_nk_}``.
    best_score_ : float
        Its cross-validated VAF in percent; with ``criterion="one_step"`` minus its loss.
    {of_search_, of_folds_}
    loss_ : ndarray of shape (n_candidates,)
        Loss of each candidate; NaN where its regressors are linearly dependent.
    cv_results_ : dict
        Columns ``params``, ``nk``, ``delay`` (s), ``loss``, and for ``"vaf"`` ``mean_test_score``,
        ``std_test_score``, ``rank_test_score`` and ``split<i>_test_score``.
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
    {n_features_in_, feature_names_in_}

    Notes
    -----
    For :class:`ARXRegressor` with ``method="ols"`` all candidates come from one QR factorisation.
    The two criteria can differ: with coloured remnant the one-step loss is biased towards other
    delays (Fig. 9 of the thesis). White noise on the output of an open loop leads it astray too, by
    two samples at 10 to 30 % of noise, and ``"impulse"`` hardly (rms 0 to 1.2 samples); in a
    person's loop ``"impulse"`` is 1.6 samples of 0.02 s early, where the one-step loss is 1 late.
    For progress, call
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
        "estimator": [HasMethods(["fit", "predict"])],
        "nk": ["array-like", None],
        "criterion": [StrOptions({"one_step", "impulse", "vaf"})],
        "cv": ["cv_object"],
        "scoring": [VAFScorer, None],
        "window": [Interval(Real, 0, None, closed="neither"), None],
        "step": [Interval(Real, 0, None, closed="neither"), None],
    }

    def __init__(
        self,
        estimator: Any,
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

    def _run_search(self, evaluate_candidates: Evaluate, variants: dict[Any, Any]) -> Any:
        if self.window is not None and self.criterion != "one_step":
            raise ValueError("window= needs criterion='one_step'.")
        [estimator] = variants.values()
        found = evaluate_candidates(estimator, self._candidates, "delays")
        self.dt_ = found.table.dt
        if self.window is not None:
            if not has_fast_path(estimator):
                raise ValueError("window= needs an ARXRegressor with method='ols'.")
            self._slide(found.table)
        candidates = [one["nk"] for one in found.candidates]
        seconds = [
            tuple(k * self.dt_ for k in nk) if isinstance(nk, tuple) else nk * self.dt_
            for nk in candidates
        ]
        results: dict[str, Any] = {"params": found.candidates, "nk": candidates, "delay": seconds}
        by_vaf = self.criterion == "vaf"
        if by_vaf:
            results |= _scored(found.scores)
        loss = 100.0 - results["mean_test_score"] if by_vaf else found.losses
        self.loss_: np.ndarray = loss
        self.cv_results_ = results | {"loss": self.loss_}
        if np.all(np.isnan(self.loss_)):
            with_orders(estimator, nk=candidates[0]).fit(*found.data)  # the error has its cause
            raise ValueError("Every candidate delay leaves linearly dependent regressors.")
        self.best_index_ = int(np.nanargmin(self.loss_))
        self.best_params_ = found.candidates[self.best_index_]
        self.best_nk_ = self.best_params_["nk"]
        self.best_delay_ = seconds[self.best_index_]
        self.best_score_ = float((100.0 if by_vaf else 0.0) - self.loss_[self.best_index_])
        return with_orders(estimator, **self.best_params_)

    def _candidates(self, table: CandidateTable) -> list[dict[str, Any]]:
        if self.nk is None:
            shortest_run = int(longest_stretches(table.grid).min())
            delays = list(range(1, max(1, min(N_CANDIDATES, shortest_run // 4)) + 1))
        else:
            delays = [as_candidate("nk", value) for value in self.nk]
        if not delays:
            raise ValueError("nk is empty; give at least one candidate, or None for 1 to 50.")
        return [{"nk": nk} for nk in delays]

    def _slide(self, table: CandidateTable) -> None:
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
        losses = np.full((n_windows, len(table.candidates)), np.nan)
        slack = 1e-6 * self.dt_
        for i, start in enumerate((begin - slack).tolist()):
            part = table.between(start, start + self.window)
            if part.n_rows > len(part.R):
                losses[i] = table.one_step_losses(part)
        self.loss_path_ = losses
        some = ~np.isnan(losses).all(axis=1)
        values = np.array([np.max(one["nk"]) for one in table.candidates], dtype=float)
        self.nk_path_ = np.full(n_windows, np.nan)
        self.nk_path_[some] = values[np.nanargmin(losses[some], axis=1)]
        self.delay_path_ = self.nk_path_ * self.dt_

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
            found += (
                "the likelihood of an impulse response that begins there."
                if as_fitted(self).criterion == "impulse"
                else "the mean squared error one step ahead."
            )
            shown, caption = lowest(self.loss_), "Lowest losses"
            header += ["loss", "over the best"]
            least = max(self.loss_[self.best_index_], 1e-300)
            cells = [[f"{x:.5g}", f"{100 * (x / least - 1):.2f} %"] for x in self.loss_]
            if as_fitted(self).criterion == "impulse":  # a logarithm
                best_loss = self.loss_[self.best_index_]
                cells = [[f"{x:.5g}", f"{x - best_loss:.3g}"] for x in self.loss_]
        else:
            found += f"cross-validated {self._vaf_name} of the free run, {self.best_score_:.1f} %."
            vaf = results["mean_test_score"]
            shown, caption = highest(vaf, standard_error_over_folds(results, self.best_index_))
            header += ["VAF (%)"]
            cells = [[f"{v:.2f}"] for v in vaf]
        rows = [[_delay_text(nk[i]), seconds[i], *cells[i]] for i in shown]
        return found, TextTable(caption, header, rows)


class OrderSearchCV(ModelSearch):
    """Choose the orders of an ARX model by cross-validated VAF or by an information criterion.

    All combinations of ``na``, ``nb``, ``nk`` and decimation factor are fitted and simulated; the
    smallest model that is not clearly worse than the best is refitted.

    Parameters
    ----------
    estimator : ARXRegressor or Pipeline that ends in one
        Model whose orders are searched.
    na, nb : sequence of int or None, default=None
        Candidates; None means 1 to 4. Entries of ``nb`` may be tuples, one number per input.
    nk : sequence of int, dict or None, default=None
        Candidate delays in samples of the model's grid, or one such sequence per decimation
        factor, ``{1: range(1, 51), 2: range(1, 26)}``. None keeps the estimator's own, which
        must be 0 where there are several factors.
    factor : sequence of int or None, default=None
        Candidate decimation factors; they are set in the pipeline's :class:`Decimator`, or one is
        added in front. None keeps the estimator's own.
    criterion : {"vaf", "bic", "mbic"}, default="vaf"
        Cross-validated VAF of the free run at full rate; the Bayesian information criterion ln V +
        p ln(N) / N of the one-step errors; or the same with three times the second term. The last
        two only compare models with the same decimation factor, and simulate nothing.
    rule : {"one_standard_error", "best"}, default="one_standard_error"
        With ``"vaf"``, take the model with the fewest parameters (then the highest VAF) among
        those within one standard error of the best, or the best itself.
    {folds, scoring}
    n_jobs : int or None, default=None
        Threads over folds; over candidates that do not share a factorisation.

    Attributes
    ----------
    best_params_ : dict
        Chosen ``na``, ``nb``, ``nk`` and ``factor``.
    best_na_, best_nb_, best_nk_, best_factor_ : int
        The same, one by one.
    best_delay_ : float
        ``best_nk_`` in seconds.
    best_score_ : float
        Mean cross-validated VAF of the chosen model in percent; else minus its criterion.
    {of_search_, of_folds_}
    cv_results_ : dict
        One entry per candidate: ``params``, ``param_na``, ``param_nb``, ``param_nk``,
        ``param_factor``, ``n_params``, ``delay`` (s), ``bic``, ``mbic``, and for ``"vaf"``
        ``split<i>_test_score``, ``mean_test_score``, ``std_test_score``, ``rank_test_score``. NaN
        for candidates whose regressors are linearly dependent.
    standard_error_ : float
        For ``"vaf"``: standard error of the best VAF, over folds or, with a single fold, over eight
        blocks of its rows.
    best_estimator_ : estimator
        The chosen model refitted on all data.
    {n_features_in_, feature_names_in_}

    Notes
    -----
    Candidates of one decimation factor are compared on the same rows. For :class:`ARXRegressor`
    with ``method="ols"`` all come from one QR factorisation of each run: the time grows with the
    number of rows, whatever the number of runs and folds. For progress, call
    ``search.set_callbacks(sklearn.callback.ProgressBar())`` before ``fit``.

    References
    ----------
    Van Grootheest, thesis, Section 5.2.2, Figs. 5.12 and C.1-C.12, Tables 5.2 and 5.3. Drop et al.,
    Objective model selection for identifying the human feedforward response in manual control,
    IEEE Transactions on Cybernetics 48 (2018): modified BIC.

    Examples
    --------
    >>> from skhoid import ARXRegressor, OrderSearchCV, load_human_tracking
    >>> X, y = load_human_tracking(1)
    >>> search = OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[1, 2], nk=[6, 7, 8]).fit(X, y)
    >>> sorted(search.best_params_)
    ['factor', 'na', 'nb', 'nk']

    With several people, leave one out at a time; ``groups`` says whose run each row belongs to:

    >>> import numpy as np
    >>> from skhoid import make_tracking_runs, run_labels
    >>> X, y = make_tracking_runs(n_runs=4, duration=10.24, sampling_rate=50, random_state=0)
    >>> people = np.array(["Ann", "Ann", "Bob", "Cleo"])[run_labels(X) - 1]
    >>> search = OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[2], nk=[15])
    >>> search = search.fit(X, y, groups=people)
    >>> [key for key in search.cv_results_ if key.startswith("split")]
    ['split0_test_score', 'split1_test_score', 'split2_test_score']
    """

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict"])],
        "na": ["array-like", None],
        "nb": ["array-like", None],
        "nk": ["array-like", dict, None],
        "factor": ["array-like", None],
        "criterion": [StrOptions({"vaf", "bic", "mbic"})],
        "rule": [StrOptions({"one_standard_error", "best"})],
        "cv": ["cv_object"],
        "scoring": [VAFScorer, None],
        "n_jobs": [Integral, None],
    }

    def __init__(
        self,
        estimator: Any,
        *,
        na: Any = None,
        nb: Any = None,
        nk: Any = None,
        factor: Any = None,
        criterion: str = "vaf",
        rule: str = "one_standard_error",
        cv: Any = None,
        scoring: VAFScorer | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.estimator = estimator
        self.na = na
        self.nb = nb
        self.nk = nk
        self.factor = factor
        self.criterion = criterion
        self.rule = rule
        self.cv = cv
        self.scoring = scoring
        self.n_jobs = n_jobs

    def _run_search(self, evaluate_candidates: Evaluate, variants: dict[Any, Any]) -> Any:
        if self.criterion != "vaf" and len(variants) > 1:
            raise ValueError(
                f"criterion={self.criterion!r} uses one-step errors, whose size depends on the "
                "sampling rate, so it cannot compare decimation factors. Use criterion='vaf'."
            )
        parts = {
            factor: evaluate_candidates(
                variant,
                partial(self._candidates, variant, factor),
                f"factor {factor}",
            )
            for factor, variant in variants.items()
        }
        params = [{**c, "factor": d} for d, part in parts.items() for c in part.candidates]
        results: dict[str, Any] = {"params": params}
        for name in ("na", "nb", "nk", "factor"):
            results[f"param_{name}"] = np.empty(len(params), dtype=object)
            results[f"param_{name}"][:] = [one[name] for one in params]
        found = list(parts.values())
        results["n_params"] = np.concatenate([part.n_params for part in found])
        results["delay"] = np.concatenate(
            [[np.max(c["nk"]) * part.table.dt for c in part.candidates] for part in found]
        )
        complexity = np.concatenate(
            [part.n_params * np.log(part.n_rows) / part.n_rows for part in found]
        )
        with np.errstate(divide="ignore"):
            fit = np.log(np.concatenate([part.losses for part in found]))
        results["bic"], results["mbic"] = fit + complexity, fit + PENALTY * complexity
        if self.criterion == "vaf":
            results |= _scored(np.vstack([part.scores for part in found]))
        self.cv_results_ = results
        self._choose(np.concatenate([part.within for part in found]))
        chosen = dict(self.best_params_)
        return with_orders(variants[chosen.pop("factor")], **chosen)

    def _choose(self, within: np.ndarray) -> None:
        """Choose a candidate; ``within`` are standard errors on each fold."""
        results, by_vaf = self.cv_results_, self.criterion == "vaf"
        values = results["mean_test_score"] if by_vaf else -results[self.criterion]
        if np.all(np.isnan(values)):
            raise ValueError(
                "No candidate could be fitted: the regressors of all are linearly dependent. Fit "
                "one with ARXRegressor to see the cause."
            )
        self.best_index_ = best = int(np.nanargmax(values))
        self.standard_error_ = np.nan
        if by_vaf:
            splits = [v[best] for k, v in results.items() if k.startswith("split")]
            self.standard_error_ = float(sem(splits) if len(splits) > 1 else within[best, 0])
            if self.rule == "one_standard_error":
                good = np.flatnonzero(values >= values[best] - np.nan_to_num(self.standard_error_))
                self.best_index_ = int(
                    min(good, key=lambda i: (results["n_params"][i], -values[i]))
                )
        self.best_score_ = float(values[self.best_index_])
        self.best_params_ = results["params"][self.best_index_]
        self.best_na_ = self.best_params_["na"]
        self.best_nb_ = self.best_params_["nb"]
        self.best_nk_ = self.best_params_["nk"]
        self.best_factor_ = self.best_params_["factor"]
        self.best_delay_ = float(results["delay"][self.best_index_])

    def _variants(self, estimator: Any) -> dict[Any, Any]:
        """Clones of the estimator, one per decimation factor."""
        steps = estimator.steps if isinstance(estimator, Pipeline) else []
        names = [name for name, step in steps if isinstance(step, Decimator)]
        if self.factor is None:
            return {estimator.named_steps[names[0]].factor if names else 1: clone(estimator)}
        if len(self.factor) == 0:
            raise ValueError("factor is empty; give at least one decimation factor.")
        if not names:
            known: dict[str, Any] = {
                n: getattr(steps[0][1] if steps else estimator, n, None) for n in ("dt", "run")
            }
            # After the run-in is trimmed, so that the filter works on the measurement window.
            place = max(
                (i + 1 for i, (_, step) in enumerate(steps) if isinstance(step, RunInTrimmer)),
                default=0,
            )
            if not steps:
                steps = make_pipeline(estimator).steps
            estimator = Pipeline(
                [*steps[:place], ("decimator", Decimator(**known)), *steps[place:]]
            )
            names = ["decimator"]
        return {
            d: clone(estimator).set_params(**{f"{names[0]}__factor": d})
            for d in (whole_number("factor", d, 1) for d in self.factor)
        }

    def _candidates(self, variant: Any, factor: int, _: CandidateTable) -> list[dict[str, Any]]:
        if isinstance(self.nk, Mapping) and factor not in self.nk:
            raise ValueError(
                f"nk has no candidates for factor {factor}; it names the factors {list(self.nk)}."
            )
        nk = self.nk[factor] if isinstance(self.nk, Mapping) else self.nk
        if nk is None:
            nk = [final_step(variant)[1].nk]
            if self.factor is not None and len(self.factor) > 1 and np.max(nk) > 0:
                raise ValueError(
                    f"The estimator's nk={nk[0]} is in samples of the model's grid, so it is a "
                    "different delay at each decimation factor. Give "
                    "nk={factor: candidates, ...}, or put a DelayShift into the pipeline and "
                    "leave nk at 0."
                )
        grids = {
            "na": DEFAULT_ORDERS if self.na is None else self.na,
            "nb": DEFAULT_ORDERS if self.nb is None else self.nb,
            "nk": nk,
        }
        for name, values in grids.items():
            if len(values) == 0:
                raise ValueError(f"{name} is empty; give at least one candidate.")
        return [
            dict(zip(grids, map(as_candidate, grids, values), strict=True))
            for values in product(*grids.values())
        ]

    def _found(self) -> tuple[str, TextTable]:
        results = self.cv_results_
        chosen = ", ".join(f"{name} = {value}" for name, value in self.best_params_.items())
        told = as_fitted(self)
        criterion, rule = told.criterion, told.rule
        if criterion == "vaf":
            vaf = results["mean_test_score"]
            shown, caption = highest(vaf, self.standard_error_)
            by = "by the highest VAF"
            if rule == "one_standard_error":
                by = "as the smallest within one standard error of the highest VAF"
            by += f". Its cross-validated {self._vaf_name} is {self.best_score_:.1f} %"
        else:
            shown, caption = lowest(results[criterion]), f"Lowest {criterion.upper()}"
            by = f"by the lowest {criterion.upper()}"
        if self.best_index_ not in shown:
            shown = np.append(shown, self.best_index_)
        found = f"OrderSearchCV: {chosen}, chosen from {len(results['params'])} candidates {by}."
        rows = [
            [
                *(one_or_all(np.atleast_1d(v)) for v in results["params"][i].values()),
                f"{results['n_params'][i]:.0f}",
                f"{results['delay'][i]:.4g}",
                *([f"{vaf[i]:.2f}"] if criterion == "vaf" else []),
                f"{results['bic'][i]:.4f}",
                "chosen" if i == self.best_index_ else "",
            ]
            for i in shown
        ]
        scores = ["VAF (%)"] if criterion == "vaf" else []
        header = [*self.best_params_, "parameters", "delay (s)", *scores, "BIC / n", ""]
        return found, TextTable(caption, header, rows)


def standard_error_over_folds(results: dict[str, Any], index: int) -> float:
    """Standard error over folds of the mean VAF of a candidate; NaN of a single fold."""
    n_folds = sum(key.startswith("split") and key.endswith("_test_score") for key in results)
    return float(results["std_test_score"][index] / np.sqrt(n_folds - 1)) if n_folds > 1 else np.nan


def highest(vaf: np.ndarray, error: float) -> tuple[np.ndarray, str]:
    """The candidates to show, best first, and a caption with the standard error of the best."""
    caption = "Highest VAF"
    if np.isfinite(error):
        near = int(np.sum(vaf >= np.nanmax(vaf) - error))
        caption += (
            f" ({near} of {vaf.size} within one standard error, {error:.2g} points, of the best)"
        )
    return lowest(-vaf), caption


def lowest(loss: np.ndarray) -> np.ndarray:
    """The candidates to show, best first, without those that could not be fitted."""
    order = np.argsort(loss)[:N_SHOWN]
    return order[~np.isnan(loss[order])]


def _delay_text(value: Any, form: Any = str) -> str:
    """A delay, or those of several inputs."""
    return f"({', '.join(map(form, value))})" if isinstance(value, tuple) else str(form(value))


def _scored(scores: np.ndarray) -> dict[str, Any]:
    """Columns of the scores of candidates (rows) on folds."""
    table: dict[str, Any] = {}
    for i, column in enumerate(scores.T):
        table[f"split{i}_test_score"] = column
    mean = scores.mean(axis=1)
    table["mean_test_score"] = mean
    table["std_test_score"] = scores.std(axis=1)
    table["rank_test_score"] = rankdata(
        np.where(np.isnan(mean), np.inf, -mean), method="min"
    ).astype(int)
    return table
