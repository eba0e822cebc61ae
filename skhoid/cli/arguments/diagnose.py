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
  skhoid diagnose                          bundled recordings of a human tracker
  skhoid diagnose run*.csv --input e --x x --target f_t --output u --time t
  skhoid diagnose runs.mat --input data.e --output data.u --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --input e --role roll=motion --time t --effects motion_feedback bias
  skhoid diagnose stick.csv --input force --output angle --time t --core arx --na 2 --nb 2 --nk 1
  skhoid diagnose run*.csv --input e --time t --report out.html --tables out
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
    )
    add = command.add_argument
    add_recording_options(add)
    add_search_options(add)
    add(
        "--domain",
        choices=["human", "machine"],
        help="what was recorded: it decides the words, and which effects are tried (default: "
        "machine for an ARX model, unless it answers the error, target or x of a loop)",
    )
    add_plot_options(add, "skhoid-diagnose")
    add("--report", metavar="FILE", help="write a report, one HTML file")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)
