"""What a method makes of a data set: errors over time, alarms, validation, and its losses."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ... import ARXRegressor, DelaySearchCV, VAFScorer
from .blocks import DataSet
from .tournament_conditions import WINDOWS, Change
from .tournament_methods import TOURNAMENT_METHODS, TournamentMethod

LAST = 1.28  # s that an alarm looks at
N_THRESHOLDS = 24
THRESHOLDS = np.geomspace(0.02, 3.0, N_THRESHOLDS)  # of |Δ ln K_edot|
ALARMS = [f"alarm_{i:02d}" for i in range(N_THRESHOLDS)]


def alarms(time: np.ndarray, K_edot: np.ndarray, baseline: tuple[float, float]) -> dict[str, float]:
    """The largest difference from the baseline after it, and when each threshold is exceeded.

    Instants without an estimate, or with one that is not positive, are left out.
    """
    found = {"peak": np.nan} | dict.fromkeys(ALARMS, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.where(K_edot > 0, np.log(K_edot), np.nan)
    level[~np.isfinite(level)] = np.nan
    before = level[(time >= baseline[0]) & (time <= baseline[1])]
    if not np.isfinite(before).any():
        return found
    width = max(1, round(LAST / float(np.median(np.diff(time)))))
    recent = pd.Series(level).rolling(width, min_periods=1).mean().to_numpy()
    later = time > baseline[1]
    apart = np.abs(recent[later] - np.nanmedian(before))
    apart = np.where(np.isfinite(apart), apart, 0.0)
    if not apart.size:
        return found
    so_far = np.maximum.accumulate(apart)
    found["peak"] = float(so_far[-1])
    first = np.searchsorted(so_far, THRESHOLDS)
    instants = np.append(time[later], np.nan)
    return found | dict(zip(ALARMS, instants[first].tolist(), strict=True))


PARAMETERS = ("K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e")
FOLLOWED = "K_edot"  # what changes are detected in
STEP = 0.16  # s between the instants that are judged
WORST = 1.0  # relative error, beyond which and without an estimate an error is this
NEARLY = 1e-6  # of a step, by which instants may differ
NORMAL_95 = 1.959964
FAR = 100.0  # times the truth, beyond which a method has diverged
LOWEST_VAF = -100.0  # %
TOLERANCE, STAYS = 0.15, 5.0  # of the truth, and s for which an error stays in it
LOST = 0.5  # relative error of a level, beyond which the change was not followed
AHEAD = 5.12  # s that offline methods may see a change before it happens
LEAST_CHANGE = 0.2  # of a parameter, by which lags are measured
SEARCHED = (0.15, 0.48)  # s, delays that are searched


def method_figures(
    data: DataSet,
    *,
    cell: str,
    method: str,
    settings: Mapping[str, Any],
    watching: Mapping[str, Any],
    delay: str = "true",
) -> pd.DataFrame:
    """Rows of one data set, one for each parameter that the method estimates.

    ``settings`` are those of the method's knob by cell; ``watching`` those with which it watches
    for changes, also where there are none.
    """
    how, setting, watched = TOURNAMENT_METHODS[method], settings[cell], watching[cell]
    path, vaf, failure = follow(data, how, setting, delay)
    path_of_alarms = path
    if watched != setting:
        path_of_alarms, _, other = follow(data, how, watched, delay)
        failure = failure or other
    return rows_of_path(data, how, path, vaf, path_of_alarms).assign(failure=failure)


def tuning_scores(
    data: DataSet, *, cell: str, method: str, delay: str = "true"
) -> list[dict[str, Any]]:
    """VAF of validation runs with each setting of a method's knob, not below -100 %."""
    how = TOURNAMENT_METHODS[method]
    rows = []
    for place, setting in enumerate(how.settings):
        _, vaf, failure = follow(data, how, setting, delay, path=False)
        vaf = max(vaf, LOWEST_VAF) if np.isfinite(vaf) else LOWEST_VAF
        rows.append({"setting": place, "vaf": vaf, "failure": failure})
    return rows


