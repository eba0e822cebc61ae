"""Slow, readable twins of the compiled loops and of the array code: one row at a time.

They share no code with the package. Runs are given as stretches ``(begin, end)`` of rows.
"""

import numpy as np
from scipy.linalg import solve_toeplitz


def regressor_rows(y, X, stretches, na, nb, nk, intercept=False):
    """Eq. 10 for every row whose lags are known: inside its own stretch, and none of them NaN.

    Returns the regression vectors, the outputs, the rows, and how many rows NaN cost.
    """
    phi, output, rows, n_missing = [], [], [], 0
    for begin, end in stretches:
        for t in range(begin, end):
            wanted = [(y, t - i, -1.0) for i in range(1, na + 1)]
            for j in range(X.shape[1]):
                wanted += [(X[:, j], t - nk[j] - k, 1.0) for k in range(nb[j])]
            if any(row < begin for _, row, _ in wanted):
                continue
            values = [sign * float(signal[row]) for signal, row, sign in wanted]
            if intercept:
                values.append(1.0)
            if np.isnan([*values, y[t]]).any():
                n_missing += 1
                continue
            phi.append(values)
            output.append(float(y[t]))
            rows.append(t)
    n_params = na + sum(nb) + intercept
    return np.array(phi).reshape(-1, n_params), np.array(output), np.array(rows, int), n_missing


def one_step(t, history, X, a, b, nk, intercept, first_input):
    """Eq. 6 in row t; ``history[i]`` is the output i + 1 rows before it."""
    value = intercept
    for j, coefficients in enumerate(b):
        for k, coefficient in enumerate(coefficients):
            row = t - nk[j] - k
            if row >= first_input:
                value += coefficient * X[row, j]
    for i, coefficient in enumerate(a):
        value -= coefficient * history[i]
    return value


def free_run(X, stretches, a, b, nk, intercept=0.0, past=None, y0=None, bound=1e100):
    """Simulate from the inputs alone; ``past[s]`` is the first row whose inputs are known."""
    out = np.zeros(len(X))
    for s, (begin, end) in enumerate(stretches):
        history = [0.0] * len(a) if y0 is None else [float(v) for v in y0[s][: len(a)]]
        first_input = begin if past is None else past[s]
        for t in range(begin, end):
            value = one_step(t, history, X, a, b, nk, intercept, first_input)
            out[t] = max(-bound, min(bound, value))
            history = [out[t], *history][: len(a)]
    return out


def predict_ahead(y, X, stretches, a, b, nk, intercept=0.0, horizon=1, bound=1e100):
    """Simulate each row afresh from what was measured up to ``horizon`` rows before it."""
    out = np.zeros(len(y))
    for begin, end in stretches:
        measured = {}
        for t in range(begin, end):
            last_known = t - horizon
            history = {row: measured[row] for row in range(begin, min(last_known, t - 1) + 1)}
            for row in range(max(begin, last_known + 1), t + 1):
                lags = [history.get(row - 1 - i, 0.0) for i in range(len(a))]
                value = one_step(row, lags, X, a, b, nk, intercept, begin)
                history[row] = max(-bound, min(bound, value))
            out[t] = history[t]
            if np.isnan(y[t]):
                lags = [measured.get(t - 1 - i, 0.0) for i in range(len(a))]
                value = one_step(t, lags, X, a, b, nk, intercept, begin)
                measured[t] = max(-bound, min(bound, value))
            else:
                measured[t] = float(y[t])
    return out


def one_step_losses(y, X, stretches, na, nb, candidates, intercept=False):
    """Mean squared one-step error (Eq. 24) of each ``nk``, on the rows that all of them know."""
    n_inputs = X.shape[1]
    common = None
    tables = []
    for nk in candidates:
        nks = [nk] * n_inputs if np.ndim(nk) == 0 else list(nk)
        tables.append(regressor_rows(y, X, stretches, na, [nb] * n_inputs, nks, intercept)[:3])
        rows = set(tables[-1][2].tolist())
        common = rows if common is None else common & rows
    losses = []
    for phi, output, rows in tables:
        kept = [i for i, row in enumerate(rows.tolist()) if row in common]
        theta = np.linalg.lstsq(phi[kept], output[kept], rcond=None)[0]
        losses.append(np.mean((output[kept] - phi[kept] @ theta) ** 2))
    return np.array(losses)


def vaf(measured, simulated):
    """Eq. 25 in percent, unclipped; rows that were not measured are left out."""
    lost = power = 0.0
    for u, u_hat in zip(measured, simulated, strict=True):
        if not np.isnan(u):
            lost += (u - u_hat) ** 2
            power += u**2
    return 100 * (1 - lost / power)


