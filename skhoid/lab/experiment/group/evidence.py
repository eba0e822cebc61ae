"""The evidence of each person and condition for and against effects, computed once and kept."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ....effects.base import Effect
from ....effects.composition import Effects
from ....search import EffectSearchCV, Status
from ....search.evidence import COLUMNS, evidence_of
from ...studies.montecarlo.identity import described
from ...studies.montecarlo.store import Store, uniform
from ..people.groups import Group
from ..people.kept import completed
from .prevalence import log_factor

FORMAT = 1  # of the blocks
STANDS_IN = "unknown"


@dataclass(frozen=True)
class EvidenceJob:
    """What a worker is given."""

    search: EffectSearchCV
    found: Effects
    effects: list[Effect]
    group: Group

    def __str__(self) -> str:
        return str(self.group)


def weigh_person(job: EvidenceJob) -> pd.DataFrame:
    """The table of evidence of one person in one condition."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the search of the same runs has said it
        table = evidence_of(job.search, job.found, job.effects, job.group.X, job.group.y)
    return uniform(table)


def named_by(search: EffectSearchCV) -> Effects:
    """Effects that a fitted search named, with their choices; not those that only stand in."""
    named = [name for name in search.best_effects_ if name != STANDS_IN]
    steps = search.best_estimator_.effects_
    kept = [(name, effect) for name, effect in steps if effect.name in named]
    templates = search.best_estimator_.effects
    chosen = dict(Effects.of(templates).steps) if templates is not None else {}
    return Effects([(name, chosen.get(name, effect)) for name, effect in kept])


def candidates_of(searches: list[EffectSearchCV]) -> list[Effect]:
    """Effects to weigh in everybody: what a search named, and what all of them together suggest.

    The rows of the last step of each search are a preview of its evidence.
    """
    named = {name for search in searches for name in search.best_effects_} - {STANDS_IN}
    total: dict[str, float] = {}
    for search in searches:
        rows = search.ranking_
        last = rows[(rows["step"] == rows["step"].max()) & (rows["status"] != Status.REFUSED)]
        for _, row in last.iterrows():
            known = row[["delta_bic", "delta_bic_joint", "delta_bic_loop"]].to_numpy(dtype=float)
            known = known[np.isfinite(known)]
            if known.size and row["effect"] not in search.best_effects_:
                factor = log_factor(float(known.min()), float(row["vaf_gain"]))
                total[row["effect"]] = total.get(row["effect"], 0.0) + factor
    suggested = {name for name, factor in total.items() if factor > 0.0}
    effects = searches[0]._candidates()
    return [effect for effect in effects if effect.name in named | suggested and not effect.noise]


def weighed(
    jobs: list[EvidenceJob],
    folder: str | os.PathLike[str] | None,
    n_jobs: int | None,
    progress: bool | None,
) -> list[pd.DataFrame]:
    """The tables of all jobs, from the folder where they are there."""
    if not jobs[0].effects:
        return [pd.DataFrame(columns=COLUMNS) for _ in jobs]
    store, finished = None, {}
    if folder is not None:
        store = Store(folder, _description(jobs))
        finished = store.finished()
    tables = completed(
        jobs,
        weigh_person,
        finished,
        None if store is None else store.write,
        n_jobs=n_jobs,
        progress=progress,
        what="evidence",
    )
    return [table.reindex(columns=COLUMNS) for table in tables]


def _description(jobs: list[EvidenceJob]) -> dict[str, Any]:
    first = jobs[0]
    return {
        "what": f"evidence for effects, format {FORMAT}",
        "entropy": "0",
        "search": described(first.search),
        "effects": [described(effect) for effect in first.effects],
        "groups": [[str(job.group), job.group.identity(), repr(job.found)] for job in jobs],
    }
