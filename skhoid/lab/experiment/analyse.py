"""analyse_experiment: the analysis of Section VI for all subjects and conditions."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats
from sklearn.pipeline import make_pipeline

from ... import (
    ARXRegressor,
    DelaySearchCV,
    DelayShift,
    MissingDataWarning,
    RecursiveARX,
    RunTimeWarning,
    arx_to_operator,
    performance_scores,
    reference_fits,
)
from ...arx.many_runs import PARAMETERS as ARX
from ...interpret import FROM_POLES
from ...runs import RUN, TIME
from .groups import CONDITION, SUBJECT, Cell, read_cells
from .result import ExperimentResult, verdicts

PARAMETERS = (*ARX, *FROM_POLES)
FORMS = ("lambda", "Lambda", "constant")
LONGEST_DELAY = 0.5  # s
STEP = 0.16  # s, between the points at which paths are kept
MEAN = "mean"  # label of what is averaged over runs


@dataclass(frozen=True)
class AnalysisPlan:
    """What is the same for all subjects and conditions; times in s, the horizon in samples."""

    memory_horizon: float
    delay: float | None
    input: str
    region: float
    fit_intercept: bool
    dt: float

    @property
    def horizons(self) -> dict[str, Any]:
        """Memory horizons by form: one, or none that ends for a1 and a2."""
        N0, inf = self.memory_horizon, np.inf
        return {"lambda": N0, "Lambda": (inf, inf, N0, N0, *[N0] * self.fit_intercept)}


def analyse_cell(cell: Cell, plan: AnalysisPlan) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """The tables of ExperimentResult for one cell, and notes."""
    delay, notes = _delay(cell, plan)
    shifted = DelayShift(delay["delay"]).fit_transform(cell.X[[plan.input]])
    # Samples are numbered as in RunLayout.sample_numbers.
    first, stop = (int(np.floor(t / plan.dt + 0.25)) for t in (cell.start, cell.stop))
    numbers = np.arange(first, stop, max(round(STEP / plan.dt), 1))
    predictions: list[tuple[int, str, np.ndarray]] = []
    theta: dict[str, list[np.ndarray]] = {form: [] for form in plan.horizons}
    for at, (a, b) in enumerate(zip(cell.starts[:-1], cell.starts[1:], strict=True)):
        part, output = shifted.iloc[a:b], cell.y.iloc[a:b]
        for form, horizon in plan.horizons.items():
            model = RecursiveARX(
                fit_intercept=plan.fit_intercept,
                memory_horizon=horizon,
                init_window=plan.region,
                p0=1.0,
            ).fit(part, output)
            theta[form].append(_thinned(model, numbers, plan.dt))
            predictions.append((at, form, model.predict(shifted)))
        constant = ARXRegressor(fit_intercept=plan.fit_intercept).fit(part, output)
        predictions.append((at, "constant", constant.predict(shifted)))
    paths = pd.concat(
        [_path_table(np.stack(each), form, cell, numbers, plan) for form, each in theta.items()]
    )
    batch = _batch(cell, plan, delay["delay"])
    changes = _changes(batch)
    variation = _variation(np.stack(theta["lambda"]))
    changes["variation"] = changes["parameter"].map(variation)
    mean = paths[(paths[RUN] == MEAN) & paths["a1"].notna()]
    if lost := int(mean["K_e"].isna().sum()):
        notes.append(
            f"{cell}: {lost} of {len(mean)} instants of the mean paths have no "
            "pair of complex poles, so no operator parameters"
        )
    tables = {
        "paths": paths,
        "batch": batch,
        "scores": performance_scores(
            cell.X, cell.y, find_windows(cell, plan.region), roles={plan.input: "e"}
        ),
        "validation": _validation(cell, plan, predictions),
        "changes": changes,
        "delays": pd.DataFrame([delay]),
    }
    for table in tables.values():
        table.insert(0, SUBJECT, [cell.subject] * len(table))
        table.insert(1, CONDITION, [cell.condition] * len(table))
    return tables, notes


def _delay(cell: Cell, plan: AnalysisPlan) -> tuple[dict[str, Any], list[str]]:
    """n_k* of all runs together, or the given delay."""
    if plan.delay is not None:
        nk = round(float(plan.delay) / plan.dt)
        return {"nk": nk, "delay": nk * plan.dt, "searched": False}, []
    nk_max = max(round(LONGEST_DELAY / plan.dt), 1)
    search = DelaySearchCV(
        ARXRegressor(inputs=[plan.input], fit_intercept=plan.fit_intercept), nk=range(1, nk_max + 1)
    ).fit(cell.X, cell.y)
    found = {"nk": search.best_nk_, "delay": float(search.best_delay_), "searched": True}
    if search.best_nk_ in (1, nk_max):
        return found, [
            f"{cell}: the delay {found['delay']:g} s is at the end of the range searched"
        ]
    return found, []


def _thinned(model: RecursiveARX, numbers: np.ndarray, dt: float) -> np.ndarray:
    """theta at some sample numbers, NaN where the run has none."""
    have = np.rint(model.time_path_ / dt).astype(np.int64)
    at = np.minimum(np.searchsorted(have, numbers), have.size - 1)
    return np.where((have[at] == numbers)[:, None], model.coef_path_[at][:, :4], np.nan)


def _path_table(
    theta: np.ndarray, form: str, cell: Cell, numbers: np.ndarray, plan: AnalysisPlan
) -> pd.DataFrame:
    """Estimates of the runs, and their mean, which is averaged before it is converted."""
    all_ = np.concatenate([theta, theta.mean(axis=0, keepdims=True)])
    operator, _, _ = arx_to_operator(all_, plan.dt)
    columns: dict[str, Any] = {
        RUN: np.repeat(np.array([*cell.labels, MEAN], dtype=object), numbers.size),
        "form": form,
        TIME: np.tile(numbers * plan.dt, len(all_)),
    }
    columns |= {name: all_[..., i].ravel() for i, name in enumerate(ARX)}
    return pd.DataFrame(columns | {name: operator[name].ravel() for name in FROM_POLES})


def _batch(cell: Cell, plan: AnalysisPlan, delay: float) -> pd.DataFrame:
    """Batch models of the first and the last region of each run, and their means."""
    estimator = make_pipeline(
        DelayShift(delay), ARXRegressor(inputs=[plan.input], fit_intercept=plan.fit_intercept)
    )
    regions = {
        "ini": (cell.start, cell.start + plan.region),
        "fin": (cell.stop - plan.region, cell.stop),
    }
    frames = []
    for number, label in enumerate(cell.labels):
        X, y = cell.run(number)
        table = reference_fits(X[[plan.input]], y, list(regions.values()), estimator=estimator)
        columns = [f"{sd}{name}" for sd in ("", "sd_") for name in PARAMETERS]
        table = table.reindex(columns=["start", "stop", *columns])
        frames.append(table.assign(**{RUN: label, "form": list(regions)}))
    each = pd.concat(frames)
    of_form = each.groupby("form", sort=False)
    mean = of_form[["start", "stop", *ARX]].mean()
    operator, _, _ = arx_to_operator(mean[list(ARX)].to_numpy(), plan.dt)
    mean = mean.assign(**operator)
    spread = of_form[list(PARAMETERS)].std().add_prefix("sd_")
    mean = mean.join(spread).reset_index().assign(**{RUN: MEAN})
    table = pd.concat([each, mean])
    first = [RUN, "form", "start", "stop"]
    return table[[*first, *[c for c in table if c not in first]]].reset_index(drop=True)


def find_windows(cell: Cell, region: float) -> dict[str, tuple[float, float]]:
    """T_m, and its parts: a region at each end, and the transition between them."""
    ini, fin = cell.start + region, cell.stop - region
    windows = {"T_m": (cell.start, cell.stop), "ini": (cell.start, ini)}
    if fin > ini + 1e-6:
        windows["tran"] = (ini, fin)
    return windows | {"fin": (fin, cell.stop)}


def _validation(
    cell: Cell, plan: AnalysisPlan, predictions: list[tuple[int, str, np.ndarray]]
) -> pd.DataFrame:
    """VAF of free runs, by the run that was fitted and the runs that are simulated."""
    time = cell.X.index.get_level_values(TIME).to_numpy(dtype=float)
    y, n = cell.y.to_numpy(), len(cell.labels)
    run = np.repeat(np.arange(n), np.diff(cell.starts))
    slack = 1e-6 * plan.dt
    windows = find_windows(cell, plan.region)
    found = []
    for fitted, form, prediction in predictions:
        errors = (y - np.asarray(prediction, dtype=float).ravel()) ** 2
        for name in [window for window in ("T_m", "tran") if window in windows]:
            start, stop = windows[name]
            rows = ~np.isnan(y) & (time >= start - slack) & (time < stop - slack)
            lost = np.bincount(run[rows], errors[rows], n)
            with np.errstate(divide="ignore", invalid="ignore"):
                left = lost / np.bincount(run[rows], y[rows] ** 2, n)
            vaf = np.maximum(0.0, 100 * (1 - left))
            others = np.delete(vaf, fitted)
            row = {RUN: cell.labels[fitted], "form": form, "window": name}
            row |= {"vaf_estimation": vaf[fitted]}
            found.append(row | {"vaf_validation": others.mean() if others.size else np.nan})
    return pd.DataFrame(found)


def _changes(batch: pd.DataFrame) -> pd.DataFrame:
    """Paired t test of each parameter between the last and the first region of the runs."""
    each = batch[batch[RUN] != MEAN].pivot(index=RUN, columns="form", values=list(PARAMETERS))
    rows = []
    for name in PARAMETERS:
        both = each[name].astype(float).dropna()
        change = both["fin"] - both["ini"]
        t = p = np.nan
        if len(change) > 1:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # all changes are the same
                t, p = stats.ttest_1samp(change, 0.0)
        means = {"ini": both["ini"].mean(), "fin": both["fin"].mean(), "change": change.mean()}
        rows.append({"parameter": name, **means, "t": t, "p": p, "n_runs": len(change)})
    return pd.DataFrame(rows)


def _variation(theta: np.ndarray) -> dict[str, float]:
    """How much the mean path varies over time, relative to what the scatter of runs explains."""
    n_runs = len(theta)
    if n_runs < 2:
        return {}
    mean = theta.mean(axis=0)
    noise = np.sqrt(np.nanmean(theta.var(axis=0, ddof=1), axis=0) / n_runs)
    over_time = np.nanstd(mean, axis=0)
    return dict(zip(ARX, over_time / noise, strict=True))


def analyse_experiment(
    X: pd.DataFrame,
    y: Any,
    *,
    last: int | None = 5,
    memory_horizon: float = 256.0,
    delay: float | None = None,
    input: str = "e",
    measurement_time: float | None = None,
    region: float = 30.72,
    transition_time: Any = None,
    fit_intercept: bool = False,
    n_jobs: int | None = None,
) -> ExperimentResult:
    """Analyse an experiment with several people, conditions and runs, as in Section VI.

    For each subject and condition, take the last runs without their run-in and find their common
    delay n_k*. Fit ARX models with n_a = n_b = 2: batch models of the first and the last region of
    each run, and recursive models of each run that forget all parameters (λ), or b0 and b1 only
    (Λ), starting from the batch model of the first region with P0 = I. Average them over the runs,
    and convert them all to parameters of the operator. Each run's models are validated on the other
    runs.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_channels)
        Channels with the row index levels ``run`` and ``time`` (s), and ``subject`` and
        ``condition`` if there are any. Besides the error, ``f_t`` (or ``x``) is used for the
        tracking score only.
    y : Series or array of shape (n_rows,)
        Control output.
    last : int or None, default=5
        How many runs of each subject and condition to use, counted from the last; None means all.
    memory_horizon : float, default=256.0
        N0 in samples.
    delay : float or None, default=None
        Delay n_k dt in s, including the sample of zero-order hold. None searches that of each
        subject and condition up to 0.5 s.
    input : str, default="e"
        Column of the error.
    measurement_time : float or None, default=None
        Seconds to keep at the end of each run; 81.92 in the thesis. None: negative times are the
        run-in.
    region : float, default=30.72
        Length of the first and the last region in s.
    transition_time : float, dict by condition, or None, default=None
        When the controlled element changes, in s of the time index; shown in plots.
    fit_intercept : bool, default=False
        Add a constant to the models, for recordings with an offset.
    n_jobs : int or None, default=None
        Number of threads, as in joblib.

    Returns
    -------
    result : ExperimentResult
        Tables, ``summary()`` and ``plot()``.

    Raises
    ------
    ShortRunError
        If a run is shorter than two regions; the message names it.
    RunIndexError, IrregularSamplingError
        If rows, runs or time violate the data convention.
    ValueError
        If there is no column of the error, or an option is not valid.

    Notes
    -----
    Runs of a subject in a condition are compared over the time that they share; runs with different
    times, subjects without runs in a condition and missing runs are listed in ``result.notes``.
    Times are those of the index.

    References
    ----------
    Van Grootheest, thesis, Section VI and App. M.

    Examples
    --------
    >>> from skhoid.lab.experiment import analyse_experiment, simulate_experiment
    >>> X, y = simulate_experiment(2, "C4", random_state=0)
    >>> result = analyse_experiment(X, y, transition_time=41.92)
    >>> print(result.summary())
    2 subjects, 1 condition; 5 runs of each, from 0 to 81.92 s at 100 Hz.
    ...
    - C4: S2 adapts (K_e 0.084 to 0.058, -31 %, K_edot 0.035 to 0.078 s, +124 %); S1 shows no
      change beyond the scatter of runs.
    ...
    """
    if last is not None and last < 1:
        raise ValueError(f"last must be a number of runs, at least 1; got {last}.")
    if not (np.isfinite(region) and region > 0):
        raise ValueError(f"region must be a time in s, above 0; got {region!r}.")
    if not memory_horizon > 1:
        raise ValueError(f"memory_horizon must be more than one sample; got {memory_horizon:g}.")
    cells, dt, notes = read_cells(X, y, last, input, measurement_time, region)
    plan = AnalysisPlan(float(memory_horizon), delay, input, region, fit_intercept, dt)
    times = {} if transition_time is None else transition_time
    if not isinstance(times, Mapping):
        times = dict.fromkeys((cell.condition for cell in cells), float(times))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)  # the notes count it
        warnings.simplefilter("ignore", RunTimeWarning)  # and say what runs do not share
        found = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(analyse_cell)(cell, plan) for cell in cells
        )
    joined = {
        name: pd.concat([tables[name] for tables, _ in found], ignore_index=True)
        for name in found[0][0]
    }
    joined["scores"].attrs = dict(found[0][0]["scores"].attrs)
    return ExperimentResult(
        **joined,
        verdicts=verdicts(joined["changes"], joined["validation"]),
        notes=[*notes, *(note for _, some in found for note in some)],
        dt=dt,
        memory_horizon=plan.memory_horizon,
        region=region,
        transition_times=dict(times),
    )
