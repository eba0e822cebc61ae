"""Responses of any smooth memory: to a channel, or to the error beyond the model's own dynamics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import fftconvolve

from ..runs.roles import OTHER
from .base import Effect
from .core_kind import CoreKind
from .dimension import Dimension, E, S, U
from .free_form import N_KNOTS, FreeForm
from .operator_signals import Command
from .record import Record
from .time_variation import needs_channel

Curve = Callable[[np.ndarray], np.ndarray]
LONGEST = 1.5  # s, of a person's memory of what a channel did
SEEN_AHEAD = 1.0  # s, of a target that may have been shown in advance
SHAKEN = 0.5  # s, of a body's and a stick's memory of what shakes them
OF_TARGET = 0.02  # share of a channel by the target, above which the loop moves it
LAGS_OF_TARGET = 16
STRETCHES = 8  # of a run; every other one tells the rest, as the operator may change on the way
FROM_OUTSIDE = ("f_t", "dist")  # roles of channels that the loop does not move


class _Remembering(FreeForm):
    """What responses by a smooth impulse response have in common: the curve over the lag."""

    over = "lag"
    abscissa = S
    shrinks = True
    y_word = "impulse response"

    def first_lag(self, record: Record) -> float:
        """Of the impulse response, in seconds."""
        raise NotImplementedError

    @property
    def longest(self) -> float:
        """Of the impulse response, beyond its first lag; in units of the record's time."""
        return LONGEST

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None:
            return self
        first = self.first_lag(record)
        ends = np.linspace(first, first + self.longest * record.time_unit, N_KNOTS)
        return self.with_choices(knots=tuple(ends.tolist()))


def convolved(signal: np.ndarray, curve: Curve, knots: tuple[float, ...], dt: float) -> np.ndarray:
    """Sum over lags between the outermost knots of curve(lag) signal(t - lag) dt.

    Before the first sample and after the last the signal holds.
    """
    first, last = round(knots[0] / dt), round(knots[-1] / dt)
    weights = curve(np.arange(first, last + 1) * dt) * dt
    weights[[0, -1]] /= 2
    n, before, after = signal.shape[0], max(last, 0), max(-first, 0)
    held = np.pad(signal, ((before, after), (0, 0)), mode="edge")
    whole = fftconvolve(held, weights[:, None], axes=0)
    return np.asarray(whole[before - first : before - first + n])


class FreePath(_Remembering):
    """A response to a channel with any smooth impulse response.

    command + integral of curve(lag) (channel(t - lag) - reference). To what the loop moves, a
    person responds after the least delay of the model; of a target alone, the future is tried too
    (``ahead``). Motion that the loop does not move may shake body and stick: then it adds to the
    output itself, and without a delay (``at``).

    Parameters
    ----------
    channel : str or None, default=None
        What is responded to; None tries every channel but the input.
    ahead : float, default=0.0
        How far the response looks ahead, in seconds, where the target was shown in advance.
    at : {"command", "output"} or None, default=None
        What it adds to: the command to the limb, or the output, without a delay. None means the
        command; a search tries the output for motion that does not follow the target.
    knots : tuple of float or None, default=None
        Lags in seconds; None means equal distances over 1.5 s (for a machine, its own time), or
        over 0.5 s at the output.
    values : tuple of float or None, default=None
        The impulse response at the knots, in units of the output per unit of the channel and
        second; None estimates it.
    spread : float or None, default=None
        Usual size of the impulse response; None chooses it by likelihood.
    reference : float or None, default=None
        Level of the channel that is not responded to, which is an offset; None takes its mean.

    References
    ----------
    Pillonetto et al., Kernel methods in system identification (2014). Marmarelis, Nonlinear dynamic
    modeling of physiological systems (2004).

    Examples
    --------
    >>> from skhoid.effects import FreePath
    >>> FreePath(channel="e_y").sentence
    'the output also responds to e_y, as a function of how long ago it was'
    """

    name = "free_path"
    title = "free response"
    physics = "A channel moves the output, by an impulse response of unknown shape."
    formula = "command + sum over lags of curve(lag) (channel(t - lag) - reference)"
    tex = (
        r"c' = c + \int \mathrm{curve}(\sigma)\,"
        r" (\mathrm{channel}(t - \sigma) - \mathrm{reference})\, d\sigma"
    )
    source = "Pillonetto et al. (2014)"

    def __init__(
        self,
        *,
        channel: str | None = None,
        ahead: float = 0.0,
        at: str | None = None,
        knots: tuple[float, ...] | None = None,
        values: tuple[float, ...] | None = None,
        spread: float | None = None,
        reference: float | None = None,
    ):
        self.channel = channel
        self.ahead = ahead
        self.at = at
        self.knots = knots
        self.values = values
        self.spread = spread
        self.reference = reference

    @property
    def place(self) -> str:  # type: ignore[override]
        return "sum" if self.at == "output" else "path"

    @property
    def longest(self) -> float:
        return SHAKEN if self.at == "output" else LONGEST

    @property
    def ordinate(self) -> Dimension:
        return U / Dimension.of_channel(self.channel) / S

    @property
    def sentence(self) -> str:
        if self.at == "output":
            return f"{self.channel} shakes the output without a delay"
        return f"the output also responds to {self.channel}, as a function of how long ago it was"

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.channel is None and len(record.channels) > len(record.inputs):
            return None
        return needs_channel(self.channel, record, OTHER, "channel besides the input")

    def alternatives(self, record: Record) -> list[Any]:
        """One for each channel that is no input; one ahead for a target, one at once for motion."""
        if self.channel is not None:
            return [self]
        made = []
        for name in record.channels:
            if name not in record.inputs:
                made.append(self.with_choices(channel=name))
                if record.roles.get(name) == "f_t":
                    made.append(self.with_choices(channel=name, ahead=SEEN_AHEAD))
                if shakes(name, record):
                    made.append(self.with_choices(channel=name, at="output"))
        return made

    def variants(self, record: Record) -> list[Effect]:
        return [one.with_knots(record) for one in self.alternatives(record)]

    def with_knots(self, record: Record) -> Any:
        known = super().with_knots(record)
        if self.reference is not None:
            return known
        return known.with_choices(
            reference=float(record.channel(self.channel)[record.known].mean())
        )

    def first_lag(self, record: Record) -> float:
        if self.at == "output":
            return 0.0
        role = record.roles.get(self.channel or "", "")
        outside = role.startswith(FROM_OUTSIDE)
        return -self.ahead if outside else record.least_delay

    def shaped(self, signal: Any, record: Record, curve: Curve) -> Any:
        assert self.knots is not None
        away = record.channel(self.channel) - (self.reference or 0.0)
        more = convolved(away, curve, self.knots, record.dt)
        return signal + more if self.at == "output" else signal.plus(more)


