"""RecursiveARXCV: the memory horizon of a recursive ARX model, chosen on validation runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from numbers import Integral
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from .. import _kernels
from .._sklearn import CallbackSupportMixin, fit_context, with_callbacks
from ..exceptions import RunCutWarning
from ..metrics import VAFScorer, scored_rows, scored_signals, vaf_of_sums
from ..text import ModelSummary, TextTable, number, vaf_name
from .base import BOUND
from .folds import SplitsRuns, make_folds
from .forgetting import Forgetting, kernel_arrays, read_forgetting
from .recursive import RecursiveLeastSquares
from .rls import RecursionData, RecursionState, kernel_regressors, recurse
from .searches import highest, standard_error_over_folds

HORIZONS = (*(2.0**i for i in range(1, 14)), np.inf)  # Table V


class RecursiveARXCV(SplitsRuns, CallbackSupportMixin, RecursiveLeastSquares):
    """Recursive ARX model whose memory horizon is chosen on validation runs.

    All horizons are estimated in one pass over the data of each fold, and the free run along each
    path is scored on the runs left out (Fig. 13 of the thesis). The best horizon is then fitted on
    all runs.

    Parameters
    ----------
    memory_horizons : sequence of float or of one per parameter, or None, default=None
        N0 in samples of the fitted grid; an entry such as ``(inf, inf, 256, 256)`` is a Λ. None
        means 2, 4, ... 8192 and infinity.
    {orders, inputs, fit_intercept}
    init, init_window, p0
        As for :class:`RecursiveARX`.
    cv : int, splitter, iterable or None, default=None
        Folds of whole runs; None leaves out one run at a time. To train on one run and validate on
        the others, as the thesis does, use ``LeavePGroupsOut(n_runs - 1)``.
    scoring : VAFScorer or None, default=None
        How the VAF is computed: run-in, window (in the thesis that of the transition), average.
    n_jobs : int or None, default=None
        Threads for the folds.
    {roles, dt, run}

    Attributes
    ----------
    best_memory_horizon_ : float or tuple
        The entry with the highest mean VAF on validation runs.
    best_score_ : float
        That VAF in percent.
    best_index_ : int
        Its position in ``cv_results_``.
    cv_results_ : dict
        For each entry ``memory_horizon``, ``forgetting`` (λ), ``mean_test_score``,
        ``std_test_score``, ``split<i>_test_score``, the same for ``train``, ``gain`` over the last
        infinite horizon (Eqs. 31-32; NaN without one), ``std_gain`` over splits,
        ``overfit_difference`` and ``overfit_ratio`` of the VAF on training and on validation runs
        (Eqs. J.1-J.4). VAF is
        unclipped, at least -1000.
    n_runs_pooled_ : int
        Runs estimated together in each fold (the smallest number). The best horizon is for that
        many runs; more runs leave less noise, which favours shorter horizons.

    See Also
    --------
    skhoid.plotting.MemoryHorizonDisplay : Plots the trade-off.

    Notes
    -----
    ``GridSearchCV`` over ``memory_horizon`` of a :class:`RecursiveARX` gives the same scores.
    Other attributes are those of :class:`RecursiveARX`. For progress, call
    ``search.set_callbacks(sklearn.callback.ProgressBar())`` before ``fit``.

    Runs with one forcing function share more than the operator: a path with very short memory can
    learn the response to that particular function, and then fails on any other. If the best horizon
    is surprisingly short, validate on runs with another target.

    Examples
    --------
    >>> from skhoid import RecursiveARXCV, VAFScorer, make_tracking_runs
    >>> X, y = make_tracking_runs("C4", n_runs=4, remnant_intensity=0.1, random_state=0)
    >>> search = RecursiveARXCV(
    ...     [16, 64, 256, 1024, float("inf")], nk=29, scoring=VAFScorer(window=(30.72, 51.2))
    ... ).fit(X, y)
    >>> search.best_memory_horizon_, search.n_runs_pooled_
    (64.0, 3)
    """

    store_covariance = False

    _parameter_constraints: dict = {
        **RecursiveLeastSquares._parameter_constraints,
        "memory_horizons": "no_validation",
        "cv": ["cv_object"],
        "scoring": [VAFScorer, None],
        "n_jobs": [Integral, None],
    }

    def __init__(
        self,
        memory_horizons: Any = None,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        fit_intercept: bool = False,
        init: Any = "ols",
        init_window: float = 30.72,
        p0: Any = None,
        cv: Any = None,
        scoring: VAFScorer | None = None,
        n_jobs: int | None = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.memory_horizons = memory_horizons
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.init = init
        self.init_window = init_window
        self.p0 = p0
        self.cv = cv
        self.scoring = scoring
        self.n_jobs = n_jobs
        self.roles = roles
        self.dt = dt
        self.run = run

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, groups: Any = None, **params: Any) -> RecursiveARXCV:
        """Score all memory horizons, and fit the best one on all runs.

        Parameters
        ----------
        {X, y, groups}
        **params : dict
            Anything else that ``cv`` requests, if metadata routing is enabled.

        Returns
        -------
        self : RecursiveARXCV

        Raises
        ------
        ValueError
            If there is only one run, or a fold cuts a run.
        """
        data = self._read_recursion(X, y)
        settings = self._settings(data)
        routed = self._routed(X, data.grid.layout, groups, params)
        validation = _HorizonScores(
            data,
            self._hold(data.grid, data.inputs)[:],
            self._read_y(X, y),
            self.scoring or VAFScorer(),
            self._start,
        )
        folds = self._folds(validation, routed)
        context = self._init_callback_context(max_subtasks=len(folds) + 1)
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        scored = []
        in_turn = Parallel(n_jobs=self.n_jobs, prefer="threads", return_as="generator")(
            delayed(validation.scores)(runs, settings) for runs in folds
        )
        for of_fold in in_turn:
            scored.append(of_fold)
            self._tell_part(context, f"fold {len(scored)}")
        self.n_runs_pooled_ = min(len(train) for train, _ in folds)
        self._set_results(settings, np.array(scored))
        self._doubt_best(self.best_score_)
        self._fit_recursion(data, settings[self.best_index_])
        self._tell_part(context, "refit")
        context.call_on_fit_task_end(estimator=self, X=X, y=y)
        return self

    def _tell_part(self, context: Any, part: str) -> None:
        """Tell callbacks that a part of the fit is done."""
        task = context.subcontext(task_name=part)
        task.call_on_fit_task_begin(estimator=self)
        task.call_on_fit_task_end(estimator=self)

    def _settings(self, data: RecursionData) -> list[Forgetting]:
        entries: tuple[Any, ...] = HORIZONS
        if self.memory_horizons is not None:
            if not np.iterable(self.memory_horizons):
                raise ValueError(
                    f"memory_horizons must be a sequence of horizons; got {self.memory_horizons!r}."
                )
            entries = tuple(self.memory_horizons)
        if not entries:
            raise ValueError("memory_horizons is empty; give at least one, or None for 2 ... 8192.")
        if any(entry is None or isinstance(entry, str) for entry in entries):
            raise ValueError(
                "memory_horizons must hold numbers of samples, or tuples of one per parameter; got "
                f"{list(entries)}."
            )
        self._entries: list[Any] = [tuple(e) if np.ndim(e) else float(e) for e in entries]
        return [
            read_forgetting(
                None,
                entry,
                None,
                form="joint",
                n_params=self.orders_.n_params,
                time=data.instants.time,
                dt=self.dt_,
            )
            for entry in self._entries
        ]

    def _folds(
        self, validation: _HorizonScores, routed: dict[str, Any]
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Numbers of the runs to train on and to validate on."""
        layout, run = validation.data.grid.layout, validation.run
        some = np.bincount(run, validation.known) > 0
        if some.sum() == 1:
            raise ValueError(
                "RecursiveARXCV validates on other runs, but X has only one"
                f"{'' if some.size == 1 else ' with measurements'}. For a single run use "
                "RecursiveARX(forgetting='auto'), which uses one-step predictions."
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RunCutWarning)
            folds = make_folds(layout, self.cv, routed, validation.known, validation.keep)
        if any(rows.cut for fold in folds for rows in fold):
            raise ValueError(
                f"The splits of cv={self.cv!r} take parts of runs, but a path over time cannot be "
                "scored within a run. Give whole runs, as LeaveOneGroupOut and GroupKFold do."
            )
        return [
            (np.flatnonzero(fold.train.whole & some), np.flatnonzero(fold.test.whole & some))
            for fold in folds
        ]

    def _set_results(self, settings: list[Forgetting], scores: np.ndarray) -> None:
        """Make the table, from scores of shape (n_folds, 2, n_settings): test and train."""
        test, train = scores.mean(axis=0)
        results: dict[str, Any] = {
            "memory_horizon": self._entries,
            "forgetting": [setting.value for setting in settings],
        }
        for kind, values in zip(("test", "train"), scores.swapaxes(0, 1), strict=True):
            for split, of_split in enumerate(values):
                results[f"split{split}_{kind}_score"] = of_split
            results[f"mean_{kind}_score"] = values.mean(axis=0)
            results[f"std_{kind}_score"] = values.std(axis=0)
        endless = [i for i, setting in enumerate(settings) if (setting.factors == 1.0).all()]
        results["gain"] = test - (test[endless[-1]] if endless else np.nan)
        gains = scores[:, 0] - (scores[:, 0, endless[-1:]] if endless else np.nan)
        results["std_gain"] = gains.std(axis=0)
        results["overfit_difference"] = train - test
        with np.errstate(divide="ignore", invalid="ignore"):
            results["overfit_ratio"] = np.where(test > 0, train / test, np.nan)
        self.cv_results_ = results
        self._vaf_name = vaf_name(centered=getattr(self.scoring, "centered", False))
        self.best_index_ = int(np.argmax(test))
        self.best_memory_horizon_ = self._entries[self.best_index_]
        self.best_score_ = float(test[self.best_index_])

    def summary_table(self) -> ModelSummary:
        results, vaf = self.cv_results_, self.cv_results_["mean_test_score"]
        shown, caption = highest(vaf, standard_error_over_folds(results, self.best_index_))
        header = ["N0 (samples)", "VAF (%)", "VAF, train (%)", "gain"]
        rows = [
            [
                str(self._entries[i]),
                *(number(results[key][i], 0.1) for key in ("mean_test_score", "mean_train_score")),
                number(results["gain"][i], 0.1),
            ]
            for i in shown
        ]
        found = super().summary_table()
        score = f"{self._vaf_name} {self.best_score_:.1f} %"
        searched = f"{len(vaf)} memory horizons, by cross-validated {score}"
        facts = {**found.facts, "Searched": searched}
        return replace(found, facts=facts, more=[TextTable(caption, header, rows), *found.more])

    def _read_forgetting(self, time: np.ndarray) -> Forgetting:
        return self._forgetting

    def _check_streaming(self) -> None:
        if not self.__sklearn_is_fitted__():
            raise ValueError(
                "RecursiveARXCV can stream only after fit, which chooses the memory horizon."
            )


