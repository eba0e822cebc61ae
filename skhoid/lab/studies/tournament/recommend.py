"""recommend_method: the method for one's own experiment and question."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd

from ...._sklearn import Interval, StrOptions, checked
from ....human.operator import delay_samples
from ....simulation.conditions import Condition
from ....simulation.task import CompensatoryTask
from ....text import Summary, wrapped
from .cells import TournamentCell
from .changes import Change
from .figures import FOLLOWED
from .methods import TOURNAMENT_METHODS, available_methods
from .questions import DATA_SET, QUESTIONS, losses, question_of
from .result import TournamentResult
from .study import run_tournament
from .tuning import SIMULATION

SIGNIFICANT = 2.0  # standard errors


@dataclass(frozen=True, eq=False, repr=False)
class MethodAdvice:
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

    Examples
    --------
    >>> from skhoid.lab.studies.tournament import recommend_method
    >>> advice = recommend_method("C4", 0.15, methods=["rls", "arx"], n_replications=2)
    >>> advice.estimator
    RecursiveARX(memory_time=5.12, nk=29, store_covariance=True)
    """

    method: str
    estimator: Any
    close: list[str]
    ranking: pd.DataFrame
    question: str
    parameter: str
    result: TournamentResult

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return Summary(self)._repr_html_()

    def __str__(self) -> str:
        question, best = QUESTIONS[self.question], self.ranking.iloc[0]
        label = TOURNAMENT_METHODS[self.method].label
        lines = wrapped(
            f"To {question.worded(self.parameter)}: {self.method} ({label}); {question.loss} "
            f"{best['loss']:.3g} {question.unit}."
        )
        others = [name for name in self.close if name != self.method]
        alike = "All other methods are worse by more than two standard errors."
        if others:
            alike = f"Equally good within two standard errors: {', '.join(others)}."
        lines += wrapped(alike if len(self.ranking) > 1 else "No other method took part.")
        for name, row in self.ranking.iloc[1:].iterrows():
            if name not in self.close:
                lines += wrapped(
                    f"  {name}: {row['difference']:+.3g} ± {row['se']:.2g} {question.unit}", "  "
                )
        P_n = self.result.cells["group"].str.partition(", ")[2].drop_duplicates()
        lines += wrapped(
            f"From {int(best['n'])} simulated runs ({'; '.join(P_n)}), tuned by validation VAF on "
            "others. To fit to recordings:"
        )
        return "\n".join([*lines, "", repr(self.estimator)])

    def plot(self, kind: str = "bias", **options: Any) -> Any:
        """Draw the tournament behind it.

        Parameters
        ----------
        kind : {"bias", "settling", "winners"}, default="bias"
            As for :meth:`TournamentResult.plot`.
        **options
            Of the display.

        Returns
        -------
        display : Display
        """
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
    delay: str = "true",
    random_state: int = 0,
    out: str | os.PathLike[str] | None = None,
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
    delay : {"true", "searched"}, default="true"
        What methods are told that do not estimate the delay, as for :func:`run_tournament`.
    random_state : int, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`.
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

    See Also
    --------
    skhoid.recommend_forgetting : The memory of recursive least squares alone, more finely.

    Notes
    -----
    Methods are compared on the same runs: standard errors are those of the mean difference from
    the best method. They say nothing about the validation runs, which all share.

    Examples
    --------
    >>> from skhoid.lab.studies.tournament import recommend_method
    >>> advice = recommend_method(
    ...     "C3", 0.15, question="predict", methods=["rls", "arx"], n_replications=2
    ... )
    >>> advice.method, advice.close
    ('rls', ['rls'])
    """
    question_of(question)
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
        delay=delay,
        random_state=random_state,
        out=out,
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
    taken = result.tuning[result.tuning["chosen"]].drop_duplicates("method", keep="first")
    if (result.tuning["group"].str.startswith("changing")).any():
        changing = result.tuning["group"].str.startswith("changing")
        taken = result.tuning[result.tuning["chosen"] & changing].drop_duplicates("method")
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
        estimator=how.make(1 / task.sampling_rate, nk, setting),
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
