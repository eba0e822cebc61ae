"""PI and PID controllers as the core of a model: what commonly closes a machine's loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.signal import lfilter

from ..arx.base import ESTIMATE
from ..effects.composition import Effects
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import CoreKind, E, Parameter, S, U
from ..effects.record import Record
from .cores import OPERATORS_MOVE, Core, Ratio, find_pace
from .fitting import Criterion, some_runs
from .likelihood import likeliest
from .model import Model, fit_core
from .simulator import Simulator

# What proportional and derivative action answer: the error, or the measurement alone.
FORMS: Mapping[str, tuple[str, str | None]] = {
    "pi": ("e", None),
    "i-p": ("x", None),
    "pid": ("e", "e"),
    "pi-d": ("e", "x"),
    "i-pd": ("x", "x"),
}


# Share of the last sample that a sum of e has: nobody knows.
TRAPEZOID, WITH_LAST, WITHOUT = 0.5, 1.0, 0.0


class ControllerCore(Core):
    """A PI or PID controller: K_e p + K_i integral of e + K_edot d(d)/dt / (T_f s + 1), delayed.

    ``form`` says what p and d are, the error e or the measurement -x: ``FORMS``. None is open.
    The integral begins anywhere in each run. ``zero`` frees the zero of the error; ``last`` is the
    share of the last sample that the sum of e has.
    """

    kind = CoreKind.CONTROLLER
    ratios = (Ratio("T_i", "K_e", "K_i", S, "integral time"),)
    has_states = True
    forgetting = (1.0, -1.0)

    def __init__(
        self,
        form: str | None,
        fixed_delay: float | None = None,
        zero: bool = False,
        last: float = TRAPEZOID,
    ):
        self.form, self.fixed_delay, self.zero, self.last = form, fixed_delay, zero, last
        proportional = Parameter("K_e", U / E, -50.0, 50.0, (0.5,), "proportional gain")
        integral = Parameter("K_i", U / (E * S), -50.0, 50.0, (0.5,), "gain on the integral")
        self.parameters = (proportional, integral)
        if form is not None and "d" in form:
            self.parameters += (
                Parameter("K_edot", U * S / E, -50.0, 50.0, (0.1,), "gain on the rate"),
                Parameter("T_f", S, 0.0, 2.0, (0.1,), "time constant of the rate's filter"),
            )
        if zero:
            self.parameters += (Parameter("e_0", E, -50.0, 50.0, (0.0,), "zero of the error"),)
        if fixed_delay is None:
            self.parameters += (Parameter("tau_e", S, 0.0, 1.5, (0.0,), "time delay"),)
            self.delays = ("tau_e",)
        gains = [p.name for p in self.parameters if p.name.startswith(("K_", "e_"))]
        self.gains = tuple(gains)

    def add_to_record(self, record: Record) -> Record:
        return replace(
            record,
            core=self.kind,
            time_unit=OPERATORS_MOVE / find_pace(record),
            criterion_rate=np.inf,
            least_delay=0.0,
        )

    def delay(self, values: dict[str, float]) -> float:
        return self.fixed_delay if self.fixed_delay is not None else values["tau_e"]

    def find_seen(self, record: Record, delay: float | np.ndarray) -> np.ndarray | None:
        if "x" not in FORMS[self.form or "pi"]:
            return None
        return -record.delayed(record.channels[record.with_role("x")[0]], delay)

    def command(
        self,
        error: np.ndarray,
        gains: Gains,
        values: dict[str, float],
        dt: float,
        seen: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        proportional, derivative = FORMS[self.form or "pi"]
        answered = {"e": error, "x": error if seen is None else seen}
        summed = (error - values.get("e_0", 0.0)) * gains.error
        total = dt * (np.cumsum(summed, axis=0) - (1 - self.last) * summed)
        position = values["K_e"] * gains.error * answered[proportional] + values["K_i"] * total
        if derivative is None:
            return position, np.zeros_like(position)
        return position, values["K_edot"] * gains.rate * answered[derivative]

    def response(
        self, command: Command, gains: Gains, spring: Spring, values: dict[str, float], dt: float
    ) -> np.ndarray:
        if not command.rate.any():
            return command.position
        # Backward differences, which a filter without time constant leaves as they are.
        pole = values.get("T_f", 0.0) + dt
        change = np.diff(command.rate, axis=0, prepend=command.rate[:1])
        return command.position + lfilter([1 / pole], [1.0, dt / pole - 1.0], change, axis=0)

    def earlier(self, values: dict[str, float], seconds: float) -> dict[str, float]:
        return {"tau_e": -seconds} if self.fixed_delay is None else {}

    def chosen(self, record: Record) -> Core:
        """The likeliest form, each with the noise model that is likeliest with it, by BIC.

        It has a delay, and a zero of the error where its sensor or a mean removed has shifted that,
        if they make it likelier.
        """
        if self.form not in (None, *list_forms(record)):
            raise ValueError(
                f"controller={self.form!r} acts on the measurement: X needs a column of role x, or "
                "the error and the target."
            )
        some = some_runs(record, MOST_ROWS)
        record = record if some is None else record.part(some, 1)
        record = self.add_to_record(record.beginning(MOST_ROWS * record.dt))
        record = replace(record, initial=ESTIMATE)
        delays = (0.0, None) if self.fixed_delay is None else (self.fixed_delay,)
        forms = list_forms(record) if self.form is None else [self.form]
        cores = [ControllerCore(form, delay, True) for form in forms for delay in delays]
        cores += [  # elsewhere proportional action hides it
            ControllerCore(form, delays[0], True, last)
            for form in forms
            for last in (WITH_LAST, WITHOUT)
            if FORMS[form][0] == "x"
        ]
        likely = [(loss, core) for core in cores if np.isfinite(loss := core.find_loss(record))]
        if not likely:
            return ControllerCore(self.form or "pi", self.fixed_delay)
        loss, best = min(likely, key=lambda one: one[0])
        plainer = ControllerCore(best.form, best.fixed_delay, last=best.last)
        return plainer if plainer.find_loss(record) <= loss else best

    def find_loss(self, record: Record) -> float:
        """BIC of the controller, without constants; infinite where it is none."""
        model = fit_controller(self, record, Criterion(record))
        end = likeliest(model.simulator, [model.theta])
        if end is None or not self.is_sound(end[1]):
            return np.inf
        n = int(record.known.sum())
        rounding = n * float(np.log(ROUNDING * record.sd("u") ** 2))
        return max(end[0], rounding) + model.theta.size * float(np.log(n))

    def is_sound(self, theta: np.ndarray) -> bool:
        """Whether all actions have one sign, and the rate's filter passes more than a lag would."""
        values = dict(zip((p.name for p in self.parameters), theta.tolist(), strict=True))
        gain, rate = values["K_e"], values.get("K_edot")
        lead = np.inf if rate is None else gain * rate - values["T_f"] * gain**2
        return gain * values["K_i"] > 0.0 and lead > 0.0


def list_forms(record: Record) -> list[str]:
    """Forms that a record allows: some need the measurement x beside the error."""
    return [
        form for form, answered in FORMS.items() if "x" not in answered or record.with_role("x")
    ]


MOST_ROWS = 10_000  # that decide on the form
ROUNDING = 1e-12  # of the output's variance, which numbers of seven digits leave
DELAYS = (0.0, 2.0, 6.0)  # samples, to start from
FILTERS = (1.0, 10.0)  # samples, of the time constant of a rate's filter, the same


def fit_controller(core: ControllerCore, record: Record, criterion: Criterion) -> Model:
    """A controller without effects, of which all but delay and filter is linear."""
    simulator = Simulator(core, Effects([]), record)
    names = simulator.names
    starts = []
    for late, filtered in product(DELAYS, FILTERS):
        more = {"tau_e": late * record.dt, "T_f": filtered * record.dt, "e_0": 0.0}
        pairs = zip(names, simulator.scale, strict=True)
        starts.append(np.array([more.get(name, scale) for name, scale in pairs]))
    return fit_core(core, record, criterion, np.unique(starts, axis=0))
