"""Frequency responses by Fourier coefficients, batch and recursive ARX models (App. I)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ... import ARXRegressor, DelaySearchCV, FrequencyResponse, RecursiveARX, fourier_coefficients
from ...interpret import arx_response, arx_response_covariance
from ...simulation import task_of
from .blocks import DataSet
from .declared import INTENSITIES, STATES, Claim, PaperStudy, range_text
from .memory_horizons import candidate_delays

CELL = ["condition", "remnant_intensity"]
METHODS = ("fc", "batch", "recursive")


def measure_responses(data: DataSet) -> pd.DataFrame:
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
        sds = {"magnitude_sd": _sd(np.abs(H)), "phase_sd": _sd(np.angle(H / mean))}
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = {
                "stated_over_ensemble": stated["magnitude_sd"] / sds["magnitude_sd"],
                "phase_stated_over_ensemble": stated["phase_sd"] / sds["phase_sd"],
            }
        found = {
            "omega": omega,
            "magnitude": np.abs(mean),
            "phase": np.degrees(np.unwrap(np.angle(mean))),
            "magnitude_sd": sds["magnitude_sd"],
            "phase_sd": np.degrees(sds["phase_sd"]),
            "stated_magnitude_sd": stated["magnitude_sd"],
            "stated_phase_sd": np.degrees(stated["phase_sd"]),
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


def _claims(summary: pd.DataFrame, table: pd.DataFrame) -> Iterator[Claim]:
    quiet = summary[summary.index.get_level_values("remnant_intensity") == 0]
    noisy = summary[summary.index.get_level_values("remnant_intensity") > 0]
    if len(quiet):
        bias = quiet["bias"].abs()
        yield Claim(
            "App. I",
            "without remnant all three methods find the operator",
            f"magnitudes within {100 * bias.max():.1f} %",
            bool(bias.max() < 0.05),
        )
    if len(noisy):
        spread = noisy["relative_sd"].groupby(["condition", "method"]).median()
        more = [
            spread[condition]["fc"] / spread[condition]["batch"]
            for condition in spread.index.get_level_values("condition").unique()
        ]
        yield Claim(
            "App. I",
            "with remnant Fourier coefficients scatter more than ARX models",
            f"median complex deviations {range_text(more, 1)} times those of batch models",
            bool(min(more) > 1),
        )
        ratio = noisy["stated_over_ensemble"].groupby("method").median()
        yield Claim(
            "App. I",
            "stated deviations (Eq. H.9) are consistent with those of the ensemble",
            f"in the median {ratio['batch']:.2f} times those for batch models, "
            f"{ratio['recursive']:.2f} times for recursive ones: too small, because the "
            "equation error is coloured and P0 = I still holds the recursion back",
            bool(ratio["batch"] > 2 / 3),
        )


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(condition: str, P_n: float) -> Any:
        from ...plotting import StudyResponseDisplay

        truth = task_of(condition, {}).operator.frequency_response
        return StudyResponseDisplay.from_summary(
            summary.xs((condition, P_n), drop_level=False), truth=truth
        )

    summary = _summary(table)
    cells = table[CELL].drop_duplicates().itertuples(index=False)
    return {f"figI-{c}-{P:g}": partial(draw, c, P) for c, P in cells}


RESPONSES = PaperStudy(
    "frequency responses by three methods",
    "Frequency responses by Fourier coefficients, batch and recursive ARX models (App. I)",
    {"conditions": STATES, "intensities": INTENSITIES, "remnant_order": 2, "gains": "table"},
    measure_responses,
    _summary,
    _claims,
    _figures,
)
