"""The simulated loop: rows of physics for the kernel, effects in the loop, blocks of runs.

The operator's response to a known error moves the error only after the delay. So a loop with
effects is closed stretch by stretch: response and error are computed in turn until neither changes,
which takes a few sweeps for a stretch of a few delays. In this way effects are simulated by their
own ``apply``, including those of users.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np
from joblib import Parallel, delayed

from .. import _kernels
from .._machine import check_memory
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.operator_signals import Gains
from ..effects.record import Record
from ..exceptions import UnstableLoopError
from ..human import HumanOperator, LinearElement
from ..human.operator import PURSUIT
from ..human.variation import as_floats, evaluate, find_span
from ..interpret.arx_channel import ARXChannel
from ..model.cores import OperatorCore
from ..model.simulator import Simulator
from ..pipelines import taken_apart
from ..preprocessing.base import as_fitted
from ..runs.roles import role_of
from .conditions import OMEGA_NM
from .forcing import Multisine

if TYPE_CHECKING:
    from .task import CompensatoryTask

DISPLAYS = {"compensatory": 0.0, "pursuit": 1.0}
# Largest step times fastest rate: the neuromuscular mode then has 12 samples a period.
COARSEST = 0.52
SIGNED = set(PURSUIT)


@dataclass(frozen=True)
class Delay:
    """A delay of the operator's output: whole samples, and weights for the fraction of one."""

    samples: int
    weights: np.ndarray
    delay_time: float

    @classmethod
    def of(cls, task: CompensatoryTask) -> Delay:
        tau, rate = task.operator.tau_e, task.sampling_rate
        exact = tau * rate
        if exact >= task.n_samples:
            raise ValueError(
                f"CompensatoryTask: the delay tau_e = {tau} s is longer than the run of "
                f"{task.n_samples / rate:g} s."
            )
        whole = abs(exact - round(exact)) <= 1e-6
        held = task.transport == "held" or (task.transport is None and whole)
        if held and not whole:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is {exact:g} samples at {rate:g} Hz; a held "
                "delay must be a whole number of samples. Use transport='interpolated', or "
                "another rate."
            )
        samples = round(exact) if whole else int(exact)
        part = 0.0 if whole else exact - samples
        if held:
            return cls(samples, np.tile([0.0, 1.0, 0.0], (3, 1)), tau)
        if samples < 1:
            raise ValueError(
                f"CompensatoryTask: tau_e = {tau} s is less than one sample at {rate:g} Hz, too "
                "short to interpolate. Use a higher sampling rate, or transport='held'."
            )
        if part <= 0.5:
            middle = [0.0, 0.5 + part, 0.5 - part]
        else:
            middle = [part - 0.5, 1.5 - part, 0.0]
        return cls(samples, np.array([[part, 1 - part, 0.0], middle, [0.0, part, 1 - part]]), tau)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.samples, self.weights, np.zeros(0), 0, 0


@dataclass(frozen=True)
class ARXResponse:
    """A fitted ARX model as the operator."""

    coefficients: np.ndarray
    na: int
    nk: int
    delay_time: float

    @classmethod
    def of(cls, task: CompensatoryTask) -> ARXResponse:
        _, model = taken_apart(task.operator)
        inputs, intercept = getattr(model, "inputs_", ["e"]), getattr(model, "intercept_", 0.0)
        named = getattr(model, "column_names", None) is not None
        role = role_of(inputs[0], getattr(as_fitted(model), "roles", None))
        if len(inputs) != 1 or intercept or (named and role != "e"):
            raise ValueError(
                f"A model in the loop responds to the error e alone, without intercept; this one "
                f"has the inputs {inputs} and the intercept {intercept:g}. Fit one with "
                "inputs=['e']."
            )
        if task.display != "compensatory" or task.transport is not None:
            raise ValueError(
                "display and transport are those of a HumanOperator; the operator is a "
                f"{type(model).__name__}, which has its own delay and sees only e."
            )
        channel = ARXChannel.of(task.operator, None, "CompensatoryTask(operator=...)")
        if channel.time is not None:
            raise ValueError(
                "The model's parameters vary over time; only constant models can be put into the "
                "loop."
            )
        dt = 1 / task.sampling_rate
        if abs(channel.dt_recording - channel.dt) > 1e-6 * dt:
            raise ValueError(
                f"The model was fitted to decimated recordings (dt = {channel.dt:g} s, of "
                f"{channel.dt_recording:g} s); fit it without the Decimator for the loop."
            )
        if abs(channel.dt - dt) > 1e-6 * dt:
            raise ValueError(
                f"The model runs at dt = {channel.dt:g} s and the loop at {dt:g} s. Fit it at the "
                f"rate of the loop, or use sampling_rate={1 / channel.dt:g}."
            )
        nk = channel.nk + round(channel.shift / dt)
        return cls(_kernels.gate(channel.theta), channel.na, nk, nk * dt)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return 0, np.zeros((3, 3)), self.coefficients, self.na, self.nk


