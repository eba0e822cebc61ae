"""WaveletOperator: an operator fitted at each instant to responses that wavelets estimate."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import fftconvolve, find_peaks
from scipy.signal.windows import blackmanharris

from .._sklearn import Interval, fit_context
from ..arx.rls import grid_numbers
from ..exceptions import RankDeficiencyError, ShortRunError, UsageError
from ..interpret.response_fit import ResponseFit
from ..preprocessing.base import as_fitted
from ..preprocessing.grid import bridged
from ..regression import DataToFit
from ..runs.roles import columns_by_role
from .operator_fitting import DYNAMICS, LIMITS, STARTS
from .operator_path import ESTIMATED, OperatorPath

LEAK = 0.01  # of abs(H), an error of any response by wavelets
N_DATA = 2  # real numbers in a complex one


class ResponseFits(NamedTuple):
    """Values and standard errors, one row a response.

    Columns are K_e, K_edot, tau_e, omega_nm, zeta_nm, T_L; ``stuck`` says which of omega_nm,
    zeta_nm and tau_e are at a bound.
    """

    values: np.ndarray
    deviations: np.ndarray
    stuck: np.ndarray


def fit_responses(
    omega: np.ndarray,
    H: np.ndarray,
    sd: np.ndarray,
    dt: float,
) -> ResponseFits:
    """Fit an operator to each response of an array (n, n_frequencies), NaN if unknown."""
    low, high = np.transpose(
        [[-np.inf, np.inf]] * 2
        + [np.log(LIMITS["omega_nm"]), np.log(LIMITS["zeta_nm"]), LIMITS["tau_e"]]
    )
    known = np.isfinite(H)
    H = np.where(known, H, 0.0)
    spread = np.hypot(np.where(np.isfinite(sd), sd, 0.0), LEAK * abs(H))
    weight = np.where(known, np.sqrt(2.0) / np.maximum(spread, 1e-300), 0.0)
    model = SampledOperator(omega, dt)
    grid = [
        np.array([np.log(omega), np.log(zeta), tau])
        for omega, zeta, tau in product(*(STARTS[name] for name in DYNAMICS))
    ]
    total = (weight**2).sum(axis=0)
    mean = (weight**2 * H).sum(axis=0) / np.maximum(total, 1e-300)
    together = ResponseFit(model, mean[None], np.sqrt(total)[None], low, high)
    general, _ = together.find_best_minima(together.starts(grid, positive=True))
    fit = ResponseFit(model, H, weight, low, high)
    own = fit.starts(grid, positive=True)
    p, _ = fit.find_best_minima([*own, np.tile(general, (len(H), 1))])
    return _finished(fit, p)


class SampledOperator:
    """Responses of an operator whose output holds half a sample on average."""

    def __init__(self, omega: np.ndarray, dt: float) -> None:
        self.s, self.dt = 1j * omega, dt

    def _filter(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Response to a gain of 1, with delay and hold, and derivatives of its log."""
        natural, zeta, tau = np.exp(p[:, 2:3]), np.exp(p[:, 3:4]), p[:, 4:5]
        damped, square = 2 * zeta * natural * self.s, natural**2
        below = self.s**2 + damped + square
        by_omega = 2 - (damped + 2 * square) / below
        return square / below * np.exp(-self.s * (tau + self.dt / 2)), by_omega, -damped / below

    def gains(self, p: np.ndarray) -> np.ndarray:
        unit = self._filter(p)[0]
        return np.stack([unit, unit * self.s], axis=-1)

    def slopes(self, p: np.ndarray) -> np.ndarray:
        unit, by_omega, by_zeta = self._filter(p)
        whole = unit * (p[:, :1] + p[:, 1:2] * self.s)
        columns = [unit, unit * self.s, whole * by_omega, whole * by_zeta, -self.s * whole]
        return np.stack(columns, axis=-1)


