"""RecursiveBoxJenkins: a varying operator by recursive prediction errors, unbiased by remnant."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from .. import _kernels
from .._sklearn import StrOptions, fit_context
from ..arx.orders import Orders
from .whitened import CONSTRAINTS, Start, WhitenedFilter, WhitenedRecursion, Window, stabilised


class BoxJenkinsFilter(WhitenedFilter):
    """Prediction errors, from a start."""

    before = ()

    def __init__(
        self, start: Start, orders: Orders, lam: np.ndarray, dt: float, n_runs: int
    ) -> None:
        super().__init__(start, orders, lam, dt)
        self.advance = _kernels.whitened.prediction_errors
        self.forgetting = np.concatenate([np.sqrt(lam[:-1]), self.shares])
        self.shared = np.concatenate([self.worth * start.information.ravel(), self.largest])
        na, nd = orders.na, start.d.size
        length = 2 + 3 * (na + 1) + 2 * nd + 1
        for nb, nk in zip(orders.nb, orders.nk, strict=True):
            length += nk + nb + nd + max(nb + nd, na + 1) + nb
        self.memory = np.zeros((n_runs, length))

    @property
    def information(self) -> np.ndarray:
        return self.shared[: self.n**2].reshape(self.n, self.n)


class RecursiveBoxJenkins(WhitenedRecursion):
    """Box-Jenkins model whose parameters follow the data, by recursive prediction errors.

    u = B(q)/F(q) e(t - nk) + 1/D(q) eps: a simulation of the operator plus remnant with a spectrum
    of its own. Recursive least squares (:class:`RecursiveARX`) gives the remnant the poles of the
    operator instead, which biases its parameters where the remnant has others. With w = B/F e and
    v = u - w, at each instant

    eps = D u - B/F (D e), psi = D/F [-w(t-1) ... e(t-nk) ...], R = ΛRΛ + psi psi',
    theta += R^-1 psi eps

    and D follows v by least squares, with a memory of its own.

    Parameters
    ----------
    na, nb, nk : int, or one per input for nb and nk, default=2, 2, 0
        Orders of F and B, and input delay in samples, as for :class:`RecursiveARX`.
    {inputs}
    noise_order : int, default=8
        Order of D. Eight describe the remnant filters of the thesis, of orders 1 to 4.
    forgetting, memory_horizon, memory_time : float or one per parameter, default=None
        λ, N0 in samples, or T0 in seconds; at most one. None: nothing is forgotten.
    noise_memory_time : float or None, default=None
        T0 of D in seconds. None: nothing is forgotten, as people's remnant hardly changes.
    init : "pem" or array of shape (n_params,), default="pem"
        theta0: by prediction errors in batch on the first ``init_window`` seconds, or given; D
        comes from that window in both cases.
    init_window : float, default=30.72
        Seconds of data from the first row that is not NaN, or as many as there are.
    parameters : {"path", "last"}, default="path"
        What predictions use: theta at the same time in the run, or the last one.
    store_covariance : bool, default=False
        Keep ``covariance_path_``.
    {roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        theta(t) = [f_1 ... b_0 ...] after each instant. Absent after ``partial_fit``.
    noise_path_ : ndarray of shape (n_instants, noise_order)
        Coefficients of D.
    time_path_ : ndarray of shape (n_instants,)
        Time in the run in seconds.
    coef_, noise_ar_ : ndarray
        The last theta and coefficients of D.
    a_, b_ : ndarray, ndarray or list of them
        The parts of ``coef_``: F without its first 1, and B.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``: σ² R^-1 (1 + λ^n) / (1 + λ) after n updates.
    standard_errors_ : ndarray of shape (n_params,)
        Square roots of its diagonal.
    parameters_ : DataFrame
        The last parameters: value, sd, low and high (95 % interval), unit, meaning.
    covariance_path_ : ndarray of shape (n_instants, n_params, n_params)
        Covariance of ``coef_path_``; with ``store_covariance``.
    one_step_errors_ : ndarray of shape (n_grid_rows,)
        eps of each row of the fitted grid by the estimates before it; NaN where there was no
        update.
    noise_variance_ : float
        σ², the mean of eps².
    forgetting_ : float or ndarray
        λ used.
    memory_horizon_ : float or ndarray
        1 / (1 - λ) in samples.
    initial_coef_ : ndarray of shape (n_params,)
        theta0.
    n_updates_, n_held_ : int
        Updates; and instants at which nothing was forgotten, as no information came.
    {parameter_names_, dt_, inputs_, n_features_in_, feature_names_in_}

    See Also
    --------
    RecursiveARX : Least squares: faster, of less variance, biased by coloured remnant.
    RecursiveIV : Unbiased too where a target is known, whatever the remnant.
    operator_parameters : Turns the path into parameters of the operator.

    Notes
    -----
    The textbook's recursion (Ljung and Söderström 1983) often diverges with short memories (Ortiz
    Moya 2025). Here

    - the signals are whitened first and simulated then. The other way round, D would take every
      step of theta for noise, and amplify it: remnant of order 4 makes D large where steps are;
    - the gradient is filtered by an F that follows the estimate with a lag of the memory: psi of a
      slightly older F is still a descent direction, and what R holds stays comparable;
    - steps that would take a pole of F out of the unit circle are halved until they do not. As R
      contains psi psi', a step never raises the error of its own instant, to first order;
    - D is a moving average of v and needs no projection; its least squares are stored in factors
      (Bierman 1977). Errors of more than two standard deviations, as a change of the operator
      makes them, count less in it, the less the larger they are.

    In a closed loop the estimate is unbiased if the noise model holds: an autoregressive one of
    sufficient order does for any stationary remnant. It is so for long memories; with few seconds,
    estimates scatter so much that their mean is not the truth, and poles may become real and stay
    so: with 2.56 s and P_n = 0.25 in half of single runs, with 5.12 s in one of fifty. The estimate
    lags behind changes by about the memory. Rows count from 2 s after the lags of a run are known.
    Where y or an input is NaN, nothing is updated or forgotten; inputs hold their last value.

    References
    ----------
    Ljung and Söderström, Theory and Practice of Recursive Identification (1983), ch. 3. Ortiz Moya,
    thesis, TU Delft (2025). Steiglitz and McBride, IEEE Trans. Autom. Control 10 (1965) 461-464.

    Examples
    --------
    >>> from skhoid import RecursiveBoxJenkins, make_tracking_runs, operator_parameters
    >>> X, y = make_tracking_runs("C1", n_runs=3, remnant_intensity=0.1, random_state=1)
    >>> model = RecursiveBoxJenkins(nk=29, memory_time=10.24).fit(X, y)
    >>> operator_parameters(model)[["K_e", "K_edot", "omega_nm"]].iloc[-1].round(2).tolist()
    [0.09, 0.04, 11.2]
    """

    _parameter_constraints: dict = {**CONSTRAINTS, "init": [StrOptions({"pem"}), "array-like"]}
    method_name = "recursive prediction errors"

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        noise_order: int = 8,
        forgetting: Any = None,
        memory_horizon: Any = None,
        memory_time: Any = None,
        noise_memory_time: float | None = None,
        init: Any = "pem",
        init_window: float = 30.72,
        parameters: str = "path",
        store_covariance: bool = False,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.na = na
        self.nb = nb
        self.nk = nk
        self.inputs = inputs
        self.noise_order = noise_order
        self.forgetting = forgetting
        self.memory_horizon = memory_horizon
        self.memory_time = memory_time
        self.noise_memory_time = noise_memory_time
        self.init = init
        self.init_window = init_window
        self.parameters = parameters
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> Self:
        """Run the recursion over recorded runs, all at once, aligned by time in the run.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : RecursiveBoxJenkins

        Raises
        ------
        ValueError
            If forgetting or init do not fit the model.
        ShortRunError
            If the first window has too few rows for the model of the noise.
        RunIndexError, IrregularSamplingError
            If rows, runs or time violate the data convention.

        Warns
        -----
        MissingDataWarning
            With the number of rows that are NaN.
        """
        return self._fit_recursion(X, y)

    def _given_start(self) -> np.ndarray:
        names = self.parameter_names_
        try:
            theta = np.array(self.init, dtype=np.float64)
        except (TypeError, ValueError):
            theta = np.empty(0)
        if theta.shape != (len(names),) or not np.isfinite(theta).all():
            raise ValueError(
                f"init must be 'pem' or theta0: {len(names)} finite numbers for "
                f"{', '.join(names)}; got {self.init!r}."
            )
        return stabilised(theta, self.orders_.na)

    def _filter(self, window: Window, lam: np.ndarray, n_runs: int) -> BoxJenkinsFilter:
        by_name = isinstance(self.init, str)
        start = window.estimate() if by_name else window.at(self._given_start())
        return BoxJenkinsFilter(start, self.orders_, lam, self.dt_, n_runs)
