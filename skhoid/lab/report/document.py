"""``report`` and ``Report``: makes the page, shows it in a notebook or browser, saves it."""

from __future__ import annotations

from typing import Any

from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.utils.validation import check_is_fitted

from ...diagnosis import Comparison, compare
from ...pipelines import taken_apart
from ...runs import output_name
from ...search import EffectSearchCV, with_effects, without_output
from ..experiment.group import GroupEffectSearch
from ..experiment.people import PeopleResult
from ..explore import Exploration
from ..explore.payloads import payload_in_report, payload_of
from .content import Results, read_content
from .experiment import report_experiment
from .page import Page


class Report(Page):
    """A report on a model: data, comparison, missing effects, parameters, what to do next.

    Make it with :func:`report`. In a notebook it shows itself.

    Parameters
    ----------
    title : str
        Title of the page.
    content : dict
        What its template shows.
    search : EffectSearchCV or None
        The search for missing effects, fitted; None where there was none.
    comparison : Comparison or None
        The model without new effects against the data; None where that is not possible.
    final_comparison : Comparison or None
        The same of the model with the effects found; None where none was added.

    Attributes
    ----------
    html : str
        The whole page: one file with its plots inside, which needs no network.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs, report
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> page = report(ARXRegressor(nk=15), X, y, effects=None, title="First look")
    >>> page
    <Report 'First look': VAF ... %>
    >>> page.html[:15]
    '<!DOCTYPE html>'
    """

    def __init__(
        self,
        title: str,
        content: dict[str, Any],
        search: EffectSearchCV | None,
        comparison: Comparison | None,
        final_comparison: Comparison | None,
    ):
        super().__init__(title, content)
        self.search = search
        self.comparison = comparison
        self.final_comparison = final_comparison


def report(
    model: Any,
    X: Any = None,
    y: Any = None,
    *,
    effects: Any = "all",
    title: str | None = None,
    source: str | None = None,
    made_with: dict[str, str] | None = None,
) -> Any:
    """Report on a model: one HTML page from the data to what is missing, and what to do next.

    It is one file, with its plots inside, and needs no network. All text from the data is escaped,
    and the page's policy lets no script run but its own.

    Parameters
    ----------
    model : EffectSearchCV, OperatorRegressor, ARXRegressor, or any regressor with ``predict``
        What to report on. What is not fitted is fitted to ``X`` and ``y``. A search that is
        fitted must be so on these data; where one is made here, it fits the model anew. What was
        found in an experiment with people, a :class:`GroupEffectSearch` or a
        :class:`PeopleResult`, makes the page of :func:`skhoid.lab.report.report_experiment`, which
        has more options. Of an exploration (``widget.exploration``) it is the page of its present
        model, with its search and the models that were kept; it does not need X and y.
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample. An experiment does not need it.
    y : Series or array of shape (n_rows,)
        Measured output. An experiment does not need it.
    effects : "all", list of ids or effects, or None, default="all"
        Effects to try on a model that can take them, by an :class:`EffectSearchCV` with its
        other settings at their defaults; None does not search. A search as ``model`` has its own.
    title : str or None, default=None
        Title of the page; None says what was found.
    source : str or None, default=None
        Where the data are from, in a sentence.
    made_with : dict of str or None, default=None
        More lines for the section "How this was made": a seed, or the "command"; with one, what to
        do next is told in commands.

    Returns
    -------
    report : Report or ExperimentReport
        ``save(path)`` writes the file, ``open_in_browser()`` shows it; notebooks show it too.

    Raises
    ------
    ValueError
        If there are no data, a fitted search was fitted to other data than ``X`` and ``y``, or
        ``effects`` name what does not exist.

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs, report
    >>> from skhoid.effects import Bias
    >>> X, y = make_tracking_runs(
    ...     n_runs=2,
    ...     remnant_intensity=0.05,
    ...     sampling_rate=50,
    ...     effects=Bias(level=0.1),
    ...     random_state=0,
    ... )
    >>> page = report(OperatorRegressor(), X, y, effects=["bias", "dead_zone"])
    >>> page.search.best_effects_
    ['bias']
    >>> page.save("report.html")  # doctest: +SKIP
    """
    if isinstance(model, GroupEffectSearch | PeopleResult):
        return report_experiment(model, X, y, title=title, source=source, made_with=made_with)
    if isinstance(model, Exploration):
        return _report_exploration(model, title=title, source=source, made_with=made_with)
    if X is None or y is None:
        raise ValueError(
            f"report needs the data: report(model, X, y). Only what was found in an experiment "
            f"with people goes without; got {type(model).__name__}."
        )
    search, no_search = _search(model, X, y, effects)
    if search is not None:
        baseline = search.baseline_
    else:
        baseline = model if _is_fitted(model) else clone(model).fit(X, y)
    final = None if search is None or len(search.error_path_) == 1 else search.best_estimator_
    kept = y if search is None else without_output(y, search.control_)
    comparison, no_comparison = _comparison(baseline, X, kept)
    after, _ = (None, "") if final is None else _comparison(final, X, kept)
    results = Results(
        baseline=baseline,
        final=final,
        final_name="" if search is None else with_effects(search.result_.added),
        search=search,
        no_search=no_search,
        fitted_here=search is not None or baseline is not model,
        comparison=comparison,
        no_comparison=no_comparison,
        after=after,
    )
    payload = payload_of(search, comparison, X, y)
    return _make_page(X, y, results, payload, title, source=source, made_with=made_with)