def follow(
    data: DataSet, method: TournamentMethod, setting: Any, delay: str, *, path: bool = True
) -> tuple[pd.DataFrame | None, float, str | None]:
    """The path of parameters of a fitted model, its validation VAF, and why there is none."""
    found = None
    assert data.validation is not None
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            nk, dt = total_delay(data, delay), 1 / data.task.sampling_rate
            model = method.estimator(dt, nk, setting, data.truth.parameters).fit(data.X, data.y)
            if path:
                found = method.read(model)
            return found, float(VAFScorer()(model, data.validation.X, data.validation.y)), None
        except MemoryError:
            raise
        except Exception as error:
            return found, np.nan, f"{type(error).__name__}: {error}"


def total_delay(data: DataSet, delay: str) -> int:
    """n_k in samples, with that of zero-order hold: the true one, or the one that is found."""
    if delay == "true":
        return int(data.truth.nk)
    rate = data.task.sampling_rate
    first, last = (round(seconds * rate) for seconds in SEARCHED)
    search = DelaySearchCV(ARXRegressor(), nk=range(first, last + 1)).fit(data.X[["e"]], data.y)
    return int(search.best_nk_)


def at_instants(path: pd.DataFrame, time: np.ndarray, causal: bool) -> pd.DataFrame:
    """A path at other instants: the last before, or for offline methods linear between two.

    Outside its own instants its nearest end holds, as in predictions.
    """
    if path.index.name != "time":  # of a constant model
        return path.iloc[np.zeros(time.size, dtype=int)].set_axis(time, axis=0)
    own = path.index.to_numpy(float)
    place = np.clip(np.interp(time, own, np.arange(own.size)), 0, own.size - 1)
    low = np.floor(place + NEARLY).astype(int)
    if causal or own.size > time.size:
        return path.iloc[low].set_axis(time, axis=0)
    high, share = np.minimum(low + 1, own.size - 1), np.maximum(place - low, 0.0)[:, None]
    values = path.to_numpy(float)
    with np.errstate(invalid="ignore"):
        between = (1 - share) * values[low] + share * values[high]
    return pd.DataFrame(
        np.where(share > NEARLY, between, values[low]), index=time, columns=path.columns
    )


def rows_of_path(
    data: DataSet,
    method: TournamentMethod,
    path: pd.DataFrame | None,
    vaf: float,
    path_of_alarms: pd.DataFrame | None,
) -> pd.DataFrame:
    """Figures of a path against the truth, and alarms of a path that may be another."""
    task = data.task
    change = Change.of(task)
    every = max(1, round(STEP * task.sampling_rate))
    truth = data.truth.parameters.iloc[::every]
    time = truth.index.to_numpy(float)
    judged = time >= change.start
    time, truth = time[judged], truth[judged]
    windows = change.windows(time)
    names = [name for name in PARAMETERS if name != "tau_e" or method.estimates_delay]
    estimates = {name: np.full(time.size, np.nan) for name in names}
    deviations = {name: np.full(time.size, np.nan) for name in names}
    if path is not None:
        found = at_instants(path, time, method.causal)
        estimates = {name: found[name].to_numpy(float) for name in names}
        deviations = {
            name: found[f"sd_{name}"].to_numpy(float) for name in names if f"sd_{name}" in found
        }
    true = {name: truth[name].to_numpy(float) for name in names}
    errors = {name: estimates[name] / true[name] - 1.0 for name in names}
    of_change = _of_change(time, errors[FOLLOWED], estimates[FOLLOWED], true[FOLLOWED], change)
    watched = np.full(time.size, np.nan)
    if path_of_alarms is not None:
        watched = at_instants(path_of_alarms, time, method.causal)[FOLLOWED].to_numpy(float)
    of_change |= alarms(time, watched, change.baseline)
    ahead = 0.0 if method.causal else AHEAD
    whole = {
        "vaf": vaf,
        "diverged": _diverged(estimates, true, vaf) or path is None,
        "change_begins": np.nan if change.times is None else change.times[0] - ahead,
        "change_time": np.nan if change.times is None else change.times[1],
        "change_left": np.nan if change.times is None else change.end - change.times[1],
    }
    rows = []
    for name in names:
        row: dict[str, Any] = {"method": method.name, "parameter": name, **whole}
        for window in WINDOWS:
            inside = windows.get(window, np.zeros(time.size, dtype=bool))
            of_window = _of_window(
                errors[name][inside], deviations.get(name, np.full(time.size, np.nan))[inside],
                true[name][inside],
            )  # fmt: skip
            row |= {f"{figure}_{window}": value for figure, value in of_window.items()}
        rows.append(row | (of_change if name == FOLLOWED else dict.fromkeys(of_change, np.nan)))
    return pd.DataFrame(rows)


