"""Files of the command line: recordings to read, and where results go."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .output import note
from .parser import MODELS, PICTURES, TABLES, read_units, refuse

FITTED, FITTED_IN_PART = "fitted", "partly fitted"  # what a model's file says of a run


def read_files(
    options: argparse.Namespace, roles: dict[str, str], *, signals: bool = True
) -> tuple[Any, Any, Any]:
    """X and y of the files that the options name, and which column was taken for what.

    ``roles`` are the channels that are named; without ``signals`` no others are taken.
    """
    from ..guessing import guess_columns
    from ..opening import read_chosen

    if options.dt is not None and options.time is None:
        refuse(options, ["resample"], "needs --time NAME: with --dt the clock is regular.")
    if options.time is not None and options.dt is not None and not options.resample:
        raise ValueError("--time and --dt both say where time comes from: give one of them.")
    guess = guess_columns(
        options.files,
        roles=roles,
        output=options.output,
        time=options.time,
        run=options.run,
        units=read_units(options),
        dt=None if options.resample else options.dt,
        signals=signals,
    )
    X, y = read_chosen(guess, options)
    options.columns = guess
    options.recorded = _mark_runs(y)
    clock = X.index.get_level_values("time")
    if options.time is not None and not options.resample and (clock[1:2] - clock[:1] == 1.0).all():
        note(
            f"{options.time} advances by 1 a row, counted as 1 s; if it holds row numbers, give "
            "--dt SECONDS in place of --time."
        )
    return X, y, guess


def _mark_runs(y: Any) -> dict[str, str]:
    """A checksum of the measured output of each run: labels such as 0 and 1 are in every file."""
    import joblib

    from ...runs import run_name

    levels = [name for name in y.index.names if name != "time"]
    runs = y.groupby(level=levels[0] if len(levels) == 1 else levels, sort=False)
    return {run_name(label): joblib.hash(part.to_numpy(dtype=float)) for label, part in runs}


def show_names(files: Iterable[str]) -> str:
    """Files as text that every output takes, also where their names are not UTF-8."""
    from ...io import shown

    return ", ".join(map(shown, files))


def find_column(X: Any, asked: str) -> str:
    """Column of X that was asked for by its header, with its unit, or as a field of a struct."""
    from ...io import split_header

    name = asked if asked in X else split_header(asked)[0]
    return name if name in X else name.rpartition(".")[2]


def describe_runs(layout: Any, inputs: list[str], y: Any, units: dict[str, str]) -> str:
    """How many runs and rows there are, of which input and output."""
    from ...runs import output_name
    from ...text import counted

    def named(channel: str) -> str:
        return f"{channel} ({units[channel]})" if units.get(channel) else channel

    seconds = layout.n_rows * layout.dt
    whole = f"{seconds:.0f}" if seconds >= 100 else f"{seconds:.3g}"
    return (
        f"Measured: {counted(len(layout.labels), 'run')}, {layout.n_rows} rows at "
        f"{1 / layout.dt:.6g} Hz, {whole} s in all; "
        f"input {', '.join(map(named, inputs))}, output {named(output_name(y))}"
    )


# What is to be written is checked before the work begins.


def new_file(name: str, overwrite: bool, *, new_folder: bool = False) -> Path:
    """A file to write; its folder may be a new one."""
    path = Path(name)
    if path.is_dir():
        raise ValueError(f"{path} is a folder; name a file in it.")
    if os.path.lexists(path) and not overwrite:  # a link that leads nowhere, too
        raise ValueError(f"{path} exists; choose another name, or --overwrite.")
    if not new_folder and not path.parent.exists():
        raise ValueError(f"The folder {path.parent} of {path} does not exist.")
    _check_parents(path)
    return path


def model_file(options: argparse.Namespace) -> Path | None:
    """The file of --save, if a model is to be kept."""
    if options.save is None:
        return None
    if not options.save.endswith(MODELS):
        raise ValueError(f"--save writes a file such as model{MODELS[0]}; got {options.save}.")
    return new_file(options.save, options.overwrite)


def check_plot_file(name: str, overwrite: bool) -> None:
    """The file of a plot, of a format that can be drawn."""
    from matplotlib.figure import Figure

    path = new_file(name, overwrite)
    formats = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in formats:
        raise ValueError(f"{path} is no image file; its name ends in one of {', '.join(formats)}.")


def figure_folder(options: argparse.Namespace, default: str) -> Path | None:
    """The folder for the plots, if any are drawn."""
    if options.no_pictures:
        refuse(options, ["out", "format"], "is for the plots, and --no-pictures draws none.")
        return None
    folder = Path(options.out or default)
    check_folders(folder)
    return folder


def check_tables(options: argparse.Namespace) -> None:
    """Tables that are asked for, in a format that can be written."""
    from ...io import check_table_format

    if options.tables is not None:
        check_folders(options.tables)
        check_table_format(options.table_format or TABLES)


def check_folders(*names: str | Path | None) -> None:
    """Refuse folders that cannot be made or written into."""
    for name in names:
        if name is None:
            continue
        if Path(name).exists() and not Path(name).is_dir():
            raise ValueError(f"{name} is a file; name a folder.")
        _check_parents(Path(name) / "file")


def _check_parents(path: Path) -> None:
    """The nearest folder that exists must let others be made in it."""
    folder = next(parent for parent in path.parents if os.path.lexists(parent))
    if not folder.is_dir():
        raise ValueError(f"{folder} is a file and no folder; choose another place than {path}.")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"The folder {folder} may not be written into; choose another place.")


# And then written.


def save_model(
    model: Any,
    path: Path | None,
    options: argparse.Namespace,
    fitted: tuple[Any, Any] | None = None,
) -> str | None:
    """Write a fitted model if it is asked for, and beside it which runs it knows; gives the path.

    ``fitted`` are the names of runs, row by row, and whether the model was fitted on that row; None
    if it was fitted on all of them.
    """
    import joblib
    import pandas as pd

    if path is None:
        return None
    recorded = getattr(options, "recorded", {})
    share = pd.Series(1.0, index=list(recorded))
    if fitted is not None:
        share = pd.Series(fitted[1], index=fitted[0], dtype=float).groupby(level=0).mean()
    model.fitted_runs_ = {
        recorded[run]: FITTED if part == 1 else FITTED_IN_PART
        for run, part in share.items()
        if part > 0 and run in recorded
    }
    joblib.dump(model, path)
    return str(path)


def save_tables(tables: dict[str, Any], options: argparse.Namespace) -> list[str]:
    """Write tables if they are asked for; returns the paths."""
    if options.tables is None:
        return []
    return write_tables(tables, options.tables, options.table_format or TABLES)


def write_tables(tables: dict[str, Any], folder: str | Path, form: str) -> list[str]:
    """Write tables by name; returns the paths."""
    from ... import io

    named = {f"{name}.{form}": table for name, table in tables.items()}
    return [str(path) for path in io.write_tables(named, folder)]


def without_screen() -> None:
    """Draw into files, so that it works on machines without a display too."""
    import matplotlib

    matplotlib.use("Agg")


def save_figures(
    figures: dict[str, Any],
    folder: Path,
    command: str,
    form: str | None = None,
    *,
    others: Iterable[str] = (),
    named: tuple[Any, Any] | None = None,
) -> list[str]:
    """Save figures by name, in a format, "png" by default; returns the paths.

    Those of the ``others`` that the same command drew into the folder before are deleted. ``named``
    is X and y, whose names appear in the figures.
    """
    from ...io import save_figure
    from ...plotting import names_as_they_are

    form = form or "png"
    software = f"skhoid {command}"
    folder.mkdir(parents=True, exist_ok=True)
    for name in set(others) - set(figures):
        path = folder / f"{name}.{form}"
        if path.is_file() and software.encode() in path.read_bytes():  # pictures say who drew them
            path.unlink()
    shown = [] if named is None else _names(*named)
    paths = []
    for name, figure in figures.items():
        names_as_they_are(figure, shown)
        key = "Software" if form.lower() == "png" else "Creator"
        known = form.lower() in PICTURES
        paths.append(folder / f"{name}.{form}")
        save_figure(figure, paths[-1], metadata={key: software} if known else None)
    return list(map(str, paths))


def _names(X: Any, y: Any) -> list[str]:
    """Names in the data that figures may show."""
    names = [*X.columns, y.name]
    for data in (X, y):
        names += data.attrs.get("units", {}).values()
    for level in getattr(X.index, "levels", []):
        if level.name != "time":
            names += list(level)
    return list(map(str, names))
