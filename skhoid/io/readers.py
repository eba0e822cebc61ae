"""Read recorded runs into the data convention of skhoid."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT, checked
from ..runs import RUN, TIME, run_index
from ..runs.roles import role_of
from ._complaints import problems_of_files, problems_of_runs
from ._guessing import guess_of
from ._mat import read_mat
from ._parquet import read_parquet
from ._paths import Paths, expand_paths, shown
from ._runs import FileRuns, runs_of
from ._sheet import read_csv
from ._table import FileTable, split_header
from .guess import ColumnGuess, UnclearColumnsError, where_of

__all__ = ["read_runs"]

_READERS: dict[str, Callable[[Path], FileTable]] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".pq": read_parquet,
    ".mat": read_mat,
}


@checked(
    paths=[str, os.PathLike, Iterable],
    time=[str, None],
    units=[Mapping, None],
    dt=DT,
)
def read_runs(
    paths: Paths,
    *,
    inputs: str | Sequence[str] | Mapping[str, str] | None = None,
    output: str | Mapping[str, str] | None = None,
    time: str | None = None,
    run: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read recorded runs from CSV, Parquet or MATLAB files.

    What you do not name is guessed from headers and values, and one printed line says which column
    was taken for what. Name inputs, output, and time or `dt`, and nothing is guessed.

    Nothing is resampled, sorted or left out: rows are as in the files, and missing values are NaN
    (no measurement). The clock is checked when a model is fitted; :func:`skhoid.resample_runs` puts
    irregularly sampled runs onto a grid.

    Parameters
    ----------
    paths : path, glob pattern, or list of these
        Such as ``"data/run*.csv"``. The matches of a pattern are in natural order (run2 before
        run10), a list keeps its own. The extension sets the format: ``.csv``, ``.tsv``, ``.txt``
        (separated by comma, semicolon or tab, with one header row; decimal commas are recognised
        unless the comma is the separator), ``.parquet``, ``.pq``, ``.mat`` (version 5 and 7.3).
        Parquet and MAT 7.3 need ``pip install "skhoid[io]"``.
    inputs : str, list of str, dict or None, default=None
        Input channels, the columns of `X`. A dict renames: ``{name in the file: channel}``. A
        column headed ``e [deg]`` or ``e (deg)`` can be named as ``"e"`` or by its whole header. In
        a MAT file a name is a variable; a dotted one (``"data.e"``) is a field of a struct, whose
        channel is called ``"e"`` unless another one is. None guesses, and names channels by their
        roles, ``e``, ``x`` and ``f_t``; if there is no error, e = f_t - x is computed.
    output : str, dict or None, default=None
        The operator's output, as in `inputs`. None guesses, and names it ``u``.
    time : str or None, default=None
        Column of the time in seconds, or in the unit that `units` or its header states (s, ms,
        us). None is guessed unless `dt` is given.
    run : str or None, default=None
        Column of the run labels; the rows of a run must be contiguous. None means that each file is
        one run, labelled by its name without extension; if anything is guessed, this column is
        guessed too, along with outer levels such as ``subject``.
    units : dict or None, default=None
        Units by channel (and of the time), such as ``{"e": "deg", "time": "ms"}``. They override
        those of the headers. Only the time is ever converted.
    dt : float or None, default=None
        Sampling time in seconds of files without a time column; every run then starts at 0.

    Returns
    -------
    X : DataFrame of shape (n_rows, n_inputs)
        Float64, with the row index levels ``run`` and ``time`` (s). ``X.attrs["units"]`` is a
        dict of the known units of its channels.
    y : Series of shape (n_rows,)
        The output with the same index and ``y.attrs["units"]``.

    Raises
    ------
    FileNotFoundError
        If a file does not exist or a pattern matches none.
    ImportError
        If a format needs a package that is not installed.
    ValueError
        If a file cannot be read as runs; the message names file, column and row.

    Notes
    -----
    An (N, 1) or (1, N) variable of a MAT file is one run. If every channel is an (N, M) matrix,
    its columns are M runs, labelled ``"<file>-1"`` to ``"<file>-M"``, and the time may be one
    vector for all. MATLAB objects such as ``iddata`` cannot be read: save their ``InputData``,
    ``OutputData`` and ``SamplingInstants`` as plain arrays.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid.io import read_runs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("run1", "run2"):
    ...         rows = "t [ms];error [deg];u\\n0;1,5;0\\n10;1,25;-0,5\\n"
    ...         _ = (Path(folder) / f"{name}.csv").write_text(rows)
    ...     X, y = read_runs(f"{folder}/run*.csv", inputs={"error": "e"}, output="u", time="t")
    >>> X
                  e
    run  time
    run1 0.00  1.50
         0.01  1.25
    run2 0.00  1.50
         0.01  1.25
    >>> y.to_list(), X.attrs["units"]
    ([0.0, -0.5, 0.0, -0.5], {'e': 'deg'})

    With nothing named:

    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rows = "".join(f"{10 * k},{k % 7},{k % 5}\\n" for k in range(60))
    ...     path = Path(folder) / "run1.csv"
    ...     _ = path.write_text("Time [ms],Tracking error (deg),stick\\n" + rows)
    ...     X, y = read_runs(path)
    Columns: time "Time [ms]", error e "Tracking error (deg)", output u "stick"
    """
    if run is not None and not isinstance(run, str):
        raise TypeError(
            f"run= must name one column; got {run!r}. Read several subjects or conditions one by "
            'one and join them: pd.concat({"S1": X1, "S2": X2}, names=["subject"]).'
        )
    if inputs is None or output is None or (time is None and dt is None):
        return _guessed(paths, inputs, output, time, run, units, dt)
    files = expand_paths(paths)
    channels = [*_wanted(inputs, "inputs"), *_wanted(output, "output")]
    if all(_READERS.get(path.suffix.lower()) is read_mat for path in files):
        channels = _by_field(channels)
    _check_names(channels)
    clock = _clock(time, dt)
    given = _check_units(units or {}, channels, time)
    return _read(files, channels, clock, given, run)