def operator_response(task: CompensatoryTask) -> Delay | ARXResponse:
    """How the operator's output arises."""
    return Delay.of(task) if isinstance(task.operator, HumanOperator) else ARXResponse.of(task)


def read_parameters(task: CompensatoryTask) -> dict[str, Any]:
    """Numbers and functions of time on which the loop depends."""
    element, remnant = task.controlled_element, task.remnant
    display = DISPLAYS[task.display] if isinstance(task.display, str) else task.display
    parameters: dict[str, Any] = {"K_c": element.K_c, "omega_b": element.omega_b}
    parameters["K_n"] = 0.0 if remnant is None or remnant.gain is None else remnant.gain
    if isinstance(task.operator, HumanOperator):
        parameters |= task.operator.adaptable | {"display": display}
    return parameters


def physics_rows(task: CompensatoryTask) -> tuple[np.ndarray, int]:
    """Rows of physics every half step while something varies, and the sample where they begin.

    See ``_kernels.loop``.
    """
    parameters = read_parameters(task)
    n_steps = task.n_run_in + task.n_samples
    varies = np.array(find_span(*parameters.values())) * task.sampling_rate + task.n_run_in
    if varies[0] > varies[1]:  # never
        varies = np.zeros(2)
    # One more sample on each side, for parameters that jump between two.
    begin = int(np.clip(np.floor(varies[0]) - 1, 0, n_steps))
    end = int(np.clip(np.ceil(varies[1]) + 1, begin, n_steps))
    half_steps = np.arange(1 if task.is_constant else 2 * (end - begin) + 1)
    t = (half_steps / 2 + begin - task.n_run_in) / task.sampling_rate
    # Constants stay scalars, which broadcast.
    p = {name: _check_values(name, value, t) for name, value in parameters.items()}
    _check_rate(task, p)
    rows = np.zeros((t.size, _kernels.loop.N_PHYSICS))
    rows[:, 6], rows[:, 7], rows[:, 8] = p["K_c"], p["omega_b"], p["K_n"]
    if isinstance(task.operator, HumanOperator):
        K_e = p["K_e"]
        K_edot = p["K_edot"] if "K_edot" in p else K_e * p["T_L"]
        stiffness, shown = p["omega_nm"] ** 2, p["display"]
        rows[:, 0] = 2 * p["zeta_nm"] * p["omega_nm"]
        rows[:, 1] = stiffness
        rows[:, 2] = stiffness * (K_e + shown * p["K_t"])
        rows[:, 3] = stiffness * (K_edot + shown * p["K_tdot"])
        rows[:, 4] = stiffness * (shown * p["K_x"] - K_e)
        rows[:, 5] = stiffness * (shown * p["K_xdot"] - K_edot)
    return rows, begin


def _check_values(name: str, parameter: Any, t: np.ndarray) -> Any:
    if not callable(parameter):
        return float(parameter)
    values = evaluate(parameter, t)
    wrong = ~np.isfinite(values)
    if name not in SIGNED:
        wrong |= values <= 0 if name in ("omega_nm", "zeta_nm") else values < 0
    if name == "display":
        wrong |= values > 1
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        what = "finite" if name in SIGNED else "finite and positive"
        what += ", at most 1" if name == "display" else ""
        raise ValueError(
            f"CompensatoryTask: {name} is {values[i]:g} at t = {t[i]:g} s (0 is the beginning of "
            f"the measurement window); it must be {what}, in the run-in too."
        )
    return values


