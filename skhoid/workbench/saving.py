"""The report on the present model, written into the session's folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..explore.exploration import Exploration
from ..reporting import report
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
        data = exploration.runs.part(tuple(sorted((*here.train, *here.hold))))
    if of_search and searched is not None:
        page = report(searched.search, searched.X, searched.y, **more)
    else:
        page = report(model, *data, effects=None, **more)
    return page.save(folder.free("report.html"))


def _is_found(exploration: Exploration, searched: Searched) -> bool:
    """Whether the present model is the one that the search has found."""
    here = exploration.here
    if here.moved or here.train != searched.train:
        return False
    effects = searched.search.best_estimator_.effects
    found = [] if effects is None else list(effects.names)
    return sorted(found) == sorted(here.effects.names)
