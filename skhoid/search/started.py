"""What a search begins with: the model, its data without what is left out, and the folds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.record import Record
from ..model.prepared import Prepared
from ..recordings.loss_of_control import ControlCheck
from .all_runs import Held
from .judges import HeldOutRows


@dataclass(frozen=True)
class Started:
    """A search before any effect is tried.

    ``lost`` are rows without control, ``known`` rows to be explained, at full rate; ``some`` are
    the columns of the record in which effects are looked for (None: all), ``record`` their data.
    """

    model: Any
    prepared: Prepared
    control: ControlCheck
    lost: np.ndarray
    known: np.ndarray
    some: np.ndarray | None
    record: Record
    folds: list[HeldOutRows]
    held: list[Held]

    def of_record(self) -> Prepared:
        """The data in which effects are looked for."""
        return replace(self.prepared, record=self.record)
