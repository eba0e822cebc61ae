"""Numbers that a search rests on: steps, structure left, ceiling; computed before any verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..diagnosis.ceiling import consistent_ceiling, noise_ceiling
from ..diagnosis.signals import RunsRead, sorted_signals
from ..effects.base import Effect
from ..effects.record import Signature
from ..model.estimator import vaf_of_output
from ..model.prepared import Prepared, SimulatedModel
from .all_runs import AllRuns
from .forward import Path, Search, SearchStep, further_changes
from .leftover import REPEATS, Leftover, leftovers
from .signatures import noises_in

NOTED = 0.2  # points
SURE = 4.0  # standard errors


@dataclass(frozen=True)
class SearchNumbers:
    """Numbers of a search.

    ``steps`` are judged models with none, the first, the first two ... of the effects ``added``
    (names); ``left`` is structure that remains, ``noises`` effects that are noise and show in it.
    ``ceiling`` is the VAF that a model can reach, NaN where it is not known, for the reason
    ``no_ceiling``. ``share`` is the part of the output's power that is not its mean. ``changes``
    are those of further parameters where gains change. With ``one_cause`` one free form explains
    as much as all of the effects together, and is likelier.
    """

    path: Path
    steps: list[SearchStep]
    added: list[str]
    left: list[Leftover]
    noises: list[tuple[Effect, Signature]]
    ceiling: float
    no_ceiling: str
    share: float
    changes: dict[str, tuple[float, float, float]]
    one_cause: bool = False

    @property
    def ids(self) -> list[str]:
        """Ids of what was found."""
        effects = dict(self.path.model.effects.steps)
        noises = [effect.name for effect, _ in self.noises]
        return [*(effects[name].name for name in self.added), *noises]

    @property
    def gained(self) -> float:
        """Points of VAF that the effects added gain on held-out rows."""
        return self.steps[-1].vaf - self.steps[0].vaf

    @property
    def worst(self) -> float:
        """Points of the largest structure that is left."""
        return max([item.points for item in self.left], default=0.0)

    @property
    def explainable_gap(self) -> float:
        return float(max(self.gained + self.worst, 0.0))


def numbers_of(
    search: Search,
    path: Path,
    best: SimulatedModel,
    prepared: Prepared,
    measured: np.ndarray,
    recorded: np.ndarray,
    all_runs: AllRuns | None = None,
) -> SearchNumbers:
    """Walk the path again, and look for what is left; ``measured`` has every row of y.

    ``recorded`` is the output of the search's runs with the noise that the search took out. Where
    it did, or looked at some of the runs, steps are judged on ``all_runs`` of ``prepared``.
    """
    record = replace(search.record, y=recorded)
    steps = walked(search, path, all_runs)
    left = leftovers(path.model, search.folds, search.loop)
    noises, others = noises_in(recorded - path.model.output, record, search.noises)
    left += [Leftover(s.where, "output", s.words, 100 * s.share, np.nan) for s in others]
    rest, rest_sd, vaf, unknown = gap_of(best, prepared, measured)
    noted = NOTED * search.share
    left = [item for item in left if item.points >= noted]
    if rest > SURE * rest_sd and rest >= noted:  # not where it is NaN
        left.insert(0, Leftover("repeats", "output", REPEATS, rest, np.nan))
    ceiling, why = consistent_ceiling(vaf + rest, max(step.vaf for step in steps), rest_sd)
    return SearchNumbers(
        path=path,
        steps=steps,
        added=path.added,
        left=left,
        noises=noises,
        ceiling=ceiling,
        no_ceiling=why or unknown,
        share=search.share,
        changes=further_changes(search, path),
    )


def walked(search: Search, path: Path, all_runs: AllRuns | None = None) -> list[SearchStep]:
    """Models with the first, the first two ... of the effects, each fitted anew for every fold."""
    models = search.partial_models(path.model, len(path.steps[0].parent.effects), path.core)
    steps = [search.judged(model, []) for model in models]
    if all_runs is not None:
        pairs = zip(steps, models, strict=True)
        return [all_runs.judged(search, step, model) for step, model in pairs]
    predictions = [search.refitted(model) for model in models]
    return [
        replace(step, vaf=vaf_of_output(search.record, prediction), prediction=prediction)
        for step, prediction in zip(steps, predictions, strict=True)
    ]


def gap_of(
    model: SimulatedModel, prepared: Prepared, measured: np.ndarray
) -> tuple[float, float, float, str]:
    """Explainable gap of a model in points, its standard error, and the VAF it refers to.

    NaN where the data give no noise ceiling, for the reason that comes last.
    """
    layout = prepared.grid.layout
    read = RunsRead(
        model=model,
        layout=layout,
        index=pd.RangeIndex(layout.n_rows),
        measured=measured,
        free_run=model.free_run(prepared),
        trimmed=np.zeros(layout.n_rows, dtype=bool),
        columns=dict(zip(prepared.names, prepared.table.T, strict=True)),
        roles=model.get_params(deep=False).get("roles"),
        output="u",
        units={},
    )
    try:
        signals = sorted_signals(read, run_in=model.settling)
    except ValueError:
        return np.nan, np.nan, np.nan, "the runs are too short for spectra"
    found = noise_ceiling(signals)
    return found.gap, found.sd, found.vaf, found.reason
