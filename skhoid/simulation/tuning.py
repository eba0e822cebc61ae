"""``tune_remnant``: the remnant gain that gives a desired intensity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..exceptions import RemnantIntensityError
from ..human import HumanOperator
from ..human.variation import mix, transition_of
from .engine import RunOptions, entropy_of, simulate
from .task import CompensatoryTask

# Relative standard error of the gain above which realisations no longer determine it.
LARGEST_ERROR = 0.5
DOUBTFUL, MANY = 0.1, 400  # above this error, this many realisations decide
EVER = 1e9  # s: before and after any transition
STREAM = 1  # of random numbers, apart from those of the runs


def tune_remnant(
    task: CompensatoryTask,
    *,
    n_realisations: int = 10,
    random_state: Any = None,
    noise: Any = None,
    open_loop: bool = False,
    n_jobs: int | None = None,
    progress: bool = False,
) -> CompensatoryTask:
    """Find the remnant gain K_n that gives a desired intensity P_n.

    The mean of P_n = var(n) / var(u) in the measurement window, over realisations of the noise,
    equals ``task.remnant.intensity``. The loop is linear, so u is the sum of the response to the
    forcing functions and K_n times the response to the noise: each is simulated once, and K_n is
    the root of an explicit function. Where the operator's gains (or else the controlled element)
    follow a Sigmoid, Step or Ramp, K_n follows it too, between the gains for the parameters at its
    two ends, as in conditions C3-C6. Otherwise K_n is constant. Effects are left out.

    Parameters
    ----------
    task : CompensatoryTask
        With a ``remnant`` of given intensity.
    n_realisations : int, default=10
        Number of realisations; ten in the thesis.
    random_state : int, RandomState, Generator or None, default=None
        Source of the noise, which differs from that of runs simulated with the same seed.
    noise : array of shape (n_realisations, n_run_in + n_samples) or None, default=None
        White noise of unit variance instead.
    open_loop : bool, default=False
        Tune for runs in which the remnant does not go round the loop.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.
    progress : bool, default=False
        Show a progress bar.

    Returns
    -------
    task : CompensatoryTask
        The task with this gain in its remnant.

    Raises
    ------
    RemnantIntensityError
        If the loop cannot reach the intensity, or if the intensity is so close to the limit that
        the realisations do not determine the gain (standard error above 50 %).

    Examples
    --------
    >>> from skhoid import CompensatoryTask, Remnant, tune_remnant
    >>> task = CompensatoryTask.of_condition("C1", remnant=Remnant(order=2, intensity=0.15))
    >>> round(tune_remnant(task, random_state=0).remnant.gain, 3)
    0.016
    """
    remnant = task.remnant
    if isinstance(n_realisations, bool) or int(n_realisations) != n_realisations:
        raise ValueError(f"n_realisations must be a whole number; got {n_realisations!r}.")
    if n_realisations < 1 or (noise is not None and len(np.atleast_2d(noise)) != n_realisations):
        rows = "" if noise is None else f" and noise with {len(np.atleast_2d(noise))} rows"
        raise ValueError(
            f"tune_remnant needs at least one realisation, and noise with one row for each; got "
            f"n_realisations={n_realisations}{rows}."
        )
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
        progress=progress,
        stream=STREAM,
    )
    operator, element = task.operator, task.controlled_element
    gains = (
        (operator.K_e, operator.T_L, operator.K_edot) if isinstance(operator, HumanOperator) else ()
    )
    transition = transition_of(*gains, element.K_c, element.omega_b)
    gain: Any
    if remnant.intensity == 0:
        gain = 0.0
    elif transition is None:
        gain = _constant_gain(task, n_realisations, options)
    else:
        begin, end = (_constant_gain(task.at(t), n_realisations, options) for t in (-EVER, EVER))
        gain = mix(begin, end, transition)
    return replace(task, remnant=replace(remnant, intensity=None, gain=gain))


def _constant_gain(task: CompensatoryTask, n_realisations: int, options: RunOptions) -> float:
    assert task.remnant is not None
    wanted = task.remnant.intensity
    assert wanted is not None
    curve = _IntensityCurve.of(task, n_realisations, options)
    root = curve.solve(wanted)
    error = np.inf if root is None else curve.relative_error(root, n_realisations)
    if error > DOUBTFUL and options.noise is None:
        # A few realisations may not show how close the limit is.
        curve = _IntensityCurve.of(task, max(MANY, n_realisations), options)
        judged = curve.solve(wanted)
        error = np.inf if judged is None else curve.relative_error(judged, n_realisations)
    advice = (
        f"The remnant goes round the loop, so P_n tends to {curve.limit:.3f} as K_n grows "
        f"(mean of {curve.of_noise.size} realisations). Ask for less, or give the remnant a gain."
    )
    if root is None and wanted >= curve.limit:
        raise RemnantIntensityError(f"No gain gives P_n = {wanted}. {advice}")
    if root is None or error > LARGEST_ERROR:
        raise RemnantIntensityError(
            f"P_n = {wanted} is too close to what the loop can reach: {n_realisations} "
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

    def relative_error(self, log_gain: float, n_realisations: int) -> float:
        """Relative standard error of a gain found from this many realisations."""
        if self.of_noise.size < 2:
            return 0.0
        h = 1e-4
        slope = (self.intensities(log_gain + h) - self.intensities(log_gain - h)).mean() / (2 * h)
        spread = self.intensities(log_gain).std(ddof=1) / np.sqrt(n_realisations)
        return float(spread / slope) if slope > 0 else np.inf
