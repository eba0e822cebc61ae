"""SimulatedARX: an ARX model with effects, estimated by the error of its simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from numbers import Integral
from typing import Any

import numpy as np
from scipy.signal import lfilter

from .._sklearn import Interval, StrOptions
from ..arx.base import ESTIMATE, REST, BaseARX, check_lengths
from ..arx.batch import ARXRegressor
from ..arx.model_summary import orders_text
from ..arx.orders import Orders
from ..effects.composition import Effects
from ..effects.record import Record
from ..preprocessing.grid import ModelGrid
from ..regression import segments
from .arx_starts import find_arx_starts, list_spread_starts
from .cores import ARXCore
from .estimator import GreyBox
from .fitting import Criterion, RemnantModel
from .model import Model, find_scaled_sse, fit_by_halving
from .prepared import Prepared, SimulatedCore, mark_measured
from .simulator import Simulator

SHARED = ("na", "nb", "nk", "inputs", "fit_intercept", "initial", "roles", "dt", "run")


class SimulatedARX(GreyBox, BaseARX):
    """ARX model with effects: all parameters minimise the error of simulation.

    The response to one input is that of A(q) y(t) = B(q) x(t - nk) + c and the effects together.
    ``ARXRegressor(...).with_effect(...)`` returns such a model.

    Parameters
    ----------
    na : int, default=2
        Number of output lags.
    nb : int, default=2
        Number of input coefficients.
    nk : int, default=0
        Input delay in samples of the grid the model is fitted on, as for :class:`ARXRegressor`.
    inputs : column name or list with one, or None, default=None
        The linear input. None means the column of role ``e``, or the only one. Effects may use all
        columns.
    fit_intercept : bool, default=False
        Add a constant c.
    {effects, controlled_element}
    settling : float, default=0.0
        Seconds at the start of each run (and after each gap) that do not count in the fit.
    initial : {"rest", "estimate"} or None, default=None
        How simulations begin, as for :class:`ARXRegressor`.
    {start, roles, dt, run}

    Attributes
    ----------
    coef_ : ndarray of shape (n_params,)
        theta = [a_1 ... a_na, b_0 ... b_{nb-1}, c].
    a_, b_ : ndarray
        Its parts.
    intercept_ : float
        The constant c, 0 without ``fit_intercept``.
    standard_errors_ : ndarray of shape (n_params,)
        Standard errors of ``coef_``.
    {parameter_table_, parameters_, effects_, covariance_}
    noise_ar_ : ndarray of shape (6,)
        AR model of the residual of simulation.
    noise_variance_ : float
        Variance of the whitened residual.
    {likelihood}
    {controlled_element_, parameter_names_, initial_, dt_, inputs_}
    n_rows_used_, n_rows_missing_ : int
        Rows that count, and rows left out because y is NaN.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    ARXRegressor : The linear model by least squares or instruments.
    EffectSearchCV : Finds the effects that are missing.

    Notes
    -----
    ``score`` is the VAF of the free run in percent: 100 is perfect, where other regressors have R²,
    at most 1 (``VAFScorer(fraction=True)``).

    Parameters minimise the sum of squares of the simulation's residual, whitened by an AR model.
    Bounds and starting values of an effect's times follow from how fast the output moves.
    ``predict_ahead`` adds the AR model's prediction of the residual, and ``to_transfer_function``
    returns the linear part.

    Examples
    --------
    >>> from skhoid import SimulatedARX, make_tracking_runs
    >>> X, y = make_tracking_runs("C1", 2, duration=20.48, remnant_intensity=0.05, random_state=2)
    >>> model = SimulatedARX(nk=29, effects=["bias"]).fit(X, y)
    >>> model.parameters_.index.tolist()
    ['a1', 'a2', 'b0', 'b1', 'bias__level']
    """

    _fixed_core = True  # its coefficients are shown in several places
    _takes_first = False

    _parameter_constraints: dict = {
        **GreyBox._parameter_constraints,
        "initial": [StrOptions({"rest", "estimate"}), None],
        "na": [Interval(Integral, 0, None, closed="left")],
        "nb": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "nk": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "inputs": "no_validation",
        "fit_intercept": ["boolean"],
    }

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        fit_intercept: bool = False,
        effects: Any = None,
        controlled_element: Any = None,
        settling: float = 0.0,
        initial: str | None = None,
        start: dict | None = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.fit_intercept = fit_intercept
        self.effects = effects
        self.controlled_element = controlled_element
        self.settling = settling
        self.initial = initial
        self.start = start
        self.roles = roles
        self.dt = dt
        self.run = run

    @classmethod
    def like(cls, model: ARXRegressor) -> SimulatedARX:
        """The simulated model of the same orders and data as one by least squares, without effects.

        Parameters
        ----------
        model : ARXRegressor
            Fitted or not.
        """
        if model.method != "ols":
            raise ValueError(
                f"method={model.method!r} does not take effects: they are estimated in simulation, "
                "with a noise model of its own, which remnant does not bias the way it biases "
                "one-step errors. Use method='ols'."
            )
        return cls(**{name: getattr(model, name) for name in SHARED})

    def _orders(self) -> Orders:
        return Orders.of(self.na, self.nb, self.nk, 1, bool(self.fit_intercept))

    def _simulated_core(self) -> SimulatedCore:
        orders = self._orders()
        return SimulatedCore(
            core=ARXCore(orders.na, orders.nb[0], orders.nk[0], orders.intercept),
            estimated=fit_arx,
            description=orders_text(orders),
            errors_note="Standard errors assume that the AR model whitens the residual.",
            start=self.start or {},
            check=partial(check_lengths, orders=orders),
        )

    def _take_over(
        self, prepared: Prepared, model: Model, noise: RemnantModel, least_error: np.ndarray
    ) -> None:
        self._set_estimates(prepared, model, noise)
        self.n_rows_missing_ = prepared.n_missing
        self.orders_ = self._orders()
        self.noise_variance_ = model.sse / max(model.fit.n - model.theta.size, 1)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        self.coef_ = model.theta[: self.orders_.n_params].copy()
        errors = np.sqrt(np.diag(self.covariance_.to_numpy()))
        self.standard_errors_ = errors[: self.orders_.n_params]

    def _ahead(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        free = self._free_run(grid, values)
        return forecast(free, output, segments(grid), self.noise_ar_, horizon)

    def _errors_on(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        return output - self._ahead(grid, values, output, 1)

    def _simulated(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray | None
    ) -> np.ndarray:
        record, columns = self._record(grid, values)
        if output is None:
            return columns.rows(self.simulation_.run(record, REST))
        known, y = mark_measured(grid, columns, output), columns.beside(np.nan_to_num(output))
        return columns.rows(replace(self.simulation_, initial=ESTIMATE).run_from(record, known, y))


def simulated_model(estimator: Any, purpose: str) -> Any:
    """The estimator, if it simulates effects; the SimulatedARX like it of an ARXRegressor."""
    if isinstance(estimator, ARXRegressor):
        return SimulatedARX.like(estimator)
    if not isinstance(estimator, GreyBox):
        is_class = isinstance(estimator, type)
        name = estimator.__name__ if is_class else type(estimator).__name__
        hint = f" the class {name}: pass {name}()." if is_class else f" {name}."
        if hasattr(estimator, "steps"):
            hint += f" Put its other steps before: make_pipeline(..., {purpose}(model))."
        raise TypeError(
            f"{purpose} takes an OperatorRegressor, an ARXRegressor, or a model derived from "
            'skhoid.model.GreyBox (docs/effect-in-depth.md, "A model of your own"); got' + hint
        )
    return estimator


N_ROUNDS = 5  # of Steiglitz and McBride
N_LEAST_SQUARES = 3  # of these, best first, that are followed
N_SPREAD = 4  # of the spread starts, the same


def fit_arx(core: ARXCore, record: Record, criterion: Criterion) -> Model:
    """The core without effects at its smallest simulation error, never worse than its starts."""
    simulator = Simulator(core, Effects([]), record)
    starts = find_arx_starts(core, record, record.input, N_ROUNDS)
    starts.sort(key=lambda theta: criterion.sse(simulator.run(theta)))
    starts = starts[:N_LEAST_SQUARES]
    starts += list_spread_starts(core, record, record.input)[:N_SPREAD]
    best = min(starts, key=lambda theta: find_scaled_sse(simulator, criterion, theta))
    sized = ARXCore(core.na, core.nb, core.nk, core.intercept, find_sizes(core, record, best))
    simulator = Simulator(sized, Effects([]), record)
    return fit_by_halving(simulator, criterion, starts)


def find_sizes(core: ARXCore, record: Record, theta: np.ndarray) -> dict[str, float]:
    """Changes of the coefficients that would change the output by its own size (linearised)."""
    assert record.y is not None
    denominator = np.r_[1.0, theta[: core.na]]
    b = np.r_[np.zeros(core.nk), theta[core.na : core.na + core.nb]]
    answers = {
        "a": lfilter(b, np.polymul(denominator, denominator), record.input, axis=0),
        "b": lfilter([1.0], denominator, record.input, axis=0),
        "intercept": lfilter([1.0], denominator, np.ones_like(record.input), axis=0),
    }
    known = record.known
    size = float(np.sqrt(np.mean(record.y[known] ** 2)))
    rms = {k: max(float(np.sqrt(np.mean(v[known] ** 2))), 1e-300) for k, v in answers.items()}
    names = [p.name for p in core.parameters]
    return {n: size / rms[n if n == "intercept" else n[0]] for n in names}


def forecast(
    simulated: np.ndarray,
    output: np.ndarray,
    segments: Sequence[tuple[int, int]],
    ar: np.ndarray,
    horizon: int,
) -> np.ndarray:
    """Simulated output, and the residual as an AR model foresees it some rows ahead.

    A residual that was not measured, or lies before its segment, is taken as zero.
    """
    if all(end - begin <= horizon for begin, end in segments):
        return simulated.copy()
    companion = np.eye(ar.size, k=-1)
    companion[:1] = -ar
    weights = np.linalg.matrix_power(companion, horizon)[:1].ravel()
    residual = np.nan_to_num(output - simulated)
    ahead = simulated.copy()
    for begin, end in segments:
        for i, weight in enumerate(weights):
            lag = horizon + i
            if begin + lag < end:
                ahead[begin + lag : end] += weight * residual[begin : end - lag]
    return ahead
