"""Fits of a model with one more effect, on all runs, and without some of the rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.free_form import FreeForm
from ..effects.parameter import Dimension
from ..effects.record import Record
from .effort import is_spent
from .fitting import FAR, Criterion, Fit, derivatives, minimise, sse_at, sum_up
from .jumps import Scan, search_pattern
from .model import Model, find_best, find_scaled_sse, fit_by_halving, in_order, make_start, without
from .simulator import Simulator
from .smoothing import smooth

HIDDEN = 0.5  # share of the output's power about its mean that a hopeless parent leaves
N_VARIANTS_KEPT = 2  # variants that are followed to the end
AS_GOOD = 10.0  # n log(SSE / SSE) within which variants count as equal
ALIKE = 0.9  # share of the gain of the best variant
COARSE_SIZES = (0.15, 0.05)  # steps of a pattern search, relative
FINE_SIZES = (0.04, 0.013, 0.004)
BEGUN = 4  # iterations of a fit that may come to nothing
LEAST_COARSE_GAIN = 5e-4  # of the power of the output


def extended(
    parent: Model,
    name: str,
    effect: Effect,
    criterion: Criterion,
    coarse: Criterion,
    *,
    start: Mapping[str, float] | None = None,
) -> Model:
    """A fitted model with one more effect, from the best of its variants and starts.

    They are explored under the ``coarse`` criterion, and the best are fitted to the end.
    """
    explored = explore(parent, name, effect, coarse, start=start)
    return finish(parent, name, explored, criterion, coarse)


class Explored(NamedTuple):
    """Variants of an effect at their minima of a coarse criterion, best first.

    Each is its sum of squares, its number, itself and its fit; ``before`` are the squares of the
    parent.
    """

    before: float
    variants: list[tuple[float, int, Effect, Fit]]

    @property
    def gain(self) -> float:
        """Squares that the best saves."""
        return self.before - self.variants[0][0]


def explore(
    parent: Model,
    name: str,
    effect: Effect,
    coarse: Criterion,
    *,
    start: Mapping[str, float] | None = None,
    worth: float = 0.0,
    rough: Model | None = None,
    again: bool = False,
    asked: float = 0.0,
) -> Explored:
    """Variants of one more effect, each from the best of its starts, under a ``coarse`` criterion.

    Those that cannot save the share ``worth`` of the power end early. In a search, ``rough`` is
    what :func:`explored_from` returned for the parent: without it, what other parameters gain on
    the rows of ``coarse`` counts as gain of the effect. ``again`` says that the effect was added to
    a smaller parent before: it is scanned less closely; ``asked`` is the share of the parent's
    squares that a scan has to save, to go on, and a fit ``FAR`` times less before its pattern.
    """
    record = replace(parent.simulator.record, prediction=parent.output)
    core = parent.simulator.core
    if rough is None:
        rough = Model(Simulator(core, parent.effects, coarse.record), parent.fit)
    before = coarse.sse(rough.output)
    explored: list[tuple[float, int, Effect, Fit]] = []
    last: dict[tuple[str, Dimension], float] = {}
    enough = LEAST_COARSE_GAIN * coarse.power
    below = before - min(enough, worth * coarse.power) if worth else np.inf
    scan = Scan(rough, name, effect, coarse, again=again, asked=asked)

    def with_(variant: Effect) -> Simulator:
        return extend_simulator(parent, name, variant, coarse.record)

    for number, variant in enumerate(effect.variants(record)):
        if explored and is_spent():
            break
        least = min((item[0] for item in explored), default=before)
        is_shade = effect.shades and explored and variant.form != explored[0][2].form
        if is_shade and before - least < enough:
            break
        simulator = with_(variant)
        scan = scan.of(variant)
        scanned = variant.scanned(scan, coarse.record) if below > 0.0 else []
        values = [*scanned, *variant.starts(record)]
        starts = [make_start(rough, simulator, name, v) for v in values]
        if effect.place == "delay":
            starts = [restart_core(simulator, coarse, start) for start in starts]
        elif effect.place == "sum":  # an offset may have made the parent's poles slow
            plain = core.starts_for(coarse.record, coarse.record.input)
            starts += [np.r_[own, starts[0][len(own) :]] for own in plain]
        starts += [apply_start(simulator, one, start) for one in starts[:1] if start]
        for other in parent.other_cores:
            starts += [make_start(rough, simulator, name, v, other) for v in values]
        if last:  # what the last variant found, where its parameters have the same units
            known = [(last.get(key), i) for i, key in enumerate(_keys(simulator))]
            same = [np.array([s[i] if v is None else v for v, i in known]) for s in starts]
            starts = [*np.unique(np.clip(same, simulator.low, simulator.high), axis=0), *starts]
        fit = find_best(simulator, coarse, starts, explore=True, below=below).fit
        if effect.place == "output" and before > HIDDEN * coarse.power_about_mean:
            # It hides the output from least squares, so the parent is far off.
            spread = core.spread(coarse.record, coarse.record.input)
            if variant.free_form and spread:  # the curve waits until its core is found
                held = with_(variant.with_values(variant.starts(record)[0]))
                own = parent.theta.size
                kept = [np.r_[one, parent.theta[one.size : own]] for one in spread]
                found = fit_by_halving(held, coarse, kept).fit.theta
                blind = [np.r_[found, starts[-1][own:]]]
            else:
                blind = [np.r_[own, starts[0][len(own) :]] for own in spread]
            fit = fit_by_halving(simulator, coarse, [fit.theta, *blind]).fit
        saved = before - fit.sse
        if not variant.smooth and saved > 0.0 and FAR * saved >= asked * before:
            fit = search_pattern(Model(simulator, fit), name, coarse, COARSE_SIZES).fit
        if before - fit.sse > enough:

            def error_of(other: Effect, theta: np.ndarray = fit.theta) -> float:
                return coarse.sse(with_(other).run(theta))

            adjusted = variant.adjusted(error_of, coarse.record)
            if adjusted is not variant:
                variant, simulator = adjusted, with_(adjusted)
                fit = minimise(simulator, coarse, fit.theta, max_iter=8, tol=2e-4)
        last = dict(zip(_keys(simulator), fit.theta.tolist(), strict=True))
        explored.append((fit.sse, number, variant, fit))
    return Explored(before, sorted(explored, key=lambda item: item[:2]))


def finish(
    parent: Model,
    name: str,
    explored: Explored,
    criterion: Criterion,
    coarse: Criterion,
    *,
    worth: float = 0.0,
) -> Model:
    """The best of variants that were explored, fitted to the end.

    It is if it gained more than twice the share ``worth`` of the power of ``coarse``, or gains more
    than that share after a few iterations under ``criterion``.
    """
    before, gain = explored.before, explored.gain
    enough = LEAST_COARSE_GAIN * coarse.power
    finished: list[tuple[int, Model]] = []
    for sse, number, variant, fit in explored.variants[:N_VARIANTS_KEPT]:
        simulator = extend_simulator(parent, name, variant)
        promising = before - sse > enough
        if finished and (not promising or before - sse < ALIKE * gain):
            break
        followed = promising and before - sse > 2 * worth * coarse.power
        theta, most = fit.theta, 20 if followed else BEGUN if promising else 1
        if worth and not promising:  # a search refines it once more
            theta, most = start_beside(parent, simulator, criterion, theta), 0
        full = minimise(simulator, criterion, theta, max_iter=most)
        if promising and not followed:
            followed = criterion.sse(parent.output) - full.sse > worth * criterion.power
            if followed:
                full = minimise(simulator, criterion, full.theta, max_iter=20)
        model = Model(simulator, full, parent.other_cores)
        if isinstance(variant, FreeForm) and variant.spread is None:
            model = smooth(model, [name]).refined(criterion)
        if followed and not variant.smooth:
            model = search_pattern(model, name, criterion, FINE_SIZES)
        finished.append((number, model))
    assert finished
    least = min(model.sse for _, model in finished)
    # Of equally good variants the first is the plainest, and physical.
    most = least * np.exp(AS_GOOD / criterion.n)
    near = [item for item in finished if item[1].sse <= most]
    return min(near, key=lambda item: item[0])[1]


def begin(parent: Model, name: str, explored: Explored, criterion: Criterion) -> Model:
    """The best of variants that were explored, as it is."""
    *_, variant, fit = explored.variants[0]
    simulator = extend_simulator(parent, name, variant)
    theta = start_beside(parent, simulator, criterion, fit.theta)
    return Model(simulator, minimise(simulator, criterion, theta, max_iter=0), parent.other_cores)


def extend_simulator(
    parent: Model, name: str, variant: Effect, record: Record | None = None
) -> Simulator:
    """The simulator of a parent with one more effect; its record is the parent's unless given."""
    effects = Effects([*parent.effects.steps, (name, variant)])
    record = parent.simulator.record if record is None else record
    return Simulator(parent.simulator.core, effects, record)


