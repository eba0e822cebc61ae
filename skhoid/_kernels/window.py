"""Maximum-likelihood fit of an operator with an AR remnant to pieces of records, by Gauss-Newton.

The dynamics q are log omega_nm, log zeta_nm, tau_e, log omega_nm and log zeta_nm at the end, then
log G and M of each sigmoid; the gains (K_e, K_edot, and their changes) and the states at the
beginning of each piece are linear and are solved for. ``share_of`` has the sigmoid that K_e,
K_edot, omega_nm and zeta_nm follow, or -1.

A row of ``pieces`` holds a piece's first and last + 1 row, the first row from which the error is
known, its first place among the rows of the criterion (every ``thin``-th), and its first and last +
1 place in ``valid``: the rows of the criterion whose prediction error counts.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .kernel import OPTIONS, inner, kernel

N_DYNAMIC = 5
FLOOR = 3e-5  # of the output's power: a smaller residual is hardly taken for coloured noise
STEP = 1e-5  # of dynamics, for central differences
TINY = 1e-24  # squares relative to those of the output, below which a fit is exact
MOST_STEPS, MOST_TRIES = 60, 12
SLOW = 3  # steps in a row that save no more than is settled, where more was predicted
DEPENDENT = 1e-13  # squares of a column relative to what they were before projection


@njit(**OPTIONS, forceinline=True)
def _hold(omega, zeta, dt, out):
    """Fill the matrices of the neuromuscular system for inputs held over a sample.

    Of output and companion: phi, then what a position and a rate command add.
    """
    mean, square = -zeta * omega, omega * omega
    away = mean * mean - square
    root = np.sqrt(abs(away))
    growth = np.exp(mean * dt)
    if root * dt < 1e-4:
        sine = growth * dt * (1.0 + away * dt * dt / 6.0)
        cosine = growth * (1.0 + away * dt * dt / 2.0)
    elif away < 0.0:
        sine, cosine = growth * np.sin(root * dt) / root, growth * np.cos(root * dt)
    else:  # each exponential alone cannot overflow
        slow, fast = np.exp((mean + root) * dt), np.exp((mean - root) * dt)
        sine, cosine = (slow - fast) / (2.0 * root), (slow + fast) / 2.0
    p0, p1 = cosine + sine * mean, sine
    p2, p3 = -sine * square, cosine - sine * mean
    of_rate = square * (p0 - 1.0) + 2.0 * mean * p2
    of_position = square * p1 + 2.0 * mean * (p3 - 1.0)
    out[0], out[1], out[2], out[3] = p0, p1, p2, p3
    out[4], out[5], out[6], out[7] = 1.0 - p3, of_position, square * sine, of_rate


@inner
def _delayed(e, first, last, past, delay, out):
    """The error ``delay`` samples ago at rows ``first`` to ``last``, by Keys's cubic convolution.

    Its slope with respect to the delay is continuous, so that a criterion has no kinks.
    """
    whole = int(np.floor(-delay))
    f = -delay - whole
    w0 = 0.5 * f * (-1.0 + f * (2.0 - f))
    w1 = 1.0 + 0.5 * f * f * (3.0 * f - 5.0)
    w2 = 0.5 * f * (1.0 + f * (4.0 - 3.0 * f))
    w3 = 0.5 * f * f * (f - 1.0)
    top = e.size - 1
    for k in range(first, last):
        i = k + whole
        if i - 1 >= past and i + 2 <= top:
            out[k - first] = w0 * e[i - 1] + w1 * e[i] + w2 * e[i + 1] + w3 * e[i + 2]
        else:
            out[k - first] = (
                w0 * e[min(max(i - 1, past), top)]
                + w1 * e[min(max(i, past), top)]
                + w2 * e[min(max(i + 1, past), top)]
                + w3 * e[min(max(i + 2, past), top)]
            )


@inner
def _coefficients(q, share_of, shares, n, dt, table):
    """Fill the matrices of each row, or of the first where the dynamics are constant."""
    omega, zeta = np.exp(q[0]), np.exp(q[1])
    if share_of[2] < 0 and share_of[3] < 0:
        _hold(omega, zeta, dt, table[0])
        return 0
    more = np.exp(q[3]) - omega if share_of[2] >= 0 else 0.0
    damped = np.exp(q[4]) - zeta if share_of[3] >= 0 else 0.0
    for k in range(n):
        w, z = omega, zeta
        if share_of[2] >= 0:
            w += more * shares[share_of[2], k]
        if share_of[3] >= 0:
            z += damped * shares[share_of[3], k]
        _hold(w, z, dt, table[k])
    return 1


@inner
def _prepare(e, time, piece, dt, q, share_of, delayed, shares, table):
    """Delayed error, sigmoids and matrices on the rows of a piece."""
    first, n = piece[0], piece[1] - piece[0]
    _delayed(e, first, piece[1], piece[2], q[2] / dt, delayed)
    for j in range(shares.shape[0]):
        rate, middle = np.exp(q[N_DYNAMIC + 2 * j]), q[N_DYNAMIC + 1 + 2 * j] + q[2]
        for k in range(n):
            shares[j, k] = 1.0 / (1.0 + np.exp(-rate * (time[first + k] - middle)))
    return _coefficients(q, share_of, shares, n, dt, table)


@inner
def _respond(position, rate, by_row, n, table, varies, start, thin, out):
    """Output every ``thin`` rows; position and rate commands are an input times their factors.

    ``by_row`` has the input, ``position`` and ``rate`` one factor or one for each row.
    """
    y, v = start
    a, b, c, d = table[0, 0], table[0, 1], table[0, 2], table[0, 3]
    py, pv, ry, rv = table[0, 4], table[0, 5], table[0, 6], table[0, 7]
    many = position.size > 1
    at, place = 0, 0
    for k in range(n):
        if at == 0:
            out[place] = y
            place += 1
            at = thin
        at -= 1
        if varies:
            a, b, c, d = table[k, 0], table[k, 1], table[k, 2], table[k, 3]
            py, pv, ry, rv = table[k, 4], table[k, 5], table[k, 6], table[k, 7]
        i = k if many else 0
        p, r = position[i] * by_row[k], rate[i] * by_row[k]
        y, v = a * y + b * v + (py * p + ry * r), c * y + d * v + (pv * p + rv * r)


@inner
def _whiten(column, ar, valid, out):
    for i in range(valid.size):
        at = valid[i]
        total = column[at]
        for j in range(ar.size):
            total += ar[j] * column[at - 1 - j]
        out[i] = total


@inner
def _dot(a, b):
    """Once for all: each array expression in a function takes a tenth of a second to compile."""
    return np.dot(a, b)


@inner
def _add(out, factor, more):
    for i in range(out.size):
        out[i] += factor * more[i]


@inner
def _scale(out, factor):
    for i in range(out.size):
        out[i] *= factor


@inner
def _basis(own, pieces, corner):
    """Make the two columns of states orthonormal in each piece; ``corner`` holds their triangle."""
    for s in range(len(pieces)):
        first, second = own[0, pieces[s, 4] : pieces[s, 5]], own[1, pieces[s, 4] : pieces[s, 5]]
        length = np.sqrt(_dot(first, first))
        _scale(first, 1.0 / length if length > 0.0 else 0.0)
        whole = _dot(second, second)
        along = _dot(first, second)
        _add(second, -along, first)
        rest = _dot(second, second)
        rest = np.sqrt(rest) if rest > DEPENDENT * whole else 0.0
        _scale(second, 1.0 / rest if rest > 0.0 else 0.0)
        corner[s, 0], corner[s, 1], corner[s, 2] = length, along, rest


@inner
def _project(own, pieces, column):
    for s in range(len(pieces)):
        part = column[pieces[s, 4] : pieces[s, 5]]
        for i in range(2):
            base = own[i, pieces[s, 4] : pieces[s, 5]]
            _add(part, -_dot(base, part), base)


@inner
def _solve(normal, right, damping):
    """Solve a symmetric system, scaled to a unit diagonal, with ``damping`` added to that."""
    n = right.size
    scale = np.empty(n)
    for i in range(n):
        scale[i] = 1.0 / np.sqrt(normal[i, i]) if normal[i, i] > 0.0 else 0.0
    lower = np.zeros((n, n))
    x = np.zeros(n)
    for i in range(n):
        for j in range(i + 1):
            total = normal[i, j] * scale[i] * scale[j]
            if i == j:
                total += damping
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                lower[i, i] = np.sqrt(total) if total > 1e-14 else 0.0
            else:
                lower[i, j] = total / lower[j, j] if lower[j, j] > 0.0 else 0.0
    for i in range(n):
        total = right[i] * scale[i]
        for k in range(i):
            total -= lower[i, k] * x[k]
        x[i] = total / lower[i, i] if lower[i, i] > 0.0 else 0.0
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * x[k]
        x[i] = total / lower[i, i] if lower[i, i] > 0.0 else 0.0
    for i in range(n):
        x[i] *= scale[i]
    return x


@inner
def _columns(e, time, pieces, thin, dt, q, share_of, n_shares, out):
    """Responses to unit gains and, in the last two rows, to unit states at the beginning."""
    longest = 0
    for s in range(len(pieces)):
        longest = max(longest, pieces[s, 1] - pieces[s, 0])
    delayed, shares = np.empty(longest), np.empty((n_shares, longest))
    table = np.empty((longest if share_of[2] >= 0 or share_of[3] >= 0 else 1, 8))
    one, none = np.ones(1), np.zeros(1)
    still = np.zeros(longest)
    for s in range(len(pieces)):
        n, to = pieces[s, 1] - pieces[s, 0], pieces[s, 3]
        varies = _prepare(e, time, pieces[s], dt, q, share_of, delayed, shares, table)
        _respond(one, none, delayed, n, table, varies, (0.0, 0.0), thin, out[0, to:])
        _respond(none, one, delayed, n, table, varies, (0.0, 0.0), thin, out[1, to:])
        at = 2
        if share_of[0] >= 0:
            share = shares[share_of[0]]
            zero = np.zeros(longest)
            _respond(share, zero, delayed, n, table, varies, (0.0, 0.0), thin, out[at, to:])
            at += 1
        if share_of[1] >= 0:
            share = shares[share_of[1]]
            zero = np.zeros(longest)
            _respond(zero, share, delayed, n, table, varies, (0.0, 0.0), thin, out[at, to:])
            at += 1
        _respond(none, none, still, n, table, varies, (1.0, 0.0), thin, out[at, to:])
        _respond(none, none, still, n, table, varies, (0.0, 1.0), thin, out[at + 1, to:])


@inner
def simulated(e, time, pieces, thin, dt, q, gains, states, share_of, n_shares, n_rows):
    """Output on the rows of the criterion for given gains and states of each piece."""
    out = np.zeros(n_rows)
    longest = 0
    for s in range(len(pieces)):
        longest = max(longest, pieces[s, 1] - pieces[s, 0])
    delayed, shares = np.empty(longest), np.empty((n_shares, longest))
    table = np.empty((longest if share_of[2] >= 0 or share_of[3] >= 0 else 1, 8))
    size = longest if share_of[0] >= 0 or share_of[1] >= 0 else 1
    position, rate = np.empty(size), np.empty(size)
    for s in range(len(pieces)):
        n = pieces[s, 1] - pieces[s, 0]
        varies = _prepare(e, time, pieces[s], dt, q, share_of, delayed, shares, table)
        at = 2
        for k in range(size):
            position[k], rate[k] = gains[0], gains[1]
        if share_of[0] >= 0:
            _add(position[:n], gains[at], shares[share_of[0]])
            at += 1
        if share_of[1] >= 0:
            _add(rate[:n], gains[at], shares[share_of[1]])
        start = (states[s, 0], states[s, 1])
        _respond(position, rate, delayed, n, table, varies, start, thin, out[pieces[s, 3] :])
    return out


@inner
def evaluated(e, time, y, pieces, valid, thin, dt, q, ar, share_of, n_shares):
    """Best gains and states for given dynamics and noise model, and what they leave.

    Returns the squares of prediction errors; gains; states; the residual on the rows of the
    criterion; prediction errors; whitened and projected columns of the gains; the orthonormal
    columns of the states.
    """
    n_gains = 2 + int(share_of[0] >= 0) + int(share_of[1] >= 0)
    columns = np.zeros((n_gains + 2, y.size))
    _columns(e, time, pieces, thin, dt, q, share_of, n_shares, columns)
    n = valid.size
    white = np.empty((n_gains, n))
    own = np.empty((2, n))
    corner = np.empty((len(pieces), 3))
    for i in range(2):
        _whiten(columns[n_gains + i], ar, valid, own[i])
    _basis(own, pieces, corner)
    target = np.empty(n)
    _whiten(y, ar, valid, target)
    whole = target.copy()
    _project(own, pieces, target)
    kept = np.zeros((n_gains, n))
    for i in range(n_gains):
        _whiten(columns[i], ar, valid, white[i])
        _add(kept[i], 1.0, white[i])
        _project(own, pieces, white[i])
    normal, right = np.empty((n_gains, n_gains)), np.empty(n_gains)
    for i in range(n_gains):
        right[i] = _dot(white[i], target)
        for j in range(i + 1):
            normal[i, j] = normal[j, i] = _dot(white[i], white[j])
    gains = _solve(normal, right, 0.0)
    for i in range(n_gains):
        _add(target, -gains[i], white[i])
        _add(whole, -gains[i], kept[i])
    states = np.zeros((len(pieces), 2))
    residual = y.copy()
    for s in range(len(pieces)):
        a, b = pieces[s, 4], pieces[s, 5]
        if corner[s, 2] > 0.0:
            states[s, 1] = _dot(own[1, a:b], whole[a:b]) / corner[s, 2]
        if corner[s, 0] > 0.0:
            along = _dot(own[0, a:b], whole[a:b]) - corner[s, 1] * states[s, 1]
            states[s, 0] = along / corner[s, 0]
        first = pieces[s, 3]
        last = first + (pieces[s, 1] - pieces[s, 0] + thin - 1) // thin
        for i in range(2):
            _add(residual[first:last], -states[s, i], columns[n_gains + i, first:last])
    for i in range(n_gains):
        _add(residual, -gains[i], columns[i])
    return _dot(target, target), gains, states, residual, target, white, own


@kernel(
    "f8[::1], f8[::1], f8[::1], i8[:,::1], i8[::1], i8, f8, f8[:,::1], f8[::1], i8[::1], i8",
    9,
)
def scanned(e, time, y, pieces, valid, thin, dt, points, ar, share_of, n_shares):
    """Squares of prediction errors at many dynamics, for one noise model."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = evaluated(e, time, y, pieces, valid, thin, dt, points[i], ar, share_of, n_shares)[
            0
        ]
    return out


