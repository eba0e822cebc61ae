"""What is added: offsets, answers to other channels, further linear dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.signal import lfilter

from ..runs.roles import OTHER
from .base import Effect
from .entry import Argument
from .error_scan import ErrorScan
from .in_time import with_middle
from .operator_signals import bilinear, shaped
from .parameter import CHANNEL, ONE, RAD, CoreKind, Dimension, E, Parameter, S, T, U
from .record import Record, differentiated, needs_channel

__all__ = [  # in the order of the catalogue
    "Bias",
    "Drift",
    "Integral",
    "Feedforward",
    "Preview",
    "OutputFeedback",
    "MotionFeedback",
    "Disturbance",
    "CrossAxis",
    "ExtraLag",
    "ExtraLead",
    "NeuromuscularMode",
    "HigherOrder",
]


class Bias(Effect):
    """A constant offset of the output."""

    name = "bias"
    place = "sum"
    physics = "The output has an offset: trim, or a sensor's zero error."
    machine_physics = "The output has an offset: a sensor's zero error, or a constant load."
    formula = "u + level"
    tex = r"u' = u + \mathrm{level}"
    source = "Ljung (1999)"
    parameters = (Parameter("level", U, -1e4, 1e4, (0.1,), "offset"),)
    neutral = {"level": 0.0}
    within = ("drift",)  # that has settled
    citation = "Ljung, System identification (1999), section 14.1."
    told_apart = {
        "drift": "record longer runs",
        "integral": "record a constant disturbance of 30 s",
    }
    examples = ({"level": 0.1},)
    hidden = {"level": 0.05}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return "a controller's integral begins anywhere" if core == CoreKind.CONTROLLER else None

    def apply(self, signal: np.ndarray, record: Record, level: float) -> np.ndarray:
        return signal + level


class Drift(Effect):
    """An offset of the output that changes during the run.

    ``"linear"``: rate (t - reference); ``"settling"``: level - rate tau exp(-(t - reference) /
    tau), which comes to rest at the level, with the reference at the start.
    """

    name = "drift"
    place = "sum"
    physics = "The output drifts steadily, or settles after the start."
    formula = "u + rate (t - reference), or u + level - rate tau exp(-(t - reference) / tau)"
    tex = (
        r"u' = u + \begin{cases} \mathrm{rate}\,(t - \mathrm{reference}) & \text{linear} \\"
        r" \mathrm{level} - \mathrm{rate}\;\mathrm{tau}\; e^{-(t - \mathrm{reference}) /"
        r" \mathrm{tau}}"
        r" & \text{settling} \end{cases}"
    )
    source = "Ljung (1999)"
    choices = {"form": ("linear", "settling")}
    citation = "Ljung (1999), section 14.1."
    examples = (
        {"form": "linear", "rate": 0.004, "reference": 40.96},
        {"form": "settling", "rate": 0.02, "tau": 15.0, "level": 0.1, "reference": 0.0},
    )
    hidden = {"rate": 0.002}
    parameters = (
        Parameter("rate", U / S, -20.0, 20.0, (0.5,), "rate of the drift", U / T, ("linear",)),
        Parameter(
            "rate", U / S, -100.0, 100.0, (2.0, -2.0), "rate at the start", U / T, ("settling",)
        ),
        Parameter("tau", S, 0.05, 1.0, (0.15, 0.4), "time constant", T, ("settling",)),
        Parameter("level", U, -20.0, 20.0, (0.0,), "level where it settles", forms=("settling",)),
    )
    arguments = {
        "reference": Argument(
            'Time in the run, in seconds, at which it is zero (``"linear"``) or begins '
            '(``"settling"``); None takes '
            "the middle, and the start.",
            "float or None",
        )
    }

    @property
    def neutral(self) -> dict[str, float]:  # type: ignore[override]
        return {"rate": 0.0, "level": 0.0} if self.form == "settling" else {"rate": 0.0}

    def variants(self, record: Record) -> list[Effect]:
        made: list[Effect] = []
        formed: list[Any] = super().variants(record)
        for chosen in formed:
            if chosen.form == "settling" and self.reference is None:
                chosen.set_params(reference=float(record.t[0].mean()))
            made.append(with_middle(chosen, record))
        return made

    def apply(
        self,
        signal: np.ndarray,
        record: Record,
        rate: float,
        tau: float = 1.0,
        level: float = 0.0,
    ) -> np.ndarray:
        since = record.t - self.reference
        if self.form == "settling":
            return signal + level - rate * tau * np.exp(-since / tau)
        return signal + rate * since


class Integral(Effect):
    """Trim: the operator responds to the integral of the error.

    ``"pure"``: 1 / s; ``"leaky"``: 1 / (s + leak), which forgets. Runs are cut from what people do,
    so the integral begins anywhere in each of them, as that of a controller does.
    """

    name = "integral"
    title = "integral action"
    place = "path"
    physics = "A standing error is trimmed away slowly."
    machine_physics = "The machine also integrates its input."
    formula = "command + gain * integral of e(t - tau_e)"
    tex = r"c' = c + \mathrm{gain} \int e(t - \tau_e)\,\mathrm{d}t"
    source = "McRuer and Krendel (1974)"
    lasts = True
    neutral = {"gain": 0.0}
    within = ("higher_order",)  # with a slow pole and a zero; its other pair cancels
    choices = {"form": ("pure", "leaky")}
    citation = "McRuer and Krendel (1974), low-frequency trim."
    told_apart = {
        "output_feedback": (
            "record a constant target or disturbance of 30 s: an integral keeps growing; a "
            "response to x does not"
        ),
    }
    examples = (
        {"form": "pure", "gain": 0.1},
        {"form": "leaky", "gain": 0.1, "leak": 0.7},
    )
    hidden = {"form": "pure", "gain": 0.05}
    parameters = (
        Parameter("gain", U / (E * S), 0.0, 20.0, (0.1, 0.5), "gain on the integral"),
        Parameter("leak", ONE / S, 0.001, 0.6, (0.1,), "rate of forgetting", forms=("leaky",)),
    )

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return "a controller has integral action" if core == CoreKind.CONTROLLER else None

    def forgetting(self, dt: float, **values: float) -> np.ndarray:
        return np.array([1.0, values.get("leak", 0.0) * dt - 1.0])

    def apply(self, signal: Any, record: Record, gain: float, leak: float = 0.0) -> Any:
        total = lfilter([record.dt], self.forgetting(record.dt, leak=leak), signal.error, axis=0)
        return signal.plus(gain * total)


X = Dimension.of_role("x")  # is the target less the error: of the same size as the error
TARGET = Dimension.of_role("f_t")
OF_INVERSE = ("inverse", "spread")  # forms of the response to the target that need the element
FELT, SHAKEN = ("direct", "canal"), ("feedthrough",)  # forms of the response to motion
GAINS_OF_TARGET = (
    Parameter(
        "gain",
        ONE,
        0.0,
        3.0,
        (0.3,),
        "gain on the inverse controlled element",
        forms=OF_INVERSE,
    ),
    Parameter("gain", U * S / TARGET, 0.0, 20.0, (0.1,), "gain on the target", forms=("rate",)),
    Parameter("gain", U / TARGET, 0.0, 20.0, (0.1,), "gain on the target", forms=("gain",)),
)
FASTEST_REFLEX = 0.02  # s, from a perturbation of the arm to its muscles
SCAN_STEP = 0.06  # s, of the time of an answer to the target


class _AnswerToTarget(Effect):
    """What responses to the target have in common: a gain and a form."""

    form: str | None
    neutral = {"gain": 0.0}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_target(record, self.form)

    choices = {"form": ("inverse", "rate", "gain")}
    unless_given = {"form": "gain"}
    ahead = -1.0  # sign by which the time parameter becomes time looked ahead

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Times as close as the minima of the squares, with all gains solved for at each."""
        gain, time = self.parameters[:2]
        if not record.core.has_limb or self.fixed or self.form == "spread":
            return []
        times = np.arange(time.low, time.high + SCAN_STEP / 2, SCAN_STEP)
        target = shaped_target(record, self.form)
        answers = [record.delayed(target, -self.ahead * float(t)) for t in times]
        columns = [np.repeat(x[:, :, None], times.size, axis=2) for x in error_of.commands(np.inf)]
        left = error_of.left([*columns, np.stack(answers, axis=2)], np.inf)
        # Only the best of neighbours, which leaves room for another minimum.
        best = [i for i in np.argsort(left) if left[i] <= left[max(i - 1, 0) : i + 2].min()]
        scale = gain.find_scale(record, self.place)
        return [
            {gain.name: start * scale, time.name: float(times[i])}
            for i in best[:2]
            for start in (*gain.starts, 2 * gain.starts[0])
        ]

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        element = record.controlled_element
        known = element is not None and element.not_invertible is None
        possible = self.form is not None or known
        return [v for v in made if possible or v.form not in OF_INVERSE]


