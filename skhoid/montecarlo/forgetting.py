"""Tracking ability against noise sensitivity: the choice of a memory horizon (Fig. 13, App. J)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ..arx.recursive_cv import HORIZONS
from .batch import FORMS, delay_losses, least_squares, trade_off
from .blocks import Block
from .declared import identified_as
from .paper import (
    CONDITIONS,
    FIRST_PART,
    INTENSITIES,
    KEPT,
    Claim,
    StudyResult,
    candidate_delays,
    gains_of,
    shifted,
    span,
    succeeded,
)
from .study import MonteCarloStudy

TRANSITION = (30.72, 51.20)  # s: where validation runs are scored
CELL = ["condition", "remnant_intensity"]
SETTING = ["form", "memory_horizon"]
VARYING = ("C3", "C4", "C5", "C6")
BEST = 256.0  # N0 of the thesis
PRACTICALLY_NONE = 1.0  # VAF points between forgetting by factor and by matrix
LONG = 2048.0  # N0 from which on a memory is long


@identified_as("skhoid: forgetting VAF", version=1)
def forgetting_vaf(
    block: Block,
    *,
    memory_horizons: Sequence[float] = HORIZONS,
    window: tuple[float, float] = TRANSITION,
    init_window: float = FIRST_PART,
    scaled: bool = False,
    by_run: bool = False,
) -> pd.DataFrame:
    """VAF of recursions by memory horizon, for a :class:`MonteCarloStudy`.

    Each run has its own n_k*, theta0 of its first ``init_window`` seconds and P0 = I; with
    ``scaled`` the signals have unit power there first, so that P0 is worth one sample whatever
    the units. With ``by_run`` there is a row for each validation run.
    """
    rate = block.task.sampling_rate
    before, first = int((block.record.time < 0).sum()), round(init_window * rate)
    begin, end = (round(instant * rate) for instant in window)
    assert block.validation is not None
    nks = candidate_delays(block.task)
    e, u, e_v, u_v = block.record.e, block.record.u, block.validation.e, block.validation.u
    losses, _ = delay_losses(e, u, before, nks)
    delays = nks[losses.argmin(axis=1)]
    rows = []
    for run, nk in enumerate(delays):
        one, many = (shifted(x, before, nk, extra=1) for x in (e[[run]], e_v))
        u_one, u_many = u[[run], before:], u_v[:, before:]
        if scaled:
            e_power, u_power = (
                np.sqrt(np.mean(signal[:, :first] ** 2)) for signal in (one[:, 1:], u_one)
            )
            one, many, u_one, u_many = (
                one / e_power, many / e_power, u_one / u_power, u_many / u_power,
            )  # fmt: skip
        theta0 = least_squares(one[:, 1 : first + 1], u_one[:, :first])[0]
        rows.append(
            trade_off(
                one[0, : end + 1], u_one[0, :end], theta0, many[:, : end + 1], u_many[:, :end],
                memory_horizons, FORMS, (begin, end),
            )
        )  # fmt: skip
    vaf = np.array(rows)  # runs, forms, horizons, recordings
    of_validation = vaf[..., 1:] if by_run else vaf[..., 1:].mean(axis=-1, keepdims=True)
    shape = of_validation.shape

    def spread(values: Any, axis: int) -> np.ndarray:
        along = np.expand_dims(np.asarray(values), [i for i in range(4) if i != axis])
        return np.broadcast_to(along, shape).ravel()

    table = pd.DataFrame(
        {
            "replication": spread(block.replications, 0),
            "form": spread(np.array(FORMS, dtype=object), 1),
            "memory_horizon": spread(np.array(memory_horizons, dtype=float), 2),
            "nk": spread(delays, 0),
            "P_n": spread(block.record.intensity(), 0),
            "vaf_estimation": np.broadcast_to(vaf[..., :1], shape).ravel(),
            "vaf_validation": of_validation.ravel(),
        }
    )
    if by_run:
        table.insert(3, "validation", spread(range(len(e_v)), 3))
    else:
        table["sd_validation"] = (
            vaf[..., 1:].std(axis=-1, ddof=1).ravel() if len(e_v) > 1 else np.nan
        )
    return table


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

    Recursive ARX[2, 2] models of each estimation run, with its own n_k*, theta0 = OLS of the first
    30.72 s and P0 = I, for all memory horizons; λ forgets all parameters, Λ b0 and b1 alone. The
    path of parameters is run freely on each validation run, and scored on the transition window
    from 30.72 to 51.20 s.

    Parameters
    ----------
    n_replications : int, default=100
        Estimation runs of each cell.
    conditions : sequence of str, default=("C1", ..., "C6")
        Conditions of Table III.
    intensities : sequence of float, default=(0, 0.05, ..., 0.30)
        P_n.
    memory_horizons : sequence of float, default=(2, 4, ..., 8192, inf)
        N0 in samples (Table V); one of them infinity, with which the others are compared.
    n_validation : int, default=10
        Validation runs of each cell.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter.
    gains : {"table", "tuned"}, default="table"
        K_n of Table G.1, or found from ten realisations of a seed stream of its own.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept, see :meth:`MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a bar; None means where there is a terminal.

    Returns
    -------
    result : StudyResult
        Its table has a row for each replication, form ("lambda", "Lambda") and memory horizon,
        with nk, P_n, ``vaf_estimation``, ``vaf_validation`` (mean over validation runs, each at
        least 0 %) and ``sd_validation`` (deviation over them).

    Notes
    -----
    All replications of a cell share its validation runs, so that the level of their mean VAF has
    a standard error of ``sd_validation`` over the root of ``n_validation``, however many
    replications there are; gains have much less.

    Examples
    --------
    >>> from skhoid.montecarlo import forgetting_study
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
            "memory_horizons are above 1 and hold infinity, no forgetting, with which the others "
            f"are compared; got {list(memory_horizons)}."
        )
    if n_validation < 1:
        raise ValueError(f"n_validation is at least 1; got {n_validation!r}.")
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


def with_gain(table: pd.DataFrame, data_set: list[str]) -> pd.DataFrame:
    """The gain in VAF over no forgetting (Eqs. 31-32), of the same data set and form."""
    keys = [*data_set, "form"]
    endless = table[np.isinf(table["memory_horizon"])].set_index(keys)["vaf_validation"]
    base = table.join(endless.rename("base"), on=keys)["base"]
    return table.assign(gain=table["vaf_validation"] - base)


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
                    f"Λ less λ at N0 = 256: {span(apart, 2, sign=True)} points",
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
                    f"P_n = {P_n:g}: {span(values, 0)}"
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
                f"best N0 with remnant {span(constant['N0'], 0)}",
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
                f"best mean gains {span(back, 1)} against {span(into, 1)} points",
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
        from ..plotting import StudyTradeOffDisplay

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
