"""``EffectSearchCV``: the search for missing effects, as a scikit-learn estimator."""

from __future__ import annotations

from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.callback import CallbackSupportMixin, with_callbacks
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from .._sklearn import FittedDisplay, Interval, StrOptions, fit_context
from ..arx.folds import SplitsRuns, folds_of
from ..effects.base import Effect
from ..effects.catalogue import BY_NAME, CLASSES
from ..effects.composition import Effects
from ..human import ELEMENT
from ..model.estimator import delay_notes
from ..model.fitting import MOST_ROWS, some_runs
from ..model.parameters import difference_notes, parameter_text
from ..model.prepared import Prepared
from ..model.simulated_arx import simulated_model
from ..preprocessing.base import as_fitted, keep_parameters
from ..preprocessing.gate import as_output, as_table
from ..recordings.loss_of_control import CHOICES, LEAVE_OUT, notes_of_lost
from ..regression import RunRegressor, units_of
from ..runs.fingerprint import fingerprint
from ..runs.roles import role_of
from ..text import ModelSummary, Summary, estimates_table
from .all_runs import AllRuns, Held, held_columns
from .estimators import Estimators
from .explanations import (
    changes_sentences,
    experiments,
    headline_of,
    summary_of,
    unexplained_by,
    untried_notes,
)
from .explores import ExploredByHand, remember
from .judges import HeldOutRows
from .left_out import control_of, without_rows
from .leftover import SearchNumbers, numbers_of
from .path import GivenDelay, Path, Progress, Search, forward, pair_of, with_given_delay
from .results import error_path, held_out_table, ranking_table, short_ranking, unexplained_table
from .shape import fitted_shape, shaped, told_shape
from .sketch import SketchesEffects
from .started import Started
from .statuses import Ending, Verdict

GUARD = 5.0  # s beside held-out blocks of a single run
MOST_FOLDS = 20  # of a search in some of very many runs


