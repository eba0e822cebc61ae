"""``make_tracking_runs``: simulated runs as a dataset, in the manner of scikit-learn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from inspect import signature
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils import Bunch

from .._sklearn import Interval, checked
from ..human import ControlledElement, HumanOperator
from ..human.operator import PURSUIT, delay_samples, zoh_parameters
from ..human.variation import Parameter, Shifted, evaluate
from .conditions import Condition, Remnant
from .engine import TrackingRecord
from .task import CompensatoryTask, tune_remnant

CHANNELS = {"e": "e", "x": "x", "f_t": "f_t", "dist": "f_d"}
REMNANT = ("remnant_intensity", "remnant_order", "remnant_gain")
CHANGES = (*REMNANT, "adaptation_lag", "perturbation")  # options that change a task
# Options of make_tracking_runs: those that describe the task, and those that are passed on.
OF_TASK = (
    *("sampling_rate", "duration", "run_in", "target", "disturbance", "display", "operator"),
    *("controlled_element", "effects"),
    *CHANGES,
)
OF_TUNING = ("random_state", "open_loop", "n_jobs")
OF_SIMULATION = (*OF_TUNING, "random_phases", "keep_run_in")


@checked(
    remnant_intensity=[Real],
    channels=[str, "array-like"],
    adaptation_lag=[Interval(Real, -1e9, 1e9, closed="both")],
    perturbation=[Mapping, None],
    random_phases=["boolean"],
    open_loop=["boolean"],
    return_truth=["boolean"],
    n_jobs=[Integral, None],
)
def make_tracking_runs(
    condition: str | Condition | CompensatoryTask = "C1",
    n_runs: int = 5,
    *,
    remnant_intensity: float = 0.0,
    remnant_order: int | str = 2,
    remnant_gain: Parameter | None = None,
    channels: Sequence[str] = ("e",),
    sampling_rate: float = 100.0,
    duration: float = 81.92,
    run_in: float | None = None,
    keep_run_in: float = 0.0,
    target: Any = None,
    disturbance: Any = None,
    random_phases: bool = False,
    display: str | Parameter = "compensatory",
    operator: Any = None,
    controlled_element: ControlledElement | None = None,
    effects: Any = None,
    adaptation_lag: float = 0.0,
    perturbation: Mapping[str, Parameter] | None = None,
    open_loop: bool = False,
    return_truth: bool = False,
    random_state: Any = None,
    n_jobs: int | None = None,
) -> Any:
    """Simulate runs of a tracking task as a dataset.

    Parameters
    ----------
    condition : {"C1", ..., "C6"}, Condition or CompensatoryTask, default="C1"
        What is controlled and by whom; see :func:`tracking_condition` and :func:`mixed_condition`.
        A whole task has its own sampling rate, duration, run-in, forcing functions, display,
        operator, element and effects, so do not give these.
    n_runs : int, default=5
        Number of runs; they differ in remnant and, with ``random_phases``, in phases.
    remnant_intensity : float, default=0.0
        P_n = var(n) / var(u); :func:`tune_remnant` finds the gain from ten separate realisations.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter (Eqs. 27-28).
    remnant_gain : float, callable, "table" or None, default=None
        K_n, if not tuned; ``"table"`` is that of Table G.1 for ``remnant_intensity``.
    channels : sequence of {"e", "x", "f_t", "dist"}, default=("e",)
        Columns of X: error, output of the controlled element, target, and the disturbance f_d.
    sampling_rate, duration : float, default=100.0 and 81.92
        Samples and integration steps per second (Hz), and length of a run (s).
    run_in, keep_run_in : float or None and float, default=None and 0.0
        Time simulated before the window, in s (None: seven times ``duration``, or 20 s with
        effects), and how much of it to return as well, at negative time.
    target, disturbance : Multisine, callable, array or None, default=None
        Forcing functions; None means Table I for the target and no disturbance; 0.0 means none. For
        one that changes within the run, see :class:`Mixture`.
    random_phases : bool, default=False
        Draw new phases for each run.
    display : {"compensatory", "pursuit"}, float or callable, default="compensatory"
        Whether the operator's gains on target and output are in use, or what share over time.
    operator, controlled_element : HumanOperator or fitted model, ControlledElement, or None
        Replacements for those of the condition.
    effects : Effect, Effects, list of these or None, default=None
        What the operator does beyond linear dynamics, such as ``DeadZone(width=0.3)``, with
        numbers for all parameters. The remnant's gain is tuned without effects.
    adaptation_lag : float, default=0.0
        Time in s by which the operator's parameters lag the element's; if negative, they lead.
    perturbation : dict or None, default=None
        ``{"K_e", "K_edot", "omega_nm", "zeta_nm" or a gain of a pursuit display: number or
        function of time}``, added to the parameter.
    open_loop : bool, default=False
        The remnant is added to u but does not go round the loop (Eq. G.1).
    return_truth : bool, default=False
        Also return the truth behind the runs.
    random_state : int, RandomState, Generator or None, default=None
        Source of all randomness. Run i is the same whatever ``n_runs`` and ``n_jobs`` are.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.

    Returns
    -------
    X : DataFrame of shape (n_runs * n_samples, n_channels)
        With the row index levels ``run`` (from 0) and ``time`` (s; the window begins at 0).
        ``X.attrs["units"]`` are deg for the conditions and the target of the thesis.
    y : Series of shape (n_runs * n_samples,)
        Control output ``u``.
    truth : Bunch
        Only with ``return_truth``: ``u_without_remnant`` and ``remnant`` (Series like y);
        ``parameters``, a DataFrame over time of K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm, K_c,
        omega_b, K_n, and of gains of a pursuit display; ``arx_parameters``, the same of a1, a2, b0,
        b1 under zero-order hold (not with such gains); ``nk``, their delay in samples; ``task``.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> X, y = make_tracking_runs("C4", n_runs=2, remnant_intensity=0.15, random_state=0)
    >>> X.shape, X.index.names
    ((16384, 1), FrozenList(['run', 'time']))
    >>> X, y, truth = make_tracking_runs("C1", n_runs=1, return_truth=True)
    >>> truth.nk, truth.arx_parameters.iloc[0].round(4).tolist()
    (29, [-1.9121, 0.9243, 0.0443, -0.0432])
    """
    given = dict(locals())  # most of the options are only passed on
    check_channel_names(channels)
    task = task_of(condition, {name: given[name] for name in OF_TASK})
    if task.remnant is not None and task.remnant.gain is None:
        task = tune_remnant(task, **{name: given[name] for name in OF_TUNING})
    record = task.simulate(n_runs, **{name: given[name] for name in OF_SIMULATION})
    of_thesis = isinstance(condition, str) and target is None  # Tables I and II
    X, y = frames_of(record, channels, "deg" if of_thesis else None)
    return (X, y, truth_of(task, record)) if return_truth else (X, y)


def check_channel_names(channels: Any) -> None:
    """Refuse names that are not channels."""
    known = all(isinstance(name, str) and name in CHANNELS for name in channels)
    if not known or isinstance(channels, str) or not 0 < len(set(channels)) == len(channels):
        hint = " The disturbance f_d is the channel 'dist'." if "f_d" in map(str, channels) else ""
        raise ValueError(
            f"channels must list some of {list(CHANNELS)}, each once; got {channels!r}.{hint}"
        )


def task_of(
    condition: str | Condition | CompensatoryTask, given: Mapping[str, Any]
) -> CompensatoryTask:
    """The task that options of :func:`make_tracking_runs` describe; gains are not tuned yet."""
    defaults = {
        name: parameter.default
        for name, parameter in signature(make_tracking_runs).parameters.items()
    }
    given = {
        name: value
        for name, value in given.items()
        if not (value is defaults[name] or (np.isscalar(value) and value == defaults[name]))
    }
    of_task = {name: value for name, value in given.items() if name not in CHANGES}
    if not isinstance(condition, CompensatoryTask):
        task = CompensatoryTask.of_condition(condition, **of_task)
    elif of_task:
        raise ValueError(
            f"A whole task has its own {', '.join(of_task)}: change the task "
            "(dataclasses.replace), or give a condition."
        )
    else:
        task = condition
    task = _adapt(task, given.get("adaptation_lag", 0.0), dict(given.get("perturbation", {})))
    remnant = [given.get(name, defaults[name]) for name in REMNANT]
    return _set_remnant(task, condition, *remnant)


def frames_of(
    record: TrackingRecord, channels: Sequence[str], unit: str | None = None
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y of simulated runs."""
    index = _make_index(record)
    shape = record.u.shape
    signals = {c: np.broadcast_to(getattr(record, CHANNELS[c]), shape).ravel() for c in channels}
    X = pd.DataFrame(signals, index=index)
    y = pd.Series(record.u.ravel(), index=index, name="u")
    if unit is not None:
        X.attrs["units"] = dict.fromkeys(channels, unit)
        y.attrs["units"] = {"u": unit}
    return X, y


