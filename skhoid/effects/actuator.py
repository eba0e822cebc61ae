"""Effects on the output: stops, rate limit, play, friction, quantisation, stiffening spring."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtr

from .. import _kernels
from .base import Effect
from .dimension import ONE, S, U
from .error_scan import ErrorScan
from .operator_signals import Spring
from .parameter import Parameter
from .record import Record
from .static_map import StaticMap, mean_within
from .traces import stop_of

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

    Parameters
    ----------
    limit : float or None, default=None
        In units of the output, or of the error; None estimates it.
    remnant : float or None, default=None
        Standard deviation of the remnant ahead of the stop (``"behind"``), in units of the output;
        None estimates it.
    skew : float or None, default=None
        Half the relative difference between the two stops (``"unequal"``); None estimates it.
    form : {"hard", "soft", "unequal", "behind"} or None, default=None
        None tries the first three, and ``"behind"`` where samples pile up at a stop.
    at : {"output", "command", "error"} or None, default=None
        What is limited: the output, the command to the limb, or the error, as by the edge of a
        screen. None means the output; a search tries all three, the other two as ``"hard"``.

    References
    ----------
    Gelb and Vander Velde, Multiple-input describing functions (1968).

    Examples
    --------
    >>> from skhoid.effects import Saturation
    >>> Saturation(limit=1.5).name
    'saturation'
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

    def __init__(
        self,
        *,
        limit: float | None = None,
        remnant: float | None = None,
        skew: float | None = None,
        form: str | None = None,
        at: str | None = None,
    ):
        self.limit = limit
        self.remnant = remnant
        self.skew = skew
        self.form = form
        self.at = at

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        limit = Parameter("limit", self.unit, 0.1, 4.0, (0.8, 1.6), "maximum deflection")
        if self.form == "unequal":
            skew = Parameter("skew", ONE, -0.95, 0.95, (-0.3, 0.3), "asymmetry of the stops")
            return (limit, skew)
        if self.form != "behind":
            return (limit,)
        return (
            limit,
            Parameter("remnant", self.unit, 0.01, 2.0, (0.3,), "remnant ahead of the stop"),
        )

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        # A stop after the remnant shows in the output itself.
        possible = self.form == "behind" or stop_of(record) is not None
        return [v for v in made if v.form != "behind" or possible]

    def mapped(
        self,
        signal: np.ndarray,
        record: Record,
        limit: float,
        remnant: float = 0.0,
        skew: float = 0.0,
    ) -> np.ndarray:
        if self.form == "soft":
            return limit * np.tanh(signal / limit)
        if self.form == "behind":
            return mean_within(signal, limit, remnant)
        return np.clip(signal, -limit * (1 - skew), limit * (1 + skew))


class RateLimit(Effect):
    """The rate of the output is limited.

    Parameters
    ----------
    limit : float or None, default=None
        Maximum rate, in units of the output per second; None estimates it.

    References
    ----------
    Rate-limited actuators: Duda, Flight control system analysis with rate limiters (1997).

    Examples
    --------
    >>> from skhoid.effects import RateLimit
    >>> RateLimit().place
    'output'
    """

    name = "rate_limit"
    place = "output"
    physics = "The hand or the actuator has a maximum speed."
    machine_physics = "The actuator has a maximum speed."
    formula = "|du'/dt| <= limit"
    tex = r"\left|\frac{\mathrm{d}u'}{\mathrm{d}t}\right| \le \mathrm{limit}"
    source = "Duda (1997)"
    kinks = True
    parameters = (Parameter("limit", U / S, 0.1, 30.0, (1.0, 2.0, 4.0), "maximum rate"),)

    def __init__(self, *, limit: float | None = None):
        self.limit = limit

    def apply(self, signal: np.ndarray, record: Record, limit: float) -> np.ndarray:
        return _kernels.greybox.rate_limited(_kernels.gate(signal), limit * record.dt)


class Backlash(Effect):
    """Play: the output trails the command by a gap, and stays put when the command reverses.

    Parameters
    ----------
    gap : float or None, default=None
        Half-width of the play in units of the output; None estimates it.

    References
    ----------
    Gelb and Vander Velde (1968).

    Examples
    --------
    >>> from skhoid.effects import Backlash
    >>> Backlash(gap=0.1).name
    'backlash'
    """

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

    def __init__(self, *, gap: float | None = None):
        self.gap = gap

    def apply(self, signal: np.ndarray, record: Record, gap: float) -> np.ndarray:
        return _kernels.greybox.stuck(_kernels.gate(signal), gap, gap, True)


class Stiction(Effect):
    """Dry friction: the output sticks until it breaks away, then trails the command.

    ``"slide"``: it keeps following until the command reverses; ``"jump"``: it sticks again at once.

    Parameters
    ----------
    breakaway : float or None, default=None
        Distance between command and output at which it breaks away, in units of the output; None
        estimates it.
    kinetic : float or None, default=None
        Distance kept while sliding (Coulomb friction), or left after a jump, as a fraction of
        ``breakaway``; None estimates it.
    form : {"slide", "jump"} or None, default=None
        None tries both.

    References
    ----------
    Armstrong-Helouvry et al., A survey of models for machines with friction (1994).

    Examples
    --------
    >>> from skhoid.effects import Stiction
    >>> Stiction(kinetic=0.0).fixed
    {'kinetic': 0.0}
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
    choices = {"form": ("slide", "jump")}

    def __init__(
        self,
        *,
        breakaway: float | None = None,
        kinetic: float | None = None,
        form: str | None = None,
    ):
        self.breakaway = breakaway
        self.kinetic = kinetic
        self.form = form

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
        slides = self.form != "jump"
        return _kernels.greybox.stuck(_kernels.gate(signal), breakaway, kinetic * breakaway, slides)


