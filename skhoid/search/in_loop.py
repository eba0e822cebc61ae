"""Candidates judged in the closed loop, where the remnant cannot pass for a response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..model.cores import Core
from ..model.estimator import vaf_of_output
from ..model.fitting import Criterion, minimise
from ..model.loop import Loop, LoopSimulator, drawn, loop_of
from ..model.model import Model
from ..model.simulator import Simulator
from .held_out import HeldOutRows, refitted_prediction
from .joint import RATES

LEAST_DELTA_BIC = 20.0  # of an effect that counts
LEAST_GAIN = 0.1  # VAF points on held-out rows of an effect that counts
LEAST_IF_BETTER, MUCH_BETTER = 5.0, 0.3  # the same, of one that gains so many points of VAF there
LEAST_RATE = 45.0  # Hz, to which records are thinned
LIKELY, LIKELY_IF_FIRST, LIKELY_BESIDE_BENT = 25.0, 12.0, 50.0  # with a noise model of its own
MOSTLY = 0.5  # of the power of a change of the output
ITERATIONS = 10
N_TRIED = 2  # iterations from each of several starts
TOLERANCE = 1e-4


@dataclass(frozen=True)
class InLoop:
    """A model in the closed loop: its VAF on held-out rows, and what it has over a parent there.

    NaN where the loop cannot be solved, as with what jumps or sticks, or is not asked. ``bends``
    says that what the model has more is not linear, moves levels, or acts in stretches that were
    found in the data: a remnant makes its mean answer in the loop nearly linear, or is held there,
    and what is no better in the loop may still be right. None where no loop is known. ``beside``
    says what the parent has: nothing yet, other effects, or among them some that bend.
    """

    vaf: float = np.nan
    delta_bic: float = np.nan
    gain: float = np.nan
    bends: bool | None = None
    beside: Literal["nothing", "others", "bent"] = "others"

    @property
    def refutes(self) -> bool:
        """Whether the loop is known, and the model no better than the parent there."""
        if self.bends:
            return self.delta_bic < -LEAST_DELTA_BIC
        least = LEAST_IF_BETTER if self.gain >= MUCH_BETTER else LEAST_DELTA_BIC
        return self.delta_bic <= least or self.gain < LEAST_GAIN

    @property
    def asked(self) -> float:
        """ΔBIC asked of it by a noise model that is estimated along.

        Less where it is the first, and not linear: of nothing, such effects have hardly any. Where
        the loop is not asked, what stands beside one that bends takes up what its form leaves.
        """
        if self.beside == "nothing" and self.bends:
            return LIKELY_IF_FIRST
        unsolved = bool(np.isnan(self.delta_bic))
        if unsolved and (self.beside == "bent" or self.bends is False):
            return LIKELY_BESIDE_BENT
        return LIKELY

    @property
    def against(self) -> float:
        """ΔBIC that the loop has against a model that is not linear."""
        return max(-self.delta_bic, 0.0) if self.bends else 0.0


def only_levels(added: Sequence[Effect], parent: Model, model: Model) -> bool:
    """Whether effects move the level of the output alone, or mostly.

    With an integrator in the element the level of u is that of the disturbance, whatever the
    person's own is, which shows in e.
    """
    if all(e.place == "sum" and getattr(e, "channel", None) is None for e in added):
        return True
    change = np.where(parent.simulator.record.known, model.output - parent.output, 0.0)
    levels = change.sum(axis=0) ** 2 / np.maximum(parent.simulator.record.known.sum(axis=0), 1)
    return bool(levels.sum() > MOSTLY * (change**2).sum())


class LoopJudge:
    """The loop of a record, in which models are fitted and judged."""

    def __init__(self, core: Core, record: Record, loop: Loop, folds: Sequence[HeldOutRows]):
        self.core, self.record, self.loop, self.folds = core, record, loop, folds
        self.plain = Criterion(record)
        self._around: dict[tuple, LoopParent] = {}

    @classmethod
    def of(cls, core: Core, record: Record, folds: Sequence[HeldOutRows]) -> LoopJudge | None:
        """The loop of a record, thinned to a rate that is fast enough; None where it has none."""
        thin = max(1, int(1 / (LEAST_RATE * record.dt) + 1e-6))
        if thin > 1:
            record = record.part(np.arange(record.n_runs), thin)
        loop = loop_of(record)
        if loop is None:
            return None
        rows = [HeldOutRows(fold.test[::thin], fold.train[::thin]) for fold in folds]
        return cls(core, record, loop, rows)

    def around(self, parent: Model, plain: Model | None = None) -> LoopParent:
        """The loop around a model; a remnant of the kind that it leaves is drawn along.

        ``plain`` is the same model at the least error of simulation, by which it is known again;
        None: it is that itself.
        """
        key = (parent if plain is None else plain).key
        if key not in self._around:
            self._around[key] = self._first_around(parent)
        return self._around[key]

    def _first_around(self, parent: Model) -> LoopParent:
        assert self.record.y is not None
        open_run = Simulator(self.core, parent.effects, self.record).run(parent.theta)
        remnant = drawn(self.record.y - open_run, self.record.known)
        return LoopParent(self, replace(self.loop, remnant=remnant), parent)

    def fitted(self, loop: Loop, effects: Effects, starts: Sequence[np.ndarray]) -> Model:
        """Effects beside the core, at the smallest error of the loop that some starts lead to.

        Of several starts the one is followed that some iterations from each lead furthest down.
        """
        simulator: Any = LoopSimulator(self.core, effects, self.record, loop)
        start = starts[0]
        if len(starts) > 1:
            begun = [
                minimise(simulator, self.plain, one, max_iter=N_TRIED, tol=TOLERANCE)
                for one in starts
            ]
            start = min(begun, key=lambda fit: fit.sse).theta
        fit = minimise(simulator, self.plain, start, max_iter=ITERATIONS, tol=TOLERANCE)
        return Model(simulator, fit)


class LoopParent:
    """A model in its loop, against which others are judged."""

    def __init__(self, judge: LoopJudge, loop: Loop, parent: Model):
        self.judge, self.loop, self.parent = judge, loop, parent
        self._vaf: tuple[Model, float] | None = None
        self._compared: dict[int, tuple[Model, InLoop, Model | None]] = {}  # models by identity
        self._judged: dict[int, tuple[Model, InLoop]] = {}  # beside which fit of the parent

    @cached_property
    def fit(self) -> Model:
        """The model at the smallest error of its loop."""
        return self.judge.fitted(self.loop, self.parent.effects, [self.parent.theta])

    @property
    def solved(self) -> bool:
        """Whether the loop can be solved."""
        return bool(np.isfinite(self.fit.output).all())

    def judged(self, model: Model) -> InLoop:
        """A model with more effects, and the parent, under the noise model of the better one."""
        done = self._judged.get(id(model))
        if done is not None and done[0] is self.fit:
            return done[1]
        known, fitted = self.compared(model)
        if fitted is None:
            return known
        before, after = self.vaf, self._held_out(fitted)
        if not np.isfinite(before):
            known = self._not_asked(self._bends(model, self._added(model)))
        elif not np.isfinite(after):
            known = self._unsolved(model)
        else:
            known = replace(known, vaf=after, gain=after - before)
        self._judged[id(model)] = (self.fit, known)
        return known

    def compared(self, model: Model) -> tuple[InLoop, Model | None]:
        """The same without the rows held out, which take most of the time, and the fit to judge.

        None where nothing is left to judge.
        """
        if id(model) not in self._compared:
            self._compared[id(model)] = (model, *self._compare(model))
        return self._compared[id(model)][1:]

    def _compare(self, model: Model) -> tuple[InLoop, Model | None]:
        added = self._added(model)
        effects = [effect for _, effect in added]
        if only_levels(effects, self.parent, model):
            return self._not_asked(True), None
        bends = self._bends(model, added)
        if not (model.simulator.smooth and self.solved):
            return self._not_asked(bends), None
        known = self.fit.values()
        names = model.simulator.names
        other = np.array([{**model.values(), **known}[name] for name in names])
        fitted = self.judge.fitted(self.loop, model.effects, [model.theta, other])
        if not np.isfinite(fitted.output).all():
            return self._unsolved(model), None
        self._start_from(fitted)
        delta_bic = min(self.delta_bic(fitted, rate) for rate in RATES)
        bends = bends and self._bends(model, model.effects.steps)
        return InLoop(delta_bic=delta_bic, bends=bends, beside=self._beside), fitted

    def _unsolved(self, model: Model) -> InLoop:
        """Of a model without a solution in the loop.

        A linear path without one is a loop that does not settle, or has no delay.
        """
        added = self._added(model)
        paths = all(effect.place in ("path", "sum") for _, effect in added)
        linear = paths and not self._bends(model, model.effects.steps)
        lost = -np.inf if linear else np.nan
        return InLoop(lost, lost, lost, self._bends(model, added))

    def delta_bic(self, fitted: Model, rate: float) -> float:
        """What a model has over the parent at a rate, under the noise model of the better one."""
        criterion = Criterion(self.judge.record, rate=rate)
        best = min(self.fit, fitted, key=lambda m: m.sse)
        if not np.isfinite(best.output).all():  # beyond the rows that count it may run away
            return np.nan
        criterion.set_noise(criterion.remnant_model(best.output))
        parent, refined = (
            m.refined(criterion, max_iter=ITERATIONS, tol=TOLERANCE) for m in (self.fit, fitted)
        )
        ratio = criterion.n * np.log(max(parent.sse, 1e-300) / max(refined.sse, 1e-300))
        more = refined.n_parameters - parent.n_parameters
        return float(ratio - more * np.log(criterion.n))

    def _not_asked(self, bends: bool) -> InLoop:
        """What is left to other criteria."""
        return InLoop(bends=bends, beside=self._beside)

    @cached_property
    def _beside(self) -> Literal["nothing", "others", "bent"]:
        steps = self.parent.effects.steps
        if not steps:
            return "nothing"
        return "bent" if self._bends(self.parent, steps) else "others"

    def _bends(self, model: Model, steps: list[tuple[str, Effect]]) -> bool:
        """Whether some of the effects of a model, without the others, make no linear answer."""
        effects = Effects(steps)
        alone = LoopSimulator(self.judge.core, effects, self.judge.record, self.loop)
        values = model.values()
        theta = np.array([values[name] for name in alone.names])
        return alone.is_curved(theta) or any(effect.n_hidden > 0 for _, effect in effects)

    def _added(self, model: Model) -> list[tuple[str, Effect]]:
        """Effects that a model has and the parent has not, with their names."""
        known = self.parent.effects.names
        return [(name, effect) for name, effect in model.effects if name not in known]

    def _start_from(self, other: Model) -> None:
        """Fit the parent from where another model ended, which may be better."""
        known = {**self.fit.values(), **other.values()}
        start = np.array([known[name] for name in self.fit.simulator.names])
        again = self.judge.fitted(self.loop, self.parent.effects, [start])
        if again.sse < (1 - TOLERANCE) * self.fit.sse:
            self.fit = again

    @property
    def vaf(self) -> float:
        """Held-out VAF of the parent in the loop; NaN where the loop cannot be solved."""
        if not self.solved:
            return np.nan
        if self._vaf is None or self._vaf[0] is not self.fit:
            self._vaf = self.fit, self._held_out(self.fit)
        return self._vaf[1]

    def _held_out(self, fitted: Model) -> float:
        """VAF of held-out rows, each fold refitted without them."""
        judge = self.judge
        predicted = refitted_prediction(
            fitted, judge.plain, judge.folds, max_iter=ITERATIONS, tol=TOLERANCE
        )
        if not np.isfinite(predicted[judge.record.known]).all():
            return np.nan
        return vaf_of_output(judge.record, predicted)
