"""How a search goes: the best effect added step by step, and those removed that no longer pay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from ..effects.base import Effect
from ..effects.composition import Effects
from ..model.extend import refit_each_beside
from ..model.fitting import Criterion, minimise
from ..model.model import Model, in_order
from ..model.simulator import Simulator
from .judging import CLAIM, THRESHOLD, Candidate
from .probability import Alternative
from .statuses import Reason
from .steps import Search, SearchStep, output_error_fit, unique_name

BETTER_AGAIN = 0.999  # times the squares, at most, of an effect fitted anew
ADDED = ("path", "sum")  # places where the order of effects changes nothing
SAME = 0.05  # of what the first saves, by which what another explains is apart from it at most
RIVAL = 0.5  # of the best's evidence, for another that is followed as the first


@dataclass
class Path:
    """What a search did: its steps, and the model and effects it ended with.

    ``beside`` is the evidence of effects by their names beside all others, where it was asked.
    """

    steps: list[SearchStep]
    model: Model
    beside: dict[str, float] = field(default_factory=dict)

    @property
    def ids(self) -> list[str]:
        return [effect.name for _, effect in self.model.effects]

    @property
    def ended_early(self) -> bool:
        """Whether time was over before all effects were tried beside the last model."""
        why = [c.untried.code for c in self.steps[-1].candidates if c.untried is not None]
        return Reason.TIME in why

    @property
    def added(self) -> list[str]:
        """Names of effects that the model did not have before."""
        before = self.steps[0].at_likelihood.effects.names
        return [name for name in self.model.effects.names if name not in before]

    @property
    def core(self) -> dict[str, float]:
        """Parameters of the core before any effect was added."""
        return {n: v for n, v in self.steps[0].at_least_error.values().items() if "__" not in n}


def find_path(search: Search, baseline: Model, most: int) -> Path:
    """What a search does."""
    return order_by_worth(search, forward(search, baseline, most))


def tell_chances(path: Path, lead: float, left: float) -> None:
    """Find the probability of each name beside something else.

    A free form leads the effects found by ``lead`` nats, which is all its evidence where nothing
    was found; ``left`` are nats of what they leave.
    """
    for step in path.steps:
        ahead = lead + (step.best.least if step.best else 0.0)
        told = step.best or not path.added
        step.other = [Alternative(None, ahead, left)] if told else []
        step.tell_chances()
    kept = {*path.model.effects.names}  # beside one that was dropped a name showed less
    for name in path.added:
        passing = [
            (step, c) for step in path.steps for c in step.candidates if c.name == name and c.passes
        ]
        beside_kept = [one for one in passing if {*one[0].at_likelihood.effects.names} <= kept]
        for step, one in (beside_kept or passing)[-1:]:
            step.tell_chance(one, path.added, path.beside.get(name, -np.inf))
            for _, same in passing:
                same.probability = one.probability


def order_by_worth(search: Search, path: Path) -> Path:
    """The path with its effects in an order in which what costs held-out rows least comes last."""
    last: list[str] = []
    names, model = path.added, path.model
    while len(names) > 1:
        fewer = {n: output_error_fit(search.fewer(model, n, path.core)) for n in names}
        least = max(names, key=lambda name: search.refit(fewer[name]))
        names, model, last = [n for n in names if n != least], fewer[least], [least, *last]
    given = [name for name in path.model.effects.names if name not in path.added]
    return replace(path, model=put_in_order(path.model, [*given, *names, *last]))


def put_in_order(model: Model, names: Sequence[str]) -> Model:
    """The same model, its effects in an order; maps of one place keep theirs, as signals pass."""
    by_name = dict(model.effects.steps)
    of_place: dict[str, list[str]] = {}
    for name, effect in model.effects.steps:
        of_place.setdefault(effect.place, []).append(name)
    for place in ADDED:
        of_place[place] = [name for name in names if by_name[name].place == place]
    return in_order(model, [of_place[by_name[name].place].pop(0) for name in names])


def forward(search: Search, baseline: Model, most: int) -> Path:
    """Add the best effect as long as one counts; where several do, begin with the second best too.

    A given delay is freed first where that counts, so that no other effect makes up for one that is
    wrong; whether it is, is judged at the end, as of any other effect.
    """
    claim = find_claim(search, baseline) if most else None
    if claim is not None:
        step = try_beside(search, baseline, claim)
        found_claim = step.best
        if found_claim is not None:  # else it would only imitate what is missing
            assert found_claim.model is not None
            freed = Path([step], output_error_fit(found_claim.model))
            return drop_superfluous(search, follow(search, freed, most + 1), most)
    first = search.step(baseline)
    path = Path([first], first.at_likelihood)
    if first.best is None or not most:
        return path
    least = RIVAL * first.best.least
    found: list[Path] = []
    for start in [c for c in first.candidates[:2] if c.passes and c.least >= least]:
        assert start.model is not None
        if found and (search.is_over or explains(search, found[0], start)):
            break
        known = [first.best.name] if found else []
        among = None if search.exhaustive or not found else list_counting(search, found[0], start)
        one = follow(search, Path([first], start.model), most, known, among)
        last = one.steps[-1].best
        found += [one] if last is None or last.name not in known else []
        if len(found[0].ids) < len(baseline.effects) + 2:
            break
    best = min(found, key=lambda one: find_cost(search, one.model))
    second = first.candidates[1].model if best is not found[0] else None
    if second is not None and not search.exhaustive:  # of all effects now
        best = follow(search, Path([first], second), most)
    return drop_superfluous(search, best, most)


def try_beside(search: Search, parent: Model, effect: Effect) -> SearchStep:
    """A step in which one effect is tried."""
    search.remember(parent)
    with search.progress.step(2):  # fitted, and refined
        name = unique_name(effect, parent.effects)
        one = search.candidate(parent, name, effect)
        search.progress.done(1)
        return search.judge_candidates(parent, [one])


def explains(search: Search, path: Path, other: Candidate) -> bool:
    """Whether a path has another effect, or its first counts beside that, and not the reverse."""
    if other.name in path.added:
        return True
    first, beside = path.steps[0].best, {c.name: c for c in path.steps[1].candidates}
    assert first is not None
    assert other.model is not None
    if other.name not in beside or beside[other.name].passes:
        return False
    return try_beside(search, output_error_fit(other.model), first.effect).best is not None


def list_counting(search: Search, path: Path, other: Candidate) -> set[str]:
    """Ids of a path, and of what counted in its steps, or may have as it was begun.

    Beside the first only, where another explains the same: it leaves the same.
    """
    first, plain = path.steps[0].best, path.steps[0].at_least_error
    assert first is not None
    assert first.model is not None
    assert other.model is not None
    apart = (first.model.output - other.model.output)[:: search.criterion.thin]
    squares = float((apart[search.criterion.known] ** 2).sum())
    same = squares < SAME * (plain.sse - output_error_fit(first.model).sse)
    tried = [c for step in path.steps[same:] for c in step.candidates if c.model is not None]
    near = {c.effect.name for c in tried if max(c.delta_bic / 2, c.hoped) > THRESHOLD}
    return near | {*path.ids}


def find_claim(search: Search, baseline: Model) -> Effect | None:
    """The effect that frees a given delay; None where none was given or it is not asked."""
    claim = next((effect for effect in search.effects if effect.name == CLAIM), None)
    known = {effect.name for _, effect in baseline.effects}
    if claim is None or CLAIM in known or claim.refusal_in(search.record, search.core.kind):
        return None
    return claim


def follow(
    search: Search,
    path: Path,
    most: int,
    known: Sequence[str] = (),
    among: set[str] | None = None,
) -> Path:
    """Add the best of each step, until it is one that is ``known`` from another path.

    Of all effects, or of those ``among`` some ids.
    """
    steps, model = list(path.steps), path.model
    while len(model.effects) < most:
        steps.append(search.step(output_error_fit(model), among))
        best = steps[-1].best
        if best is None or best.model is None or best.name in known:
            break
        model = best.model
    return Path(steps, model)


def find_cost(search: Search, model: Model) -> float:
    """n log(SSE) with the noise model of a model's residual, and log(n) for each parameter."""
    criterion = Criterion(search.record)
    fitted = output_error_fit(model)
    criterion.set_noise(criterion.remnant_model(fitted.output))
    sse = fitted.refined(criterion).sse
    return float(criterion.n * np.log(max(sse, 1e-300)) + model.n_parameters * np.log(criterion.n))


