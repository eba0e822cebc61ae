"""Forward search: adds the best effect step by step, and has the criteria for what counts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from .._machine import ended_by_signals
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..model.cores import Core
from ..model.estimator import vaf_of_output
from ..model.extend import beside_each_other, explored_from, extended
from ..model.fitting import Criterion, Fit, minimise, sse_at
from ..model.model import Model, in_order, without
from ..model.simulator import Simulator
from .candidates import (
    AS_GOOD,
    LEAST_GAIN,
    LITTLE_NOISE,
    Candidate,
    SearchStep,
    Weigh,
    likeliest_alternatives,
    weigh_likely,
    without_name,
)
from .held_out import HeldOutRows, held_out, refitted_prediction, without_folds
from .in_loop import LIKELY_IF_FIRST, LoopJudge
from .joint import JointParent
from .progress import Progress
from .signatures import traces_of, without_noise
from .special_cases import special_first

PARTS = 3  # of the work for each process
N_RIVALS = 2  # effects that may be the first instead
HOPELESS = 0.002  # of the output's power
BETTER_AGAIN = 0.999  # times the squares, at most, of an effect fitted anew
TRACE_LEADS = 0.5  # points of VAF that another may gain more than what a trace shows
ADDED = ("path", "sum")  # places where the order of effects changes nothing
CLAIM = "wrong_delay"  # the effect by which a given delay is freed
LEAST_GAIN_OF_CLAIM = 0.6  # VAF points: a little delay makes up for much that is not one


def unique_name(effect: Effect, effects: Effects) -> str:
    """The name that a composition gives a further effect."""
    return (effects + effect).names[-1]


class Search:
    """Tries effects added to parents, all on the same record and under one noise model per step."""

    def __init__(
        self,
        core: Core,
        record: Record,
        effects: Sequence[Effect],
        folds: list[HeldOutRows],
        n_jobs: int | None = None,
        progress: Progress | None = None,
    ):
        self.progress = Progress() if progress is None else progress
        self.core, self.record, self.folds = core, record, folds
        self.loop = LoopJudge.of(core, record, folds)
        self.effects = [e for e in effects if not e.noise]
        self.noises = [e for e in effects if e.noise]  # which no input explains
        self.traces = traces_of(record)
        self.criterion = Criterion(record)
        self.coarse = self.criterion.coarse()
        self.share = share_about_mean(self.criterion)
        self.n_jobs = n_jobs
        self._refits: dict[tuple, np.ndarray] = {}
        self._parts: dict[tuple, list[Model]] = {}
        self._parents: dict[frozenset[str], Model] = {}

    def quiet(self, baseline: Model) -> Search | None:
        """The same search without noise that a model's residual shows; None where there is none."""
        if not self.core.kind.is_operator:
            return None
        record = without_noise(self.record, baseline.output, self.noises)
        if record is None:
            return None
        effects = [*self.effects, *self.noises]
        return Search(self.core, record, effects, self.folds, self.n_jobs, self.progress)

    def _each(self, function: Callable[..., Any], items: Sequence[Any], *args: Any) -> list[Any]:
        """``function(item, *args)`` of each item, in ``n_jobs`` processes."""
        n_jobs = effective_n_jobs(self.n_jobs)
        if n_jobs == 1 or len(items) < 2:
            made = []
            for item in items:
                made.append(function(item, *args))
                self.progress.done(1)
            return made
        # Costly neighbours in the catalogue go to different processes, and the record to each once.
        n_parts = min(PARTS * n_jobs, len(items))
        parts = [items[i::n_parts] for i in range(n_parts)]
        with ended_by_signals():
            done = []
            for part in Parallel(n_jobs, batch_size=1, return_as="generator")(
                delayed(_all_of)(function, part, args) for part in parts
            ):
                done.append(part)
                self.progress.done(len(part))
        return [done[i % n_parts][i // n_parts] for i in range(len(items))]

    def step(self, parent: Model) -> SearchStep:
        """All candidates for a parent that was fitted by output error."""
        self._parents[frozenset(parent.effects.names)] = parent
        candidates = []
        taken = {effect.name for _, effect in parent.effects}
        for effect in self.effects:
            if effect.name in taken:
                continue
            name = unique_name(effect, parent.effects)
            lacks = effect.refusal_in(self.record, self.core.kind) or ""
            tried_apart = [effect] if lacks else effect.alternatives(self.record)
            candidates += [Candidate(name, one, inapplicable=lacks) for one in tried_apart]
        tried = [c for c in candidates if not c.inapplicable]
        added = [(c.name, c.effect) for c in tried]
        with self.progress.step(2 * len(tried)):  # fitted, and refined
            rough = explored_from(parent, self.coarse)
            done = self._each(self._extended, added, parent, rough)
            for c, found in zip(tried, done, strict=True):
                c.model = self._model(found, parent)
            return self.judged(parent, candidates)

    def step_from(self, parent: Model, other: SearchStep, more: Sequence[Candidate]) -> SearchStep:
        """The candidates of another step for a parent, each fitted from where it ended there.

        Where the other parent has parameters that this one has not. ``more`` are fitted already.
        """
        self._parents[frozenset(parent.effects.names)] = parent
        fitted = {c.name for c in more}
        again = [c for c in other.candidates if c.name not in fitted]
        candidates = [Candidate(c.name, c.effect, inapplicable=c.inapplicable) for c in again]
        ends = [(c.model.effects, c.model.values()) for c in again if c.model]
        tried = [c for c in candidates if not c.inapplicable]
        with self.progress.step(2 * (len(tried) + len(more))):
            self.progress.done(len(more))
            for c, found in zip(tried, self._each(self._followed, ends, parent), strict=True):
                c.model = self._model(found, parent)
            return self.judged(parent, [*candidates, *more])

    def _followed(
        self, end: tuple[Effects, dict[str, float]], parent: Model
    ) -> tuple[Effects, Fit]:
        effects, values = end
        simulator = Simulator(self.core, effects, self.record)
        starts = [
            np.array([known[name] for name in simulator.names])
            for known in (values, {**values, **parent.values()})
        ]
        start = min(starts, key=lambda theta: sse_at(simulator, self.criterion, theta))
        return effects, minimise(simulator, self.criterion, start)

    def _extended(
        self, added: tuple[str, Effect], parent: Model, rough: Model
    ) -> tuple[Effects, Fit]:
        worth = HOPELESS / 2 * self.share
        criteria = self.criterion, self.coarse
        model = extended(parent, *added, *criteria, worth=worth, rough=rough)
        return model.effects, model.fit

    def _model(self, found: tuple[Effects, Fit], parent: Model) -> Model:
        effects, fit = found
        return Model(Simulator(self.core, effects, self.record), fit, parent.other_cores)

    def judged(self, parent: Model, candidates: list[Candidate]) -> SearchStep:
        """Refine all under one noise model, that of the best, and rank."""
        plain, criterion = self.criterion, Criterion(self.record)
        tried = [c for c in candidates if c.model is not None]
        best = min([parent, *(c.model for c in tried if c.model)], key=lambda m: m.sse)
        criterion.set_noise(criterion.remnant_model(best.output))
        base = parent.refined(criterion)
        base_vaf, base_prediction = self._held_out(parent)
        n = criterion.n
        for c in tried:
            c.trace = self.traces.get(c.id, "") if c.effect.place == "output" else ""
        fitted = [(c.model.effects, c.model.fit, bool(c.trace)) for c in tried if c.model]
        refined = self._each(self._refined, fitted, parent, criterion)
        for c, (fit, vaf, prediction) in zip(tried, refined, strict=True):
            assert c.model is not None
            before = c.model.sse
            c.model = self._model((c.model.effects, fit), parent)
            c.n_parameters = c.model.n_parameters - base.n_parameters
            ratio = n * np.log(max(base.sse, 1e-300) / max(c.model.sse, 1e-300))
            c.loglik = ratio / 2
            c.delta_bic = ratio - c.n_parameters * np.log(n)
            if prediction is None:
                c.gain = 100 * (parent.sse - before) / plain.power
                c.vaf = base_vaf + c.gain
            else:
                c.vaf, c.prediction = vaf, prediction
                c.gain = c.vaf - base_vaf
            single = float(chi2.sf(max(ratio, 0.0), max(c.n_parameters, 1)))
            c.p_value = min(1.0, single * len(tried))
            c.least_gain = self.share * (LEAST_GAIN_OF_CLAIM if c.id == CLAIM else LEAST_GAIN)
            c.refused = without_name(c)
        most = max((c.gain for c in candidates if c.passes and not c.trace), default=0.0)
        for c in tried:  # levels may be those at which something else came to rest
            c.trace = c.trace if c.gain > most - TRACE_LEADS else ""
        if self.core.kind.is_operator:
            for c in tried:
                c.unweighed = c.gain >= c.least_gain and not (c.trace or c.refused)
        weigh = self._weighing(base)
        weigh_likely(candidates, weigh)
        candidates = likeliest_alternatives(candidates)
        loop = None if self.loop is None else self.loop.around(base, parent)
        known = base, parent, base_vaf, base_prediction
        step = SearchStep(*known, candidates, loop, self.refit, weigh)
        step.rank()
        special_first(step)
        return step

    def _weighing(self, base: Model) -> Weigh:
        """What finds the unbiased ΔBIC of candidates over a parent."""
        beside = cache(lambda: JointParent(base))

        def weigh(candidates: list[Candidate]) -> None:
            models = [(c.model.effects, c.model.fit) for c in candidates if c.model]
            for c, found in zip(candidates, self._each(self._joint, models, beside()), strict=True):
                c.joint, c.unweighed = found, False

        return weigh

    def _joint(self, found: tuple[Effects, Fit], beside: JointParent) -> float:
        return beside.delta_bic(self._model(found, beside.parent), LIKELY_IF_FIRST)

    def allowed_loss(self, model: Model, name: str) -> float:
        """Points of VAF that an effect may lose: some, where the output itself shows it."""
        id_ = dict(model.effects.steps)[name].name
        return -LEAST_GAIN * self.share if id_ in self.traces else 0.0

    def partial_models(self, model: Model, start: int, core: dict[str, float]) -> list[Model]:
        """Models with the first ``start`` effects, with one more, and so on."""
        key = (start, *model.key)
        if key not in self._parts:
            names = model.effects.names
            models = [output_error_fit(model)] if len(names) > start else []
            for name in reversed(names[start + 1 :]):
                models.append(self.fewer(models[-1], name, core))
            models.append(self._parents[frozenset(names[:start])])  # whatever was tried
            self._parts[key] = models[::-1]
        return self._parts[key]

    def fewer(self, model: Model, name: str, core: dict[str, float]) -> Model:
        """The model without an effect: fitted from where it is, or as the search had it."""
        fewer = without(model, name, core)
        known = self._parents.get(frozenset(fewer.effects.names))
        if known is None or {*known.simulator.names} - {*model.simulator.names}:
            return fewer  # the same effects may have had other choices then
        return in_order(known, fewer.effects.names) if known.sse < fewer.sse else fewer

    def refit(self, model: Model) -> float:
        """Held-out VAF of a model refitted without each fold's rows."""
        return vaf_of_output(self.record, self.refitted(model))

    def refitted(self, model: Model) -> np.ndarray:
        """Held-out predictions of a model refitted without each fold's rows."""
        key = model.key
        if key not in self._refits:
            found = refitted_prediction(output_error_fit(model), self.criterion, self.folds)
            self._refits[key] = np.where(np.isfinite(found), found, 0.0)
        return self._refits[key]

    def fitted_without_folds(self, model: Model) -> tuple[Model, list[np.ndarray]]:
        """A model at the least error of simulation, and its parameters without each fold."""
        base = output_error_fit(model)
        fits = without_folds(base, self.criterion, self.folds)
        return base, [fitted.theta for _, fitted in fits]

    def _refined(
        self, found: tuple[Effects, Fit, bool], parent: Model, criterion: Criterion
    ) -> tuple[Fit, float, np.ndarray | None]:
        """A model at the minimum of a criterion, and what it predicts of held-out rows."""
        effects, fit, shown = found
        fitted = self._model((effects, fit), parent)
        # What gains too little in plain simulation error cannot gain enough held out.
        if not shown and parent.sse - fitted.sse < HOPELESS * self.share * self.criterion.power:
            return fitted.refined(criterion, max_iter=1).fit, -np.inf, None
        model = fitted.refined(criterion)
        return model.fit, *self._held_out(fitted)

    def _held_out(self, fitted: Model) -> tuple[float, np.ndarray]:
        """Held-out VAF and predictions, by simulation error.

        By likelihood they would depend on the noise model, and so on what else is tried.
        """
        prediction = held_out(fitted, self.criterion, self.folds)
        return vaf_of_output(self.record, prediction), prediction


def _all_of(function: Callable[..., Any], items: Sequence[Any], args: tuple) -> list[Any]:
    """The work of one process; a single thread, as the matrix products are small."""
    with threadpool_limits(1):
        return [function(item, *args) for item in items]


def share_about_mean(criterion: Criterion) -> float:
    """Share of the output's power that is not its mean: what points of VAF have to count in."""
    return criterion.power_about_mean / max(criterion.power, 1e-300)


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
        before = self.steps[0].parent.effects.names
        return [name for name in self.model.effects.names if name not in before]

    @property
    def core(self) -> dict[str, float]:
        """Parameters of the core before any effect was added."""
        return {n: v for n, v in self.steps[0].plain.values().items() if "__" not in n}


def forward(search: Search, baseline: Model, most: int) -> Path:
    """Add the best effect as long as one pays; try the second best first effect too."""
    first = search.step(baseline)
    greedy = follow(search, first, first.best if most else None, most)
    if len(greedy.steps) > 1 and len(greedy.ids) > 1:
        for rival in first.rivals()[:N_RIVALS]:
            if rival.id in greedy.ids[:1] or not first.judge(rival):
                continue
            other = follow(search, first, rival, 2)
            if len(other.ids) > 1:
                pair = path_of_length(greedy, 2)
                if better(search, first.parent, other.model, pair):
                    greedy = follow_from(search, other, most)
    return in_gaining_order(search, trimmed(search, greedy, most), first)


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
    model = beside_each_other(plain, templates, search.criterion, search.coarse)
    if not model.sse < BETTER_AGAIN * plain.sse:
        return path
    step = search.judged(model, [])
    return replace(path, model=step.parent)


def in_gaining_order(search: Search, path: Path, first: SearchStep) -> Path:
    """Effects by rank, as they were added, or the other way round; without a loser, if all lose.

    Each step must lower the error of held-out rows, refitted without them.
    """
    start = len(path.steps[0].parent.effects)
    rank = {c.name: i for i, c in enumerate(first.candidates) if c.passes}
    given, added = path.model.effects.names[:start], path.model.effects.names[start:]
    by_rank = sorted(added, key=lambda name: rank.get(name, len(rank)))
    ways = [
        replace(path, model=ordered(path.model, [*given, *order]))
        for order in (by_rank, added, added[::-1])
    ]
    for way in ways:
        if rises(search, way):
            return way
    gains = gains_of_steps(search, ways[0])
    name = min(gains, key=lambda one: gains[one])
    fewer = output_error_fit(without(path.model, name, path.core))
    step = search.judged(fewer, [])
    path = replace(path, model=step.parent)
    return in_gaining_order(search, path, first)


def gains_of_steps(search: Search, path: Path) -> dict[str, float]:
    """What each effect of a path adds to the VAF of held-out rows, refitted without them."""
    start = len(path.steps[0].parent.effects)
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
        return Path([first], first.parent)
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


def output_error_fit(model: Model) -> Model:
    """The same model at the minimum of the plain simulation error."""
    return model.refined(Criterion(model.simulator.record))


def path_of_length(path: Path, n: int) -> Model:
    """The model with the first n effects of a path."""
    for step in path.steps:
        if len(step.parent.effects) == n:
            return step.parent
    return path.model


def further_changes(search: Search, path: Path) -> dict[str, tuple[float, float, float]]:
    """Whether neuromuscular frequency and damping change with gains that do.

    Relative change, its standard error and the p-value of the likelihood ratio, by parameter; empty
    where no gain changes by a sigmoid.
    """
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
        beside = np.array([model.values()[n] for n in plain.simulator.names])
        fewer = min(plain.sse, minimise(plain.simulator, criterion, beside).sse)
        ratio = criterion.n * np.log(fewer / model.sse)
        sd = float(np.sqrt(model.covariance()[at, at]))
        found[parameter] = (float(model.theta[at]), sd, float(chi2.sf(max(ratio, 0.0), 1)))
    return found


def better(search: Search, parent: Model, one: Model, other: Model) -> bool:
    """Whether one model explains more than the other, by the criterion that ranks candidates."""
    return lead(search, parent, one, other) > 0


def lead(search: Search, parent: Model, one: Model, other: Model) -> float:
    """ΔBIC by which one model leads another, as candidates are ranked.

    Under the noise model of the better one, and with noise models estimated along, beside what both
    have in common. Infinite where little noise is left and the plainer one is as good.
    """
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
        beside = JointParent(parent)
        joint = beside.delta_bic(both[0]) - beside.delta_bic(both[1])
        delta_bic = delta_bic / 2 + joint if np.isfinite(joint) else delta_bic
    return float(delta_bic)


def without_superfluous(search: Search, path: Path) -> Path:
    """Remove effects that no longer pay in the presence of the others.

    First the one that raises the error of held-out rows most, when refitted without them.
    """
    model = path.model
    names = model.effects.names[len(path.steps[0].parent.effects) :]  # others were given
    if len(names) < 2:
        return path
    fewer = {name: output_error_fit(search.fewer(model, name, path.core)) for name in names}
    fitted, whole = output_error_fit(model), search.refit(model)
    gains = {name: whole - search.refit(one) for name, one in fewer.items()}
    worst = min(names, key=lambda name: gains[name] - search.allowed_loss(model, name))
    loses = gains[worst] <= search.allowed_loss(model, worst)
    for name in [worst] if loses else names[:-1]:
        one = Candidate(name, dict(model.effects.steps)[name], model=fitted)
        step = search.judged(fewer[name], [one])
        if loses or not one.pays:
            path = replace(path, model=step.parent)
            return without_superfluous(search, path)
    return path
