"""A stand-in for the experiment of Section VI."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from ..exceptions import MissingDataWarning, RunTimeWarning
from ..runs import RUN, TIME
from ..simulation.conditions import known_name
from ..simulation.engine import entropy_of
from .analysis import AnalysisPlan, analyse_cell
from .read import read_cells
from .result import ExperimentResult, verdicts
from .subjects import STANDARD, RecordingSetup, draw_participant, physics_of


def simulate_experiment(
    subjects: int = 3,
    conditions: str | Sequence[str] = "C1-C6",
    runs: int = 7,
    *,
    remnant_intensity: float | None = None,
    sampling_rate: float = 100.0,
    duration: float = 81.92,
    run_in: float = 8.08,
    transition_time: float | None = None,
    random_state: Any = None,
    return_truth: bool = False,
    n_jobs: int | None = None,
) -> Any:
    """Simulate an experiment: several people, each in several conditions, several runs of each.

    A stand-in for recordings like those of Section VI. People differ in gains, lead, delay,
    neuromuscular mode and remnant, drawn around Table II; they learn over the first runs, differ
    a little from run to run, and follow a change of the controlled element 0.2 to 1 s later. S1,
    S4, S7, ... hardly adapt to it.

    Parameters
    ----------
    subjects : int, default=3
        Number of people.
    conditions : str or sequence of str, default="C1-C6"
        Conditions of the thesis: a name, a range of them, or a list.
    runs : int, default=7
        Number of runs of each person in each condition.
    remnant_intensity : float or None, default=None
        P_n = var(n) / var(u) of practised runs, for all people; 0 is none. None draws it for each
        (median 0.12). It is met in C1 and C2; in C3 to C6 the gain K_n goes from one to the
        other.
    sampling_rate : float, default=100.0
        In Hz.
    duration : float, default=81.92
        Measurement window in s.
    run_in : float, default=8.08
        Time recorded before it, in s, from rest. It is at negative time: the window begins at 0.
    transition_time : float or None, default=None
        When the controlled element changes in C3 to C6, in s from the beginning of the window.
        None means at the same part of the recording as in the thesis: 50.00 s of 90.00, 41.92 s
        of the window.
    random_state : int, RandomState, Generator or None, default=None
        Source of all randomness. A run is the same whatever other subjects, conditions and runs
        there are.
    return_truth : bool, default=False
        Also return the parameters of the people.
    n_jobs : int or None, default=None
        Number of threads, one for each person, as in joblib.

    Returns
    -------
    X : DataFrame of shape (n_rows, 3)
        Error ``e``, output of the controlled element ``x``, target ``f_t`` (deg), with the row
        index levels ``subject`` ("S1", ...), ``condition``, ``run`` (from 1), ``time`` (s).
    y : Series of shape (n_rows,)
        Control output ``u`` (deg).
    truth : DataFrame
        Only with ``return_truth``: a row for each subject and condition, with K_e, T_L (s),
        K_edot (s) and K_n at both ends (``K_e_initial``, ``K_e_final``, ...), tau_e (s), omega_nm
        (rad/s), zeta_nm, remnant_order, remnant_intensity, adaptation (part of the change of
        Table II that is made), adaptation_lag (s) and transition_time (s; NaN in C1 and C2).
        These are of practised runs.

    Raises
    ------
    UnstableLoopError
        If no draw of a person keeps control.
    RemnantIntensityError
        If the recording does not determine the gain of the remnant.
    ValueError
        If numbers or names make no sense.

    See Also
    --------
    analyse_experiment : The analysis of such recordings.
    skhoid.make_tracking_runs : Runs of one operator whose parameters you choose.

    Notes
    -----
    Standard deviations of logarithms between people: K_e 0.25, T_L 0.15, tau_e 0.10 (to whole
    samples), omega_nm 0.12, zeta_nm 0.20, P_n 0.40 (0.04 to 0.25); the remnant is of order 2 or
    3. Of the change between the states of Table II people make 0.7 to 1.1, those who hardly adapt
    0 to 0.15, also in C2. In its first run a person has 0.85 times the gain and 1.5 times the
    remnant power of a practised one; the differences fall by e in two runs. Gains scatter by 5 %
    from run to run.

    Who has less than 15 deg of phase margin in C1 or C2, or in any condition an error larger
    than the target, is drawn again, and so is a run that becomes unstable.

    References
    ----------
    Van Grootheest, thesis, Section VI-A and App. M. The 42.93 s that these give for the change
    do not fit 90.00 s.

    Examples
    --------
    >>> from skhoid.experiment.people import simulate_experiment
    >>> X, y, truth = simulate_experiment(2, "C3-C4", runs=2, return_truth=True, random_state=0)
    >>> X.shape, X.index.names
    ((72000, 3), FrozenList(['subject', 'condition', 'run', 'time']))
    >>> truth[["K_e_initial", "T_L_initial", "T_L_final", "tau_e"]].xs("C4", level=1).round(2)
             K_e_initial  T_L_initial  T_L_final  tau_e
    subject
    S1              0.09         0.49       0.52   0.26
    S2              0.09         0.46       1.41   0.26
    """
    recording = _recording(sampling_rate, duration, run_in, transition_time)
    names = _conditions(conditions)
    for what, number in (("subjects", subjects), ("runs", runs)):
        if isinstance(number, bool) or int(number) != number or number < 1:
            raise ValueError(f"{what} is a whole number, at least 1; got {number!r}.")
    if remnant_intensity is not None and not 0 <= remnant_intensity < 1:
        raise ValueError(
            "remnant_intensity is the fraction var(n) / var(u), from 0 to below 1; got "
            f"{remnant_intensity!r}."
        )
    entropy = entropy_of(random_state)

    def session(number: int) -> tuple[np.ndarray, list[dict[str, Any]]]:
        participant = draw_participant(number, recording, entropy, intensity=remnant_intensity)
        records = [participant.run(name, run) for name in names for run in range(1, runs + 1)]
        signals = [np.stack([r.e[0], r.x[0], r.f_t[0], r.u[0]], axis=1) for r in records]
        truth = [
            {"subject": f"S{number}", "condition": name} | physics_of(participant, name)
            for name in names
        ]
        return np.concatenate(signals), truth

    done = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(session)(number) for number in range(1, subjects + 1)
    )
    n_run_in, rate = round(run_in * sampling_rate), sampling_rate
    n_rows = len(done[0][0]) // (len(names) * runs)
    index = pd.MultiIndex.from_product(
        [
            [f"S{number}" for number in range(1, subjects + 1)],
            names,
            range(1, runs + 1),
            np.arange(-n_run_in, n_rows - n_run_in) / rate,
        ],
        names=["subject", "condition", RUN, TIME],
    )
    table = np.concatenate([signals for signals, _ in done])
    X = pd.DataFrame(table[:, :3], index=index, columns=["e", "x", "f_t"])
    y = pd.Series(table[:, 3].copy(), index=index, name="u")
    X.attrs["units"] = dict.fromkeys(X.columns, "deg")
    y.attrs["units"] = {"u": "deg"}
    if not return_truth:
        return X, y
    rows = [row for _, of_subject in done for row in of_subject]
    return X, y, pd.DataFrame(rows).set_index(["subject", "condition"])


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

    For each subject and condition: the last runs without their run-in; the delay n_k* of all of
    them; ARX models with n_a = n_b = 2, batch models of the first and the last region of each
    run, and recursive models of each run that forget all parameters (λ), or b0 and b1 only (Λ),
    from the batch model of its first region with P0 = I; their means over the runs; all of them
    as parameters of the operator. Each run's models are validated on the other runs.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_channels)
        Channels with the row index levels ``run`` and ``time`` (s), and ``subject`` and
        ``condition`` where there are any. Besides the error, ``f_t`` (or ``x``) serves the
        tracking score only.
    y : Series or array of shape (n_rows,)
        Control output.
    last : int or None, default=5
        How many runs of each subject and condition; None means all.
    memory_horizon : float, default=256.0
        N0 in samples.
    memory_time : float or None, default=None
        N0 dt in s, in place of it: the thesis's is 2.56 s, at 100 Hz.
    delay : float, dict or None, default=None
        Delay in s, n_k dt, which includes the sample of zero-order hold; by (subject, condition),
        subject or condition if a dict. None searches up to 0.5 s.
    input : str, default="e"
        Column of the error.
    run_in : float or None, default=None
        Seconds to leave out at the beginning of each run.
    measurement_time : float or None, default=None
        Seconds to keep at the end of each run; 81.92 in the thesis. With neither, times below 0
        are the run-in.
    region : float, default=30.72
        Length of the first and the last region in s.
    transition_time : float, dict by condition, or None, default=None
        When the controlled element changes, in s of the time index; for pictures.
    fit_intercept : bool, default=False
        Add a constant to the models, for recordings that are not about zero.
    step : float, default=0.16
        Time between the instants that are kept of paths, in s.
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
        If rows, runs or time break the data convention.
    ValueError
        If there is no column of the error, or options make no sense.

    See Also
    --------
    simulate_experiment : Recordings whose truth is known.
    skhoid.read_runs : Recordings of your own.

    Notes
    -----
    Runs of a subject in a condition are compared over the time that they share; runs that differ
    in it, subjects without runs in a condition and missing runs are in ``result.notes``. Times
    are those of the index.

    References
    ----------
    Van Grootheest, thesis, Section VI and App. M.

    Examples
    --------
    >>> from skhoid.experiment.people import analyse_experiment, simulate_experiment
    >>> X, y = simulate_experiment(2, "C4", random_state=0)
    >>> result = analyse_experiment(X, y, transition_time=41.92)
    >>> print(result.summary())
    2 subjects, 1 condition; 5 runs of each, from 0 to 81.92 s at 100 Hz.
    Delay 0.26 s; memory horizon 256 samples, 2.56 s.
    ...
    C4: S2 adapts (K_e 0.084 to 0.058, -31 %, K_edot 0.035 to 0.078 s, +124 %);
        S1 shows no change beyond the scatter of runs.
    ...

    Recordings of your own, of one person in one condition and in the files run1.csv to run7.csv
    with the columns t, error and stick, of which the last 81.92 s are measured:

    >>> from skhoid import read_runs
    >>> X, y = read_runs(
    ...     "run*.csv", inputs={"error": "e"}, output="stick", time="t"
    ... )  # doctest: +SKIP
    >>> analyse_experiment(X, y, measurement_time=81.92).summary()  # doctest: +SKIP
    """
    if last is not None and last < 1:
        raise ValueError(f"last counts runs and is at least 1; got {last}.")
    for name, value in (("region", region), ("step", step)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} is a time in s, above 0; got {value!r}.")
    if run_in is not None and measurement_time is not None:
        raise ValueError(
            "Give run_in= (leave out the first seconds) or measurement_time= (keep the last "
            "seconds), not both."
        )
    cells, dt, notes = read_cells(
        X,
        y,
        last=last,
        input=input,
        run_in=run_in,
        measurement_time=measurement_time,
        region=region,
    )
    horizon = float(memory_horizon if memory_time is None else memory_time / dt)
    if not horizon > 1:
        raise ValueError(f"The memory horizon is more than one sample; got {horizon:g}.")
    plan = AnalysisPlan(horizon, delay, input, region, fit_intercept, step, dt)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)  # the notes count it
        warnings.simplefilter("ignore", RunTimeWarning)  # and say what runs do not share
        found = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(analyse_cell)(cell, plan) for cell in cells
        )
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
        dt=dt,
        memory_horizon=horizon,
        region=region,
        transition_times=_transition_times(transition_time, [cell.condition for cell in cells]),
    )


