"""Effects to try, as cards: what a search said of each, or that nothing is known yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...effects.base import Effect
from ...effects.composition import Effects
from ...effects.registry import effect as effect_of
from ...effects.registry import title_of
from ...search import EffectSearchCV, Reason, Status
from ...search.explanations import with_effects
from ...text import as_sentence
from .position import Position

FOUND, HELPS, NO, REFUSED, UNTRIED = "found", "helps", "no", "refused", "untried"
ORDER = (FOUND, HELPS, UNTRIED, NO, REFUSED)
NOT_SEARCHED = "Not searched yet: what each effect would gain is not known."


@dataclass(frozen=True)
class SearchStepKept:
    """The candidates of one step: what they were added to (ids), and their cards."""

    parent: list[str]
    cards: list[dict[str, Any]]


@dataclass(frozen=True)
class Found:
    """What a search found, as far as an exploration needs it; all of it may go to JSON.

    ``effects`` are those of the best model (name, id and choices), ``named`` the ids that the
    verdict names; ``vaf`` is its VAF on the rows fitted, those of ``runs``.
    """

    verdict: str = ""
    kind: str = ""
    named: list[str] = field(default_factory=list)
    effects: list[list[Any]] = field(default_factory=list)
    steps: list[SearchStepKept] = field(default_factory=list)
    ceiling: float | None = None
    vaf: float = -np.inf
    runs: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, search: EffectSearchCV, runs: Sequence[int]) -> Found:
        """What a fitted search says."""
        begun = [e.name for _, e in Effects.of(search.baseline_.effects)]
        added = list(search.error_path_["effect"].iloc[1:])
        steps = []
        for number, table in search.ranking_.groupby("step"):
            before = [name.split("-")[0] for name in added[: int(number) - 1]]
            cards = [_card(row, search) for _, row in table.iterrows()]
            steps.append(SearchStepKept([*begun, *before], cards))
        ceiling = float(search.error_path_["ceiling"].iloc[-1])
        best = Effects.of(search.best_estimator_.effects)
        return cls(
            verdict=search._headline(),
            kind=search.verdict_.kind,
            named=list(search.best_effects_),
            effects=[[name, e.name, e.get_params()] for name, e in best],
            steps=steps,
            ceiling=ceiling if np.isfinite(ceiling) else None,
            vaf=float(search.error_path_["vaf_train"].iloc[-1]),
            runs=list(runs),
            notes=list(search.notes_),
        )

    def as_dict(self) -> dict[str, Any]:
        steps = [vars(step) for step in self.steps]
        return {**vars(self), "steps": steps}

    @classmethod
    def of_dict(cls, given: Mapping[str, Any]) -> Found:
        steps = [SearchStepKept(**step) for step in given["steps"]]
        return cls(**{**given, "steps": steps})

    def effect(self, kind: str, own: Mapping[str, Effect]) -> Effect:
        """The effect of an id: with the choices of the search, the user's own, or a new one."""
        for _, known, params in self.effects:
            if known == kind:
                template = own.get(kind) or effect_of(kind)
                return template.with_choices(**params)
        return own[kind].with_choices() if kind in own else effect_of(kind)

    def is_of(self, runs: Sequence[int]) -> bool:
        """Whether the search was made on these runs; true before any."""
        return not self.steps or list(self.runs) == list(runs)

    def cards(
        self, here: Position, catalogue: Sequence[Effect], domain: str | None
    ) -> tuple[list[dict[str, Any]], str]:
        """Cards for a position, best first, and what their gains refer to."""
        present = here.effects
        ids = Counter(e.name for _, e in present)
        step = self._step_for(ids)
        if step is None:
            cards = [_untried(e, domain) for e in catalogue if e.name not in ids and not e.noise]
            return cards, NOT_SEARCHED
        own = self.is_of(here.train)
        cards = [card if own else _elsewhere(card) for card in step.cards if card["id"] not in ids]
        cards.sort(key=lambda card: (ORDER.index(card["status"]), -(card["gain"] or 0.0)))
        exact = Counter(step.parent) == ids
        to = f"the model {with_effects(step.parent)}" if step.parent else "the baseline"
        words = f"Gains in the search, on held-out rows, added to {to}"
        if not own:
            words += ", of other runs than are fitted now"
        again = "" if exact and own else ". Search again for the present model and runs"
        return cards, f"{words}{again}."

    def _step_for(self, ids: Counter[str]) -> SearchStepKept | None:
        """The step that began from these effects, or else from the most of them."""
        begun = [step for step in self.steps if not Counter(step.parent) - ids]
        return max(begun, key=lambda step: len(step.parent), default=None)


def _elsewhere(card: dict[str, Any]) -> dict[str, Any]:
    """A card of a search on other runs, which names nothing here."""
    if card["status"] != FOUND:
        return card
    return {**card, "status": HELPS, "reason": "Named for other runs than are fitted now."}


def _card(row: Any, search: EffectSearchCV) -> dict[str, Any]:
    if row["status"] == Status.REFUSED:
        status = REFUSED
    elif row["effect"] in search.best_effects_:
        status = FOUND
    elif row["status"] == Status.ADDED or Reason(row["reason_code"]).counts:
        status = HELPS
    else:
        status = NO
    reason = "" if status == FOUND else as_sentence(row["reason"])
    if row["effect"] in search.stand_ins_:
        status = HELPS
        reason = "It explains part of what is missing, too little to be named."
    return {
        "id": row["effect"],
        "title": row["title"],
        "form": row["form"],
        "words": as_sentence(row["words"]),
        "gain": _number(row["vaf_gain"]),
        "delta_bic": _number(row["delta_bic"]),
        "status": status,
        "reason": reason,
        "parameters": row["parameters"],
    }


def _untried(effect: Effect, domain: str | None) -> dict[str, Any]:
    return {
        "id": effect.name,
        "title": title_of(effect.name),
        "form": "",
        "words": effect.physics_in(domain or "human"),
        "gain": None,
        "delta_bic": None,
        "status": UNTRIED,
        "reason": "",
        "parameters": "",
    }


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
