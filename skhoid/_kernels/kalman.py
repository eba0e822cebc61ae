"""Kalman filters on the physical operator, one per lane: unscented, extended, and dual extended.

The state is x = [ln omega, ln zeta, ln tau, ln |K_e|, ln |K_edot|, z, z', remnant]; parameters are
random walks, z'' = e(t - tau) - 2 zeta omega z' - omega^2 z under zero-order hold, the remnant is a
cascade of first-order lags, and y = omega^2 (K_e z + K_edot z') + last remnant state + noise.

Parameters come first so that the lower Cholesky factor moves them by its first columns alone: of
the sigma points only those of three columns need a discretisation or a delay of their own, and the
remnant, in which all is linear, needs none. Each lane has a flat state (:func:`layout`) that ends
with a ring of the last errors; a filter goes on from it bit for bit.
"""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable

from .kernel import kernel

UKF, EKF, DUAL = 0, 1, 2
OMEGA, ZETA, TAU, GAIN, RATE, Z, DZ, REMNANT = range(8)
N_PATH = 11  # five logarithms, their variances, and the covariance of the two gains
TINY = 1e-13  # of a variance, below which the rest of it is rounding
EASY = 0.25  # square of an angle up to which series are used

SETTINGS = (
    "dt",
    "measurement_noise",
    "reach",  # of sigma points, in standard deviations
    "bend",  # weight of the squared shift of the mean: beta - alpha^2
    "gate",  # standard deviations of an innovation beyond which it counts less
    "usual_square",  # of an innovation over its variance, if the noise is what it was
    "scale_gain",  # dt over the memory of the noise's scale
    "least_scale",
    "most_scale",
    "most_variance",  # of a logarithm
    "sign_gain",
    "sign_rate",
)
N_SETTINGS = len(SETTINGS)
(
    DT, NOISE, REACH, BEND, GATE, USUAL, SCALE_GAIN, LEAST_SCALE, MOST_SCALE, MOST_VARIANCE,
    SIGN_GAIN, SIGN_RATE,
) = range(N_SETTINGS)  # fmt: skip


WALK, LOW, HIGH, JITTER, START, MATRICES = np.cumsum([N_SETTINGS, 5, 5, 5, 2, 2]).tolist()
(SCALE, SINCE, BLOCKED, ERROR, UPDATES, CLAMPED) = range(6)  # numbers of a state
SQUARES, LOGS, NEXT, N_NUMBERS = range(10, 14)


def settings_layout(m):
    """Offsets of the settings that are arrays, for m remnant states."""
    at = {"walk": WALK, "low": LOW, "high": HIGH, "jitter": JITTER, "start": START}
    matrices = ("transition", "drive", "stationary", "size")
    return at | {name: MATRICES + i * m * m for i, name in enumerate(matrices)}


def layout(m):
    """Offsets in the state of a lane; the ring of errors begins at ``ring``."""
    n = 7 + m
    numbers = 4 * n + n * n
    names = {"scale": SCALE, "since": SINCE, "blocked": BLOCKED, "error": ERROR}
    names |= {"updates": UPDATES, "clamped": CLAMPED, "squares": SQUARES}
    names |= {"logs": LOGS, "at": NEXT, "ring": N_NUMBERS}
    return {"x": 0, "P": n, "W": n + n * n} | {name: numbers + at for name, at in names.items()}


@register_jitable
def copied(source, out):
    """Copy flat arrays; written out as elsewhere here, which is compiled in a third of the time."""
    for i in range(out.size):
        out[i] = source[i]