def shakes(name: str, record: Record) -> bool:
    """Whether a channel is motion that the loop does not move, so that it may act at once.

    What the output moves carries what moves the output: the target. Without a target that is not
    known, and motion that follows from the output could return it.
    """
    if not record.roles.get(name, "").startswith("motion"):
        return False
    return record.once(("shakes", name), lambda: not _follows_target(name, record))


def _follows_target(name: str, record: Record) -> bool:
    """Whether answers to the target explain part of a channel in stretches of runs left out."""
    targets = record.with_role("f_t")
    if not targets:
        return True
    target, rows = record.channel(targets[0]), record.known
    lags = record.time_unit * np.linspace(0.0, 2 * LONGEST, LAGS_OF_TARGET)
    columns = np.stack([record.delayed(target, lag)[rows] for lag in lags])
    columns = np.concatenate([columns, np.ones((1, columns.shape[1]))])
    moved = record.channel(name)[rows]
    stretch = np.arange(len(rows)) * STRETCHES // len(rows)
    odd = np.broadcast_to(stretch[:, None] % 2 == 1, rows.shape)[rows]
    left = 0.0
    for test in (odd, ~odd):
        fitted = np.linalg.lstsq(columns[:, ~test].T, moved[~test], rcond=None)[0]
        left += float(np.sum((moved[test] - fitted @ columns[:, test]) ** 2))
    return left < (1 - OF_TARGET) * float(np.sum((moved - moved.mean()) ** 2))


class FreeDynamics(_Remembering):
    """Linear dynamics beyond the order of the model: any smooth memory of the delayed error.

    command + integral of curve(lag) e(t - delay - lag).

    Parameters
    ----------
    knots : tuple of float or None, default=None
        Lags in seconds; None means equal distances over 1.5 s (for a machine, its own time).
    values : tuple of float or None, default=None
        The impulse response at the knots, in units of the output per unit of the error and second;
        None estimates it.
    spread : float or None, default=None
        Usual size of the impulse response; None chooses it by likelihood.

    References
    ----------
    Pillonetto et al., Kernel methods in system identification (2014).

    Examples
    --------
    >>> from skhoid.effects import FreeDynamics
    >>> FreeDynamics().over
    'lag'
    """

    name = "free_dynamics"
    title = "free dynamics"
    place = "path"
    physics = "The linear response to the error has a memory of unknown shape."
    formula = "command + sum over lags of curve(lag) e(t - delay - lag)"
    tex = r"c' = c + \int \mathrm{curve}(\sigma)\, e(t - \tau_e - \sigma)\, d\sigma"
    source = "Pillonetto et al. (2014)"

    @property
    def ordinate(self) -> Dimension:
        return U / E / S

    @property
    def sentence(self) -> str:
        return "the linear response to the error differs, as a function of how long ago it was"

    def first_lag(self, record: Record) -> float:
        return 0.0

    def shaped(self, signal: Command, record: Record, curve: Curve) -> Command:
        assert self.knots is not None
        return signal.plus(convolved(signal.error, curve, self.knots, record.dt))
