"""Operators that change during a run: gains, drift, scheduling by a channel, lapses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import expit

from ..runs.roles import OTHER
from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, RAD, Dimension, E, S, T, U
from .offsets import with_middle
from .operator_signals import Gains
from .parameter import Parameter
from .record import Record, differentiated

EDGE_STEPS = (0.2, 0.1, 0.05, 0.02)  # s, of the ends of lapses


def sigmoid(record: Record, rate: float, time: float) -> np.ndarray:
    """The sigmoid of Eq. 2 over the time in the run, from 0 to 1."""
    return expit(rate * (record.t - time))


class TimeVaryingGain(Effect):
    """Gains on error and error rate change during the run, by a sigmoid or a ramp.

    K(t) = K [1 + change / (1 + exp(-rate (t - time)))], with separate changes of K_e and K_edot;
    large rates are steps. ``"ramp"`` changes linearly within 4 / rate seconds.

    Parameters
    ----------
    K_e_change, K_edot_change : float or None, default=None
        Relative change of the gains on error and error rate; None estimates it. An ARX model has
        the first only.
    rate : float or None, default=None
        Steepness G in 1/s; None estimates it.
    time : float or None, default=None
        Middle of the change t_M in seconds; None estimates it.
    omega_nm_change, zeta_nm_change : float or None, default=0.0
        Relative change of neuromuscular frequency and damping; None estimates it.
    form : {"sigmoid", "ramp"} or None, default="sigmoid"
        None tries both.

    References
    ----------
    Thesis, Eqs. 2, 3 and 5, and its reference [12], which has the same sigmoids.

    Examples
    --------
    >>> from skhoid.effects import TimeVaryingGain
    >>> [p.name for p in TimeVaryingGain().free]
    ['K_e_change', 'K_edot_change', 'rate', 'time']
    """

    name = "tv_gain"
    title = "time-varying gain"
    place = "gain"
    physics = "The operator adapts: gain and lead change during the run."
    machine_physics = "The gain changes during the run."
    formula = "K (1 + change / (1 + exp(-rate (t - time))))"
    tex = (
        r"K(t) = K \left(1 + \frac{\mathrm{change}}{1 + e^{-\mathrm{rate}\,(t -"
        r" \mathrm{time})}}\right)"
    )
    source = "Thesis, Eqs. 2, 3 and 5"
    neutral = {
        "K_e_change": 0.0,
        "K_edot_change": 0.0,
        "omega_nm_change": 0.0,
        "zeta_nm_change": 0.0,
    }
    choices = {"form": ("sigmoid", "ramp")}

    def __init__(
        self,
        *,
        K_e_change: float | None = None,
        K_edot_change: float | None = None,
        rate: float | None = None,
        time: float | None = None,
        omega_nm_change: float | None = 0.0,
        zeta_nm_change: float | None = 0.0,
        form: str | None = "sigmoid",
    ):
        self.K_e_change = K_e_change
        self.K_edot_change = K_edot_change
        self.rate = rate
        self.time = time
        self.omega_nm_change = omega_nm_change
        self.zeta_nm_change = zeta_nm_change
        self.form = form

    parameters = (
        Parameter("K_e_change", ONE, -0.98, 10.0, (0.0,), "relative change of K_e"),
        Parameter("K_edot_change", ONE, -0.98, 10.0, (0.0,), "relative change of K_edot"),
        Parameter("rate", ONE / S, 0.03, 100.0, (0.4, 2.0), "steepness G"),
        Parameter("time", S, 0.0, 1.0, (0.15, 0.32, 0.5, 0.68, 0.85), "middle t_M", T),
        Parameter("omega_nm_change", ONE, -0.8, 4.0, (0.0,), "relative change of omega_nm"),
        Parameter("zeta_nm_change", ONE, -0.8, 4.0, (0.0,), "relative change of zeta_nm"),
    )

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        if record.core == CoreKind.ARX and self.K_edot_change is None:
            return [variant.with_choices(K_edot_change=0.0) for variant in made]
        return made

    def derived(self, values: dict[str, float]) -> dict[str, tuple[float, Dimension, str]]:
        found = {}
        known = {"K_e": U / E, "K_edot": U * S / E, "omega_nm": RAD / S, "zeta_nm": ONE}
        for name, dimension in known.items():
            if name in values and getattr(self, f"{name}_change") is None:
                after = values[name] * (1 + values[f"{name}_change"])
                found[f"{name}_after"] = (after, dimension, f"{name} after the change")
        return found

    def apply(
        self,
        signal: Gains,
        record: Record,
        K_e_change: float,
        K_edot_change: float,
        rate: float,
        time: float,
        omega_nm_change: float,
        zeta_nm_change: float,
    ) -> Gains:
        if self.form == "ramp":
            share = np.clip(0.5 + rate / 4 * (record.t - time), 0.0, 1.0)
        else:
            share = sigmoid(record, rate, time)
        gains = signal._replace(
            error=signal.error * (1 + K_e_change * share),
            rate=signal.rate * (1 + K_edot_change * share),
        )
        if omega_nm_change or zeta_nm_change:
            of_time = share[:, :1]
            gains = gains._replace(
                omega=gains.omega * (1 + omega_nm_change * of_time),
                zeta=gains.zeta * (1 + zeta_nm_change * of_time),
            )
        return gains


class GainDrift(Effect):
    """Both gains drift during the run, steadily or on a curve: fatigue, or learning.

    ``"linear"``: K (1 + rate (t - reference)); ``"curved"``: K (1 + rate (1 - exp(-curve (t -
    reference))) / curve), which settles where ``curve`` is positive, and comes late where it is
    negative.

    Parameters
    ----------
    rate : float or None, default=None
        Relative change per second, at the reference; None estimates it.
    curve : float or None, default=None
        One over the time constant of ``"curved"``, in 1/s; None estimates it.
    reference : float or None, default=None
        Time in the run at which the gains are nominal, in seconds; None takes the middle.
    form : {"linear", "curved"} or None, default=None
        None tries both.

    References
    ----------
    Thesis, Section II: slow variation. Heathcote et al., The power law repealed: the case for an
    exponential law of practice (2000).

    Examples
    --------
    >>> from skhoid.effects import GainDrift
    >>> GainDrift().name
    'gain_drift'
    """

    name = "gain_drift"
    place = "gain"
    physics = "The operator's gain falls (fatigue) or grows through the run."
    machine_physics = "The gain falls or grows through the run, as with temperature or wear."
    formula = "K (1 + rate (t - reference)), or 1 - exp(-curve (t - reference)) over curve in place"
    tex = (
        r"K(t) = K\,(1 + \mathrm{rate}\; s), \quad s = \begin{cases}"
        r" t - \mathrm{reference} & \text{linear} \\"
        r" \bigl(1 - e^{-\mathrm{curve}\,(t - \mathrm{reference})}\bigr) / \mathrm{curve}"
        r" & \text{curved} \end{cases}"
    )
    source = "Thesis, Section II; Heathcote et al. (2000)"
    neutral = {"rate": 0.0}
    within = ("tv_gain",)  # whose slow sigmoid is a line, and whose end is a curve
    shades = True
    choices = {"form": ("linear", "curved")}

    def __init__(
        self,
        *,
        rate: float | None = None,
        curve: float | None = None,
        reference: float | None = None,
        form: str | None = None,
    ):
        self.rate = rate
        self.curve = curve
        self.reference = reference
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        starts = (0.4, -0.4)
        rate = Parameter("rate", ONE / S, -1.9, 1.9, starts, "relative change per second", ONE / T)
        if self.form != "curved":
            return (rate,)
        curves = (2.0, -2.0)
        return (rate, Parameter("curve", ONE / S, -8.0, 8.0, curves, "rate of settling", ONE / T))

    def variants(self, record: Record) -> list[Effect]:
        formed: list[Any] = super().variants(record)
        return [with_middle(variant, record) for variant in formed]

    def apply(self, signal: Gains, record: Record, rate: float, curve: float = 0.0) -> Gains:
        away = record.t - self.reference
        if curve != 0.0:
            away = -np.expm1(-curve * away) / curve
        return signal.times(np.maximum(1 + rate * away, 0.0))


class ScheduledGain(Effect):
    """Both gains follow a measured channel.

    Parameters
    ----------
    slope : float or None, default=None
        Relative change of the gains per unit of the channel; None estimates it.
    channel : str or None, default=None
        Its name; None tries each channel that has no role.
    reference : float or None, default=None
        Value of the channel at which the gains are nominal; None takes its mean.

    References
    ----------
    Gain scheduling; Toth, Modeling and identification of linear parameter-varying systems (2010).

    Examples
    --------
    >>> from skhoid.effects import ScheduledGain
    >>> ScheduledGain(channel="speed").name
    'scheduled_gain'
    """

    name = "scheduled_gain"
    place = "gain"
    physics = "The operator adapts the gain to a measured condition, such as speed."
    machine_physics = "The gain follows a measured condition, such as speed."
    formula = "K (1 + slope (channel - reference))"
    tex = r"K(t) = K\,\bigl(1 + \mathrm{slope}\,(\mathrm{channel}(t) - \mathrm{reference})\bigr)"
    source = "Toth (2010)"
    neutral = {"slope": 0.0}

    def __init__(
        self,
        *,
        slope: float | None = None,
        channel: str | None = None,
        reference: float | None = None,
    ):
        self.slope = slope
        self.channel = channel
        self.reference = reference

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        dimension = ONE / Dimension.of_channel(self.channel)
        return (Parameter("slope", dimension, -3.0, 3.0, (0.15, -0.15), "relative change"),)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return needs_channel(self.channel, record, OTHER, "channel without a role to follow")

    def variants(self, record: Record) -> list[Effect]:
        names = record.with_role(OTHER) if self.channel is None else [self.channel]
        made = []
        for name in names:
            reference = self.reference
            if reference is None:
                reference = float(record.channels[name][record.known].mean())
            made.append(self.with_choices(channel=name, reference=reference))
        return made

    def apply(self, signal: Gains, record: Record, slope: float) -> Gains:
        away = record.channel(self.channel) - self.reference
        return signal.times(np.maximum(1 + slope * away, 0.0))


class Lapses(Effect):
    """Lapses of attention: stretches of time, the same in each run, without a response.

    Parameters
    ----------
    depth : float or None, default=None
        Share of the command that is missing in a lapse; None estimates it.
    shift : float or None, default=None
        How much later than ``intervals`` the stretches are, in seconds; None estimates it.
    intervals : list of (float, float) or None, default=None
        Starts and ends, in seconds of time in the run; None finds them.
    form : {"command", "gain", "hold"} or None, default=None
        Whether the command goes to zero, the gains on error and error rate vanish (which kicks at
        the ends, d/dt (K_edot e)), or the command holds its value; None tries all.

    References
    ----------
    Hidden two-state process, Viterbi (1967).

    Examples
    --------
    >>> from skhoid.effects import Lapses
    >>> Lapses(intervals=[(10.0, 12.5)], shift=0.0).fixed
    {'shift': 0.0}
    """

    name = "lapses"
    title = "lapses of attention"
    place = "command"
    physics = "The operator looks away and does not respond for seconds."
    machine_physics = "The input is cut off for stretches of time."
    formula = "command (1 - depth) during lapses, or + depth times their first command"
    tex = r"c'(t) = (1 - \mathrm{depth})\,c(t) \quad\text{during the lapses}"
    source = "Viterbi (1967)"
    parameters = (
        Parameter("depth", ONE, 0.0, 1.0, (0.95,), "share of the command lost"),
        Parameter("shift", S, -0.8, 0.4, (-0.15,), "shift of the intervals"),
    )
    neutral = {"depth": 0.0}
    choices = {"form": ("command", "gain", "hold")}

    def __init__(
        self,
        *,
        depth: float | None = None,
        shift: float | None = None,
        intervals: Any = None,
        form: str | None = None,
    ):
        self.form = form
        self.depth = depth
        self.shift = shift
        self.intervals = intervals

    @property
    def n_hidden(self) -> int:  # type: ignore[override]
        """Ends of the intervals."""
        return 2 * len(self.intervals or ())

    def variants(self, record: Record) -> list[Effect]:
        found = silent_stretches(record) if self.intervals is None else self.intervals
        formed: list[Any] = super().variants(record)
        return [v.with_choices(intervals=found) for v in formed]

    def adjusted(self, error_of: Callable[[Effect], float], record: Record) -> Effect:
        """Each end of an interval moved where that is better."""
        edges, best = np.array(self.intervals, dtype=float), error_of(self)
        for size in EDGE_STEPS:
            for i in range(edges.size):
                for move in (size * record.time_unit, -size * record.time_unit):
                    while True:
                        trial = edges.copy()
                        trial.flat[i] += move
                        moved = self.with_choices(intervals=[tuple(e) for e in trial.tolist()])
                        error = error_of(moved) if (trial[:, 0] < trial[:, 1]).all() else np.inf
                        if not error < best:
                            break
                        edges, best = trial, error
        return self.with_choices(intervals=[tuple(e) for e in edges.round(4).tolist()])

    def apply(self, signal: Any, record: Record, depth: float, shift: float) -> Any:
        whole = signal.position + differentiated(signal.rate, record.dt)
        away, kept = np.zeros_like(record.t), np.zeros_like(whole)
        for begin, end in self.intervals:
            inside = (record.t - begin - shift) / record.dt + 0.5
            until = (end + shift - record.t) / record.dt + 0.5
            lapse = np.clip(np.minimum(inside, until), 0.0, 1.0)
            rows = np.flatnonzero(lapse.any(axis=1))
            if not rows.size:
                continue
            near = np.s_[rows[0] : rows[-1] + 1]
            if self.form == "hold":
                first = np.broadcast_to((inside >= 0.5).argmax(axis=0), whole.shape[1:])
                held = np.take_along_axis(whole, first[None], 0)
                kept[near] = np.where(lapse[near] > away[near], held, kept[near])
            away[near] = np.maximum(away[near], lapse[near])
        left = 1 - depth * away
        if self.form == "gain":
            return signal._replace(position=left * signal.position, rate=left * signal.rate)
        position = left * whole + (1 - left) * kept
        return signal._replace(position=position, rate=np.zeros_like(signal.rate))


def needs_channel(channel: str | None, record: Record, role: str, what: str) -> str | None:
    """Why a channel that an effect needs is not there."""
    if channel is not None and channel not in record.channels:
        return f"X has no channel {channel!r}"
    if channel is None and not record.with_role(role):
        return f"X has no {what}"
    return None


def silent_stretches(record: Record) -> list[tuple[float, float]]:
    """Stretches in which no run responds to the input, by Viterbi's algorithm."""
    if record.prediction is None or record.y is None:
        return []
    answer, y, known = record.prediction, record.y, record.known
    variance = float(np.median(((y - answer) ** 2)[known])) / 0.455 + 1e-12
    # Residuals hardly change over some tenths of a second: each sample counts for less.
    weight = record.dt / (0.15 * record.time_unit)
    against = np.where(known, (y - answer) ** 2 - y**2, 0.0) / (2 * variance) * weight
    log_ratio = np.clip(against, -5 * weight, 5 * weight).sum(axis=1)
    cost = 5.0  # of a change of state; the likelihood judges the stretches together later
    n = log_ratio.size
    score = np.array([0.0, -cost])
    came = np.zeros((n, 2), dtype=np.int8)
    for k in range(n):
        stay, go = score[1], score[0] - cost
        back = score[1] - cost
        came[k] = (1 if back > score[0] else 0, 1 if stay >= go else 0)
        score = np.array([max(score[0], back), max(stay, go) + log_ratio[k]])
    state = int(score[1] > score[0])
    states = np.zeros(n, dtype=bool)
    for k in range(n - 1, -1, -1):
        states[k] = state == 1
        state = int(came[k, state])
    edges = np.flatnonzero(np.diff(np.r_[False, states, False].astype(int)))
    t = record.t[:, 0]
    found = [
        (float(t[a]), float(t[min(b, n - 1)]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if (b - a) * record.dt >= 0.4 * record.time_unit
    ]
    return [] if sum(e - b for b, e in found) > 0.5 * record.duration else found
