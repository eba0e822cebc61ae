"""What machines have: forces in the recursion, sensors, filters, schedules, a joint's reflex."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.signal import lfilter

from .. import _kernels
from .base import Effect
from .entry import Argument
from .error_scan import ErrorScan
from .in_time import ScheduledGain
from .maps import GROWTH, NO_LIMB
from .operator_signals import Gains, Spring, bilinear
from .parameter import ONE, RAD, CoreKind, Dimension, E, Parameter, S, U
from .record import Record

__all__ = [  # in the order of the catalogue
    "Friction",
    "RootFlow",
    "Stops",
    "SensorMagnitude",
    "InputFilter",
    "RateReflex",
    "ScheduledDynamics",
]

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
    citation = "Armstrong-Helouvry et al., A survey of models for machines with friction (1994)."
    told_apart = {
        "dead_zone": (
            "record slow reversals at several amplitudes: friction holds the output at each turn; "
            "a dead zone only does so around zero input"
        ),
        "backlash": (
            "let the limb or machine coast from speed: friction stops it in finite time; play does "
            "not"
        ),
        "stiction": "record reversals at several speeds of the input",
    }
    examples = (
        {"form": "coulomb", "of": "rate", "coulomb": 0.5, "reference": 0.1},
        {"form": "smooth", "of": "rate", "coulomb": 0.5, "width": 0.1, "reference": 0.1},
        {
            "form": "stribeck",
            "of": "rate",
            "coulomb": 0.5,
            "excess": 0.8,
            "fall": 0.08,
            "reference": 0.1,
        },
    )
    hidden = {"of": "limb", "coulomb": 0.03}
    parameters = (
        Parameter("coulomb", U, 0.01, 2.0, (0.1, 0.3), "friction in the limb", forms=("limb",)),
        Parameter(
            "coulomb", E, 0.0, 5.0, (0.1, 0.4), "force against the motion", forms=("output", "rate")
        ),
        Parameter("width", U, 2e-3, 1.0, (0.05,), "speed of its rise", forms=("smooth",)),
        Parameter(
            "excess", ONE, 0.0, 3.0, (0.3,), "excess of static friction", forms=("stribeck",)
        ),
        Parameter("fall", U, 5e-3, 0.3, (0.05,), "speed of its fall", forms=("stribeck",)),
    )
    arguments = {
        "reference": Argument(
            "Speed in units of v; the sign function is a thousandth of it wide. None takes the "
            "standard deviation of v in the data.",
            "float or None",
        ),
        "form": Argument('None tries all; a limb has ``"coulomb"``.'),
        "of": Argument(
            'None tries the first two for an ARX model, and takes ``"limb"`` for an operator.'
        ),
    }

    def resolved(self, parameter: Parameter) -> Parameter:
        """A speed is the output, or its rate."""
        if self.of != "rate" or parameter.name not in ("width", "fall"):
            return parameter
        return replace(parameter, dimension=U / S)

    def refusal_in(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX and record.domain == "human":
            return OF_MACHINES
        return super().refusal_in(record, core)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core == CoreKind.ARX:
            return "for an operator: of='limb'" if self.of == "limb" else None
        if core == CoreKind.CONTROLLER:
            return NO_LIMB
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
    citation = (
        "Schoukens and Noel, Three benchmarks addressing open challenges in nonlinear system "
        "identification (2017): cascaded tanks."
    )
    told_apart = {"hardening_stiffness": "record steady states at several levels"}
    examples = (
        {"form": "zero", "flow": 1.5, "reference": 0.1},
        {"form": "above", "flow": 1.5, "level": -0.15, "reference": 0.1},
    )
    parameters = (
        Parameter("flow", E, 0.0, 50.0, (0.3, 2.0), "outflow at the reference level"),
        Parameter("level", U, -5.0, 5.0, (-1.0, 0.0), "level of the outlet", forms=("above",)),
    )
    arguments = {
        "reference": Argument(
            "The level that ``flow`` refers to, in units of the output; None takes its "
            "standard deviation.",
            "float or None",
        )
    }

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
    """

    name = "stops"
    title = "end stops"
    physics = "The machine hits a stop, or a tank overflows, and leaves that limit without delay."
    formula = "y = min(max(y, low), high) in the recursion"
    tex = r"y = \min(\max(y,\, \mathrm{low}),\, \mathrm{high}) \quad\text{in the recursion}"
    source = "Schoukens and Noel (2017), cascaded tanks"
    shades = True
    choices = {"form": ("both", "high", "low")}
    citation = "Schoukens and Noel (2017), the overflow of cascaded tanks."
    told_apart = {
        "saturation": (
            "drive it into the stop and reverse at once: from its own stop the machine returns "
            "without delay; from the end of a sensor's range it returns late"
        ),
    }
    examples = (
        {"form": "both", "low": -0.2, "high": 0.2},
        {"form": "high", "high": 0.2},
        {"form": "low", "low": -0.2},
    )
    parameters = (
        Parameter("low", U, -1e3, 1e3, (-1.5, -0.8), "lowest output", forms=("low", "both")),
        Parameter("high", U, -1e3, 1e3, (1.5, 0.8), "highest output", forms=("high", "both")),
    )

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


