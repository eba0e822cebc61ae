"""MonteCarloStudy: conditions x replications x a function of one simulated data set."""

from __future__ import annotations

import inspect
import os
import re
import warnings
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from ... import CompensatoryTask, RemnantIntensityError, StudyWarning, __version__, tune_remnant
from ...exceptions import did_you_mean
from ...simulation import OF_TASK, check_channel_names, entropy_of, task_of
from .blocks import ERROR, REPLICATION, DataSet, Job, compute, joined
from .identity import described, digest, spawn_key
from .store import Store, read_manifest, uniform
from .workers import completed, yield_results

BLOCK = 32  # replications


class MonteCarloStudy:
    """A table of conditions, a number of replications, and a function of one simulated data set.

    Every data set has its own noise: the seed of a replication follows from ``random_state``, the
    contents of its cell, and its number (``numpy.random.SeedSequence``). Adding cells, replications
    or workers, or another order, does not change any of the existing results.

    Parameters
    ----------
    function : callable
        ``function(data, **settings)`` of one data set (:class:`~skhoid.lab.studies.blocks.DataSet`)
        with ``X``, ``y``, ``truth``, ``validation`` and ``record``; returns a number, a dict (one
        row), or a list of dicts, dict of arrays or DataFrame (several rows). Settings are those
        columns of ``conditions`` that are not options of the simulation.
    conditions : dict of lists, list of dicts or DataFrame
        The cells: all combinations of lists, or one per row (NaN in a DataFrame means not given).
        Columns are ``condition``, other options of :func:`skhoid.make_tracking_runs` such as
        ``remnant_intensity``, ``sampling_rate`` or ``effects``, and keyword arguments of
        ``function``.
    n_replications : int, default=100
        Data sets per cell.
    n_runs : int, default=1
        Runs per data set.
    n_validation_runs : int, default=0
        Further runs per cell, ``data.validation``, shared by all of its replications.
    simulation : dict or None, default=None
        Options of :func:`skhoid.make_tracking_runs` that all cells share, such as ``channels``.
    common_noise : bool, default=False
        Use the same noise in all cells, replication by replication, so that differences between
        cells are not due to noise (as in the thesis).
    batched : bool, default=False
        ``function`` takes several replications (:class:`~skhoid.lab.studies.blocks.Block`) instead,
        and returns a table with a column ``replication``; for compiled work on many runs at once,
        which threads can share.
    block_size : int or None, default=None
        Replications that are simulated, computed and stored together; None means 32.
    random_state : int, RandomState, Generator or None, default=None
        Source of all randomness. None draws a new one, or takes that of the folder given to
        :meth:`run`.

    Attributes
    ----------
    cells : DataFrame
        The cells, as the results show them.

    Raises
    ------
    ValueError
        If a name is neither an option of the simulation nor an argument of the function, or if a
        cell's physics are not valid.

    Examples
    --------
    >>> from skhoid import ARXRegressor, MonteCarloStudy
    >>> def lead(data, nk):
    ...     model = ARXRegressor(nk=nk).fit(data.X, data.y)
    ...     return {"b0": model.coef_[2], "true_b0": data.truth.arx_parameters["b0"].iloc[0]}
    >>> study = MonteCarloStudy(
    ...     lead,
    ...     {"condition": ["C1", "C2"], "remnant_intensity": [0.0, 0.15], "nk": [29]},
    ...     n_replications=4,
    ...     random_state=0,
    ... )
    >>> table = study.run()
    >>> table.groupby(["condition", "remnant_intensity"])["b0"].mean().round(3)
    condition  remnant_intensity
    C1         0.00                 0.044
               0.15                 0.074
    C2         0.00                 0.102
               0.15                 0.172
    Name: b0, dtype: float64
    """

    def __init__(
        self,
        function: Callable[..., Any],
        conditions: Any,
        n_replications: int = 100,
        *,
        n_runs: int = 1,
        n_validation_runs: int = 0,
        simulation: Mapping[str, Any] | None = None,
        common_noise: bool = False,
        batched: bool = False,
        block_size: int | None = None,
        random_state: Any = None,
    ) -> None:
        self.function = function
        self.n_replications = _whole(n_replications, "n_replications", 1)
        self.n_runs = _whole(n_runs, "n_runs", 1)
        self.n_validation_runs = _whole(n_validation_runs, "n_validation_runs", 0)
        self.block_size = _whole(BLOCK if block_size is None else block_size, "block_size", 1)
        self.common_noise, self.batched = common_noise, batched
        self._drawn = random_state is None
        self.entropy = entropy_of(random_state)
        shared = dict(simulation or {})
        channels = shared.pop("channels", ("e",))
        check_channel_names(channels)
        self.channels = tuple(channels)
        rows = find_rows(conditions)
        self._cells = [read_cell(row, shared, function) for row in rows]
        self.cells = uniform(pd.DataFrame([{k: label(v) for k, v in row.items()} for row in rows]))
        self._labels = self.cells.to_dict("records")
        if self.cells.duplicated().any():
            twice = self.cells[self.cells.duplicated()].iloc[0].to_dict()
            raise ValueError(f"conditions: the cell {twice} occurs twice.")

    @property
    def description(self) -> dict[str, Any]:
        """Description of the study; two studies with the same description give the same table."""
        return {
            "function": described(self.function),
            "cells": [described(cell["row"]) for cell in self._cells],
            "simulation": described(self._cells[0]["shared"]),
            "channels": list(self.channels),
            "n_replications": self.n_replications,
            "n_runs": self.n_runs,
            "n_validation_runs": self.n_validation_runs,
            "common_noise": self.common_noise,
            "batched": self.batched,
            "block_size": self.block_size,
            "entropy": str(self.entropy),
            "skhoid": __version__,
        }

    def run(
        self,
        out: str | os.PathLike[str] | None = None,
        *,
        n_jobs: int | None = None,
        progress: bool | None = None,
    ) -> pd.DataFrame:
        """Compute all cells and replications, or those that are left.

        Parameters
        ----------
        out : path or None, default=None
            Folder for finished blocks (tables in JSON, written as they finish). A study that was
            stopped for any reason resumes from it and ends with the same table. None keeps nothing.
        n_jobs : int or None, default=None
            Number of workers, as in joblib; inside ``joblib.parallel_config(backend="dask")`` those
            of the connected dask cluster (``pip install "skhoid[dask]"``). Ray and Spark have their
            own joblib backends; their results come in rounds.
        progress : bool or None, default=None
            Show a progress bar; without a terminal a line for each block. None means only in a
            terminal.

        Returns
        -------
        table : DataFrame
            The columns of the cells, ``replication``, those that the function returned, and
            ``error`` and ``seed`` for data sets that failed (None elsewhere).

        Raises
        ------
        StudyFolderError
            If the folder belongs to a different study, or to none.
        WorkersLostError
            If workers die repeatedly. Blocks that do not kill their worker are finished first.

        Warns
        -----
        StudyWarning
            If data sets failed, or if a file was damaged and its block is computed again.
        """
        store, finished = None, {}
        if out is not None:
            drawn, there = self.entropy, read_manifest(out)
            if self._drawn and there is not None:
                self.entropy = int(there.get("entropy", drawn))
            try:
                store = Store(out, self.description)
            except Exception:
                self.entropy = drawn
                raise
            finished = store.finished()
        ranges = self._ranges()
        wanted = {number for number in range(len(ranges)) if number not in finished}
        tasks = self._tuned({ranges[number][0] for number in wanted}, n_jobs)
        found = completed(
            {i: self._job(tasks[ranges[i][0]], *ranges[i]) for i in sorted(wanted)},
            compute,
            store,
            finished=finished,
            n_jobs=n_jobs,
            threads=self.batched,
            progress=progress,
            what="study",
        )
        whole = uniform(joined(found))
        _warn_of_failures(whole, len(self._cells) * self.n_replications)
        return whole

    def data_set(self, cell: int, replication: int) -> DataSet:
        """Simulate one data set again, to see what the function was given.

        Parameters
        ----------
        cell : int
            Row of :attr:`cells`.
        replication : int
            Its number in the cell, as in the results.

        Returns
        -------
        data : DataSet
        """
        cell = range(len(self._cells))[cell]
        task = self._tuned({cell}, None)[cell]
        if isinstance(task, str):
            raise RemnantIntensityError(task)
        one = range(_whole(replication, "replication", 0), replication + 1)
        return next(iter(self._job(task, cell, one).block(one).data_sets()))

    def _ranges(self) -> list[tuple[int, range]]:
        """Cell and replications of each block; the same whoever computes them."""
        size, n = self.block_size, self.n_replications
        return [
            (cell, range(first, min(first + size, n)))
            for cell in range(len(self._cells))
            for first in range(0, n, size)
        ]

    def _draw_entropy(self, cell: int) -> int:
        if self.common_noise:
            return self.entropy
        row, shared = self._cells[cell]["row"], self._cells[cell]["shared"]
        key = spawn_key(described(row | shared))
        sequence = np.random.SeedSequence(self.entropy, spawn_key=key)
        return int.from_bytes(sequence.generate_state(4).tobytes(), "little")

    def _tuned(self, cells: set[int], n_jobs: int | None) -> dict[int, CompensatoryTask | str]:
        """The tasks of cells, or why there is none; gains are tuned once per cell."""
        jobs = {
            i: (self._cells[i]["task"], self._draw_entropy(i), self._cells[i]["simulation"])
            for i in sorted(cells)
        }
        if all(task.remnant is None or task.remnant.gain is not None for task, *_ in jobs.values()):
            return {i: task for i, (task, *_) in jobs.items()}
        return dict(yield_results(jobs, _tune, n_jobs=n_jobs, threads=True))

    def _job(self, task: CompensatoryTask | str, cell: int, replications: range) -> Job:
        return Job(
            function=self.function,
            batched=self.batched,
            labels=self._labels[cell],
            task=task,
            simulation=self._cells[cell]["simulation"],
            settings=self._cells[cell]["settings"],
            entropy=self._draw_entropy(cell),
            replications=replications,
            n_runs=self.n_runs,
            n_validation=self.n_validation_runs,
            channels=self.channels,
        )

    def __repr__(self) -> str:
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return (
            f"MonteCarloStudy({name}, {len(self._cells)} cells x {self.n_replications} "
            f"replications, {digest(self.description)})"
        )


