"""``SearchResult``: what a search found, as statuses, numbers and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import pandas as pd

from ..effects.base import Effect
from ..effects.maps import StaticMap
from ..effects.registry import title_of, titles_of
from ..model.estimator import vaf_of_output
from ..model.parameters import parameter_table, parameter_text
from ..model.prepared import Prepared
from ..text import Note
from .judging import FREE_RUN, INSTRUMENTS, LIKELIHOOD, Candidate, find_why_not
from .leftover import Leftover, SearchNumbers
from .shape import Shape
from .share import Share
from .statuses import TRIED, Reason, Status, Verdict

DESCRIBED = 5  # candidates of a step whose parameters are written out
# What an effect on a compensatory display can only be equivalent to, and why.
SHOWS_TARGET = {"feedforward", "preview", "output_feedback"}
EQUIVALENT = (
    "equivalent to {}: a compensatory display shows only the error, and since e = f_t - x the "
    "same output follows from other lags of e; the operator cannot have seen target and x "
    "separately"
)
NOT_SAID = (
    "if the display shows the error alone (set display=), it is equivalent to other lags of e"
)


@dataclass(frozen=True, eq=False, repr=False)
class SearchResult:
    """What a search found; each attribute is that of :class:`EffectSearchCV` with an underscore.

    Parameters
    ----------
    verdict : Verdict
        How it ended.
    best_effects, stand_ins : list of str
        Ids of effects that are named, and of those that explain too little to be named.
    ranking, limits, error_path, predictions, unexplained, left_out : DataFrame
        Candidates, how large those may be that are not named, models, simulated outputs, structure
        left, and stretches left out.
    parameters : DataFrame
        Of the best model.
    shape : Shape or None
        Of what has no name.
    explainable_gap : float
        Points of VAF that a better model can gain over the baseline.
    closed : Share
        What share of the explainable gap the effects added close, with an interval.
    ceiling_note : str
        Why the ceiling is not known.
    experiments : list of str
        What to record.
    notes : list of Note
        Further remarks.
    searched_runs : list
        Labels of the runs in which effects were looked for.
    max_effects : int
        How many effects could be added.

    Examples
    --------
    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> search = EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)
    >>> search.result_.best_effects
    []
    """

    verdict: Verdict
    best_effects: list[str]
    stand_ins: list[str]
    ranking: pd.DataFrame
    limits: pd.DataFrame
    error_path: pd.DataFrame
    predictions: pd.DataFrame
    unexplained: pd.DataFrame
    left_out: pd.DataFrame
    parameters: pd.DataFrame
    shape: Shape | None
    explainable_gap: float
    closed: Share
    ceiling_note: str
    experiments: list[str]
    notes: list[Note]
    searched_runs: list[Any]
    max_effects: int

    @property
    def added(self) -> list[str]:
        """Names of the effects that were added to the model."""
        return [str(name) for name in self.error_path["effect"].iloc[1:]]

    @property
    def ended_early(self) -> bool:
        """Whether the time limit was reached before all effects were tried."""
        return bool((self.ranking["reason_code"] == Reason.TIME).any())

    @property
    def tried(self) -> pd.DataFrame:
        """Rows of the ranking whose effects were fitted to the data."""
        return self.ranking[self.ranking["status"].isin(TRIED)]

    def as_dict(self) -> dict[str, Any]:
        """The same as numbers and names, for JSON.

        Returns
        -------
        found : dict
        """
        return {
            "ranking": list_records(self.ranking),
            "limits": list_records(self.limits),
            "error_path": list_records(self.error_path.reset_index()),
            "best_effects": self.best_effects,
            "stand_ins": self.stand_ins,
            "verdict": str(self.verdict),
            "explainable_gap": self.explainable_gap,
            "closed": self.closed._asdict(),
            "parameters": list_records(self.parameters.reset_index()),
            "unexplained": list_records(self.unexplained),
            "shape": None if self.shape is None else self.shape.as_dict(),
            "ceiling_note": self.ceiling_note,
            "experiments": self.experiments,
            "left_out": list_records(self.left_out),
            "notes": [str(note) for note in self.notes],
        }


def describe_effect(effect: Effect, display: str | None, domain: str = "human") -> str:
    """What an effect means, in one sentence, given what the operator could see, if there is one."""
    if domain == "machine":
        return effect.physics_in(domain)
    if effect.name in SHOWS_TARGET and display is None:
        return f"{effect.physics[:-1]}; {NOT_SAID}"
    seen = display != "compensatory" and (effect.name != "preview" or display == "preview")
    if effect.name in SHOWS_TARGET and not seen:
        if display == "pursuit":
            return (
                "equivalent to preview: a pursuit display shows the target as it is now, not what "
                "comes; a target that the operator can predict looks the same"
            )
        return EQUIVALENT.format(effect.title)
    return effect.physics_in(domain)


def with_effects(names: Iterable[str]) -> str:
    """What a model is called by all effects that were added to it: ``with bias and dead zone``."""
    names = list(names)
    return f"with {titles_of(names)}" if names else "baseline"


def list_records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table, for JSON."""
    return [
        {key: v.item() if isinstance(v, np.generic) else v for key, v in record.items()}
        for record in frame.to_dict("records")
    ]