@register_jitable
def oscillation(x, dt):
    """cos and sin / frequency at an angle with square x, and the slope of that."""
    if abs(x) < EASY:
        c = 1 - x / 2 * (1 - x / 12 * (1 - x / 30 * (1 - x / 56 * (1 - x / 90 * (1 - x / 132)))))
        s = 1 - x / 6 * (1 - x / 20 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110 * (1 - x / 156)))))
        slope = -1 / 6 * (1 - x / 10 * (1 - x / 28 * (1 - x / 54 * (1 - x / 88 * (1 - x / 130)))))
        return c, s * dt, slope * dt**3
    root = np.sqrt(abs(x))
    if x > 0:
        c, s = np.cos(root), np.sin(root) / root
    else:
        c, s = np.cosh(root), np.sinh(root) / root
    return c, s * dt, (c - s) / (2 * x) * dt**3


@register_jitable
def held(omega, zeta, dt):
    """Transition of [z, z'] and its response to an error held for dt (Eqs. F.3-F.4)."""
    sigma = zeta * omega
    c, s, _ = oscillation(omega * omega * (1 - zeta * zeta) * dt * dt, dt)
    decay = np.exp(-sigma * dt)
    c, s = decay * c, decay * s
    a11 = c + sigma * s
    return a11, s, -omega * omega * s, c - sigma * s, (1 - a11) / (omega * omega), s


@register_jitable
def held_slopes(omega, zeta, dt, out):
    """Derivatives of :func:`held` by ln omega (first row) and ln zeta (second row)."""
    sigma, square = zeta * omega, omega * omega
    c, s, slope = oscillation(square * (1 - zeta * zeta) * dt * dt, dt)
    decay = np.exp(-sigma * dt)
    a11, a12 = decay * (c + sigma * s), decay * s
    b1 = (1 - a11) / square
    for k in range(2):
        d = 2 * square * (1 - zeta * zeta) if k == 0 else -2 * square * zeta * zeta
        rise = 2 * square if k == 0 else 0.0
        ds, dc = slope * d, -dt * s / 2 * d
        bent = sigma * s + sigma * ds  # of sigma s
        out[k, 0] = -dt * sigma * a11 + decay * (dc + bent)
        out[k, 1] = -dt * sigma * a12 + decay * ds
        out[k, 2] = -rise * a12 - square * out[k, 1]
        out[k, 3] = -dt * sigma * decay * (c - sigma * s) + decay * (dc - bent)
        out[k, 4] = (-out[k, 0] - rise * b1) / square
        out[k, 5] = out[k, 1]


@register_jitable
def corrected(x, P, cross, innovation, variance):
    """Correct x and P in place by one measurement with the cross covariance P_xy = P h."""
    n = x.size
    for i in range(n):
        gain = cross[i] / variance
        x[i] += gain * innovation
        for j in range(i + 1):
            value = P[i, j] - gain * cross[j]
            P[i, j] = value
            P[j, i] = value


