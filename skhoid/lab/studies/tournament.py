"""run_tournament and recommend_method: every method on the same simulated runs."""

from __future__ import annotations

import contextlib
import math
import os
import timeit
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ... import CompensatoryTask, make_tracking_runs
from ..._sklearn import Interval, StrOptions, checked
from ...human import delay_samples
from ...simulation import Condition
from ...text import Document, Item, Items, Paragraph, Told
from .monte_carlo import MonteCarloStudy
from .tournament_conditions import SIZES, Change, TournamentCell, tournament_cells
from .tournament_methods import TOURNAMENT_METHODS, TournamentMethod, available_methods
from .tournament_result import DATA_SET, QUESTIONS, TournamentResult, find_question, losses
from .tournament_scores import FOLLOWED, LOWEST_VAF, method_figures, tuning_scores
from .workers import progress_bar

SIMULATION = {"run_in": 20.0}  # s


def _groups(cells: Sequence[TournamentCell]) -> dict[str, list[TournamentCell]]:
    """The cells that are tuned together."""
    groups: dict[str, list[TournamentCell]] = {}
    for cell in cells:
        groups.setdefault(cell.group, []).append(cell)
    return groups


def _tune(
    method: TournamentMethod,
    cells: Sequence[TournamentCell],
    n_data_sets: int,
    make: Callable[..., MonteCarloStudy],
    run: Callable[[MonteCarloStudy, Path], pd.DataFrame],
) -> pd.DataFrame:
    """Mean validation VAF of each setting in each group, and which setting is taken.

    Each setting is tried on so many data sets, evenly from all cells of a group; ``make`` makes a
    study of some cells, ``run`` runs it in a folder.
    """
    tables = []
    settings = range(len(method.settings))
    for number, (group, members) in enumerate(_groups(cells).items()):
        found = pd.DataFrame(
            {
                "method": method.name,
                "group": group,
                "knob": method.knob,
                "setting": list(map(str, method.settings)),
                "vaf": np.nan,
                "failed": 0.0,
                "chosen": [place == 0 for place in settings],
            }
        )
        if len(settings) > 1:
            places = np.linspace(0, len(members) - 1, min(n_data_sets, len(members))).round()
            some = [members[int(place)] for place in places]
            study = make(some, math.ceil(n_data_sets / len(some)))
            table = run(study, Path("tuning") / method.name / f"group {number}")
            table = table.reindex(columns=["setting", "vaf", "failure", "error"])
            lost = table["failure"].notna() | table["error"].notna()
            vaf = table["vaf"].fillna(LOWEST_VAF).groupby(table["setting"]).mean().reindex(settings)
            found["vaf"] = vaf.to_numpy()
            found["failed"] = (
                100.0 * lost.groupby(table["setting"]).mean().reindex(settings).fillna(1.0)
            ).to_numpy()
            if vaf.notna().any():
                found["chosen"] = np.arange(len(settings)) == np.nanargmax(vaf)
        tables.append(found)
    return pd.concat(tables, ignore_index=True)


def _watching(settings: dict[str, Any], cells: Sequence[TournamentCell]) -> dict[str, Any]:
    """The settings with which changes are watched for: where nothing changes, those that the method
    has where something does, with the same remnant; else its own.
    """
    of_changing = {cell.group: settings[cell.name] for cell in cells if cell.kind == "changing"}
    return {
        cell.name: of_changing.get(cell.group.replace("constant", "changing"), settings[cell.name])
        for cell in cells
    }


# Replications of fast and slow methods, and data sets that each setting is tried on.
NUMBERS = {"full": (16, 4, 8), "small": (4, 1, 2)}
TUNING, EVALUATION = 1, 2  # spawn keys of the seeds
AT_ONCE = 4  # replications of a block


