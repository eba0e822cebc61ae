"""recommend_forgetting: the memory horizon for a planned experiment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ...arx.forgetting import forgetting_factor
from ...simulation.conditions import Condition
from ...simulation.task import CompensatoryTask, change_times
from ...text import Summary
from ..studies.montecarlo.horizons import SETTING, forgetting_vaf, kept_run_in, succeeded, with_gain
from ..studies.montecarlo.study import MonteCarloStudy

FIRST = 3 / 8  # of the duration, in which nothing changes: 30.72 s of 81.92 s
HALF_WIDTH = 1 / 8  # of the duration, on either side of the change
WIDER = 0.75  # times the duration of the change
SHORTEST = 2.0  # s from which theta0 may come
SIGNIFICANT = 2.0  # standard errors
RUNS = ["remnant_intensity", "replication", "validation"]


@dataclass(frozen=True, eq=False, repr=False)
class ForgettingAdvice:
    """The memory horizon that suits an experiment, and the results behind it.

    Parameters
    ----------
    memory_horizon : float
        N0 in samples with the highest mean VAF on validation runs; infinity (no forgetting) if that
        is as good.
    memory_time : float
        The same in s.
    forgetting : float
        λ = 1 - 1/N0.
    close : list of float
        Horizons whose mean VAF is within two standard errors (paired) of the highest.
    gain : float
        VAF points gained over no forgetting.
    summary : DataFrame
        Mean VAF on estimation and validation runs, gain and its standard error, by intensity, form
        and horizon.
    table : DataFrame
        VAF of each estimation run on each validation run.
    window : tuple of float
        Where validation runs were scored, in s.
    sampling_rate : float
        Sampling rate in Hz.

    Examples
    --------
    >>> from skhoid import recommend_forgetting
    >>> advice = recommend_forgetting("C4", remnant_intensity=0.1, n_replications=8)
    >>> advice.memory_horizon, advice.memory_time
    (256.0, 2.56)
    """

    memory_horizon: float
    memory_time: float
    forgetting: float
    close: list[float]
    gain: float
    summary: pd.DataFrame
    table: pd.DataFrame
    window: tuple[float, float]
    sampling_rate: float

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return Summary(self)._repr_html_()

    def __str__(self) -> str:
        runs = self.table["replication"].nunique()
        intensities = ", ".join(f"{P:.2g}" for P in self.table["remnant_intensity"].unique())
        if np.isinf(self.memory_horizon):
            head = "Do not forget (λ = 1): no memory horizon gives a clearly better VAF."
        else:
            head = (
                f"N0 = {self.memory_horizon:g} samples ({self.memory_time:.3g} s, "
                f"λ = {self.forgetting:.5f}): VAF {self.gain:+.1f} points over no forgetting."
            )
        others = [N0 for N0 in self.close if self.memory_horizon != N0]
        alike = (
            f"Equally good within two standard errors: N0 = "
            f"{', '.join(f'{N0:g}' for N0 in others)}."
            if others
            else "All other horizons of the grid are worse by more than two standard errors."
        )
        apart = self._matrix()
        return "\n".join(
            [
                head,
                alike,
                f"Forgetting only b0 and b1 (Λ), at its best: {apart:+.2f} points.",
                f"From {runs} runs at P_n = {intensities}, {self.sampling_rate:g} Hz, scored from "
                f"{self.window[0]:.4g} to {self.window[1]:.4g} s on runs that were not fitted.",
            ]
        )

    def _matrix(self) -> float:
        """VAF points gained by Λ over λ, each at its best."""
        mean = self.summary["vaf_validation"].groupby(SETTING).mean().groupby("form").max()
        return float(mean["Lambda"] - mean["lambda"])

    def plot(self, kind: str = "gain") -> Any:
        """Draw the trade-off.

        Parameters
        ----------
        kind : str, default="gain"
            As in :class:`skhoid.plotting.StudyTradeOffDisplay`.

        Returns
        -------
        display : StudyTradeOffDisplay
        """
        from ...plotting import StudyTradeOffDisplay

        good = succeeded(self.table)
        cell = ["remnant_intensity", "replication", *SETTING]
        table = good.groupby(cell)[["vaf_estimation", "vaf_validation"]].mean().reset_index()
        table.insert(0, "condition", "this task")
        return StudyTradeOffDisplay.from_table(table, kind=kind)


def recommend_forgetting(
    task: str | Condition | CompensatoryTask,
    remnant_intensity: float | Sequence[float] | None = None,
    *,
    remnant_order: Any = 2,
    memory_horizons: Sequence[float] | None = None,
    window: tuple[float, float] | None = None,
    init_window: float | None = None,
    n_replications: int = 20,
    n_validation: int = 10,
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> ForgettingAdvice:
    """Find the memory horizon for an experiment, by the study of Fig. 13 on a simulation of it.

    Estimation runs are simulated, recursive ARX[2, 2] models with every memory horizon follow them,
    and each path of parameters is simulated on validation runs. The horizon that does best on those
    is long enough to average out remnant, and short enough to follow the change.

    Parameters
    ----------
    task : str, Condition or CompensatoryTask
        The experiment: controlled element, forcing functions, sampling rate, duration, and the
        expected operator, with all changes over time; or the name of a condition of the thesis.
    remnant_intensity : float, sequence of float or None, default=None
        Expected P_n, or several to average over; None means the task's own remnant.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter.
    memory_horizons : sequence of float or None, default=None
        N0 in samples; None means 2, 4, 8 ... up to the samples of a run, and infinity.
    window : (float, float) or None, default=None
        Where validation runs are scored, in s. None means around the change: an eighth of the
        duration on either side of its middle, or more if the change takes longer; if nothing
        changes, everything after ``init_window``.
    init_window : float or None, default=None
        Seconds of the run that give theta0; None means three eighths of the duration, but no
        further than ``window``.
    n_replications : int, default=20
        Estimation runs for each intensity.
    n_validation : int, default=10
        Validation runs.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    advice : ForgettingAdvice
        ``print(advice)`` shows it as text; ``advice.plot()`` draws VAF by memory horizon.

    Raises
    ------
    ValueError
        If there is no remnant (the shortest memory then always wins), or windows do not fit.
    RemnantIntensityError
        If the loop cannot reach the intensity.

    Notes
    -----
    Signals are first scaled to unit power, so that P0 = I weighs as much as one sample whatever the
    units.

    References
    ----------
    Van Grootheest, thesis, Sections IV-E and V-B.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from skhoid import CompensatoryTask, recommend_forgetting
    >>> task = CompensatoryTask.of_condition("C3", sampling_rate=50.0)
    >>> advice = recommend_forgetting(task, remnant_intensity=0.15, n_replications=8)
    >>> advice.memory_time, round(advice.forgetting, 4)
    (2.56, 0.9922)
    """
    if not isinstance(task, CompensatoryTask):
        task = CompensatoryTask.of_condition(task)
    rate = task.sampling_rate
    around = change_window(task) if window is None else (float(window[0]), float(window[1]))
    first = _init_window(task, around) if init_window is None else float(init_window)
    around = (first, task.duration) if around is None else around
    if not 0 <= around[0] < around[1] <= task.duration + 1e-9:
        raise ValueError(
            f"window={around} does not lie in the run of {task.duration:g} s (from 0 s on)."
        )
    if not 0 < first <= task.duration:
        raise ValueError(
            f"init_window must be a time within the run of {task.duration:g} s; got {first:g}."
        )
    horizons = _horizons(memory_horizons, task.n_samples)
    study = MonteCarloStudy(
        partial(
            forgetting_vaf,
            memory_horizons=horizons,
            window=around,
            init_window=first,
            scaled=True,
            by_run=True,
        ),
        _cells(task, remnant_intensity, remnant_order),
        n_replications,
        n_validation_runs=n_validation,
        simulation={"keep_run_in": kept_run_in(task)},
        batched=True,
        block_size=25,
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress).drop(columns="condition")
    if table["error"].notna().all():
        raise ValueError(f"Every simulated run failed. The first error: {table['error'].iloc[0]}")
    if "remnant_intensity" not in table:
        table.insert(0, "remnant_intensity", table["P_n"].mean())
    return _advice(table, around, rate)


def _advice(table: pd.DataFrame, window: tuple[float, float], rate: float) -> ForgettingAdvice:
    good = succeeded(table)
    of_lambda = good[good["form"] == "lambda"]
    vaf = of_lambda.pivot(index=RUNS, columns="memory_horizon", values="vaf_validation")
    best = float(vaf.mean().idxmax())
    worse = vaf.rsub(vaf[best], axis=0)
    near = worse.mean() <= SIGNIFICANT * crossed_standard_error(worse)  # not where it is NaN
    close = [float(N0) for N0 in vaf.columns if best == N0 or near[N0]]
    if np.inf in close:
        best = np.inf
    return ForgettingAdvice(
        memory_horizon=best,
        memory_time=best / rate,
        forgetting=float(forgetting_factor(best)),
        close=close,
        gain=float(vaf[best].mean() - vaf[np.inf].mean()),
        summary=_summary(good),
        table=table,
        window=window,
        sampling_rate=rate,
    )


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    grouped = with_gain(table, RUNS).groupby(["remnant_intensity", *SETTING])
    means = grouped[["vaf_estimation", "vaf_validation", "gain"]].mean()
    errors = [crossed_standard_error(part.set_index(RUNS)[["gain"]])["gain"] for _, part in grouped]
    return means.assign(se_gain=errors)


def crossed_standard_error(values: pd.DataFrame) -> pd.Series:
    """Standard errors of means over estimation and validation runs, both random.

    Both vary: var(mean) = var_e / n_e + var_v / n_v, where each is the variance of means over the
    other kind (crossed random effects; their interaction is counted twice, which errs on the safe
    side). NaN with a single run of either.
    """
    levels = ["remnant_intensity", "replication"], ["remnant_intensity", "validation"]
    variance: Any = 0.0
    for level in levels:
        means = values.groupby(level).mean()
        variance = variance + means.groupby("remnant_intensity").var().div(
            means.groupby("remnant_intensity").count()
        )
    return np.sqrt(variance.mean() / len(variance))


def _cells(task: CompensatoryTask, intensity: Any, order: Any) -> list[dict[str, Any]]:
    if intensity is None:
        if task.remnant is None or not (task.remnant.gain or task.remnant.intensity):
            raise ValueError(
                "Give remnant_intensity, such as 0.15: without remnant the shortest memory is "
                "always best."
            )
        return [{"condition": task}]
    wanted = [float(P_n) for P_n in np.atleast_1d(intensity)]
    if min(wanted) <= 0:
        raise ValueError(
            f"remnant_intensity must be above 0, since without remnant the shortest memory is "
            f"always best; got {intensity!r}."
        )
    return [
        {"condition": replace(task, remnant=None), "remnant_intensity": P_n, "remnant_order": order}
        for P_n in wanted
    ]


def _horizons(given: Sequence[float] | None, n_samples: int) -> tuple[float, ...]:
    if given is None:
        return (*(2.0**i for i in range(1, int(np.log2(n_samples)) + 1)), np.inf)
    horizons = tuple(sorted({float(N0) for N0 in given} | {np.inf}))
    if horizons[0] <= 1:
        raise ValueError(f"memory_horizons must be above 1; got {horizons[0]:g}.")
    return horizons


def change_window(task: CompensatoryTask) -> tuple[float, float] | None:
    """Seconds around the change of a task's parameters; None where nothing changes in the run."""
    times = change_times(task)
    if times is None:
        return None
    early, middle, late = times
    half = max(HALF_WIDTH * task.duration, WIDER * (late - early))
    return max(0.0, middle - half), min(task.duration, middle + half)


def _init_window(task: CompensatoryTask, around: tuple[float, float] | None) -> float:
    first = FIRST * task.duration
    if around is not None and SHORTEST <= around[0] < first:
        return around[0]
    return first
