"""A gain, a delay or an offset that changes in time, or with a channel, along any smooth curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from ..runs.roles import OTHER
from .core_kind import CoreKind
from .dimension import ONE, Dimension, S, U
from .free_form import FreeForm
from .operator_signals import Gains
from .record import Record
from .smooth_curve import SLOPE
from .time_variation import needs_channel

Curve = Callable[[np.ndarray], np.ndarray]
TIME = "time"
N_IN_TIME = 21  # knots: four seconds of a run of 82 s, so that what swings in twelve is seen


class _Varying(FreeForm):
    """What curves over the time in the run, or over a channel, have in common."""

    channel: str | None
    what: ClassVar[str]
    by_channel: ClassVar[bool] = True

    @property
    def over(self) -> str:
        return self.channel or TIME

    @property
    def abscissa(self) -> Dimension:
        return S if self.channel is None else Dimension.of_channel(self.channel)

    @property
    def sentence(self) -> str:
        if self.channel is None:
            return f"it acts on {self.what}, as a function of time in the run"
        return f"it acts on {self.what}, as a function of {self.channel}"

    def alternatives(self, record: Record) -> list[Any]:
        """One over time, and one over each channel without a role."""
        if self.channel is not None or self.knots is not None or not self.by_channel:
            return [self]
        return [self, *(self.with_choices(channel=name) for name in record.with_role(OTHER))]

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.channel is None:
            return None
        return needs_channel(self.channel, record, OTHER, "channel to follow")

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None or self.channel is not None:
            return super().with_knots(record)
        seen = record.t[record.known.any(axis=1)]
        # From the start of the runs, which is not where the output begins to count.
        ends = np.linspace(float(record.t[0].min()), float(seen.max()), N_IN_TIME)
        return self.with_choices(knots=tuple(ends.tolist()))

    def watched(self, record: Record) -> np.ndarray:
        return record.channel(self.channel)[record.known]

    def along(self, record: Record, curve: Curve) -> np.ndarray:
        """The curve at each sample; where no data tell how it goes on with a channel, it holds."""
        assert self.knots is not None
        if self.channel is None:
            return curve(record.t)
        return curve(np.clip(record.channel(self.channel), self.knots[0], self.knots[-1]))


class FreeGain(_Varying):
    """Gains that change along any smooth curve, in time or with a channel.

    The gains on error and error rate are multiplied by max(1 + curve, 0); the curve has no level,
    which is the gain.

    Parameters
    ----------
    channel : str or None, default=None
        What the gains follow; None means the time in the run.
    of : {"both", "error", "rate"}, default="both"
        Which gains change.
    knots : tuple of float or None, default=None
        Where the curve is given, in seconds or in units of the channel; None means equal distances
        in time, or quantiles of the channel.
    values : tuple of float or None, default=None
        The curve at the knots; None estimates it.
    spread : float or None, default=None
        Size of the curve's smoothest part, that decides how smooth it is; None chooses it by
        likelihood.

    References
    ----------
    Wood, Generalized additive models (2017). Hastie and Tibshirani, Varying-coefficient models
    (1993).

    Examples
    --------
    >>> from skhoid.effects import FreeGain
    >>> FreeGain().over
    'time'
    """

    name = "free_gain"
    title = "free gain"
    place = "gain"
    physics = "The gains change along a curve of unknown shape."
    formula = "K (1 + curve(t))"
    tex = r"K(t) = K\,(1 + \mathrm{curve}(t))"
    source = "Hastie and Tibshirani (1993)"
    kept = (SLOPE,)
    what = "the gains"
    y_word = "factor on the gains"
    at_rest = 1.0
    least = 0.0

    def __init__(
        self,
        *,
        channel: str | None = None,
        of: str = "both",
        knots: tuple[float, ...] | None = None,
        values: tuple[float, ...] | None = None,
        spread: float | None = None,
    ):
        self.channel = channel
        self.of = of
        self.knots = knots
        self.values = values
        self.spread = spread

    @property
    def ordinate(self) -> Dimension:
        return ONE

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.of == "rate" and core == CoreKind.ARX:
            return "a linear model has no gain on the error rate of its own"
        return super().refusal(record, core)

    def shaped(self, signal: Gains, record: Record, curve: Curve) -> Gains:
        factor = np.maximum(1 + self.along(record, curve), 0.0)
        if self.of == "both":
            return signal.times(factor)
        return signal._replace(**{self.of: getattr(signal, self.of) * factor})


class FreeDelay(_Varying):
    """A delay that changes along any smooth curve, in time or with a channel.

    delay + curve in seconds, not below the least delay of the model; the curve has no level, which
    is the delay.

    Parameters
    ----------
    channel : str or None, default=None
        What the delay follows; None means the time in the run.
    knots : tuple of float or None, default=None
        Where the curve is given; see :class:`FreeGain`.
    values : tuple of float or None, default=None
        The curve at the knots, in seconds; None estimates it.
    spread : float or None, default=None
        Size of the curve's smoothest part in seconds; None chooses it by likelihood.

    References
    ----------
    Wood, Generalized additive models (2017).

    Examples
    --------
    >>> from skhoid.effects import FreeDelay
    >>> FreeDelay(channel="workload").over
    'workload'
    """

    name = "free_delay"
    title = "free delay"
    place = "delay"
    physics = "The delay changes along a curve of unknown shape."
    formula = "tau_e + curve(t)"
    tex = r"\tau(t) = \tau_e + \mathrm{curve}(t)"
    source = "Wood (2017)"
    kept = (SLOPE,)
    what = "the delay"
    y_word = "change"
    largest = 0.5
    usual = 0.05

    def __init__(
        self,
        *,
        channel: str | None = None,
        knots: tuple[float, ...] | None = None,
        values: tuple[float, ...] | None = None,
        spread: float | None = None,
    ):
        self.channel = channel
        self.knots = knots
        self.values = values
        self.spread = spread

    @property
    def ordinate(self) -> Dimension:
        return S

    def shaped(self, signal: Any, record: Record, curve: Curve) -> Any:
        return signal + self.along(record, curve)


class FreeOffset(_Varying):
    """An offset of the output that changes along any smooth curve in time, the same in each run.

    Parameters
    ----------
    knots : tuple of float or None, default=None
        Times in the run in seconds; None means equal distances.
    values : tuple of float or None, default=None
        The curve at the knots, in units of the output; None estimates it.
    spread : float or None, default=None
        Size of the curve's smoothest part, in units of the output; None chooses it by likelihood.

    References
    ----------
    Wood, Generalized additive models (2017).

    Examples
    --------
    >>> from skhoid.effects import FreeOffset
    >>> FreeOffset().place
    'sum'
    """

    name = "free_offset"
    title = "free offset"
    place = "sum"
    physics = "The output has an offset that changes along a curve of unknown shape."
    formula = "u + curve(t)"
    tex = r"u' = u + \mathrm{curve}(t)"
    source = "Wood (2017)"
    within = ("free_map",)  # whose curves have a level
    what = "the level of the output"
    y_word = "offset"
    channel = None
    by_channel = False

    @property
    def ordinate(self) -> Dimension:
        return U

    def shaped(self, signal: np.ndarray, record: Record, curve: Curve) -> np.ndarray:
        return signal + self.along(record, curve)
