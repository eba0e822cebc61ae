"""The compensatory (or pursuit) tracking loop (Fig. 1), simulated as the thesis does (App. D)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np

from .._machine import check_memory
from ..effects.composition import Effects
from ..human import ControlledElement, HumanOperator
from ..human.checks import check_positive
from ..human.operator import PURSUIT
from ..human.variation import Parameter
from ..interpret.channel import is_arx
from .conditions import Condition, tracking_condition
from .engine import RunOptions, simulate
from .forcing import Multisine, Samples
from .physics import DISPLAYS, operator_response, parameters_of, physics_rows
from .remnant import Remnant
from .tracking_record import TrackingRecord
from .with_effects import RUN_IN, check_effects

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
        function of time for a display that changes within the run.
    duration : float, default=81.92
        Measurement window in s; a fraction of a sample at its end is left out.
    run_in : float or None, default=None
        Time simulated before the window, in s, for transients to die out; None means seven windows,
        as in the thesis, or 20 s with ``effects``.
    sampling_rate : float, default=100.0
        Rate of samples and of integration steps, in Hz.
    transport : {"held", "interpolated"} or None, default=None
        How the delay is realised: as whole samples, held over the step (App. D), or by linear
        interpolation between samples (App. A). None holds delays of whole samples and interpolates
        others.
    effects : Effect, Effects, list of these or None, default=None
        What the operator does beyond its linear dynamics, with numbers for all parameters; see
        :mod:`skhoid.effects`. Remnant is added after them. Choices left open, such as the form,
        take their first option.

    Raises
    ------
    ValueError
        If the sampling is too slow for the physics, the delay is longer than the run, or a function
        of time gives negative or non-finite physics.

    See Also
    --------
    make_tracking_runs : Simulate the runs of a task as a dataset.

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

        Returns
        -------
        task : CompensatoryTask
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
        return not any(callable(p) for p in parameters_of(self).values())

    def at(self, t: float) -> CompensatoryTask:
        """The task with its parameters at one instant.

        Parameters
        ----------
        t : float
            Time in s; 0 is the beginning of the measurement window.

        Returns
        -------
        task : CompensatoryTask
            Remnant and display are unchanged.
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
        progress: bool = False,
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
        progress : bool, default=False
            Show a progress bar.

        Returns
        -------
        record : TrackingRecord

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
            progress=progress,
        )
        return simulate(self, n_runs, options)
