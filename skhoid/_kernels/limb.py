"""Compiled response of a limb with dry friction."""

from __future__ import annotations

import numpy as np

from .kernel import kernel


@kernel("f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8, f8[::1], f8", 1)
def rubbing(position, rate, matrices, omega, zeta, friction, spring, bound):
    """Response from rest of a second-order system whose motion friction opposes.

    As ``second_order``, with a force ``friction`` against the motion, in units of the position
    command: held over each step, it is the one that brings the rate at the end of the step to zero,
    or as near as its size allows (Moreau's time stepping). So it sticks without chattering at any
    step. omega and zeta are of one sample or of each, as ``matrices`` are. The cubic and square
    force ``spring`` of the output is that at the beginning of a step.
    """
    n, runs = position.shape
    out = np.empty((n, runs))
    z, v = np.zeros(runs), np.zeros(runs)
    out[0] = 0.0
    varies = matrices.shape[0] > 1
    for k in range(n - 1):
        i = k if varies else 0
        q = matrices[i]
        square, damping = omega[i] * omega[i], 2.0 * zeta[i] * omega[i]
        by_z, by_v = q[4] + q[8], q[6] + q[10]  # of a force that is held
        by_rate = by_v - damping * by_z
        for j in range(runs):
            force = (spring[0] * z[j] * z[j] + spring[1] * abs(z[j])) * z[j]
            p0, p1 = position[k, j] - force, position[k + 1, j] - force
            r0, r1 = rate[k, j], rate[k + 1, j]
            new = q[0] * z[j] + q[1] * v[j] + q[4] * p0 + q[5] * r0 + q[8] * p1 + q[9] * r1
            beside = q[2] * z[j] + q[3] * v[j] + q[6] * p0 + q[7] * r0 + q[10] * p1 + q[11] * r1
            held = (beside - damping * new + square * r1) / by_rate
            held = min(max(held, -friction), friction)
            z[j] = min(max(new - held * by_z, -bound), bound)
            v[j] = beside - held * by_v
            out[k + 1, j] = z[j]
    return out
