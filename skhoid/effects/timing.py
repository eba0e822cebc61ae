"""Delays, and control that is not continuous."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect, Parameter
from .record import Record, differentiated
from .time_variation import sigmoid

HOLDS_CLOCK = tuple(np.arange(0.1, 0.9, 0.1).round(2).tolist())
SCANS = (10.0, 32.0, 100.0)  # s of the runs
COHERENT = 0.12  # ticks that a clock may be off at the end of a scan
KEPT_HOLDS = 6
SCANNED_DELAYS = 24
HOLDS_EVENT = (0.02, 0.1, 0.2, 0.3, 0.4)


class WrongDelay(Effect):
    """The delay is another than assumed.

    Parameters
    ----------
    extra : float or None, default=None
        What the delay is longer, in seconds; None estimates it.

    Notes
    -----
    It frees a delay that the model was given (``OperatorRegressor(delay=0.28)``, or ``nk`` of an
    ARX model); a model that estimates its delay needs it not.

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
    physics = "The answer comes earlier or later than the model assumes."
    formula = "e(t - delay - extra)"
    source = "Thesis, Section V"
    parameters = (Parameter("extra", "s", -0.4, 0.6, (-0.08, 0.08), "", "longer than assumed"),)

    def __init__(self, *, extra: float | None = None):
        self.extra = extra

    @property
    def neutral(self) -> dict[str, float]:
        return {"extra": 0.0}

    def refusal(self, record: Record, core: str) -> str | None:
        if core == "operator, free delay":
            return "the model estimates its delay already (delay=None)"
        return None

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        low, high = super().limits(record)["extra"]
        return {"extra": (max(low, -record.ahead), high)}

    def scanned(self, error_of: Callable[..., float], record: Record) -> list[dict[str, float]]:
        """Whole samples of an ARX model, whose input may be rough between them."""
        if record.core != "arx" or self.extra is not None:
            return []
        low, high = (round(limit / record.dt) for limit in self.limits(record)["extra"])
        samples = np.unique(np.linspace(low, high, SCANNED_DELAYS).round())
        return [{"extra": float(n * record.dt)} for n in samples]

    def apply(self, signal: Any, record: Record, extra: float) -> Any:
        return signal + extra


class TimeVaryingDelay(Effect):
    """The delay changes in the run, by a sigmoid.

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
    Thesis, Eq. 28, for its sigmoid.

    Examples
    --------
    >>> from skhoid.effects import TimeVaryingDelay
    >>> TimeVaryingDelay(change=0.1).name
    'tv_delay'
    """

    name = "tv_delay"
    place = "delay"
    physics = "The operator becomes slower, or faster, to answer in the run."
    formula = "tau_e + change / (1 + exp(-rate (t - time)))"
    source = "Thesis, Eq. 28"
    parameters = (
        Parameter("change", "s", -0.5, 0.5, (0.05, -0.05), "", "of the delay"),
        Parameter("rate", "1/s", 0.05, 20.0, (0.5,), "", "steepness"),
        Parameter("time", "s", 0.02, 0.98, (0.3, 0.7), "T", "middle of the change"),
    )

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

    @property
    def neutral(self) -> dict[str, float]:
        return {"change": 0.0}

    def apply(self, signal: Any, record: Record, change: float, rate: float, time: float) -> Any:
        return signal + change * sigmoid(record, rate, time)


class Intermittent(Effect):
    """Sampled control: the command is held between decisions.

    Parameters
    ----------
    hold_time : float or None, default=None
        Time between decisions (at least), in seconds; None estimates it.
    threshold : float or None, default=None
        Change that makes a decision, in units of the output (``"event"``) or the error
        (``"error"``); None estimates it.
    phase : float or None, default=None
        First tick of the clock after the start of a run, in seconds; None estimates it.
    trigger : {"clock", "event", "error"} or None, default=None
        What makes a decision: time alone, a change of the command, or of the error. None tries all.

    References
    ----------
    Gawthrop et al., Intermittent control: a computational theory of human control (2011).

    Examples
    --------
    >>> from skhoid.effects import Intermittent
    >>> Intermittent(trigger="clock", hold_time=0.4).place
    'command'
    """

    name = "intermittent"
    place = "command"
    physics = "The operator decides at instants, and holds the command between."
    formula = "command(t_i) for t_i <= t < t_(i+1)"
    source = "Gawthrop et al. (2011)"
    smooth = False

    def __init__(
        self,
        *,
        hold_time: float | None = None,
        threshold: float | None = None,
        phase: float | None = None,
        trigger: str | None = None,
    ):
        self.hold_time = hold_time
        self.threshold = threshold
        self.phase = phase
        self.trigger = trigger

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.trigger in ("event", "error"):
            unit = "e" if self.trigger == "error" else "u"
            thresholds = tuple(np.geomspace(0.05, 1.2, 9).tolist())
            return (
                Parameter("hold_time", "s", 0.0, 1.2, HOLDS_EVENT, "", "refractory time"),
                Parameter("threshold", f"{{{unit}}}", 0.01, 4.0, thresholds, unit, "that triggers"),
            )
        return (
            Parameter("hold_time", "s", 0.04, 1.2, HOLDS_CLOCK, "", "between decisions"),
            Parameter("phase", "s", 0.0, 1.2, (0.0,), "", "of the first decision"),
        )

    def variants(self, record: Record) -> list[Effect]:
        return self.one_of_each("trigger", ("clock", "event", "error"))

    def starts(self, record: Record) -> list[dict[str, float]]:
        """A grid, on which the delay is shorter by what the hold delays on average."""
        found = []
        for values in super().starts(record):
            hold = values.get("hold_time", self.hold_time or 0.0)
            found.append({**values, "+tau_e": -hold / 2})
        return found

    def scanned(self, error_of: Callable[..., float], record: Record) -> list[dict[str, float]]:
        """Times between ticks, ever finer: over a run they must be right to a share of a tick."""
        if self.trigger != "clock" or self.hold_time is not None:
            return []
        unit = record.time_unit
        duration = record.duration / unit
        # Of a fast system the settling can be longer than a scan.
        settled = record.dt * int(record.known.any(axis=1).argmax())
        begin = settled if record.core == "arx" else 0.0
        holds = [0.15]
        while holds[-1] < 0.9:
            holds.append(holds[-1] + COHERENT * holds[-1] ** 2 / SCANS[0])
        for i, seconds in enumerate(SCANS):
            errors = [error_of(self._ticking(h * unit), begin + seconds * unit) for h in holds]
            best = [holds[j] for j in np.argsort(errors)[: KEPT_HOLDS >> i]]
            if seconds >= duration:
                break
            finer = COHERENT / min(SCANS[i + 1], duration) if i + 1 < len(SCANS) else 0.0
            holds = [h + k * finer * h**2 for h in best for k in range(-4, 5)]
        return [self._ticking(hold * unit) for hold in best[:2]]

    def _ticking(self, hold: float) -> dict[str, float]:
        return {"hold_time": hold, "phase": self.phase or 0.0, "+tau_e": -hold / 2}

    def apply(
        self,
        signal: Any,
        record: Record,
        hold_time: float,
        threshold: float = 0.0,
        phase: float = 0.0,
    ) -> Any:
        dt = record.dt
        whole = _kernels.gate(signal.position + differentiated(signal.rate, dt))
        watched = _kernels.gate(signal.error) if self.trigger == "error" else whole
        if self.trigger == "clock":
            threshold = 0.0
        period = max(hold_time / dt, 1.0)
        kept = _kernels.greybox.held(whole, watched, period, threshold, phase / dt)
        return signal._replace(position=kept, rate=np.zeros_like(kept))