def _of_window(error: np.ndarray, deviation: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Figures of the relative errors in a window, in %; NaN if it is empty."""
    if not error.size:
        return dict.fromkeys(("bias", "rmse", "median_error", "failed", "coverage"), np.nan)
    known = np.isfinite(error)
    bounded = np.clip(error, -WORST, WORST)
    size = np.where(known, np.abs(bounded), WORST)
    # An instant without an estimate is one whose interval holds nothing.
    stated = np.isfinite(deviation)
    inside = known & (np.abs(error * truth) <= NORMAL_95 * np.where(stated, deviation, 0.0))
    return {
        "bias": 100.0 * float(bounded[known].mean()) if known.any() else np.nan,
        "rmse": 100.0 * float(np.sqrt(np.mean(size**2))),
        "median_error": 100.0 * float(np.median(size)),
        "failed": 100.0 * float(1.0 - known.mean()),
        "coverage": 100.0 * float(inside.mean()) if stated.any() else np.nan,
    }


def _diverged(
    estimates: Mapping[str, np.ndarray], truth: Mapping[str, np.ndarray], vaf: float
) -> bool:
    """Whether parameters are infinite or a hundred times the truth, or free runs useless."""
    for name, values in estimates.items():
        known = ~np.isnan(values)
        if (np.abs(values[known]) > FAR * np.abs(truth[name][known])).any():
            return True
    return not (np.isfinite(vaf) and vaf >= LOWEST_VAF)


def _of_change(
    time: np.ndarray, error: np.ndarray, estimate: np.ndarray, truth: np.ndarray, change: Change
) -> dict[str, float]:
    """Settling time and lag, of K_edot."""
    found = {"settling": np.nan, "lag": np.nan}
    windows = change.windows(time)
    if change.times is not None and windows["after"].sum() > 1:
        found["settling"] = settling_time(time, error, change.times[2], windows["after"])
        if windows["before"].sum() > 1:
            found["lag"] = lag(time, estimate, truth, windows)
    return found


def settling_time(time: np.ndarray, error: np.ndarray, changed: float, after: np.ndarray) -> float:
    """Seconds from the end of the change until the error has settled; infinite if it does not.

    Settled is the first instant from which, for five seconds or to the end, the relative error
    stays within 15 % plus two standard deviations of its level. Level and deviation are those of
    the second half of the window after the change: a small bias does not count, but a level that is
    off by more than half of the truth is not settled. (As the settling time of a step response in
    textbooks, with a band for noise.)
    """
    later = np.flatnonzero(after)
    settled = error[later[later.size // 2 :]]
    settled = settled[np.isfinite(settled)]
    if settled.size < 2 or abs(settled.mean()) > LOST:
        return np.inf
    with np.errstate(invalid="ignore"):
        near = np.abs(error - settled.mean()) <= TOLERANCE + 2.0 * settled.std()
    begin = int(np.searchsorted(time, changed))
    span = max(1, round(STAYS / float(np.median(np.diff(time)))))
    for i in range(begin, time.size):
        if near[i : i + span].all():
            return max(0.0, float(time[i] - changed))
    return np.inf


def lag(
    time: np.ndarray, estimate: np.ndarray, truth: np.ndarray, windows: Mapping[str, np.ndarray]
) -> float:
    """Mean delay of a change in the estimate, in s: the area between its progress and the true one.

    Both progress from 0, the mean before, to 1, the mean after (Elmore 1948: the centroid of the
    impulse response). It averages over noise, and neither bias nor scale counts. NaN where the
    change is too small.
    """
    levels = []
    for values in (truth, estimate):
        before, after = (_mean(values[windows[name]]) for name in ("before", "after"))
        levels.append((before, after - before))
    (true_start, true_span), (start, span) = levels
    if abs(true_span) < LEAST_CHANGE * abs(true_start) or not span / true_span > LEAST_CHANGE:
        return np.nan
    around = windows["around"] & np.isfinite(estimate)
    apart = (truth[around] - true_start) / true_span - (estimate[around] - start) / span
    return float(np.trapezoid(apart, time[around])) if around.sum() > 1 else np.nan


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan
