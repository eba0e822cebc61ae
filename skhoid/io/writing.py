"""Runs, tables and figures as complete files or none."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy import io as scipy_io

from .._sklearn import checked
from ..runs import RunLayout, check_alignment, read_layout
from .files import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Give a hidden name in the folder of ``path`` to write to, and move the result to ``path``.

    After an error ``path`` is unchanged, and nothing else is left behind. A symbolic link is
    followed: its target is replaced. The file is on the disk before it is moved.
    """
    path = Path(os.path.realpath(path))
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file in it.")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise OSError(f"{path} is not a regular file and is not replaced.")  # a device, a pipe
    # Writers look at the last ending, or at two (.csv.gz).
    aside = path.with_name(f".{token_hex(8)}.tmp{''.join(path.suffixes[-2:])}")
    try:
        yield aside
        with open(aside, "rb+") as file:
            os.fsync(file.fileno())
        aside.replace(path)
    except OSError as error:
        named = error.filename is not None and not is_left_over(Path(error.filename))
        if named or error.errno is None:
            raise
        # The error names the intended file, not the hidden one or none.
        raise OSError(error.errno, os.strerror(error.errno), os.fspath(path)) from error
    finally:
        aside.unlink(missing_ok=True)


def is_left_over(path: Path) -> bool:
    """Whether a file was left by a process that was killed while writing it."""
    return path.name.startswith(".") and ".tmp" in path.suffixes


_LISTS = (list, tuple, np.ndarray)
TABLE_FORMATS = ("tsv", "csv", "parquet")


def check_table_format(form: str) -> None:
    """Refuse a format that cannot be written here before long work begins."""
    if form not in TABLE_FORMATS:
        raise ValueError(f"Tables can be written as {', '.join(TABLE_FORMATS)}; got {form!r}.")
    if form == "parquet":
        require("pyarrow", "Writing Parquet tables")


def write_tables(tables: Mapping[str, pd.DataFrame], folder: str | Path) -> list[Path]:
    """Write tables to a folder, by file name.

    Names end in ``.tsv`` or ``.csv``, with or without ``.gz``, or in ``.parquet``. Named row
    indexes become columns, and lists become text; the second of two columns of the same name gets
    the suffix ``_2``. The files are moved into place when all are complete.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in tables]
    with ExitStack() as moves:
        parts = [moves.enter_context(written_whole(path)) for path in paths]
        for table, part in zip(tables.values(), parts, strict=True):
            _write(_plain(table), part)
    return paths


def _write(table: pd.DataFrame, path: Path) -> None:
    if path.suffix == ".parquet":
        table.to_parquet(path, engine="pyarrow", index=False)
    else:
        table.to_csv(path, sep="\t" if ".tsv" in path.suffixes else ",", index=False)


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns of one type each, under distinct names that are text."""
    unnamed = all(name is None for name in frame.index.names)
    table = frame.reset_index(drop=unnamed, allow_duplicates=True)
    table.attrs = {}
    names: list[str] = []
    for name in table.columns:
        parts = name if isinstance(name, tuple) else (name,)
        text = "_".join(str(part) for part in parts if part != "")
        while text in names:
            text += "_2"
        names.append(text)
    table.columns = names
    for name in table.columns:
        if table[name].dtype != object:
            continue
        cells = table[name].map(
            lambda cell: ", ".join(map(str, cell)) if isinstance(cell, _LISTS) else cell
        )
        if pd.api.types.infer_dtype(cells, skipna=True).startswith("mixed"):
            cells = cells.map(str, na_action="ignore")
        table[name] = cells
    return table


_RUN_FORMATS = (".csv", ".tsv", ".parquet", ".mat")
DPI = 120
EMBEDDED: Any = {"pdf.fonttype": 42, "ps.fonttype": 42}  # TrueType: journals refuse type 3


def save_figure(
    figure: Figure, path: str | Path, *, metadata: dict[str, str] | None = None
) -> Path:
    """Save a figure in the format of the path's ending, and close it.

    Fonts are embedded in PDF and PS as TrueType, as journals demand.
    """
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    path = Path(path)
    with written_whole(path) as aside, mpl.rc_context(EMBEDDED):
        figure.savefig(aside, dpi=DPI, metadata=metadata)
    plt.close(figure)
    return path


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
    suffix = path.suffix.lower()
    if suffix not in _RUN_FORMATS:
        raise ValueError(
            f"{path} has the extension {path.suffix!r}; skhoid writes {', '.join(_RUN_FORMATS)}."
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
    if suffix == ".parquet":
        require("pyarrow", f"Writing the Parquet file {path.name}")
    with written_whole(path) as aside:
        if suffix == ".mat":
            _write_mat(table, layout, aside)
        else:
            _write(table.reset_index(), aside)
    return path


def _write_mat(table: pd.DataFrame, layout: RunLayout, path: Path) -> None:
    times = [layout.time[a:b] for a, b in pairwise(layout.run_starts)]
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
    scipy_io.savemat(path, matrices)
