"""analyse_experiment: the analysis of Section VI for all subjects and conditions."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from ...exceptions import MissingDataWarning, RunTimeWarning, UsageError
from .cell_analysis import AnalysisPlan, CellTables, analyse_cell
from .read import Cell, read_cells
from .result import ExperimentResult, verdicts


def analyse_experiment(
    X: pd.DataFrame,
    y: Any,
    *,
    last: int | None = 5,
    memory_horizon: float = 256.0,
    memory_time: float | None = None,
    delay: Any = None,
    input: str = "e",
    run_in: float | None = None,
    measurement_time: float | None = None,
    region: float = 30.72,
    transition_time: Any = None,
    fit_intercept: bool = False,
    step: float = 0.16,
    n_jobs: int | None = None,
) -> ExperimentResult:
    """Analyse an experiment with several people, conditions and runs, as in Section VI.

    For each subject and condition, take the last runs without their run-in and find their common
    delay n_k*. Fit ARX models with n_a = n_b = 2: batch models of the first and the last region of
    each run, and recursive models of each run that forget all parameters (λ), or b0 and b1 only
    (Λ), starting from the batch model of the first region with P0 = I. Average them over the runs,
    and convert them all to parameters of the operator. Each run's models are validated on the other
    runs.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_channels)
        Channels with the row index levels ``run`` and ``time`` (s), and ``subject`` and
        ``condition`` if there are any. Besides the error, ``f_t`` (or ``x``) is used for the
        tracking score only.
    y : Series or array of shape (n_rows,)
        Control output.
    last : int or None, default=5
        How many runs of each subject and condition to use, counted from the last; None means all.
    memory_horizon : float, default=256.0
        N0 in samples.
    memory_time : float or None, default=None
        N0 dt in s, instead of ``memory_horizon``; 2.56 s in the thesis, at 100 Hz.
    delay : float, dict or None, default=None
        Delay n_k dt in s, including the sample of zero-order hold; a dict has it by (subject,
        condition), subject or condition. None searches up to 0.5 s.
    input : str, default="e"
        Column of the error.
    run_in : float or None, default=None
        Seconds to leave out at the start of each run.
    measurement_time : float or None, default=None
        Seconds to keep at the end of each run; 81.92 in the thesis. If neither is given, negative
        times are the run-in.
    region : float, default=30.72
        Length of the first and the last region in s.
    transition_time : float, dict by condition, or None, default=None
        When the controlled element changes, in s of the time index; shown in plots.
    fit_intercept : bool, default=False
        Add a constant to the models, for recordings with an offset.
    step : float, default=0.16
        Time between the points at which parameter paths are kept, in s.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.

    Returns
    -------
    result : ExperimentResult
        Tables, ``summary()`` and ``plot()``.

    Raises
    ------
    ShortRunError
        If a run is shorter than two regions; the message names it.
    RunIndexError, IrregularSamplingError
        If rows, runs or time violate the data convention.
    ValueError
        If there is no column of the error, or an option is not valid.

    See Also
    --------
    simulate_experiment : Simulate recordings whose truth is known.
    skhoid.read_runs : Read your own recordings.

    Notes
    -----
    Runs of a subject in a condition are compared over the time that they share; runs with different
    times, subjects without runs in a condition and missing runs are listed in ``result.notes``.
    Times are those of the index.

    References
    ----------
    Van Grootheest, thesis, Section VI and App. M.

    Examples
    --------
    >>> from skhoid.lab.experiment import analyse_experiment, simulate_experiment
    >>> X, y = simulate_experiment(2, "C4", random_state=0)
    >>> result = analyse_experiment(X, y, transition_time=41.92)
    >>> print(result.summary())
    2 subjects, 1 condition; 5 runs of each, from 0 to 81.92 s at 100 Hz.
    Delay 0.26 s; memory horizon 256 samples, 2.56 s.
    ...
    C4: S2 adapts (K_e 0.084 to 0.058, -31 %, K_edot 0.035 to 0.078 s, +124 %);
        S1 shows no change beyond the scatter of runs.
    ...

    Your own recordings of one person in one condition, in the files run1.csv to run7.csv with the
    columns t, error and stick, of which the last 81.92 s are the measurement:

    >>> from skhoid import read_runs
    >>> X, y = read_runs(
    ...     "run*.csv", inputs={"error": "e"}, output="stick", time="t"
    ... )  # doctest: +SKIP
    >>> analyse_experiment(X, y, measurement_time=81.92).summary()  # doctest: +SKIP
    """
    _check_options(last, region, step, run_in, measurement_time)
    cells, dt, notes = read_cells(X, y, last, input, run_in, measurement_time, region)
    horizon = _in_samples(memory_horizon, memory_time, dt)
    plan = AnalysisPlan(horizon, delay, input, region, fit_intercept, step, dt)
    times = _transition_times(transition_time, [cell.condition for cell in cells])
    return _joined(_found(cells, plan, n_jobs), plan, times, notes)


def _check_options(
    last: int | None,
    region: float,
    step: float,
    run_in: float | None,
    measurement_time: float | None,
) -> None:
    if last is not None and last < 1:
        raise ValueError(f"last must be a number of runs, at least 1; got {last}.")
    for name, value in (("region", region), ("step", step)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be a time in s, above 0; got {value!r}.")
    if run_in is not None and measurement_time is not None:
        raise UsageError(
            "The run-in (leave out the first seconds) and the measurement time (keep the last "
            "seconds) are both given.",
            hint="Give run_in= or measurement_time=, not both.",
            options=["run_in", "measurement_time"],
        )


def _in_samples(memory_horizon: float, memory_time: float | None, dt: float) -> float:
    horizon = float(memory_horizon if memory_time is None else memory_time / dt)
    if not horizon > 1:
        raise ValueError(f"The memory horizon must be more than one sample; got {horizon:g}.")
    return horizon


def _found(cells: list[Cell], plan: AnalysisPlan, n_jobs: int | None) -> list[CellTables]:
    """The results for each cell."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)  # the notes count it
        warnings.simplefilter("ignore", RunTimeWarning)  # and say what runs do not share
        return Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(analyse_cell)(cell, plan) for cell in cells
        )


def _joined(
    found: list[CellTables], plan: AnalysisPlan, times: dict[Any, float], notes: list[str]
) -> ExperimentResult:
    """The tables of all cells concatenated, and what they say about change."""
    joined = {
        name: pd.concat([getattr(f, name) for f in found], ignore_index=True)
        for name in ("paths", "batch", "scores", "validation", "changes")
    }
    joined["scores"].attrs = dict(found[0].scores.attrs)
    return ExperimentResult(
        **joined,
        delays=pd.DataFrame([f.delay for f in found]),
        verdicts=verdicts(joined["changes"], joined["validation"]),
        notes=[*notes, *(note for f in found for note in f.notes)],
        dt=plan.dt,
        memory_horizon=plan.memory_horizon,
        region=plan.region,
        transition_times=times,
    )


def _transition_times(given: Any, conditions: list[Any]) -> dict[Any, float]:
    if given is None:
        return {}
    if isinstance(given, (int, float, np.number)):
        return dict.fromkeys(conditions, float(given))
    return {name: float(time) for name, time in dict(given).items() if name in conditions}
