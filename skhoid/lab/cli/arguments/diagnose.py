"""The arguments of ``skhoid diagnose``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from .shared import (
    add_output_options,
    add_plot_options,
    add_recording_options,
    add_search_options,
)

EXAMPLES = """\
examples:
  skhoid diagnose                     bundled recordings of a human tracker
  skhoid diagnose run*.csv            columns are guessed, and said
  skhoid diagnose run*.csv --output stick --x pitch --target command
  skhoid diagnose runs.mat --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --role roll=motion --effects motion_feedback bias
  skhoid diagnose arm.csv --input force --output angle --core arx --nk 1
  skhoid diagnose run*.csv --report out.html --tables out --format pdf
"""


def add_diagnose(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "diagnose",
        "find the effects that a model of your recordings is missing",
        "Fit a model to recorded runs, compare it with them, and find out which "
        "physical effects it is missing, on runs held out of the fit. Without files it uses four "
        "bundled recordings of a person tracking a target.",
        EXAMPLES,
        "[FILES] [OPTIONS]",
    )
    add_recording_options(command)
    add = command.section("Search")
    add_search_options(add)
    add(
        "--domain",
        choices=["human", "machine"],
        help="what was recorded: it decides the words, and which effects are tried (default: "
        "machine for an ARX model, unless it answers the error, target or x of a loop)",
    )
    add = command.section("Output")
    add_plot_options(add, "skhoid-diagnose")
    add("--report", metavar="FILE", help="write a report, one HTML file")
    add(
        "--sketch",
        metavar="FILE",
        help="write the shape of what has no name as an effect of your own, a Python file named "
        "after the effect, such as my_effect.py",
    )
    add("--overwrite", action="store_true", help="replace these FILEs if they exist")
    add_output_options(add)
