"""One group of runs: its fits, as the rows of a table that a folder can keep."""

from __future__ import annotations

import hashlib
import io
import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import joblib
import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.utils.metadata_routing import get_routing_for_object

from ....diagnosis.ceiling import consistent_ceiling, noise_ceiling
from ....diagnosis.signals import read_signals
from ....metrics import scored_rows, scored_signals, vaf_of_rows, vaf_of_sums
from ....pipelines import final_step, prediction_from, raw_layout, trimmed_rows
from ....preprocessing.gate import as_output
from ....runs import run_labels
from ...studies.montecarlo.store import uniform
from .groups import Group
from .parameters import Row, effects_of, parameters_of

WHOLE = -1  # in place of the number of a run: the fit of all runs
# What the rows of a block are.
FIT, JUDGED, CEILING, EFFECT, WARNED, MODEL = "fit", "run", "ceiling", "effect", "warning", "model"
# Filters of warnings belong to the whole process, and workers may be threads.
_one_at_a_time = threading.RLock()


class Line(NamedTuple):
    """A row of a block; ``part`` says what it is."""

    part: str
    run: int
    name: str = ""
    estimate: float = np.nan
    se: float = np.nan
    unit: str = ""
    vaf: float = np.nan
    n_rows: int = 0
    of: str = ""
    text: str = ""


@dataclass(frozen=True)
class Job:
    """What a worker is given."""

    estimator: Any
    group: Group
    each_run: bool
    ceiling: bool
    keep_models: bool

    def __str__(self) -> str:
        return str(self.group)


@dataclass
class _Found:
    """Lines so far, and the model of the group."""

    lines: list[Line] = field(default_factory=list)
    model: Any = None

    def noting(self, run: int, work: Callable[[], Any]) -> tuple[Any, str]:
        """The result, or the reason why there is none; warnings become lines."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                return work(), ""
            except MemoryError:
                raise
            except Exception as error:
                return None, f"{type(error).__name__}: {error}"
            finally:
                for warning in caught:
                    text = f"{warning.category.__name__}: {warning.message}"
                    self.lines.append(Line(WARNED, run, text=text))


def fit_group(job: Job) -> tuple[pd.DataFrame, bytes]:
    """The fits of one group, and its model as bytes (empty where none is kept)."""
    with _one_at_a_time:
        return _fit_group(job)


def _fit_group(job: Job) -> tuple[pd.DataFrame, bytes]:
    group, found = job.group, _Found()
    n_runs = len(group.labels)
    model, of_runs = _fit(job, found, WHOLE, group.X, group.y)
    own = np.full(n_runs, np.nan)
    if job.each_run and n_runs == 1:  # which is the same fit
        of_all = [line for line in found.lines if line.part == FIT and line.run == WHOLE]
        found.lines += [line._replace(run=0) for line in of_all]
        own[0] = of_all[0].vaf
    elif job.each_run:
        for number in range(n_runs):
            _, vaf = _fit(job, found, number, *group.run(number))
            own[number] = vaf[0]
    for number in range(n_runs):
        rows = slice(*group.starts[number : number + 2])
        output = np.asarray(group.y.iloc[rows], dtype=float)
        known = output[np.isfinite(output)]
        found.lines.append(
            Line(
                JUDGED,
                number,
                estimate=float(own[number]),
                se=float(known.std()) if known.size else np.nan,
                vaf=float(of_runs[number]),
                n_rows=output.size,
            )
        )
    if model is not None and job.ceiling:
        ceiling, why = found.noting(WHOLE, lambda: ceiling_of(model, group.X, group.y))
        found.lines.append(Line(CEILING, WHOLE, estimate=np.nan if why else ceiling))
        if why:
            found.lines.append(Line(WARNED, WHOLE, text=f"no noise ceiling: {why}"))
    content = b""
    if job.keep_models:
        if model is not None:
            content = packed(model)
        found.lines.append(Line(MODEL, WHOLE, text=checksum(content)))
    return uniform(pd.DataFrame(found.lines, columns=Line._fields)), content


def _fit(
    job: Job, found: _Found, run: int, X: pd.DataFrame, y: pd.Series
) -> tuple[Any, np.ndarray]:
    """Fit, and add the lines; the VAF of each run of X."""
    n_runs = len(job.group.labels) if run == WHOLE else 1

    def fitted() -> tuple[Any, list[Row], float, np.ndarray]:
        model = clone(job.estimator)
        model.fit(X, y, **_groups_for(model, X))
        vaf, of_runs = vafs(model, X, y)
        return model, parameters_of(model, vaf), vaf, of_runs

    result, failure = found.noting(run, fitted)
    if failure:
        found.lines.append(Line(FIT, run, n_rows=len(y), text=failure))
        return None, np.full(n_runs, np.nan)
    model, rows, vaf, of_runs = result
    found.lines += [
        Line(FIT, run, row.parameter, row.estimate, row.se, row.unit, vaf, len(y)) for row in rows
    ]
    if run == WHOLE:
        found.lines += [
            Line(EFFECT, run, row.parameter, row.estimate, row.se, row.unit, of=name, text=verdict)
            for name, row, verdict in effects_of(model)
        ]
    return model, of_runs


def _groups_for(estimator: Any, X: pd.DataFrame) -> dict[str, Any]:
    """The run of each row, for a search whose splitter asks for groups."""
    prefix, last = final_step(estimator)
    splitter = getattr(last, "cv", None)
    if not hasattr(splitter, "get_metadata_routing"):
        return {}
    if get_routing_for_object(splitter).split.requests.get("groups") is not True:
        return {}
    return {f"{prefix}groups": run_labels(X)}


def vafs(model: Any, X: pd.DataFrame, y: pd.Series) -> tuple[float, np.ndarray]:
    """VAF of the free run as VAFScorer gives it, and that of each run."""
    layout = raw_layout(model, X)
    keep = scored_rows(layout, None, None) & ~trimmed_rows(model, X)
    prediction, fed = prediction_from(model, X, y)
    if fed.size == keep.size:
        keep &= fed
    signal, error, run = scored_signals(as_output(y), prediction, keep, layout, False)
    n_runs = len(layout.labels)
    lost, power = (np.bincount(run, part**2, n_runs) for part in (error, signal))
    scored = np.bincount(run, minlength=n_runs) > 0
    pooled = float(vaf_of_sums(lost, power, scored, "pooled"))
    of_runs = np.full(n_runs, np.nan)
    some = scored & (power > 0)
    of_runs[some] = vaf_of_sums(lost[some], power[some], scored[some], None)
    return pooled, of_runs


def ceiling_of(model: Any, X: pd.DataFrame, y: pd.Series) -> float:
    """``compare(model, X, y).noise_ceiling``, without the tests of a comparison."""
    signals = read_signals(model, X, y, one_step=False)
    vaf = float(
        vaf_of_rows(signals.y, signals.predicted, signals.scored, signals.layout, "pooled", False)
    )
    ceiling = noise_ceiling(signals)
    top, reason = consistent_ceiling(vaf + ceiling.gap, vaf, ceiling.sd, held_out=False)
    return np.nan if reason or ceiling.reason else top


def packed(model: Any) -> bytes:
    stream = io.BytesIO()
    joblib.dump(model, stream)
    return stream.getvalue()


def unpacked(content: bytes) -> Any:
    return joblib.load(io.BytesIO(content))


def checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16] if content else ""