class Feedforward(_AnswerToTarget):
    """The operator responds to the target as well as to the error.

    ``"inverse"``: gain times the inverse controlled element of f_t; ``"rate"``: gain times the
    target's rate; ``"gain"``: gain times the target.
    """

    name = "feedforward"
    place = "path"
    physics = "The operator also responds to the target itself, as a pursuit display allows."
    machine_physics = "The target acts on the output in addition to the input."
    formula = "command + gain f_t(t - delay) / H_CE"
    tex = (
        r"c' = c + \mathrm{gain} \cdot \begin{cases}"
        r" H_{CE}^{-1} f_t(t - \mathrm{delay}) & \text{inverse} \\"
        r" \dot f_t(t - \mathrm{delay}) & \text{rate} \\ f_t(t - \mathrm{delay}) & \text{gain}"
        r" \end{cases}"
    )
    source = "Wasicko et al. (1966)"
    citation = (
        "Wasicko, McRuer and Magdaleno, Human pilot dynamic response in single-loop systems with "
        "compensatory and pursuit displays (1966)."
    )
    told_apart = {
        "output_feedback": (
            "add a disturbance f_d of its own frequencies: it moves x and leaves f_t"
        ),
        "preview": "record a target with steps: a response before the step is preview",
    }
    examples = (
        {"form": "inverse", "gain": 0.6, "delay": 0.2},
        {"form": "rate", "gain": 0.05, "delay": 0.2},
        {"form": "gain", "gain": 0.05, "delay": 0.2},
    )
    hidden = {"gain": 0.5, "delay": 0.2}
    parameters = (
        *GAINS_OF_TARGET,
        Parameter("delay", S, 0.0, 0.8, (0.05, 0.3), "delay of the response to the target"),
    )

    def apply(self, signal: Any, record: Record, gain: float, delay: float) -> Any:
        return signal.plus(gain * record.delayed(shaped_target(record, self.form), delay))


