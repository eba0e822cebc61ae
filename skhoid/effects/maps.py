"""Maps of the error, the command or the output, with and without memory; stiff springs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.special import ndtr

from .. import _kernels
from .base import Effect
from .entry import Argument
from .error_scan import ErrorScan
from .operator_signals import Spring
from .parameter import ONE, CoreKind, E, Parameter, S, U
from .record import Record, differentiated, find_stop

__all__ = [  # in the order of the catalogue
    "DeadZone",
    "AsymmetricGain",
    "Rectified",
    "CubicGain",
    "AbsoluteValue",
    "Saturation",
    "RateLimit",
    "Backlash",
    "Stiction",
    "Quantised",
    "HardeningStiffness",
]

NO_LIMB = "a controller has no limb and no spring"
GROWTH = "increase of the gain with amplitude"
PLACE_OF = {"error": "input", "command": "command", "output": "output"}


class StaticMap(Effect):
    """Base of effects that map a signal sample by sample, at one of several places.

    A subclass has the argument ``at``, which its ``choices`` list first, the usual place before the
    others, and implements ``mapped``. A search tries every place.
    """

    plain: ClassVar[tuple[str, ...]]  # forms that are tried at other places than the usual one
    physics_at: ClassVar[Mapping[str, str]] = {}  # in place of ``physics`` at other places
    at: str | None
    form: str | None

    @property
    def usual_at(self) -> str:
        """Where it acts unless another place is given."""
        return self.choices["at"][0]

    @property
    def place(self) -> str:  # type: ignore[override]
        at = self.at or self.usual_at
        if at not in PLACE_OF:
            self.check_choices()
        return PLACE_OF[at]

    def resolved(self, parameter: Parameter) -> Parameter:
        """In units of the signal that is mapped."""
        if self.place == "input":
            return parameter
        return replace(parameter, dimension=parameter.dimension.with_input_as_output())

    def physics_in(self, domain: str) -> str:
        return self.physics_at.get(self.at or "") or super().physics_in(domain)

    def variants(self, record: Record) -> list[Effect]:
        """The choices at the place, which is the usual one unless another is given.

        At others the plain forms only, where none is given.
        """
        placed = self.with_choices(at=self.at or self.usual_at)
        made: list[Any] = super(StaticMap, placed).variants(record)
        return [v for v in made if v.at == self.usual_at or v.form in self.plain] or made

    def alternatives(self, record: Record) -> list[Effect]:
        """One for each place; an ARX model has the usual one only."""
        usual, *others = self.copy_for_each("at", self.choices["at"])
        return [usual] if record.core == CoreKind.ARX else [usual, *others]

    def apply(self, signal: Any, record: Record, *args: Any, **values: Any) -> Any:
        if self.place != "command":
            return self.mapped(signal, record, *args, **values)
        whole = signal.position + differentiated(signal.rate, record.dt)
        mapped = self.mapped(whole, record, *args, **values)
        return signal._replace(position=mapped, rate=np.zeros_like(signal.rate))

    def mapped(self, signal: np.ndarray, record: Record, *args: Any, **values: Any) -> np.ndarray:
        """What becomes of the signal."""
        raise NotImplementedError(f"{type(self).__name__} must implement mapped.")


def mean_within(signal: np.ndarray, limit: float, remnant: float) -> np.ndarray:
    """Mean of a signal that limits cut, over remnant that is cut with it."""
    flat = _kernels.gate(signal).ravel()
    return _kernels.greybox.cut_within(flat, limit, remnant).reshape(np.shape(signal))


class DeadZone(StaticMap):
    """Indifference threshold: small errors get no response, or small commands are not carried out.

    ``"gap"``: e' = sign(e) max(abs(e) - width, 0); ``"smooth"``: e' = e - width tanh(e / width);
    ``"jump"``: e' = e where abs(e) > width, else 0; ``"behind"``: the mean of the gap over remnant
    that passes through it too, with standard deviation ``remnant``.
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
    neutral = {"width": 0.0}
    citation = (
        "McRuer and Krendel, Mathematical models of human pilot behavior, AGARDograph 188 (1974): "
        "indifference thresholds."
    )
    told_apart = {
        "cubic_gain": (
            "record runs with half and with twice the amplitude of the target: a dead zone "
            "vanishes at large amplitude; a growing gain does not"
        ),
    }
    examples = (
        {"form": "gap", "width": 0.7},
        {"form": "smooth", "width": 0.7},
        {"form": "jump", "width": 0.7},
        {"form": "behind", "at": "output", "width": 0.1, "remnant": 0.05},
    )
    hidden = {"width": 0.3}
    parameters = (
        Parameter("width", E, 0.02, 3.0, (0.25, 0.7), "half-width of the threshold"),
        Parameter(
            "remnant", E, 0.01, 2.0, (0.3,), "remnant ahead of the threshold", forms=("behind",)
        ),
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
            edge = max(0.05 * width, 1e-300)
            return signal * np.clip((np.abs(signal) - width) / edge + 0.5, 0.0, 1.0)
        if self.form == "smooth":
            return signal - width * np.tanh(signal / max(width, 1e-300))
        return signal - np.clip(signal, -width, width)


class AsymmetricGain(StaticMap):
    """Errors to the left and to the right get different gains.

    ``"all"``: e' = e + asymmetry abs(e); ``"large"``: e' = e + asymmetry max(abs(e) - level, 0),
    where small errors get the same gain on both sides.
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
    told_apart = {
        "absolute_value": (
            "record a target of higher frequencies: asymmetry acts on the error's rate too"
        ),
        "rectified": "record runs with a constant disturbance to either side",
    }
    examples = (
        {"form": "all", "asymmetry": 0.4},
        {"form": "large", "asymmetry": 0.6, "level": 0.7},
    )
    hidden = {"asymmetry": 0.3}
    parameters = (
        Parameter(
            "asymmetry", ONE, -0.7, 0.7, (-0.2, 0.2), "positive errors stronger", forms=("all",)
        ),
        Parameter(
            "asymmetry", ONE, -0.95, 0.95, (-0.3, 0.3), "positive errors stronger", forms=("large",)
        ),
        Parameter(
            "level", E, 0.05, 2.0, (0.3, 0.8), "error above which gains differ", forms=("large",)
        ),
    )

    def mapped(
        self, signal: np.ndarray, record: Record, asymmetry: float, level: float = 0.0
    ) -> np.ndarray:
        return signal + asymmetry * np.maximum(np.abs(signal) - level, 0.0)


class Rectified(Effect):
    """Half-wave rectification: errors of one sign get a response, the others hardly any.

    ``"sharp"``: e' = e on its side, leak e on the other; ``"soft"``: e' = (e + s sqrt(e^2 +
    width^2) - s width) / 2 with s = 1 or -1, a gradual transition from one side to the other.
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
    citation = (
        "Semicircular and visual half-wave channels: Young, Human control capabilities (1973)."
    )
    examples = (
        {"form": "sharp", "side": "positive", "leak": 0.1},
        {"form": "soft", "side": "positive", "width": 0.7},
    )
    hidden = examples[0]
    parameters = (
        Parameter("width", E, 0.02, 1.0, (0.3,), "width of the bend", forms=("soft",)),
        Parameter(
            "leak", ONE, 0.0, 0.18, (0.05,), "relative gain on the other side", forms=("sharp",)
        ),
    )

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
    citation = "Ljung, System identification (1999), Hammerstein models."
    examples = (
        {"form": "cubic", "hardening": 0.15},
        {"form": "square", "hardening": 0.4},
        {"form": "power", "hardening": 0.8, "reference": 0.6},
    )
    hidden = {"hardening": 0.5}
    parameters = (
        Parameter("hardening", ONE, -0.7, 2.5, (-0.3, 0.3), GROWTH, forms=("power",)),
        Parameter("hardening", ONE / E, -0.25, 20.0, (-0.1, 0.3), GROWTH, forms=("square",)),
        Parameter("hardening", ONE / E**2, -0.08, 20.0, (-0.02, 0.1), GROWTH, forms=("cubic",)),
    )
    arguments = {
        "reference": Argument(
            'Standard deviation of the error (or output) that ``"power"`` refers to; None takes '
            "it from the data.",
            "float or None",
        )
    }

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
    examples = (
        {"form": "together", "gain": 0.05},
        {"form": "apart", "gain": 0.05, "later": 0.1},
    )
    hidden = examples[0]
    parameters = (
        Parameter("gain", U / E, -5.0, 5.0, (-0.3, 0.3), "gain on the magnitude"),
        Parameter(
            "later",
            S,
            -0.3,
            0.6,
            (-0.1, 0.1),
            "delay after the response to the error",
            forms=("apart",),
        ),
    )

    def apply(self, signal: Any, record: Record, gain: float, later: float = 0.0) -> Any:
        size = np.abs(signal.error)
        return signal.plus(gain * (record.delayed(size, later) if self.form == "apart" else size))


SCANNED_STEPS = np.geomspace(0.25, 3.5, 45)  # in standard deviations of the output
OFFSETS = (0.0, 0.5)
KEPT_STEPS = 3
HIDDEN = 0.35  # remnant ahead of levels, in steps, that hides them
PLAY = 0.5  # logarithm of the mean distance of jumps from the command, either way
AMPLITUDE, STEPS = 3.0, 30.0  # standard deviations of the output, and most jumps on the way there
SHARES, FINER_SHARES = np.linspace(0.0, 0.95, 20), np.linspace(-0.03, 0.03, 7)
FACTORS, FINER_FACTORS = np.linspace(0.88, 1.12, 25), np.linspace(0.992, 1.008, 9)


class Saturation(StaticMap):
    """Stops: the output, the command or the perceived error stays within limits.

    ``"hard"``: min(max(u, -limit), limit); ``"unequal"``: from -limit (1 - skew) to limit (1 +
    skew); ``"soft"``: limit tanh(u / limit); ``"behind"``: the mean of the hard one over remnant
    that is limited too, with standard deviation ``remnant``.
    """

    name = "saturation"
    physics = "The stick reaches its stop, or the hand its full deflection."
    physics_at = {
        "command": "The command to the limb is limited.",
        "error": "Errors beyond a limit look the same, as at the edge of a display.",
    }
    machine_physics = "The output reaches a stop, or the limit of the sensor's range."
    formula = "u' = min(max(u, -limit), limit), or limit tanh(u / limit)"
    tex = (
        r"u' = \begin{cases} \min(\max(u, -\mathrm{limit}),\, \mathrm{limit}) & \text{hard} \\"
        r" \mathrm{limit}\,\tanh(u / \mathrm{limit}) & \text{soft} \end{cases}"
    )
    source = "Gelb and Vander Velde (1968)"
    choices = {
        "at": ("output", "command", "error"),
        "form": ("hard", "soft", "unequal", "behind"),
    }
    plain = ("hard",)
    neutral = {"limit": np.inf}
    citation = "Gelb and Vander Velde, Multiple-input describing functions (1968)."
    told_apart = {
        "cubic_gain": "record runs at half the amplitude: stops are not reached then",
        "hardening_stiffness": (
            "record runs at half the amplitude, and move the stick slowly from stop to stop"
        ),
        "rate_limit": (
            "record a slow target of large amplitude, which reaches the stop and not the rate"
        ),
    }
    examples = (
        {"form": "hard", "limit": 0.2},
        {"form": "soft", "limit": 0.2},
        {"form": "unequal", "limit": 0.2, "skew": -0.4},
        {"form": "behind", "limit": 0.2, "remnant": 0.05},
    )
    hidden = {"limit": 0.1}
    parameters = (
        Parameter("limit", E, 0.1, 4.0, (0.8, 1.6), "maximum deflection"),
        Parameter(
            "skew", ONE, -0.95, 0.95, (-0.3, 0.3), "asymmetry of the stops", forms=("unequal",)
        ),
        Parameter("remnant", E, 0.01, 2.0, (0.3,), "remnant ahead of the stop", forms=("behind",)),
    )

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        # A stop after the remnant shows in the output itself.
        possible = self.form == "behind" or find_stop(record) is not None
        return [v for v in made if v.form != "behind" or possible]

    def mapped(
        self,
        signal: np.ndarray,
        record: Record,
        limit: float,
        remnant: float = 0.0,
        skew: float = 0.0,
    ) -> np.ndarray:
        if np.isinf(limit):
            return signal
        if self.form == "soft":
            return limit * np.tanh(signal / limit)
        if self.form == "behind":
            return mean_within(signal, limit, remnant)
        return np.clip(signal, -limit * (1 - skew), limit * (1 + skew))


class RateLimit(Effect):
    """The rate of the output is limited."""

    name = "rate_limit"
    place = "output"
    keeps_unit = True
    physics = "The hand or the actuator has a maximum speed."
    machine_physics = "The actuator has a maximum speed."
    formula = "|du'/dt| <= limit"
    tex = r"\left|\frac{\mathrm{d}u'}{\mathrm{d}t}\right| \le \mathrm{limit}"
    source = "Duda (1997)"
    kinks = True
    neutral = {"limit": np.inf}
    parameters = (Parameter("limit", U / S, 0.1, 30.0, (1.0, 2.0, 4.0), "maximum rate"),)
    citation = (
        "Rate-limited actuators: Duda, Flight control system analysis with rate limiters (1997)."
    )
    examples = ({"limit": 0.5},)
    hidden = {"limit": 0.2}

    def apply(self, signal: np.ndarray, record: Record, limit: float) -> np.ndarray:
        return _kernels.greybox.rate_limited(_kernels.gate(signal), limit * record.dt)


class Backlash(Effect):
    """Play: the output trails the command by a gap, and stays put when the command reverses."""

    name = "backlash"
    place = "output"
    physics = "There is play between hand and stick, or in the linkage."
    machine_physics = "There is play in the gears or the linkage."
    formula = "u' holds while |u - u'| < gap, then trails u by gap"
    tex = r"u'_k = \min(\max(u'_{k-1},\, u_k - \mathrm{gap}),\, u_k + \mathrm{gap})"
    source = "Gelb and Vander Velde (1968)"
    parameters = (Parameter("gap", U, 0.01, 2.0, (0.1, 0.3), "half-width of the play"),)
    neutral = {"gap": 0.0}
    # With a kinetic friction as large as the static one; in a limb that is fast.
    within = ("stiction", "friction")
    examples = ({"gap": 0.08},)
    hidden = {"gap": 0.03}

    def apply(self, signal: np.ndarray, record: Record, gap: float) -> np.ndarray:
        return _kernels.greybox.stuck(_kernels.gate(signal), gap, gap, True)


class Stiction(Effect):
    """Dry friction: the output sticks until it breaks away, then trails the command.

    ``"slide"``: it keeps following until the command reverses; ``"jump"``: it sticks again at once.
    """

    name = "stiction"
    place = "output"
    physics = "The stick sticks, breaks away, then slides or sticks again."
    machine_physics = "The output sticks, breaks away, then slides or sticks again."
    formula = "u' holds while |u - u'| < breakaway, then trails u by kinetic * breakaway"
    tex = (
        r"u' = \begin{cases} \text{constant} & \text{while } |u - u'| < \mathrm{breakaway} \\"
        r" u \mp \mathrm{kinetic} \cdot \mathrm{breakaway} & \text{then} \end{cases}"
    )
    source = "Armstrong-Helouvry et al. (1994)"
    parameters = (
        Parameter("breakaway", U, 0.01, 2.0, (0.1, 0.2, 0.4, 0.7), "static friction"),
        Parameter("kinetic", ONE, 0.0, 0.95, (0.2, 0.6), "ratio of kinetic to static friction"),
    )
    smooth = False
    shades = True
    neutral = {"breakaway": 0.0}
    choices = {"form": ("slide", "jump")}
    citation = "Armstrong-Helouvry et al., A survey of models for machines with friction (1994)."
    told_apart = {
        "backlash": (
            "record slow ramps of a few seconds: with backlash the output follows at a constant "
            "distance; with stiction it jumps"
        ),
    }
    examples = (
        {"form": "slide", "breakaway": 0.15, "kinetic": 0.3},
        {"form": "jump", "breakaway": 0.15, "kinetic": 0.3},
    )
    hidden = {"form": "slide", "breakaway": 0.04, "kinetic": 0.3}

    def scanned_beside(
        self, error_of: ErrorScan, values: dict[str, float]
    ) -> list[dict[str, float]]:
        """Jumps with nearly the same mean distance from the command, which is found first."""
        if self.form != "jump" or self.fixed:
            return []
        mean, best = values["breakaway"] * (1 + values["kinetic"]) / 2, values
        shares, factors = SHARES, FACTORS
        for _ in range(2):
            tried = [
                {"breakaway": 2 * by * mean / (1 + share), "kinetic": share}
                for share in shares
                for by in factors
            ]
            best = min(tried, key=lambda one: error_of(one, np.inf))
            mean = best["breakaway"] * (1 + best["kinetic"]) / 2
            shares = np.clip(best["kinetic"] + FINER_SHARES, 0.0, 0.95)
            factors = FINER_FACTORS
        return [best]

    def within_cube(
        self, values: dict[str, float], at: np.ndarray, record: Record
    ) -> dict[str, float]:
        """By the mean distance from the command, and the number of steps in an amplitude.

        Jumps of the same size make the output a staircase with a play of the mean distance.
        """
        if self.form != "jump" or self.fixed:
            return super().within_cube(values, at, record)
        breakaway, kinetic = values["breakaway"], values["kinetic"]
        mean = breakaway * (1 + kinetic) / 2 * np.exp(PLAY * (2 * at[0] - 1) ** 3)
        amplitude = AMPLITUDE * record.sd("u")
        least = min(amplitude / (2 * mean), STEPS)  # with no kinetic friction
        jump = min(amplitude / (least * (STEPS / least) ** at[1]), 2 * mean)
        breakaway = float(mean + jump / 2)
        return {"breakaway": breakaway, "kinetic": float((mean - jump / 2) / breakaway)}

    def apply(
        self, signal: np.ndarray, record: Record, breakaway: float, kinetic: float
    ) -> np.ndarray:
        if breakaway == 0.0:
            return signal
        slides = self.form != "jump"
        return _kernels.greybox.stuck(_kernels.gate(signal), breakaway, kinetic * breakaway, slides)


class Quantised(StaticMap):
    """The output, the command or the perceived error takes discrete levels.

    ``"sharp"``: u' = step round(u / step - offset); ``"behind"``: its mean over remnant that is
    quantised too, with standard deviation ``remnant``, u + steps that the remnant smooths;
    ``"uneven"`` has levels at step n^(1 / power), n = 0, 1, 2 ... to either side.
    """

    name = "quantised"
    title = "quantisation"
    physics = "The output moves in steps: keys, detents, or a coarse converter."
    physics_at = {
        "command": "The command to the limb moves in steps.",
        "error": "The error is seen in steps, as on a coarse display.",
    }
    machine_physics = "The output moves in steps: detents, or a coarse converter."
    formula = "u' = step round(u / step - offset)"
    tex = r"u' = \mathrm{step}\,\operatorname{round}(u / \mathrm{step} - \mathrm{offset})"
    source = "Widrow and Kollar (2008)"
    shades = True
    # The smooth form comes first: the others start from what it finds as well.
    choices = {"at": ("output", "command", "error"), "form": ("behind", "sharp", "uneven")}
    plain = ("behind", "sharp")
    citation = "Widrow and Kollar, Quantization noise (2008); Gelb and Vander Velde (1968)."
    examples = (
        {"form": "sharp", "step": 0.12, "offset": 0.0},
        {"form": "behind", "step": 0.12, "offset": 0.0, "remnant": 0.08},
        {"form": "uneven", "step": 0.1, "power": 1.5},
    )
    hidden = {"step": 0.1, "offset": 0.0}
    parameters = (
        Parameter("step", E, 0.05, 6.0, (0.5, 1.0, 2.0), "distance between levels"),
        Parameter(
            "offset",
            ONE,
            -0.5,
            0.5,
            (0.0, 0.5),
            "shift of the thresholds, in steps",
            forms=("behind", "sharp"),
        ),
        Parameter(
            "remnant",
            ONE,
            0.15,
            HIDDEN,
            (0.2,),
            "remnant ahead of the levels, in steps",
            forms=("behind",),
        ),
        Parameter(
            "power", ONE, 0.5, 2.0, (0.8, 1.25), "crowding of uneven levels", forms=("uneven",)
        ),
    )
    unless_given = {"form": "sharp"}

    unseen_at = {"remnant": HIDDEN, "step": np.inf}  # an offset is left, or two levels
    softness = 0.0  # of corners, in steps

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        return self.form == "behind" or self.softness > 0.0

    def softened(self, amount: float) -> Effect:
        soft = self.with_choices()
        soft.softness = amount
        return soft

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """A step is as large at most as leaves three levels in use: fewer show no step.

        Three levels of the output are two steps apart; the error passes them within one.
        """
        found = super().limits(record)
        seen = record.input if self.place == "input" else record.y
        if seen is not None and record.known.any():
            low, high = found["step"]
            most = float(np.ptp(seen[record.known])) / (1.0 if self.place == "input" else 2.0)
            found["step"] = (low, max(low, min(high, most)))
        return found

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Steps as close as the minima of the squares, which are some percent wide."""
        if self.form != "behind" or self.step is not None:
            return []
        offsets = OFFSETS if self.offset is None else (self.offset,)
        remnant = 0.2 if self.remnant is None else self.remnant
        size = record.sd("e" if self.place == "input" else "u")
        tried = [
            {"step": step * size, "offset": offset, "remnant": remnant}
            for step in SCANNED_STEPS
            for offset in offsets
        ]
        errors = [error_of(values, record.duration) for values in tried]
        return [tried[i] for i in np.argsort(errors)[:KEPT_STEPS]]

    def mapped(
        self,
        signal: np.ndarray,
        record: Record,
        step: float,
        offset: float = 0.0,
        remnant: float = 0.0,
        power: float = 1.0,
    ) -> np.ndarray:
        if self.form == "uneven":
            levels = self._rounded(np.abs(signal / step) ** power) ** (1 / power)
            return step * np.copysign(levels, signal)
        if self.form != "behind":
            return step * self._rounded(signal / step - offset)
        # Sines of once, twice and three times the angle make the steps, smoothed by the remnant.
        sines = np.exp(-2 * (np.pi * remnant * np.arange(1, 4)) ** 2) / np.pi
        flat = _kernels.gate(signal).ravel()
        return _kernels.greybox.stepped(flat, step, offset, sines).reshape(np.shape(signal))

    def _rounded(self, place: np.ndarray) -> np.ndarray:
        if not self.softness:
            return np.round(place)
        below = np.floor(place)
        return below + ndtr((place - below - 0.5) / self.softness)


class HardeningStiffness(Effect):
    """A spring that stiffens with deflection opposes the command.

    ``"cubic"``: stiffness u^3; ``"square"``: stiffness u abs(u). With an operator it is the
    neuromuscular spring, omega_nm^2 (u + stiffness u^3); with an ARX model, A(q) u = B(q) (x -
    stiffness u^3), the Duffing oscillator.
    """

    name = "hardening_stiffness"
    place = "spring"
    physics = "The spring of the limb or stick stiffens with deflection."
    machine_physics = "The spring stiffens with deflection."
    formula = "u + stiffness u^3, or u + stiffness u |u|, in place of u in the spring"
    tex = (
        r"u \to \begin{cases} u + \mathrm{stiffness}\; u^3 & \text{cubic} \\"
        r" u + \mathrm{stiffness}\; u\,|u| & \text{square} \end{cases}"
        r" \quad\text{in the spring}"
    )
    source = "Wigren and Schoukens (2013)"
    shades = True
    neutral = {"stiffness": 0.0}
    choices = {"form": ("cubic", "square")}
    citation = (
        "Wigren and Schoukens, Three free data sets for nonlinear system identification (2013)."
    )
    examples = (
        {"form": "cubic", "stiffness": 15.0},
        {"form": "square", "stiffness": 4.0},
    )
    hidden = examples[0]
    parameters = (
        Parameter(
            "stiffness",
            ONE / U**2,
            0.0,
            20.0,
            (0.02, 0.3),
            "stiffening of the spring",
            forms=("cubic",),
        ),
        Parameter(
            "stiffness",
            ONE / U,
            0.0,
            20.0,
            (0.02, 0.3),
            "stiffening of the spring",
            forms=("square",),
        ),
    )

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return NO_LIMB if core == CoreKind.CONTROLLER else None

    def apply(self, signal: Spring, record: Record, stiffness: float) -> Spring:
        return signal.stiffer(**{self.form or "cubic": stiffness})