def start_beside(
    parent: Model, simulator: Simulator, criterion: Criterion, theta: np.ndarray
) -> np.ndarray:
    """Parameters, with the parent's own if these are better with the effect added."""
    beside = np.r_[parent.theta, theta[parent.theta.size :]]
    return min(theta, beside, key=lambda t: sse_at(simulator, criterion, t))


def explored_from(parent: Model, coarse: Criterion) -> Model:
    """The parent at its own minimum of a coarse criterion, beside which candidates start there."""
    simulator = Simulator(parent.simulator.core, parent.effects, coarse.record)
    fit = minimise(simulator, coarse, parent.theta, max_iter=8, tol=2e-4)
    return Model(simulator, fit, parent.other_cores)


def _keys(simulator: Simulator) -> list[tuple[str, Dimension]]:
    """Names and dimensions of parameters: a threshold may be one of the error, or of the output."""
    dimensions = [parameter.dimension for parameter in simulator.parameters]
    return list(zip(simulator.names, dimensions, strict=True))


def apply_start(
    simulator: Simulator, theta: np.ndarray, start: Mapping[str, float] | None
) -> np.ndarray:
    """A start with the values that a user gave."""
    values = {**dict(zip(simulator.names, theta.tolist(), strict=True)), **(start or {})}
    return np.clip([values[n] for n in simulator.names], simulator.low, simulator.high)


