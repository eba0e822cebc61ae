"""identify_people: one estimator for every person, condition and run of an experiment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from numbers import Integral
from typing import Any

import pandas as pd
from sklearn.base import clone

from ...._sklearn import HasMethods, Interval, checked
from .assemble import assembled
from .fit import Job, fit_group
from .groups import Group, levels_of, read_groups
from .kept import Folder, completed, description_of
from .result import PeopleResult


@checked(
    estimator=[HasMethods(["fit", "get_params"])],
    by=[str, list, tuple, None],
    each_run=[bool, None],
    ceiling=[bool],
    folder=[str, os.PathLike, None],
    keep_models=[bool],
    n_jobs=[Interval(Integral, -1000, 1000, closed="both"), None],
    progress=[bool, None],
)
def identify_people(
    estimator: Any,
    X: pd.DataFrame,
    y: Any,
    *,
    by: Sequence[str] | str | None = None,
    each_run: bool | None = None,
    ceiling: bool = True,
    folder: str | os.PathLike[str] | None = None,
    keep_models: bool = True,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> PeopleResult:
    """Identify every person in every condition with one estimator, run by run and all runs.

    A fit that fails does not stop the others: its row says why. Who and what looks wrong is listed
    with the reason, and never left out.

    Parameters
    ----------
    estimator : estimator
        A model, pipeline or search of skhoid or scikit-learn. It is cloned for each fit.
    X : DataFrame of shape (n_rows, n_channels)
        Channels with the row index levels ``run`` and ``time`` (s), and ``subject`` and
        ``condition`` if there are any.
    y : Series or array of shape (n_rows,)
        Control output.
    by : str, sequence of str or None, default=None
        Index levels whose combinations are identified apart. None means those of ``subject`` and
        ``condition`` that X has.
    each_run : bool or None, default=None
        Whether each run is fitted on its own, besides all runs of the group. None means yes for
        models, and no for searches, which hold out runs (an estimator with a parameter ``cv``).
    ceiling : bool, default=True
        Whether to estimate the noise ceiling of each group, as :func:`skhoid.compare` does.
    folder : path or None, default=None
        Folder for finished groups. A call that was stopped for any reason goes on where it was, and
        ends with the same result. Needs ``pip install "skhoid[io]"``.
    keep_models : bool, default=True
        Whether to keep the fitted estimator of each group.
    n_jobs : int or None, default=None
        Number of workers, as in joblib; inside ``joblib.parallel_config(backend="dask")`` those of
        the connected cluster.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    result : PeopleResult
        Tables of parameters, models, failures, what is outlying, ``summary()``.

    Raises
    ------
    RunIndexError
        If X has no index with runs and time, or rows of a run are not together.
    StudyFolderError
        If the folder holds results of other data or of another estimator; the message says what
        differs.
    WorkersLostError
        If workers die repeatedly.

    See Also
    --------
    analyse_experiment : Time-varying parameters, and who adapts.
    simulate_experiment : Simulate recordings whose truth is known.

    Notes
    -----
    Each fit is the one that ``estimator.fit`` makes of these rows alone, to the last bit. A search
    whose splitter asks for groups, such as ``LeaveOneGroupOut``, is given the runs. Besides the
    model's own parameters the tables have what searches chose (``delay`` in s, numbers of
    ``best_params_``), and the operator's parameters of ARX models whose orders allow it
    (:func:`skhoid.operator_parameters`; NaN where the poles are real; ``tau_e`` where the delay was
    searched). Of a recursive model they are those at the end of the runs. A model without
    parameters has one row, ``vaf``.

    What looks wrong is found by comparison with the other people and the person's other runs: the
    sign of K_e or of the static gain, the size of the output, a VAF near zero, parameters, and runs
    with a VAF far below the others. Spreads are robust (median absolute deviation; Qn of Rousseeuw
    and Croux between people), and limits grow with the number of comparisons, so that each rule
    flags anything in about 5 % of faultless experiments.

    References
    ----------
    Rousseeuw and Croux, Alternatives to the median absolute deviation, J. Am. Stat. Assoc. 88,
    1993.

    Examples
    --------
    >>> from skhoid import ARXRegressor, simulate_experiment
    >>> from skhoid import identify_people
    >>> X, y = simulate_experiment(2, "C1", runs=2, duration=20.48, random_state=0)
    >>> result = identify_people(ARXRegressor(nk=29), X, y)
    >>> K_e = result.groups[result.groups["parameter"] == "K_e"]
    >>> K_e[["subject", "run", "estimate", "se"]].round(3)
       subject  run  estimate     se
    4       S1  all     0.082  0.001
    13      S2  all     0.066  0.002
    """
    given = levels_of(X, by)
    estimator = clone(estimator)
    groups = read_groups(X, y, given)
    chosen = not is_search(estimator) if each_run is None else bool(each_run)
    jobs = [Job(estimator, group, chosen, bool(ceiling), bool(keep_models)) for group in groups]
    found = _computed(jobs, folder, n_jobs, progress)
    return assembled(estimator, groups, found, each_run=chosen, keep_models=bool(keep_models))


def is_search(estimator: Any) -> bool:
    """Whether it holds out runs, itself or as a step of a pipeline."""
    names = estimator.get_params(deep=True)
    return any(name == "cv" or name.endswith("__cv") for name in names)


def _computed(
    jobs: list[Job], folder: Any, n_jobs: int | None, progress: bool | None
) -> list[tuple[pd.DataFrame, bytes]]:
    """The block and the model of each group, from the folder where they are there."""
    kept, finished = None, {}
    if folder is not None:
        first = jobs[0]
        groups: list[Group] = [job.group for job in jobs]
        kept = Folder(
            folder,
            description_of(first.estimator, groups, each_run=first.each_run, ceiling=first.ceiling),
        )
        finished = kept.finished(first.keep_models)
    return completed(
        jobs,
        fit_group,
        finished,
        None if kept is None else kept.write,
        n_jobs=n_jobs,
        progress=progress,
        what="people",
    )