def _make_index(record: TrackingRecord) -> pd.MultiIndex:
    return pd.MultiIndex.from_product([range(len(record.u)), record.time], names=["run", "time"])


def _adapt(
    task: CompensatoryTask, lag: Any, perturbation: dict[str, Parameter]
) -> CompensatoryTask:
    """The operator with its parameters lagging the controlled element's, or perturbed."""
    if not lag and not perturbation:
        return task
    operator = task.operator
    if not isinstance(operator, HumanOperator):
        raise ValueError(
            "adaptation_lag and perturbation change the parameters of a HumanOperator; the "
            f"operator is a {type(operator).__name__}."
        )
    operator = operator.with_rate_gain()
    parameters = operator.adaptable
    unknown = [name for name in perturbation if name not in parameters]
    if unknown:
        raise ValueError(
            f"perturbation: no parameter {unknown} to add to; there are {list(parameters)}."
        )
    changed: dict[str, Any] = {
        name: Shifted(value, float(lag), perturbation.get(name, 0.0))
        for name, value in parameters.items()
        if callable(value) or name in perturbation
    }
    return replace(task, operator=replace(operator, **changed))


def _set_remnant(
    task: CompensatoryTask,
    condition: Any,
    intensity: float,
    order: int | str,
    gain: Any,
) -> CompensatoryTask:
    if isinstance(gain, str):
        if gain != "table":
            raise ValueError(
                f"remnant_gain must be a number (K_n), a function of time or 'table'; got {gain!r}."
            )
        if not isinstance(condition, str):
            raise ValueError(
                "remnant_gain='table' needs the name of a condition of the thesis; in a task of "
                "your own, use Remnant.from_table(name, intensity)."
            )
        if intensity == 0:
            return replace(task, remnant=None)
        return replace(task, remnant=Remnant.from_table(condition, intensity, order))
    if gain is not None:
        if intensity:
            raise ValueError(
                f"Give remnant_intensity or remnant_gain, not both; got {intensity!r} and {gain!r}."
            )
        return replace(task, remnant=Remnant(order=order, gain=gain))
    if intensity:
        return replace(task, remnant=Remnant(order=order, intensity=intensity))
    return task


