"""Read recorded runs, with a guess for what is not named."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..._sklearn import DT, checked
from ...io.assembling import (
    Channel,
    by_field,
    check_names,
    checked_clock,
    checked_units,
    wanted_channels,
)
from ...io.files import FileTable, Paths, expand_paths
from ...io.reading import DOTTED, each_table, first_table, read_named
from ...runs import RUN, TIME
from ...runs.roles import role_of
from .columns import make_guess
from .names import LEVELS, UnclearNamesError, names_guess
from .problems import (
    ColumnGuess,
    Problem,
    UnclearColumnsError,
    even_times,
    problems_of_files,
    problems_of_runs,
    quoted,
    where_of,
)


@checked(
    paths=[str, os.PathLike, Iterable],
    time=[str, None],
    units=[Mapping, None],
    dt=DT,
    levels=[Mapping, None],
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
    levels: Mapping[str, str] | None = None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read recorded runs from text, Excel, Parquet, MATLAB, NumPy or XDF files.

    What you do not name is guessed from headers and values, and one printed line says which column
    was taken for what. Name inputs, output, and time or `dt`, and nothing is guessed.

    Nothing is resampled, sorted or left out, but for signals of one run in files with other clocks:
    rows are as in the files, and missing values are NaN (no measurement). A clock that is even but
    for its rounding is taken as even. The clock is checked when a model is fitted;
    :func:`skhoid.resample_runs` puts irregularly sampled runs onto a grid.

    Parameters
    ----------
    paths : path, folder, glob pattern, or list of these
        Such as ``"data/run*.csv"``. The matches of a pattern, and the files in a folder and those
        below it, are in natural order (run2 before run10), a list keeps its own. Files with one
        signal each are one run. The extension sets the format: text (``.csv``, ``.tsv``, ``.txt``,
        ``.dat``, ``.asc``, ``.log``, ``.res``), ``.parquet``, ``.feather``, ``.mat`` (version 5 and
        7.3), ``.npz``, ``.xlsx``, ``.xdf``. Parquet, Feather and MAT 7.3 need ``pip install
        "skhoid[io]"``, Excel ``"skhoid[excel]"``, XDF ``"skhoid[xdf]"``. ``"a.xlsx#Run 2"`` is one
        sheet; else sheets with the same columns are runs.
    inputs : str, list of str, dict or None, default=None
        Input channels, the columns of `X`. A dict renames: ``{name in the file: channel}``. A
        column headed ``e [deg]`` or ``e (deg)`` can be named as ``"e"`` or by its whole header. In
        a MAT file a name is a variable, ``"CMD(:,4)"`` a column of one; a dotted one (``"data.e"``)
        is a field of a struct, whose channel is called ``"e"`` unless another one is. None guesses,
        and names channels by their roles, ``e``, ``x`` and ``f_t``; if there is no error, e = f_t -
        x is computed.
    output : str, dict or None, default=None
        The operator's output, as in `inputs`. None guesses, and names it ``u``.
    time : str or None, default=None
        Column of the time, in the unit that `units` or its header states (s, ms, us, ns); else in
        seconds, unless steps of 2 or more say another one, which is printed. None is guessed
        unless `dt` is given.
    run : str or None, default=None
        Column of the run labels; the rows of a run must be contiguous. None means that each file is
        one run, labelled by its name without extension; if anything is guessed, this column is
        guessed too, along with outer levels such as ``subject``.
    units : dict or None, default=None
        Units by channel (and of the time), such as ``{"e": "deg", "time": "ms"}``. They override
        those of the headers. Only the time is ever converted.
    dt : float or None, default=None
        Sampling time in seconds of files without a time column; every run then starts at 0.
    levels : dict or None, default=None
        Columns whose labels are outer levels of the index, ``{column: level}``, such as
        ``{"person": "subject"}``; a run then also begins where time restarts in a file. None is
        guessed if anything is.

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
    An (N, 1) or (1, N) variable of a MAT or NPZ file is one run. If every channel is an (N, M)
    matrix, its columns are M runs, labelled ``"<file>-1"`` to ``"<file>-M"``, and the time may be
    one vector for all; a matrix whose shape no other has holds a channel per column. MATLAB objects
    such as ``iddata`` cannot be read (tables and timetables need ``pip install "skhoid[matlab]"``);
    the error has the line of MATLAB that converts them.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid import read_runs
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
        return _guessed(paths, inputs, output, time, run, units, dt, levels)
    files = expand_paths(paths)
    channels = [*wanted_channels(inputs, "inputs"), *wanted_channels(output, "output")]
    if all(path.suffix.lower() in DOTTED for path in files):
        channels = by_field(channels)
    check_names(channels)
    clock = checked_clock(time, dt)
    given = checked_units(units or {}, channels, time)
    X, y = read_named(each_table(files), channels, clock, given, run, levels)
    slow = np.median(np.diff(X.index.get_level_values(TIME))) >= 1 if len(X) > 2 else False
    if time is not None and "time" not in given and slow:
        guess = make_guess(first_table(files), paths, output=output, time=time, signals=False)
        if guess.time_remark:
            print(f"{quoted(time)}: {guess.time_remark}")
        given |= {key: unit for key, unit in guess.units.items() if key == "time"}
        X, y = read_named(each_table(files), channels, clock, given, run, levels)
    _even_out(X, y)
    return X, y


def _guessed(
    paths: Paths,
    inputs: Any,
    output: Any,
    time: str | None,
    run: str | None,
    units: Mapping[str, str] | None,
    dt: float | None,
    levels: Mapping[str, str] | None,
) -> tuple[pd.DataFrame, pd.Series]:
    """Read with a guess for what is not named, and print it."""
    named = {} if inputs is None else {c.asked: c.name for c in wanted_channels(inputs, "inputs")}
    roles = {asked: role_of(name) for asked, name in named.items()}
    table = first_table(paths)
    given: dict[str, Any] = {"roles": roles, "output": output, "time": time, "run": run}
    guess = make_guess(table, paths, **given, units=units, dt=dt, signals=inputs is None)
    if inputs is not None:
        guess.channels = {asked: name for asked, name in named.items() if asked in guess.channels}
    if levels is not None:
        guess.levels = dict(levels)
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
    of_runs: list[Problem] = []
    if not guess.problems:
        try:
            X, y = _read_guess(guess, opened)
            guess.remarks += _even_out(X, y)
            of_runs = problems_of_runs(X, y, irregular=irregular)
            if not of_runs:
                return X, y
        except ValueError as error:
            failure = error
    problems = [*guess.problems, *problems_of_files(list(each_table(files, opened)), guess)]
    problems = problems or of_runs
    if not problems:
        assert failure is not None
        raise failure
    raise UnclearColumnsError(
        where_of(files), problems, guess.columns, guess.all_remarks
    ) from failure


def _even_out(X: pd.DataFrame, y: pd.Series) -> list[str]:
    """Take a clock that only rounds its times as the even one that it reads, and say so."""
    found = even_times(X.index)
    if found is None:
        return []
    even, remark = found
    arrays = [X.index.get_level_values(name) for name in X.index.names if name != TIME]
    X.index = y.index = pd.MultiIndex.from_arrays([*arrays, even], names=X.index.names)
    return [remark]


def add_error(X: pd.DataFrame, guess: ColumnGuess) -> None:
    """Form the error e, where the files have none or its opposite."""
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


def _read_guess(guess: ColumnGuess, opened: FileTable | None) -> tuple[pd.DataFrame, pd.Series]:
    assert guess.output is not None
    channels = [
        Channel(asked, name, renamed=True)
        for asked, name in [*guess.channels.items(), guess.output]
    ]
    check_names(channels)
    clock = checked_clock(guess.time, guess.dt)
    given = checked_units(guess.units, channels, guess.time)
    tables = each_table(guess.paths, opened)
    X, y = read_named(tables, channels, clock, given, guess.run, guess.levels)
    add_error(X, guess)
    return _of_subfolders(X, y, guess)


def _of_subfolders(
    X: pd.DataFrame, y: pd.Series, guess: ColumnGuess
) -> tuple[pd.DataFrame, pd.Series]:
    """Subject and condition as levels, where the names of subfolders say them."""
    paths = [guess.paths] if isinstance(guess.paths, str | os.PathLike) else list(guess.paths)
    root = Path(paths[0])
    if len(paths) > 1 or not root.is_dir() or guess.run is not None or guess.levels:
        return X, y
    files, runs = expand_paths(root), X.index.unique(RUN)
    if len(runs) != len(files) or all(path.parent == root for path in files):
        return X, y
    try:
        labels, pattern = names_guess(files, root, LEVELS)
    except UnclearNamesError:
        return X, y
    of_run = pd.DataFrame(labels, index=runs)
    outer = [level for level in LEVELS if level in of_run and level != RUN]
    of_run = of_run.assign(**{RUN: of_run.get(RUN, "1")})[[*outer, RUN]]
    if not outer or of_run.isna().any(axis=None) or of_run.duplicated().any():
        return X, y
    guess.remarks.append(f"labels by {pattern}")
    rows = of_run.loc[X.index.get_level_values(RUN)]
    time = X.index.get_level_values(TIME)
    arrays = [rows[level].to_numpy() for level in rows]
    X.index = y.index = pd.MultiIndex.from_arrays([*arrays, time], names=[*rows, TIME])
    return X, y