def _check_rate(task: CompensatoryTask, p: dict[str, Any]) -> None:
    """Refuse a step too long for the fastest mode."""
    modes = {"controlled element (omega_b)": np.max(p["omega_b"])}
    if isinstance(task.operator, HumanOperator):
        zeta = np.asarray(p["zeta_nm"])
        fastest = p["omega_nm"] * (zeta + np.sqrt(np.maximum(zeta**2 - 1, 0)))
        speed = np.where(zeta > 1, fastest, p["omega_nm"])
        modes["neuromuscular mode (omega_nm, zeta_nm)"] = speed.max()
    if (remnant := task.remnant) is not None:
        is_nm = isinstance(remnant.order, str)
        modes["remnant filter"] = OMEGA_NM if is_nm else 1 / remnant.time_constant
    what = max(modes, key=lambda name: modes[name])
    if modes[what] > COARSEST * task.sampling_rate:
        raise ValueError(
            f"CompensatoryTask: {task.sampling_rate:g} Hz is too slow for the {what} of "
            f"{modes[what]:.4g} rad/s. Use sampling_rate={np.ceil(modes[what] / COARSEST):g} Hz or "
            "more."
        )


SILENT = np.zeros(10)  # remnant filter


@dataclass(frozen=True)
class CompiledLoop:
    """The loop of a task as the kernel takes it."""

    rows: np.ndarray
    begin: int
    response: Delay | ARXResponse
    dt: float

    @classmethod
    def of(cls, task: CompensatoryTask) -> CompiledLoop:
        return cls(*physics_rows(task), operator_response(task), 1 / task.sampling_rate)

    def run(
        self,
        f_t: np.ndarray,
        f_d: np.ndarray,
        white: np.ndarray,
        *,
        rows: np.ndarray | None = None,
        remnant: np.ndarray = SILENT,
        closed: bool = True,
        first: int = 0,
        bound: float = np.inf,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Signals e, u, x, n (4, n, n_runs) from sample ``first``, and where e passes ``bound``."""
        return _kernels.loop.tracker(bool(remnant[8:].any()))(
            f_t,
            f_d,
            white,
            self.rows if rows is None else rows,
            self.begin,
            remnant,
            *self.response.arguments,
            self.dt,
            float(closed),
            first,
            bound,
        )


RUN_IN = 20.0  # s; the default of seven windows is for loops with little damping
STRETCH = 2.0  # delays
SHORTEST = 0.1  # s, of a stretch
AHEAD = 3.0  # s of the forcing functions that a preview may ask for
SWEEPS = 100
SAME = 1e-9  # of the forcing functions
LOST = 1e2  # times the forcing functions: an error this large is not tracking
OPERATOR_GAINS = range(2, 6)  # columns of the physics, see _kernels.loop


class _Operator(Effect):
    """The gains of a HumanOperator, which may vary over time, as factors on gains of 1."""

    name = "operator"
    place = "gain"

    def __init__(self, *, operator: HumanOperator):
        self.operator = operator

    def apply(self, signal: Gains, record: Record, **values: float) -> Gains:
        given = self.operator.over_time(record.t[:, 0])
        error, rate, omega, zeta = (
            given[name][:, None] for name in ("K_e", "K_edot", "omega_nm", "zeta_nm")
        )
        return Gains(error, rate, omega, zeta)


def check_effects(task: CompensatoryTask) -> None:
    """Refuse effects without numbers, and operators that cannot have effects."""
    effects = Effects.of(task.effects)
    if not isinstance(task.operator, HumanOperator):
        raise ValueError(
            "CompensatoryTask: effects need a HumanOperator; the operator is a "
            f"{type(task.operator).__name__}."
        )
    if task.display != "compensatory":
        raise ValueError(
            "CompensatoryTask: with effects the display must be 'compensatory'; the effects "
            "feedforward and output_feedback respond to target and output."
        )
    for name, effect in effects:
        if effect.noise:
            raise ValueError(
                f"CompensatoryTask: {effect.name} is noise; add {effect.noise} of your own to y."
            )
        if effect.free:
            raise _find_unnumbered(name, effect)


def _find_unnumbered(name: str, effect: Effect) -> ValueError:
    missing = ", ".join(f"{p.name}=" for p in effect.free)
    return ValueError(
        f"CompensatoryTask: the effect {name} needs numbers to be simulated: "
        f"{type(effect).__name__}({missing})."
    )


def choose_first(task: CompensatoryTask, channels: dict[str, np.ndarray], t: np.ndarray) -> Effects:
    """The effects with open choices (form, channel) made: the first whose numbers are all given."""
    window = t[:, 0] > -0.5 / task.sampling_rate
    record = _make_record(task, {n: c[window] for n, c in channels.items()}, t[window])
    steps = []
    for name, effect in Effects.of(task.effects):
        reason = effect.refusal(record, OperatorCore(task.operator.tau_e).kind)
        if reason is not None:
            raise ValueError(f"CompensatoryTask: the effect {name} does not apply: {reason}.")
        variants = effect.variants(record)
        known = [variant for variant in variants if not variant.free]
        if not known:
            raise _find_unnumbered(name, variants[0])
        steps.append((name, known[0]))
    return Effects(steps)


def track_effects(
    task: CompensatoryTask,
    track: Callable[..., tuple[np.ndarray, np.ndarray]],
    f_t: np.ndarray,
    f_d: np.ndarray,
    white: np.ndarray,
    silent: np.ndarray,
) -> np.ndarray:
    """Signals e, u, x, n of runs of a task with effects, of shape (4, n_total, n_runs).

    ``track`` runs the loop; ``silent`` are its rows of physics without the operator.
    """
    n_total, dt = white.shape[0], 1 / task.sampling_rate
    t = (np.arange(-task.n_run_in, task.n_samples) * dt)[:, None]
    out = track(f_t, f_d, white)[0]
    channels = {"e": out[0], "x": out[2], "f_t": np.broadcast_to(f_t, out[0].shape)}
    if f_d.any():
        channels["dist"] = np.broadcast_to(f_d, out[0].shape)
    effects = Effects([("operator", _Operator(operator=task.operator))])
    effects = Effects([*effects.steps, *choose_first(task, channels, t).steps])
    core, ones = OperatorCore(task.operator.tau_e), np.ones(4)

    answer = np.zeros(out[0].shape)
    size = max(np.abs(f_t).max(), np.abs(f_d).max()) or 1.0
    step = max(round(STRETCH * task.operator.tau_e / dt), round(SHORTEST / dt), 1)
    for end in [*range(step, n_total, step), n_total]:
        shown = min(end + round(AHEAD / dt), n_total)
        for _ in range(SWEEPS):
            record = _make_record(task, {n: c[:shown] for n, c in channels.items()}, t[:shown])
            new = Simulator(core, effects, record).run(ones)[:end]
            change = np.abs(new - answer[:end]).max()
            answer[:end] = new
            moved = answer[:end] + (f_d[:end] if f_d.shape[1] > 1 else f_d[:end, :1])
            out = track(f_t[:end], moved, white[:end], rows=silent)[0]
            channels["e"][:end], channels["x"][:end] = out[0], out[2]
            if not change > SAME * size:
                break
        else:
            raise ValueError(
                f"The loop with the effects {effects.names[1:]} cannot be solved at "
                f"t = {t[end - 1, 0]:.2f} s: they respond without delay to signals that they move."
            )
        if not np.abs(out[0]).max() < LOST * size:
            raise UnstableLoopError(
                f"The loop with the effects {effects.names[1:]} is unstable: its error passes "
                f"{LOST:g} times the forcing functions by t = {t[end - 1, 0]:.2f} s."
            )
    out[1] += answer
    return out


def _make_record(task: CompensatoryTask, channels: dict[str, np.ndarray], t: np.ndarray) -> Record:
    element = task.controlled_element
    K_c, omega_b = (float(evaluate(p, np.zeros(1))[0]) for p in (element.K_c, element.omega_b))
    return Record(
        dt=1 / task.sampling_rate,
        t=t,
        channels=channels,
        roles={name: name for name in channels},
        inputs=("e",),
        known=np.ones(channels["e"].shape, dtype=bool),
        controlled_element=LinearElement((K_c,), (1.0, omega_b, 0.0)),
    )


@dataclass(frozen=True, eq=False)
class TrackingRecord:
    """Signals of simulated runs.

    Parameters
    ----------
    time : ndarray of shape (n_samples,)
        Time in s; 0 is the beginning of the measurement window.
    e, u, x, n : ndarray of shape (n_runs, n_samples)
        Error, control output, output of the controlled element, and remnant (in u).
    f_t, f_d : ndarray of shape (1 or n_runs, n_samples)
        Target, and disturbance at the input of the controlled element.

    Examples
    --------
    >>> from skhoid import CompensatoryTask
    >>> record = CompensatoryTask.of_condition("C1").simulate()
    >>> record.score().round(4)
    array([0.1778])
    """

    time: np.ndarray
    e: np.ndarray
    u: np.ndarray
    x: np.ndarray
    n: np.ndarray
    f_t: np.ndarray
    f_d: np.ndarray

    @property
    def u_without_remnant(self) -> np.ndarray:
        """The operator's response u - n, of shape (n_runs, n_samples)."""
        return self.u - self.n

    def intensity(self) -> np.ndarray:
        """Remnant intensity P_n = var(n) / var(u) of each run (Eq. 5.11), in the window."""
        window = self.time >= 0
        return self.n[:, window].var(axis=1) / self.u[:, window].var(axis=1)

    def score(self) -> np.ndarray:
        """Performance score var(e) / var(f_t) of each run, in the window."""
        window = self.time >= 0
        return self.e[:, window].var(axis=1) / self.f_t[:, window].var(axis=1)


UNFORCED = 1e9  # the same where remnant alone drives the loop
ADVICE = (
    "Lower the operator's gain (K_e) or its delay, give it more lead (T_L), or shorten the time "
    "during which its gains do not suit the controlled element."
)
STREAMS = {"target": 2, "disturbance": 3}  # of random numbers; 0 is the runs' noise, 1 tuning


@dataclass(frozen=True)
class RunOptions:
    """Which runs of a task, and how; see :meth:`CompensatoryTask.simulate`.

    ``stream`` keeps noise for different uses apart; runs are those from number ``first_run`` on.
    """

    random_state: Any = None
    noise: Any = None
    random_phases: bool = False
    open_loop: bool = False
    keep_run_in: float = 0.0
    n_jobs: int | None = None
    stream: int = 0
    first_run: int = 0


def simulate(task: CompensatoryTask, n_runs: Any, options: RunOptions) -> TrackingRecord:
    """Simulate runs; a run is the same whenever its number and the random state are."""
    if isinstance(n_runs, bool) or not isinstance(n_runs, Integral) or n_runs < 1:
        raise ValueError(f"n_runs must be a whole number, at least 1; got {n_runs!r}.")
    n_total, rate, remnant = task.n_run_in + task.n_samples, task.sampling_rate, task.remnant
    if remnant is not None and remnant.gain is None:
        raise ValueError(
            f"The gain of {remnant!r} is not known yet: tune_remnant(task) returns the task with "
            "the gain for this intensity."
        )
    kept = _count_run_in(task, options.keep_run_in)
    first = task.n_run_in - kept
    check_memory(
        5 * int(n_runs) * (n_total - first),  # error, output, x, remnant and target
        f"The simulation of {n_runs} runs of {n_total - first} samples",
    )
    given_noise = options.noise
    if given_noise is not None:
        given_noise = _read_noise(given_noise, int(n_runs), n_total)
    entropy = entropy_of(options.random_state)
    loop = CompiledLoop.of(task)
    has_effects = len(Effects.of(task.effects)) > 0
    if task.is_constant and not has_effects:
        _check_stability(loop)
    filter_ = SILENT if remnant is None else remnant.filter_coefficients()
    track = partial(loop.run, remnant=filter_, closed=not options.open_loop)
    silent = loop.rows.copy()
    silent[:, OPERATOR_GAINS] = 0.0
    drawn = options.random_phases
    forcing = {name: None if drawn else _sample_forcing(task, name) for name in STREAMS}

    def block(runs: range) -> tuple[np.ndarray, ...]:
        if remnant is None:
            white = np.zeros((n_total, len(runs)))
        else:
            white = np.empty((n_total, len(runs)))
            scale = np.sqrt(rate)  # unit intensity: variance 1 / dt
            if given_noise is None:
                for column, run in enumerate(runs):
                    generator = _make_generator(entropy, options.stream, options.first_run + run)
                    _kernels.loop.draw(generator, scale, white, column)
            else:
                np.multiply(given_noise[runs.start : runs.stop].T, scale, out=white)
        f_t, f_d = (
            _draw_forcing(task, name, entropy, runs, options.first_run)
            if shared is None
            else shared
            for name, shared in forcing.items()
        )
        if has_effects:
            out = track_effects(task, track, f_t, f_d, white, silent)[:, first:]
            lost = np.full(len(runs), -1)
        else:
            bound = np.inf if task.is_constant else _choose_bound(f_t, f_d)
            out, lost = track(f_t, f_d, white, first=first, bound=bound)
        return out, lost, f_t[first:].T, f_d[first:].T

    many = _kernels.loop.MANY
    n_distinct = 1 if remnant is None and not drawn else int(n_runs)
    blocks = [range(i, min(i + many, n_distinct)) for i in range(0, n_distinct, many)]
    done: Any = map(block, blocks)
    if options.n_jobs not in (None, 1) and len(blocks) > 1:
        done = Parallel(n_jobs=options.n_jobs, prefer="threads", return_as="generator")(
            delayed(block)(runs) for runs in blocks
        )
    signals = np.empty((4, n_distinct, n_total - first))
    targets, disturbances = [], []
    suspected = False
    for runs, (out, lost, f_t, f_d) in zip(blocks, done, strict=True):
        if (lost >= 0).any() and not suspected:
            suspected = True
            _check_growth(task, loop)
        if not np.isfinite(out[:, -1]).all():
            raise UnstableLoopError(f"The loop is unstable: its signals overflow. {ADVICE}")
        signals[:, runs.start : runs.stop] = out.transpose(0, 2, 1)
        targets.append(f_t)
        disturbances.append(f_d)
    time = np.arange(-kept, task.n_samples) / rate
    n_drawn = len(blocks) if drawn else 1
    f_t, f_d = np.concatenate(targets[:n_drawn]), np.concatenate(disturbances[:n_drawn])
    if n_distinct != n_runs:
        signals = np.repeat(signals, int(n_runs), axis=1)
    e, u, x, n = signals
    return TrackingRecord(time=time, e=e, u=u, x=x, n=n, f_t=f_t, f_d=f_d)


def _count_run_in(task: CompensatoryTask, keep_run_in: Any) -> int:
    """Number of samples of the run-in that are returned."""
    rate = task.sampling_rate
    known = isinstance(keep_run_in, Real) and np.isfinite(float(keep_run_in))
    kept = round(keep_run_in * rate) if known else -1
    if not 0 <= kept <= task.n_run_in:
        raise ValueError(
            f"keep_run_in must lie between 0 and the run-in of {task.n_run_in / rate:g} s; got "
            f"{keep_run_in!r}."
        )
    return kept


def _choose_bound(f_t: np.ndarray, f_d: np.ndarray) -> float:
    """The error above which a time-varying loop is suspected to be unstable."""
    forcing = max(np.abs(f_t).max(), 100 * np.abs(f_d).max())
    return float(LOST * forcing) or UNFORCED


def _make_generator(entropy: int, stream: int, run: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(stream, run)))