def _read(
    files: list[Path],
    channels: list[_Channel],
    clock: str | float,
    given: dict[str, str],
    run: str | None,
    levels: Mapping[str, str] | None = None,
    opened: FileTable | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y of files; ``levels`` as in runs_of, with the names of their levels."""
    pieces: list[FileRuns] = []
    known: dict[str, tuple[str, Path]] = {}
    for path in files:
        table = opened if opened is not None and opened.path == path else _open(path)
        pieces.append(
            runs_of(
                table,
                [channel.asked for channel in channels],
                clock=clock,
                time_unit=given.get("time"),
                run=run,
                levels=None if levels is None else list(levels),
            )
        )
        _gather_units(table, channels, given, known)
    if levels is not None:
        pieces = _told_apart(pieces)
    _check_labels(pieces, run)
    return _assemble(
        pieces, [channel.name for channel in channels], known, list((levels or {}).values())
    )


def _told_apart(pieces: list[FileRuns]) -> list[FileRuns]:
    """Files that number their runs alike: the file name is put before the label."""
    labels = [label for piece in pieces for label in piece.labels]
    if len(set(labels)) == len(labels) or len({piece.path for piece in pieces}) < len(pieces):
        return pieces

    def named(piece: FileRuns, label: Any) -> Any:
        own = label[-1] if isinstance(label, tuple) else label
        text = (
            shown(piece.path.stem) if len(piece.labels) == 1 else f"{shown(piece.path.stem)} {own}"
        )
        return (*label[:-1], text) if isinstance(label, tuple) else text

    return [
        replace(piece, labels=[named(piece, label) for label in piece.labels]) for piece in pieces
    ]


def first_table(paths: Paths) -> FileTable:
    """The first of the files, opened."""
    return _open(expand_paths(paths)[0])


def _guessed(
    paths: Paths,
    inputs: Any,
    output: Any,
    time: str | None,
    run: str | None,
    units: Mapping[str, str] | None,
    dt: float | None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read with a guess for what is not named, and print it."""
    named = {} if inputs is None else {c.asked: c.name for c in _wanted(inputs, "inputs")}
    roles = {asked: role_of(name) for asked, name in named.items()}
    table = first_table(paths)
    given: dict[str, Any] = {"roles": roles, "output": output, "time": time, "run": run}
    guess = guess_of(table, paths, **given, units=units, dt=dt, signals=inputs is None)
    if inputs is not None:
        guess.channels = {asked: name for asked, name in named.items() if asked in guess.channels}
    X, y = read_guessed(guess, table)
    print(guess)
    return X, y


def read_guessed(
    guess: ColumnGuess, opened: FileTable | None = None, *, irregular: bool = False
) -> tuple[pd.DataFrame, pd.Series]:
    """Read the files of a guess; one error lists everything that is unclear or wrong in them.

    ``irregular`` allows clocks that are to be resampled.
    """
    files = expand_paths(guess.paths)
    failure: Exception | None = None
    if not guess.problems:
        try:
            X, y = _read_guess(guess, files, opened)
            problems = problems_of_runs(X, y, irregular=irregular)
            if not problems:
                return X, y
        except ValueError as error:
            failure = error
    problems = [*guess.problems, *problems_of_files([_open(path) for path in files], guess)]
    if not problems:
        assert failure is not None
        raise failure
    raise UnclearColumnsError(where_of(files), problems, guess.columns, guess.remarks) from failure


def _read_guess(
    guess: ColumnGuess, files: list[Path], opened: FileTable | None
) -> tuple[pd.DataFrame, pd.Series]:
    assert guess.output is not None
    channels = [
        _Channel(asked, name, renamed=True)
        for asked, name in [*guess.channels.items(), guess.output]
    ]
    _check_names(channels)
    clock = _clock(guess.time, guess.dt)
    given = _check_units(guess.units, channels, guess.time)
    X, y = _read(files, channels, clock, given, guess.run, guess.levels, opened)
    if guess.error_from == "f_t - x":
        names = {role_of(name, guess.roles): name for name in X.columns}
        error = (X[names["f_t"]] - X[names["x"]]).rename("e")
        attributes = {"units": {**X.attrs["units"]}}
        unit = attributes["units"].get(names["x"])
        if unit and unit == attributes["units"].get(names["f_t"]):
            attributes["units"]["e"] = unit
        X.insert(0, "e", error)
        X.attrs = attributes
    elif guess.error_from == "-e":
        X["e"] = -X["e"]
    return X, y


@dataclass(frozen=True)
class _Channel:
    asked: str
    name: str
    renamed: bool = False


def _wanted(spec: Any, argument: str) -> list[_Channel]:
    items: list[tuple[Any, Any]]
    if isinstance(spec, str):
        items = [(spec, split_header(spec)[0])]
    elif isinstance(spec, Mapping):
        items = list(spec.items())
    elif isinstance(spec, Iterable) and argument == "inputs":
        items = [(name, split_header(name)[0] if isinstance(name, str) else name) for name in spec]
    else:
        items = [(spec, spec)]
    for item in items:
        if not all(isinstance(name, str) for name in item):
            raise TypeError(f"{argument} must name channels by strings; got {spec!r}.")
    if not items:
        raise ValueError(f"{argument} is empty: name at least one channel.")
    if argument == "output" and len(items) > 1:
        raise ValueError(f"output must name one channel; got {spec!r}.")
    return [_Channel(*item, renamed=isinstance(spec, Mapping)) for item in items]


def _by_field(channels: list[_Channel]) -> list[_Channel]:
    """Fields of structs under their own names, for guessing roles, where these are unique."""
    fields = [channel.name.rpartition(".")[2] for channel in channels]
    return [
        replace(channel, name=field)
        if not channel.renamed and fields.count(field) == 1
        else channel
        for channel, field in zip(channels, fields, strict=True)
    ]


def _check_names(channels: list[_Channel]) -> None:
    names = [channel.name for channel in channels]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(
            f"The channel {twice!r} is named more than once among inputs and output "
            f"({names}). Name it once, or rename with a dict {{name in the file: channel}}."
        )


def _clock(time: str | None, dt: float | None) -> str | float:
    if time is not None and dt is not None:
        raise ValueError(f"Give the time column ({time!r}) or dt ({dt!r}), not both.")
    if time is not None:
        return time
    if dt is None:
        raise ValueError(
            "There is no clock: name the time column (time='t'), or, if the files have none, "
            "give the sampling time in seconds (dt=0.01)."
        )
    return float(dt)


def _check_units(
    units: Mapping[str, str], channels: list[_Channel], time: str | None
) -> dict[str, str]:
    """Return the given units by channel name, those of the time under ``"time"``."""
    keys = {"time": "time"}
    if time is not None:
        keys |= {time: "time", split_header(time)[0]: "time"}
    for channel in channels:
        keys |= {channel.asked: channel.name, split_header(channel.asked)[0]: channel.name}
    keys |= {channel.name: channel.name for channel in channels}
    unknown = [key for key in units if key not in keys]
    if unknown:
        raise ValueError(
            f"units has {unknown[0]!r}, which is not one of the channels, {list(keys)}."
        )
    return {keys[key]: unit for key, unit in units.items()}


def _open(path: Path) -> FileTable:
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path} has the extension {path.suffix!r}; skhoid reads {', '.join(_READERS)}."
        )
    return reader(path)


