"""identify_people: one estimator for every person, condition and run of an experiment."""

from __future__ import annotations

import base64
import io
import os
import re
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeGuard

import joblib
import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.utils.metadata_routing import get_routing_for_object

from ... import __version__, operator_parameters, run_labels
from ..._sklearn import HasMethods, Interval, checked
from ...diagnosis import consistent_ceiling, noise_ceiling, read_signals
from ...interpret import FROM_POLES, UNITS, is_arx
from ...metrics import scored_rows, scored_signals, vaf_of_rows, vaf_of_sums
from ...pipelines import (
    by_likelihood,
    final_step,
    prediction_from,
    raw_layout,
    taken_apart,
    trimmed_rows,
)
from ...preprocessing import as_output
from ...runs import RUN
from ...text import counted
from ..studies.identity import described
from ..studies.store import Store, uniform
from ..studies.workers import completed
from .groups import ALL, CONDITION, SUBJECT, Group, absent_people, read_groups
from .outlying import outlying_table
from .people import COLUMNS, PeopleResult


class Row(NamedTuple):
    """An estimate; NaN where it, or its standard error, is not known."""

    parameter: str
    estimate: float
    se: float = np.nan
    unit: str = ""


def collect_parameters(model: Any, vaf: float) -> list[Row]:
    """What searches chose, parameters of the model, and of the operator that it stands for.

    Of a recursive model they are those at the end. A model without parameters has its VAF.
    """
    rows = {row.parameter: row for row in _chosen(model)}
    searched = "delay" in rows or any(name.endswith(("nk", "delay")) for name in rows)
    table = getattr(taken_apart(model)[1], "parameters_", None)
    if isinstance(table, pd.DataFrame):
        for name, value, sd, unit in zip(
            table.index, table["value"], table["sd"], table["unit"], strict=True
        ):
            rows[str(name)] = Row(str(name), float(value), float(sd), "" if unit == "-" else unit)
    if is_arx(model):
        for row in _operator(model, searched):
            rows.setdefault(row.parameter, row)
    return list(rows.values()) or [Row("vaf", vaf, unit="%")]


def _within(estimator: Any) -> Iterator[Any]:
    """An estimator and what it holds: best estimators, and last steps of pipelines."""
    while estimator is not None:
        yield estimator
        last = estimator.steps[-1][1] if isinstance(estimator, Pipeline) else None
        estimator = getattr(estimator, "best_estimator_", last)


def _chosen(estimator: Any) -> Iterator[Row]:
    """Numbers that searches chose, from the outermost in."""
    for one in _within(estimator):
        for name, value in (getattr(one, "best_params_", None) or {}).items():
            if _is_number(value):
                yield Row(str(name), float(value))
        for name, unit in (("delay", "s"), ("memory_horizon", "samples")):
            value = getattr(one, f"best_{name}_", None)
            if _is_number(value):
                yield Row(name, float(value), unit=unit)


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, (Real, np.number)) and not isinstance(value, (bool, np.bool_))


def _operator(model: Any, searched: bool) -> Iterator[Row]:
    """Parameters of the operator; none where orders, inputs or steps do not allow them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of real poles: their rows are NaN
        try:
            found = operator_parameters(model).iloc[-1]
        except (TypeError, ValueError):
            return
    # A delay that was given is no estimate.
    for name in (*FROM_POLES, *["tau_e"] * searched):
        yield Row(name, float(found[name]), float(found[f"sd_{name}"]), UNITS[name])


WHOLE = -1  # in place of the number of a run: the fit of all runs
# What the rows of a block are.
FIT, JUDGED, CEILING, EFFECT, WARNED, MODEL = "fit", "run", "ceiling", "effect", "warning", "model"
# Filters of warnings belong to the whole process, and workers may be threads.
_one_at_a_time = threading.RLock()


class Line(NamedTuple):
    """A row of a block; ``part`` says what it is."""

    part: str
    run: int
    name: str = ""
    estimate: float = np.nan
    se: float = np.nan
    unit: str = ""
    vaf: float = np.nan
    n_rows: int = 0
    of: str = ""
    text: str = ""


def list_effects_found(model: Any) -> Iterator[Line]:
    """What a search for effects found, or that it found nothing; nothing of other estimators."""
    search = next((one for one in _within(model) if hasattr(one, "best_effects_")), None)
    if search is None:
        return
    parameters = collect_parameters(search.best_estimator_, np.nan)
    for effect in search.best_effects_ or [""]:
        start = f"{effect}__"
        rows = [row for row in parameters if effect and row.parameter.startswith(start)]
        for name, estimate, se, unit in rows or [Row(start, np.nan)]:
            name = name.removeprefix(start)
            text = str(search.verdict_)
            yield Line(EFFECT, WHOLE, name, estimate, se, unit, of=effect, text=text)


@dataclass(frozen=True)
class Job:
    """What a worker is given."""

    estimator: Any
    group: Group
    each_run: bool
    ceiling: bool

    def __str__(self) -> str:
        return str(self.group)


@dataclass
class _Found:
    """Lines so far, and the model of the group."""

    lines: list[Line] = field(default_factory=list)
    model: Any = None

    def noting(self, run: int, work: Callable[[], Any]) -> tuple[Any, str]:
        """The result, or the reason why there is none; warnings become lines."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                return work(), ""
            except MemoryError:
                raise
            except Exception as error:
                return None, f"{type(error).__name__}: {error}"
            finally:
                for warning in caught:
                    text = f"{warning.category.__name__}: {warning.message}"
                    self.lines.append(Line(WARNED, run, text=text))


