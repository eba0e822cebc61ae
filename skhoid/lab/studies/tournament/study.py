"""run_tournament: every method on the same simulated runs."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...._sklearn import Interval, StrOptions, checked
from ....simulation.tracking_runs import make_tracking_runs
from ..montecarlo.study import MonteCarloStudy
from ..montecarlo.workers import progress_bar
from .cells import SIZES, TournamentCell, tournament_cells
from .figures import method_figures
from .methods import TournamentMethod, available_methods
from .result import TournamentResult
from .tuning import chosen_settings, groups_of, simulation_of, tuned, watching

# Replications of fast and slow methods, and data sets that each setting is tried on.
NUMBERS = {"full": (16, 4, 8), "small": (4, 1, 2)}
TUNING, EVALUATION = 1, 2  # spawn keys of the seeds
OF_CELL = ("family", "kind", "group")
DT = 0.01  # s, of the run whose cost is measured
AT_ONCE = 4  # replications of a block


@checked(
    methods=["array-like", None],
    cells=["array-like", None],
    size=[StrOptions(set(SIZES))],
    n_replications=[Interval(Integral, 1, None, closed="left"), None],
    n_validation=[Interval(Integral, 1, None, closed="left")],
    delay=[StrOptions({"true", "searched"})],
    random_state=[Interval(Integral, 0, None, closed="left")],
)
def run_tournament(
    methods: Sequence[str] | None = None,
    cells: Sequence[TournamentCell] | None = None,
    *,
    size: str = "full",
    n_replications: int | None = None,
    n_validation: int = 3,
    delay: str = "true",
    random_state: int = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> TournamentResult:
    """Let methods that follow a varying operator compete on the same simulated runs.

    Each method is first tuned: for constant and for changing conditions, and each remnant
    intensity, the setting of its one knob with the highest mean VAF on validation runs; all methods
    try as many settings on the same number of data sets. Then each follows other runs, of other
    seeds, and is compared with the truth.

    Parameters
    ----------
    methods : sequence of str or None, default=None
        Names in :data:`TOURNAMENT_METHODS`; None means all that can be imported.
    cells : sequence of TournamentCell or None, default=None
        Conditions; None means those of :func:`tournament_cells` for ``size``.
    size : {"full", "small"}, default="full"
        Cells and replications: 16 runs of a cell, 4 for slow methods, and 8 data sets for each
        setting; or 4, 1 and 2.
    n_replications : int or None, default=None
        Runs of each cell instead, the same for slow methods.
    n_validation : int, default=3
        Validation runs of each cell.
    delay : {"true", "searched"}, default="true"
        What methods are told that do not estimate the delay: the true one, or the n_k of the
        lowest one-step error of a batch ARX model of each run.
    random_state : int, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`. Each method has
        its own part, so that a further method computes only itself.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    result : TournamentResult
        ``print(result)`` says which method to use when; ``result.table`` has all figures.

    Raises
    ------
    ValueError
        If a method is not known, two cells have the same name, or no run can be simulated.

    See Also
    --------
    recommend_method : The same for one's own experiment and question.

    Examples
    --------
    >>> from skhoid.lab.studies.tournament import run_tournament, tournament_cells
    >>> cells = tournament_cells("small", conditions=["C4"])
    >>> result = run_tournament(["rls", "arx"], cells, size="small", n_replications=2)
    >>> result.ranking("follow").index.tolist()
    ['rls', 'arx']
    """
    chosen, notes = available_methods(methods)
    cells = tournament_cells(size) if cells is None else list(cells)
    names = [cell.name for cell in cells]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"Two cells have the name {twice!r}.")
    fast, slow, n_tuning = NUMBERS[size]
    if n_replications is not None:
        fast = slow = n_replications
    options = {"delay": delay, "n_validation": n_validation, "seed": _seed(random_state, TUNING)}
    n_studies = sum(1 + len(groups_of(cells)) * (len(m.settings) > 1) for m in chosen)
    tables, tunings = [], []
    with progress_bar(progress, n_studies, 0, "tournament") as advance:

        def run(study: MonteCarloStudy, folder: Path) -> pd.DataFrame:
            where = None if out is None else Path(out) / folder
            found = study.run(where, n_jobs=n_jobs, progress=False)
            advance()
            return found

        for method in chosen:
            tuning = tuned(method, cells, n_tuning, options, run)
            settings = chosen_settings(method, tuning, cells)
            study = MonteCarloStudy(
                partial(
                    method_figures,
                    method=method.name,
                    settings=settings,
                    watching=watching(settings, cells),
                    delay=delay,
                ),
                [cell.row() for cell in cells],
                slow if method.slow else fast,
                n_validation_runs=n_validation,
                simulation=simulation_of(cells, method),
                block_size=1 if method.slow else AT_ONCE,
                random_state=_seed(random_state, EVALUATION),
            )
            found = run(study, Path("evaluation") / method.name)
            tables.append(_told(found, method, settings, cells))
            tunings.append(tuning)
    table = pd.concat(tables, ignore_index=True)
    if table["error"].notna().all():
        raise ValueError(f"Every simulated run failed. The first error: {table['error'].iloc[0]}")
    tuning = pd.concat(tunings, ignore_index=True)
    return TournamentResult(
        table=table,
        tuning=tuning,
        methods=_table_of_methods(chosen, slow, fast),
        cost=measured_cost(chosen, tuning),
        notes=notes,
    )


def _seed(random_state: int, key: int) -> int:
    sequence = np.random.SeedSequence(int(random_state), spawn_key=(key,))
    return int.from_bytes(sequence.generate_state(4).tobytes(), "little")


def _told(
    table: pd.DataFrame,
    method: TournamentMethod,
    settings: dict[str, Any],
    cells: Sequence[TournamentCell],
) -> pd.DataFrame:
    """The table with what is known of the cells and the method."""
    of_cells = {cell.name: asdict(cell) | {"group": cell.group} for cell in cells}
    for name in reversed(OF_CELL):
        table.insert(1, name, [of_cells[cell][name] for cell in table["cell"]])
    table["method"] = method.name  # also of data sets that failed
    table["setting"] = [str(settings[cell]) for cell in table["cell"]]
    return table


def _table_of_methods(methods: Sequence[TournamentMethod], slow: int, fast: int) -> pd.DataFrame:
    rows = [
        {
            "method": method.name,
            "label": method.label,
            "causal": method.causal,
            "knob": method.knob,
            "n_settings": len(method.settings),
            "told": method.told,
            "oracle": method.is_oracle,
            "n_replications": slow if method.slow else fast,
        }
        for method in methods
    ]
    return pd.DataFrame(rows).set_index("method")


def measured_cost(methods: Sequence[TournamentMethod], tuning: pd.DataFrame) -> pd.Series:
    """Microseconds per sample of ``fit``, on this machine: the shortest of three fits of one run.

    The setting is the one most often chosen; slow methods are fitted once.
    """
    X, y, truth = make_tracking_runs(
        "C4",
        1,
        remnant_intensity=0.15,
        channels=("e", "f_t"),
        run_in=20.0,
        random_state=0,
        return_truth=True,
    )
    costs = {}
    for method in methods:
        taken = tuning[tuning["chosen"] & (tuning["method"] == method.name)]["setting"]
        common = taken.mode().iloc[0]
        setting = next(s for s in method.settings if str(s) == common)
        spent = []
        for _ in range(1 if method.slow else 3):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                begin = time.perf_counter()
                try:
                    method.estimator(DT, truth.nk, setting, truth.parameters).fit(
                        X[list(method.channels)], y
                    )
                except Exception:  # it is in the table
                    spent.append(np.nan)
                    continue
                spent.append(time.perf_counter() - begin)
        costs[method.name] = 1e6 * float(np.min(spent)) / len(y)
    return pd.Series(costs, name="cost")
