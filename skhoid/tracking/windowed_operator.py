"""WindowedOperator: maximum likelihood in windows that slide along the run."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import Interval, fit_context
from ..exceptions import ShortRunError
from ..preprocessing.base import as_fitted
from .operator_fitting import (
    NOISE_ORDER,
    OperatorFit,
    OperatorRecord,
    OperatorSearch,
    Pieces,
    too_short,
)
from .operator_path import ESTIMATED, OperatorPath

BY_WINDOW = 1e-5  # of n log(SSE), where the fit of a window is settled: 0.003 standard errors


class WindowedOperator(OperatorPath):
    """Operator whose parameters are fitted by maximum likelihood in windows that slide along.

    In each window u = H_nm(s) [K_e + K_edot s] exp(-s tau_e) e + n (Eqs. 3-5) with constant
    parameters, states at the window's beginning that are free, and a remnant n that is an AR
    process estimated along with them. Its estimates belong to the middle of the window.

    Parameters
    ----------
    window : float, default=10.0
        Length of the windows in s.
    step : float, default=1.0
        Time from one window to the next, in s.
    {error, roles, dt, run}

    Attributes
    ----------
    parameters_path_ : DataFrame of shape (n_windows, 12)
        Over the time (s) of the windows' middles: K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm and
        their standard errors ``sd_K_e`` ...
    {last_parameters_}
    time_path_ : ndarray of shape (n_windows,)
        Middles of the windows in s.
    at_bound_ : ndarray of bool, shape (n_windows, 3)
        Whether omega_nm, zeta_nm and tau_e ended at a bound; such have no standard error.
    noise_ar_ : ndarray of shape (n_windows, 6)
        Coefficients a_1 ... of the remnant, A(q) n = white noise, at the rate of the criterion.
    noise_variance_ : ndarray of shape (n_windows,)
        Variance of that white noise.
    whole_ : dict
        Constant parameters fitted to the whole record, from which windows start too.
    {dt_}
    inputs_ : list of str
        Name of the error channel.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    SigmoidOperator : Maximum likelihood with a shape in time, on the whole record.
    OperatorRegressor : Constant parameters, with effects.

    Notes
    -----
    Each window minimises the squares of the errors of predictions one step ahead, A(q) (u -
    u_simulated), over omega_nm (2 to 40 rad/s), zeta_nm (0.02 to 2), tau_e (0.05 to 0.8 s) and
    A(q) by Levenberg-Marquardt, with the gains and states, which are linear, solved for. The
    simulation is under zero-order hold at the sampling rate, with the delayed error by Keys's cubic
    convolution; its errors count at 25 Hz, above which operators have hardly any power.

    Several runs are pooled: a window has the rows of all runs at the same time in the run, each run
    with states of its own. Where the error of the past is not known (start of a run, after a gap),
    the longest delay is left out, or a quarter of what there is if that is less.

    Standard errors are from the Fisher information of all parameters, the AR model included. They
    say how certain the constant parameters of a window are; neighbours share data, so their errors
    are alike. In simulated runs with a remnant of 15 % of the output's power, 95 % intervals of
    windows of 10 s cover 82 to 88 %, those of 20 s about 91 %, and those of 80 s 95 %.

    References
    ----------
    Zaal and Sweet, Estimation of time-varying pilot model parameters (2011). Keys, Cubic
    convolution interpolation for digital image processing (1981). Ljung, System identification:
    theory for the user (1999), for prediction errors in a closed loop.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.tracking.windowed_operator import WindowedOperator
    >>> X, y = make_tracking_runs("C4", n_runs=1, remnant_intensity=0.05, random_state=0)
    >>> model = WindowedOperator(window=15.0, step=5.0).fit(X, y)
    >>> model.parameters_path_.loc[[12.5, 67.5], "K_edot"].round(2).tolist()
    [0.04, 0.08]
    """

    _parameter_constraints: dict = {
        **OperatorPath._parameter_constraints,
        "window": [Interval(Real, 0, None, closed="neither")],
        "step": [Interval(Real, 0, None, closed="neither")],
    }

    def __init__(
        self,
        window: float = 10.0,
        step: float = 1.0,
        *,
        inputs: Any = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ):
        self.window = window
        self.step = step
        self.inputs = inputs
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> WindowedOperator:
        """Fit an operator to each window.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : WindowedOperator
        """
        data = self._read_operator_data(X, y)
        held = self._hold(data.grid, data.grid.thin_inputs(data.values), self._columns)
        e = held.column(0, slice(None)).astype(float)
        record = OperatorRecord.of(data, e)
        search = OperatorSearch.of(record)
        firsts, length = self._windows(record)
        fits, used = self._fits(search, firsts, length, len(e))
        middles = np.array(used) + length // 2
        tables = ([fit.values() for fit in fits], [fit.deviations() for fit in fits])
        values, deviations = (
            {name: np.array([row[name] for row in rows]) for name in (*ESTIMATED, "T_L")[:n]}
            for rows, n in zip(tables, (5, 6), strict=True)
        )
        self._set_path(middles, values, deviations)
        self.at_bound_ = np.stack([fit.stuck for fit in fits])
        self.noise_ar_ = np.zeros((len(fits), NOISE_ORDER))
        for row, fit in zip(self.noise_ar_, fits, strict=True):
            row[: fit.ar.size] = fit.ar
        self.noise_variance_ = np.array([fit.squares / fit.n_rows for fit in fits])
        return self

    def _windows(self, record: OperatorRecord) -> tuple[np.ndarray, int]:
        """First sample numbers of the windows, and how many samples they have."""
        length = max(1, round(self.window / record.dt))
        step = max(1, round(self.step / record.dt))
        first = record.number[record.stretches[:, 0]]
        past = first + record.stretches[:, 1] - record.stretches[:, 0]
        longest = int((past - first).max(initial=0))
        if longest < length:
            raise ShortRunError(
                f"WindowedOperator: window = {self.window:g} s, but the longest stretch without a "
                f"gap has {longest * record.dt:.6g} s (n_samples = {len(record.e)} rows of X). Use "
                "a shorter window, or longer runs."
            )
        return np.arange(int(first.min()), int(past.max()) - length + 1, step), length

    def _fits(
        self, search: OperatorSearch, firsts: np.ndarray, length: int, n_samples: int
    ) -> tuple[list[OperatorFit], list[int]]:
        """Fits of the windows that have enough rows, and their first sample numbers."""
        record, needed = search.record, search.n_parameters
        begin, end = int(firsts[0]), int(record.number.max()) + 1
        whole = record.enough(begin, end, NOISE_ORDER, needed)
        if whole is None:
            raise too_short(type(self).__name__, record, needed, n_samples)
        general = search.started(whole, NOISE_ORDER)
        self.whole_ = general.values()
        fits: list[OperatorFit] = []
        used: list[int] = []
        for first in firsts.tolist():
            pieces = record.enough(first, first + length, NOISE_ORDER, needed)
            if pieces is None:
                continue
            fits.append(self._likeliest(search, pieces, fits[-1] if fits else general, general))
            used.append(first)
        if not fits:
            raise too_short(type(self).__name__, record, needed, n_samples)
        return fits, used

    def _likeliest(
        self, search: OperatorSearch, pieces: Pieces, before: OperatorFit, general: OperatorFit
    ) -> OperatorFit:
        """From the window before, and from the whole record where that ends at a bound."""
        fit = search.fitted(pieces, before.dynamics, before.ar, BY_WINDOW)
        if not fit.stuck.any():
            return fit
        other = search.fitted(pieces, general.dynamics, general.ar, BY_WINDOW)
        return min(fit, other, key=lambda one: one.squares)

    def _method_name(self) -> str:
        told = as_fitted(self)
        return f"maximum likelihood in windows of {told.window:g} s, {told.step:g} s apart"
