"""Models of a search as estimators, each at its largest likelihood."""

from __future__ import annotations

from typing import Any

from ..model.fitting import Criterion, RemnantModel
from ..model.likelihood import likelihood_fit
from ..model.model import Model
from ..model.prepared import Prepared, SimulatedModel
from .all_runs import on_rows_of
from .path import output_error_fit


class Estimators:
    """Estimators with the settings of a model; what one model leads to is found once."""

    def __init__(self, model: SimulatedModel):
        self.model = model
        self._known: dict[tuple, tuple[Prepared, Model, RemnantModel]] = {}

    def of(self, prepared: Prepared, fitted: Model) -> Any:
        """A model as an estimator."""
        key = (id(prepared), *fitted.key)
        if key not in self._known:
            start = start_of(on_rows_of(prepared.record, fitted))
            self._known[key] = prepared, *likelihood_fit(start, Criterion(prepared.record))
        _, likeliest, noise = self._known[key]
        return self.model.with_fit(prepared, likeliest, noise)


def start_of(fitted: Model) -> Model:
    """Where the last fit of a model begins: for an ARX model where its own ``fit`` does.

    It has few rounds of noise models, which further ones before them would not be.
    """
    return fitted if fitted.simulator.core.kind.is_operator else output_error_fit(fitted)
