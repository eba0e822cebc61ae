"""People side by side: the effects of one model, fitted to each person alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...effects import titles_of
from ...pipelines import prediction_from
from .models import OUT, TRAIN, Models, Position, make_key, name_structure

MOST = 24  # people: of more panels nobody compares all
SHOWN = 10.0  # s of a run: in a small panel a longer one is a black band
POINTS = 400  # of a line in a panel of some 250 px


@dataclass
class PeopleFits:
    """Fits of a model to each person alone, as far as they have come.

    ``rows`` are what the page shows of each person, in the order of ``models.runs.people()``.
    """

    models: Models
    position: Position
    rows: list[dict[str, Any]] = field(default_factory=list)
    stopped: bool = False

    def fit(self) -> Iterator[None]:
        """Fit one person after the other, until it is stopped."""
        try:
            for name, numbers in self.models.runs.people()[:MOST]:
                if self.stopped:
                    return
                self.rows.append(fit_person(self.models, self.position, name, tuple(numbers)))
                yield
        finally:
            self.stopped = True

    def told(self, here: Position) -> dict[str, Any]:
        """How far it is, and whether the model is another now."""
        now = replace(here, uses=self.position.uses)
        names = self.position.effects.names
        title = titles_of(names) if names else "baseline"
        if self.position.structure:
            title = f"{name_structure(self.models.estimator_of(self.position))}, {title}"
        return {
            "title": title,
            "done": len(self.rows),
            "running": not self.stopped,
            "changed": make_key(now) != make_key(self.position),
        }


def fit_person(
    models: Models, position: Position, name: str, numbers: tuple[int, ...]
) -> dict[str, Any]:
    """A model of one person's runs: its VAF, parameters, and some seconds of the first run."""
    runs = models.runs
    person: dict[str, Any] = {"name": name, "run": numbers[0], "failure": ""}
    try:
        uses = tuple(TRAIN if run in numbers else OUT for run in range(runs.n))
        model = models.fitted(replace(position, uses=uses))
    except ValueError as error:
        return {**person, "failure": str(error)}
    simulated = np.full(runs.layout.n_rows, np.nan)
    simulated[runs.mask(numbers)] = prediction_from(model, *runs.part(numbers))[0]
    estimated = {one.name for one in model.parameter_table_.values() if one.free}
    table = model.parameters_
    rows = runs.rows(numbers[0])
    first = rows.start + int(np.argmax(runs.scored[rows]))  # behind what settles
    last = min(first + round(SHOWN / runs.layout.dt), rows.stop)
    shown = slice(first, last, max((last - first) // POINTS, 1))
    return {
        **person,
        "vaf": runs.vaf(simulated, numbers),
        "parameters": [
            {"name": str(key), **row[["value", "sd", "low", "high", "unit"]].to_dict()}
            for key, row in table.iterrows()
            if key in estimated or np.isfinite(row["sd"])
        ],
        "t": runs.layout.time[shown],
        "measured": runs.measured[shown],
        "simulated": simulated[shown],
    }
