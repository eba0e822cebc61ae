"""Read an experiment: files, labels, columns and clocks of many people."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..._sklearn import DT, checked
from ...io.archives import read_xdf
from ...io.assembling import (
    Channel,
    FileRuns,
    assemble,
    by_field,
    check_names,
    checked_clock,
    checked_units,
    cut_runs,
    gather_units,
    wanted_channels,
)
from ...io.files import FileTable, read_clock, shown, split_header
from ...io.reading import open_table
from ...runs import TIME
from ...runs.roles import role_of
from ...text import counted
from .columns import PEEK, make_guess
from .names import (
    FIELDS,
    LEVELS,
    Sources,
    UnclearNamesError,
    find_sources,
    levels_in_names,
    names_guess,
    natural,
)
from .problems import ColumnGuess, Problem, UnclearColumnsError, said_alone
from .reading import add_error
from .structures import (
    Dims,
    checked_dims,
    first_slices,
    is_motion,
    read_motion,
    runs_of_arrays,
    split_groups,
)
from .words import unit_by_name


@dataclass(frozen=True)
class Asked:
    """What a user has said about columns."""

    inputs: Any
    output: Any
    time: str | None
    units: Mapping[str, str] | None
    dt: float | None
    levels: Mapping[str, str]  # column: level, of which several may be of the condition

    @property
    def channels(self) -> list[str] | None:
        """Columns of the channels that are named; None if none is."""
        named = [
            channel.asked
            for spec, what in ((self.inputs, "inputs"), (self.output, "output"))
            if spec is not None
            for channel in wanted_channels(spec, what)
        ]
        return named or None

    @property
    def complete(self) -> bool:
        """Whether nothing about channels and clock has to be guessed."""
        clock = self.time is not None or self.dt is not None
        return self.inputs is not None and self.output is not None and clock


@dataclass
class Columns:
    """Channels with the output last, clock and labels (column: level) of the files."""

    channels: list[Channel]
    clock: str | float
    units: dict[str, str]
    levels: dict[str, str]
    guess: ColumnGuess
    stated: bool = False  # whether the user gave the unit of the time
    known: dict[str, tuple[str, Path]] = field(default_factory=dict)

    @property
    def run(self) -> str | None:
        """The column that labels runs."""
        return next((name for name, level in self.levels.items() if level == "run"), None)

    @property
    def outer(self) -> dict[str, str]:
        """The other columns of labels."""
        return {name: level for name, level in self.levels.items() if level != "run"}

    @property
    def unit_by_steps(self) -> bool:
        """Whether the unit of the time was guessed from the steps of the first file."""
        by_name = isinstance(self.clock, str) and unit_by_name(self.clock, time=True)
        return self.units.get("time", "s") != "s" and not self.stated and not by_name

    def take_seconds(self) -> None:
        """Drop the unit that was guessed, as the clocks of other files do not look like it."""
        unit = self.units.pop("time")
        self.guess.units.pop("time", None)
        self.guess.time_remark = (
            f"the clock of the first file looks like {unit}, that of others does not: all are "
            "read as s"
        )

    def of_file(self, table: FileTable) -> list[Channel]:
        """The channels under the names that they have in a file, whose units may differ."""
        return [
            Channel(_name_in(table, channel.asked), channel.name, renamed=True)
            for channel in self.channels
        ]

    def find_clock(self, table: FileTable) -> tuple[str | float, str | None]:
        """The clock of a file, and its unit if the header does not say it."""
        if not isinstance(self.clock, str):
            return self.clock, None
        unit = self.units.get("time")
        try:
            name = _name_in(table, self.clock)
        except ValueError:
            if not self.guess.guessed:
                raise
            own = make_guess(table, table.path, signals=False)
            if own.time is None:
                raise
            name, unit = own.time, own.units.get("time")
        if self.stated:
            return name, self.units["time"]
        header = table.names[table.find(name)]
        return name, table.unit_of(table.find(name)) or unit_by_name(header, time=True) or unit


def find_columns(table: FileTable, paths: Any, asked: Asked) -> Columns:
    """The columns of the first file; what is not clear is one error."""
    guess = _guess(table, paths, asked)
    if guess.problems:
        where = shown(table.path)
        unclear = UnclearColumnsError(where, guess.problems, guess.columns, guess.all_remarks)
        raise unclear if guess.guessed else ValueError(str(unclear))
    levels = dict(guess.levels)
    if guess.run is not None:
        levels[guess.run] = "run"
    named = {table.names[table.find(column)]: level for column, level in asked.levels.items()}
    levels = {
        name: level
        for name, level in levels.items()
        if level not in named.values() and name not in named
    }
    levels = named | levels
    used = {*levels, *asked.levels}
    guess.unused = [name for name in guess.unused if name not in used]
    guess.run = next((name for name, level in levels.items() if level == "run"), None)
    guess.levels = {name: level for name, level in levels.items() if level != "run"}
    if asked.inputs is not None:
        inputs = wanted_channels(asked.inputs, "inputs")
        inputs = by_field(inputs) if table.kind == "variable" else inputs
    else:
        inputs = [
            Channel(column, name, renamed=True)
            for column, name in guess.channels.items()
            if column not in used
        ]
    assert guess.output is not None
    channels = [*inputs, Channel(*guess.output, renamed=True)]
    check_names(channels)
    clock = checked_clock(guess.time, guess.dt)
    units = checked_units(guess.units, channels, guess.time)
    stated = "time" in checked_units(dict(asked.units or {}), channels, guess.time)
    return Columns(channels, clock, units, levels, guess, stated)


def _guess(table: FileTable, paths: Any, asked: Asked) -> ColumnGuess:
    named = (
        {}
        if asked.inputs is None
        else {channel.asked: channel.name for channel in wanted_channels(asked.inputs, "inputs")}
    )
    if asked.complete:
        checked_clock(asked.time, asked.dt)
    guess = make_guess(
        table,
        paths,
        roles={column: role_of(name) for column, name in named.items()},
        output=asked.output,
        time=asked.time,
        run=next((column for column, level in asked.levels.items() if level == "run"), None),
        units=asked.units,
        dt=asked.dt,
        signals=asked.inputs is None,
    )
    for column, level in asked.levels.items():
        if level in LEVELS[:2]:
            try:
                table.find(column)
            except ValueError as error:
                guess.problems.append(Problem(said_alone(error)))
    if asked.output is not None and not guess.problems:
        (output,) = wanted_channels(asked.output, "output")
        if table.kind == "variable":
            (output,) = by_field([output])
        guess.output = (output.asked, output.name)
    guess.guessed = not asked.complete
    return guess


def _name_in(table: FileTable, asked: str) -> str:
    """The header by which a file has a column: of the same text, or with another unit."""
    try:
        table.find(asked)
    except ValueError:
        short = split_header(asked)[0]
        if short == asked:
            raise
        table.find(short)
        return short
    return asked


@dataclass(frozen=True)
class Part:
    """One run, and its labels by level."""

    labels: dict[str, Any]
    runs: FileRuns


def split_parts(
    groups: Sequence[tuple[dict[str, str], FileTable]],
    from_file: dict[str, str],
    columns: Columns,
    dims: Dims | None,
) -> tuple[list[Part], Dims | None]:
    """The runs of one file, and what the dimensions of its arrays are, if it has any."""
    found: list[Part] = []
    order = None
    for of_struct, whole in groups:
        channels = columns.of_file(whole)
        clock, unit = columns.find_clock(whole)
        gather_units(whole, channels, columns.units, columns.known)
        asked = [channel.asked for channel in channels]
        tables: list[tuple[dict[str, str], FileTable]] = [({}, whole)]
        if whole.kind == "variable":
            known = [level for level in LEVELS if level in from_file or level in of_struct]
            tables, of_arrays = runs_of_arrays(whole, asked, clock, dims, known)
            order = of_arrays or order
        for of_run, table in tables:
            given = {**from_file, **of_struct, **of_run}
            found += _of_table(table, asked, clock, unit, columns, given)
    if not found:
        raise ValueError(f"{groups[0][1].path} has no run with numbers.")
    return found, order


def _of_table(
    table: FileTable,
    asked: list[str],
    clock: str | float,
    unit: str | None,
    columns: Columns,
    given: dict[str, str],
) -> list[Part]:
    outer = {name: level for name, level in columns.outer.items() if level not in given}
    run = columns.run if "run" not in given else None
    run = table.run_name if run is None and "run" not in given else run
    cut = bool(outer) or "run" not in given  # runs may begin where time begins anew
    runs = cut_runs(
        table,
        asked,
        clock=clock,
        time_unit=unit,
        run=run,
        levels=list(outer) if cut else None,
    )
    found = []
    for label, piece in _each(runs):
        inside = label if isinstance(label, tuple) else (label,)
        labels: dict[str, Any] = {}
        names = [*outer.values(), "run"] if len(inside) == len(outer) + 1 else ["run"]
        for level, one in zip(names, inside if len(names) > 1 else [label], strict=True):
            labels[level] = f"{labels[level]}_{one}" if level in labels else one
        if run is None:
            labels["run"] = "1" if len(runs.labels) == 1 or outer else str(labels["run"])
        labels |= given
        in_order = {level: labels[level] for level in FIELDS if level in labels}
        found.append(Part(in_order, replace(piece, labels=[label])))
    return found


def _each(runs: FileRuns) -> list[tuple[Any, FileRuns]]:
    """The runs of a file one by one."""
    stops = np.cumsum(runs.lengths)
    found = []
    for label, length, stop in zip(runs.labels, runs.lengths, stops.tolist(), strict=True):
        rows = slice(stop - int(length), stop)
        channels = [values[rows] for values in runs.channels]
        one = FileRuns(runs.path, [label], np.array([length]), runs.time[rows], channels)
        found.append((label, one))
    return found


def joined(
    parts: Sequence[Part], columns: Columns, *, keep_order: bool
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y; runs are in natural order of their labels unless told to keep theirs."""
    levels = [level for level in FIELDS if any(level in part.labels for part in parts)]
    for part in parts:
        lacking = [level for level in levels if level not in part.labels and level in LEVELS]
        if lacking:
            raise ValueError(
                f"{part.runs.path} gives no {lacking[0]}, which other files give: give the "
                f"pattern, or read such files alone."
            )
    if not keep_order:
        parts = sorted(parts, key=lambda part: [natural(part.labels.get(k, "")) for k in levels])
    # Sessions and blocks have no level of their own.
    more = [
        level
        for level in ("session", "block")
        if len({part.labels.get(level) for part in parts}) > 1
    ]
    outer = [level for level in levels if level in LEVELS[:2]]
    seen: dict[tuple[Any, ...], Part] = {}
    pieces = []
    for part in parts:
        run = part.labels["run"]
        if more:
            before = [str(part.labels[level]) for level in more if level in part.labels]
            run = "-".join([*before, str(run)])
        label = (*(part.labels[level] for level in outer), run)
        other = seen.setdefault(label, part)
        if other is not part:
            raise ValueError(_twice(other, part, [*outer, "run"], label))
        _check_clock(part, _named([*outer, "run"], label))
        pieces.append(replace(part.runs, labels=[label if outer else run]))
    names = [channel.name for channel in columns.channels]
    return assemble(pieces, names, columns.known, outer or None, every_level=True)


