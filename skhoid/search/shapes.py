"""Free forms tried where no name fits: which place, and what shape, explain what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.catalogue import FREE_FORMS
from ..effects.composition import Effects
from ..effects.free_form import FreeForm
from ..greybox.extend import extended
from ..greybox.fitting import Criterion, derivatives
from ..greybox.model import Model
from ..greybox.simulator import Simulator
from .candidates import Candidate, SearchStep
from .forward import Search, better
from .leftover import Leftover, judged_columns
from .search_numbers import SearchNumbers
from .verdict import BESIDE_ONE, BESIDE_SEVERAL, Outcome, Verdict, decided, unnamed

NO_NAME = (Outcome.NOT_IN_CATALOGUE, Outcome.NOT_TRIED, Outcome.CUT_SHORT)
FOLLOWED = 4  # forms whose curves are fitted to the end
AS_GOOD = 0.1  # points
NAME = "free"
ONE_FORM = "one free form explains more than all the effects named"


@dataclass(frozen=True)
class Hint:
    """A form on probation: what its curves explain of a residual, linearised."""

    effect: FreeForm
    points: float
    delta_bic: float


def shape_step(search: Search, parent: Model, forms: Sequence[FreeForm]) -> SearchStep:
    """Free forms for a parent, judged as effects with names are, the best first.

    ``parent`` is at the least error of simulation.
    """
    hints = hints_of(search, parent, forms)[:FOLLOWED]
    candidates = []
    for number, hint in enumerate(hints):
        name = f"{NAME}_{number}"
        model = extended(parent, name, hint.effect, search.criterion, search.coarse)
        candidates.append(Candidate(name, dict(model.effects.steps)[name], model=model))
    return search.judged(parent, candidates)


def hints_of(search: Search, parent: Model, forms: Sequence[FreeForm]) -> list[Hint]:
    """Forms at every place where they apply, those first that explain most of held-out rows."""
    record = replace(search.record, prediction=parent.output)
    criterion = Criterion(search.record)
    criterion.set_noise(criterion.remnant_model(parent.output))
    own = derivatives(parent.simulator, criterion, parent.theta)
    found = []
    for form in forms:
        if form.refusal_in(record, search.core.kind):
            continue
        for one in form.alternatives(record):
            for variant in one.variants(record):
                effects = Effects([*parent.effects.steps, (NAME, variant)])
                simulator = Simulator(search.core, effects, search.record)
                values = parent.values()
                theta = np.array([values.get(name, 0.0) for name in simulator.names])
                at = [i for i, name in enumerate(simulator.names) if name not in values]
                columns = derivatives(simulator, criterion, theta)[at]
                result = judged_columns(own, columns, criterion, search.folds)
                if result is not None:
                    found.append(Hint(variant, *result))
    return sorted(found, key=lambda hint: -hint.points)


@dataclass(frozen=True)
class FoundShape:
    """The best free form for a parent, and the step in which it was judged."""

    step: SearchStep
    candidate: Candidate

    @property
    def model(self) -> Model:
        assert self.candidate.model is not None
        return self.candidate.model


def found_shape(search: Search, parent: Model, forms: Sequence[FreeForm]) -> FoundShape | None:
    """The free form that explains most of what a parent leaves; None where none passes."""
    step = shape_step(search, parent, forms)
    return None if step.best is None else FoundShape(step, step.best)


@dataclass(frozen=True)
class Shaped:
    """Numbers and verdict of a search, and the free form that explains what has no name."""

    search: Search
    found: SearchNumbers
    verdict: Verdict
    shape: FoundShape | None


def shaped(search: Search, found: SearchNumbers, *, tries_all: bool) -> Shaped:
    """The verdict, with the shape of what has no name.

    One free form in place of all the effects that were named, which explains more, is structure
    that these leave: they may stand in for something else together.
    """
    verdict = decided(found, tries_all=tries_all)
    if verdict.outcome == Outcome.FOUND and found.added:
        found = beside_one_form(search, found)
        verdict = decided(found, tries_all=tries_all)
    elif verdict.outcome == Outcome.NOTHING and found.left:
        shape = found_shape(search, found.steps[0].plain, forms())
        if shape is None or shape.candidate.gain < BESIDE_ONE[0] * found.share:
            return Shaped(search, found, verdict, None)
        verdict = Verdict(unnamed(tries_all), [], [])
        return Shaped(search, found, verdict, shape)
    if verdict.outcome not in NO_NAME:
        return Shaped(search, found, verdict, None)
    return Shaped(
        search, found, verdict, found_shape(search, unnamed_parent(found, verdict), forms())
    )


def beside_one_form(search: Search, found: SearchNumbers) -> SearchNumbers:
    """The numbers, with what one free form in place of all effects explains beyond them.

    Where it explains as much as several and is likelier, none of these explains its part.
    """
    several = len(found.added) > 1
    least, share = (BESIDE_SEVERAL if several else BESIDE_ONE)[:2]
    baseline = found.steps[0].plain
    most = max([hint.points for hint in hints_of(search, baseline, forms())], default=0.0)
    if most < found.gained + (-AS_GOOD if several else max(least * found.share, share * most)):
        return found
    rival = found_shape(search, baseline, forms())
    if rival is None:
        return found
    excess = rival.candidate.gain - found.gained
    likelier = (
        several and excess > -AS_GOOD and better(search, baseline, rival.model, found.path.model)
    )
    if not likelier and not excess > 0.0:
        return found
    effect: Any = rival.candidate.effect
    more = Leftover("shape", effect.over, ONE_FORM, excess, rival.candidate.delta_bic)
    left = [*found.left, more] if excess >= least * found.share else found.left
    left = sorted(left, key=lambda item: -item.points)
    return replace(found, left=left, one_cause=likelier)


def forms() -> list[FreeForm]:
    """All free forms, with nothing chosen."""
    return [form() for form in FREE_FORMS]


def unnamed_parent(found: SearchNumbers, verdict: Verdict) -> Model:
    """The model with the effects that are named, without those that stand in for others."""
    model = found.path.model
    ids = [dict(model.effects.steps)[name].name for name in found.added]
    kept = sum(1 for name in ids if name in verdict.named)
    return found.steps[kept].plain
