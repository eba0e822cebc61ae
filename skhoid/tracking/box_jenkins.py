"""RecursiveBoxJenkins: a varying operator by recursive prediction errors, unbiased by remnant."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _kernels
from ..arx.orders import Orders
from .whitened import Start, WhitenedFilter, WhitenedRecursion, Window


class BoxJenkinsFilter(WhitenedFilter):
    """Prediction errors, from a start."""

    before = ()

    def __init__(
        self, start: Start, orders: Orders, lam: np.ndarray, dt: float, n_runs: int
    ) -> None:
        super().__init__(start, orders, lam, dt)
        self.advance = _kernels.whitened.prediction_errors
        self.forgetting = np.concatenate([np.sqrt(lam), self.shares])
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
    {orders, inputs}
    noise_order : int, default=8
        Order of D. Eight describe the remnant filters of the thesis, of orders 1 to 4; with 0 it is
        a recursive output error model. Nothing of D is forgotten, as people's remnant hardly
        changes.
    memory_time : float or one per parameter, default=None
        T0 in seconds. None: nothing is forgotten.
    init_window : float, default=30.72
        Seconds of data, or as many as there are, in which prediction errors in batch find theta0
        and D; from the first row that is not NaN.
    {store_covariance, roles, dt, run}

    Attributes
    ----------
    coef_path_ : ndarray of shape (n_instants, n_params)
        theta(t) = [f_1 ... b_0 ...] after each instant. Absent after ``partial_fit``.
    noise_path_ : ndarray of shape (n_instants, noise_order)
        Coefficients of D.
    {time_path_}
    coef_, noise_ar_ : ndarray
        The last theta and coefficients of D.
    a_, b_ : ndarray, ndarray or list of them
        The parts of ``coef_``: F without its first 1, and B.
    covariance_ : ndarray of shape (n_params, n_params)
        Covariance of ``coef_``: σ² R^-1 (1 + λ^n) / (1 + λ) after n updates.
    {standard_errors_, last_parameters_, covariance_path_}
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
    sufficient order does for any stationary remnant. With few seconds, estimates scatter so much
    that their mean is not the truth, and poles may become real and stay so: with 2.56 s and P_n =
    0.25 in half of single runs, with 5.12 s in one of fifty. The estimate lags behind changes by
    about the memory. Rows count from 2 s after the lags of a run are known. Where y or an input is
    NaN, nothing is updated or forgotten; inputs hold their last value.

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

    method_name = "recursive prediction errors"

    def __init__(
        self,
        na: int = 2,
        nb: Any = 2,
        nk: Any = 0,
        *,
        inputs: Any = None,
        noise_order: int = 8,
        memory_time: Any = None,
        init_window: float = 30.72,
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
        self.memory_time = memory_time
        self.init_window = init_window
        self.store_covariance = store_covariance
        self.roles = roles
        self.dt = dt
        self.run = run

    def _filter(self, window: Window, lam: np.ndarray, n_runs: int) -> BoxJenkinsFilter:
        return BoxJenkinsFilter(window.estimate(), self.orders_, lam, self.dt_, n_runs)
