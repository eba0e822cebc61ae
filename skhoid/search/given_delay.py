"""A delay given to a model is a claim, tested against what a search with a free delay finds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..model.cores import OperatorCore
from ..model.extend import extended
from ..model.model import Model, without
from ..model.prepared import Prepared, SimulatedModel
from ..model.simulator import Simulator
from .candidates import LEAST_DELTA_BIC, Candidate, SearchStep
from .forward import (
    CLAIM,
    Path,
    Search,
    in_gaining_order,
    ordered,
    output_error_fit,
    rises,
    unique_name,
)
from .statuses import Verdict
from .verdict import Ending


@dataclass
class GivenDelay:
    """A search whose model has a given delay, and the effect that frees it, with its name.

    ``first`` is the first step of the search; for an operator, for which a search with a free delay
    tries the same, it waits for that.
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

    def freed(self, prepared: Prepared, model: SimulatedModel) -> tuple[Prepared, Search, Model]:
        """Data, search and baseline of the same model whose delay is free.

        An operator is one that was given no delay, so that the search is the same; other models
        keep the effect that frees theirs.
        """
        core, search = self.search.core, self.search
        if self.first is not None:
            claim = next(c for c in self.first.candidates if c.id == CLAIM)
            assert claim.model is not None
            return prepared, search, output_error_fit(claim.model)
        assert type(core) is OperatorCore
        free = OperatorCore(None, core.least)
        record, searched = (
            free.on(replace(one, _derived={})) for one in (prepared.record, search.record)
        )
        spec = replace(prepared.spec, core=free, given={})
        prepared = replace(prepared, spec=spec, record=record)
        effects = [*search.effects, *search.noises]
        search = Search(free, searched, effects, search.folds, search.n_jobs, search.progress)
        return prepared, search, model.first_fit(replace(prepared, record=searched))

    def tested(self, free: Path) -> Path:
        """The result of a search with a free delay; with the given one if the data allow it."""
        search, name = self.search, self.name
        first = self.first or self._first_beside(free.steps[0])
        steps = [first, *(replace(step, parent=self._told(step.parent)) for step in free.steps)]
        model = output_error_fit(self._told(free.model))
        before = first.parent.effects.names
        added = [n for n in model.effects.names if n not in (name, *before)]
        path = Path(steps, model)
        fixed = self._with_given(model, added, path.core)
        step = search.judged(fixed, [Candidate(name, self.claim, model=model)])
        ways = [(model, [name, *added]), (model, [*added, name])]
        if not step.judge(step.candidates[0]):
            ways.insert(0, (fixed, added))
        for found, order in ways:
            path = replace(path, model=ordered(found, [*before, *order]))
            if rises(search, path):
                return path
        return in_gaining_order(search, path, first)

    def stands(self, path: Path) -> bool:
        """Whether one effect beside the given delay explains clearly more than another delay alone.

        A free delay takes up much of what is fed back late, and leaves too little of it to find.
        """
        first = path.steps[0]
        best, claim = first.best, next(c for c in first.candidates if c.name == self.name)
        if path.added != [self.name] or best is None or best is claim or not best.linear_in_loop:
            return False
        first.judge(claim)
        more = min(best.weight - claim.weight, best.joint - claim.joint)
        return bool(more > LEAST_DELTA_BIC and best.gain > claim.gain)

    def _first_beside(self, free: SearchStep) -> SearchStep:
        """The first step with the given delay, from what that with a free one has found."""
        claim = Candidate(self.name, self.claim, model=self._told(free.plain))
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
        """A model with a free delay as one with a given delay and the effect that frees it."""
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
