"""ARXRegressor: least squares, and instrumental variables for closed loops."""

from __future__ import annotations

import warnings
from numbers import Integral
from typing import Any

import numpy as np
from scipy.signal import lfilter
from sklearn.exceptions import ConvergenceWarning

from .._sklearn import Interval, StrOptions, fit_context
from ..exceptions import MissingDataWarning, RankDeficiencyError
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import HeldInputs, ModelGrid
from ..regression import DataToFit, check_segments, segments
from ..text import ModelSummary, estimates_table
from .base import (
    ESTIMATE,
    REST,
    BaseARX,
    arx_parameter_table,
    check_row_count,
    held_level,
    measured_rows,
    pays,
)
from .instruments import estimate, instrument_columns
from .least_squares import Triangle, robust_covariance, weighted
from .model_summary import (
    CLOSED_LOOP,
    JUDGE,
    WHITE,
    condition,
    delay_text,
    largest_pole,
    orders_text,
)
from .orders import regressor_blocks, regressors
from .prediction_errors import estimate as estimate_by_errors
from .prediction_errors import predict_steps

PREDICTION_ERRORS = ("oe", "bj", "armax")
METHODS = {
    "ols": "ordinary least squares",
    "iv": "instrumental variables",
    "oe": "output error",
    "bj": "Box-Jenkins",
    "armax": "ARMAX",
}
FIRST = 2000  # rows of each stretch that tell how it begins
RUN_AWAY = 1e50  # where no start helps


