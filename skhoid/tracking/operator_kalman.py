"""OperatorKalman: Kalman filters whose states are an operator's physical parameters."""

from __future__ import annotations

import warnings
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import Interval, StrOptions, fit_context
from ..arx.rls import Instants, window_rows
from ..arx.streaming import Streaming
from ..exceptions import PoorExcitationWarning
from ..preprocessing.base import as_fitted
from .kalman import (
    METHODS,
    NAMES,
    KalmanPlan,
    KalmanRows,
    Lanes,
    combined,
    make_lanes,
    run_lanes,
)
from .operator_path import OperatorPath, operator_frame

OFTEN = 0.1  # of updates at a bound, of which a warning tells
OF_RUNS = ("_path_frame", "time_path_", "_numbers", "one_step_errors_", "run_labels_")


class OperatorKalman(Streaming, OperatorPath):
    """Human operator whose physical parameters are followed by a Kalman filter.

    The neuromuscular system z'' = e(t - tau_e) - 2 zeta_nm omega_nm z' - omega_nm² z has the output
    u = omega_nm² (K_e z + K_edot z'), which is Eqs. 3-5 without a derivative of e. Its state and
    that of the remnant are estimated together with the logarithms of the five parameters, which
    are random walks.

    Parameters
    ----------
    method : {"ukf", "ekf", "dual_ekf"}, default="ukf"
        Unscented Kalman filter (Rojer and others 2019); extended Kalman filter; or two extended
        filters (Popovici, Zaal and Pool 2017), of the state with the gains, and of omega_nm,
        zeta_nm and tau_e, by the sensitivities of the state to them.
    process_noise : float, default=0.05
        Standard deviation of the change of ln K_e and ln K_edot in one second, in s^-1/2: the ratio
        of process to measurement noise, since that of the latter is estimated. More follows faster
        and is noisier. The logarithms of the other parameters change a tenth of it.
    remnant_order : {0, 1, 2, 3, 4}, default=1
        Order of the remnant's filter, 1 / (T_n s + 1)^m; 0 takes it as white. T_n is estimated in
        the first window.
    init : "batch" or dict, default="batch"
        Parameters to start from: a batch fit of the first window of each run
        (:class:`OperatorRegressor`), or ``{"K_e": ..., "K_edot": ..., "omega_nm": ...,
        "zeta_nm": ..., "tau_e": ...}`` in their units.
    init_window : float, default=25.0
        Seconds of the first window of each run, from its first row that is not NaN.
    fit_intercept : bool, default=False
        Whether the output has a constant part, such as a stick whose rest is not at zero. It is
        estimated in the first window, and kept. A warning tells of one that is left out.
    smooth : bool, default=False
        Smooth the path by also using later data (Rauch, Tung and Striebel 1965); not for streaming.
    {error, roles, dt, run}

    Attributes
    ----------
    {parameters_path_, time_path_, last_parameters_}
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        Innovations y - ŷ of each row of the fitted grid, NaN where nothing was measured.
    log_likelihood_ : float
        Of the innovations; to compare options on the same data.
    initial_parameters_ : dict
        Parameters from which the filter began.
    intercept_ : float
        Constant part of the output, in its unit; 0 without ``fit_intercept``.
    n_updates_ : int
        Measurements used.
    n_clamped_ : dict
        How often each parameter was held at a bound.
    {run_labels_, dt_, inputs_, jitter_, n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARX : Recursive least squares, faster and biased by coloured remnant.
    OperatorRegressor : The batch fit from which the filter begins.

    Notes
    -----
    State x = [ln omega, ln zeta, ln tau, ln K_e, ln K_edot, z, z', n]; the signs of the gains
    are those of the start. z moves by its exact zero-order hold with the delayed error, which is
    interpolated linearly between samples; e is what the operator saw, so remnant that went round
    the loop does not bias. The parameters' variance grows by Q_i = σ_i² dt with each measurement:
    where y is NaN, or the error a delay ago is not known, nothing is measured and nothing
    forgotten.

    The remnant's order-m filter and white noise are fitted by Whittle's likelihood to the residual
    of the start in the first window, from 0.1 to 4 Hz, where operators act: what is assumed about
    noise at low frequencies decides about bias and standard errors. Innovations of the last 10 s
    are compared with those of the window, and scale both noises.

    "ukf" has sigma points at ±√3 standard deviations, of the covariance before the step and of
    the predicted one. "ekf" has the slopes of the same functions. In "dual_ekf" the parameter
    filter weighs innovations with the whole variance that the state filter expects of them.

    Nothing diverges: omega_nm stays within 3 to 30 rad/s, zeta_nm within 0.05 to 1, tau_e within
    0.05 to 0.6 s, gains within a factor 50 of their start, standard deviations of logarithms within
    1; an innovation of more than four standard deviations counts as if it had more noise (Huber's
    weight), and covariances stay positive semidefinite. The constant covariance of Rojer and others
    was far less accurate here than the updated one.

    Several runs have a filter each and start from one batch fit of all their windows; their
    logarithms are combined at each time in the run by their inverse variances. Standard errors do
    not include the lag behind a sudden change.

    References
    ----------
    Rojer, Pool, van Paassen and Mulder, IFAC-PapersOnLine 52-19 (2019) 109-114. Popovici, Zaal and
    Pool, AIAA 2017-3666. Boer and Kenyon, IEEE Trans. SMC 28 (1998) 89-99. Rauch, Tung and
    Striebel, AIAA J. 3 (1965) 1445-1450. Julier and Uhlmann, Proc. IEEE 92 (2004) 401-422.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.tracking.operator_kalman import OperatorKalman
    >>> X, y = make_tracking_runs("C4", n_runs=2, remnant_intensity=0.05, random_state=0)
    >>> model = OperatorKalman().fit(X, y)
    >>> path = model.parameters_path_
    >>> path.shape
    (8192, 12)
    >>> bool(path["K_edot"].iloc[-1] > 1.5 * path["K_edot"].loc[20.0])
    True
    """

    _parameter_constraints: dict = {
        **OperatorPath._parameter_constraints,
        "method": [StrOptions(set(METHODS))],
        "process_noise": [Interval(Real, 0, 1e3, closed="left")],
        "remnant_order": [Interval(Integral, 0, 4, closed="both")],
        "init": [StrOptions({"batch"}), dict],
        "init_window": [Interval(Real, 0, 1e6, closed="neither")],
        "fit_intercept": ["boolean"],
        "smooth": ["boolean"],
    }

    def __init__(
        self,
        method: str = "ukf",
        *,
        process_noise: float = 0.05,
        remnant_order: int = 1,
        init: Any = "batch",
        init_window: float = 25.0,
        fit_intercept: bool = False,
        smooth: bool = False,
        inputs: Any = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.method = method
        self.process_noise = process_noise
        self.remnant_order = remnant_order
        self.init = init
        self.init_window = init_window
        self.fit_intercept = fit_intercept
        self.smooth = smooth
        self.inputs = inputs
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> OperatorKalman:
        """Run the filter over recorded runs.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : OperatorKalman

        Raises
        ------
        ShortRunError, RankDeficiencyError
            If the first window does not suffice for the batch fit.
        UsageError
            If there is more than one input.
        """
        data = self._read_operator_data(X, y)
        instants = Instants.of(data.grid)
        lanes = make_lanes(data, instants)
        plan = KalmanPlan(self, self.dt_)
        start = plan.start(lanes.windows(window_rows(self.init_window, self.dt_)))
        filters = [KalmanRows(plan, start) for _ in range(lanes.n_lanes)]
        found = run_lanes(filters, lanes, smooth=self.smooth)
        self._end_stream(*OF_RUNS)
        self._start, self._filters = start, filters
        self.run_labels_ = list(data.grid.layout.labels)
        self.one_step_errors_ = found.errors[instants.run, instants.of_row]
        values, deviations = combined(found.path, found.present, start)
        self._set_path(instants.number, values, deviations)
        if lanes.n_lanes == 1 and data.grid.rows is None:
            self._leave_for_streams(filters[0], data.grid.layout)
        self._tell_of_bounds()
        return self

    def _tell_of_bounds(self) -> None:
        often = {
            name: n for name, n in self.n_clamped_.items() if n > OFTEN * max(self.n_updates_, 1)
        }
        if often:
            told = ", ".join(f"{name} {n} times" for name, n in often.items())
            warnings.warn(
                f"Of {self.n_updates_} updates, parameters were held at their bounds: {told}. The "
                "standard errors do not count there. Give less process_noise, or init={...}.",
                PoorExcitationWarning,
                stacklevel=3,
            )

    def _begun(self, X: np.ndarray, y: np.ndarray, fresh: np.ndarray) -> KalmanRows | None:
        self._check_one_input()
        plan = KalmanPlan(self, self.dt_)
        lanes = Lanes.of_rows(X[:, 0], y, fresh)
        start = plan.start(lanes.windows(window_rows(self.init_window, self.dt_)))
        return KalmanRows(plan, start)

    def _check_streaming(self) -> None:
        if self.smooth and "_path" not in vars(self):
            raise ValueError(
                "partial_fit cannot start with smooth=True, which needs whole runs. Call fit on "
                "recorded runs first."
            )

    def _refresh(self, row_filter: KalmanRows) -> None:
        attributes = self.__dict__
        for name in OF_RUNS:
            attributes.pop(name, None)
        attributes["_path"] = row_filter.latest()
        attributes["_filters"] = [row_filter]
        attributes["_start"] = row_filter.start

    @property
    def _last_frame(self) -> pd.DataFrame:
        path = self._filters[0].last_path()
        values, deviations = combined(path, np.ones((1, 1), dtype=bool), self._start)
        return operator_frame(values, deviations, None)

    def _count(self, name: str, size: int = 1) -> np.ndarray:
        self._check_fitted()
        return np.sum([f.number(name, size) for f in self._filters], axis=0)

    @property
    def n_updates_(self) -> int:
        return int(self._count("updates")[0])

    @property
    def n_clamped_(self) -> dict[str, int]:
        return dict(zip(NAMES, self._count("clamped", 5).astype(int).tolist(), strict=True))

    @property
    def log_likelihood_(self) -> float:
        total = self._count("squares")[0] + self._count("logs")[0]
        return float(-0.5 * (total + self.n_updates_ * np.log(2 * np.pi)))

    @property
    def initial_parameters_(self) -> dict[str, float]:
        self._check_fitted()
        return dict(zip(NAMES, self._start.parameters.tolist(), strict=True))

    @property
    def intercept_(self) -> float:
        self._check_fitted()
        return self._start.intercept

    def _constant_part(self) -> float:
        return self.intercept_

    def _method_name(self) -> str:
        told = as_fitted(self)
        return f"{METHODS[told.method]}{', smoothed' if told.smooth else ''}"
