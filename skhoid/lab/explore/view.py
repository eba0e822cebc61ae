"""What the component is told: a model's effects and numbers, how good it is, and what to try next.

The cards are ``Found``, what a search said of each effect; ``Figures`` are VAF, the stair of the
error, the noise ceiling and what is left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ... import EffectSearchCV, OperatorRegressor, compare
from ...effects import Effect, Effects, title_of, titles_of
from ...effects import effect as effect_of
from ...model import ModelParameter, effect_curves
from ...search import (
    Reason,
    SearchResult,
    Status,
    limits_table,
    pack_result,
    tell_headline,
    tell_limit,
    tell_verdict,
    unpack_result,
    with_effects,
)
from ...text import as_sentence
from .models import Models, Position, Runs, make_key, pack_effects, unpack_effects

SPAN = 3.0  # times a value, and
SPAN_SD = 10.0  # standard errors of it, that a slider reaches on either side
STEPS = 200  # of a slider
MOST_POINTS = 200  # of a curve
DIGITS = 12  # of what a slider is set to
FOUND, HELPS, NO, REFUSED, UNTRIED = "found", "helps", "no", "refused", "untried"
ORDER = (FOUND, HELPS, UNTRIED, NO, REFUSED)
NOT_SEARCHED = "Not searched yet: what effects would gain, and which of them apply, is not known."
RUNS_AWAY = -999.0  # VAF in percent, below which a free run has left the data
BESIDE = 5.0  # times the largest measured value, at which a run has left them too
CLOSE = 0.5  # points of VAF, by which the best model known may be worse than that of a search
LEAST = -1e9  # points, of a model that could not be compared
OF_SEARCH = "Of the best model of the search."
AWAY = "With these values the simulation runs away from what was measured."


# A model: its effects with parameters and curves, its numbers.


def list_effects_found(
    model: Any, moved: Mapping[str, float], fitted: Any, domain: str
) -> list[dict[str, Any]]:
    """The effects of a model as cards; ``fitted`` is the same before anything was moved."""
    return [
        {
            "name": name,
            "title": title_of(name),
            "words": effect.physics_in(domain),
            "form": _form(effect),
            "parameters": _parameters(name, effect, model, moved, fitted),
            "curve": make_curve(model, name),
        }
        for name, effect in dict(model.effects_.steps).items()
    ]


def list_others(model: Any, moved: Mapping[str, float], fitted: Any) -> list[dict[str, Any]]:
    """The parameters that are not of an effect."""
    table = fitted.parameter_table_
    return [
        _parameter(one, one.name, table[name], moved) | {"movable": is_movable(fitted, name)}
        for name, one in model.parameter_table_.items()
        if "__" not in name
    ]


def is_movable(fitted: Any, name: str) -> bool:
    """Whether a parameter may be moved by hand: all of effects, and an operator's own estimates."""
    one = fitted.parameter_table_.get(name)
    own = isinstance(fitted, OperatorRegressor) and one is not None and one.free
    return own or (one is not None and "__" in name)


def make_curve(model: Any, name: str) -> dict[str, Any] | None:
    """What an effect does, as lines; None where it cannot be drawn."""
    try:
        with np.errstate(all="ignore"):
            found = effect_curves(model, name)
    except (ValueError, FloatingPointError):
        return None
    lines = [
        {"label": label, "x": _thinned(curve.x), "y": _thinned(curve.y)}
        for label, curve in found.curves.items()
    ]
    without = {"x": _thinned(found.without.x), "y": _thinned(found.without.y)}
    return {"xlabel": found.xlabel, "ylabel": found.ylabel, "lines": lines, "without": without}


def _doubt_in_words(one: ModelParameter) -> str:
    """Words for a parameter that is not estimated: it ended at a bound, or may have any size."""
    if one.at_bound:
        return f"; at its {one.at_bound} bound"
    return "; these runs do not determine it" if one.is_vague else ""


def _thinned(values: Any) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    rows = np.unique(np.linspace(0, values.size - 1, min(values.size, MOST_POINTS)).astype(int))
    return values[rows]


def _form(effect: Effect) -> str:
    return ", ".join(str(v) for key in effect.choices if (v := getattr(effect, key)) is not None)


def _parameters(
    name: str, effect: Effect, model: Any, moved: Mapping[str, float], fitted: Any
) -> list[dict[str, Any]]:
    if effect.free_form:
        return []  # coefficients of a curve
    table = fitted.parameter_table_
    rows = [(p, model.parameter_table_[f"{name}__{p.name}"]) for p in effect.parameters]
    return [
        _parameter(one, p.name.replace("_", " "), table[one.name], moved) | {"fixed": not one.free}
        for p, one in rows
    ]