def _finished(fit: ResponseFit, p: np.ndarray) -> ResponseFits:
    """Values and standard errors; these grow with a misfit beyond what weights allow."""
    stuck = ((p <= fit.low) | (p >= fit.high))[:, 2:]
    residuals, slopes = fit.look(p)
    normal, _ = fit.normal_equations(p, residuals, slopes)
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
    inverse = np.linalg.pinv(normal / (scale[:, :, None] * scale[:, None, :]), 1e-12, True)
    covariance = inverse / (scale[:, :, None] * scale[:, None, :])
    degrees = np.maximum(N_DATA * (fit.weight > 0).sum(axis=1) - p.shape[1], 1)
    excess = np.maximum((residuals**2).sum(axis=1) / degrees, 1.0)
    covariance *= excess[:, None, None]
    sd = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
    sd[:, 2:][stuck] = np.nan
    natural, zeta = np.exp(p[:, 2]), np.exp(p[:, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        lead = p[:, 1] / p[:, 0]
        slope = np.stack([-lead, np.ones(len(p))], axis=1) / p[:, :1]
    of_lead = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", slope, covariance[:, :2, :2], slope), 0))
    return ResponseFits(
        np.stack([p[:, 0], p[:, 1], p[:, 4], natural, zeta, lead], axis=1),
        np.stack([sd[:, 0], sd[:, 1], sd[:, 4], natural * sd[:, 2], zeta * sd[:, 3], of_lead], 1),
        stuck,
    )


RATE = 25.0  # Hz, of the means that are transformed
CONE = 0.92  # share of a wavelet's envelope that must lie in the record: its edge is sqrt(2) sd off
AT_LEAST = 4  # frequencies, to fit five parameters
LINE = 1e-5  # of the power of the strongest line of a multisine
MOST_LINES, PURE, PERIODIC = 40, 0.9, 0.9999  # of a multisine, and least shares of the power
N_LOGARITHMIC = 12  # frequencies, if the target is no multisine
SCALES = ((-0.5, 0.25), (0.0, 0.5), (0.5, 0.25))  # smoothing: widths in frequency, weights
BAND = (0.2, 20.0)  # rad/s, of the frequencies where none are given
REACH = 4.0  # standard deviations of Gaussian smoothing


class WaveletOperator(OperatorPath):
    """Operator whose parameters are fitted at each instant to a response found by wavelets.

    H(w, t) = S{W_u conj(W_f)} / S{W_e conj(W_f)} with Morlet wavelet transforms W of output, error
    and target, and a smoothing S over time and scale: the target is an instrument, so that the
    remnant, which goes round the loop into the error, does not bias the ratio. Then, at each
    instant, K_e, K_edot, tau_e, omega_nm and zeta_nm of Eqs. 3-5 are fitted to H.

    Parameters
    ----------
    omega0 : float, default=8.0
        Frequency of the Morlet wavelet in rad per standard deviation of its envelope: at w the
        envelope has a standard deviation of ``omega0 / w`` seconds and of ``w / omega0`` rad/s.
    time_smoothing : float, default=1.5
        Standard deviation in time of the smoothing S, in those of the envelope. Zero is none, and
        leaves no standard errors.
    step : float, default=0.5
        Time from one instant to the next, in s.
    {error, roles, dt, run}

    Attributes
    ----------
    frequencies_ : ndarray of shape (n_frequencies,)
        In rad/s: the lines of the target from 0.2 to 20 rad/s if it is a multisine, else 12 on a
        log scale.
    frequency_response_ : ndarray of complex, shape (n_instants, n_frequencies)
        H; NaN outside the cone of influence.
    frequency_response_sd_ : ndarray of shape (n_instants, n_frequencies)
        Standard deviation of its distance from the true one in the complex plane.
    coherence_ : ndarray of shape (n_instants, n_frequencies)
        Squared coherence of output and instrument, from 0 to 1.
    parameters_path_ : DataFrame of shape (n_instants, 12)
        Over time (s): K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm and their standard errors
        ``sd_K_e`` ... NaN where fewer than four frequencies are known; predictions hold the
        nearest known values there.
    parameters_ : DataFrame
        Those of the last known instant: value, sd, low and high (95 % interval), unit, meaning.
    time_path_ : ndarray of shape (n_instants,)
        Instants in s.
    at_bound_ : ndarray of bool, shape (n_instants, 3)
        Whether omega_nm, zeta_nm and tau_e ended at a bound; such have no standard error.
    {dt_}
    inputs_ : list of str
        Name of the error channel.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    WindowedOperator : Less sensitive to the remnant.
    fourier_coefficients : The response of an operator that does not vary.

    Notes
    -----
    Signals are averaged to 25 Hz, differentiated, so that slow power does not leak into what is
    fast (both leave the ratio as it is), and transformed by ``pywt.cwt`` with the wavelet exp(-t²/2
    + i omega0 t). S weighs time by a Gaussian and takes three scales with weights 1/4, 1/2, 1/4.
    Several runs are pooled: S also sums over runs at the same time in the run. Missing output is
    interpolated and counts as not recorded. A transform counts where 92 % of its envelope lie in
    what was recorded, which is sqrt(2) standard deviations from an end: the cone of influence.

    The variance of H is S_rr S_ff / ((n - 1) abs(S_ef)²), with the smoothed spectrum S_rr of the
    residual W_u - H W_e, which is the remnant, and n = sqrt(1 + 2 time_smoothing²) averages in S,
    times the number of runs; plus 1 % of abs(H) for lines that leak into each other. Frequencies
    are taken as independent; instants share data, so their errors are alike. The hold of the fitted
    operator adds half a sample of delay to tau_e.

    References
    ----------
    Zaal and Sweet, Estimation of time-varying pilot model parameters (2011), for the two steps.
    Torrence and Compo, A practical guide to wavelet analysis (1998), for cone and smoothing.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.tracking.wavelet_operator import WaveletOperator
    >>> X, y = make_tracking_runs("C1", n_runs=1, channels=["e", "f_t"])
    >>> model = WaveletOperator().fit(X, y)  # doctest: +SKIP
    >>> model.parameters_path_.loc[41.0:42.0, "K_e"].round(2).tolist()  # doctest: +SKIP
    [0.09, 0.09, 0.09]
    """

    _parameter_constraints: dict = {
        **OperatorPath._parameter_constraints,
        "omega0": [Interval(Real, 2, 60, closed="both")],
        "time_smoothing": [Interval(Real, 0, 100, closed="both")],
        "step": [Interval(Real, 0, None, closed="neither")],
    }

    def __init__(
        self,
        *,
        omega0: float = 8.0,
        time_smoothing: float = 1.5,
        step: float = 0.5,
        inputs: Any = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ):
        self.omega0 = omega0
        self.time_smoothing = time_smoothing
        self.step = step
        self.inputs = inputs
        self.roles = roles
        self.dt = dt
        self.run = run

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any) -> WaveletOperator:
        """Find the frequency response over time, and fit an operator to it.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample: the error, and the target.
        {y}

        Returns
        -------
        self : WaveletOperator
        """
        pywt = require_wavelets()
        data = self._read_operator_data(X, y)
        signals = self._signals(data)
        blocks = Blocks.of(data, signals)
        self.frequencies_ = self._find_frequencies(blocks)
        spectra = self._spectra(pywt, blocks)
        step = max(1, round(self.step / blocks.dt))
        self._keep_response(spectra, slice(step // 2, None, step), blocks.n_runs)
        known = np.isfinite(self.frequency_response_)
        enough = known.sum(axis=1) >= AT_LEAST
        if not enough.any():
            raise ShortRunError(
                "WaveletOperator: no instant lies in the cone of influence of "
                f"{AT_LEAST} frequencies (n_samples = {len(signals)} rows of X). At "
                f"{self.frequencies_[-1]:.3g} rad/s a wavelet needs "
                f"{2**1.5 * self.omega0 / self.frequencies_[-1]:.3g} s, at lower ones more. Use "
                "longer runs, higher frequencies or a smaller omega0."
            )
        numbers = (blocks.first + np.arange(blocks.n)[step // 2 :: step]) * blocks.size
        self._fit_instants(enough, numbers + blocks.size // 2)
        return self

    def _signals(self, data: DataToFit) -> np.ndarray:
        """Output, error and instrument on the grid, in columns; output may be NaN."""
        grid = data.grid
        known = self._reading.names
        names = list(range(data.values.shape[1])) if known is None else list(known)
        positions, wanted = columns_by_role(names, self.roles), [self._columns[0]]
        if "f_t" in positions or "x" in positions:
            wanted.append(positions["f_t" if "f_t" in positions else "x"])
        else:
            raise UsageError(
                "WaveletOperator needs the target as its instrument, but X has no column of role "
                f"'f_t' (nor 'x' beside the error); the columns are {names}.",
                hint="Add it, or name it by roles={column: 'f_t'}.",
                options=["role"],
            )
        labels = [str(names[i]) for i in wanted]
        held = self._hold(grid, grid.thin_inputs(data.values), wanted, labels)[:]
        error, other = held[:, 0], held[:, -1]
        if "f_t" not in positions:
            other = other + error
        return np.stack([data.output, error, other], axis=1)

    def _find_frequencies(self, blocks: Blocks) -> np.ndarray:
        low, high = BAND[0], min(BAND[1], 0.9 * np.pi / blocks.dt)
        if high <= low:
            raise ValueError(
                f"A sampling time of {self.dt_:g} s allows responses up to {high:.3g} rad/s, and "
                f"operators are fitted to those from {low:g} rad/s on."
            )
        lines = blocks.lines(low, high)
        return lines if lines.size >= AT_LEAST else np.geomspace(low, high, N_LOGARITHMIC)

    def _spectra(self, pywt: Any, blocks: Blocks) -> np.ndarray:
        """Smoothed sums over runs of what H and its variance need, NaN outside the cone.

        Rows are S_uf, S_ef, S_ue, S_uu, S_ee, S_ff; of shape (6, n_frequencies, n_blocks).
        """
        wavelet = f"cmor2.0-{self.omega0 / (2 * np.pi)!r}"
        omega = self.frequencies_
        total = np.zeros((6, omega.size, blocks.n), dtype=complex)
        weight = np.zeros((omega.size, blocks.n))
        for begin, values, known in blocks.pieces:
            here = np.s_[..., begin : begin + len(values)]
            cross = np.zeros((6, omega.size, len(values)), dtype=complex)
            for place, share in SCALES:
                scales = self.omega0 / (omega * (1 + place / self.omega0) * blocks.dt)
                u, e, f = (
                    pywt.cwt(column, scales, wavelet, method="fft")[0] for column in values.T
                )
                pairs = ((u, f), (e, f), (u, e), (u, u), (e, e), (f, f))
                for row, (a, b) in zip(cross, pairs, strict=True):
                    row += share * a * b.conj()
            for i, width in enumerate(self.omega0 / omega / blocks.dt):
                covered = smoothed(known, width)
                inside = (covered >= CONE).astype(float)
                weight[i][here[1:]] += inside
                total[:, i][here] += cross[:, i] * inside
        for i, width in enumerate(self.time_smoothing * self.omega0 / omega / blocks.dt):
            outside = weight[i] == 0
            total[:, i] = smoothed(total[:, i], width)
            total[:, i, outside] = np.nan
        return total

    def _keep_response(self, spectra: np.ndarray, instants: slice, n_runs: int) -> None:
        uf, ef, ue, uu, ee, ff = np.swapaxes(spectra[:, :, instants], 1, 2)
        uu, ee, ff = uu.real, ee.real, ff.real
        averages = np.sqrt(1 + 2 * self.time_smoothing**2) * n_runs
        with np.errstate(divide="ignore", invalid="ignore"):
            H = uf / ef
            residual = uu - 2 * (H.conj() * ue).real + abs(H) ** 2 * ee
            variance = np.maximum(residual, 0.0) * ff / abs(ef) ** 2
            self.coherence_ = abs(uf) ** 2 / (uu * ff)
        H[~np.isfinite(H)] = np.nan
        self.frequency_response_ = H
        self.frequency_response_sd_ = np.sqrt(
            variance / (averages - 1) if averages > 1 else np.full_like(variance, np.nan)
        )

    def _fit_instants(self, enough: np.ndarray, numbers: np.ndarray) -> None:
        """Fit operators to the responses of the instants that have enough frequencies."""
        H, sd = self.frequency_response_[enough], self.frequency_response_sd_[enough]
        found = fit_responses(self.frequencies_, H, sd, self.dt_)
        tables = np.full((2, enough.size, found.values.shape[1]), np.nan)
        tables[:, enough] = found.values, found.deviations
        self.at_bound_ = np.zeros((enough.size, 3), dtype=bool)
        self.at_bound_[enough] = found.stuck
        values, deviations = (
            dict(zip((*ESTIMATED, "T_L"), table.T, strict=True)) for table in tables
        )
        self._set_path(numbers, values, deviations)

    def _method_name(self) -> str:
        return f"wavelets (Morlet, omega0 = {as_fitted(self).omega0:g}), fit at each instant"


@dataclass(frozen=True)
class Blocks:
    """Means of ``size`` samples of output, error and instrument, aligned by time in the run.

    ``pieces`` are the first block of a stretch (counted from that of all), its means, and which
    were recorded.
    """

    size: int
    dt: float
    first: int
    n: int
    n_runs: int
    pieces: list[tuple[int, np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, data: DataToFit, signals: np.ndarray) -> Blocks:
        grid = data.grid
        size = max(1, int(1 / (RATE * grid.dt) + 1e-9))
        number = grid_numbers(grid)
        found = []
        for begin, end in zip(
            grid.begin[grid.measured].tolist(), grid.end[grid.measured].tolist(), strict=True
        ):
            begin += -int(number[begin]) % size
            count = max(end - begin, 0) // size
            part = signals[begin : begin + count * size]
            known = ~np.isnan(part).any(axis=1)
            if known.sum() < 2:
                continue
            part = np.stack([bridged(column) for column in part.T], axis=1)
            means = np.gradient(part.reshape(count, size, 3).mean(axis=1), axis=0)
            of_blocks = known.reshape(count, size).mean(axis=1)
            found.append((int(number[begin]) // size, means, of_blocks))
        first = min((at for at, _, _ in found), default=0)
        last = max((at + len(means) for at, means, _ in found), default=0)
        pieces = [(at - first, means, known) for at, means, known in found]
        return cls(size, size * grid.dt, first, last - first, len(grid.layout.labels), pieces)

    def lines(self, low: float, high: float) -> np.ndarray:
        """Frequencies of the instrument in a band, if it is a multisine."""
        if not self.pieces:
            return np.array([])
        _, means, _ = max(self.pieces, key=lambda piece: len(piece[1]))
        f = means[:, 2]
        bins = whole_bins(f)
        if not bins.size:
            bins = peak_bins(f)
        omega = 2 * np.pi * bins / (f.size * self.dt)
        return omega[(omega >= low) & (omega <= high)]


def whole_bins(f: np.ndarray) -> np.ndarray:
    """Bins that hold nearly all power of a signal, if these are few: it is then periodic."""
    power = abs(np.fft.rfft(f)) ** 2
    if not power.max() > 0:
        raise RankDeficiencyError("WaveletOperator: the instrument does not move.")
    found = np.flatnonzero(power > LINE * power.max())
    few = found.size <= min(MOST_LINES, f.size // 10)
    return found if few and power[found].sum() > PERIODIC * power.sum() else np.array([])


def peak_bins(f: np.ndarray) -> np.ndarray:
    """Places between bins of the peaks that hold most power of a signal, if these are few."""
    power = abs(np.fft.rfft(f * blackmanharris(f.size))) ** 2
    log_power = np.log(np.maximum(power, 1e-30 * power.max()))
    peaks, _ = find_peaks(log_power, height=np.log(LINE * power.max()))
    near = (peaks[:, None] + np.arange(-4, 5)).clip(0, power.size - 1)
    few = 0 < peaks.size <= min(MOST_LINES, f.size // 10)
    if not few or power[np.unique(near)].sum() < PURE * power.sum():
        return np.array([])
    before, at, after = log_power[peaks - 1], log_power[peaks], log_power[peaks + 1]
    return peaks + 0.5 * (before - after) / (before - 2 * at + after)


def smoothed(values: np.ndarray, width: float) -> np.ndarray:
    """Gaussian smoothing along the last axis, zero outside; ``width`` in samples."""
    if width < 1e-9:
        return values
    reach = np.arange(-int(REACH * width + 1), int(REACH * width + 1) + 1)
    kernel = np.exp(-0.5 * (reach / width) ** 2)
    kernel = (kernel / kernel.sum()).reshape((1,) * (values.ndim - 1) + (-1,))
    return fftconvolve(values, kernel, mode="same", axes=-1)


def require_wavelets() -> Any:
    """PyWavelets, or an error that says how to install it."""
    try:
        import pywt
    except ImportError:
        raise ImportError(
            'WaveletOperator needs PyWavelets: pip install "skhoid[wavelets]".'
        ) from None
    return pywt
