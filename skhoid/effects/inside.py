"""Forces of the output and its rate inside a machine: friction, square-root outflow, stops."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from .. import _kernels
from .base import Effect
from .core_kind import CoreKind
from .dimension import ONE, Dimension, E, S, U
from .error_scan import ErrorScan
from .operator_signals import Spring
from .parameter import Parameter
from .record import Record

SHARP = 1e-3  # of the output's (or its rate's) size, the width of a sign function
SEEN = 0.05  # the same, of a measured speed, which is noisy
SIZES = np.geomspace(0.03, 10.0, 11)  # of forces, in standard deviations of the input
N_KEPT = 2  # starts
LINE = 1e-4  # of the output's size, below which a root is a line
OF_MACHINES = "for machines: domain='machine'"
NO_OPERATOR = "for an ARX model: it acts between the lags of the output"


class _Inside(Effect):
    """What forces inside the recursion have in common."""

    place = "inside"
    domains: ClassVar[tuple[str, ...]] = ("machine",)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        return None if core == CoreKind.ARX else NO_OPERATOR

    def of_measured(
        self, error_of: ErrorScan, record: Record, one: np.ndarray, key: str, more: dict[str, float]
    ) -> list[dict[str, float]]:
        """Sizes of a force with the core fitted beside it, with the force of what was measured.

        ``one`` is the force of size one. Without it the core is bent by what is missing.
        """
        assert record.y is not None
        found = []
        sizes = SIZES if getattr(self, key) is None else (getattr(self, key) / record.sd("e"),)
        for size in record.sd("e") * np.asarray(sizes):
            for core, _ in error_of.refitted(record.y, size * one):
                values = {key: float(size), **more, **core}
                found.append((error_of(values, np.inf), values))
        found.sort(key=lambda item: item[0])
        return [values for _, values in found[:N_KEPT]]


class Friction(_Inside):
    """Dry friction opposes the motion: a force that depends on the sign of the speed.

    In an operator's limb (``of="limb"``) it sticks where command and spring do not exceed it:
    u'' + 2 zeta_nm omega_nm u' + omega_nm^2 (u + coulomb sign(u')) = omega_nm^2 command.

    In a machine A(q) y = B(q) (x - F(v)) with v the output (``of="output"``, where that is a speed)
    or its rate (``"rate"``). ``"coulomb"``: F = coulomb sign(v); ``"smooth"``: F = coulomb
    tanh(v / width); ``"stribeck"``: F = coulomb sign(v) (1 + excess exp(-(v / fall)^2)), which is
    greater at rest.
    Viscous friction, proportional to v, is already in A(q), and a constant force in the intercept.

    Parameters
    ----------
    coulomb : float or None, default=None
        Force that opposes the motion, in units of the input, or of the command to the limb; None
        estimates it.
    width : float or None, default=None
        Speed at which three quarters of the force act (``"smooth"``), in units of v; None estimates
        it.
    excess : float or None, default=None
        Ratio of static to Coulomb friction, minus one (``"stribeck"``); None estimates it.
    fall : float or None, default=None
        Speed over which the excess falls (``"stribeck"``), in units of v; None estimates it.
    form : {"coulomb", "smooth", "stribeck"} or None, default=None
        None tries all; a limb has ``"coulomb"``.
    of : {"output", "rate", "limb"} or None, default=None
        None tries the first two for an ARX model, and takes ``"limb"`` for an operator.
    reference : float or None, default=None
        Speed in units of v; the sign function is a thousandth of it wide. None takes the standard
        deviation of v in the data.

    References
    ----------
    Armstrong-Helouvry et al., A survey of models for machines with friction (1994).

    Examples
    --------
    >>> from skhoid.effects import Friction
    >>> Friction(form="coulomb", of="output").place
    'inside'
    """

    name = "friction"
    domains = ("human", "machine")
    physics = "Dry friction in limb or stick opposes the motion, whatever the speed."
    machine_physics = "Dry friction opposes the motion, whatever the speed."
    formula = "A y = B (x - coulomb sign(v) (1 + excess exp(-(v / fall)^2)))"
    tex = (
        r"A\,y = B\,(x - F(v)), \quad F = \begin{cases}"
        r" \mathrm{coulomb}\,\operatorname{sign}(v) & \text{coulomb} \\"
        r" \mathrm{coulomb}\,\tanh(v / \mathrm{width}) & \text{smooth} \\"
        r" \mathrm{coulomb}\,\operatorname{sign}(v)\,"
        r"\bigl(1 + \mathrm{excess}\; e^{-(v / \mathrm{fall})^2}\bigr) & \text{stribeck}"
        r" \end{cases}"
    )
    source = "Armstrong-Helouvry et al. (1994)"
    shades = True
    neutral = {"coulomb": 0.0}
    choices = {"form": ("coulomb", "smooth", "stribeck"), "of": ("output", "rate", "limb")}
    within = ("stiction",)  # which has another kinetic friction

    def __init__(
        self,
        *,
        coulomb: float | None = None,
        width: float | None = None,
        excess: float | None = None,
        fall: float | None = None,
        form: str | None = None,
        of: str | None = None,
        reference: float | None = None,
    ):
        self.coulomb = coulomb
        self.width = width
        self.excess = excess
        self.fall = fall
        self.form = form
        self.of = of
        self.reference = reference

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.of == "limb":
            return (Parameter("coulomb", U, 0.01, 2.0, (0.1, 0.3), "friction in the limb"),)
        speed = U / S if self.of == "rate" else U
        coulomb = Parameter("coulomb", E, 0.0, 5.0, (0.1, 0.4), "force against the motion")
        if self.form == "smooth":
            return (coulomb, Parameter("width", speed, 2e-3, 1.0, (0.05,), "speed of its rise"))
        if self.form == "stribeck":
            return (
                coulomb,
                Parameter("excess", ONE, 0.0, 3.0, (0.3,), "excess of static friction"),
                Parameter("fall", speed, 5e-3, 0.3, (0.05,), "speed of its fall"),
            )
        return (coulomb,)

    def refusal_in(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX and record.domain == "human":
            return OF_MACHINES
        return super().refusal_in(record, core)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX:
            return "for an operator: of='limb'" if self.of == "limb" else None
        if self.of in (None, "limb") and self.form in (None, "coulomb"):
            return None
        return "an operator has of='limb' and form='coulomb'"

    def variants(self, record: Record) -> list[Effect]:
        if record.core != CoreKind.ARX and self.of in (None, "limb"):
            return [self.with_choices(of="limb", form="coulomb")]
        made: list[Any] = [v for v in super().variants(record) if v.of != "limb"]
        if self.reference is not None:
            return made
        speed = {"output": record.sd("u"), "rate": rate_size(record)}
        return [v.with_choices(reference=speed[v.of]) for v in made]

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        if record.y is None or self.of == "limb":
            return []
        v = record.y
        if self.of == "rate":
            v = np.diff(record.y, axis=0, prepend=record.y[:1]) / record.dt
        one = np.tanh(v / (SEEN * (self.reference or 1.0)))
        more = {k: v for k, v in self.starts(record)[0].items() if k != "coulomb"}
        return self.of_measured(error_of, record, one, "coulomb", more)

    def derived(self, values: dict[str, float]) -> dict[str, tuple[float, Dimension, str]]:
        """Viscous friction, of an ARX model whose output is a speed."""
        a = sum(v for n, v in values.items() if n[0] == "a" and n[1:].isdigit())
        b = sum(v for n, v in values.items() if n[0] == "b" and n[1:].isdigit())
        if self.of != "output" or b == 0.0:
            return {}
        return {"viscous": ((1 + a) / b, E / U, "force by speed")}

    def apply(
        self,
        signal: Spring,
        record: Record,
        coulomb: float,
        width: float = 0.0,
        excess: float = 0.0,
        fall: float = 1.0,
    ) -> Spring:
        if coulomb == 0.0:
            return signal
        of_rate = self.of != "output"
        kind = _kernels.inside.FRICTION
        if self.form != "smooth":
            kind, width = _kernels.inside.SHARP, SHARP * (self.reference or 1.0)
        return signal.resisted(kind, of_rate, coulomb, width, excess, fall)


def rate_size(record: Record) -> float:
    """Standard deviation of the rate of the output per second."""
    if record.y is None:
        return 1.0
    both = record.known[1:] & record.known[:-1]
    return float(np.std((np.diff(record.y, axis=0) / record.dt)[both])) or 1.0


class RootFlow(_Inside):
    """Outflow proportional to the square root of the level, as from a tank (Torricelli's law).

    A(q) y = B(q) (x - flow sqrt(max(y - level, 0))).

    Parameters
    ----------
    flow : float or None, default=None
        In units of the input per square root of the unit of the output; it is given and estimated
        as the outflow at a level of one standard deviation of the output, in units of the input.
        None estimates it.
    level : float or None, default=None
        Reading of the output at which nothing flows (``"above"``), in its units; None estimates it.
    form : {"zero", "above"} or None, default=None
        Whether the outlet is at a reading of zero; None tries both.
    reference : float or None, default=None
        The level that ``flow`` refers to, in units of the output; None takes the standard deviation
        of the output.

    References
    ----------
    Schoukens and Noel, Three benchmarks addressing open challenges in nonlinear system
    identification (2017): cascaded tanks.

    Examples
    --------
    >>> from skhoid.effects import RootFlow
    >>> RootFlow().name
    'root_flow'
    """

    name = "root_flow"
    title = "square-root flow"
    physics = "The outflow grows with the square root of the level (or pressure)."
    formula = "A y = B (x - flow sqrt(max(y - level, 0) / reference))"
    tex = (
        r"A\,y = B\,\bigl(x - \mathrm{flow}"
        r" \sqrt{\max(y - \mathrm{level},\, 0) / \mathrm{reference}}\bigr)"
    )
    source = "Schoukens and Noel (2017), cascaded tanks"
    shades = True
    neutral = {"flow": 0.0}
    choices = {"form": ("zero", "above")}

    def __init__(
        self,
        *,
        flow: float | None = None,
        level: float | None = None,
        form: str | None = None,
        reference: float | None = None,
    ):
        self.flow = flow
        self.level = level
        self.form = form
        self.reference = reference

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        flow = Parameter("flow", E, 0.0, 50.0, (0.3, 2.0), "outflow at the reference level")
        if self.form != "above":
            return (flow,)
        return (flow, Parameter("level", U, -5.0, 5.0, (-1.0, 0.0), "level of the outlet"))

    def variants(self, record: Record) -> list[Effect]:
        reference = record.sd("u") if self.reference is None else self.reference
        return [v.with_choices(reference=reference) for v in super().variants(record)]

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        if record.y is None:
            return []
        reference = record.sd("u") if self.reference is None else self.reference
        found = []
        lowest = float(record.y[record.known].min())
        for level in (0.0, lowest) if self.form == "above" else (0.0,):
            one = np.sqrt(np.maximum(record.y - level, 0.0) / reference)
            more = {"level": level} if self.form == "above" else {}
            found += self.of_measured(error_of, record, one, "flow", more)
        return found

    def apply(self, signal: Spring, record: Record, flow: float, level: float = 0.0) -> Spring:
        if flow == 0.0:
            return signal
        reference = record.sd("u") if self.reference is None else self.reference
        size, kind = flow / reference**0.5, _kernels.inside.ROOT
        return signal.resisted(kind, 0.0, size, LINE * reference, level, 0.0)


class Stops(_Inside):
    """Stops inside the machine: its state is held there, and leaves at once when driven back.

    y = min(max(y, low), high) in the recursion, so that A(q) continues from the limited output. A
    stop after the dynamics, such as a sensor's range, is :class:`Saturation`.

    Parameters
    ----------
    low, high : float or None, default=None
        Lowest and highest output, in its units; form ``"both"`` has both. None estimates it.
    form : {"high", "low", "both"} or None, default=None
        None tries all.

    References
    ----------
    Schoukens and Noel (2017), the overflow of cascaded tanks.

    Examples
    --------
    >>> from skhoid.effects import Stops
    >>> Stops(form="high", high=10.0).fixed
    {'high': 10.0}
    """

    name = "stops"
    title = "end stops"
    physics = "The machine hits a stop, or a tank overflows, and leaves that limit without delay."
    formula = "y = min(max(y, low), high) in the recursion"
    tex = r"y = \min(\max(y,\, \mathrm{low}),\, \mathrm{high}) \quad\text{in the recursion}"
    source = "Schoukens and Noel (2017), cascaded tanks"
    shades = True
    choices = {"form": ("both", "high", "low")}

    def __init__(
        self, *, low: float | None = None, high: float | None = None, form: str | None = None
    ):
        self.low = low
        self.high = high
        self.form = form

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        low = Parameter("low", U, -1e3, 1e3, (-1.5, -0.8), "lowest output")
        high = Parameter("high", U, -1e3, 1e3, (1.5, 0.8), "highest output")
        return {"high": (high,), "low": (low,)}.get(self.form or "both", (low, high))

    def starts(self, record: Record) -> list[dict[str, float]]:
        """The ends of what was measured, and somewhat inside."""
        if record.y is None or not record.known.any():
            return super().starts(record)
        y = record.y[record.known]
        names = [p.name for p in self.parameters]
        return [
            {
                n: float(v)
                for n, v in zip(("low", "high"), np.quantile(y, q), strict=True)
                if n in names
            }
            for q in ((0.005, 0.995), (0.05, 0.95))
        ]

    def apply(self, signal: Spring, record: Record, low: float = -1e9, high: float = 1e9) -> Spring:
        return signal.resisted(_kernels.inside.STOPS, 0.0, low, max(low, high), 0.0, 0.0)