N_ROUNDS = 8  # of signs and least squares
KEPT_SIGNS = 3  # starts
LOW_MINIMA = (0.15, 0.3, 0.5, 0.8)  # standard deviations, below which a minimum may be a crossing


class SensorMagnitude(Effect):
    """The sensor shows the magnitude of the output without its sign: y' = abs(y).

    Pulse counters and rectifying tachometers do this. A search starts from the signs that make the
    output smooth, then repeats with the signs of the fitted model until they no longer change.
    """

    name = "sensor_magnitude"
    title = "sensor without sign"
    place = "output"
    physics = "The sensor shows how fast or how far, but not in which direction."
    formula = "y' = |y|"
    tex = r"y' = |y|"
    source = "Wigren and Schoukens (2017)"
    domains = ("machine",)
    citation = "Wigren and Schoukens, Coupled electric drives data set and reference models (2017)."
    examples = ({},)

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core != CoreKind.ARX:
            return "for an ARX model: its signs are found with linear fits"
        if record.y is not None and (record.y[record.known] < -0.1 * record.sd("u")).any():
            return "the output takes both signs"
        return None

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """The core fitted to the output with signs that make it smooth, and with its own signs."""
        return cores_by_signs(error_of, record)

    def apply(self, signal: np.ndarray, record: Record) -> np.ndarray:
        return np.abs(signal)