def fit_group(job: Job) -> pd.DataFrame:
    """The fits of one group, and its model."""
    with _one_at_a_time:
        return _fit_group(job)


def _fit_group(job: Job) -> pd.DataFrame:
    group, found = job.group, _Found()
    n_runs = len(group.labels)
    model, of_runs = _fit(job, found, WHOLE, group.X, group.y)
    own = np.full(n_runs, np.nan)
    if job.each_run and n_runs == 1:  # which is the same fit
        of_all = [line for line in found.lines if line.part == FIT and line.run == WHOLE]
        found.lines += [line._replace(run=0) for line in of_all]
        own[0] = of_all[0].vaf
    elif job.each_run:
        for number in range(n_runs):
            _, vaf = _fit(job, found, number, *group.run(number))
            own[number] = vaf[0]
    for number in range(n_runs):
        rows = slice(*group.starts[number : number + 2])
        output = np.asarray(group.y.iloc[rows], dtype=float)
        known = output[np.isfinite(output)]
        found.lines.append(
            Line(
                JUDGED,
                number,
                estimate=float(own[number]),
                se=float(known.std()) if known.size else np.nan,
                vaf=float(of_runs[number]),
                n_rows=output.size,
            )
        )
    if model is not None and job.ceiling:
        ceiling, why = found.noting(WHOLE, lambda: find_ceiling(model, group.X, group.y))
        found.lines.append(Line(CEILING, WHOLE, estimate=np.nan if why else ceiling))
        if why:
            found.lines.append(Line(WARNED, WHOLE, text=f"no noise ceiling: {why}"))
    if model is not None:
        found.lines.append(Line(MODEL, WHOLE, text=_packed(model)))
    return uniform(pd.DataFrame(found.lines, columns=Line._fields))


def _fit(
    job: Job, found: _Found, run: int, X: pd.DataFrame, y: pd.Series
) -> tuple[Any, np.ndarray]:
    """Fit, and add the lines; the VAF of each run of X."""
    n_runs = len(job.group.labels) if run == WHOLE else 1

    def fitted() -> tuple[Any, list[Row], float, np.ndarray]:
        model = clone(job.estimator)
        model.fit(X, y, **_groups_for(model, X))
        vaf, of_runs = vafs(model, X, y)
        return model, collect_parameters(model, vaf), vaf, of_runs

    result, failure = found.noting(run, fitted)
    if failure:
        found.lines.append(Line(FIT, run, n_rows=len(y), text=failure))
        return None, np.full(n_runs, np.nan)
    model, rows, vaf, of_runs = result
    found.lines += [
        Line(FIT, run, row.parameter, row.estimate, row.se, row.unit, vaf, len(y)) for row in rows
    ]
    if run == WHOLE:
        found.lines += list_effects_found(model)
    return model, of_runs


def _groups_for(estimator: Any, X: pd.DataFrame) -> dict[str, Any]:
    """The run of each row, for a search whose splitter asks for groups."""
    prefix, last = final_step(estimator)
    splitter = getattr(last, "cv", None)
    if not hasattr(splitter, "get_metadata_routing"):
        return {}
    if get_routing_for_object(splitter).split.requests.get("groups") is not True:
        return {}
    return {f"{prefix}groups": run_labels(X)}


