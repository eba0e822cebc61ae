"""Rows that a search holds out, and what models fitted without them predict there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..model.extend import refitted, shared_derivatives
from ..model.fitting import Criterion, whitened_derivatives
from ..model.model import Model

TAKEN_BACK = (0.9, 0.8, 0.5)  # shares of the way


@dataclass
class HeldOutRows:
    """Rows to hold out, and rows to fit on, of shape (n_samples, n_runs)."""

    test: np.ndarray
    train: np.ndarray


def held_out(model: Model, criterion: Criterion, folds: Sequence[HeldOutRows]) -> np.ndarray:
    """Free runs of each fold's rows with parameters fitted without them.

    The parameters of a fold are one Gauss-Newton step from those of all rows, with the normal
    equations of its training rows; rows in no fold keep the prediction of all rows.
    """
    simulator, record = model.simulator, model.simulator.record
    output = model.output
    prediction = output.copy()
    table = whitened_derivatives(simulator, criterion, model.theta)
    by_row = table.reshape(len(table), *criterion.y.shape)
    variance = float(table[-1] @ table[-1]) / max(criterion.n, 1)
    curvature, slope = simulator.prior.weighing(variance).normal_equations(model.theta)
    inside = (model.theta > simulator.low) & (model.theta < simulator.high)
    if not inside.any():
        return prediction
    for fold in folds:
        train = fold.train[:: criterion.thin]
        rows = by_row[:, train]
        gram = rows @ rows.T
        normal, gradient = gram[:-1, :-1] + curvature, gram[:-1, -1] + slope
        block = normal[np.ix_(inside, inside)]
        ridge = 1e-9 * np.diag(block).max() if block.size else 0.0
        step = np.zeros_like(model.theta)
        scale = np.sqrt(np.maximum(np.diag(block), ridge + 1e-300))
        scaled = block / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        step[inside] = np.linalg.solve(scaled, gradient[inside] / scale) / scale
        moved = simulator.run(np.clip(model.theta + step, simulator.low, simulator.high))
        # Beyond the range of its linearisation a step may worsen even its own training rows.
        after = criterion.whitened(criterion.residual(moved)[None])[0].reshape(train.shape)
        if not np.sum(after[train] ** 2) <= gram[-1, -1]:
            moved = output
        prediction[fold.test] = moved[fold.test]
    assert record.y is not None
    return np.where(np.isfinite(prediction), prediction, 0.0)


def refitted_prediction(
    model: Model, criterion: Criterion, folds: Sequence[HeldOutRows], **ends: Any
) -> np.ndarray:
    """Free runs of each fold's rows with parameters fitted anew without them, to the end.

    Fits end as those of :func:`~skhoid.model.extend.refitted` do, which ``ends`` may set. A fit
    in a loop may end at the brink of what settles, where the loop is not solved again: it is taken
    back towards where it began. NaN where that has no solution either. Curves over a channel hold
    their last value beyond what the rows that were fitted have of it.
    """
    prediction = model.output.copy()
    for fold, fitted in without_folds(model, criterion, folds, **ends):
        prediction[fold.test] = within_seen(fitted, fold).output[fold.test]
    return prediction


def within_seen(fitted: Model, fold: HeldOutRows) -> Model:
    """A model on the record with channels that curves are over within what the fold was fitted on.

    Beyond, the data say nothing of the curve, and a straight line may lead anywhere.
    """
    simulator = fitted.simulator
    record, changed = simulator.record, {}
    for _, effect in fitted.effects:
        name = getattr(effect, "channel", None)
        if not effect.free_form or name is None or getattr(effect, "over", None) != name:
            continue
        channel = record.channel(name)
        seen = channel[fold.train]
        bounded = np.clip(channel, seen.min(), seen.max())
        if (bounded != channel)[fold.test].any():
            changed[name] = bounded
    if not changed:
        return fitted
    return Model(simulator.on(record.changed(changed)), fitted.fit, fitted.other_cores)


def without_folds(
    model: Model, criterion: Criterion, folds: Sequence[HeldOutRows], **ends: Any
) -> Iterator[tuple[HeldOutRows, Model]]:
    """Each fold and the model of :func:`refitted_prediction` that was fitted without its rows."""
    rows = shared_derivatives(model, criterion)
    for fold in folds:
        fitted = refitted(model, criterion, fold.train, rows=rows, **ends)
        theta = fitted.theta
        for share in TAKEN_BACK:
            if np.isfinite(fitted.output).all():
                break
            fitted = fitted.at(model.theta + share * (theta - model.theta))
        yield fold, fitted
