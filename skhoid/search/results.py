"""Tables of a search: ranking, error path, held-out predictions, unexplained structure."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
import pandas as pd

from ..effects.maps import StaticMap
from ..effects.registry import title_of
from ..model.estimator import vaf_of_output
from ..model.parameters import parameter_table, parameter_text
from ..model.prepared import Prepared
from ..text import DASH, p_text
from .explanations import sentence_of, with_effects
from .judging import Candidate, against_candidate
from .leftover import Leftover, SearchNumbers
from .statuses import Reason, Status

DESCRIBED = 5  # candidates of a step whose parameters are written out


def error_path(found: SearchNumbers, prepared: Prepared) -> pd.DataFrame:
    """VAF and RMSE, held out, of the baseline and with each effect."""
    record, steps = prepared.record, found.steps
    assert record.y is not None
    rows = []
    reachable = float(np.nanmax([found.ceiling, steps[-1].vaf + found.worst]))
    reachable = min(reachable, 100.0)
    titles = ["baseline", *found.added]
    for number, (title, step) in enumerate(zip(titles, steps, strict=True)):
        error = (record.y - step.prediction)[record.known]
        rows.append(
            {
                "effect": title,
                "model": with_effects(found.added[:number]),
                "vaf": step.vaf,
                "vaf_loop": np.nan if step.loop is None else step.loop.vaf,
                "rmse": float(np.sqrt(np.mean(error**2))),
                "vaf_train": vaf_of_output(record, step.parent.output),
                "ceiling": found.ceiling,
                "explainable_gap": reachable - step.vaf,
            }
        )
    frame = pd.DataFrame(rows)
    frame.index.name = "step"
    return frame


def unexplained_table(left: list[Leftover]) -> pd.DataFrame:
    """Structure that is left, one row each."""
    return pd.DataFrame(
        [vars(item) for item in left],
        columns=["where", "at", "description", "points", "delta_bic"],
    )


def held_out_table(
    found: SearchNumbers,
    prepared: Prepared,
    measured: np.ndarray,
    left_out: np.ndarray,
    index: pd.Index | None,
) -> pd.DataFrame:
    """Measured output, and held-out free runs without and with each effect, at every row."""
    columns = {"measured": measured}
    titles = ["baseline", *(f"+ {name}" for name in found.added)]
    for title, step in zip(titles, found.steps, strict=True):
        rows = prepared.columns.rows(step.prediction)
        columns[title] = np.where(left_out, np.nan, prepared.grid.to_full_rate(rows))
    return pd.DataFrame(columns, index=index)


@dataclass
class Ranked:
    """A row of the ranking; what an effect does not have is not known."""

    step: int
    rank: int
    effect: str
    title: str
    form: str
    status: Status = Status.ADDED
    vaf_gain: float = np.nan
    delta_bic: float = np.nan
    p_value: float = 0.0
    gain_loop: float = np.nan
    delta_bic_loop: float = np.nan
    delta_bic_joint: float = np.nan
    parameters: str = ""
    reason_code: Reason = Reason.NONE
    reason: str = ""
    words: str = ""
    confused_with: list[str] = field(default_factory=list)
    vaf_before: float = np.nan
    vaf_after: float = np.nan
    delta_loglik: float = np.nan
    n_parameters: float = 0


def ranking_table(found: SearchNumbers, prepared: Prepared, display: str | None) -> pd.DataFrame:
    """One row per step and effect, best first."""
    rows: list[Ranked] = []
    path, domain = found.path, prepared.record.domain
    added = set(path.model.effects.names)
    for number, step in enumerate(path.steps, 1):
        after = path.steps[number].parent if number < len(path.steps) else path.model
        of_step = {*after.effects.names} - {*step.parent.effects.names}
        chosen = added & of_step
        winner = next((c.id for c in step.candidates if c.name in of_step), "")
        before = step.refitted_vaf
        for rank, c in enumerate(step.candidates, 1):
            described = c.model is not None and (rank <= DESCRIBED or c.passes)
            row = Ranked(
                step=number,
                rank=rank,
                effect=c.id,
                title=title_of(c.id),
                form=_form(c),
                parameters=_parameters(c, prepared) if described else "",
                n_parameters=c.n_parameters,
                vaf_before=before,
                delta_bic_joint=c.joint,
                p_value=c.p_value,
                confused_with=c.confused_with,
                words=sentence_of(c.effect, display, domain) + (f" {c.trace}." if c.trace else ""),
            )
            if not c.inapplicable:
                row.delta_loglik, row.delta_bic = c.loglik, c.delta_bic
                row.vaf_after, row.vaf_gain = before + c.gain, c.gain
            if c.in_loop is not None:
                row.delta_bic_loop, row.gain_loop = c.in_loop.delta_bic, c.in_loop.gain
            if c.name not in chosen:
                row.status = Status.REFUSED if c.inapplicable else Status.NOT_BETTER
                against = against_candidate(c, winner, taken_out=c.name in of_step)
                row.reason_code, row.reason = against
            rows.append(row)
    first = path.steps[0]
    for rank, (effect, shown) in enumerate(found.noises, len(first.candidates) + 1):
        rows.append(
            Ranked(
                step=1,
                rank=rank,
                effect=effect.name,
                title=title_of(effect.name),
                form="",
                parameters=shown.parameters,
                n_parameters=len(effect.parameters),
                vaf_before=first.refitted_vaf,
                vaf_after=first.refitted_vaf,
                vaf_gain=0.0,
                words=f"{effect.physics} It is noise to the free run: {shown.words}.",
            )
        )
    return pd.DataFrame([vars(row) for row in rows], columns=[one.name for one in fields(Ranked)])


def short_ranking(ranking: pd.DataFrame, n: int, step: int | None) -> pd.DataFrame:
    """The best n candidates of each step (or of one) as texts."""
    tried = ranking[ranking["status"] != Status.REFUSED]
    if step is not None:
        if step not in set(ranking["step"]):
            raise ValueError(f"There is no step {step!r}; the steps are {_listed(ranking)}.")
        tried = tried[tried["step"] == step]
    best = tried.groupby("step").head(n)
    in_form = best["form"].map(lambda form: f" ({form})" if form else "")
    return pd.DataFrame(
        {
            "effect": best["title"] + in_form,
            "gain": best["vaf_gain"].map("{:+.2f}".format),
            "ΔBIC": best["delta_bic"].map(lambda x: f"{x:+.0f}" if np.isfinite(x) else DASH),
            "p": best["p_value"].map(lambda p: p_text(p).removeprefix("p ").removeprefix("= ")),
            "outcome": best["reason"].where(best["status"] != Status.ADDED, "added"),
            "parameters": best["parameters"],
        }
    ).set_index([best["step"], best["rank"]])


def _listed(ranking: pd.DataFrame) -> str:
    return ", ".join(map(str, ranking["step"].unique()))


def _form(candidate: Candidate) -> str:
    if candidate.model is None:
        return ""
    chosen = dict(candidate.model.effects.steps)[candidate.name]
    parts = [getattr(chosen, key, None) for key in ("form", "side", "trigger", "channel")]
    if isinstance(chosen, StaticMap) and chosen.at not in (None, chosen.usual_at):
        parts.append(f"at the {chosen.at}")
    return ", ".join(str(part) for part in parts if part)


def _parameters(candidate: Candidate, prepared: Prepared) -> str:
    fitted = candidate.model
    assert fitted is not None
    covariance = fitted.covariance()
    table = parameter_table(fitted.simulator, fitted.theta, covariance, prepared.units, {})
    return parameter_text(table.estimates(), candidate.name)
