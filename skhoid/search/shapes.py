"""Free forms tried where no name fits: which place, and what shape, explain what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.base import Effect
from ..effects.catalogue import FREE_FORMS
from ..effects.composition import Effects
from ..effects.free_form import FEWEST, FreeForm
from ..effects.free_forms import one_sided
from ..effects.record import Record
from ..model.extend import extended
from ..model.fitting import Criterion, derivatives, scaled_inverse
from ..model.model import Model
from ..model.simulator import Simulator
from .candidates import LEAST_DELTA_BIC, LEAST_GAIN, Candidate, SearchStep
from .forward import Search, lead, output_error_fit
from .held_out import HeldOutRows
from .leftover import Leftover, points_gained
from .search_numbers import SearchNumbers
from .statuses import Verdict
from .verdict import BESIDE_ONE, BESIDE_SEVERAL, Ending, decided, unnamed

FOLLOWED = 4  # forms whose curves are fitted to the end
AS_GOOD = 0.1  # points
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the prior, times the usual one
NAME = "free"
HOPEFUL = 0.5  # times what the effects found gain: at least what a form explains, linearised
TRIED = 3  # forms that are fitted in place of effects with names
BEHIND, LINEAR = "behind the muscles' delay", "linear"
# A linear answer may be a delay, dynamics or a path, and a path may answer the size of the error.
GROUPS = {
    "delay": frozenset({LINEAR}),
    "path": frozenset({LINEAR, "input"}),
    "command": frozenset({LINEAR, BEHIND}),
    "spring": frozenset({BEHIND}),
    "output": frozenset({BEHIND}),
    "inside": frozenset({BEHIND}),
}
ONE_FORM = "one free form explains more than all the effects named"


@dataclass(frozen=True)
class Hint:
    """A form on probation: what its curves explain of a residual, linearised."""

    effect: FreeForm
    points: float
    delta_bic: float


def forms_judged(search: Search, parent: Model, forms: list[Candidate]) -> SearchStep:
    """Free forms for a parent, at the least error of simulation, judged as effects with names are.

    From what is far from linear one Gauss-Newton step does not lead to the fit of a fold: those are
    refitted.
    """
    step = search.judged(parent, forms)
    far = [one for one in forms if one.model is not None and is_far(one.effect, search.record)]
    for one in far:
        assert one.model is not None
        one.vaf = search.refit(one.model)
        one.gain = one.vaf - max(step.vaf, step.refitted_vaf)
    if far:
        step.rank()
    return step


def is_far(form: Any, record: Record) -> bool:
    """Whether a form begins far from what is linear."""
    return any(form.starts(record)[0].values())


def candidates_of(
    search: Search, parent: Model, hints: Sequence[Hint], first: int = 0
) -> list[Candidate]:
    """Free forms, fitted beside a parent; the ``first`` of their numbers."""
    candidates = []
    for number, hint in enumerate(hints, first):
        name = f"{NAME}_{number}"
        model = extended(parent, name, hint.effect, search.criterion, search.coarse)
        candidates.append(Candidate(name, dict(model.effects.steps)[name], model=model))
    return candidates


def best_of(search: Search, step: SearchStep) -> Candidate | None:
    """The best form, with what it gains where folds are refitted, as it is told of names."""
    best = step.best
    if best is None or best.model is None:
        return None
    vaf = search.refit(best.model)
    return replace(best, vaf=vaf, gain=vaf - step.refitted_vaf)


def hints_of(search: Search, parent: Model) -> list[Hint]:
    """Forms at every place where they apply, those first that explain most of held-out rows.

    Of those that explain about as much, the likeliest: a level is less than a map that has one.
    """
    record = replace(search.record, prediction=parent.output)
    criterion = Criterion(search.record)
    criterion.set_noise(criterion.remnant_model(parent.output))
    own, values = derivatives(parent.simulator, criterion, parent.theta), parent.values()
    found = []
    for form in (form() for form in FREE_FORMS):
        if form.refusal_in(record, search.core.kind):
            continue
        for one in form.alternatives(record):
            for variant in one.variants(record):
                if len(variant.knots) < FEWEST:
                    continue  # what does not move has no curve
                if is_far(variant, record):
                    if one_sided(record):
                        found.append(Hint(variant, np.inf, np.inf))
                    continue
                effects = Effects([*parent.effects.steps, (NAME, variant)])
                simulator = Simulator(search.core, effects, search.record)
                theta = np.array([values.get(name, 0.0) for name in simulator.names])
                at = [i for i, name in enumerate(simulator.names) if name not in values]
                columns = derivatives(simulator, criterion, theta, at)[:-1]
                prior = simulator.prior.normal_equations(theta)[0][np.ix_(at, at)]
                result = hinted(own, columns, prior, criterion, search.folds)
                if result is not None:
                    found.append(Hint(variant, *result))
                search.record.forget()  # one channel after the other
    most = max([hint.points for hint in found if np.isfinite(hint.points)], default=0.0)

    def order(hint: Hint) -> tuple[float, float]:
        near = most - AS_GOOD < hint.points < np.inf
        return -(most if near else hint.points), -hint.delta_bic

    return sorted(found, key=order)


def hinted(
    own: np.ndarray,
    columns: np.ndarray,
    prior: np.ndarray,
    criterion: Criterion,
    folds: Sequence[HeldOutRows],
) -> tuple[float, float] | None:
    """Points that curves gain on held-out rows beside a model's derivatives, and their ΔBIC.

    At the size of the prior, of some, with which the ΔBIC is largest; what counts as parameters are
    the effective degrees of freedom. The last of ``own`` is the residual.
    """
    n_own = len(own) - 1
    plain = np.concatenate([own[:-1], columns])
    residual = own[-1]
    white = criterion.whitened(np.concatenate([plain, residual[None]]))
    gram = white @ white.T
    n = criterion.n
    before = gram[-1, -1] - gram[:n_own, -1] @ _solve(gram[:n_own, :n_own], gram[:n_own, -1])
    known = np.zeros_like(gram[:-1, :-1])
    best: tuple[float, np.ndarray] = (-np.inf, known)
    for size in SIZES:
        known = known.copy()
        known[n_own:, n_own:] = before / n * prior / size**2
        inverse = scaled_inverse(gram[:-1, :-1] + known)
        theta = inverse @ gram[:-1, -1]
        after = gram[-1, -1] - 2 * theta @ gram[:-1, -1] + theta @ gram[:-1, :-1] @ theta
        dof = np.trace(inverse @ gram[:-1, :-1]) - n_own
        delta_bic = n * np.log(max(before, 1e-300) / max(after, 1e-300)) - dof * np.log(n)
        best = max(best, (float(delta_bic), known), key=lambda one: one[0])
    delta_bic, known = best
    if delta_bic < LEAST_DELTA_BIC:
        return None
    points = points_gained(white, plain, residual, n_own, criterion, folds, _solve, known)
    return (points, delta_bic) if points > 0 else None


def _solve(gram: np.ndarray, product: np.ndarray) -> np.ndarray:
    return np.asarray(scaled_inverse(gram) @ product)


@dataclass(frozen=True)
class Shaped:
    """Numbers and verdict of a search, and the free form that explains what has no name.

    Without one, ``doubtful`` are forms that the closed loop alone speaks against.
    """

    search: Search
    found: SearchNumbers
    ending: Ending
    shape: Candidate | None = None
    doubtful: tuple[Candidate, ...] = ()


def shaped(search: Search, found: SearchNumbers, *, tries_all: bool) -> Shaped:
    """The verdict, with the shape of what has no name.

    One free form in place of all the effects that were found, which explains more, is structure
    that these leave: they may stand in for something else together.
    """
    ending, baseline = decided(found, tries_all=tries_all), found.steps[0].plain
    rival, hints = None, None
    if found.added:
        hints = hints_of(search, baseline)
        found, rival = beside_one_form(search, found, hints)
        ending = decided(found, tries_all=tries_all)
    elif ending.verdict is Verdict.NOTHING and (found.left or one_sided(search.record)):
        hints = hints_of(search, baseline)[:FOLLOWED]
        forms = candidates_of(search, baseline, hints)
        shape = best_of(search, forms_judged(search, baseline, forms))
        if shape is None or shape.gain < BESIDE_ONE[0] * found.share:
            return Shaped(search, found, ending)
        return Shaped(search, found, Ending(unnamed(tries_all), [], []), shape)
    if not ending.verdict.leaves_unknown:
        return Shaped(search, found, ending)
    parent = unnamed_parent(found, ending)
    if rival is None or parent is not baseline:
        if hints is None or parent is not baseline:
            hints = hints_of(search, parent)
        forms = candidates_of(search, parent, hints[:FOLLOWED])
        step = forms_judged(search, parent, forms)
        rival = best_of(search, step)
        if rival is None:
            doubtful = [c for c in step.candidates if c.pays and c.joint > LEAST_DELTA_BIC]
            return Shaped(search, found, ending, None, tuple(doubtful))
    return Shaped(search, found, ending, rival)


def beside_one_form(
    search: Search, found: SearchNumbers, hints: Sequence[Hint]
) -> tuple[SearchNumbers, Candidate | None]:
    """The numbers, with what one free form in place of all effects explains beyond them; the form.

    Where it explains as much as several and is likelier, none of these explains its part, unless
    the first acts where the form does and leaves little of what that explains. The same where it
    acts elsewhere than a single one, and what it explains beyond that would count as an effect:
    then the place is wrong. Of its own place it explains more than a name because any curve does,
    so that this is structure only where it shows at first sight, or is most of all. ``hints`` are
    those of the baseline.
    """
    several = len(found.added) > 1
    least, share = (BESIDE_SEVERAL if several else BESIDE_ONE)[:2]
    baseline = found.steps[0].plain
    most = max([hint.points for hint in hints], default=0.0)
    hopeful = [h for h in hints[:TRIED] if h.points > HOPEFUL * found.gained]
    named = output_error_fit(found.path.model) if hopeful else baseline
    tried = candidates_of(search, baseline, hopeful)
    better = [
        one
        for one in tried
        if one.model is not None
        and 100 * (named.sse - one.model.sse) / search.criterion.power > excess_asked(one, found)
    ]
    if several and better:  # of which another may explain more of held-out rows
        n = len(tried)
        better = [*tried, *candidates_of(search, baseline, hints[n:FOLLOWED], n)]
    rival = best_of(search, forms_judged(search, baseline, better)) if better else None
    if rival is None or rival.model is None:
        return found, None
    excess, one_cause = rival.gain - found.gained, False
    refutes = not first_stands(rival, found) if several else elsewhere(rival.effect, found)
    if refutes and excess > excess_asked(rival, found):
        lead_asked = 0.0 if several else LEAST_DELTA_BIC
        one_cause = lead(search, baseline, rival.model, found.path.model) > lead_asked
    effect: Any = rival.effect
    more = Leftover("shape", effect.over, ONE_FORM, excess, rival.delta_bic)
    at_sight = most >= found.gained + max(least * found.share, share * most)
    counts = excess >= least * found.share and (several or at_sight or excess > found.gained)
    left = sorted([*found.left, more] if counts else found.left, key=lambda item: -item.points)
    return replace(found, left=left, one_cause=one_cause), rival


def first_stands(rival: Candidate, found: SearchNumbers) -> bool:
    """Whether the first effect acts where a form does, and leaves little of what that explains."""
    first = dict(found.path.model.effects.steps)[found.added[0]]
    left = rival.gain - (found.steps[1].vaf - found.steps[0].vaf)
    return bool(group_of(rival.effect) & group_of(first)) and left <= BESIDE_ONE[1] * rival.gain


def excess_asked(one: Candidate, found: SearchNumbers) -> float:
    """Points by which a form must exceed all effects that were found to speak against them.

    One with fewer numbers, such as those at which stretches begin and end, need not exceed them.
    """
    if len(found.added) > 1:
        return -AS_GOOD
    if not elsewhere(one.effect, found):
        return found.share * BESIDE_ONE[0]
    named, form = found.path.model, one.model
    plainer = form is not None and form.n_parameters < named.n_parameters
    return -AS_GOOD if plainer else found.share * LEAST_GAIN


def elsewhere(form: Any, found: SearchNumbers) -> bool:
    """Whether a form acts elsewhere than all effects that were found."""
    effects = dict(found.path.model.effects.steps)
    own = group_of(form)
    return all(not own & group_of(effects[name]) for name in found.added)


def group_of(effect: Effect) -> frozenset[str]:
    """What an effect changes, so far as data tell places apart."""
    return GROUPS.get(effect.place, frozenset({effect.place}))


def unnamed_parent(found: SearchNumbers, ending: Ending) -> Model:
    """The model with the effects that are named, without those that stand in for others."""
    model = found.path.model
    ids = [dict(model.effects.steps)[name].name for name in found.added]
    kept = sum(1 for name in ids if name in ending.named)
    return found.steps[kept].plain
