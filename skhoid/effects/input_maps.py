"""Nonlinear responses to the error: threshold, asymmetry, rectification, cubic gain, magnitude."""

from __future__ import annotations

from typing import Any

import numpy as np

from .base import Effect
from .dimension import ONE, E, S, U
from .parameter import Parameter
from .record import Record
from .static_map import StaticMap, mean_within


class DeadZone(StaticMap):
    """Indifference threshold: small errors get no response, or small commands are not carried out.

    ``"gap"``: e' = sign(e) max(abs(e) - width, 0); ``"smooth"``: e' = e - width tanh(e / width);
    ``"jump"``: e' = e where abs(e) > width, else 0; ``"behind"``: the mean of the gap over remnant
    that passes through it too, with standard deviation ``remnant``.

    Parameters
    ----------
    width : float or None, default=None
        Half-width, in units of the error or of the output; None estimates it.
    remnant : float or None, default=None
        Standard deviation of the remnant ahead of it (``"behind"``), in the same units; None
        estimates it.
    form : {"gap", "smooth", "jump", "behind"} or None, default=None
        Whether the response starts from zero at the threshold or jumps; None tries all,
        ``"behind"`` only at places other than the error.
    at : {"error", "command", "output"} or None, default=None
        What has the threshold: the error, the command to the limb, or the output of the limb. None
        means the error; a search tries all three.

    References
    ----------
    McRuer and Krendel, Mathematical models of human pilot behavior, AGARDograph 188 (1974):
    indifference thresholds.

    Examples
    --------
    >>> from skhoid.effects import DeadZone
    >>> DeadZone(width=0.3).name
    'dead_zone'
    """

    name = "dead_zone"
    physics = "Errors below a threshold are not perceived, or not acted on."
    physics_at = {
        "command": "Small commands do not move the limb.",
        "output": "Small movements of the hand do not move the stick.",
    }
    machine_physics = "Inputs below a threshold have no effect: play, overlap, or static friction."
    formula = "e' = sign(e) max(|e| - width, 0), or e where |e| > width"
    tex = (
        r"e' = \begin{cases} \operatorname{sign}(e)\max(|e| - \mathrm{width},\, 0) & \text{gap} \\"
        r" e - \mathrm{width}\,\tanh(e / \mathrm{width}) & \text{smooth} \\"
        r" e \text{ where } |e| > \mathrm{width}, \text{ else } 0 & \text{jump} \end{cases}"
    )
    source = "McRuer and Krendel (1974)"
    shades = True
    choices = {"at": ("error", "command", "output"), "form": ("gap", "smooth", "jump", "behind")}
    plain = ("gap", "behind")

    def __init__(
        self,
        *,
        width: float | None = None,
        remnant: float | None = None,
        form: str | None = None,
        at: str | None = None,
    ):
        self.width = width
        self.remnant = remnant
        self.form = form
        self.at = at

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        width = Parameter("width", self.unit, 0.02, 3.0, (0.25, 0.7), "half-width of the threshold")
        if self.form != "behind":
            return (width,)
        return (
            width,
            Parameter("remnant", self.unit, 0.01, 2.0, (0.3,), "remnant ahead of the threshold"),
        )

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        # The error is measured with its remnant.
        return [v for v in made if v.form != "behind" or v.at != "error"] or made

    def mapped(
        self, signal: np.ndarray, record: Record, width: float, remnant: float = 0.0
    ) -> np.ndarray:
        if self.form == "behind":
            return signal - mean_within(signal, width, remnant)
        if self.form == "jump":
            # A sample at the threshold counts as far as it is inside: smooth in width.
            edge = 0.05 * width
            return signal * np.clip((np.abs(signal) - width) / edge + 0.5, 0.0, 1.0)
        if self.form == "smooth":
            return signal - width * np.tanh(signal / width)
        return signal - np.clip(signal, -width, width)


