"""The thesis's compensatory loop with constant dynamics, as one plain loop: an oracle for tests.

It shares no code with the package. The scheme is that of the thesis's Monte Carlo (Appendix D):
fourth-order Runge-Kutta at the sampling rate, f_t sampled and held over the step, the
neuromuscular filter driven by f_t[k] - x(t) at the stages, a discrete delay at the operator's
output, and remnant added after the delay. The noise is white of unit intensity: N(0, 1/dt) per
sample, held over the step.
"""

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

PERIOD = 81.92  # s, the measurement window T_m

# Table I: multiples n_t of 2 pi / T_m, amplitudes (deg), phases (rad).
MULTIPLES = np.array([3, 5, 8, 13, 22, 34, 53, 86, 139, 229])
AMPLITUDES = np.array([1.186, 1.121, 0.991, 0.756, 0.447, 0.245, 0.123, 0.061, 0.036, 0.025])
PHASES = np.array([-0.753, 1.564, 0.588, -0.546, 0.674, -1.724, -1.963, -2.189, 0.875, 0.604])

# Table II, and Eq. 27 for the remnant.
STATES = {  # K_c, omega_b (rad/s), K_e, T_L (s)
    "C1": (90.0, 6.0, 0.09, 0.4),
    "C2": (30.0, 0.2, 0.07, 1.2),
}
TAU_E, OMEGA_NM, ZETA_NM = 0.28, 11.25, 0.35
T_N = 0.06

# ZOH equivalents at 0.01 s without delay: a1, a2, b0, b1 (Table IV; facts.json zoh.Ts0.01).
ZOH_100HZ = {
    "C1": (-1.9121130548499772, 0.9242709633048523, 0.04427659234645431, -0.04318238058551549),
    "C2": (-1.9121130548499772, 0.9242709633048523, 0.10244982157940563, -0.10159876798756429),
}


@dataclass
class Recording:
    """Signals over the whole recording (deg), on the grid k / f_s."""

    e: np.ndarray
    u: np.ndarray
    x: np.ndarray
    f_t: np.ndarray
    n: np.ndarray

    def last(self, period=PERIOD, sampling_rate=100.0):
        """The measurement window: the last `period` seconds."""
        keep = round(period * sampling_rate)
        return Recording(*(getattr(self, field.name)[-keep:] for field in fields(self)))


def target(n_samples, sampling_rate=100.0):
    """Eq. 26 with Table I."""
    omega = 2 * np.pi * MULTIPLES / PERIOD
    t = np.arange(n_samples)[:, None] / sampling_rate
    return np.sin(omega * t + PHASES) @ AMPLITUDES


def simulate(
    state="C1",
    *,
    remnant_gain=0.0,
    remnant_order=1,
    rng=None,
    f_t=None,
    periods=8,
    sampling_rate=100.0,
    interpolated_delay=False,
):
    """Simulate from rest.

    `f_t` replaces the multisine of Table I and then sets the length. `interpolated_delay` moves
    the delayed output linearly over the step (Simulink's Transport Delay, Chapter 5) instead of
    holding it.
    """
    if f_t is None:
        f_t = target(round(periods * PERIOD * sampling_rate), sampling_rate)
    f_t = np.ascontiguousarray(f_t, dtype=float)
    dt = 1 / sampling_rate
    delay = round(TAU_E * sampling_rate)
    if remnant_gain:
        white = np.random.default_rng(rng).standard_normal(len(f_t)) / np.sqrt(dt)
    else:
        white = np.zeros(len(f_t))
    physics = np.array([*STATES[state], OMEGA_NM, ZETA_NM, T_N])
    e, u, x, n = _run(
        f_t, remnant_gain * white, physics, remnant_order, delay, dt, interpolated_delay
    )
    return Recording(e, u, x, f_t, n)


@njit(cache=True)
def _derivative(z, f, delayed, white, physics):
    """z: neuromuscular position and rate, controlled element x and rate, the remnant's lags."""
    K_c, omega_b, _, _, omega_nm, zeta_nm, T_n = physics
    dz = np.empty_like(z)
    dz[0] = z[1]
    dz[1] = omega_nm**2 * (f - z[2] - z[0]) - 2 * zeta_nm * omega_nm * z[1]
    dz[2] = z[3]
    dz[3] = K_c * (delayed + z[-1]) - omega_b * z[3]
    source = white
    for i in range(4, len(z)):
        dz[i] = (source - z[i]) / T_n
        source = z[i]
    return dz


@njit(cache=True)
def _run(f_t, white, physics, order, delay, dt, interpolated):
    K_e, T_L = physics[2], physics[3]
    n_samples = len(f_t)
    e, u, x, n = np.empty((4, n_samples))
    response = np.zeros(
        n_samples + delay
    )  # the operator's output before the delay, 'delay' rows late
    z = np.zeros(4 + order)
    for k in range(n_samples):
        response[k + delay] = K_e * z[0] + K_e * T_L * z[1]
        begin = response[k]
        end = response[k + 1] if interpolated else begin
        middle = (begin + end) / 2
        x[k], n[k] = z[2], z[-1]
        e[k], u[k] = f_t[k] - x[k], begin + n[k]

        f, w = f_t[k], white[k]
        k1 = _derivative(z, f, begin, w, physics)
        k2 = _derivative(z + dt / 2 * k1, f, middle, w, physics)
        k3 = _derivative(z + dt / 2 * k2, f, middle, w, physics)
        k4 = _derivative(z + dt * k3, f, end, w, physics)
        z = z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return e, u, x, n
