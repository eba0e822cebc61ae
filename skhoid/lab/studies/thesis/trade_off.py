"""Tracking ability against noise sensitivity: the choice of a memory horizon (Fig. 13, App. J)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ....arx.recursive_cv import HORIZONS
from ..montecarlo.horizons import KEPT, SETTING, forgetting_vaf, succeeded, with_gain
from ..montecarlo.study import MonteCarloStudy
from .study_result import CONDITIONS, INTENSITIES, Claim, StudyResult, gains_of, range_text

CELL = ["condition", "remnant_intensity"]
VARYING = ("C3", "C4", "C5", "C6")
BEST = 256.0  # N0 of the thesis
PRACTICALLY_NONE = 1.0  # VAF points between forgetting by factor and by matrix
LONG = 2048.0  # N0 from which on a memory is long


def forgetting_study(
    n_replications: int = 100,
    *,
    conditions: Sequence[str] = CONDITIONS,
    intensities: Sequence[float] = INTENSITIES,
    memory_horizons: Sequence[float] = HORIZONS,
    n_validation: int = 10,
    remnant_order: Any = 2,
    gains: str = "table",
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> StudyResult:
    """Trade tracking ability against noise sensitivity, for λ and Λ (Fig. 13, Figs. J.1-J.5).

    Recursive ARX[2, 2] models are fitted to each estimation run, with its own n_k*, theta0 = OLS of
    the first 30.72 s and P0 = I, for all memory horizons; λ forgets all parameters, Λ only b0 and
    b1. The path of parameters is simulated on each validation run and scored on the transition
    window from 30.72 to 51.20 s.

    Parameters
    ----------
    n_replications : int, default=100
        Estimation runs per cell.
    conditions : sequence of str, default=("C1", ..., "C6")
        Conditions of Table III.
    intensities : sequence of float, default=(0, 0.05, ..., 0.30)
        P_n.
    memory_horizons : sequence of float, default=(2, 4, ..., 8192, inf)
        N0 in samples (Table V); one of them must be infinity, with which the others are compared.
    n_validation : int, default=10
        Validation runs per cell.
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
        Its table has a row for each replication, form ("lambda", "Lambda") and memory horizon,
        with nk, P_n, ``vaf_estimation``, ``vaf_validation`` (mean over validation runs, each at
        least 0 %) and ``sd_validation`` (deviation over them).

    Notes
    -----
    All replications of a cell share its validation runs, so the standard error of the level of
    their mean VAF is ``sd_validation`` over the root of ``n_validation``, however many replications
    there are; that of gains is much smaller.

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import forgetting_study
    >>> found = forgetting_study(
    ...     4,
    ...     conditions=["C4"],
    ...     intensities=[0.1],
    ...     memory_horizons=[64, 256, float("inf")],
    ...     n_validation=2,
    ... )
    >>> found.summary["gain"].round(1).tolist()  # Lambda, lambda
    [15.4, 15.4, 0.0, 14.4, 15.2, 0.0]
    """
    horizons = tuple(float(N0) for N0 in memory_horizons)
    if np.inf not in horizons or min(horizons) <= 1:
        raise ValueError(
            f"memory_horizons must be above 1 and include infinity (no forgetting), with which "
            f"the others are compared; got {list(memory_horizons)}."
        )
    if n_validation < 1:
        raise ValueError(f"n_validation must be at least 1; got {n_validation!r}.")
    study = MonteCarloStudy(
        partial(forgetting_vaf, memory_horizons=horizons),
        {"condition": list(conditions), "remnant_intensity": [float(P) for P in intensities]},
        n_replications,
        n_validation_runs=n_validation,
        simulation={"keep_run_in": KEPT, "remnant_order": remnant_order}
        | gains_of(gains, intensities),
        batched=True,
        block_size=50,
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress)
    good = succeeded(table)
    summary = _summary(good)
    return StudyResult(
        "fig13",
        "Tracking ability against noise sensitivity, for λ and Λ (Fig. 13, App. J)",
        table,
        summary,
        _claims(summary),
        _figures(good),
    )


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means over replications by cell and setting."""
    grouped = with_gain(table, [*CELL, "replication"]).groupby([*CELL, *SETTING])
    names = ["nk", "P_n", "vaf_estimation", "vaf_validation", "sd_validation", "gain"]
    means = grouped[names].mean()
    errors = grouped["gain"].std() / np.sqrt(grouped["gain"].count())
    overfit = means["vaf_estimation"] - means["vaf_validation"]
    return means.assign(se_gain=errors, overfit=overfit)


def best_horizons(summary: pd.DataFrame) -> pd.Series:
    """Memory horizon with the highest mean VAF on validation runs, by cell and form."""
    return summary["vaf_validation"].unstack("memory_horizon").idxmax(axis=1)


