"""The analysis of Section VI for one subject in one condition: delay, fits, validation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats
from sklearn.pipeline import make_pipeline

from ...arx.batch import ARXRegressor
from ...arx.recursive import RecursiveARX
from ...arx.searches import DelaySearchCV
from ...diagnosis.scores import performance_scores
from ...interpret.conversion import FROM_POLES, arx_to_operator
from ...interpret.references import reference_fits
from ...preprocessing import DelayShift
from ...runs import RUN, TIME
from ..studies.montecarlo.vectorised import PARAMETERS as ARX
from .read import CONDITION, RECORDING, SUBJECT, Cell

PARAMETERS = (*ARX, *FROM_POLES)
FORMS = ("lambda", "Lambda", "constant")
LONGEST_DELAY = 0.5  # s
MEAN = "mean"  # label of what is averaged over runs


@dataclass(frozen=True)
class AnalysisPlan:
    """What is the same for all subjects and conditions; times in s, the horizon in samples."""

    memory_horizon: float
    delay: Any
    input: str
    region: float
    fit_intercept: bool
    step: float
    dt: float

    @property
    def horizons(self) -> dict[str, Any]:
        """Memory horizons by form: one, or none that ends for a1 and a2."""
        N0, inf = self.memory_horizon, np.inf
        return {"lambda": N0, "Lambda": (inf, inf, N0, N0, *[N0] * self.fit_intercept)}

    def batch(self) -> ARXRegressor:
        return ARXRegressor(inputs=[self.input], fit_intercept=self.fit_intercept)


@dataclass(frozen=True)
class CellTables:
    """Tables of one cell; see ExperimentResult."""

    paths: pd.DataFrame
    batch: pd.DataFrame
    scores: pd.DataFrame
    validation: pd.DataFrame
    changes: pd.DataFrame
    delay: dict[str, Any]
    notes: list[str]


def analyse_cell(cell: Cell, plan: AnalysisPlan) -> CellTables:
    """Delay, batch models, recursions and validation."""
    levels = {SUBJECT: cell.subject, CONDITION: cell.condition}
    delay, notes = _delay(cell, plan)
    shifted = DelayShift(delay["delay"]).fit_transform(cell.X[[plan.input]])
    # Samples are numbered as in RunLayout.sample_numbers.
    first, stop = (int(np.floor(t / plan.dt + 0.25)) for t in (cell.start, cell.stop))
    numbers = np.arange(first, stop, max(round(plan.step / plan.dt), 1))
    validation = _CrossValidation(cell, plan)
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
            validation.score(at, form, model.predict(shifted))
        constant = ARXRegressor(fit_intercept=plan.fit_intercept).fit(part, output)
        validation.score(at, "constant", constant.predict(shifted))
    paths = pd.concat(
        [_path_table(np.stack(each), form, cell, numbers, plan) for form, each in theta.items()]
    )
    batch = _batch(cell, plan, delay["delay"])
    scores = _scores(cell, plan)
    changes = _changes(batch)
    variation = _variation(np.stack(theta["lambda"]))
    changes["variation"] = changes["parameter"].map(variation)
    mean = paths[(paths[RUN] == MEAN) & paths["a1"].notna()]
    if lost := int(mean["K_e"].isna().sum()):
        notes.append(
            f"{cell.name or RECORDING}: {lost} of {len(mean)} instants of the mean paths have no "
            "pair of complex poles, so no operator parameters"
        )
    tables = {
        "paths": paths,
        "batch": batch,
        "scores": scores,
        "validation": validation.table(),
        "changes": changes,
    }
    return CellTables(
        **{
            name: table.assign(**levels)[[*levels, *table.columns]]
            for name, table in tables.items()
        },
        delay=levels | delay,
        notes=notes,
    )


def _delay(cell: Cell, plan: AnalysisPlan) -> tuple[dict[str, Any], list[str]]:
    """n_k* of all runs together, or the given delay."""
    given = plan.delay
    if given is not None and not isinstance(given, (int, float, np.number)):
        pair = (cell.subject, cell.condition)
        given = dict(given)
        try:
            given = next(given[k] for k in (pair, *pair) if k in given)
        except StopIteration:
            raise ValueError(
                f"delay has no entry for {cell.name}: neither {pair!r}, nor its subject or its "
                "condition."
            ) from None
    if given is not None:
        nk = round(float(given) / plan.dt)
        return {"nk": nk, "delay": nk * plan.dt, "searched": False}, []
    nk_max = max(round(LONGEST_DELAY / plan.dt), 1)
    search = DelaySearchCV(plan.batch(), nk=range(1, nk_max + 1)).fit(cell.X, cell.y)
    found = {"nk": search.best_nk_, "delay": float(search.best_delay_), "searched": True}
    if search.best_nk_ in (1, nk_max):
        return found, [
            f"{cell.name or RECORDING}: the delay {found['delay']:g} s is at the end of the "
            "range searched"
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
    estimator = make_pipeline(DelayShift(delay), plan.batch())
    regions = {
        "ini": (cell.start, cell.start + plan.region),
        "fin": (cell.stop - plan.region, cell.stop),
    }
    frames = []
    for label, (X, y) in zip(cell.labels, cell.runs, strict=True):
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


def windows_of(cell: Cell, region: float) -> dict[str, tuple[float, float]]:
    """T_m, and its parts: a region at each end, and the transition between them."""
    ini, fin = cell.start + region, cell.stop - region
    windows = {"T_m": (cell.start, cell.stop), "ini": (cell.start, ini)}
    if fin > ini + 1e-6:
        windows["tran"] = (ini, fin)
    return windows | {"fin": (fin, cell.stop)}


def _scores(cell: Cell, plan: AnalysisPlan) -> pd.DataFrame:
    return performance_scores(
        cell.X, cell.y, windows_of(cell, plan.region), roles={plan.input: "e"}
    )


class _CrossValidation:
    """VAF of free runs, by the run that was fitted and the runs that are simulated."""

    def __init__(self, cell: Cell, plan: AnalysisPlan) -> None:
        time = cell.X.index.get_level_values(TIME).to_numpy(dtype=float)
        self.y = cell.y.to_numpy()
        known = ~np.isnan(self.y)
        slack = 1e-6 * plan.dt
        self.rows = {
            name: known & (time >= start - slack) & (time < stop - slack)
            for name, (start, stop) in windows_of(cell, plan.region).items()
            if name in ("T_m", "tran")
        }
        self.run = np.repeat(np.arange(len(cell.labels)), np.diff(cell.starts))
        self.labels = cell.labels
        self.found: list[dict[str, Any]] = []

    def score(self, run: int, form: str, prediction: np.ndarray) -> None:
        errors = (self.y - np.asarray(prediction, dtype=float).ravel()) ** 2
        n = len(self.labels)
        for name, rows in self.rows.items():
            lost = np.bincount(self.run[rows], errors[rows], n)
            power = np.bincount(self.run[rows], self.y[rows] ** 2, n)
            with np.errstate(divide="ignore", invalid="ignore"):
                vaf = np.maximum(0.0, 100 * (1 - lost / power))
            others = np.delete(vaf, run)
            self.found.append(
                {
                    RUN: self.labels[run],
                    "form": form,
                    "window": name,
                    "vaf_estimation": vaf[run],
                    "vaf_validation": others.mean() if others.size else np.nan,
                }
            )

    def table(self) -> pd.DataFrame:
        return pd.DataFrame(self.found)


def _changes(batch: pd.DataFrame) -> pd.DataFrame:
    """Paired t test of each parameter between the last and the first region of the runs."""
    each = batch[batch[RUN] != MEAN]
    at = {form: each[each["form"] == form] for form in ("ini", "fin")}  # runs in the same order
    rows = []
    for name in PARAMETERS:
        ini, fin = (at[form][name].to_numpy(dtype=float) for form in ("ini", "fin"))
        both = ~np.isnan(fin - ini)
        change = (fin - ini)[both]
        t, p = _t_test(change)
        known = change.size > 0
        rows.append(
            {
                "parameter": name,
                "ini": ini[both].mean() if known else np.nan,
                "fin": fin[both].mean() if known else np.nan,
                "change": change.mean() if known else np.nan,
                "t": t,
                "p": p,
                "n_runs": change.size,
            }
        )
    return pd.DataFrame(rows)


def _t_test(change: np.ndarray) -> tuple[float, float]:
    # scipy.stats.ttest_1samp differs in the last bits, and warns where all changes are the same.
    if change.size < 2:
        return np.nan, np.nan
    spread = change.std(ddof=1) / np.sqrt(change.size)
    if spread == 0:
        return (np.nan, np.nan) if change[0] == 0 else (np.inf, 0.0)
    t = float(change.mean() / spread)
    return t, float(2 * stats.t.sf(abs(t), change.size - 1))


def _variation(theta: np.ndarray) -> dict[str, float]:
    """How much the mean path varies over time, relative to what the scatter of runs explains."""
    n_runs = len(theta)
    if n_runs < 2:
        return {}
    mean = theta.mean(axis=0)
    noise = np.sqrt(np.nanmean(theta.var(axis=0, ddof=1), axis=0) / n_runs)
    over_time = np.nanstd(mean, axis=0)
    return dict(zip(ARX, over_time / noise, strict=True))