class Preview(_AnswerToTarget):
    """The operator responds to the target ahead of time, as a preview display allows.

    ``"spread"`` averages the response of ``"inverse"`` over a stretch of the target; the other
    forms are as in :class:`Feedforward`.
    """

    name = "preview"
    place = "path"
    physics = "The operator sees the target coming and responds ahead of time."
    machine_physics = "The target acts on the output ahead of time."
    formula = "command + gain f_t(t + time) / H_CE"
    tex = r"c' = c + \mathrm{gain}\; H_{CE}^{-1} f_t(t + \mathrm{time})"
    source = "Van der El et al. (2016)"
    ahead = 1.0
    choices = {"form": ("inverse", "rate", "gain", "spread")}
    citation = (
        "Van der El et al., An empirical human controller model for preview tracking tasks (2016)."
    )
    examples = (
        {"form": "inverse", "gain": 0.6, "time": 0.4},
        {"form": "spread", "gain": 0.6, "time": 0.4, "stretch": 0.4},
        {"form": "rate", "gain": 0.05, "time": 0.4},
        {"form": "gain", "gain": 0.05, "time": 0.4},
    )
    hidden = examples[0]
    parameters = (
        *GAINS_OF_TARGET,
        Parameter("time", S, 0.0, 1.5, (0.2, 0.6), "preview time"),
        Parameter(
            "stretch", S, 0.05, 1.5, (0.3,), "length of the target averaged", forms=("spread",)
        ),
    )

    def apply(
        self, signal: Any, record: Record, gain: float, time: float, stretch: float = 0.0
    ) -> Any:
        if self.form != "spread":
            return signal.plus(gain * record.delayed(shaped_target(record, self.form), -time))
        name = record.with_role("f_t")[0]
        total = record.once(("total", name), lambda: integrate_channel(record, name))
        end = record.delayed(total, -time - stretch / 2)
        return signal.plus(gain / stretch * (end - record.delayed(total, stretch / 2 - time)))


