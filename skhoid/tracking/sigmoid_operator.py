"""SigmoidOperator: maximum likelihood of an operator whose parameters follow sigmoids in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import expit

from .._sklearn import fit_context
from .operator_fitting import (
    NOISE_ORDER,
    ROUGHLY,
    OperatorFit,
    OperatorRecord,
    OperatorSearch,
    Pieces,
    too_short,
)
from .operator_path import OperatorPath

VARYING = ("K_e", "K_edot", "omega_nm", "zeta_nm")
RATES = (0.03, 100.0)  # 1/s, bounds of G
STARTING_RATES = (0.3, 1.0, 4.0)  # 1/s
N_MIDDLES = 24  # starts of M, evenly over the record
N_REFINED = 4  # of the best starts
N_DYNAMIC = 5  # before those of sigmoids, as in the kernel
FOREVER = 1e9  # s
NEAREST, N_AWAY = 0.02, 14  # s from M, and number of places on each side, that may be as likely
REACH = 2.0  # standard errors, within which places count
FLATTER, N_RATES = 4.0, 7  # below log G, and number of rates up to the greatest, that may be so
APART = 2  # steps of M between those


class SigmoidOperator(OperatorPath):
    """Operator whose parameters follow sigmoids in time, by maximum likelihood.

    p(t) = p_1 + (p_2 - p_1) / (1 + exp(-G (t - M))) (Eq. 2 of the thesis) for the parameters that
    vary, in u = H_nm(s) [K_e + K_edot s] exp(-s tau_e) e + n (Eqs. 3-5); the others are constant,
    and the remnant n is an AR process estimated along with them.

    Parameters
    ----------
    varying : sequence of {"K_e", "K_edot", "omega_nm", "zeta_nm"}, default=("K_e", "K_edot")
        Which parameters vary; all share G (0.03 to 100 per second) and M.
    {error, roles, dt, run}

    Attributes
    ----------
    transition_ : DataFrame of shape (n_varying, 8)
        For each parameter that varies: ``initial`` and ``final`` (p_1 and p_2), ``rate`` (G in
        1/s), ``time`` (M in s in the run) and their standard errors ``sd_initial`` ... A G or M at
        a bound has none.
    {parameters_path_}
    parameters_ : DataFrame
        Those at the end: value, sd, low and high (95 % interval), unit, meaning.
    time_path_ : ndarray of shape (n_instants,)
        Instants in s.
    constant_ : dict
        Parameters of the likeliest operator without any change.
    likelihood_ratio_ : float
        n log of the ratio of the squares of prediction errors without and with the change. Without
        a change it seldom exceeds 12 for two gains with common G and M.
    noise_ar_ : ndarray of shape (6,)
        Coefficients a_1 ... of the remnant, A(q) n = white noise, at the rate of the criterion.
    noise_variance_ : float
        Variance of that white noise.
    {dt_}
    inputs_ : list of str
        Name of the error channel.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    WindowedOperator : Maximum likelihood without a shape in time.
    skhoid.effects.TimeVaryingGain : The same sigmoid as an effect, for ``OperatorRegressor``.

    Notes
    -----
    Gains vary where the error enters, before the delay, as in :class:`~skhoid.HumanOperator`: K_e(t
    - tau_e) acts on e(t - tau_e). The criterion is that of :class:`WindowedOperator` over the whole
    record, all runs pooled at the same time in the run, each with states of its own.

    Gains before and after are linear and are solved for. A grid of M (24) and G (3) with the
    dynamics of a constant operator takes the place of the genetic search of the literature; the
    best four, apart in M, are refined by Levenberg-Marquardt.

    Standard errors allow for a remnant that changes in size along with the operator: they are
    N^-1 S N^-1 (White 1980) with the Fisher information N of all parameters, the AR model included,
    and S the same with rows weighed by the squares of prediction errors. Those of G and M are at
    least a quarter as wide as where n log(squares) is within 4 of its best; for sudden changes that
    is still too small. They mean little if nothing changes.

    References
    ----------
    Zaal, Manual control adaptation to changing vehicle dynamics in roll-pitch control tasks (2016).
    Van Grootheest, thesis, Eq. 2. White, A heteroskedasticity-consistent covariance matrix
    estimator and a direct test for heteroskedasticity (1980).

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.tracking.sigmoid_operator import SigmoidOperator
    >>> X, y = make_tracking_runs("C3", n_runs=1, remnant_intensity=0.05, random_state=0)
    >>> model = SigmoidOperator().fit(X, y)
    >>> model.transition_.loc["K_e", ["initial", "final"]].round(2).tolist()
    [0.09, 0.07]
    """

    _parameter_constraints: dict = {
        **OperatorPath._parameter_constraints,
        "varying": ["array-like", tuple, str],
    }

    def __init__(
        self,
        *,
        varying: Sequence[str] = ("K_e", "K_edot"),
        inputs: Any = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ):
        self.varying = varying
        self.inputs = inputs
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> SigmoidOperator:
        """Fit an operator with sigmoids to all runs together.

        Parameters
        ----------
        {X, y}

        Returns
        -------
        self : SigmoidOperator
        """
        varying = self._varying()
        data = self._read_operator_data(X, y)
        held = self._hold(data.grid, data.grid.thin_inputs(data.values), self._columns)
        e = held.column(0, slice(None)).astype(float)
        record = OperatorRecord.of(data, e)
        first, last = int(record.number.min()), int(record.number.max()) + 1
        share_of = [0 if name in varying else -1 for name in VARYING]
        log_rates = np.log(RATES[0]), np.log(RATES[1])
        span = float(record.time.min()), float(record.time.max())
        search = OperatorSearch.of(record, share_of, [(log_rates, span)])
        pieces = record.enough(first, last, NOISE_ORDER, search.n_parameters)
        if pieces is None:
            raise too_short(type(self).__name__, record, search.n_parameters, len(e))
        plain = OperatorSearch.of(record).started(pieces, NOISE_ORDER)
        fit = self._from_grid(search, pieces, plain)
        fit = widened(search, pieces, fit)
        self.constant_ = plain.values()
        self.likelihood_ratio_ = plain.loss - fit.loss
        self.noise_ar_, self.noise_variance_ = fit.ar, fit.squares / fit.n_rows
        self._set_transitions(fit, search.share_of)
        self._set_sigmoids(np.arange(first, last), fit, search.share_of)
        return self

    def _varying(self) -> list[str]:
        names = [self.varying] if isinstance(self.varying, str) else list(self.varying)
        known = [name for name in names if isinstance(name, str) and name in VARYING]
        if not names or known != names or len(set(names)) < len(names):
            raise ValueError(
                f"varying must list some of {list(VARYING)}, each once; got {self.varying!r}."
            )
        return [name for name in VARYING if name in names]

    def _from_grid(self, search: OperatorSearch, pieces: Pieces, plain: OperatorFit) -> OperatorFit:
        """The best of several fits, from the best of a grid of G and M."""
        middles = np.linspace(search.low[-1], search.high[-1], N_MIDDLES + 2)[1:-1]
        rates = np.clip(np.log(STARTING_RATES), search.low[-2], search.high[-2])
        sigmoids = np.array([*product(rates, middles)])
        points = np.hstack([np.tile(plain.dynamics[:N_DYNAMIC], (len(sigmoids), 1)), sigmoids])
        points[:, 3:5] = plain.dynamics[:2]
        squares = search.scanned(pieces, points, plain.ar).reshape(len(rates), -1)
        chosen: list[int] = []
        for at in np.argsort(squares.min(axis=0), kind="stable").tolist():
            if all(abs(at - other) >= APART for other in chosen):
                chosen.append(at)
        fits = []
        for at in chosen[:N_REFINED]:
            start = points[int(squares[:, at].argmin()) * N_MIDDLES + at]
            fits.append(search.fitted(pieces, start, plain.ar, ROUGHLY))
        best = min(fits, key=lambda fit: fit.squares)
        return search.fitted(pieces, best.dynamics, best.ar, robust=True)

    def _set_transitions(self, fit: OperatorFit, share_of: np.ndarray) -> None:
        rows = {}
        for i, name in enumerate(VARYING):
            if share_of[i] < 0:
                continue
            at = N_DYNAMIC + 2 * int(share_of[i])
            ends, slopes = followed(fit, share_of, i, np.array([-FOREVER, FOREVER]))
            sd = fit.sd_along(slopes)
            G, M = float(np.exp(fit.dynamics[at])), float(fit.dynamics[at + 1])
            rows[name] = [
                ends[0],
                sd[0],
                ends[1],
                sd[1],
                G,
                G * fit.find_sd(at),
                M,
                fit.find_sd(at + 1),
            ]
        names = [
            f"{sd}{name}" for name in ("initial", "final", "rate", "time") for sd in ("", "sd_")
        ]
        self.transition_ = pd.DataFrame.from_dict(rows, orient="index", columns=names)

    def _set_sigmoids(self, numbers: np.ndarray, fit: OperatorFit, share_of: np.ndarray) -> None:
        t = numbers * self.dt_
        found = {name: followed(fit, share_of, i, t) for i, name in enumerate(VARYING)}
        values = {name: path for name, (path, _) in found.items()}
        deviations = {name: fit.sd_along(slopes) for name, (_, slopes) in found.items()}
        lead = values["K_edot"] / values["K_e"]
        of_lead = found["K_edot"][1] - lead[:, None] * found["K_e"][1]
        deviations["T_L"] = fit.sd_along(of_lead / values["K_e"][:, None])
        values["tau_e"] = np.full(t.size, fit.dynamics[2])
        deviations["tau_e"] = np.full(t.size, fit.find_sd(2))
        self._set_path(numbers, values, deviations)
        # Predictions take gains when the delay is over, but here they act before it.
        ago = numbers - fit.dynamics[2] / self.dt_
        self._path[:, :2] = np.transpose(
            [np.interp(ago, numbers, values[name]) for name in VARYING[:2]]
        )

    def _method_name(self) -> str:
        return f"maximum likelihood, sigmoids in {' and '.join(self.transition_.index)}"


def widened(search: OperatorSearch, pieces: Pieces, fit: OperatorFit) -> OperatorFit:
    """The fit, with standard errors of G and M that reach as far as is about as likely."""
    factors = np.ones(len(fit.covariance))
    for rate in range(N_DYNAMIC, fit.dynamics.size, 2):
        G, M = fit.dynamics[rate : rate + 2]
        low, high = search.low[rate : rate + 2], search.high[rate : rate + 2]
        reach = np.geomspace(NEAREST, (high[1] - low[1]) / 4, N_AWAY)
        middles = np.clip(M + np.concatenate([-reach, [0.0], reach]), low[1], high[1])
        rates = np.append(np.linspace(max(low[0], G - FLATTER), high[0], N_RATES), G)
        points = np.tile(fit.dynamics, (rates.size * middles.size, 1))
        points[:, rate : rate + 2] = [*product(rates, middles)]
        squares = search.scanned(pieces, points, fit.ar)
        loss = fit.n_rows * np.log(squares / fit.squares)
        likely = points[loss <= REACH**2, rate : rate + 2]
        for dynamic, found in zip((rate, rate + 1), likely.T, strict=True):
            sd = fit.find_sd(dynamic)
            if found.size and 0.0 < sd < np.inf:
                factors[fit.find_column(dynamic)] = max(1.0, np.ptp(found) / (2 * REACH * sd))
    return replace(fit, covariance=fit.covariance * np.outer(factors, factors))


def followed(
    fit: OperatorFit, share_of: np.ndarray, which: int, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A parameter of ``VARYING`` over time, and its derivatives to the parameters of a fit."""
    slopes = np.zeros((t.size, len(fit.covariance)))
    q, gain = fit.dynamics, which < 2
    first = which if gain else fit.find_column(which - 2)
    initial = fit.gains[which] if gain else np.exp(q[which - 2])
    by_first = 1.0 if gain else initial
    if share_of[which] < 0:
        slopes[:, first] = by_first
        return np.full(t.size, initial), slopes
    at = N_DYNAMIC + 2 * int(share_of[which])
    G, away = np.exp(q[at]), t - q[at + 1]
    share = expit(G * away)
    if gain:
        later = 2 + int(which == 1 and share_of[0] >= 0)
        change = fit.gains[later]
        slopes[:, first], slopes[:, later] = 1.0, share
    else:
        final = np.exp(q[which + 1])
        change, later = final - initial, fit.find_column(which + 1)
        slopes[:, first], slopes[:, later] = by_first * (1.0 - share), final * share
    steep = change * share * (1.0 - share) * G
    slopes[:, fit.find_column(at)] = steep * away
    slopes[:, fit.find_column(at + 1)] = -steep
    return initial + change * share, slopes
