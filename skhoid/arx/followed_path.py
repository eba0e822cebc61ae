"""FollowedPath: an ARX model whose parameters are known at instants of time in the run."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunTimeWarning
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import ModelGrid
from .base import BaseARX, arx_parameter_table
from .rls import Instants, grid_numbers


class FollowedPath(BaseARX):
    """Predictions along ``coef_path_``, or with the last parameters where there is no path.

    ``_numbers`` are the sample numbers of its instants, and ``initial_coef_`` what held before.
    """

    parameters: str
    coef_path_: np.ndarray
    time_path_: np.ndarray
    initial_coef_: np.ndarray
    parameter_names_: list[str]
    _numbers: np.ndarray

    @property
    def a_(self) -> np.ndarray:
        return self.orders_.split(self.coef_)[0]

    @property
    def b_(self) -> Any:
        return self.orders_.input_rows(self.coef_)

    @property
    def intercept_(self) -> float:
        return self.orders_.split(self.coef_)[2]

    @property
    def covariance_(self) -> np.ndarray:
        raise NotImplementedError

    @property
    def standard_errors_(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance_))

    @property
    def parameters_(self) -> pd.DataFrame:
        return arx_parameter_table(
            self.parameter_names_, self.coef_, self.standard_errors_, self._coefficient_units()
        )

    def _parameters(self, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
        if not self._follows_path:
            return super()._parameters(grid)
        numbers = grid_numbers(grid)
        self._check_times(grid, numbers)
        at = np.searchsorted(self._numbers, numbers, side="right") - 1
        return self.coef_path_, np.maximum(at, 0)

    def _parameters_before(self, grid: ModelGrid, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        if not self._follows_path:
            return super()._parameters_before(grid, horizon)
        self._check_times(grid, grid_numbers(grid))
        path = np.concatenate([self.initial_coef_[None], self.coef_path_])
        return path, self._places_before(grid, horizon)

    def _places_before(self, grid: ModelGrid, horizon: int) -> np.ndarray:
        """Place of what each row knew so many rows before: 0 for the start, then the path's."""
        return np.searchsorted(self._numbers, grid_numbers(grid) - horizon, side="right")

    def _check_times(self, grid: ModelGrid, numbers: np.ndarray) -> None:
        warn_of_times_outside(
            grid, numbers, self._numbers, self.time_path_, ", or use parameters='last'"
        )

    def _check_shared_times(self, instants: Instants, grid: ModelGrid) -> None:
        """Warn of runs that cannot be aligned with the others."""
        if instants.n_runs == 1:
            return
        shared = np.bincount(instants.of_row)[instants.of_row] > 1
        alone = np.bincount(instants.run, shared, instants.n_runs) == 0
        if alone.any():
            label = grid.layout.labels[int(np.argmax(alone))]
            warnings.warn(
                f"Run {label!r} shares no instant with the other runs. Runs are aligned by their "
                "time, which must count from the start of each run.",
                RunTimeWarning,
                stacklevel=5,
            )

    @property
    def _follows_path(self) -> bool:
        return as_fitted(self).parameters == "path" and "coef_path_" in vars(self)

    def _fitted(self, regressors: np.ndarray, rows: np.ndarray, grid: ModelGrid) -> np.ndarray:
        """Output that the regressors give with the parameters of the instant before."""
        if not self._follows_path:
            return regressors @ self.coef_
        path, at = self._parameters_before(grid, 1)
        return np.einsum("tp,tp->t", regressors, path[at[rows]])


def warn_of_times_outside(
    grid: ModelGrid, numbers: np.ndarray, known: np.ndarray, time: np.ndarray, or_else: str = ""
) -> None:
    """Warn of stretches of a grid with no instant of a path, whose sample numbers are ``known``."""
    outside = (numbers[grid.begin] > known[-1]) | (numbers[grid.end - 1] < known[0])
    if outside.any():
        row = grid.full_row(int(grid.begin[np.argmax(outside)]))
        warnings.warn(
            f"Rows from {grid.layout.where(row)} on lie outside the fitted times, {time[0]:g} to "
            f"{time[-1]:g} s, so they get the parameters of the nearest end. Count time from the "
            f"start of each run{or_else}.",
            RunTimeWarning,
            stacklevel=6,
        )
