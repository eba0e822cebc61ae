"""``EffectSearchCV``: the search for missing effects, as a scikit-learn estimator."""

from __future__ import annotations

import time
import weakref
from dataclasses import fields, replace
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.metrics import check_scoring
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from .._sklearn import (
    BaseSearchCV,
    FittedDisplay,
    Interval,
    StrOptions,
    fit_context,
    with_callbacks,
)
from ..arx.folds import SplitsRuns
from ..effects.base import Effect
from ..effects.catalogue import BY_NAME, CLASSES
from ..effects.composition import Effects
from ..effects.parameter import CoreKind
from ..human import ELEMENT
from ..model.estimator import GreyBox, delay_notes
from ..model.fitting import MOST_ROWS, Criterion, RemnantModel
from ..model.likelihood import likelihood_fit
from ..model.model import Model
from ..model.parameters import difference_notes
from ..model.prepared import Prepared
from ..model.simulated_arx import simulated_model
from ..preprocessing.base import RemembersParameters
from ..preprocessing.gate import as_output, as_table
from ..recordings.loss_of_control import CHOICES, LEAVE_OUT, notes_of_lost
from ..regression import units_of
from ..runs import fingerprint_of
from ..text import Note, Summary
from .data import SearchData, held_columns, prepare_data, refit_on_rows, split_data
from .judging import LEAST_GAIN
from .leftover import SearchNumbers, measure_path
from .limits import end_explained, find_limits
from .path import find_path
from .probability import find_chances
from .results import (
    SearchResult,
    compare_models,
    error_path,
    held_out_table,
    ranking_table,
    unexplained_table,
)
from .shape import Shape, find_unnamed, fit_shape
from .share import find_share
from .sketch import SketchesEffects
from .statuses import Ending, Verdict
from .steps import Progress, Search, output_error_fit
from .telling import (
    experiments_for,
    note_changes,
    note_left_out,
    note_more_runs,
    note_untried,
    short_ranking,
    tell_briefly,
    tell_search,
)

TRYING = (
    0.5  # of a time limit: judging what was tried takes as long at most, of a relay's 9,800 rows
)
NOT_KEPT = ("parameters", "max_effects")  # the best estimator has these, and the search itself

# Data of fits, for as long as others hold them: a search itself keeps none, and is small.
_DATA: weakref.WeakKeyDictionary[Any, tuple[Any, Any]] = weakref.WeakKeyDictionary()


