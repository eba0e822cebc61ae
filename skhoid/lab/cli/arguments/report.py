"""The arguments of ``skhoid report``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from .shared import add_output_options, add_recording_options, add_search_options

EXAMPLES = """\
examples:
  skhoid report                            bundled recordings of a human tracker
  skhoid report run*.csv --out monday.html
  skhoid report run*.csv --effects none    the model as it is, no search
  skhoid report run*.csv --title "Subject 3" --overwrite --tables tables
"""


def add_report(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "report",
        "write a report on a model of your recordings, one HTML file",
        "Do what `skhoid diagnose` does, and write it down in one HTML file that needs "
        "no network: data, model, comparison, ranking, error, parameters, and what to do next. "
        "Without files it uses four bundled recordings of a person tracking a target.",
        EXAMPLES,
        "[FILES] [OPTIONS]",
    )
    add_recording_options(command)
    add_search_options(command.section("Search"), "; none: no search")
    add = command.section("Output")
    add("--title", metavar="TEXT", help="title of the report")
    add("--out", default="report.html", metavar="FILE", help="the file (default: report.html)")
    add("--overwrite", action="store_true", help="replace FILE if it exists")
    add_output_options(add)