def _tune(job: tuple[CompensatoryTask, int, Mapping[str, Any]]) -> CompensatoryTask | str:
    task, entropy, simulation = job
    if task.remnant is None or task.remnant.gain is not None:
        return task
    try:
        return tune_remnant(
            task, random_state=entropy, open_loop=simulation.get("open_loop", False)
        )
    except MemoryError:
        raise
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _whole(value: Any, name: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} must be a whole number, at least {least}; got {value!r}.")
    return int(value)


def _warn_of_failures(table: pd.DataFrame, total: int) -> None:
    failed = table[table[ERROR].notna()]
    if failed.empty:
        return
    first = failed.iloc[0]
    names = table.columns[: list(table.columns).index(REPLICATION)]
    cell = ", ".join(f"{name}={first[name]}" for name in names)
    warnings.warn(
        f"{len(failed)} of {total} data sets failed; the columns error and seed say which. The "
        f"first, replication {first[REPLICATION]} of {cell}: {first[ERROR]}",
        StudyWarning,
        stacklevel=3,
    )


LISTS = (list, tuple, range, np.ndarray, pd.Series, pd.Index)
LONGEST = 40  # characters of what stands for an object in a table
OF_SIMULATION = ("random_phases", "open_loop", "keep_run_in")
OF_STUDY = {
    "n_runs": "n_runs of the study",
    "random_state": "random_state of the study",
    "n_jobs": "n_jobs of run()",
    "progress": "progress of run()",
    "noise": "random_state of the study",
    "return_truth": "data.truth in the function",
    "channels": "simulation={'channels': ...}",
}


