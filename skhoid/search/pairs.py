"""Pairs of effects tried together, where no effect alone can be named and something is missing."""

from __future__ import annotations

import numpy as np

from .candidates import Candidate, SearchStep
from .forward import Path, Search, follow_from, in_gaining_order, output_error_fit, trimmed

N_FEW = 3  # candidates beside which others are tried


def likeliest_few(first: SearchStep, path: Path) -> list[Candidate]:
    """Candidates of the first step that gain on held-out rows, the likeliest first.

    What the search began with has been tried beside all others.
    """
    begun = path.added[:1]
    if first.weigh is not None:
        first.weigh([c for c in first.candidates if c.unweighed])
    found = [
        c
        for c in first.candidates
        if c.model is not None
        and not c.refused
        and c.name not in begun
        and c.gain >= c.least_gain
        and np.isfinite(c.weight)
    ]
    return sorted(found, key=lambda c: -c.weight)[:N_FEW]


def pair_of(search: Search, path: Path, most: int) -> Path | None:
    """A path that begins with two effects which are named together, and not alone; or None.

    Each must pass all criteria beside the other, as an effect added to a model that has the other.
    """
    first = path.steps[0]
    if most < len(first.parent.effects) + 2:
        return None
    for one in likeliest_few(first, path):
        assert one.model is not None
        step = search.step(output_error_fit(one.model))
        if step.best is None or step.best.model is None:
            continue
        pair = step.best.model
        fewer = output_error_fit(search.fewer(pair, one.name, path.core))
        effect = dict(pair.effects.steps)[one.name]
        beside = search.judged(fewer, [Candidate(one.name, effect, model=output_error_fit(pair))])
        if beside.best is None:
            continue
        longer = follow_from(search, Path([first, step], pair), most)
        found = in_gaining_order(search, trimmed(search, longer, most), first)
        if len(found.added) > 1:
            return found
    return None