def compare_models(
    result: SearchResult, best_effects: Any, by_fold: Sequence[Sequence[float]]
) -> dict[str, Any]:
    """``cv_results_`` of a search: the models along its path, then candidates not added.

    ``by_fold`` are the VAF of the former on what each fold holds out.
    """
    path, added = result.error_path, result.added
    tried = result.tried
    given: list[str] = next(iter(tried["beside"]), [])
    models = [[*given, *added[:n]] for n in range(len(path))]
    scores, steps = path["vaf"].tolist(), list(range(len(path)))
    params: list[Any] = [{"effects": names} for names in models]
    params[-1] = {"effects": best_effects}
    for _, row in tried[tried["status"] != Status.ADDED].iterrows():
        params.append({"effects": [*row["beside"], row["effect"]]})
        scores.append(row["vaf_after"])
        steps.append(row["step"])
    mean = np.array(scores, dtype=float)
    order = pd.Series(mean).rank(method="min", ascending=False, na_option="bottom")
    effects = np.ma.masked_all(len(params), dtype=object)
    for i, one in enumerate(params):
        effects[i] = one["effects"]
    splits = np.full((len(by_fold[0]), len(params)), np.nan)
    splits[:, : len(by_fold)] = np.transpose(by_fold)
    return {
        "params": params,
        "param_effects": effects,
        "step": np.array(steps),
        **{f"split{i}_test_score": scores for i, scores in enumerate(splits)},
        "mean_test_score": mean,
        "std_test_score": splits.std(axis=0),
        "rank_test_score": order.to_numpy().astype(np.int32),
    }


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
                "vaf_loop": step.vaf_loop,
                "rmse": float(np.sqrt(np.mean(error**2))),
                "vaf_train": vaf_of_output(record, step.at_likelihood.output),
                "ceiling": found.ceiling,
                "explainable_gap": reachable - step.vaf,
            }
        )
    frame = pd.DataFrame(rows)
    frame.index.name = "step"
    return frame


def unexplained_table(left: list[Leftover]) -> pd.DataFrame:
    """Structure that is left, one row each."""
    columns = ["where", "at", "description", "points", "delta_bic"]
    return pd.DataFrame([vars(item) for item in left], columns=columns)


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
    beside: list[str]
    status: Status = Status.ADDED
    vaf_gain: float = np.nan
    delta_bic: float = np.nan
    p_value: float = 0.0
    evidence: float = np.nan
    judge: str = ""
    free_run: float = np.nan
    likelihood: float = np.nan
    instruments: float = np.nan
    probability: float = np.nan
    parameters: str = ""
    reason_code: Reason = Reason.NONE
    reason: str = ""
    words: str = ""
    confused_with: list[str] = field(default_factory=list)
    vaf_before: float = np.nan
    vaf_after: float = np.nan


def ranking_table(found: SearchNumbers, prepared: Prepared, display: str | None) -> pd.DataFrame:
    """One row per step and effect, best first."""
    rows: list[Ranked] = []
    path, domain = found.path, prepared.record.domain
    added = set(path.model.effects.names)
    for number, step in enumerate(path.steps, 1):
        after = path.steps[number].at_likelihood if number < len(path.steps) else path.model
        of_step = {*after.effects.names} - {*step.at_likelihood.effects.names}
        chosen = added & of_step
        winner = next((c.effect.name for c in step.candidates if c.name in of_step), "")
        before, beside = step.refitted_vaf, [e.name for _, e in step.at_likelihood.effects]
        for rank, c in enumerate(step.candidates, 1):
            described = c.model is not None and (rank <= DESCRIBED or c.passes)
            row = Ranked(
                step=number,
                rank=rank,
                effect=c.effect.name,
                title=title_of(c.effect.name),
                form=_form(c),
                beside=beside,
                parameters=_parameters(c, prepared) if described else "",
                vaf_before=before,
                p_value=c.p_value,
                probability=c.probability,
                confused_with=c.confused_with,
                words=describe_effect(c.effect, display, domain)
                + (f" {c.trace}." if c.trace else ""),
            )
            if c.untried is None:
                row.delta_bic, row.evidence, row.judge = c.delta_bic, c.least, c.judge
                row.free_run = c.evidence.get(FREE_RUN, np.nan)
                row.likelihood = c.evidence.get(LIKELIHOOD, np.nan)
                row.instruments = c.evidence.get(INSTRUMENTS, np.nan)
                row.vaf_after, row.vaf_gain = before + c.gain, c.gain
            if c.name not in chosen:
                against = find_why_not(c, winner, taken_out=c.name in of_step)
                row.status = Status.of(against.code)
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
                beside=[e.name for _, e in first.at_likelihood.effects],
                parameters=shown.parameters,
                vaf_before=first.refitted_vaf,
                vaf_after=first.refitted_vaf,
                vaf_gain=0.0,
                words=f"{effect.physics} It is noise to the free run: {shown.words}.",
            )
        )
    return pd.DataFrame([vars(row) for row in rows], columns=[one.name for one in fields(Ranked)])


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
