"""What the kernel needs to know of a task: rows of physics, and how the output arises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from .. import _kernels
from ..human import HumanOperator
from ..human.operator import PURSUIT
from ..human.variation import evaluate
from ..pipelines import unwrapped
from ..preprocessing import Decimator, DelayShift

if TYPE_CHECKING:
    from .loop import CompensatoryTask

DISPLAYS = {"compensatory": 0.0, "pursuit": 1.0}
# Largest step times fastest rate: the neuromuscular mode then has 12 samples a period.
COARSEST = 0.52
SIGNED = set(PURSUIT)


@dataclass(frozen=True)
class Delay:
    """A delay of the operator's output, in whole samples and weights for what is between."""

    samples: int
    weights: np.ndarray
    delay_time: float
    constant: bool = True

    @classmethod
    def of(cls, task: CompensatoryTask) -> Delay:
        tau, rate = task.operator.tau_e, task.sampling_rate
        exact = tau * rate
        if exact >= task.n_run_in + task.n_samples:
            raise ValueError(
                f"CompensatoryTask: the delay tau_e = {tau} s is longer than the run of "
                f"{(task.n_run_in + task.n_samples) / rate:g} s."
            )
        whole = abs(exact - round(exact)) <= 1e-6
        held = task.transport == "held" or (task.transport is None and whole)
        if held and not whole:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is {exact:g} samples at {rate:g} Hz; a held "
                "delay is a whole number of them. Use transport='interpolated', or another rate."
            )
        samples = round(exact) if whole else int(exact)
        part = 0.0 if whole else exact - samples
        if held:
            return cls(samples, np.tile([0.0, 1.0, 0.0], (3, 1)), tau)
        if samples < 1:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is less than one sample at {rate:g} Hz, too "
                "short to interpolate. Use a higher sampling rate, or tau_e = 0."
            )
        if part <= 0.5:
            middle = [0.0, 0.5 + part, 0.5 - part]
        else:
            middle = [part - 0.5, 1.5 - part, 0.0]
        return cls(samples, np.array([[part, 1 - part, 0.0], middle, [0.0, part, 1 - part]]), tau)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.samples, self.weights, np.zeros((1, 0)), 0, 0


@dataclass(frozen=True)
class ARXResponse:
    """A fitted ARX model as the operator."""

    coefficients: np.ndarray
    na: int
    nk: int
    delay_time: float
    constant: bool = True

    @classmethod
    def of(cls, task: CompensatoryTask) -> ARXResponse:
        shift, model = 0.0, unwrapped(task.operator)
        while isinstance(model, Pipeline):
            for _, step in model.steps[:-1]:
                if isinstance(step, DelayShift):
                    shift += step.delay
                elif isinstance(step, Decimator) and step.factor > 1:
                    raise ValueError(
                        f"A model behind Decimator(factor={step.factor}) has a slower clock than "
                        "the loop. Fit it without decimation to put it back into the loop."
                    )
            model = unwrapped(model.steps[-1][1])
        if not hasattr(model, "to_transfer_function"):
            raise TypeError(
                "CompensatoryTask: operator is a HumanOperator, or a fitted ARXRegressor or a "
                f"Pipeline that ends in one; got {type(model).__name__}."
            )
        check_is_fitted(model)
        dt = 1 / task.sampling_rate
        if abs(model.dt_ - dt) > 1e-6 * dt:
            raise ValueError(
                f"The model was fitted at dt = {model.dt_:g} s; the loop runs at {dt:g} s. "
                f"Use sampling_rate={1 / model.dt_:g}."
            )
        orders = model.orders_
        if len(orders.nb) != 1 or getattr(model, "intercept_", 0.0) != 0.0:
            raise ValueError(
                "A model in the loop answers the error e alone, without intercept; this one has "
                f"the inputs {model.inputs_} and intercept {getattr(model, 'intercept_', 0.0):g}."
            )
        nk = orders.nk[0] + round(shift / dt)
        return cls(_kernels.gate(model.coef_[None]), orders.na, nk, nk * dt)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return 0, np.zeros((3, 3)), self.coefficients, self.na, self.nk


def response_of(task: CompensatoryTask) -> Delay | ARXResponse:
    """How the operator's output arises."""
    return Delay.of(task) if isinstance(task.operator, HumanOperator) else ARXResponse.of(task)


def physics_rows(task: CompensatoryTask) -> np.ndarray:
    """Rows of physics every half step, or one where nothing varies; see ``_kernels.loop``."""
    element, remnant = task.controlled_element, task.remnant
    display = DISPLAYS[task.display] if isinstance(task.display, str) else task.display
    parameters: dict[str, Any] = {"K_c": element.K_c, "omega_b": element.omega_b}
    parameters["K_n"] = 0.0 if remnant is None else remnant.gain
    if isinstance(task.operator, HumanOperator):
        lead = "T_L" if task.operator.K_edot is None else "K_edot"
        names = ["K_e", lead, "omega_nm", "zeta_nm", *PURSUIT]
        parameters |= {name: getattr(task.operator, name) for name in names} | {"display": display}
    constant = not any(callable(p) for p in parameters.values())
    n_steps = task.n_run_in + task.n_samples
    half_steps = np.arange(1 if constant else 2 * n_steps + 1)
    t = (half_steps / 2 - task.n_run_in) / task.sampling_rate
    # Constants stay scalars, which broadcast.
    p = {name: _checked(name, value, t) for name, value in parameters.items()}
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
    return rows


def _checked(name: str, parameter: Any, t: np.ndarray) -> Any:
    if not callable(parameter):
        return float(parameter)
    values = evaluate(parameter, t)
    wrong = ~np.isfinite(values)
    if name not in SIGNED:
        wrong |= values < 0
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        what = "finite" if name in SIGNED else "finite and not negative"
        raise ValueError(
            f"CompensatoryTask: {name} is {values[i]:g} at t = {t[i]:g} s (0 is the beginning of "
            f"the measurement window); it must be {what}, in the run-in too."
        )
    return values


def check_rate(task: CompensatoryTask) -> None:
    """Refuse a step too long for the fastest constant physics."""
    operator, element, remnant = task.operator, task.controlled_element, task.remnant
    modes = {
        "neuromuscular mode (omega_nm)": operator.omega_nm,
        "controlled element (omega_b)": element.omega_b,
    }
    if remnant is not None:
        is_nm = isinstance(remnant.order, str)
        modes["remnant filter"] = remnant.omega_nm if is_nm else 1 / remnant.time_constant
    for what, speed in modes.items():
        if not callable(speed) and speed > COARSEST * task.sampling_rate:
            raise ValueError(
                f"CompensatoryTask: {task.sampling_rate:g} Hz is too slow for the {what} of "
                f"{speed:g} rad/s. Use sampling_rate={np.ceil(speed / COARSEST):g} Hz or more."
            )