class AsymmetricGain(StaticMap):
    """Errors to the left and to the right get different gains.

    ``"all"``: e' = e + asymmetry abs(e); ``"large"``: e' = e + asymmetry max(abs(e) - level, 0),
    where small errors get the same gain on both sides.

    Parameters
    ----------
    asymmetry : float or None, default=None
        Half the relative difference between the gains, dimensionless; None estimates it.
    level : float or None, default=None
        Error above which the gains differ (``"large"``), in units of the error, or of the output;
        None estimates it.
    form : {"all", "large"} or None, default=None
        None tries both.
    at : {"error", "command", "output"} or None, default=None
        What it applies to: the error, the command to the limb, or the output of the limb. None
        means the error; a search tries all three, the other two as ``"all"``.

    References
    ----------
    McRuer and Krendel (1974).

    Examples
    --------
    >>> from skhoid.effects import AsymmetricGain
    >>> AsymmetricGain(asymmetry=0.2)
    AsymmetricGain(asymmetry=0.2)
    """

    name = "asym_gain"
    title = "asymmetric gain"
    physics = "The response is stronger to errors on one side than on the other."
    physics_at = {
        "command": "Commands to one side are carried out more strongly than those to the other.",
        "output": "The stick moves further to one side than to the other.",
    }
    machine_physics = "Inputs to one side act more strongly than those to the other."
    formula = "e' = e + asymmetry |e|, or e + asymmetry max(|e| - level, 0)"
    tex = (
        r"e' = \begin{cases} e + \mathrm{asymmetry}\,|e| & \text{all} \\"
        r" e + \mathrm{asymmetry}\,\max(|e| - \mathrm{level},\, 0) & \text{large} \end{cases}"
    )
    source = "McRuer and Krendel (1974)"
    shades = True
    neutral = {"asymmetry": 0.0}
    choices = {"at": ("error", "command", "output"), "form": ("all", "large")}
    plain = ("all",)

    def __init__(
        self,
        *,
        asymmetry: float | None = None,
        level: float | None = None,
        form: str | None = None,
        at: str | None = None,
    ):
        self.asymmetry = asymmetry
        self.level = level
        self.form = form
        self.at = at

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        meaning = "positive errors stronger"
        if self.form == "large":
            return (
                Parameter("asymmetry", ONE, -0.95, 0.95, (-0.3, 0.3), meaning),
                Parameter(
                    "level", self.unit, 0.05, 2.0, (0.3, 0.8), "error above which gains differ"
                ),
            )
        return (Parameter("asymmetry", ONE, -0.7, 0.7, (-0.2, 0.2), meaning),)

    def mapped(
        self, signal: np.ndarray, record: Record, asymmetry: float, level: float = 0.0
    ) -> np.ndarray:
        return signal + asymmetry * np.maximum(np.abs(signal) - level, 0.0)


class Rectified(Effect):
    """Half-wave rectification: errors of one sign get a response, the others hardly any.

    ``"sharp"``: e' = e on its side, leak e on the other; ``"soft"``: e' = (e + s sqrt(e^2 +
    width^2) - s width) / 2 with s = 1 or -1, a gradual transition from one side to the other.

    Parameters
    ----------
    leak : float or None, default=None
        Relative gain on the other side (``"sharp"``), at most 0.18 (for more, see
        :class:`AsymmetricGain`); None estimates it.
    width : float or None, default=None
        Width of the bend of ``"soft"``, in units of the error; None estimates it.
    side : {"positive", "negative"} or None, default=None
        Sign of the errors that get a response; None tries both.
    form : {"sharp", "soft"} or None, default=None
        None tries both.

    References
    ----------
    Semicircular and visual half-wave channels: Young, Human control capabilities (1973).

    Examples
    --------
    >>> from skhoid.effects import Rectified
    >>> Rectified(side="positive").name
    'rectified'
    """

    name = "rectified"
    title = "one-sided response"
    place = "input"
    physics = "The operator responds only to errors of one sign."
    machine_physics = "Only inputs of one sign act."
    formula = "e' = max(e, leak e), or min(e, leak e)"
    tex = (
        r"e' = \begin{cases} \max(e,\, \mathrm{leak}\; e) & \text{sharp} \\"
        r" \tfrac{1}{2}\bigl(e + \sqrt{e^2 + \mathrm{width}^2} - \mathrm{width}\bigr) &"
        r" \text{soft} \end{cases}"
    )
    source = "Young (1973)"
    shades = True
    choices = {"form": ("sharp", "soft"), "side": ("positive", "negative")}

    def __init__(
        self,
        *,
        leak: float | None = None,
        width: float | None = None,
        side: str | None = None,
        form: str | None = None,
    ):
        self.leak = leak
        self.width = width
        self.side = side
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.form == "soft":
            return (Parameter("width", E, 0.02, 1.0, (0.3,), "width of the bend"),)
        return (Parameter("leak", ONE, 0.0, 0.18, (0.05,), "relative gain on the other side"),)

    def apply(
        self, signal: np.ndarray, record: Record, leak: float = 0.0, width: float = 0.0
    ) -> np.ndarray:
        if self.form == "soft":
            bend = np.sqrt(signal * signal + width * width) - width
            return (signal + (bend if self.side == "positive" else -bend)) / 2
        answered = signal > 0 if self.side == "positive" else signal < 0
        return np.where(answered, signal, leak * signal)