@inner
def autoregression(residual, valid, order, floor):
    """Coefficients that minimise the squares of prediction errors plus ``floor`` times theirs."""
    normal, right = np.zeros((order, order)), np.zeros(order)
    for i in range(valid.size):
        at = valid[i]
        for j in range(order):
            right[j] -= residual[at - 1 - j] * residual[at]
            for k in range(j + 1):
                normal[j, k] += residual[at - 1 - j] * residual[at - 1 - k]
    for j in range(order):
        normal[j, j] += floor
        for k in range(j):
            normal[k, j] = normal[j, k]
    return _solve(normal, right, 0.0)


@inner
def _slopes(e, time, pieces, valid, thin, dt, q, ar, share_of, n_shares, found, free, out):
    """Derivatives of prediction errors to gains, free dynamics and noise model, one a row."""
    _, gains, states, residual, _, white, own = found
    n_gains = gains.size
    for i in range(n_gains):
        for k in range(valid.size):
            out[i, k] = -white[i, k]
    for i in range(free.size):
        ahead, back = q.copy(), q.copy()
        ahead[free[i]] += STEP
        back[free[i]] -= STEP
        up = simulated(
            e, time, pieces, thin, dt, ahead, gains, states, share_of, n_shares, residual.size
        )
        down = simulated(
            e, time, pieces, thin, dt, back, gains, states, share_of, n_shares, residual.size
        )
        _add(down, -1.0, up)
        _scale(down, 0.5 / STEP)
        _whiten(down, ar, valid, out[n_gains + i])
        _project(own, pieces, out[n_gains + i])
    for j in range(ar.size):
        row = n_gains + free.size + j
        for i in range(valid.size):
            out[row, i] = residual[valid[i] - 1 - j]
        _project(own, pieces, out[row])


