"""The remnant gain that gives a wanted intensity."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..exceptions import RemnantIntensityError
from ..human import HumanOperator
from ..human.variation import mix, transition_of
from .engine import entropy_of, simulate
from .loop import CompensatoryTask

# Relative standard error of the gain above which realisations no longer determine it.
LARGEST_ERROR = 0.5
STREAM = 1  # of random numbers, apart from those of the runs


def tune_remnant(
    task: CompensatoryTask,
    *,
    n_realisations: int = 10,
    random_state: Any = None,
    noise: Any = None,
    n_jobs: int | None = None,
    progress: bool = False,
) -> CompensatoryTask:
    """Find the remnant gain K_n that gives the intensity P_n wanted.

    The mean of P_n = var(n) / var(u) in the measurement window, over realisations of the noise,
    equals ``task.remnant.intensity``. The loop is linear, so u is the sum of the answer to the
    forcing functions and K_n times the answer to the noise: each is simulated once, and the root is
    that of an explicit function of K_n. Where parameters follow one transition, K_n follows it
    too, between the gains for the parameters at its two ends, as in conditions C3-C6.

    Parameters
    ----------
    task : CompensatoryTask
        With a ``remnant`` of given intensity.
    n_realisations : int, default=10
        Number of realisations; ten in the thesis.
    random_state : int, RandomState, Generator or None, default=None
        Source of the noise, different from that of runs simulated with the same number.
    noise : array of shape (n_realisations, n_run_in + n_samples) or None, default=None
        White noise of unit variance instead.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.
    progress : bool, default=False
        Show a progress bar.

    Returns
    -------
    task : CompensatoryTask
        The task whose remnant has this gain.

    Raises
    ------
    RemnantIntensityError
        If the loop cannot reach the intensity, or if it comes so close to its limit that the
        realisations do not determine the gain (standard error above 50 %).

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
            "tune_remnant needs a task whose remnant has a wanted intensity: "
            f"Remnant(intensity=0.15), say; got {remnant!r}."
        )
    options = {
        "random_state": entropy_of(random_state),
        "noise": noise,
        "n_jobs": n_jobs,
        "progress": progress,
    }
    operator, element = task.operator, task.controlled_element
    gains = (
        (operator.K_e, operator.T_L, operator.K_edot) if isinstance(operator, HumanOperator) else ()
    )
    transition = transition_of(element.K_c, element.omega_b, *gains)
    gain: Any
    if remnant.intensity == 0:
        gain = 0.0
    elif transition is None:
        gain = _constant_gain(task, n_realisations, options)
    else:
        ends = (-task.n_run_in / task.sampling_rate, task.duration)
        begin, end = (_constant_gain(task.at(t), n_realisations, options) for t in ends)
        gain = mix(begin, end, transition)
    return replace(task, remnant=replace(remnant, intensity=None, gain=gain))


def _constant_gain(task: CompensatoryTask, n_realisations: int, options: dict[str, Any]) -> float:
    assert task.remnant is not None
    wanted = task.remnant.intensity
    forced = simulate(replace(task, remnant=None), 1)
    alone = replace(
        task,
        remnant=replace(task.remnant, intensity=None, gain=1.0),
        target=None,
        disturbance=None,
    )
    noise = simulate(alone, n_realisations, stream=STREAM, **options)
    u_f = forced.u - forced.u.mean()
    u_n = noise.u - noise.u.mean(axis=1, keepdims=True)
    of_forcing, of_both = (u_f**2).mean(), (u_f * u_n).mean(axis=1)
    of_noise, of_remnant = (u_n**2).mean(axis=1), noise.n.var(axis=1)
    if of_forcing == 0:
        raise RemnantIntensityError(
            "Without forcing functions P_n does not depend on the gain: give the task a target, "
            "or the remnant a gain."
        )

    def intensities(log_gain: Any) -> np.ndarray:
        K = np.exp(np.asarray(log_gain))[..., None]
        return K**2 * of_remnant / (of_forcing + 2 * K * of_both + K**2 * of_noise)

    scale = 0.5 * np.log(of_forcing / of_remnant.mean())
    grid = scale + np.linspace(-12, 12, 481)
    excess = intensities(grid).mean(axis=-1) - wanted
    limit = (of_remnant / of_noise).mean()
    above = np.flatnonzero(excess > 0)
    advice = (
        f"The remnant goes round the loop, so that P_n tends to {limit:.3f} as K_n grows "
        f"(mean of {n_realisations} realisations). Ask for less, or give the remnant a gain."
    )
    if above.size == 0 or above[0] == 0:
        raise RemnantIntensityError(f"No gain gives P_n = {wanted}. {advice}")
    i = above[0]
    root = brentq(lambda g: intensities(g).mean() - wanted, grid[i - 1], grid[i], xtol=1e-13)
    slope = (intensities(root + 1e-4).mean() - intensities(root - 1e-4).mean()) / 2e-4
    spread = intensities(root).std(ddof=1) if n_realisations > 1 else 0.0
    error = spread / np.sqrt(n_realisations) / slope if slope > 0 else np.inf
    if error > LARGEST_ERROR:
        raise RemnantIntensityError(
            f"P_n = {wanted} is too close to what the loop can reach: {n_realisations} "
            f"realisations give K_n = {np.exp(root):.3g} with a standard error of "
            f"{100 * error:.0f} %. {advice}"
        )
    return float(np.exp(root))
