"""Intermittent control: the command is sampled and held, on a clock or on events."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from .base import Effect
from .core_kind import CoreKind
from .dimension import E, S, U
from .error_scan import ErrorScan
from .parameter import Parameter
from .record import Record, differentiated

HOLDS_CLOCK = tuple(np.arange(0.1, 0.9, 0.1).round(2).tolist())
SCANS = (10.0, 32.0, 100.0)  # s of the runs
COHERENT = 0.2  # ticks that a clock may be off at the end of a scan
FINER = tuple((np.arange(-4, 5) / 2).tolist())
PHASES = (0.0, 1 / 3, 2 / 3)  # of a tick
KEPT_HOLDS = 10
STARTS_EVENT = (0.02, 0.1, 0.2, 0.3, 0.4)
HOLDS_EVENT = (0.04, 0.07, 0.09, 0.11, 0.13, 0.155, 0.185, 0.22, 0.26, 0.31)
THRESHOLDS = tuple(np.geomspace(0.15, 1.3, 36).tolist())  # standard deviations
RATIOS = tuple(np.geomspace(0.95, 1.6, 10).tolist())  # of gains, relative to a model without it
RATIOS_OF_ERROR = (0.8, 1.1, 1.6)
LEAST_RATIO = 0.1  # s
LAG_STEP = 0.04  # s, in which a shorter delay is tried
SCANS_EVENT = (20.0, np.inf, np.inf, np.inf)  # s of the runs
NO_HOLD = np.array([0.5, 1e-9])  # samples, and standard deviations
HOPEFUL_EVENTS = 0.97  # of what the continuous command leaves
HOPEFUL_CLOCK = 0.975
KEPT_EVENTS = (250, 12, 6, 4)
FINER_EVENT = (0.0, 0.03, 0.015)  # of thresholds and ratios, twice as much of times
BESIDE = np.array([-1.0, 0.0, 1.0])
CLOCK_OFF = 0.04  # of the time between ticks
LONGEST_REST = 0.6  # s, the refractory time
# Step and number to each side, for the refractory time, the threshold and the ratio.
BESIDE_EVENT = (((0.1, 2), (0.03, 3), (0.03, 3)), ((0.04, 1), (0.01, 1), (0.01, 1)))


class Intermittent(Effect):
    """Sampled control: the command is held between decisions.

    Parameters
    ----------
    hold_time : float or None, default=None
        Time (or least time) between decisions, in seconds; None estimates it.
    threshold : float or None, default=None
        Change that triggers a decision, in units of the output (``"event"``) or the error
        (``"error"``); None estimates it.
    phase : float or None, default=None
        First tick of the clock after the start of a run, in seconds; None estimates it.
    trigger : {"clock", "event", "error"} or None, default=None
        What triggers a decision: time, a change of the command, or one of the error. None tries
        all.

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
    title = "intermittent control"
    place = "command"
    physics = "The operator decides at discrete instants and holds the command in between."
    machine_physics = "The input is sampled at discrete instants and held in between."
    formula = "command(t_i) for t_i <= t < t_(i+1)"
    tex = r"c'(t) = c(t_i) \quad\text{for } t_i \le t < t_{i+1}"
    source = "Gawthrop et al. (2011)"
    smooth = False
    choices = {"trigger": ("clock", "event", "error")}

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
            watched = E if self.trigger == "error" else U
            thresholds = tuple(np.geomspace(0.05, 1.2, 9).tolist())
            return (
                Parameter("hold_time", S, 0.0, 1.2, STARTS_EVENT, "refractory time"),
                Parameter("threshold", watched, 0.01, 4.0, thresholds, "change that triggers"),
            )
        return (
            Parameter("hold_time", S, 0.04, 1.2, HOLDS_CLOCK, "time between decisions"),
            Parameter("phase", S, 0.0, 1.2, (0.0,), "time of the first decision"),
        )

    def starts(self, record: Record) -> list[dict[str, float]]:
        """A grid on which the delay is shortened by the mean delay of the hold."""
        found = []
        for values in super().starts(record):
            hold = values.get("hold_time", self.hold_time or 0.0)
            found.append({**values, "+tau_e": -hold / 2})
        return found[:: len(found) - 1] if self._is_scanned(record) and len(found) > 2 else found

    def _is_scanned(self, record: Record) -> bool:
        if self.trigger == "clock":
            return self.hold_time is None
        return record.core != CoreKind.ARX and not self.fixed

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        if not self._is_scanned(record):
            return []
        if self.trigger == "clock":
            return self._scanned_clock(error_of, record)
        return self._scanned_events(error_of, record)

    def _scanned_clock(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Times between ticks on ever finer grids: off by less than a tick over a whole run."""
        unit = record.time_unit
        duration = record.duration / unit
        operator = record.core != CoreKind.ARX
        # In a fast system the settling can be longer than a scan.
        settled = record.dt * int(record.known.any(axis=1).argmax())
        begin = 0.0 if operator else settled
        holds = [0.1]
        while holds[-1] < 0.9:
            holds.append(holds[-1] + COHERENT * holds[-1] ** 2 / SCANS[0])
        phases = PHASES if operator and self.phase is None else (0.0,)
        tried = [(hold, share * hold) for hold in holds for share in phases]
        for i, seconds in enumerate(SCANS):
            if operator:
                errors = self._of_clocks(tried, error_of, record.dt, seconds)
            else:
                starts = [self._ticking(one, error_of, unit) for one in tried]
                errors = np.array([error_of(v, begin + seconds * unit) for v in starts])
            if operator and errors.min() > HOPEFUL_CLOCK * self._of_continuous(error_of, seconds):
                return []
            best = [tried[j] for j in np.argsort(errors)[: KEPT_HOLDS >> i]]
            if seconds >= duration or i + 1 == len(SCANS):
                break
            finer = COHERENT / min(SCANS[i + 1], duration)
            tried = [(h + k * finer * h**2, phase) for h, phase in best for k in FINER]
        values = [self._ticking(one, error_of, unit) for one in best[:2]]
        return [error_of.fitted(v)[1] for v in values] if operator else values

    def _ticking(
        self, one: tuple[float, float], error_of: ErrorScan, unit: float
    ) -> dict[str, float]:
        hold, phase = one
        phase = phase if self.phase is None else self.phase / unit
        core = error_of.earlier(hold * unit / 2)
        return {**core, "hold_time": hold * unit, "phase": phase * unit}

    def _of_clocks(self, tried: Any, error_of: ErrorScan, dt: float, seconds: float) -> np.ndarray:
        """Sums of squares left by clocks of (hold time, phase)."""
        held = _kernels.greybox.held
        own = 0.0 if self.phase is None else self.phase
        columns = []
        for part in (0, 1):
            answers = []
            for hold, phase in tried:
                x = error_of.commands(seconds, LAG_STEP * round(hold / 2 / LAG_STEP))[part]
                answers.append(held(x, x, hold / dt, 0.0, (phase + own) / dt))
            columns.append(np.stack(answers, axis=2))
        return np.asarray(error_of.left(columns, seconds))

    def _of_continuous(self, error_of: ErrorScan, seconds: float) -> float:
        """Sum of squares left by the continuous command."""
        return float(error_of.left([x[:, :, None] for x in error_of.commands(seconds)], seconds)[0])

    def _scanned_events(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Refractory times, thresholds and ratios of the gains on a grid, then around its best.

        Ratios, because the events of a command depend on them.
        """
        of_error = self.trigger == "error"
        parent, ordinary = error_of.parameters, error_of.ordinary
        if not parent["K_e"] > 0 or not ordinary["K_e"] > 0:
            return []
        ratio = max(parent["K_edot"] / parent["K_e"], LEAST_RATIO)
        scale = record.sd("e" if of_error else "u")
        ratios = RATIOS_OF_ERROR if of_error else RATIOS
        mesh = np.meshgrid(HOLDS_EVENT, THRESHOLDS, ratios, indexing="ij")
        points = np.stack([m.ravel() for m in mesh], axis=1) * np.array([1.0, scale, ratio])
        whole, slope = error_of.commands(SCANS_EVENT[-1])
        powers = [np.mean(whole * whole), np.mean(whole * slope), np.mean(slope * slope)]

        def factor(ratio: Any) -> Any:
            """Factor that makes the command as large as the output."""
            square = powers[0] + 2 * ratio * powers[1] + ratio**2 * powers[2]
            return record.sd("u") / np.sqrt(square)

        for i, seconds in enumerate(SCANS_EVENT):
            table = np.c_[points, factor(points[:, 2])]
            if of_error:
                table[:, 1] *= abs(ordinary["K_e"])
            left = error_of.left_by_events(table, seconds, of_error)
            if i == 0:
                often = np.c_[np.tile(NO_HOLD * np.r_[record.dt, scale], (len(ratios), 1)), ratios]
                often[:, 2] *= ratio
                rows = np.c_[often, factor(often[:, 2])]
                continuous = error_of.left_by_events(rows, seconds, of_error)[:, 0].min()
                if left[:, 0].min() > HOPEFUL_EVENTS * continuous:
                    return []
            first = np.argsort(left[:, 0])[: KEPT_EVENTS[i]]
            best = points[first]
            if i + 1 == len(SCANS_EVENT):
                break
            step = FINER_EVENT[i]
            by = np.meshgrid(1 + 2 * step * BESIDE, 1 + step * BESIDE, 1 + step * BESIDE)
            finer = np.stack([m.ravel() for m in by], axis=1) if step else np.ones((1, 3))
            points = (best[:, None, :] * finer).reshape(-1, 3)
        found = []
        for (hold, threshold, r), (_, early, more) in zip(best, left[first], strict=True):
            more = float(np.clip(more, 0.5, 2.0))
            gain = more * ordinary["K_e"] * float(factor(r))
            core = ordinary | {"K_e": gain, "K_edot": r * gain}
            if "tau_e" in core:
                core = core | {"tau_e": core["tau_e"] - early}
            change = {f"+{name}": core[name] - parent[name] for name in core}
            threshold *= 1.0 if of_error else more
            found.append(error_of.fitted({**change, "hold_time": hold, "threshold": threshold}))
        found.sort(key=lambda item: item[0])
        return [values for _, values in found[:2]]

    def scanned_beside(
        self, error_of: ErrorScan, values: dict[str, float]
    ) -> list[dict[str, float]]:
        core = error_of.parameters
        both = core.get("K_edot", 0.0) * core.get("K_e", 0.0)
        if self.trigger == "clock" or self.fixed or not both > 0.0:
            return []
        if error_of.explores:  # has other events
            return []
        of_error = self.trigger == "error"
        hold, threshold = values["hold_time"], values["threshold"]
        points = np.array([[hold, threshold, core["K_edot"] / core["K_e"], 1.0]])
        if of_error:
            points[:, 1] *= abs(core["K_e"])
        for steps in BESIDE_EVENT:
            by = [1 + step * np.arange(-count, count + 1) for step, count in steps]
            finer = np.stack([m.ravel() for m in np.meshgrid(*by)], axis=1)
            points = np.repeat(points, len(finer), axis=0) * np.c_[finer, np.ones(len(finer))]
            left = error_of.left_by_events(points, SCANS_EVENT[-1], of_error)
            first = int(np.argmin(left[:, 0]))
            points = points[first : first + 1]
        hold, threshold, ratio = points[0, :3]
        early, by = left[first, 1:]
        gain = by * core["K_e"]
        change = {"+K_e": gain - core["K_e"], "+K_edot": ratio * gain - core["K_edot"]}
        threshold = threshold / abs(core["K_e"]) if of_error else by * threshold
        found = {**change, "hold_time": hold, "threshold": threshold}
        return [found, {**found, "+tau_e": -early}] if "tau_e" in core else [found]

    def within_cube(
        self, values: dict[str, float], at: np.ndarray, record: Record
    ) -> dict[str, float]:
        """Clocks of any phase, nearly as fast; events of half to twice the change, at any rest."""
        if self.fixed:
            return super().within_cube(values, at, record)
        if self.trigger == "clock":
            hold = values["hold_time"] * (1 + CLOCK_OFF * (2 * at[0] - 1))
            return {"hold_time": hold, "phase": hold * at[1]}
        longest = max(2 * values["hold_time"], LONGEST_REST)
        return {
            "hold_time": longest * at[0],
            "threshold": values["threshold"] * 4.0 ** (at[1] - 0.5),
        }

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
        period = max(hold_time / dt, 1.0 if threshold == 0.0 else 0.0)
        kept = _kernels.greybox.held(whole, watched, period, threshold, phase / dt)
        return signal._replace(position=kept, rate=np.zeros_like(kept))