@kernel(
    "f8[::1], f8[::1], f8[::1], i8[:,::1], i8[::1], i8, f8, f8[::1], f8[::1], i8[::1], i8, "
    "i8[::1], f8[::1], f8[::1], f8",
    9,
)
def fitted(
    e, time, y, pieces, valid, thin, dt, q, ar, share_of, n_shares, free, low, high, settled
):
    """Minimise the squares of prediction errors over the free dynamics and the noise model.

    Levenberg-Marquardt on all parameters; a dynamic at a bound against which the criterion pushes
    it stays there. Returns squares, gains, states, dynamics, noise model, which of ``free`` are at
    a bound, the normal matrix (gains, free dynamics, noise model), the same with rows weighed by
    squares of prediction errors, and the number of steps.
    """
    q, order, n_free = q.copy(), ar.size, free.size
    for i in free:
        q[i] = min(max(q[i], low[i]), high[i])
    power = 0.0
    for i in valid:
        power += y[i] * y[i]
    floor = FLOOR * power
    found = evaluated(e, time, y, pieces, valid, thin, dt, q, ar, share_of, n_shares)
    loss = found[0] + floor * _dot(ar, ar)
    better = autoregression(found[3], valid, order, floor)
    again = evaluated(e, time, y, pieces, valid, thin, dt, q, better, share_of, n_shares)
    if again[0] + floor * _dot(better, better) < loss:
        found, ar = again, better
        loss = found[0] + floor * _dot(ar, ar)
    n_gains = found[1].size
    size = n_gains + n_free + order
    slopes, kept = np.empty((size, valid.size)), np.empty(size, dtype=np.int64)
    stuck = np.zeros(n_free, dtype=np.bool_)
    normal, gradient = np.empty((size, size)), np.empty(size)
    damping, steps, slow = 1e-3, 0, 0
    for steps in range(MOST_STEPS):  # noqa: B007
        _slopes(e, time, pieces, valid, thin, dt, q, ar, share_of, n_shares, found, free, slopes)
        for i in range(size):
            gradient[i] = -_dot(slopes[i], found[4])
            for j in range(i + 1):
                normal[i, j] = normal[j, i] = _dot(slopes[i], slopes[j])
        for j in range(order):
            gradient[n_gains + n_free + j] -= floor * ar[j]
            normal[n_gains + n_free + j, n_gains + n_free + j] += floor
        n_kept = 0
        for i in range(size):
            if n_gains <= i < n_gains + n_free:
                d = free[i - n_gains]
                at, along = q[d], gradient[i]
                held = (at <= low[d] and along <= 0.0) or (at >= high[d] and along >= 0.0)
                stuck[i - n_gains] = held
                if held:
                    continue
            kept[n_kept] = i
            n_kept += 1
        part, right = np.empty((n_kept, n_kept)), np.empty(n_kept)
        for i in range(n_kept):
            right[i] = gradient[kept[i]]
            for j in range(n_kept):
                part[i, j] = normal[kept[i], kept[j]]
        best = _solve(part, right, 0.0)
        saved = valid.size * _dot(best, right) / max(loss, TINY * power)
        if not saved > settled or slow == SLOW:
            break
        accepted = False
        for _ in range(MOST_TRIES):
            moves = _solve(part, right, damping) if damping > 0.0 else best
            step = np.zeros(size)
            for i in range(n_kept):
                step[kept[i]] = moves[i]
            trial = q.copy()
            for i in range(n_free):
                moved = trial[free[i]] + step[n_gains + i]
                trial[free[i]] = min(max(moved, low[free[i]]), high[free[i]])
            noise = ar.copy()
            _add(noise, 1.0, step[n_gains + n_free :])
            new = evaluated(e, time, y, pieces, valid, thin, dt, trial, noise, share_of, n_shares)
            least = new[0] + floor * _dot(noise, noise)
            if least < loss:
                slow = slow + 1 if valid.size * (loss - least) < settled * loss else 0
                loss = least
                q, ar, found, accepted = trial, noise, new, True
                damping = damping / 10.0 if damping > 1e-7 else 0.0
                break
            damping = max(5.0 * damping, 1e-6)
        if not accepted:
            break
    weighed = np.empty((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            for k in range(valid.size):
                total += slopes[i, k] * slopes[j, k] * found[4][k] * found[4][k]
            weighed[i, j] = weighed[j, i] = total
    return found[0], found[1], found[2], q, ar, stuck, normal, weighed, steps
