"""Intensity, spectrum, order and time constant of the remnant that a model leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import fft
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal.windows import tukey
from scipy.stats import chi2, norm

from .._sklearn import DT, ROLES, RUN_IN, HasMethods, checked
from ..text import Block, Document, Facts, Paragraph, Told, counted, p_text
from .ceiling import Ceiling, Route, noise_ceiling
from .repeats import Group
from .signals import Signals, read_signals

ORDERS = (1, 2, 3, 4)
Z95 = float(norm.ppf(0.975))
SILENT = 1e-9  # of the output power; a residual below is rounding
HIGHEST = 60.0  # rad/s; above, the remnant of a tracking task holds next to nothing
TOP = ((0.5, 0.7), (0.8, 1.0))  # of the Nyquist frequency: bands whose densities are compared
FLAT = 1.25  # ratio of these densities up to which they are a floor
ABOVE_FLOOR = 10.0  # times the floor, down to which the density is fitted
LEAST_BINS = 20
TAPER = 0.1  # of the run; without, the jump from its end to its start hides a steep spectrum
NEIGHBOURS = 11  # bins over which spectra are averaged for the sampling error of P_n
UNLIKELY = 0.01  # p value of a filter that does not describe the spectrum
N_BANDS = 12  # in which the spectrum is compared with the filter
POSSIBLE = 0.05  # probability from which an order is not excluded

FIRST_ORDER = (
    "The remnant looks like white noise through a first-order low-pass filter (m = 1). Direct ARX "
    "estimates are then badly biased: the model takes noise to have the denominator of the "
    "operator's own, second-order dynamics, which fits orders 2 to 4 well enough but not this "
    "one (van Grootheest, Section VII). Do not convert such an ARX model to operator parameters "
    "without a check by another method, such as Fourier coefficients."
)
MAYBE_FIRST_ORDER = "A first order is not excluded (probability {:.2f}). If it is: " + FIRST_ORDER
ROUTES = {
    "repeats": "what does not repeat between runs with the same target",
    "lines": "the residual between the excited lines of the target",
    "none": "the whole residual, an upper bound: it includes what the model lacks",
}


@dataclass(frozen=True, eq=False, repr=False)
class RemnantEstimate(Told):
    """Remnant of an operator, as found by :func:`remnant_estimate`.

    Intervals are 95 %. K_n and T_n, and their intervals, are those of the order chosen; ``orders``
    has them for every order.

    Parameters
    ----------
    intensity : float
        P_n = var(n) / var(u).
    interval : (float, float)
        Interval of P_n.
    order : int or None
        Order m of the filter K_n / (T_n s + 1)^m; None where nothing could be fitted.
    time_constant : float
        T_n in s.
    time_constant_interval : (float, float)
        Interval of T_n, given m.
    gain : float
        K_n in units of u times s^0.5.
    gain_interval : (float, float)
        Interval of K_n, given m.
    orders : DataFrame
        One row per order m (the index): ``gain``, ``time_constant``, their standard deviations
        ``sd_gain`` and ``sd_time_constant``, ``log_likelihood`` below that of the best order (0,
        or negative), and ``probability``, if all orders are equally likely beforehand.
    p_value : float
        Probability of a misfit as large as that of the chosen order, if the remnant is of that
        order. If small, none of the filters describes it, and order and time constant are at best a
        rough description.
    spectrum : DataFrame
        ``omega`` (rad/s), ``psd`` (squared unit of u per rad/s, one-sided), ``fitted``, the
        density of the chosen filter, and ``used`` (bool), the frequencies of the fit.
    route : {"repeats", "lines", "none"}
        Where the noise comes from: what does not repeat between runs with the same target, the
        residual between excited lines, or the whole residual.
    warning : str
        A caution if the remnant is of first order; otherwise empty.
    n_runs : int
        Number of runs used.
    output : str
        Name of u.
    unit : str or None
        Unit of u.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.diagnosis.remnant_estimate import remnant_estimate
    >>> X, y = make_tracking_runs(
    ...     "C1", 5, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> remnant = remnant_estimate(ARXRegressor(nk=29).fit(X, y), X, y)
    >>> remnant.order, round(remnant.time_constant, 2)
    (2, 0.06)
    """

    intensity: float
    interval: tuple[float, float]
    order: int | None
    time_constant: float
    time_constant_interval: tuple[float, float]
    gain: float
    gain_interval: tuple[float, float]
    orders: pd.DataFrame
    p_value: float
    spectrum: pd.DataFrame
    route: str
    warning: str
    n_runs: int
    output: str
    unit: str | None

    def __repr__(self) -> str:
        order = "" if self.order is None else f", order {self.order}"
        return (
            f"<{type(self).__name__} of {self.output}: P_n = {self.intensity:.3f} "
            f"({_span(self.interval, '.3f')}){order}>"
        )

    def document(self) -> Document:
        """The estimate, with intervals and warnings.

        Returns
        -------
        document : Document
        """
        unit = "" if self.unit is None else f" {self.unit}"
        facts = {"intensity P_n": f"{self.intensity:.3f} ({_span(self.interval, '.3f')})"}
        if self.order is None:
            facts["order, time constant"] = "none, there is too little to fit"
        else:
            odds = ", ".join(f"{m}: {p:.2f}" for m, p in self.orders["probability"].items())
            facts["order m"] = f"{self.order} (probability of {odds})"
            of_time = _span(self.time_constant_interval, ".4f")
            facts["time constant T_n"] = f"{self.time_constant:.4f} s ({of_time})"
            of_gain = _span(self.gain_interval, ".3g")
            facts["gain K_n"] = f"{self.gain:.3g}{unit} s^0.5 ({of_gain})"
        blocks: list[Block] = [Facts(facts, beside=False)]
        if self.p_value < UNLIKELY:
            text = (
                f"No order describes the spectrum ({p_text(self.p_value)}): order, time constant "
                "and gain are only a rough description."
            )
            blocks.append(Paragraph(text))
        if self.warning:
            blocks.append(Paragraph(f"Warning: {self.warning}"))
        return Document(
            f"Remnant in {self.output}, from {ROUTES[self.route]} "
            f"({counted(self.n_runs, 'run')}). Intervals are 95 %.",
            blocks,
        )


@checked(
    model=[HasMethods("predict")],
    repeats=[bool, Mapping, "array-like", None],
    roles=ROLES,
    run_in=RUN_IN,
    dt=DT,
)
def remnant_estimate(
    model: Any,
    X: Any,
    y: Any,
    *,
    repeats: Any = None,
    roles: dict | None = None,
    run_in: float | None = None,
    dt: float | None = None,
    run: Any = None,
) -> RemnantEstimate:
    """Estimate the operator's remnant from the residual of a model's free run.

    The remnant n is what does not repeat in the residual over runs that share the target; with
    one run and a periodic target, the residual between the excited lines; otherwise it cannot be
    separated from what the model lacks, and the whole residual is an upper bound. Its spectrum is
    compared with the filters ``|K_n / (T_n j omega + 1)^m|²`` (Eq. 27) of orders 1 to 4.

    Parameters
    ----------
    model : fitted estimator or pipeline
        Any regressor whose ``predict`` runs freely.
    X : DataFrame or array of shape (n_rows, n_channels)
        Channels; the target has the role f_t, or is e + x.
    y : Series or array of shape (n_rows,)
        The operator's output u.
    repeats : sequence, dict, bool or None, default=None
        Which runs share the target: one label per run, ``{run: label}``, True (all) or False
        (none). None compares the targets.
    roles : dict or None, default=None
        ``{column: role}`` for columns whose names are not their roles.
    run_in : float or None, default=None
        Leave out this many seconds at the start of each run.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index.
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Returns
    -------
    remnant : RemnantEstimate

    See Also
    --------
    skhoid.Remnant : The same filter in the simulator.

    Notes
    -----
    The interval of P_n is for the operator, whose other runs have another remnant. Order and time
    constant come from a Whittle likelihood of the averaged periodogram, up to 60 rad/s, half the
    Nyquist frequency, or ten times a floor of white measurement noise. ``p_value`` tests what the
    probabilities assume: that one of the four orders is true. A model's linear error in the
    response to e, which remnant on its way round the loop would show as remnant, is taken out.

    References
    ----------
    Van Grootheest, thesis, Eqs. 5.11 and 27, Section VII.
    P. Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2,
    1953.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.diagnosis.remnant_estimate import remnant_estimate
    >>> X, y = make_tracking_runs(
    ...     "C2", 5, remnant_intensity=0.2, remnant_order=3, channels=["e", "f_t"], random_state=0
    ... )
    >>> remnant = remnant_estimate(ARXRegressor(nk=29).fit(X, y), X, y)
    >>> remnant.orders["probability"].round(2).to_dict()
    {1: 0.0, 2: 0.0, 3: 1.0, 4: 0.0}
    """
    signals = read_signals(model, X, y, repeats=repeats, roles=roles, run_in=run_in, dt=dt, run=run)
    ceiling = noise_ceiling(signals)
    # The residual is set to zero while the free run settles from its start at rest.
    used = [
        (group, part / np.sqrt(signals.scored[group.rows].mean()))
        for group, part in zip(signals.groups, ceiling.remnant, strict=True)
        if not ceiling.route.separates or ceiling.covered[group.rows[0, 0]]
    ]
    intensity, interval = _intensity(signals, ceiling, used)
    spectrum = _spectrum(used, ceiling, signals.dt)
    known = spectrum["used"]
    worth_fitting = intensity > SILENT and known.sum() >= LEAST_BINS
    orders = _fits(spectrum[known]) if worth_fitting else pd.DataFrame()
    return RemnantEstimate(
        intensity=intensity,
        interval=interval,
        **_of_best_order(orders, spectrum),
        orders=orders,
        route=(ceiling.route if ceiling.route.separates else Route.NONE).value,
        warning=_warning(orders),
        n_runs=sum(group.n_runs for group, _ in used),
        output=signals.output,
        unit=signals.units.get(signals.output),
    )


def _of_best_order(orders: pd.DataFrame, spectrum: pd.DataFrame) -> dict[str, Any]:
    """The filter of the most probable order, and its density beside the spectrum."""
    order, T_n, K_n, p_value = None, (np.nan, np.nan), (np.nan, np.nan), np.nan
    spectrum = spectrum.assign(fitted=np.nan)
    if len(orders):
        order = int(orders["probability"].idxmax())
        best = orders.loc[order]
        T_n = best["time_constant"], best["sd_time_constant"]
        K_n = best["gain"], best["sd_gain"]
        spectrum["fitted"] = K_n[0] ** 2 / np.pi * _shape(spectrum["omega"], T_n[0], order)
        p_value = _p_value(spectrum[spectrum["used"]])
    return {
        "order": order,
        "time_constant": float(T_n[0]),
        "time_constant_interval": _log_interval(*T_n),
        "gain": float(K_n[0]),
        "gain_interval": _log_interval(*K_n),
        "p_value": p_value,
        "spectrum": spectrum[["omega", "psd", "fitted", "used"]],
    }


def _intensity(
    signals: Signals, ceiling: Ceiling, used: list[tuple[Group, np.ndarray]]
) -> tuple[float, tuple[float, float]]:
    """P_n = N / U, and its interval by the delta method from the joint spectra of n and u."""
    parts = [_powers(signals.y[group.rows], part, group, ceiling) for group, part in used]
    N = sum(float(part["n"].sum()) for part in parts)
    U = sum(float(part["u"].sum()) for part in parts)
    if not U > 0:
        raise ValueError("The output is constant in all runs, so there is no remnant to estimate.")
    P = N / U
    variance = sum(
        float(np.sum(p["nn"] - 2 * P * p["nu"] + P**2 * (p["uu"] + p["response"]))) for p in parts
    )
    sd = np.sqrt(variance * ceiling.noise.unevenness) / U
    return P, _log_interval(P, sd)


def _powers(
    u: np.ndarray, part: np.ndarray, group: Group, ceiling: Ceiling
) -> dict[str, np.ndarray]:
    """Power of n and u by bin, and variances and covariance of these powers under noise."""
    R = group.n_runs
    n, u = (fft.rfft(x - x.mean(axis=1, keepdims=True), axis=1)[:, 1:] for x in (part, u))
    if group.n_samples % 2 == 0:  # the Nyquist bin stands for one, all others for two
        n[:, -1] /= np.sqrt(2)
        u[:, -1] /= np.sqrt(2)
    at_lines = np.zeros(n.shape[1], dtype=bool)
    response, in_u, dof = np.zeros_like(u[0]), u, R
    if ceiling.route is Route.REPEATS:
        response, in_u, dof = u.mean(axis=0), u - u.mean(axis=0), R - 1
    elif ceiling.route is Route.LINES:
        at_lines[_excited(group) - 1] = True
        response = np.where(at_lines, u[0], 0.0)
    else:  # how much of u is noise is not known
        in_u = np.zeros_like(u)
    own = n * np.sqrt(dof / R)  # deviations hold less than the noise
    nn, nu, uu = (
        _averaged((a.conj() * b).sum(axis=0), ~at_lines) / dof
        for a, b in ((own, own), (own, in_u), (in_u, in_u))
    )
    nn, uu = nn.real, uu.real
    target = np.maximum(np.abs(response) ** 2 - uu / R, 0.0)
    return {
        "n": np.where(at_lines, R * nn, (np.abs(n) ** 2).sum(axis=0)),
        "u": (np.abs(u) ** 2).sum(axis=0),
        "nn": R**2 / dof * nn**2,
        "nu": R * np.abs(nu) ** 2,
        "uu": dof * uu**2 + (uu**2 if ceiling.route is Route.REPEATS else 0.0),
        "response": 2 * R * target * uu,
    }


def _excited(group: Group) -> np.ndarray:
    """Excited bins, without the mean."""
    assert group.lines is not None
    return group.lines[group.lines > 0]


def _averaged(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Average over neighbouring bins, of those that are known."""
    count = uniform_filter1d(known.astype(float), NEIGHBOURS, mode="nearest")
    values = np.where(known, values, 0.0)
    total = uniform_filter1d(values.real, NEIGHBOURS, mode="nearest") + 1j * uniform_filter1d(
        values.imag, NEIGHBOURS, mode="nearest"
    )
    return total / np.maximum(count, 1.0 / NEIGHBOURS)


def _spectrum(used: list[tuple[Group, np.ndarray]], ceiling: Ceiling, dt: float) -> pd.DataFrame:
    """Averaged tapered periodogram, its degrees of freedom, and where it is fitted."""
    route = ceiling.route
    longest = max(group.n_samples for group, _ in used)
    omega = 2 * np.pi * fft.rfftfreq(longest, dt)
    power, dof = np.zeros(omega.size), np.zeros(omega.size)
    for group, part in used:
        n = group.n_samples
        lines = _excited(group) if route is Route.LINES else np.array([], dtype=int)
        spectrum = fft.rfft(part - part.mean(axis=1, keepdims=True), axis=1)
        spectrum[:, lines] = 0.0
        taper = tukey(n, TAPER)
        tapered = fft.rfft(taper * fft.irfft(spectrum, n, axis=1), axis=1)
        density = (np.abs(tapered) ** 2).sum(axis=0) * dt / np.sum(taper**2)
        weight = np.full(density.size, (group.n_runs - (route is Route.REPEATS)) / group.n_runs)
        weight[lines] = 0.0
        # Bins of a shorter run lie between those of the longest.
        at = np.minimum(np.round(np.arange(density.size) * longest / n).astype(int), omega.size - 1)
        np.add.at(power, at, weight * density)
        np.add.at(dof, at, weight * group.n_runs)
    known = dof > 0
    known[0] = False
    psd = power[known] / dof[known] / np.pi
    # A taper and a varying power leave fewer independent ordinates than there are bins.
    taper = tukey(longest, TAPER)
    fewer = ceiling.noise.unevenness * np.mean(taper**4) / np.mean(taper**2) ** 2
    table = pd.DataFrame({"omega": omega[known], "psd": psd, "dof": dof[known] / fewer})
    table["used"] = table["omega"] <= _highest(table, np.pi / dt)
    return table


def _highest(table: pd.DataFrame, nyquist: float) -> float:
    """Frequency up to which the density is that of remnant."""
    highest = min(HIGHEST, nyquist / 2)
    omega, psd = table["omega"].to_numpy(), table["psd"].to_numpy()
    upper, top = (psd[(omega > low * nyquist) & (omega <= high * nyquist)] for low, high in TOP)
    if not top.size or upper.mean() > FLAT * top.mean():
        return highest  # the tail of the remnant itself
    smooth = uniform_filter1d(psd, LEAST_BINS, mode="nearest")
    low = omega[smooth < ABOVE_FLOOR * top.mean()]
    return min(highest, float(low[0])) if low.size else highest


def _shape(omega: Any, T_n: float, m: int) -> np.ndarray:
    return (1 + (T_n * np.asarray(omega)) ** 2) ** -m


def _fits(spectrum: pd.DataFrame) -> pd.DataFrame:
    """Filters of every order at their greatest (Whittle) likelihood."""
    omega, dof = spectrum["omega"].to_numpy(), spectrum["dof"].to_numpy()
    density = np.pi * spectrum["psd"].to_numpy()

    def loss(log_T: float, m: int) -> float:
        shape = _shape(omega, np.exp(log_T), m)
        gain = np.sum(dof * density / shape) / dof.sum()  # K_n^2, the best for this T_n
        return float(np.sum(dof * np.log(gain * shape)))

    rows = {}
    for m in ORDERS:
        bounds = -np.log(10 * omega[-1]), -np.log(omega[0])
        found = minimize_scalar(loss, bounds=bounds, args=(m,), method="bounded")
        T_n = float(np.exp(found.x))
        shape = _shape(omega, T_n, m)
        slopes = np.stack(  # of the log density, with the logarithms of K_n and T_n
            [np.full(omega.size, 2.0), -2 * m * (T_n * omega) ** 2 / (1 + (T_n * omega) ** 2)]
        )
        sd = np.sqrt(np.diag(np.linalg.pinv((slopes * dof) @ slopes.T)))
        gain = float(np.sqrt(np.sum(dof * density / shape) / dof.sum()))
        rows[m] = {
            "gain": gain,
            "time_constant": T_n,
            "sd_gain": gain * sd[0],
            "sd_time_constant": T_n * sd[1],
            "log_likelihood": -float(found.fun),
        }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("order")
    table["log_likelihood"] -= table["log_likelihood"].max()
    table["probability"] = np.exp(table["log_likelihood"])
    table["probability"] /= table["probability"].sum()
    return table


def _p_value(spectrum: pd.DataFrame) -> float:
    """Probability of so large a misfit in bands that are evenly spaced on a log scale."""
    omega, dof = spectrum["omega"].to_numpy(), spectrum["dof"].to_numpy()
    edges = np.geomspace(omega[0], omega[-1] * (1 + 1e-9), N_BANDS + 1)
    band = np.searchsorted(edges, omega, side="right")
    excess = dof * (spectrum["psd"] / spectrum["fitted"] - 1).to_numpy()
    total, number = np.bincount(band, excess), np.bincount(band, dof)
    enough = number >= LEAST_BINS  # of which the sum is close to normal
    statistic = float(np.sum(total[enough] ** 2 / number[enough]))
    return float(chi2.sf(statistic, enough.sum() - 2)) if enough.sum() > 2 else np.nan


def _warning(orders: pd.DataFrame) -> str:
    if not len(orders) or orders["probability"][1] < POSSIBLE:
        return ""
    if orders["probability"].idxmax() == 1:
        return FIRST_ORDER
    return MAYBE_FIRST_ORDER.format(orders["probability"][1])


def _log_interval(value: float, sd: float) -> tuple[float, float]:
    """Interval of a positive number, of 95 %, that stays positive."""
    if not value > 0:
        return float(value), float(value)
    factor = float(np.exp(Z95 * sd / value))
    return float(value) / factor, float(value) * factor


def _span(interval: tuple[float, float], form: str) -> str:
    return " to ".join(format(edge, form) for edge in interval)
