"""What judges a model of a search, in numbers: held-out rows, noise models, traces.

What counts is in :mod:`skhoid.search.judging`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..diagnosis.leaks import LeakTest, leak_test
from ..effects.base import Effect
from ..effects.catalogue import CLASSES
from ..effects.record import (
    PILED,
    PILED_RATES,
    RECURRING,
    Record,
    Signature,
    find_fastest,
    find_step,
    find_stop,
)
from ..model.effort import bounded
from ..model.estimator import vaf_of_output
from ..model.extend import refitted, shared_derivatives
from ..model.fitting import Criterion, minimise, whitened_derivatives
from ..model.likelihood import likeliest, usual_starts
from ..model.loop import MEMORY, LoopSimulator, draw_remnant, find_loop
from ..model.model import Model
from ..model.simulator import Simulator
from .judging import THRESHOLD

TAKEN_BACK = (0.9, 0.8, 0.5)  # shares of the way
RATES = (12.5, 6.25)  # Hz: faster, errors of sensors and simulation count more than the remnant
LOST = 10.0  # by which a larger model that has not been fitted well is worse
LEAST_RATE = 45.0  # Hz, to which records are thinned
ITERATIONS = 10
TOLERANCE = 1e-4
BLOCK = MEMORY  # s, longer than what remnant and loop remember: errors of blocks are apart


@dataclass
class HeldOutRows:
    """Rows to hold out, and rows to fit on, of shape (n_samples, n_runs)."""

    test: np.ndarray
    train: np.ndarray


def held_out(model: Model, criterion: Criterion, folds: Sequence[HeldOutRows]) -> np.ndarray:
    """Free runs of each fold's rows, with parameters one Gauss-Newton step from those of all."""
    simulator, record = model.simulator, model.simulator.record
    output = simulator.run_ahead(model.theta)
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
        theta = np.clip(model.theta + step, simulator.low, simulator.high)
        moved = simulator.run(theta)
        # Beyond the range of its linearisation a step may worsen even its own training rows.
        after = criterion.whitened(criterion.residual(moved)[None])[0].reshape(train.shape)
        if np.sum(after[train] ** 2) <= gram[-1, -1]:
            prediction[fold.test] = simulator.run_ahead(theta)[fold.test]
    assert record.y is not None
    return np.where(np.isfinite(prediction), prediction, 0.0)


def refitted_prediction(
    model: Model, criterion: Criterion, folds: Sequence[HeldOutRows], **ends: Any
) -> np.ndarray:
    """Free runs of each fold's rows with parameters fitted without them; NaN where none settles."""
    prediction = model.output.copy()
    for fold, fitted in without_folds(model, criterion, folds, **ends):
        seen = within_seen(fitted, fold)
        prediction[fold.test] = seen.simulator.run_ahead(seen.theta)[fold.test]
    return prediction


def within_seen(fitted: Model, fold: HeldOutRows) -> Model:
    """A model on the record whose curves end where the channel did that its fold was fitted on."""
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
    return Model(simulator.on_record(record.changed(changed)), fitted.fit, fitted.other_cores)


def without_folds(
    model: Model, criterion: Criterion, folds: Sequence[HeldOutRows], **ends: Any
) -> Iterator[tuple[HeldOutRows, Model]]:
    """Each fold and the model of :func:`refitted_prediction` that was fitted without its rows."""
    rows = shared_derivatives(model, criterion)
    for fold in folds:
        with bounded(fold.train.size):
            fitted = refitted(model, criterion, fold.train, rows=rows, **ends)
        theta = fitted.theta
        for share in TAKEN_BACK:
            if np.isfinite(fitted.output).all():
                break
            fitted = fitted.at(model.theta + share * (theta - model.theta))
        yield fold, fitted


def weigh(parent: Model, model: Model, n: int) -> float:
    """Nats of a model over its parent, both at the minimum of one criterion with n rows."""
    more = model.n_parameters - parent.n_parameters
    ratio = np.log(max(parent.sse, 1e-300) / max(model.sse, 1e-300))
    return float(n * ratio - more * np.log(n)) / 2


def find_thinning(record: Record) -> int:
    """How many rows make one of a record at a rate that is still fast enough to simulate."""
    return max(1, int(1 / (LEAST_RATE * record.dt) + 1e-6))


def thin_rows(record: Record, folds: Sequence[HeldOutRows]) -> tuple[Record, Sequence[HeldOutRows]]:
    """A record at a rate that is still fast enough to simulate, and what folds hold out of it."""
    thin = find_thinning(record) if np.isfinite(record.criterion_rate) else 1
    if thin == 1:
        return record, folds
    rows = [HeldOutRows(fold.test[::thin], fold.train[::thin]) for fold in folds]
    return record.part(np.arange(record.n_runs), thin), rows


