"""Fits without some of the rows, to score rows that no fit has seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .fitting import Criterion, derivatives, minimise, sums_of
from .initial import ESTIMATE
from .jumps import searched
from .model import Model

SIZES = (0.04, 0.013)  # steps of a pattern search, relative
MOST_ITERATIONS = 40
TOLERANCE = 1e-6


def refitted(
    model: Model,
    criterion: Criterion,
    train: np.ndarray,
    *,
    starts: Iterable[dict[str, float]] = (),
    rows: np.ndarray | None = None,
    max_iter: int = MOST_ITERATIONS,
    tol: float = TOLERANCE,
) -> Model:
    """A model refitted to some of the rows, to convergence.

    Its simulator is that of the whole record, so ``output`` covers the rows left out too; estimated
    initial states are those that fit all known rows of each run.

    Parameters
    ----------
    model : Model
        The effects and their choices, and where the fit starts.
    criterion : Criterion
        On the record of the model, with the noise model to keep.
    train : ndarray of bool of shape (n_samples, n_runs)
        Rows to fit on, at the full rate of the record.
    starts : iterable of dict of str to float
        Further starting points, by parameter name, such as ``values()`` of the model without the
        last effect; parameters not named start at the model's values.
    rows : ndarray or None, default=None
        What :func:`shared_derivatives` returned for the model; None: each fit computes its own.
    max_iter, tol : int and float
        Where fits end, as in :func:`~skhoid.model.fitting.minimise`.

    Returns
    -------
    fitted : Model
        Never worse on its rows than at any of its starts.
    """
    simulator, inside = model.simulator, criterion.on(train)
    whole = simulator
    if whole.record.initial == ESTIMATE:  # by the rows that are fitted alone
        seen = replace(whole.record, known=whole.record.known & train)
        simulator = whole.on(seen)
    known = model.values()
    points = [model.theta]
    points += [np.array([{**known, **start}[n] for n in simulator.names]) for start in starts]
    known_sums = [None if rows is None else sums_of(inside, rows), *(None for _ in points[1:])]
    fits = [
        minimise(simulator, inside, point, max_iter=max_iter, tol=tol, at_start=at_start)
        for point, at_start in zip(points, known_sums, strict=True)
    ]
    best = Model(simulator, min(fits, key=lambda fit: fit.sse), model.other_cores)
    for name, effect in simulator.effects:
        if not effect.smooth:
            best = min([best, searched(best, name, inside, SIZES)], key=lambda m: m.sse)
    return Model(whole, best.fit, model.other_cores)


def shared_derivatives(model: Model, criterion: Criterion) -> np.ndarray | None:
    """Derivatives at a model's parameters, which are the same whatever rows are left out.

    None where fits do not begin with them: initial states are estimated from the rows fitted, an
    output that jumps is scaled at first, the derivatives of a large record are not kept.
    """
    simulator = model.simulator
    record = simulator.record
    if record.initial == ESTIMATE or not simulator.smooth or record.few_runs():
        return None
    within = np.clip(model.theta, simulator.low, simulator.high)
    if not np.array_equal(within, model.theta):
        return None
    rows = derivatives(simulator, criterion, model.theta)
    return rows if np.isfinite(rows).all() else None
