"""The human operator with its physical parameters, estimated by maximum likelihood."""

from __future__ import annotations

from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import clone

from .._sklearn import Interval, fit_context
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..exceptions import ShortRunError
from ..human.controlled_element import ControlledElement
from ..preprocessing.grid import ModelGrid
from ..regression import RunRegressor
from ..runs import run_column
from .controlled_element import estimate_element
from .cores import OperatorCore
from .estimates import covariance_frame, effects_with_values, parameter_table, summary_text
from .fitting import Criterion, Noise
from .lanes import Lanes, build_record, roles_of
from .model import Model, extended, fit_core, operator_starts
from .simulator import Simulator

N_LIKELIHOOD = 2  # rounds of noise model and refinement


class TakesEffects:
    """A model that effects can be added to."""

    effects: Any

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


class OperatorRegressor(TakesEffects, RunRegressor):
    """Human operator with physical parameters, and effects, by maximum likelihood.

    u = H_nm(s) [K_e + K_edot s] exp(-s tau_e) e with the neuromuscular system H_nm(s) = omega_nm^2
    / (s^2 + 2 zeta_nm omega_nm s + omega_nm^2) (Eqs. 3-5), simulated from the measured channels
    alone. All parameters, those of the effects too, minimise the squares of the simulation's
    residual, whitened by an AR model of the remnant: maximum likelihood for Gaussian remnant.

    Parameters
    ----------
    delay : float or None, default=None
        Effective time delay tau_e in seconds, kept as given until the effect ``wrong_delay`` frees
        it; None estimates it.
    inputs : column name or list with one, or None, default=None
        The error. None means the column of role ``e``.
    effects : Effect, Effects, str, list of these, or None, default=None
        What the linear operator lacks; see :mod:`skhoid.effects`.
    roles : dict or None, default=None
        Roles of columns, ``{column: role}``, where names do not tell them: e, x, f_t, or a name
        that begins with motion or dist. Effects may use all columns.
    controlled_element : ControlledElement or None, default=None
        What the operator controls, for effects that use its inverse; None estimates it from
        output and x where needed.
    settling : float, default=3.0
        Seconds at the start of each run (and after each gap) that do not count in the fit, since
        what came before them is not known.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Attributes
    ----------
    parameters_ : DataFrame
        Indexed by parameter: value, sd (standard error), low and high (95 % interval), unit,
        meaning. Parameters of effects are called ``<effect>__<parameter>``. A parameter at a
        bound has no sd.
    effects_ : Effects
        The effects with estimated values and with their choices (form, channel) made.
    covariance_ : DataFrame
        Covariance of the estimated parameters.
    noise_ar_ : ndarray of shape (6,)
        AR model of the remnant at the rate of the criterion (25 Hz, or the sampling rate).
    loglik_ : float
        Logarithm of the likelihood, without constants.
    bic_ : float
        Bayesian information criterion (smaller is better).
    vaf_ : float
        VAF of the free run on the fitted rows, in percent.
    controlled_element_ : ControlledElement or None
        Given or estimated.
    dt_ : float
        Sampling time of the fitted grid in seconds.
    inputs_ : list of str
        Name of the error channel.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    Raises
    ------
    ValueError
        If an effect does not apply to the data, with the reason.

    See Also
    --------
    EffectSearchCV : Finds the effects that are missing.
    operator_parameters : The same parameters from an ARX model.

    Notes
    -----
    Residuals count at 25 Hz, above which operators have no power to speak of; the simulation runs
    at the sampling rate. Runs with more remnant weigh less.

    References
    ----------
    Van Grootheest, thesis, Eqs. 3-5 and its reference [12]: Zaal et al., Modeling human
    multimodal perception and control using genetic maximum likelihood estimation (2009).

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(condition="C1", n_runs=2, remnant_intensity=0.05, random_state=1)
    >>> model = OperatorRegressor().fit(X, y)
    >>> model.parameters_["value"].round(2)[["K_e", "T_L", "tau_e"]].tolist()
    [0.09, 0.4, 0.28]
    >>> model.with_effect("dead_zone").effects
    Effects(steps=[('dead_zone', DeadZone())])
    """

    _parameter_constraints: dict = {
        "delay": [Interval(Real, 0, 10, closed="both"), None],
        "inputs": ["array-like", str, int, None],
        "effects": [Effect, Effects, str, list, tuple, None],
        "roles": [dict, None],
        "controlled_element": [ControlledElement, None],
        "settling": [Interval(Real, 0, None, closed="left")],
        "dt": [Interval(Real, 0, None, closed="neither"), None],
        "run": "no_validation",
    }

    def __init__(
        self,
        delay: float | None = None,
        *,
        inputs: Any = None,
        effects: Any = None,
        roles: dict | None = None,
        controlled_element: ControlledElement | None = None,
        settling: float = 3.0,
        dt: float | None = None,
        run: Any = None,
    ):
        self.delay = delay
        self.inputs = inputs
        self.effects = effects
        self.roles = roles
        self.controlled_element = controlled_element
        self.settling = settling
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> OperatorRegressor:
        """Estimate all parameters.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Output of the operator; NaN where not measured.

        Returns
        -------
        self : OperatorRegressor
        """
        record, core, _ = self._prepare(X, y)
        self._set_model(fit_with_effects(core, Effects.of(self.effects), record))
        return self

    def _core(self) -> OperatorCore:
        return OperatorCore(None if self.delay is None else float(self.delay))

    def _prepare(self, X: Any, y: Any) -> tuple[Record, OperatorCore, Lanes]:
        """Read the data as a record with its lanes, and make the core."""
        grid, _, output, values = self._read_data(X, y)
        if self.inputs is None and len(self._columns) > 1:  # none has the role e
            self._columns, self.inputs_ = self._columns[:1], self.inputs_[:1]
        if len(self._columns) != 1:
            raise ValueError(
                f"OperatorRegressor answers one channel, the error, and gets {self.inputs_}. Name "
                'it by inputs=["..."], or give it the role e; effects use the other columns.'
            )
        skipped = None if self._run is None else run_column(self._names or [], self._run)
        self._channels = [i for i in range(values.shape[1]) if i != skipped]
        names = self._channel_names(self._channels)
        self._roles = roles_of(names, self.roles)
        self._roles[self.inputs_[0]] = "e"
        self._units = {**getattr(X, "attrs", {}).get("units", {})}
        self._units.update(getattr(y, "attrs", {}).get("units", {}))
        held = self._hold(grid, values[:, self._channels], names)
        given = self.controlled_element
        element = None if given is None else (float(given.K_c), float(given.omega_b))
        record, lanes = build_record(
            grid,
            names,
            held,
            self._roles,
            self.inputs_,
            output=output,
            settling=self.settling,
            controlled_element=element,
        )
        check_rows(record, len(self._core().parameters), grid)
        if given is None:
            element = estimate_element(record)
            record = replace(record, controlled_element=element)
        self.controlled_element_ = None if element is None else ControlledElement(*element)
        return record, self._core(), lanes

    def _set_model(self, fitted: tuple[Model, Noise]) -> None:
        """Take over a fitted model."""
        model, noise = fitted
        record = model.simulator.record
        criterion = Criterion(record, noise)
        self._theta, self._chosen = model.theta, model.effects
        covariance = model.covariance()
        self.noise_ar_ = noise.ar
        n = criterion.n
        self.loglik_ = -0.5 * n * float(np.log(max(model.sse, 1e-300) / n))
        self.bic_ = -2 * self.loglik_ + model.n_parameters * float(np.log(n))
        self.vaf_ = vaf_of_output(record, model.output)
        fixed = {} if self.delay is None else {"tau_e": float(self.delay)}
        units = {"u": self._units.get(self._output_name), "e": self._units.get(self.inputs_[0])}
        units.update({f"[{name}]": unit for name, unit in self._units.items()})
        self.parameters_ = parameter_table(model.simulator, model.theta, covariance, units, fixed)
        self.covariance_ = covariance_frame(model.simulator, covariance)
        self.effects_ = effects_with_values(model)

    def _record_of(self, grid: ModelGrid, values: np.ndarray) -> tuple[Record, Lanes]:
        names = self._channel_names(self._channels)
        held = self._hold(grid, grid.thin_inputs(values)[:, self._channels], names)
        element = self.controlled_element_
        return build_record(
            grid,
            names,
            held,
            self._roles,
            self.inputs_,
            controlled_element=None if element is None else (element.K_c, element.omega_b),  # type: ignore[arg-type]
        )

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        record, lanes = self._record_of(grid, values)
        simulator = Simulator(self._core(), self._chosen, record)
        return lanes.rows(simulator.run(self._theta))

    def summary(self) -> str:
        """Parameters with their intervals, effects and goodness of fit, as text.

        Returns
        -------
        text : str
        """
        self._check_fitted()
        return summary_text(self)