class JointParent:
    """A model against which others are judged, each with the noise model that is likeliest with it.

    The noise model of a simulation-error fit holds the bias of the remnant that comes back in the
    error. A model must win at every rate of ``RATES``, so its evidence is the least of them: one
    that wins at a single rate fits an error of the simulation or of a sensor.
    """

    def __init__(self, parent: Model):
        record = parent.simulator.record
        # Evidence at these rates is the same within .3 nats where half of the rows are simulated.
        self.record, _ = thin_rows(record, [])
        self.n_parameters = parent.n_parameters
        self.simulator = simulator = parent.simulator.beside(self.record)
        starts = [parent.theta, *usual_starts(simulator, parent.theta)]
        self.found = [likeliest(simulator, starts, RATES[0])]
        for rate in RATES[1:]:  # its minimum is near that of the rate before
            last = self.found[-1]
            starts = starts if last is None else [last[1], parent.theta]
            self.found.append(likeliest(simulator, starts, rate))

    def weigh(self, model: Model) -> float:
        """Nats of a model over the parent; NaN where that has no maximum itself.

        None is granted to a model without one: nobody who is not misled by the remnant knows it.
        """
        found = np.inf
        for at_parent, rate in zip(self.found, RATES, strict=True):
            found = float(np.minimum(found, self._at_rate(model, at_parent, rate)))
            if not found > THRESHOLD:
                break
        return found

    def _at_rate(self, model: Model, found: tuple[float, np.ndarray] | None, rate: float) -> float:
        simulator, parent = model.simulator.beside(self.record), self.simulator
        shared = [simulator.names.index(name) for name in parent.names]
        starts = [model.theta]
        if found is not None:
            start = model.theta.copy()
            start[shared] = found[1]
            starts.append(start)
        larger = likeliest(simulator, starts, rate)
        if larger is None:
            return np.nan if found is None else 0.0
        fewer = likeliest(parent, [larger[1][shared]], rate, known=found)
        if fewer is None:
            return np.nan
        if fewer[0] < larger[0] - LOST:
            return 0.0
        n = Criterion(simulator.record, rate=rate).n
        added = model.n_parameters - self.n_parameters
        return (fewer[0] - larger[0] - added * float(np.log(n))) / 2


def find_loop_vaf(model: Model, folds: Sequence[HeldOutRows]) -> float:
    """VAF of held-out rows in the closed loop of a record, each fold refitted there.

    With a remnant like the one that the model leaves; NaN where no loop is known or it cannot be
    solved.
    """
    record, core, effects = model.simulator.record, model.simulator.core, model.effects
    thin = find_thinning(record)
    record = record.part(np.arange(record.n_runs), thin) if thin > 1 else record
    loop = find_loop(record)
    if loop is None or record.y is None:
        return np.nan
    left = record.y - Simulator(core, effects, record).run(model.theta)
    loop = replace(loop, remnant=draw_remnant(left, record.known))
    simulator: Any = LoopSimulator(core, effects, record, loop)
    plain = Criterion(record)
    ends: dict[str, Any] = {"max_iter": ITERATIONS, "tol": TOLERANCE}
    fitted = Model(simulator, minimise(simulator, plain, model.theta, **ends))
    if not np.isfinite(fitted.output).all():
        return np.nan
    rows = [HeldOutRows(fold.test[::thin], fold.train[::thin]) for fold in folds]
    predicted = refitted_prediction(fitted, plain, rows, **ends)
    return (
        vaf_of_output(record, predicted) if np.isfinite(predicted[record.known]).all() else np.nan
    )


def test_leak(model: Model) -> LeakTest | None:
    """The leak test of a model's free run; None where x is not known, or nobody steers."""
    record = model.simulator.record
    if record.y is None or record.roles.get(record.inputs[0]) != "e":
        return None
    names: dict[str, str] = {}
    for name, role in record.roles.items():
        if role and record.channels[name].shape == record.y.shape:
            names.setdefault(role, name)
    channels = {role: record.channels[name] for role, name in names.items()}
    told = {getattr(effect, "channel", None) for _, effect in model.effects}
    with np.errstate(all="ignore"):
        return leak_test(
            np.where(record.known, record.y, np.nan),
            model.output,
            channels,
            record.dt,
            told=lambda role: names[role] in told,
            least_delay=record.least_delay or record.dt,
        )


def find_traces(record: Record) -> dict[str, tuple[str, float]]:
    """Stops, rate limits and levels seen in the measured output: a sentence and nats, by effect.

    The nats are those of the samples there (at 12.5 Hz, as neighbours say the same), as counts of
    Poisson, over the most that an output without the effect shows.
    """
    n = float(record.known.sum()) * record.dt / record.time_unit * RATES[0]

    def weigh_share(share: float, usual: float) -> float:
        return n * (share * np.log(share / usual) - share + usual)

    step = find_step(record)
    if step is not None:
        text = f"the output takes few values, {step:.3g} apart"
        return {"quantised": (text, weigh_share(1.0, RECURRING))}
    found = {}
    stop = find_stop(record)
    if stop is not None:
        text = f"{100 * stop.share:.0f} % of the samples lie at {stop.where}"
        found["saturation"] = text, weigh_share(stop.share, PILED)
    fastest = find_fastest(record)
    if fastest is not None:
        share, limit = fastest
        text = f"{100 * share:.0f} % of the rates lie at ±{limit:.3g} per second"
        found["rate_limit"] = text, weigh_share(share, PILED_RATES)
    return found


def noises_in(
    residual: np.ndarray, record: Record, tried: Sequence[Effect]
) -> tuple[list[tuple[Effect, Signature]], list[Signature]]:
    """Effects of ``tried`` that are noise and show in a residual, and signatures of others."""
    by_name = {effect.name: effect for effect in tried if effect.noise}
    named, others = [], []
    for effect in by_name.values():
        found = effect.signature(residual, record)
        if found is not None:
            named.append((effect, found))
    for kind in CLASSES:
        if kind.noise and kind.name not in by_name:
            found = kind().signature(residual, record)
            if found is not None:
                others.append(found)
    return named, others


def without_noise(record: Record, output: np.ndarray, tried: Sequence[Effect]) -> Record | None:
    """A record without the noise of effects of ``tried`` that show beside a model's ``output``.

    A tremor would bend the fit of simulations, which has no noise model. None where nothing shows.
    """
    assert record.y is not None
    parts = [effect.noise_part(record.y - output, record) for effect in tried]
    shown = [part for part in parts if part is not None]
    if not shown:
        return None
    return replace(record, y=record.y - np.sum(shown, axis=0), remembered={})