class OutputFeedback(Effect):
    """The operator responds to the controlled element's output and its rate: H_x of pursuit."""

    name = "output_feedback"
    place = "path"
    physics = "The operator also responds to the motion of the controlled element."
    machine_physics = "The channel x acts on the output in addition to the input."
    formula = "command - gain x(t - delay) - rate_gain dx/dt(t - delay)"
    tex = (
        r"c' = c - \mathrm{gain}\; x(t - \mathrm{delay})"
        r" - \mathrm{rate\_gain}\; \dot x(t - \mathrm{delay})"
    )
    source = "Wasicko et al. (1966)"
    parameters = (
        Parameter("gain", U / X, 0.0, 20.0, (0.05,), "gain on x", U / E),
        Parameter("rate_gain", U * S / X, 0.0, 20.0, (0.05,), "gain on the rate of x", U / E),
        Parameter("delay", S, 0.0, 0.8, (0.12, 0.3), "delay of the response to x"),
    )
    neutral = {"gain": 0.0, "rate_gain": 0.0}
    examples = ({"gain": 0.05, "rate_gain": 0.03, "delay": 0.2},)
    hidden = {"gain": 0.03, "rate_gain": 0.02, "delay": 0.2}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_channel(None, record, "x", "column of role x, the controlled output")

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        return not_at_once(super().limits(record), record)

    def apply(
        self, signal: Any, record: Record, gain: float, rate_gain: float, delay: float
    ) -> Any:
        x = record.delayed(record.channels[record.with_role("x")[0]], delay)
        return signal.plus(-gain * x, -rate_gain * x)


class MotionFeedback(Effect):
    """The operator feels vehicle motion and responds to it, or it shakes the hand.

    ``"direct"``: the channel as it is; ``"canal"``: through semicircular-canal dynamics
    (0.11 s + 1) / ((5.9 s + 1)(0.005 s + 1)); ``"feedthrough"``: involuntarily, added to the
    output without delay (biodynamic feedthrough).
    """

    name = "motion_feedback"
    physics = "The operator feels the vehicle's motion and responds to it."
    machine_physics = "A measured motion acts on the output in addition to the input."
    formula = "command - gain motion(t - delay)"
    tex = r"c' = c - \mathrm{gain}\; \mathrm{motion}(t - \mathrm{delay})"
    source = "Hosman and Stassen (1999)"
    neutral = {"gain": 0.0}
    choices = {"form": ("direct", "canal", "feedthrough")}
    citation = (
        "Hosman and Stassen, Pilot's perception in the control of aircraft motions (1999); "
        "Venrooij et al., biodynamic feedthrough (2011)."
    )
    examples = (
        {"form": "direct", "channel": "motion", "gain": 0.05, "delay": 0.15},
        {"form": "canal", "channel": "motion", "gain": 0.5, "delay": 0.15},
        {"form": "feedthrough", "channel": "motion", "gain": 0.05, "delay": 0.0},
    )

    @property
    def place(self) -> str:  # type: ignore[override]
        return "sum" if self.form == "feedthrough" else "path"

    parameters = (
        Parameter("gain", U / CHANNEL, 0.0, 20.0, (0.1,), "gain on the motion", forms=FELT),
        Parameter("delay", S, 0.0, 0.6, (0.1, 0.25), "delay of the response to motion", forms=FELT),
        Parameter(
            "gain", U / CHANNEL, -20.0, 20.0, (0.1, -0.1), "gain of the feedthrough", forms=SHAKEN
        ),
        Parameter("delay", S, 0.0, 0.06, (0.0,), "delay of the feedthrough", forms=SHAKEN),
    )
    arguments = {"channel": Argument("None tries each channel of role ``motion``.")}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_channel(self.channel, record, "motion", "column of role motion")

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        found = super().limits(record)
        return found if self.form == "feedthrough" else not_at_once(found, record)

    def variants(self, record: Record) -> list[Effect]:
        names = record.with_role("motion") if self.channel is None else [self.channel]
        formed: list[Any] = super().variants(record)
        made = [v.with_choices(channel=n) for n in names for v in formed]
        if self.form == "feedthrough" or not record.with_role("x"):
            return made
        # What u moves at once (acceleration of the controlled element) would return u itself.
        return [
            v for v in made if v.form != "feedthrough" or not moved_by_output(record, v.channel)
        ]

    def apply(self, signal: Any, record: Record, gain: float, delay: float) -> Any:
        motion = record.channel(self.channel)
        if self.form == "feedthrough":
            return signal - gain * record.delayed(motion, delay)
        if self.form == "canal":
            motion = record.once(("canal", self.channel), lambda: canal(motion, record.dt))
        return signal.plus(-gain * record.delayed(motion, delay))