@checked(
    methods=["array-like", None],
    cells=["array-like", None],
    size=[StrOptions(set(SIZES))],
    n_replications=[Interval(Integral, 1, None, closed="left"), None],
    n_validation=[Interval(Integral, 1, None, closed="left")],
    delay=[StrOptions({"true", "searched"})],
    random_state=[Interval(Integral, 0, None, closed="left")],
)
def run_tournament(
    methods: Sequence[str] | None = None,
    cells: Sequence[TournamentCell] | None = None,
    *,
    size: str = "full",
    n_replications: int | None = None,
    n_validation: int = 3,
    delay: str = "true",
    random_state: int = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> TournamentResult:
    """Let methods that follow a varying operator compete on the same simulated runs.

    Each method is first tuned: for constant and for changing conditions, and each remnant
    intensity, the setting of its one knob with the highest mean VAF on validation runs; all methods
    try as many settings on the same number of data sets. Then each follows other runs, of other
    seeds, and is compared with the truth.

    Parameters
    ----------
    methods : sequence of str or None, default=None
        Names in :data:`TOURNAMENT_METHODS`; None means all that can be imported.
    cells : sequence of TournamentCell or None, default=None
        Conditions; None means those of :func:`tournament_cells` for ``size``.
    size : {"full", "small"}, default="full"
        Cells and replications: 16 runs of a cell, 4 for slow methods, and 8 data sets for each
        setting; or 4, 1 and 2.
    n_replications : int or None, default=None
        Runs of each cell instead, the same for slow methods.
    n_validation : int, default=3
        Validation runs of each cell.
    delay : {"true", "searched"}, default="true"
        What methods are told that do not estimate the delay: the true one, or the n_k of the
        lowest one-step error of a batch ARX model of each run.
    random_state : int, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`. Each method has
        its own part, so that a further method computes only itself.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    result : TournamentResult
        ``print(result)`` says which method to use when; ``result.table`` has all figures.

    Raises
    ------
    ValueError
        If a method is not known, two cells have the same name, or no run can be simulated.

    Examples
    --------
    >>> from skhoid.lab.studies import run_tournament, tournament_cells
    >>> cells = tournament_cells("small", conditions=["C4"])
    >>> result = run_tournament(["rls", "arx"], cells, size="small", n_replications=2)
    >>> result.ranking("follow").index.tolist()
    ['rls', 'arx']
    """
    chosen, notes = available_methods(methods)
    cells = tournament_cells(size) if cells is None else list(cells)
    names = [cell.name for cell in cells]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"Two cells have the name {twice!r}.")
    fast, slow, n_tuning = NUMBERS[size]
    if n_replications is not None:
        fast = slow = n_replications
    rows = {cell.name: cell for cell in cells}
    n_studies = sum(1 + len(_groups(cells)) * (len(m.settings) > 1) for m in chosen)
    tables, tunings = [], []
    with progress_bar(progress, n_studies, 0, "tournament") as advance:

        def run(study: MonteCarloStudy, folder: Path) -> pd.DataFrame:
            where = None if out is None else Path(out) / folder
            found = study.run(where, n_jobs=n_jobs, progress=False)
            advance(str(folder))
            return found

        tune_on = partial(
            _study, n_validation_runs=n_validation, random_state=_seed(random_state, TUNING)
        )
        for method in chosen:
            scores = partial(tuning_scores, method=method.name, delay=delay)
            tuning = _tune(method, cells, n_tuning, partial(tune_on, scores, method), run)
            taken = {
                group: method.settings[int(np.argmax(part["chosen"]))]
                for group, part in tuning.groupby("group", sort=False)
            }
            settings = {cell.name: taken[cell.group] for cell in cells}
            n, at_once = (slow, 1) if method.slow else (fast, AT_ONCE)
            watching = _watching(settings, cells)
            options: dict[str, Any] = {"settings": settings, "watching": watching, "delay": delay}
            study = _study(
                partial(method_figures, method=method.name, **options),
                method,
                cells,
                n,
                block_size=at_once,
                n_validation_runs=n_validation,
                random_state=_seed(random_state, EVALUATION),
            )
            table = run(study, Path("evaluation") / method.name)
            for place, name in enumerate(("family", "kind", "group"), 1):
                table.insert(place, name, [getattr(rows[cell], name) for cell in table["cell"]])
            table["method"] = method.name  # also of data sets that failed
            table["setting"] = [str(settings[cell]) for cell in table["cell"]]
            tables.append(table)
            tunings.append(tuning)
    table = pd.concat(tables, ignore_index=True)
    if table["error"].notna().all():
        raise ValueError(f"Every simulated run failed. The first error: {table['error'].iloc[0]}")
    tuning = pd.concat(tunings, ignore_index=True)
    methods_table = pd.DataFrame(
        {
            "method": method.name,
            "label": method.label,
            "causal": method.causal,
            "knob": method.knob,
            "n_settings": len(method.settings),
            "told": method.told,
            "oracle": method.is_oracle,
            "n_replications": slow if method.slow else fast,
        }
        for method in chosen
    )
    return TournamentResult(
        table=table,
        tuning=tuning,
        methods=methods_table.set_index("method"),
        cost=_measure_cost(chosen, tuning),
        notes=notes,
    )


