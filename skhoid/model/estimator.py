"""The base of models with effects: estimation by simulation, attributes and predictions.

Look here to change how such a model is fitted, or to build one on a core of your own (``GreyBox``).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.utils.validation import check_is_fitted

from .._sklearn import DT, Interval, fit_context
from ..arx.base import ESTIMATE, HELD, REST, first_measured, pays
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.parameter import CoreKind, ScaledParameter
from ..effects.record import Record
from ..exceptions import UsageError
from ..human import ELEMENT, ControlledElement, LinearElement
from ..human.controlled_element import simplify
from ..parameters import Kind, ParameterTable
from ..preprocessing.grid import ModelGrid
from ..regression import RunRegressor, check_segments
from ..runs import run_column
from ..runs.roles import EXACT, roles_of
from ..text import (
    VAF_RULE,
    ModelSummary,
    estimates_table,
    quantity,
)
from .element import adopt_element, estimate_element
from .extend import extended, refit_each_beside, refit_on_all_runs
from .fitting import Criterion, RemnantModel, minimise, sse_at, take_some_runs
from .initial import LASTING, begin_where_it_pays, find_error
from .likelihood import collect_prior, likelihood_fit, make_criterion
from .model import AT_BOUND, Model
from .parameters import (
    difference_notes,
    effects_with_values,
    move_parameters,
    parameter_table,
)
from .prepared import (
    Prepared,
    SegmentColumns,
    SimulatedCore,
    build_record,
    check_moving,
    check_rows,
    choose_beginning,
    mark_measured,
)
from .simulator import Simulator, list_parameters
from .uncertainty import estimate_covariance, find_profile_intervals

# Times the squares of a minimum: another is lower, not only better reached (fits end within 1e-5).
ANOTHER = 0.999
SAME_VAF = 1.0  # point on the fitted rows, that predictions by the parameters shown may lose


@dataclass(frozen=True)
class Simulation:
    """Estimates of a core with effects, and what free runs and texts also need.

    ``effects`` have None for what was estimated, as ``theta`` has it; ``spread`` are standard
    deviations of the channels and of the output "u", ``duration`` is that of the longest run (s).
    Free runs are those of ``predicting``, where it is not None.
    """

    spec: SimulatedCore
    effects: Effects
    theta: np.ndarray
    covariance: pd.DataFrame
    output: str
    units: dict[str, str]
    channels: list[int]
    roles: dict[str, str]
    settling: float
    n_residuals: int
    rmse: float
    duration: float
    spread: dict[str, float]
    initial: str | None
    begins: str
    levels: tuple[float, float]
    begun: float = 0.0
    predicting: np.ndarray | None = None

    def run(self, record: Record, begins: str | None = None) -> np.ndarray:
        """Free run (n_samples, n_runs) from rest, or as the fit found that runs begin."""
        how = begins or self.begins
        begun = replace(record, initial=how, levels=self.levels, begun=self.begun)
        theta = self.theta if self.predicting is None else self.predicting
        return Simulator(self.spec.core, self.effects, begun).run(theta)

    def run_from(self, record: Record, known: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Free run from states that fit the first seconds; by default in runs that show them."""
        free = self.run(record)
        if self.initial == REST:
            return free
        record = replace(record, y=y, known=known, remembered={})
        fitted = self.run(replace(record, known=first_measured(known, record.dt)), ESTIMATE)
        return begin_where_it_pays(record, free, fitted) if self.initial is None else fitted


