"""Tuning of the methods: each with the same number of settings and of data sets, by validation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..montecarlo.study import MonteCarloStudy
from .cells import TournamentCell
from .figures import LOWEST_VAF, tuning_scores
from .methods import TournamentMethod

SIMULATION = {"run_in": 20.0}  # s


def groups_of(cells: Sequence[TournamentCell]) -> dict[str, list[TournamentCell]]:
    """The cells that are tuned together."""
    groups: dict[str, list[TournamentCell]] = {}
    for cell in cells:
        groups.setdefault(cell.group, []).append(cell)
    return groups


def spread(cells: Sequence[TournamentCell], n_data_sets: int) -> tuple[list[TournamentCell], int]:
    """At most so many cells, evenly from all, and replications of each, for so many data sets."""
    places = np.linspace(0, len(cells) - 1, min(n_data_sets, len(cells))).round().astype(int)
    chosen = [cells[place] for place in places]
    return chosen, math.ceil(n_data_sets / len(chosen))


def tuned(
    method: TournamentMethod,
    cells: Sequence[TournamentCell],
    n_data_sets: int,
    options: dict[str, Any],
    run: Callable[[MonteCarloStudy, Path], pd.DataFrame],
) -> pd.DataFrame:
    """Mean validation VAF of each setting in each group, and which setting is taken.

    ``options`` are the delay, the number of validation runs and the seed; ``run`` runs a study in
    a folder of this name.
    """
    rows = []
    for number, (group, members) in enumerate(groups_of(cells).items()):
        scores = np.full(len(method.settings), np.nan)
        failed = np.zeros(len(method.settings))
        if len(method.settings) > 1:
            some, n_replications = spread(members, n_data_sets)
            study = MonteCarloStudy(
                partial(tuning_scores, method=method.name, delay=options["delay"]),
                [cell.row() for cell in some],
                n_replications,
                n_validation_runs=options["n_validation"],
                simulation=simulation_of(some, method),
                block_size=1,
                random_state=options["seed"],
            )
            table = run(study, Path("tuning") / method.name / f"group {number}")
            table = table.reindex(columns=["setting", "vaf", "failure", "error"])
            found = table["vaf"].fillna(LOWEST_VAF).groupby(table["setting"]).mean()
            scores = found.reindex(range(len(method.settings))).to_numpy(float)
            lost = (table["failure"].notna() | table["error"].notna()).groupby(table["setting"])
            failed = 100.0 * lost.mean().reindex(range(len(scores))).fillna(100.0).to_numpy()
        best = int(np.nanargmax(scores)) if np.isfinite(scores).any() else 0
        rows += [
            {
                "method": method.name,
                "group": group,
                "knob": method.knob,
                "setting": str(setting),
                "vaf": scores[place],
                "failed": failed[place],
                "chosen": place == best,
            }
            for place, setting in enumerate(method.settings)
        ]
    return pd.DataFrame(rows)


def simulation_of(cells: Sequence[TournamentCell], method: TournamentMethod) -> dict[str, Any]:
    """Options of the simulation; a whole task has its own run-in."""
    whole = any("sampling_rate" not in cell.row() for cell in cells)
    return {"channels": method.channels} | ({} if whole else SIMULATION)


def chosen_settings(
    method: TournamentMethod, tuning: pd.DataFrame, cells: Sequence[TournamentCell]
) -> dict[str, Any]:
    """The setting of a method in each cell, by the cell's name, from the tuning of the method."""
    by_group = {
        group: method.settings[int(np.argmax(part["chosen"].to_numpy()))]
        for group, part in tuning.groupby("group", sort=False)
    }
    return {cell.name: by_group[cell.group] for cell in cells}


def watching(settings: dict[str, Any], cells: Sequence[TournamentCell]) -> dict[str, Any]:
    """The settings with which changes are watched for: where nothing changes, those that the method
    has where something does, with the same remnant; else its own.
    """
    of_changing = {cell.group: settings[cell.name] for cell in cells if cell.kind == "changing"}
    return {
        cell.name: of_changing.get(cell.group.replace("constant", "changing"), settings[cell.name])
        for cell in cells
    }
