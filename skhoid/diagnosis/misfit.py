"""Errors of gain and delay of the response as a whole."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as t_distribution

from .ceiling import Ceiling, coherent_part
from .signals import Signals
from .tests_table import Test


def linear_misfit(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Gain, delay and bias by which the prediction differs from the measured response.

    The measured output is u = (1 + g) û(t - τ) + b: the residual is regressed on the part of û
    that owes nothing to the remnant of its run, on its rate, and on a constant.
    """
    g, V = np.zeros(3), np.zeros((3, 3))
    found = False
    for group in signals.groups:
        response = coherent_part(signals, group, signals.predicted[group.rows])
        if response is None or not response.any():
            continue
        found = True
        for k, rows in enumerate(group.rows):
            time = signals.layout.time[rows]
            rate = np.gradient(response[k], signals.dt)
            z = response[k] - response[k].mean()
            ones = np.ones(rows.size)
            values = signals.tapered(rows, signals.residual[rows], z, rate, ones)
            white = ceiling.noise.whitened(values, time)
            g += white[:, 1:].T @ white[:, 0]
            V += white[:, 1:].T @ white[:, 1:]
    if not found or np.linalg.cond(V) > 1e12:
        return []
    c, sd = np.linalg.solve(V, g), np.sqrt(np.diag(np.linalg.inv(V)))
    rows = np.concatenate([group.rows.ravel() for group in signals.groups])
    power = np.sum(signals.y[rows] ** 2)
    rate = np.gradient(signals.predicted[rows], signals.dt)
    shares = (
        np.sum(signals.predicted[rows] ** 2) / power,
        np.sum(rate**2) / power,
        rows.size / power,
    )
    tests = []
    for name, value, spread, factor, share, what in (
        (
            "gain",
            c[0],
            sd[0],
            1.0,
            shares[0],
            "gain of the measured response, over the predicted, less 1",
        ),
        ("delay", c[1], sd[1], -1.0, shares[1], "time (s) by which the measured response is later"),
        ("bias", c[2], sd[2], 1.0, shares[2], "mean of the residual"),
    ):
        z = value / spread
        p = float(2 * t_distribution.sf(abs(z), ceiling.noise.free))
        cost = float(100 * value**2 * share)
        tests.append(
            Test(name, signals.output, z, p, size=factor * value, cost=cost, description=what)
        )
    return tests
