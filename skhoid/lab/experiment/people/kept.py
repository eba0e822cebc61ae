"""The folder of a call: finished groups, and their models."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ...._machine import ended_by_signals
from ...._version import __version__
from ....io.whole import is_left_over, written_whole
from ...studies.montecarlo.identity import FORMAT, described
from ...studies.montecarlo.store import Store
from ...studies.montecarlo.workers import progress_bar, results_of
from .fit import MODEL, checksum
from .groups import Group

MODELS = "models"


def completed(
    jobs: Sequence[Any],
    compute: Callable[[Any], Any],
    finished: dict[int, Any],
    keep: Callable[[int, Any], None] | None,
    *,
    n_jobs: int | None,
    progress: bool | None,
    what: str,
) -> list[Any]:
    """The result of each job in order: those that are finished, and others as they get so.

    ``keep`` is given the place and the result of each that was not.
    """
    wanted = [number for number in range(len(jobs)) if number not in finished]
    done = results_of([jobs[number] for number in wanted], compute, n_jobs=n_jobs)
    with (
        ended_by_signals(),
        progress_bar(progress, len(jobs), len(finished), what) as advance,
        contextlib.closing(done),
    ):
        for place, found in done:
            finished[wanted[place]] = found
            if keep is not None:
                keep(wanted[place], found)
            advance()
    return [finished[number] for number in range(len(jobs))]


class Folder:
    """Groups that are finished: a block of a study's folder each, and a file for its model.

    The model is written first, and the block holds its checksum: a block is there only with the
    model that belongs to it.
    """

    def __init__(self, folder: str | os.PathLike[str], description: dict[str, Any]) -> None:
        self.store = Store(folder, description)
        self.models = Path(folder) / MODELS

    def finished(self, keep_models: bool) -> dict[int, tuple[pd.DataFrame, bytes]]:
        """Blocks by number with their models, but not those whose model is wanted and missing."""
        if self.models.is_dir():
            for path in self.models.iterdir():
                if is_left_over(path):  # of a process that was killed while it wrote
                    path.unlink(missing_ok=True)
        found = {}
        for number, table in self.store.finished().items():
            content = b""
            if keep_models:
                told = table.loc[table["part"] == MODEL, "text"]
                path = self._path(number)
                if len(told) and told.iloc[0]:
                    content = path.read_bytes() if path.is_file() else b""
                if not len(told) or checksum(content) != told.iloc[0]:
                    continue
            found[number] = table, content
        return found

    def write(self, number: int, found: tuple[pd.DataFrame, bytes]) -> None:
        table, content = found
        if content:
            self.models.mkdir(exist_ok=True)
            with written_whole(self._path(number), sync=True) as path:
                path.write_bytes(content)
        self.store.write(number, table)

    def _path(self, number: int) -> Path:
        return self.models / f"model-{number:06d}.joblib"


def description_of(
    estimator: Any, groups: list[Group], *, each_run: bool, ceiling: bool
) -> dict[str, Any]:
    """What a folder's results depend on."""
    return {
        "identity": FORMAT,
        "task": "identify_people",
        "estimator": described(estimator),
        "each_run": each_run,
        "ceiling": ceiling,
        "data": {str(group): [*map(str, group.labels), group.identity()] for group in groups},
        "entropy": "0",  # nothing is drawn; a folder's description has it
        "skhoid": __version__,
    }