def vafs(model: Any, X: pd.DataFrame, y: pd.Series) -> tuple[float, np.ndarray]:
    """VAF of the free run by a model's parameters, as ``compare`` gives it, and of each run."""
    model = by_likelihood(model)
    layout = raw_layout(model, X)
    keep = scored_rows(layout, None, None) & ~trimmed_rows(model, X)
    prediction, fed = prediction_from(model, X, y)
    if fed.size == keep.size:
        keep &= fed
    signal, error, run = scored_signals(as_output(y), prediction, keep, layout, False)
    n_runs = len(layout.labels)
    lost, power = (np.bincount(run, part**2, n_runs) for part in (error, signal))
    scored = np.bincount(run, minlength=n_runs) > 0
    pooled = float(vaf_of_sums(lost, power, scored, "pooled"))
    of_runs = np.full(n_runs, np.nan)
    some = scored & (power > 0)
    of_runs[some] = vaf_of_sums(lost[some], power[some], scored[some], None)
    return pooled, of_runs


def find_ceiling(model: Any, X: pd.DataFrame, y: pd.Series) -> float:
    """``compare(model, X, y).noise_ceiling``, without the tests of a comparison."""
    signals = read_signals(model, X, y, one_step=False)
    vaf = float(
        vaf_of_rows(signals.y, signals.predicted, signals.scored, signals.layout, "pooled", False)
    )
    ceiling = noise_ceiling(signals)
    top, reason = consistent_ceiling(vaf + ceiling.gap, vaf, ceiling.sd, held_out=False)
    return top if ceiling.route.separates and ceiling.known and reason is None else np.nan


def _packed(model: Any) -> str:
    stream = io.BytesIO()
    joblib.dump(model, stream)
    return base64.b64encode(stream.getvalue()).decode()


def _unpacked(text: str) -> Any:
    return joblib.load(io.BytesIO(base64.b64decode(text)))


