"""The arguments of ``skhoid experiment``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import at_least_one, positive, workers
from .shared import add_model_options, add_output_options, add_run_in, add_search_options

EXAMPLES = """\
examples:
  skhoid experiment                            a small simulated experiment
  skhoid experiment recordings/                labels by names of folders and files
  skhoid experiment "data/{subject}_{condition}_run{run}.csv" --out friday.html
  skhoid experiment all.csv --subject who --condition task --run trial
  skhoid experiment recordings/ --effects none     parameters only, no search
  skhoid experiment recordings/ --resume kept --jobs 4
"""


def add_experiment(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "experiment",
        "several people and conditions: check, identify, search, compare, one HTML file",
        "Read the recordings of several people, check them, find which effects people share, "
        "identify each run, compare the conditions, and write it all down in one HTML file with a "
        "part for each person. Without files it simulates a small experiment.",
        EXAMPLES,
        "[FOLDER_OR_PATTERN] [OPTIONS]",
    )
    add = command.section("Data")
    add(
        "files",
        nargs="*",
        default=(),
        metavar="FOLDER_OR_PATTERN",
        help="a folder, a pattern with {subject}, {condition} and {run}, or files",
    )
    add("--input", metavar="NAME", help="column of the error (default: guessed)")
    add("--output", metavar="NAME", help="output column (default: guessed)")
    add("--x", metavar="NAME", help="the controlled element's output (default: guessed)")
    add("--target", metavar="NAME", help="the target f_t (default: guessed)")
    add("--time", metavar="NAME", help="time column, in seconds (default: guessed)")
    add("--dt", type=positive, metavar="S", help="sampling time of files without a time column")
    for level in ("subject", "condition", "run"):
        add(f"--{level}", metavar="NAME", help=f"column with the {level} (default: by names)")
    add(
        "--unit",
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a channel; 'ms' for time converts it; may be repeated",
    )
    add("--last", type=at_least_one, metavar="N", help="the last N runs of each (default: all)")
    add_run_in(add)
    add_model_options(command.section("Model"), "people")
    add_search_options(command.section("Search"), "; none: no search")
    add = command.section("People")
    add("--reference", metavar="CONDITION", help="compare others with it (default: all pairs)")
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    add("--resume", metavar="FOLDER", help="keep what is finished in FOLDER, and go on from there")
    add = command.section("Output")
    add("--title", metavar="TEXT", help="title of the page")
    add("--out", default="experiment.html", metavar="FILE", help="the file (default: %(default)s)")
    add("--overwrite", action="store_true", help="replace files that exist")
    add_output_options(add)
