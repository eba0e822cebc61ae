"""Operators that change during a run: delay, gains, lapses, and control by samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import expit

from .. import _kernels
from ..runs.roles import OTHER
from .base import Effect
from .entry import Argument
from .error_scan import ErrorScan
from .operator_signals import Gains
from .parameter import CHANNEL, ONE, RAD, CoreKind, Dimension, E, Parameter, S, T, U
from .record import Record, differentiated, needs_channel

__all__ = [  # in the order of the catalogue
    "WrongDelay",
    "TimeVaryingDelay",
    "Intermittent",
    "TimeVaryingGain",
    "GainDrift",
    "Lapses",
    "ScheduledGain",
]

SCANNED_DELAYS = 24


class WrongDelay(Effect):
    """The delay differs from the assumed one.

    It frees a delay that was given to the model (``OperatorRegressor(delay=0.28)``, or ``nk`` of an
    ARX model); a model that estimates its delay does not need it.
    """

    name = "wrong_delay"
    place = "delay"
    physics = "The response comes earlier or later than the model assumes."
    machine_physics = "The dead time is shorter or longer than the model assumes."
    formula = "e(t - delay - extra)"
    tex = r"e(t) \to e(t - \tau_e - \mathrm{extra})"
    source = "Thesis, Section V"
    parameters = (Parameter("extra", S, -0.4, 0.6, (-0.08, 0.08), "delay beyond the assumed one"),)
    neutral = {"extra": 0.0}
    citation = "Thesis, Section V: n_k fixed or estimated."
    told_apart = {"extra_lag": "use a forcing function with lines up to 30 rad/s"}
    examples = ({"extra": 0.08},)
    hidden = examples[0]

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if core in (CoreKind.OPERATOR_FREE_DELAY, CoreKind.CONTROLLER):
            return "the model already estimates its delay (delay=None)"
        return None

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        low, high = super().limits(record)["extra"]
        return {"extra": (max(low, -record.ahead), high)}

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Whole samples of an ARX model, whose input may be rough between them."""
        if record.core != CoreKind.ARX or self.extra is not None:
            return []
        low, high = (round(limit / record.dt) for limit in self.limits(record)["extra"])
        samples = np.unique(np.linspace(low, high, SCANNED_DELAYS).round())
        return [{"extra": float(n * record.dt)} for n in samples]

    def apply(self, signal: Any, record: Record, extra: float) -> Any:
        return signal + extra


class TimeVaryingDelay(Effect):
    """The delay changes during the run, by a sigmoid."""

    name = "tv_delay"
    title = "time-varying delay"
    place = "delay"
    physics = "The operator becomes slower or faster to respond during the run."
    machine_physics = "The dead time changes during the run."
    formula = "tau_e + change / (1 + exp(-rate (t - time)))"
    tex = r"\tau(t) = \tau_e + \frac{\mathrm{change}}{1 + e^{-\mathrm{rate}\,(t - \mathrm{time})}}"
    source = "Thesis, Eq. 2"
    parameters = (
        Parameter("change", S, -0.5, 0.5, (0.05, -0.05), "change of the delay"),
        Parameter("rate", ONE / S, 0.05, 20.0, (0.5,), "steepness"),
        Parameter("time", S, 0.02, 0.98, (0.3, 0.7), "middle of the change", T),
    )
    neutral = {"change": 0.0}
    citation = "Thesis, Eq. 2, for its sigmoid."
    examples = ({"change": 0.15, "rate": 0.5, "time": 40.0},)
    hidden = examples[0]

    def apply(self, signal: Any, record: Record, change: float, rate: float, time: float) -> Any:
        return signal + change * sigmoid(record, rate, time)


