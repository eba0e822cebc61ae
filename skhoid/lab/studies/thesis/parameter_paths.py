"""Parameters over time of recursive models (Figs. 14-15, Apps. K and L)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ....arx.recursive import RecursiveARX
from ....interpret.conversion import FROM_POLES, arx_to_operator
from ....simulation.conditions import T_M
from ....simulation.tracking_runs import task_of, truth_of
from ..montecarlo.blocks import Block
from ..montecarlo.declared import identified_as
from ..montecarlo.horizons import FIRST_PART, KEPT, candidate_delays, shifted, succeeded
from ..montecarlo.study import MonteCarloStudy
from ..montecarlo.vectorised import PARAMETERS, delay_losses, least_squares
from .study_result import STATES, Claim, StudyResult, gains_of, range_text

CELL = ["condition", "remnant_intensity"]
TRANSITION = (T_M - 10.24, T_M + 10.24)  # s
ENDS = ("ini", "fin")


@identified_as("skhoid: parameter paths", version=1)
def parameter_paths(
    block: Block, *, memory_horizon: float = 256.0, step: float = 0.32
) -> pd.DataFrame:
    """Paths with λ and Λ, and batch models of both ends, for a :class:`MonteCarloStudy`."""
    rate = block.task.sampling_rate
    before, part = int((block.record.time < 0).sum()), round(FIRST_PART * rate)
    e, u = block.record.e, block.record.u[:, before:]
    nks = candidate_delays(block.task)
    losses, _ = delay_losses(block.record.e, block.record.u, before, nks)
    every = max(round(step * rate), 1)
    forms = {"lambda": memory_horizon, "Lambda": (np.inf, np.inf, memory_horizon, memory_horizon)}
    time = np.arange(0, u.shape[1], every) / rate
    tables = []
    for run, replication in enumerate(block.replications):
        nk = int(nks[losses[run].argmin()])
        x, y = shifted(e[[run]], before, nk), u[[run]]
        found = {
            name: RecursiveARX(memory_horizon=N0, p0=1.0, dt=1 / rate)
            .fit(x[0][:, None], y[0])
            .coef_path_[::every]
            for name, N0 in forms.items()
        }
        found |= {
            "ini": least_squares(x[:, :part], y[:, :part]),
            "fin": least_squares(x[:, -part:], y[:, -part:]),
        }
        for name, theta in found.items():
            table = pd.DataFrame(theta, columns=list(PARAMETERS))
            values, _, _ = arx_to_operator(theta, 1 / rate)
            table = table.assign(**{parameter: values[parameter] for parameter in FROM_POLES})
            table.insert(0, "time", np.nan if name in ENDS else time)
            table.insert(0, "form", name)
            table.insert(0, "replication", replication)
            tables.append(table)
    return pd.concat(tables)


def path_study(
    n_replications: int = 100,
    *,
    conditions: Sequence[str] = ("C4",),
    intensities: Sequence[float] = (0.0, 0.15, 0.30),
    memory_horizon: float = 256.0,
    step: float = 0.32,
    remnant_order: Any = 2,
    gains: str = "table",
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> StudyResult:
    """Follow the parameters through the change, with λ and with Λ (Figs. 14-15, Apps. K, L).

    For each run: n_k*; two recursions from theta0 = OLS of the first 30.72 s and P0 = I, one that
    forgets all parameters (λ) and one that forgets only b0 and b1 (Λ); batch models of the first
    and last 30.72 s; all converted to the operator's parameters.

    Parameters
    ----------
    n_replications : int, default=100
        Runs per cell.
    conditions : sequence of str, default=("C4",)
        Conditions of Table III; Apps. K and L have all.
    intensities : sequence of float, default=(0, 0.15, 0.30)
        P_n.
    memory_horizon : float, default=256
        N0 in samples.
    step : float, default=0.32
        Seconds between the times that the table keeps.
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
        Its table has a row for each replication, form and time: ``form`` is "lambda", "Lambda", or
        "ini" and "fin" for the batch models (time NaN); operator parameters are NaN where the poles
        are not a complex pair. Its summary has means and deviations over replications, averaged
        over the transition window.

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import path_study
    >>> found = path_study(4, intensities=[0.15])
    >>> found.summary.loc[("C4", 0.15), "sd_a1"].round(3).to_dict()
    {'Lambda': 0.008, 'lambda': 0.014}
    """
    study = MonteCarloStudy(
        partial(parameter_paths, memory_horizon=float(memory_horizon), step=float(step)),
        {"condition": list(conditions), "remnant_intensity": [float(P) for P in intensities]},
        n_replications,
        simulation={"keep_run_in": KEPT, "remnant_order": remnant_order}
        | gains_of(gains, intensities),
        batched=True,
        block_size=25,
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress)
    good = succeeded(table)
    summary = _summary(good)
    return StudyResult(
        "fig14",
        "Parameters over time of recursive ARX models (Figs. 14-15, Apps. K and L)",
        table,
        summary,
        _claims(summary, good),
        _figures(good),
    )


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means and deviations over replications, averaged over the transition window."""
    names = [*PARAMETERS, *FROM_POLES]
    path = table[table["time"].between(*TRANSITION)]
    grouped = path.groupby([*CELL, "form", "time"], sort=False)[names]
    over_time = grouped.mean().add_prefix("mean_").join(grouped.std(ddof=0).add_prefix("sd_"))
    return over_time.groupby([*CELL, "form"]).mean()


