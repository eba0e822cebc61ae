"""``read_experiment``: X and y of the files of an experiment with people."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..._sklearn import DT, checked
from ...runs import TIME
from ...text import counted
from .._formats import open_table
from .._guessing import PEEK
from .._likeness import numbers_of
from .._table import FileTable
from .._xdf import read_xdf
from ..readers import add_error
from .arrays import Dims, checked_dims, first_slices
from .bids import is_motion, read_motion
from .columns import Asked, Columns, columns_of
from .joining import joined
from .levels import LEVELS
from .names import UnclearNamesError, levels_in_names, names_guess
from .parts import Part, parts_of
from .sources import Sources, find_sources
from .structs import groups_of

_ARRAYS = (".mat", ".npz")


@checked(
    paths=[str, os.PathLike, Iterable],
    subject=[str, None],
    condition=[str, None],
    run=[str, None],
    time=[str, None],
    units=[Mapping, None],
    dt=DT,
)
def read_experiment(
    paths: Any,
    *,
    subject: str | None = None,
    condition: str | None = None,
    run: str | None = None,
    inputs: str | Sequence[str] | Mapping[str, str] | None = None,
    output: str | Mapping[str, str] | None = None,
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
    dims: Sequence[str] | Mapping[str, Sequence[Any] | None] | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read the recordings of an experiment: several people, conditions and runs.

    Subject, condition and run come from fields of a pattern, from columns, from the dimensions of
    arrays, or are guessed from names of folders and files. One printed line says what was guessed,
    of names and of columns. Nothing is resampled, sorted or left out, but for XDF; the checks of
    :func:`skhoid.check_experiment` come after it.

    Parameters
    ----------
    paths : str, path, or list of these
        One of: a pattern with fields, ``"data/sub-{subject}_cond-{condition}_run-{run}.csv"`` or
        ``"{subject}/{condition}/run{run}.csv"``, with ``*`` for parts that mean nothing; a folder;
        a glob pattern; a list of files. Fields are subject, session, condition, block and run; a
        session is put before the label of the run. Formats are those of
        :func:`skhoid.read_runs`, and motion tables of BIDS (``sub-01_task-x_motion.tsv``).
    subject, condition, run : str or None, default=None
        Columns with these labels. None takes them from names, or from columns that are called so.
    inputs, output, time, units, dt
        As in :func:`skhoid.read_runs`. In structs of people a channel goes by its own name,
        ``"e"``. For XDF, `dt` is the step (s) of the grid onto which all streams are interpolated;
        None takes the nominal rate of the fastest.
    dims : sequence of str, dict or None, default=None
        What the dimensions of arrays in MAT and NPZ files are, such as ``("time", "run",
        "subject")``; a dict also gives labels, ``{"time": None, "run": None, "subject": ["anna",
        "ben"]}``, which else count from ``"1"``. None means samples x runs, samples x runs x
        people, or samples x runs x conditions x people.

    Returns
    -------
    X : DataFrame of shape (n_rows, n_inputs)
        Float64, with the row index levels ``subject`` and ``condition``, where they are known,
        ``run`` and ``time`` (s), and ``X.attrs["units"]``. Labels from names are text.
    y : Series of shape (n_rows,)
        The output with the same index.

    Raises
    ------
    FileNotFoundError
        If no file matches.
    ImportError
        If a format needs a package that is not installed.
    ValueError
        If names do not say what is what, two files give the same run, or a file cannot be read;
        nothing is read by half.

    See Also
    --------
    skhoid.check_experiment : Say what is wrong with whose recordings.
    skhoid.read_runs : Read runs of one person.

    Notes
    -----
    NaN at the end of array columns, in all channels, fills short runs and is left out. A clock in
    ms is converted where a header or `units` says so; one that only looks like it is read as it
    is, and named by :func:`skhoid.check_experiment`.

    References
    ----------
    Jeung et al. (2024), Motion-BIDS, Scientific Data 11, 716, for the motion tables.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid.io import read_experiment
    >>> rows = "t,e,u\\n0,1.5,0\\n0.01,1.25,-0.5\\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("S1_lead_1", "S1_gain_1", "S2_lead_1"):
    ...         _ = (Path(folder) / f"{name}.csv").write_text(rows)
    ...     pattern = f"{folder}/{{subject}}_{{condition}}_{{run}}.csv"
    ...     X, y = read_experiment(pattern, inputs="e", output="u", time="t")
    >>> X
                                   e
    subject condition run time
    S1      gain      1   0.00  1.50
                          0.01  1.25
            lead      1   0.00  1.50
                          0.01  1.25
    S2      lead      1   0.00  1.50
                          0.01  1.25
    """
    named = {"subject": subject, "condition": condition, "run": run}
    levels = {level: column for level, column in named.items() if column is not None}
    asked = Asked(inputs, output, time, units, dt, levels)
    shape = checked_dims(dims)
    sources = find_sources(paths)
    _check_fields(sources, asked, shape)
    return _read(sources, asked, shape)


