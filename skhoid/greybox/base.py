"""What models with effects share: data, fitting, results and prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects.composition import Effects
from ..effects.record import Record
from ..exceptions import RankDeficiencyError, ShortRunError
from ..human.controlled_element import ControlledElement
from ..preprocessing.grid import ModelGrid
from ..regression import RunRegressor, bad_output, still
from ..runs import run_column
from ..runs.roles import roles_of
from ..summaries import Summary
from .cores import Core
from .element import estimate_element
from .estimates import covariance_frame, effects_with_values, parameter_table
from .extend import beside_each_other, extended
from .fitting import AR_ORDER, Criterion, RemnantModel, covariance_of
from .model import Model
from .operator_summary import simulated_summary
from .side_by_side import SegmentColumns, build_record
from .simulator import Simulator

N_LIKELIHOOD = {"operator": 12, "arx": 2}  # rounds of noise model and refinement, at most
WORSE = 1.01  # squares of the simulation error by those of the round before, at most
SETTLED = 1e-3  # of n log(SSE), by which a round must move the estimates to go on


@dataclass(frozen=True)
class Prepared:
    """Data as a record, where its columns come from, and the core."""

    record: Record
    core: Core
    columns: SegmentColumns
    grid: ModelGrid

    @property
    def run_of_columns(self) -> np.ndarray:
        """Number of the run that each column is a part of."""
        first = self.columns.begin
        rows = first if self.grid.rows is None else self.grid.rows[first]
        return self.grid.layout.run_of(rows)


class GreyBox(RunRegressor):
    """A core with effects, simulated, whose parameters are estimated by maximum likelihood.

    A subclass says what the core is, and how it is fitted without effects.
    """

    effects: Any
    controlled_element: ControlledElement | None
    settling: float
    _takes_first = True  # channel, where none has the role e
    _errors_in_words: str

    def _core(self) -> Core:
        raise NotImplementedError

    def _fitted_core(self, core: Core, record: Record, criterion: Criterion) -> Model:
        """The core at the minimum of the simulation error, without effects."""
        raise NotImplementedError

    def _core_in_words(self) -> str:
        raise NotImplementedError

    def _given_values(self) -> dict[str, float]:
        """Parameters of the core that are given, for the table."""
        return {}

    def with_effect(self, effect: Any) -> Any:
        """A new, unfitted model with one more effect: fit it to add the effect.

        Parameters
        ----------
        effect : Effect, Effects or str
            An effect, several as ``a + b``, or an id of the catalogue.

        Returns
        -------
        model : estimator
            A clone whose ``effects`` is a composition with fixed names: the second effect
            of a kind is called ``dead_zone-2``.
        """
        return clone(self).set_params(effects=Effects.of(self.effects) + effect)

    def _prepare(self, X: Any, y: Any) -> Prepared:
        """Read data to fit."""
        grid, _, output, values = self._read_data(X, y)
        if self._takes_first and self.inputs is None and len(self._columns) > 1:
            # None has the role e.
            self._columns, self.inputs_ = self._columns[:1], self.inputs_[:1]
        if len(self._columns) != 1:
            raise ValueError(
                f"{type(self).__name__} with effects answers one channel and gets {self.inputs_}. "
                'Name it by inputs=["..."]; effects use the other columns.'
            )
        columns = self._names or list(range(values.shape[1]))
        skipped = None if self._run is None else run_column(columns, self._run)
        self._channels = [i for i in range(values.shape[1]) if i != skipped]
        names = self._channel_names(self._channels)
        found = roles_of([columns[i] for i in self._channels], self.roles)
        self._roles = dict(zip(names, found.values(), strict=True))
        self._roles[self.inputs_[0]] = "e"
        held = self._hold(grid, values[:, self._channels], names)
        given = self.controlled_element
        element = None if given is None else constants_of(given)
        record, columns = build_record(
            grid,
            names,
            held,
            self._roles,
            self.inputs_,
            output=output,
            settling=self.settling,
            controlled_element=element,
        )
        core = self._core()
        record = core.on(record)
        check_rows(record, len(core.parameters), grid, self.settling)
        check_moving(record, values[:, self._columns[0]], self.inputs_[0], self._output_name)
        if given is None:
            element = estimate_element(record)
            record = replace(record, controlled_element=element)
        self.controlled_element_ = None if element is None else ControlledElement(*element)
        return Prepared(record, core, columns, grid)

    def _first_model(self, prepared: Prepared) -> Model:
        """The model with the effects it has, at the minimum of the simulation error."""
        record, core = prepared.record, prepared.core
        criterion = Criterion(record)
        model = self._fitted_core(core, record, criterion)
        coarse = criterion.coarse()
        for name, effect in Effects.of(self.effects):
            reason = effect.refusal(record, core.kind)
            if reason is not None:
                raise ValueError(f"The effect {name} does not apply: {reason}.")
            model = extended(model, name, effect, criterion, coarse)
        templates = {effect.name: effect for _, effect in Effects.of(self.effects)}
        return beside_each_other(model, templates, criterion, coarse)

    def _fit_with_effects(self, X: Any, y: Any) -> None:
        prepared = self._prepare(X, y)
        model = self._first_model(prepared)
        self._set_model(likelihood_fit(model, Criterion(prepared.record)))

    def _set_model(self, fitted: tuple[Model, RemnantModel]) -> None:
        """Take over a fitted model."""
        model, noise = fitted
        record = model.simulator.record
        self._settling = self.settling
        criterion = Criterion(record, noise)
        self._theta, self._chosen = model.theta, model.effects
        self._duration = record.duration
        self._spread = {name: record.sd(name) for name in (*record.channels, "u")}
        if record.core == "operator":
            covariance = covariance_of(model.simulator, criterion, model.fit)
        else:
            covariance = model.covariance()
        self.noise_ar_ = noise.ar
        n = criterion.n
        self.loglik_ = -0.5 * n * float(np.log(max(model.sse, 1e-300) / n))
        self.bic_ = -2 * self.loglik_ + model.n_parameters * float(np.log(n))
        self.n_rows_used_, self._n_residuals = int(record.known.sum()), n
        output = model.output
        self.vaf_ = vaf_of_output(record, output)
        self._rmse = float(np.sqrt(np.mean((record.y - output)[record.known] ** 2)))
        units = {"u": self._units.get(self._output_name), "e": self._units.get(self.inputs_[0])}
        units.update({f"[{name}]": unit for name, unit in self._units.items()})
        self.parameters_ = parameter_table(
            model.simulator, model.theta, covariance, units, self._given_values()
        )
        self.covariance_ = covariance_frame(model.simulator, covariance)
        self.effects_ = effects_with_values(model)

    def _record_of(self, grid: ModelGrid, values: np.ndarray) -> tuple[Record, SegmentColumns]:
        """Data to predict as a record."""
        names = self._channel_names(self._channels)
        held = self._hold(grid, grid.thin_inputs(values)[:, self._channels], names)
        element = self.controlled_element_
        record, columns = build_record(
            grid,
            names,
            held,
            self._roles,
            self.inputs_,
            controlled_element=None if element is None else constants_of(element),
        )
        return self._core().on(record), columns

    def _simulated(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        """Free run on the grid with effects."""
        record, columns = self._record_of(grid, values)
        return columns.rows(Simulator(self._core(), self._chosen, record).run(self._theta))

    def _summary(self) -> Summary:
        return simulated_summary(self)


def constants_of(element: ControlledElement) -> tuple[float, float]:
    """K_c and omega_b of a controlled element that does not vary."""
    K_c, omega_b = element.K_c, element.omega_b
    if callable(K_c) or callable(omega_b):
        raise ValueError(
            "controlled_element must be constant here; got one that varies in time. Pass it at one "
            "instant, controlled_element.at(t), or None to estimate it."
        )
    return float(K_c), float(omega_b)


def likelihood_fit(model: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """Refine under an AR model of the residual, and again under that of the new residual.

    Until neither moves: in a closed loop the first fit is biased, and so is its noise model, which
    holds the bias for some rounds. A wrong model leaves ever more to the noise model instead: after
    two rounds the free run may not become worse than a little. An ARX model gets these two.
    """
    for i in range(N_LIKELIHOOD[model.simulator.record.core]):
        before, noise = model, criterion.noise
        residual = criterion.residual(model.output)
        criterion.set_noise(criterion.remnant_model(model.output))
        model = model.refined(criterion)
        moved = model.theta - before.theta
        if i > 1 and _power(criterion.residual(model.output)) > WORSE * _power(residual):
            criterion.set_noise(noise)
            return before, noise
        if criterion.n * (moved @ model.fit.normal @ moved) < SETTLED * model.sse:
            break
    return model, criterion.noise


def _power(signal: np.ndarray) -> float:
    return float((signal**2).sum())


def check_rows(record: Record, n_parameters: int, grid: ModelGrid, settling: float) -> None:
    """Refuse data that cannot hold the parameters and the noise model."""
    if not record.known.any() and record.y is not None and not record.y.any():
        raise ValueError("Input y contains NaN in all rows: nothing was measured.")
    criterion = Criterion(record, RemnantModel(np.zeros(AR_ORDER), np.ones(record.n_runs)))
    if criterion.n > 0 and criterion.known.sum() > n_parameters:
        return
    counting = (max(AR_ORDER, n_parameters) + 1) * criterion.thin
    # Settling takes a quarter of a run at most.
    needed = min(counting + round(settling / grid.dt), -(-4 * counting // 3))
    seconds = needed * grid.dt
    raise ShortRunError(
        f"{record.known.sum()} rows are left for {n_parameters} parameters and the model of the "
        f"remnant (n_samples = {grid.layout.n_rows} rows of X, of which settling, missing values "
        f"and a run-in take the rest). They need a run of {round(seconds / grid.layout.dt)} rows "
        f"({seconds:.3g} s) without a gap. Use more data, or a smaller settling."
    )


def check_moving(record: Record, values: np.ndarray, name: str, output: str) -> None:
    """Refuse an input or an output that stands still."""
    assert record.y is not None
    found = bad_output(output, record.y[record.known])
    if found is None:
        measured = values[~np.isnan(values)]
        if not measured.size:
            raise ValueError(f"Input {name!r} contains NaN in all rows: nothing was measured.")
        found = still(f"Input {name!r}", measured)
        if found is not None:
            found += ": it excites nothing. Use data in which it moves; is it the right column?"
    if found is not None:
        raise RankDeficiencyError(f"The parameters cannot be estimated. {found}")


def vaf_of_output(record: Record, output: np.ndarray) -> float:
    """VAF in percent over what is known."""
    assert record.y is not None
    y, error = record.y[record.known], (record.y - output)[record.known]
    power = float(y @ y)
    return 100.0 * (1.0 - float(error @ error) / power) if power > 0 else 0.0