class ARXRegressor(BaseARX):
    """ARX model with constant parameters, estimated in one batch.

    A(q) y(t) = B(q) x(t - nk) + c + eps(t) with A = 1 + a_1 q^-1 + ... + a_na q^-na and
    B = b_0 + b_1 q^-1 + ... + b_{nb-1} q^-(nb-1) for each input (Eqs. 6-9 of the thesis).

    With physical effects it is another model, :class:`SimulatedARX`, whose parameters minimise the
    error of simulation instead of the one-step error: :meth:`with_effect` returns it.

    Parameters
    ----------
    na : int, default=2
        Number of output lags.
    nb : int or one per input, default=2
        Number of input coefficients.
    nk : int or one per input, default=0
        Input delay in samples of the grid the model is fitted on; 0 means x(t) itself. It includes
        the sample that zero-order hold adds: 29 at 100 Hz for an operator with tau_e = 0.28 s.
    {inputs}
    fit_intercept : bool, default=False
        Add a constant c to the regressors. The thesis keeps means and has none.
    method : {"ols", "iv", "oe", "bj", "armax"}, default="ols"
        Ordinary least squares by QR factorisation, or instrumental variables. Noise on the output
        that is not of the form eps/A biases OLS, in a closed loop and in an open one; ``"iv"`` uses
        signals that noise does not reach to remove the bias, at the cost of more variance. The
        others minimise the error one step ahead of a model with another noise: output error (y =
        B/A x + eps), Box-Jenkins (y = B/A x + C/D eps) and ARMAX (A y = B x + C eps). Output error
        and Box-Jenkins are the field's B/F: their F is ``a_`` here. Several inputs share it.
    nc : int, default=2
        Order of C, for ``"bj"`` and ``"armax"``.
    nd : int, default=2
        Order of D, for ``"bj"``.
    instruments : list of column names or positions, or None, default=None
        Signals for ``method="iv"`` that noise does not reach: forcing functions on target or
        disturbance, whose lags are the instruments. Naming the inputs says that nothing feeds the
        output back to them: then they and the simulated output are (IV4; Ljung 1999, section
        15.3). None means the columns of role ``f_t`` and ``dist...``; without such, the inputs,
        where none has the role ``e`` or ``x``.
    covariance : {"ols", "hac"}, default="ols"
        ``"ols"`` takes the equation error as white; ``"hac"`` (Newey and West, after whitening)
        allows for the coloured error that remnant leaves, and for one whose size varies. A
        coefficient that acts in few rows, as after a step, has the error's variance in all rows.
    initial : {"rest", "estimate"} or None, default=None
        How simulations begin. ``"rest"``: with all signals zero before the first sample.
        ``"estimate"``: in ``score`` and where ``y`` is known, from the initial states that fit the
        first seconds of each run (10 s or 200 rows, a quarter at most) best; in ``predict``, as if
        the inputs had always been as in the first row. None takes
        ``"estimate"`` only where runs clearly do not begin at rest, in ``score`` for each run by
        itself.
    {roles, dt, run}

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
    c_, d_ : ndarray of shape (nc,), (nd,)
        Coefficients c_1 ... of C and d_1 ... of D in the noise C/D eps; D of an ARMAX model is A,
        and of least squares and instruments too. Empty where there are none.
    f_ : ndarray of shape (na,)
        ``a_`` of output error and Box-Jenkins models, as the field calls it.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``.
    {standard_errors_}
    noise_variance_ : float
        Variance of the equation error, in the squared unit of ``y``; with weights, in rows of
        weight 1.
    parameters_ : DataFrame
        Indexed by parameter: value, sd (standard error), low and high (95 % interval), unit,
        meaning.
    parameter_names_ : list of str
        Names of the entries of ``coef_``.
    instruments_ : list of str
        Names of the instruments; none for least squares.
    {initial_, dt_, inputs_}
    n_rows_used_ : int
        Rows in the regression.
    {n_rows_missing_, jitter_}
    {n_features_in_, feature_names_in_}

    See Also
    --------
    DelaySearchCV : Finds ``nk``.
    OrderSearchCV : Finds ``na``, ``nb``, ``nk`` and the decimation factor.
    SimulatedARX : The same system with effects, estimated in simulation.
    EffectSearchCV : Finds the effects that are missing.

    Notes
    -----
    ``score`` is the VAF of the free run in percent: 100 is perfect, where other regressors have R²,
    at most 1 (``VAFScorer(fraction=True)``).

    Several runs are fitted together. Lags never cross runs or gaps, and only known data are used:
    regression starts at k_c = max(na + 1, nb + nk) of each run. Confidence intervals are for the
    parameters of the ARX model, not of the operator: a model biased by remnant is precisely wrong.

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
    """

    covariance_: np.ndarray

    _parameter_constraints: dict = {
        **BaseARX._parameter_constraints,
        "method": [StrOptions({"ols", "iv", *PREDICTION_ERRORS})],
        "nc": [Interval(Integral, 0, None, closed="left")],
        "nd": [Interval(Integral, 0, None, closed="left")],
        "instruments": "no_validation",
        "covariance": [StrOptions({"ols", "hac"})],
        "initial": [StrOptions({"rest", "estimate"}), None],
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
        nc: int = 2,
        nd: int = 2,
        instruments: Any = None,
        covariance: str = "ols",
        initial: str | None = None,
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
        self.nc = nc
        self.nd = nd
        self.instruments = instruments
        self.covariance = covariance
        self.initial = initial
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> ARXRegressor:
        """Estimate the parameters.

        Parameters
        ----------
        {X, y, sample_weight}

        Returns
        -------
        self : ARXRegressor

        Raises
        ------
        RankDeficiencyError
            If the parameters cannot all be estimated; the message names the cause.
        {run_errors}

        Warns
        -----
        MissingDataWarning
            With the number of rows that are NaN.
        sklearn.exceptions.ConvergenceWarning
            If another method than ``"ols"`` has not converged.
        """
        data = self._read_data(X, y, in_parts=self.method == "ols", sample_weight=sample_weight)
        self._set_orders(data.grid)
        self.parameter_names_ = self.orders_.parameter_names(self.inputs_)
        self.c_ = self.d_ = np.empty(0)
        if self.method != "ols":
            refuse_weights(data.weights, f"method={self.method!r}")
        if self.method == "iv":
            self._fit_by_instruments(data)
        elif self.method in PREDICTION_ERRORS:
            self._fit_by_prediction_errors(data)
        else:
            self._fit_by_least_squares(data)
        errors = np.sqrt(np.diag(self.covariance_))
        p = self.coef_.size
        self.covariance_, self.standard_errors_ = self.covariance_[:p, :p], errors[:p]
        noise = [f"c{i + 1}" for i in range(self.c_.size)]
        if self.method == "bj":
            noise += [f"d{i + 1}" for i in range(self.d_.size)]
        self.parameters_ = arx_parameter_table(
            [*self.parameter_names_, *noise],
            np.r_[self.coef_, self.c_, self.d_],
            errors,
            [*self._coefficient_units(), *["-"] * len(noise)],
        )
        check_segments(data.grid, self._rows_to_forget(self.dt_))
        self._see_beginning(data.grid, data.inputs, data.output)
        return self

    def _fit_by_least_squares(self, data: DataToFit) -> None:
        grid, inputs, output = data.grid, data.inputs, data.output
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        orders = self.orders_
        blocks = regressor_blocks(output, inputs, begin, end, orders)
        triangle = Triangle.of_blocks(
            (weighted(table, rows, data.weights) for table, rows, _ in blocks), orders.n_params + 1
        )
        self.n_rows_used_ = n_rows = triangle.n_rows
        possible = int(np.maximum(end - begin - orders.first_row, 0).sum())
        self.n_rows_missing_ = possible - n_rows
        check_row_count(n_rows, orders.n_params, grid)
        self._report_missing(grid, inputs, data.told, n_rows, self.inputs_)
        self._check_rank(triangle, inputs, output)
        self.instruments_: list[str] = []
        self.coef_ = triangle.solve()
        self.noise_variance_ = triangle.rss / max(n_rows - orders.n_params, 1)
        bread = triangle.inverse_information()
        if self.covariance == "hac":
            table, rows, _ = regressors(output, inputs, begin, end, orders)
            table = weighted(table, rows, data.weights)
            errors = table[:, -1] - table[:, :-1] @ self.coef_
            weights = table[:, :-1] @ bread
            leverage = np.einsum("tp,tp->t", weights, table[:, :-1])
            self.covariance_ = robust_covariance(weights, leverage, errors, rows, grid.begin)
        else:
            self.covariance_ = self.noise_variance_ * bread

    def _fit_by_instruments(self, data: DataToFit) -> None:
        grid, inputs, output = data.grid, data.inputs, data.output
        positions = instrument_columns(
            self._reading.names or list(range(data.columns.shape[1])),
            self.instruments,
            self._columns,
            self.roles,
            self._reading.run,
            "method='iv'",
        )
        self.instruments_ = self._channel_names(positions)
        open_loop = set(self._columns) <= set(positions)
        others = [i for i in positions if not open_loop or i not in self._columns]
        outside = data.columns[:, others]
        found = estimate(
            output,
            inputs,
            outside,
            grid.begin[grid.measured],
            grid.end[grid.measured],
            self.orders_,
            self.dt_,
            self.instruments_,
            self.covariance == "hac",
            open_loop,
        )
        if not found.converged:
            warnings.warn(
                f"The instrumental-variable estimate has not converged after {found.n_rounds} "
                "rounds; the instruments may be weak. Compare its standard errors with "
                "method='ols'.",
                ConvergenceWarning,
                stacklevel=4,
            )
        self.n_rows_used_, self.n_rows_missing_ = found.n_rows, found.n_missing
        signals = np.column_stack([inputs, outside])
        names = [*self.inputs_, *self._channel_names(others)]
        self._report_missing(grid, signals, data.told, found.n_rows, names)
        self.coef_, self.covariance_ = found.theta, found.covariance
        self.noise_variance_ = found.noise_variance

    def _fit_by_prediction_errors(self, data: DataToFit) -> None:
        grid, inputs, output = data.grid, data.inputs, data.output
        begin, end = grid.begin[grid.measured], grid.end[grid.measured]
        nc = self.nc if self.method != "oe" else 0
        nd = self.nd if self.method == "bj" else 0
        orders, n_params = self.orders_, self.orders_.n_params + nc + nd
        blocks = regressor_blocks(output, inputs, begin, end, orders)
        triangle = Triangle.of_blocks((table for table, *_ in blocks), orders.n_params + 1)
        check_row_count(triangle.n_rows, n_params + 1, grid)
        self._check_rank(triangle, inputs, output)
        found = estimate_by_errors(output, inputs, begin, end, orders, self.method, nc, nd)
        if not found.converged:
            warnings.warn(
                f"The {METHODS[self.method]} model has not converged. Use smaller orders, or "
                "compare the standard errors with method='ols'.",
                ConvergenceWarning,
                stacklevel=4,
            )
        self.n_rows_used_, self.n_rows_missing_ = found.rows.size, found.n_missing
        self._report_missing(grid, inputs, data.told, found.rows.size, self.inputs_)
        self.instruments_ = []
        system = orders.n_params
        self.coef_, self.c_, self.d_ = np.split(found.theta, [system, system + nc])
        left = max(found.rows.size - n_params - found.n_states, 1)
        self.noise_variance_ = float(found.errors @ found.errors) / left
        slopes = Triangle.of(np.column_stack([found.slopes, found.errors]))
        if len(slopes.null_space()):
            raise RankDeficiencyError(
                f"The {n_params} parameters of the {METHODS[self.method]} model cannot all be "
                "estimated: A, B, C and D have factors in common. Use smaller orders."
            )
        bread = slopes.inverse_information()
        self.covariance_ = self.noise_variance_ * bread
        if self.covariance == "hac":
            weights = found.slopes @ bread
            leverage = np.einsum("tp,tp->t", weights, found.slopes)
            self.covariance_ = robust_covariance(
                weights, leverage, found.errors, found.rows, grid.begin
            )

    @property
    def f_(self) -> np.ndarray:
        if self.method not in ("oe", "bj"):
            raise AttributeError(f"A model with method={self.method!r} has no F; see a_.")
        return self.a_

    def _ahead(
        self, grid: ModelGrid, values: np.ndarray, output: np.ndarray, horizon: int
    ) -> np.ndarray:
        fitted = as_fitted(self).method
        if fitted == "oe":
            return self._free_run(grid, values)
        if fitted not in ("bj", "armax"):
            return super()._ahead(grid, values, output, horizon)
        free = self._free_run(grid, values)
        ahead = free.copy()
        inputs = self._held_inputs(grid, values)[:]
        _, b, constant = self.orders_.split(self.coef_)
        c = np.r_[1.0, self.c_]
        for begin, end in segments(grid):
            rows = slice(begin, end)
            if horizon >= end - begin:  # no output is known so long before
                continue
            if fitted == "bj":
                left, drive = output[rows] - free[rows], np.zeros(end - begin)
                ahead[rows] += predict_steps(left, drive, c, np.r_[1.0, self.d_], horizon)
                continue
            drive = np.full(end - begin, constant)
            for j, (nb, nk) in enumerate(zip(self.orders_.nb, self.orders_.nk, strict=True)):
                drive += lfilter(np.r_[np.zeros(nk), b[j, :nb]], [1.0], inputs[rows, j])
            a = np.r_[1.0, self.a_]
            ahead[rows] = predict_steps(output[rows], drive, c, a, horizon)
        return ahead

    def _errors_on(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        fitted = as_fitted(self).method
        if fitted not in PREDICTION_ERRORS:
            return super()._errors_on(grid, values, output)
        errors = output - self._ahead(grid, values, output, 1)
        errors[~measured_rows(grid)] = np.nan
        for begin in grid.begin:
            errors[begin : begin + self.orders_.first_row] = np.nan
        return errors

    def _see_beginning(self, grid: ModelGrid, inputs: np.ndarray, output: np.ndarray) -> None:
        """Decide by the rows that were fitted how free runs begin; the user's choice comes first.

        With ``initial_`` equal to "estimate" runs of which only the inputs are known begin as if
        these had always been as at first, with an output within the ``_levels`` that were measured.
        """
        known = ~np.isnan(output)
        measured = output[measured_rows(grid) & known].astype(np.float64, copy=False)
        self._levels = float(measured.min()), float(measured.max())
        held = self.initial == ESTIMATE
        if self.initial is None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MissingDataWarning)  # the fit has said so
                held_inputs = self._hold(grid, inputs)
            first = measured_rows(grid, FIRST) & known
            left = []
            for self.initial_ in (REST, ESTIMATE):
                free = self._begun(grid, held_inputs, FIRST)
                left.append(float(((output[first] - free[first]) ** 2).sum()))
            held = pays(left[0], left[1], measured)
        self.initial_ = ESTIMATE if held else REST

    def _begun(self, grid: ModelGrid, inputs: HeldInputs, most: int | None = None) -> np.ndarray:
        """Free run from rest, or from where the first inputs would have led."""
        if self.initial_ == REST:
            return self._simulate(grid, inputs, most=most)
        _, b, constant = self.orders_.split(self.coef_)
        drive = inputs[grid.past] @ b.sum(axis=1) + constant
        level = held_level(np.r_[1.0, self.a_], drive, self._levels)
        y0 = np.repeat(level[:, None], max(self.orders_.na, 1), axis=1)
        return self._simulate(grid, inputs, y0, held=True, most=most)

    def _free_run(self, grid: ModelGrid, values: np.ndarray) -> np.ndarray:
        return self._begun(grid, self._held_inputs(grid, values))

    def _run_from(self, grid: ModelGrid, values: np.ndarray, output: np.ndarray) -> np.ndarray:
        """Free run whose initial states fit the output, where the output shows them."""
        inputs = self._held_inputs(grid, values)
        free = self._begun(grid, inputs)
        asked = as_fitted(self).initial
        if asked == REST or not max(free.max(), -free.min()) < RUN_AWAY:
            return free
        if self.initial_ == ESTIMATE:
            return self._from_fitted_states(grid, inputs, output, held=True)
        fitted = None
        stretches = zip(grid.begin, grid.end, grid.measured, strict=True)
        for rows in (slice(begin, end) for begin, end, counts in stretches if counts):
            known = ~np.isnan(output[rows])
            y = output[rows][known]
            rest = float(((y - free[rows][known]) ** 2).sum())
            if not pays(rest, 0.0, y):
                continue
            if fitted is None:
                fitted = self._from_fitted_states(grid, inputs, output, held=True)
            # Each is judged alone: the others must not change its prediction.
            if pays(rest, float(((y - fitted[rows][known]) ** 2).sum()), y):
                free[rows] = fitted[rows]
        return free

    def with_effect(self, effect: Any) -> Any:
        """A new, unfitted model of the same orders with an effect: fit it to add the effect.

        Parameters
        ----------
        effect : Effect, Effects or str
            An effect, several as ``a + b``, or an id of the catalogue.

        Returns
        -------
        model : SimulatedARX
            Its parameters minimise the error of simulation. Least squares cannot see effects, so
            ``method="iv"`` is refused, and ``covariance`` has no meaning.

        Examples
        --------
        The delay given is nine samples (of 10 ms) short of the simulated operator's 29:

        >>> from skhoid import ARXRegressor, make_tracking_runs
        >>> X, y = make_tracking_runs(
        ...     "C1", 2, duration=20.48, remnant_intensity=0.05, random_state=2
        ... )
        >>> model = ARXRegressor(nk=20).with_effect("wrong_delay").fit(X, y)
        >>> extra = model.parameters_.loc["wrong_delay__extra"]
        >>> [float(round(extra["value"], 2)), extra["unit"]]
        [0.09, 's']
        """
        # The one import that goes up: who only wants least squares does not load models of effects.
        from ..model.simulated_arx import SimulatedARX

        return SimulatedARX.like(self).with_effect(effect)

    def summary_table(self) -> ModelSummary:
        hac = as_fitted(self).covariance == "hac"
        n, p = self.n_rows_used_, len(self.coef_)
        facts = {"Model": orders_text(self.orders_), **self._signal_facts()}
        instrumental = bool(self.instruments_)
        by_errors = as_fitted(self).method in PREDICTION_ERRORS
        facts["Method"] = METHODS[as_fitted(self).method]
        if by_errors:
            facts["Noise"] = f"nc = {self.c_.size}, nd = {self.d_.size}"
            p += self.c_.size + self.d_.size
        if instrumental:
            facts["Instruments"] = ", ".join(self.instruments_)
        facts["Rows"] = f"{n}" + (
            f" ({self.n_rows_missing_} missing)" if self.n_rows_missing_ else ""
        )
        facts["Runs"] = f"{self._n_runs}"
        facts |= self._grid_facts()
        facts["Delay, nk"] = delay_text(self.orders_.nk, self.dt_)
        facts["Residual sd"] = self._residual_sd()
        sse = self.noise_variance_ * max(n - p, 1)
        criteria = not instrumental and sse > 0
        if criteria:
            fit = n * np.log(sse / n)
            facts["AIC"], facts["BIC"] = f"{fit + 2 * p:.1f}", f"{fit + p * np.log(n):.1f}"
        facts["Largest |pole|"] = largest_pole(self.a_)
        if not (instrumental or hac or by_errors) and p > 0 and sse > 0:
            facts["Condition"] = f"{condition(self.covariance_):.3g} (scaled regressors)"
        notes = [
            "Standard errors allow for a coloured equation error."
            if hac
            else WHITE.format(
                " after filtering by the remnant model"
                if instrumental
                else '; covariance="hac" allows for a coloured one'
            )
        ]
        if not (instrumental or by_errors):
            notes.append(CLOSED_LOOP.format('. method="iv" removes it'))
        if instrumental and set(self.inputs_) <= set(self.instruments_):
            notes.append(
                "The inputs are their own instruments: right only where nothing feeds the output "
                "back to them."
            )
        notes.append(JUDGE.format(", AIC and BIC are" if criteria else " is"))
        if criteria:
            notes.append("AIC and BIC omit constants; compare them only on the same rows.")
        return ModelSummary(
            self._title(),
            facts,
            estimates_table(self.parameters_),
            notes,
        )


def refuse_weights(weights: np.ndarray | None, by: str) -> None:
    """Refuse weights that differ, other than by leaving rows out, where they cannot be obeyed."""
    if weights is not None and np.ptp(weights[weights > 0.0]) > 0.0:
        raise ValueError(
            f"{by} cannot weigh rows. sample_weight may say which rows were measured (0, and the "
            "same number elsewhere); for other weights use method='ols'."
        )