# ``fit`` is its own: that of BaseSearchCV fits each candidate anew for each fold and ranks by one
# score. Here all candidates of a step share one fit of their parent, folds are one step from it,
# and several judges decide.
class EffectSearchCV(RemembersParameters, SketchesEffects, SplitsRuns, FittedDisplay, BaseSearchCV):
    """Find the physical effects that a model is missing, judged on held-out runs.

    Every effect of a catalogue is added to the model in turn, and all parameters are refitted
    together in simulation. Judges say what they grant it, in nats: the simulation of the measured
    error, a likelihood with a noise model of its own, and what is left along target and disturbance
    (instruments), which no remnant has. The least of these is its evidence; it must be more than
    12.5, and held-out rows must gain 0.2 points of VAF (about the mean). The best is added, and so
    on until no effect has that much; those that no longer have once others are added are removed.
    An effect that was added is named if it is as probable as ``confidence`` asks.

    Parameters
    ----------
    estimator : OperatorRegressor, ARXRegressor or other GreyBox
        The model, unfitted; effects that it already has stay. For what a model of your own needs,
        see :class:`skhoid.model.GreyBox`.
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
    confidence : float, default=0.75
        Least probability of a name that is given; effects that are less probable are possible ones,
        which stand in for what is missing.
    max_effects : int, default=4
        Maximum number of effects to add.
    n_jobs : int or None, default=None
        Number of processes that try effects; None means 1, -1 all processors. The result does not
        depend on it.
    domain : {"human", "machine"} or None, default=None
        What was recorded: it decides the wording and which effects are tried. A machine that an
        OperatorRegressor describes has a PI or PID controller. None means "human" for an
        OperatorRegressor, unless such a controller without delay explains the output far better
        than a person, and for an ARX model that responds to the error, the target or x.
    lost_control : {"leave_out", "keep"}, default="leave_out"
        What to do with stretches in which a person lost control (:func:`skhoid.lost_control`).
    max_rows : int or None, default=200_000
        Maximum number of rows in which to look for effects, in whole runs spread evenly over the
        data; None uses all. The models found are those of all rows.
    time_limit : float or None, default=None
        Seconds that ``fit`` may take, about. In the first half effects are tried; in the other the
        best model so far is judged and told. What was not tried has the status "not tried" in
        ``ranking_``, and a note lists it. None means as long as it takes.
    exhaustive : bool, default=False
        Whether every effect is fitted to the end in every step, also one that cannot become the
        best by what the first iterations gain. It is slow, and a check: the names are the same.

    Attributes
    ----------
    ranking_ : DataFrame
        One row per step and effect, best first: step, rank, effect (its id), title, form, beside
        (ids of the effects it was added to), status (a :class:`skhoid.search.Status`), vaf_gain
        (points, held out), evidence (the least that any judge grants, in nats), judge (who it is),
        probability (that the name is right), free_run, likelihood and instruments (evidence of
        these judges), delta_bic (of the free run), p_value (of its likelihood ratio, times the
        number of effects tried), parameters, reason_code and reason (why it was not added: a
        :class:`skhoid.search.Reason`, and words), words, confused_with, vaf_before, vaf_after. NaN
        is what was not evaluated.
        :meth:`ranking_table` is the short form.
    limits_ : DataFrame
        How large effects may be that were tried and are not named, one row each: effect (its id),
        title, parameter, unit, sense ("at most", or "at least" where it does nothing at infinity),
        limit (95 %, one-sided), limit_points (of VAF, what that size would gain), shown_from (the
        smallest size that such runs would have named in 90 % of cases), shown_points, and reason
        (why a number is NaN).
    best_effects_ : list of str
        Ids in the order added. ``"unknown"`` at the end means structure that none of the effects
        tried explains.
    stand_ins_ : list of str
        Ids of effects in ``best_estimator_`` that explain too little of it to be named.
    shape_ : Shape or None
        What the data show of an effect without a name.
    result_ : SearchResult
        All of it in one structure; ``as_dict()`` is for JSON.
    verdict_ : Verdict
        How it ended, see :class:`skhoid.search.Verdict`.
    error_path_ : DataFrame
        One row per step, starting with the baseline: effect (the id that was added), model (all its
        effects so far), vaf and rmse (held out, each fold refitted), vaf_loop (in the closed loop),
        vaf_train, ceiling (of the best model), explainable_gap (points left to explain).
    predictions_ : DataFrame
        Held-out free runs: measured, baseline, and one column per effect added; NaN in rows that
        are left out.
    baseline_, best_estimator_ : estimator
        The model without and with the effects, fitted to all rows.
    best_params_ : dict
        ``effects`` of ``best_estimator_``, with the choices of their forms.
    best_score_ : float
        VAF on held-out rows of that model, each fold refitted, in percent.
    cv_results_ : dict of ndarray
        As of GridSearchCV: params, param_effects, mean_test_score (the VAF of all held-out rows
        together, not a mean over folds), split0_test_score and so on (of each fold's rows; NaN of
        candidates that were not added), std_test_score, rank_test_score, and step. First the models
        of ``error_path_``, then candidates that were not added.
    best_index_ : int
        Of the best model there, which need not have rank 1: an effect needs evidence, too.
    n_splits_ : int
        Number of folds.
    scorer_ : callable
        ``scorer_(estimator, X, y)`` is the VAF in percent.
    control_ : ControlCheck
        Where control was lost.
    explainable_gap_ : float
        Points of VAF that a better model can gain over the baseline: what the effects found gain,
        plus the largest structure in ``unexplained_``.
    closed_ : Share
        What share of that gap the effects added close: value, low and high (95 %), and whether the
        gap reaches up to the noise ceiling (``of_ceiling``).
    unexplained_ : DataFrame
        Structure left at the end: where (time, frequency, amplitude, channel, "repeats" for what
        is the same in all runs, or "curved" for what follows target and disturbance in no
        proportion), at, description, points, delta_bic. Rows may be one and the same: each was
        looked for alone.
    ceiling_note_ : str
        Why the ceiling is not known; empty if it is.
    experiments_ : list of str
        What to record to tell apart effects that these data cannot.
    left_out_ : DataFrame
        Stretches left out because control was lost: run, from, to (s in the run), times, reason.
    searched_runs_ : list
        Labels of the runs in which effects were looked for.
    notes_ : list of Note
        Further remarks; ``str()`` of one is its text.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    See Also
    --------
    compare : Where a model and measurements differ.

    Notes
    -----
    A ``delay`` given to the estimator is a claim: effects are named by a search with a free delay,
    and ``wrong_delay`` says whether the data also refute the given one. For progress, call
    ``search.set_callbacks(sklearn.callback.ProgressBar())`` before ``fit``.

    Of ``GridSearchCV`` it has no ``param_grid`` (``effects`` says what is tried), ``scoring``
    (candidates are judged by evidence; give the search itself to ``cross_val_score``), ``refit``
    (``best_estimator_`` is always of all rows), ``error_score`` (what cannot be fitted is a row of
    ``ranking_``) and ``return_train_score`` (``error_path_`` has ``vaf_train``).

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
        "confidence": [Interval(Real, 0, 1, closed="both")],
        "max_effects": [Interval(Integral, 0, None, closed="left")],
        "n_jobs": [Integral, None],
        "domain": [StrOptions({"human", "machine"}), None],
        "lost_control": [StrOptions({*CHOICES})],
        "max_rows": [Interval(Integral, 1, None, closed="left"), None],
        "time_limit": [Interval(Real, 0, None, closed="neither"), None],
        "exhaustive": ["boolean"],
    }

    # What BaseSearchCV asks itself.
    refit = True
    scoring = None
    multimetric_ = False

    def __init__(
        self,
        estimator: Any,
        effects: Any = "all",
        cv: Any = None,
        display: str | None = None,
        controlled_element: Any = None,
        *,
        confidence: float = 0.75,
        max_effects: int = 4,
        n_jobs: int | None = None,
        domain: str | None = None,
        lost_control: str = LEAVE_OUT,
        max_rows: int | None = MOST_ROWS,
        time_limit: float | None = None,
        exhaustive: bool = False,
    ):
        self.estimator = estimator
        self.effects = effects
        self.cv = cv
        self.display = display
        self.controlled_element = controlled_element
        self.confidence = confidence
        self.max_effects = max_effects
        self.n_jobs = n_jobs
        self.domain = domain
        self.lost_control = lost_control
        self.max_rows = max_rows
        self.time_limit = time_limit
        self.exhaustive = exhaustive

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
        limit = np.inf if self.time_limit is None else float(self.time_limit)
        until = time.monotonic() + TRYING * limit
        model = clone(simulated_model(self.estimator, "EffectSearchCV"))
        self.keep_parameters()
        context = self._init_callback_context(max_subtasks=None)  # steps until none helps
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        _remember(self, X, y)
        X = as_table(X)
        with threadpool_limits(1):  # small products, which threads only slow down
            data = self.read_data(model, X, y, groups, params)
            core, effects = data.prepared.core, self.list_effects()
            progress = Progress(self, context)
            options = self.n_jobs, progress, until, self.exhaustive
            search = Search(core, data.record, effects, data.folds, *options)
            most, tries_all = int(self.max_effects), self.tries_all
            found = search_effects(search, model, data, as_output(y), most, tries_all)
            self.best_estimator_, self.baseline_ = found.best, found.baseline
            self.control_ = data.control
            by_fold = [data.score_folds(step.prediction) for step in found.numbers.steps]
            self._keep(self._result(found, data, X, y), by_fold)
        self._doubt_best(self.best_score_)
        self._fingerprint = fingerprint_of(X)
        if hasattr(model, "feature_names_in_"):
            self.feature_names_in_ = model.feature_names_in_
        context.call_on_fit_task_end(estimator=self, X=X, y=y)
        return self

    def read_data(
        self, model: Any, X: Any, y: Any, groups: Any = None, params: dict[str, Any] | None = None
    ) -> SearchData:
        """The data of a search and its folds, as ``fit`` takes them; for tools.

        Parameters
        ----------
        model : estimator
            A clone of ``estimator``, whose columns are taken from X.
        X, y : DataFrame and Series
            The recordings.
        groups : array-like or None, default=None
            As in ``fit``.
        params : dict or None, default=None
            Other metadata of ``fit``.

        Returns
        -------
        data : SearchData
        """
        if self.controlled_element is not None:
            model.set_params(controlled_element=self.controlled_element)
        prepared, control = prepare_data(
            model,
            X,
            y,
            domain="human" if self.domain is None and self.display else self.domain,
            lost_control=self.lost_control,
        )
        routed = self._routed(X, prepared.grid.layout, groups, params or {})
        return split_data(prepared, control, cv=self.cv, routed=routed, max_rows=self.max_rows)

    def _result(self, found: Found, data: SearchData, X: Any, y: Any) -> SearchResult:
        """What was found, as statuses, numbers and tables."""
        best, prepared, numbers = found.best, data.prepared, found.numbers
        measured = as_output(y)
        lost = data.control.rows(measured.size)
        left_out = lost | (~prepared.known & ~np.isnan(measured))
        index = X.index if isinstance(X, pd.DataFrame) else None
        predictions = held_out_table(numbers, prepared, measured, left_out, index)
        unit = units_of(y).get(str(getattr(y, "name", None)))
        if unit:
            predictions.attrs["units"] = {"measured": unit}
        ranking = ranking_table(numbers, prepared, self.display)
        path = error_path(numbers, prepared)
        last = path.iloc[-1]
        unknown = Verdict.beyond(self.tries_all and not numbers.path.ended_early)
        ending = name_if_sure(found.ending, numbers, self.confidence, unknown)
        ending = end_explained(ending, last["vaf"], last["ceiling"], numbers.share)
        notes = [*_note_searched(data), *_note_controller(data), *note_changes(numbers.changes)]
        n_runs = len(data.searched_runs)
        if ending.verdict is Verdict.POSSIBLE:
            notes += note_more_runs(numbers.path, ending.stand_ins, n_runs, self.confidence)
        if self.max_effects:
            notes += note_untried(self.list_effects(), ranking)
        notes += note_left_out(ranking, self.time_limit)
        least = getattr(prepared.core, "least", 0.0)
        notes += [Note("delay", text) for text in delay_notes(best.parameters_, least)]
        if hasattr(best, "simulation_parameters_"):  # an operator
            predicting = best.simulation_.predicting is not None
            differ = difference_notes(best.parameters_, best.simulation_parameters_, predicting)
            notes += [Note("two estimates", text) for text in differ]
        notes += notes_of_lost(data.control.table)
        return SearchResult(
            verdict=ending.verdict,
            best_effects=ending.best_effects,
            stand_ins=ending.stand_ins,
            ranking=ranking,
            limits=find_limits(numbers.path, self.list_effects(), prepared.units, self.confidence),
            error_path=path,
            predictions=predictions,
            unexplained=unexplained_table(numbers.left),
            left_out=data.control.table,
            parameters=best.parameters_,
            shape=found.shape,
            explainable_gap=numbers.explainable_gap,
            closed=find_share(numbers, prepared.record),
            ceiling_note=numbers.no_ceiling if np.isnan(numbers.ceiling) else "",
            experiments=experiments_for(ranking),
            notes=notes,
            searched_runs=data.searched_runs,
            max_effects=int(self.max_effects),
        )

    def _keep(self, result: SearchResult, by_fold: list[list[float]]) -> None:
        """Fitted attributes of a result, and scores of its models on what each fold holds out."""
        self.take_result(result, self.baseline_, self.best_estimator_)
        self.n_splits_ = len(by_fold[0])
        self.scorer_ = check_scoring(self.best_estimator_)
        self.cv_results_ = compare_models(result, self.best_estimator_.effects, by_fold)
        self.best_index_ = len(result.error_path) - 1
        self.best_params_ = self.cv_results_["params"][self.best_index_]
        self.best_score_ = float(self.cv_results_["mean_test_score"][self.best_index_])

    def take_result(self, result: SearchResult, baseline: Any, best: Any) -> EffectSearchCV:
        """Take what this search found earlier; for tools.

        It can then be told and drawn, and has no ``cv_results_``.

        Parameters
        ----------
        result : SearchResult
            What it found.
        baseline, best : estimator
            The models without and with the effects, fitted.

        Returns
        -------
        self : EffectSearchCV
        """
        self.result_, self.baseline_, self.best_estimator_ = result, baseline, best
        for field in fields(result):
            if field.name not in NOT_KEPT:
                setattr(self, f"{field.name}_", getattr(result, field.name))
        return self

    def list_effects(self) -> list[Effect]:
        """The effects that are tried.

        Returns
        -------
        effects : list of Effect
        """
        if isinstance(self.effects, str) and self.effects == "all":
            return [c() for c in CLASSES]
        return [e for _, e in Effects.of(self.effects)]

    @property
    def tries_all(self) -> bool:
        """Whether all effects of the catalogue are tried."""
        return BY_NAME.keys() <= {effect.name for effect in self.list_effects()}

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = tags.target_tags.required = True
        return tags

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
        return tell_search(self.result_).text()

    def plot(self, kind: str = "path", *, ax: Any = None, **options: Any) -> Any:
        """Draw the search, as :class:`skhoid.plotting.SearchDisplay` does.

        Parameters
        ----------
        kind : {"path", "steps", "ranking"}, default="path"
            The error at each step with the noise ceiling, simulations before and after, or the
            candidates of a step.
        ax : Axes, sequence of Axes or None, default=None
            Where to draw. None makes a figure.
        **options : dict
            Of :meth:`skhoid.plotting.SearchDisplay.from_estimator`.

        Returns
        -------
        display : SearchDisplay
        """
        check_is_fitted(self)
        from ..plotting import SearchDisplay

        return SearchDisplay.from_estimator(self, kind, ax=ax, **options)

    def explore(self, X: Any = None, y: Any = None) -> Any:
        """Try the effects by hand, in a notebook: add, move parameters, see the error fall.

        The widget shows measured and simulated output run by run, where in time, frequency and
        amplitude they differ, and the effects as cards with their parameters as sliders; the
        kernel computes.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns) or None, default=None
            The data of the fit; None takes those of ``fit``, if they are still in memory.
        y : Series or array of shape (n_rows,) or None, default=None
            Their measured output.

        Returns
        -------
        widget : anywidget.AnyWidget
            The last expression of a cell shows it. ``widget.exploration.model`` is the model as
            it was left.

        Raises
        ------
        ImportError
            Without anywidget: ``pip install "skhoid[notebook]"``.
        ValueError
            If the data of the fit are gone, or X and y are others.

        See Also
        --------
        skhoid.lab.report.report : A page with all combinations of the effects found.
        """
        check_is_fitted(self)
        from ..lab.explore import Exploration
        from ..lab.explore.component import of_exploration

        data = self._data_of_fit(X, y)
        return of_exploration(Exploration(self.estimator, *data, search=self).at_result())

    def _data_of_fit(self, X: Any, y: Any) -> tuple[Any, Any]:
        if (X is None) != (y is None):
            raise ValueError("Give both X and y, or none.")
        if X is not None:
            self.check_data(X, y)
            return X, y
        held = tuple(one() for one in _DATA.get(self, ()))
        if len(held) != 2 or any(one is None for one in held):
            raise ValueError(
                "The data that this search was fitted to are no longer in memory: pass them, "
                "search.explore(X, y)."
            )
        return held[0], held[1]

    def check_data(self, X: Any, y: Any) -> None:
        """Refuse data that the search was not fitted to.

        Parameters
        ----------
        X, y : DataFrame and Series
            What may be the data of the fit.

        Raises
        ------
        ValueError
            If it is not.
        """
        of_fit = self.predictions_["measured"].to_numpy()
        given = np.asarray(getattr(y, "to_numpy", lambda: y)(), dtype=float).ravel()
        if len(of_fit) != len(given) or not np.array_equal(of_fit, given, equal_nan=True):
            raise ValueError(
                f"This search was fitted to {len(of_fit)} rows of an output, and y "
                f"({len(given)} rows) is not that output. Pass the X and y that it was fitted to, "
                "or fit it to these."
            )
        if fingerprint_of(X) != self._fingerprint:
            raise ValueError(
                "This search was fitted to another X: values, names, runs or times differ. Pass "
                "the X and y that it was fitted to, or fit it to these."
            )

    def _found_html(self) -> str:
        return tell_briefly(self.result_).html()


class Found(NamedTuple):
    """What a search finds, how it ends, both models, and the shape of what has no name."""

    numbers: SearchNumbers
    ending: Ending
    baseline: Any
    best: Any
    shape: Shape | None


def search_effects(
    search: Search, model: GreyBox, data: SearchData, y: np.ndarray, most: int, tries_all: bool
) -> Found:
    """Search, on the output without a tremor that shows; what is found is told of all rows."""
    prepared, held, recorded = data.prepared, data.held, search.record.y
    baseline = model.first_fit(replace(prepared, record=search.record))
    calm = search.without_tremor(baseline) if most else None
    if calm is not None:
        held = held or [held_columns(fold.test) for fold in search.folds]
        search = calm
        baseline = model.first_fit(replace(prepared, record=calm.record))
    path = find_path(search, baseline, most)
    before = fit_likeliest(prepared, path.steps[0].at_least_error)
    best = model.with_fit(
        prepared, *(fit_likeliest(prepared, path.model) if path.added else before)
    )
    measured = np.where(prepared.known, y, np.nan)
    numbers = measure_path(search, path, best, prepared, measured, recorded, held)
    ended = find_unnamed(search, numbers, tries_all=tries_all and not path.ended_early)
    shape = fit_shape(ended, model, prepared, measured)
    if len(path.model.effects):  # choices made, numbers to be estimated
        best.set_params(effects=path.model.effects)
    return Found(ended.found, ended.ending, model.with_fit(prepared, *before), best, shape)


def fit_likeliest(prepared: Prepared, fitted: Model) -> tuple[Model, RemnantModel, np.ndarray]:
    """A model at its largest likelihood on all rows, its noise, and where its error is least."""
    start = refit_on_rows(prepared.record, fitted)
    # An ARX model has few rounds of noise models: it begins where its own ``fit`` does.
    if not start.simulator.core.kind.is_operator:
        start = output_error_fit(start)
    return *likelihood_fit(start, Criterion(prepared.record)), start.theta


def name_if_sure(
    ending: Ending, numbers: SearchNumbers, confidence: float, unknown: Verdict
) -> Ending:
    """The end of a search whose names are given only where they are as probable as asked.

    What gains nothing before another is added is no surer than that. Where something else is as
    probable, the verdict is ``unknown``.
    """
    tried = [c for step in numbers.path.steps for c in step.candidates if c.passes]
    chances = {c.effect.name: c.probability for c in tried}
    unsure = [name for name in ending.named if chances.get(name, 1.0) < confidence]
    gains = np.diff([step.vaf for step in numbers.steps])
    for i in reversed(range(len(gains))):
        if gains[i] < LEAST_GAIN * numbers.share and {*numbers.ids[i + 1 :]} & {*unsure}:
            unsure.append(numbers.ids[i])
    sure = [name for name in ending.named if name not in unsure]
    verdict = ending.verdict
    if verdict is Verdict.FOUND and unsure:
        verdict = Verdict.POSSIBLE
    first = numbers.path.steps[0]
    if verdict in (Verdict.POSSIBLE, Verdict.NOTHING) and not sure:
        verdict = unknown if find_chances(first.tried).something_else >= confidence else verdict
    return Ending(verdict, sure, [n for n in (*ending.named, *ending.stand_ins) if n not in sure])


def _note_searched(data: SearchData) -> list[Note]:
    """In which runs effects were looked for, where not in all."""
    if data.some is None:
        return []
    known = data.prepared.record.known.sum(axis=0)
    text = (
        f"effects were looked for in {len(data.searched_runs):,} of "
        f"{len(data.prepared.grid.layout.labels):,} runs, with {known[data.some].sum():,} of "
        f"{known.sum():,} rows. Parameters, likelihood and VAF of the models are those of all runs"
    )
    return [Note("some runs", text, hint="max_rows=None looks for effects in all runs")]


def _note_controller(data: SearchData) -> list[Note]:
    """That a controller answers, with its form."""
    core: Any = data.prepared.core
    if core.kind != CoreKind.CONTROLLER:
        return []
    form = core.form.upper()
    text = f"a controller answers, {form}: the linear model, with K_i on the integral of the error"
    return [Note("controller", text, hint='domain="human" takes a person instead')]


def _remember(search: Any, X: Any, y: Any) -> None:
    """Remember what a search was fitted to, as long as it is there anyway."""
    try:
        _DATA[search] = weakref.ref(X), weakref.ref(y)
    except TypeError:  # a list, say
        _DATA.pop(search, None)