def fit_with_effects(core: Any, effects: Effects, record: Record) -> tuple[Model, Noise]:
    """Fit a core and add effects one after the other; refine by maximum likelihood."""
    criterion = Criterion(record)
    model = fit_core(core, record, criterion, operator_starts(core, record, criterion))
    for name, effect in effects:
        reason = effect.refusal(record, core.kind)
        if reason is not None:
            raise ValueError(f"The effect {name} does not apply: {reason}.")
        model = extended(model, name, effect, criterion)
    return likelihood_fit(model, criterion)


def likelihood_fit(model: Model, criterion: Criterion) -> tuple[Model, Noise]:
    """Refine under an AR model of the residual, and again under that of the new residual."""
    for _ in range(N_LIKELIHOOD):
        criterion.set_noise(criterion.noise_of(model.output))
        model = model.refined(criterion)
    return model, criterion.noise


def check_rows(record: Record, n_parameters: int, grid: ModelGrid) -> None:
    """Refuse data that cannot hold the parameters."""
    n = int(record.known.sum())
    if n == 0 and record.y is not None and not record.y.any():
        raise ValueError("Input y contains NaN in all rows: nothing was measured.")
    if n <= n_parameters:
        raise ShortRunError(
            f"{n} rows are left for {n_parameters} parameters (n_samples = {grid.layout.n_rows} "
            "rows of X, of which settling, missing values and a run-in take the rest). Use more "
            "data, or a smaller settling."
        )


def vaf_of_output(record: Record, output: np.ndarray) -> float:
    """VAF in percent over what is known."""
    assert record.y is not None
    y, error = record.y[record.known], (record.y - output)[record.known]
    power = float(y @ y)
    return 100.0 * (1.0 - float(error @ error) / power) if power > 0 else 0.0
