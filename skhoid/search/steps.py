"""A step of a search: effects tried beside a model, each judged, and ranked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from .._machine import ended_by_signals
from ..diagnosis.leaks import LeakTest
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..model.cores import Core
from ..model.estimator import vaf_of_output
from ..model.extend import explored_from, extended
from ..model.fitting import Criterion, Fit, minimise, sse_at
from ..model.model import Model, in_order, without
from ..model.simulator import Simulator
from .judges import (
    HeldOutRows,
    InLoop,
    JointParent,
    LoopJudge,
    LoopParent,
    find_traces,
    held_out,
    refitted_prediction,
    test_leak,
    without_folds,
    without_noise,
)
from .judging import (
    CLAIM,
    CONFUSED,
    LEAST_GAIN,
    LEAST_GAIN_OF_CLAIM,
    LIKELY_IF_FIRST,
    LOOP_DELTA_BIC,
    MAY_BE_BEST,
    N_RIVALS,
    RIVAL,
    TRACE_LEADS,
    Candidate,
    as_good,
    find_special_cases,
    find_why_unnamed,
    hardly_there,
    leaks_beyond,
    likeliest_alternatives,
    mark_confused,
    may_lead,
    order_key,
    plainest_first,
)
from .statuses import Against, Reason

PARTS = 3  # of the work for each process
HOPELESS = 0.002  # of the output's power

FindJoint = Callable[[list[Candidate]], None]


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

    The parent is there twice: ``at_likelihood``, the largest under the noise model of the step, and
    ``at_least_error`` of the simulation. ``refit`` is the held-out VAF of a model refitted for each
    fold, and ``find_joint`` finds the unbiased ΔBIC of candidates.
    """

    at_likelihood: Model
    at_least_error: Model
    vaf: float
    prediction: np.ndarray
    candidates: list[Candidate]
    loop: LoopParent | None
    refit: Callable[[Model], float]
    find_joint: FindJoint | None = None

    @property
    def refitted_vaf(self) -> float:
        """Held-out VAF of the parent, refitted for each fold."""
        return self.refit(self.at_least_error)

    def rank(self) -> None:
        """Put the best first; it has also passed in the closed loop, where that is known."""
        judged: list[Candidate] = []
        while True:
            find_likely_joint(self.candidates, self.find_joint)
            self.candidates.sort(key=order_key)
            plainest_first(self.candidates)
            first = self.candidates[0] if self.candidates else None
            if first is None or not first.passes or any(first is one for one in judged):
                break
            self.judge(first)
            judged.append(first)
        self._likeliest_in_loop()
        mark_confused(self.candidates)

    def _likeliest_in_loop(self) -> None:
        """Of the linear effects that pass, the one with the largest ΔBIC in the closed loop.

        Outside the loop, the remnant also influences which of them fits best. Those whose ΔBIC in
        the loop is within 20 of the largest keep their order: the first of them leads.
        """
        first = self.best
        if first is None or not first.linear_in_loop:
            return
        rivals = [c for c in self.rivals() if not c.trace][:N_RIVALS]
        assert self.loop is not None
        assert first.in_loop is not None
        enough = first.in_loop.delta_bic + LOOP_DELTA_BIC
        if not any(self._likely_in_loop(c, enough) for c in rivals):  # whatever rows held out say
            for c in rivals:
                if abs(c.ranking_bic - first.ranking_bic) < CONFUSED:
                    self.judge(c)
            return
        for c in rivals:
            self.judge(c)
        near = [c for c in rivals if c.passes and c.linear_in_loop]

        def in_loop(c: Candidate) -> float:
            assert c.in_loop is not None
            return c.in_loop.delta_bic

        least = max(in_loop(c) for c in [first, *near]) - LOOP_DELTA_BIC
        best = next(c for c in [first, *near] if in_loop(c) >= least)
        self.candidates.remove(best)
        self.candidates.insert(0, best)

    def rivals(self) -> list[Candidate]:
        """Candidates that pass and have much of the ranking ΔBIC of the first."""
        find_likely_joint(self.candidates, self.find_joint, RIVAL)
        self.candidates[1:] = sorted(self.candidates[1:], key=order_key)
        least = RIVAL * self.candidates[0].ranking_bic
        return [c for c in self.candidates[1:] if c.passes and c.ranking_bic > least]

    def _likely_in_loop(self, candidate: Candidate, enough: float) -> bool:
        """Whether a linear effect's ΔBIC in the closed loop is more than enough."""
        assert self.loop is not None
        assert candidate.model is not None
        found, _ = self.loop.compare_likelihood(candidate.model)
        return not found.bends and bool(found.delta_bic > enough)

    def judge(self, candidate: Candidate) -> None:
        """Judge a candidate in the closed loop too, and refitted without each fold.

        Its ``passes`` says afterwards whether it still passes.
        """
        if candidate.lacks_joint and self.find_joint is not None:
            self.find_joint([candidate])
        if candidate.in_loop is None and not candidate.trace:
            assert candidate.model is not None
            loop = self.loop
            candidate.in_loop = InLoop() if loop is None else loop.compare_in_loop(candidate.model)
        solved = candidate.in_loop is not None and np.isfinite(candidate.in_loop.vaf)
        if candidate.pays and candidate.model is not None and not solved:
            candidate.refused = leaks_beyond(test_leak(candidate.model), self._parent_leak)
        if candidate.passes and not candidate.trace:
            candidate.refused = hardly_there(candidate)
        if candidate.passes and candidate.model is not None:
            gain = self.refit(candidate.model) - self.refitted_vaf
            if gain <= (-candidate.least_gain if candidate.trace else 0.0):
                candidate.refused = Against(
                    Reason.LOSES, f"fitted without the rows, it loses {-gain:.2g} points there"
                )

    @cached_property
    def _parent_leak(self) -> LeakTest | None:
        return test_leak(self.at_likelihood)

    @property
    def best(self) -> Candidate | None:
        first = self.candidates[0] if self.candidates else None
        return first if first is not None and first.passes else None

    def put_special_first(self) -> None:
        """Put a special case before the best, where that has nothing beyond it that counts.

        It must have passed all criteria itself, those of the closed loop and of rows left out too.
        """
        general = self.best
        if general is None or general.trace:
            return
        for special in find_special_cases(general, self.candidates):
            self.judge(special)
            if special.passes and as_good(special, general):
                self.candidates.remove(special)
                self.candidates.insert(0, special)
                return


