"""Tables of what a search found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..diagnosis.ceiling import noise_ceiling
from ..diagnosis.run_signals import read_signals
from ..effects.base import Effect
from ..effects.record import Record
from ..effects.traces import Signature
from ..greybox.base import vaf_of_output
from ..greybox.estimates import parameter_table, parameter_text
from ..greybox.model import without
from .explanations import words_of
from .forward import Candidate, Path, Search, SearchStep, output_error_fit

DESCRIBED = 5  # candidates of a step whose parameters are written out


def walked(search: Search, path: Path) -> list[SearchStep]:
    """Held-out predictions of the model with the first, the first two ... of its effects."""
    models = [output_error_fit(path.model)]
    first = path.steps[0].parent.effects.names
    added = [n for n in path.model.effects.names if n not in first]
    for name in reversed(added):
        models.append(without(models[-1], name, path.core))
    noise = search.criterion.remnant_model(path.model.output)
    return [search.judged(model, [], noise) for model in reversed(models)]


def gap_of(model: Any, X: Any, y: Any) -> tuple[float, float, float]:
    """Explainable gap of a model in points, its standard error, and the VAF it refers to.

    NaN where the data tell no noise ceiling.
    """
    try:
        signals = read_signals(model, X, y, run_in=model.settling)
    except ValueError:  # too short for spectra
        return np.nan, np.nan, np.nan
    found = noise_ceiling(signals)
    return found.gap, found.sd, found.vaf


def error_path(
    record: Record, steps: Sequence[SearchStep], names: Sequence[str], ceiling: float, left: float
) -> pd.DataFrame:
    """VAF and RMSE, held out, of the baseline and with each effect."""
    assert record.y is not None
    rows = []
    # Where an effect lets remnant pass a nonlinearity the baseline's ceiling is a lower bound.
    reachable = float(np.nanmax([ceiling, steps[-1].vaf + left]))
    top = reachable if np.isfinite(ceiling) else np.nan
    for title, step in zip(["baseline", *names], steps, strict=True):
        error = (record.y - step.prediction)[record.known]
        rows.append(
            {
                "effect": title,
                "vaf": step.vaf,
                "rmse": float(np.sqrt(np.mean(error**2))),
                "vaf_train": vaf_of_output(record, step.parent.output),
                "ceiling": top,
                "explainable_gap": reachable - step.vaf,
            }
        )
    frame = pd.DataFrame(rows)
    frame.index.name = "step"
    return frame


def ranking_table(
    path: Path, display: str, noises: Sequence[tuple[Effect, Signature]], model: Any
) -> pd.DataFrame:
    """One row per step and effect, best first."""
    rows = []
    added = set(path.model.effects.names)
    for number, step in enumerate(path.steps, 1):
        chosen = [c for c in step.candidates if c.passes and c.name in added][:1]
        for rank, c in enumerate(step.candidates, 1):
            status = "added" if c in chosen else "not better"
            if c.reason:
                status = "does not apply"
            described = c.model is not None and (rank <= DESCRIBED or c.passes)
            rows.append(
                {
                    "step": number,
                    "rank": rank,
                    "effect": c.id,
                    "form": _form(c),
                    "parameters": _parameters(c, model) if described else "",
                    "n_parameters": c.n_parameters,
                    "delta_loglik": np.nan if c.reason else c.loglik,
                    "delta_bic": np.nan if c.reason else c.evidence,
                    "vaf_before": step.vaf,
                    "vaf_after": np.nan if c.reason else c.vaf,
                    "vaf_gain": np.nan if c.reason else c.gain,
                    "p_value": c.p_value,
                    "confused_with": c.confused_with,
                    "words": words_of(c.effect, display) + (f" {c.trace}." if c.trace else ""),
                    "status": status,
                    "reason": c.reason,
                }
            )
    for rank, (effect, found) in enumerate(noises, len(path.steps[0].candidates) + 1):
        rows.append(
            {
                "step": 1,
                "rank": rank,
                "effect": effect.name,
                "form": "",
                "parameters": found.parameters,
                "n_parameters": len(effect.parameters),
                "delta_loglik": np.nan,
                "delta_bic": np.nan,
                "vaf_before": path.steps[0].vaf,
                "vaf_after": path.steps[0].vaf,
                "vaf_gain": 0.0,
                "p_value": 0.0,
                "confused_with": [],
                "words": f"{effect.physics} It is noise to the free run: {found.words}.",
                "status": "added",
                "reason": "",
            }
        )
    return pd.DataFrame(rows)


def _form(candidate: Candidate) -> str:
    if candidate.model is None:
        return ""
    chosen = dict(candidate.model.effects.steps)[candidate.name]
    parts = [getattr(chosen, key, None) for key in ("form", "side", "trigger", "channel")]
    return ", ".join(str(part) for part in parts if part)


def _parameters(candidate: Candidate, model: Any) -> str:
    fitted = candidate.model
    assert fitted is not None
    units = {"u": model._units.get(model._output_name), "e": model._units.get(model.inputs_[0])}
    units.update({f"[{name}]": unit for name, unit in model._units.items()})
    table = parameter_table(fitted.simulator, fitted.theta, fitted.covariance(), units, {})
    return parameter_text(table, candidate.name)
