"""Parameters over time of recursive models (Figs. 14-15, Apps. K and L)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ... import RecursiveARX, arx_to_operator
from ...arx.many_runs import PARAMETERS, fit_runs, search_delays
from ...interpret import FROM_POLES
from ...simulation import T_M, task_of, truth_of
from .blocks import Block
from .declared import STATES, Claim, PaperStudy, range_text
from .memory_horizons import FIRST_PART, KEPT, candidate_delays, shifted

CELL = ["condition", "remnant_intensity"]
TRANSITION = (T_M - 10.24, T_M + 10.24)  # s
ENDS = ("ini", "fin")


def parameter_paths(
    block: Block, *, memory_horizon: float = 256.0, step: float = 0.32
) -> pd.DataFrame:
    """Paths with λ and Λ, and batch models of both ends, for a :class:`MonteCarloStudy`."""
    rate = block.task.sampling_rate
    before, part = int((block.record.time < 0).sum()), round(FIRST_PART * rate)
    e, u = block.record.e, block.record.u[:, before:]
    nks = candidate_delays(block.task)
    losses, _ = search_delays(block.record.e, block.record.u, before, nks)
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
            "ini": fit_runs(x[:, :part], y[:, :part]),
            "fin": fit_runs(x[:, -part:], y[:, -part:]),
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


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means and deviations over replications, averaged over the transition window."""
    names = [*PARAMETERS, *FROM_POLES]
    path = table[table["time"].between(*TRANSITION)]
    grouped = path.groupby([*CELL, "form", "time"], sort=False)[names]
    over_time = grouped.mean().add_prefix("mean_").join(grouped.std(ddof=0).add_prefix("sd_"))
    return over_time.groupby([*CELL, "form"]).mean()


def _claims(summary: pd.DataFrame, table: pd.DataFrame) -> Iterator[Claim]:
    sd = summary[[f"sd_{name}" for name in PARAMETERS]]
    noisy = sd[sd.index.get_level_values("remnant_intensity") > 0]
    if len(noisy):
        ratio = noisy.xs("Lambda", level="form") / noisy.xs("lambda", level="form")
        a, b = ratio.iloc[:, :2], ratio.iloc[:, 2:]
        yield Claim(
            "Fig. 14",
            "Λ makes the estimates notably steadier, those of a1 and a2 in particular",
            f"deviations over those of λ: {range_text(a)} of a, {range_text(b)} of b",
            bool((ratio < 1).all(axis=None) and a.to_numpy().max() < b.to_numpy().min()),
        )
        yield _correlation_claim(table)
        mean = summary[summary.index.get_level_values("remnant_intensity") > 0]
        omega, zeta = mean["mean_omega_nm"], mean["mean_zeta_nm"]
        yield Claim(
            "Fig. 15",
            "omega_nm and zeta_nm are overestimated (11.25 rad/s and 0.35)",
            f"{range_text(omega, 1)} rad/s and {range_text(zeta)}",
            bool((omega > 11.25).all() and (zeta > 0.35).all()),
        )
        yield from _lead_claims(table)


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


def _lead_claims(table: pd.DataFrame) -> Iterator[Claim]:
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
    if spreads:
        yield Claim(
            "Fig. 15",
            "no stable estimates of T_L where the element is mostly 1/s²",
            f"its interquartile range there is {range_text(spreads, 1)} times that at 1/s",
            bool(min(spreads) > 2),
        )


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(condition: str, form: str, parameters: str) -> Any:
        from ...plotting import EnsembleDisplay

        task = task_of(condition, {"run_in": 1.0})
        truth = truth_of(task, task.simulate(1))
        return EnsembleDisplay.from_table(
            table[table["condition"] == condition],
            form=form,
            parameters=parameters,
            truth=truth.arx_parameters.join(truth.parameters[list(FROM_POLES)]),
            transition_time=None if condition in STATES else T_M,
        )

    return {
        f"{figure}-{condition}-{form}": partial(draw, condition, form, parameters)
        for condition in dict.fromkeys(table["condition"])
        for figure, parameters in (("fig14", "arx"), ("fig15", "operator"))
        for form in ("lambda", "Lambda")
    }


PATHS = PaperStudy(
    "ARX parameters over time in C4",
    "Parameters over time of recursive ARX models (Figs. 14-15, Apps. K and L)",
    {
        "conditions": ("C4",),
        "intensities": (0.0, 0.15, 0.30),
        "memory_horizon": 256.0,
        "step": 0.32,
        "remnant_order": 2,
        "gains": "table",
    },
    parameter_paths,
    _summary,
    _claims,
    _figures,
    ("fig14",),
    {"keep_run_in": KEPT},
    {"batched": True, "block_size": 25},
)