def drop_superfluous(search: Search, path: Path, most: int) -> Path:
    """Remove effects that no longer count beside the others, the least of them first.

    The search goes on from there, until it has been there.
    """
    seen: list[set[str]] = []
    while True:
        path = fit_again(search, path)
        fewer = drop_least(search, path)
        seen.append({*path.ids})
        if fewer is None:
            return path
        # Without its own effect, what is made up for a given delay would be other effects.
        again = {*fewer.ids} in seen or (CLAIM in path.ids and CLAIM not in fewer.ids)
        path = fewer if again else follow(search, fewer, most)


def drop_least(search: Search, path: Path) -> Path | None:
    """The path without the effect that counts least beside the others; None where all count."""
    model, added = path.model, path.added
    judged = []
    # The last was judged beside the others when it was added; only a freed delay was not.
    for name in added if path.ids == [CLAIM] else added[:-1]:
        effect = dict(model.effects.steps)[name]
        fewer = output_error_fit(search.fewer(model, name, path.core))
        one = Candidate(name, effect, model=output_error_fit(model))
        step = search.judge_candidates(fewer, [one])
        path.beside[name] = one.least
        if not one.passes:
            judged.append((one.least, one.gain, step.at_likelihood))
    if not judged:
        return None
    return replace(path, model=min(judged, key=lambda one: one[:2])[2])