def _study(
    function: Callable[..., Any],
    method: TournamentMethod,
    cells: Sequence[TournamentCell],
    n_replications: int,
    block_size: int = 1,
    **options: Any,
) -> MonteCarloStudy:
    """A study of some cells, on channels that the method needs."""
    whole = any("sampling_rate" not in cell.row() for cell in cells)  # and has its own run-in
    return MonteCarloStudy(
        function,
        [cell.row() for cell in cells],
        n_replications,
        simulation={"channels": method.channels} | ({} if whole else SIMULATION),
        block_size=block_size,
        **options,
    )


def _seed(random_state: int, key: int) -> int:
    sequence = np.random.SeedSequence(int(random_state), spawn_key=(key,))
    return int.from_bytes(sequence.generate_state(4).tobytes(), "little")


def _measure_cost(methods: Sequence[TournamentMethod], tuning: pd.DataFrame) -> pd.Series:
    """Microseconds per sample of ``fit``, on this machine: the shortest of three fits of one run.

    The setting is the one most often chosen; slow methods are fitted once.
    """
    options: dict[str, Any] = {"remnant_intensity": 0.15, "channels": ("e", "f_t")} | SIMULATION
    X, y, truth = make_tracking_runs("C4", 1, random_state=0, return_truth=True, **options)
    costs = {}
    for method in methods:
        taken = tuning[tuning["chosen"] & (tuning["method"] == method.name)]["setting"]
        common = taken.mode().iloc[0]
        setting = next(s for s in method.settings if str(s) == common)
        model = method.estimator(0.01, truth.nk, setting, truth.parameters)
        fit = partial(model.fit, X[list(method.channels)], y)
        spent = [np.nan]
        with warnings.catch_warnings(), contextlib.suppress(Exception):  # which is in the table
            warnings.simplefilter("ignore")
            spent = timeit.repeat(fit, number=1, repeat=1 if method.slow else 3)
        costs[method.name] = 1e6 * float(np.min(spent)) / len(y)
    return pd.Series(costs, name="cost")


SIGNIFICANT = 2.0  # standard errors


@dataclass(frozen=True, eq=False, repr=False)
class MethodAdvice(Told):
    """The method that suits an experiment and a question, and the results behind it.

    Parameters
    ----------
    method : str
        Name of the method with the lowest mean loss.
    estimator : estimator
        With its options, to be fitted to recordings.
    close : list of str
        Methods whose mean loss is within two standard errors (paired) of the lowest.
    ranking : DataFrame
        By method, the best first: mean ``loss``, ``difference`` from the best one, its paired
        standard error ``se``, ``setting`` of its knob, ``causal``, and the number ``n`` of data
        sets.
    question : str
        What was asked.
    parameter : str
        Which parameter, if the question is about one.
    result : TournamentResult
        All figures.
    """

    method: str
    estimator: Any
    close: list[str]
    ranking: pd.DataFrame
    question: str
    parameter: str
    result: TournamentResult

    def __repr__(self) -> str:
        return str(self.summary())

    def document(self) -> Document:
        """Which method, how much better it is than others, and the estimator to fit."""
        question, best = QUESTIONS[self.question], self.ranking.iloc[0]
        label = TOURNAMENT_METHODS[self.method].label
        title = (
            f"To {question.asks.format(parameter=self.parameter)}: {self.method} ({label}); "
            f"{question.loss} {best['loss']:.3g} {question.unit}."
        )
        others = [name for name in self.close if name != self.method]
        alike = "All other methods are worse by more than two standard errors."
        if others:
            alike = f"Equally good within two standard errors: {', '.join(others)}."
        worse = [
            Item(f"{name}: {row['difference']:+.3g} ± {row['se']:.2g} {question.unit}")
            for name, row in self.ranking.iloc[1:].iterrows()
            if name not in self.close
        ]
        P_n = self.result.cells["group"].str.partition(", ")[2].drop_duplicates()
        return Document(
            title,
            [
                Paragraph(alike if len(self.ranking) > 1 else "No other method took part."),
                *([Items(worse, numbered=False)] if worse else []),
                Paragraph(
                    f"From {int(best['n'])} simulated runs ({'; '.join(P_n)}), tuned by validation "
                    "VAF on others. To fit to recordings:"
                ),
                Paragraph(repr(self.estimator)),
            ],
        )

    def plot(self, kind: str = "bias", **options: Any) -> Any:
        """Draw the tournament behind it, as :meth:`TournamentResult.plot` does."""
        return self.result.plot(kind, **options)