class _HorizonScores:
    """Scores all settings on training and validation runs."""

    def __init__(
        self,
        data: RecursionData,
        inputs: np.ndarray,
        y: np.ndarray,
        scorer: VAFScorer,
        start: Callable[[RecursionData, np.ndarray], tuple[np.ndarray, np.ndarray]],
    ) -> None:
        """``inputs`` are those to simulate from; ``start`` gives theta0 and P0 of some runs."""
        self.data, self.y, self.scorer, self.start = data, y, scorer, start
        self.scorer.check_for_search()
        layout = data.grid.layout
        self.run = layout.run_of(np.arange(layout.n_rows))
        of_grid = self.run if data.grid.rows is None else self.run[data.grid.rows]
        some = np.bincount(of_grid, ~np.isnan(data.output), len(layout.labels)) > 0
        self.known = ~np.isnan(y) & some[self.run]
        self.keep = self.known & scored_rows(layout, self.scorer.run_in, self.scorer.window)
        signal, _, run = scored_signals(
            y, np.zeros(y.size), self.keep, layout, self.scorer.centered
        )
        self.power = np.bincount(run, signal**2, len(layout.labels))
        self.scored = np.bincount(run, minlength=len(layout.labels)) > 0
        self.signals = np.ones((data.signals.shape[0], data.inputs.shape[0]))
        self.signals[0] = np.nan  # no output is given to a free run
        self.signals[1 : 1 + inputs.shape[1]] = inputs.T

    def scores(self, runs: tuple[np.ndarray, np.ndarray], settings: list[Forgetting]) -> np.ndarray:
        """VAF on validation and on training runs, of shape (2, n_settings)."""
        train, test = runs
        data = self.data
        start = self.start(data, train)
        signals = np.ascontiguousarray(data.signals[:, :, train])
        target = np.ascontiguousarray(data.target[:, train])
        known = data.instants.of_row[np.isin(data.instants.run, train)]
        at = np.maximum(data.instants.of_row, known.min())
        scores = np.empty((2, len(settings)))
        lanes = _kernels.rls.MANY
        for first in range(0, len(settings), lanes):
            block = settings[first : first + lanes]
            wide = max(setting.factors.shape[1] for setting in block)
            factors = np.ones((1, wide, lanes))
            for lane, setting in enumerate(block):
                factors[:, :, lane] = setting.factors
            paths = recurse(
                RecursionState(*start, lanes), signals, target, data.orders, block[0],
                inflation=kernel_arrays(factors), keep=("theta",),
            )  # fmt: skip
            for kind, chosen in enumerate((test, train)):
                vaf = self._vaf(paths.theta, at, chosen)
                scores[kind, first : first + lanes] = vaf[: len(block)]
        return scores

    def _vaf(self, paths: np.ndarray, at: np.ndarray, runs: np.ndarray) -> np.ndarray:
        """VAF of the free runs, row t with ``paths[at[t]]``, of shape (n_params, lanes)."""
        grid, orders, lanes = self.data.grid, self.data.orders, paths.shape[2]
        regressors = kernel_regressors(orders)
        free = np.zeros((self.signals.shape[1], lanes))
        for run in runs:
            chosen = self.data.instants.run[grid.begin] == run
            begin, end, past = grid.begin[chosen], grid.end[chosen], grid.past[chosen]
            out = free[begin[0] : end[-1]]
            _kernels.rls.free_runs(
                self.signals, *regressors, orders.na, begin, end, past, paths, at, BOUND, out
            )
        if grid.rows is not None:
            lines = (grid.to_full_rate(np.ascontiguousarray(lane)) for lane in free.T)
            free = np.stack(list(lines), axis=1)
        lost = np.zeros((len(self.power), lanes))
        for run, (first, last) in enumerate(pairwise(grid.layout.run_starts.tolist())):
            if run in runs:
                error = free[first:last]
                error -= self.y[first:last, None]
                error[~self.keep[first:last]] = 0.0
                lost[run] = np.einsum("tj,tj->j", error, error)
        if np.isnan(lost).any():
            row = int(np.argmax(np.isnan(free).any(axis=1)))
            raise ValueError(f"The prediction is NaN in {grid.layout.where(row)}.")
        scored = self.scored & np.isin(np.arange(self.scored.size), runs)
        return np.atleast_1d(vaf_of_sums(lost, self.power, scored, self.scorer.average))