def _parameter(
    one: ModelParameter, label: str, fitted: ModelParameter, moved: Mapping[str, float]
) -> dict[str, Any]:
    return {
        "name": one.name,
        "label": label,
        "meaning": one.meaning + _doubt_in_words(one),
        "unit": one.unit,
        "value": one.value,
        "sd": one.sd if np.isfinite(one.sd) and one.sd > 0 else None,
        "low": one.min if np.isfinite(one.min) else None,
        "high": one.max if np.isfinite(one.max) else None,
        **_slider(fitted),
        "fixed": False,
        "movable": True,
        "moved": one.name in moved,
    }


def _slider(one: ModelParameter) -> dict[str, float]:
    """From where to where a slider goes: round numbers about the estimate, within the bounds."""
    span = max(SPAN * abs(one.value), SPAN_SD * one.sd if np.isfinite(one.sd) else 0.0)
    if span == 0.0:
        span = (one.max - one.min) / 2 if np.isfinite(one.max - one.min) else 1.0
    begin, end = max(one.min, one.value - span), min(one.max, one.value + span)
    step = 10.0 ** np.floor(np.log10(max(end - begin, 1e-300) / STEPS))
    step *= next(k for k in (1.0, 2.0, 5.0, 10.0) if (end - begin) / (k * step) <= STEPS)
    first, last = np.ceil(begin / step) * step, np.floor(end / step) * step
    return {"from": _round(first), "to": _round(last), "step": _round(step)}


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


# Effects to try, as cards.


@dataclass(frozen=True)
class SearchStep:
    """The candidates of one step: what they were added to (ids), and their cards."""

    parent: list[str]
    cards: list[dict[str, Any]]


@dataclass(frozen=True)
class Found:
    """What a search found, as cards and sentences; nothing before any.

    ``runs`` are those that it was fitted to, ``structure`` is that of its models, ``before`` the
    effects that it began with, ``effects`` those of its best model, ``controller`` the form of the
    controller that it found to answer.
    """

    result: SearchResult | None = None
    runs: tuple[int, ...] = ()
    before: Effects = field(default_factory=lambda: Effects([]))
    effects: Effects = field(default_factory=lambda: Effects([]))
    controller: str | None = None
    structure: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, search: EffectSearchCV, position: Position) -> Found:
        """What a search says that was fitted to the runs of a position."""
        models = search.baseline_, search.best_estimator_
        before, best = (Effects.of(model.effects) for model in models)
        form = getattr(search.baseline_, "controller_", None)
        return cls(search.result_, position.train, before, best, form, position.structure)

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "result": None if self.result is None else pack_result(self.result),
            "runs": list(self.runs),
            "before": pack_effects(self.before),
            "effects": pack_effects(self.effects),
            "controller": self.controller,
            "structure": dict(self.structure),
        }

    @classmethod
    def of_dict(cls, given: Mapping[str, Any], data: Runs) -> Found:
        runs, result = tuple(given["runs"]), given["result"]
        return cls(
            None if result is None else unpack_result(result, *data.part(runs)),
            runs,
            unpack_effects(given["before"]),
            unpack_effects(given["effects"]),
            given["controller"],
            given["structure"],
        )

    @cached_property
    def verdict(self) -> str:
        return "" if self.result is None else f"{tell_verdict(self.result)}."

    @cached_property
    def verdict_added(self) -> str:
        """The verdict where all that it names is in the model."""
        return "" if self.result is None else f"{tell_verdict(self.result, added=True)}."

    @property
    def kind(self) -> str:
        return "" if self.result is None else self.result.verdict.kind

    @property
    def named(self) -> list[str]:
        """Ids that the verdict names."""
        return [] if self.result is None else self.result.best_effects

    @cached_property
    def steps(self) -> list[SearchStep]:
        result = self.result
        if result is None:
            return []
        allowed = result.limits.dropna(subset=["limit"]).set_index("effect")
        limit = {str(name): tell_limit(row, "limit") for name, row in allowed.iterrows()}
        return [
            SearchStep(
                table["beside"].iloc[0], [_card(row, result, limit) for _, row in table.iterrows()]
            )
            for _, table in result.ranking.groupby("step")
        ]

    @property
    def last(self) -> Mapping[str, float]:
        """Figures of the best model."""
        return {} if self.result is None else self.result.error_path.iloc[-1]

    @cached_property
    def notes(self) -> list[str]:
        """The verdict with its figures, and remarks."""
        result = self.result
        return [] if result is None else [tell_headline(result), *map(str, result.notes)]

    @cached_property
    def limits(self) -> list[list[str]]:
        """Headings and rows of what these runs allow."""
        table = None if self.result is None else limits_table(self.result)
        return [] if table is None else [list(row) for row in (table.header, *table.rows)]

    def effect(self, kind: str, own: Mapping[str, Effect]) -> Effect:
        """The effect of an id: with the choices of the search, the user's own, or a new one."""
        for _, known in self.effects:
            if known.name == kind:
                template = own.get(kind) or effect_of(kind)
                return template.with_choices(**known.get_params())
        return own[kind].with_choices() if kind in own else effect_of(kind)

    def is_of(self, here: Position) -> bool:
        """Whether the search was of this structure and on these runs; true before any."""
        return self.result is None or (self.runs == here.train and self.structure == here.structure)

    def other(self, here: Position) -> str:
        """What the search was of, where it was not of this position."""
        if self.structure != here.structure:
            return "another structure than is fitted now"
        return "other runs than are fitted now"

    def cards(
        self, here: Position, catalogue: Sequence[Effect], domain: str | None
    ) -> tuple[list[dict[str, Any]], str]:
        """Cards for a position, best first, and what their gains refer to."""
        present = here.effects
        ids = Counter(e.name for _, e in present)
        step = self._step_for(ids)
        if step is None:
            cards = [_untried(e, domain) for e in catalogue if e.name not in ids and not e.noise]
            others = "people" if domain == "machine" else "machines"
            words = f"{NOT_SEARCHED} Effects of {others} alone are not listed"
            if noise := [e.name for e in catalogue if e.noise]:
                words += f"; {titles_of(noise)} is looked for in what is left"
            return cards, f"{words}."
        own, other = self.is_of(here), self.other(here)
        cards = [card for card in step.cards if card["id"] not in ids]
        cards = cards if own else [_elsewhere(card, other) for card in cards]
        cards.sort(key=lambda card: ORDER.index(card["status"]))  # else as the search ranks them
        exact = Counter(step.parent) == ids
        to = f"the model {with_effects(step.parent)}" if step.parent else "the baseline"
        words = f"Ranked by evidence. Gains are on held-out rows, of each added to {to}"
        if not own:
            words += f", of {other}"
        again = "" if exact and own else ". Search again for the present model and runs"
        return cards, f"{words}{again}."

    def _step_for(self, ids: Counter[str]) -> SearchStep | None:
        """The step that began from these effects, or else from the most of them."""
        begun = [step for step in self.steps if not Counter(step.parent) - ids]
        return max(begun, key=lambda step: len(step.parent), default=None)