def _named(levels: list[str], label: tuple[Any, ...]) -> str:
    return ", ".join(f"{level} {own!r}" for level, own in zip(levels, label, strict=True))


def _twice(one: Part, other: Part, levels: list[str], label: tuple[Any, ...]) -> str:
    what = _named(levels, label)
    if one.runs.path == other.runs.path:
        return (
            f"{one.runs.path} has two runs of {what}: give each its own label, or name the column "
            "that tells them apart."
        )
    return (
        f"Two files give {what}: {one.runs.path} and {other.runs.path}. Leave one out, or give "
        "the pattern of the names with all that tells them apart, such as "
        "'{subject}/{condition}_{run}.csv'."
    )


def _check_clock(part: Part, what: str) -> None:
    """Refuse a run whose time does not increase."""
    time = part.runs.time
    back = np.flatnonzero(~(np.diff(time) > 0) & ~np.isnan(time[1:]) & ~np.isnan(time[:-1]))
    if back.size:
        row = int(back[0])
        raise ValueError(
            f"The time of {what} in {part.runs.path} does not increase at row {row + 2}: "
            f"{time[row]:.10g} s is followed by {time[row + 1]:.10g} s ({back.size} such rows). "
            "If another run begins there, name the column that labels runs."
        )


_ARRAYS = (".mat", ".npz")


