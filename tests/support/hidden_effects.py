"""Runs of the thesis's closed loop with effects hidden in the operator, and their truth.

The scheme is that of ``closed_loop.py``, with which it agrees where no effect is on, and like it
shares no code with the package except the remnant gains of Table G.1.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numba import njit
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import Bunch
from support.closed_loop import (
    AMPLITUDES,
    MULTIPLES,
    OMEGA_NM,
    PERIOD,
    PHASES,
    STATES,
    T_N,
    TAU_E,
    ZETA_NM,
)

from skhoid import Remnant

INTENSITIES = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)  # of Table G.1
TRANSITIONS = {  # Table III: states before and after 40.96 s, and the rate (1/s) between them
    "C1": ("C1", "C1", 1.0),
    "C2": ("C2", "C2", 1.0),
    "C3": ("C1", "C2", 0.5),
    "C4": ("C1", "C2", 100.0),
    "C5": ("C2", "C1", 0.5),
    "C6": ("C2", "C1", 100.0),
}
# A disturbance at the stick: lines of its own, each about 1.2 times one of the target's.
MULTIPLES_D = np.array([4, 6, 10, 16, 27, 41, 64, 103, 167, 275])


@dataclass(frozen=True)
class Effects:
    """What the operator does beyond the linear response; everything off by default.

    Times are in s from the beginning of the window. What acts on the error comes before the
    neuromuscular filter, gains and lapses before the delay; saturation, rate limit and steps of
    the output are those of the stick and act on the remnant too.
    """

    gain_step: tuple | None = None  # (time, factor) of K_e and K_e T_L
    gain_sigmoid: tuple | None = None  # (time, factor, rate in 1/s)
    gain_of_run: tuple | None = None  # a factor for each run
    delay_change: tuple | None = None  # (time, seconds more)
    lapses: tuple | None = None  # (number per run, duration in s): no response
    lapses_repeat: bool = False  # at the same instants in all runs
    dead_zone: float = 0.0  # deg of e
    asymmetry: float = 0.0  # gain 1 + a for e > 0, 1 - a for e < 0
    cubic: float = 0.0  # e + c e^3
    feedforward: tuple | None = None  # (K_f, delay in s) on the rate of f_t, filtered
    bias: float = 0.0  # deg of u
    drift: float = 0.0  # deg of u over the window
    saturation: float = np.inf  # |u| at most
    rate_limit: float = np.inf  # |du/dt| at most, deg/s
    quantum: float = 0.0  # deg of u


NO_EFFECTS = Effects()


def simulate_runs(
    condition="C1",
    n_runs=5,
    *,
    effects=NO_EFFECTS,
    intensity=0.15,
    order=2,
    remnant_gain=None,
    seed=0,
    sampling_rate=100.0,
    oversampling=1,
    duration=PERIOD,
    run_in=PERIOD,
    targets=None,
    disturbance=0.0,
    first_run=1,
    multiples=MULTIPLES,
):
    """Simulate runs; the same seed gives the same runs, and the same noise whatever the effects.

    ``remnant_gain`` replaces the gain of Table G.1 for ``intensity``, which between the table's
    own is interpolated. ``targets`` has a number for each run: 0 is the target of Table I, any
    other number a realisation of its own phases; None is 0 for all. ``disturbance`` (deg) is the
    rms of f_d at the stick, the same in all runs. ``multiples`` of 2 pi / PERIOD are the target's
    frequencies; numbers that are not whole make it non-periodic.

    Returns X (e, x, f_t and, where there is one, dist), y (u), and truth: ``n`` (u less
    ``u_without_remnant``), ``u_without_remnant`` (the exact operator driven by the e of the run),
    ``linear_response`` (the same without effects), ``ceiling`` (percent, 100 (1 - sum n^2 /
    sum u^2)), ``intensity`` (var(n) / var(u)), ``remnant_gain`` (K_n over time), ``remnant_order``.

    Where the stick itself is limited (saturation, rate limit, quantum), remnant and response pass
    it together, and the mean answer is not the answer to the mean: a model can then do better
    than ``u_without_remnant``, and ``ceiling`` is a lower bound.
    """
    rate = sampling_rate * oversampling
    dt = 1 / rate
    n_total = round((run_in + duration) * rate)
    n_before = n_total - round(duration * rate)
    t = (np.arange(n_total) - n_before) * dt
    targets = (0,) * n_runs if targets is None else tuple(targets)
    half = t[0] + np.arange(2 * n_total + 1) * dt / 2  # where Runge-Kutta asks for parameters
    K_n = _remnant_gain(condition, intensity, order, half) if remnant_gain is None else remnant_gain
    K_n = np.broadcast_to(np.asarray(K_n, dtype=float), half.shape)
    physical = _physics(condition, half)
    f_d = _disturbance(disturbance, t)
    delay = np.full(n_total, round(TAU_E * rate))
    if effects.delay_change is not None:
        at, more = effects.delay_change
        delay[t >= at - dt / 2] += round(more * rate)
    K_f, tau_f = effects.feedforward or (0.0, 0.0)
    inner = np.array(
        [effects.dead_zone, effects.asymmetry, effects.cubic, K_f, round(tau_f * rate)]
    )
    outer = np.array([effects.saturation, effects.rate_limit * dt, effects.quantum])
    physics = (OMEGA_NM, ZETA_NM, T_N)
    offset = effects.bias + effects.drift * np.clip(t / duration, 0, 1)

    tables = []
    for i in range(n_runs):
        white = np.random.default_rng([seed, i]).standard_normal(n_total) / np.sqrt(dt)
        f_t = target(t, targets[i], multiples)
        gain = _gain(effects, half, duration, seed, i)
        over_time = np.ascontiguousarray(np.stack([*physical, gain, K_n], axis=1))
        out = _run(f_t, f_d, white, over_time, delay, offset, physics, order, inner, outer, dt)
        if not np.isfinite(out).all() or np.abs(out[0]).max() > 100 * np.abs(f_t).max():
            raise ArithmeticError(f"The loop of run {i} is unstable: {condition}, {effects}.")
        kept = np.vstack([out, f_t, f_d])[:, n_before::oversampling]
        time = np.round(np.arange(kept.shape[1]) / sampling_rate, 9)
        index = pd.MultiIndex.from_arrays(
            [np.full(time.size, first_run + i), time], names=["run", "time"]
        )
        names = ["e", "x", "u", "u_without_remnant", "linear_response", "f_t", "dist"]
        tables.append(pd.DataFrame(kept.T, index=index, columns=names))
    table = pd.concat(tables)
    X = table[["e", "x", "f_t", *(["dist"] if disturbance else [])]].copy()
    y = table["u"].copy()
    n = (y - table["u_without_remnant"]).rename("n")
    truth = Bunch(
        n=n,
        u_without_remnant=table["u_without_remnant"].copy(),
        linear_response=table["linear_response"].copy(),
        ceiling=100 * (1 - np.sum(n**2) / np.sum(y**2)),
        intensity=np.var(n) / np.var(y),
        remnant_gain=K_n[2 * n_before : -1 : 2 * oversampling].copy(),
        remnant_order=order,
    )
    return X, y, truth


def remnant_psd(truth, omega):
    """Density of the remnant by Eq. 27 in deg^2 s/rad, of positive frequencies only."""
    gain = np.mean(truth.remnant_gain**2)
    return gain / np.abs(1j * T_N * np.asarray(omega) + 1) ** (2 * truth.remnant_order) / np.pi


def gap_sampling_error(truth, y, n_runs):
    """Standard deviation of the gap in VAF points where nothing is missing.

    With the noise power from the deviations between runs that share the target, the gap is the
    mean product of residuals of different runs, 100 / (R (R - 1)) sum_{i != j} <n_i n_j> / <u^2>.
    Each of its R (R - 1) / 2 products has the variance 1 / T int C(tau)^2 dtau, which is
    pi / T int psd(omega)^2 domega over positive frequencies (Parseval), and in time goes with the
    fourth power of the gain.
    """
    omega = np.linspace(0, 1000.0, 20001)
    varying = np.mean(truth.remnant_gain**4) / np.mean(truth.remnant_gain**2) ** 2
    product = varying * np.pi / PERIOD * np.trapezoid(remnant_psd(truth, omega) ** 2, omega)
    return 100 * np.sqrt(2 / (n_runs * (n_runs - 1)) * product) / np.mean(y**2)


def target(t, realisation=0, multiples=MULTIPLES):
    """Table I, with other phases for a realisation other than 0."""
    phases = PHASES
    if realisation:
        phases = np.random.default_rng(realisation).uniform(-np.pi, np.pi, PHASES.size)
    return np.sin(np.multiply.outer(t, 2 * np.pi * multiples / PERIOD) + phases) @ AMPLITUDES


def _disturbance(rms, t):
    """Ten sines whose amplitudes are to each other as the target's are."""
    if not rms:
        return np.zeros_like(t)
    amplitudes = AMPLITUDES * rms / np.sqrt(np.sum(AMPLITUDES**2) / 2)
    phases = np.random.default_rng(1).uniform(-np.pi, np.pi, amplitudes.size)
    return np.sin(np.multiply.outer(t, 2 * np.pi * MULTIPLES_D / PERIOD) + phases) @ amplitudes


