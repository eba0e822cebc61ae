"""Tables of the command line, written into a folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...io.tables import check_table_format
from ...io.tables import write_tables as write_all
from .arguments.shared import TABLES
from .files import check_folders


def check_tables(options: argparse.Namespace) -> None:
    """Refuse tables that cannot be written, before the work begins."""
    if options.tables is None:
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
    named = {f"{name}.{form}": table for name, table in tables.items()}
    return [str(path) for path in write_all(named, folder)]