def brick_wall(signal, factor):
    """Keep what lies below the Nyquist frequency of every ``factor``-th row, by an explicit DFT."""
    n = len(signal)
    t = np.arange(n)
    out = np.zeros(n)
    for k in range(-(n // 2), n - n // 2):
        if abs(k) / n < 0.5 / factor:  # cycles a row
            wave = np.exp(2j * np.pi * k * t / n)
            out += (np.vdot(wave, signal) / n * wave).real
    return out


def block_mean(signal, factor):
    """In every row, the mean of it and the ``factor - 1`` rows after it, where there are any."""
    return np.array([np.mean(signal[t : t + factor]) for t in range(len(signal))])


def delay(signal, n_samples, stretches):
    """Each row holds what was there ``n_samples`` before it in its stretch; NaN without a past."""
    out = np.full(len(signal), np.nan)
    for begin, end in stretches:
        for t in range(begin, end):
            if t - n_samples >= begin:
                out[t] = signal[t - n_samples]
    return out


def measurements(y, X, stretches, numbers, na, nb, nk, intercept=False):
    """Instants of pooled runs, each the list of its ``(row, phi, u)``, in the order of the runs.

    ``numbers[row]`` is the sample number of a row in its run; an instant is a number that any row
    has.
    """
    phi, output, rows, _ = regressor_rows(y, X, stretches, na, nb, nk, intercept)
    order = {number: at for at, number in enumerate(sorted(set(numbers)))}
    instants = [[] for _ in order]
    for vector, u, row in zip(phi, output, rows, strict=True):
        instants[order[numbers[row]]].append((int(row), vector, u))
    return instants


def forget(P, factors, form):
    """Eq. 20, or only the diagonal of P divided by the factors."""
    root = 1 / np.sqrt(factors)
    if form == "joint":
        return P * np.outer(root, root)
    return P + np.diag(np.diag(P) * (1 / factors - 1))


def rls_update(theta, P, phi, u):
    """Eqs. 11-14 and 18-19, the product of Eq. 19 in the right order; also error and alpha."""
    error = u - phi @ theta
    alpha = 1 + phi @ P @ phi
    gain = P @ phi / alpha
    P = P - np.outer(gain, phi @ P)
    return theta + gain * error, (P + P.T) / 2, error, alpha


def recursive_least_squares(
    instants, forgetting, theta0, P0, form="joint", resets=(), dtype=np.longdouble
):
    """Eqs. 11-20 instant by instant; an instant without a measurement forgets nothing.

    ``forgetting`` is a number, one per instant, or instants by parameters. At the instants
    ``resets`` P is P0 again, before forgetting. Returns the paths of theta, of P and of the
    forgotten P before its update, and ``{row: (error, alpha)}``.
    """
    theta, P0 = np.array(theta0, dtype), np.array(P0, dtype)
    factors = np.array(forgetting, dtype)
    factors = factors[:, None] if factors.ndim == 1 else factors
    factors = np.broadcast_to(factors, (len(instants), theta.size))
    P = P0
    thetas, Ps, forgotten, errors = [], [], [], {}
    for t, found in enumerate(instants):
        if t in resets:
            P = P0
        if found:
            P = forget(P, factors[t], form)
        forgotten.append(P)
        for row, phi, u in found:
            theta, P, error, alpha = rls_update(theta, P, phi.astype(dtype), dtype(u))
            errors[row] = (error, alpha)
        thetas.append(theta)
        Ps.append(P)
    return np.array(thetas), np.array(Ps), np.array(forgotten), errors


def weighted_least_squares(instants, forgetting, theta0, P0, at, negligible=1e-25):
    """Minimise Eq. 4.21 plus the discounted prior, by QR, for each of the instants ``at``.

    Rows of weight below ``negligible`` are left out.
    """
    factors = np.broadcast_to(np.asarray(forgetting, float), len(instants))
    measured = [bool(found) for found in instants]
    age = np.cumsum(np.where(measured, np.log(factors), 0.0))  # log of the weight of the prior
    table = [(t, *phi, u) for t, found in enumerate(instants) for _, phi, u in found]
    table = np.array(table).reshape(-1, len(theta0) + 2)
    when = table[:, 0].astype(int)
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(P0, float)))
    prior = np.column_stack([root, root @ theta0])
    thetas = []
    for t in at:
        past = table[when <= t]
        weight = np.exp(age[t] - age[when[when <= t]])
        rows = (np.sqrt(weight)[:, None] * past[:, 1:])[weight > negligible]
        R = np.linalg.qr(np.vstack([prior * np.exp(age[t] / 2), rows]), mode="r")
        p = len(theta0)
        thetas.append(np.linalg.solve(R[:p, :p], R[:p, p]))
    return np.array(thetas)


def variable_forgetting(instants, horizon, theta0, P0):
    """Fortescue, Kershenbaum and Ydstie (1981): the larger the error, the more is forgotten.

    Returns the path of theta and the factor of each instant, 1 - 1 / horizon at first.
    """
    theta, P = np.array(theta0, float), np.array(P0, float)
    factor, squares = 1 - 1 / horizon, []
    thetas, factors = [], []
    for found in instants:
        factors.append(factor)
        P = P / factor if found else P
        for _, phi, u in found:
            theta, P, error, alpha = rls_update(theta, P, phi, u)
            squares.append(error**2 / alpha)
        if found:
            latest = np.mean(squares[-len(found) :])
            factor = max(0.5, 1 - latest / (np.mean(squares) * horizon))
        thetas.append(theta)
    return np.array(thetas), np.array(factors)


