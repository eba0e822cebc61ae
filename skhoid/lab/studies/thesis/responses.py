"""Frequency responses by Fourier coefficients, batch and recursive ARX models (App. I)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ....arx.batch import ARXRegressor
from ....arx.recursive import RecursiveARX
from ....arx.searches import DelaySearchCV
from ....interpret import FrequencyResponse, arx_response, arx_response_covariance
from ....interpret.fourier import fourier_coefficients
from ....simulation.tracking_runs import task_of
from ..montecarlo.blocks import DataSet
from ..montecarlo.declared import identified_as
from ..montecarlo.horizons import candidate_delays, succeeded
from ..montecarlo.study import MonteCarloStudy
from .study_result import INTENSITIES, STATES, Claim, StudyResult, gains_of, range_text

CELL = ["condition", "remnant_intensity"]
METHODS = ("fc", "batch", "recursive")


@identified_as("skhoid: frequency responses", version=1)
def responses_of(data: DataSet) -> pd.DataFrame:
    """Responses at the lines of the target, by three methods, for a :class:`MonteCarloStudy`."""
    task, target = data.task, data.task.target
    dt = 1 / task.sampling_rate
    found = {"fc": fourier_coefficients(data.X, data.y, forcing=target)}
    search = DelaySearchCV(ARXRegressor(), nk=candidate_delays(task)).fit(data.X, data.y)
    batch = search.best_estimator_
    recursive = RecursiveARX(nk=search.best_nk_, p0=1.0).fit(data.X, data.y)
    for name, model in (("batch", batch), ("recursive", recursive)):
        theta = model.coef_[None]
        H = arx_response(theta, target.omega, dt, na=2, nk=search.best_nk_)
        C = arx_response_covariance(
            theta, model.covariance_[None], target.omega, dt, na=2, nk=search.best_nk_
        )
        found[name] = FrequencyResponse(target.omega, H, covariance=C)
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "method": name,
                    "omega": response.omega,
                    "H_real": np.squeeze(response.response).real,
                    "H_imag": np.squeeze(response.response).imag,
                    "magnitude_sd": np.squeeze(response.magnitude_sd),
                    "phase_sd": np.radians(np.squeeze(response.phase_sd)),
                }
            )
            for name, response in found.items()
        ]
    )


def response_study(
    n_replications: int = 100,
    *,
    conditions: Sequence[str] = STATES,
    intensities: Sequence[float] = INTENSITIES,
    remnant_order: Any = 2,
    gains: str = "table",
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> StudyResult:
    """Compare frequency responses found by three methods with the operator's (App. I).

    Fourier coefficients (Eq. 5.14), a batch ARX[2, 2] model with n_k*, and the final parameters of
    a recursion without forgetting (P0 = I), at the lines of the target.

    Parameters
    ----------
    n_replications : int, default=100
        Runs per cell.
    conditions : sequence of str, default=("C1", "C2")
        Conditions with constant dynamics.
    intensities : sequence of float, default=(0, 0.05, ..., 0.30)
        P_n.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter.
    gains : {"table", "tuned"}, default="table"
        K_n from Table G.1, or tuned on ten realisations with their own seeds.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    result : StudyResult
        Its table has a row for each replication, method ("fc", "batch", "recursive") and line:
        omega (rad/s), the response and its stated deviations (Eqs. H.9, H.10; rad). Its summary
        has, by cell, method and line, the relative bias of the ensemble mean, its total complex
        deviation divided by the mean (Eq. H.7), and the ratio of stated deviations to those of the
        ensemble.

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import response_study
    >>> found = response_study(4, conditions=["C1"], intensities=[0.15])
    >>> found.summary.loc[("C1", 0.15, "fc")].shape
    (10, 6)
    """
    study = MonteCarloStudy(
        responses_of,
        {"condition": list(conditions), "remnant_intensity": [float(P) for P in intensities]},
        n_replications,
        simulation={"remnant_order": remnant_order} | gains_of(gains, intensities),
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress)
    good = succeeded(table)
    summary = _summary(good)
    return StudyResult(
        "appI",
        "Frequency responses by Fourier coefficients, batch and recursive ARX models (App. I)",
        table,
        summary,
        _claims(summary),
        _figures(good),
    )


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (condition, P_n, method), part in table.groupby([*CELL, "method"], sort=False):
        H = part["H_real"].to_numpy() + 1j * part["H_imag"].to_numpy()
        n_lines = part["omega"].nunique()
        H = H.reshape(-1, n_lines)
        stated = {
            name: np.sqrt(np.mean(part[name].to_numpy().reshape(-1, n_lines) ** 2, axis=0))
            for name in ("magnitude_sd", "phase_sd")
        }
        omega, mean = part["omega"].to_numpy()[:n_lines], H.mean(axis=0)
        true = task_of(condition, {}).operator.frequency_response(omega)
        angle = np.angle(H / mean)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = {
                "stated_over_ensemble": stated["magnitude_sd"] / _sd(np.abs(H)),
                "phase_stated_over_ensemble": stated["phase_sd"] / _sd(angle),
            }
        found = {
            "omega": omega,
            "magnitude": np.abs(mean),
            "bias": np.abs(mean) / np.abs(true) - 1,
            "phase_error": np.degrees(np.angle(mean / true)),
            "relative_sd": np.sqrt(_sd(H.real) ** 2 + _sd(H.imag) ** 2) / np.abs(mean),
        } | ratios
        rows.append(
            pd.DataFrame(found).assign(condition=condition, remnant_intensity=P_n, method=method)
        )
    return pd.concat(rows).set_index([*CELL, "method", "omega"]).sort_index()


def _sd(values: np.ndarray) -> np.ndarray:
    if len(values) < 2:
        return np.full(values.shape[1], np.nan)
    return values.std(axis=0, ddof=1)


def _claims(summary: pd.DataFrame) -> list[Claim]:
    quiet = summary[summary.index.get_level_values("remnant_intensity") == 0]
    noisy = summary[summary.index.get_level_values("remnant_intensity") > 0]
    claims = []
    if len(quiet):
        bias = quiet["bias"].abs()
        claims.append(
            Claim(
                "App. I",
                "without remnant all three methods find the operator",
                f"magnitudes within {100 * bias.max():.1f} %",
                bool(bias.max() < 0.05),
            )
        )
    if len(noisy):
        spread = noisy["relative_sd"].groupby(["condition", "method"]).median()
        more = [
            spread[condition]["fc"] / spread[condition]["batch"]
            for condition in spread.index.get_level_values("condition").unique()
        ]
        claims.append(
            Claim(
                "App. I",
                "with remnant Fourier coefficients scatter more than ARX models",
                f"median complex deviations {range_text(more, 1)} times those of batch models",
                bool(min(more) > 1),
            )
        )
        ratio = noisy["stated_over_ensemble"].groupby("method").median()
        claims.append(
            Claim(
                "App. I",
                "stated deviations (Eq. H.9) are consistent with those of the ensemble",
                f"in the median {ratio['batch']:.2f} times those for batch models, "
                f"{ratio['recursive']:.2f} times for recursive ones: too small, because the "
                "equation error is coloured and P0 = I still holds the recursion back",
                bool(ratio["batch"] > 2 / 3),
            )
        )
    return claims


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(condition: str, P_n: float) -> Any:
        from ....plotting import StudyResponseDisplay

        return StudyResponseDisplay.from_table(
            table,
            condition=condition,
            remnant_intensity=P_n,
            truth=task_of(condition, {}).operator.frequency_response,
        )

    cells = table[CELL].drop_duplicates().itertuples(index=False)
    return {f"figI-{c}-{P:g}": partial(draw, c, P) for c, P in cells}