@register_jitable
def factored(P, L):
    """Lower Cholesky factor of a positive semidefinite matrix; what has no variance is left out."""
    n = P.shape[0]
    for j in range(n):
        d = P[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if d > TINY * P[j, j]:
            root = np.sqrt(d)
            inverse = 1 / root
            L[j, j] = root
            for i in range(j + 1, n):
                rest = P[i, j]
                for k in range(j):
                    rest -= L[i, k] * L[j, k]
                L[i, j] = rest * inverse
        else:
            for i in range(j, n):
                L[i, j] = 0.0


@register_jitable
def rest(numbers, x, P, W, settings, stationary):
    """Begin a run, or go on after a gap: the signals before are not known."""
    for i in range(Z, x.size):
        x[i] = 0.0
    for i in range(Z, x.size):
        for j in range(x.size):
            P[i, j] = P[j, i] = 0.0
    P[Z, Z], P[DZ, DZ] = settings[START], settings[START + 1]
    for i in range(len(stationary)):
        for j in range(len(stationary)):
            P[7 + i, 7 + j] = numbers[SCALE] * stationary[i, j]
    for k in range(3):
        for i in range(x.size):
            W[k, i] = 0.0
    numbers[SINCE], numbers[BLOCKED], numbers[NEXT], numbers[ERROR] = 0.0, 0.0, 0.0, np.nan


@register_jitable
def delayed(numbers, ring, lag):
    """The error ``lag`` samples before the last, and its slope by the lag."""
    size = ring.size
    lag = min(max(lag, 0.0), min(numbers[SINCE], size) - 2.0)
    whole = int(lag)
    place = int(numbers[NEXT]) - 1 - whole
    if place < 0:
        place += size
    before = place - 1 if place > 0 else size - 1
    e, older = ring[place], ring[before]
    return e + (lag - whole) * (older - e), older - e


@register_jitable
def crossed(transition, P, out):
    """Covariance of x with its prediction, when P has that in its columns of z alone."""
    for i in range(len(P)):
        out[i, Z], out[i, DZ] = P[i, Z], P[i, DZ]
        for j in range(len(transition)):
            out[i, 7 + j] = 0.0
            for k in range(j + 1):
                out[i, 7 + j] += transition[j, k] * P[i, 7 + k]


@register_jitable
def remnant_moved(is_dual, scale, transition, drive, x, P, W):
    """Move the remnant and its covariances, in which P already has the moved z."""
    M, N = len(transition), x.size
    new, mean = np.empty((M, N)), np.empty(M)
    if is_dual:
        for k in range(3):
            for i in range(M - 1, -1, -1):
                total = 0.0
                for j in range(i + 1):
                    total += transition[i, j] * W[k, 7 + j]
                W[k, 7 + i] = total
    for i in range(M):
        total = 0.0
        for k in range(i + 1):
            total += transition[i, k] * x[7 + k]
        mean[i] = total
        for j in range(N):
            total = 0.0
            for k in range(i + 1):
                total += transition[i, k] * P[7 + k, j]
            new[i, j] = total
    for i in range(M):
        x[7 + i] = mean[i]
        for j in range(7):
            P[7 + i, j] = new[i, j]
            P[j, 7 + i] = new[i, j]
        for j in range(i + 1):
            total = scale * drive[i, j]
            for k in range(j + 1):
                total += new[i, 7 + k] * transition[j, k]
            P[7 + i, 7 + j] = total
            P[7 + j, 7 + i] = total


@register_jitable
def predicted_unscented(numbers, ring, settings, x, P, L, moves):
    """Move z and its covariances through sigma points."""
    dt, reach = settings[DT], settings[REACH]
    weight = 1 / (2 * reach * reach)
    factored(P, L)
    omega, zeta = np.exp(x[OMEGA]), np.exp(x[ZETA])
    lag = np.exp(x[TAU]) / dt
    a11, a12, a21, a22, b1, b2 = held(omega, zeta, dt)
    e, _ = delayed(numbers, ring, lag)
    z1, z2 = x[Z], x[DZ]
    m1, m2 = a11 * z1 + a12 * z2 + b1 * e, a21 * z1 + a22 * z2 + b2 * e
    shift1, shift2 = 0.0, 0.0
    v11, v12, v22 = settings[JITTER], 0.0, settings[JITTER + 1]
    # moves[j] is the difference of z of the two points of column j, over that of the points.
    for j in range(7):
        l1, l2 = L[Z, j], L[DZ, j]
        if j > TAU:
            d1, d2 = a11 * l1 + a12 * l2, a21 * l1 + a22 * l2
            moves[j, 0], moves[j, 1] = d1, d2
            v11 += d1 * d1
            v12 += d1 * d2
            v22 += d2 * d2
            continue
        first1, first2 = 0.0, 0.0
        for side in range(2):
            step = reach if side == 0 else -reach
            p11, p12, p21, p22, q1, q2 = a11, a12, a21, a22, b1, b2
            if j < TAU:
                w = omega
                if j == OMEGA:
                    value = x[OMEGA] + step * L[OMEGA, j]
                    w = np.exp(min(max(value, settings[LOW]), settings[HIGH]))
                value = x[ZETA] + step * L[ZETA, j]
                d = np.exp(min(max(value, settings[LOW + 1]), settings[HIGH + 1]))
                p11, p12, p21, p22, q1, q2 = held(w, d, dt)
            value = x[TAU] + step * L[TAU, j]
            value = np.exp(min(max(value, settings[LOW + 2]), settings[HIGH + 2]))
            moved, _ = delayed(numbers, ring, value / dt)
            s1, s2 = z1 + step * l1, z2 + step * l2
            d1 = p11 * s1 + p12 * s2 + q1 * moved - m1
            d2 = p21 * s1 + p22 * s2 + q2 * moved - m2
            shift1, shift2 = shift1 + weight * d1, shift2 + weight * d2
            v11 += weight * d1 * d1
            v12 += weight * d1 * d2
            v22 += weight * d2 * d2
            if side == 0:
                first1, first2 = d1, d2
            else:
                moves[j, 0] = (first1 - d1) / (2 * reach)
                moves[j, 1] = (first2 - d2) / (2 * reach)
    x[Z], x[DZ] = m1 + shift1, m2 + shift2
    bend = settings[BEND]
    for i in range(x.size):
        c1, c2 = 0.0, 0.0
        for j in range(min(i + 1, 7)):
            c1 += L[i, j] * moves[j, 0]
            c2 += L[i, j] * moves[j, 1]
        P[i, Z], P[i, DZ] = c1, c2
    return v11 + bend * shift1**2, v12 + bend * shift1 * shift2, v22 + bend * shift2**2


@register_jitable
def predicted_extended(method, numbers, ring, settings, x, P, W, slopes, moves):
    """Move z and its covariances along its slopes."""
    dt = settings[DT]
    omega, zeta, lag = np.exp(x[OMEGA]), np.exp(x[ZETA]), np.exp(x[TAU]) / dt
    a11, a12, a21, a22, b1, b2 = held(omega, zeta, dt)
    held_slopes(omega, zeta, dt, slopes)
    e, rise = delayed(numbers, ring, lag)
    z1, z2 = x[Z], x[DZ]
    for k in range(2):
        moves[k, 0] = slopes[k, 0] * z1 + slopes[k, 1] * z2 + slopes[k, 4] * e
        moves[k, 1] = slopes[k, 2] * z1 + slopes[k, 3] * z2 + slopes[k, 5] * e
    moves[TAU, 0], moves[TAU, 1] = b1 * rise * lag, b2 * rise * lag
    x[Z], x[DZ] = a11 * z1 + a12 * z2 + b1 * e, a21 * z1 + a22 * z2 + b2 * e
    if method == DUAL:  # sensitivities W = dx / dtheta; P has none between the two filters
        for k in range(3):
            s1, s2 = W[k, Z], W[k, DZ]
            W[k, Z] = a11 * s1 + a12 * s2 + moves[k, 0]
            W[k, DZ] = a21 * s1 + a22 * s2 + moves[k, 1]
    for i in range(x.size):
        c1 = a11 * P[i, Z] + a12 * P[i, DZ]
        c2 = a21 * P[i, Z] + a22 * P[i, DZ]
        if method == EKF:
            for k in range(3):
                c1 += P[i, k] * moves[k, 0]
                c2 += P[i, k] * moves[k, 1]
        P[i, Z], P[i, DZ] = c1, c2
    v11 = settings[JITTER] + a11 * P[Z, Z] + a12 * P[DZ, Z]
    v12 = a21 * P[Z, Z] + a22 * P[DZ, Z]
    v22 = settings[JITTER + 1] + a21 * P[Z, DZ] + a22 * P[DZ, DZ]
    if method == EKF:
        for k in range(3):
            v11 += moves[k, 0] * P[k, Z]
            v12 += moves[k, 1] * P[k, Z]
            v22 += moves[k, 1] * P[k, DZ]
    return v11, v12, v22


@register_jitable
def measured_unscented(settings, x, P, L, cross):
    """Prediction of the measurement and its variance; ``cross`` gets P_xy."""
    N, has_remnant = x.size, x.size > REMNANT
    reach = settings[REACH]
    weight = 1 / (2 * reach * reach)
    factored(P, L)
    square = np.exp(2 * x[OMEGA])
    gain = settings[SIGN_GAIN] * np.exp(x[GAIN])
    rate = settings[SIGN_RATE] * np.exp(x[RATE])
    centre = square * (gain * x[Z] + rate * x[DZ])
    shift, variance = 0.0, 0.0
    for i in range(N):
        cross[i] = 0.0
    for j in range(N):
        noise = L[N - 1, j] if has_remnant else 0.0
        if j >= Z:
            half = noise
            if j in (Z, DZ):
                half += square * (gain * L[Z, j] + rate * L[DZ, j])
            variance += half * half
        else:
            half = 0.0
            for side in range(2):
                step = reach if side == 0 else -reach
                q = square
                if j == OMEGA:
                    value = x[OMEGA] + step * L[OMEGA, j]
                    q = np.exp(2 * min(max(value, settings[LOW]), settings[HIGH]))
                g = gain if j > GAIN else gain * np.exp(step * L[GAIN, j])
                r = rate * np.exp(step * L[RATE, j])
                d = q * (g * (x[Z] + step * L[Z, j]) + r * (x[DZ] + step * L[DZ, j]))
                d += step * noise - centre
                shift += weight * d
                variance += weight * d * d
                half += d if side == 0 else -d
            half /= 2 * reach
        for i in range(j, N):
            cross[i] += L[i, j] * half
    if has_remnant:
        centre += x[N - 1]
    return centre + shift, variance + settings[BEND] * shift * shift


@register_jitable
def measured_extended(method, settings, x, P, h, cross):
    """The same by the slopes of the measurement."""
    N, has_remnant = x.size, x.size > REMNANT
    square = np.exp(2 * x[OMEGA])
    gain = settings[SIGN_GAIN] * np.exp(x[GAIN])
    rate = settings[SIGN_RATE] * np.exp(x[RATE])
    for i in range(N):
        h[i] = 0.0
    h[GAIN], h[RATE] = square * gain * x[Z], square * rate * x[DZ]
    h[Z], h[DZ] = square * gain, square * rate
    output = h[GAIN] + h[RATE]
    if method == EKF:
        h[OMEGA] = 2 * output
    if has_remnant:
        h[N - 1] = 1.0
    variance = 0.0
    for i in range(N):
        cross[i] = 0.0
        for j in range(N):
            cross[i] += P[i, j] * h[j]
        variance += h[i] * cross[i]
    return output + (x[N - 1] if has_remnant else 0.0), variance


@register_jitable
def dual_corrected(x, P, W, h, cross, innovation, variance):
    """Correct the parameter filter by the total slope, then the state filter."""
    slope, moved = np.empty(3), np.empty(3)
    for k in range(3):
        total = 2 * (h[GAIN] + h[RATE]) if k == OMEGA else 0.0
        for j in range(3, x.size):
            total += h[j] * W[k, j]
        slope[k] = total
    spread = variance
    for k in range(3):
        moved[k] = 0.0
        for j in range(3):
            moved[k] += P[k, j] * slope[j]
        spread += slope[k] * moved[k]
    for k in range(3):
        for j in range(3, x.size):
            W[k, j] -= cross[j] / variance * slope[k]
    corrected(x[3:], P[3:, 3:], cross[3:], innovation, variance)
    corrected(x[:3], P[:3, :3], moved, innovation, spread)


@register_jitable
def bounded(numbers, settings, x, P):
    """Keep parameters and variances within their bounds."""
    for i in range(5):
        within = min(max(x[i], settings[LOW + i]), settings[HIGH + i])
        if x[i] != within:
            x[i] = within
            numbers[CLAMPED + i] += 1
    for i in range(x.size):
        shrink = 1.0
        if P[i, i] <= 0:
            shrink = 0.0
        elif i < 5 and P[i, i] > settings[MOST_VARIANCE]:
            shrink = np.sqrt(settings[MOST_VARIANCE] / P[i, i])
        if shrink < 1.0:
            for j in range(x.size):
                P[i, j] *= shrink
                P[j, i] *= shrink


@kernel(
    "i8, f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], i1[:,::1], i8, i8, f8[:,:,::1], "
    "f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,:,::1]",
    8,
)
def advance(
    method, states, settings, e, y, fresh, begin, end, path, errors, filtered, priors, crosses
):
    """Advance the filters of all lanes by a method over the rows from ``begin`` to ``end``.

    ``states`` (n_lanes, size) and ``settings`` (n_lanes, size) are laid out by :func:`layout`
    and :func:`settings_layout`; e, y and ``fresh``, which is 1 where a run begins or goes on
    after a gap and 2 where there is no row, have the shape (1 or n_lanes, n_rows). NaN in y
    is no measurement; NaN in e holds the last one, and nothing is measured until it has
    passed.

    Outputs of shape (n_lanes, n_rows, ...), left alone if of size 0: ``path``, N_PATH numbers;
    ``errors``, the innovation and its variance, NaN without a measurement; and for smoothing x
    and P after and before the measurement, and the covariance of x with its next prediction.
    """
    M = round(np.sqrt((settings.shape[1] - MATRICES) / 3))
    N = 7 + M
    L, slopes = np.zeros((N, N)), np.zeros((2, 6))
    moves, cross, h = np.zeros((7, 2)), np.zeros(N), np.zeros(N)
    for lane in range(states.shape[0]):
        state, own = states[lane], settings[lane]
        after = N + N * N
        x, both = state[:N], state[:after]
        P = state[N:after].reshape((N, N))
        W = state[after : after + 3 * N].reshape((3, N))
        after += 3 * N
        numbers, ring = state[after : after + N_NUMBERS], state[after + N_NUMBERS :]
        matrices = own[MATRICES:].reshape((3, M, M))
        transition, drive, stationary = matrices[0], matrices[1], matrices[2]
        row = lane if y.shape[0] > 1 else 0
        for t in range(begin, end):
            if fresh[row, t] == 2:
                continue
            if crosses.size > 0:
                for i in range(N):
                    copied(P[i], crosses[lane, t, i])
            if fresh[row, t] == 1:
                rest(numbers, x, P, W, own, stationary)
                if crosses.size > 0:
                    for i in range(N):
                        for j in range(Z, N):
                            crosses[lane, t, i, j] = 0.0
            known = y[row, t] == y[row, t] and numbers[BLOCKED] <= 0
            ready = numbers[SINCE] >= np.exp(x[TAU]) / own[DT] + 2
            if ready:
                if method == UKF:
                    v11, v12, v22 = predicted_unscented(numbers, ring, own, x, P, L, moves)
                else:
                    v11, v12, v22 = predicted_extended(
                        method, numbers, ring, own, x, P, W, slopes, moves
                    )
                if crosses.size > 0:
                    crossed(transition, P, crosses[lane, t])
                for i in range(N):
                    P[Z, i], P[DZ, i] = P[i, Z], P[i, DZ]
                P[Z, Z], P[Z, DZ], P[DZ, Z], P[DZ, DZ] = v11, v12, v12, v22
                if M > 0:
                    remnant_moved(method == DUAL, numbers[SCALE], transition, drive, x, P, W)
                if known:
                    for i in range(5):
                        P[i, i] += own[WALK + i]
            if errors.size > 0:
                errors[lane, t, 0] = errors[lane, t, 1] = np.nan
            if priors.size > 0:
                copied(both, priors[lane, t])
            if ready and known:
                if method == UKF:
                    output, variance = measured_unscented(own, x, P, L, cross)
                else:
                    output, variance = measured_extended(method, own, x, P, h, cross)
                variance += numbers[SCALE] * own[NOISE]
                innovation = y[row, t] - output
                square = innovation * innovation / variance
                if errors.size > 0:
                    errors[lane, t, 0], errors[lane, t, 1] = innovation, variance
                numbers[SQUARES] += square
                numbers[LOGS] += np.log(variance)
                numbers[UPDATES] += 1
                most = own[GATE] * own[GATE] * own[USUAL]
                if square > most:
                    variance *= np.sqrt(square / most)
                if method == DUAL:
                    dual_corrected(x, P, W, h, cross, innovation, variance)
                else:
                    corrected(x, P, cross, innovation, variance)
                bounded(numbers, own, x, P)
                change = own[SCALE_GAIN] * (min(square, most) / own[USUAL] - 1)
                scale = numbers[SCALE] * (1 + change)
                numbers[SCALE] = min(max(scale, own[LEAST_SCALE]), own[MOST_SCALE])
            now = e[row, t]
            if now == now:
                numbers[ERROR] = now
                numbers[BLOCKED] = max(numbers[BLOCKED] - 1, 0.0)
            else:
                now = numbers[ERROR] if numbers[ERROR] == numbers[ERROR] else 0.0
                numbers[BLOCKED] = np.exp(x[TAU]) / own[DT] + 2
            place = int(numbers[NEXT])
            ring[place] = now
            numbers[NEXT] = place + 1 if place + 1 < ring.size else 0
            numbers[SINCE] += 1
            if filtered.size > 0:
                copied(both, filtered[lane, t])
            if path.size > 0:
                for i in range(5):
                    path[lane, t, i], path[lane, t, 5 + i] = x[i], P[i, i]
                path[lane, t, 10] = P[GAIN, RATE]


@kernel("f8[:,:,::1], f8[:,:,::1], f8[:,:,:,::1], i1[:,::1]", 1)
def smooth_kalman(filtered, priors, crosses, fresh):
    """Smooth x and P of all lanes in place, backwards (Rauch, Tung and Striebel 1965).

    Arguments are outputs of ``advance``, whose predictions are linear or statistically linearised.
    """
    n = crosses.shape[2]
    L, gain, product = np.zeros((n, n)), np.empty((n, n)), np.empty((n, n))
    change, shift = np.empty((n, n)), np.empty(n)
    for lane in range(filtered.shape[0]):
        row = lane if fresh.shape[0] > 1 else 0
        after = -1
        for t in range(filtered.shape[1] - 1, -1, -1):
            if fresh[row, t] == 2:
                continue
            if after >= 0:
                prior = priors[lane, after, n:].reshape((n, n))
                factored(prior, L)
                for i in range(n):  # a row of the gain solves prior g = cross
                    for j in range(n):
                        rest = crosses[lane, after, i, j]
                        for k in range(j):
                            rest -= L[j, k] * gain[i, k]
                        gain[i, j] = rest / L[j, j] if L[j, j] > 0 else 0.0
                    for j in range(n - 1, -1, -1):
                        rest = gain[i, j]
                        for k in range(j + 1, n):
                            rest -= L[k, j] * gain[i, k]
                        gain[i, j] = rest / L[j, j] if L[j, j] > 0 else 0.0
                for i in range(n):
                    shift[i] = filtered[lane, after, i] - priors[lane, after, i]
                    for j in range(n):
                        change[i, j] = filtered[lane, after, n + i * n + j] - prior[i, j]
                for i in range(n):
                    for j in range(n):
                        filtered[lane, t, i] += gain[i, j] * shift[j]
                        product[i, j] = 0.0
                        for k in range(n):
                            product[i, j] += gain[i, k] * change[k, j]
                for i in range(n):
                    for j in range(i + 1):
                        value = filtered[lane, t, n + i * n + j]
                        for k in range(n):
                            value += product[i, k] * gain[j, k]
                        filtered[lane, t, n + i * n + j] = value
                        filtered[lane, t, n + j * n + i] = value
            after = t