def restart_core(simulator: Simulator, criterion: Criterion, theta: np.ndarray) -> np.ndarray:
    """Parameters, with the core re-estimated by least squares if that is better.

    The parent's core compensates for a wrong delay; with another delay it would lead back to the
    wrong one.
    """
    core = simulator.core
    simulator.run(theta)
    found = core.starts_for(simulator.record, simulator.last_state.command.position)
    again = [np.r_[own, theta[len(core.parameters) :]] for own in found]
    return min([theta, *again], key=lambda t: find_scaled_sse(simulator, criterion, t))


def refit_each_beside(
    model: Model, templates: Mapping[str, Effect], criterion: Criterion, coarse: Criterion
) -> Model:
    """Each effect but the last refitted together with the others, where that is better.

    ``templates`` are effects by their ids, with nothing chosen or estimated.
    """
    names = model.effects.names
    for name, effect in model.effects.steps[:-1]:
        if effect.name in templates:
            template = templates[effect.name]
            if "at" in effect.choices:  # the place was found by likelihood
                template = template.with_choices(at=effect.get_params()["at"])
            again = extended(without(model, name), name, template, criterion, coarse)
            model = again if again.sse < model.sse else model
    return in_order(model, names)


def refit_on_all_runs(model: Model, record: Record) -> Model:
    """A model of some runs of a record, at the minimum of the simulation error of all of them."""
    simulator = Simulator(model.simulator.core, model.effects, record)
    criterion = Criterion(record)
    found = Model(simulator, minimise(simulator, criterion, model.theta), model.other_cores)
    for name, effect in simulator.effects:
        if not effect.smooth:
            found = search_pattern(found, name, criterion, FINE_SIZES)
    return found


HELD_OUT_SIZES = (0.04, 0.013)
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
    """A model refitted to some of the rows, ``train``, to convergence; never worse there than its
    starts.

    Its simulator is that of the whole record, so ``output`` covers the rows left out too.
    ``starts`` are further starting points by name; ``rows`` is what :func:`shared_derivatives`
    returned.
    """
    simulator, inside = model.simulator, criterion.on_rows(train)
    whole = simulator
    if whole.estimates_start:  # by the rows that are fitted alone
        seen = replace(whole.record, known=whole.record.known & train)
        simulator = whole.on_record(seen)
    known = model.values()
    points = [model.theta]
    points += [np.array([{**known, **start}[n] for n in simulator.names]) for start in starts]
    known_sums = [None if rows is None else sum_up(inside, rows), *(None for _ in points[1:])]
    fits = [
        minimise(simulator, inside, point, max_iter=max_iter, tol=tol, at_start=at_start)
        for point, at_start in zip(points, known_sums, strict=True)
    ]
    best = Model(simulator, min(fits, key=lambda fit: fit.sse), model.other_cores)
    for name, effect in simulator.effects:
        if not effect.smooth:
            best = min(
                [best, search_pattern(best, name, inside, HELD_OUT_SIZES)], key=lambda m: m.sse
            )
    return Model(whole, best.fit, model.other_cores)


def shared_derivatives(model: Model, criterion: Criterion) -> np.ndarray | None:
    """Derivatives at a model's parameters, which are the same whatever rows are left out.

    None where fits do not begin with them: initial states are estimated from the rows fitted, an
    output that jumps is scaled at first, the derivatives of a large record are not kept.
    """
    simulator = model.simulator
    record = simulator.record
    if simulator.estimates_start or not simulator.smooth or record.few_runs():
        return None
    within = np.clip(model.theta, simulator.low, simulator.high)
    if not np.array_equal(within, model.theta):
        return None
    rows = derivatives(simulator, criterion, model.theta)
    return rows if np.isfinite(rows).all() else None