class Disturbance(Effect):
    """The operator responds directly to a measured disturbance.

    A disturbance comes from outside: no model can reconstruct the output from it, and the least
    delay for signals that the loop moves does not apply. But it is felt before it is seen, and no
    muscle responds to a perturbation sooner than the short-latency stretch reflex, 0.02 s: the
    least delay of a person (or ``least_delay``, if that is less); a machine may respond at once.
    """

    name = "disturbance"
    title = "disturbance response"
    place = "path"
    physics = "The operator sees or feels the disturbance and responds before the error shows it."
    machine_physics = "A measured disturbance acts on the output in addition to the input."
    formula = "command - gain dist(t - delay)"
    tex = r"c' = c - \mathrm{gain}\; \mathrm{dist}(t - \mathrm{delay})"
    source = "Pool et al. (2011)"
    neutral = {"gain": 0.0}
    citation = (
        "Pool et al., Identification of multimodal pilot models using ramp target and multisine "
        "disturbance signals (2011). Pruszynski and Scott, Optimal feedback control and the long- "
        "latency stretch response (2012), for the least delay."
    )
    examples = ({"channel": "dist", "gain": 0.1, "delay": 0.15},)
    parameters = (
        Parameter("gain", U / CHANNEL, -20.0, 20.0, (0.1,), "gain on the disturbance"),
        Parameter("delay", S, 0.0, 0.8, (0.1, 0.3), "delay of the response"),
    )
    arguments = {"channel": Argument("None tries each channel of role ``dist``.")}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_channel(self.channel, record, "dist", "column of role dist")

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        found = super().limits(record)
        least = min(FASTEST_REFLEX, record.least_delay) if record.core.is_operator else 0.0
        return found | {"delay": (least, found["delay"][1])}

    def variants(self, record: Record) -> list[Effect]:
        names = record.with_role("dist") if self.channel is None else [self.channel]
        return [self.with_choices(channel=name) for name in names]

    def apply(self, signal: Any, record: Record, gain: float, delay: float) -> Any:
        return signal.plus(-gain * record.delayed(record.channel(self.channel), delay))


class CrossAxis(Effect):
    """The operator also responds to another axis.

    ``"error"``: e' = e + gain times the other channel, before equalisation; ``"command"``: command
    + gain times the channel, with the delay of the response to the error, without lead.
    """

    name = "cross_axis"
    title = "cross-axis coupling"
    physics = "The error of another axis leaks into this axis."
    machine_physics = "Another channel leaks into the input."
    formula = "e' = e + gain channel, or command + gain channel"
    tex = (
        r"e' = e + \mathrm{gain} \cdot \mathrm{channel}"
        r" \quad\text{or}\quad c' = c + \mathrm{gain} \cdot \mathrm{channel}"
    )
    source = "Barendswaard et al. (2019)"
    neutral = {"gain": 0.0}
    choices = {"form": ("error", "command")}
    citation = "Barendswaard et al., Effects of crossfeed in dual-axis manual control (2019)."
    examples = (
        {"form": "error", "channel": "other", "gain": 0.4},
        {"form": "command", "channel": "other", "gain": 0.05},
    )

    @property
    def place(self) -> str:  # type: ignore[override]
        return "path" if self.form == "command" else "input"

    parameters = (
        Parameter(
            "gain", E / CHANNEL, -20.0, 20.0, (0.1, -0.1), "gain of the crossfeed", forms=("error",)
        ),
        Parameter(
            "gain",
            U / CHANNEL,
            -20.0,
            20.0,
            (0.1, -0.1),
            "gain of the crossfeed",
            forms=("command",),
        ),
    )
    arguments = {"channel": Argument("None tries each channel that has no role.")}

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_channel(self.channel, record, OTHER, "channel without role")

    def variants(self, record: Record) -> list[Effect]:
        names = record.with_role(OTHER) if self.channel is None else [self.channel]
        formed: list[Any] = super().variants(record)
        if self.form is None and record.core == CoreKind.ARX:
            # It has no lead of its own, in which the two could differ.
            formed = [v for v in formed if v.form == "error"]
        return [v.with_choices(channel=name) for v in formed for name in names]

    def apply(self, signal: Any, record: Record, gain: float) -> Any:
        answered = record.channel(self.channel)
        if self.form != "command":
            return signal + gain * answered
        return signal.plus(gain * record.delayed(answered, signal.delay))