def _transition_times(given: Any, conditions: list[Any]) -> dict[Any, float]:
    if given is None:
        return {}
    if isinstance(given, (int, float, np.number)):
        return dict.fromkeys(conditions, float(given))
    return {name: float(time) for name, time in dict(given).items() if name in conditions}


def _recording(rate: float, duration: float, run_in: float, time: float | None) -> RecordingSetup:
    if time is None:  # at the same part of the recording as in the thesis
        part = (STANDARD.run_in + STANDARD.transition_time) / (STANDARD.run_in + STANDARD.duration)
        time = round(part * (run_in + duration) - run_in, 6)
    return RecordingSetup(float(rate), float(duration), float(run_in), float(time))


def _conditions(conditions: Any) -> list[str]:
    """Names of conditions, of a list of them or of a range such as C1-C6."""
    if isinstance(conditions, str):
        ends = re.fullmatch(r"\s*(C\d+)\s*[-–]\s*(C\d+)\s*", conditions, re.IGNORECASE)
        if ends is None:
            return [known_name(conditions.strip())]
        first, last = (int(known_name(end)[1:]) for end in ends.groups())
        if last < first:
            raise ValueError(f"The range {conditions!r} ends before it begins.")
        return [f"C{number}" for number in range(first, last + 1)]
    names = [known_name(name) for name in conditions]
    if not 0 < len(set(names)) == len(names):
        raise ValueError(f"conditions names each condition once, at least one; got {conditions!r}.")
    return names
