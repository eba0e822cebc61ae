"""Errors of gain and delay of the response as a whole."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as t_distribution

from .ceiling import Ceiling, coherent_part
from .signals import Signals
from .tests_table import Test

LONGEST = 1.0  # s, by which a prediction is shifted either way


def linear_misfit(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Gain and delay by which the prediction differs from the measured response.

    The measured output is u = (1 + g) û(t - τ) + ...: the residual is regressed on the part of û
    that owes nothing to the remnant of its run, and on its rate.
    """
    g, V = np.zeros(2), np.zeros((2, 2))
    found = False
    for group in signals.groups:
        response = coherent_part(signals, group, signals.predicted[group.rows])
        if response is None or not response.any():
            continue
        found = True
        for k, rows in enumerate(group.rows):
            time = signals.layout.time[rows]
            rate = np.gradient(response[k], signals.dt)
            values = signals.tapered(rows, signals.residual[rows], response[k], rate)
            white = ceiling.noise.whitened(values, time)
            g += white[:, 1:].T @ white[:, 0]
            V += white[:, 1:].T @ white[:, 1:]
    if not found or np.linalg.cond(V) > 1e12:
        return []
    c, sd = np.linalg.solve(V, g), np.sqrt(np.diag(np.linalg.inv(V)))
    tests = []
    for name, value, spread, factor, what in (
        ("gain", c[0], sd[0], 1.0, "gain of the measured response over the predicted one, less 1"),
        ("delay", c[1], sd[1], -1.0, "time (s) by which the measured response is later"),
    ):
        z = value / spread
        p = float(2 * t_distribution.sf(abs(z), ceiling.noise.free))
        tests.append(Test(name, signals.output, z, p, np.nan, factor * value, description=what))
    return tests