@checked(
    paths=[str, os.PathLike, Iterable],
    subject=[str, None],
    condition=[str, list, tuple, None],
    run=[str, None],
    time=[str, None],
    units=[Mapping, None],
    dt=DT,
    some=[bool],
)
def read_experiment(
    paths: Any,
    *,
    subject: str | None = None,
    condition: str | Sequence[str] | None = None,
    run: str | None = None,
    inputs: str | Sequence[str] | Mapping[str, str] | None = None,
    output: str | Mapping[str, str] | None = None,
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
    dims: Sequence[str] | Mapping[str, Sequence[Any] | None] | None = None,
    some: bool = False,
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
    subject, condition, run : str or None (condition: or sequence of str), default=None
        Columns with these labels. None takes them from names, or from columns that are called so.
        Of several columns of the condition, ``["pace", "state"]``, labels are put together,
        ``fast_tired``; :func:`skhoid.lab.experiment.mixed_model` takes them apart as factors.
    inputs, output, time, units, dt
        As in :func:`skhoid.read_runs`. In structs of people a channel goes by its own name,
        ``"e"``. For XDF, `dt` is the step (s) of the grid onto which all streams are interpolated;
        None takes the nominal rate of the fastest.
    dims : sequence of str, dict or None, default=None
        What the dimensions of arrays in MAT and NPZ files are, such as ``("time", "run",
        "subject")``; a dict also gives labels, ``{"time": None, "run": None, "subject": ["anna",
        "ben"]}``, which else count from ``"1"``. None means samples x runs, samples x runs x
        people, or samples x runs x conditions x people.
    some : bool, default=False
        Whether a pattern may leave out other files of the same kind below its folder. If not, an
        error says how many it matches.

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
    ms is converted where a header or `units` says so, or steps of 2 or more in the files that are
    looked at, which is printed; else :func:`skhoid.check_experiment` names one that looks like it.

    References
    ----------
    Jeung et al. (2024), Motion-BIDS, Scientific Data 11, 716, for the motion tables.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid import read_experiment
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
    several = [condition] if isinstance(condition, str) else list(condition or ())
    if not all(isinstance(one, str) for one in several):
        raise ValueError(f"condition is a column or a list of columns, by name; got {condition!r}.")
    named = [(subject, "subject"), *((one, "condition") for one in several), (run, "run")]
    levels = {column: level for column, level in named if column is not None}
    asked = Asked(inputs, output, time, units, dt, levels)
    shape = checked_dims(dims)
    sources = find_sources(paths, some=some)
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
            groups = split_groups(table, wanted, labels) or [({}, table)]
        found, of_arrays = split_parts(groups, labels, columns, dims)
        order = of_arrays or order
        parts += found
    X, y = joined(parts, columns, keep_order=sources.listed or len(sources.files) == 1)
    add_error(X, columns.guess)
    said = [from_files.said] * bool(from_files.said)
    said += [str(order)] * (order is not None and dims is None)
    said += [sources.remark] * bool(sources.remark)
    by_steps = bool(columns.guess.time_remark)
    if columns.guess.guessed or by_steps or len(asked.levels) < len(columns.levels):
        said.append(str(columns.guess))
    if said:
        print(f"{_counts(X, len(sources.files))}; {'; '.join(said)}")
    return X, y


def _step(table: FileTable, columns: Columns) -> float:
    """The usual step of the clock of a file, in its own unit."""
    name, _ = columns.find_clock(table)
    if not isinstance(name, str):
        return np.nan
    peeked = table.peek(PEEK)
    steps = np.diff(read_clock(peeked[table.find(name)]))
    return float(np.nanmedian(steps)) if steps.size else np.nan


@dataclass(frozen=True)
class _Labels:
    """Labels of the files by their names, and how they were found."""

    labels: list[dict[str, str]]
    said: str = ""


def _check_fields(sources: Sources, asked: Asked, dims: Dims | None) -> None:
    if dims is not None and not any(path.suffix.lower() in _ARRAYS for path in sources.files):
        raise ValueError(
            f"dims names the dimensions of arrays in {' and '.join(_ARRAYS)} files; "
            f"{sources.files[0]} has none."
        )
    for labels in (sources.labels or [])[:1]:
        both = [(level, column) for column, level in asked.levels.items() if level in labels]
        if both:
            raise ValueError(
                f"The pattern has {{{both[0][0]}}}, and {both[0][0]}={both[0][1]!r} names a "
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
    groups = split_groups(first, asked.channels, known & set(LEVELS)) or [({}, first)]
    table = groups[0][1]
    is_array = first.path.suffix.lower() in _ARRAYS
    columns = find_columns(
        first_slices(table, dims) if is_array else table, str(sources.files[0]), asked
    )
    if sources.labels is not None:
        _leave_out(columns, set(sources.labels[0]), asked)
        return first.path, groups, columns, _Labels(sources.labels)
    inside = set(groups[0][0])
    if is_array:
        found, order = split_parts(groups[:1], dict.fromkeys(known, ""), columns, dims)
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
        if level in known and level not in asked.levels.values():
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
