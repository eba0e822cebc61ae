"""The stretch reflex: a delayed response to the rate of the input in one direction."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, RAD, E, S, U
from .dynamics import bilinear
from .error_scan import ErrorScan
from .parameter import Parameter
from .record import Record

DELAYS = np.linspace(0.015, 0.15, 28)  # s, scanned
FREQUENCIES = (15.0, 30.0, 60.0)  # rad/s, scanned
KEPT = 2
COARSEST = 0.05  # s of sampling time


class RateReflex(Effect):
    """A delayed path from the rate of the input, rectified: the stretch reflex of a joint.

    u' = u + sense gain H(s) p, where p is the rate de/dt(t - delay) while it is positive
    (``side="positive"``) or negative, else zero, and H(s) = omega^2 / (s^2 + 2 zeta omega s +
    omega^2). In addition to the intrinsic stiffness, which is linear and responds at once, a muscle
    responds to being stretched, not to being released, and like the stiffness it resists.

    Parameters
    ----------
    gain : float or None, default=None
        In units of the output times seconds per unit of the input, not negative; None estimates it.
    delay : float or None, default=None
        In seconds; None estimates it.
    omega : float or None, default=None
        Natural frequency of the path in rad/s; None estimates it.
    zeta : float or None, default=None
        Its damping ratio; None estimates it.
    side : {"positive", "negative"} or None, default=None
        Sign of the rates that get a response; None tries both.
    sense : {1, -1} or None, default=None
        Sign of the output that resists a positive input, by the recording's convention; None takes
        that of the covariance of output and input.

    References
    ----------
    Mirbagheri, Barbeau and Kearney, Intrinsic and reflex contributions to human ankle stiffness,
    Experimental Brain Research 135 (2000).

    Examples
    --------
    >>> from skhoid.effects import RateReflex
    >>> RateReflex(side="negative", delay=0.04).fixed
    {'delay': 0.04}
    """

    name = "rate_reflex"
    place = "sum"
    physics = "A delayed reflex responds to stretch, but not to release, in proportion to its rate."
    machine_physics = "A delayed response to the rate of the input, in one direction only."
    formula = "u +- gain H(s) max(+-de/dt(t - delay), 0)"
    tex = (
        r"u' = u \pm \mathrm{gain}\; H(s) \max(\pm \dot e(t - \mathrm{delay}),\, 0),"
        r" \quad H(s) = \frac{\omega^2}{s^2 + 2 \zeta \omega s + \omega^2}"
    )
    source = "Mirbagheri et al. (2000)"
    neutral = {"gain": 0.0}
    choices = {"side": ("positive", "negative")}
    parameters = (
        Parameter("gain", U * S / E, 0.0, 1e3, (0.03, 0.3), "gain on the rate"),
        Parameter("delay", S, 0.015, 0.3, (0.04,), "delay of the response", scale=ONE),
        Parameter("omega", RAD / S, 2.0, 200.0, (30.0,), "frequency of the path", scale=ONE),
        Parameter("zeta", ONE, 0.2, 5.0, (1.0,), "its damping ratio"),
    )

    def __init__(
        self,
        *,
        gain: float | None = None,
        delay: float | None = None,
        omega: float | None = None,
        zeta: float | None = None,
        side: str | None = None,
        sense: int | None = None,
    ):
        self.gain = gain
        self.delay = delay
        self.omega = omega
        self.zeta = zeta
        self.side = side
        self.sense = sense

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core != CoreKind.ARX:
            return "for an ARX model of a joint: position to torque"
        if record.dt > COARSEST:
            return f"sampled every {record.dt:g} s: a reflex of about 0.04 s does not show"
        return None

    def variants(self, record: Record) -> list[Effect]:
        made: list[Any] = super().variants(record)
        if self.sense is not None or record.y is None:
            return made
        x, y = record.input[record.known], record.y[record.known]
        sense = -1 if float(np.sum((x - x.mean()) * y)) < 0.0 else 1
        return [v.with_choices(sense=sense) for v in made]

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """Frequencies to a third of the sampling rate, where less is slow."""
        limits = super().limits(record)
        low, high = limits["omega"]
        return {**limits, "omega": (low, max(min(high, 2.0 / record.dt), 2 * low))}

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Delays and frequencies with the gain that explains most of what the model leaves."""
        left, known = error_of.residual, record.known
        fastest = self.limits(record)["omega"][1]
        delays = DELAYS if self.delay is None else (self.delay,)
        tried = []
        for omega in (w for w in FREQUENCIES if w < fastest):
            shaped = self._answer(record, 0.0, omega, 1.0)
            for delay in delays:
                answer = record.delayed(shaped, float(delay))[known]
                power = float(answer @ answer)
                product = float(answer @ left[known])
                if power > 0.0 and product > 0.0:
                    values = {"gain": product / power, "delay": float(delay)}
                    tried.append((-(product**2) / power, {**values, "omega": omega, "zeta": 1.0}))
        tried.sort(key=lambda one: one[0])
        return [values for _, values in tried[:KEPT]]

    def _answer(self, record: Record, delay: float, omega: float, zeta: float) -> np.ndarray:
        """What the path makes of the input with a gain of one."""
        rate = record.rate(record.inputs[0])
        one_way = np.minimum if self.side == "negative" else np.maximum
        seen = (self.sense or 1) * one_way(rate, 0.0)
        late = record.delayed(seen, delay)
        poles = [1.0, 2 * zeta * omega, omega**2]
        filtered = bilinear([0.0, 0.0, omega**2], poles, record.dt)
        return _kernels.greybox.filtered(_kernels.gate(late), *filtered)

    def apply(
        self,
        signal: np.ndarray,
        record: Record,
        gain: float,
        delay: float,
        omega: float,
        zeta: float,
    ) -> np.ndarray:
        return signal + gain * self._answer(record, delay, omega, zeta)