def _read(sources: Sources, asked: Asked, dims: Dims | None) -> tuple[pd.DataFrame, pd.Series]:
    """Read all files, and print what was guessed."""
    first, groups, columns, from_files = _looked_at(sources, asked, dims)
    if columns.unit_by_steps and len(sources.files) > 1:
        others = {1, len(sources.files) - 1}
        if all(_step(_opened(sources, number, asked)[0], columns) < 1 for number in others):
            columns.take_seconds()
    parts: list[Part] = []
    order = None
    for number, labels in enumerate(from_files.labels):
        if number:
            table, _ = _opened(sources, number, asked)
            table.note = table.note or f"The first file is {first}."
            wanted = [channel.asked for channel in columns.channels]
            groups = groups_of(table, wanted, labels) or [({}, table)]
        found, of_arrays = parts_of(groups, labels, columns, dims)
        order = of_arrays or order
        parts += found
    X, y = joined(parts, columns, keep_order=sources.listed or len(sources.files) == 1)
    add_error(X, columns.guess)
    said = [from_files.said] * bool(from_files.said)
    said += [str(order)] * (order is not None and dims is None)
    said += [sources.remark] * bool(sources.remark)
    if columns.guess.guessed or len(asked.levels) < len(columns.levels):
        said.append(str(columns.guess))
    if said:
        print(f"{_counts(X, len(sources.files))}; {'; '.join(said)}")
    return X, y


def _step(table: FileTable, columns: Columns) -> float:
    """The usual step of the clock of a file, in its own unit."""
    name, _ = columns.clock_of(table)
    if not isinstance(name, str):
        return np.nan
    peeked = table.peek(PEEK)
    steps = np.diff(numbers_of(peeked[table.find(name)]))
    return float(np.nanmedian(steps)) if steps.size else np.nan


class _Labels:
    """Labels of the files by their names, and how they were found."""

    def __init__(self, labels: list[dict[str, str]], said: str = "") -> None:
        self.labels, self.said = labels, said


def _check_fields(sources: Sources, asked: Asked, dims: Dims | None) -> None:
    if dims is not None and not any(path.suffix.lower() in _ARRAYS for path in sources.files):
        raise ValueError(
            f"dims names the dimensions of arrays in {' and '.join(_ARRAYS)} files; "
            f"{sources.files[0]} has none."
        )
    for labels in (sources.labels or [])[:1]:
        both = [level for level in asked.levels if level in labels]
        if both:
            raise ValueError(
                f"The pattern has {{{both[0]}}}, and {both[0]}={asked.levels[both[0]]!r} names a "
                "column too: give one of them, and * in the pattern for the other."
            )


def _opened(sources: Sources, number: int, asked: Asked) -> tuple[FileTable, Asked]:
    """A file as a table; files that have a grid of their own have a clock by it."""
    path = sources.files[number]
    of_xdf, of_bids = path.suffix.lower() == ".xdf", is_motion(path)
    if not of_xdf and not of_bids:
        return open_table(path), asked
    table = read_xdf(path, asked.dt) if of_xdf else read_motion(path)
    dt = None if of_xdf else asked.dt
    time = asked.time or (None if dt is not None else "time")
    return table, Asked(asked.inputs, asked.output, time, asked.units, dt, asked.levels)


def _looked_at(
    sources: Sources, asked: Asked, dims: Dims | None
) -> tuple[Path, list[tuple[dict[str, str], FileTable]], Columns, _Labels]:
    """The first file, its structs and columns, and the labels in the names of files."""
    first, asked = _opened(sources, 0, asked)
    keyed = set(LEVELS) & levels_in_names(sources.files, sources.root)
    known = set(sources.labels[0]) if sources.labels else keyed
    if len(sources.files) == 1 and not sources.labels:
        known = set()
    groups = groups_of(first, asked.channels, known & set(LEVELS)) or [({}, first)]
    table = groups[0][1]
    is_array = first.path.suffix.lower() in _ARRAYS
    columns = columns_of(
        first_slices(table, dims) if is_array else table, str(sources.files[0]), asked
    )
    if sources.labels is not None:
        _leave_out(columns, set(sources.labels[0]), asked)
        return first.path, groups, columns, _Labels(sources.labels)
    inside = set(groups[0][0])
    if is_array:
        found, order = parts_of(groups[:1], dict.fromkeys(known, ""), columns, dims)
        inside |= set() if order is None else set(order.names)
        if len(found) > 1:  # else the one run has no label of its own
            inside |= set(found[0].labels) - known
    if len(sources.files) == 1:
        return first.path, groups, columns, _Labels([{}])
    _leave_out(columns, keyed, asked)
    inside |= set(columns.levels.values())
    wanted = [level for level in LEVELS if level not in inside]
    try:
        labels, pattern = names_guess(sources.files, sources.root, wanted)
    except UnclearNamesError:
        if {"subject", "run"} <= inside:  # names of files then say nothing that is needed
            return first.path, groups, columns, _Labels([{} for _ in sources.files])
        if not columns.levels or len(wanted) == len(LEVELS):
            raise
        # Names and columns may say the same: a trial number in both.
        labels, pattern = names_guess(sources.files, sources.root, LEVELS)
        _leave_out(columns, set(labels[0]), asked)
    fields = any(labels)
    return first.path, groups, columns, _Labels(labels, f"labels by {pattern}" if fields else "")


def _leave_out(columns: Columns, known: set[str], asked: Asked) -> None:
    """Columns of labels that the names of files give already, unless a user named them."""
    for name, level in list(columns.levels.items()):
        if level in known and level not in asked.levels:
            del columns.levels[name]
            columns.guess.levels.pop(name, None)
            if columns.guess.run == name:
                columns.guess.run = None


def _counts(X: pd.DataFrame, n_files: int) -> str:
    keys = [name for name in X.index.names if name != TIME]
    sizes = []
    if "subject" in keys:
        people = X.index.unique("subject").size
        sizes.append("1 person" if people == 1 else f"{people} people")
    if "condition" in keys:
        sizes.append(counted(X.index.unique("condition").size, "condition"))
    sizes.append(counted(X.index.droplevel(TIME).unique().size, "run"))
    return f"Files: {n_files}, {', '.join(sizes)}"
