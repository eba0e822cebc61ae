"""Batch ARX models: ordinary least squares, and instrumental variables for closed loops."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from numbers import Integral, Real
from typing import Any

import numpy as np

from .._sklearn import DT, Interval, StrOptions, fit_context
from ..effects.base import Effect
from ..effects.composition import Effects
from ..human import ELEMENT
from ..model.arx_core import fitted_arx
from ..model.cores import ARXCore
from ..model.estimator import SimulatedModelMixin, Simulation
from ..model.fitting import RemnantModel
from ..model.model import Model
from ..model.prepared import Prepared, SimulatedCore
from ..preprocessing.grid import ModelGrid
from ..text import ModelSummary
from .base import BaseARX, check_lengths
from .model_summary import orders_text
from .orders import Orders
from .strategies import EquationError, LinearSimulationError, SimulationError, Strategy

EQUATION_ERROR = {"ols": EquationError.by_least_squares, "iv": EquationError.by_instruments}
NO_EFFECTS_BY_INSTRUMENTS = (
    "method='iv' does not take effects: they are estimated in simulation, which remnant does not "
    "bias the way it biases one-step errors. Use method='ols'."
)


class ARXRegressor(SimulatedModelMixin, BaseARX):
    """ARX model with constant parameters, estimated in one batch.

    A(q) y(t) = B(q) x(t - nk) + c + eps(t) with A = 1 + a_1 q^-1 + ... + a_na q^-na and
    B = b_0 + b_1 q^-1 + ... + b_{nb-1} q^-(nb-1) for each input (Eqs. 6-9 of the thesis).

    With ``effects`` the response to one input is that of the ARX model and the effects together,
    and all parameters minimise the simulation error, not the one-step error.

    Parameters
    ----------
    na : int, default=2
        Number of output lags.
    nb : int or one per input, default=2
        Number of input coefficients.
    nk : int or one per input, default=0
        Input delay in samples of the grid the model is fitted on; 0 means x(t) itself. It includes
        the sample that zero-order hold adds: 29 at 100 Hz for an operator with tau_e = 0.28 s.
    inputs : list of column names or positions, or None, default=None
        Linear inputs. None means the column named ``e`` if there is one, else all columns.
    fit_intercept : bool, default=False
        Add a constant c to the regressors. The thesis keeps means and has none.
    method : {"ols", "iv"}, default="ols"
        Ordinary least squares by QR factorisation, or instrumental variables. Remnant that is not
        of the form eps/A biases OLS in a closed loop; ``"iv"`` uses signals from outside the loop
        to remove the bias, at the cost of more variance.
    instruments : list of column names or positions, or None, default=None
        External signals for ``method="iv"``: forcing functions on target or disturbance. None
        means the columns of role ``f_t`` and ``dist...``.
    covariance : {"ols", "hac"}, default="ols"
        ``"ols"`` takes the equation error as white; ``"hac"`` (Newey and West) allows for the
        coloured error that remnant leaves.
    effects : Effect, Effects, str, list of these, or None, default=None
        What the linear model is missing, such as ``"dead_zone"``; see :mod:`skhoid.effects`. They
        need one linear input (named by ``inputs``, or of role ``e``), and may use all columns.
    controlled_element : ControlledElement, LinearElement, str, system or None, default=None
        For effects that use its inverse: ``"1/(s(s+1))"``, or a SciPy or python-control transfer
        function; None estimates it from output and x where needed.
    settling : float, default=0.0
        Seconds at the start of each run (and after each gap) that do not count in a fit with
        effects, which starts from rest.
    initial : {"rest", "estimate"} or None, default=None
        How simulations begin. ``"rest"``: with all signals zero before the first sample.
        ``"estimate"``: in ``score`` and where ``y`` is known, from the initial states that fit each
        run best; in ``predict``, as if the inputs had always been as in the first row. None takes
        ``"estimate"`` only where runs clearly do not begin at rest, in ``score`` for each run by
        itself.
    start : dict or None, default=None
        Starting values for a fit with effects, ``{parameter: value}`` by the names of
        ``parameters_``, in addition to the model's own starts.
    n_starts : int, default=24
        How many systems with different poles are tried as starts of a fit with effects, in addition
        to those from least squares; they are fixed, so a fit is repeatable.
    roles : dict or None, default=None
        Roles of columns, ``{column: role}``, where their names do not give them.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Attributes
    ----------
    coef_ : ndarray of shape (n_params,)
        theta = [a_1 ... a_na, b_0 ... b_{nb-1} of each input, c].
    a_ : ndarray of shape (na,)
        Output coefficients a_1 ... a_na.
    b_ : ndarray of shape (nb,), or list of them for several inputs
        Input coefficients b_0 ... b_{nb-1}.
    intercept_ : float
        The constant c, 0 without ``fit_intercept``.
    covariance_ : ndarray of shape (n_estimated, n_estimated)
        Covariance of what was estimated, in the order of the first rows of ``parameters_``:
        ``coef_``, then the parameters of effects.
    standard_errors_ : ndarray of shape (n_params,)
        Standard errors of ``coef_``, square roots of the diagonal of ``covariance_``.
    noise_variance_ : float
        Variance of the equation error, in the squared unit of ``y``; with effects, of the whitened
        residual.
    parameters_ : DataFrame
        Indexed by parameter: value, sd (standard error), low and high (95 % interval), unit,
        meaning. Parameters of effects are called ``<effect>__<parameter>``; those that are fixed,
        or follow from others, come last.
    effects_ : Effects
        The effects with their estimated values and chosen form and channel.
    noise_ar_ : ndarray of shape (6,)
        With effects: AR model of the residual of simulation.
    loglik_, bic_, vaf_ : float
        With effects: logarithm of the likelihood without constants, Bayesian information
        criterion, and VAF in percent of the free run on the fitted rows.
    controlled_element_ : ControlledElement, LinearElement or None
        With effects: given or estimated.
    parameter_names_ : list of str
        Names of the entries of ``coef_``.
    initial_ : str
        How free runs begin: ``"rest"`` or ``"estimate"``.
    dt_ : float
        Sampling time of the fitted grid in seconds.
    inputs_ : list of str
        Names of the linear inputs.
    n_rows_used_ : int
        Rows in the regression.
    n_rows_missing_ : int
        Rows left out because y or an input in their lags is NaN.
    jitter_ : float
        Largest deviation of a step of the clock, as a fraction of the sampling time.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

    See Also
    --------
    DelaySearchCV : Finds ``nk``.
    OrderSearchCV : Finds ``na``, ``nb``, ``nk`` and the decimation factor.
    EffectSearchCV : Finds the effects that are missing.

    Notes
    -----
    Several runs are fitted together. Lags never cross runs or gaps, and only known data are used:
    regression starts at k_c = max(na + 1, nb + nk) of each run. Confidence intervals are for the
    parameters of the ARX model, not of the operator: a model biased by remnant is precisely wrong.

    With effects, parameters minimise the sum of squares of the simulation's residual, whitened by
    an AR model. Bounds and starting values of an effect's times follow from how fast the output
    moves. ``predict_ahead`` adds the AR model's prediction of the residual, and
    ``to_transfer_function`` returns the linear part.

    References
    ----------
    Van Grootheest, thesis, Sections III-A and III-B. Ljung, System Identification (1999), ch. 7.

    Examples
    --------
    >>> from skhoid import ARXRegressor, load_human_tracking
    >>> X, y = load_human_tracking(1)
    >>> model = ARXRegressor(na=2, nb=2, nk=7).fit(X, y)
    >>> model.parameter_names_
    ['a1', 'a2', 'b0', 'b1']
    >>> bool(model.score(X, y) > 90)
    True

    The delay given is nine samples (of 10 ms) short of the simulated operator's 29:

    >>> from skhoid import make_tracking_runs
    >>> X, y = make_tracking_runs("C1", 2, duration=20.48, remnant_intensity=0.05, random_state=2)
    >>> model = ARXRegressor(na=2, nb=2, nk=20).with_effect("wrong_delay").fit(X, y)
    >>> extra = model.parameters_.loc["wrong_delay__extra"]
    >>> [float(round(extra["value"], 2)), extra["unit"]]
    [0.09, 's']
    """

    _fixed_core = True  # its coefficients are shown in several places

    _parameter_constraints: dict = {
        "na": [Interval(Integral, 0, None, closed="left")],
        "nb": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "nk": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "inputs": "no_validation",
        "fit_intercept": ["boolean"],
        "method": [StrOptions({"ols", "iv"})],
        "instruments": "no_validation",
        "covariance": [StrOptions({"ols", "hac"})],
        "effects": [Effect, Effects, str, list, tuple, None],
        "controlled_element": ELEMENT,
        "settling": [Interval(Real, 0, None, closed="left")],
        "initial": [StrOptions({"rest", "estimate"}), None],
        "start": [dict, None],
        "n_starts": [Interval(Integral, 0, None, closed="left")],
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        fit_intercept: bool = False,
        method: str = "ols",
        instruments: Any = None,
        covariance: str = "ols",
        effects: Any = None,
        controlled_element: Any = None,
        settling: float = 0.0,
        initial: str | None = None,
        start: dict | None = None,
        n_starts: int = 24,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.method = method
        self.instruments = instruments
        self.covariance = covariance
        self.effects = effects
        self.controlled_element = controlled_element
        self.settling = settling
        self.initial = initial
        self.start = start
        self.n_starts = n_starts
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> ARXRegressor:
        """Estimate the parameters.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample; runs and time are read from its index.
        y : Series or array of shape (n_rows,)
            Output. NaN means no measurement.

        Returns
        -------
        self : ARXRegressor

        Raises
        ------
        RankDeficiencyError
            If the parameters cannot all be estimated; the message names the cause.
        ShortRunError
            If a run has fewer rows than the lags need.
        RunIndexError, IrregularSamplingError
            If rows, runs or time violate the data convention.
        ValueError
            If an effect does not apply to the data, with the reason.

        Warns
        -----
        MissingDataWarning
            With the number of rows that are NaN.
        sklearn.exceptions.ConvergenceWarning
            If ``method="iv"`` has not converged after 20 rounds.
        """
        with_effects = len(Effects.of(self.effects)) > 0
        if with_effects and self.method == "iv":
            raise ValueError(NO_EFFECTS_BY_INSTRUMENTS)
        estimated = SimulationError.estimated if with_effects else EQUATION_ERROR[self.method]
        needs = "all" if with_effects else "inputs"
        data = self._read_data(X, y, needs, in_parts=self.method != "iv")
        self._strategy: Strategy = estimated(self, data)
        return self

    def _simulated_core(self) -> SimulatedCore:
        if self.method == "iv":
            raise ValueError(NO_EFFECTS_BY_INSTRUMENTS)
        orders = Orders.of(self.na, self.nb, self.nk, 1, bool(self.fit_intercept))
        return SimulatedCore(
            core=ARXCore(
                orders.na, orders.nb[0], orders.nk[0], orders.intercept, n_starts=self.n_starts
            ),
            estimated=fitted_arx,
            description=orders_text(orders),
            errors_note="Standard errors assume that the AR model whitens the residual.",
            start=self.start or {},
            check=partial(check_lengths, orders=orders),
        )

    def _take_over(self, prepared: Prepared, model: Model, noise: RemnantModel) -> None:
        self._strategy = SimulationError.taken_over(self, prepared, model, noise)

    def _move(self, simulation: Simulation) -> None:
        assert isinstance(self._strategy, SimulationError)
        self._strategy = replace(self._strategy, simulation=simulation)

    @property
    def simulation_(self) -> Simulation:
        """The estimate by the error of simulation, if it is one."""
        strategy = self._strategy
        if not isinstance(strategy, (SimulationError, LinearSimulationError)):
            raise AttributeError("This model was estimated from its equation error.")
        return strategy.simulation

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        return self._strategy.free_run(self, grid, values)

    def _run_from(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        return self._strategy.run_from(self, grid, values, output)

    def _ahead(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        return self._strategy.ahead(self, grid, values, output, horizon)

    def _one_step_errors(self, X: Any, y: Any) -> np.ndarray:
        return self._strategy.one_step_errors(self, X, y)

    def simulate(self, X: Any, y: Any = None, *, initial_state: str = "zero") -> np.ndarray:
        """Simulate the output, from a zero or an estimated initial state.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,), default=None
            Measured output, needed to estimate the initial state.
        initial_state : {"zero", "estimate"}, default="zero"
            ``"estimate"`` chooses the ``na`` outputs before each run (and gap, and end of the
            run-in) by least squares on ``y``, as MATLAB's ``compare`` does.

        Returns
        -------
        y_sim : ndarray of shape (n_rows,)
        """
        self._check_fitted()
        return super().simulate(X, y, initial_state=initial_state)

    def _simulated(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        return self._strategy.simulated(self, grid, values, output)

    def _summary(self) -> ModelSummary:
        return self._strategy.summary(self)
