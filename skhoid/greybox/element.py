"""The controlled element (K_c, omega_b) estimated from the recorded u and x."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..effects.record import Record
from ..human import LinearElement

WORST_FIT = 0.2  # largest share of the power of x that may stay unexplained


def estimate_element(record: Record) -> LinearElement | None:
    """K_c and omega_b from u and x by least squares on integrals of dx/dt = v, dv/dt = K_c u - ...

    x(t) = K_c (integral of integral of u) - omega_b (integral of x) + c_0 + c_1 t for each run; a
    measured disturbance adds to u. None where x is not measured or does not answer u in this way.
    """
    names = record.with_role("x")
    if not names or record.y is None:
        return None
    K_c = omega_b = 0.0
    columns, target = [], []
    disturbances = record.with_role("dist")
    for disturbed in [*disturbances[:1], None]:
        rows_of = []
        for j in range(record.n_runs):
            known = np.flatnonzero(record.known[:, j])
            if known.size < 50:
                continue
            span = slice(known[0], known[-1] + 1)
            # Pieces of some seconds, each with its own start, so that integrals forget slow errors.
            for piece in _pieces(span, round(8.0 / record.dt)):
                x = record.channels[names[0]][piece, j]
                u = record.y[piece, j]
                if disturbed is not None:
                    u = u + record.channels[disturbed][piece, j]
                t = np.arange(x.size) * record.dt
                once = cumulative_trapezoid(x, dx=record.dt, initial=0)
                twice = cumulative_trapezoid(
                    cumulative_trapezoid(u, dx=record.dt, initial=0), dx=record.dt, initial=0
                )
                nuisance = np.stack([np.ones_like(t), t], 1)
                block = np.stack([twice, -once, x], 1)
                block -= nuisance @ np.linalg.lstsq(nuisance, block, rcond=None)[0]
                rows_of.append(block)
        if not rows_of:
            return None
        table = np.concatenate(rows_of)
        solved, *_ = np.linalg.lstsq(table[:, :2], table[:, 2], rcond=None)
        error = table[:, 2] - table[:, :2] @ solved
        columns.append(solved)
        target.append(float(error @ error) / max(float(table[:, 2] @ table[:, 2]), 1e-300))
    best = int(np.argmin(target))
    K_c, omega_b = columns[best]
    if target[best] > WORST_FIT or not K_c > 0:
        return None
    return LinearElement((float(K_c),), (1.0, float(max(omega_b, 0.0)), 0.0))


def _pieces(span: slice, length: int) -> list[slice]:
    starts = range(span.start, span.stop - length // 2, length)
    return [slice(s, min(s + length, span.stop)) for s in starts]