def integrate_channel(record: Record, name: str) -> np.ndarray:
    """Integral over time of what makes the controlled element follow a channel."""
    answer = record.inverse_dynamics(name)
    # The trapezoid rule from rest one sample before; SciPy's rounds differently in the last bits.
    return record.dt * (np.cumsum(answer, axis=0) - answer / 2)


def needs_target(record: Record, form: str | None) -> str | None:
    """Why a response to the target does not apply."""
    missing = needs_channel(None, record, "f_t", "target: a column of role f_t, or e and x")
    if missing is not None or form not in OF_INVERSE:
        return missing
    if record.controlled_element is None:
        return "the controlled element is not known: pass controlled_element=ControlledElement(...)"
    return record.controlled_element.not_invertible


def shaped_target(record: Record, form: str | None) -> np.ndarray:
    """The target, its rate, or the output that makes the controlled element follow it."""
    name = record.with_role("f_t")[0]
    if form == "inverse":
        return record.inverse_dynamics(name)
    return record.rate(name) if form == "rate" else record.channels[name]


def canal(motion: np.ndarray, dt: float) -> np.ndarray:
    """Response of the semicircular canals."""
    poles = bilinear([0.0, 0.11, 1.0], np.polymul([5.9, 1.0], [0.005, 1.0]), dt)
    return lfilter(*poles, motion, axis=0)


def moved_by_output(record: Record, channel: str) -> bool:
    """Whether a channel follows the output within some samples, as acceleration in a loop does."""
    if record.y is None:
        return False
    motion, y, known = record.channels[channel], record.y, record.known
    name, element = record.with_role("x")[0], record.controlled_element
    driven = [y, differentiated(record.rate(name), record.dt)]
    if element is not None and element.not_invertible is None:
        driven.append(record.inverse_dynamics(name))
    return any(abs(np.corrcoef(s[known], motion[known])[0, 1]) > 0.3 for s in driven)


def not_at_once(
    limits: dict[str, tuple[float, float]], record: Record
) -> dict[str, tuple[float, float]]:
    """Bounds whose delay is at least that of the record: a faster response is the loop itself."""
    return limits | {"delay": (record.least_delay, limits["delay"][1])}


class ExtraLag(Effect):
    """Equalisation lag: 1 / (time s + 1)."""

    name = "extra_lag"
    place = "command"
    keeps_unit = True
    physics = "The operator low-pass filters what is seen."
    machine_physics = "The input passes through an additional lag."
    formula = "1 / (time s + 1)"
    tex = r"H(s) = \frac{1}{\mathrm{time}\; s + 1}"
    source = "McRuer and Krendel (1974)"
    parameters = (Parameter("time", S, 0.0, 20.0, (0.1, 1.0), "lag time constant T_I"),)
    neutral = {"time": 0.0}
    within = ("higher_order",)  # with a zero and a pole that cancel
    citation = "McRuer and Krendel (1974), the precision model."
    told_apart = {"nm_mode": "use a forcing function with lines up to 30 rad/s"}
    examples = ({"time": 0.2},)
    hidden = examples[0]

    def apply(self, signal: Any, record: Record, time: float) -> Any:
        return shaped(signal, record, [0.0, 0.0, 1.0], [0.0, time, 1.0])


class ExtraLead(Effect):
    """A second lead: time s + 1."""

    name = "extra_lead"
    place = "command"
    keeps_unit = True
    physics = "The operator also responds to the acceleration of the error."
    machine_physics = "The input passes through an additional lead."
    formula = "time s + 1"
    tex = r"H(s) = \mathrm{time}\; s + 1"
    source = "McRuer and Krendel (1974)"
    parameters = (Parameter("time", S, 0.0, 2.0, (0.05, 0.3), "time constant of the second lead"),)
    neutral = {"time": 0.0}
    within = ("higher_order",)  # whose other zero and poles are fast
    examples = ({"time": 0.2},)
    hidden = examples[0]

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return "an ARX model has its own zeros: raise nb" if core == CoreKind.ARX else None

    def apply(self, signal: Any, record: Record, time: float) -> Any:
        faster = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(rate=signal.rate + time * faster)