@checked(
    remnant_intensity=[Interval(Real, 0, None, closed="neither"), "array-like", None],
    question=[StrOptions(set(QUESTIONS))],
    parameter=[str],
    causal=["boolean", None],
    methods=["array-like", None],
    n_replications=[Interval(Integral, 2, None, closed="left")],
    n_validation=[Interval(Integral, 1, None, closed="left")],
    random_state=[Interval(Integral, 0, None, closed="left")],
)
def recommend_method(
    task: str | Condition | CompensatoryTask,
    remnant_intensity: float | Sequence[float] | None = None,
    *,
    question: str = "follow",
    parameter: str = FOLLOWED,
    causal: bool | None = None,
    methods: Sequence[str] | None = None,
    remnant_order: Any = 2,
    n_replications: int = 10,
    n_validation: int = 3,
    random_state: int = 0,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> MethodAdvice:
    """Find the method for an experiment and a question, by a tournament on a simulation of it.

    Runs of the experiment are simulated, every method is tuned by validation runs and follows
    others, and its answers are compared with the truth.

    Parameters
    ----------
    task : str, Condition or CompensatoryTask
        The experiment: controlled element, forcing functions, sampling rate, duration, and the
        expected operator with all changes over time; or the name of a condition of the thesis.
    remnant_intensity : float, sequence of float or None, default=None
        Expected P_n, or several to average over; None means the task's own remnant.
    question : {"follow", "final", "detect", "predict", "delay"}, default="follow"
        "follow": the RMSE over time of a parameter; "final": its RMSE after the change; "detect":
        the time to an alarm, with one false alarm in ten; "predict": the validation VAF; "delay":
        the RMSE over time of tau_e.
    parameter : {"K_edot", "K_e", "omega_nm", "zeta_nm", "tau_e"}, default="K_edot"
        For "follow" and "final".
    causal : bool or None, default=None
        Whether the answer is needed while the person steers (True) or afterwards, by a method that
        also uses later data (False). None means any.
    methods : sequence of str or None, default=None
        Names in :data:`TOURNAMENT_METHODS`; None means all that can be imported.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter.
    n_replications : int, default=10
        Runs for each intensity.
    n_validation : int, default=3
        Validation runs for each intensity.
    random_state : int, default=0
        Source of all randomness.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    advice : MethodAdvice
        ``print(advice)`` shows it as text; ``advice.estimator`` is ready to be fitted.

    Raises
    ------
    ValueError
        If there is no remnant, nothing changes but the question is about a change, or a method is
        not known.

    Notes
    -----
    Methods are compared on the same runs: standard errors are those of the mean difference from
    the best method. They say nothing about the validation runs, which all share.

    Examples
    --------
    >>> from skhoid.lab.studies import recommend_method
    >>> advice = recommend_method(
    ...     "C3", 0.15, question="predict", methods=["rls", "arx"], n_replications=2
    ... )
    >>> advice.method, advice.close
    ('rls', ['rls'])
    """
    find_question(question)
    if not isinstance(task, CompensatoryTask):
        task = CompensatoryTask.of_condition(task, run_in=SIMULATION["run_in"])
    chosen, _ = available_methods(methods, causal=causal)
    of_delay = question == "delay" or (parameter == "tau_e" and question in ("follow", "final"))
    names = [m.name for m in chosen if not m.is_oracle and (m.estimates_delay or not of_delay)]
    if not names:
        lacking = "estimates the delay" if of_delay else "does without the truth"
        raise ValueError(f"None of these methods {lacking}.")
    cells = _cells(task, remnant_intensity, remnant_order, question)
    result = run_tournament(
        names,
        cells,
        size="small",
        n_replications=n_replications,
        n_validation=n_validation,
        random_state=random_state,
        n_jobs=n_jobs,
        progress=progress,
    )
    return _advice(result, question, parameter, task)


def _cells(
    task: CompensatoryTask, intensity: Any, order: Any, question: str
) -> list[TournamentCell]:
    if intensity is None:
        if task.remnant is None or not (task.remnant.gain or task.remnant.intensity):
            raise ValueError(
                "Give remnant_intensity, such as 0.15: without remnant every method is right."
            )
        wanted: list[float | None] = [None]
    else:
        wanted = [float(P_n) for P_n in np.atleast_1d(intensity)]
        if min(P_n for P_n in wanted if P_n is not None) <= 0:
            raise ValueError(f"remnant_intensity must be above 0; got {intensity!r}.")
        task = replace(task, remnant=None)
    changes = Change.of(replace(task, remnant=None)).times is not None
    if not changes and question in ("final", "detect"):
        raise ValueError(
            f"Nothing changes in this task, so the question {question!r} has no answer: give an "
            "operator with parameters over time, such as a Sigmoid or Step."
        )
    cells = []
    for P_n in wanted:
        text = "own remnant" if P_n is None else f"P_n {P_n:g}"
        kind = "changing" if changes else "constant"
        cells.append(TournamentCell(f"task, {text}", task, P_n, order, kind=kind))
        if question == "detect":
            still = TournamentCell(
                f"task before the change, {text}", task.at(0.0), P_n, order, kind="constant"
            )
            cells.append(still)
    return cells


def _advice(
    result: TournamentResult, question: str, parameter: str, task: CompensatoryTask
) -> MethodAdvice:
    found = losses(result.table, question, parameter).dropna(how="any", axis=1)
    order = found.mean().sort_values(kind="stable")
    best = str(order.index[0])
    apart = found[order.index].sub(found[best], axis=0)
    error = _paired_error(apart)
    taken = result.tuning[result.tuning["chosen"]]
    changing = taken["group"].str.startswith("changing")
    taken = (taken[changing] if changing.any() else taken).drop_duplicates("method")
    ranking = pd.DataFrame(
        {
            "loss": order,
            "difference": apart.mean(),
            "se": error,
            "setting": taken.set_index("method")["setting"].reindex(order.index),
            "causal": result.methods["causal"].reindex(order.index),
            "n": found.count(),
        }
    ).reindex(order.index)
    ranking.index.name = "method"
    near = (ranking["difference"] <= SIGNIFICANT * ranking["se"]) | (ranking["difference"] <= 0)
    how = TOURNAMENT_METHODS[best]
    setting = next(s for s in how.settings if str(s) == ranking["setting"].iloc[0])
    nk = delay_samples(task.operator, 1 / task.sampling_rate, nearest=True)
    return MethodAdvice(
        method=best,
        estimator=how.estimator(1 / task.sampling_rate, nk, setting),
        close=ranking.index[near].tolist(),
        ranking=ranking,
        question=question,
        parameter=parameter,
        result=result,
    )


def _paired_error(apart: pd.DataFrame) -> pd.Series:
    """Standard errors of means over cells of differences between methods on the same data sets."""
    grouped = apart.groupby(DATA_SET[0])
    variance = (grouped.var() / grouped.count()).mean() / grouped.ngroups
    return np.sqrt(variance)