def _draw_forcing(
    task: CompensatoryTask, name: str, entropy: int, runs: range, first_run: int
) -> np.ndarray:
    """A forcing function with phases of its own in each run, of shape (n_total, n_runs)."""
    given = getattr(task, name)
    n_total = task.n_run_in + task.n_samples
    if given is None:
        return np.zeros((n_total, len(runs)))
    if not isinstance(given, Multisine):
        raise ValueError(
            f"random_phases=True draws the phases of a Multisine, but the {name} is "
            f"{type(given).__name__}."
        )
    numbers = [first_run + run for run in runs]
    seeds = [int(_make_generator(entropy, STREAMS[name], i).integers(2**31)) for i in numbers]
    drawn = [given.with_random_phases(seed) for seed in seeds]
    return np.stack([f.sample(-task.n_run_in, n_total, task.sampling_rate) for f in drawn], axis=1)


def _sample_forcing(task: CompensatoryTask, name: str) -> np.ndarray:
    """A forcing function on the whole grid, of shape (n_total, 1)."""
    given = getattr(task, name)
    n_total = task.n_run_in + task.n_samples
    if given is None:
        return np.zeros((n_total, 1))
    if isinstance(given, Multisine):
        f = given.sample(-task.n_run_in, n_total, task.sampling_rate)
    elif callable(given) or np.isscalar(given):
        f = evaluate(given, np.arange(-task.n_run_in, task.n_samples) / task.sampling_rate)
    else:
        f = given.values
    if f.shape != (n_total,):
        raise ValueError(
            f"The {name} must have {n_total} samples ({task.n_run_in} in the run-in and "
            f"{task.n_samples} in the window); got an array of shape {f.shape}."
        )
    if not np.isfinite(f).all():
        k = int(np.flatnonzero(~np.isfinite(f))[0])
        t = (k - task.n_run_in) / task.sampling_rate
        raise ValueError(f"The {name} is {f[k]} at t = {t:g} s; it must be finite.")
    return _kernels.gate(f[:, None])


