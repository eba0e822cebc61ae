"""Maps without memory, which may act on the error, the command or the output."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from scipy.special import ndtr

from .base import Effect
from .core_kind import CoreKind
from .dimension import Dimension, E, U
from .record import Record, differentiated

PLACE_OF = {"error": "input", "command": "command", "output": "output"}


class StaticMap(Effect):
    """Base of effects that map a signal sample by sample, at one of several places.

    A subclass has the argument ``at``, which its ``choices`` list first, the usual place before the
    others, and implements ``mapped``. A search tries every place.
    """

    plain: ClassVar[tuple[str, ...]]  # forms that are tried at other places than the usual one
    physics_at: ClassVar[Mapping[str, str]] = {}  # in place of ``physics`` at other places
    at: str | None
    form: str | None

    @property
    def usual_at(self) -> str:
        """Where it acts unless another place is given."""
        return self.choices["at"][0]

    @property
    def place(self) -> str:  # type: ignore[override]
        return PLACE_OF[self.at or self.usual_at]

    @property
    def unit(self) -> Dimension:
        """Of the signal that is mapped."""
        return E if self.place == "input" else U

    def physics_in(self, domain: str) -> str:
        return self.physics_at.get(self.at or "") or super().physics_in(domain)

    def variants(self, record: Record) -> list[Effect]:
        """The choices at the place, which is the usual one unless another is given.

        At others the plain forms only, where none is given.
        """
        placed = self.with_choices(at=self.at or self.usual_at)
        made: list[Any] = super(StaticMap, placed).variants(record)
        return [v for v in made if v.at == self.usual_at or v.form in self.plain] or made

    def alternatives(self, record: Record) -> list[Effect]:
        """One for each place; an ARX model has the usual one only."""
        usual, *others = self.one_of_each("at", self.choices["at"])
        return [usual] if record.core == CoreKind.ARX else [usual, *others]

    def apply(self, signal: Any, record: Record, *args: Any, **values: Any) -> Any:
        if self.place != "command":
            return self.mapped(signal, record, *args, **values)
        whole = signal.position + differentiated(signal.rate, record.dt)
        mapped = self.mapped(whole, record, *args, **values)
        return signal._replace(position=mapped, rate=np.zeros_like(signal.rate))

    def mapped(self, signal: np.ndarray, record: Record, *args: Any, **values: Any) -> np.ndarray:
        """What becomes of the signal."""
        raise NotImplementedError(f"{type(self).__name__} must implement mapped.")


def mean_within(signal: np.ndarray, limit: float, remnant: float) -> np.ndarray:
    """Mean of a signal that limits cut, over remnant that is cut with it."""
    above, below = (signal - limit) / remnant, (signal + limit) / remnant
    return remnant * (_mean_above_zero(below) - _mean_above_zero(above)) - limit


def _mean_above_zero(x: np.ndarray) -> np.ndarray:
    """Mean of max(x + z, 0) over standard normal z."""
    return x * ndtr(x) + np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)