def _progress(t, rate, time):
    return 1 / (1 + np.exp(-np.clip(rate * (t - time), -500, 500)))


def _physics(condition, t):
    """K_c, omega_b, K_e and K_e T_L over time (Eq. 3.7)."""
    first, second, rate = TRANSITIONS[condition]
    progress = _progress(t, rate, PERIOD / 2)
    values = []
    for state in (first, second):
        K_c, omega_b, K_e, T_L = STATES[state]
        values.append((K_c, omega_b, K_e, K_e * T_L))
    return [a + (b - a) * progress for a, b in zip(*values, strict=True)]


def _remnant_gain(condition, intensity, order, t):
    """Table G.1; between its columns K_n^2 is linear."""
    if not intensity:
        return np.zeros_like(t)
    first, second, rate = TRANSITIONS[condition]
    gains = []
    for state in (first, second):
        known = [Remnant.from_table(state, P_n, order).gain ** 2 for P_n in INTENSITIES]
        gains.append(np.sqrt(np.interp(intensity, (0.0, *INTENSITIES), (0.0, *known))))
    return gains[0] + (gains[1] - gains[0]) * _progress(t, rate, PERIOD / 2)


def _gain(effects, t, duration, seed, run):
    gain = np.ones_like(t)
    little = (t[1] - t[0]) / 2
    if effects.gain_step is not None:
        at, factor = effects.gain_step
        gain[t >= at - little] *= factor
    if effects.gain_sigmoid is not None:
        at, factor, rate = effects.gain_sigmoid
        gain *= 1 + (factor - 1) * _progress(t, rate, at)
    if effects.gain_of_run is not None:
        gain *= effects.gain_of_run[run]
    if effects.lapses is not None:
        number, length = effects.lapses
        rng = np.random.default_rng([seed, 0 if effects.lapses_repeat else run, 1])
        for begin in rng.uniform(0, duration - length, number):
            gain[(t >= begin) & (t < begin + length)] = 0.0
    return gain


