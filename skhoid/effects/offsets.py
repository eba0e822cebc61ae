"""Offsets of the output (bias, drift) and trim (the integral of the error)."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect
from .dimension import ONE, E, S, T, U
from .parameter import Parameter
from .record import Record


class Bias(Effect):
    """A constant offset of the output.

    Parameters
    ----------
    level : float or None, default=None
        In units of the output; None estimates it.

    References
    ----------
    Ljung, System identification (1999), section 14.1.

    Examples
    --------
    >>> from skhoid.effects import Bias
    >>> Bias(level=0.1).fixed
    {'level': 0.1}
    """

    name = "bias"
    place = "sum"
    physics = "The output has an offset: trim, or a sensor's zero error."
    machine_physics = "The output has an offset: a sensor's zero error, or a constant load."
    formula = "u + level"
    tex = r"u' = u + \mathrm{level}"
    source = "Ljung (1999)"
    parameters = (Parameter("level", U, -20.0, 20.0, (0.1,), "offset"),)
    neutral = {"level": 0.0}
    within = ("drift",)  # that has settled

    def __init__(self, *, level: float | None = None):
        self.level = level

    def apply(self, signal: np.ndarray, record: Record, level: float) -> np.ndarray:
        return signal + level


class Drift(Effect):
    """An offset of the output that changes during the run.

    ``"linear"``: rate (t - reference); ``"settling"``: level - rate tau exp(-(t - reference) /
    tau), which comes to rest at the level, with the reference at the start.

    Parameters
    ----------
    rate : float or None, default=None
        In units of the output per second (at the start, for ``"settling"``); None estimates it.
    tau : float or None, default=None
        Time constant of ``"settling"`` in seconds; None estimates it.
    level : float or None, default=None
        Where ``"settling"`` comes to rest, in units of the output; None estimates it.
    reference : float or None, default=None
        Time in the run, in seconds, at which it is zero (``"linear"``) or begins
        (``"settling"``); None takes the middle, and the start.
    form : {"linear", "settling"} or None, default=None
        None tries both.

    References
    ----------
    Ljung (1999), section 14.1.

    Examples
    --------
    >>> from skhoid.effects import Drift
    >>> Drift().name
    'drift'
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

    def __init__(
        self,
        *,
        rate: float | None = None,
        tau: float | None = None,
        level: float | None = None,
        reference: float | None = None,
        form: str | None = None,
    ):
        self.rate = rate
        self.tau = tau
        self.level = level
        self.reference = reference
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        rate = Parameter("rate", U / S, -20.0, 20.0, (0.5,), "rate of the drift", U / T)
        if self.form != "settling":
            return (rate,)
        steep = Parameter("rate", U / S, -100.0, 100.0, (2.0, -2.0), "rate at the start", U / T)
        level = Parameter("level", U, -20.0, 20.0, (0.0,), "level where it settles")
        return (steep, Parameter("tau", S, 0.05, 1.0, (0.15, 0.4), "time constant", T), level)

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

    ``"pure"``: the integral from the start of the run; ``"leaky"``: 1 / (s + leak), which forgets.

    Parameters
    ----------
    gain : float or None, default=None
        In units of the output per unit of the error and second; None estimates it.
    leak : float or None, default=None
        Rate of forgetting in 1/s of ``"leaky"``; None estimates it.
    form : {"pure", "leaky"} or None, default=None
        None tries both.

    References
    ----------
    McRuer and Krendel (1974), low-frequency trim.

    Examples
    --------
    >>> from skhoid.effects import Integral
    >>> Integral().place
    'path'
    """

    name = "integral"
    title = "integral action"
    place = "path"
    physics = "A standing error is trimmed away slowly."
    machine_physics = "The machine also integrates its input."
    formula = "command + gain * integral of e(t - tau_e)"
    tex = r"c' = c + \mathrm{gain} \int e(t - \tau_e)\,\mathrm{d}t"
    source = "McRuer and Krendel (1974)"
    neutral = {"gain": 0.0}
    within = ("higher_order",)  # with a slow pole and a zero; its other pair cancels
    choices = {"form": ("pure", "leaky")}

    def __init__(
        self, *, gain: float | None = None, leak: float | None = None, form: str | None = None
    ):
        self.gain = gain
        self.leak = leak
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        gain = Parameter("gain", U / (E * S), 0.0, 20.0, (0.1, 0.5), "gain on the integral")
        if self.form != "leaky":
            return (gain,)
        return (gain, Parameter("leak", ONE / S, 0.001, 0.6, (0.1,), "rate of forgetting"))

    def apply(self, signal: Any, record: Record, gain: float, leak: float = 0.0) -> Any:
        dt = record.dt
        b, a = np.array([dt, 0.0, 0.0]), np.array([leak * dt - 1.0, 0.0])
        total = _kernels.greybox.filtered(_kernels.gate(signal.error), b, a)
        return signal.plus(gain * total)


def with_middle(effect: Any, record: Record) -> Any:
    """Refer an effect to the middle of the runs, unless it has a reference."""
    if effect.reference is not None:
        return effect
    return effect.with_choices(reference=float((record.t[0] + record.t[-1]).mean() / 2))
