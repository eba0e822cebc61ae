"""What a search ends with in numbers: its steps walked again, structure left, the ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..diagnosis.ceiling import consistent_ceiling, noise_ceiling
from ..diagnosis.signals import RunsRead, prepare_signals
from ..effects.base import Effect
from ..effects.record import Record, Signature
from ..model.estimator import GreyBox, vaf_of_output
from ..model.extend import refit_on_all_runs
from ..model.model import Model
from ..model.prepared import Prepared
from ..model.simulator import Simulator
from .data import Held
from .judges import find_loop_vaf, noises_in
from .judging import LEAST_GAIN, THRESHOLD
from .path import Path, further_changes
from .steps import Search, SearchStep, output_error_fit

LEFT_SURELY = 4.0  # standard errors by which what is left exceeds nothing
REPEATS = "part of the residual repeats from run to run, or follows the target"
CURVED = "part of the residual follows what came from outside, but not in proportion, or not always"


@dataclass(frozen=True)
class Leftover:
    """Structure that is left, and where: a row of ``unexplained_``."""

    where: str
    at: str
    description: str
    points: float
    delta_bic: float = np.nan


@dataclass(frozen=True)
class SearchNumbers:
    """Numbers of a search.

    ``steps`` are judged models with none, the first, the first two ... of the effects ``added``
    (names). ``left_nats`` are those of another form beside them, times the share that they are of
    those without any name. ``ceiling``, known to ``ceiling_sd``, is NaN for the reason
    ``no_ceiling``. ``share`` is the part of the output's power that is not its mean.
    """

    path: Path
    steps: list[SearchStep]
    added: list[str]
    left: list[Leftover]
    left_nats: float
    noises: list[tuple[Effect, Signature]]
    ceiling: float
    ceiling_sd: float
    no_ceiling: str
    share: float
    changes: dict[str, tuple[float, float, float]]

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


def measure_path(
    search: Search,
    path: Path,
    best: GreyBox,
    prepared: Prepared,
    measured: np.ndarray,
    recorded: np.ndarray | None,
    held: Sequence[Held],
) -> SearchNumbers:
    """Walk the path again, and look for noise in ``recorded``; ``measured`` is all of y.

    The search may have looked at some of the runs only, or at the output without a tremor:
    ``recorded`` is the output of its runs, and ``held`` what each fold holds out of all runs.
    """
    assert recorded is not None
    steps = walked(search, path, prepared.record, held)
    as_recorded = replace(search.record, y=recorded)
    noises, others = noises_in(recorded - path.model.output, as_recorded, search.noises)
    left = [Leftover(s.where, "output", s.words, 100 * s.share) for s in others]
    nats, share = search.curves.weigh(output_error_fit(path.model))
    points = share * (100 - steps[-1].vaf)
    if points < LEAST_GAIN * search.share:  # without remnant, errors of simulation show too
        nats = 0.0
    if nats > THRESHOLD:
        left.append(Leftover("curved", "output", CURVED, points, 2 * nats))
    if (
        nats > 0.0 and path.added
    ):  # of a right name whose form is a little off, a small part is left
        before, _ = search.curves.weigh(path.steps[0].at_least_error)
        nats *= min(nats / max(before, nats), 1.0)
    rest, rest_sd, vaf, unknown = find_gap(best, prepared, measured)
    if rest > LEFT_SURELY * rest_sd:  # not where it is NaN
        left.insert(0, Leftover("repeats", "output", REPEATS, rest))
    ceiling, why = consistent_ceiling(vaf + rest, max(step.vaf for step in steps), rest_sd)
    if unknown:  # or only at least
        ceiling = np.nan
    return SearchNumbers(
        path=path,
        steps=steps,
        added=path.added,
        left=left,
        left_nats=nats,
        noises=noises,
        ceiling=ceiling,
        ceiling_sd=rest_sd,
        no_ceiling=unknown or str(why or ""),
        share=search.share,
        changes=further_changes(search, path),
    )


def walked(search: Search, path: Path, record: Record, held: Sequence[Held]) -> list[SearchStep]:
    """Models with the first, the first two ... of the effects, each fitted anew for every fold.

    They are judged on a record that need not be that of the search.
    """
    models = search.partial_models(path.model, len(path.steps[0].at_likelihood.effects), path.core)
    steps = [search.judge_candidates(model, []) for model in models]
    for step, model in zip(steps, models, strict=True):
        step.vaf_loop = find_loop_vaf(step.at_likelihood, search.folds)
        if record is search.record:
            step.prediction = search.refitted(model)
        else:
            step.prediction = predict_on(record, held, *search.fitted_without_folds(model))
            step.at_likelihood = refit_on_all_runs(step.at_likelihood, record)
        step.vaf = vaf_of_output(record, step.prediction)
    return steps


def predict_on(
    record: Record, held: Sequence[Held], model: Model, without: Sequence[np.ndarray]
) -> np.ndarray:
    """Free runs of a model, and in rows of each fold with the parameters of ``without``."""
    core, effects = model.simulator.core, model.effects
    found = Simulator(core, effects, record).run_ahead(model.theta)
    for theta, (columns, rows) in zip(without, held, strict=True):
        held_out = Simulator(core, effects, record.part(columns, 1)).run_ahead(theta)
        found[:, columns] = np.where(rows, held_out, found[:, columns])
    return np.where(np.isfinite(found), found, 0.0)


def find_gap(
    model: GreyBox, prepared: Prepared, measured: np.ndarray
) -> tuple[float, float, float, str]:
    """Explainable gap of a model (points), its standard error, its VAF, and why it is not known."""
    layout = prepared.grid.layout
    read = RunsRead(
        model=model,
        layout=layout,
        index=pd.RangeIndex(layout.n_rows),
        measured=measured,
        free_run=model.by_likelihood().free_run(prepared),
        trimmed=np.zeros(layout.n_rows, dtype=bool),
        columns=dict(zip(prepared.names, prepared.table.T, strict=True)),
        roles=model.get_params(deep=False).get("roles"),
        output="u",
        units={},
    )
    try:
        signals = prepare_signals(read, run_in=model.settling)
    except ValueError:
        return np.nan, np.nan, np.nan, "the runs are too short for spectra"
    found = noise_ceiling(signals)
    unknown = "" if found.route.separates and found.known else str(found.note)
    return found.gap, found.sd, found.vaf, unknown