class EffectSearchCV(
    ExploredByHand,
    SketchesEffects,
    SplitsRuns,
    FittedDisplay,
    CallbackSupportMixin,
    MetaEstimatorMixin,
    RegressorMixin,
    BaseEstimator,
):
    """Find the physical effects that a model is missing, judged on held-out runs.

    Every effect of a catalogue is added to the model in turn, and all parameters are refitted
    together in simulation. An effect counts when both criteria are met: by likelihood, ΔBIC = n
    log(SSE before / after) - k log n > 25; by free run, a gain of at least 0.2 points of VAF (about
    the mean) on held-out rows. Where the controlled element is known, the best effect must also
    help in the **closed loop**, where target and disturbance are the inputs and the model's output
    moves x and e: there, remnant that returns in the error cannot pass for a response. For
    nonlinear effects, or where the loop cannot be solved, a jointly estimated noise model decides.
    The effect must also simulate held-out rows better when refitted without them, its numbers must
    not end at a bound, and it must not rebuild the output from x. Then it is added, and the search
    continues until no effect meets all criteria; effects that no longer meet them once others are
    added are removed.

    Parameters
    ----------
    estimator : OperatorRegressor, ARXRegressor or other SimulatedModel
        The model, unfitted; effects that it already has stay. For what a model of your own needs,
        see :class:`skhoid.model.SimulatedModel`.
    effects : "all", list of ids or effects, Effect or Effects, default="all"
        Effects to try, which may include your own.
    cv : cross-validation generator, iterable of splits, int or None, default=None
        Rows to hold out. None leaves out one run at a time or, with a single run, three blocks with
        guards of 5 s on either side.
    display : {"compensatory", "pursuit", "preview"} or None, default=None
        What the operator could see; it decides how effects are described, not how they rank. None
        means unknown.
    controlled_element : ControlledElement, LinearElement, str, system or None, default=None
        What the operator controls: ``"1/(s(s+1))"``, say, or a transfer function of SciPy or
        python-control. None estimates it from u and x where both are measured.
    max_effects : int, default=4
        Maximum number of effects to add.
    n_jobs : int or None, default=None
        Number of processes that try effects; None means 1, -1 all processors. The result does not
        depend on it.
    domain : {"human", "machine"} or None, default=None
        What was recorded. It decides the wording and which effects are tried: dry friction or a
        sensor that shows the magnitude are for machines. None means "human" for an
        OperatorRegressor, and for an ARX model that responds to the error, the target or x of a
        loop.
    lost_control : {"leave_out", "keep"}, default="leave_out"
        What to do with stretches in which control was lost, found in the error by the rule of
        :func:`skhoid.lost_control`: leave them out of fits and of held-out rows, or keep them like
        all other rows. Not used with ``domain="machine"``.
    max_rows : int or None, default=200_000
        Maximum number of rows in which to look for effects, in whole runs spread evenly over the
        data; None uses all. Parameters, standard errors, likelihood and VAF of the models found are
        those of all rows.

    Attributes
    ----------
    ranking_ : DataFrame
        One row per step and effect, best first: step, rank, effect (its id), title, form, status
        ("added", "not better", "does not apply"), vaf_gain (points, held out), delta_bic (larger is
        better; one noise model for all candidates), p_value (of the likelihood ratio, times the
        number of effects tried), gain_loop and delta_bic_loop (the same in the closed loop; NaN
        where not evaluated), delta_bic_joint (with a jointly estimated noise model; NaN for an ARX
        model, for effects without a gain, and far behind the best), parameters (with standard
        errors and units), reason_code and reason (why it was not added: a
        :class:`skhoid.search.Reason`, and words), words, confused_with, vaf_before (held
        out, refitted for each fold, of the first step as in ``error_path_``), vaf_after (its sum
        with vaf_gain), delta_loglik, n_parameters. :meth:`ranking_table` is the short form.
    best_effects_ : list of str
        Ids in the order added; empty when nothing is missing. ``"unknown"`` at the end means
        structure that none of the effects tried explains; on its own, it means that the effects
        which explain part of it, ``stand_ins_``, explain too little to be named.
    stand_ins_ : list of str
        Ids of effects in ``best_estimator_`` that explain part of what is missing, but too little
        to name it; otherwise empty.
    shape_ : Shape or None
        What the data show of an effect without a name: place, curve with a band, what it explains,
        and the named effects that are nearest. None where nothing is missing, all has a name, or no
        free form explains it.
    verdict_ : Verdict
        ``NOTHING`` (is missing), effects ``FOUND``, or what ``"unknown"`` at the end of
        ``best_effects_`` means: ``NOT_IN_CATALOGUE`` if all of it was tried; ``NOT_TRIED`` if
        ``effects`` is only part of it; ``CUT_SHORT`` (by max_effects) if the search ended while
        effects still helped. See :class:`skhoid.search.Verdict`; ``str()`` of it is a sentence.
    error_path_ : DataFrame
        One row per step, starting with the baseline: effect (the id that was added), model (all its
        effects so far, in words), vaf and rmse (held out, each fold refitted), vaf_loop (in the
        closed loop; NaN where it is not known), vaf_train, ceiling (one number for all steps, from
        the part of the best model's residual that does not repeat; NaN where it is not known),
        explainable_gap (points left to explain).
    predictions_ : DataFrame
        Held-out free runs: measured, baseline, and one column per effect added; NaN in rows that
        are left out.
    baseline_, best_estimator_ : estimator
        The model without and with the effects, fitted to all rows.
    explainable_gap_ : float
        Points of VAF that a better model can gain over the baseline: what the effects found gain on
        held-out rows, plus the largest structure in ``unexplained_``. Like ``ceiling`` it depends
        on the best model, and so on the effects tried; VAF and RMSE of the baseline do not.
    unexplained_ : DataFrame
        Structure left at the end: where (time, frequency, amplitude, channel, or "repeats" for what
        is the same in all runs), at, description, points, delta_bic.
    ceiling_note_ : str
        Why the ceiling is not known; empty if it is.
    experiments_ : list of str
        What to record to tell apart effects that these data cannot.
    left_out_ : DataFrame
        Stretches left out because control was lost: run, from and to (s in the run), times (the
        error, as a multiple of its usual size), reason.
    searched_runs_ : list
        Labels of the runs in which effects were looked for: all, or up to ``max_rows`` rows.
        ``ranking_``, ``unexplained_`` and the VAF in the closed loop refer to these.
    notes_ : list of str
        Further sentences of the summary: in which runs effects were looked for; which other
        parameters change together with the gains; a delay at its lower bound; both estimates of
        parameters on which likelihood and simulation error disagree; what is left out.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    See Also
    --------
    compare : Where a model and measurements differ.

    Notes
    -----
    Candidates are compared on held-out rows with parameters for each fold, one Gauss-Newton step
    from those of all rows; effects that are named are refitted for each fold. A ``delay`` given to
    the estimator is a claim: effects are named by a search with a free delay, and ``wrong_delay``
    says whether the data also refute the given one. Since e = f_t - x, responses to f_t, x and e
    without delays are the same; delays, and the controlled element's inverse in the feedforward
    path, tell them apart.

    For progress, call ``search.set_callbacks(sklearn.callback.ProgressBar())`` before ``fit``.

    Examples
    --------
    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(condition="C1", n_runs=3, remnant_intensity=0.1, random_state=0)
    >>> y = y.clip(-0.1, 0.1)  # a stop
    >>> search = EffectSearchCV(OperatorRegressor(), effects=["dead_zone", "bias", "saturation"])
    >>> search.fit(X, y).best_effects_
    ['saturation']
    """

    _parameter_constraints: dict = {
        "estimator": "no_validation",  # see fit
        "effects": [StrOptions({"all"}), list, tuple, str, Effect, Effects],
        "cv": ["cv_object"],
        "display": [StrOptions({"compensatory", "pursuit", "preview"}), None],
        "controlled_element": ELEMENT,
        "max_effects": [Interval(Integral, 0, None, closed="left")],
        "n_jobs": [Integral, None],
        "domain": [StrOptions({"human", "machine"}), None],
        "lost_control": [StrOptions({*CHOICES})],
        "max_rows": [Interval(Integral, 1, None, closed="left"), None],
    }

    def __init__(
        self,
        estimator: Any,
        effects: Any = "all",
        cv: Any = None,
        display: str | None = None,
        controlled_element: Any = None,
        *,
        max_effects: int = 4,
        n_jobs: int | None = None,
        domain: str | None = None,
        lost_control: str = LEAVE_OUT,
        max_rows: int | None = MOST_ROWS,
    ):
        self.estimator = estimator
        self.effects = effects
        self.cv = cv
        self.display = display
        self.controlled_element = controlled_element
        self.max_effects = max_effects
        self.n_jobs = n_jobs
        self.domain = domain
        self.lost_control = lost_control
        self.max_rows = max_rows

    @with_callbacks
    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None, **params: Any) -> EffectSearchCV:
        """Run the search.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output.
        groups : array-like of shape (n_rows,) or None, default=None
            Group of each row, as in ``GridSearchCV``: what ``cv`` keeps together, and what
            ``cv=None`` leaves out one at a time. Each consists of whole runs. None means one group
            per run.
        **params : dict
            Other metadata that ``cv`` requests, with metadata routing enabled.

        Returns
        -------
        self : EffectSearchCV

        Raises
        ------
        TypeError
            If the estimator is not a model that simulates effects; the message says what it lacks.
        """
        model = clone(simulated_model(self.estimator, "EffectSearchCV"))
        keep_parameters(self)
        context = self._init_callback_context(max_subtasks=None)  # steps until none helps
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        remember(self, X, y)
        X = as_table(X)
        with threadpool_limits(1):  # small products, which threads only slow down
            started = self._started(model, X, y, groups, params)
            prepared, lost = started.prepared, started.lost
            control, known, some = started.control, started.known, started.some
            self._control = control
            search = Search(
                prepared.core,
                started.record,
                self._candidates(),
                started.folds,
                self.n_jobs,
                Progress(self, context),
            )
            measured = as_output(y)
            kept = np.where(known, measured, np.nan)
            estimators = Estimators(model)
            found, ending, best = self._searched(search, estimators, prepared, kept, started.held)
            if len(found.path.model.effects):  # choices made, numbers to be estimated
                best.set_params(effects=found.path.model.effects)
            self.best_estimator_ = best
            self.baseline_ = estimators.of(prepared, found.path.steps[0].plain)
            self._conclude(ending)
            self.left_out_ = control.table
            self._tell_searched(prepared, some)
            self._tabulate(found, prepared)
        index = X.index if isinstance(X, pd.DataFrame) else None
        left_out = lost | (~prepared.known & ~np.isnan(measured))
        self.predictions_ = held_out_table(found, prepared, measured, left_out, index)
        unit = units_of(y).get(str(getattr(y, "name", None)))
        if unit:
            self.predictions_.attrs["units"] = {"measured": unit}
        self._fingerprint = fingerprint(X)
        self.n_features_in_ = model.n_features_in_
        if hasattr(model, "feature_names_in_"):
            self.feature_names_in_ = model.feature_names_in_
        context.call_on_fit_task_end(estimator=self, X=X, y=y)
        return self

    def _started(self, model: Any, X: Any, y: Any, groups: Any, params: dict[str, Any]) -> Started:
        """The model and its data, without stretches in which control was lost, and the folds."""
        if self.controlled_element is not None:
            model.set_params(controlled_element=self.controlled_element)
        prepared = in_domain(model.prepare(X, y), self.domain, getattr(model, "roles", None))
        control = control_of(model, X, self.lost_control, self.domain)
        layout = prepared.grid.layout
        lost = control.rows(layout.n_rows)
        prepared = without_rows(prepared, lost, model.settling)
        routed = self._routed(X, layout, groups, params)
        known = prepared.known & ~lost
        some = None if self.max_rows is None else some_runs(prepared.record, self.max_rows)
        record = prepared.record if some is None else prepared.record.part(some, 1)
        folds, held = self._folds(prepared, known, routed, some)
        return Started(model, prepared, control, lost, known, some, record, folds, held)

    def _searched(
        self,
        search: Search,
        estimators: Estimators,
        prepared: Prepared,
        measured: np.ndarray,
        held: list[Held],
    ) -> tuple[SearchNumbers, Ending, Any]:
        """What a search finds, the verdict, and the best model; ``measured`` is y.

        With a delay that was given, names and what is left are those of a free one, unless that
        alone is found and one effect beside the given delay explains clearly more.
        """
        recorded = search.record.y
        assert recorded is not None
        model = estimators.model
        fitted = model.first_fit(replace(prepared, record=search.record))
        most = int(self.max_effects)
        quiet = search.quiet(fitted) if most else None
        if quiet is not None:
            held = held or [held_columns(fold.test) for fold in search.folds]
            search, fitted = quiet, model.first_fit(replace(prepared, record=quiet.record))
        of_all = search.record is prepared.record

        def numbers(search: Search, prepared: Prepared, path: Path) -> tuple[SearchNumbers, Any]:
            best = estimators.of(prepared, path.model if path.added else path.steps[0].plain)
            all_runs = None if of_all else AllRuns(prepared.record, held)
            return numbers_of(search, path, best, prepared, measured, recorded, all_runs), best

        def with_its_delay() -> tuple[SearchNumbers, Ending, Any]:
            found, best = numbers(search, prepared, forward(search, fitted, most))
            ended = shaped(search, found, tries_all=self._tries_all())
            alone = ended.ending.best_effects == ["unknown"] and ended.shape is None
            both = pair_of(search, found.path, most) if alone else None
            if both is not None:
                together, of_both = numbers(search, prepared, both)
                again = shaped(search, together, tries_all=self._tries_all())
                if again.ending.named:
                    ended, best = again, of_both
            self.shape_ = fitted_shape(ended, model, prepared, measured)
            return ended.found, ended.ending, best

        given = GivenDelay.of(search, fitted) if most else None
        if given is None:
            return with_its_delay()
        freed, beside, baseline = given.freed(prepared, model)
        more = most + len(baseline.effects) - len(fitted.effects)
        free, _ = numbers(beside, freed, forward(beside, baseline, more))
        ended = shaped(beside, free, tries_all=self._tries_all())
        free = ended.found
        path = given.tested(free.path)
        if given.stands(path):
            return with_its_delay()
        self.shape_ = fitted_shape(ended, model, freed, measured)
        found, best = numbers(search, prepared, path)
        found = replace(found, left=free.left, noises=free.noises, changes=free.changes)
        return found, with_given_delay(ended.ending, free.path, path), best

    def _conclude(self, ending: Ending) -> None:
        self.best_effects_ = ending.best_effects
        self.stand_ins_ = ending.stand_ins
        self.verdict_: Verdict = ending.verdict

    def _tell_searched(self, prepared: Prepared, some: np.ndarray | None) -> None:
        labels, run_of = prepared.grid.layout.labels, prepared.run_of_columns
        runs = np.unique(run_of if some is None else run_of[some])
        self.searched_runs_ = [labels[run] for run in runs]
        self._where_searched = []
        if some is not None:
            known = prepared.record.known.sum(axis=0)
            self._where_searched = [
                f"effects were looked for in {runs.size:,} of {len(labels):,} runs, with "
                f"{known[some].sum():,} of {known.sum():,} rows. Parameters, likelihood and VAF "
                "of the models are those of all runs. max_rows=None looks for effects in all runs"
            ]

    def _tabulate(self, found: SearchNumbers, prepared: Prepared) -> None:
        self.unexplained_ = unexplained_table(found.left)
        self.explainable_gap_ = found.explainable_gap
        self.error_path_ = error_path(found, prepared)
        self.ceiling_note_ = found.no_ceiling if np.isnan(found.ceiling) else ""
        self.ranking_ = ranking_table(found, prepared, self.display)
        self.notes_ = self._where_searched + changes_sentences(found.changes)
        if self.max_effects:
            self.notes_ += untried_notes(self._candidates(), self.ranking_)
        best = self.best_estimator_
        self.notes_ += delay_notes(best.parameters_, getattr(prepared.core, "least", 0.0))
        if hasattr(best, "simulation_parameters_"):  # an operator
            self.notes_ += difference_notes(best.parameters_, best.simulation_parameters_)
        self.notes_ += [note.with_hint for note in notes_of_lost(self.left_out_)]
        self.experiments_ = experiments(self.ranking_)

    def _candidates(self) -> list[Effect]:
        if isinstance(self.effects, str) and self.effects == "all":
            return [c() for c in CLASSES]
        return [e for _, e in Effects.of(self.effects)]

    def _tries_all(self) -> bool:
        return BY_NAME.keys() <= {effect.name for effect in self._candidates()}

    def _folds(
        self,
        prepared: Prepared,
        rows_known: np.ndarray,
        routed: dict[str, Any],
        some: np.ndarray | None,
    ) -> tuple[list[HeldOutRows], list[Held]]:
        """Rows to hold out and to fit on, in ``some`` columns; and what is held out in all."""
        record, columns, known = prepared.record, prepared.columns, prepared.record.known
        groups = routed["groups"]
        run_of = prepared.run_of_columns
        if some is not None:
            known, run_of = known[:, some], run_of[some]
        runs = np.unique(run_of[known.any(axis=0)])
        if self.cv is None and groups is None and runs.size > 1:
            parts = runs if some is None else np.array_split(runs, min(MOST_FOLDS, runs.size))
            tests = [known & np.isin(run_of, part) for part in parts]
            folds = [HeldOutRows(t, known & ~t) for t in tests]
            return folds, [] if some is None else [held_columns(t, some) for t in tests]
        if self.cv is None and groups is None:
            return _blocks(known, round(GUARD / record.dt)), []
        folds, held = [], []
        for fold in folds_of(prepared.grid.layout, self.cv, routed, rows_known):
            rows = prepared.grid.thin_inputs(fold.test.mask())
            whole = columns.beside(rows, fill=False) & record.known
            test = whole if some is None else whole[:, some]
            if test.any():
                folds.append(HeldOutRows(test, known & ~test))
                if some is not None:
                    held.append(held_columns(whole))
        return folds, held

    def ranking_table(self, n: int = 5, step: int | None = None) -> pd.DataFrame:
        """The best candidates of each step, in a few readable columns.

        Parameters
        ----------
        n : int, default=5
            Maximum number of candidates per step.
        step : int or None, default=None
            One step; None means all.

        Returns
        -------
        table : DataFrame
            Texts, by step and rank: effect, gain (points of held-out VAF), ΔBIC, p, outcome (added,
            or why not), parameters.
        """
        check_is_fitted(self)
        return short_ranking(self.ranking_, n, step)

    def summary(self) -> Summary:
        """The search in plain sentences: verdict, steps, errors, what to record next.

        Returns
        -------
        text : Summary
            A string that notebooks show line by line.
        """
        check_is_fitted(self)
        final = self.best_estimator_.parameters_
        texts = [parameter_text(final, name) for name in self.error_path_["effect"]]
        text = summary_of(
            self.error_path_.assign(parameters=texts),
            self.ranking_,
            self.best_effects_,
            self.stand_ins_,
            self.verdict_,
            as_fitted(self).max_effects,
            self.ceiling_note_,
            self.unexplained_,
            told_shape(self.best_effects_, self.shape_),
            self.experiments_ + self.notes_,
        )
        return Summary(text)

    def _headline(self) -> str:
        """The verdict in one sentence."""
        rest = unexplained_by(self.verdict_, self.ranking_, as_fitted(self).max_effects)
        return headline_of(
            self.error_path_, self.best_effects_, self.stand_ins_, self.verdict_, rest
        )

    def _found_html(self) -> str:
        found = f"EffectSearchCV. {self._headline()}"
        best = self.best_estimator_
        if isinstance(best, RunRegressor):
            return best._summary().html(found)
        return ModelSummary(type(best).__name__, {}, estimates_table(best.parameters_), []).html(
            found
        )

    def predict(self, X: Any) -> np.ndarray:
        """Free run of the best model.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.

        Returns
        -------
        y_pred : ndarray of shape (n_rows,)
        """
        check_is_fitted(self)
        return self.best_estimator_.predict(X)

    def score(self, X: Any, y: Any) -> float:
        """VAF of the free run of the best model, in percent.

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
        check_is_fitted(self)
        return self.best_estimator_.score(X, y)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


def in_domain(prepared: Prepared, domain: str | None, roles: Any) -> Prepared:
    """The data with their domain: the given one, or the one that core and roles imply."""
    record = prepared.record
    if domain is None:
        own = role_of(record.inputs[0], roles)
        loop = {"x", "f_t"} & {*prepared.roles.values()}
        answers = own in ("x", "f_t") or (own == "e" and bool(loop))
        domain = "human" if record.core.is_operator or answers else "machine"
    return replace(prepared, record=replace(record, domain=domain))


def _blocks(known: np.ndarray, guard: int) -> list[HeldOutRows]:
    """Three contiguous blocks of one run, with guards that are neither fitted nor held out."""
    folds = []
    rows = np.flatnonzero(known.any(axis=1))
    for block in np.array_split(rows, 3):
        test, train = np.zeros_like(known), known.copy()
        test[block] = known[block]
        train[max(block[0] - guard, 0) : block[-1] + guard + 1] = False
        folds.append(HeldOutRows(test, train))
    return folds
