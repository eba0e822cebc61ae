"""Effects on the delay: not the one assumed, or one that varies in time."""

from __future__ import annotations

from typing import Any

import numpy as np

from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, S, T
from .error_scan import ErrorScan
from .parameter import Parameter
from .record import Record
from .time_variation import sigmoid

SCANNED_DELAYS = 24


class WrongDelay(Effect):
    """The delay differs from the assumed one.

    Parameters
    ----------
    extra : float or None, default=None
        How much longer the delay is, in seconds; None estimates it.

    Notes
    -----
    It frees a delay that was given to the model (``OperatorRegressor(delay=0.28)``, or ``nk`` of an
    ARX model); a model that estimates its delay does not need it.

    References
    ----------
    Thesis, Section V: n_k fixed or estimated.

    Examples
    --------
    >>> from skhoid.effects import WrongDelay
    >>> WrongDelay().name
    'wrong_delay'
    """

    name = "wrong_delay"
    place = "delay"
    physics = "The response comes earlier or later than the model assumes."
    machine_physics = "The dead time is shorter or longer than the model assumes."
    formula = "e(t - delay - extra)"
    tex = r"e(t) \to e(t - \tau_e - \mathrm{extra})"
    source = "Thesis, Section V"
    parameters = (Parameter("extra", S, -0.4, 0.6, (-0.08, 0.08), "delay beyond the assumed one"),)
    neutral = {"extra": 0.0}

    def __init__(self, *, extra: float | None = None):
        self.extra = extra

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.OPERATOR_FREE_DELAY:
            return "the model already estimates its delay (delay=None)"
        return None

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        low, high = super().limits(record)["extra"]
        return {"extra": (max(low, -record.ahead), high)}

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Whole samples of an ARX model, whose input may be rough between them."""
        if record.core != CoreKind.ARX or self.extra is not None:
            return []
        low, high = (round(limit / record.dt) for limit in self.limits(record)["extra"])
        samples = np.unique(np.linspace(low, high, SCANNED_DELAYS).round())
        return [{"extra": float(n * record.dt)} for n in samples]

    def apply(self, signal: Any, record: Record, extra: float) -> Any:
        return signal + extra


class TimeVaryingDelay(Effect):
    """The delay changes during the run, by a sigmoid.

    Parameters
    ----------
    change : float or None, default=None
        In seconds; None estimates it.
    rate : float or None, default=None
        Steepness G of the sigmoid in 1/s; None estimates it.
    time : float or None, default=None
        Middle of the change, in seconds; None estimates it.

    References
    ----------
    Thesis, Eq. 2, for its sigmoid.

    Examples
    --------
    >>> from skhoid.effects import TimeVaryingDelay
    >>> TimeVaryingDelay(change=0.1).name
    'tv_delay'
    """

    name = "tv_delay"
    title = "time-varying delay"
    place = "delay"
    physics = "The operator becomes slower or faster to respond during the run."
    machine_physics = "The dead time changes during the run."
    formula = "tau_e + change / (1 + exp(-rate (t - time)))"
    tex = r"\tau(t) = \tau_e + \frac{\mathrm{change}}{1 + e^{-\mathrm{rate}\,(t - \mathrm{time})}}"
    source = "Thesis, Eq. 2"
    parameters = (
        Parameter("change", S, -0.5, 0.5, (0.05, -0.05), "change of the delay"),
        Parameter("rate", ONE / S, 0.05, 20.0, (0.5,), "steepness"),
        Parameter("time", S, 0.02, 0.98, (0.3, 0.7), "middle of the change", T),
    )
    neutral = {"change": 0.0}

    def __init__(
        self,
        *,
        change: float | None = None,
        rate: float | None = None,
        time: float | None = None,
    ):
        self.change = change
        self.rate = rate
        self.time = time

    def apply(self, signal: Any, record: Record, change: float, rate: float, time: float) -> Any:
        return signal + change * sigmoid(record, rate, time)
