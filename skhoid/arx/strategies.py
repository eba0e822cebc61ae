"""Strategies of ARXRegressor: how it is estimated and how it predicts.

``ARXRegressor.fit`` chooses one: the equation error, by least squares or instrumental variables,
or the error of simulation, where there are effects.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from ..effects.composition import Effects
from ..model.arx_core import forecast
from ..model.estimator import Simulation, first_model, simulated_summary, simulation_of
from ..model.fitting import Criterion, RemnantModel
from ..model.initial import ESTIMATE, HELD
from ..model.likelihood import likelihood_fit
from ..model.model import Model
from ..model.parameters import arx_parameter_table
from ..model.prepared import Prepared, prepared_for
from ..preprocessing.grid import ModelGrid
from ..regression import DataToFit, segments
from ..runs import input_columns
from ..runs.roles import is_external, role_of
from ..text import ModelSummary
from .base import BaseARX, check_row_count
from .beginning import Beginning
from .excitation import rank_error
from .instruments import estimate
from .least_squares import Triangle, newey_west
from .model_summary import batch_summary
from .orders import Orders, regressor_blocks, regressors

if TYPE_CHECKING:
    from .batch import ARXRegressor

ONLY_SIMULATED = ("noise_ar_", "loglik_", "bic_", "vaf_", "controlled_element_")


class Strategy(Protocol):
    """What depends on how an ARX model was estimated."""

    def free_run(self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        """Free run on the grid, from all columns of X at full rate."""

    def ahead(
        self,
        model: ARXRegressor,
        grid: ModelGrid,
        values: np.ndarray,
        output: np.ndarray,
        horizon: int,
    ) -> np.ndarray:
        """Predictions some rows ahead, on the grid."""

    def one_step_errors(self, model: ARXRegressor, X: Any, y: Any) -> np.ndarray:
        """One-step errors on the grid; NaN where there are none."""

    def run_from(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray
    ) -> np.ndarray:
        """Free run on the grid from initial states that fit the output."""

    def simulated(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        """Free run on the grid from rest, or from initial states that fit an output."""

    def summary(self, model: ARXRegressor) -> ModelSummary:
        """What was estimated, and how."""


class AnswersByEquation:
    """Predictions are those of the ARX equation with ``coef_``, as of every linear model."""

    begins: Beginning

    def free_run(self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        return self.begins.free_run(model, grid, model._held_inputs(grid, values))

    def run_from(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray
    ) -> np.ndarray:
        return self.begins.run_from(model, grid, model._held_inputs(grid, values), output)

    def ahead(
        self,
        model: ARXRegressor,
        grid: ModelGrid,
        values: np.ndarray,
        output: np.ndarray,
        horizon: int,
    ) -> np.ndarray:
        return BaseARX._ahead(model, grid, values, output, horizon)

    def one_step_errors(self, model: ARXRegressor, X: Any, y: Any) -> np.ndarray:
        return BaseARX._one_step_errors(model, X, y)

    def simulated(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        return BaseARX._simulated(model, grid, values, output)


@dataclass(frozen=True)
class EquationError(AnswersByEquation):
    """Coefficients that minimise the error of one step: by regression, or with instruments.

    It holds what was fitted, whatever parameters were set since: ``hac`` says how standard errors
    were found, and ``instruments`` are names of channels, none for least squares.
    """

    hac: bool
    begins: Beginning
    instruments: list[str] = field(default_factory=list)

    @classmethod
    def by_least_squares(cls, model: ARXRegressor, data: DataToFit) -> EquationError:
        grid, inputs, output = data.grid, data.inputs, data.output
        begin, end = _begun(model, grid)
        hac, orders = model.covariance == "hac", model.orders_
        blocks = regressor_blocks(output, inputs, begin, end, orders)
        triangle = Triangle.of_blocks((table for table, *_ in blocks), orders.n_params + 1)
        n_rows = triangle.n_rows
        possible = int(np.maximum(end - begin - orders.first_row, 0).sum())
        model.n_rows_missing_ = possible - n_rows
        check_row_count(n_rows, orders.n_params, grid)
        model._report_missing(grid, inputs, output, n_rows, model.inputs_)
        _check_rank(model, triangle, inputs, output)
        coef = triangle.solve()
        variance = triangle.rss / max(n_rows - orders.n_params, 1)
        bread = triangle.inverse_information()
        if hac:
            table, rows, _ = regressors(output, inputs, begin, end, orders)
            errors = table[:, -1] - table[:, :-1] @ coef
            # The sum over influences, not of scores, keeps variances positive near collinearity.
            influence = (table[:, :-1] * errors[:, None]) @ bread
            covariance = newey_west(influence, rows, grid.begin)
        else:
            covariance = variance * bread
        _show(model, coef, covariance, variance, n_rows)
        return cls(hac, Beginning.seen(model, grid, inputs, output))

    @classmethod
    def by_instruments(cls, model: ARXRegressor, data: DataToFit) -> EquationError:
        grid, inputs, output = data.grid, data.inputs, data.output
        begin, end = _begun(model, grid)
        hac = model.covariance == "hac"
        positions = instrument_columns(model, data.columns.shape[1])
        names = model._channel_names(positions)
        outside = data.columns[:, positions]
        found = estimate(output, inputs, outside, begin, end, model.orders_, model.dt_, names, hac)
        if not found.converged:
            warnings.warn(
                f"The instrumental-variable estimate has not converged after {found.n_rounds} "
                "rounds; the instruments may be weak. Compare its standard errors with "
                "method='ols'.",
                ConvergenceWarning,
                stacklevel=4,
            )
        model.n_rows_missing_ = found.n_missing
        signals = np.column_stack([inputs, outside])
        model._report_missing(grid, signals, output, found.n_rows, [*model.inputs_, *names])
        _show(model, found.theta, found.covariance, found.noise_variance, found.n_rows)
        return cls(hac, Beginning.seen(model, grid, inputs, output), names)

    def summary(self, model: ARXRegressor) -> ModelSummary:
        return batch_summary(model, hac=self.hac, instruments=self.instruments)


@dataclass(frozen=True)
class SimulationError:
    """Coefficients and effects that minimise the error of simulation, and predict by it."""

    simulation: Simulation

    @staticmethod
    def estimated(model: ARXRegressor, data: DataToFit) -> Strategy:
        prepared = prepared_for(model, data)
        fitted = first_model(prepared, Effects.of(model.effects))
        fitted, noise = likelihood_fit(fitted, Criterion(prepared.record))
        return SimulationError.taken_over(model, prepared, fitted, noise)

    @staticmethod
    def taken_over(
        model: ARXRegressor, prepared: Prepared, fitted: Model, noise: RemnantModel
    ) -> Strategy:
        """Show estimates; those of a search that found no effect are of a linear model."""
        simulation = simulation_of(model, prepared, fitted, noise)
        model.n_rows_missing_ = prepared.n_missing
        model.orders_ = Orders.of(model.na, model.nb, model.nk, 1, bool(model.fit_intercept))
        model.noise_variance_ = fitted.sse / max(fitted.fit.n - fitted.theta.size, 1)
        _show_coefficients(
            model,
            fitted.theta[: model.orders_.n_params].copy(),
            simulation.covariance.to_numpy(),
        )
        linear = not len(fitted.effects)
        if not linear:
            return SimulationError(simulation)
        held = simulation.begins == HELD
        begins = Beginning(simulation.initial, held, simulation.levels)
        return LinearSimulationError(simulation, begins)

    def free_run(self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        return self.simulation.free_run(model, grid, values)

    def run_from(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray
    ) -> np.ndarray:
        return self.simulation.run_from(model, grid, values, output, self.simulation.initial)

    def ahead(
        self,
        model: ARXRegressor,
        grid: ModelGrid,
        values: np.ndarray,
        output: np.ndarray,
        horizon: int,
    ) -> np.ndarray:
        free = self.free_run(model, grid, values)
        return forecast(free, output, segments(grid), model.noise_ar_, horizon)

    def one_step_errors(self, model: ARXRegressor, X: Any, y: Any) -> np.ndarray:
        grid, values = model._read_X(X, reset=False)
        output = grid.thin_output(model._read_y(X, y))
        return output - self.ahead(model, grid, values, output, 1)

    def simulated(
        self, model: ARXRegressor, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        if output is None:
            return self.simulation.from_rest(model, grid, values)
        return self.simulation.run_from(model, grid, values, output, ESTIMATE)

    def summary(self, model: ARXRegressor) -> ModelSummary:
        return simulated_summary(model, self.simulation)


@dataclass(frozen=True)
class LinearSimulationError(AnswersByEquation):
    """Coefficients that minimise the error of simulation without effects."""

    simulation: Simulation
    begins: Beginning

    def summary(self, model: ARXRegressor) -> ModelSummary:
        return simulated_summary(model, self.simulation)


def _begun(model: ARXRegressor, grid: ModelGrid) -> tuple[np.ndarray, np.ndarray]:
    """Set orders and names of the coefficients; return the stretches to regress on."""
    model._set_orders(grid)
    model.parameter_names_ = model.orders_.parameter_names(model.inputs_)
    return grid.begin[grid.measured], grid.end[grid.measured]


def _show(
    model: ARXRegressor, coef: np.ndarray, covariance: np.ndarray, variance: float, n_rows: int
) -> None:
    """Set the attributes of an estimate by the equation error."""
    for name in ONLY_SIMULATED:  # from an earlier fit with effects
        if hasattr(model, name):
            delattr(model, name)
    model.n_rows_used_, model.noise_variance_ = n_rows, variance
    _show_coefficients(model, coef, covariance)
    model.effects_ = Effects([])
    model.parameters_ = arx_parameter_table(
        model.parameter_names_, coef, model.standard_errors_, model._coefficient_units()
    )


def _show_coefficients(model: ARXRegressor, coef: np.ndarray, covariance: np.ndarray) -> None:
    """Set coefficients, and a covariance of them and of what else was estimated."""
    orders = model.orders_
    model.parameter_names_ = orders.parameter_names(model.inputs_)
    model.coef_, model.covariance_ = coef, covariance
    model.standard_errors_ = np.sqrt(np.diag(covariance))[: orders.n_params]
    model.a_, _, model.intercept_ = orders.split(coef)
    model.b_ = orders.input_rows(coef)


def instrument_columns(model: Any, n_columns: int, what: str = "method='iv'") -> list[int]:
    """Columns of the external signals; ``what`` needs them."""
    names = model._names or list(range(n_columns))
    if model.instruments is not None:
        positions = input_columns(
            names, n_columns, model.instruments, model._run, what="instruments"
        )
    else:
        positions = [i for i, n in enumerate(names) if is_external(role_of(n, model.roles))]
    if not positions:
        raise ValueError(
            f"{what} needs external signals in X, such as the target f_t or a disturbance. "
            f"Name them with instruments=[...]; the columns are {names}."
        )
    inside = [names[p] for p in positions if p in model._columns]
    if inside:
        raise ValueError(
            f"{inside[0]!r} is an input and cannot be its own instrument; instruments are "
            "signals from outside the loop, such as f_t. If it is one, OLS has no bias to cure."
        )
    return positions


def _check_rank(
    model: ARXRegressor, triangle: Triangle, inputs: np.ndarray, output: np.ndarray
) -> None:
    null_space = triangle.null_space()
    if len(null_space):
        finite = ~np.isnan(inputs).any(axis=1) & ~np.isnan(output)
        raise rank_error(
            null_space,
            model.parameter_names_,
            model.inputs_,
            inputs[finite].astype(np.float64),
            output[finite].astype(np.float64),
            model._output_name,
            model.orders_,
        )