def truth_of(task: CompensatoryTask, record: TrackingRecord) -> Bunch:
    """What is behind simulated runs; see :func:`make_tracking_runs`."""
    index = _make_index(record)
    t = pd.Index(record.time, name="time")
    element, operator, remnant = task.controlled_element, task.operator, task.remnant
    truth = Bunch(
        u_without_remnant=pd.Series(record.u_without_remnant.ravel(), index, name="u"),
        remnant=pd.Series(record.n.ravel(), index, name="n"),
        task=task,
    )
    parameters: dict[str, Any] = {}
    if isinstance(operator, HumanOperator):
        parameters |= operator.over_time(record.time)
        pursuit = [name for name in PURSUIT if getattr(operator, name) != 0.0]
        for name in pursuit:
            parameters[name] = evaluate(getattr(operator, name), record.time)
        if not pursuit:
            theta = zoh_parameters(operator, 1 / task.sampling_rate, record.time)
            truth.arx_parameters = pd.DataFrame(theta, index=t, columns=["a1", "a2", "b0", "b1"])
        truth.nk = delay_samples(operator, 1 / task.sampling_rate, nearest=True)
    parameters |= {
        name: evaluate(getattr(element, name), record.time) for name in ("K_c", "omega_b")
    }
    gain = 0.0 if remnant is None or remnant.gain is None else remnant.gain
    truth.parameters = pd.DataFrame(parameters | {"K_n": evaluate(gain, record.time)}, index=t)
    return truth
