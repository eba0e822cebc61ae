"""A slow, readable twin of the compiled tracking loop, written from Appendix D of the thesis.

It shares no code with the package. Parameters are numbers or functions of time (s). The operator is
Eq. D.3: two neuromuscular filters side by side, with the gains at their inputs, and the delay at
the output; where the muscle itself varies, it is one that is pushed by omega² K_e e and by the rate
of omega² K_edot e. The controlled element is Eqs. D.6-D.11 with K_c first: v' = K_c u - omega_b v,
x' = v. The remnant filter is a cascade of lags (Eq. D.4) or the neuromuscular filter (Eq. D.5),
with the gain first. All of it is integrated together by fourth-order Runge-Kutta; forcing functions
and white noise are held over the step.
"""

import numpy as np


def at(parameter, t):
    """A number or a function of time, at one instant."""
    return float(parameter(np.asarray(t))) if callable(parameter) else float(parameter)


def neuromuscular(position, rate, force, omega, zeta):
    """Time derivatives of the two states of omega² / (s² + 2 zeta omega s + omega²)."""
    return rate, omega**2 * (force - position) - 2 * zeta * omega * rate


def one_muscle(position, momentum, direct, lead, omega, zeta):
    """y'' + 2 zeta omega y' + omega² y = omega² direct + d/dt (omega² lead), which may vary."""
    rate = momentum + omega**2 * lead
    return rate, omega**2 * (direct - position) - 2 * zeta * omega * rate


def runge_kutta(derivative, state, dt):
    """One step of ode4; ``derivative(state, part)`` at part 0, 1/2, 1/2 and 1 of the step."""

    def moved(slope, length):
        return [s + length * d for s, d in zip(state, slope, strict=True)]

    k1 = derivative(state, 0.0)
    k2 = derivative(moved(k1, dt / 2), 0.5)
    k3 = derivative(moved(k2, dt / 2), 0.5)
    k4 = derivative(moved(k3, dt), 1.0)
    return [
        s + dt / 6 * (a + 2 * b + 2 * c + d)
        for s, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
    ]


def simulate(
    f_t,
    f_d,
    white,
    *,
    rate,
    begin=0,
    K_c,
    omega_b,
    tau_e=0.0,
    K_e=0.0,
    K_edot=0.0,
    omega_nm=1.0,
    zeta_nm=1.0,
    shown=0.0,
    K_t=0.0,
    K_tdot=0.0,
    K_x=0.0,
    K_xdot=0.0,
    interpolated=False,
    arx=None,
    order=1,
    K_n=0.0,
    T_n=0.06,
    remnant_muscle=(11.25, 0.35),
    closed=True,
    varying_muscle=False,
    step=runge_kutta,
):
    """Simulate one run from rest; sample k is at (k + begin) / rate.

    ``white`` has unit variance. ``arx`` = (a, b, nk) replaces the operator. ``step`` integrates one
    step. Returns e, u, x and n.
    """
    dt = 1 / rate
    strength = np.sqrt(rate)  # white noise of unit intensity
    n_lags = 2 if order == "nm" else order
    state = [0.0] * (6 + n_lags)
    outputs, errors = [], []
    out = {name: np.empty(len(f_t)) for name in "euxn"}
    delay = tau_e * rate

    def operator_output(state):
        return state[0] + (0.0 if varying_muscle else state[3])

    def remnant_of(state):
        return state[6] if order == "nm" else state[5 + order]

    def delayed(k, part):
        """The operator's output ``delay`` samples before sample k + part."""
        if arx is not None:
            return outputs[k]
        if not interpolated:
            return outputs[k - round(delay)] if k >= round(delay) else 0.0
        instant = k + part - delay
        before = int(np.floor(instant + 1e-9))
        weight = instant - before
        older = outputs[before] if before >= 0 else 0.0
        newer = outputs[before + 1] if 0 <= before + 1 < len(outputs) else 0.0
        return older if weight < 1e-9 else (1 - weight) * older + weight * newer

    def arx_response(k):
        a, b, nk = arx
        value = sum(b[j] * errors[k - nk - j] for j in range(len(b)) if k - nk - j >= 0)
        return value - sum(a[i] * outputs[k - 1 - i] for i in range(len(a)) if k - 1 - i >= 0)

    for k in range(len(f_t)):
        x, n = state[4], remnant_of(state)
        errors.append(f_t[k] - x)
        outputs.append(operator_output(state) if arx is None else arx_response(k))
        out["e"][k], out["x"][k], out["n"][k] = f_t[k] - x, x, n
        out["u"][k] = delayed(k, 0.0) + n

        def derivative(state, part, k=k):
            t = (k + part + begin) / rate
            position, speed, first, second, x, v, *lags = state
            e = f_t[k] - x
            display = at(shown, t)
            direct = at(K_e, t) * e + display * (at(K_t, t) * f_t[k] + at(K_x, t) * x)
            lead = at(K_edot, t) * e + display * (at(K_tdot, t) * f_t[k] + at(K_xdot, t) * x)
            muscle = at(omega_nm, t), at(zeta_nm, t)
            if varying_muscle:
                d_operator = [*one_muscle(position, speed, direct, lead, *muscle), 0.0, 0.0]
            else:
                d_operator = [
                    *neuromuscular(position, speed, direct, *muscle),
                    *neuromuscular(first, second, lead, *muscle),
                ]
            n = remnant_of(state) if closed else 0.0
            stick = delayed(k, part) + n + f_d[k]
            d_element = [v, at(K_c, t) * stick - at(omega_b, t) * v]
            source = at(K_n, t) * strength * white[k]
            if order == "nm":
                d_remnant = neuromuscular(*lags, source, *remnant_muscle)
            else:
                d_remnant = [(a - b) / T_n for a, b in zip([source, *lags[:-1]], lags, strict=True)]
            return [*d_operator, *d_element, *d_remnant]

        state = step(derivative, state, dt)
    return out["e"], out["u"], out["x"], out["n"]