def _gather_units(
    table: FileTable,
    channels: list[_Channel],
    given: dict[str, str],
    known: dict[str, tuple[str, Path]],
) -> None:
    for channel in channels:
        unit = given.get(channel.name) or table.unit_of(table.find(channel.asked))
        if not unit:
            continue
        other, path = known.setdefault(channel.name, (unit, table.path))
        if other != unit:
            raise ValueError(
                f"The unit of channel {channel.name!r} is {other!r} in {path} and {unit!r} in "
                f"{table.path}: convert one file, or state the unit in units=."
            )


def _check_labels(pieces: list[FileRuns], run: str | None) -> None:
    first: dict[Any, Path] = {}
    for piece in pieces:
        for label in piece.labels:
            other = first.setdefault(label, piece.path)
            if other is piece.path:
                continue
            if other == piece.path:
                raise ValueError(f"{piece.path} is named twice in paths.")
            advice = (
                "rename a file, or give a column with run labels by run="
                if run is None
                else "give every run its own label"
            )
            raise ValueError(
                f"Two files have a run labelled {label!r}, {other} and {piece.path}: {advice}."
            )


def _assemble(
    pieces: list[FileRuns],
    names: list[str],
    known: dict[str, tuple[str, Path]],
    levels: list[str] | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    for piece in pieces:
        _check_instants(piece)
    labels = [label for piece in pieces for label in piece.labels]
    lengths = np.concatenate([piece.lengths for piece in pieces])
    index = _index(labels, lengths, _joined([piece.time for piece in pieces]), levels or [])
    # Each channel leaves the pieces as it is taken, so that all rows are in memory only once.
    output = _joined([piece.channels.pop() for piece in pieces])
    if len(names) == 2:
        values = _joined([piece.channels.pop() for piece in pieces])[None]
        values = values.copy() if np.may_share_memory(values, output) else values
    else:
        values = np.empty((len(names) - 1, len(index)))
        for k in reversed(range(len(values))):
            values[k] = _joined([piece.channels.pop() for piece in pieces])
    X = pd.DataFrame(np.require(values, requirements="W").T, index, names[:-1], copy=False)
    y = pd.Series(np.require(output, requirements="W"), index, name=names[-1], copy=False)
    units = {name: unit for name, (unit, _) in known.items()}
    X.attrs["units"] = {name: units[name] for name in names[:-1] if name in units}
    y.attrs["units"] = {name: units[name] for name in names[-1:] if name in units}
    return X, y


def _index(
    labels: list[Any], lengths: np.ndarray, time: np.ndarray, levels: list[str]
) -> pd.MultiIndex:
    """The row index, with those of the outer levels that have more than one label."""
    if not levels:
        return run_index(labels, lengths, time)
    inner = run_index(list(range(len(labels))), lengths, time)
    parts = [pd.Categorical(list(column)) for column in zip(*labels, strict=True)]
    names = [*levels, RUN]
    kept = [k for k, part in enumerate(parts) if len(part.categories) > 1 or k == len(levels)]
    return pd.MultiIndex(
        levels=[*(parts[k].categories for k in kept), inner.levels[1]],
        codes=[*(np.repeat(parts[k].codes, lengths) for k in kept), inner.codes[1]],
        names=[*(names[k] for k in kept), TIME],
        verify_integrity=False,
    )


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _check_instants(piece: FileRuns) -> None:
    missing = np.flatnonzero(np.isnan(piece.time))
    if missing.size:
        stops = np.cumsum(piece.lengths)
        k = int(np.searchsorted(stops, missing[0], side="right"))
        row = int(missing[0] - stops[k] + piece.lengths[k])
        raise ValueError(
            f"The time of run {piece.labels[k]!r} in {piece.path} is missing in its row "
            f"{row + 1}: every sample needs a time. If the whole row is empty, delete it: lags "
            "restart after a gap."
        )