def cores_by_signs(error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
    """Changes of a core that is linear in its parameters, fitted to an output without its signs.

    From signs that make it smooth, then with the signs of the free run until they stay.
    """
    if record.y is None:
        return []
    known = record.known

    def error(free_run: np.ndarray) -> float:
        return float(np.sum((np.abs(free_run) - record.y)[known] ** 2))

    found = []
    lows = [share * record.sd("u") for share in LOW_MINIMA]
    guesses = [smooth_signs(record.y), *(signs_by_minima(record.y, low) for low in lows)]
    for signs in guesses:
        signed = signs * record.y
        for _ in range(N_ROUNDS):
            rounds = error_of.refitted(signed)
            if not rounds:
                return []
            values, free_run = min(rounds, key=lambda one: error(one[1]))
            found.append((error(free_run), values))
            again = np.where(free_run < 0.0, -record.y, record.y)
            if np.array_equal(again, signed):
                break
            signed = again
    found.sort(key=lambda one: one[0])
    return [values for _, values in found[:KEPT_SIGNS]]


def smooth_signs(y: np.ndarray) -> np.ndarray:
    """Signs of samples (n_samples, n_runs) at which the second differences are least.

    The first is positive. By Viterbi's algorithm, over the signs of two neighbours.
    """
    n, runs = y.shape
    signs = np.ones((n, runs))
    if n < 3:
        return signs
    pairs = [(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)]  # of the sample before and this one
    cost = np.array([[0.0 if a > 0 else np.inf for a, _ in pairs]] * runs).T
    came = np.zeros((n, 4, runs), dtype=int)
    for k in range(2, n):
        new = np.empty_like(cost)
        for i, (b, c) in enumerate(pairs):
            before = [j for j, pair in enumerate(pairs) if pair[1] == b]
            bends = np.stack(
                [
                    cost[j] + (c * y[k] - 2 * b * y[k - 1] + pairs[j][0] * y[k - 2]) ** 2
                    for j in before
                ]
            )
            least = np.argmin(bends, axis=0)
            came[k, i] = np.array(before)[least]
            new[i] = bends.min(axis=0)
        cost = new
    at = np.argmin(cost, axis=0)
    columns = np.arange(runs)
    for k in range(n - 1, 1, -1):
        signs[k] = np.array([pair[1] for pair in pairs])[at]
        signs[k - 1] = np.array([pair[0] for pair in pairs])[at]
        at = came[k, at, columns]
    return signs


def signs_by_minima(y: np.ndarray, low: float) -> np.ndarray:
    """Signs of samples (n_samples, n_runs) that change at each minimum below a value."""
    before, after = y[:-2] >= y[1:-1], y[1:-1] < y[2:]
    flips = np.ones_like(y)
    flips[1:-1] = np.where(before & after & (y[1:-1] < low), -1.0, 1.0)
    return np.cumprod(flips, axis=0)


SLOWEST, FASTEST = 0.05, 20.0  # times the frequency at the reference


class ScheduledDynamics(ScheduledGain):
    """Natural frequencies that follow a measured channel, with constant damping ratios.

    Poles exp(s dt) of A(q) become exp(factor s dt) with factor = 1 + slope (channel - reference);
    B(q) is scaled so that the static gain stays. A gain that follows the channel as well is
    :class:`ScheduledGain`.
    """

    name = "scheduled_dynamics"
    place = "gain"
    physics = "The dynamics become faster or slower with a measured condition, such as position."
    formula = "omega (1 + slope (channel - reference)) in place of omega, for all poles"
    tex = (
        r"\omega(t) = \omega\,\bigl(1 + \mathrm{slope}\,(\mathrm{channel}(t) -"
        r" \mathrm{reference})\bigr)"
        r" \quad\text{of all poles}"
    )
    source = "Toth (2010)"
    domains = ("machine",)
    citation = "Toth, Modeling and identification of linear parameter-varying systems (2010)."
    told_apart = {
        "scheduled_gain": (
            "record steps at several fixed values of the channel: the gain shows in their height, "
            "the dynamics in their shape"
        ),
    }
    examples = ({"channel": "speed", "slope": 0.3, "reference": 3.0},)

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
    citation = "Schoukens, Suykens and Ljung, Wiener-Hammerstein benchmark (2009)."
    examples = (
        {"form": "dead_zone", "time": 0.3, "width": 0.7},
        {"form": "clipped", "time": 0.3, "width": 1.2, "skew": 0.0},
        {"form": "cubic", "time": 0.3, "hardening": 0.15},
        {"form": "square", "time": 0.3, "hardening": 0.4},
    )
    parameters = (
        Parameter(
            "time", S, 0.0, 20.0, (0.03, 0.3), "time constant of the filter", forms=("first",)
        ),
        Parameter(
            "omega", RAD / S, 0.3, 200.0, (3.0, 15.0), "frequency of the filter", forms=("second",)
        ),
        Parameter("zeta", ONE, 0.02, 5.0, (0.7,), "damping ratio of the filter", forms=("second",)),
        Parameter("hardening", ONE / E**2, -0.3, 20.0, (-0.02, 0.1), GROWTH, forms=("cubic",)),
        Parameter("hardening", ONE / E, -1.0, 20.0, (-0.1, 0.3), GROWTH, forms=("square",)),
        Parameter("width", E, 0.02, 3.3, (0.7, 1.5), "limit after the filter", forms=("clipped",)),
        Parameter(
            "skew", ONE, -0.95, 0.95, (-0.3, 0.3), "asymmetry of the limits", forms=("clipped",)
        ),
        Parameter(
            "width", E, 0.0, 3.0, (0.25, 0.7), "threshold after the filter", forms=("dead_zone",)
        ),
    )
    options = {"order": ("first", "second")}
    arguments = {
        "order": Argument(
            'A search tries ``"first"``: the two poles of ``"second"`` make up for poles that a '
            "linear model "
            "lacks, whatever the map.",
            '{"first", "second"}',
            "first",
        )
    }

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
        w = lfilter(*poles, signal, axis=0)
        if self.form == "clipped":
            return np.clip(w, -width * (1 - skew), width * (1 + skew))
        if self.form in ("cubic", "square"):
            power = 2 if self.form == "cubic" else 1
            if hardening < 0.0:  # where it softens, it stays at its greatest
                greatest = (-1 / ((power + 1) * hardening)) ** (1 / power)
                w = np.clip(w, -greatest, greatest)
            return w * (1 + hardening * np.abs(w) ** power)
        return w - np.clip(w, -width, width)


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
    options = {"sense": (1, -1)}
    arguments = {
        "sense": Argument(
            "Sign of the output that resists a positive input, by the recording's convention; "
            "None takes that of "
            "the covariance of output and input.",
            "{1, -1} or None",
        )
    }
    parameters = (
        Parameter("gain", U * S / E, 0.0, 1e3, (0.03, 0.3), "gain on the rate"),
        Parameter("delay", S, 0.015, 0.3, (0.04,), "delay of the response", scale=ONE),
        Parameter("omega", RAD / S, 2.0, 200.0, (30.0,), "frequency of the path", scale=ONE),
        Parameter("zeta", ONE, 0.2, 5.0, (1.0,), "its damping ratio"),
    )
    citation = (
        "Mirbagheri, Barbeau and Kearney, Intrinsic and reflex contributions to human ankle "
        "stiffness, Experimental Brain Research 135 (2000)."
    )
    told_apart = {"rectified": "record slow ramps, in which the rate hardly acts"}
    examples = (
        {"side": "positive", "gain": 0.03, "delay": 0.05, "omega": 25.0, "zeta": 0.7, "sense": 1},
        {"side": "negative", "gain": 0.03, "delay": 0.05, "omega": 25.0, "zeta": 0.7, "sense": 1},
    )

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
        return lfilter(*filtered, late, axis=0)

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
