"""``OperatorRegressor``: the human operator's physical parameters, by maximum likelihood."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import product
from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import Interval, StrOptions
from ..effects.composition import Effects
from ..effects.record import Record
from ..exceptions import SlowClockWarning
from ..preprocessing import doubt_long_delay
from .controller import FORMS, ControllerCore, fit_controller
from .cores import LEAST_DELAY, OperatorCore
from .estimator import GreyBox
from .fitting import Criterion, RemnantModel, minimise
from .model import Model, fit_core
from .prepared import Prepared, SimulatedCore
from .simulator import Simulator


class OperatorRegressor(GreyBox):
    """Human operator with physical parameters, and effects, by maximum likelihood.

    u = H_nm(s) [K_e + K_edot s] exp(-s tau_e) e with the neuromuscular system H_nm(s) = omega_nm^2
    / (s^2 + 2 zeta_nm omega_nm s + omega_nm^2) (Eqs. 3-5), simulated from the measured channels
    alone. All parameters, those of the effects too, minimise the squares of the simulation's
    residual, whitened by an AR model of the remnant: maximum likelihood for a Gaussian remnant.

    Parameters
    ----------
    delay : float or None, default=None
        Effective time delay tau_e in seconds, kept as given unless the effect ``wrong_delay`` frees
        it; None estimates it.
    least_delay : float or None, default=None
        Shortest time in seconds after which the operator responds to what the loop moves (the
        error, the output, the motion); None means 0.1 s, since people who respond to what they see
        or feel have no shorter effective delay. A shorter one would make the model the inverse of
        the controlled element. A given ``delay`` below it is kept.
    inputs : column name or list with one, or None, default=None
        The error. None means the column of role ``e``.
    {effects}
    roles : dict or None, default=None
        Roles of columns, ``{column: role}``, where names do not show them: e, x, f_t, or a name
        that begins with motion or dist; "" for none. Effects may use all columns.
    {controlled_element}
    settling : float, default=3.0
        Seconds at the start of each run (and after each gap) that do not count in the fit, because
        what came before is not known.
    {start}
    controller : {"any", "pi", "pid", "i-p", "pi-d", "i-pd"} or None, default=None
        None means a person. Otherwise a machine's controller is in the place of the person: see
        Notes. ``"any"`` takes the likeliest form. :class:`EffectSearchCV` does so for
        ``domain="machine"``, and where no domain is given and a controller without delay is far
        likelier than a person.
    {dt, run}

    Attributes
    ----------
    {parameter_table_, parameters_}
    simulation_parameters_ : DataFrame
        The same for the smallest simulation error, without a noise model. In a closed loop it is
        biased by the remnant; ``summary`` shows both estimates where they differ by more than
        their uncertainty allows. ``predict`` and ``score`` simulate with these where that is worth
        more than a point of VAF on the fitted rows (``by_likelihood()`` is the model that does
        not), and ``summary`` says so.
    {effects_, covariance_}
    noise_ar_ : ndarray of shape (6,)
        AR model of the remnant at the rate of the criterion (25 Hz, or the sampling rate).
    {likelihood}
    n_rows_used_ : int
        Rows that count: measured, and not in the settling time or a run-in.
    controller_ : str or None
        The form of the controller.
    {controlled_element_, initial_, dt_, inputs_}
    {n_features_in_, feature_names_in_}

    Raises
    ------
    RankDeficiencyError
        If the error or the output does not move.
    ShortRunError
        If the runs are too short for the parameters and the noise model.
    ValueError
        If an effect does not apply to the data; the message says why.

    See Also
    --------
    EffectSearchCV : Finds the effects that are missing.
    operator_parameters : The same parameters from an ARX model.

    Notes
    -----
    ``score`` is the VAF of the free run in percent: 100 is perfect, where other regressors have R²,
    at most 1 (``VAFScorer(fraction=True)``).

    Residuals count at 25 Hz, above which operators have hardly any power; the simulation runs at
    the sampling rate. Runs with more remnant weigh less.

    Standard errors hold for remnant of any colour. They include how far the estimates would move at
    twice the sampling time, and if channels waited between samples: that makes tau_e uncertain by
    0.29 samples at least, and dominates where there is little remnant. Intervals of effects'
    parameters are those of the profile likelihood: they may be longer on one side, and one at its
    bound has an interval that ends there.

    A controller is u = K_e e + K_i integral of e + K_edot d/dt e / (T_f s + 1), with all rows in
    its likelihood. What stands behind the hyphen, or "i-p", acts on the measurement: -x in place of
    e, which takes a column of role x. The integral begins anywhere in each run, so that neither set
    points far from zero nor what came before matter. ``"any"`` estimates a delay tau_e, and a zero
    e_0 of the error (of a sensor, or of a mean that was removed), where they make it likelier. Sums
    of e may hold its last sample or not: that makes K_e on the error uncertain by K_i dt / 2.

    References
    ----------
    Van Grootheest, thesis, Eqs. 3-5 and its reference [8]: Zaal et al., Modeling human
    multimodal perception and control using genetic maximum likelihood estimation (2009). McRuer and
    Jex, A review of quasi-linear pilot models (1967), for the least delay.

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
        **GreyBox._parameter_constraints,
        "delay": [Interval(Real, 0, 10, closed="both"), None],
        "least_delay": [Interval(Real, 0, 1, closed="both"), None],
        "controller": [StrOptions({"any", *FORMS}), None],
    }

    def __init__(
        self,
        delay: float | None = None,
        *,
        least_delay: float | None = None,
        inputs: Any = None,
        effects: Any = None,
        roles: dict | None = None,
        controlled_element: Any = None,
        settling: float = 3.0,
        start: dict | None = None,
        controller: str | None = None,
        dt: float | None = None,
        run: Any = None,
    ):
        self.delay = delay
        self.least_delay = least_delay
        self.inputs = inputs
        self.effects = effects
        self.roles = roles
        self.controlled_element = controlled_element
        self.settling = settling
        self.start = start
        self.controller = controller
        self.dt = dt
        self.run = run

    def _with_given_core(self, given: Mapping[str, float]) -> Any:
        delay = given.get("tau_e")
        super()._with_given_core({name: v for name, v in given.items() if name != "tau_e"})
        return self.set_params(delay=delay)

    def prepare(self, X: Any, y: Any, sample_weight: Any = None) -> Prepared:
        prepared = super().prepare(X, y, sample_weight)
        if self.controller is None and not self._reading.indexed and self.dt is None:
            warnings.warn(
                SlowClockWarning(
                    "X has no time index, so each row counts as 1 s, and no person steers that "
                    "slowly.",
                    hint="Give the sampling time in seconds, such as dt=0.01.",
                    options=["dt"],
                ),
                stacklevel=4,
            )
        if self.delay is not None:
            roles = ("e", "x") if self.controller is None else ("e",)
            doubt_long_delay(self.delay, self.recorded_dt, roles)
        return prepared

    def _take_over(
        self, prepared: Prepared, model: Model, noise: RemnantModel, least_error: np.ndarray
    ) -> None:
        super()._take_over(prepared, model, noise, least_error)
        self.controller_ = getattr(prepared.core, "form", None)

    def _simulated_core(self) -> SimulatedCore:
        delay = None if self.delay is None else float(self.delay)
        given = {} if delay is None else {"tau_e": delay}
        if self.controller is not None:
            form = None if self.controller == "any" else self.controller
            return SimulatedCore(
                core=ControllerCore(form, delay),
                estimated=fit_controller,
                description="controller with integral action",
                errors_note="Standard errors allow for noise of any colour.",
                given=given,
                start=self.start or {},
            )
        least = LEAST_DELAY if self.least_delay is None else float(self.least_delay)
        return SimulatedCore(
            core=OperatorCore(delay, least),
            estimated=fit_plain_operator,
            description="human operator, Eqs. 3-5",
            errors_note="Standard errors allow for remnant of any colour.",
            given=given,
            start=self.start or {},
        )