@checked(
    estimator=[HasMethods(["fit", "get_params"])],
    each_run=[bool, None],
    ceiling=[bool],
    folder=[str, os.PathLike, None],
    n_jobs=[Interval(Integral, -1000, 1000, closed="both"), None],
    progress=[bool, None],
)
def identify_people(
    estimator: Any,
    X: pd.DataFrame,
    y: Any,
    *,
    each_run: bool | None = None,
    ceiling: bool = True,
    folder: str | os.PathLike[str] | None = None,
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
    each_run : bool or None, default=None
        Whether each run is fitted on its own, besides all runs of the group. None means yes for
        models, and no for searches, which hold out runs (an estimator with a parameter ``cv``).
    ceiling : bool, default=True
        Whether to estimate the noise ceiling of each group, as :func:`skhoid.compare` does.
    folder : path or None, default=None
        Folder for finished groups. A call that was stopped for any reason goes on where it was, and
        ends with the same result.
    n_jobs : int or None, default=None
        Number of workers, as in joblib; inside ``joblib.parallel_config(backend="dask")`` those of
        the connected cluster.
    progress : bool or None, default=None
        Show a progress bar; without a terminal a line for each group. None means only in a
        terminal.

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

    Notes
    -----
    Each fit is the one that ``estimator.fit`` makes of these rows alone, to the last bit. A search
    whose splitter asks for groups, such as ``LeaveOneGroupOut``, is given the runs. Spreads by
    which people and runs look wrong are robust (median absolute deviation; Qn of Rousseeuw and
    Croux between people), and limits grow with the number of comparisons, so that each rule flags
    anything in about 5 % of faultless experiments.

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
    estimator = clone(estimator)
    groups = read_groups(X, y)
    each_run = not _is_search(estimator) if each_run is None else each_run
    jobs = {n: Job(estimator, group, each_run, ceiling) for n, group in enumerate(groups)}
    store = None
    if folder is not None:
        description = {
            "task": "identify_people",
            "estimator": described(estimator),
            "each_run": each_run,
            "ceiling": ceiling,
            "data": {str(group): [*map(str, group.labels), group.identity()] for group in groups},
            "skhoid": __version__,
        }
        store = Store(folder, description)
    what = "search" if _is_search(estimator) else "parameters"
    found = completed(jobs, fit_group, store, n_jobs=n_jobs, progress=progress, what=what)
    return _assembled(estimator, groups, found, each_run)


def _is_search(estimator: Any) -> bool:
    """Whether it holds out runs, itself or as a step of a pipeline."""
    names = estimator.get_params(deep=True)
    return any(name == "cv" or name.endswith("__cv") for name in names)


NUMBER = re.compile(r"\d[\d.,e+-]*")
LONGEST = 300  # characters of a note


def _assembled(
    estimator: Any, groups: list[Group], found: list[pd.DataFrame], each_run: bool
) -> PeopleResult:
    """The result of all groups, in their order."""
    lines = _labelled(groups, found)
    fits = _fits(lines)
    whole = fits[fits["number"] == WHOLE]
    of_runs = fits[fits["number"] != WHOLE] if each_run else whole
    judged = lines[lines["part"] == JUDGED].reset_index(drop=True)
    runs = judged[[SUBJECT, CONDITION, RUN, "n_rows"]].assign(
        vaf=judged["estimate"], vaf_group=judged["vaf"], spread=judged["se"]
    )
    whole, of_runs = (part[list(COLUMNS)].reset_index(drop=True) for part in (whole, of_runs))
    outlying = outlying_table(whole, of_runs, runs)
    models = lines[lines["part"] == MODEL]
    return PeopleResult(
        table=_flagged(of_runs, outlying),
        groups=_flagged(whole, outlying),
        runs=runs,
        models={
            (line.subject, line.condition): _unpacked(line.text)
            for line in models.itertuples(index=False)
        },
        outlying=outlying,
        found=_effects(lines),
        notes=[*_missing(groups), *_counted_warnings(lines)],
        estimator=" ".join(repr(estimator).split()),
    )


def _labelled(groups: list[Group], tables: list[pd.DataFrame]) -> pd.DataFrame:
    """All lines, with the labels of their subject, condition and run."""
    parts = []
    for place, (group, table) in enumerate(zip(groups, tables, strict=True)):
        labels = [ALL if number == WHOLE else group.labels[number] for number in table["run"]]
        parts.append(
            table.assign(
                number=table["run"],
                place=place,
                subject=pd.Series([group.subject] * len(table), table.index, dtype=object),
                condition=pd.Series([group.condition] * len(table), table.index, dtype=object),
                run=pd.Series(labels, table.index, dtype=object),
            )
        )
    return pd.concat(parts, ignore_index=True)


def _fits(lines: pd.DataFrame) -> pd.DataFrame:
    """The tidy table; the ceiling of a group holds for its runs too."""
    ceilings = lines[lines["part"] == CEILING].set_index("place")["estimate"]
    fits = lines[lines["part"] == FIT]
    return fits.rename(columns={"name": "parameter", "text": "failure"}).assign(
        ceiling=fits["place"].map(ceilings).astype(float), outlying=""
    )


def _flagged(table: pd.DataFrame, outlying: pd.DataFrame) -> pd.DataFrame:
    """The reasons beside the rows that they concern; those of a person are in all its runs."""
    reasons: dict[tuple[Any, ...], list[str]] = {}
    for flag in outlying.itertuples(index=False):
        reasons.setdefault((flag.subject, flag.condition, flag.run), []).append(flag.reason)
    keys = zip(table[SUBJECT], table[CONDITION], table[RUN], strict=True)
    texts = [
        "; ".join(
            [*reasons.get((s, c, ALL), []), *(reasons.get((s, c, r), []) if r != ALL else [])]
        )
        for s, c, r in keys
    ]
    return table.assign(outlying=pd.Series(texts, table.index, dtype=object))


def _effects(lines: pd.DataFrame) -> pd.DataFrame:
    effects = lines[lines["part"] == EFFECT].rename(
        columns={"of": "effect", "name": "parameter", "text": "verdict"}
    )
    columns = [SUBJECT, CONDITION, "effect", "parameter", "estimate", "se", "unit", "verdict"]
    return effects[columns].reset_index(drop=True)


def _missing(groups: list[Group]) -> list[str]:
    """Who has no runs in a condition, and fewer runs than others."""
    notes = absent_people([(group.subject, group.condition) for group in groups])
    most = max(len(group.labels) for group in groups)
    return notes + [
        f"{group} has {counted(len(group.labels), 'run')}, others have up to {most}"
        for group in groups
        if len(group.labels) < most
    ]


def _counted_warnings(lines: pd.DataFrame) -> list[str]:
    """Warnings of fits, those that differ in numbers only counted as one."""
    first: dict[str, tuple[str, str]] = {}
    times: dict[str, int] = {}
    for line in lines[lines["part"] == WARNED].itertuples(index=False):
        text = " ".join(line.text.split())[:LONGEST]
        kind = NUMBER.sub("#", text)
        named = [str(n) for n in (line.subject, line.condition) if n != ALL]
        where = " ".join([*named, "all runs" if line.run == ALL else f"run {line.run}"])
        first.setdefault(kind, (text, where))
        times[kind] = times.get(kind, 0) + 1
    return [
        f"{where}{f' (and {times[kind] - 1} more)' if times[kind] > 1 else ''}: {text}"
        for kind, (text, where) in first.items()
    ]