def _elsewhere(card: dict[str, Any], other: str) -> dict[str, Any]:
    """A card of a search of something else, which names nothing here."""
    if card["status"] != FOUND:
        return card
    return {**card, "status": HELPS, "reason": f"Named for {other}."}


def _card(row: Any, result: SearchResult, limits: Mapping[str, str]) -> dict[str, Any]:
    if row["status"] == Status.REFUSED:
        status = REFUSED
    elif row["effect"] in result.best_effects:
        status = FOUND
    elif row["status"] == Status.ADDED or Reason(row["reason_code"]).counts:
        status = HELPS
    else:
        status = NO
    reason, probability = as_sentence(row["reason"]), row["probability"]
    if status == FOUND:
        ranked = result.ranking
        named = ranked[(ranked["effect"] == row["effect"]) & (ranked["status"] == Status.ADDED)]
        later = row["status"] != Status.ADDED and len(named) > 0
        reason = f"Named in step {named['step'].iloc[0]}, beside what was added." if later else ""
        probability = named["probability"].iloc[0] if later else probability
    if row["effect"] in result.stand_ins:
        status = HELPS
        reason = "It explains part of what is missing, too little to be named."
    return {
        "id": row["effect"],
        "title": row["title"],
        "form": row["form"],
        "words": as_sentence(row["words"]),
        "gain": _number(row["vaf_gain"]),
        "evidence": _number(row["evidence"]),
        "probability": _number(probability),
        "status": status,
        "reason": reason,
        "limit": "" if status == FOUND else limits.get(row["effect"], ""),
        "parameters": row["parameters"],
    }


def _untried(effect: Effect, domain: str | None) -> dict[str, Any]:
    return {
        "id": effect.name,
        "title": title_of(effect.name),
        "form": "",
        "words": effect.physics_in(domain or "human"),
        "gain": None,
        "evidence": None,
        "probability": None,
        "status": UNTRIED,
        "reason": "",
        "limit": "",
        "parameters": "",
    }


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


# How good a position is.