def _read_noise(noise: Any, n_runs: int, n_total: int) -> np.ndarray:
    noise = np.atleast_2d(as_floats(noise, "noise"))
    if noise.shape != (n_runs, n_total):
        raise ValueError(
            f"noise must have the shape ({n_runs}, {n_total}), runs and samples with the run-in; "
            f"got {noise.shape}."
        )
    return noise


def _check_stability(loop: CompiledLoop) -> None:
    """Raise if the response of constant dynamics to a pulse of the target grows."""
    times = []
    for patience in (1, 10, 100):  # a slow loop responds first and decays later
        n_samples = round(patience * (60.0 + 40 * loop.response.delay_time) / loop.dt)
        pulse, nothing = np.zeros((2, n_samples, 1))
        pulse[0] = 1.0
        e = np.abs(loop.run(pulse, nothing, nothing)[0][0, :, 0])
        third = e.size // 3
        early, late = e[third : 2 * third].max(), e[2 * third :].max()
        if late <= max(early * (1 + 1e-6), 1e-9):  # not NaN
            return
        growing = third * loop.dt
        times.append(growing / np.log(late / early) if np.isfinite(late) else 0.0)
        if not np.isfinite(late):
            break
    raise UnstableLoopError(
        f"The loop is unstable: its error grows by a factor e every {times[0]:.2g} s. {ADVICE}"
    )