def _make_page(
    X: Any,
    y: Any,
    results: Results,
    payload: dict[str, Any] | None,
    title: str | None,
    **about: Any,
) -> Report:
    search, comparison = results.search, results.comparison
    content = read_content(X, y, results, payload, **about)
    content["found_title"] = title is None and (search is not None or comparison is not None)
    if title is None:
        name = type(taken_apart(results.baseline)[1]).__name__
        title = f"{name} against measured {output_name(y)}"
    return Report(title, content, search, comparison, results.after)


def _report_exploration(exploration: Exploration, *, title: str | None, **about: Any) -> Report:
    """Report on the present model, beside the search of its runs and the models kept."""
    with exploration.lock:
        here, model, state = exploration.here, exploration.model, exploration.state()
        search, payload = exploration.searched(), payload_in_report(exploration)
    X, y = exploration.runs.part(here.train)
    baseline = model if search is None else search.baseline_
    new = [name for name in here.effects.names if name not in exploration.found.before.names]
    by_hand = "numbers moved by hand" if here.moved else ""
    name = ", ".join(filter(None, [with_effects(new) if new else "", by_hand]))
    final = None if model is baseline else model
    comparison, no_comparison = _comparison(baseline, X, y)
    results = Results(
        baseline=baseline,
        final=final,
        final_name=name if new else f"with {by_hand or 'fewer effects'}",
        search=search,
        no_search=state["verdict"] or "Search in the workbench, and save the report again.",
        comparison=comparison,
        no_comparison=no_comparison,
        after=None if final is None else _comparison(final, X, y)[0],
        models=state["models"],
        held_out=", ".join(exploration.runs.labels[run] for run in here.hold),
    )
    return _make_page(X, y, results, payload, title, **about)


def _search(model: Any, X: Any, y: Any, effects: Any) -> tuple[EffectSearchCV | None, str]:
    """The fitted search for missing effects, or why there is none."""
    if isinstance(model, EffectSearchCV):
        if not _is_fitted(model):
            return clone(model).fit(X, y), ""
        model.check_data(X, y)
        return model, ""
    if not hasattr(model, "with_effect"):
        kind = type(model).__name__
        return None, (
            f"{kind} takes no effects. Models that do: OperatorRegressor and ARXRegressor, by "
            "report(OperatorRegressor(), X, y)."
        )
    if effects is None:
        return None, 'Not asked for (effects=None). effects="all" tries the whole catalogue.'
    search = EffectSearchCV(clone(model), effects=effects)
    search.list_effects()  # a name that is none is no matter of this model
    try:
        return search.fit(X, y), ""
    except ValueError as error:
        # A model that takes no effects, such as one of several inputs, can still be reported on.
        if not _is_fitted(model):
            raise
        return None, f"Not possible: {error}"


def _comparison(model: Any, X: Any, y: Any) -> tuple[Comparison | None, str]:
    try:
        return compare(model, X, y), ""
    except ValueError as error:
        return None, str(error)


def _is_fitted(model: Any) -> bool:
    try:
        check_is_fitted(model)
    except NotFittedError:
        return False
    return True