HOLDS_CLOCK = tuple(np.arange(0.1, 0.9, 0.1).round(2).tolist())
SCANS = (10.0, 32.0, 100.0)  # s of the runs
COHERENT = 0.2  # ticks that a clock may be off at the end of a scan
FINER = tuple((np.arange(-4, 5) / 2).tolist())
PHASES = (0.0, 1 / 3, 2 / 3)  # of a tick
KEPT_HOLDS = 10
STARTS_EVENT = (0.02, 0.1, 0.2, 0.3, 0.4)
STARTS_THRESHOLD = tuple(np.geomspace(0.05, 1.2, 9).tolist())
ON_EVENTS = ("event", "error")
HOLDS_EVENT = tuple(np.geomspace(0.04, 1.1, 48).tolist())
THRESHOLDS = tuple(np.geomspace(0.08, 1.3, 10).tolist())  # standard deviations
LEADS = tuple(np.geomspace(0.06, 2.0, 7).tolist())  # s, the ratio of the gains
FOLLOWED_EVENTS = 3  # of what is best in windows, and of what is best in whole runs
AHEAD = (0.0, 0.35, 0.7)  # of the refractory time, by which the delay is shorter
# Windows and seconds of the runs, how many are kept, what the best leaves at most of what the model
# without holds leaves there, and the relative step to what is tried beside these: an event that is
# off moves all later ones, so windows grow as what is tried gets finer, and whole runs may lose
# track. Hidden holds left .34 to .98 of it in the windows of 16 s, runs without any 1.02 and more.
SCANS_EVENT = (
    (4.0, 12.0, 600, 1.0, 0.0),
    (8.0, 24.0, 80, 1.0, 0.012),
    (16.0, 32.0, 250, 1.06, 0.0),
    (16.0, np.inf, 25, 1.02, 0.006),
    (32.0, np.inf, 10, 1.1, 0.003),
    (np.inf, np.inf, 3, np.inf, 0.0),
)
SAMPLED, KEPT_NEIGHBOURS = 3, 800  # of the grid, and of these with those beside them
NEARLY = 1.06  # times what is left without holds, of one of three where all would leave less
AGAIN = 6  # times fewer are kept of a second scan: it still finds seven of nine hidden holds
LAG_STEP = 0.04  # s, in which a shorter delay is tried
HOPEFUL_CLOCK = 0.975
BESIDE = np.array([-1.0, 0.0, 1.0])
CLOCK_OFF = 0.04  # of the time between ticks
LONGEST_REST = 0.6  # s, the refractory time
# Step and number to each side, for the refractory time, the threshold and the ratio.
BESIDE_EVENT = (((0.1, 2), (0.03, 3), (0.03, 3)), ((0.04, 1), (0.01, 1), (0.01, 1)))


