"""The highest VAF of a free run that any model could reach, and the density of the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy import fft
from scipy.ndimage import uniform_filter1d
from scipy.signal import resample
from scipy.stats import norm

from ..text import Note
from .repeats import Decided, Group
from .signals import (
    Signals,
    coherent_part,
    lagged_from_rest,
    on_lines,
    response_to_target,
    tap_spacing,
)

CONFIDENCE = 0.95
SIGMAS = 4.0  # standard errors by which chance takes a VAF above the ceiling
LEAST_EXCESS = 0.5  # points, the same for what the standard error does not count
LEAST_PART = 0.5  # of the power of the output, at least, that the rows of a ceiling hold
STRONG = 3e-4  # of the strongest direction; what the instruments excite less is left alone
N_TAPS = 10  # of the finite impulse response that a linear misfit may have
N_IN_TIME = 3  # order of the polynomials of time that taps may be
N_LAGS = 40  # of the response to a signal from outside
N_BENT = 8  # of the response to what a map makes of the error
RIDGES = tuple(10.0 ** np.arange(-6, 2))  # of the mean power of what responses are sought of
N_PIECES = 4  # of the only run, in place of runs
SURE = 2.0  # standard errors by which a response must explain more than nothing
N_AR = 12  # order of the autoregression that describes noise
SILENT = 1e-12  # of the output power; residuals below are rounding errors


class Route(StrEnum):
    """How noise is told from what repeats."""

    REPEATS = "repeats"
    LINES = "lines"
    INPUTS = "inputs"
    NONE = "none"

    @property
    def separates(self) -> bool:
        """Whether all of the residual is told apart; else a ceiling is a lower bound at most."""
        return self in (Route.REPEATS, Route.LINES)


class NoCeiling(StrEnum):
    """Why a noise ceiling is not known."""

    NO_TARGET = "the target is not known"
    APART = "runs of one target differ in a disturbance"
    NO_ROUTE = "no run shares its target, and none is periodic"
    FEW_RUNS = "too few of the runs have a route"
    CONTRADICTED = "the model is better than the ceiling"


@dataclass(frozen=True)
class Ceiling:
    """Noise of each group of runs, and what it leaves to explain.

    ``gap`` is in VAF points of the output on rows that have a route, which hold the share ``part``
    of its power; NaN where it is not known, for the reason ``note``.
    """

    route: Route
    note: Note
    gap: float
    sd: float
    vaf: float
    noise: NoiseDensity
    remnant: list[np.ndarray]
    covered: np.ndarray
    part: float = 1.0

    @property
    def known(self) -> bool:
        return bool(np.isfinite(self.gap))

    @property
    def value(self) -> float:
        return self.vaf + self.gap

    @property
    def interval(self) -> tuple[float, float]:
        half = float(norm.ppf(0.5 + CONFIDENCE / 2)) * self.sd
        return self.value - half, self.value + half


def consistent_ceiling(
    ceiling: float, vaf: float, sd: float = 0.0, *, held_out: bool = True
) -> tuple[float, Note | None]:
    """Ceiling to show with the VAF of a model, or NaN and the reason why it is not known.

    A ceiling is never above 100, and a model that did not see the rows exceeds it only by chance.
    """
    if not np.isfinite(ceiling):
        return np.nan, None
    if vaf > ceiling + max(SIGMAS * sd, LEAST_EXCESS):
        judged = "a model judged on rows it did not see" if held_out else "the model"
        why = (
            "what does not repeat is not only noise: the runs differ in more than their remnant "
            "(a disturbance, the person, the initial state)"
        )
        if not held_out:
            why = f"it has learnt the noise of these rows, or {why}"
        return np.nan, Note(
            NoCeiling.CONTRADICTED,
            f"{judged} reaches {vaf:.1f} %, more than the {min(ceiling, 100.0):.1f} % estimated: "
            f"{why}",
        )
    return float(min(max(ceiling, vaf), 100.0)), None


def noise_ceiling(signals: Signals) -> Ceiling:
    """Split the residual into what repeats and what does not.

    Of R runs that share the target, r_k = d + n_k: Σn² is R/(R - 1) Σ (r_k - mean r)². A linear
    misfit Δ answers the noise in e, too (Δe_n): it is estimated with the target or the other runs
    as instruments, shrunk (James and Stein) and taken out. With one run and a periodic target the
    noise is read off between the lines.
    """
    routes = [_route(group) for group in signals.groups]
    best = next((route for route in (Route.REPEATS, Route.LINES) if route in routes), Route.NONE)
    noise, parts = _noise(signals, routes, best, [signals.residual[g.rows] for g in signals.groups])
    residuals, gap, variance, power, lost = [], 0.0, 0.0, 0.0, 0.0
    for group, route in zip(signals.groups, routes, strict=True):
        r, spread = signals.residual[group.rows], 0.0
        if route is best is not Route.NONE:
            r, spread = _remove_linear_misfit(signals, group, noise)
        residuals.append(r)
        variance += spread
    if best is not Route.NONE:
        noise, parts = _noise(signals, routes, best, residuals)
    covered = np.zeros(signals.layout.n_rows, dtype=bool)
    for group, route, remnant in zip(signals.groups, routes, parts, strict=True):
        if route is not best or best is Route.NONE:
            continue
        covered[group.rows.ravel()] = True
        y, r = signals.y[group.rows], signals.residual[group.rows]
        power += float(np.sum(y[signals.scored[group.rows]] ** 2))
        lost += float(np.sum(r**2))
        noise_power, spread = _noise_power(group, route, remnant, noise)
        gap += float(np.sum(r**2)) - noise_power
        variance += spread
    note = _note(signals, best)
    unknown = Ceiling(best, note, np.nan, np.nan, np.nan, noise, parts, covered)
    if best is Route.NONE:
        return _reached_by_inputs(signals, unknown)
    part = power / float(np.sum(signals.y[signals.scored] ** 2))
    if part < LEAST_PART:
        some = sum(
            group.n_runs
            for group, route in zip(signals.groups, routes, strict=True)
            if route is best
        )
        every = sum(group.n_runs for group in signals.groups)
        what = (
            "repeat each other" if best is Route.REPEATS else "hold whole periods of their target"
        )
        text = f"only {some} of {every} runs {what}"
        text += f"; {signals.decided}" if signals.decided.text else ""
        unknown = replace(unknown, note=Note(NoCeiling.FEW_RUNS, text), part=part)
        return _reached_by_inputs(signals, unknown)
    return Ceiling(
        best,
        note,
        100 * gap / power,
        100 * float(np.sqrt(variance)) / power,
        100 * (1 - lost / power),
        noise,
        parts,
        covered,
        part=part,
    )


def _reached_by_inputs(signals: Signals, unknown: Ceiling) -> Ceiling:
    """What responses to target and disturbance explain of the residual in runs not used for them.

    A lower bound: one after the other, linear responses to both, and responses to bends of that
    part of the error which they cause, and to that part with gains that change in time. Nothing of
    a run's own noise is in them, so that what they explain is no noise.
    """
    runs = [rows for group in signals.groups for rows in group.rows]
    if not signals.external or signals.driving is None:
        return unknown
    outside = [
        [signals.channels[name][rows] - signals.channels[name][rows].mean() for rows in runs]
        for name in signals.external
    ]
    linear = [np.concatenate(of_run, axis=1) for of_run in zip(*map(_pasts, outside), strict=True)]
    driving = [signals.channels[signals.driving][rows] for rows in runs]
    caused = _explained_by_others(linear, driving) if signals.driving == "e" else driving
    size = float(np.sqrt(np.mean(np.concatenate(caused) ** 2)))
    if not size > 0:
        return unknown
    rest = [signals.residual[rows] for rows in runs]
    gap, variance, lost = 0.0, 0.0, sum(float(r @ r) for r in rest)
    for tables in (linear, _bends(caused, size), _changes(caused)):
        found = _explained_by_others(tables, rest)
        gain = sum(float((2 * r - p) @ p) for r, p in zip(rest, found, strict=True))
        spread = 4 * sum(
            float(unknown.noise.covariance(p[:, None], signals.layout.time[rows])[0, 0])
            for rows, p in zip(runs, found, strict=True)
        )
        if gain > SURE * np.sqrt(spread):
            gap, variance = gap + gain, variance + spread
            rest = [r - p for r, p in zip(rest, found, strict=True)]
    if not gap:
        return unknown
    power = sum(float(np.sum(signals.y[rows][signals.scored[rows]] ** 2)) for rows in runs)
    covered = np.zeros_like(unknown.covered)
    covered[np.concatenate(runs)] = True
    return replace(
        unknown,
        route=Route.INPUTS,
        note=Note(
            Route.INPUTS,
            f"a lower bound: responses to what comes from outside, found in other runs, explain "
            f"{100 * gap / power:.1f} points of VAF more; what else could be explained cannot be "
            f"told: {unknown.note.text}",
        ),
        gap=100 * gap / power,
        sd=100 * float(np.sqrt(variance)) / power,
        vaf=100 * (1 - lost / power),
        covered=covered,
        part=1.0,
    )


def _pasts(signal: list[np.ndarray], n_lags: int = N_LAGS) -> list[np.ndarray]:
    """Pasts of a signal, run by run."""
    step = max(tap_spacing(part[None], 1.0) for part in signal)
    return [lagged_from_rest(part, step * np.arange(n_lags)) for part in signal]


def _bends(caused: list[np.ndarray], size: float) -> list[np.ndarray]:
    """Pasts of maps of a signal and of its rate, run by run."""
    maps = []
    for part in caused:
        z = part / size
        rate = np.gradient(z)
        rate = rate / max(float(np.sqrt(np.mean(rate**2))), 1e-300)
        maps.append([z * np.abs(z), z**3, np.abs(z), z**2, rate * np.abs(rate)])
    pasts = [_pasts(list(one), N_BENT) for one in zip(*maps, strict=True)]
    return [np.concatenate(of_run, axis=1) for of_run in zip(*pasts, strict=True)]


def _changes(caused: list[np.ndarray]) -> list[np.ndarray]:
    """Pasts of a signal times polynomials of time, and these, run by run."""
    found = []
    for past in _pasts(caused, N_BENT):
        shapes = legvander(np.linspace(-1, 1, len(past)), N_IN_TIME)[:, 1:]
        found.append(np.column_stack([_varying(past, shapes.T), shapes]))
    return found


def _explained_by_others(tables: list[np.ndarray], values: list[np.ndarray]) -> list[np.ndarray]:
    """Part of signals (one a run) in tables' columns, by coefficients found in the other runs.

    Of the only run, in other pieces of it. The ridge is that which explains most.
    """
    n_pieces = 1 if len(tables) > 1 else N_PIECES
    ones = [np.column_stack([table, np.ones(len(table))]) for table in tables]
    parts = [piece for table in ones for piece in np.array_split(table, n_pieces)]
    targets = [piece for value in values for piece in np.array_split(value, n_pieces)]
    grams = np.array([part.T @ part for part in parts])
    products = np.array([part.T @ v for part, v in zip(parts, targets, strict=True)])
    scale = np.sqrt(np.maximum(np.diag(grams.sum(axis=0)), 1e-300))
    grams, products = grams / np.outer(scale, scale), products / scale
    without = grams.sum(axis=0) - grams, products.sum(axis=0) - products
    most, best = -np.inf, np.zeros_like(products)
    for ridge in RIDGES:
        damped = without[0] + ridge * np.eye(scale.size)
        found = np.linalg.solve(damped, without[1][..., None])[..., 0]
        explained = 2 * np.sum(found * products) - np.einsum("ki,kij,kj->", found, grams, found)
        if explained > most:
            most, best = explained, found
    whole = [part @ (w / scale) for part, w in zip(parts, best, strict=True)]
    return [np.concatenate(whole)] if n_pieces > 1 else whole


def _route(group: Group) -> Route:
    if group.n_runs > 1:
        return Route.REPEATS
    return Route.NONE if group.lines is None else Route.LINES


def _noise(
    signals: Signals, routes: list[Route], best: Route, residuals: list[np.ndarray]
) -> tuple[NoiseDensity, list[np.ndarray]]:
    """Noise model of the groups that have the best route, and noise (or residual) by group."""
    records, times, scored, without, parts, independent = [], [], [], [], [], 0
    for group, route, r in zip(signals.groups, routes, residuals, strict=True):
        part = r
        if route is Route.REPEATS:
            part = (r - r.mean(axis=0)) * np.sqrt(group.n_runs / (group.n_runs - 1))
        elif route is Route.LINES:
            part = r - on_lines(r, group)
        elif "f_t" in signals.channels:
            part = r - response_to_target(signals, group, "residual")
        parts.append(part)
        if route is best:
            records += list(part)
            times += [signals.layout.time[rows] for rows in group.rows]
            scored += [signals.scored[rows] for rows in group.rows]
            without += [group.lines if route is Route.LINES else None] * group.n_runs
            independent += group.n_runs - (route is Route.REPEATS)
    floor = SILENT * float(np.mean(signals.y[signals.scored] ** 2))
    return noise_density(records, times, signals.dt, without, scored, independent, floor), parts


def _noise_power(
    group: Group, route: Route, remnant: np.ndarray, noise: NoiseDensity
) -> tuple[float, float]:
    """Sum of squares of the noise of a group, and the variance of the error of the gap."""
    n = group.n_samples
    S = noise.at(group.omega(noise.dt)[1:])
    if route is Route.REPEATS:
        # r_k r_l of two runs, summed over n samples, has the variance 2 sum S^2 over the bins.
        spread = 2 * group.n_runs / (group.n_runs - 1) * noise.unevenness * 2 * float(np.sum(S**2))
        return float(np.sum(remnant**2)), spread
    assert group.lines is not None
    periodogram = np.abs(fft.rfft(remnant[0], norm="ortho")) ** 2
    lines = np.union1d(group.lines, [0])
    between = 2 * (periodogram.sum() - periodogram[lines].sum())
    if n % 2 == 0 and (n // 2) not in group.lines:
        between -= periodogram[-1]
    expected = S[group.lines - 1]
    # One bin of each line holds exponentially distributed noise, of that known mean.
    return float(between + 2 * expected.sum()), float(np.sum((2 * expected) ** 2))


def _remove_linear_misfit(
    signals: Signals, group: Group, noise: NoiseDensity
) -> tuple[np.ndarray, float]:
    """Residuals of a group less a linear response to e, and the variance that this adds."""
    r = signals.residual[group.rows]
    if signals.driving != "e" or np.sum(r**2) <= SILENT * np.sum(signals.y[group.rows] ** 2):
        return r, 0.0
    e = signals.channels["e"][group.rows]
    instrument = _instrument(signals, group, e)
    if instrument is None:
        return r, 0.0
    step = tap_spacing(instrument, signals.dt)
    taps = step * np.arange(N_TAPS)
    if taps[-1] * 4 > group.n_samples:
        return r, 0.0
    rest, spread = _answered(signals, group, noise, r, e, instrument, taps, 0)
    if group.n_runs > 1:
        # A response that varies in time has other taps at other times.
        rest, more = _answered(signals, group, noise, rest, e, instrument, taps, N_IN_TIME)
        spread += more
    return rest, spread


def _answered(
    signals: Signals,
    group: Group,
    noise: NoiseDensity,
    r: np.ndarray,
    e: np.ndarray,
    instrument: np.ndarray,
    taps: np.ndarray,
    order: int,
) -> tuple[np.ndarray, float]:
    """Residuals less a response to e, constant or with taps that are polynomials of time."""
    time = np.linspace(-1, 1, group.n_samples)
    shapes = legvander(time, order)[:, min(order, 1) :].T
    n = taps.size * len(shapes)
    g, V, A = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    delayed = [_varying(lagged_from_rest(signal, taps), shapes) for signal in e]
    for k in range(group.n_runs):
        Z = _varying(lagged_from_rest(instrument[k], taps), shapes)
        g += Z.T @ r[k]
        A += Z.T @ delayed[k]
        V += noise.covariance(Z, signals.layout.time[group.rows[k]])
    U, s, Wt = np.linalg.svd(A)
    kept = s > STRONG * s[0]
    U, s, Wt = U[:, kept], s[kept], Wt[kept]
    z = U.T @ g
    found = float(z @ np.linalg.pinv(U.T @ V @ U, hermitian=True) @ z)
    shrunk = max(0.0, 1.0 - max(s.size - 2, 0) / found) if found > 0 else 0.0
    inverse = shrunk * (Wt.T / s) @ U.T
    response = np.array([L @ (inverse @ g) for L in delayed])
    part = _part_by_way_of_error(r, response, group, noise)
    inverse, rest = part * inverse, r - part * response
    scattered = rest - rest.mean(axis=0) if group.n_runs > 1 else rest - on_lines(rest, group)
    slope = 2 * sum((L.T @ x for L, x in zip(delayed, scattered, strict=True)), np.zeros(n))
    slope *= group.n_runs / max(group.n_runs - 1, 1)
    of_taps = inverse @ V @ inverse.T
    curved = of_taps @ sum((L.T @ L for L in delayed), np.zeros((n, n)))
    return rest, float(slope @ of_taps @ slope) + 2 * float(np.sum(curved * curved.T))


def _varying(lagged: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    return np.concatenate([lagged * shape[:, None] for shape in shapes], axis=1)


def _part_by_way_of_error(
    r: np.ndarray, response: np.ndarray, group: Group, noise: NoiseDensity
) -> float:
    """Share (0 to 1) of a misfit that responds to e; the rest responds to the target in other ways.

    Without the right part of Δe_n, n + Δe_n is closest to filtered white noise (the prediction-
    error criterion, which holds in a closed loop).
    """
    if group.n_runs == 1 or not response.any():
        return 1.0
    deviations = [part - part.mean(axis=0) for part in (r, response)]
    if np.sum(deviations[0] ** 2) <= SILENT * np.sum(r**2):
        return 1.0
    top = noise.omega[noise.known(noise.omega)].max()
    n = group.n_samples
    m = min(n, max(int(np.ceil(top * noise.dt / np.pi * n)), 8 * N_AR))
    if m < n:
        deviations = [resample(part, m, axis=1) for part in deviations]
    losses = [
        np.log(_innovation_power(deviations[0] - part * deviations[1])) for part in (0.0, 0.5, 1.0)
    ]
    curvature = losses[0] - 2 * losses[1] + losses[2]
    slope = (losses[2] - losses[0]) / 2  # at one half, for steps of one half
    if curvature <= 0:
        return 1.0 if losses[2] < losses[0] else 0.0
    return float(np.clip(0.5 - 0.5 * slope / curvature, 0.0, 1.0))


def _innovation_power(records: np.ndarray) -> float:
    """Mean squared one-step error of one autoregression of all records."""
    windows = np.lib.stride_tricks.sliding_window_view(records, N_AR + 1, axis=1)
    table = windows.reshape(-1, N_AR + 1)
    gram = table.T @ table
    past = gram[:-1, :-1] + 1e-12 * np.trace(gram) * np.eye(N_AR)
    return float(gram[-1, -1] - gram[-1, :-1] @ np.linalg.solve(past, gram[:-1, -1]))


def _instrument(signals: Signals, group: Group, e: np.ndarray) -> np.ndarray | None:
    """Part of e that the target explains, else that which other runs share."""
    if group.lines is not None:
        return np.broadcast_to(on_lines(e.mean(axis=0)[None], group), e.shape)
    return coherent_part(signals, group, "e")


def _note(signals: Signals, route: Route) -> Note:
    """How the ceiling is found, or why it cannot be."""
    decided = signals.decided
    if route is Route.REPEATS:
        return Note(
            route,
            "from the part of the residual that does not repeat between runs with the same target"
            f"{f' ({decided})' if decided.text else ''}; a lower bound if a missing effect does "
            "not respond to the remnant linearly (dead zone, steps, lapses, fast changes) or "
            "differs between runs",
        )
    if route is Route.LINES:
        return Note(
            route,
            "from the residual between the excited lines of a periodic target, in one run; a lower "
            "bound: what varies in time or is distorted falls between the lines too",
        )
    if "f_t" not in signals.channels:
        return Note(
            NoCeiling.NO_TARGET,
            "the target is not known. Add a channel f_t (or e and x)",
            hint="or say with repeats= which runs share a target",
        )
    if Decided(decided.kind).apart:
        return Note(NoCeiling.APART, f"{decided}. Record runs that share target and disturbance")
    which = "the only run has a target that" if len(signals.groups) == 1 else "every run has a "
    which += "" if len(signals.groups) == 1 else "target of its own, which"
    return Note(
        NoCeiling.NO_ROUTE,
        f"{which} is not periodic in the window. Record runs that share the target, or a whole "
        "number of periods of a multisine",
    )


LEAKAGE = 1e-3  # of the largest density; below, a transform of a finite run holds leakage
SMOOTHING = 0.15  # of the frequency, half width of the average over bins
LEAST_BINS = 8  # half width of that average, at least
ENVELOPE = 10.0  # s, over which the power of the noise is averaged


@dataclass(frozen=True)
class NoiseDensity:
    """Density of noise per bin of a Fourier transform of unit length.

    It has ``free`` degrees of freedom, and averages to the variance of a sample; ``envelope`` is
    the power over time, over its mean.
    """

    omega: np.ndarray
    density: np.ndarray
    time: np.ndarray
    envelope: np.ndarray
    dt: float
    free: float

    def at(self, omega: np.ndarray) -> np.ndarray:
        return np.interp(omega, self.omega, self.density)

    def scale(self, time: np.ndarray) -> np.ndarray:
        """Standard deviation over time, relative to its rms."""
        return np.sqrt(np.interp(time, self.time, self.envelope))

    @property
    def correlation_time(self) -> float:
        """Integral of the squared autocorrelation over both signs of the lag, in s."""
        spacing = np.gradient(self.omega)
        return (
            np.pi
            * float(np.sum(self.density**2 * spacing))
            / float(np.sum(self.density * spacing)) ** 2
        )

    @property
    def unevenness(self) -> float:
        """Mean of the squared power over time, over the square of the mean power; 1 if steady."""
        return float(np.mean(self.envelope**2) / np.mean(self.envelope) ** 2)

    def covariance(self, Z: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Covariance of Z' n under noise alone."""
        # Real and imaginary parts beside each other: products of both are those of real numbers.
        Fz = fft.rfft(Z.T * self.scale(time), axis=1, norm="ortho")
        parts = (Fz * np.sqrt(self._density_of_bins(len(Z)))).view(float)
        return parts @ parts.T

    def _density_of_bins(self, n: int) -> np.ndarray:
        """Density of the bins of n samples, twice that of bins that stand for two."""
        S = 2 * self.at(2 * np.pi * fft.rfftfreq(n, self.dt))
        S[0] = S[min(1, S.size - 1)] / 2
        if n % 2 == 0:
            S[-1] /= 2
        return S

    def known(self, omega: np.ndarray) -> np.ndarray:
        """Where the density is more than the leakage of strong frequencies into weak ones."""
        return self.at(omega) > LEAKAGE * self.density.max()

    def whitened(self, values: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Signals (columns) through the zero-phase filter that makes the noise white."""
        n = len(values)
        omega = 2 * np.pi * fft.rfftfreq(n, self.dt)
        S = self.at(omega)
        gain = np.where(self.known(omega), 1 / np.sqrt(np.maximum(S, 1e-300)), 0.0)
        spectrum = fft.rfft(values / self.scale(time)[:, None], axis=0)
        return fft.irfft(spectrum * gain[:, None], n, axis=0)


def noise_density(
    records: list[np.ndarray],
    times: list[np.ndarray],
    dt: float,
    without: list[np.ndarray | None],
    scored: list[np.ndarray],
    independent: float,
    floor: float,
) -> NoiseDensity:
    """Noise density of records (zero where not scored), apart from excited bins (``without``)."""
    longest = max(len(record) for record in records)
    omega = 2 * np.pi * fft.rfftfreq(longest, dt)[1:]
    power, count = np.zeros(omega.size), np.zeros(omega.size)
    for record, bins, known in zip(records, without, scored, strict=True):
        n = len(record)
        periodogram = np.abs(fft.rfft(record, norm="ortho")) ** 2 / known.mean()
        used = np.ones(periodogram.size)
        used[0] = 0.0
        if bins is not None:
            used[bins] = 0.0
        at = np.clip(np.round(np.arange(1, periodogram.size) * longest / n).astype(int), 1, None)
        at = np.minimum(at - 1, omega.size - 1)
        np.add.at(power, at, (periodogram * used)[1:])
        np.add.at(count, at, used[1:])
    density = np.maximum(_smoothed(power, count), floor)
    time, envelope = _envelope(records, times, scored, dt)
    free = 2 * (2 * LEAST_BINS + 1) * independent
    return NoiseDensity(omega, density, time, envelope, dt, free)


def _smoothed(power: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Average over bins within a fraction of the frequency."""
    n = power.size
    bins = np.arange(n)
    half = np.maximum(LEAST_BINS, SMOOTHING * bins).astype(int)
    # As many bins below as above, so that a slope in the density does not tilt the average.
    low, high = np.maximum(bins - half, 0), np.minimum(bins + half + 1, n)
    total = np.concatenate([[0.0], np.cumsum(power)])
    number = np.concatenate([[0.0], np.cumsum(count)])
    used = number[high] - number[low]
    with np.errstate(invalid="ignore", divide="ignore"):
        density = (total[high] - total[low]) / used
    known = used > 0
    return np.interp(bins, bins[known], density[known])


def _envelope(
    records: list[np.ndarray], times: list[np.ndarray], scored: list[np.ndarray], dt: float
) -> tuple[np.ndarray, np.ndarray]:
    start = min(float(time[0]) for time in times)
    stop = max(float(time[-1]) for time in times)
    grid = np.arange(start, stop + dt, min(ENVELOPE / 10, (stop - start) / 4 + dt))
    power, count = np.zeros(grid.size), np.zeros(grid.size)
    for record, time, known in zip(records, times, scored, strict=True):
        at = np.searchsorted(grid, time, side="right") - 1
        power += np.bincount(at, record**2, grid.size)
        count += np.bincount(at, known, grid.size)
    width = min(max(round(ENVELOPE / (grid[1] - grid[0])), 1), grid.size)
    mean = uniform_filter1d(power, width, mode="nearest")
    mean = mean / np.maximum(uniform_filter1d(count, width, mode="nearest"), 1e-9)
    average = power.sum() / count.sum()
    centre = grid + (grid[1] - grid[0]) / 2
    if not average > 0:
        return centre, np.ones(grid.size)
    return centre, np.maximum(mean / average, 0.05)