class Quantised(StaticMap):
    """The output, the command or the perceived error takes discrete levels.

    ``"sharp"``: u' = step round(u / step - offset); ``"behind"``: its mean over remnant that is
    quantised too, with standard deviation ``remnant``, u + steps that the remnant smooths;
    ``"uneven"`` has levels at step n^(1 / power), n = 0, 1, 2 ... to either side.

    Parameters
    ----------
    step : float or None, default=None
        Distance between levels, in units of the output or of the error; None estimates it.
    offset : float or None, default=None
        Shift of the thresholds, in steps; 0.5 rounds down. None estimates it.
    remnant : float or None, default=None
        Standard deviation of the remnant ahead of it (``"behind"``), in steps; None estimates it.
    power : float or None, default=None
        How levels crowd away from zero (above one) or towards it (``"uneven"``); None estimates it.
    form : {"sharp", "behind", "uneven"} or None, default=None
        None tries all, ``"uneven"`` at the output only.
    at : {"output", "command", "error"} or None, default=None
        What has levels: the output, the command to the limb, or the error, as on a coarse display.
        None means the output; a search tries all three.

    References
    ----------
    Widrow and Kollar, Quantization noise (2008); Gelb and Vander Velde (1968).

    Examples
    --------
    >>> from skhoid.effects import Quantised
    >>> Quantised(step=0.1).fixed
    {'step': 0.1}
    """

    name = "quantised"
    title = "quantisation"
    physics = "The output moves in steps: keys, detents, or a coarse converter."
    physics_at = {
        "command": "The command to the limb takes only a few values.",
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

    def __init__(
        self,
        *,
        step: float | None = None,
        offset: float | None = None,
        remnant: float | None = None,
        power: float | None = None,
        form: str | None = None,
        at: str | None = None,
    ):
        self.step = step
        self.offset = offset
        self.remnant = remnant
        self.power = power
        self.form = form
        self.at = at

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        steps = (0.5, 1.0, 2.0)
        offset = Parameter(
            "offset", ONE, -0.5, 0.5, (0.0, 0.5), "shift of the thresholds, in steps"
        )
        step = Parameter("step", self.unit, 0.05, 6.0, steps, "distance between levels")
        if self.form == "behind":
            remnant = Parameter(
                "remnant", ONE, 0.15, HIDDEN, (0.2,), "remnant ahead of the levels, in steps"
            )
            return (step, offset, remnant)
        if self.form == "uneven":
            return (
                step,
                Parameter("power", ONE, 0.5, 2.0, (0.8, 1.25), "crowding of uneven levels"),
            )
        return (step, offset)

    unseen_at = {"remnant": HIDDEN}  # which leaves an offset
    softness = 0.0  # of corners, in steps

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        return self.form == "behind" or self.softness > 0.0

    def softened(self, amount: float) -> Effect:
        soft = self.with_choices()
        soft.softness = amount
        return soft

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
        return _kernels.greybox.smooth_levels(_kernels.gate(signal), step, offset, *sines)

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

    Parameters
    ----------
    stiffness : float or None, default=None
        In units of the command per cubed (``"square"``: squared) unit of the output; None
        estimates it.
    form : {"cubic", "square"} or None, default=None
        None tries both.

    References
    ----------
    Wigren and Schoukens, Three free data sets for nonlinear system identification (2013).

    Examples
    --------
    >>> from skhoid.effects import HardeningStiffness
    >>> HardeningStiffness().place
    'spring'
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

    def __init__(self, *, stiffness: float | None = None, form: str | None = None):
        self.stiffness = stiffness
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        dimension = ONE / U if self.form == "square" else ONE / U**2
        return (
            Parameter("stiffness", dimension, 0.0, 20.0, (0.02, 0.3), "stiffening of the spring"),
        )

    def apply(self, signal: Spring, record: Record, stiffness: float) -> Spring:
        return signal.stiffer(**{self.form or "cubic": stiffness})
