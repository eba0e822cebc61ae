"""Monte-Carlo studies, those of the thesis, and experiments of several people: tables and seeds."""

from typing import Any

import numpy as np
from cases import case, public, result_items
from worlds import NK

import skhoid
from skhoid import ARXRegressor, MonteCarloStudy

CELL = {"conditions": ["C1"], "intensities": [0.0, 0.15]}


def estimates(data: Any, nk: int = NK) -> dict[str, float]:
    """The function of the study: coefficients, and a number from its own seed."""
    model = ARXRegressor(nk=nk).fit(data.X, data.y)
    names = ("a1", "a2", "b0", "b1")
    own = np.random.default_rng(data.random_state).standard_normal()
    return dict(zip(names, model.coef_.tolist(), strict=True)) | {"own": own}


@case("study/own")
def own() -> dict[str, Any]:
    study = MonteCarloStudy(
        estimates,
        {"condition": ["C1", "C4"], "remnant_intensity": [0.1], "nk": [NK]},
        3,
        n_validation_runs=1,
        simulation={"sampling_rate": 50.0, "duration": 30.0, "run_in": 10.0},
        random_state=7,
    )
    table = study.run()
    data = study.data_set(1, 2)
    summary = public("summarize")(table, by=["condition"], values=["b0", "b1"])
    seeds = [study.data_set(cell, 0).seed for cell in (0, 1)]
    own_seeds = [study.data_set(cell, 1).random_state for cell in (0, 1)]
    return {
        "table": table,
        "seeds": seeds,
        "own seeds": [str(seed) for seed in own_seeds],
        "X": data.X,
        "y": data.y,
        "validation": data.validation.y,
        "summarize": summary,
    }


@case("study/common noise")
def common() -> dict[str, Any]:
    objects = [skhoid.HumanOperator(), skhoid.HumanOperator(K_e=skhoid.Ramp(0.09, 0.07, 5.0, 9.0))]
    study = MonteCarloStudy(
        estimates,
        [{"operator": operator, "remnant_gain": 0.01} for operator in objects],
        2,
        common_noise=True,
        simulation={"sampling_rate": 50.0, "duration": 20.0, "run_in": 5.0},
        random_state=1,
    )
    other = MonteCarloStudy(
        estimates,
        [{"operator": operator, "remnant_gain": 0.01} for operator in objects],
        2,
        simulation={"sampling_rate": 50.0, "duration": 20.0, "run_in": 5.0},
        random_state=1,
    )
    seeds = [other.data_set(cell, 0).seed for cell in (0, 1)]
    return {"table": study.run(), "cells": study.cells, "other": other.run(), "seeds": seeds}


def of_thesis(name: str, n_replications: int, **options: Any) -> dict[str, Any]:
    found = public("paper_study")(PAPER[name], n_replications, every_figure=True, **options)
    return {
        "table": found.table,
        "summary": found.summary,
        "claims": [[c.holds, c.source, c.statement, c.found] for c in found.claims],
        "title and notes": [found.title, *found.notes],
        "figures": sorted(found.figures),
    }


HORIZONS = [64, 256, np.inf]
PAPER = {
    "delay_study": "fig9",
    "forgetting_study": "fig13",
    "path_study": "fig14",
    "response_study": "appI",
}
SMALL: dict[str, dict[str, Any]] = {
    "delay_study": CELL | {"orders": [2, "nm"], "n_validation": 1},
    "forgetting_study": {
        "conditions": ["C1", "C4"],
        "intensities": [0.15],
        "memory_horizons": HORIZONS,
        "n_validation": 1,
    },
    "path_study": {"intensities": [0.15], "step": 1.28},
    "response_study": CELL,
}
for _name, _options in SMALL.items():
    case(f"study/{_name}", name=_name, n_replications=2, **_options)(of_thesis)


@case("study/paper_study")
def by_figure() -> dict[str, Any]:
    found = public("paper_study")(
        "fig13", 1, conditions=["C1"], intensities=[0.1], memory_horizons=HORIZONS, n_validation=1
    )
    return {"name": found.name, "table": found.table, "figures": sorted(found.figures)}


@case("study/recommend_forgetting")
def advice() -> dict[str, Any]:
    found = skhoid.recommend_forgetting(
        "C4", 0.15, memory_horizons=HORIZONS, n_replications=3, n_validation=2
    )
    return result_items(found) | {"text": str(found)}


@case("experiment")
def experiment() -> dict[str, Any]:
    X, y, truth = skhoid.simulate_experiment(
        1, ["C1", "C4"], 3, sampling_rate=50.0, random_state=0, return_truth=True
    )
    found = skhoid.analyse_experiment(X, y, last=2, memory_horizon=128.0)
    items = result_items(found) | {"X": X, "y": y, "truth": dict(truth)}
    return items | {"score_table": found.score_table()}
