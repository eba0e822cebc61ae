"""Errors of gain, delay and mean of the response as a whole."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.stats import chi2
from scipy.stats import t as t_distribution

from .ceiling import Ceiling, coherent_part
from .signals import Group, Signals
from .tests_table import Test

LONGEST = 0.5  # s, by which a prediction is shifted either way
N_TERMS = 3  # response, its rate, and the rate of that


def linear_misfit(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Gain, lag and bias by which the prediction differs from the measured response.

    The measured output is u = (1 + g) û(t - τ) + b: the residual is regressed on the part of û
    that owes nothing to the remnant of its run, on its rate, and on a constant. A delay that the
    model lacks, and for which one of its lags stands, is looked for by shifts of û.
    """
    responses = _responses(signals)
    if not responses:
        return []
    g, V = np.zeros(3), np.zeros((3, 3))
    for group, response in responses:
        for k, rows in enumerate(group.rows):
            z = response[k]
            rate, ones = np.gradient(z, signals.dt), np.ones(rows.size)
            values = signals.tapered(rows, signals.residual[rows], z, rate, ones)
            white = ceiling.noise.whitened(values, signals.layout.time[rows])
            g += white[:, 1:].T @ white[:, 0]
            V += white[:, 1:].T @ white[:, 1:]
    if np.linalg.cond(V) > 1e12:
        return []
    c, sd = np.linalg.solve(V, g), np.sqrt(np.diag(np.linalg.inv(V)))
    rows = np.concatenate([group.rows.ravel() for group, _ in responses])
    power = np.sum(signals.y[rows] ** 2)
    rate = np.gradient(signals.predicted[rows], signals.dt)
    shares = np.array([np.sum(signals.predicted[rows] ** 2), np.sum(rate**2), rows.size]) / power
    tests = []
    for name, value, spread, sign, share, what in (
        (
            "gain",
            c[0],
            sd[0],
            1,
            shares[0],
            "gain of the measured response, over the predicted, less 1",
        ),
        ("lag", c[1], sd[1], -1, shares[1], "time (s) by which the measured response is later"),
        ("bias", c[2], sd[2], 1, shares[2], "mean of the residual"),
    ):
        z = value / spread
        p = float(2 * t_distribution.sf(abs(z), ceiling.noise.free))
        cost = float(100 * value**2 * share)
        tests.append(
            Test(name, signals.output, z, p, size=sign * value, cost=cost, description=what)
        )
    return [*tests, *_delay(signals, ceiling, responses)]


def _responses(signals: Signals) -> list[tuple[Group, np.ndarray]]:
    """The part of the prediction that is caused from outside the loop, without its mean."""
    found = []
    for group in signals.groups:
        response = coherent_part(signals, group, signals.predicted[group.rows])
        if response is not None:
            response = response - response.mean(axis=1, keepdims=True)
            if response.any():
                found.append((group, response))
    return found


def _delay(
    signals: Signals, ceiling: Ceiling, responses: list[tuple[Group, np.ndarray]]
) -> list[Test]:
    """Would the response fit better later or earlier, if its gain and lags were free.

    u is regressed on û(t - τ) and its first two rates for every shift τ; a lag of the model that
    stands for a delay is then undone by the rates. The statistic is the fall of the whitened sum
    of squares from no shift to the best one.
    """
    n = min(group.n_samples for group, _ in responses)
    longest = min(int(LONGEST / signals.dt), n // 8)
    if longest < 1:
        return []
    lags = np.arange(-longest, longest + 1)
    A, b = np.zeros((2, N_TERMS, N_TERMS)), np.zeros((2, lags.size, N_TERMS))
    power = 0.0
    for group, response in responses:
        for k, rows in enumerate(group.rows):
            u = signals.y[rows] - signals.y[rows].mean()
            terms = [response[k]]
            for _ in range(N_TERMS - 1):
                terms.append(np.gradient(terms[-1], signals.dt))
            plain = signals.tapered(rows, u, *terms)
            power += float(np.sum(u**2))
            white = ceiling.noise.whitened(plain, signals.layout.time[rows])
            for number, values in enumerate((white, plain)):
                size = fft.next_fast_len(rows.size + longest, real=True)
                spectra = fft.rfft(values, size, axis=0)
                cross = fft.irfft(spectra[:, :1] * spectra[:, 1:].conj(), size, axis=0)
                A[number] += values[:, 1:].T @ values[:, 1:]
                b[number] += cross[lags]
    explained = [
        np.einsum("ki,ij,kj->k", part, np.linalg.pinv(gram, rcond=1e-10, hermitian=True), part)
        for gram, part in zip(A, b, strict=True)
    ]
    best = int(np.argmax(explained[0]))
    fall = float(explained[0][best] - explained[0][longest])
    return [
        Test(
            "delay",
            signals.output,
            fall,
            float(chi2.sf(fall, 2)),
            size=float(lags[best] * signals.dt),
            cost=float(100 * max(explained[1][best] - explained[1][longest], 0.0) / power),
            description="delay (s) that the response lacks, with its gain and two lags free",
        )
    ]