class Figures:
    """Figures of positions; what a comparison found of a position is kept."""

    def __init__(self, models: Models, domain: str):
        self.models, self.runs, self.domain = models, models.runs, domain
        self._judged: dict[Any, dict[str, Any]] = {}

    def prediction(self, here: Position, n: int | None = None) -> np.ndarray:
        """Free run on all runs with the first n effects, or all."""
        if n is None or n == len(here.effects):
            return self.models.prediction(here)
        # Numbers were moved in the last model: those on the way to it stay as fitted.
        return self.models.prediction(
            replace(here, effects=Effects(here.effects.steps[:n]), moved={})
        )

    def vaf(self, prediction: np.ndarray, here: Position) -> dict[str, float | None]:
        """VAF of the runs that are fitted, and of those held out."""
        return {
            "train": self.runs.vaf(prediction, here.train),
            "hold": self.runs.vaf(prediction, here.hold),
        }

    def stair(self, here: Position) -> list[dict[str, Any]]:
        """The error without effects, with the first, the first two ..."""
        stair = []
        for n in range(len(here.effects) + 1):
            prediction = self.prediction(here, n)
            title = title_of(here.effects.names[n - 1]) if n else "baseline"
            vaf = self.vaf(prediction, here)
            rmse = self.runs.rmse(prediction, here.train)
            stair.append({"title": title, "vaf": vaf["train"], "rmse": rmse, "held": vaf["hold"]})
        return stair

    def runs_away(self, prediction: np.ndarray, here: Position) -> str | None:
        """What to say where the free run leaves the data behind."""
        scored = self.runs.scored
        largest = float(np.abs(self.runs.measured[scored]).max(initial=0.0))
        reached = np.abs(np.nan_to_num(prediction[scored], nan=np.inf)).max(initial=0.0)
        vaf = self.vaf(prediction, here)["train"]
        if vaf is None or (vaf > RUNS_AWAY and reached < BESIDE * max(largest, 1e-300)):
            return None
        return AWAY

    def judge(self, here: Position) -> bool:
        """Compare the model of a position with the data; whether something new was found."""
        if judged_key(here) in self._judged:
            return False
        settling = float(getattr(self.models.estimator, "settling", 0.0)) or None
        model = self.models.moved(here)
        judged: dict[str, Any] = {"ceiling": None, "note": "", "findings": [], "vaf": LEAST}
        judged["by_frequency"] = None
        try:
            found = compare(model, *self.runs.part(here.train), run_in=settling, domain=self.domain)
        except ValueError as error:
            judged["note"] = str(error)
        else:
            judged |= {"note": found.ceiling_note, "vaf": found.vaf}
            judged["by_frequency"] = found.by_frequency
            if np.isfinite(found.noise_ceiling):
                judged["ceiling"] = {"vaf": found.noise_ceiling}
            judged["findings"] = [{"what": f.title, "why": f.meaning} for f in found.findings]
        self._judged[judged_key(here)] = judged
        return True

    def findings(self, here: Position, found: Found) -> list[dict[str, str]]:
        """What the comparison of a position says, if it was made, and the notes of its search."""
        judged = self._judged.get(judged_key(here))
        notes = found.notes if found.is_of(here) else []
        said = [{"what": as_sentence(note), "why": "A note of the search."} for note in notes]
        return said + ([] if judged is None else judged["findings"])

    def ceiling(self, here: Position, found: Found) -> dict[str, Any]:
        """The noise ceiling as the best model on these runs has it: a worse one shows less."""
        pending = judged_key(here) not in self._judged
        known = [one for one in self._judged_on(here) if one["ceiling"] is not None]
        best = max(known, key=lambda one: one["vaf"], default=None)
        last = found.last if found.runs == here.train else {}
        of_search = np.isfinite(last.get("ceiling", np.nan))
        if of_search and (best is None or best["vaf"] < last["vaf_train"] - CLOSE):
            ceiling = {"vaf": float(last["ceiling"]), "note": OF_SEARCH}
        elif best is not None:
            ceiling = {**best["ceiling"], "note": as_sentence(best["note"])}
        else:
            ceiling = None
        return {"ceiling": ceiling, "ceiling_pending": pending}

    def measured(self, here: Position) -> pd.DataFrame | None:
        """What a comparison found over frequency; the response measured there is of no model."""
        known = (one["by_frequency"] for one in self._judged_on(here))
        return next((table for table in known if table is not None), None)

    def _judged_on(self, here: Position) -> list[dict[str, Any]]:
        """What was found of models on the same runs."""
        return [one for key, one in list(self._judged.items()) if key[0] == here.uses]


def judged_key(here: Position) -> tuple[Any, ...]:
    """By which what was found of a position is known again."""
    return here.uses, *make_key(here), tuple(here.moved.items())
