"""Additional linear dynamics: lag, lead, second neuromuscular mode, higher order."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, RAD, S
from .parameter import Parameter
from .record import Record, differentiated


class ExtraLag(Effect):
    """Equalisation lag: 1 / (time s + 1).

    Parameters
    ----------
    time : float or None, default=None
        T_I in seconds; None estimates it.

    References
    ----------
    McRuer and Krendel (1974), the precision model.

    Examples
    --------
    >>> from skhoid.effects import ExtraLag
    >>> ExtraLag(time=0.2).name
    'extra_lag'
    """

    name = "extra_lag"
    place = "command"
    physics = "The operator low-pass filters what is seen."
    machine_physics = "The input passes through an additional lag."
    formula = "1 / (time s + 1)"
    tex = r"H(s) = \frac{1}{\mathrm{time}\; s + 1}"
    source = "McRuer and Krendel (1974)"
    parameters = (Parameter("time", S, 0.0, 20.0, (0.1, 1.0), "lag time constant T_I"),)
    neutral = {"time": 0.0}
    within = ("higher_order",)  # with a zero and a pole that cancel

    def __init__(self, *, time: float | None = None):
        self.time = time

    def apply(self, signal: Any, record: Record, time: float) -> Any:
        return shaped(signal, record, [0.0, 0.0, 1.0], [0.0, time, 1.0])


class ExtraLead(Effect):
    """A second lead: time s + 1.

    Parameters
    ----------
    time : float or None, default=None
        In seconds; None estimates it.

    References
    ----------
    McRuer and Krendel (1974).

    Examples
    --------
    >>> from skhoid.effects import ExtraLead
    >>> ExtraLead().place
    'command'
    """

    name = "extra_lead"
    place = "command"
    physics = "The operator also responds to the acceleration of the error."
    machine_physics = "The input passes through an additional lead."
    formula = "time s + 1"
    tex = r"H(s) = \mathrm{time}\; s + 1"
    source = "McRuer and Krendel (1974)"
    parameters = (Parameter("time", S, 0.0, 2.0, (0.05, 0.3), "time constant of the second lead"),)
    neutral = {"time": 0.0}
    within = ("higher_order",)  # whose other zero and poles are fast

    def __init__(self, *, time: float | None = None):
        self.time = time

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return "an ARX model has its own zeros: raise nb" if core == CoreKind.ARX else None

    def apply(self, signal: Any, record: Record, time: float) -> Any:
        faster = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(rate=signal.rate + time * faster)


class NeuromuscularMode(Effect):
    """A second mode of limb and stick, behind the neuromuscular system.

    omega^2 / (s^2 + 2 zeta omega s + omega^2).

    Parameters
    ----------
    omega : float or None, default=None
        In rad/s; None estimates it.
    zeta : float or None, default=None
        Damping ratio; None estimates it.

    References
    ----------
    Magdaleno and McRuer, Experimental validation of neuromuscular models (1971).

    Examples
    --------
    >>> from skhoid.effects import NeuromuscularMode
    >>> NeuromuscularMode(zeta=0.3).fixed
    {'zeta': 0.3}
    """

    name = "nm_mode"
    title = "second neuromuscular mode"
    place = "command"
    physics = "The limb and the stick together have a second mode."
    machine_physics = "There is a second mode."
    formula = "omega^2 / (s^2 + 2 zeta omega s + omega^2)"
    tex = r"H(s) = \frac{\omega^2}{s^2 + 2 \zeta \omega s + \omega^2}"
    source = "Magdaleno and McRuer (1971)"
    parameters = (
        Parameter("omega", RAD / S, 4.0, 60.0, (15.0, 25.0), "frequency of the mode"),
        Parameter("zeta", ONE, 0.03, 2.0, (0.3,), "its damping ratio"),
    )
    within = ("higher_order",)  # whose zeros are fast

    def __init__(self, *, omega: float | None = None, zeta: float | None = None):
        self.omega = omega
        self.zeta = zeta

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX:
            return "an ARX model has no neuromuscular system; higher_order adds poles and zeros"
        return None

    def apply(self, signal: Any, record: Record, omega: float, zeta: float) -> Any:
        poles = [1.0, 2 * zeta * omega, omega**2]
        return shaped(signal, record, [0.0, 0.0, omega**2], poles)


class HigherOrder(Effect):
    """Two more poles and zeros, with gain 1 at low frequency.

    Parameters
    ----------
    zero_frequency, zero_damping, pole_frequency, pole_damping : float or None, default=None
        Frequencies in rad/s and damping ratios; None estimates one.

    References
    ----------
    Ljung (1999), order selection.

    Examples
    --------
    >>> from skhoid.effects import HigherOrder
    >>> len(HigherOrder().free)
    4
    """

    name = "higher_order"
    title = "higher-order dynamics"
    place = "command"
    physics = "The linear dynamics are of higher order."
    formula = "(s^2/w_z^2 + 2 z_z s/w_z + 1) / (s^2/w_p^2 + 2 z_p s/w_p + 1)"
    tex = (
        r"H(s) = \frac{s^2 / \omega_z^2 + 2 \zeta_z s / \omega_z + 1}"
        r"{s^2 / \omega_p^2 + 2 \zeta_p s / \omega_p + 1}"
    )
    source = "Ljung (1999)"
    parameters = (
        Parameter("zero_frequency", RAD / S, 0.3, 40.0, (1.5, 6.0, 15.0), "of the zeros"),
        Parameter("zero_damping", ONE, 0.0, 5.0, (0.6,), "of the zeros"),
        Parameter("pole_frequency", RAD / S, 0.3, 40.0, (1.5, 6.0, 15.0), "of the poles"),
        Parameter("pole_damping", ONE, 0.02, 5.0, (0.6,), "of the poles"),
    )

    def __init__(
        self,
        *,
        zero_frequency: float | None = None,
        zero_damping: float | None = None,
        pole_frequency: float | None = None,
        pole_damping: float | None = None,
    ):
        self.zero_frequency = zero_frequency
        self.zero_damping = zero_damping
        self.pole_frequency = pole_frequency
        self.pole_damping = pole_damping

    def starts(self, record: Record) -> list[dict[str, float]]:
        """Zeros and poles at the same places (shifted a little, so that they can part)."""
        found = []
        for p in super().starts(record):
            if p["zero_frequency"] == p["pole_frequency"]:
                found.append({**p, "zero_frequency": 1.1 * p["zero_frequency"]})
        return found

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """Wider for an ARX model: machines ring longer than people, and over more octaves."""
        limits = super().limits(record)
        if record.core != CoreKind.ARX:
            return limits
        for name in ("zero_frequency", "pole_frequency"):
            low, high = limits[name]
            limits[name] = (0.1 * low, 5 * high)
        return {**limits, "zero_damping": (-5.0, 5.0), "pole_damping": (1e-3, 5.0)}

    def apply(
        self,
        signal: Any,
        record: Record,
        zero_frequency: float,
        zero_damping: float,
        pole_frequency: float,
        pole_damping: float,
    ) -> Any:
        zeros = [zero_frequency**-2, 2 * zero_damping / zero_frequency, 1.0]
        poles = [pole_frequency**-2, 2 * pole_damping / pole_frequency, 1.0]
        return shaped(signal, record, zeros, poles)


def shaped(command: Any, record: Record, b: list[float], a: list[float]) -> Any:
    """A command through b(s) / a(s), both with s^2, s and 1."""
    numerator, denominator = bilinear(b, a, record.dt)

    def through(x: np.ndarray) -> np.ndarray:
        return _kernels.greybox.filtered(_kernels.gate(x), numerator, denominator)

    return command._replace(position=through(command.position), rate=through(command.rate))


def bilinear(b: Any, a: Any, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients b0, b1, b2 and a1, a2 of b(s) / a(s), both of s^2, s and 1, by Tustin's rule."""
    c = 2.0 / dt
    to_z = np.array([[c * c, c, 1.0], [-2 * c * c, 0.0, 2.0], [c * c, -c, 1.0]])
    numerator, denominator = to_z @ np.asarray(b, float), to_z @ np.asarray(a, float)
    return numerator / denominator[0], denominator[1:] / denominator[0]
