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
from ..runs import run_index
from ._mat import read_mat
from ._parquet import read_parquet
from ._paths import Paths, expand_paths
from ._runs import FileRuns, runs_of
from ._sheet import read_csv
from ._table import FileTable, split_header

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
    inputs: str | Sequence[str] | Mapping[str, str],
    output: str | Mapping[str, str],
    time: str | None = None,
    run: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read recorded runs from CSV, Parquet or MATLAB files.

    Nothing is resampled, sorted or left out: rows come as they are in the files, a missing value
    is NaN (no measurement). What skhoid asks of the clock is checked when a model is fitted;
    :func:`skhoid.resample_runs` brings an irregular clock onto a grid.

    Parameters
    ----------
    paths : path, glob pattern, or list of these
        ``"data/run*.csv"``, say. The matches of a pattern are in natural order (run2 before
        run10), a list keeps its own. The extension sets the format: ``.csv``, ``.tsv``, ``.txt``
        (separator comma, semicolon or tab, one header row; a decimal comma is recognised where
        the separator is none), ``.parquet``, ``.pq``, ``.mat`` (version 5 and 7.3). Parquet and
        MAT 7.3 need ``pip install "skhoid[io]"``.
    inputs : str, list of str, or dict
        Input channels, the columns of `X`. A dict renames: ``{name in the file: channel}``.
        A column headed ``e [deg]`` or ``e (deg)`` is named ``"e"``, or by its whole header. In a
        MAT file a name is a variable, a dotted one (``"data.e"``) the field of a struct, whose
        channel is called ``"e"`` unless another one is.
    output : str or dict
        The operator's output, as in `inputs`.
    time : str or None, default=None
        Column of the time in seconds, or in the unit that `units` or its header states (s, ms,
        us). None needs `dt`.
    run : str or None, default=None
        Column of the run labels; the rows of a run must be contiguous. None means that each file
        is one run, labelled by its name without extension.
    units : dict or None, default=None
        Units by channel (and of the time), for instance ``{"e": "deg", "time": "ms"}``. They
        override those of the headers. Only the time is ever converted.
    dt : float or None, default=None
        Sampling time in seconds of files without a time column; every run then starts at 0.

    Returns
    -------
    X : DataFrame of shape (n_rows, n_inputs)
        Float64, with the row index levels ``run`` and ``time`` (s). ``X.attrs["units"]`` is a
        dict with the known units of its channels.
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
    """
    if run is not None and not isinstance(run, str):
        raise TypeError(
            f"run= names one column; got {run!r}. For subjects or conditions read each by itself "
            'and join them: pd.concat({"S1": X1, "S2": X2}, names=["subject"]).'
        )
    files = expand_paths(paths)
    channels = [*_wanted(inputs, "inputs"), *_wanted(output, "output")]
    if all(_READERS.get(path.suffix.lower()) is read_mat for path in files):
        channels = _by_field(channels)
    _check_names(channels)
    clock = _clock(time, dt)
    given = _check_units(units or {}, channels, time)
    pieces: list[FileRuns] = []
    known: dict[str, tuple[str, Path]] = {}
    for path in files:
        table = _open(path)
        pieces.append(
            runs_of(
                table,
                [channel.asked for channel in channels],
                clock=clock,
                time_unit=given.get("time"),
                run=run,
            )
        )
        _gather_units(table, channels, given, known)
    _check_labels(pieces, run)
    return _assemble(pieces, [channel.name for channel in channels], known)


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
    """Fields of structs under their own names, of which roles are taken, where these are unique."""
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
            f"The channel {twice!r} is wanted more than once among inputs and output "
            f"({names}). Name it once, or rename with a dict {{name in the file: channel}}."
        )


def _clock(time: str | None, dt: float | None) -> str | float:
    if time is not None and dt is not None:
        raise ValueError(f"Give the time column ({time!r}) or dt ({dt!r}), not both.")
    if time is not None:
        return time
    if dt is None:
        raise ValueError(
            "There is no clock: name the time column (time='t'), or give the sampling time in "
            "seconds if the files have none (dt=0.01)."
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
            f"units has {unknown[0]!r}, which is no wanted channel; the channels are {list(keys)}."
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
                "rename a file, or name a column with run labels by run="
                if run is None
                else "give every run its own label"
            )
            raise ValueError(
                f"Two files have a run labelled {label!r}, {other} and {piece.path}: {advice}."
            )


def _assemble(
    pieces: list[FileRuns], names: list[str], known: dict[str, tuple[str, Path]]
) -> tuple[pd.DataFrame, pd.Series]:
    for piece in pieces:
        _check_instants(piece)
    labels = [label for piece in pieces for label in piece.labels]
    lengths = np.concatenate([piece.lengths for piece in pieces])
    index = run_index(labels, lengths, _joined([piece.time for piece in pieces]))
    # Each channel leaves the pieces as it is taken, so that all rows are in memory but once.
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


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _check_instants(piece: FileRuns) -> None:
    missing = np.flatnonzero(np.isnan(piece.time))
    if missing.size:
        stops = np.cumsum(piece.lengths)
        k = int(np.searchsorted(stops, missing[0], side="right"))
        row = int(missing[0] - stops[k] + piece.lengths[k])
        raise ValueError(
            f"The time of run {piece.labels[k]!r} in {piece.path} is missing in its row {row + 1}: "
            "every sample needs its instant. Where the whole row is empty, delete it: that is a "
            "gap, at which lags start anew."
        )