@njit(cache=True)
def _perceived(e, inner):
    """The error behind the static effects."""
    if inner[0] > 0:
        e = np.sign(e) * max(abs(e) - inner[0], 0.0)
    if inner[1] != 0:
        e *= 1 + inner[1] if e > 0 else 1 - inner[1]
    if inner[2] != 0:
        e += inner[2] * e**3
    return e


@njit(cache=True)
def _stick(u, before, outer):
    """The stick's stop, the limit of its rate and its steps; ``before`` is its last position."""
    level, move, quantum = outer
    u = min(max(u, before - move), before + move)
    if quantum > 0:
        u = quantum * np.round(u / quantum)
    return min(max(u, -level), level)


@njit(cache=True)
def _muscle(dz, z, i, force, physics):
    """The neuromuscular filter whose position and rate are z[i] and z[i + 1]."""
    omega_nm, zeta_nm, _ = physics
    dz[i] = z[i + 1]
    dz[i + 1] = omega_nm**2 * (force - z[i]) - 2 * zeta_nm * omega_nm * z[i + 1]


@njit(cache=True)
def _derivative(dz, z, f, operator, f_d, white, held, now, physics, inner, level):
    """z: controlled element; pairs of neuromuscular filters (gain and lead at their inputs) of the
    operator and of the one without effects; the filter of f_t; the remnant's lags. A stick that is
    ``held`` keeps ``operator``."""
    K_c, omega_b, K_e, K_edot, gain, K_n = now
    e = f - z[0]
    u = operator if held else min(max(operator + z[-1], -level), level)
    dz[0] = z[1]
    dz[1] = K_c * (u + f_d) - omega_b * z[1]
    seen = gain * _perceived(e, inner)
    _muscle(dz, z, 2, K_e * seen, physics)
    _muscle(dz, z, 4, K_edot * seen, physics)
    _muscle(dz, z, 6, K_e * e, physics)
    _muscle(dz, z, 8, K_edot * e, physics)
    _muscle(dz, z, 10, f, physics)
    source = K_n * white
    for i in range(12, len(z)):
        dz[i] = (source - z[i]) / physics[2]
        source = z[i]