def fit_again(search: Search, path: Path) -> Path:
    """Each of several effects refitted with the others: the first was fitted without them."""
    if search.is_over:
        return path
    templates: dict[str, Effect] = {effect.name: effect for effect in search.effects}
    plain = output_error_fit(path.model)
    model = refit_each_beside(plain, templates, search.criterion, search.coarse)
    if not model.sse < BETTER_AGAIN * plain.sse:
        return path
    return replace(path, model=search.judge_candidates(model, []).at_likelihood)


def further_changes(search: Search, path: Path) -> dict[str, tuple[float, float, float]]:
    """Changes of neuromuscular frequency and damping with a gain that changes: value, sd and p."""
    found: dict[str, tuple[float, float, float]] = {}
    names = [n for n, e in path.model.effects if e.name == "tv_gain"]
    if not names or not search.core.kind.is_operator:
        return found
    criterion = Criterion(search.record)
    criterion.set_noise(criterion.remnant_model(path.model.output))
    plain = path.model.refined(criterion)
    for parameter in ("omega_nm_change", "zeta_nm_change"):
        freed = [
            (n, e.with_choices(**{parameter: None}) if n == names[0] else e)
            for n, e in path.model.effects
        ]
        simulator = Simulator(search.core, Effects(freed), search.record)
        full = f"{names[0]}__{parameter}"
        start = np.array([{**plain.values(), full: 0.0}[n] for n in simulator.names])
        model = Model(simulator, minimise(simulator, criterion, start))
        at = simulator.names.index(full)
        # The loss has several minima over the time of a change: the freed fit may find another.
        start = np.array([model.values()[n] for n in plain.simulator.names])
        fewer = min(plain.sse, minimise(plain.simulator, criterion, start).sse)
        ratio = criterion.n * np.log(fewer / model.sse)
        sd = float(np.sqrt(model.covariance()[at, at]))
        found[parameter.removesuffix("_change")] = (
            float(model.theta[at]),
            sd,
            float(chi2.sf(max(ratio, 0.0), 1)),
        )
    return found