class GreyBox(RunRegressor):
    """A core with effects, simulated, whose parameters are estimated by maximum likelihood.

    A subclass has the parameters ``inputs``, ``effects``, ``roles``, ``controlled_element``,
    ``settling``, ``dt`` and ``run``, and says in ``_simulated_core`` what the core is and how it is
    fitted without effects. Searches take it.
    """

    effects: Any
    controlled_element: Any
    settling: float
    parameter_table_: ParameterTable
    simulation_: Simulation
    vaf_: float
    initial: str | None = None  # how simulations begin, where a user may say so
    _takes_first = True  # channel, where none has the role e
    _fixed_core = False  # whether parameters of the core stay as fitted

    _parameter_constraints: dict = {
        "inputs": ["array-like", str, int, None],
        "effects": [Effect, Effects, str, list, tuple, None],
        "roles": [dict, None],
        "controlled_element": ELEMENT,
        "settling": [Interval(Real, 0, None, closed="left")],
        "start": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    def _simulated_core(self) -> SimulatedCore:
        raise NotImplementedError

    def set_params(self, **params: Any) -> Any:
        """Set parameters, of effects and of what else is nested by ``<name>__<parameter>``.

        Parameters
        ----------
        **params : dict
            Values; effects given by name have no parameters.
        """
        nested = next((name for name in params if name.startswith("effects__")), None)
        effects = params.get("effects", self.effects)
        if nested is not None and not hasattr(effects, "set_params"):
            raise ValueError(
                f"{nested} cannot be set: effects={effects!r} has no parameters of its own. Give "
                f"effects as objects instead: "
                f"effects=skhoid.effects.Effects.of({'...' if effects is None else repr(effects)})."
            )
        return super().set_params(**params)

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> Any:
        """Estimate all parameters.

        Runs also weigh less by how much more remnant they have than others, beside their weights.

        Parameters
        ----------
        {X, y, sample_weight}
        """
        prepared = self.prepare(X, y, sample_weight)
        first = self.first_fit(prepared)
        found = likelihood_fit(first, Criterion(prepared.record))
        self._take_over(prepared, *found, first.theta)
        return self

    def _take_over(
        self, prepared: Prepared, model: Model, noise: RemnantModel, least_error: np.ndarray
    ) -> None:
        """Set the attributes of a fit that began at parameters of the ``least_error``."""
        self._set_estimates(prepared, model, noise)
        criterion = Criterion(model.simulator.record)
        plain = model.refined(criterion)
        # Where much is missing, the likeliest parameters may lie in another valley of the error.
        if sse_at(model.simulator, criterion, least_error) < ANOTHER * plain.sse:
            plain = model.at(least_error).refined(criterion)
        self.simulation_parameters_ = tabulate_least_error(plain, criterion, prepared)
        vaf = vaf_of_output(plain.simulator.record, plain.simulator.run_ahead(plain.theta))
        if vaf - self.vaf_ > SAME_VAF:
            rmse = self.simulation_.rmse * np.sqrt((100 - vaf) / (100 - self.vaf_))
            self.simulation_ = replace(self.simulation_, predicting=plain.theta, rmse=float(rmse))
            self.vaf_ = vaf

    def by_likelihood(self) -> Any:
        """This fitted model, predicting by ``parameters_`` even where others simulate better."""
        simulation = self.simulation_
        if simulation.predicting is None:
            return self
        taken = copy.copy(self)
        taken.simulation_ = replace(simulation, predicting=None)
        return taken

    def _set_estimates(self, prepared: Prepared, model: Model, noise: RemnantModel) -> None:
        record = model.simulator.record
        criterion = Criterion(record, noise)
        intervals = {}
        if record.core != CoreKind.ARX:
            own = make_criterion(model, noise)
            covariance = estimate_covariance(
                model.simulator, own, model.fit, collect_prior(model.simulator)
            )
            intervals = find_profile_intervals(model, own, covariance)
        else:
            covariance = model.covariance()
        n, output = criterion.n, model.simulator.run_ahead(model.theta)
        self.noise_ar_ = noise.ar
        self.loglik_ = -0.5 * n * float(np.log(max(model.sse, 1e-300) / n))
        self.bic_ = -2 * self.loglik_ + model.n_parameters * float(np.log(n))
        self.n_rows_used_ = int(record.known.sum())
        self.vaf_ = vaf_of_output(record, output)
        self.parameter_table_ = parameter_table(
            model.simulator,
            model.theta,
            covariance,
            prepared.units,
            prepared.spec.given,
            intervals,
        )
        self.parameters_ = self.parameter_table_.estimates()
        self.effects_ = effects_with_values(model)
        names = model.simulator.names
        self.covariance_ = pd.DataFrame(covariance, index=names, columns=names)
        self.simulation_ = Simulation(
            spec=prepared.spec,
            effects=model.effects,
            theta=model.theta,
            covariance=self.covariance_,
            output=prepared.output,
            units=self._units,
            channels=prepared.channels,
            roles=prepared.roles,
            settling=self.settling,
            n_residuals=n,
            rmse=float(np.sqrt(np.mean((record.y - output)[record.known] ** 2))),
            duration=record.duration,
            spread={name: record.sd(name) for name in (*record.channels, "u")},
            **self._first_samples(prepared, model),
        )

    def _first_samples(self, prepared: Prepared, model: Model) -> dict[str, Any]:
        """How free runs begin: from rest, or from where inputs held at their first values have led.

        By default from rest, unless the fitted rows show otherwise. An integral begins at the level
        that suits all of them best.
        """
        simulator = model.simulator
        record = replace(simulator.record, known=prepared.measured, remembered={})
        assert record.y is not None
        initial = self.initial if simulator.core.has_states else REST
        y = record.y[record.known]
        levels = float(y.min()), float(y.max())

        def run(way: str, begun: float) -> np.ndarray:
            begun_so = replace(record, y=None, initial=way, levels=levels, begun=begun)
            return np.asarray(simulator.beside(begun_so).run(model.theta))

        rest, level = REST, 0.0
        if simulator.lasts and record.initial != REST:
            rest, at_zero = LASTING, run(LASTING, 0.0)
            one, left = ((x - at_zero)[record.known] for x in (run(LASTING, 1.0), record.y))
            level = float(one @ left / max(one @ one, 1e-300))
        begins = rest if initial == REST else HELD
        if initial is None:
            at_rest, held = (find_error(record, run(way, level)) for way in (rest, HELD))
            begins = HELD if pays(at_rest, held, y) else rest
        is_at_rest = begins == REST and not simulator.estimates_start
        self.initial_ = REST if is_at_rest else ESTIMATE
        return {
            "initial": initial if is_at_rest else ESTIMATE,
            "begins": begins,
            "levels": levels,
            "begun": level,
        }

    def with_effect(self, effect: Any) -> Any:
        """A new, unfitted model with one more effect: fit it to add the effect.

        Parameters
        ----------
        effect : Effect, Effects or str
            An effect, several as ``a + b``, or an id of the catalogue. The second effect of a kind
            is called ``dead_zone-2``.
        """
        return clone(self).set_params(effects=Effects.of(self.effects) + effect)

    def with_parameters(self, values: Mapping[str, float]) -> Any:
        """This fitted model with other values of some of its parameters; nothing is refitted.

        What was moved has no standard error, and what was found at the estimates (``vaf_``,
        ``loglik_``, ``bic_``) is gone.

        Parameters
        ----------
        values : dict of str to float
            Values by the names of ``parameters_``, such as ``{"dead_zone__width": 0.3}``: those
            that were estimated or, of effects, given. Of a SimulatedARX only those of effects.

        Examples
        --------
        >>> from skhoid import OperatorRegressor, make_tracking_runs
        >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.05, random_state=1)
        >>> model = OperatorRegressor(effects=["bias"]).fit(X, y)
        >>> moved = model.with_parameters({"bias__level": 0.02})
        >>> bool(moved.score(X, y) < model.score(X, y))
        True
        """
        check_is_fitted(self)
        if self._fixed_core and not len(self.effects_):
            raise ValueError(
                f"This {type(self).__name__} has no effects, and only parameters of effects can be "
                "moved: add one by with_effect(...), and fit."
            )
        return move_parameters(self, values, self._fixed_core)

    def with_table(self, table: ParameterTable) -> Any:
        """A new, unfitted model that a fit completes as a table says.

        Starts that the table names are tried beside the model's own.

        Parameters
        ----------
        table : ParameterTable
            ``parameter_table_`` of this fitted model, after :meth:`~ParameterTable.fix` and
            :meth:`~ParameterTable.vary`. What it fixes is given to effects, with the form and the
            channel that the fit chose; of the core of an operator only ``tau_e`` can be given.

        Examples
        --------
        >>> from skhoid import OperatorRegressor, make_tracking_runs
        >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.05, random_state=1)
        >>> model = OperatorRegressor(effects=["bias"]).fit(X, y)
        >>> model.with_table(model.parameter_table_.fix("bias__level", 0.0)).effects
        Effects(steps=[('bias', Bias(level=0.0))])
        """
        check_is_fitted(self)
        steps = []
        for name, effect in self.simulation_.effects:
            rows = {p.name: table[f"{name}__{p.name}"] for p in effect.parameters}
            given = {key: None if one.free else one.value for key, one in rows.items()}
            steps.append((name, effect.with_choices(**given)))
        fixed = {
            name: one.value
            for name, one in table.items()
            if one.kind is Kind.GIVEN and "__" not in name
        }
        start = {
            name: one.start for name, one in table.items() if one.free and np.isfinite(one.start)
        }
        model = clone(self).set_params(effects=Effects(steps))
        if start:
            model.set_params(start=start)
        return model._with_given_core(fixed)

    def _with_given_core(self, given: Mapping[str, float]) -> Any:
        """The unfitted model with some parameters of its core given."""
        if given:
            raise ValueError(
                f"{', '.join(given)}: parameters of the core of {type(self).__name__} cannot be "
                "fixed. Let them vary, and fix parameters of effects."
            )
        return self

    def prepare(self, X: Any, y: Any, sample_weight: Any = None) -> Prepared:
        """Read data for :meth:`first_fit`, as runs side by side; searches call it.

        Parameters
        ----------
        {X, y, sample_weight}
        """
        data = self._read_data(X, y, "all", in_parts=True, sample_weight=sample_weight)
        grid, _, output, thinned, values, known, weights = data
        if self._takes_first and self.inputs is None and len(self._columns) > 1:
            # None has the role e.
            self._columns, self.inputs_ = self._columns[:1], self.inputs_[:1]
        if len(self._columns) != 1:
            raise UsageError(
                f"{type(self).__name__} with effects responds to one channel, but got inputs="
                f"{self.inputs_}. Effects may use the other columns.",
                hint='Name it by inputs=["..."].',
                options=["input"],
            )
        columns = self._reading.names or list(range(values.shape[1]))
        skipped = None if self._reading.run is None else run_column(columns, self._reading.run)
        channels = [i for i in range(values.shape[1]) if i != skipped]
        names = self._channel_names(channels)
        found = roles_of([columns[i] for i in channels], self.roles)
        roles = dict(zip(names, found.values(), strict=True))
        error, output_name = self.inputs_[0], self.output_name
        roles[error] = "e"
        held = self._hold(grid, thinned, channels, names)
        check_segments(grid, round(self.settling / grid.dt))
        given = self.controlled_element
        record, sides = build_record(
            grid,
            names,
            held,
            roles,
            self.inputs_,
            output=output,
            weights=weights,
            settling=self.settling,
        )
        if given is not None:
            some = take_some_runs(record) or record
            record = replace(record, controlled_element=adopt_element(given, some))
        spec = self._simulated_core()
        if spec.check is not None:
            spec.check(grid)
        spec = replace(spec, core=spec.core.chosen(record))
        record = spec.core.add_to_record(record)
        begins = choose_beginning(spec.core, record, self.initial, self.settling)
        record = replace(record, initial=begins)
        check_rows(record, len(spec.core.parameters), grid, self.settling)
        check_moving(record, thinned[:, self._columns[0]], error, output_name)
        if given is None:
            some = take_some_runs(record) or record
            record = replace(record, controlled_element=estimate_element(some))
        element = record.controlled_element
        self.controlled_element_ = None if element is None else simplify(element)
        units = self._units
        return Prepared(
            spec=spec,
            record=record,
            columns=sides,
            grid=grid,
            table=values,
            names=columns,
            channels=channels,
            roles=roles,
            units={"u": units.get(output_name), "e": units.get(error)}
            | {f"[{role}]": units.get(name) for name, role in roles.items() if role in EXACT}
            | {f"[{name}]": unit for name, unit in units.items()},
            n_missing=int(np.isnan(data.told).sum()),
            output=output_name,
            measured=mark_measured(grid, sides, output),
            known=known,
        )

    def first_fit(self, prepared: Prepared) -> Model:
        """Fit the core with the model's effects, by the simulation error alone.

        Parameters
        ----------
        prepared : Prepared
            What :meth:`prepare` returned.
        """
        return fit_first_model(prepared, Effects.of(self.effects))

    def with_fit(
        self, prepared: Prepared, fitted: Model, noise: RemnantModel, least_error: np.ndarray
    ) -> Any:
        """A new estimator with the same settings that takes the given estimates.

        Parameters
        ----------
        prepared : Prepared
            What the last call of :meth:`prepare` on this estimator returned.
        fitted : Model
            Estimates of the core and of any effects.
        noise : RemnantModel
            Model of the remnant under which they were found.
        least_error : ndarray
            Parameters of the least simulation error, from which they were found.
        """
        taken = copy.copy(self).set_params(**clone(self).get_params(deep=False))
        taken.keep_parameters()
        taken._take_over(prepared, fitted, noise, least_error)
        return taken

    def free_run(self, prepared: Prepared) -> np.ndarray:
        """Predict from data that have been read already: the same as ``predict(X)``.

        Parameters
        ----------
        prepared : Prepared
            What :meth:`prepare` returned for X and y.
        """
        found = self._free_run(prepared.grid, prepared.table)
        return prepared.grid.to_full_rate(found)

    def _rows_to_forget(self, dt: float) -> int:
        return max(round(self.simulation_.settling / dt), super()._rows_to_forget(dt))

    def make_record(self, X: Any) -> Record:
        """Channels of runs as a record, as simulations of this fitted model take them.

        Parameters
        ----------
        {X}
        """
        return self._record(*self._read_X(X, reset=False))[0]

    def _record(self, grid: ModelGrid, values: np.ndarray) -> tuple[Record, SegmentColumns]:
        """Data to predict as a record."""
        simulation, element = self.simulation_, self.controlled_element_
        names = self._channel_names(simulation.channels)
        record, columns = build_record(
            grid,
            names,
            self._hold(grid, grid.thin_inputs(values), simulation.channels, names),
            simulation.roles,
            self.inputs_,
            controlled_element=None if element is None else LinearElement.of(element),
        )
        return simulation.spec.core.add_to_record(record), columns

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        record, columns = self._record(grid, values)
        return columns.rows(self.simulation_.run(record))

    def _run_from(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        record, columns = self._record(grid, values)
        known, y = mark_measured(grid, columns, output), columns.beside(np.nan_to_num(output))
        return columns.rows(self.simulation_.run_from(record, known, y))

    def summary_table(self) -> ModelSummary:
        simulation, element = self.simulation_, self.controlled_element_
        facts = {
            "Model": simulation.spec.description,
            "Effects": ", ".join(self.effects_.names) or "none",
            **self._signal_facts(),
            "Method": "maximum likelihood",
            "Rows": f"{self.n_rows_used_}",
            "Runs": f"{self._n_runs}",
            **self._grid_facts(),
            "Residuals": f"{simulation.n_residuals} in the likelihood",
            "Settling": f"{simulation.settling:g} s left out",
            **self._fit_facts(),
            "Noise model": f"AR({len(self.noise_ar_)})",
        }
        if element is not None:
            facts["Element"] = (
                f"K_c = {element.K_c:.4g}, omega_b = {element.omega_b:.4g} rad/s"
                if isinstance(element, ControlledElement)
                else str(element)
            )
        notes = [
            simulation.spec.errors_note,
            "They do not allow for effects that the model lacks: see compare and EffectSearchCV.",
            "VAF and RMSE are those of the fitted rows; summary(X, y) gives the VAF of others. "
            f"{VAF_RULE} Log-likelihood and BIC are without constants.",
        ]
        notes += [
            f"{name} is in the unit of the signal behind {' and '.join(one.behind)}, which is not "
            "that of the recorded one."
            for name, one in self.parameter_table_.items()
            if isinstance(one, ScaledParameter) and one.behind
        ]
        table = self.parameters_
        if not (table["sd"] > 0).all():
            notes.append(
                "A dash in place of a standard error: given, at a bound, or not determined."
            )
        vague = [name for name, one in self.parameter_table_.items() if one.is_vague]
        if vague:
            notes.append(
                f"These runs do not determine {', '.join(vague)}: the standard error exceeds the "
                "value. An effect that the model lacks may be why."
            )
        notes += delay_notes(table, getattr(simulation.spec.core, "least", 0.0))
        least_error = getattr(self, "simulation_parameters_", None)  # of an operator
        if least_error is not None:
            notes += difference_notes(table, least_error, simulation.predicting is not None)
        return ModelSummary(
            f"{type(self).__name__}: {simulation.output} from {self.inputs_[0]}",
            facts,
            estimates_table(table),
            [
                *notes,
                *(f"{n}: {e.physics_in('human')} {e.formula}" for n, e in self.effects_),
            ],
        )

    def _fit_facts(self) -> dict[str, str]:
        """How good the fit is, as long as the parameters are those of the fit."""
        if not hasattr(self, "vaf_"):
            return {"Fit": "none: parameters were moved by hand"}
        return {
            "VAF, fit": f"{self.vaf_:.1f} % (free run)",
            "RMSE, fit": quantity(self.simulation_.rmse, self._units.get(self.output_name))
            + " (free run)",
            "Log-likelihood": f"{self.loglik_:.1f}",
            "BIC": f"{self.bic_:.1f}",
        }


def fit_first_model(prepared: Prepared, effects: Effects) -> Model:
    """The core with effects at the minimum of the simulation error.

    Of a large number of runs, some are fitted first from all starts, and then all from the best.
    """
    record, core = prepared.record, prepared.core
    some = take_some_runs(record)
    if some is not None:
        return refit_on_all_runs(fit_first_model(replace(prepared, record=some), effects), record)
    criterion = Criterion(record)
    start = prepared.spec.start
    for name, effect in effects:
        reason = effect.refusal(record, core.kind)
        if reason is not None:
            raise ValueError(f"The effect {name} does not apply: {reason}.")
    variants = [(name, v) for name, effect in effects for v in effect.variants(record)]
    table = ParameterTable(list_parameters(core, variants, record))
    start = table.checked(start, list(table))
    found = record.once(
        ("first fit", id(core)), lambda: prepared.spec.estimated(core, record, criterion)
    )
    model = try_user_start(found, criterion, start)
    coarse = criterion.coarse()
    for name, effect in effects:
        given = {n: v for n, v in start.items() if n.startswith(f"{name}__") or "__" not in n}
        model = extended(model, name, effect, criterion, coarse, start=given)
    templates = {effect.name: effect for _, effect in effects}
    model = refit_each_beside(model, templates, criterion, coarse)
    return try_user_start(model, criterion, start)


def try_user_start(model: Model, criterion: Criterion, start: Mapping[str, float]) -> Model:
    """The model, or the one reached from a user's start where that is better."""
    if not start:
        return model
    simulator = model.simulator
    values = {**model.values(), **start}
    theta = np.array([values[name] for name in simulator.names])
    fit = minimise(simulator, criterion, theta)
    return Model(simulator, fit, model.other_cores) if fit.sse < model.sse else model


def vaf_of_output(record: Record, output: np.ndarray) -> float:
    """VAF in percent over what is known."""
    assert record.y is not None
    y, error = record.y[record.known], (record.y - output)[record.known]
    power = float(y @ y)
    return 100.0 * (1.0 - float(error @ error) / power) if power > 0 else 0.0


def delay_notes(table: pd.DataFrame, least: float) -> list[str]:
    """What to say about a delay that is at the least there is, or shorter."""
    if "tau_e" not in table.index:
        return []
    value, sd = float(table.loc["tau_e", "value"]), float(table.loc["tau_e", "sd"])
    if sd == 0.0 and value < least:
        return [f"The delay given, {value:.2f} s, is below the least of people, {least:.2f} s."]
    if sd != 0.0 and value <= least * (1 + AT_BOUND):
        return [
            f"tau_e is at its lower bound, {least:.2f} s, the least of a person. The fit would "
            "make it shorter still: a machine responds, something else responds at once, or "
            "channels are misaligned."
        ]
    return []


def tabulate_least_error(model: Model, criterion: Criterion, prepared: Prepared) -> pd.DataFrame:
    """Table of the parameters of a model at its smallest simulation error.

    Standard errors allow for a remnant of any colour, but not for a bias.
    """
    covariance = estimate_covariance(model.simulator, criterion, model.fit)
    table = parameter_table(
        model.simulator, model.theta, covariance, prepared.units, prepared.spec.given
    )
    return table.estimates()