class NeuromuscularMode(Effect):
    """A second mode of limb and stick, behind the neuromuscular system.

    omega^2 / (s^2 + 2 zeta omega s + omega^2).
    """

    name = "nm_mode"
    title = "second neuromuscular mode"
    place = "command"
    keeps_unit = True
    physics = "The limb and the stick together have a second mode."
    machine_physics = "There is a second mode."
    formula = "omega^2 / (s^2 + 2 zeta omega s + omega^2)"
    tex = r"H(s) = \frac{\omega^2}{s^2 + 2 \zeta \omega s + \omega^2}"
    source = "Magdaleno and McRuer (1971)"
    parameters = (
        Parameter("omega", RAD / S, 4.0, 60.0, (15.0, 25.0), "frequency of the mode"),
        Parameter("zeta", ONE, 0.03, 2.0, (0.3,), "its damping ratio"),
    )
    within = ("higher_order",)  # whose zeros are fast
    citation = "Magdaleno and McRuer, Experimental validation of neuromuscular models (1971)."
    examples = ({"omega": 12.0, "zeta": 0.2},)
    hidden = examples[0]

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX:
            return "an ARX model has no neuromuscular system; higher_order adds poles and zeros"
        return None

    def apply(self, signal: Any, record: Record, omega: float, zeta: float) -> Any:
        poles = [1.0, 2 * zeta * omega, omega**2]
        return shaped(signal, record, [0.0, 0.0, omega**2], poles)


class HigherOrder(Effect):
    """Two more poles and zeros, with gain 1 at low frequency."""

    name = "higher_order"
    title = "higher-order dynamics"
    place = "command"
    keeps_unit = True
    physics = "The linear dynamics are of higher order."
    formula = "(s^2/w_z^2 + 2 z_z s/w_z + 1) / (s^2/w_p^2 + 2 z_p s/w_p + 1)"
    tex = (
        r"H(s) = \frac{s^2 / \omega_z^2 + 2 \zeta_z s / \omega_z + 1}"
        r"{s^2 / \omega_p^2 + 2 \zeta_p s / \omega_p + 1}"
    )
    source = "Ljung (1999)"
    parameters = (
        Parameter("zero_frequency", RAD / S, 0.3, 40.0, (1.5, 6.0, 15.0), "of the zeros"),
        Parameter("zero_damping", ONE, 0.0, 5.0, (0.6,), "of the zeros"),
        Parameter("pole_frequency", RAD / S, 0.3, 40.0, (1.5, 6.0, 15.0), "of the poles"),
        Parameter("pole_damping", ONE, 0.02, 5.0, (0.6,), "of the poles"),
    )
    citation = "Ljung (1999), order selection."
    examples = (
        {"zero_frequency": 2.0, "zero_damping": 0.4, "pole_frequency": 5.0, "pole_damping": 0.4},
    )
    hidden = {
        "zero_frequency": 6.0,
        "zero_damping": 0.3,
        "pole_frequency": 6.0,
        "pole_damping": 0.6,
    }

    def starts(self, record: Record) -> list[dict[str, float]]:
        """Zeros and poles at the same places (shifted a little, so that they can part)."""
        found = []
        for p in super().starts(record):
            if p["zero_frequency"] == p["pole_frequency"]:
                found.append({**p, "zero_frequency": 1.1 * p["zero_frequency"]})
        return found

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """Wider for an ARX model: machines ring longer than people, and over more octaves."""
        limits = super().limits(record)
        if record.core != CoreKind.ARX:
            return limits
        for name in ("zero_frequency", "pole_frequency"):
            low, high = limits[name]
            limits[name] = (0.1 * low, 5 * high)
        return {**limits, "zero_damping": (-5.0, 5.0), "pole_damping": (1e-3, 5.0)}

    def apply(
        self,
        signal: Any,
        record: Record,
        zero_frequency: float,
        zero_damping: float,
        pole_frequency: float,
        pole_damping: float,
    ) -> Any:
        zeros = [zero_frequency**-2, 2 * zero_damping / zero_frequency, 1.0]
        poles = [pole_frequency**-2, 2 * pole_damping / pole_frequency, 1.0]
        return shaped(signal, record, zeros, poles)
