"""The report on the present model, written into the session's folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...effects.composition import Effects
from ..explore.exploration import Exploration
from ..explore.payloads import payload_of_exploration
from ..report import report
from .session import SessionFolder

__all__ = ["Searched", "saved_report"]


@dataclass(frozen=True)
class Searched:
    """A search of this session that is in memory, and the runs on which it was fitted."""

    search: Any
    train: tuple[int, ...]
    X: Any
    y: Any


def saved_report(
    folder: SessionFolder, exploration: Exploration, searched: Searched | None, source: str
) -> Path:
    """Write the report beside those that there are; returns its path."""
    made_with = {"Session": f"skhoid workbench --session {folder.path}"}
    more: dict[str, Any] = {"source": source, "made_with": made_with}
    with exploration.lock:
        here, model = exploration.here, exploration.model
        of_search = searched is not None and _is_found(exploration, searched)
        data = exploration.runs.part(here.train)
        payload = None if of_search else payload_of_exploration(exploration)
        held = exploration.figures.vaf(exploration.figures.prediction(here), here)["hold"]
    if held is not None:
        names = ", ".join(exploration.runs.labels[run] for run in here.hold)
        made_with["Held out"] = f"VAF {held:.1f} % on {names}, which are not in this page's figures"
    if payload is None:
        assert searched is not None
        page = report(searched.search, searched.X, searched.y, **more)
    else:
        page = report(model, *data, effects=None, **more)._embed(payload)
    return page.save(folder.free("report.html"))


def _is_found(exploration: Exploration, searched: Searched) -> bool:
    """Whether the present model is the one that the search has found."""
    here = exploration.here
    if here.moved or here.train != searched.train:
        return False
    return _chosen(Effects.of(searched.search.best_estimator_.effects)) == _chosen(here.effects)


def _chosen(effects: Effects) -> dict[str, str]:
    """Choices and given numbers of effects, by name."""
    return {name: repr(effect.get_params()) for name, effect in effects}