def find_rows(conditions: Any) -> list[dict[str, Any]]:
    """The cells as given, one dict each."""
    if isinstance(conditions, pd.DataFrame):
        rows = [
            {str(k): v for k, v in row.items() if np.ndim(v) or not pd.isna(v)}
            for row in conditions.to_dict("records")
        ]
    elif isinstance(conditions, Mapping):
        lists = {
            name: list(values) if isinstance(values, LISTS) else [values]
            for name, values in conditions.items()
        }
        rows = [dict(zip(lists, row, strict=True)) for row in product(*lists.values())]
    else:
        rows = [dict(row) for row in conditions]
    if not any(rows):
        raise ValueError("conditions is empty: a study needs at least one cell.")
    return rows


def label(value: Any) -> Any:
    """A value of a cell as text or a number, for a column of the results."""
    if value is None or isinstance(value, (bool, int, float, str, np.bool_, np.number)):
        return value
    text = str(value)
    if len(text) <= LONGEST and not re.search(r"\bat 0x|\n", text):
        return text
    name = getattr(value, "name", None)
    if isinstance(name, str):
        return name
    return f"{getattr(value, '__name__', type(value).__name__)} {digest(described(value))[:6]}"


def read_cell(
    row: dict[str, Any], shared: dict[str, Any], function: Callable[..., Any]
) -> dict[str, Any]:
    """What a cell simulates, and the settings it passes to the function."""
    both = shared | row
    known = {"condition", *OF_TASK, *OF_SIMULATION}
    for name in both:
        if name in OF_STUDY:
            raise ValueError(f"{name} is not an option of a cell; use {OF_STUDY[name]}.")
    settings = {name: value for name, value in both.items() if name not in known}
    _check_settings(settings, function, known)
    task = task_of(
        both.get("condition", "C1"), {name: both[name] for name in OF_TASK if name in both}
    )
    simulation = {name: both[name] for name in OF_SIMULATION if both.get(name) is not None}
    return {
        "row": row,
        "shared": shared,
        "task": task,
        "simulation": simulation,
        "settings": settings,
    }


def _check_settings(
    settings: Mapping[str, Any], function: Callable[..., Any], known: set[str]
) -> None:
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # not a function, or a compiled one
        if not callable(function):
            raise TypeError(
                f"function must be callable with a data set; got {function!r}."
            ) from None
        return
    needed = [
        p.name
        for p in parameters[1:]
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    for name in needed:
        if name not in settings:
            raise ValueError(
                f"conditions: the function needs {name!r}; give it as a column, such as "
                f"{{{name!r}: [...]}}."
            )
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters):
        return
    accepted = {p.name for p in parameters[1:]}
    for name in settings:
        if name not in accepted:
            raise ValueError(
                f"conditions: {name!r} is neither an option of make_tracking_runs nor an argument "
                f"of the function ({', '.join(sorted(accepted)) or 'it has none'})."
                f"{did_you_mean(name, [*known, *accepted])}"
            )
