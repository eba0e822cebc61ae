"""Files of the command line: recordings to read, and where results go."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

ABOUT_FILES = ["time", "dt", "run", "unit", "resample"]
ABOUT_FILES += ["input", "output", "x", "target", "role", "display"]  # channels, and what was seen


def at_least_one(text: str) -> int:
    """A whole number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, at least 1; got {text!r}")
    return int(text)


def add_file_options(add: Callable[..., Any]) -> None:
    """Options that say which files, and what is in them."""
    add("files", nargs="*", metavar="FILES", help="CSV, Parquet or MAT files, or patterns")
    add("--output", metavar="NAME", help="output channel (default: u)")
    add("--time", metavar="NAME", help="time channel, in seconds")
    add("--run", metavar="NAME", help="column with run labels (default: one file is one run)")
    add("--dt", type=float, metavar="S", help="sampling time, for files without a time channel")
    add(
        "--unit",
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a channel; 'ms' for time converts it; may be repeated",
    )
    add(
        "--resample",
        action="store_true",
        help="bring an irregular clock onto a regular grid by interpolation first",
    )


def pairs(items: Iterable[str], option: str, example: str) -> dict[str, str]:
    """NAME=VALUE words of an option that may be repeated."""
    found = {}
    for item in items:
        name, sign, value = item.partition("=")
        if not sign:
            raise ValueError(f"{option} takes {example}; got {item!r}.")
        found[name] = value
    return found


def read_files(options: argparse.Namespace, inputs: list[str]) -> tuple[Any, Any]:
    """X and y of the files that the options name."""
    from .. import read_runs, resample_runs

    if options.time is None and options.dt is None:
        raise ValueError("Say where time comes from: --time NAME, or --dt SECONDS.")
    units = pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg")
    X, y = read_runs(
        options.files,
        inputs=inputs,
        output=options.output or "u",
        time=options.time,
        run=options.run,
        units=units or None,
        dt=options.dt,
    )
    return resample_runs(X, y, dt=options.dt) if options.resample else (X, y)


def check_no_files(options: argparse.Namespace) -> None:
    """Refuse options about files where there are none, before bundled recordings are used."""
    for name in ABOUT_FILES:
        if getattr(options, name, None) not in (None, [], False):
            raise ValueError(
                f"--{name} is about files, and there are none. Options that take several words "
                "also take files that follow: name the files first."
            )


def new_file(name: str, overwrite: bool) -> Path:
    """A file to write, checked before the work begins."""
    path = Path(name)
    if path.is_dir():
        raise ValueError(f"{path} is a folder; name a file in it.")
    if path.exists() and not overwrite:
        raise ValueError(f"{path} exists; choose another name, or --overwrite.")
    return path


def check_picture(name: str, overwrite: bool) -> None:
    """A picture to draw, checked before the work begins."""
    from matplotlib.figure import Figure

    path = new_file(name, overwrite)
    if not path.parent.is_dir():
        raise ValueError(f"The folder {path.parent} of {path} does not exist.")
    formats = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in formats:
        raise ValueError(f"{path} is no picture; its name ends in one of {', '.join(formats)}.")


def check_folders(*names: str | None) -> None:
    """Refuse, before the work begins, folders that are files."""
    for name in names:
        if name is not None and Path(name).is_file():
            raise ValueError(f"{name} is a file; name a folder.")


def without_screen() -> None:
    """Draw into files, on machines without a display too."""
    import matplotlib

    matplotlib.use("Agg")


def save_figures(figures: dict[str, Any], folder: Path) -> list[str]:
    """Save figures by file name, and close them; returns the paths."""
    import matplotlib.pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=120)
        plt.close(figure)
    return [str(folder / name) for name in figures]
