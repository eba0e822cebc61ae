"""Write runs to files that read_runs can read."""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import checked
from ..runs import check_alignment, read_layout
from ._table import require
from .whole import written_whole

__all__ = ["write_runs"]


@checked(path=[str, os.PathLike], overwrite=["boolean"])
def write_runs(X: pd.DataFrame, y: pd.Series, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write runs to a CSV, TSV, Parquet or MATLAB file.

    The file is complete or absent: it is written under a temporary name and then moved into place.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_channels)
        Channels, with the row index levels ``run`` and ``time``.
    y : Series of shape (n_rows,)
        The operator's output, with a name and the same index.
    path : path
        The extension sets the format. ``.csv``, ``.tsv`` and ``.parquet`` (which needs ``pip
        install "skhoid[io]"``) have the columns ``run``, ``time``, those of X, and y. ``.mat``
        (version 5) has one matrix per channel, with one column per run, and a vector ``time``; its
        runs must share their times, and lose their labels.
    overwrite : bool, default=False
        Replace a file that exists. A symbolic link counts as existing wherever it leads, and is
        followed.

    Returns
    -------
    path : Path
        The file.

    Raises
    ------
    FileExistsError
        If the file exists and ``overwrite`` is False.
    ValueError
        If the format is unknown, y has no name of its own, or the runs do not fit into matrices.

    See Also
    --------
    read_runs : Reads such files.

    Examples
    --------
    >>> import tempfile
    >>> from skhoid import make_tracking_runs, read_runs, write_runs
    >>> X, y = make_tracking_runs("C1", n_runs=2, duration=10.0, run_in=10.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_runs(X, y, f"{folder}/runs.csv")
    ...     again, _ = read_runs(path, inputs="e", output="u", time="time", run="run")
    >>> again.equals(X)
    True
    """
    path = Path(path)
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise ValueError(
            f"{path} has the extension {path.suffix!r}; skhoid writes {', '.join(_WRITERS)}."
        )
    if os.path.lexists(path) and not overwrite:  # a link that leads nowhere, too
        raise FileExistsError(f"{path} exists. Choose another name, or give overwrite=True.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"The folder {path.parent} of {path} does not exist.")
    if not isinstance(X, pd.DataFrame):
        raise TypeError(f"X must be a DataFrame with run and time in its index; got {type(X)}.")
    check_alignment(X, y)
    if not isinstance(y, pd.Series) or y.name is None or y.name in X.columns:
        raise ValueError(
            f"y must be a Series whose name is not a column of X, {list(X.columns)}; got "
            f"{getattr(y, 'name', None)!r}."
        )
    layout = read_layout(X)
    table = X.assign(**{str(y.name): y})
    table.attrs = {}
    with written_whole(path) as aside:
        write(table, layout, aside)
    return path


def _write_csv(table: pd.DataFrame, layout: Any, path: Path) -> None:
    table.to_csv(path)


def _write_tsv(table: pd.DataFrame, layout: Any, path: Path) -> None:
    table.to_csv(path, sep="\t")


def _write_parquet(table: pd.DataFrame, layout: Any, path: Path) -> None:
    require("pyarrow", f"Writing the Parquet file {path.name}")
    table.reset_index().to_parquet(path, engine="pyarrow", index=False)


def _write_mat(table: pd.DataFrame, layout: Any, path: Path) -> None:
    from scipy.io import savemat

    starts = layout.run_starts
    times = [layout.time[a:b] for a, b in pairwise(starts)]
    if any(not np.array_equal(times[0], other) for other in times[1:]):
        raise ValueError(
            "Runs with different lengths or times do not fit into one matrix per channel: write "
            "a .csv or .parquet file, or one .mat file per run."
        )
    odd = [name for name in map(str, table.columns) if name == "time" or name.startswith("_")]
    if odd:
        raise ValueError(
            f"A .mat file cannot hold the channel {odd[0]!r}: 'time' is taken, and names must "
            "not begin with an underscore. Rename it, or write another format."
        )
    matrices = {"time": times[0][:, None]}
    for name in table.columns:
        matrices[str(name)] = table[name].to_numpy().reshape(len(times), -1).T
    savemat(path, matrices)


_WRITERS: dict[str, Callable[[pd.DataFrame, Any, Path], None]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mat": _write_mat,
    ".tsv": _write_tsv,
}
