"""Dynamics that follow a channel, and a filter before a static map: for machines."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, RAD, E, S
from .dynamics import bilinear
from .operator_signals import Gains
from .parameter import Parameter
from .record import Record
from .time_variation import ScheduledGain

SLOWEST, FASTEST = 0.05, 20.0  # times the frequency at the reference


class ScheduledDynamics(ScheduledGain):
    """Natural frequencies that follow a measured channel, with constant damping ratios.

    Poles exp(s dt) of A(q) become exp(factor s dt) with factor = 1 + slope (channel - reference);
    B(q) is scaled so that the static gain stays. A gain that follows the channel as well is
    :class:`ScheduledGain`.

    Parameters
    ----------
    slope : float or None, default=None
        Relative change of the frequencies per unit of the channel; None estimates it.
    channel : str or None, default=None
        Column to follow; None tries each that has no role.
    reference : float or None, default=None
        Value of the channel at which the dynamics are those of A(q); None takes its mean.

    References
    ----------
    Toth, Modeling and identification of linear parameter-varying systems (2010).

    Examples
    --------
    >>> from skhoid.effects import ScheduledDynamics
    >>> ScheduledDynamics(channel="angle").place
    'gain'
    """

    name = "scheduled_dynamics"
    place = "gain"
    physics = "The dynamics become faster or slower with a measured condition, such as position."
    machine_physics = physics
    formula = "omega (1 + slope (channel - reference)) in place of omega, for all poles"
    tex = (
        r"\omega(t) = \omega\,\bigl(1 + \mathrm{slope}\,(\mathrm{channel}(t) -"
        r" \mathrm{reference})\bigr)"
        r" \quad\text{of all poles}"
    )
    source = "Toth (2010)"
    domains = ("machine",)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core != CoreKind.ARX:
            return "for an ARX model: its poles follow the channel"
        return super().refusal(record, core)

    def apply(self, signal: Gains, record: Record, slope: float) -> Gains:
        away = record.channel(self.channel) - self.reference
        return signal._replace(omega=signal.omega * np.clip(1 + slope * away, SLOWEST, FASTEST))


class InputFilter(Effect):
    """A filter ahead of a static nonlinearity, which no filter after it can replace.

    w is the input filtered by 1 / (time s + 1) (``order="first"``) or omega^2 / (s^2 + 2 zeta omega
    s + omega^2) (``"second"``), and e' = map(w): ``"dead_zone"`` sign(w) max(abs(w) - width, 0);
    ``"clipped"`` min(max(w, -width (1 - skew)), width (1 + skew)); ``"cubic"`` w + hardening w^3;
    ``"square"`` w + hardening w abs(w).

    Parameters
    ----------
    time : float or None, default=None
        Time constant in seconds (``"first"``); None estimates it.
    omega : float or None, default=None
        Natural frequency in rad/s (``"second"``); None estimates it.
    zeta : float or None, default=None
        Damping ratio (``"second"``); None estimates it.
    width : float or None, default=None
        Threshold or limit of w in units of the input; None estimates it.
    skew : float or None, default=None
        Half the relative difference between the limits (``"clipped"``); None estimates it.
    hardening : float or None, default=None
        In the unit of the input to the power -2 (``"cubic"``) or -1; None estimates it.
    form : {"dead_zone", "clipped", "cubic", "square"} or None, default=None
        None tries all.
    order : {"first", "second"}, default="first"
        A search tries ``"first"``: the two poles of ``"second"`` make up for poles that a linear
        model lacks, whatever the map.

    References
    ----------
    Schoukens, Suykens and Ljung, Wiener-Hammerstein benchmark (2009).

    Examples
    --------
    >>> from skhoid.effects import InputFilter
    >>> InputFilter(form="dead_zone", order="first", time=0.1).fixed
    {'time': 0.1}
    """

    name = "input_filter"
    place = "input"
    physics = "The input passes through a filter before a threshold, a limit or a curve."
    formula = "e' = map(H(s) e), where the map is a dead zone, limits, a cube or a square"
    tex = (
        r"w = \frac{e}{\mathrm{time}\; s + 1}, \quad e' = \begin{cases}"
        r" \operatorname{sign}(w)\max(|w| - \mathrm{width},\, 0) & \text{dead\_zone} \\"
        r" \min(\max(w, -\mathrm{width}),\, \mathrm{width}) & \text{clipped} \\"
        r" w + \mathrm{hardening}\; w^3 & \text{cubic} \\"
        r" w + \mathrm{hardening}\; w\,|w| & \text{square} \end{cases}"
    )
    source = "Schoukens, Suykens and Ljung (2009)"
    domains = ("machine",)
    shades = True
    choices = {"form": ("dead_zone", "clipped", "cubic", "square")}

    def __init__(
        self,
        *,
        time: float | None = None,
        omega: float | None = None,
        zeta: float | None = None,
        width: float | None = None,
        skew: float | None = None,
        hardening: float | None = None,
        form: str | None = None,
        order: str = "first",
    ):
        self.time = time
        self.omega = omega
        self.zeta = zeta
        self.width = width
        self.skew = skew
        self.hardening = hardening
        self.form = form
        self.order = order

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        filtered: tuple[Parameter, ...] = (
            Parameter("time", S, 0.0, 20.0, (0.03, 0.3), "time constant of the filter"),
        )
        if self.order == "second":
            filtered = (
                Parameter("omega", RAD / S, 0.3, 200.0, (3.0, 15.0), "frequency of the filter"),
                Parameter("zeta", ONE, 0.02, 5.0, (0.7,), "damping ratio of the filter"),
            )
        growth = "increase of the gain with amplitude"
        if self.form == "cubic":
            return (*filtered, Parameter("hardening", ONE / E**2, -0.3, 20.0, (-0.02, 0.1), growth))
        if self.form == "square":
            return (*filtered, Parameter("hardening", ONE / E, -1.0, 20.0, (-0.1, 0.3), growth))
        if self.form == "clipped":
            width = Parameter("width", E, 0.02, 3.3, (0.7, 1.5), "limit after the filter")
            skew = Parameter("skew", ONE, -0.95, 0.95, (-0.3, 0.3), "asymmetry of the limits")
            return (*filtered, width, skew)
        width = Parameter("width", E, 0.0, 3.0, (0.25, 0.7), "threshold after the filter")
        return (*filtered, width)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core != CoreKind.ARX:
            return "for an ARX model: an operator has extra_lag and the maps of the error"
        return None

    def apply(
        self,
        signal: Any,
        record: Record,
        time: float = 0.0,
        omega: float = 1.0,
        zeta: float = 1.0,
        width: float = 0.0,
        skew: float = 0.0,
        hardening: float = 0.0,
    ) -> Any:
        if self.order == "second":
            poles = bilinear([0.0, 0.0, omega**2], [1.0, 2 * zeta * omega, omega**2], record.dt)
        else:
            poles = bilinear([0.0, 0.0, 1.0], [0.0, time, 1.0], record.dt)
        w = _kernels.greybox.filtered(_kernels.gate(signal), *poles)
        if self.form == "clipped":
            return np.clip(w, -width * (1 - skew), width * (1 + skew))
        if self.form in ("cubic", "square"):
            power = 2 if self.form == "cubic" else 1
            if hardening < 0.0:  # where it softens, it stays at its greatest
                greatest = (-1 / ((power + 1) * hardening)) ** (1 / power)
                w = np.clip(w, -greatest, greatest)
            return w * (1 + hardening * np.abs(w) ** power)
        return w - np.clip(w, -width, width)
