"""Candidates judged in the closed loop, where the remnant cannot pass for an answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.composition import Effects
from ..effects.record import Record
from ..greybox.base import vaf_of_output
from ..greybox.cores import Core
from ..greybox.fitting import Criterion, Fit, minimise
from ..greybox.loop import Loop, LoopSimulator, drawn
from ..greybox.model import Model
from .held_out import HeldOutRows, held_out

LEAST_EVIDENCE = 12.0  # of an effect that counts
ITERATIONS = 10
TOLERANCE = 1e-4


@dataclass(frozen=True)
class InLoop:
    """A model fitted in the closed loop, and its VAF on held-out rows.

    ``evidence`` and ``gain`` (points of VAF) are over a parent; NaN for the parent itself.
    """

    model: Model
    vaf: float
    evidence: float = np.nan
    gain: float = np.nan

    @property
    def helps(self) -> bool:
        return self.evidence > LEAST_EVIDENCE and self.gain > 0.0


@dataclass(frozen=True)
class LoopJudge:
    """The loop of a record, in which models are fitted and judged."""

    core: Core
    record: Record
    loop: Loop
    folds: Sequence[HeldOutRows]

    def judged(
        self, base: Model, models: Sequence[Model], each: Callable[..., list[Any]]
    ) -> list[InLoop]:
        """A parent, and models with more effects, under one noise model.

        Where a model is not linear, a remnant of the kind that the parent leaves is drawn along.
        """
        assert self.record.y is not None
        remnant = drawn(self.record.y - base.output, self.record.known)
        here = replace(self, loop=replace(self.loop, remnant=remnant))
        plain = Criterion(self.record)
        parent = here.model(base.effects, here.fitted((base.effects, [base.theta]), plain))
        known = parent.values()
        work = [
            (
                m.effects,
                [m.theta, np.array([{**m.values(), **known}[n] for n in m.simulator.names])],
            )
            for m in models
        ]
        fits = each(here.fitted, work, plain)
        all_ = [
            parent,
            *(here.model(effects, fit) for (effects, _), fit in zip(work, fits, strict=True)),
        ]
        criterion = Criterion(self.record)
        criterion.set_noise(criterion.remnant_model(min(all_, key=lambda m: m.sse).output))
        found = [here.held_out(m, criterion) for m in all_]
        first, n = found[0], criterion.n
        rest = []
        for one in found[1:]:
            ratio = n * np.log(max(first.model.sse, 1e-300) / max(one.model.sse, 1e-300))
            more = one.model.n_parameters - first.model.n_parameters
            evidence = ratio - more * np.log(n)
            rest.append(replace(one, evidence=evidence, gain=one.vaf - first.vaf))
        return [first, *rest]

    def fitted(self, work: tuple[Effects, list[np.ndarray]], criterion: Criterion) -> Fit:
        """Effects beside the core, at the smallest error of the loop that some starts lead to."""
        effects, starts = work
        simulator: Any = LoopSimulator(self.core, effects, self.record, self.loop)
        fits = [
            minimise(simulator, criterion, start, max_iter=ITERATIONS, tol=TOLERANCE)
            for start in starts
        ]
        return min(fits, key=lambda fit: fit.sse)

    def model(self, effects: Effects, fit: Fit) -> Model:
        """A fit in the loop as a model, whose output is that of the loop."""
        simulator: Any = LoopSimulator(self.core, effects, self.record, self.loop)
        return Model(simulator, fit)

    def held_out(self, fitted: Model, criterion: Criterion) -> InLoop:
        """Refine under a noise model, and predict held-out rows; by what predicts them better."""
        refined = fitted.refined(criterion, max_iter=ITERATIONS, tol=TOLERANCE)
        vafs = [
            vaf_of_output(self.record, held_out(model, by, self.folds))
            for model, by in ((fitted, Criterion(self.record)), (refined, criterion))
        ]
        return InLoop(refined, max(vafs))
