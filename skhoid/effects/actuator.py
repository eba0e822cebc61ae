"""What hand and stick do to the output."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect, Parameter
from .record import Record


class Saturation(Effect):
    """Stops: the output stays within limits.

    ``"hard"``: min(max(u, -limit), limit); ``"soft"``: limit tanh(u / limit).

    Parameters
    ----------
    limit : float or None, default=None
        In units of the output; None estimates it.
    form : {"hard", "soft"} or None, default=None
        None tries both.

    References
    ----------
    Stick stops; Gelb and Vander Velde, Multiple-input describing functions (1968).

    Examples
    --------
    >>> from skhoid.effects import Saturation
    >>> Saturation(limit=1.5).name
    'saturation'
    """

    name = "saturation"
    place = "output"
    physics = "The stick reaches its stop, or the hand its greatest deflection."
    formula = "u' = min(max(u, -limit), limit), or limit tanh(u / limit)"
    source = "Gelb and Vander Velde (1968)"
    parameters = (Parameter("limit", "{u}", 0.1, 4.0, (0.8, 1.6), "u", "greatest deflection"),)

    def __init__(self, *, limit: float | None = None, form: str | None = None):
        self.limit = limit
        self.form = form

    def variants(self, record: Record) -> list[Effect]:
        forms = ("hard", "soft") if self.form is None else (self.form,)
        return [self.with_choices(form=form) for form in forms]

    def apply(self, signal: np.ndarray, record: Record, limit: float) -> np.ndarray:
        if self.form == "soft":
            return limit * np.tanh(signal / limit)
        return np.clip(signal, -limit, limit)


class RateLimit(Effect):
    """The output moves at a limited rate.

    Parameters
    ----------
    limit : float or None, default=None
        Greatest rate in units of the output per second; None estimates it.

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
    physics = "Hand or actuator cannot move faster."
    formula = "|du'/dt| <= limit"
    source = "Duda (1997)"
    parameters = (Parameter("limit", "{u}/s", 0.1, 30.0, (1.0, 2.0, 4.0), "u", "greatest rate"),)

    def __init__(self, *, limit: float | None = None):
        self.limit = limit

    def apply(self, signal: np.ndarray, record: Record, limit: float) -> np.ndarray:
        return _kernels.greybox.rate_limited(_kernels.gate(signal), limit * record.dt)


class Backlash(Effect):
    """Play: the output follows at a distance and stays when the command turns.

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
    formula = "u' stays while |u - u'| < gap, and follows at that distance"
    source = "Gelb and Vander Velde (1968)"
    parameters = (Parameter("gap", "{u}", 0.01, 2.0, (0.1, 0.3), "u", "half-width of the play"),)

    def __init__(self, *, gap: float | None = None):
        self.gap = gap

    @property
    def neutral(self) -> dict[str, float]:
        return {"gap": 0.0}

    def apply(self, signal: np.ndarray, record: Record, gap: float) -> np.ndarray:
        return _kernels.greybox.stuck(_kernels.gate(signal), gap, gap)


class Stiction(Effect):
    """Dry friction: the output sticks until it breaks away, then slides behind the command.

    Parameters
    ----------
    breakaway : float or None, default=None
        Distance of command and output at which it breaks away, in units of the output; None
        estimates it.
    kinetic : float or None, default=None
        Distance kept while it slides (Coulomb friction), as a share of ``breakaway``; None
        estimates it.

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
    physics = "The stick sticks, breaks away and slides."
    formula = "u' stays while |u - u'| < breakaway, then follows kinetic * breakaway behind"
    source = "Armstrong-Helouvry et al. (1994)"
    parameters = (
        Parameter("breakaway", "{u}", 0.01, 2.0, (0.1, 0.2, 0.4, 0.7), "u", "static friction"),
        Parameter("kinetic", "-", 0.0, 0.95, (0.2, 0.6), "", "kinetic by static friction"),
    )
    smooth = False

    def __init__(self, *, breakaway: float | None = None, kinetic: float | None = None):
        self.breakaway = breakaway
        self.kinetic = kinetic

    def apply(
        self, signal: np.ndarray, record: Record, breakaway: float, kinetic: float
    ) -> np.ndarray:
        return _kernels.greybox.stuck(_kernels.gate(signal), breakaway, kinetic * breakaway)


class Quantised(Effect):
    """The output takes discrete levels.

    Parameters
    ----------
    step : float or None, default=None
        Distance of levels in units of the output; None estimates it.

    References
    ----------
    Gelb and Vander Velde (1968).

    Examples
    --------
    >>> from skhoid.effects import Quantised
    >>> Quantised().smooth
    False
    """

    name = "quantised"
    place = "output"
    physics = "The output moves in steps: keys, detents, or a coarse converter."
    formula = "u' = step round(u / step)"
    source = "Gelb and Vander Velde (1968)"
    parameters = (
        Parameter(
            "step", "{u}", 0.05, 4.0, tuple(np.geomspace(0.3, 2.5, 9).tolist()), "u", "of levels"
        ),
    )
    smooth = False

    def __init__(self, *, step: float | None = None):
        self.step = step

    def apply(self, signal: np.ndarray, record: Record, step: float) -> np.ndarray:
        return step * np.round(signal / step)


class HardeningStiffness(Effect):
    """A spring that stiffens with deflection: stiffness u^3 acts against the command.

    With an operator the neuromuscular spring, omega_nm^2 (u + stiffness u^3); with an ARX model
    A(q) u = B(q) (x - stiffness u^3), which is the Duffing oscillator.

    Parameters
    ----------
    stiffness : float or None, default=None
        In units of the command per cubed unit of the output; None estimates it.

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
    physics = "The spring of limb or stick stiffens with deflection."
    formula = "u + stiffness u^3 in place of u in the spring"
    source = "Wigren and Schoukens (2013)"
    parameters = (
        Parameter("stiffness", "1/{u}^2", 0.0, 20.0, (0.02, 0.3), "1/u*u", "of the cubic spring"),
    )

    def __init__(self, *, stiffness: float | None = None):
        self.stiffness = stiffness

    @property
    def neutral(self) -> dict[str, float]:
        return {"stiffness": 0.0}

    def apply(self, signal: Any, record: Record, stiffness: float) -> Any:
        return signal + stiffness
