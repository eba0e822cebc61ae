"""Results of the command line, for other programs: JSON and tables."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .files import check_folders
from .options import refuse

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 100  # columns
TABLES = "tsv"


def add_output_options(add: Callable[..., Any], tables: bool = True) -> None:
    """Options that every command has, and those of tables."""
    if tables:
        add("--tables", metavar="FOLDER", help="write every table to FOLDER")
        add_table_format(add, TABLES)
    add("--json", action="store_true", help="print the results as JSON, and nothing else")
    add("--debug", action="store_true", help="show tracebacks of errors (exit code 1)")


def add_table_format(add: Callable[..., Any], default: str) -> None:
    """The option that says in which format tables are written."""
    add(
        "--table-format",
        choices=["tsv", "csv", "parquet"],
        help=f"tab-separated or comma-separated text, or Parquet (default: {default})",
    )


def check_tables(options: argparse.Namespace) -> None:
    """Say what hinders tables before the work begins."""
    from ..io.tables import check_table_format

    if options.tables is None:
        refuse(options, ["table_format"], "needs --tables FOLDER: else no tables are written.")
        return
    check_folders(options.tables)
    check_table_format(options.table_format or TABLES)


def save_tables(tables: dict[str, Any], options: argparse.Namespace) -> list[str]:
    """Write tables if they are asked for; returns the paths."""
    if options.tables is None:
        return []
    return write_tables(tables, options.tables, options.table_format or TABLES)


def write_tables(tables: dict[str, Any], folder: str | Path, form: str) -> list[str]:
    """Write tables by name; returns the paths."""
    from ..io import tables as files

    named = {f"{name}.{form}": table for name, table in tables.items()}
    return [str(path) for path in files.write_tables(named, folder)]


def print_json(found: dict[str, Any]) -> None:
    """Print one JSON document; it has no NaN, so null stands for it."""
    print(json.dumps(_finite(found), indent=2, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "item"):  # a number of NumPy
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def say(text: str, options: argparse.Namespace) -> None:
    """Print for people: with JSON on the output, nowhere."""
    if not options.json:
        print(text, flush=True)


def note(text: str) -> None:
    """Print beside the results, on one line."""
    print(f"skhoid: note: {' '.join(text.split())}", file=sys.stderr)


def make_console() -> Console:
    """A console that prints tables, and names as they are."""
    from rich.console import Console

    # Piped output has no width of its own.
    width = None if sys.stdout.isatty() else WIDTH
    return Console(highlight=False, markup=False, emoji=False, soft_wrap=True, width=width)


def print_wrapped(line: str) -> None:
    """Print a line, wrapped under its indentation, at once."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    print(
        textwrap.fill(
            line, WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
        ),
        flush=True,
    )


def say_files(files: dict[str, Any]) -> None:
    """Say what was written where."""
    if files.get("report"):
        print_wrapped(f"Report: {files['report']} (one file; open it in a browser)")
    for what in ("pictures", "tables", "files"):
        paths = [Path(name) for name in files.get(what, [])]
        if paths:
            names = ", ".join(path.name for path in paths)
            print_wrapped(f"{what.capitalize()} in {paths[0].parent}: {names}")
