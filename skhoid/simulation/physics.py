"""What the kernel needs to know about a task: rows of physics, delay, the operator's response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _kernels
from ..human import HumanOperator
from ..human.operator import PURSUIT
from ..human.variation import Transition, evaluate, span_of_changes
from ..interpret.channel import ARXChannel
from ..pipelines import taken_apart
from ..preprocessing.base import as_fitted
from ..runs.roles import role_of

if TYPE_CHECKING:
    from .task import CompensatoryTask

DISPLAYS = {"compensatory": 0.0, "pursuit": 1.0}
# Largest step times fastest rate: the neuromuscular mode then has 12 samples a period.
COARSEST = 0.52
SIGNED = set(PURSUIT)


@dataclass(frozen=True)
class Delay:
    """A delay of the operator's output: whole samples, and weights for the fraction of one."""

    samples: int
    weights: np.ndarray
    delay_time: float

    @classmethod
    def of(cls, task: CompensatoryTask) -> Delay:
        tau, rate = task.operator.tau_e, task.sampling_rate
        exact = tau * rate
        if exact >= task.n_samples:
            raise ValueError(
                f"CompensatoryTask: the delay tau_e = {tau} s is longer than the run of "
                f"{task.n_samples / rate:g} s."
            )
        whole = abs(exact - round(exact)) <= 1e-6
        held = task.transport == "held" or (task.transport is None and whole)
        if held and not whole:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is {exact:g} samples at {rate:g} Hz; a held "
                "delay must be a whole number of samples. Use transport='interpolated', or "
                "another rate."
            )
        samples = round(exact) if whole else int(exact)
        part = 0.0 if whole else exact - samples
        if held:
            return cls(samples, np.tile([0.0, 1.0, 0.0], (3, 1)), tau)
        if samples < 1:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is less than one sample at {rate:g} Hz, too "
                "short to interpolate. Use a higher sampling rate, or transport='held'."
            )
        if part <= 0.5:
            middle = [0.0, 0.5 + part, 0.5 - part]
        else:
            middle = [part - 0.5, 1.5 - part, 0.0]
        return cls(samples, np.array([[part, 1 - part, 0.0], middle, [0.0, part, 1 - part]]), tau)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.samples, self.weights, np.zeros(0), 0, 0


@dataclass(frozen=True)
class ARXResponse:
    """A fitted ARX model as the operator."""

    coefficients: np.ndarray
    na: int
    nk: int
    delay_time: float

    @classmethod
    def of(cls, task: CompensatoryTask) -> ARXResponse:
        _, model = taken_apart(task.operator)
        inputs, intercept = getattr(model, "inputs_", ["e"]), getattr(model, "intercept_", 0.0)
        named = getattr(model, "_names", None) is not None
        role = role_of(inputs[0], getattr(as_fitted(model), "roles", None))
        if len(inputs) != 1 or intercept or (named and role != "e"):
            raise ValueError(
                f"A model in the loop responds to the error e alone, without intercept; this one "
                f"has the inputs {inputs} and the intercept {intercept:g}. Fit one with "
                "inputs=['e']."
            )
        if task.display != "compensatory" or task.transport is not None:
            raise ValueError(
                "display and transport are those of a HumanOperator; the operator is a "
                f"{type(model).__name__}, which has its own delay and sees only e."
            )
        channel = ARXChannel.of(task.operator, None, "CompensatoryTask(operator=...)")
        if channel.time is not None:
            raise ValueError(
                "The model's parameters vary over time; only constant models can be put into the "
                "loop."
            )
        dt = 1 / task.sampling_rate
        if abs(channel.dt_recording - channel.dt) > 1e-6 * dt:
            raise ValueError(
                f"The model was fitted to decimated recordings (dt = {channel.dt:g} s, of "
                f"{channel.dt_recording:g} s); fit it without the Decimator for the loop."
            )
        if abs(channel.dt - dt) > 1e-6 * dt:
            raise ValueError(
                f"The model runs at dt = {channel.dt:g} s and the loop at {dt:g} s. Fit it at the "
                f"rate of the loop, or use sampling_rate={1 / channel.dt:g}."
            )
        nk = channel.nk + round(channel.shift / dt)
        return cls(_kernels.gate(channel.theta), channel.na, nk, nk * dt)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return 0, np.zeros((3, 3)), self.coefficients, self.na, self.nk


def operator_response(task: CompensatoryTask) -> Delay | ARXResponse:
    """How the operator's output arises."""
    return Delay.of(task) if isinstance(task.operator, HumanOperator) else ARXResponse.of(task)


