"""Tests of the residual for errors of gain, lag and mean of the whole response."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as t_distribution

from .ceiling import Ceiling
from .coherent import coherent_part
from .repeats import Group
from .run_signals import Signals
from .tests_table import Test


def linear_misfit(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Gain, lag and bias by which the prediction differs from the measured response.

    The measured output is u = (1 + g) û(t - τ) + b: the residual is regressed on the part of û
    that owes nothing to the remnant of its run, on its rate, and on a constant.
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
    scale = np.sqrt(np.diag(V))
    if np.any(scale == 0) or np.linalg.cond(V / np.outer(scale, scale)) > 1e10:
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
    return tests


def _responses(signals: Signals) -> list[tuple[Group, np.ndarray]]:
    """The part of the prediction that is caused from outside the loop, without its mean."""
    found = []
    for group in signals.groups:
        response = coherent_part(signals, group, "predicted")
        if response is not None:
            response = response - response.mean(axis=1, keepdims=True)
            if response.any():
                found.append((group, response))
    return found