def find_likely_joint(
    candidates: list[Candidate], find_joint: FindJoint | None, share: float = MAY_BE_BEST
) -> None:
    """Find the unbiased ΔBIC of those that may have a ``share`` of the best's ranking ΔBIC."""
    while find_joint is not None and (left := may_lead(candidates, share)):
        find_joint(left)


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
        self.traces = find_traces(record)
        self.criterion = Criterion(record)
        self.coarse = self.criterion.coarse()
        # Of the output's power that is not its mean: what points of VAF have to count in.
        self.share = self.criterion.power_about_mean / max(self.criterion.power, 1e-300)
        self.n_jobs = n_jobs
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
                delayed(_run_all)(function, part, args) for part in parts
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
            return self.judge_candidates(parent, candidates)

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
            return self.judge_candidates(parent, [*candidates, *more])

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

    def judge_candidates(self, parent: Model, candidates: list[Candidate]) -> SearchStep:
        """Refine all under one noise model, that of the best, and rank."""
        criterion = Criterion(self.record)
        tried = [c for c in candidates if c.model is not None]
        best = min([parent, *(c.model for c in tried if c.model)], key=lambda m: m.sse)
        criterion.set_noise(criterion.remnant_model(best.output))
        at_likelihood = parent.refined(criterion)
        vaf_before, prediction_before = self._held_out(parent)
        n = criterion.n
        for c in tried:
            c.trace = self.traces.get(c.effect.name, "") if c.effect.place == "output" else ""
        fitted = [(c.model.effects, c.model.fit, bool(c.trace)) for c in tried if c.model]
        refined = self._each(self._refined, fitted, parent, criterion)
        for c, (fit, vaf, prediction) in zip(tried, refined, strict=True):
            assert c.model is not None
            before = c.model.sse
            c.model = self._model((c.model.effects, fit), parent)
            c.n_parameters = c.model.n_parameters - at_likelihood.n_parameters
            ratio = n * np.log(max(at_likelihood.sse, 1e-300) / max(c.model.sse, 1e-300))
            c.delta_bic = ratio - c.n_parameters * np.log(n)
            if prediction is None:
                c.gain = 100 * (parent.sse - before) / self.criterion.power
                c.vaf = vaf_before + c.gain
            else:
                c.vaf, c.prediction = vaf, prediction
                c.gain = c.vaf - vaf_before
            single = float(chi2.sf(max(ratio, 0.0), max(c.n_parameters, 1)))
            c.p_value = min(1.0, single * len(tried))
            c.least_gain = self.share * (
                LEAST_GAIN_OF_CLAIM if c.effect.name == CLAIM else LEAST_GAIN
            )
            c.refused = find_why_unnamed(c)
        most = max((c.gain for c in candidates if c.passes and not c.trace), default=0.0)
        for c in tried:  # levels may be those at which something else came to rest
            c.trace = c.trace if c.gain > most - TRACE_LEADS else ""
        if self.core.kind.is_operator:
            for c in tried:
                c.lacks_joint = c.gain >= c.least_gain and not (c.trace or c.refused)
        find_joint = self._joint_finder(at_likelihood)
        find_likely_joint(candidates, find_joint)
        candidates = likeliest_alternatives(candidates)
        step = SearchStep(
            at_likelihood=at_likelihood,
            at_least_error=parent,
            vaf=vaf_before,
            prediction=prediction_before,
            candidates=candidates,
            loop=None if self.loop is None else self.loop.around(at_likelihood, key=parent.key),
            refit=self.refit,
            find_joint=find_joint,
        )
        step.rank()
        step.put_special_first()
        return step

    def _joint_finder(self, parent: Model) -> FindJoint:
        """What finds the unbiased ΔBIC of candidates over a parent."""
        joint_parent = cache(lambda: JointParent(parent))

        def find_joint(candidates: list[Candidate]) -> None:
            models = [(c.model.effects, c.model.fit) for c in candidates if c.model]
            for c, found in zip(
                candidates, self._each(self._joint, models, joint_parent()), strict=True
            ):
                c.joint, c.lacks_joint = found, False

        return find_joint

    def _joint(self, found: tuple[Effects, Fit], parent: JointParent) -> float:
        return parent.delta_bic(self._model(found, parent.parent), LIKELY_IF_FIRST)

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


def _run_all(function: Callable[..., Any], items: Sequence[Any], args: tuple) -> list[Any]:
    """The work of one process; a single thread, as the matrix products are small."""
    with threadpool_limits(1):
        return [function(item, *args) for item in items]


def output_error_fit(model: Model) -> Model:
    """The same model at the minimum of the plain simulation error."""
    return model.refined(Criterion(model.simulator.record))
