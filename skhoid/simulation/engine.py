"""Running the kernel of the loop: blocks of runs, noise, forcing functions, unstable loops."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np
from joblib import Parallel, delayed

from .. import _kernels
from .._machine import check_memory
from ..effects.composition import Effects
from ..exceptions import UnstableLoopError
from ..human.checks import as_floats
from ..human.variation import evaluate
from .forcing import Multisine
from .physics import ARXResponse, Delay, operator_response, physics_rows
from .tracking_record import TrackingRecord
from .with_effects import track_with_effects

if TYPE_CHECKING:
    from .task import CompensatoryTask

LOST = 1e2  # times the forcing functions: an error this large is not tracking
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
    progress: bool = False
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
    kept = _kept_run_in(task, options.keep_run_in)
    first = task.n_run_in - kept
    check_memory(
        5 * int(n_runs) * (n_total - first),  # error, output, x, remnant and target
        f"The simulation of {n_runs} runs of {n_total - first} samples",
    )
    given_noise = options.noise
    if given_noise is not None:
        given_noise = _given_noise(given_noise, int(n_runs), n_total)
    entropy = entropy_of(options.random_state)
    response, physics = operator_response(task), physics_rows(task)
    has_effects = len(Effects.of(task.effects)) > 0
    if task.is_constant and not has_effects:
        _check_stability(task, physics, response)
    filter_ = np.zeros(10) if remnant is None else remnant.filter_coefficients()
    drawn = options.random_phases
    forcing = {name: None if drawn else _forcing(task, name) for name in STREAMS}

    def block(runs: range) -> tuple[np.ndarray, ...]:
        if remnant is None:
            white = np.zeros((n_total, len(runs)))
        else:
            white = np.empty((n_total, len(runs)))
            scale = np.sqrt(rate)  # unit intensity: variance 1 / dt
            if given_noise is None:
                for column, run in enumerate(runs):
                    generator = _generator(entropy, options.stream, options.first_run + run)
                    _kernels.loop.draw(generator, scale, white, column)
            else:
                np.multiply(given_noise[runs.start : runs.stop].T, scale, out=white)
        f_t, f_d = (
            _drawn_forcing(task, name, entropy, runs, options.first_run)
            if shared is None
            else shared
            for name, shared in forcing.items()
        )
        compiled = _tracker(len(runs), filter_)

        def track(
            f_t: np.ndarray, f_d: np.ndarray, white: np.ndarray, rows: np.ndarray, begin: int = 0
        ) -> tuple[np.ndarray, np.ndarray]:
            return compiled(
                f_t,
                f_d,
                white,
                rows,
                physics[1],
                filter_,
                *response.arguments,
                1 / rate,
                0.0 if options.open_loop else 1.0,
                begin,
                np.inf if task.is_constant or has_effects else _bound(f_t, f_d),
            )

        if has_effects:
            out = track_with_effects(task, track, f_t, f_d, white, physics[0])[:, first:]
            lost = np.full(len(runs), -1)
        else:
            out, lost = track(f_t, f_d, white, physics[0], first)
        return out, lost, f_t[first:].T, f_d[first:].T

    many = _kernels.loop.MANY
    n_distinct = 1 if remnant is None and not drawn else int(n_runs)
    blocks = [range(i, min(i + many, n_distinct)) for i in range(0, n_distinct, many)]
    done: Any = map(block, blocks)
    if options.n_jobs not in (None, 1) and len(blocks) > 1:
        done = Parallel(n_jobs=options.n_jobs, prefer="threads", return_as="generator")(
            delayed(block)(runs) for runs in blocks
        )
    if options.progress:
        from rich.progress import track as track_progress

        done = track_progress(done, description="simulating", total=len(blocks), transient=True)
    signals = np.empty((4, n_distinct, n_total - first))
    targets, disturbances = [], []
    suspected = False
    for runs, (out, lost, f_t, f_d) in zip(blocks, done, strict=True):
        if (lost >= 0).any() and not suspected:
            suspected = True
            _check_growth(task, physics, response)
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


def _tracker(n_runs: int, remnant: np.ndarray) -> Any:
    """The kernel for a number of runs and a remnant filter."""
    lanes = 1 if n_runs == 1 else _kernels.loop.MANY
    return _kernels.loop.tracker(lanes, bool(remnant[8:].any()))


def _kept_run_in(task: CompensatoryTask, keep_run_in: Any) -> int:
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


def _bound(f_t: np.ndarray, f_d: np.ndarray) -> float:
    """The error above which a time-varying loop is suspected to be unstable."""
    forcing = max(np.abs(f_t).max(), 100 * np.abs(f_d).max())
    return float(LOST * forcing) or UNFORCED


def _generator(entropy: int, stream: int, run: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(stream, run)))


def _drawn_forcing(
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
    seeds = [int(_generator(entropy, STREAMS[name], i).integers(2**31)) for i in numbers]
    drawn = [given.with_random_phases(seed) for seed in seeds]
    return np.stack([f.sample(-task.n_run_in, n_total, task.sampling_rate) for f in drawn], axis=1)


def _forcing(task: CompensatoryTask, name: str) -> np.ndarray:
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


def _given_noise(noise: Any, n_runs: int, n_total: int) -> np.ndarray:
    noise = np.atleast_2d(as_floats(noise, "noise"))
    if noise.shape != (n_runs, n_total):
        raise ValueError(
            f"noise must have one row for each of {n_runs} runs and one column for each of "
            f"{n_total} "
            f"samples (run-in and window); got {noise.shape}."
        )
    if not np.isfinite(noise).all():
        run, k = np.argwhere(~np.isfinite(noise))[0]
        raise ValueError(f"noise is {noise[run, k]} in run {run}, sample {k}; it must be finite.")
    return noise


def _without_remnant(
    task: CompensatoryTask,
    physics: tuple[np.ndarray, int],
    response: Delay | ARXResponse,
    f_t: np.ndarray,
    f_d: np.ndarray,
    bound: float,
) -> tuple[np.ndarray, int]:
    """Error of a run without remnant, and roughly where it exceeds ``bound``, or -1."""
    silent = np.zeros(10)
    (e, *_), lost = _tracker(1, silent)(
        f_t,
        f_d,
        np.zeros_like(f_t),
        *physics,
        silent,
        *response.arguments,
        1 / task.sampling_rate,
        1.0,
        0,
        bound,
    )
    return np.abs(e[:, 0]), int(lost[0])


def _check_stability(
    task: CompensatoryTask, physics: tuple[np.ndarray, int], response: Delay | ARXResponse
) -> None:
    """Raise if the response of constant dynamics to a pulse of the target grows."""
    times = []
    for patience in (1, 10, 100):  # a slow loop responds first and decays later
        n_samples = round(patience * (60.0 + 40 * response.delay_time) * task.sampling_rate)
        pulse = np.zeros((n_samples, 1))
        pulse[0] = 1.0
        e, _ = _without_remnant(task, physics, response, pulse, np.zeros_like(pulse), np.inf)
        third = e.size // 3
        early, late = e[third : 2 * third].max(), e[2 * third :].max()
        if late <= max(early * (1 + 1e-6), 1e-9):  # not NaN
            return
        growing = third / task.sampling_rate
        times.append(growing / np.log(late / early) if np.isfinite(late) else 0.0)
        if not np.isfinite(late):
            break
    raise UnstableLoopError(
        f"The loop is unstable: its error grows by a factor e every {times[0]:.2g} s. {ADVICE}"
    )


def _check_growth(
    task: CompensatoryTask, physics: tuple[np.ndarray, int], response: Delay | ARXResponse
) -> None:
    """Raise if time-varying dynamics make the error large even without remnant."""
    f_t, f_d = (_forcing(task, name) for name in STREAMS)
    _, lost = _without_remnant(task, physics, response, f_t, f_d, _bound(f_t, f_d))
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
            "None; got "
            f"{random_state!r}."
        )
    return int(random_state)
