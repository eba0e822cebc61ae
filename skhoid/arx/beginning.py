"""How free runs of a linear ARX model begin: at rest, or from what inputs and outputs show."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..exceptions import MissingDataWarning
from ..model.cores import held_level
from ..model.initial import ESTIMATE, REST, pays
from ..preprocessing.grid import ModelGrid
from ..preprocessing.held_inputs import HeldInputs

if TYPE_CHECKING:
    from .batch import ARXRegressor

FIRST = 2000  # rows of each stretch that tell how it begins
RUN_AWAY = 1e50  # where no start helps


@dataclass(frozen=True)
class Beginning:
    """How the free runs of a fitted model begin.

    ``initial`` is what was asked for; ``held`` says whether runs of which only the inputs are known
    begin as if these had always been as at first, with an output within ``levels``.
    """

    initial: str | None
    held: bool
    levels: tuple[float, float]

    @classmethod
    def seen(
        cls, model: ARXRegressor, grid: ModelGrid, inputs: np.ndarray, output: np.ndarray
    ) -> Beginning:
        """From the rows that were fitted, and what the user asked for; sets ``initial_``."""
        known = ~np.isnan(output)
        measured = output[measured_rows(grid) & known].astype(np.float64, copy=False)
        levels = float(measured.min()), float(measured.max())
        held = model.initial == ESTIMATE
        if model.initial is None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MissingDataWarning)  # the fit has said so
                held_inputs = model._hold(grid, inputs)
            first = measured_rows(grid, FIRST) & known
            left = [
                float(
                    ((output[first] - way._free(model, grid, held_inputs, FIRST)[first]) ** 2).sum()
                )
                for way in (cls(None, held, levels) for held in (False, True))
            ]
            held = pays(left[0], left[1], measured)
        model.initial_ = ESTIMATE if held else REST
        return cls(ESTIMATE if held else model.initial, held, levels)

    def free_run(self, model: ARXRegressor, grid: ModelGrid, inputs: HeldInputs) -> np.ndarray:
        return self._free(model, grid, inputs)

    def _free(
        self, model: ARXRegressor, grid: ModelGrid, inputs: HeldInputs, most: int | None = None
    ) -> np.ndarray:
        if not self.held:
            return model._simulate(grid, inputs, most=most)
        orders, coef = model.orders_, model.coef_
        _, b, constant = orders.split(coef)
        drive = inputs[grid.past] @ b.sum(axis=1) + constant
        level = held_level(np.r_[1.0, model.a_], drive, self.levels)
        y0 = np.repeat(level[:, None], max(orders.na, 1), axis=1)
        return model._simulate(grid, inputs, y0, held=True, most=most)

    def run_from(
        self, model: ARXRegressor, grid: ModelGrid, inputs: HeldInputs, output: np.ndarray
    ) -> np.ndarray:
        """Free run whose initial states fit the output, where the output shows them."""
        free = self._free(model, grid, inputs)
        if self.initial == REST or not max(free.max(), -free.min()) < RUN_AWAY:
            return free
        if self.initial == ESTIMATE:
            return model._from_fitted_states(grid, inputs, output, held=True)
        fitted = None
        stretches = zip(grid.begin, grid.end, grid.measured, strict=True)
        for rows in (slice(begin, end) for begin, end, counts in stretches if counts):
            known = ~np.isnan(output[rows])
            y = output[rows][known]
            rest = float(((y - free[rows][known]) ** 2).sum())
            if not pays(rest, 0.0, y):
                continue
            if fitted is None:
                fitted = model._from_fitted_states(grid, inputs, output, held=True)
            # Each is judged alone: the others must not change its prediction.
            if pays(rest, float(((y - fitted[rows][known]) ** 2).sum()), y):
                free[rows] = fitted[rows]
        return free


def measured_rows(grid: ModelGrid, most: int | None = None) -> np.ndarray:
    """Rows outside run-ins, or the first ``most`` of each stretch."""
    rows = np.zeros(grid.n_rows, dtype=bool)
    for begin, end in zip(grid.begin[grid.measured], grid.end[grid.measured], strict=True):
        rows[begin : end if most is None else min(end, begin + most)] = True
    return rows