class CubicGain(StaticMap):
    """Gain that grows (hardening) or falls (softening) with amplitude.

    ``"cubic"``: e' = e + hardening e^3; ``"square"``: e' = e + hardening e abs(e); ``"power"``: e'
    = sign(e) abs(e)^(1 + hardening), in units of the standard deviation of the error. Where it
    softens, the response stays at its maximum beyond the error where it is reached.

    Parameters
    ----------
    hardening : float or None, default=None
        In the unit of the error to the power -2 or -1, or dimensionless; None estimates it.
    form : {"cubic", "square", "power"} or None, default=None
        None tries all.
    at : {"error", "command"} or None, default=None
        What it applies to: the error, or the command to the limb. None means the error; a search
        tries both, the command without ``"square"``.
    reference : float or None, default=None
        Standard deviation of the error (or output) that ``"power"`` refers to; None takes it from
        the data.

    References
    ----------
    Ljung, System identification (1999), Hammerstein models.

    Examples
    --------
    >>> from skhoid.effects import CubicGain
    >>> CubicGain(form="cubic").name
    'cubic_gain'
    """

    name = "cubic_gain"
    physics = "The response to large errors is more (or less) than proportional."
    physics_at = {"command": "The response to large commands is more (or less) than proportional."}
    machine_physics = "The response to large inputs is more (or less) than proportional."
    formula = "e' = e + hardening e^3, e + hardening e |e|, or sign(e) |e|^(1 + hardening)"
    tex = (
        r"e' = \begin{cases} e + \mathrm{hardening}\; e^3 & \text{cubic} \\"
        r" e + \mathrm{hardening}\; e\,|e| & \text{square} \\"
        r" \operatorname{sign}(e)\,|e|^{1 + \mathrm{hardening}} & \text{power} \end{cases}"
    )
    source = "Hammerstein models, Ljung (1999)"
    shades = True
    choices = {"at": ("error", "command"), "form": ("cubic", "square", "power")}
    plain = ("cubic", "power")
    neutral = {"hardening": 0.0}

    def __init__(
        self,
        *,
        hardening: float | None = None,
        form: str | None = None,
        at: str | None = None,
        reference: float | None = None,
    ):
        self.hardening = hardening
        self.form = form
        self.at = at
        self.reference = reference

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        meaning = "increase of the gain with amplitude"
        if self.form == "power":
            return (Parameter("hardening", ONE, -0.7, 2.5, (-0.3, 0.3), meaning),)
        if self.form == "square":
            return (Parameter("hardening", ONE / self.unit, -0.25, 20.0, (-0.1, 0.3), meaning),)
        return (Parameter("hardening", ONE / self.unit**2, -0.08, 20.0, (-0.02, 0.1), meaning),)

    def variants(self, record: Record) -> list[Effect]:
        signal = "e" if self.place == "input" else "u"
        reference = record.sd(signal) if self.reference is None else self.reference
        return [v.with_choices(reference=reference) for v in super().variants(record)]

    def mapped(self, signal: np.ndarray, record: Record, hardening: float) -> np.ndarray:
        size = np.abs(signal)
        if self.form == "power":
            relative = np.maximum(size / self.reference, 1e-6)
            return signal * relative**hardening
        power = 1 if self.form == "square" else 2
        if hardening < 0.0:
            greatest = (-1 / ((power + 1) * hardening)) ** (1 / power)
            signal = np.clip(signal, -greatest, greatest)
            size = np.minimum(size, greatest)
        return signal * (1 + hardening * size**power)


class AbsoluteValue(Effect):
    """The operator responds to the magnitude of the error too: the command gets gain abs(e).

    ``"together"``: at the same time as to the error; ``"apart"``: earlier or later.

    Parameters
    ----------
    gain : float or None, default=None
        In units of the output per unit of the error; None estimates it.
    later : float or None, default=None
        How much later the response to the magnitude is than that to the error (``"apart"``), in
        seconds; None estimates it.
    form : {"together", "apart"} or None, default=None
        None tries both.

    References
    ----------
    McRuer and Krendel (1974).

    Examples
    --------
    >>> from skhoid.effects import AbsoluteValue
    >>> AbsoluteValue().place
    'path'
    """

    name = "absolute_value"
    title = "response to size alone"
    place = "path"
    physics = "The magnitude of the error moves the stick to one side, whatever the error's sign."
    machine_physics = "The input's magnitude moves the output to one side, whatever its sign."
    formula = "command + gain |e(t - tau_e - later)|"
    tex = r"c' = c + \mathrm{gain}\;|e(t - \tau_e - \mathrm{later})|"
    source = "McRuer and Krendel (1974)"
    shades = True
    neutral = {"gain": 0.0}
    choices = {"form": ("together", "apart")}

    def __init__(
        self, *, gain: float | None = None, later: float | None = None, form: str | None = None
    ):
        self.gain = gain
        self.later = later
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        gain = Parameter("gain", U / E, -5.0, 5.0, (-0.3, 0.3), "gain on the magnitude")
        if self.form != "apart":
            return (gain,)
        return (
            gain,
            Parameter("later", S, -0.3, 0.6, (-0.1, 0.1), "delay after the response to the error"),
        )

    def apply(self, signal: Any, record: Record, gain: float, later: float = 0.0) -> Any:
        size = np.abs(signal.error)
        return signal.plus(gain * (record.delayed(size, later) if self.form == "apart" else size))