class Intermittent(Effect):
    """Sampled control: the command is held between decisions."""

    name = "intermittent"
    title = "intermittent control"
    place = "command"
    keeps_unit = True
    physics = "The operator decides at discrete instants and holds the command in between."
    machine_physics = "The input is sampled at discrete instants and held in between."
    formula = "command(t_i) for t_i <= t < t_(i+1)"
    tex = r"c'(t) = c(t_i) \quad\text{for } t_i \le t < t_{i+1}"
    source = "Gawthrop et al. (2011)"
    smooth = False
    choices = {"trigger": ("clock", "event", "error")}
    citation = (
        "Gawthrop et al., Intermittent control: a computational theory of human control (2011)."
    )
    examples = (
        {"trigger": "clock", "hold_time": 0.3, "phase": 0.0},
        {"trigger": "event", "hold_time": 0.1, "threshold": 0.1},
        {"trigger": "error", "hold_time": 0.1, "threshold": 0.8},
    )
    hidden = examples[0]
    parameters = (
        Parameter("hold_time", S, 0.0, 1.2, STARTS_EVENT, "refractory time", forms=ON_EVENTS),
        Parameter(
            "threshold", U, 0.01, 4.0, STARTS_THRESHOLD, "change that triggers", forms=("event",)
        ),
        Parameter(
            "threshold", E, 0.01, 4.0, STARTS_THRESHOLD, "change that triggers", forms=("error",)
        ),
        Parameter(
            "hold_time", S, 0.04, 1.2, HOLDS_CLOCK, "time between decisions", forms=("clock",)
        ),
        Parameter("phase", S, 0.0, 1.2, (0.0,), "time of the first decision", forms=("clock",)),
    )
    arguments = {
        "trigger": Argument(
            "What triggers a decision: time, a change of the command, or one of the error. None "
            "tries all."
        )
    }

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
        return record.core.has_limb and not self.fixed

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
        operator = record.core.has_limb
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
        """Refractory times, thresholds, leads and delays on a grid, then around its best.

        In short windows first, as an event that is off moves all later ones. A lead,
        because the events of a command depend on it; a shorter delay, because a model without holds
        has theirs in its own.
        """
        of_error = self.trigger == "error"
        parent, ordinary = error_of.parameters, error_of.ordinary
        if not ordinary["K_e"] > 0:
            return []
        scale = record.sd("e" if of_error else "u")
        whole, slope = error_of.commands(np.inf)
        powers = [np.mean(whole * whole), np.mean(whole * slope), np.mean(slope * slope)]

        def factor(lead: Any) -> Any:
            """Factor that makes the command as large as the output."""
            square = powers[0] + 2 * lead * powers[1] + lead**2 * powers[2]
            return record.sd("u") / np.sqrt(square)

        def left_by(points: np.ndarray, seconds: float, window: float) -> np.ndarray:
            table = np.c_[points[:, :3], factor(points[:, 2])]
            if of_error:
                table[:, 1] *= abs(ordinary["K_e"])
            left = np.empty((len(points), 3))
            for ahead in np.unique(points[:, 3]):
                same = points[:, 3] == ahead
                left[same] = error_of.left_by_events(
                    table[same], seconds, of_error, ahead=ahead, window=window
                )
            return left

        mesh = np.meshgrid(HOLDS_EVENT, THRESHOLDS, LEADS, AHEAD, indexing="ij")
        points = np.stack([m.ravel() for m in mesh], axis=1) * [1.0, scale, 1.0, 1.0]
        points[:, 3] = LAG_STEP * np.round(points[:, 3] * points[:, 0] / LAG_STEP)
        points = np.unique(points, axis=0)
        kept_points, kept_left = [], []
        # One of three neighbours in lead and delay is as good within a twentieth.
        tried = points[::SAMPLED]
        window, seconds, *_ = SCANS_EVENT[0]
        left = left_by(tried, seconds, window)[:, 0]
        hope = 1.0 - error_of.asked
        if left.min() > NEARLY * hope * error_of.left_without(seconds, window):
            return []
        if error_of.again:
            points = tried
        else:
            near = SAMPLED * np.argsort(left)[:KEPT_NEIGHBOURS, None] + BESIDE.astype(int)
            points = points[np.unique(near.clip(0, len(points) - 1))]
        for window, seconds, kept, most, step in SCANS_EVENT:
            left = left_by(points, seconds, window)
            most = min(most, hope) if error_of.asked else most
            if left[:, 0].min() > most * error_of.left_without(seconds, window):
                return []
            first = np.argsort(left[:, 0])[: max(kept // AGAIN, 1) if error_of.again else kept]
            best = points[first]
            if window >= SCANS_EVENT[-2][0]:  # the longest windows, and whole runs
                kept_points.append(best[:FOLLOWED_EVENTS])
                kept_left.append(left[first[:FOLLOWED_EVENTS]])
            by = np.meshgrid(1 + step * BESIDE, 1 + 4 * step * BESIDE, 1 + 8 * step * BESIDE)
            finer = np.unique(np.stack([m.ravel() for m in by] + [np.ones(27)], axis=1), axis=0)
            points = (best[:, None, :] * finer).reshape(-1, 4)
        best, of_best = np.concatenate(kept_points), np.concatenate(kept_left)
        found = []
        for (hold, threshold, lead, ahead), (_, early, more) in zip(best, of_best, strict=True):
            more = float(np.clip(more, 0.5, 2.0))
            gain = more * ordinary["K_e"] * float(factor(lead))
            core = ordinary | {"K_e": gain, "K_edot": lead * gain}
            if "tau_e" in core:
                core = core | {"tau_e": core["tau_e"] - ahead - early}
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
        if error_of.explores or "omega_nm" not in core:  # has other events, or no limb
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
            left = error_of.left_by_events(points, np.inf, of_error)
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


EDGE_STEPS = (0.2, 0.1, 0.05, 0.02)  # s, of the ends of lapses


def sigmoid(record: Record, rate: float, time: float) -> np.ndarray:
    """The sigmoid of Eq. 2 over the time in the run, from 0 to 1."""
    return expit(rate * (record.t - time))


class TimeVaryingGain(Effect):
    """Gains on error and error rate change during the run, by a sigmoid or a ramp.

    K(t) = K [1 + change / (1 + exp(-rate (t - time)))], with separate changes of K_e and K_edot;
    large rates are steps. ``"ramp"`` changes linearly within 4 / rate seconds.
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
    arguments = {
        "omega_nm_change": Argument(
            "Relative change of neuromuscular frequency; None estimates it.", "float or None", 0.0
        ),
        "zeta_nm_change": Argument(
            "Relative change of neuromuscular damping; None estimates it.", "float or None", 0.0
        ),
        "form": Argument("None tries both.", default="sigmoid"),
    }
    citation = "Thesis, Eqs. 2, 3 and 5, and its reference [12], which has the same sigmoids."
    examples = (
        {"form": "sigmoid", "K_e_change": 0.7, "K_edot_change": -0.4, "rate": 0.3, "time": 40.0},
        {"form": "ramp", "K_e_change": 0.7, "K_edot_change": -0.4, "rate": 0.1, "time": 40.0},
    )
    hidden = {"K_e_change": -0.4, "K_edot_change": 0.8, "rate": 2.0, "time": 40.0}

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
    citation = (
        "Thesis, Section II: slow variation. Heathcote et al., The power law repealed: the case "
        "for an exponential law of practice (2000)."
    )
    told_apart = {
        "tv_gain": (
            "record longer runs, or the same run twice without a pause: a drift goes on; a change "
            "of gain is over"
        ),
    }
    examples = (
        {"form": "linear", "rate": -0.01, "reference": 0.0},
        {"form": "curved", "rate": -0.02, "curve": 0.04, "reference": 0.0},
    )
    hidden = {"rate": -0.008}
    parameters = (
        Parameter("rate", ONE / S, -1.9, 1.9, (0.4, -0.4), "relative change per second", ONE / T),
        Parameter(
            "curve", ONE / S, -8.0, 8.0, (2.0, -2.0), "rate of settling", ONE / T, ("curved",)
        ),
    )
    arguments = {
        "reference": Argument(
            "Time in the run at which the gains are nominal, in seconds; None takes the middle.",
            "float or None",
        )
    }

    def variants(self, record: Record) -> list[Effect]:
        formed: list[Any] = super().variants(record)
        return [with_middle(variant, record) for variant in formed]

    def apply(self, signal: Gains, record: Record, rate: float, curve: float = 0.0) -> Gains:
        away = record.t - self.reference
        if curve != 0.0:
            away = -np.expm1(-curve * away) / curve
        return signal.times(np.maximum(1 + rate * away, 0.0))


class ScheduledGain(Effect):
    """Both gains follow a measured channel."""

    name = "scheduled_gain"
    place = "gain"
    physics = "The operator adapts the gain to a measured condition, such as speed."
    machine_physics = "The gain follows a measured condition, such as speed."
    formula = "K (1 + slope (channel - reference))"
    tex = r"K(t) = K\,\bigl(1 + \mathrm{slope}\,(\mathrm{channel}(t) - \mathrm{reference})\bigr)"
    source = "Toth (2010)"
    neutral = {"slope": 0.0}
    citation = (
        "Gain scheduling; Toth, Modeling and identification of linear parameter-varying systems "
        "(2010)."
    )
    examples = ({"channel": "speed", "slope": 0.3, "reference": 3.0},)
    parameters = (Parameter("slope", ONE / CHANNEL, -3.0, 3.0, (0.15, -0.15), "relative change"),)
    arguments = {
        "channel": Argument("What is followed; None tries each channel that has no role."),
        "reference": Argument(
            "Value of the channel at which nothing is changed; None takes its mean.",
            "float or None",
        ),
    }

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
    """Lapses of attention: stretches of time, the same in each run, without a response."""

    name = "lapses"
    title = "lapses of attention"
    place = "command"
    keeps_unit = True
    physics = "The input is not answered for seconds, as where an operator looks away."
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
    arguments = {
        "intervals": Argument(
            "Starts and ends, in seconds of time in the run; None finds them.",
            "list of (float, float) or None",
        ),
        "form": Argument(
            "Whether the command goes to zero, the gains on error and error rate vanish (which "
            "kicks at the ends, d/dt (K_edot e)), or the command holds its value; None tries all."
        ),
    }
    citation = "Hidden two-state process, Viterbi (1967)."
    examples = (
        {"form": "command", "depth": 0.9, "shift": 0.0, "intervals": [(20.0, 27.0), (50.0, 58.0)]},
        {"form": "gain", "depth": 0.9, "shift": 0.0, "intervals": [(20.0, 27.0), (50.0, 58.0)]},
        {"form": "hold", "depth": 0.9, "shift": 0.0, "intervals": [(4.6, 6.2)]},
    )
    hidden = examples[0]

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


def with_middle(effect: Any, record: Record) -> Any:
    """Refer an effect to the middle of the runs, unless it has a reference."""
    if effect.reference is not None:
        return effect
    return effect.with_choices(reference=float((record.t[0] + record.t[-1]).mean() / 2))