def predictive_log_likelihood(errors):
    """Of one-step predictions with variances s2 alpha, s2 the one that makes it largest."""
    squares = [error**2 / alpha for error, alpha in errors]
    variance = np.mean(squares)
    terms = [
        np.log(2 * np.pi * variance * alpha) + square / variance
        for square, (_, alpha) in zip(squares, errors, strict=True)
    ]
    return float(-0.5 * np.sum(terms))


def smooth_path(thetas, Ps, forgotten):
    """Rauch, Tung and Striebel (1965) for a random walk with increments forgotten[t] - Ps[t-1]."""
    thetas, Ps, forgotten = (np.array(path, float) for path in (thetas, Ps, forgotten))
    smoothed, covariance = thetas.copy(), Ps.copy()
    for t in range(len(thetas) - 2, -1, -1):
        gain = Ps[t] @ np.linalg.inv(forgotten[t + 1])
        smoothed[t] += gain @ (smoothed[t + 1] - thetas[t])
        covariance[t] += gain @ (covariance[t + 1] - forgotten[t + 1]) @ gain.T
    return smoothed, covariance


def free_run_along(X, stretches, split, path, nk, past=None, bound=1e100):
    """Free run, row t with the parameters ``path[t]``; ``split`` makes a, b, intercept of them."""
    out = np.zeros(len(X))
    for s, (begin, end) in enumerate(stretches):
        first_input = begin if past is None else past[s]
        history = [0.0] * len(split(path[begin])[0])
        for t in range(begin, end):
            a, b, intercept = split(path[t])
            value = one_step(t, history, X, a, b, nk, intercept, first_input)
            out[t] = max(-bound, min(bound, value))
            history = [out[t], *history][: len(a)]
    return out


def predict_ahead_along(y, X, stretches, split, path, nk, horizon):
    """As ``predict_ahead``, the prediction of row t with the parameters ``path[t]``."""
    out = np.zeros(len(y))
    for begin, end in stretches:
        measured = {}

        def value_at(row, history, target, begin=begin):
            a, b, intercept = split(path[target])
            lags = [history.get(row - 1 - i, 0.0) for i in range(len(a))]
            return one_step(row, lags, X, a, b, nk, intercept, begin)

        for t in range(begin, end):
            history = {row: value for row, value in measured.items() if row <= t - horizon}
            for row in range(max(begin, t - horizon + 1), t + 1):
                history[row] = value_at(row, history, t)
            out[t] = history[t]
            measured[t] = value_at(t, measured, t) if np.isnan(y[t]) else float(y[t])
    return out


def robust_covariance(weights, leverage, errors):
    """Covariance of weights' errors of one run without gaps, by matrices of all pairs of rows."""
    n, p = weights.shape
    gamma = np.array([errors[k:] @ errors[: n - k] / n for k in range(min(20, n // 10) + 1)])
    models = [(n * np.log(gamma[0]), np.ones(1), gamma[0])]
    for order in range(1, min(int(10 * np.log10(n)), n // 10) + 1):
        a = solve_toeplitz(gamma[:order], gamma[1 : order + 1])
        left = gamma[0] - a @ gamma[1 : order + 1]
        models.append((n * np.log(left) + order * np.log(n), np.r_[1.0, -a], left))
    _, D, variance = min(models, key=lambda model: model[0])
    impulse = np.zeros(2 * n)
    for t in range(2 * n):
        impulse[t] = (t == 0) - sum(D[i] * impulse[t - i] for i in range(1, min(D.size, t + 1)))
    before = n if D.size > 1 else 0
    H = np.zeros((n, n + before))  # errors from white ones, of rows before the first too
    for t in range(n):
        for s in range(t + before + 1):
            H[t, s] = impulse[t + before - s]
    moved = H.T @ weights
    acting = moved[before:]
    white = [sum(D[i] * errors[t - i] for i in range(min(D.size, t + 1))) for t in range(n)]
    scores = acting * (np.array(white) / np.sqrt(1 - np.minimum(leverage, 0.99)))[:, None]
    above = below = 0.0
    for score in scores.T:
        rho = 0.97 * (score[1:] @ score[:-1]) / (score @ score)
        above += 4 * rho**2 / ((1 - rho) ** 6 * (1 + rho) ** 2)
        below += 1 / (1 - rho) ** 4
    lags = min(1.1447 * (above / below * n) ** (1 / 3), n // 4)
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    kernel = np.where(apart <= lags, 1 - apart / (lags + 1), 0.0)
    long_run = scores.T @ kernel @ scores
    stationary = moved.T @ moved * variance * n / (n - p)
    squares = acting**2
    known = squares.sum(axis=0) ** 2 / np.diag(squares.T @ kernel**2 @ squares)
    share, rest = (np.diag(np.sqrt(x / (known + 30))) for x in (known, 30.0))
    return share @ long_run @ share + rest @ stationary @ rest
