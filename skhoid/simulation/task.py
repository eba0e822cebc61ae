"""The compensatory (or pursuit) tracking loop (Fig. 1), simulated as the thesis does (App. D)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
from scipy.optimize import brentq

from .._machine import check_memory
from ..effects.composition import Effects
from ..exceptions import RemnantIntensityError
from ..human import ControlledElement, HumanOperator
from ..human.operator import PURSUIT
from ..human.variation import Parameter, check_positive, evaluate, find_transition, mix
from ..interpret.arx_channel import is_arx
from .conditions import Condition, Remnant, tracking_condition
from .engine import (
    DISPLAYS,
    RUN_IN,
    RunOptions,
    TrackingRecord,
    check_effects,
    entropy_of,
    operator_response,
    physics_rows,
    read_parameters,
    simulate,
)
from .forcing import Multisine, Samples

RUN_IN_WINDOWS = 7
MOST_SAMPLES = 1e15


@dataclass(frozen=True, kw_only=True)
class CompensatoryTask:
    """The closed loop of Fig. 1: a person steers a controlled element.

    e = f_t - x; the operator responds to e with u; remnant adds to u; the controlled element
    responds to u + f_d with x. Integrated by fourth-order Runge-Kutta at the sampling rate, with
    forcing functions and white noise held over the step (Apps. A and D).

    Parameters
    ----------
    controlled_element : ControlledElement, default: state 1 of Table II
        What is controlled.
    operator : HumanOperator, or fitted ARXRegressor or Pipeline, default: state 1 of Table II
        Who controls it: physics, or a model fitted at this sampling rate with the input ``e``.
    remnant : Remnant or None, default=None
        Noise in u. If only its intensity is given, :func:`tune_remnant` must find the gain first.
    target : Multisine, callable or array of shape (n_samples,), default: Multisine()
        f_t. A function takes an array of times (s); an array covers run-in and window.
    disturbance : Multisine, callable, array or None, default=None
        f_d, added to u at the input of the controlled element.
    display : {"compensatory", "pursuit"}, float or callable, default="compensatory"
        What share of the operator's gains on target and output is in use: none (0), all (1), or a
        function of time.
    duration : float, default=81.92
        Measurement window in s; a fraction of a sample at its end is left out.
    run_in : float or None, default=None
        Time simulated before the window, in s; None means seven windows, as in the thesis, or 20 s
        with ``effects``.
    sampling_rate : float, default=100.0
        Rate of samples and of integration steps, in Hz.
    transport : {"held", "interpolated"} or None, default=None
        How the delay is realised: as whole samples, held over the step (App. D), or by linear
        interpolation between samples (App. A). None holds delays of whole samples and interpolates
        others.
    effects : Effect, Effects, list of these or None, default=None
        What the operator does beyond its linear dynamics, with numbers for all parameters; see
        :mod:`skhoid.effects`. Remnant is added after them. Of choices left open, such as the form,
        the first is taken.

    Examples
    --------
    >>> from skhoid import CompensatoryTask, ControlledElement, HumanOperator, Remnant
    >>> task = CompensatoryTask(
    ...     controlled_element=ControlledElement(K_c=30.0, omega_b=0.2),
    ...     operator=HumanOperator(K_e=0.07, T_L=1.2),
    ...     remnant=Remnant(order=2, gain=0.039),
    ... )
    >>> record = task.simulate(n_runs=3, random_state=0)
    >>> record.u.shape, record.intensity().round(2)
    ((3, 8192), array([0.15, 0.17, 0.14]))
    """

    controlled_element: ControlledElement = field(default_factory=ControlledElement)
    operator: Any = field(default_factory=HumanOperator)
    remnant: Remnant | None = None
    target: Any = field(default_factory=Multisine)
    disturbance: Any = None
    display: str | Parameter = "compensatory"
    duration: float = 81.92
    run_in: float | None = None
    sampling_rate: float = 100.0
    transport: str | None = None
    effects: Any = None

    def __post_init__(self) -> None:
        check_positive(self, "duration", "sampling_rate")
        if self.run_in is not None:
            check_positive(self, "run_in", zero=True)
        if not callable(self.display):
            if isinstance(self.display, str) and self.display not in DISPLAYS:
                raise ValueError(
                    f"CompensatoryTask: display must be 'compensatory', 'pursuit', a number from "
                    f"0 to 1 or a function of time; got {self.display!r}."
                )
            if not isinstance(self.display, str):
                check_positive(self, "display", zero=True)
                if self.display > 1:
                    raise ValueError(
                        f"CompensatoryTask: display must be at most 1 (pursuit); got "
                        f"{self.display!r}."
                    )
        if self.transport not in (None, "held", "interpolated"):
            raise ValueError(
                "CompensatoryTask: transport must be 'held', 'interpolated' or None; got "
                f"{self.transport!r}."
            )
        if not (self.duration + (self.run_in or 0.0)) * self.sampling_rate < MOST_SAMPLES:
            raise ValueError(
                f"CompensatoryTask: {self.duration:g} s at {self.sampling_rate:g} Hz, with the "
                "run-in, are more samples than any machine can hold."
            )
        check_memory(
            6 * (self.n_run_in + self.n_samples),
            f"A run of {self.duration:g} s at {self.sampling_rate:g} Hz, with the run-in,",
        )
        if self.n_samples < 2:
            raise ValueError(
                f"CompensatoryTask: {self.duration} s at {self.sampling_rate} Hz are fewer than "
                "two samples."
            )
        self._check_parts()
        if self.is_constant:
            physics_rows(self)
        operator_response(self)

    def _check_parts(self) -> None:
        if not isinstance(self.controlled_element, ControlledElement):
            raise TypeError(
                "CompensatoryTask: controlled_element must be a ControlledElement; got "
                f"{self.controlled_element!r}."
            )
        if not isinstance(self.remnant, (Remnant, type(None))):
            raise TypeError(f"CompensatoryTask: remnant must be a Remnant; got {self.remnant!r}.")
        for name in ("target", "disturbance"):
            given = getattr(self, name)
            if isinstance(given, (np.ndarray, list, tuple)):
                object.__setattr__(self, name, Samples(given))
            elif not (callable(given) or given is None or isinstance(given, (Samples, Real))):
                raise TypeError(
                    f"CompensatoryTask: {name} must be a Multisine, a function of time, an "
                    f"array, a number or None; got {given!r}."
                )
        if len(Effects.of(self.effects)):
            check_effects(self)
        if not isinstance(self.operator, HumanOperator):
            if not is_arx(self.operator):
                raise TypeError(
                    f"CompensatoryTask: operator must be a HumanOperator, or a fitted ARX model "
                    f"(or a pipeline or search that ends in one); got "
                    f"{type(self.operator).__name__}."
                )
            return
        gains = [getattr(self.operator, name) for name in PURSUIT]
        if self.display == "pursuit" and not any(callable(gain) or gain for gain in gains):
            raise ValueError(
                "CompensatoryTask: a pursuit display shows target and output, but the operator "
                "has no gains on them: give it K_t, K_tdot, K_x or K_xdot."
            )

    @classmethod
    def of_condition(cls, condition: str | Condition, **options: Any) -> CompensatoryTask:
        """The task for a condition.

        Parameters
        ----------
        condition : str or Condition
            ``"C1"`` to ``"C6"`` of the thesis, or one of your own.
        **options
            Any other parameters of the task.
        """
        if not isinstance(condition, Condition):
            condition = tracking_condition(condition)
        options.setdefault("controlled_element", condition.controlled_element)
        options.setdefault("operator", condition.operator)
        return cls(**options)

    @property
    def n_samples(self) -> int:
        """Number of samples in the window."""
        return int(self.duration * self.sampling_rate + 1e-6)

    @property
    def n_run_in(self) -> int:
        """Number of samples before the window."""
        if self.run_in is None and len(Effects.of(self.effects)):
            return round(RUN_IN * self.sampling_rate)
        if self.run_in is None:
            return RUN_IN_WINDOWS * self.n_samples
        return round(self.run_in * self.sampling_rate)

    @property
    def is_constant(self) -> bool:
        """Whether no parameter varies over time."""
        return not any(callable(p) for p in read_parameters(self).values())

    def at(self, t: float) -> CompensatoryTask:
        """The task with its parameters at one instant; remnant and display are unchanged.

        Parameters
        ----------
        t : float
            Time in s; 0 is the beginning of the measurement window.
        """
        physics = isinstance(self.operator, HumanOperator)
        return replace(
            self,
            controlled_element=self.controlled_element.at(t),
            operator=self.operator.at(t) if physics else self.operator,
        )

    def simulate(
        self,
        n_runs: int = 1,
        *,
        random_state: Any = None,
        noise: Any = None,
        random_phases: bool = False,
        open_loop: bool = False,
        keep_run_in: float = 0.0,
        n_jobs: int | None = None,
    ) -> TrackingRecord:
        """Simulate runs.

        Parameters
        ----------
        n_runs : int, default=1
            Number of runs; they differ in noise and, with ``random_phases``, in phases.
        random_state : int, RandomState, Generator or None, default=None
            Source of noise and phases. Run i is the same however many runs there are.
        noise : array of shape (n_runs, n_run_in + n_samples) or None, default=None
            White noise of unit variance for the remnant filter, instead of ``random_state``.
        random_phases : bool, default=False
            Draw new phases of target and disturbance for each run; both must be multisines.
        open_loop : bool, default=False
            Eq. G.1: the remnant is added to u, but does not go round the loop.
        keep_run_in : float, default=0.0
            Also return this much of the run-in, in s, at negative time.
        n_jobs : int or None, default=None
            Number of threads, as in joblib.

        Raises
        ------
        UnstableLoopError
            If the loop is unstable.
        """
        options = RunOptions(
            random_state=random_state,
            noise=noise,
            random_phases=random_phases,
            open_loop=open_loop,
            keep_run_in=keep_run_in,
            n_jobs=n_jobs,
        )
        return simulate(self, n_runs, options)


SHARES = (0.05, 0.5, 0.95)  # of the change
NOTHING = 1e-9  # of relative steps, summed


def change_times(task: CompensatoryTask) -> tuple[float, float, float] | None:
    """Seconds after which 5, 50 and 95 % of the change are done; None if nothing changes.

    The change is the way of all parameters, but for the gain of the remnant: the sum of their steps
    relative to their largest values.
    """
    t = np.arange(task.n_samples + 1) / task.sampling_rate
    travelled = np.zeros(task.n_samples)
    for name, parameter in read_parameters(task).items():
        if callable(parameter) and name != "K_n":
            values = evaluate(parameter, t)
            travelled += np.abs(np.diff(values)) / (np.abs(values).max() or 1.0)
    so_far = np.cumsum(travelled)
    if so_far[-1] <= NOTHING:
        return None
    early, middle, late = (float(t[np.searchsorted(so_far, s * so_far[-1])]) for s in SHARES)
    return early, middle, late


N_REALISATIONS = 10  # as in the thesis
# Relative standard error of the gain above which realisations no longer determine it.
LARGEST_ERROR = 0.5
DOUBTFUL, MANY = 0.1, 400  # above this error, this many realisations decide
EVER = 1e9  # s: before and after any transition
STREAM = 1  # of random numbers, apart from those of the runs


def tune_remnant(
    task: CompensatoryTask,
    *,
    random_state: Any = None,
    noise: Any = None,
    open_loop: bool = False,
    n_jobs: int | None = None,
) -> CompensatoryTask:
    """Find the remnant gain K_n that gives a desired intensity P_n.

    The mean of P_n = var(n) / var(u) in the measurement window, over ten realisations of the noise,
    equals ``task.remnant.intensity``. The loop is linear (effects are left out), so u is the sum of
    the responses to the forcing functions and to K_n times the noise: each is simulated once, and
    K_n is the root of an explicit function. Where the operator's gains (or else the controlled
    element) follow a Sigmoid, Step or Ramp, K_n follows it too, between the gains for the
    parameters at its two ends, as in conditions C3-C6.

    Parameters
    ----------
    task : CompensatoryTask
        With a ``remnant`` of given intensity.
    random_state : int, RandomState, Generator or None, default=None
        Source of the noise, which differs from that of runs simulated with the same seed.
    noise : array of shape (10, n_run_in + n_samples) or None, default=None
        White noise of unit variance instead.
    open_loop : bool, default=False
        Tune for runs in which the remnant does not go round the loop.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.

    Returns
    -------
    task : CompensatoryTask
        The task with this gain in its remnant.

    Raises
    ------
    RemnantIntensityError
        If the loop cannot reach the intensity, or only so nearly that the realisations do not
        determine the gain (standard error above 50 %).

    Examples
    --------
    >>> from skhoid import CompensatoryTask, Remnant, tune_remnant
    >>> task = CompensatoryTask.of_condition("C1", remnant=Remnant(order=2, intensity=0.15))
    >>> round(tune_remnant(task, random_state=0).remnant.gain, 3)
    0.016
    """
    remnant = task.remnant
    if remnant is None or remnant.intensity is None:
        raise ValueError(
            f"tune_remnant needs a task whose remnant has an intensity, such as "
            f"Remnant(intensity=0.15); got {remnant!r}."
        )
    options = RunOptions(
        random_state=entropy_of(random_state),
        noise=noise,
        open_loop=open_loop,
        n_jobs=n_jobs,
        stream=STREAM,
    )
    operator, element = task.operator, task.controlled_element
    gains = (
        (operator.K_e, operator.T_L, operator.K_edot) if isinstance(operator, HumanOperator) else ()
    )
    transition = find_transition(*gains, element.K_c, element.omega_b)
    gain: Any
    if remnant.intensity == 0:
        gain = 0.0
    elif transition is None:
        gain = _tune_constant(task, options)
    else:
        begin, end = (_tune_constant(task.at(t), options) for t in (-EVER, EVER))
        gain = mix(begin, end, transition)
    return replace(task, remnant=replace(remnant, intensity=None, gain=gain))


def _tune_constant(task: CompensatoryTask, options: RunOptions) -> float:
    assert task.remnant is not None
    wanted = task.remnant.intensity
    assert wanted is not None
    curve = _IntensityCurve.of(task, N_REALISATIONS, options)
    root = curve.solve(wanted)
    error = np.inf if root is None else curve.relative_error(root)
    if error > DOUBTFUL and options.noise is None:
        # A few realisations may not show how close the limit is.
        curve = _IntensityCurve.of(task, MANY, options)
        judged = curve.solve(wanted)
        error = np.inf if judged is None else curve.relative_error(judged)
    advice = (
        f"The remnant goes round the loop, so P_n tends to {curve.limit:.3f} as K_n grows "
        f"(mean of {curve.of_noise.size} realisations). Ask for less, or give the remnant a gain."
    )
    if root is None and wanted >= curve.limit:
        raise RemnantIntensityError(f"No gain gives P_n = {wanted}. {advice}")
    if root is None or error > LARGEST_ERROR:
        raise RemnantIntensityError(
            f"P_n = {wanted} is too close to what the loop can reach: {N_REALISATIONS} "
            f"realisations do not determine its gain. {advice}"
        )
    return float(np.exp(root))


@dataclass(frozen=True)
class _IntensityCurve:
    """P_n of each realisation as a function of the gain."""

    of_forcing: float
    of_both: np.ndarray
    of_noise: np.ndarray
    of_remnant: np.ndarray

    @classmethod
    def of(
        cls, task: CompensatoryTask, n_realisations: int, options: RunOptions
    ) -> _IntensityCurve:
        task = replace(task, run_in=task.n_run_in / task.sampling_rate, effects=None)  # is linear
        assert task.remnant is not None
        forced = simulate(replace(task, remnant=None), 1, RunOptions())
        unit = replace(task.remnant, intensity=None, gain=1.0)
        alone = replace(task, remnant=unit, target=None, disturbance=None)
        noise = simulate(alone, n_realisations, options)
        u_f = forced.u - forced.u.mean()
        u_n = noise.u - noise.u.mean(axis=1, keepdims=True)
        if not u_f.any():
            raise RemnantIntensityError(
                "Without forcing functions P_n does not depend on the gain: give the task a "
                "target, or the remnant a gain."
            )
        return cls(
            float((u_f**2).mean()),
            (u_f * u_n).mean(axis=1),
            (u_n**2).mean(axis=1),
            noise.n.var(axis=1),
        )

    @property
    def limit(self) -> float:
        return float((self.of_remnant / self.of_noise).mean())

    def intensities(self, log_gain: Any) -> np.ndarray:
        K = np.exp(np.asarray(log_gain))[..., None]
        both = self.of_forcing + 2 * K * self.of_both + K**2 * self.of_noise
        return K**2 * self.of_remnant / both

    def solve(self, wanted: float) -> float | None:
        """Logarithm of the smallest gain with mean intensity ``wanted``; None if there is none."""
        middle = 0.5 * np.log(self.of_forcing / self.of_remnant.mean())
        grid = middle + np.linspace(-12, 12, 481)
        above = np.flatnonzero(self.intensities(grid).mean(axis=-1) > wanted)
        if above.size == 0 or above[0] == 0:
            return None
        around = grid[above[0] - 1], grid[above[0]]
        return brentq(lambda g: self.intensities(g).mean() - wanted, *around, xtol=1e-13)

    def relative_error(self, log_gain: float) -> float:
        """Relative standard error of a gain found from N_REALISATIONS."""
        h = 1e-4
        slope = (self.intensities(log_gain + h) - self.intensities(log_gain - h)).mean() / (2 * h)
        spread = self.intensities(log_gain).std(ddof=1) / np.sqrt(N_REALISATIONS)
        return float(spread / slope) if slope > 0 else np.inf