def parameters_of(task: CompensatoryTask) -> dict[str, Any]:
    """Numbers and functions of time on which the loop depends."""
    element, remnant = task.controlled_element, task.remnant
    display = DISPLAYS[task.display] if isinstance(task.display, str) else task.display
    parameters: dict[str, Any] = {"K_c": element.K_c, "omega_b": element.omega_b}
    parameters["K_n"] = 0.0 if remnant is None or remnant.gain is None else remnant.gain
    if isinstance(task.operator, HumanOperator):
        parameters |= task.operator.adaptable | {"display": display}
    return parameters


def physics_rows(task: CompensatoryTask) -> tuple[np.ndarray, int]:
    """Rows of physics every half step while something varies, and the sample where they begin.

    See ``_kernels.loop``.
    """
    parameters = parameters_of(task)
    n_steps = task.n_run_in + task.n_samples
    varies = np.array(span_of_changes(*parameters.values())) * task.sampling_rate + task.n_run_in
    if varies[0] > varies[1]:  # never
        varies = np.zeros(2)
    # One more sample on each side, for parameters that jump between two.
    begin = int(np.clip(np.floor(varies[0]) - 1, 0, n_steps))
    end = int(np.clip(np.ceil(varies[1]) + 1, begin, n_steps))
    half_steps = np.arange(1 if task.is_constant else 2 * (end - begin) + 1)
    t = (half_steps / 2 + begin - task.n_run_in) / task.sampling_rate
    # Constants stay scalars, which broadcast; parameters with one transition share its progress.
    progress: dict[Any, np.ndarray] = {}
    p = {name: _checked_values(name, value, t, progress) for name, value in parameters.items()}
    _check_rate(task, p)
    rows = np.zeros((t.size, _kernels.loop.N_PHYSICS))
    rows[:, 6], rows[:, 7], rows[:, 8] = p["K_c"], p["omega_b"], p["K_n"]
    if isinstance(task.operator, HumanOperator):
        K_e = p["K_e"]
        K_edot = p["K_edot"] if "K_edot" in p else K_e * p["T_L"]
        stiffness, shown = p["omega_nm"] ** 2, p["display"]
        rows[:, 0] = 2 * p["zeta_nm"] * p["omega_nm"]
        rows[:, 1] = stiffness
        rows[:, 2] = stiffness * (K_e + shown * p["K_t"])
        rows[:, 3] = stiffness * (K_edot + shown * p["K_tdot"])
        rows[:, 4] = stiffness * (shown * p["K_x"] - K_e)
        rows[:, 5] = stiffness * (shown * p["K_xdot"] - K_edot)
    return rows, begin


def _checked_values(
    name: str, parameter: Any, t: np.ndarray, progress: dict[Any, np.ndarray]
) -> Any:
    if not callable(parameter):
        return float(parameter)
    if isinstance(parameter, Transition):
        key = parameter.unit()
        if key not in progress:
            progress[key] = key.progress(t)
        values = parameter.along(progress[key])
    else:
        values = evaluate(parameter, t)
    wrong = ~np.isfinite(values)
    if name not in SIGNED:
        wrong |= values <= 0 if name in ("omega_nm", "zeta_nm") else values < 0
    if name == "display":
        wrong |= values > 1
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        what = "finite" if name in SIGNED else "finite and positive"
        what += ", at most 1" if name == "display" else ""
        raise ValueError(
            f"CompensatoryTask: {name} is {values[i]:g} at t = {t[i]:g} s (0 is the beginning of "
            f"the measurement window); it must be {what}, in the run-in too."
        )
    return values


def _check_rate(task: CompensatoryTask, p: dict[str, Any]) -> None:
    """Refuse a step too long for the fastest mode."""
    modes = {"controlled element (omega_b)": np.max(p["omega_b"])}
    if isinstance(task.operator, HumanOperator):
        zeta = np.asarray(p["zeta_nm"])
        fastest = p["omega_nm"] * (zeta + np.sqrt(np.maximum(zeta**2 - 1, 0)))
        speed = np.where(zeta > 1, fastest, p["omega_nm"])
        modes["neuromuscular mode (omega_nm, zeta_nm)"] = speed.max()
    if (remnant := task.remnant) is not None:
        is_nm = isinstance(remnant.order, str)
        modes["remnant filter"] = remnant.omega_nm if is_nm else 1 / remnant.time_constant
    what = max(modes, key=lambda name: modes[name])
    if modes[what] > COARSEST * task.sampling_rate:
        raise ValueError(
            f"CompensatoryTask: {task.sampling_rate:g} Hz is too slow for the {what} of "
            f"{modes[what]:.4g} rad/s. Use sampling_rate={np.ceil(modes[what] / COARSEST):g} Hz or "
            "more."
        )
