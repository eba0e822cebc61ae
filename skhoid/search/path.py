"""How a search goes: the best effect added step by step, pairs, and a given delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from ..effects.base import Effect
from ..effects.composition import Effects
from ..model.cores import OperatorCore
from ..model.estimator import GreyBox, vaf_of_output
from ..model.extend import extended, refit_each_beside
from ..model.fitting import Criterion, minimise
from ..model.model import Model, in_order, without
from ..model.prepared import Prepared
from ..model.simulator import Simulator
from .judges import (
    JointParent,
)
from .judging import (
    AS_GOOD,
    CLAIM,
    LEAST_DELTA_BIC,
    LITTLE_NOISE,
    Candidate,
)
from .statuses import Ending, Verdict
from .steps import Search, SearchStep, output_error_fit, unique_name

N_FIRST = 2  # effects that may be the first instead
BETTER_AGAIN = 0.999  # times the squares, at most, of an effect fitted anew
ADDED = ("path", "sum")  # places where the order of effects changes nothing
N_FEW = 3  # candidates beside which others are tried


@dataclass
class Path:
    """What a search did: its steps, and the model and effects it ended with."""

    steps: list[SearchStep]
    model: Model

    @property
    def ids(self) -> list[str]:
        return [effect.name for _, effect in self.model.effects]

    @property
    def added(self) -> list[str]:
        """Names of effects that the model did not have before."""
        before = self.steps[0].at_likelihood.effects.names
        return [name for name in self.model.effects.names if name not in before]

    @property
    def core(self) -> dict[str, float]:
        """Parameters of the core before any effect was added."""
        return {n: v for n, v in self.steps[0].at_least_error.values().items() if "__" not in n}


def forward(search: Search, baseline: Model, most: int) -> Path:
    """Add the best effect as long as one pays; try the second best first effect too."""
    first = search.step(baseline)
    greedy = follow(search, first, first.best if most else None, most)
    if len(greedy.steps) > 1 and len(greedy.ids) > 1:
        for rival in first.rivals()[:N_FIRST]:
            if rival.effect.name in greedy.ids[:1]:
                continue
            first.judge(rival)
            if not rival.passes:
                continue
            other = follow(search, first, rival, 2)
            if len(other.ids) > 1:
                pair = path_of_length(greedy, 2)
                if better(search, first.at_likelihood, other.model, pair):
                    greedy = follow_from(search, other, most)
    return drop_losing(search, trimmed(search, greedy, most), first)


def trimmed(search: Search, path: Path, most: int) -> Path:
    """Without effects that no longer pay; if some were removed, the search goes on from there."""
    seen: list[set[str]] = []
    while True:
        fewer = without_superfluous(search, fitted_again(search, path))
        seen.append({*path.ids})
        if len(fewer.ids) == len(path.ids):
            return fewer
        path = follow_from(search, fewer, most)
        if {*path.ids} in seen:
            return fewer


def fitted_again(search: Search, path: Path) -> Path:
    """Each of several effects refitted with the others: the first was fitted without them."""
    templates = {effect.name: effect for effect in search.effects}
    plain = output_error_fit(path.model)
    model = refit_each_beside(plain, templates, search.criterion, search.coarse)
    if not model.sse < BETTER_AGAIN * plain.sse:
        return path
    step = search.judge_candidates(model, [])
    return replace(path, model=step.at_likelihood)


def drop_losing(search: Search, path: Path, first: SearchStep) -> Path:
    """A path in an order in which each effect lowers the held-out error.

    Where there is none, the effect that loses most is dropped, until there is one.
    """
    while True:
        orders = likely_orders(path, first)
        if (found := order_effects(search, orders)) is not None:
            return found
        gains = gains_of_steps(search, orders[0])
        name = min(gains, key=lambda one: gains[one])
        fewer = output_error_fit(without(path.model, name, path.core))
        path = replace(path, model=search.judge_candidates(fewer, []).at_likelihood)


def order_effects(search: Search, orders: Sequence[Path]) -> Path | None:
    """The first of some orders in which each effect lowers the held-out error, if one does."""
    return next((order for order in orders if rises(search, order)), None)


def likely_orders(path: Path, first: SearchStep) -> list[Path]:
    """The effects of a path by their rank in the first step, as they were added, and backwards."""
    start = len(path.steps[0].at_likelihood.effects)
    rank = {c.name: i for i, c in enumerate(first.candidates) if c.passes}
    given, added = path.model.effects.names[:start], path.model.effects.names[start:]
    by_rank = sorted(added, key=lambda name: rank.get(name, len(rank)))
    return [
        replace(path, model=ordered(path.model, [*given, *order]))
        for order in (by_rank, added, added[::-1])
    ]


def gains_of_steps(search: Search, path: Path) -> dict[str, float]:
    """What each effect of a path adds to the VAF of held-out rows, refitted without them."""
    start = len(path.steps[0].at_likelihood.effects)
    parts = search.partial_models(path.model, start, path.core)
    vafs = [search.refit(part) for part in parts]
    return dict(zip(path.model.effects.names[start:], np.diff(vafs).tolist(), strict=True))


def rises(search: Search, path: Path) -> bool:
    """Whether no step of a path loses more than it may."""
    gains = gains_of_steps(search, path)
    return all(gain > search.allowed_loss(path.model, name) for name, gain in gains.items())


def ordered(model: Model, names: Sequence[str]) -> Model:
    """The same model, its effects in an order; maps of one place keep theirs, as signals pass."""
    by_name = dict(model.effects.steps)
    of_place: dict[str, list[str]] = {}
    for name, effect in model.effects.steps:
        of_place.setdefault(effect.place, []).append(name)
    for place in ADDED:
        of_place[place] = [name for name in names if by_name[name].place == place]
    return in_order(model, [of_place[by_name[name].place].pop(0) for name in names])


def follow(search: Search, first: SearchStep, start: Candidate | None, most: int) -> Path:
    """Add ``start`` and then the best of each step."""
    if start is None or start.model is None:
        return Path([first], first.at_likelihood)
    return follow_from(search, Path([first], start.model), most)


def follow_from(search: Search, path: Path, most: int) -> Path:
    steps, model = list(path.steps), path.model
    while len(model.effects) < most:
        step = search.step(output_error_fit(model))
        steps.append(step)
        best = step.best
        if best is None or best.model is None:
            break
        model = best.model
    return Path(steps, model)


def path_of_length(path: Path, n: int) -> Model:
    """The model with the first n effects of a path."""
    for step in path.steps:
        if len(step.at_likelihood.effects) == n:
            return step.at_likelihood
    return path.model


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


def better(search: Search, parent: Model, one: Model, other: Model) -> bool:
    """Whether one model explains more than the other, by the criterion that ranks candidates."""
    return lead(search, parent, one, other) > 0


def lead(search: Search, parent: Model, one: Model, other: Model) -> float:
    """ΔBIC by which one model leads another; infinite for a plainer one that is as good."""
    criterion = Criterion(search.record)
    both = [output_error_fit(m) for m in (one, other)]
    best = min(both, key=lambda m: m.sse)
    criterion.set_noise(criterion.remnant_model(best.output))
    a, b = (m.refined(criterion) for m in both)
    n = criterion.n
    vafs = [vaf_of_output(search.record, m.output) for m in both]
    if min(vafs) > LITTLE_NOISE and vafs[0] < vafs[1] + AS_GOOD:
        return np.inf if a.n_parameters < b.n_parameters else -np.inf
    delta_bic = n * np.log(b.sse / a.sse) - (a.n_parameters - b.n_parameters) * np.log(n)
    if search.core.kind.is_operator:
        joint_parent = JointParent(parent)
        joint = joint_parent.delta_bic(both[0]) - joint_parent.delta_bic(both[1])
        delta_bic = delta_bic / 2 + joint if np.isfinite(joint) else delta_bic
    return float(delta_bic)


def without_superfluous(search: Search, path: Path) -> Path:
    """Remove effects that no longer pay beside the others, the worst on held-out rows first."""
    model = path.model
    names = model.effects.names[len(path.steps[0].at_likelihood.effects) :]  # others were given
    if len(names) < 2:
        return path
    fewer = {name: output_error_fit(search.fewer(model, name, path.core)) for name in names}
    fitted, whole = output_error_fit(model), search.refit(model)
    gains = {name: whole - search.refit(one) for name, one in fewer.items()}
    worst = min(names, key=lambda name: gains[name] - search.allowed_loss(model, name))
    loses = gains[worst] <= search.allowed_loss(model, worst)
    for name in [worst] if loses else names[:-1]:
        one = Candidate(name, dict(model.effects.steps)[name], model=fitted)
        step = search.judge_candidates(fewer[name], [one])
        if loses or not one.pays:
            path = replace(path, model=step.at_likelihood)
            return without_superfluous(search, path)
    return path


def likeliest_few(first: SearchStep, path: Path) -> list[Candidate]:
    """Candidates of the first step that gain and were not begun with, the likeliest first."""
    begun = path.added[:1]
    if first.find_joint is not None:
        first.find_joint([c for c in first.candidates if c.lacks_joint])
    found = [
        c
        for c in first.candidates
        if c.model is not None
        and not c.refused
        and c.name not in begun
        and c.gain >= c.least_gain
        and np.isfinite(c.ranking_bic)
    ]
    return sorted(found, key=lambda c: -c.ranking_bic)[:N_FEW]


def find_pair(search: Search, path: Path, most: int) -> Path | None:
    """A path that begins with two effects that pass all criteria beside each other; or None."""
    first = path.steps[0]
    if most < len(first.at_likelihood.effects) + 2:
        return None
    for one in likeliest_few(first, path):
        assert one.model is not None
        step = search.step(output_error_fit(one.model))
        if step.best is None or step.best.model is None:
            continue
        pair = step.best.model
        fewer = output_error_fit(search.fewer(pair, one.name, path.core))
        effect = dict(pair.effects.steps)[one.name]
        second = search.judge_candidates(
            fewer, [Candidate(one.name, effect, model=output_error_fit(pair))]
        )
        if second.best is None:
            continue
        longer = follow_from(search, Path([first, step], pair), most)
        found = drop_losing(search, trimmed(search, longer, most), first)
        if len(found.added) > 1:
            return found
    return None


@dataclass
class GivenDelay:
    """A search whose model has a given delay, and the effect that frees it, with its name.

    The ``first`` step of an operator is made when it is asked for: the search with a free delay
    tries the same candidates.
    """

    search: Search
    baseline: Model
    name: str
    claim: Effect
    first: SearchStep | None

    @classmethod
    def of(cls, search: Search, baseline: Model) -> GivenDelay | None:
        """None where no delay was given, or it is not to be tested."""
        claim = next((effect for effect in search.effects if effect.name == CLAIM), None)
        known = {effect.name for _, effect in baseline.effects}
        if claim is None or CLAIM in known or claim.refusal_in(search.record, search.core.kind):
            return None
        waits = type(search.core) is OperatorCore and bool(claim.free)
        first = None if waits else search.step(baseline)
        return cls(search, baseline, unique_name(claim, baseline.effects), claim, first)

    def freed(self, prepared: Prepared, model: GreyBox) -> tuple[Prepared, Search, Model]:
        """Data, search and baseline of the same model whose delay is free."""
        core, search = self.search.core, self.search
        if self.first is not None:
            claim = next(c for c in self.first.candidates if c.effect.name == CLAIM)
            assert claim.model is not None
            return prepared, search, output_error_fit(claim.model)
        assert type(core) is OperatorCore
        free = OperatorCore(None, core.least)
        record, searched = (
            free.add_to_record(replace(one, remembered={}))
            for one in (prepared.record, search.record)
        )
        spec = replace(prepared.spec, core=free, given={})
        prepared = replace(prepared, spec=spec, record=record)
        effects = [*search.effects, *search.noises]
        search = Search(free, searched, effects, search.folds, search.n_jobs, search.progress)
        return prepared, search, model.first_fit(replace(prepared, record=searched))

    def tested(self, free: Path) -> Path:
        """The result of a search with a free delay; with the given one if the data allow it."""
        search, name = self.search, self.name
        first = self.first or self._first_step(free.steps[0])
        steps = [
            first,
            *(replace(step, at_likelihood=self._told(step.at_likelihood)) for step in free.steps),
        ]
        model = output_error_fit(self._told(free.model))
        before = first.at_likelihood.effects.names
        added = [n for n in model.effects.names if n not in (name, *before)]
        path = Path(steps, model)
        fixed = self._with_given(model, added, path.core)
        step = search.judge_candidates(fixed, [Candidate(name, self.claim, model=model)])
        ways = [(model, [name, *added]), (model, [*added, name])]
        step.judge(step.candidates[0])
        if not step.candidates[0].passes:
            ways.insert(0, (fixed, added))
        for found, order in ways:
            path = replace(path, model=ordered(found, [*before, *order]))
            if rises(search, path):
                return path
        return drop_losing(search, path, first)

    def stands(self, path: Path) -> bool:
        """Whether one effect beside the given delay explains clearly more than another delay."""
        first = path.steps[0]
        best, claim = first.best, next(c for c in first.candidates if c.name == self.name)
        if path.added != [self.name] or best is None or best is claim or not best.linear_in_loop:
            return False
        first.judge(claim)
        more = min(best.ranking_bic - claim.ranking_bic, best.joint - claim.joint)
        return bool(more > LEAST_DELTA_BIC and best.gain > claim.gain)

    def _first_step(self, free: SearchStep) -> SearchStep:
        """The first step with the given delay, from what that with a free one has found."""
        claim = Candidate(self.name, self.claim, model=self._told(free.at_least_error))
        return self.search.step_from(self.baseline, free, [claim])

    def _with_given(self, model: Model, added: list[str], core: dict[str, float]) -> Model:
        """The model with the given delay: without what frees it, or built up anew, if better."""
        search, effects = self.search, dict(model.effects.steps)
        fewer = without(model, self.name, core)
        again = self.baseline
        for name in added:
            again = extended(again, name, effects[name], search.criterion, search.coarse)
        return min(fewer, output_error_fit(again), key=lambda one: one.sse)

    def _told(self, model: Model) -> Model:
        """Rewrite a model with a free delay: as the given delay and the effect that frees it."""
        name, before = self.name, self.baseline.effects.names
        if name in model.effects.names:
            return model
        core, steps = self.search.core, model.effects.steps
        freeing = (name, self.claim)
        effects = Effects([*steps[: len(before)], freeing, *steps[len(before) :]])
        simulator = Simulator(core, effects, self.search.record)
        extra = f"{name}__{self.claim.free[0].name}"
        at = [model.simulator.names.index("tau_e" if n == extra else n) for n in simulator.names]
        fit = model.fit.permuted(at)
        theta = fit.theta.copy()
        theta[simulator.names.index(extra)] -= core.delay({})
        theta = np.clip(theta, simulator.low, simulator.high)
        return Model(simulator, replace(fit, theta=theta))


def with_given_delay(ending: Ending, free: Path, path: Path) -> Ending:
    """The end of a search with a free delay, for the model whose delay was given."""
    lost = {*free.ids} - {*path.ids}
    named = [CLAIM] if CLAIM in path.ids else []
    named += [name for name in ending.named if name not in lost]
    verdict = ending.verdict
    if not verdict.leaves_unknown:
        verdict = Verdict.FOUND if named else Verdict.NOTHING
    return Ending(verdict, named, ending.stand_ins)
