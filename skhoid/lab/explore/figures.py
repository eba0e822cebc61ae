"""How good a position is: VAF, the stair of the error, the noise ceiling, what is left."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...diagnosis.comparison import compare
from ...effects.composition import Effects
from ...effects.registry import title_of
from ...text import as_sentence
from .cards import Found
from .models import Models
from .position import Position

RUNS_AWAY = -999.0  # VAF in percent, below which a free run has left the data
BESIDE = 5.0  # times the largest measured value, at which a run has left them too
CLOSE = 0.5  # points of VAF, by which the best model known may be worse than that of a search
LEAST = -1e9  # points, of a model that could not be compared
REMEMBERED = 20  # comparisons
OF_SEARCH = "Of the best model of the search."
AWAY = "With these values the simulation runs away from what was measured."


class Figures:
    """Figures of positions; what a comparison found of a position is kept."""

    def __init__(self, models: Models, domain: str):
        self.models, self.runs, self.domain = models, models.runs, domain
        self._judged: dict[Any, dict[str, Any]] = {}

    def prediction(self, here: Position, n: int | None = None) -> np.ndarray:
        """Free run on all runs with the first n effects, or all."""
        effects = here.effects if n is None else Effects(here.effects.steps[:n])
        return self.models.prediction(effects, here.train, here.moved)

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
        if key_of(here) in self._judged:
            return False
        settling = float(getattr(self.models.estimator, "settling", 0.0)) or None
        model = self.models.moved(here.effects, here.train, here.moved)
        judged: dict[str, Any] = {"ceiling": None, "note": "", "findings": [], "vaf": LEAST}
        try:
            found = compare(model, *self.runs.part(here.train), run_in=settling, domain=self.domain)
        except ValueError as error:
            judged["note"] = str(error)
        else:
            judged |= {"note": found.ceiling_note, "vaf": found.vaf}
            if np.isfinite(found.noise_ceiling):
                low, high = found.noise_ceiling_interval
                judged["ceiling"] = {"vaf": found.noise_ceiling, "low": low, "high": high}
            judged["findings"] = [{"what": f.title, "why": f.meaning} for f in found.findings]
        self._judged[key_of(here)] = judged
        return True

    def memory(self) -> list[list[Any]]:
        """What comparisons found last, for JSON."""
        last = list(self._judged.items())[-REMEMBERED:]
        return [
            [list(uses), text, [list(one) for one in moved], judged]
            for (uses, text, moved), judged in last
        ]

    def remember(self, given: Iterable[list[Any]]) -> None:
        """Take what :meth:`memory` returned."""
        for uses, text, moved, judged in given:
            key = tuple(uses), text, tuple((name, value) for name, value in moved)
            self._judged[key] = judged

    def findings(self, here: Position, found: Found) -> list[dict[str, str]]:
        """What the comparison of a position says, if it was made, and the notes of its search."""
        judged = self._judged.get(key_of(here))
        notes = found.notes if found.is_of(here.train) else []
        said = [{"what": as_sentence(note), "why": "A note of the search."} for note in notes]
        return said + ([] if judged is None else judged["findings"])

    def ceiling(self, here: Position, found: Found) -> dict[str, Any]:
        """The noise ceiling as the best model on these runs has it: a worse one shows less."""
        pending = key_of(here) not in self._judged
        same = [one for key, one in list(self._judged.items()) if key[0] == here.uses]
        known = [one for one in same if one["ceiling"] is not None]
        best = max(known, key=lambda one: one["vaf"], default=None)
        of_search = found.ceiling is not None and tuple(found.runs) == here.train
        if of_search and (best is None or best["vaf"] < found.vaf - CLOSE):
            ceiling = {"vaf": found.ceiling, "low": None, "high": None, "note": OF_SEARCH}
        elif best is not None:
            ceiling = {**best["ceiling"], "note": as_sentence(best["note"])}
        else:
            ceiling = None
        return {"ceiling": ceiling, "ceiling_pending": pending}


def key_of(here: Position) -> tuple[Any, ...]:
    """By which what was found of a position is known again."""
    return here.uses, repr(here.effects.get_params()), tuple(here.moved.items())