@njit(cache=True)
def _run(f_t, f_d, white, over_time, delay, offset, physics, order, inner, outer, dt):
    """Rows e, x, u, u without remnant, and the linear response to e.

    ``over_time`` has a row for every half step: K_c, omega_b, K_e, K_edot, gain, K_n.
    """
    n_samples = len(f_t)
    out = np.zeros((5, n_samples))
    response, linear, forward = np.zeros((3, n_samples))  # before their delays
    held = np.isfinite(outer[1]) or outer[2] > 0
    delay_f, nominal = int(inner[4]), delay[0]
    z = np.zeros(12 + order)
    k1, k2, k3, k4 = np.empty((4, len(z)))
    with_remnant = without = 0.0
    for k in range(n_samples):
        response[k] = z[2] + z[5]
        linear[k] = z[6] + z[9]
        forward[k] = inner[3] * z[11]
        w = offset[k]
        if k >= delay[k]:
            w += response[k - delay[k]]
        if k >= delay_f:
            w += forward[k - delay_f]
        with_remnant = _stick(w + z[-1], with_remnant, outer)
        without = _stick(w, without, outer)
        out[0, k], out[1, k] = f_t[k] - z[0], z[0]
        out[2, k], out[3, k] = with_remnant, without
        if k >= nominal:
            out[4, k] = linear[k - nominal]

        begin, middle, end = over_time[2 * k], over_time[2 * k + 1], over_time[2 * k + 2]
        given = (f_t[k], with_remnant if held else w, f_d[k], white[k], held)
        rest = (physics, inner, outer[0])
        _derivative(k1, z, *given, begin, *rest)
        _derivative(k2, z + dt / 2 * k1, *given, middle, *rest)
        _derivative(k3, z + dt / 2 * k2, *given, middle, *rest)
        _derivative(k4, z + dt * k3, *given, end, *rest)
        z += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return out


class _Known(RegressorMixin, BaseEstimator):
    """A model whose prediction is known for the rows of X."""

    def __repr__(self):
        return f"{type(self).__name__}()"

    def __sklearn_is_fitted__(self):
        return True

    def fit(self, X, y=None):
        return self


class Oracle(_Known):
    """The exact operator, effects and all, driven by the measured e.

    ``u`` is ``truth.u_without_remnant``, or those of several simulations after each other.
    """

    def __init__(self, u):
        self.u = u

    def predict(self, X):
        return self.u.loc[X.index].to_numpy()


class LinearTruth(_Known):
    """The exact operator without its effects, driven by the measured e.

    ``u`` is ``truth.linear_response``; ``gain`` scales it, for a model a little off.
    """

    def __init__(self, u, gain=1.0):
        self.u = u
        self.gain = gain

    def predict(self, X):
        return self.gain * self.u.loc[X.index].to_numpy()
