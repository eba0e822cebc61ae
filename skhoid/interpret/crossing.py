"""Crossover frequency and phase margin, of responses at lines and along a parameter path."""

from __future__ import annotations

import warnings
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT, HasMethods, checked
from ..human import ControlledElement
from ..human.checks import as_floats
from ..human.margins import phase_margin
from ..human.variation import evaluate
from .arx_responses import arx_response
from .channel import ARXChannel, is_arx

BLOCK = 2048  # instants at a time, for memory
N_HALVINGS = 40


def crossover_at_lines(
    omega: np.ndarray, response: np.ndarray, delay: float, interpolate: bool
) -> tuple[float, float]:
    """Crossover frequency (rad/s) and phase margin (deg) of one open loop at lines."""
    known = np.isfinite(response) & (response != 0)
    omega, response = omega[known], response[known]
    gain = np.log(np.abs(response))
    down = np.flatnonzero((gain[:-1] >= 0) & (gain[1:] < 0))
    if down.size == 0:
        return np.nan, np.nan
    pair = slice(down[-1], down[-1] + 2)
    omega, response, gain = omega[pair], response[pair], gain[pair]
    if not interpolate:
        nearest = np.argmin(np.abs(np.abs(response) - 1.0))
        return float(omega[nearest]), float(phase_margin(response[nearest]))
    part = gain[0] / (gain[0] - gain[1])
    at = omega[0] * (omega[1] / omega[0]) ** part
    # The delay's share of the phase is linear in omega and needs no interpolation.
    rest = response * np.exp(1j * omega * delay)
    turn = np.angle(rest[1] / rest[0])
    phase = np.angle(rest[0]) + part * turn - at * delay
    return float(at), float(phase_margin(np.exp(1j * phase)))


@checked(
    controlled_element=[HasMethods("frequency_response")],
    dt=DT,
    nk=[Integral, None],
    na=[Integral],
    delay=[Real],
    time=["array-like", None],
    omega=["array-like", None],
)
def crossover_path(
    theta: Any,
    controlled_element: ControlledElement,
    *,
    dt: float | None = None,
    nk: int | None = None,
    na: int = 2,
    delay: float = 0.0,
    time: Any = None,
    omega: Any = None,
) -> pd.DataFrame:
    """Crossover frequency and phase margin over time, from a path of ARX parameters.

    At every instant, the last downward crossing of one by H_OL = H_ARX(j omega; theta(t)) H_CE(j
    omega, t) is found on a grid and refined by bisection to rounding.

    Parameters
    ----------
    theta : array-like of shape (n_instants, n_params), or fitted ARX model
        [a_1 ... a_na, b_0 ... b_{nb-1}] of the operator at each instant. A model, alone or at the
        end of a pipeline or search, supplies its parameters over time (or its constant ones for
        each of ``time``) and the next four arguments.
    controlled_element : ControlledElement
        Evaluated at the same instants.
    dt : float or None, default=None
        Sampling time of the model in seconds; needed with an array.
    nk : int or None, default=None
        Input delay in samples; needed with an array.
    na : int, default=2
        Number of output lags.
    delay : float, default=0.0
        Further delay in seconds, such as that of a :class:`~skhoid.DelayShift`.
    time : array-like of shape (n_instants,) or None, default=None
        Instants in seconds. None means 0, dt, 2 dt ...
    omega : array-like of shape (n_lines,) or None, default=None
        Grid in rad/s on which crossings are searched. None means 160 frequencies, evenly spaced on
        a log scale, from 0.1 rad/s to Nyquist. Two crossings between neighbouring frequencies are
        missed.

    Returns
    -------
    path : DataFrame with the columns ``omega_c`` (rad/s) and ``phase_margin`` (deg)
        Its index is ``time``. NaN where the open loop does not cross one, with a warning, and
        where ``theta`` is NaN.

    Examples
    --------
    >>> from skhoid import ControlledElement, Sigmoid
    >>> from skhoid import crossover_path
    >>> theta = [[-1.91212, 0.92427, 0.04428, -0.04318]] * 2
    >>> element = ControlledElement(K_c=Sigmoid(90, 60, rate=0.5, time=40.96), omega_b=6.0)
    >>> crossover_path(theta, element, dt=0.01, nk=29, time=[0.0, 81.92]).round(2)
           omega_c  phase_margin
    time
    0.00      1.57         75.94
    81.92     0.96         82.65
    """
    if is_arx(theta):
        arx = ARXChannel.of(theta, None, "crossover_path")
        dt, nk, na, delay = arx.dt, arx.nk, arx.na, arx.shift
        time = arx.time if arx.time is not None else [0.0] if time is None else time
        theta = np.broadcast_to(arx.theta, (len(time), arx.theta.shape[-1]))
    if dt is None or nk is None:
        raise ValueError("An array of parameters needs dt (s) and nk (samples) of its model.")
    theta = as_floats(theta, "theta")
    if theta.ndim != 2:
        raise ValueError(f"theta must have the shape (n_instants, n_params); got {theta.shape}.")
    instants = dt * np.arange(len(theta)) if time is None else as_floats(time, "time")
    if instants.shape != (len(theta),):
        raise ValueError(
            f"time holds {instants.size} instants but theta {len(theta)}; give one time per "
            "instant."
        )
    if omega is None:
        grid = np.geomspace(min(0.1, 0.01 * np.pi / dt), np.pi / dt, 160)
    else:
        grid = as_floats(omega, "omega")
        if grid.ndim != 1 or grid.size < 2 or not np.all(np.isfinite(grid) & (grid > 0)):
            raise ValueError("omega must be a grid of at least two frequencies in rad/s, above 0.")
    K_c = evaluate(controlled_element.K_c, instants)
    omega_b = evaluate(controlled_element.omega_b, instants)

    def open_loop(w: np.ndarray, rows: slice | np.ndarray) -> np.ndarray:
        s = 1j * w
        element = K_c[rows, None] / (s * (s + omega_b[rows, None]))
        return arx_response(theta[rows], w, dt, na=na, nk=nk, delay=delay) * element

    omega_c = np.full(len(theta), np.nan)
    for begin in range(0, len(theta), BLOCK):
        gain = np.abs(open_loop(grid, slice(begin, begin + BLOCK)))
        down = (gain[:, :-1] >= 1) & (gain[:, 1:] < 1)
        found = np.flatnonzero(down.any(axis=1))
        last = down.shape[1] - 1 - np.argmax(down[found, ::-1], axis=1)
        low, high = grid[last], grid[last + 1]
        for _ in range(N_HALVINGS):
            middle = np.sqrt(low * high)
            above = np.abs(open_loop(middle[:, None], begin + found)[:, 0]) >= 1
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        omega_c[begin + found] = low
    crosses = np.flatnonzero(~np.isnan(omega_c))
    margin = np.full(len(theta), np.nan)
    margin[crosses] = phase_margin(open_loop(omega_c[crosses, None], crosses)[:, 0])
    lost = np.isnan(omega_c) & np.isfinite(theta).all(axis=1)
    warn_no_crossover(int(lost.sum()), len(theta), "instants")
    return pd.DataFrame(
        {"omega_c": omega_c, "phase_margin": margin}, index=pd.Index(instants, name="time")
    )


def warn_no_crossover(n_lost: int, n_all: int, what: str) -> None:
    if n_lost:
        warnings.warn(
            f"{n_lost} of {n_all} {what} have no crossover: the open loop does not fall from "
            "above 1 to below it at the frequencies given. Crossover and margin are NaN there.",
            UserWarning,
            stacklevel=3,
        )