def _claims(summary: pd.DataFrame, table: pd.DataFrame) -> list[Claim]:
    sd = summary[[f"sd_{name}" for name in PARAMETERS]]
    noisy = sd[sd.index.get_level_values("remnant_intensity") > 0]
    claims = []
    if len(noisy):
        ratio = noisy.xs("Lambda", level="form") / noisy.xs("lambda", level="form")
        a, b = ratio.iloc[:, :2], ratio.iloc[:, 2:]
        claims.append(
            Claim(
                "Fig. 14",
                "Λ makes the estimates notably steadier, those of a1 and a2 in particular",
                f"deviations over those of λ: {range_text(a)} of a, {range_text(b)} of b",
                bool((ratio < 1).all(axis=None) and a.to_numpy().max() < b.to_numpy().min()),
            )
        )
        claims.append(_correlation_claim(table))
        mean = summary[summary.index.get_level_values("remnant_intensity") > 0]
        omega, zeta = mean["mean_omega_nm"], mean["mean_zeta_nm"]
        claims.append(
            Claim(
                "Fig. 15",
                "omega_nm and zeta_nm are overestimated (11.25 rad/s and 0.35)",
                f"{range_text(omega, 1)} rad/s and {range_text(zeta)}",
                bool((omega > 11.25).all() and (zeta > 0.35).all()),
            )
        )
        claims += _lead_claims(table)
    return claims


def _correlation_claim(table: pd.DataFrame) -> Claim:
    path = table[(table["form"] == "lambda") & (table["remnant_intensity"] > 0)]
    path = path[path["time"].between(*TRANSITION)]
    grouped = path.groupby([*CELL, "replication"])
    found = [
        grouped[[one, two]].corr().xs(one, level=-1)[two].groupby(CELL).mean()
        for one, two in (("a1", "a2"), ("b0", "b1"))
    ]
    return Claim(
        "Fig. 14",
        "a1 is negatively correlated with a2, and b0 with b1",
        f"mean correlation over time {range_text(found[0])} and {range_text(found[1])}",
        bool(all((one < 0).all() for one in found)),
    )


def _lead_claims(table: pd.DataFrame) -> list[Claim]:
    """T_L where the element is mostly 1/s and where it is mostly 1/s²."""
    path = table[(table["form"] == "lambda") & (table["remnant_intensity"] > 0)]
    spreads = []
    for condition, order in (("C3", 1), ("C4", 1), ("C5", -1), ("C6", -1)):
        of = path[path["condition"] == condition]
        if of.empty:
            continue
        single, double = [
            np.subtract(*np.nanpercentile(of.loc[chosen, "T_L"], [75, 25]))
            for chosen in (of["time"] < TRANSITION[0], of["time"] > TRANSITION[1])
        ][::order]
        spreads.append(double / single)
    if not spreads:
        return []
    return [
        Claim(
            "Fig. 15",
            "no stable estimates of T_L where the element is mostly 1/s²",
            f"its interquartile range there is {range_text(spreads, 1)} times that at 1/s",
            bool(min(spreads) > 2),
        )
    ]


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(condition: str, form: str, parameters: str) -> Any:
        from ....plotting import StudyPathDisplay

        return StudyPathDisplay.from_table(
            table,
            condition=condition,
            form=form,
            parameters=parameters,
            truth=true_paths(condition),
            transition_time=None if condition in STATES else T_M,
        )

    return {
        f"{figure}-{condition}-{form}": partial(draw, condition, form, parameters)
        for condition in dict.fromkeys(table["condition"])
        for figure, parameters in (("fig14", "arx"), ("fig15", "operator"))
        for form in ("lambda", "Lambda")
    }


def true_paths(condition: Any) -> pd.DataFrame:
    """The true parameters of a condition over time."""
    task = task_of(condition, {"run_in": 1.0})
    truth = truth_of(task, task.simulate(1))
    return truth.arx_parameters.join(truth.parameters[list(FROM_POLES)])