def _check_growth(task: CompensatoryTask, loop: CompiledLoop) -> None:
    """Raise if time-varying dynamics make the error large even without remnant."""
    f_t, f_d = (_sample_forcing(task, name) for name in STREAMS)
    bound = _choose_bound(f_t, f_d)
    lost = int(loop.run(f_t, f_d, np.zeros_like(f_t), bound=bound)[1][0])
    if lost >= 0:
        t = (lost - task.n_run_in) / task.sampling_rate
        raise UnstableLoopError(
            f"The loop is unstable: without remnant its error passes {LOST:g} times the target by "
            f"t = {t:.2f} s (0 is the beginning of the measurement window). {ADVICE}"
        )
    if not (f_t.any() or f_d.any()):
        raise UnstableLoopError(f"The loop is unstable under remnant alone. {ADVICE}")


def entropy_of(random_state: Any) -> int:
    """One number that seeds everything; the same for the same ``random_state``."""
    if random_state is None:
        entropy = np.random.SeedSequence().entropy
        assert isinstance(entropy, int)
        return entropy
    if isinstance(random_state, np.random.Generator):
        return int(random_state.integers(2**32))
    if isinstance(random_state, np.random.RandomState):
        return int(random_state.randint(2**31))
    if isinstance(random_state, bool) or not isinstance(random_state, Integral) or random_state < 0:
        raise ValueError(
            "random_state must be a non-negative whole number, a RandomState, a Generator or "
            f"None; got {random_state!r}."
        )
    return int(random_state)
