"""What the data of one person say for and against effects, whether a search named them or not.

Open it to change how a group of people is asked which effects it shares.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from threadpoolctl import threadpool_limits

from ..effects.composition import Effects
from ..model.simulated_arx import simulated_model
from .effect_search import EffectSearchCV
from .judging import FREE_RUN, INSTRUMENTS, LIKELIHOOD, Candidate
from .steps import Search, SearchStep

COLUMNS = [
    "instead_of",
    "effect",
    "evidence",
    "vaf_gain",
    "free_run",
    "likelihood",
    "instruments",
    "reason",
]


def evidence_of(
    search: EffectSearchCV,
    found: Effects,
    effects: list[Any],
    X: Any,
    y: Any,
    ranking: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Evidence of effects beside those that a search found, and in place of each of them.

    What the ``ranking`` of that search has is not asked again.
    """
    rows: list[tuple[Any, ...]] = []
    names = found.names
    given = Effects.of(getattr(search.estimator, "effects", None))
    for out in ["", *names]:
        kept = Effects([(name, effect) for name, effect in found if name != out])
        tried = [e for e in effects if e.name not in {kind.name for _, kind in kept}]
        if out:  # its own form stays as it was chosen
            own = dict(found.steps)[out]
            tried = [own, *(e for e in tried if e.name != own.name)]
        out = out and dict(found.steps)[out].name
        if ranking is not None:
            beside = {effect.name for _, effect in [*given, *kept]}
            told = _told(ranking, beside, {e.name for e in tried})
            rows += [(out, *row) for row in told.itertuples(index=False, name=None)]
            tried = [e for e in tried if e.name not in set(told["effect"])]
        if tried:
            step = _weighed(search, kept, tried, X, y)
            rows += [_row(out, c) for c in step.candidates]
    return pd.DataFrame(rows, columns=COLUMNS)


def _told(ranking: pd.DataFrame, beside: set[str], names: set[str]) -> pd.DataFrame:
    """The rows of a search that no judge can change: one is against it, or the last was asked.

    How much one is against it does not matter: see ``log_factor``. The likelihood is asked last.
    """
    here = ranking[ranking["effect"].isin(names) & (ranking["beside"].map(set) == beside)]
    here = here.drop_duplicates("effect")
    return here.loc[(here["evidence"] <= 0.0) | here["likelihood"].notna(), COLUMNS[1:]]


def _weighed(search: EffectSearchCV, kept: Effects, tried: list[Any], X: Any, y: Any) -> SearchStep:
    """All of the effects beside those that are kept, each judged by all that can judge it."""
    asked = clone(search).set_params(effects=tried, n_jobs=None)
    model = clone(simulated_model(search.estimator, "EffectSearchCV"))
    if len(kept):
        model.set_params(effects=Effects.of(getattr(model, "effects", None)) + kept)
    with threadpool_limits(1):
        data = asked.read_data(model, X, y)
        whole = Search(data.prepared.core, data.record, tried, data.folds)
        step = whole.step(model.first_fit(data.searched))
        for c in step.candidates:
            if c.model is not None:
                step.ask_all(c)
    return step


def _row(out: str, c: Candidate) -> tuple[Any, ...]:
    """What all judges say of a candidate, in nats."""
    judged = [c.evidence.get(judge, np.nan) for judge in (FREE_RUN, LIKELIHOOD, INSTRUMENTS)]
    numbers = c.least if c.evidence else np.nan, c.gain, *judged
    return out, c.effect.name, *numbers, "" if c.untried is None else c.untried.text