def fit_plain_operator(core: OperatorCore, record: Record, criterion: Criterion) -> Model:
    """An operator without effects; see ``Model.other_cores`` where it ends at a bound."""
    starts = list_operator_starts(core, record, criterion)
    model = fit_core(core, record, criterion, starts)
    simulator = model.simulator
    dynamic = np.array([name in core.ordinary for name in simulator.names])
    at_bound = (model.theta <= simulator.low) | (model.theta >= simulator.high)
    if (at_bound & dynamic).any():
        # A spurious lag and lead may compensate for what is missing: try without both, too.
        plain = {name: usual.centre for name, usual in core.usual.items()}
        plain |= dict.fromkeys(core.gains[1:], 0.0)
        without = np.array([plain.get(name, value) for name, value in model.values().items()])
        given = np.array([name in plain for name in simulator.names])
        fits = [
            minimise(simulator, criterion, start, fixed=fixed)
            for start, fixed in ((starts[0], dynamic), (without, given))
        ]
        model.other_cores = tuple(
            dict(zip(simulator.names, fit.theta.tolist(), strict=True)) for fit in fits
        )
    return model


def list_operator_starts(core: OperatorCore, record: Record, criterion: Criterion) -> np.ndarray:
    """Starts of an operator: gains by least squares on a grid of delay and neuromuscular system."""
    simulator = Simulator(core, Effects([]), record)
    delays = np.zeros(1)
    if core.fixed_delay is None:
        delays = np.maximum(np.arange(0.06, 0.62, 0.08), core.least)
    found = []
    for delay, omega, zeta in product(delays, (5.0, 9.0, 15.0), (0.25, 0.7)):
        theta = np.array([1.0, 0.0, omega, zeta, delay][: len(core.parameters)])
        by_gain = []
        for gains in ((1.0, 0.0), (0.0, 1.0)):
            theta[:2] = gains
            by_gain.append(simulator.run(theta)[:: criterion.thin])
        a, b, y = criterion.whitened(np.stack([*by_gain, criterion.y]))
        solved = np.linalg.lstsq(np.stack([a, b], 1), y, rcond=None)[0]
        if solved[1] < 0:
            solved = np.array([float(a @ y) / max(float(a @ a), 1e-300), 0.0])
        residual = y - solved[0] * a - solved[1] * b
        theta[:2] = solved
        found.append((float(residual @ residual), theta.copy()))
    found.sort(key=lambda item: item[0])
    return np.array([theta for _, theta in found[:4]])