def _claims(summary: pd.DataFrame) -> list[Claim]:
    gain = summary["gain"].unstack("memory_horizon")
    cells = {key[:2] for key in summary.index}
    whole = cells >= {(condition, P_n) for condition in CONDITIONS for P_n in INTENSITIES}
    best = best_horizons(summary).reset_index(name="N0")
    overall = gain.groupby("form").mean()
    claims = []
    for form, sign in (("lambda", "λ"), ("Lambda", "Λ")):
        N0 = float(overall.loc[form].idxmax())
        near = "; ".join(
            f"{overall.loc[form, h]:+.2f} at {h:g}" for h in (128.0, 256.0, 512.0) if h in overall
        )
        claims.append(
            Claim(
                "Fig. 13",
                f"over all conditions and intensities N0 = 256 is the best, {sign}",
                f"N0 = {N0:g} (mean gain {near})",
                N0 == BEST if whole else None,
            )
        )
    if BEST in gain:
        at_best = gain[BEST].unstack("form") + summary["vaf_validation"].unstack("memory_horizon")[
            np.inf
        ].unstack("form")
        apart = (at_best["Lambda"] - at_best["lambda"]).reset_index(name="apart")
        apart = apart.loc[apart["remnant_intensity"] > 0, "apart"]
        if len(apart):
            claims.append(
                Claim(
                    "Fig. 13",
                    "no significant difference between λ and Λ",
                    f"Λ minus λ at N0 = 256: {range_text(apart, 2, sign=True)} points",
                    bool(apart.abs().max() < PRACTICALLY_NONE),
                )
            )
    return claims + _claims_of_cells(best, gain)


def _claims_of_cells(best: pd.DataFrame, gain: pd.DataFrame) -> list[Claim]:
    claims = []
    of_lambda = best[best["form"] == "lambda"]
    varying = of_lambda[of_lambda["condition"].isin(VARYING)]
    if len(varying["remnant_intensity"].unique()) > 1:
        octaves = varying.pivot(index="condition", columns="remnant_intensity", values="N0")
        octaves = np.log2(octaves.clip(upper=2.0**14))
        steps = np.diff(octaves.to_numpy(), axis=1)
        claims.append(
            Claim(
                "Fig. 13",
                "lower intensities require lower N0 (C3-C6)",
                "; ".join(
                    f"P_n = {P_n:g}: {range_text(values, 0)}"
                    for P_n, values in varying.groupby("remnant_intensity")["N0"]
                ),
                bool((steps >= -1).all() and (octaves.iloc[:, -1] > octaves.iloc[:, 0]).all()),
            )
        )
    constant = of_lambda[of_lambda["condition"].isin(("C1", "C2"))]
    constant = constant[constant["remnant_intensity"] > 0]
    if len(constant):
        claims.append(
            Claim(
                "Fig. 13",
                "constant dynamics (C1, C2) require longer memories",
                f"best N0 with remnant {range_text(constant['N0'], 0)}",
                bool((constant["N0"] >= LONG).all()),
            )
        )
    gains = gain.max(axis=1).xs("lambda", level="form").unstack("condition")
    gains = gains[gains.index > 0]
    if {"C3", "C4", "C5", "C6"} <= set(gains.columns) and len(gains):
        into, back = gains[["C3", "C4"]].mean(axis=1), gains[["C5", "C6"]].mean(axis=1)
        claims.append(
            Claim(
                "Fig. 13",
                "forgetting gains notably less in C5 and C6 (1/s² to 1/s) than in C3 and C4",
                f"best mean gains {range_text(back, 1)} against {range_text(into, 1)} points",
                bool((back < into).all()),
            )
        )
    if {"C1", "C2"} <= set(gains.columns) and 16.0 in gain.columns and len(gains) > 1:
        at_16 = gain[16.0].xs("lambda", level="form").unstack("condition")
        at_16 = at_16[at_16.index > 0]
        spread = at_16.max() - at_16.min()
        claims.append(
            Claim(
                "Fig. 13",
                "the gains of different intensities lie further apart in C2 than in C1",
                f"at N0 = 16 over {spread['C2']:.1f} and {spread['C1']:.1f} points",
                bool(spread["C2"] > spread["C1"]),
            )
        )
    return claims


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(kind: str) -> Any:
        from ....plotting import StudyTradeOffDisplay

        return StudyTradeOffDisplay.from_table(table, kind=kind)

    kinds = {
        "fig13": "gain",
        "figJ1": "vaf_estimation",
        "figJ2": "vaf_validation",
        "figJ3": "overfit_difference",
        "figJ4": "overfit_ratio",
        "figJ5": "tradeoff_ratio",
    }
    return {name: partial(draw, kind) for name, kind in kinds.items()}
