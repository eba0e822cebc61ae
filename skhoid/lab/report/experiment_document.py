"""``report_experiment``: the page of an experiment with people."""

from __future__ import annotations

from typing import Any

import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ...recordings.experiment_check import ExperimentCheck
from ..experiment.group import GroupEffectSearch
from ..experiment.people import PeopleResult
from .experiment_content import Experiment, experiment_content
from .page import Page


class ExperimentReport(Page):
    """A report on an experiment: who was recorded, what the group has, parameters, each person.

    Make it with :func:`report_experiment`, or with :func:`skhoid.report`. In a notebook it shows
    itself.

    Parameters
    ----------
    title : str
        Title of the page.
    content : dict
        What its template shows.
    statistics : dict
        ``MixedModelResult`` by parameter; only those that could be made.

    Attributes
    ----------
    html : str
        The whole page: one file with its plots inside, which needs no network.

    Examples
    --------
    >>> from skhoid import ARXRegressor, identify_people, report, simulate_experiment
    >>> X, y = simulate_experiment(2, "C1", runs=1, duration=20.48, random_state=0)
    >>> people = identify_people(ARXRegressor(nk=29), X, y, each_run=False, ceiling=False)
    >>> report(people, title="Two people")
    <ExperimentReport 'Two people': 2 people, VAF ... %>
    """

    template = "experiment"

    def __init__(self, title: str, content: dict[str, Any], statistics: dict[str, Any]):
        super().__init__(title, content)
        self.statistics = statistics


def report_experiment(
    experiment: GroupEffectSearch | PeopleResult,
    X: pd.DataFrame | None = None,
    y: Any = None,
    *,
    people: PeopleResult | None = None,
    check: ExperimentCheck | None = None,
    reference: Any = None,
    title: str | None = None,
    source: str | None = None,
    made_with: dict[str, str] | None = None,
) -> ExperimentReport:
    """Report on an experiment with people: one HTML page from the recordings to each person.

    The page says in one sentence what was found, and then holds who was recorded and what looks
    wrong there; how many people have each effect, who, and how conditions differ; each parameter
    of everybody with means, contrasts and effect sizes by a mixed model, and its checks; how well
    each person is modelled; who differs from the group; and a part for each person, folded, with
    parameters, effects and pictures. It is one file that needs no network.

    Parameters
    ----------
    experiment : GroupEffectSearch or PeopleResult
        What was found: by a fitted search in the group, or by :func:`skhoid.identify_people`.
    X : DataFrame or None, default=None
        The channels that it was found in. Without them there are no pictures of measured and
        simulated output where only people were identified, and no rate and fingerprint of the data.
    y : Series or None, default=None
        The control output.
    people : PeopleResult or None, default=None
        Parameters of each run, beside a search in the group, which fits all runs together. They
        are then compared between conditions in place of those of the search.
    check : ExperimentCheck or None, default=None
        What :func:`skhoid.check_experiment` found.
    reference : label or None, default=None
        Condition against which the others are compared; None compares all pairs.
    title : str or None, default=None
        Title of the page.
    source : str or None, default=None
        Where the data are from, in a sentence.
    made_with : dict of str or None, default=None
        More lines for the section "How this was made": the command, a seed.

    Returns
    -------
    report : ExperimentReport
        ``save(path)`` writes the file, ``open_in_browser()`` shows it; notebooks show it too.

    Raises
    ------
    TypeError
        If ``experiment`` is neither of the two.
    NotFittedError
        If the search is not fitted.
    ValueError
        If ``X`` has no runs of somebody whom the result has, there is no such ``reference``, or X
        is given without y.

    See Also
    --------
    skhoid.report : The page of one person's model.
    skhoid.lab.experiment.mixed_model : The comparison of conditions.

    Notes
    -----
    Without statsmodels the page says so, and has means and spreads. All text from the data is
    escaped, and the page's policy lets no script run but its own.

    Examples
    --------
    >>> from skhoid import ARXRegressor, identify_people, simulate_experiment
    >>> from skhoid.lab.report import report_experiment
    >>> X, y = simulate_experiment(2, "C1", runs=1, duration=20.48, random_state=0)
    >>> people = identify_people(ARXRegressor(nk=29), X, y, each_run=False, ceiling=False)
    >>> page = report_experiment(people, X, y)
    >>> page.save("experiment.html")  # doctest: +SKIP
    """
    if isinstance(experiment, GroupEffectSearch):
        check_is_fitted(experiment, "prevalence_")
        given = Experiment(experiment, people or experiment.identified_, people is not None)
    elif isinstance(experiment, PeopleResult):
        given = Experiment(None, experiment, True)
    else:
        raise TypeError(
            "report_experiment takes a fitted GroupEffectSearch, or the PeopleResult of "
            f"identify_people; got {type(experiment).__name__}."
        )
    if (X is None) != (y is None):
        raise ValueError("Give X and y together, or neither of them.")
    if reference is not None and reference not in given.conditions:
        raise ValueError(
            f"reference is one of {', '.join(map(str, given.conditions))}; got {reference!r}."
        )
    content, statistics = experiment_content(
        given,
        X,
        y,
        check=check,
        reference=reference,
        source=source,
        made_with=made_with,
    )
    return ExperimentReport(title or "An experiment with people", content, statistics)
