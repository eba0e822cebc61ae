"""One state of an exploration, and the way there: what is undone, redone and kept in a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ...effects.composition import Effects
from ...effects.registry import effect as effect_of

TRAIN, HOLD, OUT = "train", "hold", "out"
USES = (TRAIN, HOLD, OUT)


@dataclass(frozen=True)
class Position:
    """What a model is made of.

    ``uses`` says of each run whether it is fitted, held out or left out; ``effects`` hold numbers
    where a parameter is given; ``moved`` are values of parameters that were moved by hand since the
    fit. ``words`` say how this state came about.
    """

    uses: tuple[str, ...]
    effects: Effects
    moved: Mapping[str, float] = field(default_factory=dict)
    words: str = ""

    @property
    def train(self) -> tuple[int, ...]:
        return self.of_use(TRAIN)

    @property
    def hold(self) -> tuple[int, ...]:
        return self.of_use(HOLD)

    def of_use(self, use: str) -> tuple[int, ...]:
        """Numbers of the runs of a use."""
        return tuple(i for i, one in enumerate(self.uses) if one == use)

    def with_changes(self, words: str, **changes: Any) -> Position:
        return replace(self, words=words, **changes)

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON; effects by id."""
        effects = [[name, e.name, e.get_params()] for name, e in self.effects]
        return {
            "uses": list(self.uses),
            "effects": effects,
            "moved": dict(self.moved),
            "words": self.words,
        }

    @classmethod
    def of_dict(cls, given: Mapping[str, Any]) -> Position:
        steps = [
            (name, effect_of(kind).set_params(**params)) for name, kind, params in given["effects"]
        ]
        return cls(tuple(given["uses"]), Effects(steps), dict(given["moved"]), str(given["words"]))


class History:
    """Positions one after the other, and where among them one is."""

    def __init__(self, first: Position):
        self.positions = [first]
        self.at = 0

    @property
    def here(self) -> Position:
        return self.positions[self.at]

    def go(self, position: Position) -> None:
        """A new step; what was undone before it is gone."""
        self.positions = [*self.positions[: self.at + 1], position]
        self.at += 1

    @property
    def undo(self) -> str | None:
        """What would be undone."""
        return self.here.words if self.at else None

    @property
    def redo(self) -> str | None:
        """What would be done again."""
        after = self.positions[self.at + 1 : self.at + 2]
        return after[0].words if after else None

    def step(self, by: int) -> None:
        if not 0 <= self.at + by < len(self.positions):
            raise ValueError(f"There is nothing to {'undo' if by < 0 else 'redo'}.")
        self.at += by

    def as_dict(self) -> dict[str, Any]:
        return {"positions": [one.as_dict() for one in self.positions], "at": self.at}

    @classmethod
    def of_dict(cls, given: Mapping[str, Any]) -> History:
        positions = [Position.of_dict(one) for one in given["positions"]]
        history = cls(positions[0])
        history.positions, history.at = positions, int(given["at"])
        return history
