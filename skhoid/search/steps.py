"""A step of a search: effects tried beside a model, each judged, and ranked."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from .._machine import ended_by_signals
from ..diagnosis.leaks import SLOPE, LeakTest
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..model.cores import Core
from ..model.effort import OutOfTimeError, bounded
from ..model.estimator import vaf_of_output
from ..model.extend import Explored, begin, explore, explored_from, extended, finish
from ..model.fitting import Criterion, Fit, RemnantModel
from ..model.model import Model, begin_alike, in_order, without
from ..model.simulator import Simulator
from .instruments import Curves, InstrumentJudge
from .judges import (
    HeldOutRows,
    JointParent,
    find_traces,
    held_out,
    refitted_prediction,
    test_leak,
    weigh,
    without_folds,
    without_noise,
)
from .judging import (
    CLAIM,
    FLOOR,
    FREE_RUN,
    INSTRUMENTS,
    LEAST_GAIN,
    LIKELIHOOD,
    THRESHOLD,
    TRACE,
    Candidate,
    find_lead,
    find_likeliest_alternatives,
    find_why_unnamed,
    find_why_zero,
    mark_confused,
    rank,
)
from .probability import Alternative, find_chances, name_probability
from .statuses import Against, Reason

PARTS = 3  # of the work for each process
HOPELESS = 0.002  # of the output's power: less than ``LEAST_GAIN`` on the rows of the fit
N_JUDGED = 3  # of the best candidates: the first, and those it has to be told from
AT_ONCE = 0.5  # of what the best start saves, with which a candidate is followed at once


class Progress:
    """Steps of a search, and what is done in each, as subtasks of its ``fit``.

    Without a context it says nothing, as in other processes.
    """

    def __init__(self, estimator: Any = None, context: Any = None):
        self._estimator, self._context = estimator, context
        self._task: Any = None
        self._left = 0

    def __getstate__(self) -> dict[str, Any]:
        return vars(Progress())

    @contextmanager
    def step(self, n: int) -> Iterator[None]:
        """A step of n pieces of work; inside another it is part of that."""
        if self._context is None or self._task is not None:
            yield
            return
        task = self._context.subcontext(task_name="effects tried", max_subtasks=n)
        self._task, self._left = task, n
        task.call_on_fit_task_begin(estimator=self._estimator)
        try:
            yield
        finally:
            self._task = None
            task.call_on_fit_task_end(estimator=self._estimator)

    def done(self, n: int) -> None:
        """Say that n more pieces of work are done."""
        for _ in range(min(n, self._left) if self._task is not None else 0):
            self._left -= 1
            piece = self._task.subcontext()
            piece.call_on_fit_task_begin(estimator=self._estimator)
            piece.call_on_fit_task_end(estimator=self._estimator)


def unique_name(effect: Effect, effects: Effects) -> str:
    """The name that a composition gives a further effect."""
    return (effects + effect).names[-1]


@dataclass
class SearchStep:
    """A parent, and all candidates for it, best first.

    The parent is there twice: ``at_likelihood``, the largest under the noise model of the step,
    which ``criterion`` has, and ``at_least_error`` of the simulation.
    """

    search: Search
    criterion: Criterion
    at_likelihood: Model
    at_least_error: Model
    vaf: float
    prediction: np.ndarray
    candidates: list[Candidate]
    other: list[Alternative] = field(default_factory=list)  # something else, if it was looked for
    vaf_loop: float = np.nan
    _joint: dict[int, JointParent] = field(default_factory=dict)

    @property
    def refitted_vaf(self) -> float:
        """Held-out VAF of the parent, refitted for each fold."""
        return self.search.refit(self.at_least_error)

    @property
    def best(self) -> Candidate | None:
        first = self.candidates[0] if self.candidates else None
        return first if first is not None and first.passes else None

    @cached_property
    def _parent_leak(self) -> LeakTest | None:
        return test_leak(self.at_likelihood)

    def tell_chances(self) -> None:
        """Find the probability of each name, as if nothing else were found."""
        tried = self.tried
        chances = find_chances(tried)
        for i, c in enumerate(c for c in self.candidates if c.evidence):
            c.probability = name_probability(tried, chances, i) if c.least > 0 else 0.0

    def tell_chance(self, candidate: Candidate, found: Container[str], beside: float) -> None:
        """Find the probability of a name beside others that are ``found``: they are no rivals.

        They may have hidden a part of it in this step; ``beside`` them it has other evidence.
        """
        rivals = [
            c for c in self.candidates if c.evidence and c is not candidate and c.name not in found
        ]
        own = Alternative(candidate.effect, max(candidate.least, beside))
        tried = [own, *(Alternative(c.effect, c.least) for c in rivals), *self.other]
        candidate.probability = name_probability(tried, find_chances(tried), 0)

    @property
    def tried(self) -> list[Alternative]:
        """The effects that apply and something else, for their probabilities."""
        applying = [Alternative(c.effect, c.least) for c in self.candidates if c.evidence]
        return [*applying, *self.other]

    def rank(self) -> None:
        """Put the best first, by the evidence of all judges; the next two are judged as well.

        What was only begun is followed where it may come before the second.
        """
        while True:
            self.candidates.sort(key=rank)
            known = find_likeliest_alternatives([c for c in self.candidates if not c.begun])
            left = [c for c in known[:N_JUDGED] if c.passes and not c.refit]
            if left:
                self.judge(left[0])
                continue
            least = max([THRESHOLD, *(c.least for c in known[1:2])])
            hopeful = [c for c in self.candidates if c.hoped > least]
            if not hopeful:
                break
            self.follow(hopeful[0])
        self.candidates = sorted(find_likeliest_alternatives(self.candidates), key=rank)
        self._put_special_first()
        mark_confused(self.candidates)

    def follow(self, begun: Candidate) -> None:
        """Fit a candidate that was only begun, and weigh it."""
        begun.begun = False
        self.search.finish(self.at_least_error, [begun])
        self.search.weigh_fitted(self, [begun])

    def judge(self, candidate: Candidate) -> None:
        """Ask all judges of a candidate, until one of them is against it."""
        record = self.at_likelihood.simulator.record
        failed = attempt(partial(self._ask_in_turn, candidate), record)
        if failed is not None:
            candidate.refused = failed

    def _ask_in_turn(self, c: Candidate) -> None:
        assert c.model is not None
        if not c.trace:
            self.ask_all(c, least=THRESHOLD)
            if c.passes:
                c.refused = find_why_zero(c)
        if c.passes and not c.refit:
            c.refused = find_leak(test_leak(c.model), self._parent_leak)
        if c.passes and not c.refit:
            self.refit_gain(c)

    def refit_gain(self, c: Candidate) -> None:
        """Find what a candidate gains on held-out rows with parameters fitted without them."""
        assert c.model is not None
        before = self.at_least_error if c.before is None else c.before[1]
        model, record = c.model, self.at_likelihood.simulator.record
        refit = self.search.refit
        gain = attempt(lambda: refit(model) - refit(before), record)
        c.refit = True
        if isinstance(gain, Against):
            c.gain, c.refused = -np.inf, gain
        else:
            c.gain = gain

    def ask_all(self, candidate: Candidate, least: float = -np.inf) -> None:
        """Ask judges that were not asked yet, as long as there is more than the ``least``."""
        c = candidate
        assert c.model is not None
        before = self.at_likelihood if c.before is None else c.before[0]
        if c.least > least and INSTRUMENTS not in c.evidence:
            judge = self.search.instruments
            c.evidence[INSTRUMENTS] = np.nan if judge is None else judge.evidence(before, c.model)
        if c.least > least and LIKELIHOOD not in c.evidence:
            c.evidence[LIKELIHOOD] = self._by_own_noise(before, c.model)

    def _by_own_noise(self, before: Model, model: Model) -> float:
        """Nats of a model over another, each with the noise model that is likeliest with it."""
        if not before.simulator.core.kind.is_operator:
            return np.nan
        if id(before) not in self._joint:
            self._joint[id(before)] = JointParent(before)
        return self._joint[id(before)].weigh(model)

    def _put_special_first(self) -> None:
        """Put a special case before the best, where that has nothing beyond it that counts."""
        general = self.best
        if general is None or general.trace:
            return
        for special in [c for c in self.candidates if general.effect.name in c.effect.within]:
            if special.begun:
                self.follow(special)
            if special.passes:
                self.judge(special)
            more = general.gain - special.gain
            as_good = find_lead(general, special) <= THRESHOLD or more < special.least_gain
            if special.passes and as_good:
                self.candidates.remove(special)
                self.candidates.insert(0, special)
                return


def attempt(work: Callable[[], Any], record: Record, until: float = np.inf) -> Any:
    """What some work on a candidate returns, or why it failed, or that time was over."""
    try:
        with bounded(record.known.size, until), np.errstate(all="ignore"):
            return work()
    except OutOfTimeError:
        return Against(Reason.TIME, "the time limit was reached before")
    except (ArithmeticError, ValueError) as error:  # LinAlgError is a ValueError
        text = f"it could not be fitted to these runs: {error or type(error).__name__}"
        return Against(Reason.NOT_FITTED, text.rstrip("."))


def find_leak(leak: LeakTest | None, of_parent: LeakTest | None) -> Against | None:
    """What speaks against a model that rebuilds the output from x, more than its parent does."""
    if leak is None or not leak.leaks:
        return None
    known = of_parent.slope if of_parent is not None and of_parent.leaks else -np.inf
    return None if leak.slope < known + SLOPE else Against(Reason.REBUILDS, leak.reason)


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
        until: float = np.inf,
        exhaustive: bool = False,
    ):
        self.exhaustive = exhaustive
        self.progress = Progress() if progress is None else progress
        self.until = until  # of time.monotonic(): when no further effect is tried
        self.core, self.record, self.folds = core, record, folds
        self.instruments = InstrumentJudge.of(record, THRESHOLD) if core.kind.is_operator else None
        self.curves = Curves(record, self.instruments)
        self.effects = [e for e in effects if not e.noise]
        self.noises = [e for e in effects if e.noise]  # which no input explains
        self.traces = find_traces(record)
        self.criterion = Criterion(record)
        self.coarse = self.criterion.coarse()
        # Of the output's power that is not its mean: what points of VAF have to count in.
        self.share = self.criterion.power_about_mean / max(self.criterion.power, 1e-300)
        self._worth = HOPELESS / 2 * self.share  # that exploring has to save, to go on
        self.n_jobs = n_jobs
        self._stepped = False
        self._refits: dict[tuple, np.ndarray] = {}
        self._parts: dict[tuple, list[Model]] = {}
        self._parents: dict[frozenset[str], Model] = {}

    def without_tremor(self, baseline: Model) -> Search | None:
        """The same search on the output without a tremor that a model's residual shows.

        None where it shows none.
        """
        if not self.core.kind.is_operator:
            return None
        record = without_noise(self.record, baseline.output, self.noises)
        if record is None:
            return None
        effects = [*self.effects, *self.noises]
        options = self.n_jobs, self.progress, self.until, self.exhaustive
        return Search(self.core, record, effects, self.folds, *options)

    @property
    def is_over(self) -> bool:
        """Whether the time for trying effects is over."""
        return time.monotonic() > self.until

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
                delayed(_run_all)(function, part, args) for part in parts
            ):
                done.append(part)
                self.progress.done(len(part))
        return [done[i % n_parts][i // n_parts] for i in range(len(items))]

    def remember(self, parent: Model) -> None:
        """Keep a parent, with which a path may be walked again."""
        self._parents[frozenset(parent.effects.names)] = parent

    def step(self, parent: Model, among: Container[str] | None = None) -> SearchStep:
        """All candidates for a parent that was fitted by output error, or those ``among`` ids."""
        self.remember(parent)
        candidates = []
        taken = {effect.name for _, effect in parent.effects}
        for effect in self.effects:
            if effect.name in taken or (among is not None and effect.name not in among):
                continue
            name = unique_name(effect, parent.effects)
            lacks = effect.refusal_in(self.record, self.core.kind)
            against = Against(Reason.REFUSED, lacks) if lacks else None
            tried_apart = [effect] if lacks else effect.alternatives(self.record)
            candidates += [Candidate(name, one, untried=against) for one in tried_apart]
        tried = [c for c in candidates if c.untried is None]
        with self.progress.step(3 * len(tried)):  # explored, fitted, and refined
            rough = explored_from(parent, self.coarse)
            asked = 0.0
            for smooth in (True, False):  # first those that are not scanned: they say what leads
                some = [c for c in tried if c.effect.smooth is smooth]
                added = [(c.name, c.effect) for c in some]
                done = self._each(self._explored, added, parent, rough, self._stepped, asked)
                for c, found in zip(some, done, strict=True):
                    if isinstance(found, Against):
                        c.untried = found
                    else:
                        c.explored = found
                        share = found.gain / max(found.before, 1e-300)
                        asked = max(asked, 0.0 if self.exhaustive else AT_ONCE * share)
            self._stepped = True
            most = max((c.explored.gain for c in tried if c.explored), default=0.0)
            least = max(AT_ONCE * most, self._worth * self.coarse.power)
            for c in tried:
                shown = c.effect.place == "output" and c.effect.name in self.traces
                leads = c.explored is not None and c.explored.gain >= least
                c.begun = not (self.exhaustive or shown or leads)
            self.finish(parent, [c for c in tried if c.explored])
            return self.judge_candidates(parent, candidates)

    def finish(self, parent: Model, candidates: list[Candidate]) -> None:
        """Fit candidates that were explored, unless they are only begun."""
        items = [(c.name, c.explored, c.begun) for c in candidates]
        for c, found in zip(candidates, self._each(self._finished, items, parent), strict=True):
            self._take(found, c, parent)

    def _explored(
        self, added: tuple[str, Effect], parent: Model, rough: Model, again: bool, asked: float
    ) -> Explored | Against:
        how: dict[str, Any] = {"worth": self._worth, "rough": rough, "again": again, "asked": asked}
        return attempt(lambda: explore(parent, *added, self.coarse, **how), self.record, self.until)

    def _finished(
        self, item: tuple[str, Explored, bool], parent: Model
    ) -> tuple[Effects, Fit] | Against:
        name, explored, is_begun = item
        if is_begun:
            return self._try(begin, parent, name, explored, self.criterion)
        return self._try(
            finish, parent, name, explored, self.criterion, self.coarse, worth=self._worth
        )

    def _try(
        self, make: Callable[..., Model], *args: Any, **how: Any
    ) -> tuple[Effects, Fit] | Against:
        """Effects and fit of a model that is made in the time there is, or why there is none."""

        def fit() -> tuple[Effects, Fit]:
            model = make(*args, **how)
            return model.effects, model.fit

        return attempt(fit, self.record, self.until)

    def candidate(self, parent: Model, name: str, effect: Effect) -> Candidate:
        """One more effect beside a parent, as it is fitted."""
        one = Candidate(name, effect)
        found = self._try(extended, parent, name, effect, self.criterion, self.coarse)
        self._take(found, one, parent)
        if one.model is not None:
            one.effect = dict(one.model.effects.steps)[name]
        return one

    def _take(self, found: tuple[Effects, Fit] | Against, c: Candidate, parent: Model) -> None:
        if isinstance(found, Against):
            c.untried = found
        else:
            c.model = self._model(found, parent)

    def _model(self, found: tuple[Effects, Fit], parent: Model) -> Model:
        effects, fit = found
        return Model(Simulator(self.core, effects, self.record), fit, parent.other_cores)

    def _alike(self, parent: Model, c: Candidate) -> Model:
        """What a candidate is compared with: the parent, whose runs begin as the candidate's do."""
        assert c.model is not None
        values = {n.removeprefix(f"{c.name}__"): v for n, v in c.model.values().items()}
        return begin_alike(parent, c.name, dict(c.model.effects.steps)[c.name], values)

    def judge_candidates(self, parent: Model, candidates: list[Candidate]) -> SearchStep:
        """Refine all under one noise model, that of the best, and rank."""
        step = self.weigh_candidates(parent, candidates)
        step.rank()
        return step

    def weigh_candidates(self, parent: Model, candidates: list[Candidate]) -> SearchStep:
        """Refine all under one noise model; they are not ranked yet."""
        criterion = Criterion(self.record)
        tried = [c for c in candidates if c.model is not None]
        alike = [self._alike(parent, c) for c in tried]
        pairs = zip(tried, alike, strict=True)
        models = [parent, *(c.model for c, before in pairs if c.model and before is parent)]
        criterion.set_noise(criterion.remnant_model(min(models, key=lambda m: m.sse).output))
        vaf_before, prediction_before = self._held_out(parent)
        step = SearchStep(
            search=self,
            criterion=criterion,
            at_likelihood=parent.refined(criterion),
            at_least_error=parent,
            vaf=vaf_before,
            prediction=prediction_before,
            candidates=candidates,
        )
        self.weigh_fitted(step, candidates, alike)
        return step

    def weigh_fitted(
        self, step: SearchStep, candidates: list[Candidate], alike: list[Model] | None = None
    ) -> None:
        """Refine candidates under the noise model of a step, and say what they have for them."""
        parent, criterion, n = step.at_least_error, step.criterion, step.criterion.n
        tried = [c for c in candidates if c.model is not None]
        n_tried = sum(c.model is not None for c in step.candidates)
        alike = [self._alike(parent, c) for c in tried] if alike is None else alike
        pairs = list(zip(tried, alike, strict=True))
        for c in tried:
            shown = self.traces.get(c.effect.name) if c.effect.place == "output" else None
            c.trace, nats = shown or ("", np.nan)
            c.evidence = {TRACE: nats} if c.trace else {}
        noises = [  # runs that begin anywhere leave other noise
            criterion.noise if before is parent else criterion.remnant_model(c.model.output)
            for c, before in pairs
            if c.model
        ]
        fitted = [(c.model.effects, c.model.fit, bool(c.trace), c.begun) for c in tried if c.model]
        items = list(zip(fitted, noises, strict=True))
        refined = self._each(self._refined, items, parent)
        for (c, plain), noise, found in zip(pairs, noises, refined, strict=True):
            if isinstance(found, Against):
                c.untried, c.model, c.begun = found, None, False
                continue
            assert c.model is not None
            fit, vaf, prediction = found
            sse, before, of_before = c.model.sse, step.at_likelihood, step.vaf
            c.model = self._model((c.model.effects, fit), parent)
            if c.begun:
                sse = self.criterion.sse(c.model.output)
            if plain is not parent:
                before = plain.refined(Criterion(self.record, noise))
                of_before, c.before = self._held_out(plain)[0], (before, plain)
            c.n_parameters = c.model.n_parameters - before.n_parameters
            if not c.trace:
                c.evidence = {FREE_RUN: weigh(before, c.model, n)}
            if prediction is None:
                c.gain = 100 * (plain.sse - sse) / self.criterion.power
                c.vaf = of_before + c.gain
            else:
                c.vaf, c.prediction = vaf, prediction
                c.gain = c.vaf - of_before
            ratio = n * np.log(max(before.sse, 1e-300) / max(c.model.sse, 1e-300))
            single = float(chi2.sf(max(ratio, 0.0), max(c.n_parameters, 1)))
            c.p_value = min(1.0, single * n_tried)
            least = FLOOR if c.effect.name == CLAIM else LEAST_GAIN
            c.least_gain = least * self.share
            c.refused = find_why_unnamed(c)

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
        self, found: tuple[tuple[Effects, Fit, bool, bool], RemnantModel], parent: Model
    ) -> tuple[Fit, float, np.ndarray | None] | Against:
        return attempt(partial(self._refine, found, parent), self.record)

    def _refine(
        self, found: tuple[tuple[Effects, Fit, bool, bool], RemnantModel], parent: Model
    ) -> tuple[Fit, float, np.ndarray | None]:
        """A model at the minimum under a noise model, and what it predicts of held-out rows."""
        (effects, fit, shown, begun), noise = found
        criterion = Criterion(self.record, noise)
        fitted = self._model((effects, fit), parent)
        # What gains too little in plain simulation error cannot gain enough held out.
        hopeless = parent.sse - fitted.sse < HOPELESS * self.share * self.criterion.power
        if begun or (hopeless and not shown):
            return fitted.refined(criterion, max_iter=1).fit, -np.inf, None
        model = fitted.refined(criterion)
        return model.fit, *self._held_out(fitted)

    def _held_out(self, fitted: Model) -> tuple[float, np.ndarray]:
        """Held-out VAF and predictions, by simulation error.

        By likelihood they would depend on the noise model, and so on what else is tried.
        """
        prediction = held_out(fitted, self.criterion, self.folds)
        return vaf_of_output(self.record, prediction), prediction


def _run_all(function: Callable[..., Any], items: Sequence[Any], args: tuple) -> list[Any]:
    """The work of one process; a single thread, as the matrix products are small."""
    with threadpool_limits(1):
        return [function(item, *args) for item in items]


def output_error_fit(model: Model) -> Model:
    """The same model at the minimum of the plain simulation error."""
    return model.refined(Criterion(model.simulator.record))
